// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rasterization of triangles into a packet's pixels: small ones one per lane, larger ones by all lanes together, one
// block of pixels at a time.

#pragma once

#include "cuda/uncertain_pixels.h"

struct Raster {
    // Triangles of at most this many pixels are rasterized by a single lane, if enough others are.
    enum { SMALL_AREA = 64, STEPS_PER_LANE = 5 };

    // Rasterize each lane's triangle, in the first `count` lanes. `broadcast` holds one triangle.
    static inline void rasterize(const Bvh& bvh, const Camera& camera, Packet& packet, const Triangle& t, int count,
                                 Triangle* broadcast, UncertainPixels& uncertain) {
        const int lane = Warp::lane();
        const int area = lane < count ? (t.x1 - t.x0 + 1) * (t.y1 - t.y0 + 1) : 0;
        const bool small = area > 0 && area <= SMALL_AREA;
        unsigned larger = Warp::ballot(area > 0);
        const unsigned small_lanes = Warp::ballot(small);
        if (small_lanes) {
            const int steps = Warp::reduce_max(small ? area : 0);
            if (steps <= STEPS_PER_LANE * __popc(small_lanes)) {
                if (POINTS)
                    rasterize_points(bvh, camera, packet, t, small, uncertain);
                else
                    rasterize_small(bvh, camera, packet, t, small ? area : 0, steps, uncertain);
                larger &= ~small_lanes;
            }
        }
        for (; larger; larger = Warp::without_first_lane(larger)) {
            const int k = Warp::first_lane(larger);
            if (lane == k) *broadcast = t;
            Warp::sync();
            rasterize_large(bvh, camera, packet, *broadcast, uncertain);
            Warp::sync();
        }
    }

    // Each lane steps through the pixels of its triangle's bounds, all lanes in parallel.
    static inline void rasterize_small(const Bvh& bvh, const Camera& camera, Packet& packet, const Triangle& t,
                                       int area, int steps, UncertainPixels& uncertain) {
        unsigned touched = 0;
        const bool cut = camera.near.cuts(t.max_inv_z);
        int x = t.x0, y = t.y0;
        for (int step = 0; step < steps; ++step) {
            if (step < area) {
                rasterize_spot(bvh, camera, packet, t, cut, Spot{x, y, Packet::index_at(x, y)}, uncertain, touched);
                ++x;
                if (x > t.x1) x = t.x0, ++y;
            }
        }
        packet.stale_blocks |= Warp::reduce_or(touched);
        Warp::sync();
    }

    // Each lane steps through the points in the cells of its triangle.
    static inline void rasterize_points(const Bvh& bvh, const Camera& camera, Packet& packet, const Triangle& t,
                                        bool mine, UncertainPixels& uncertain) {
        unsigned touched = 0;
        const bool cut = camera.near.cuts(t.max_inv_z);
        int x = t.x0, y = t.y0, slot = mine ? packet.memory->first_in(x, y) : -1;
        while (Warp::any(mine)) {
            if (slot >= 0) {
                rasterize_spot(bvh, camera, packet, t, cut, Spot{0, 0, slot}, uncertain, touched);
                slot = packet.memory->after(slot);
            }
            if (mine && slot < 0) {
                ++x;
                if (x > t.x1) x = t.x0, ++y;
                mine = y <= t.y1;
                if (mine) slot = packet.memory->first_in(x, y);
            }
        }
        packet.stale_blocks |= Warp::reduce_or(touched);
        Warp::sync();
    }

    // A pixel, or a point, which has only a slot.
    struct Spot {
        int x, y, index;
    };
    // Rasterize it if a lane's triangle covers it, and record its block.
    static inline void rasterize_spot(const Bvh& bvh, const Camera& camera, Packet& packet, const Triangle& t, bool cut,
                                      Spot spot, UncertainPixels& uncertain, unsigned& touched) {
        const int x = spot.x, y = spot.y, index = spot.index;
        const RayPlace p = packet.point(camera, x, y, index);
        const float within = t.within(p);
        if (within >= -t.error_bound) {
            Key* stored = packet.at(index);
            const float inv_z =
                t.exact
                    ? t.clamp(ExactPlane::of(camera, bvh.corners(t.slot)).at(packet.exact_point(camera, x, y, index)))
                    : t.inv_z_at(p);
            const Key key = DepthKey::of(inv_z, t.slot + bvh.first_id);
            if (within <= t.error_bound || camera.origins.may_hide(inv_z)) {
                if (t.may_show(*stored))
                    uncertain.add(t.slot, POINTS ? Packet::x_of(index) : x, POINTS ? Packet::y_of(index) : y);
            } else if (camera.near.shows(inv_z, cut) && key > *stored) {
                atomicMax(stored, key);
                touched |= 1u << (POINTS ? index / LANES : Packet::block_of(x, y));
            }
        }
    }

