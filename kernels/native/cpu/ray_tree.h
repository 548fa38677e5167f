// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rays of a ray table, which are the same for every view: a tree over them is built once
// (warpvis/rendering/casters/sorted_rays_cpu.py). Packets of LANES adjacent rays are the children of tiles, tiles those
// of groups, and groups those of a bundle, which is rendered as a separate image: the bounds of all children of one
// parent fill one register per coordinate. The blocks of the image are these packets, and its tiles are these tiles.

#pragma once

#include "cpu/image.h"

// A rectangle in the image, in u and v.
struct RayBox {
    float u0, v0, u1, v1;

    inline RayBox scaled(float factor) const { return RayBox{u0 * factor, v0 * factor, u1 * factor, v1 * factor}; }
    // The rectangle that covers the pixels from (x0, y0) to (x1, y1).
    static inline RayBox of_pixels(const Image& image, int x0, int y0, int x1, int y1) {
        const float left = image.center_x, top = image.center_y;
        return RayBox{(float)x0 - left, (float)y0 - top, (float)(x1 + 1) - left, (float)(y1 + 1) - top};
    }
};

// Column and row of a ray in a tile as a linear function of u and v with a known error, for tiles whose rays are those
// of the table in nearly even spacing.
struct RayFit {
    float u, v;  // of column 0 and row 0
    float column_u, column_v, row_u, row_v;  // derivatives of the column and the row
    float off_column, off_row;  // greatest deviation of the rays from the linear function
    float shift;  // a packet has 1 << shift columns; 0 if the tile has no fit
    float spacing;  // greatest step along a column or a row, in u or v

    inline int last_column() const { return (PACKETS_ACROSS << (int)shift) - 1; }
    inline int last_row() const { return (PACKETS_ACROSS << (LANE_SHIFT - (int)shift)) - 1; }
    // Index of the ray at a column and a row of a tile.
    inline int slot(int column, int row) const {
        const int x = (int)shift, y = LANE_SHIFT - x;
        return ((column >> x) + (row >> y) * PACKETS_ACROSS) * LANES + (column & ((1 << x) - 1)) +
               ((row & ((1 << y) - 1)) << x);
    }
    enum { LANE_SHIFT = 4, PACKETS_ACROSS = 4, WORDS = 10 };
};
// Intersections of rays with the plane of the eye, z = 0, if rays have distinct origins: a ray is (p, q, 0) + z (u, v,
// 1), with p and q scaled like x and y, and begins at its own z, which is at least 0.
struct RayOrigins {
    const float *p, *q;  // [packet][lane]
    const float* begin;  // [packet][lane]: z at which a ray begins
    const float* clip_inv_z;  // [packet][lane]: 1 / begin
    const float *row_p, *row_q;  // [tile][row][column], of tiles that have a fit
    const float* range;  // [tile][RANGE_WORDS]: middles of p, q and u q - v p, then the greatest distances from these
    float max_p = 0.0f, max_q = 0.0f;  // greatest magnitudes in a bundle
    float reach = 0.0f;  // greatest distance of a ray's origin from the eye [m]
    // Tests in double precision that are left until other methods are faster; null if there is no other.
    int* exact_tests = nullptr;
    enum { RANGE_WORDS = 6 };

    inline void count_exact_test() const {
        if (exact_tests) --*exact_tests;
    }
    inline bool is_exhausted() const { return exact_tests && *exact_tests < 0; }
};

static_assert(LANES == 1 << RayFit::LANE_SHIFT && sizeof(RayFit) == RayFit::WORDS * sizeof(float),
              "Python writes the words of one");

struct RayTree {
    enum { BOUND_ROWS = 4, GROUP_PACKETS = LANES * LANES };  // rows of a node's bounds: least u and v, greatest u and v

