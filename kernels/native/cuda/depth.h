// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What a packet keeps of each pixel where nobody asks for objects: w = 1 / z of the nearest surface. Bits of floats that
// are not negative are in the floats' order. See cuda_depth_id.h for the other kind.

typedef unsigned Key;

struct Nearest {
    enum { has_id = false };

    static inline Key key(float w, unsigned) { return __float_as_uint(w); }
    static inline unsigned w_bits(Key key) { return key; }
    static inline unsigned id(Key) { return 0; }
};
