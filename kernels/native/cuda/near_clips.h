// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Clipping near plane: surfaces nearer than the near plane are removed.

struct NearPlane {
    float clip_inv_z;  // limit of 1 / z for visible surfaces
    float reach;  // distance of the near plane's corners from the camera

    static inline NearPlane of(float clip_inv_z, float reach) { return NearPlane{clip_inv_z, reach}; }
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