    const float* group_bounds;  // [BOUND_ROWS][group]
    const float* tile_bounds;  // [group][BOUND_ROWS][tile]
    const float* packet_bounds;  // [tile][BOUND_ROWS][packet]
    const float *u, *v;  // [packet][lane]
    const float *rest_u, *rest_v;  // rounding errors of u and v
    const float *row_u, *row_v;  // [tile][row][column], of tiles that have a fit
    const float* scale;  // [packet][lane]: depth of a ray at z = 1; null if it is 1 for all
    const int* place;  // [packet][lane]: index of the pixel in the image, -1 for lanes without a ray
    const int* run;  // [packet]: number of consecutive lanes whose pixels are contiguous in the image
    const int* corner;  // [tile]: first pixel, if a tile is a tile of the image and its packets are the blocks; else -1
    const RayFit* fit;  // [tile]
    float clip_inv_z;  // in terms of depth: nearer surfaces are clipped
    RayOrigins origins;  // only for ORIGIN_RAYS

    // The tree of a `TableCall` of kernels/casting/ray_bundle_packets.py.
    template <class TableCall>
    static inline RayTree of(const TableCall& call) {
        const auto& rays = call.rays;
        const auto& origins = call.origins;
        return RayTree{.group_bounds = rays.group_bounds.data,
                       .tile_bounds = rays.tile_bounds.data,
                       .packet_bounds = rays.packet_bounds.data,
                       .u = rays.u.data,
                       .v = rays.v.data,
                       .rest_u = rays.rest_u.data,
                       .rest_v = rays.rest_v.data,
                       .row_u = rays.row_u.data,
                       .row_v = rays.row_v.data,
                       .scale = rays.scale.data,
                       .place = rays.place.data,
                       .run = rays.run.data,
                       .corner = rays.corner.data,
                       .fit = (const RayFit*)rays.fit.data,
                       .clip_inv_z = call.job.camera.clip_inv_z,
                       .origins = {.p = origins.p.data,
                                   .q = origins.q.data,
                                   .begin = origins.begin.data,
                                   .clip_inv_z = origins.clip_inv_z.data,
                                   .row_p = origins.row_p.data,
                                   .row_q = origins.row_q.data,
                                   .range = origins.range.data}};
    }

    // Unrounded u and v of a ray, and of a packet's rays.
    inline double exact_u(int ray) const { return (double)u[ray] + rest_u[ray]; }
    inline double exact_v(int ray) const { return (double)v[ray] + rest_v[ray]; }
    inline Doubles exact_us(int packet) const { return widen(u, packet) + widen(rest_u, packet); }
    inline Doubles exact_vs(int packet) const { return widen(v, packet) + widen(rest_v, packet); }
    static inline Doubles widen(const float* rays, int packet) {
        return __builtin_convertvector(Lanes::load(rays + packet * LANES), Doubles);
    }

    // Which of LANES bounds overlap a rectangle; the bounds of a missing child are inverted.
    static inline Ints overlap(const float* bounds, const RayBox& box) {
        return (Lanes::load(bounds) <= Lanes::all(box.u1)) & (Lanes::load(bounds + LANES) <= Lanes::all(box.v1)) &
               (Lanes::load(bounds + 2 * LANES) >= Lanes::all(box.u0)) &
               (Lanes::load(bounds + 3 * LANES) >= Lanes::all(box.v0));
    }
    // The bounds of one child.
    static inline RayBox box_of(const float* bounds, int child) {
        return RayBox{bounds[child], bounds[LANES + child], bounds[2 * LANES + child], bounds[3 * LANES + child]};
    }
    inline const float* bounds_of_tiles(int group) const { return tile_bounds + group * (BOUND_ROWS * LANES); }
    inline const float* bounds_of_packets(int tile) const { return packet_bounds + tile * (BOUND_ROWS * LANES); }

