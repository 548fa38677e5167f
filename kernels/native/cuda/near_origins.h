// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What is nearer than the near plane hides what is behind it, as in near_occludes.h, and rays begin beside the eye.

struct NearPlane {
    float reach;  // how far from the eye

    static inline NearPlane of(float, float reach) { return NearPlane{reach}; }
    static inline bool cuts(float) { return false; }
    static inline bool shows(float, bool) { return true; }
    static inline float most(float endless) { return endless; }
    static inline bool clips() { return false; }
    // How far beyond a coordinate of a box the eye has to be for all of the box to be beside all rays' origins.
    inline float below(float value) const { return value - reach; }
    inline float above(float value) const { return value + reach; }
};
