// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Traversal of the BVH by a packet, front to back, with frustum culling, back-face culling and occlusion culling by the
// packet's z-buffer.

#pragma once

#include "cuda/raster.h"
#include "cuda/visits.h"

// Factor that covers the rounding error of a radius.
constexpr float WIDER = 1.0001f;

struct Walk {
    enum { FEW_CELLS = 4 };  // greatest number of cells whose points a lane tests

    // State of a node while one of its children is traversed: its remaining visits. The children are read again.
    struct Level {
        unsigned visit[LANES];
        int node;

        inline void put(unsigned of_lane, int of_all) {
            visit[Warp::lane()] = of_lane;
            if (Warp::lane() == 0) node = of_all;
            Warp::sync();
        }
        inline void get(const Bvh& bvh, unsigned& of_lane, int& of_all, int& child) const {
            of_lane = visit[Warp::lane()];
            of_all = node;
            child = child_of(bvh, node);
        }
    };
    static inline int child_of(const Bvh& bvh, int node) {
        return __ldg(bvh.children + (long long)node * LANES + Warp::lane());
    }

    // Whether all triangles of the child face away: the directions from the camera to all points of its box form acute
    // angles with every normal in the cone.
    static inline bool faces_away(const Origins& origins, Vec3 axis, float cutoff, Vec3 low, Vec3 high) {
        const Vec3 sum = Vec3::plus(low, high), size = Vec3::minus(high, low);
        // Both sides are doubled: twice the center and twice half the diagonal.
        return Vec3::dot(sum, axis) >=
               origins.past(cutoff * Root::about(Vec3::dot(sum, sum)) + WIDER * Root::about(Vec3::dot(size, size)));
    }

    // Greatest coordinate of a box along a direction.
    static inline float farthest_along(Vec3 direction, Vec3 low, Vec3 high) {
        return fmaxf(direction.x * low.x, direction.x * high.x) + fmaxf(direction.y * low.y, direction.y * high.y) +
               fmaxf(direction.z * low.z, direction.z * high.z);
    }

    // Whether a box intersects the frustum of a rectangle of pixels whose first one is at (u, v), widened by `aside`;
    // tests its five planes.
    static inline bool reaches_frustum(const Vec3* to_camera, float u, float v, float columns, float rows, Vec3 low,
                                       Vec3 high, ImagePoint aside) {
        const Vec3 x = to_camera[0], y = to_camera[1], z = to_camera[2];
        const float u0 = u - 0.5f, u1 = u0 + columns, v0 = v - 0.5f, v1 = v0 + rows;
        return farthest_along(z, low, high) >= 0.0f &&
               farthest_along(combined(x, z, -u0, 1.0f), low, high) >= -aside.u &&
               farthest_along(combined(x, z, u1, -1.0f), low, high) >= -aside.u &&
               farthest_along(combined(y, z, -v0, 1.0f), low, high) >= -aside.v &&
               farthest_along(combined(y, z, v1, -1.0f), low, high) >= -aside.v;
    }
    static inline Vec3 combined(Vec3 x, Vec3 z, float of_z, float of_x) {
        return Vec3{of_z * z.x + of_x * x.x, of_z * z.y + of_x * x.y, of_z * z.z + of_x * x.z};
    }

    // Bounds of a box in the image, in pixels from the principal point.
    struct ScreenBounds : ImageBox {
        float zmin, zmax;
        float slack;  // margin for rounding
        bool crossing;  // reaches so close to the camera, or behind it, that it may cover any part of the image

