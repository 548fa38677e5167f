// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Where the rays of a packet's points pass: anywhere in its image (points.h). See grid_places.h for pixels.

struct Places {
    enum { NO_POINT = -0x7fffffff - 1 };

    const ImagePoint* list;  // of the view [px], from the image's corner
    double scale, center[2];  // u is what is to the right of the centre, so many times as long
    ImagePoint points[SLOTS];  // u and v
    int place[SLOTS];  // in the list; the complement of one that is not in the image; NO_POINT
    int first[CellGrid::COUNT];  // the slot of a point in each cell; -1 for none
    short next[SLOTS];  // that of another one in the cell of each; -1 for none
    ImageBox bounds[SLOT_BLOCKS];  // of the points of a block
    Cells cells[SLOT_BLOCKS];  // where these are
    unsigned pixels[SLOT_BLOCKS];  // of the packet where these are: a Visit

    inline ImagePoint point(const Camera&, int, int, int index) const { return points[index]; }
    inline ExactImagePoint exact(const Camera&, int, int, int index) const { return exact(list[max(place[index], 0)]); }
    inline ExactImagePoint exact(ImagePoint at) const {
        return ExactImagePoint{((double)at.u - center[0]) * scale, ((double)at.v - center[1]) * scale};
    }
    inline unsigned pixels_of(int block) const { return pixels[min(block, SLOT_BLOCKS - 1)]; }
    inline Cells cells_of(int block) const { return cells[min(block, SLOT_BLOCKS - 1)]; }
    inline void bounds_of(int block, ImageBox& box) const { box = bounds[min(block, SLOT_BLOCKS - 1)]; }
    inline int first_in(int x, int y) const { return first[y * CellGrid::SIDE + x]; }
    inline int after(int slot) const { return next[slot]; }
};
