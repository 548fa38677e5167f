// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The objects with separate frames that a view may see. Each has a BVH in its own frame, into which the camera is
// transformed: neither rigid motion nor stretching changes depth or image coordinates, and neither requires a rebuild.

#pragma once

#include "cpu/walk.h"

// Bounding boxes of objects in camera space, one per lane: their centers, and half of each edge.
struct OrientedBoxes {
    Points center, half[3];

    // A column of LANES rows; beyond `last`, that row is repeated.
    static inline Doubles column(const float* rows, int stride, int last) {
        float value[LANES];
        for (int k = 0; k < LANES; ++k) value[k] = rows[(k < last ? k : last) * stride];
        return __builtin_convertvector(Lanes::load(value), Doubles);
    }
    static inline Floats narrow(Doubles value) { return __builtin_convertvector(value, Floats); }

    // Axes of one object per lane, with quaternions of any norm.
    static inline void axes(const float* row, int last, Doubles (*axis)[3]) {
        const Doubles x = column(row + 3, POSE_WORDS, last), y = column(row + 4, POSE_WORDS, last),
                      z = column(row + 5, POSE_WORDS, last), w = column(row + 6, POSE_WORDS, last);
        const Doubles s = 2.0 / ((x * x + y * y) + (z * z + w * w));
        Pose::axes_of(x, y, z, w, s, axis);
    }

    // Stretch factors of the objects from `first` on, one per lane.
    static inline void factors(const View& view, int first, int last, Doubles* factor) {
        const Movables& movables = view.scene.movables;
        double value[3][LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            const Stretch stretch = movables.stretch_of(first + (lane < last ? lane : last), view.world);
            for (int k = 0; k < 3; ++k) value[k][lane] = stretch.factor[k];
        }
        __builtin_memcpy(factor, value, sizeof value);
    }

    // Centers are computed in double precision: an object may be far from the origin of its frame, which may be far
    // from the world's.
    static inline OrientedBoxes of(int first, int last, const View& view) {
        const float* box = view.scene.movables.boxes + (long long)first * BOX_WORDS;
        const float* row = view.scene.movables.poses_from(first, view.world);
        OrientedBoxes moved;
        Doubles factor[3] = {(Doubles)(1.0), (Doubles)(1.0), (Doubles)(1.0)};
        if (view.world.sizes && first < view.scene.movables.moving) factors(view, first, last, factor);
        const double* focal = view.job.focal;
        Doubles axis[3][3], center[3];
        axes(row, last, axis);
        for (int k = 0; k < 3; ++k) center[k] = column(row + k, POSE_WORDS, last) - view.pose.position[k];
        for (int i = 0; i < 3; ++i) {
            const Doubles low = column(box + i, BOX_WORDS, last) * factor[i],
                          high = column(box + 3 + i, BOX_WORDS, last) * factor[i];
            for (int k = 0; k < 3; ++k) center[k] += axis[i][k] * (0.5 * (low + high));
            const Floats size = narrow(0.5 * (high - low));
            const Points edge = {narrow(axis[i][0]) * size, narrow(axis[i][1]) * size, narrow(axis[i][2]) * size};
            moved.half[i] = view.camera.transform(edge);  // in the world frame, the rounding error of the origin is 0
        }
        const ExactRow* m = view.pose.axis;
        moved.center.x = narrow((m[0][0] * center[0] + m[0][1] * center[1] + m[0][2] * center[2]) * focal[0]);
        moved.center.y = narrow((m[1][0] * center[0] + m[1][1] * center[1] + m[1][2] * center[2]) * focal[1]);
        moved.center.z = narrow(m[2][0] * center[0] + m[2][1] * center[1] + m[2][2] * center[2]);
        return moved;
    }

    // Whether the boxes reach the inner side of a plane through the camera.
    inline Ints reach(float x, float y, float z, float aside = 0.0f) const {
        Floats farthest = x * center.x + (y * center.y + z * center.z);
        for (int i = 0; i < 3; ++i) farthest += Lanes::abs(x * half[i].x + (y * half[i].y + z * half[i].z));
        return farthest >= Lanes::all(-aside);
    }

