// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Keys of a z-buffer: the greatest is the nearest.

#pragma once

#include "cuda/variant.h"

// If neither objects nor normals were requested: 1 / z of the nearest surface.
struct DepthOnlyKey {
    typedef unsigned Key;

    enum { HAS_ID = false };

    static inline Key of(float inv_z, unsigned) { return __float_as_uint(inv_z); }
    static inline unsigned inv_z_bits(Key key) { return key; }
    static inline unsigned id(Key) { return 0; }
};

// Otherwise, 1 / z of the nearest surface and the id of its triangle; at equal depth the lesser id wins, independent of
// the order of drawing.
struct DepthIdKey {
    typedef unsigned long long Key;

    enum { HAS_ID = true };

    static inline Key of(float inv_z, unsigned id) { return ((Key)__float_as_uint(inv_z) << 32) | ~id; }
    static inline unsigned inv_z_bits(Key key) { return (unsigned)(key >> 32); }
    static inline unsigned id(Key key) { return ~(unsigned)key; }
};

typedef Select<WITH_ID>::Type<DepthIdKey, DepthOnlyKey> DepthKey;
typedef DepthKey::Key Key;
