// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rays in lanes, and bounds of a leaf's triangles, for tests against the rays of a tile or of its packets.

#pragma once

#include "cpu/solids.h"

// Rays in lanes: of a packet, one ray in all lanes, or a window of a tile.
template <RayKind KIND>
struct RayLanes {
    Floats u, v;
    Floats p = {}, q = {}, w = {};  // only for ORIGIN_RAYS

    static inline RayLanes packet(const RayTree& tree, int packet) {
        const auto load = [packet](const float* rays) { return Lanes::load(rays + packet * LANES); };
        RayLanes rays = {.u = load(tree.u), .v = load(tree.v)};
        if constexpr (KIND == ORIGIN_RAYS) rays.set_origins(load(tree.origins.p), load(tree.origins.q));
        return rays;
    }
    static inline RayLanes ray(const RayTree& tree, int ray) {
        RayLanes rays = {.u = Lanes::all(tree.u[ray]), .v = Lanes::all(tree.v[ray])};
        if constexpr (KIND == ORIGIN_RAYS)
            rays.set_origins(Lanes::all(tree.origins.p[ray]), Lanes::all(tree.origins.q[ray]));
        return rays;
    }
    static inline RayLanes window(const RayTree& tree, int corner, int width) {
        const auto load = [=](const float* rows) { return Grid::window(rows + corner, width); };
        RayLanes rays = {.u = load(tree.row_u), .v = load(tree.row_v)};
        if constexpr (KIND == ORIGIN_RAYS) rays.set_origins(load(tree.origins.row_p), load(tree.origins.row_q));
        return rays;
    }
    inline void set_origins(Floats at_p, Floats at_q) { p = at_p, q = at_q, w = u * q - v * p; }

    // Minimum of a triangle's three edge functions: of triangle k for all rays, or of each lane's triangle.
    inline Floats inner(const Triangles& t, int k) const {
        Floats edge[3];
        for (int e = 0; e < 3; ++e) {
            const Linear linear = Linear::of_lane(t.edge[e], k);
            edge[e] = linear.at(u, linear.row(v));
            if constexpr (KIND == ORIGIN_RAYS) edge[e] += of_moment(t.side[e].x[k], t.side[e].y[k], t.side[e].z[k]);
        }
        return Lanes::min(edge[0], edge[1], edge[2]);
    }
    inline Floats inner(const Triangles& t) const {
        Floats edge[3];
        for (int e = 0; e < 3; ++e) {
            edge[e] = t.edge[e].at(u, t.edge[e].row(v));
            if constexpr (KIND == ORIGIN_RAYS) edge[e] += of_moment(t.side[e].x, t.side[e].y, t.side[e].z);
        }
        return Lanes::min(edge[0], edge[1], edge[2]);
    }
    template <class Number>
    inline Floats of_moment(Number x, Number y, Number z) const {
        return y * p + (z * w - x * q);
    }
    inline Floats inv_z(const Linear& plane) const {
        const Floats inv_z = plane.at(u, plane.row(v));
        if constexpr (KIND == ORIGIN_RAYS) return inv_z / (1.0f - (plane.u * p + plane.v * q));
        return inv_z;
    }
};

// A leaf's triangles and their bounds: for ORIGIN_RAYS, relative to the rays of a tile.
template <RayKind KIND>
struct RayLeaf {
    const Triangles& triangles;
    RayBox box;  // of all shown triangles
    float nearest;  // greatest inv_z of all
    float bounds[RayTree::BOUND_ROWS][LANES];  // of each triangle: least u and v, greatest u and v
    float min_size;  // least over all triangles of the longer side of their rectangles
    unsigned inexact;  // lanes in which single precision does not suffice for inv_z
    unsigned uncertain_side;  // lanes of triangles of which rays may see another side than the eye does
    unsigned computed;  // lanes whose planes have been computed
    ExactPlane planes[LANES];
    // Only for ORIGIN_RAYS: edge functions at the middle of the moments, and the bound of their deviation from it.
    Floats one[3], slack[3];

