// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Unordered rays of a ray table: anywhere in their packet's image (warpvis/rendering/_ray_images.py). See
// table_places.h for rays near the centers of pixels.

struct Places : PointIndex {
    const ImagePoint* points;  // in the order of the z-buffer; some point of the image for slots without a ray
    const ImagePoint* rests;  // rounding errors of the points
    RayStarts starts;

    inline RayPlace point(const Camera&, int, int, int index) const { return starts.of(points[index], index); }
    inline ExactRayPlace exact(const Camera&, int, int, int index) const {
        const ImagePoint p = points[index], error = rests[index];
        return starts.of(ExactImagePoint{(double)p.u + error.u, (double)p.v + error.v}, index);
    }
    inline bool is_behind(float inv_z, int index) const { return starts.is_behind(inv_z, index); }
};