        static inline ScreenBounds of(const Vec3* m, Vec3 low, Vec3 high, float blur, bool shown) {
            const Vec3 middle = half_of(Vec3::plus(low, high)), half = half_of(Vec3::minus(high, low));
            const float x = Vec3::dot(m[0], middle), y = Vec3::dot(m[1], middle), z = Vec3::dot(m[2], middle);
            const float depth = across(m[2], half);
            ScreenBounds p;
            p.zmin = z - depth, p.zmax = z + depth;
            p.slack = SMALL_BOX_SLACK + SMALL_BOX_SLACK_BLURS * blur;
            p.crossing = p.zmin <= BOX_CROSSING_SHARE * (across(m[2], magnitude(middle)) + depth);
            if (Warp::any(shown && !p.crossing && depth > DEEP_SHARE * z)) {
                p.set_corners(m, low, high);
                p.slack = BOX_SLACK + BOX_SLACK_BLURS * blur;
                return p;
            }
            // With u of the box's center, x - u z is linear and 0 at the center, so its extent divided by the least z
            // bounds the box's extent in the image.
            const float inv_z = Reciprocal::about(z), inv_zmin = Reciprocal::about(p.zmin);
            const float u = x * inv_z, v = y * inv_z;
            const float aside = across(Vec3::along(m[0], m[2], -u), half) * inv_zmin;
            const float along = across(Vec3::along(m[1], m[2], -v), half) * inv_zmin;
            p.left = u - aside, p.right = u + aside, p.top = v - along, p.bottom = v + along;
            return p;
        }
        inline float nearest_inv_z() const { return crossing ? NOWHERE : NEARER * Reciprocal::about(zmin); }

        static inline Vec3 half_of(Vec3 v) { return Vec3{0.5f * v.x, 0.5f * v.y, 0.5f * v.z}; }
        static inline Vec3 magnitude(Vec3 v) { return Vec3{fabsf(v.x), fabsf(v.y), fabsf(v.z)}; }
        // Half extent of a box along a direction.
        static inline float across(Vec3 direction, Vec3 half) { return Vec3::dot(magnitude(direction), half); }

        inline void set_corners(const Vec3* m, Vec3 low, Vec3 high) {
            // The eight corners in camera space are sums of one term per axis.
            const Vec3 x[2] = {scaled(m, 0, low.x), scaled(m, 0, high.x)};
            const Vec3 y[2] = {scaled(m, 1, low.y), scaled(m, 1, high.y)};
            const Vec3 z[2] = {scaled(m, 2, low.z), scaled(m, 2, high.z)};
            left = top = NOWHERE;
            right = bottom = -NOWHERE;
            for (int corner = 0; corner < 8; ++corner) {
                const Vec3 p = Vec3::plus(Vec3::plus(x[corner & 1], y[corner >> 1 & 1]), z[corner >> 2]);
                const float inv_z = Reciprocal::about(p.z), u = p.x * inv_z, v = p.y * inv_z;
                left = fminf(left, u), right = fmaxf(right, u);
                top = fminf(top, v), bottom = fmaxf(bottom, v);
            }
        }
        static inline Vec3 scaled(const Vec3* rows, int axis, float by) {
            const float* m = &rows[0].x + axis;
            return Vec3{m[0] * by, m[3] * by, m[6] * by};
        }
    };

    // Open a node: returns the visit of this lane's child, 0 if it is not visible. If only small leaves are visible,
    // `small` is their mask and nothing is left to visit: they are close together, so their order hardly matters.
    static inline unsigned open(const Bvh& bvh, const Camera& camera, const Packet& packet, int index, int& child,
                                unsigned& small) {
        const float* node = bvh.nodes + (long long)index * NODE_WORDS + Warp::lane();
        // All loads are issued before the first use, so that there is a single wait.
        const Vec3 box_low = Place::load(node + NODE_LOW_ROW * LANES),
                   box_high = Place::load(node + NODE_HIGH_ROW * LANES);
        child = child_of(bvh, index);
        Vec3 axis = {0.0f, 0.0f, 0.0f};
        float cutoff = 0.0f;
        if (camera.skip_back_faces)
            axis = Place::load(node + CONE_AXIS_ROW * LANES), cutoff = __ldg(node + CONE_CUTOFF_ROW * LANES);
        const Vec3 low = camera.relative(box_low), high = camera.relative(box_high);
        const bool shown =
            box_low.x <= box_high.x && !(camera.skip_back_faces && faces_away(camera.origins, axis, cutoff, low, high));
        Child found = visit(camera, camera.to_camera, packet, low, high, shown);
        small = 0;
        if (found.visit && PixelRect::few(found.pixels) && is_occluded(packet, found)) found.visit = 0;
        if (!Warp::any(found.visit && !(child < 0 && PixelRect::small(found.pixels)))) {
            small = Warp::ballot(found.visit != 0);
            if (found.visit && bvh.is_large) Cache::prefetch(bvh.corners((unsigned)~child * LANES), LEAF_ROWS);
            return 0;
        }
        return found.visit;
    }