    inline RayLeaf(const Camera& camera, const Image& image, const Triangles& t, const Visit& visit) : triangles(t) {
        box = RayBox::of_pixels(image, visit.x0, visit.y0, visit.x1, visit.y1);
        nearest = visit.nearest_inv_z;
        Lanes::store(bounds[0], __builtin_convertvector(t.x0, Floats) - image.center_x);
        Lanes::store(bounds[1], __builtin_convertvector(t.y0, Floats) - image.center_y);
        Lanes::store(bounds[2], __builtin_convertvector(t.x1 + 1, Floats) - image.center_x);
        Lanes::store(bounds[3], __builtin_convertvector(t.y1 + 1, Floats) - image.center_y);
        const Ints size = t.shown ? (t.x1 - t.x0 > t.y1 - t.y0 ? t.x1 - t.x0 : t.y1 - t.y0) : Lanes::all_ints(1 << 24);
        min_size = (float)(__builtin_reduce_min(size) + 1);
        computed = 0;
        if constexpr (KIND == ORIGIN_RAYS) {
            uncertain_side = Lanes::bits(t.uncertain_side);
            const Floats width = t.place[2] - t.place[0], height = t.place[3] - t.place[1];
            inexact = Lanes::bits(t.inexact | Raster::has_unstable_plane(camera, t, width, height)) | uncertain_side;
        } else {
            uncertain_side = 0;
            inexact = Lanes::bits(t.inexact | Raster::has_unstable_plane(camera, t));
        }
    }

    // Set the bounds for the rays of a tile.
    inline void set_tile(const RayOrigins& origins, int tile) {
        if constexpr (KIND != ORIGIN_RAYS) return;
        const Triangles& t = triangles;
        const float* range = origins.range + tile * RayOrigins::RANGE_WORDS;
        const Ints endless = t.place[0] <= Lanes::all(-1e30f);
        const Floats max_inv_z = endless ? Lanes::all(0.0f) : t.max_inv_z,
                     min_inv_z = endless ? Lanes::all(0.0f) : t.min_inv_z;
        const Floats middle = 0.5f * (max_inv_z + min_inv_z), half = 0.50001f * (max_inv_z - min_inv_z);
        for (int k = 0; k < 2; ++k) {
            const Floats shift = range[k] * middle;
            const Floats margin =
                __builtin_fabsf(range[k]) * half + range[k + 3] * max_inv_z + 1e-5f * Lanes::abs(shift);
            Lanes::store(bounds[k], t.place[k] - (shift + margin));
            Lanes::store(bounds[k + 2], t.place[k + 2] - (shift - margin));
        }
        for (int e = 0; e < 3; ++e) {
            const Points& s = t.side[e];
            one[e] = t.edge[e].one + (s.y * range[0] + (s.z * range[2] - s.x * range[1]));
            slack[e] = t.error_bound + 1.0001f * (Lanes::abs(s.y) * range[3] +
                                                  (Lanes::abs(s.z) * range[5] + Lanes::abs(s.x) * range[4]));
        }
    }

    inline RayBox box_of(int k) const { return RayTree::box_of(bounds[0], k); }
    inline bool is_inexact(int k) const { return (inexact >> k) & 1; }
    inline bool is_uncertain_side(int k) const { return KIND == ORIGIN_RAYS && ((uncertain_side >> k) & 1); }
    // An edge function for the rays of the tile, and how much it may differ from that of a ray.
    inline Linear edge(int e) const {
        const Linear& edge = triangles.edge[e];
        return KIND == ORIGIN_RAYS ? Linear{edge.u, edge.v, one[e]} : edge;
    }
    inline const Floats& error_bound(int e) const { return KIND == ORIGIN_RAYS ? slack[e] : triangles.error_bound; }

    // Triangles that may be visible in a rectangle: an edge function is greatest at one of its corners.
    inline unsigned touching(const RayBox& box, float min_inv_z) const {
        const Triangles& t = triangles;
        const Floats none = Lanes::all(0.0f);
        Ints inside = Lanes::all_ints(-1);
        for (int e = 0; e < 3; ++e) {
            const Linear edge = this->edge(e);
            const Floats u = edge.u >= none ? Lanes::all(box.u1) : Lanes::all(box.u0);
            const Floats v = edge.v >= none ? Lanes::all(box.v1) : Lanes::all(box.v0);
            inside &= edge.at(u, edge.row(v)) >= -error_bound(e);
        }
        if constexpr (KIND == ORIGIN_RAYS) inside |= t.uncertain_side;
        return Lanes::bits(t.shown & RayTree::overlap(bounds[0], box) & (t.max_inv_z >= Lanes::all(min_inv_z)) &
                           inside);
    }

    inline const ExactPlane& plane(const Camera& camera, int k) {
        if (!((computed >> k) & 1)) {
            planes[k] = ExactPlane::of(camera, triangles.corners, k);
            computed |= 1u << k;
        }
        return planes[k];
    }
};

