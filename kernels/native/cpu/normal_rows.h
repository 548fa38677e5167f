// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Normal equations of poses on CPU cores, 16 pixels at a time in double precision: see
// kernels/gradients/normal_equations.py.

#pragma once

#include "cpu/depth_rows.h"

// Sums do not depend on how products are rounded, and a fused product and sum is one instruction.
#pragma clang fp contract(fast)

constexpr int TWIST = 6, PRODUCTS = TWIST * (TWIST + 1) / 2;

// Standard deviations of depth [m], tabulated by the bits of depth: see `sigma_at` of kernels/maps/compare_depth.py.
struct SigmaTable {
    const float* values;
    int last, first_bits, shift;  // of place in bits to index
    bool is_constant;
    double constant;  // 1 divided by the first

    static inline SigmaTable of(const float* values, int count, int first_bits, int step_bits) {
        const bool is_constant = count == 2 && values[0] == values[1];
        return SigmaTable{values, count - 1, first_bits, __builtin_ctz(step_bits), is_constant, 1.0 / values[0]};
    }
    // 1 divided by the standard deviations.
    inline Doubles inverse_at(Floats depth) const {
        return is_constant ? (Doubles)(constant) : 1.0 / PixelLanes::wide(at(depth));
    }
    inline Floats at(Floats depth) const {
        const Ints end = Lanes::all_ints(last << shift), zero = Lanes::all_ints(0);
        Ints place = (Ints)depth - first_bits;
        place = place < 0 ? zero : (place > end ? end : place);
        Ints before = place >> shift;
        before = before > last - 1 ? Lanes::all_ints(last - 1) : before;
        Floats pair[2];
        PixelLanes::gather_pairs(values, before, pair);
        const Floats part = __builtin_convertvector(place - (before << shift), Floats) / (float)(1 << shift);
        return pair[0] + (pair[1] - pair[0]) * part;
    }
};

// Sums of 16 pixels at a time: the lower triangle of H, row by row, b, the cost and the numbers of pixels.
struct NormalSums {
    Doubles products[PRODUCTS], sides[TWIST], cost;
    Ints inliers, measured;

    inline void add(const Doubles* jacobian, Doubles weight, Doubles residual) {
        int next = 0;
#pragma unroll
        for (int i = 0; i < TWIST; ++i) {
            const Doubles weighted = weight * jacobian[i];
            sides[i] += residual * weighted;
#pragma unroll
            for (int k = 0; k <= i; ++k) products[next++] += weighted * jacobian[k];
        }
    }
    // The sum of lanes in their order.
    static inline double total(Doubles lanes) {
        double sum = 0.0;
        for (int k = 0; k < LANES; ++k) sum += lanes[k];
        return sum;
    }
    // Write the rows of H, b, the cost, and the numbers of inliers and of measured pixels.
    inline void write(double* sums_out) const {
        int next = 0;
        for (int i = 0; i < TWIST; ++i)
            for (int k = 0; k <= i; ++k) sums_out[TWIST * i + k] = sums_out[TWIST * k + i] = total(products[next++]);
        double* const rest = sums_out + TWIST * TWIST;
        for (int i = 0; i < TWIST; ++i) rest[i] = total(sides[i]);
        rest[TWIST] = total(cost);
        rest[TWIST + 1] = PixelLanes::sum(inliers);
        rest[TWIST + 2] = PixelLanes::sum(measured);
    }
};

// Which pixels are used, and with which weight: `Weighting` of Python.
struct PixelWeighting {
    DepthRange range;
    SigmaTable sigmas;
    double huber, max_distance, min_cosine;
    float max_jump;
    int column;  // of the object's poses, -1 if the camera moves

    template <class Weighting>
    static inline PixelWeighting of(const Weighting& options, const float* sigmas, int count) {
        const auto& criteria = options.criteria;
        return PixelWeighting{.range = DepthRange::of(criteria.near, criteria.far),
                              .sigmas = SigmaTable::of(sigmas, count, criteria.first_bits, criteria.step_bits),
                              .huber = options.huber,
                              .max_distance = options.max_distance,
                              .min_cosine = options.min_cosine,
                              .max_jump = options.max_jump,
                              .column = options.column};
    }
};

