// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Where the rays of a packet's points pass: anywhere in its image (points.h). See grid_places.h for pixels.

struct Places : PointIndex {
    enum { NO_POINT = -0x7fffffff - 1 };

    const ImagePoint* list;  // of the view [px], from the image's corner
    double scale, center[2];  // u is what is to the right of the centre, so many times as long
    ImagePoint points[SLOTS];  // u and v
    int place[SLOTS];  // in the list; the complement of one that is not in the image; NO_POINT

    inline ImagePoint point(const Camera&, int, int, int index) const { return points[index]; }
    inline ExactImagePoint exact(const Camera&, int, int, int index) const { return exact(list[max(place[index], 0)]); }
    inline ExactImagePoint exact(ImagePoint at) const {
        return ExactImagePoint{((double)at.u - center[0]) * scale, ((double)at.v - center[1]) * scale};
    }
};
