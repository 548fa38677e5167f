// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/number_lanes.h"
#include "cpu/rows.h"
#include "shared/sky.h"

// Paint the sky of the rows that this worker takes; `call` is a `SkyCall` and `out` a `ColorImages` of kernels/shading.
template <class Call, class Out>
inline void paint_sky_rows(const Call& call, Out& out) {
    for_rows(call.job, [&](int view, int y) {
        const auto& sky = sky_of(call.skies, call.world_sky, call.worlds, view);
        if (sky.is_absent) return;
        const auto images = surface_images(call.points, call.segmentation, call.segmentation, &call.points, view, y);
        const auto row =
            sky_row(sky, call.camera, call.footprint, call.camera_to_world, call.rays, call.pixels, images, y);
        for (int x = 0; x < images.width; x += LANES) row.paint(x, (unsigned char*)out.color.data);
    });
}