// Images of a view, and its rays and their origins in the camera frame: coordinate by coordinate, `pixels` numbers
// each.
struct NormalImages {
    int width, pixels;
    const double *rays, *origins;  // origins are null if they are those of the pose
    const float *measured, *depth, *normals;
    const int *objects, *columns;  // objects of pixels, and columns of objects

    // Coordinates of pixels in the world.
    static inline void rotate(const Pose& pose, const Doubles* in_camera, Doubles* in_world) {
        for (int k = 0; k < 3; ++k)
            in_world[k] =
                pose.axis[0][k] * in_camera[0] + pose.axis[1][k] * in_camera[1] + pose.axis[2][k] * in_camera[2];
    }
    inline void load(const double* table, int pixel, int count, Doubles* coordinates) const {
        for (int k = 0; k < 3; ++k) coordinates[k] = PixelLanes::load(table + (long long)k * pixels + pixel, count);
    }
    // Which pixels show an object in a column.
    inline Ints shows(int column, int pixel, Ints known) const {
        Ints found = Lanes::all_ints(0);
        for (const int k : Lanes::each(known)) found[k] = columns[objects[pixel + k]] == column ? -1 : 0;
        return found;
    }
    // Rendered depth from any pixel on, infinite out of the image.
    inline Floats depth_from(int pixel) const {
        if (pixel >= 0 && pixel + LANES <= pixels) return Lanes::load(depth + pixel);
        Floats values = Lanes::all(__builtin_inff());
        for (int k = 0; k < LANES; ++k)
            if (pixel + k >= 0 && pixel + k < pixels) values[k] = depth[pixel + k];
        return values;
    }
    // Whether depth is discontinuous between neighbors: see `is_jump` of normal_equations.py.
    inline Ints jumps(int pixel, int step, Floats z, float max_jump) const {
        const Floats inverse = 1.0f / depth_from(pixel - step) + 1.0f / depth_from(pixel + step);
        return Lanes::abs(z * (z * inverse - 2.0f)) > max_jump;
    }
    // Whether pixels are at a depth discontinuity of the image.
    inline Ints at_edge(int pixel, Floats z, float max_jump) const {
        Ints x = Lanes::index() + pixel % width;
        if (width >= LANES)
            x -= x >= width ? Lanes::all_ints(width) : Lanes::all_ints(0);
        else
            x %= width;
        const Ints places = Lanes::index() + pixel;
        return ((x > 0) & (x < width - 1) & jumps(pixel, 1, z, max_jump)) |
               ((places >= width) & (places < pixels - width) & jumps(pixel, width, z, max_jump));
    }
};

// Sums over pixels of one view at a pose.
struct NormalRows {
    const PixelWeighting& options;
    const NormalImages& images;
    Pose camera;
    double offset[3];  // of the camera from the center of the twist, in the world

    inline void add(int first, int end, NormalSums* sums) const {
        for (int pixel = first; pixel < end; pixel += LANES) add_pixels(pixel, end - pixel, sums);
    }
    // Add the costs of the measured pixels among 16, and the terms of inliers.
    inline void add_pixels(int pixel, int count, NormalSums* sums) const {
        const Floats measured = PixelLanes::load(images.measured + pixel, count);
        Doubles ray[3];
        images.load(images.rays, pixel, count, ray);
        const Ints known = options.range.contains(measured) & __builtin_convertvector(ray[0] == ray[0], Ints);
        if (!Lanes::any(known)) return;
        const Floats rendered = PixelLanes::load(images.depth + pixel, count);
        const Ints seen = known & (Lanes::abs(rendered) <= __FLT_MAX__);
        const Doubles scale = options.sigmas.inverse_at(seen ? rendered : measured);
        const Doubles zero = (Doubles)(0.0);
        const Doubles difference =
            PixelLanes::select(seen, PixelLanes::wide(measured) - PixelLanes::wide(rendered), zero);
        const Doubles residual = difference * scale, limit = options.max_distance * scale;
        const Doubles size = __builtin_elementwise_abs(residual);
        const Doubles bounded = PixelLanes::select(seen & narrow(size < limit), size, limit);
        sums->cost += PixelLanes::select(known, cost_of(bounded), zero);
        sums->measured -= known;
        if (Lanes::any(seen)) add_seen(pixel, count, seen, Residuals{measured, rendered, ray, scale, difference}, sums);
    }