    // Whether all pixels that a child may cover show nearer surfaces. There are few: a lane tests its child's.
    static inline bool is_occluded(const Packet& packet, const Child& child) {
        const unsigned nearest = Visit::nearest_inv_z(child.visit);
        const FewPixels few = FewPixels::of(child.pixels);
        return packet.inv_z_bits(few.x[0], few.y[0]) > nearest && packet.inv_z_bits(few.x[1], few.y[1]) > nearest &&
               packet.inv_z_bits(few.x[2], few.y[2]) > nearest && packet.inv_z_bits(few.x[3], few.y[3]) > nearest;
    }

    // The visit of a box, given relative to the camera in a frame whose rotation into camera space has three rows.
    static inline Child visit(const Camera& camera, const Vec3* to_camera, const Packet& packet, Vec3 low, Vec3 high,
                              bool shown) {
        if (!Warp::any(shown)) return Child{0, 0};
        ScreenBounds p = ScreenBounds::of(to_camera, low, high, camera.blur, shown);
        ImageBox box = p;
        float inv_z = 0.0f;
        if (RAY_ORIGINS) {
            // The bounds are widened by the displacement at the nearest depth; the box, which is tested at the mean 1 /
            // z, only by the deviation from the mean.
            const float max_inv_z = p.nearest_inv_z(), min_inv_z = Reciprocal::about(p.zmax) * (1.0f / NEARER);
            inv_z = 0.5f * (min_inv_z + max_inv_z);
            box.widen(camera.origins.aside_at(0.50001f * (max_inv_z - min_inv_z)));
            p.widen(camera.origins.aside_at(max_inv_z));
        }
        const ImagePoint slack = camera.wider(p.slack), spread = camera.wider(0.0f);
        const float u = camera.first_u + (float)packet.first_x, v = camera.first_v + (float)packet.first_y;
        const PixelBounds in = p.pixels({u, v}, {PACKET_WIDTH - 1.0f, PACKET_HEIGHT - 1.0f}, slack, p.crossing);
        shown = shown && p.zmin <= camera.far && in.any();
        if (shown && p.crossing)
            shown =
                reaches_frustum(to_camera, camera.left_of(u), camera.above(v), (float)PACKET_WIDTH + 2.0f * spread.u,
                                (float)PACKET_HEIGHT + 2.0f * spread.v, low, high, camera.origins.aside());
        if (!shown) return Child{0, 0};
        if (POINTS && !p.crossing &&
            !shows_points(camera, packet, box, inv_z, p.slack, __float_as_uint(p.nearest_inv_z())))
            return Child{0, 0};
        Child child = child_of(p.nearest_inv_z(), (int)in.left, (int)in.top, (int)in.right, (int)in.bottom);
        if (p.crossing) child.pixels |= PixelRect::ANYWHERE;
        if (RAY_TABLE && !p.crossing && PixelRect::few(child.pixels) &&
            !meets_few(camera, packet, child.pixels, box, inv_z, p.slack))
            return Child{0, 0};
        return child;
    }
    static inline Child child_of(float nearest_inv_z, int x0, int y0, int x1, int y1) {
        return Child{Visit::of(nearest_inv_z, x0, y0, x1, y1), PixelRect::of(x0, y0, x1, y1)};
    }

