// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/color_rows.h"
#include "cpu/corner_cache.h"

// Shade the rows that this worker takes by light at vertices; `call` and `out` are those of `shade_rows`.
template <class Call, class Out>
inline void shade_vertex_rows(const Call& call, Out& out) {
    CornerCache cache;
    int cached_view = -1;
    for_rows(call.job, [&](int view, int y) {
        if (view != cached_view) cache.clear(call.lights, call.shadows.data != nullptr), cached_view = view;
        const SurfaceImages images = surface_images(call.points, call.segmentation, call.faces, &call.normals, view, y);
        auto row = color_row(call.appearance, call.worlds, images, call.footprint, call.camera_to_world, out.color);
        for (int x = 0; x < images.width; x += LANES)
            cached_vertex_lit_colors(row, x, call.lights, call.shadows, cache);
    });
}
