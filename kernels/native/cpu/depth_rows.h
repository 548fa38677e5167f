// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rows of depth images to world points and labels, 16 pixels at a time: see kernels/maps/classify.py.

#pragma once

#include "cpu/number_lanes.h"
#include "shared/pose.h"

// Range of valid depth [m]: finite, positive, and from `near` to `far`.
struct DepthRange {
    float below, last;  // the greatest number below the range, and the greatest in it

    static inline DepthRange of(float near, float far) {
        const float greatest = __FLT_MAX__;
        return DepthRange{.below = near > 0.0f ? before(near) : 0.0f, .last = far < greatest ? far : greatest};
    }
    // The greatest number below a positive one.
    static inline float before(float number) {
        int bits;
        __builtin_memcpy(&bits, &number, sizeof bits);
        --bits;
        __builtin_memcpy(&number, &bits, sizeof bits);
        return number;
    }
    inline Ints contains(Floats depth) const { return (depth > below) & (depth <= last); }
};

// The change of a linear function of world points with depth, for the pixels of a row.
struct RowSlopes {
    double first, step;  // of a pinhole camera: at column 0, and per column
    double axis[3];  // of a ray table: along the axes of the camera
    const double* rays;

    // Slopes of the pixels from column x on.
    inline Doubles from(int x, int count) const {
        if (!rays) return (Lanes::index_doubles() + (double)x) * step + first;
        Doubles slopes = (Doubles)(0.0);
        for (int i = 0; i < (count < LANES ? count : LANES); ++i) {
            const double* ray = rays + 3LL * (x + i);
            slopes[i] = axis[0] * ray[0] + axis[1] * ray[1] + axis[2] * ray[2];
        }
        return slopes;
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
        RowDirections row = {};
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k) row.axis[i][k] = pose.axis[i][k];
        row.rays = rays;
        if (rays) return row;
        const double corner[3] = {(0.5 - center[0]) / focal[0], (y + 0.5 - center[1]) / focal[1], 1.0};
        pose.rotate_out(corner, row.first);
        for (int k = 0; k < 3; ++k) row.step[k] = pose.axis[0][k] / focal[0];
        return row;
    }
    // Slopes of world coordinate k.
    inline RowSlopes component(int k) const {
        return RowSlopes{first[k], step[k], {axis[0][k], axis[1][k], axis[2][k]}, rays};
    }
    // Slopes of the dot product with a vector.
    inline RowSlopes along(const double* vector) const {
        RowSlopes slopes = {};
        for (int k = 0; k < 3; ++k) {
            slopes.first += vector[k] * first[k];
            slopes.step += vector[k] * step[k];
            for (int i = 0; i < 3; ++i) slopes.axis[i] += vector[k] * axis[i][k];
        }
        slopes.rays = rays;
        return slopes;
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
    // Dot product of the camera's position with a vector.
    inline double along(const double* vector) const {
        return vector[0] * origin[0] + vector[1] * origin[1] + vector[2] * origin[2];
    }
    // A linear function of the world points from column x on, rounded once; NaN where a pixel has no ray.
    inline Floats values(const RowSlopes& slopes, double start, int x, Floats depth) const {
        const Doubles change = __builtin_convertvector(depth, Doubles) * slopes.from(x, width - x);
        return __builtin_convertvector(change + start, Floats);
    }
    inline Floats coordinate(int k, int x, Floats depth) const {
        return values(directions.component(k), origin[k], x, depth);
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

// Heights of a row's points above a plane in single precision, and the bound of their difference from the exact ones,
// both rounded: 16 roundings of the greatest terms, of which at most 9 occur.
struct RoughHeights {
    float first, step, start, height;
    float error_per_depth, error;

    static inline RoughHeights of(const RowSlopes& slopes, double start, float height, int width) {
        const float rounding = 1.0f / (1 << 20);
        return RoughHeights{
            .first = (float)slopes.first,
            .step = (float)slopes.step,
            .start = (float)start,
            .height = height,
            .error_per_depth = rounding * (float)(__builtin_fabs(slopes.first) + width * __builtin_fabs(slopes.step)),
            .error = rounding * (float)(__builtin_fabs(start) + __builtin_fabs((double)height))};
    }
    inline Floats at(Floats columns, Floats depth) const { return depth * (columns * step + first) + start - height; }
    // Whether it is certain on which side of a limit the heights are.
    inline Ints certain(Floats heights, float limit, Floats depth) const {
        return Lanes::abs(heights - limit) > depth * error_per_depth + error;
    }
};

// Classification of the points of a row, as in `case_of`.
struct RowCases {
    double normal[3], offset;  // of the ground's plane
    float height, tolerance;  // of the ground [m]
    float growth[3];  // coefficients of 1, depth and its square in the tolerance along the ray
    int below_label;
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

    // Tolerances of the heights of points: `tolerance`, and the error of depth times its component across the plane.
    inline Floats limits(Floats heights, float camera_height, Floats depth) const {
        return tolerance + Lanes::abs(heights - camera_height) * (growth[0] / depth + growth[1] + growth[2] * depth);
    }

    // Write labels, and spheres if requested.
    inline void classify(const DepthRow& row, unsigned char* labels_out, int* spheres_out) const {
        const RowSlopes slopes = row.directions.along(normal);
        const double start = row.along(normal) + offset;
        int x = 0;
        if (one_limit() && sphere_count == 0 && !slopes.rays && !spheres_out) {
            const RoughHeights rough = RoughHeights::of(slopes, start, height, row.width);
            for (; x + LANES <= row.width; x += LANES)
                if (!write_certain(row, rough, x, labels_out)) write_uncertain(row, slopes, start, x, labels_out);
        }
        for (; x < row.width; x += LANES) write(row, slopes, start, x, labels_out, spheres_out);
    }
    // Whether one comparison classifies the ground: a constant tolerance, and no label of points below.
    inline bool one_limit() const {
        return growth[0] == 0.0f && growth[1] == 0.0f && growth[2] == 0.0f && below_label == LABEL_GROUND;
    }
    // Write 16 labels if single precision is enough, else return false.
    inline bool write_certain(const DepthRow& row, const RoughHeights& rough, int x, unsigned char* labels_out) const {
        const Floats depth = Lanes::load(row.depth + x), heights = rough.at(PixelLanes::columns(x), depth);
        const Ints known = row.range.contains(depth);
        if (Lanes::any(known & ~rough.certain(heights, tolerance, depth))) return false;
        const Ints labels = heights < tolerance ? Lanes::all_ints(LABEL_GROUND) : Lanes::all_ints(LABEL_OBSTACLE);
        PixelLanes::store(labels_out + x, known ? labels : Lanes::all_ints(LABEL_EMPTY), LANES);
        return true;
    }
    // Inlined, this rare case would take registers of the others.
    __attribute__((noinline)) void write_uncertain(const DepthRow& row, const RowSlopes& slopes, double start, int x,
                                                   unsigned char* labels_out) const {
        write(row, slopes, start, x, labels_out, nullptr);
    }
    // Write the labels of pixels from column x on, and spheres if requested.
    inline void write(const DepthRow& row, const RowSlopes& slopes, double start, int x, unsigned char* labels_out,
                      int* spheres_out) const {
        const Floats depth = row.load(x), heights = row.values(slopes, start, x, depth) - height;
        const Ints known = row.range.contains(depth) & (heights == heights);
        Floats limit = Lanes::all(tolerance);
        Ints low = Lanes::all_ints(LABEL_GROUND);
        if (!one_limit()) {
            limit = limits(heights, (float)start - height, depth);
            low = heights < -limit ? Lanes::all_ints(below_label) : low;
        }
        const Ints above = known & ~(heights < limit);
        Ints labels = Lanes::all_ints(LABEL_OBSTACLE), spheres = Lanes::all_ints(-1);
        if (sphere_count > 0 && Lanes::any(above)) spheres = find_spheres(row.points(x, depth), &labels);
        labels = above ? labels : (known ? low : Lanes::all_ints(LABEL_EMPTY));
        PixelLanes::store(labels_out + x, labels, row.width - x);
        spheres = above ? spheres : Lanes::all_ints(-1);
        if (spheres_out) PixelLanes::store((float*)spheres_out + x, (Floats)spheres, row.width - x);
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