// Least ratio of inv_z to its change across the image for which single precision suffices: rounding of the rays' u and
// v, by up to 3e-8 of the image, then changes inv_z by less than 1e-6 of it.
constexpr float STEEPEST_PACKET = 0.03f;

// A plane expanded about the middle of a packet: its value there is computed in double precision.
struct PacketPlane {
    float base, u, v, middle_u, middle_v;
    bool steep;

    static inline PacketPlane of(const Camera& camera, const RayTree& tree, const ExactPlane& plane, int packet) {
        const RayBox box = RayTree::box_of(tree.bounds_of_packets(packet / LANES), packet % LANES);
        PacketPlane near;
        near.u = (float)plane.u, near.v = (float)plane.v;
        near.middle_u = 0.5f * (box.u0 + box.u1), near.middle_v = 0.5f * (box.v0 + box.v1);
        near.base = (float)(plane.u * near.middle_u + (plane.v * near.middle_v + plane.one));
        const float slope_u = __builtin_fabsf(near.u), slope_v = __builtin_fabsf(near.v);
        const float reach = slope_u * (box.u1 - near.middle_u) + slope_v * (box.v1 - near.middle_v);
        near.steep = !(near.base - reach >= STEEPEST_PACKET * camera.extent * (slope_u + slope_v));
        return near;
    }
    inline Floats at(Floats at_u, Floats at_v) const { return u * (at_u - middle_u) + (v * (at_v - middle_v) + base); }
    inline float at(float at_u, float at_v) const { return u * (at_u - middle_u) + (v * (at_v - middle_v) + base); }
};

// The same for all packets of a tile.
struct PacketPlanes {
    float u, v, base[LANES], middle_u[LANES], middle_v[LANES];
    unsigned steep;
    Floats nearest;  // upper bound of inv_z in each packet

    inline void set(const Camera& camera, const ExactPlane& plane, const float* bounds) {
        const Floats u0 = Lanes::load(bounds), v0 = Lanes::load(bounds + LANES), u1 = Lanes::load(bounds + 2 * LANES),
                     v1 = Lanes::load(bounds + 3 * LANES);
        u = (float)plane.u, v = (float)plane.v;
        const Floats at_u = 0.5f * (u0 + u1), at_v = 0.5f * (v0 + v1);
        const Doubles exact = plane.u * __builtin_convertvector(at_u, Doubles) +
                              (plane.v * __builtin_convertvector(at_v, Doubles) + plane.one);
        const Floats center = __builtin_convertvector(exact, Floats);
        const float slope_u = __builtin_fabsf(u), slope_v = __builtin_fabsf(v);
        const Floats reach = slope_u * (u1 - at_u) + slope_v * (v1 - at_v);
        steep = ~Lanes::bits(center - reach >= Lanes::all(STEEPEST_PACKET * camera.extent * (slope_u + slope_v)));
        nearest = (center + reach) + 1e-5f * (Lanes::abs(center) + reach);
        Lanes::store(base, center);
        Lanes::store(middle_u, at_u);
        Lanes::store(middle_v, at_v);
    }
    inline PacketPlane of(int child) const {
        return PacketPlane{base[child], u, v, middle_u[child], middle_v[child], ((steep >> child) & 1) != 0};
    }
};

// The packets of a tile that a triangle touches and those that it covers, as bit masks.
struct TouchedPackets {
    unsigned touched, covered;
    Floats nearest;  // upper bound of inv_z of TABLE_RAYS in each packet, if single precision suffices for the plane

    template <RayKind KIND>
    static inline TouchedPackets of(const RayLeaf<KIND>& leaf, int k, const float* bounds) {
        Ints touched = Lanes::all_ints(-1), covered = touched;
        const Floats u0 = Lanes::load(bounds), v0 = Lanes::load(bounds + LANES), u1 = Lanes::load(bounds + 2 * LANES),
                     v1 = Lanes::load(bounds + 3 * LANES);
        for (int e = 0; e < 3; ++e) {
            const Linear edge = Linear::of_lane(leaf.edge(e), k);
            const float error_bound = leaf.error_bound(e)[k];
            const bool right = edge.u[0] >= 0.0f, down = edge.v[0] >= 0.0f;
            touched &= edge.at(right ? u1 : u0, edge.row(down ? v1 : v0)) >= Lanes::all(-error_bound);
            covered &= edge.at(right ? u0 : u1, edge.row(down ? v0 : v1)) > Lanes::all(error_bound);
        }
        const Linear plane = Linear::of_lane(leaf.triangles.inv_z, k);
        const Floats nearest = plane.at(plane.u[0] >= 0.0f ? u1 : u0, plane.row(plane.v[0] >= 0.0f ? v1 : v0));
        return TouchedPackets{Lanes::bits(touched), Lanes::bits(covered), 1.00001f * nearest};
    }
};

