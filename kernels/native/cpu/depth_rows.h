// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rows of depth images to world points and labels, 16 pixels at a time: see kernels/maps/classify.py.

#pragma once

#include "cpu/number_lanes.h"
#include "shared/pose.h"

// Range of valid depth [m].
struct DepthRange {
    float near, far;

    inline Ints contains(Floats depth) const {
        return (Lanes::abs(depth) < __builtin_inff()) & (depth > 0.0f) & (depth >= near) & (depth <= far);
    }
};

// World directions of the pixels of a row, scaled to depth 1.
struct RowDirections {
    double axis[3][3];  // of the camera, in the world
    double first[3];  // of a pinhole camera: the direction at column 0, and its change per column
    double step[3];
    // of a ray table: x y z of each pixel in the camera frame, NaN if it has no ray; null for a pinhole camera
    const double* rays;

    // Directions of the rays of a table, or of the pixels of a pinhole camera if `rays` is null.
    static inline RowDirections of(const Pose& pose, const double* focal, const double* center, int y,
                                   const double* rays) {
        RowDirections row;
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k) row.axis[i][k] = pose.axis[i][k];
        row.rays = rays;
        if (rays) return row;
        const double corner[3] = {(0.5 - center[0]) / focal[0], (y + 0.5 - center[1]) / focal[1], 1.0};
        pose.rotate_out(corner, row.first);
        for (int k = 0; k < 3; ++k) row.step[k] = pose.axis[0][k] / focal[0];
        return row;
    }
    // Component k of the pixels' directions from column x on.
    inline Doubles component(int k, int x, int count) const {
        if (!rays) return __builtin_convertvector(Lanes::index() + x, Doubles) * step[k] + first[k];
        Doubles directions = (Doubles)(0.0);
        for (int i = 0; i < (count < LANES ? count : LANES); ++i) {
            const double* ray = rays + 3LL * (x + i);
            directions[i] = axis[0][k] * ray[0] + axis[1][k] * ray[1] + axis[2][k] * ray[2];
        }
        return directions;
    }
};

// A row of a depth image and its camera in the world.
struct DepthRow {
    int width;
    const float* depth;
    DepthRange range;
    const double* origin;
    RowDirections directions;

    inline Floats load(int x) const { return PixelLanes::load(depth + x, width - x); }
    // Coordinate k of the world points from column x on, rounded once; NaN where a pixel has no ray.
    inline Floats coordinate(int k, int x, Floats depth) const {
        const Doubles far = __builtin_convertvector(depth, Doubles) * directions.component(k, x, width - x);
        return __builtin_convertvector(far + origin[k], Floats);
    }
    inline Points points(int x, Floats depth) const {
        return Points{coordinate(0, x, depth), coordinate(1, x, depth), coordinate(2, x, depth)};
    }

    // Write world points, NaN if a pixel has no valid depth.
    inline void back_project(float* points_out) const {
        for (int x = 0; x < width; x += LANES) {
            const Floats seen = load(x);
            Floats rows[3];
            Points::interleave(points(x, range.contains(seen) ? seen : Lanes::all(__builtin_nanf(""))), rows);
            const int count = 3 * (width - x);
            for (int k = 0; k < 3 && k * LANES < count; ++k)
                PixelLanes::store(points_out + 3LL * x + k * LANES, rows[k], count - k * LANES);
        }
    }
};

// Classification of the points of a row, as in `case_of`.
struct RowCases {
    int up;
    float height, tolerance;  // of the ground [m]
    int sphere_count;
    const float* centers;  // of spheres
    const float* sizes;
    const unsigned char* sphere_labels;

    // Find the spheres that contain the points most deeply, -1 if none does, and replace the labels of those points.
    inline Ints find_spheres(const Points& points, Ints* labels) const {
        Ints spheres = Lanes::all_ints(-1);
        Floats min_ratio = Lanes::all(1.0f);
        for (int i = 0; i < sphere_count; ++i) {
            const float* center = centers + 3LL * i;
            const Points offset = Points{points.x - center[0], points.y - center[1], points.z - center[2]};
            const Floats distance = PixelLanes::root(offset.x * offset.x + offset.y * offset.y + offset.z * offset.z);
            const Floats ratio = distance / (0.5f * sizes[i]);
            const Ints deeper = ratio < min_ratio;
            min_ratio = deeper ? ratio : min_ratio;
            spheres = deeper ? Lanes::all_ints(i) : spheres;
            *labels = deeper ? Lanes::all_ints(sphere_labels[i]) : *labels;
        }
        return spheres;
    }

    // Write labels, and spheres if requested.
    inline void classify(const DepthRow& row, unsigned char* labels_out, int* spheres_out) const {
        for (int x = 0; x < row.width; x += LANES) {
            const Floats depth = row.load(x), heights = row.coordinate(up, x, depth);
            const Ints known = row.range.contains(depth) & (heights == heights);
            const Ints above = known & ~(heights - height < tolerance);
            Ints labels = Lanes::all_ints(LABEL_OBSTACLE), spheres = Lanes::all_ints(-1);
            if (sphere_count > 0 && Lanes::any(above)) spheres = find_spheres(row.points(x, depth), &labels);
            labels = above ? labels : (known ? Lanes::all_ints(LABEL_GROUND) : Lanes::all_ints(LABEL_EMPTY));
            PixelLanes::store(labels_out + x, labels, row.width - x);
            spheres = above ? spheres : Lanes::all_ints(-1);
            if (spheres_out) PixelLanes::store((float*)spheres_out + x, (Floats)spheres, row.width - x);
        }
    }
};

// Labels of pixels of rendered images.
struct ObjectRow {
    int width, object_count;
    const unsigned char* object_labels;
    DepthRange range;

    inline void label(const float* depth, const int* objects, unsigned char* labels_out) const {
        for (int x = 0; x < width; x += LANES) {
            const Ints known = range.contains(PixelLanes::load(depth + x, width - x));
            for (int i = 0; i < (width - x < LANES ? width - x : LANES); ++i) {
                const int object = known[i] ? objects[x + i] : -1;
                const bool exists = object >= 0 && object < object_count;
                labels_out[x + i] = exists ? object_labels[object] : LABEL_EMPTY;
            }
        }
    }
};
