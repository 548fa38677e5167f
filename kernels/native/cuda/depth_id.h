// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Z-buffer key if objects or normals were requested: 1 / z of the nearest surface and the id of its triangle. The
// greatest key is the nearest; at equal depth the lesser id wins, independent of the order of drawing.

typedef unsigned long long Key;

struct DepthKey {
    enum { HAS_ID = true };

    static inline Key of(float inv_z, unsigned id) { return ((Key)__float_as_uint(inv_z) << 32) | ~id; }
    static inline unsigned inv_z_bits(Key key) { return (unsigned)(key >> 32); }
    static inline unsigned id(Key key) { return ~(unsigned)key; }
};
