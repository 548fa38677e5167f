// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The near plane, which removes surfaces nearer than it, or lets them hide what lies behind them.

#pragma once

#include "cuda/variant.h"

// Clipping near plane: surfaces nearer than it are removed.
struct ClippingPlane {
    float clip_inv_z;  // limit of 1 / z for visible surfaces
    float reach;  // distance of the near plane's corners from the camera

    static inline ClippingPlane of(float clip_inv_z, float reach) { return ClippingPlane{clip_inv_z, reach}; }
    // Whether the near plane may clip a surface whose greatest 1 / z is max_inv_z; and whether a point of it remains
    // visible.
    inline bool cuts(float max_inv_z) const { return max_inv_z > clip_inv_z; }
    inline bool shows(float inv_z, bool cut) const { return !cut || inv_z <= clip_inv_z; }
    inline float max_inv_z(float) const { return clip_inv_z; }
    static inline bool clips() { return true; }
    // Coordinates of a box, moved by `reach`: a camera beyond them sees the box unclipped.
    inline float below(float value) const { return value - reach; }
    inline float above(float value) const { return value + reach; }
};

// Occluding near plane.
struct OccludingPlane {
    static inline OccludingPlane of(float, float) { return OccludingPlane{}; }
    static inline bool cuts(float) { return false; }
    static inline bool shows(float, bool) { return true; }
    static inline float max_inv_z(float endless) { return endless; }
    static inline bool clips() { return false; }
    static inline float below(float value) { return value; }
    static inline float above(float value) { return value; }
};

// Occluding near plane for rays with distinct origins.
struct OriginsPlane : OccludingPlane {
    float reach;  // greatest distance of a ray origin from the eye

    static inline OriginsPlane of(float, float reach) {
        OriginsPlane plane;
        plane.reach = reach;
        return plane;
    }
    // Coordinates of a box, moved by `reach`: if the eye is beyond them, all ray origins are outside the box.
    inline float below(float value) const { return value - reach; }
    inline float above(float value) const { return value + reach; }
};

typedef Select<RAY_ORIGINS>::Type<OriginsPlane, Select<CLIPS>::Type<ClippingPlane, OccludingPlane>> NearPlane;