    // Blocks that the child may cover and that do not show nearer surfaces only.
    static inline bool open_block(const Packet& packet, unsigned visit) {
        const int lane = Warp::lane();
        // Without the test of the lane, a visit at NOWHERE would match lanes without a block, which are at NOWHERE too.
        const bool met = POINTS ? (lane < SLOT_BLOCKS) & Visit::meets(visit, packet.memory->pixels_of(lane))
                                : Visit::touches(visit, lane);
        return met && packet.block_min_inv_z <= Visit::nearest_inv_z(visit);
    }
    static inline unsigned open_blocks(const Packet& packet, unsigned visit) {
        return Warp::ballot(open_block(packet, visit));
    }
    static inline bool hidden(const Packet& packet, unsigned visit) { return !Warp::any(open_block(packet, visit)); }
    // Whether a ray passes through bounds of few pixels; true for more pixels.
    static inline bool meets_rays(const Camera& camera, const Packet& packet, const ImageBox& box, float inv_z) {
        const float rounding = Setup::rounding_of(camera);
        ImageBox wide = box;
        wide.widen(camera.origins.aside_at(inv_z));
        const float u = camera.first_u + (float)packet.first_x, v = camera.first_v + (float)packet.first_y;
        const PixelBounds in =
            wide.pixels({u, v}, {PACKET_WIDTH - 1.0f, PACKET_HEIGHT - 1.0f}, camera.wider(rounding), false);
        const unsigned pixels = PixelRect::of((int)in.left, (int)in.top, (int)in.right, (int)in.bottom);
        return !PixelRect::few(pixels) || meets_few(camera, packet, pixels, box, inv_z, rounding);
    }
    // Whether a ray of these pixels passes through bounds, which are widened for surfaces nearer or farther than 1 / z.
    static inline bool meets_few(const Camera& camera, const Packet& packet, unsigned pixels, const ImageBox& box,
                                 float inv_z, float rounding) {
        const FewPixels few = FewPixels::of(pixels);
        bool meets = false;
        for (int k = 0; k < 4; ++k) {
            const RayPlace p = packet.point(camera, few.x[k], few.y[k], Packet::index_at(few.x[k], few.y[k]));
            meets |= box.holds(Origins::seen(p, inv_z), rounding);
        }
        return meets;
    }

    // Whether a box of few cells contains points that do not show surfaces nearer than the given bits of 1 / z; true
    // for more cells.
    static inline bool shows_points(const Camera& camera, const Packet& packet, const ImageBox& box, float inv_z,
                                    float rounding, unsigned nearest_inv_z) {
        ImageBox wide = box;
        wide.widen(camera.origins.aside_at(inv_z));
        const Cells cells = wide.cells(camera, rounding);
        const bool few = cells.any() && cells.count() <= FEW_CELLS;
        const int last_y = few ? cells.y1 : cells.y0 - 1;
        bool shown = cells.any() && !few;
        for (int y = cells.y0; y <= last_y; ++y)
            for (int x = cells.x0; x <= cells.x1; ++x)
                for (int slot = packet.memory->first_in(x, y); slot >= 0; slot = packet.memory->after(slot))
                    shown |= DepthKey::inv_z_bits(*packet.at(slot)) <= nearest_inv_z &&
                             box.holds(Origins::seen(packet.point(camera, 0, 0, slot), inv_z), rounding);
        return shown;
    }

    // Queue triangles of leaves until there are enough. The next leaf is loaded while the lanes test one.
    static inline void queue_leaves(const Bvh& bvh, const Camera& camera, const Packet& packet, int child,
                                    unsigned& lanes, TriangleQueue& queue) {
        const Setup::PacketBounds bounds = Setup::PacketBounds::of(camera, packet.first_x, packet.first_y);
        unsigned slot = ~Warp::shuffle(child, Warp::first_lane(lanes)) * LANES + Warp::lane();
        Setup::Corners corners = Setup::Corners::of(bvh.corners(slot));
        for (;;) {
            const Setup::Corners current = corners;
            const unsigned current_slot = slot;
            lanes = Warp::without_first_lane(lanes);
            if (lanes) {
                slot = ~Warp::shuffle(child, Warp::first_lane(lanes)) * LANES + Warp::lane();
                corners = Setup::Corners::of(bvh.corners(slot));
            }
            ImageBox box;
            float inv_z;
            bool is_visible = Setup::may_cover(bvh, camera, bounds, current, current_slot, box, inv_z);
            if (POINTS && is_visible)
                is_visible = shows_points(camera, packet, box, inv_z, Setup::rounding_of(camera), ~0u);
            else if (RAY_TABLE && is_visible)
                is_visible = meets_rays(camera, packet, box, inv_z);
            queue.add(is_visible, current_slot);
            if (!lanes || queue.count >= LANES) return;
        }
    }

