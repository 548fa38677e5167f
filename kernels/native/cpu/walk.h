// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Traversal of the BVH front to back, with frustum culling and occlusion culling by the hierarchical z-buffer.

#pragma once

#include "cpu/ray_raster.h"
#include "cpu/sparse.h"

// Greater than every inv_z: sorts lanes that are not shown to the end, where the nearest one is.
constexpr float BEHIND_ALL = 3.2e38f;

// Bounds of boxes in the image.
struct ScreenBounds {
    Floats nearest_inv_z, left, top, right, bottom;
    Ints shown;

    // The boxes' corners in camera space are given as sums of one term per axis.
    template <RayKind KIND>
    static inline ScreenBounds of(const Points (*term)[2], float far, float blur, const Image& image, Ints shown) {
        Floats zmin = Lanes::all(0.0f), size = Lanes::all(0.0f);
        for (int axis = 0; axis < 3; ++axis) {
            zmin += Lanes::min(term[axis][0].z, term[axis][1].z);
            size += Lanes::max(__builtin_elementwise_abs(term[axis][0].z), __builtin_elementwise_abs(term[axis][1].z));
        }
        shown &= zmin <= Lanes::all(far);
        const Ints crossing = zmin <= BOX_CROSSING_SHARE * size;

        // The margin covers rounding and little more: if triangles are small, most boxes lie between pixel centers.
        // Boxes that reach behind the camera may cover any part of the image.
        ScreenBounds bounds;
        float slack = SMALL_BOX_SLACK + SMALL_BOX_SLACK_BLURS * blur;
        if (Lanes::any(shown & ~bounds.set_reach(term, zmin, crossing))) {
            bounds.set_corners(term, crossing);
            slack = BOX_SLACK + BOX_SLACK_BLURS * blur;
        }
        Floats left = bounds.left, right = bounds.right, top = bounds.top, bottom = bounds.bottom;
        if constexpr (KIND == ORIGIN_RAYS) {
            const Floats nearest = 1.0f / (crossing ? Lanes::all(1.0f) : zmin);
            const Floats aside = image.tree->origins.max_p * nearest, along = image.tree->origins.max_q * nearest;
            left -= aside, right += aside, top -= along, bottom += along;
        }
        const float to_x = image.center_x - 0.5f, to_y = image.center_y - 0.5f;
        const Floats none = Lanes::all(0.0f), wide = Lanes::all((float)(image.width - 1)),
                     tall = Lanes::all((float)(image.height - 1));
        left = Lanes::max(crossing ? none : image.first_pixel(left + (to_x - slack)), none);
        top = Lanes::max(crossing ? none : image.first_pixel(top + (to_y - slack)), none);
        right = Lanes::min(crossing ? wide : image.last_pixel(right + (to_x + slack)), wide);
        bottom = Lanes::min(crossing ? tall : image.last_pixel(bottom + (to_y + slack)), tall);
        shown &= (left <= right) & (top <= bottom);
        const Floats nearest_inv_z = crossing ? Lanes::all(NOWHERE) : 1.00001f / zmin;
        return ScreenBounds{nearest_inv_z, left, top, right, bottom, shown};
    }

    // Fast bounds: with u of a box's center, x - u z is linear and 0 at the center, so its extent divided by the least
    // z bounds the box's extent in the image. Returns the boxes for which these bounds are not much too wide.
    inline Ints set_reach(const Points (*term)[2], Floats zmin, Ints crossing) {
        // Twice the center, and twice the half edges.
        Points middle = Points::plus(term[0][0], term[0][1]);
        for (int axis = 1; axis < 3; ++axis) middle = Points::plus(middle, Points::plus(term[axis][0], term[axis][1]));
        const Floats inverse = 1.0f / middle.z, u = middle.x * inverse, v = middle.y * inverse;
        Floats aside = Lanes::all(0.0f), along = aside, depth = aside;
        for (int axis = 0; axis < 3; ++axis) {
            const Points edge = Points::minus(term[axis][1], term[axis][0]);
            aside += Lanes::abs(edge.x - u * edge.z);
            along += Lanes::abs(edge.y - v * edge.z);
            depth += Lanes::abs(edge.z);
        }
        const Floats half = 0.5f / (crossing ? Lanes::all(1.0f) : zmin);
        left = u - aside * half, right = u + aside * half;
        top = v - along * half, bottom = v + along * half;
        return crossing | (depth <= DEEP_SHARE * middle.z);
    }

