// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Blocking of a block of points, one per lane, by the triangles of a BVH and by objects with their own frames; on the
// CPU: cpu/shadow_walk.h.
//
// The lanes test the children of a node, the triangles of a leaf, or objects, one each, by the shaft from the box of
// the points to the light; then each lane tests its ray by those that remain. Triangles are tested by their shadow
// volumes: one point after the other by all triangles, or one triangle after the other by all points, whichever are
// fewer. Points for which single precision does not suffice are tested in double precision.

#pragma once

#include "cuda/quick_volume.h"
#include "cuda/scene.h"
#include "shared/shafts.h"

// A box of points and their light, in the world or in the frame of an object, and the shaft from one to the other.
struct ShadowBox {
    double center[3];  // in single precision without loss
    double half[3];
    LightPlace light;  // relative to the center
    Shaft shaft;
};

// A warp's shared memory.
struct ShadowMemory {
    struct Level {
        int node;
        unsigned children;  // that are still to be visited
        unsigned points[LANES];  // whose rays may enter each child's box
    };
    struct Boxes {
        float low[3][LANES], high[3][LANES];

        inline void put(const float* lows, const float* highs) {
            Warp::sync();
            for (int k = 0; k < 3; ++k) low[k][Warp::lane()] = lows[k], high[k][Warp::lane()] = highs[k];
            Warp::sync();
        }
    };
    Level levels[LEVELS];
    ShadowBox world, local;
    Boxes objects, children;
    double points[4][LANES];  // coordinates and the limit
    QuickPoint quick_points[LANES];
    QuickVolume volumes[LANES];
};

// This lane's point, relative to the center of a box.
struct ShadowPoint {
    double at[3];
    double limit;  // greatest parameter of a ray toward a directional light at which a surface blocks it

    // Bits that sort like floats.
    static inline unsigned sortable(float value) {
        const unsigned bits = __float_as_uint(value);
        return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
    }
    static inline float of_sortable(unsigned bits) {
        return __uint_as_float(bits & 0x80000000u ? bits & 0x7fffffffu : ~bits);
    }
    // Bounds of points in single precision are wrong by less than this share of the greatest coordinate.
    static constexpr float ROUNDING = 2e-7f;

    // Bound the active points by a box, with the shaft to its light. Their coordinates and the light's, which are those
    // of the frame before, become relative to its center.
    inline void bound(unsigned active, ShadowBox& box) {
        const int lane = Warp::lane();
        const bool is_active = active >> lane & 1;
        for (int k = 0; k < 3; ++k) {
            const unsigned place = sortable((float)at[k]);
            const float low = of_sortable(Warp::reduce_min(is_active ? place : ~0u));
            const float high = of_sortable(Warp::reduce_max(is_active ? place : 0u));
            const float middle = 0.5f * low + 0.5f * high, size = fmaxf(fabsf(low), fabsf(high));
            at[k] -= middle;
            if (lane != k) continue;
            box.center[k] = middle;
            box.half[k] = fmaxf(high - middle, middle - low) + ROUNDING * size;
            if (!box.light.directional) box.light.at[k] -= middle;
        }
        Warp::sync();
        const double origin[3] = {0, 0, 0};
        if (lane < 3) box.shaft.set_bounds(lane, box.light, origin, box.half);
        if (lane < (int)Shaft::LINES) box.shaft.set_line(lane, box.light, origin, box.half);
        Warp::sync();
    }
    // The point in the frame of an object, divided by factors along its axes, as the light, which is written.
    inline ShadowPoint seen_from(const Pose& object, const double* factors, const ShadowBox& box,
                                 LightPlace& light) const {
        ShadowPoint moved;
        double from[3], to_light[3];
        for (int k = 0; k < 3; ++k) {
            from[k] = box.center[k] - object.position[k];
            to_light[k] = box.light.directional ? box.light.at[k] : box.light.at[k] + from[k];
        }
        Warp::sync();
        for (int i = 0; i < 3; ++i) {
            const double scale = factors[i] == 1.0 ? 1.0 : 1.0 / factors[i];
            const double x = object.axis[i][0] * scale, y = object.axis[i][1] * scale, z = object.axis[i][2] * scale;
            moved.at[i] = (at[0] + from[0]) * x + (at[1] + from[1]) * y + (at[2] + from[2]) * z;
            if (Warp::lane() == i) light.at[i] = to_light[0] * x + to_light[1] * y + to_light[2] * z;
        }
        if (Warp::lane() == 0) light.directional = box.light.directional;
        moved.limit = limit;
        Warp::sync();
        return moved;
    }
};

// The ray of a lane's point to the light, in single precision relative to the center.
struct ShadowRay {
    float origin[3], inverse[3], limit, margin;

