// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Search for the points of a packet that a surface may cover: by the cells of a grid, and by blocks.

struct PointIndex {
    int first[CellGrid::COUNT];  // the slot of a point in each cell; -1 if empty
    short next[SLOTS];  // the slot of the next point in the same cell; -1 at the end
    ImageBox bounds[SLOT_BLOCKS];  // of the points of a block
    Cells cells[SLOT_BLOCKS];  // cell ranges of the blocks
    unsigned pixels[SLOT_BLOCKS];  // pixels of the packet that contain the points of a block: a Visit

    inline unsigned pixels_of(int block) const { return pixels[min(block, SLOT_BLOCKS - 1)]; }
    inline Cells cells_of(int block) const { return cells[min(block, SLOT_BLOCKS - 1)]; }
    inline void bounds_of(int block, ImageBox& box) const { box = bounds[min(block, SLOT_BLOCKS - 1)]; }
    inline int first_in(int x, int y) const { return first[y * CellGrid::SIDE + x]; }
    inline int after(int slot) const { return next[slot]; }
    static inline bool is_behind(float, int) { return false; }

    // Call before any point is added.
    inline void clear() {
        for (int cell = Warp::lane(); cell < CellGrid::COUNT; cell += LANES) first[cell] = -1;
        Warp::sync();
    }
    // Insert a point into its cell.
    inline void add(const Camera& camera, ImagePoint p, int slot) {
        const Cells cell = ImageBox{p.u, p.u, p.v, p.v}.cells(camera, 0.0f);
        next[slot] = (short)atomicExch(first + cell.y0 * CellGrid::SIDE + cell.x0, slot);
    }
};
