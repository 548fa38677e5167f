// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Where rays of a table pass that are in no order: anywhere in their packet's image, as the table has it
// (warpvis/rendering/_ray_images.py). See table_places.h for rays that pass near the centres of pixels.

struct Places : PointIndex {
    const ImagePoint* points;  // in the order of the z-buffer; of slots without a ray, one of the image
    const ImagePoint* rests;  // what rounding took from them

    inline ImagePoint point(const Camera&, int, int, int index) const { return points[index]; }
    inline ExactImagePoint exact(const Camera&, int, int, int index) const {
        const ImagePoint p = points[index], rest = rests[index];
        return ExactImagePoint{(double)p.u + rest.u, (double)p.v + rest.v};
    }
};
