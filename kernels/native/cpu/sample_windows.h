// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Targets, one or several objects, and the states of their samples as bits.

#pragma once

#include "cpu/silhouettes.h"
#include "shared/sample_window.h"

struct FractionJob {
    int count;  // of targets
    const int* first;  // [target + 1]: first of its objects in `members`
    const int* members;
    int objects;  // of the scene
    int canvas[4];  // x0, y0, x1, y1 in pixels of the image, end exclusive
    int min_samples;  // of the rectangle that a target may cover
    char* counts;  // [counter][view][target]: ints
    long long count_stride, view_stride;  // bytes between counters and between views
    int* hidden_by;  // [view][target][object]: samples occluded by that object

    // The job of a `FractionCall` of kernels/visibility/fraction_packets.py.
    template <class FractionCall, class Counts, class HiddenBy>
    static inline FractionJob of(const FractionCall& call, const Counts& counts, const HiddenBy& hidden_by) {
        const auto& canvas = call.canvas;
        return FractionJob{.count = call.targets.first.shape[0] - 1,
                           .first = call.targets.first.data,
                           .members = call.targets.members.data,
                           .objects = call.scene.object_count,
                           .canvas = {canvas.x0, canvas.y0, canvas.x1, canvas.y1},
                           .min_samples = call.min_samples,
                           .counts = (char*)counts.data,
                           .count_stride = counts.strides[0],
                           .view_stride = counts.strides[1],
                           .hidden_by = hidden_by.data};
    }
};

// The camera's job for a window, in whole tiles.
static inline Job job_of(const SampleWindow& window, const Job& image) {
    Job job = image;
    job.width = Grid::tiles(window.x1 - window.x0) * TILE_SIDE;
    job.height = Grid::tiles(window.y1 - window.y0) * TILE_SIDE;
    for (int k = 0; k < 2; ++k) {
        job.focal[k] = image.focal[k] * window.across;
        job.center[k] = image.center[k] * window.across - (k ? window.y0 : window.x0);
    }
    return job;
}

// Bits of the samples of some rows of tiles, row by row: one number for the samples of a tile in a row.
struct SampleBits {
    typedef unsigned short Row;
    static_assert(sizeof(Row) * 8 == TILE_SIDE, "a bit for each sample of a tile's row");

    Row* rows;  // [row][tile]
    int tiles_x;

    inline Row& at(int row, int tile) const { return rows[row * tiles_x + tile]; }
    inline void clear(int count) const { __builtin_memset(rows, 0, (long long)count * tiles_x * sizeof(Row)); }

    // Set the bits of a block, given its column and row of blocks.
    inline void set(unsigned bits, int block_x, int block_y) const {
        for (int r = 0; r < BLOCK_SIDE; ++r) {
            const unsigned part = bits >> r * BLOCK_SIDE & ((1u << BLOCK_SIDE) - 1);
            at(block_y * BLOCK_SIDE + r, block_x / BLOCKS_ACROSS) |= part << block_x % BLOCKS_ACROSS * BLOCK_SIDE;
        }
    }
    // Samples of a tile's row that differ from those on their left. To the left of the first tile, nothing is set.
    inline unsigned differs_left(int row, int tile) const {
        const unsigned bits = at(row, tile), last = tile > 0 ? at(row, tile - 1) >> (TILE_SIDE - 1) : 0;
        return (bits ^ (bits << 1 | last)) & 0xffffu;
    }
    // Whether the last sample of a row is set: it differs from what is on its right.
    inline int last(int row) const { return at(row, tiles_x - 1) >> (TILE_SIDE - 1); }
};
