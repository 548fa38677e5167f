// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Where the rays of a packet's pixels pass: near their centres, as a table has it (warpvis/rendering/_ray_packets.py).
// See grid_places.h for the other kind.

struct Places : NoPoints {
    const ImagePoint* points;  // in the order of the z-buffer; of pixels without a ray, their centres
    const ImagePoint* rests;  // what rounding took from them

    inline ImagePoint point(const Camera&, int, int, int index) const { return points[index]; }
    inline ExactImagePoint exact(const Camera&, int, int, int index) const {
        const ImagePoint p = points[index], rest = rests[index];
        return ExactImagePoint{(double)p.u + rest.u, (double)p.v + rest.v};
    }
};
