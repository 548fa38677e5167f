// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What is nearer than the near plane is not there.

struct NearPlane {
    float most_inv_z;  // of what is there
    float reach;  // how far from the camera the plane's corners are

    static inline NearPlane of(float most_inv_z, float reach) { return NearPlane{most_inv_z, reach}; }
    // Whether part of what is nowhere nearer than 1 / max_inv_z is not there; and whether a place of it is there.
    inline bool cuts(float max_inv_z) const { return max_inv_z > most_inv_z; }
    inline bool shows(float inv_z, bool cut) const { return !cut || inv_z <= most_inv_z; }
    inline float most(float) const { return most_inv_z; }
    static inline bool clips() { return true; }
    // How far beyond a coordinate of a box the camera has to be for all of the box to be there.
    inline float below(float value) const { return value - reach; }
    inline float above(float value) const { return value + reach; }
};