    // Factor that covers the rounding of a ray's parameter.
    static constexpr float LONGER = 1.00001f;
    static constexpr float LEAST = 1e-18f;  // replaces smaller components of a direction

    static inline ShadowRay of(const ShadowPoint& point, const ShadowBox& box) {
        ShadowRay ray;
        ray.limit = LONGER * (box.light.directional ? (float)point.limit : 1.0f);
        float reach = 0.0f;
        for (int k = 0; k < 3; ++k) {
            ray.origin[k] = (float)point.at[k];
            const float along = (float)(box.light.directional ? box.light.at[k] : box.light.at[k] - point.at[k]);
            ray.inverse[k] = 1.0f / (fabsf(along) < LEAST ? LEAST : along);
            reach += (float)box.half[k];
        }
        ray.margin = Shaft::SLACK * reach;
        return ray;
    }
    // Whether the ray may enter box k of boxes relative to the center.
    inline bool enters(const ShadowMemory::Boxes& boxes, int k) const {
        float begin = 0.0f, end = limit;
        for (int i = 0; i < 3; ++i) {
            const float low = boxes.low[i][k], high = boxes.high[i][k];
            const float near = (low - Shaft::SLACK * fabsf(low) - margin - origin[i]) * inverse[i];
            const float far = (high + Shaft::SLACK * fabsf(high) + margin - origin[i]) * inverse[i];
            begin = fmaxf(begin, fminf(near, far));
            end = fminf(end, fmaxf(near, far));
        }
        return begin <= end * LONGER;
    }
    // The active points whose rays may enter box k.
    inline unsigned entering(const ShadowMemory::Boxes& boxes, int k, unsigned active) const {
        return Warp::ballot(enters(boxes, k)) & active;
    }
};

// Blocks points by the surfaces of a scene. Sets of points are bits of lanes.
struct ShadowWalk {
    enum {
        POINTS_PER_TRIANGLE = 2,  // points that are tested by all triangles in the time of a triangle by all points
        STATIC = -1,  // stands for static geometry among the objects
    };

    const Scene& scene;
    ShadowMemory& memory;

    // The points that no surface blocks, of some in the world; `memory.world` has their light.
    inline unsigned lit(ShadowPoint point, unsigned active) const {
        point.bound(active, memory.world);
        const ShadowRay ray = ShadowRay::of(point, memory.world);
        int first = -(int)LANES;
        unsigned found = scene.bvh.root >= 0;
        for (;;) {
            while (found == 0) {
                first += LANES;
                if (first >= scene.movables.count) return active;
                found = meet(first);
            }
            const int k = Warp::first_lane(found);
            found = Warp::without_first_lane(found);
            const unsigned some = first < 0 ? active : ray.entering(memory.objects, k, active);
            if (some == 0) continue;
            active &= ~some | lit_beside(point, some, first < 0 ? (int)STATIC : first + k);
            if (active == 0) return 0;
        }
    }

    // The lanes whose objects, from `first` on, have boxes that the shaft meets.
    inline unsigned meet(int first) const {
        const Movables& movables = scene.movables;
        const int m = min(first + Warp::lane(), movables.count - 1);
        float low[3], high[3];
        bound(movables, m, memory.world.center, low, high);
        memory.objects.put(low, high);
        return Warp::ballot(memory.world.shaft.meets(low, high) && first + Warp::lane() < movables.count &&
                            !movables.excludes(m));
    }
    // The box of an object in the world, relative to a center.
    static inline void bound(const Movables& movables, int m, const double* center, float* low, float* high) {
        Vec3 axis[3];
        const float* pose = movables.pose(m);
        float q[4], square = 0.0f;
        for (int k = 0; k < 4; ++k) q[k] = __ldg(pose + 3 + k), square += q[k] * q[k];
        Pose::axes_of(q[0], q[1], q[2], q[3], 2.0f / square, (float (*)[3])axis);
        const bool is_solid = __ldg(movables.solid + m) != SOLID_NONE;
        float middle[3] = {0, 0, 0}, half[3] = {0, 0, 0};
        double factors[3];
        factors_of(movables, m, factors);
        const float* box = movables.box(m);
        for (int i = 0; i < 3; ++i) {
            float from = __ldg(box + i), to = __ldg(box + 3 + i);
            if (is_solid) to = extent(movables, m, i), from = -to;
            const float* along = &axis[i].x;
            for (int k = 0; k < 3; ++k) {
                middle[k] += along[k] * (float)factors[i] * 0.5f * (from + to);
                half[k] += fabsf(along[k] * (float)factors[i]) * 0.5f * (to - from);
            }
        }
        for (int k = 0; k < 3; ++k) {
            const float place = __ldg(pose + k);
            const float margin = BOX_ROUNDING * (fabsf(place) + fabsf((float)center[k]) + fabsf(middle[k]) + half[k]);
            const float at = (float)(place - center[k]) + middle[k];
            low[k] = at - half[k] - margin, high[k] = at + half[k] + margin;
        }
    }
    // Share of the terms of a box that covers their rounding; those of `middle` may cancel each other.
    static constexpr float BOX_ROUNDING = 4e-6f;

