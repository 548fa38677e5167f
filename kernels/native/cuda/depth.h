// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What the z-buffer keeps of a pixel where nobody asks for objects: 1 / z of the nearest surface. Bits of floats that
// are not negative are in the floats' order. See depth_id.h for the other kind.

typedef unsigned Key;

struct DepthKey {
    enum { HAS_ID = false };

    static inline Key of(float inv_z, unsigned) { return __float_as_uint(inv_z); }
    static inline unsigned inv_z_bits(Key key) { return key; }
    static inline unsigned id(Key) { return 0; }
};
