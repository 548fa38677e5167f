// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Bounds of the blocks of a packet's points in its image.

#pragma once

#include "cuda/places.h"
#include "cuda/visits.h"

struct PointBlocks {
    // Cells per pixel for a side of `pixels` pixels, with no point beyond the last cell.
    static inline float per_side(float pixels) { return (CellGrid::SIDE - 0.01f) / fmaxf(pixels, 0.01f); }

    // Each lane sets the bounds of one block, or marks it as empty.
    template <class PointPlaces>
    static inline void set(const Camera& camera, PointPlaces& places, int block, const ImageBox& box, bool has_points) {
        places.bounds[block] = has_points ? box : ImageBox{NOWHERE, -NOWHERE, NOWHERE, -NOWHERE};
        places.cells[block] = has_points ? box.cells(camera, 0.0f) : Cells{1, 1, 0, 0};
        places.pixels[block] = has_points ? visit(camera, box) : none();
    }
    static inline unsigned visit(const Camera& camera, const ImageBox& box) {
        return Visit::of(0.0f, pixel(box.left - camera.first_u), pixel(box.top - camera.first_v),
                         pixel(box.right - camera.first_u), pixel(box.bottom - camera.first_v));
    }
    // An empty range: it ends before it begins.
    static inline unsigned none() { return Visit::of(0.0f, PACKET_WIDTH - 1, PACKET_HEIGHT - 1, 0, 0); }
    static inline int pixel(float from_first) {
        return max(min(__float2int_rd(from_first + 0.5f), PACKET_WIDTH - 1), 0);
    }
};