    // Half the extent of a solid along an axis, in units of its size.
    static inline float extent(const Movables& movables, int m, int axis) {
        const int kind = __ldg(movables.solid + m);
        if (axis < 2 || kind == SOLID_BALL) return 1.0f;
        return __ldg(movables.solid_size(m) + 3) + (kind == SOLID_CAPSULE ? 1.0f : 0.0f);
    }
    // The factors of a mesh along its axes, or the sizes of a solid.
    static inline void factors_of(const Movables& movables, int m, double* factors) {
        const Stretch stretch = movables.stretch(m);
        const bool is_solid = __ldg(movables.solid + m) != SOLID_NONE;
        for (int k = 0; k < 3; ++k)
            factors[k] = is_solid ? (double)__ldg(movables.solid_size(m) + k) : stretch.factor[k];
    }

    // Those of some points that an object does not block.
    inline unsigned lit_beside(const ShadowPoint& point, unsigned some, int m) const {
        const Movables& movables = scene.movables;
        Pose pose = {{0, 0, 0}, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
        double factors[3] = {1, 1, 1};
        int kind = SOLID_NONE, root = scene.bvh.root;
        const unsigned char* excluded = scene.bvh.excluded;
        if (m != STATIC) {
            pose = Pose::from(movables.pose(m));
            factors_of(movables, m, factors);
            kind = __ldg(movables.solid + m), root = __ldg(movables.root + m);
            if (__ldg(movables.object + m) >= 0) excluded = nullptr;
        }
        ShadowPoint local = point.seen_from(pose, factors, memory.world, memory.local.light);
        if (kind != SOLID_NONE) return some & ~solid(local, kind, __ldg(movables.solid_size(m) + 3));
        local.bound(some, memory.local);
        return tree(local, some, root, excluded);
    }
    // The points whose rays cross the surface of a solid.
    inline unsigned solid(const ShadowPoint& point, int kind, double half) const {
        const LightPlace& light = memory.local.light;
        double toward[3];
        for (int k = 0; k < 3; ++k) toward[k] = light.directional ? light.at[k] : light.at[k] - point.at[k];
        const double limit = light.directional ? point.limit : 1.0;
        return Warp::ballot(SolidShadow<double>::crosses(kind, half, point.at, toward, limit));
    }

    // The points that no triangle of a tree blocks. `excluded` is null if no triangle is excluded.
    inline unsigned tree(const ShadowPoint& point, unsigned active, int root, const unsigned char* excluded) const {
        for (int k = 0; k < 3; ++k) memory.points[k][Warp::lane()] = point.at[k];
        memory.points[3][Warp::lane()] = point.limit;
        memory.quick_points[Warp::lane()] = {(float)point.at[0], (float)point.at[1], (float)point.at[2],
                                             (float)point.limit};
        const ShadowRay ray = ShadowRay::of(point, memory.local);
        int depth = -1, node = root;
        unsigned children = 0, some = active;
        for (int child = root;;) {
            if (child < 0) {
                active &= ~leaf(some, ~child, excluded);
                if (active == 0) return 0;
            } else {
                if (depth >= 0) put_level(depth, node, children);
                node = child;
                children = open(ray, some, node, ++depth);
            }
            do {
                while (children == 0) {
                    if (--depth < 0) return active;
                    children = memory.levels[depth].children, node = memory.levels[depth].node;
                }
                const int k = Warp::first_lane(children);
                some = active & memory.levels[depth].points[k];
                child = __ldg(scene.bvh.children + (long long)node * LANES + k);
                children = Warp::without_first_lane(children);
            } while (some == 0);
        }
    }
    inline void put_level(int depth, int node, unsigned children) const {
        Warp::sync();
        if (Warp::lane() == 0) memory.levels[depth].node = node, memory.levels[depth].children = children;
        Warp::sync();
    }
    // The children of a node whose boxes rays of active points may enter; the points of each are written to a level.
    inline unsigned open(const ShadowRay& ray, unsigned active, int node, int depth) const {
        const float* rows = scene.bvh.nodes + (long long)node * NODE_WORDS + Warp::lane();
        float low[3], high[3];
        for (int k = 0; k < 3; ++k) {
            low[k] = __ldg(rows + (NODE_LOW_ROW + k) * LANES) - (float)memory.local.center[k];
            high[k] = __ldg(rows + (NODE_HIGH_ROW + k) * LANES) - (float)memory.local.center[k];
        }
        memory.children.put(low, high);
        unsigned points = 0;
        unsigned met = Warp::ballot(memory.local.shaft.meets(low, high));
        for (; met; met = Warp::without_first_lane(met)) {
            const int k = Warp::first_lane(met);
            const unsigned entering = ray.entering(memory.children, k, active);
            if (Warp::lane() == k) points = entering;
        }
        memory.levels[depth].points[Warp::lane()] = points;
        Warp::sync();
        return Warp::ballot(points != 0);
    }

    // The points, of some, that triangles of a leaf block.
    inline unsigned leaf(unsigned active, int index, const unsigned char* excluded) const {
        const long long slot = (long long)index * LANES + Warp::lane();
        const float* rows = scene.bvh.leaves + (long long)index * LEAF_WORDS + Warp::lane();
        const ShadowBox& box = memory.local;
        float corner[3][3], low[3], high[3];
        for (int k = 0; k < 3; ++k) {
            for (int c = 0; c < 3; ++c) corner[c][k] = __ldg(rows + (3 * c + k) * LANES);
            low[k] = Three::min(corner[0][k], corner[1][k], corner[2][k]) - (float)box.center[k];
            high[k] = Three::max(corner[0][k], corner[1][k], corner[2][k]) - (float)box.center[k];
        }
        bool found = box.shaft.meets(low, high);
        if (found && excluded) found = !excluded[Bvh::object_of(__ldg(scene.bvh.owners + slot))];
        QuickVolume volume = {};
        if (found) {
            const float half[3] = {(float)box.half[0], (float)box.half[1], (float)box.half[2]};
            found = volume.set(corner, box.center, box.light, half[0] + half[1] + half[2]) && volume.meets(half);
        }
        const unsigned triangles = Warp::ballot(found);
        if (triangles == 0) return 0;
        unsigned blocked, unsure;
        if (__popc(active) <= POINTS_PER_TRIANGLE * __popc(triangles))
            blocked = by_points(volume, found, active, unsure);
        else
            blocked = by_triangles(volume, triangles, active, unsure);
        unsure &= active & ~blocked;
        return unsure == 0 ? blocked : blocked | by_exact(memory, rows, found, unsure);
    }
    // Those points that are inside of a triangle's volume, and others that may be: one point after the other.
    inline unsigned by_points(const QuickVolume& volume, bool found, unsigned active, unsigned& unsure) const {
        unsigned blocked = 0;
        for (unsure = 0; active; active = Warp::without_first_lane(active)) {
            const int k = Warp::first_lane(active);
            const float least = found ? volume.least(memory.quick_points[k]) : -NOWHERE;
            if (Warp::any(least > 1.0f))
                blocked |= 1u << k;
            else if (Warp::any(least >= -1.0f))
                unsure |= 1u << k;
        }
        return blocked;
    }
    // The same, one triangle after the other.
    inline unsigned by_triangles(const QuickVolume& volume, unsigned triangles, unsigned active,
                                 unsigned& unsure) const {
        const QuickPoint point = memory.quick_points[Warp::lane()];
        Warp::sync();
        memory.volumes[Warp::lane()] = volume;
        Warp::sync();
        unsigned blocked = unsure = 0;
        for (; triangles && (active & ~blocked); triangles = Warp::without_first_lane(triangles)) {
            const QuickVolume& of_all = memory.volumes[Warp::first_lane(triangles)];
            const float least = of_all.least(point);
            blocked |= Warp::ballot(least > 1.0f) & active;
            unsure |= Warp::ballot(least >= -1.0f);
        }
        return blocked;
    }
    // Those points that are inside of a triangle's volume, in double precision.
    static __noinline__ unsigned by_exact(const ShadowMemory& memory, const float* rows, bool found, unsigned points) {
        typedef ShadowVolume<double> Volume;
        const ShadowBox& box = memory.local;
        double corner[3][3];
        for (int c = 0; c < 3; ++c)
            for (int k = 0; k < 3; ++k) corner[c][k] = __ldg(rows + (3 * c + k) * LANES) - box.center[k];
        const Volume volume = Volume::of(corner, box.light, box.half[0] + box.half[1] + box.half[2]);
        unsigned blocked = 0;
        for (; points; points = Warp::without_first_lane(points)) {
            const int k = Warp::first_lane(points);
            const double (*at)[LANES] = memory.points;
            if (Warp::any(found && volume.contains(at[0][k], at[1][k], at[2][k], at[3][k]))) blocked |= 1u << k;
        }
        return blocked;
    }
};
