// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What the z-buffer keeps of a pixel where somebody asks for objects or normals: 1 / z of the nearest surface, and
// which triangle it is. The greatest key is the nearest; of two at one depth, that of the lesser id, whichever comes
// first.

typedef unsigned long long Key;

struct DepthKey {
    enum { HAS_ID = true };

    static inline Key of(float inv_z, unsigned id) { return ((Key)__float_as_uint(inv_z) << 32) | ~id; }
    static inline unsigned inv_z_bits(Key key) { return (unsigned)(key >> 32); }
    static inline unsigned id(Key key) { return ~(unsigned)key; }
};
