// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/number_lanes.h"
#include "cpu/rows.h"
#include "shared/pbr.h"

// Shade the rows that this worker takes, as `shade_rows`.
template <class Call, class Out>
inline void shade_pbr_rows(const Call& call, Out& out) {
    for_rows(call.job, [&](int view, int y) {
        const SurfaceImages images = surface_images(call.points, call.segmentation, call.faces, &call.normals, view, y);
        auto row = pbr_row(call.appearance, call.worlds, images, call.footprint, call.camera_to_world, out.color);
        for (int x = 0; x < images.width; x += LANES) row.lit_colors(x, call.lights, call.shadows);
    });
}
