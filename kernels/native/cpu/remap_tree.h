// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// A `RayTree` over the places of a map, rebuilt for each view: packets are blocks of 4 x 4 pixels of the map, tiles are
// 16 x 16 pixels and groups 64 x 64, so that neighbors in the map are traversed together, wherever they are in the
// image.

#pragma once

#include "cpu/remap_map.h"
#include "cpu/solids.h"

// Minima of several registers at once.
struct MinLanes {
    // Lane k of the result is the minimum of r[k]; overwrites the 16 registers.
    static inline Floats of(Floats* r) {
        for (int i = 0; i < 8; ++i)
            r[i] = Lanes::min(
                __builtin_shufflevector(r[i], r[i + 8], 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23),
                __builtin_shufflevector(r[i], r[i + 8], 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31));
        for (int i = 0; i < 4; ++i)
            r[i] = Lanes::min(
                __builtin_shufflevector(r[i], r[i + 4], 0, 1, 2, 3, 16, 17, 18, 19, 8, 9, 10, 11, 24, 25, 26, 27),
                __builtin_shufflevector(r[i], r[i + 4], 4, 5, 6, 7, 20, 21, 22, 23, 12, 13, 14, 15, 28, 29, 30, 31));
        for (int i = 0; i < 2; ++i)
            r[i] = Lanes::min(
                __builtin_shufflevector(r[i], r[i + 2], 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29),
                __builtin_shufflevector(r[i], r[i + 2], 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31));
        return Lanes::min(
            __builtin_shufflevector(r[0], r[1], 0, 16, 2, 18, 4, 20, 6, 22, 8, 24, 10, 26, 12, 28, 14, 30),
            __builtin_shufflevector(r[0], r[1], 1, 17, 3, 19, 5, 21, 7, 23, 9, 25, 11, 27, 13, 29, 15, 31));
    }
};

// Margin of bounds around places [pixels of the tree], as in prepared tables.
constexpr float TREE_MARGIN = 1e-3f;

// Places of 16 pixels along an axis, relative to the principal point and in pixels of the tree, and their rounding
// errors.
struct TreePlaces {
    Floats rounded, error;
};

struct TreeAxis {
    double center, scale;
    float near_center, center_rest, power;  // the same if the scale is a power of two; else power is 0

    static inline TreeAxis of(const RemapJob& job, int axis) {
        const double center = job.center[axis], scale = job.tree_focal / job.focal[axis];
        const float near = (float)center, power = (float)scale;
        unsigned bits;
        __builtin_memcpy(&bits, &power, sizeof bits);
        const bool exact = power == scale && (bits & 0x7fffffu) == 0;
        return TreeAxis{center, scale, near, (float)(center - near), exact ? power : 0.0f};
    }
    inline TreePlaces of(Floats pixels) const {
        if (power > 0.0f) {
            // Rounding error of the difference of two numbers (Knuth's TwoSum).
            const Floats place = pixels - near_center, back = place - pixels;
            const Floats lost = (pixels - (place - back)) - (near_center + back);
            return TreePlaces{place * power, (lost - center_rest) * power};
        }
        const Doubles exact = (__builtin_convertvector(pixels, Doubles) - center) * scale;
        const Floats rounded = __builtin_convertvector(exact, Floats);
        return TreePlaces{rounded, __builtin_convertvector(exact - __builtin_convertvector(rounded, Doubles), Floats)};
    }
};

// The arrays of a tree, in a worker's memory.
struct RemapTree {
    float *group_bounds, *tile_bounds, *packet_bounds;
    float *u, *v, *rest_u, *rest_v;
    int *place, *run, *corner;
    RayFit* fit;  // all zero: no tile has a fit
    int* outside;  // [packet]: bit mask of lanes outside the image

    static inline RemapTree carve(Arena& arena, int groups) {
        const long long tiles = (long long)groups * LANES, packets = tiles * LANES, rays = packets * LANES;
        const int bounds = RayTree::BOUND_ROWS * LANES;
        RemapTree tree;
        tree.group_bounds = arena.floats(bounds);
        tree.tile_bounds = arena.floats((long long)groups * bounds);
        tree.packet_bounds = arena.floats(tiles * bounds);
        tree.u = arena.floats(rays);
        tree.v = arena.floats(rays);
        tree.rest_u = arena.floats(rays);
        tree.rest_v = arena.floats(rays);
        tree.place = arena.ints(rays);
        tree.run = arena.ints(packets);
        tree.corner = arena.ints(tiles);
        tree.fit = (RayFit*)arena.take(tiles * (long long)sizeof(RayFit));
        tree.outside = arena.ints(packets);
        return tree;
    }
    inline RayTree as_ray_tree(float clip_inv_z) const {
        RayTree tree = RayTree();
        tree.group_bounds = group_bounds, tree.tile_bounds = tile_bounds, tree.packet_bounds = packet_bounds;
        tree.u = tree.row_u = u, tree.v = tree.row_v = v, tree.rest_u = rest_u, tree.rest_v = rest_v;
        tree.place = place, tree.run = run, tree.corner = corner, tree.fit = fit;
        tree.clip_inv_z = clip_inv_z;
        return tree;
    }