    inline void set_corners(const Points (*term)[2], Ints crossing) {
        left = top = Lanes::all(NOWHERE);
        right = bottom = -left;
        for (int corner = 0; corner < 8; ++corner) {
            const Points p =
                Points::plus(Points::plus(term[0][corner & 1], term[1][(corner >> 1) & 1]), term[2][corner >> 2]);
            const Floats inverse = 1.0f / (crossing ? Lanes::all(1.0f) : p.z);
            const Floats x = p.x * inverse, y = p.y * inverse;
            left = Lanes::min(left, x);
            right = Lanes::max(right, x);
            top = Lanes::min(top, y);
            bottom = Lanes::max(bottom, y);
        }
    }

    // The bounds of each lane, nearer by a factor if their corners are longer sums.
    struct Lane {
        float near[LANES];
        int x0[LANES], y0[LANES], x1[LANES], y1[LANES];

        inline Visit visit(int k, int child) const { return Visit{child, near[k], x0[k], y0[k], x1[k], y1[k]}; }
    };
    inline Lane lanes(float nearer) const {
        const Floats none = Lanes::all(0.0f);
        Lane lane;
        Lanes::store(lane.near, nearest_inv_z * nearer);
        Lanes::store(lane.x0, __builtin_convertvector(shown ? left : none, Ints));
        Lanes::store(lane.y0, __builtin_convertvector(shown ? top : none, Ints));
        Lanes::store(lane.x1, __builtin_convertvector(shown ? right : none, Ints));
        Lanes::store(lane.y1, __builtin_convertvector(shown ? bottom : none, Ints));
        return lane;
    }
};

template <RayKind KIND>
struct Walk {
    static inline Floats farthest_along(const float* plane, Points low, Points high) {
        return Lanes::max(plane[0] * low.x, plane[0] * high.x) +
               (Lanes::max(plane[1] * low.y, plane[1] * high.y) + Lanes::max(plane[2] * low.z, plane[2] * high.z));
    }

    static inline Floats row(const float* node, int index) { return Lanes::load(node + index * LANES); }

    // Whether all triangles of the child face away: the directions from the camera, or from ray origins up to `aside`
    // away, to all points of its box form acute angles with every normal in the cone.
    static inline Ints faces_away(const float* node, Points low, Points high, float aside) {
        const Points to_center = Points{0.5f * (low.x + high.x), 0.5f * (low.y + high.y), 0.5f * (low.z + high.z)};
        const Points half = Points{0.5f * (high.x - low.x), 0.5f * (high.y - low.y), 0.5f * (high.z - low.z)};
        const Points axis =
            Points{row(node, CONE_AXIS_ROW), row(node, CONE_AXIS_ROW + 1), row(node, CONE_AXIS_ROW + 2)};
        const Floats distance = __builtin_elementwise_sqrt(Points::dot(to_center, to_center));
        Floats radius = __builtin_elementwise_sqrt(Points::dot(half, half));
        if constexpr (KIND == ORIGIN_RAYS) radius += 2.0f * aside;
        return Points::dot(to_center, axis) >= row(node, CONE_CUTOFF_ROW) * distance + 1.0001f * radius;
    }

    // Find the children of a node that may be visible, as visits, the nearest last; returns their number.
    static inline int open(const Bvh& bvh, const Camera& camera, const Frustum& frustum, const Image& image, int index,
                           Visit* out) {
        const float* node = bvh.node(index);
        const Floats low_x = row(node, NODE_LOW_ROW), high_x = row(node, NODE_HIGH_ROW);
        const Points low = camera.relative(low_x, row(node, NODE_LOW_ROW + 1), row(node, NODE_LOW_ROW + 2));
        const Points high = camera.relative(high_x, row(node, NODE_HIGH_ROW + 1), row(node, NODE_HIGH_ROW + 2));
        Ints shown = low_x <= high_x;
        for (int p = 0; p < Frustum::PLANES; ++p)
            shown &= farthest_along(frustum.plane[p], low, high) >= Lanes::all(frustum.min_product[p]);
        if (camera.skip_back_faces)
            shown &= ~faces_away(node, low, high, KIND == ORIGIN_RAYS ? image.tree->origins.reach : 0.0f);
        if (!Lanes::any(shown)) return 0;

        // The eight corners in camera space, as sums of one term per axis.
        Points term[3][2];
        for (int k = 0; k < 2; ++k) {
            const Points corner = k ? high : low;
            const Row* m = camera.to_camera;
            term[0][k] = Points{m[0][0] * corner.x, m[1][0] * corner.x, m[2][0] * corner.x};
            term[1][k] = Points{m[0][1] * corner.y, m[1][1] * corner.y, m[2][1] * corner.y};
            term[2][k] =
                Points{m[0][2] * corner.z - camera.origin_error[0], m[1][2] * corner.z - camera.origin_error[1],
                       m[2][2] * corner.z - camera.origin_error[2]};
        }
        const ScreenBounds bounds = ScreenBounds::of<KIND>(term, camera.far, camera.blur, image, shown);
        const unsigned found = Lanes::bits(bounds.shown);
        int place[LANES];
        Lanes::store(place, places(bounds.shown ? bounds.nearest_inv_z : Lanes::all(BEHIND_ALL)));
        const ScreenBounds::Lane lanes = bounds.lanes(1.0f);
        const int* children = bvh.children_of(index);
        for (const int k : Lanes::each(found)) {
            out[place[k]] = lanes.visit(k, children[k]);
        }
        return __builtin_popcount(found);
    }

