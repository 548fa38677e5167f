// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Colors of rows of pixels as of the fixed-function pipeline: light is computed and clamped at vertices, interpolated
// between them, and multiplied by the texture. Shadows are those of pixels.

#pragma once

#include "shared/lighting.h"
#include "shared/vertex_grids.h"

// Write the colors of pixels of a `ColorRow` from x on.
template <class Numbers, class Row, class Lights, class Shadows>
inline void vertex_lit_colors(Row& row, int x, const Lights& lights, const Shadows& shadows) {
    typedef typename Row::Vector Vector;
    row.write(
        x, [&](const typename Row::Shown& shown, typename Numbers::Whole, const Vector&, long long place, int count) {
            const Vector flat = SurfaceImages::triple<Numbers>(row.images.normals, place, count);
            FlatCells cells;
            cells.entry = -1;
            const auto corners = corner_finder<Numbers>(row, shown, cells, flat).locate_corners();
            return row.lit_by_images(shown, corners, lights, shadows, place, count);
        });
}
