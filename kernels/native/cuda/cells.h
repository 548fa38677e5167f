// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The cells of a packet's points (points.h), used to find the points that a small triangle may cover. Packets of pixels
// need none.

#pragma once

#include "cuda/bvh.h"

struct PointCellGrid {
    enum { SIDE = POINT_BLOCKS >= 32 ? 32 : POINT_BLOCKS >= 8 ? 16 : 8, COUNT = SIDE * SIDE };

    float per_u, per_v;  // cells per pixel of the packet

    // Column or row of a position, given its distance from the first point; it may be out of range.
    inline int column(float from_first) const { return __float2int_rd(from_first * per_u); }
    inline int row(float from_first) const { return __float2int_rd(from_first * per_v); }
};

struct NoCellGrid {
    enum { SIDE = 1, COUNT = 1 };

    static inline int column(float) { return 0; }
    static inline int row(float) { return 0; }
};
typedef Select<POINTS>::Type<PointCellGrid, NoCellGrid> CellGrid;

// A range of cells, possibly empty.
struct Cells {
    int x0, y0, x1, y1;

    inline bool any() const { return POINTS && x0 <= x1 && y0 <= y1; }
    inline int count() const { return POINTS ? (x1 - x0 + 1) * (y1 - y0 + 1) : 0; }
    static inline Cells all() {
        return POINTS ? Cells{0, 0, CellGrid::SIDE - 1, CellGrid::SIDE - 1} : Cells{0, 0, 0, 0};
    }
    // The cells between two positions, given as distances from the first points.
    static inline Cells between(const CellGrid& grid, float left, float top, float right, float bottom) {
        if constexpr (!POINTS) return all();
        return Cells{max(grid.column(left), 0), max(grid.row(top), 0), min(grid.column(right), (int)CellGrid::SIDE - 1),
                     min(grid.row(bottom), (int)CellGrid::SIDE - 1)};
    }
};