    // Pixels with measured and rendered depth.
    struct Residuals {
        Floats measured, rendered;
        const Doubles* ray;  // in the camera frame
        Doubles scale, difference;  // 1 / sigma, and measured minus rendered depth
    };
    // Huber's cost: with c = min(size, huber), it is c (size - c / 2).
    inline Doubles cost_of(Doubles size) const {
        const Doubles part = size < options.huber ? size : (Doubles)(options.huber);
        return part * (size - 0.5 * part);
    }
    static inline Ints narrow(decltype(Doubles{} < Doubles{}) mask) { return __builtin_convertvector(mask, Ints); }

    // Add the terms of inliers: see `term_of` of normal_equations.py.
    inline void add_seen(int pixel, int count, Ints seen, const Residuals& of, NormalSums* sums) const {
        Doubles ray[3], normal[3];
        NormalImages::rotate(camera, of.ray, ray);
        load_normals(pixel, count, normal);
        const Doubles along = normal[0] * ray[0] + normal[1] * ray[1] + normal[2] * ray[2];
        const Doubles squared = ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2];
        const Doubles smallest = options.min_cosine * options.min_cosine * squared;
        Ints used = seen & narrow(__builtin_elementwise_abs(along * of.difference) <= options.max_distance) &
                    narrow(along * along > smallest);
        if (options.column >= 0) used &= images.shows(options.column, pixel, used);
        if (options.max_jump < __builtin_inff()) used &= ~images.at_edge(pixel, of.rendered, options.max_jump);
        if (!Lanes::any(used)) return;
        sums->inliers -= used;

        // Numbers of other pixels may be NaN or infinite.
        const Doubles zero = (Doubles)(0.0), sign = (Doubles)(options.column >= 0 ? -1.0 : 1.0);
        const Doubles factor = sign * of.scale / along;
        Doubles arm[3] = {offset[0] + zero, offset[1] + zero, offset[2] + zero}, scaled[3];
        if (images.origins) add_origins(pixel, count, arm);
        for (int k = 0; k < 3; ++k) {
            arm[k] = PixelLanes::select(used, arm[k] + PixelLanes::wide(of.measured) * ray[k], zero);
            scaled[k] = PixelLanes::select(used, normal[k] * factor, zero);
        }
        const Doubles jacobian[TWIST] = {arm[1] * scaled[2] - arm[2] * scaled[1],
                                         arm[2] * scaled[0] - arm[0] * scaled[2],
                                         arm[0] * scaled[1] - arm[1] * scaled[0],
                                         scaled[0],
                                         scaled[1],
                                         scaled[2]};
        const Doubles residual = of.difference * of.scale, size = __builtin_elementwise_abs(residual);
        sums->add(jacobian, size > options.huber ? options.huber / size : zero + 1.0, residual);
    }
    inline void load_normals(int pixel, int count, Doubles* normal) const {
        Floats triple[3];
        PixelLanes::load_triples(images.normals + 3LL * pixel, triple, count);
        for (int k = 0; k < 3; ++k) normal[k] = PixelLanes::wide(triple[k]);
    }
    inline void add_origins(int pixel, int count, Doubles* arm) const {
        Doubles in_camera[3], origin[3];
        images.load(images.origins, pixel, count, in_camera);
        NormalImages::rotate(camera, in_camera, origin);
        for (int k = 0; k < 3; ++k) arm[k] += origin[k];
    }
};
