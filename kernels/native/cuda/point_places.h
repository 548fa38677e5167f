// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rays of a packet of points pass anywhere in its image (points.h). See grid_places.h for pixels.

struct Places : PointIndex {
    enum { NO_POINT = -0x7fffffff - 1 };

    const ImagePoint* list;  // points of the view [px], from the image's corner
    double scale, center[2];  // u is `scale` times the distance to the right of the center
    ImagePoint points[SLOTS];  // u and v
    int place[SLOTS];  // index in the list; the complement of the index if the point is outside the image; NO_POINT

    inline ImagePoint point(const Camera&, int, int, int index) const { return points[index]; }
    inline ExactImagePoint exact(const Camera&, int, int, int index) const { return exact(list[max(place[index], 0)]); }
    inline ExactImagePoint exact(ImagePoint pixel) const {
        return ExactImagePoint{((double)pixel.u - center[0]) * scale, ((double)pixel.v - center[1]) * scale};
    }
};