// Rays of a tile that a leaf's tiny triangles hit, in lanes: up to two columns and rows of each triangle.
struct TinyHits {
    enum { SIDE = 2, RAYS = SIDE * SIDE };
    int column[LANES], row[LANES];  // the first ones
    unsigned hits[RAYS], certain[RAYS];  // lanes, of each of the rays
    float inv_z[RAYS][LANES];

    // Lanes that hit a ray, and bits of the rays of a lane.
    inline unsigned any() const { return hits[0] | hits[1] | hits[2] | hits[3]; }
    inline unsigned rays_of(int k) const {
        return (hits[0] >> k & 1) | (hits[1] >> k & 1) << 1 | (hits[2] >> k & 1) << 2 | (hits[3] >> k & 1) << 3;
    }
    // First columns or rows, such that all are inside the tile.
    static inline Ints begin(Ints first, int last) {
        const Ints last_start = Lanes::all_ints(last - (SIDE - 1));
        return first < last_start ? first : last_start;
    }
};

// Columns and rows of a tile that a leaf's triangles may touch.
struct RayColumns {
    // Triangles of at most this many columns and rows touch only the rays of one window of a tile.
    enum { SMALL_SIDE = 4 };

    int first_ray;  // of the tile
    const RayFit& fit;
    Ints first_column, last_column, first_row, last_row;
    // Lanes of triangles that may touch few rays, and of those that may touch more; of the former, lanes of those that
    // touch at most two columns and two rows.
    unsigned small, larger, tiny;

    template <RayKind KIND>
    inline RayColumns(const Image& image, const RayLeaf<KIND>& leaf, int tile)
        : first_ray(tile * (LANES * LANES)), fit(image.tree->fit[tile]) {
        const Floats u0 = Lanes::load(leaf.bounds[0]), v0 = Lanes::load(leaf.bounds[1]),
                     u1 = Lanes::load(leaf.bounds[2]), v1 = Lanes::load(leaf.bounds[3]);
        const Floats u = 0.5f * (u0 + u1) - fit.u, v = 0.5f * (v0 + v1) - fit.v;
        const Floats half_u = 0.5f * (u1 - u0), half_v = 0.5f * (v1 - v0);
        Ints candidates = leaf.triangles.shown & (leaf.triangles.max_inv_z >= Lanes::all(image.tile_min[tile]));
        candidates &=
            range(u * fit.column_u + v * fit.column_v,
                  half_u * __builtin_fabsf(fit.column_u) + half_v * __builtin_fabsf(fit.column_v) + fit.off_column,
                  fit.last_column(), first_column, last_column);
        candidates &= range(u * fit.row_u + v * fit.row_v,
                            half_u * __builtin_fabsf(fit.row_u) + half_v * __builtin_fabsf(fit.row_v) + fit.off_row,
                            fit.last_row(), first_row, last_row);
        const Ints side = Lanes::all_ints(SMALL_SIDE);
        const Ints few = candidates & (last_column - first_column < side) & (last_row - first_row < side);
        small = Lanes::bits(few);
        const Ints two = Lanes::all_ints(TinyHits::SIDE);
        tiny = Lanes::bits(few & (last_column - first_column < two) & (last_row - first_row < two));
        larger = Lanes::bits(candidates & ~few);
    }
    static inline Ints range(Floats middle, Floats half, int max_index, Ints& first, Ints& last) {
        const Floats none = Lanes::all(0.0f), low = Lanes::max(__builtin_elementwise_ceil(middle - half), none);
        const Floats high = Lanes::min(__builtin_elementwise_floor(middle + half), Lanes::all((float)max_index));
        const Ints nonempty = low <= high;
        first = __builtin_convertvector(nonempty ? low : none, Ints);
        last = __builtin_convertvector(nonempty ? high : none, Ints);
        return nonempty;
    }
    // First column or row of each window, such that the window ends inside the tile.
    static inline void begin(Ints first, int last, int* to) {
        const Ints last_start = Lanes::all_ints(last - (SMALL_SIDE - 1));
        Lanes::store(to, first < last_start ? first : last_start);
    }
};
static_assert(RayColumns::SMALL_SIDE * RayColumns::SMALL_SIDE == LANES, "a register holds a window");
