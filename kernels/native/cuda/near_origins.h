// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Occluding near plane as in near_occludes.h, for rays with distinct origins.

struct NearPlane {
    float reach;  // greatest distance of a ray origin from the eye

    static inline NearPlane of(float, float reach) { return NearPlane{reach}; }
    static inline bool cuts(float) { return false; }
    static inline bool shows(float, bool) { return true; }
    static inline float max_inv_z(float endless) { return endless; }
    static inline bool clips() { return false; }
    // Coordinates of a box, moved by `reach`: if the eye is beyond them, all ray origins are outside the box.
    inline float below(float value) const { return value - reach; }
    inline float above(float value) const { return value + reach; }
};