    // Bounds of the boxes in the image.
    template <RayKind KIND>
    inline ScreenBounds bounds(float far, float blur, const Image& image, Ints shown) const {
        const float center_x = image.center_x, center_y = image.center_y;
        const float p = KIND == ORIGIN_RAYS ? image.tree->origins.max_p : 0.0f,
                    q = KIND == ORIGIN_RAYS ? image.tree->origins.max_q : 0.0f;
        shown &= reach(0.0f, 0.0f, 1.0f) & reach(1.0f, 0.0f, center_x, p) &
                 reach(-1.0f, 0.0f, image.width - center_x, p) & reach(0.0f, 1.0f, center_y, q) &
                 reach(0.0f, -1.0f, image.height - center_y, q);
        const Points zero = {Lanes::all(0.0f), Lanes::all(0.0f), Lanes::all(0.0f)};
        Points term[3][2];
        for (int i = 0; i < 3; ++i) {
            const Points middle = i == 0 ? center : zero;
            term[i][0] = Points::minus(middle, half[i]);
            term[i][1] = Points::plus(middle, half[i]);
        }
        return ScreenBounds::of<KIND>(term, far, blur, image, shown);
    }
};

// Visits of the movable objects that a view may see; their child is the object.
template <RayKind KIND>
struct Queue {
    Visit* visits;
    int* order;  // front to back
    int count;

    // Factor that makes these boxes slightly nearer than those of the trees: their corners are longer sums, with larger
    // rounding errors.
    static constexpr float nearer() { return 1.0001f; }

    // Bounds of the objects from `first` on, one per lane.
    static inline ScreenBounds bounds(const View& view, const Image& image, int first, Ints active) {
        const OrientedBoxes boxes = OrientedBoxes::of(first, view.scene.movables.end_of(first) - 1 - first, view);
        return boxes.bounds<KIND>(view.camera.far, view.camera.blur, image, active);
    }
    // Find the bounds of one object; returns false if it is not in the image.
    static inline bool find(const View& view, const Image& image, int movable, Visit& found) {
        const ScreenBounds all = bounds(view, image, movable, Lanes::index() == Lanes::all_ints(0));
        if (!Lanes::any(all.shown)) return false;
        found = all.lanes(nearer()).visit(0, movable);
        return true;
    }

    inline void fill(const View& view, const Image& image) {
        const Movables& movables = view.scene.movables;
        for (int first = 0; first < movables.count;) {
            const int remaining = movables.end_of(first) - first;
            add(movables, view.world, first, bounds(view, image, first, Lanes::index() < Lanes::all_ints(remaining)));
            first += remaining < LANES ? remaining : (int)LANES;
        }
        sort();
    }

    inline void add(const Movables& movables, const World& world, int first, const ScreenBounds& bounds) {
        if (!Lanes::any(bounds.shown)) return;
        const ScreenBounds::Lane lanes = bounds.lanes(nearer());
        for (const int k : Lanes::each(bounds.shown)) {
            if (!world.excludes(movables.object[first + k])) visits[count++] = lanes.visit(k, first + k);
        }
    }

    // Depth bins of eighths of powers of two. The order affects the time, not the image.
    enum {
        FRACTION_BITS = 23,  // of a float's mantissa
        BIN_BITS = FRACTION_BITS - 3,
        BIN_OF_ONE = 127 << 3,
        BINS = 256,
        NEARER_BINS = 64,  // for depths below 1 m
    };
    static inline int bin_of(float inv_z) {
        int bits;
        __builtin_memcpy(&bits, &inv_z, sizeof bits);
        const int place = BIN_OF_ONE + NEARER_BINS - (bits >> BIN_BITS);
        return place < 0 ? 0 : place < BINS ? place : BINS - 1;
    }
    inline void sort() {
        int start[BINS + 1];
        if (count < 2) {
            order[0] = 0;
            return;
        }
        for (int b = 0; b <= BINS; ++b) start[b] = 0;
        for (int i = 0; i < count; ++i) start[bin_of(visits[i].nearest_inv_z) + 1] += 1;
        for (int b = 0; b < BINS; ++b) start[b + 1] += start[b];
        for (int i = 0; i < count; ++i) order[start[bin_of(visits[i].nearest_inv_z)]++] = i;
    }
};