    // Shared memory of a traversal, except for the levels.
    struct Memory {
        Triangle broadcast;
        unsigned triangles[TriangleQueue::SIZE];
        UncertainPixels uncertain;
        // Where to resume: `level` is -1 before the start.
        int level, queued;
        unsigned small;

        inline void go_on_at(int of_level, int of_queue, unsigned of_small) {
            if (Warp::lane() == 0) level = of_level, queued = of_queue, small = of_small;
            Warp::sync();
        }
    };

    // Rasterize all visible triangles of a BVH. `levels` has one entry for each of its levels.
    static inline void traverse(const Bvh& bvh, const Camera& camera, Packet& packet, Level* levels, Memory& memory) {
        if (Warp::lane() == 0) memory.uncertain.count = 0;
        memory.go_on_at(-1, 0, 0);
        for (bool more = true; more;) {
            more = go_on(bvh, camera, packet, levels, memory);
            if (memory.uncertain.count == 0) return;
            // At this point no state of the traversal is in registers, which the call would have to save.
            packet.stale_blocks =
                Exactly::rasterize(bvh, &camera, packet, &memory.uncertain, TriangleQueue::taken(memory.triangles));
            packet.refresh();
        }
    }

    // Rasterize up to LANES of the queued triangles.
    static inline void rasterize_queued(const Bvh& bvh, const Camera& camera, Packet& packet, TriangleQueue& queue,
                                        Memory& memory) {
        unsigned slot;
        const int count = queue.take(slot);
        const Triangle t = Setup::triangle(bvh, camera, packet.first_x, packet.first_y, slot);
        Raster::rasterize(bvh, camera, packet, t, count, &memory.broadcast, memory.uncertain);
        packet.refresh();
    }

    // Traverse until all is rasterized, or until the memory of uncertain pixels may overflow. Returns whether it may.
    static inline bool go_on(const Bvh& bvh, const Camera& camera, Packet& packet, Level* levels, Memory& memory) {
        const int lane = Warp::lane();
        TriangleQueue queue = {memory.triangles, memory.queued};
        int level = memory.level, child = 0;
        unsigned visit = 0, small = memory.small;
        int node = bvh.root;  // whose children are being visited
        // whether the node was opened, and whether queued triangles must not wait
        bool opened = level >= 0, at_once = false;
        if (opened) {
            levels[level].get(bvh, visit, node, child);
        } else {
            level = 0;
        }
        for (;;) {
            if (!opened) {
                visit = open(bvh, camera, packet, node, child, small);
                opened = true;
            }
            if (queue.count >= LANES || (at_once && queue.count > 0)) {
                rasterize_queued(bvh, camera, packet, queue, memory);
                if (memory.uncertain.count < UncertainPixels::ENOUGH) continue;
                levels[level].put(visit, node);
                memory.go_on_at(level, queue.count, small);
                return true;
            }
            at_once = false;
            if (small) {
                queue_leaves(bvh, camera, packet, child, small, queue);
                continue;
            }
            const unsigned next = Warp::reduce_max(visit);
            if (next == 0) {
                if (level > 0) {
                    --level;
                    levels[level].get(bvh, visit, node, child);
                    continue;
                }
                if (queue.count == 0) return false;
                at_once = true;
                continue;
            }
            const int k = Warp::first_lane(Warp::ballot(visit == next));
            if (lane == k) visit = 0;
            if (hidden(packet, next)) continue;
            const int index = Warp::shuffle(child, k);
            if (index < 0) {
                const int area = Setup::area(bvh, camera, packet.first_x, packet.first_y, ~index);
                queue.add(area > 0, ~index * LANES + lane);
                at_once = Warp::any(area > Raster::SMALL_AREA);  // it may occlude what follows
            } else {
                levels[level].put(visit, node);
                ++level;
                node = index;
                opened = false;
            }
        }
    }
};
