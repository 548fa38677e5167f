// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What a packet keeps of each pixel where somebody asks for objects or normals: w = 1 / z of the nearest surface, and
// which triangle it is. The greatest key is the nearest; of two at one depth, that of the lesser id, whichever comes
// first.

typedef unsigned long long Key;

struct Nearest {
    enum { has_id = true };

    static inline Key key(float w, unsigned id) { return ((Key)__float_as_uint(w) << 32) | ~id; }
    static inline unsigned w_bits(Key key) { return (unsigned)(key >> 32); }
    static inline unsigned id(Key key) { return ~(unsigned)key; }
};