    // Set the places of a part of a map; returns their bounding rectangle, inverted if there are none.
    inline RayBox set(const RemapJob& job, const RemapPart& part, long long view, const Image& image) const {
        const int groups = job.across() * job.down();
        part.load(job, view);
        for (int k = 0; k < RayTree::BOUND_ROWS * LANES; ++k) group_bounds[k] = nowhere(k / LANES);
        for (int group = 0; group < groups; ++group) {
            float* bounds = tile_bounds + group * (RayTree::BOUND_ROWS * LANES);
            for (int child = 0; child < LANES; ++child) {
                const MapTile tile = MapTile::of(job, part, view, group * LANES + child);
                if (tile.in_map) set_tile(job, tile, image);
                put_bounds(bounds, child, tile.in_map ? bounds_of_packets(tile.index) : nullptr);
            }
            put_bounds(group_bounds, group, bounds);
        }
        __builtin_memset(image.block_stale, 0, groups * RayTree::GROUP_PACKETS);
        __builtin_memset(image.tile_stale, 0, groups * LANES);
        float all[RayTree::BOUND_ROWS * LANES];
        put_bounds(all, 0, group_bounds);
        return RayTree::box_of(all, 0);
    }
    inline float* bounds_of_packets(int tile) const { return packet_bounds + tile * (RayTree::BOUND_ROWS * LANES); }
    static inline float nowhere(int row) { return row < 2 ? NOWHERE : -NOWHERE; }
    // Set a child's bounds from the rows of the child's children; null for a missing child.
    static inline void put_bounds(float* to, int child, const float* rows) {
        for (int row = 0; row < RayTree::BOUND_ROWS; ++row) {
            const float sign = row < 2 ? 1.0f : -1.0f;
            to[row * LANES + child] =
                rows ? sign * Lanes::min_of(sign * Lanes::load(rows + row * LANES)) : nowhere(row);
        }
    }

    inline void set_tile(const RemapJob& job, const MapTile& tile, const Image& image) const {
        corner[tile.index] = tile.whole ? tile.row * job.columns + tile.column : -1;
        __builtin_memset(fit + tile.index, 0, sizeof *fit);
        const TreeAxis horizontal = TreeAxis::of(job, 0), vertical = TreeAxis::of(job, 1);
        const Floats none = Lanes::all(0.0f);
        Floats low_u[LANES], low_v[LANES], high_u[LANES], high_v[LANES], start[LANES];
        for (int block = 0; block < LANES; ++block) {
            const int packet = tile.index * LANES + block;
            const MapBlock from = MapBlock::of(job, tile, block, place + packet * LANES);
            run[packet] = 1;
            const Ints inside = from.inside(job);
            outside[packet] = (int)(~Lanes::bits(inside) & 0xffff);
            if (!Lanes::any(inside)) {
                Lanes::store(image.inv_z + packet * LANES, start[block] = Lanes::all(NOWHERE));
                low_u[block] = low_v[block] = high_u[block] = high_v[block] = Lanes::all(NOWHERE);
                continue;
            }
            const TreePlaces at_u = horizontal.of(inside ? from.x : none), at_v = vertical.of(inside ? from.y : none);
            Lanes::store(u + packet * LANES, at_u.rounded);
            Lanes::store(v + packet * LANES, at_v.rounded);
            Lanes::store(rest_u + packet * LANES, at_u.error);
            Lanes::store(rest_v + packet * LANES, at_v.error);
            // Places outside the image occlude everything and are never written.
            const Floats limits = MapBlock::limits(job, tile, block, place + packet * LANES);
            start[block] = inside ? limits : Lanes::all(NOWHERE);
            Lanes::store(image.inv_z + packet * LANES, start[block]);
            low_u[block] = inside ? at_u.rounded : Lanes::all(NOWHERE);
            low_v[block] = inside ? at_v.rounded : Lanes::all(NOWHERE);
            high_u[block] = inside ? -at_u.rounded : Lanes::all(NOWHERE);
            high_v[block] = inside ? -at_v.rounded : Lanes::all(NOWHERE);
        }
        float* bounds = bounds_of_packets(tile.index);
        Lanes::store(bounds, MinLanes::of(low_u) - TREE_MARGIN);
        Lanes::store(bounds + LANES, MinLanes::of(low_v) - TREE_MARGIN);
        Lanes::store(bounds + 2 * LANES, TREE_MARGIN - MinLanes::of(high_u));
        Lanes::store(bounds + 3 * LANES, TREE_MARGIN - MinLanes::of(high_v));
        const Floats min_inv_z = MinLanes::of(start);
        Lanes::store(image.block_min + tile.index * LANES, min_inv_z);
        image.tile_min[tile.index] = Lanes::min_of(min_inv_z);
    }
    // After rasterization, clear the places outside the image, and mark packets that consist only of those to be
    // written.
    inline void show_outside(const Image& image, int tile) const {
        float* bounds = bounds_of_packets(tile);
        for (int child = 0; child < LANES; ++child) {
            const int packet = tile * LANES + child;
            if (outside[packet]) {
                // A selection would become a masked store, which takes AMD's processors much longer.
                if (outside[packet] == (1 << LANES) - 1)
                    Lanes::store(image.inv_z + packet * LANES, Lanes::all(0.0f));
                else
                    for (const int k : Lanes::each((unsigned)outside[packet])) image.inv_z[packet * LANES + k] = 0.0f;
            }
            if (bounds[child] > bounds[2 * LANES + child]) bounds[child] = bounds[2 * LANES + child] = 0.0f;
        }
    }
};