    // Rasterize one triangle with all lanes: first each tests one block, then each tests one pixel of the touched
    // blocks.
    static inline void rasterize_large(const Bvh& bvh, const Camera& camera, Packet& packet, const Triangle t,
                                       UncertainPixels& uncertain) {
        const int lane = Warp::lane();
        const int block_x = Packet::block_x(lane), block_y = Packet::block_y(lane);
        float u0 = camera.left_of(SmallInt::to_float(packet.first_x + block_x) + camera.first_u),
              u1 = camera.right_of(SmallInt::to_float(packet.first_x + block_x + BLOCK_WIDTH - 1) + camera.first_u);
        float v0 = camera.above(SmallInt::to_float(packet.first_y + block_y) + camera.first_v),
              v1 = camera.below(SmallInt::to_float(packet.first_y + block_y + BLOCK_HEIGHT - 1) + camera.first_v);
        bool touched = lane < BLOCKS && block_x + BLOCK_WIDTH - 1 >= t.x0 && block_x <= t.x1 &&
                       block_y + BLOCK_HEIGHT - 1 >= t.y0 && block_y <= t.y1;
        if (POINTS) {
            ImageBox box = {u0, u1, v0, v1};
            packet.memory->bounds_of(lane, box);
            const Cells cells = packet.memory->cells_of(lane);
            u0 = box.left, u1 = box.right, v0 = box.top, v1 = box.bottom;
            touched =
                lane < SLOT_BLOCKS && cells.x1 >= t.x0 && cells.x0 <= t.x1 && cells.y1 >= t.y0 && cells.y0 <= t.y1;
        }
        bool above = true, below = true, covered = true;
        for (int e = 0; e < 3; ++e) {
            // The extremes of an edge function are at corners of a block. Rounding is monotonic, so the test of a
            // corner pixel never contradicts that of another pixel.
            const bool right = t.edge[e].u >= 0.0f, down = t.edge[e].v >= 0.0f;
            const float max_edge = camera.origins.max_edge(t.edge[e], right ? u1 : u0, down ? v1 : v0);
            const float min_edge = camera.origins.min_edge(t.edge[e], right ? u0 : u1, down ? v0 : v1);
            above &= max_edge >= -t.error_bound;
            below &= min_edge <= t.error_bound;
            covered &= min_edge > t.error_bound;
        }
        touched &= above || (t.sees_both_sides() && below);
        covered &= !t.sees_both_sides();
        const float corner_inv_z = t.clamp(t.plane_at(t.slope_u >= 0.0f ? u1 : u0, t.slope_v >= 0.0f ? v1 : v0));
        const float nearest_inv_z =
            t.exact ? t.max_inv_z : NEARER * camera.origins.nearest(corner_inv_z, t.slope_u, t.slope_v);
        touched &= __float_as_uint(nearest_inv_z) >= packet.block_min_inv_z;
        const unsigned covered_blocks = Warp::ballot(covered);
        const unsigned blocks = Warp::ballot(touched);
        if (!blocks) return;
        packet.stale_blocks |= blocks;
        ExactPlane plane = {0.0, 0.0, 0.0};
        if (t.exact) plane = ExactPlane::of(camera, bvh.corners(t.slot));
        for (unsigned remaining = blocks; remaining; remaining = Warp::without_first_lane(remaining)) {
            const int block = Warp::first_lane(remaining);
            const int index = Packet::index(block, lane);
            const int x = Packet::block_x(block) + Packet::pixel_x(lane),
                      y = Packet::block_y(block) + Packet::pixel_y(lane);
            const RayPlace p = packet.point(camera, x, y, index);
            const float within = covered_blocks >> block & 1 ? NOWHERE : t.within(p);
            if (within < -t.error_bound) continue;
            const float inv_z = t.exact ? t.clamp(plane.at(packet.exact_point(camera, x, y, index))) : t.inv_z_at(p);
            Key* stored = packet.at(index);
            const Key key = DepthKey::of(inv_z, t.slot + bvh.first_id);
            if (within <= t.error_bound || camera.origins.may_hide(inv_z)) {
                if (t.may_show(*stored)) uncertain.add(t.slot, x, y);
            } else if (camera.near.shows(inv_z, camera.near.cuts(t.max_inv_z)) && key > *stored) {
                *stored = key;
            }
        }
    }
};

// Triangles that wait until there are enough for all lanes: of most leaves, only few triangles are visible.
struct TriangleQueue {
    enum { SIZE = 2 * LANES };  // fewer than LANES triangles wait when LANES more are added

    unsigned* slots;
    int count;

    inline void add(bool is_visible, unsigned slot) {
        const unsigned lanes = Warp::ballot(is_visible);
        if (is_visible) slots[count + __popc(lanes & ((1u << Warp::lane()) - 1))] = slot;
        count += __popc(lanes);
        Warp::sync();
    }

    // Take one triangle per lane, as far as available; the others keep waiting. The taken ones are stored behind those
    // until more are added.
    inline int take(unsigned& slot) {
        const int lane = Warp::lane(), taken = min(count, (int)LANES);
        slot = slots[min(lane, taken - 1)];
        count -= taken;
        const unsigned next = slots[LANES + lane];
        Warp::sync();
        slots[lane] = next;
        slots[LANES + lane] = slot;
        Warp::sync();
        return taken;
    }
    static inline const unsigned* taken(const unsigned* slots) { return slots + LANES; }
};
