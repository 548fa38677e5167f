// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Where rays of a table pass that are in no order: anywhere in their packet's image, as the table has it
// (warpvis/rendering/_ray_images.py). See table_places.h for rays that pass near the centres of pixels.

struct Places : PointIndex {
    const ImagePoint* points;  // in the order of the z-buffer; of slots without a ray, one of the image
    const ImagePoint* rests;  // what rounding took from them
    RayStarts starts;

    inline RayPlace point(const Camera&, int, int, int index) const { return starts.of(points[index], index); }
    inline ExactRayPlace exact(const Camera&, int, int, int index) const {
        const ImagePoint p = points[index], rest = rests[index];
        return starts.of(ExactImagePoint{(double)p.u + rest.u, (double)p.v + rest.v}, index);
    }
    inline bool is_behind(float inv_z, int index) const { return starts.is_behind(inv_z, index); }
};
