// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The cells of a packet's points (points.h), by which those are found that a small triangle may cover. See no_cells.h
// for packets of pixels.

struct CellGrid {
    enum { SIDE = POINT_BLOCKS >= 32 ? 32 : POINT_BLOCKS >= 8 ? 16 : 8, COUNT = SIDE * SIDE };

    float per_u, per_v;  // cells to one of the packet's pixels

    // In which column or row a place is, as far as that is from the first point's; there may be no such.
    inline int column(float from_first) const { return __float2int_rd(from_first * per_u); }
    inline int row(float from_first) const { return __float2int_rd(from_first * per_v); }
};

// Cells that may have something in them.
struct Cells {
    int x0, y0, x1, y1;

    inline bool some() const { return x0 <= x1 && y0 <= y1; }
    inline int count() const { return (x1 - x0 + 1) * (y1 - y0 + 1); }
    static inline Cells all() { return Cells{0, 0, CellGrid::SIDE - 1, CellGrid::SIDE - 1}; }
    // Those from some places to others, as far as they are from the first points.
    static inline Cells between(const CellGrid& grid, float left, float top, float right, float bottom) {
        return Cells{max(grid.column(left), 0), max(grid.row(top), 0), min(grid.column(right), (int)CellGrid::SIDE - 1),
                     min(grid.row(bottom), (int)CellGrid::SIDE - 1)};
    }
};
