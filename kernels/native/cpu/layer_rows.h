// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Lists of the pixels that show what is behind their surfaces: see kernels/shading/layer_rows.py.

#pragma once

#include "cpu/number_lanes.h"
#include "cpu/rows.h"
#include "shared/constants.h"
#include "shared/opacity.h"

// Bands of BLOCK_SIDE rows of an image, whose pixels are listed in blocks of BLOCK_SIDE x BLOCK_SIDE.
template <class Call, class Out>
inline void list_transparent(const Call& call, Out& out) {
    const int height = call.points.shape[1], width = call.points.shape[2], bands = out.count.shape[1];
    for_rows(call.job, [&](int view, int band) {
        SurfaceImages images = surface_images(call.points, call.segmentation, call.faces, &call.points, view, 0);
        const long long first = images.first, start = ((long long)view * bands + band) * BLOCK_SIDE * width;
        auto row = opacity_row(call.appearance, call.worlds, images, call.footprint, call.camera_to_world);
        const int top = band * BLOCK_SIDE, rows = height - top < BLOCK_SIDE ? height - top : BLOCK_SIDE;
        int* pixels = out.pixels.data + start;
        float* opacities = (float*)out.opacity.data + 2 * start;
        int count = 0;
        for (int x = 0; x < width; x += LANES) {
            Floats opacity[BLOCK_SIDE], passes[BLOCK_SIDE];
            unsigned found[BLOCK_SIDE] = {}, any = 0;
            for (int r = 0; r < rows; ++r) {
                images.first = first + (long long)(top + r) * width;
                found[r] = Lanes::bits(row.find(x, Lanes::all_ints(0), opacity[r], passes[r]));
                any |= found[r];
            }
            if (any == 0) continue;
            for (int k = 0; k < LANES * rows; ++k) {
                const int r = k / BLOCK_SIDE % rows, lane = k / (BLOCK_SIDE * rows) * BLOCK_SIDE + k % BLOCK_SIDE;
                if (!(found[r] >> lane & 1)) continue;
                pixels[count] = (top + r) * width + x + lane;
                opacities[2 * count] = opacity[r][lane], opacities[2 * count + 1] = passes[r][lane];
                ++count;
            }
        }
        out.count.data[(long long)view * bands + band] = count;
    });
}