    // Call `visit(tile)` for the tiles that overlap a rectangle and may show a surface, until it returns false; returns
    // whether it never did.
    template <class VisitTile>
    inline __attribute__((always_inline)) bool all_tiles(const Image& image, const RayBox& box, float inv_z,
                                                         VisitTile visit) const {
        for (const int group : Lanes::each(overlap(group_bounds, box))) {
            const Ints open = Lanes::load(image.tile_min + group * LANES) <= Lanes::all(inv_z);
            for (const int child : Lanes::each(open & overlap(bounds_of_tiles(group), box)))
                if (!visit(group * LANES + child)) return false;
        }
        return true;
    }
    // Bit masks of packets of a tile and rays of a packet that do so.
    inline unsigned packets_in(const Image& image, int tile, const RayBox& box, float inv_z) const {
        const Ints open = Lanes::load(image.block_min + tile * LANES) <= Lanes::all(inv_z);
        return Lanes::bits(open & overlap(bounds_of_packets(tile), box));
    }
    inline unsigned rays_in(const Image& image, int packet, const RayBox& box, float inv_z) const {
        const Floats at_u = Lanes::load(u + packet * LANES), at_v = Lanes::load(v + packet * LANES);
        return Lanes::bits((Lanes::load(image.inv_z + packet * LANES) <= Lanes::all(inv_z)) &
                           (at_u >= Lanes::all(box.u0)) & (at_u <= Lanes::all(box.u1)) & (at_v >= Lanes::all(box.v0)) &
                           (at_v <= Lanes::all(box.v1)));
    }

    // Recompute stale bounds of a tile. Rasterization only increases inv_z, so stale bounds are conservative: they are
    // refreshed where that may pay off.
    static inline void refresh(const Image& image, int tile) {
        if (!image.tile_stale[tile]) return;
        typedef unsigned char Flags __attribute__((ext_vector_type(LANES)));
        Flags stale;
        const int first = tile * LANES;
        __builtin_memcpy(&stale, image.block_stale + first, sizeof stale);
        for (const int k : Lanes::each(__builtin_convertvector(stale, Ints) != 0)) {
            const int packet = first + k;
            image.block_min[packet] = Lanes::min_of(Lanes::load(image.inv_z + packet * LANES));
        }
        __builtin_memset(image.block_stale + first, 0, LANES);
        image.tile_min[tile] = Lanes::min_of(Lanes::load(image.block_min + first));
        image.tile_stale[tile] = 0;
    }

    // Whether a rectangle is occluded: all its rays hit surfaces nearer than the visit.
    inline bool hides(const Image& image, const Visit& visit) const {
        const RayBox box = RayBox::of_pixels(image, visit.x0, visit.y0, visit.x1, visit.y1);
        const float inv_z = visit.nearest_inv_z;
        return all_tiles(image, box, inv_z, [&](int tile) __attribute__((always_inline)) {
            for (const int child : Lanes::each(packets_in(image, tile, box, inv_z)))
                if (rays_in(image, tile * LANES + child, box, inv_z)) return false;
            refresh(image, tile);
            return true;
        });
    }

    // Clear the z-buffer; lanes without a ray occlude everything and are never written.
    inline void begin(const Image& image, int groups) const {
        const int packets = groups * GROUP_PACKETS;
        for (int tile = 0; tile < groups * LANES; ++tile) {
            const bool full = corner[tile] >= 0;
            for (int packet = tile * LANES; packet < (tile + 1) * LANES; ++packet) {
                const Ints none = full ? Lanes::all_ints(0) : Lanes::load(place + packet * LANES) < Lanes::all_ints(0);
                Lanes::store(image.inv_z + packet * LANES, none ? Lanes::all(NOWHERE) : Lanes::all(0.0f));
            }
        }
        __builtin_memset(image.block_min, 0, packets * sizeof(float));
        __builtin_memset(image.tile_min, 0, groups * LANES * sizeof(float));
        __builtin_memset(image.block_stale, 0, packets);
        __builtin_memset(image.tile_stale, 0, groups * LANES);
    }
};

// Whether a visit is occluded.
template <RayKind KIND>
static inline bool is_hidden(const Image& image, const Visit& visit) {
    if constexpr (KIND != PIXEL_RAYS) return image.tree->hides(image, visit);
    return image.hides(visit.x0, visit.y0, visit.x1, visit.y1, visit.nearest_inv_z);
}
