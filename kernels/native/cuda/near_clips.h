// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What is nearer than the near plane is not there.

struct NearPlane {
    float most_inv_z;  // of what is there
    float reach;  // how far from the camera the plane's corners are

    static inline NearPlane of(float most_inv_z, float reach) { return NearPlane{most_inv_z, reach}; }
    inline bool shows(float inv_z) const { return inv_z <= most_inv_z; }
    static inline bool clips() { return true; }
    // How far beyond a coordinate of a box the camera has to be for all of the box to be there.
    inline float below(float value) const { return value - reach; }
    inline float above(float value) const { return value + reach; }
};