    // Rank of each lane's value in ascending order; of equal values, the lower lane comes first. Counting needs no
    // branches, which a sort would mispredict.
    static inline Ints places(Floats values) {
        const Ints lane = Lanes::index();
        Ints place = Lanes::all_ints(0);
        for (int other = 0; other < LANES; ++other) {
            const Floats value = Lanes::all(values[other]);
            place -= (value < values) | ((value == values) & (lane > other));
        }
        return place;
    }

    // If the tree is a single leaf, push that leaf: the node's box would be no smaller.
    static inline int begin(const Bvh& bvh, const Image& image, int root, Visit* stack) {
        const int* children = bvh.children_of(root);
        if (children[0] >= 0 || children[1] != 0) return 0;
        // Infinitely near: nothing occludes it. Ray tables read the visit's rectangle, which must cover the whole
        // image.
        const bool whole = KIND != PIXEL_RAYS;
        const int right = whole ? image.width - 1 : 0, bottom = whole ? image.height - 1 : 0;
        stack[0] = Visit{children[0], NOWHERE, 0, 0, right, bottom};
        return 1;
    }

    // Prefetch the next visit during this one: the cache lines of a leaf, and as many of a node.
    static inline void fetch(const Bvh& bvh, int child) {
        const char* rows = (const char*)(child >= 0 ? bvh.node(child) : bvh.leaf(~child));
        for (int line = 0; line < LEAF_ROWS; ++line) __builtin_prefetch(rows + line * Arena::ALIGNMENT);
    }

    // Rasterize all that is visible. Two instantiations: the one without ids is faster.
    static inline void traverse(const Bvh& bvh, const Instance& instance, const Camera& camera, const Image& image,
                                Visit* stack, Mode mode) {
        if (mode == MODE_DEPTH)
            traverse_depth(bvh, instance, camera, image, stack);
        else
            traverse_ids(bvh, instance, camera, image, stack, mode);
    }
    static __attribute__((noinline)) void traverse_depth(const Bvh& bvh, const Instance& instance, const Camera& camera,
                                                         const Image& image, Visit* stack) {
        traverse_all(bvh, instance, camera, image, stack, MODE_DEPTH);
    }
    static __attribute__((noinline)) void traverse_ids(const Bvh& bvh, const Instance& instance, const Camera& camera,
                                                       const Image& image, Visit* stack, Mode mode) {
        __builtin_assume(mode != MODE_DEPTH);
        traverse_all(bvh, instance, camera, image, stack, mode);
    }
    static inline __attribute__((always_inline)) void traverse_all(const Bvh& bvh, const Instance& instance,
                                                                   const Camera& camera, const Image& image,
                                                                   Visit* stack, Mode mode) {
        const Frustum frustum = Frustum::of<KIND>(camera, image);
        int depth = begin(bvh, image, instance.root, stack);
        if (depth == 0) depth = open(bvh, camera, frustum, image, instance.root, stack);
        while (depth > 0) {
            const Visit visit = stack[--depth];
            if (depth > 0) fetch(bvh, stack[depth - 1].child);
            if (is_hidden<KIND>(image, visit)) continue;
            if (visit.child >= 0) {
                depth += open(bvh, camera, frustum, image, visit.child, stack + depth);
                continue;
            }
            if constexpr (KIND == ORIGIN_RAYS)
                if (image.tree->origins.is_exhausted()) return;
            const long long leaf = ~visit.child;
            Triangles triangles;
            triangles.corners = bvh.leaf(leaf);
            triangles.owners = instance.owners + leaf * instance.owner_step;
            triangles.first_id = (int)leaf * LANES + instance.first_id;
            if (!Setup::leaf<KIND>(camera, image, triangles)) continue;
            if constexpr (KIND != PIXEL_RAYS)
                RayRaster<KIND>::rasterize(camera, image, triangles, visit, mode);
            else if (image.first_packet)
                Sparse::rasterize(camera, image, triangles,
                                  triangles.inexact | Raster::has_unstable_plane(camera, triangles), mode);
            else
                Raster::rasterize(camera, image, triangles, mode);
        }
    }
};
