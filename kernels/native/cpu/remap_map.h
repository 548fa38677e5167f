// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Maps, and the parts of them that are rendered.

#pragma once

#include "cpu/camera.h"

// Images at arbitrary places: a map contains, for each output pixel, the place in the camera's image that it shows.
struct RemapJob : Job {  // of the camera's image; nothing is visible outside
    int rows, columns;  // of the map
    double tree_focal;  // of both axes, in units of tree places, which are finer than pixels
    const float* limits;  // inv_z at each place: farther surfaces are not searched for; null for no limits

    // The job of a `RemapCall` of kernels/casting/packets.py.
    template <class RemapCall>
    static inline RemapJob of(const RemapCall& call) {
        RemapJob job = {Job::of_call(call), call.job.rows, call.job.columns, call.job.tree_focal, call.job.limits.data};
        job.pixels = call.job.pixels.data;
        return job;
    }

    // Side of a group in pixels, and the number of groups of a tree: its rays stay in a core's cache.
    enum { GROUP_SIDE = BLOCKS_ACROSS * TILE_SIDE, MAX_GROUPS = 10 };

    static inline int parts(int count, int size) { return (count + size - 1) / size; }
    inline int groups_across() const { return parts(columns, GROUP_SIDE); }
    inline int groups_down() const { return parts(rows, GROUP_SIDE); }
    // Groups of a tree, horizontally and vertically.
    inline int across() const { return groups_across() < MAX_GROUPS ? groups_across() : (int)MAX_GROUPS; }
    inline int down() const {
        const int max_down = MAX_GROUPS / across();
        return groups_down() < max_down ? groups_down() : max_down;
    }
    inline int trees_across() const { return parts(groups_across(), across()); }
    inline int trees() const { return trees_across() * parts(groups_down(), down()); }
};

// The first pixel of the map that a tree covers.
struct RemapPart {
    int first_column, first_row;

    static inline RemapPart of(const RemapJob& job, int tree) {
        return RemapPart{tree % job.trees_across() * job.across() * RemapJob::GROUP_SIDE,
                         tree / job.trees_across() * job.down() * RemapJob::GROUP_SIDE};
    }
    // Load rows of the map into the cache, one after the other: blocks would be loaded in an order that processors do
    // not predict.
    inline void load(const RemapJob& job, long long view) const {
        const int end = first_row + job.down() * RemapJob::GROUP_SIDE, width = job.across() * RemapJob::GROUP_SIDE;
        const int left = job.columns - first_column, columns = left < width ? left : width;
        for (int row = first_row; row < end && row < job.rows; ++row) {
            const long long first = (view * job.rows + row) * job.columns + first_column;
            touch(job.pixels + 2 * first, 2 * columns);
            if (job.limits) touch(job.limits + first, columns);
        }
    }
    static inline void touch(const float* numbers, int count) {
        for (int k = 0; k < count; k += LANES) __asm__ volatile("" : : "r"(*(const volatile float*)(numbers + k)));
    }
};

// A tile of the map.
struct MapTile {
    long long view;
    int index;  // in the tree
    int column, row;  // of its first pixel
    bool in_map, whole;  // whether any of it is inside the map, and all of it

    static inline MapTile of(const RemapJob& job, const RemapPart& part, long long view, int index) {
        const int group = index / LANES, tile = index % LANES;
        const int column =
            part.first_column + group % job.across() * RemapJob::GROUP_SIDE + tile % BLOCKS_ACROSS * TILE_SIDE;
        const int row = part.first_row + group / job.across() * RemapJob::GROUP_SIDE + tile / BLOCKS_ACROSS * TILE_SIDE;
        return MapTile{view,
                       index,
                       column,
                       row,
                       column < job.columns && row < job.rows,
                       column + TILE_SIDE <= job.columns && row + TILE_SIDE <= job.rows};
    }
    // First column and row of a block.
    inline int block_column(int block) const { return column + block % BLOCKS_ACROSS * BLOCK_SIDE; }
    inline int block_row(int block) const { return row + block / BLOCKS_ACROSS * BLOCK_SIDE; }
};

// Sixteen pixels of a map.
struct MapBlock {
    Floats x, y;

    // Load a block of a tile. For a partial tile, `place` receives the index of each pixel, -1 beyond the end of the
    // map.
    static inline MapBlock of(const RemapJob& job, const MapTile& tile, int block, int* place) {
        const int column = tile.block_column(block), row = tile.block_row(block);
        const long long first = (tile.view * job.rows + row) * job.columns + column;
        if (tile.whole) place = nullptr;
        if (place) {
            for (int k = 0; k < LANES; ++k) {
                const int x = column + k % BLOCK_SIDE, y = row + k / BLOCK_SIDE;
                place[k] = x < job.columns && y < job.rows ? y * job.columns + x : -1;
            }
        }
        const float* source = job.pixels + first * 2;
        if (!place) return rows(source, job.columns * 2LL);
        float pairs[2 * LANES];
        for (int k = 0; k < LANES; ++k)
            for (int c = 0; c < 2; ++c)
                pairs[2 * k + c] = place[k] < 0 ? __builtin_nanf("") : source[offset(job, k) * 2 + c];
        return rows(pairs, 2 * BLOCK_SIDE);
    }
    // Offset of a pixel from the first one of its block.
    static inline long long offset(const RemapJob& job, int k) {
        return (long long)(k / BLOCK_SIDE) * job.columns + k % BLOCK_SIDE;
    }
    // Load the limits of a block, 0 without any. `place` is that of a partial tile.
    static inline Floats limits(const RemapJob& job, const MapTile& tile, int block, const int* place) {
        if (!job.limits) return Lanes::all(0.0f);
        const float* source = job.limits + tile.view * job.rows * job.columns;
        if (!tile.whole) {
            Floats found = Lanes::all(0.0f);
            for (int k = 0; k < LANES; ++k)
                if (place[k] >= 0) found[k] = source[place[k]];
            return found;
        }
        typedef float Four __attribute__((ext_vector_type(BLOCK_SIDE)));
        Four r[BLOCK_SIDE];
        source += (long long)tile.block_row(block) * job.columns + tile.block_column(block);
        for (int k = 0; k < BLOCK_SIDE; ++k) __builtin_memcpy(&r[k], source + (long long)k * job.columns, sizeof r[k]);
        const auto upper = __builtin_shufflevector(r[0], r[1], 0, 1, 2, 3, 4, 5, 6, 7);
        const auto lower = __builtin_shufflevector(r[2], r[3], 0, 1, 2, 3, 4, 5, 6, 7);
        return __builtin_shufflevector(upper, lower, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }
    // Load rows of x y x y ..., `stride` numbers from each other.
    static inline MapBlock rows(const float* from, long long stride) {
        typedef float Eight __attribute__((ext_vector_type(8)));
        Eight r[BLOCK_SIDE];
        for (int k = 0; k < BLOCK_SIDE; ++k) __builtin_memcpy(&r[k], from + k * stride, sizeof r[k]);
        const Floats a = __builtin_shufflevector(r[0], r[1], 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        const Floats b = __builtin_shufflevector(r[2], r[3], 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        return MapBlock{__builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30),
                        __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31)};
    }
    // Which places are inside the image; NaN is not.
    inline Ints inside(const RemapJob& job) const {
        const Floats none = Lanes::all(0.0f);
        return (x >= none) & (x < Lanes::all((float)job.width)) & (y >= none) & (y < Lanes::all((float)job.height));
    }
};
