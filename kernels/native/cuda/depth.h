// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Z-buffer key if object ids were not requested: 1 / z of the nearest surface. The bit patterns of nonnegative floats
// sort like the floats. See depth_id.h for the other kind.

typedef unsigned Key;

struct DepthKey {
    enum { HAS_ID = false };

    static inline Key of(float inv_z, unsigned) { return __float_as_uint(inv_z); }
    static inline unsigned inv_z_bits(Key key) { return key; }
    static inline unsigned id(Key) { return 0; }
};
