// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The samples of an image that a target, one or several objects, may cover, and their states as bits.

#pragma once

#include "cpu/silhouettes.h"

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

// The rectangle of a canvas that a target may cover, in samples.
struct SampleWindow {
    int across;  // samples along the side of a pixel
    int x0, y0, x1, y1;  // relative to the image's first sample, end exclusive

    // Extend a rectangle in pixels by the corners of a box; returns how many of them are behind the camera.
    static inline int add_box(const Pose& camera, const Job& job, const float* box, double* low, double* high) {
        int behind = 0;
        for (int corner = 0; corner < 8; ++corner) {
            double place[3], seen[3];
            for (int k = 0; k < 3; ++k) place[k] = box[(corner >> k & 1) * 3 + k];
            camera.transform_into(place, seen);
            behind += seen[2] <= 0.0;
            if (seen[2] <= 0.0) continue;
            for (int k = 0; k < 2; ++k) {
                const double at = job.focal[k] * seen[k] / seen[2] + job.center[k];
                low[k] = at < low[k] ? at : low[k];
                high[k] = at > high[k] ? at : high[k];
            }
        }
        return behind;
    }
    // The least odd number of samples along the side of a pixel that gives a rectangle of pixels enough samples. From
    // one to the next, sides grow to at most three times their length: they are at most `3 * min_samples` unless it is
    // 1.
    static inline int samples_across(double width, double height, int min_samples) {
        int across = 1;
        while (across < MAX_SAMPLES_ACROSS && (width * across + 1) * (height * across + 1) < min_samples) across += 2;
        return across;
    }
    // The window of a rectangle in pixels, with a margin of a sample; empty if it is outside of the canvas.
    static inline SampleWindow of(const double* low, const double* high, const FractionJob& request) {
        double from[2], to[2];
        for (int k = 0; k < 2; ++k) {
            from[k] = low[k] > request.canvas[k] ? low[k] : request.canvas[k];
            to[k] = high[k] < request.canvas[2 + k] ? high[k] : request.canvas[2 + k];
            if (from[k] > to[k]) return SampleWindow{1, 0, 0, 0, 0};
        }
        const int across = samples_across(to[0] - from[0], to[1] - from[1], request.min_samples);
        int window[4];
        for (int k = 0; k < 2; ++k) {
            const int first = (int)__builtin_floor(from[k] * across) - 1, end = (int)__builtin_ceil(to[k] * across) + 1;
            window[k] = first > request.canvas[k] * across ? first : request.canvas[k] * across;
            window[2 + k] = end < request.canvas[2 + k] * across ? end : request.canvas[2 + k] * across;
        }
        return SampleWindow{across, window[0], window[1], window[2], window[3]};
    }
    inline bool empty() const { return x0 >= x1 || y0 >= y1; }

    // The camera's job for the window, in whole tiles.
    inline Job job_of(const Job& image) const {
        Job job = image;
        job.width = Grid::tiles(x1 - x0) * TILE_SIDE;
        job.height = Grid::tiles(y1 - y0) * TILE_SIDE;
        for (int k = 0; k < 2; ++k) {
            job.focal[k] = image.focal[k] * across;
            job.center[k] = image.center[k] * across - (k ? y0 : x0);
        }
        return job;
    }
};

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
