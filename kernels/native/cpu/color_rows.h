// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/number_lanes.h"
#include "cpu/rows.h"
#include "shared/lighting.h"

// Shade the rows that this worker takes; `call` is a `ColorCall` and `out` a `ColorImages` of
// kernels/shading/color_rows.py.
template <class Call, class Out>
inline void shade_rows(const Call& call, Out& out) {
    for_rows(call.job, [&](int view, int y) {
        const SurfaceImages images = surface_images(call.points, call.segmentation, call.faces, &call.normals, view, y);
        auto row = color_row(call.appearance, call.worlds, images, call.footprint, call.camera_to_world, out.color);
        for (int x = 0; x < images.width; x += LANES) {
            if (call.is_lit)
                row.lit_colors(x, call.lights, call.shadows);
            else
                row.base_colors(x);
        }
    });
}
