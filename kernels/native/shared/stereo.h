// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Measurement model of a triangulation sensor: `warpvis.sensors.StereoDepth`.

#pragma once

#include "shared/noise.h"

template <class Numbers, class Model, class Eye>
struct Stereo {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef PixelWords<Numbers> Words;
    const SensorRow<Numbers>& row;
    const Model& model;
    const Eye& eye;  // an `OtherEye` of kernels/sensors/stereo.py

    // Inputs of the model at a pixel.
    struct Pixel {
        Real depth;  // of the first surface [m], +inf if there is none
        Real far_depth;  // the same along the optical axis of the other eye [m]
        Real other_depth;  // depth that the other eye measures there [m]
        Real column;  // of the pixel's center [px]
        Real support;  // fraction of the surrounding window that shows the same surface, from 0 to 1
        Real cosine;  // of the angle of incidence
        Real reflectivity;
        Real noise;  // standard normal
        Real chance;  // uniform in (0, 1)
    };

    // sin(2 pi a), by a minimax polynomial with exact zeros and a relative error below 4e-7.
    static inline Real wave(Real a) {
        const Real t = a - Numbers::floor(a + 0.5f), square = t * t;
        Real sum = square * 3.0019321f - 9.507514f;
        sum = sum * square + 16.758163f;
        sum = sum * square - 16.208584f;
        sum = sum * square + 6.283183f;
        return sum * (t * (1.0f - 4.0f * square));
    }
    inline Real measured(Real disparity, Real noise) const {
        const Real locked = model.locking == 0.0f ? disparity : disparity + model.locking * wave(disparity);
        const Real found = locked + model.sigma * noise;
        return model.levels > 0.0f ? Numbers::floor(found * model.levels + 0.5f) / model.levels : found;
    }
    // If the disparity is unchanged, the depth is unchanged to the last bit.
    inline Real depth_of(Real found, Real depth, Real disparity) const {
        return model.levels > 0.0f ? model.disparity_scale / found : depth * (disparity / found);
    }
    // Whether a surface occludes this one from the other eye: its disparity is greater by more than the tolerance.
    inline Whole hidden(const Pixel& pixel) const {
        const float scale = model.shift_scale < 0.0f ? -model.shift_scale : model.shift_scale;
        return scale * (pixel.far_depth - pixel.other_depth) >
               model.shadow_tolerance * pixel.far_depth * pixel.other_depth;
    }
    inline Whole is_outside(const Pixel& pixel, Real nearness) const {
        const Real column = pixel.column - model.shift_scale * nearness;
        return (column < model.first_column) | (column > model.last_column);
    }
    // Fraction of pixels with a given signal that are detected.
    inline Real found_share(Real signal) const {
        const Real share = (signal - model.min_signal) * model.signal_slope;
        return share < 1.0f ? share : Numbers::real(1.0f);
    }

    inline void match(const Pixel& pixel, Real& depth, Whole& reason) const {
        const Real nearness = 1.0f / pixel.depth, disparity = model.disparity_scale * nearness;
        const Real found = measured(disparity, pixel.noise);
        const Real reported = depth_of(found, pixel.depth, disparity);
        const Real endless = Numbers::real(Numbers::endless()), none = Numbers::real(Numbers::no_number());
        const Whole too_far = (reported > row.range.far) | (found <= 0.0f),
                    in_range = (reported >= row.range.near) & (reported <= row.range.far);
        const Whole lost = pixel.chance >= found_share(pixel.reflectivity * pixel.cosine) * model.detection_rate;
        const Whole grazing = pixel.chance >= found_share(pixel.cosine);
        const Whole too_much = disparity > model.max_disparity, empty = !(pixel.depth < endless);

        reason = in_range ? Numbers::whole(REASON_VALID) : Numbers::whole(REASON_RANGE);
        reason = lost ? (grazing ? Numbers::whole(REASON_GRAZING) : Numbers::whole(REASON_DROPOUT)) : reason;
        reason = pixel.support < model.min_support ? Numbers::whole(REASON_EDGE) : reason;
        reason = hidden(pixel) ? Numbers::whole(REASON_SHADOW) : reason;
        reason = is_outside(pixel, nearness) ? Numbers::whole(REASON_BAND) : reason;
        reason = too_much ? Numbers::whole(REASON_RANGE) : reason;
        reason = empty ? Numbers::whole(REASON_EMPTY) : reason;

        depth = in_range ? reported : (too_far ? endless : -endless);
        depth = too_much ? -endless : depth;
        depth = reason > (int)REASON_RANGE ? none : depth;
        depth = empty ? endless : depth;
    }

#if defined(__CUDA_ARCH__)
    // `support` of the pixels of a thread, whose windows overlap.
    inline void find_supports(int x, float* supports) const {
        if (!model.window || model.window > (int)DepthStrip::REACH) {
#pragma unroll
            for (int k = 0; k < RANDOM_WORDS; ++k)
                supports[k] = model.window && x + k < row.width ? support(x + k) : 1.0f;
            return;
        }
        const DepthStrip strip = DepthStrip::of(row, x);
        float in_row[RANDOM_WORDS] = {}, in_column[RANDOM_WORDS] = {};
#pragma unroll
        for (int lag = -DepthStrip::REACH; lag <= (int)DepthStrip::REACH; ++lag) {
            if (lag < -model.window || lag > model.window) continue;
#pragma unroll
            for (int k = 0; k < RANDOM_WORDS; ++k) count(strip.at(k, 0), strip.at(k, lag), in_row[k]);
            if (row.y + lag < 0 || row.y + lag >= row.height) continue;
            float depths[RANDOM_WORDS];
            DepthStrip::load(row.depth + row.place(x) + (long long)lag * row.width, row.count(x), depths);
#pragma unroll
            for (int k = 0; k < RANDOM_WORDS; ++k) count(strip.at(k, 0), depths[k], in_column[k]);
        }
#pragma unroll
        for (int k = 0; k < RANDOM_WORDS; ++k)
            supports[k] = (in_row[k] / columns_of_window(x + k)) * (in_column[k] / rows_of_window());
    }
#endif
    // Fraction of the window of each pixel that shows the pixel's surface.
    inline Real support(int x) const {
        if (is_even(x)) return Numbers::real(1.0f);
        const float* depths = row.depth + row.place(x);
        const Real depth = Numbers::load(depths, row.count(x));
        Real in_row = Numbers::real(0.0f), in_column = in_row;
        for (int lag = -model.window; lag <= model.window; ++lag) {
            // Pixels beyond the ends of the row or the column belong to no surface.
            count(depth, row.exact(x + lag, row.y, Numbers::endless()), in_row);
            if (row.y + lag < 0 || row.y + lag >= row.height) continue;
            count(depth, Numbers::load(depths + (long long)lag * row.width, row.count(x)), in_column);
        }
        return (in_row / columns_of_window(x)) * (in_column / rows_of_window());
    }
    inline void count(Real depth, Real other, Real& number) const {
        const Whole same = model.disparity_scale * Numbers::abs(depth - other) < model.edge_step * depth * other;
        number = same ? number + 1.0f : number;
    }
    // Number of image pixels in the window, horizontally and vertically.
    inline Real columns_of_window(int x) const {
        const Real first = Numbers::columns(x) - (float)model.window, last = first + (float)(2 * model.window);
        const Real first_column = Numbers::real(0.0f), last_column = Numbers::real((float)(row.width - 1));
        return (last < last_column ? last : last_column) - (first > first_column ? first : first_column) + 1.0f;
    }
    inline float rows_of_window() const {
        const int first = row.y - model.window, last = row.y + model.window, last_row = row.height - 1;
        return (float)((last < last_row ? last : last_row) - (first > 0 ? first : 0) + 1);
    }
    // Whether all pixels of the windows belong to one surface, by their least and greatest depth: true in most of an
    // image, and faster than counting. Uncertain cases, within the rounding error, return false and are counted.
    inline bool is_even(int x) const {
        const int reach = model.window, end = x + Numbers::PIXELS;
        if (Numbers::PIXELS == 1 || x < reach || end + reach > row.width) return false;
        const int below = row.height - 1 - row.y, up = row.y < reach ? row.y : reach;
        const int down = below < reach ? below : reach;
        const float* depths = row.depth + row.place(x);
        Real min_depth = Numbers::load(depths, Numbers::PIXELS), max_depth = min_depth;
        for (int lag = -reach; lag <= reach; ++lag) widen(depths + lag, min_depth, max_depth);
        for (int lag = -up; lag <= down; ++lag) widen(depths + (long long)lag * row.width, min_depth, max_depth);
        const float margin = 0.99999f;
        return Numbers::all(model.disparity_scale * (max_depth - min_depth) <
                            margin * model.edge_step * (min_depth * max_depth));
    }
    static inline void widen(const float* from, Real& min_depth, Real& max_depth) {
        const Real depth = Numbers::load(from, Numbers::PIXELS);
        min_depth = depth < min_depth ? depth : min_depth;
        max_depth = depth > max_depth ? depth : max_depth;
    }

    // Angle between the rays of pixels and the normals of the surfaces: its cosine is `along` divided by the root of
    // `square`.
    struct Incidence {
        Real along, square;
        inline Real cosine() const { return along / Numbers::root(square); }
    };
    inline Incidence incidence(int x) const {
        const Real across = Numbers::load(model.column_slopes.data + x, row.count(x));
        const float down = model.row_slopes.data[row.y];
        Real normal[3];
        row.normal(x, normal);
        Real along = Numbers::real(0.0f);
        for (int k = 0; k < 3; ++k) {
            const Real ray = across * eye.axes.data[k][0] + (down * eye.axes.data[k][1] + eye.axes.data[k][2]);
            along = along + ray * normal[k];
        }
        return Incidence{Numbers::abs(along), across * across + (down * down + 1.0f)};
    }
    // Whether the signal of every pixel with a surface exceeds full detection by more than the rounding error: then
    // neither the cosine nor a random number is needed.
    inline bool suffices(const Incidence& light, Real depth, Real reflectivity) const {
        if (Numbers::PIXELS == 1 || model.detection_rate < 1.0f) return false;
        const float full = (model.min_signal + 1.0f / model.signal_slope) * 1.0001f;
        const Real signal = reflectivity * light.along;
        return Numbers::all((signal * signal >= (full * full) * light.square) | (depth == Numbers::endless()));
    }
    // Normal numbers interpolated between the nodes of a `SmoothField`, with weights whose squares sum to 1. The pixels
    // of a register lie between a few adjacent nodes.
    template <class Field>
    inline Real interpolated(const Field& field, int x) const {
        const auto& nodes = field.nodes;
        const int spacing = field.spacing, node_row = row.y / spacing, first = field.column_nodes.data[x];
        const int count = nodes.shape[2] - first;
        const float* above = nodes.data + ((long long)row.view * nodes.shape[1] + node_row) * nodes.shape[2] + first;
        const float* below = above + nodes.shape[2];
        const auto& down = field.weights.data[row.y - node_row * spacing];
        Real between[2];
        for (int side = 0; side < 2; ++side) {
            const Real upper = Numbers::load(above + side, count - side);
            const Real lower = Numbers::load(below + side, count - side);
            between[side] = upper * down[0] + lower * down[1];
        }
        const Real left = Numbers::load(field.left_weights.data + x, row.count(x));
        const Real right = Numbers::load(field.right_weights.data + x, row.count(x));
        if (Numbers::repeats(spacing))
            return left * Numbers::repeated(between[0], spacing) + right * Numbers::repeated(between[1], spacing);
        float stored[2][Numbers::PIXELS], at_pixels[2][Numbers::PIXELS] = {};
        for (int side = 0; side < 2; ++side) Numbers::store(stored[side], between[side], Numbers::PIXELS);
        for (int k = 0; k < Numbers::PIXELS && x + k < row.width; ++k) {
            const int node = field.column_nodes.data[x + k] - first;
            at_pixels[0][k] = stored[0][node];
            at_pixels[1][k] = stored[1][node];
        }
        return left * Numbers::load(at_pixels[0], Numbers::PIXELS) +
               right * Numbers::load(at_pixels[1], Numbers::PIXELS);
    }

    // Measure the pixels from x on that share random words.
    inline void measure(int x) const {
        PixelNormals<Numbers> noise;
        Words chance;
        const bool white = model.sigma > 0.0f && !model.noise.nodes.data;
        bool has_chance = false;
        if (white) noise = row.draw_normals(STREAM_DISPARITY, x);
        const int first = x;
#if defined(__CUDA_ARCH__)
        float supports[RANDOM_WORDS];
        find_supports(x, supports);
#endif
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(first, k); ++k, x += Numbers::PIXELS) {
            if (empty(x)) continue;
            Pixel pixel = load_pixel(x);
#if defined(__CUDA_ARCH__)
            pixel.support = supports[k];
#else
            pixel.support = model.window ? support(x) : Numbers::real(1.0f);
#endif
            if (white) pixel.noise = noise.block[k];
            if (by_chance(x, pixel)) {
                const bool clumps = model.holes.nodes.data;
                if (!clumps && !has_chance) chance = row.draw(STREAM_DROPOUT, first);
                has_chance = true;
                pixel.chance = clumps ? Random<Numbers>::cumulative(interpolated(model.holes, x))
                                      : Random<Numbers>::uniform(chance.block[k]);
            }
            Real depth;
            Whole reason;
            match(pixel, depth, reason);
            row.write(x, depth, reason);
        }
    }
    // Whether all pixels of a register are empty; if so, write them. This is common in many images.
    inline bool empty(int x) const {
        const Real depth = row.exact(x);
        if (Numbers::PIXELS == 1 || !Numbers::all(depth == Numbers::endless())) return false;
        row.write(x, depth, Numbers::whole(REASON_EMPTY));
        return true;
    }
    // Compute the light that comes back. Returns whether detection depends on chance.
    inline bool by_chance(int x, Pixel& pixel) const {
        pixel.reflectivity = row.reflectivities(x);
        if (!row.normals) return model.detection_rate < 1.0f;
        const Incidence light = incidence(x);
        if (suffices(light, pixel.depth, pixel.reflectivity)) return false;
        pixel.cosine = light.cosine();
        return true;
    }
    inline Pixel load_pixel(int x) const {
        const Real one = Numbers::real(1.0f), none = Numbers::real(0.0f), endless = Numbers::real(Numbers::endless());
        const float* other_depth = model.other_depth.data;
        Pixel pixel;
        pixel.depth = row.exact(x);
        pixel.far_depth = pixel.depth - (float)eye.place[2];  // it may be in front of the first eye, due to rounding
        pixel.other_depth = other_depth ? Numbers::load(other_depth + row.place(x), row.count(x)) : endless;
        pixel.column = Numbers::columns(x) + 0.5f;
        pixel.cosine = one;
        pixel.noise = model.noise.nodes.data ? interpolated(model.noise, x) : none;
        pixel.chance = none;
        return pixel;
    }
};

// Project the points of pixels into the image of a view's other eye, x y x y ... [px]; NaN if they lie outside.
template <class Numbers, class Model, class Eye, class Points, class Limits>
struct OtherPoints {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    const SensorRow<Numbers>& row;
    const Model& model;
    const Eye& eye;
    const Points& points;
    const Limits& limits;

    inline void measure(int x) const {
        PointStore stored = {(float*)points.data + row.place(x) * 2, row.count(x)};
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k) project(x + k * Numbers::PIXELS, k, stored);
        stored.flush();
    }
#if defined(__CUDA_ARCH__)
    // Points of a thread, which are stored in pairs.
    struct PointStore {
        float* to;
        int count;
        float values[2 * RANDOM_WORDS];

        inline void put(int k, float column, float line) { values[2 * k] = column, values[2 * k + 1] = line; }
        inline void flush() const {
#pragma unroll
            for (int k = 0; k < 2 * RANDOM_WORDS; k += RANDOM_WORDS) {
                GroupStore<Numbers, float> half = {to + k, 2 * count - k};
#pragma unroll
                for (int i = 0; i < RANDOM_WORDS; ++i) half.put(i, values[k + i]);
                half.flush();
            }
        }
    };
#else
    struct PointStore {
        float* to;
        int count;

        inline void put(int k, Real column, Real line) const {
            Numbers::store_pairs(to + 2 * k * Numbers::PIXELS, column, line, count - k * Numbers::PIXELS);
        }
        inline void flush() const {}
    };
#endif
    inline void project(int x, int k, PointStore& stored) const {
        const float place[3] = {(float)eye.place[0], (float)eye.place[1], (float)eye.place[2]};
        const Real depth = row.exact(x), across = Numbers::load(model.column_slopes.data + x, row.count(x));
        const Real nearness = 1.0f / (depth - place[2]);
        const Real shift = (across * place[2] - place[0]) * (float)row.focal[0] * nearness;
        const Real column = Numbers::columns(x) + (model.added_columns + 0.5f) + shift;
        const float across_rows = (model.row_slopes.data[row.y] * place[2] - place[1]) * (float)row.focal[1];
        const Real pixel_row = across_rows * nearness + ((float)row.y + 0.5f);
        const Whole is_inside =
            (depth >= model.min_depth) & (depth < Numbers::endless()) & (column >= 0.0f) & (column < model.other_width);
        const Real none = Numbers::real(Numbers::no_number());
        stored.put(k, is_inside ? column : none, is_inside ? inside(pixel_row) : none);
        if (limits.data) Numbers::store(limits.data + row.place(x), limit(nearness), row.count(x));
    }
    // Inverse depths beyond which no surface hides a point, by half of the tolerance, and less than rounding.
    inline Real limit(Real nearness) const {
        const float scale = model.shift_scale < 0.0f ? -model.shift_scale : model.shift_scale;
        return nearness * 0.999999f + 0.5f * model.shadow_tolerance / scale;
    }
    // Clamp rows that rounding moved beyond the upper or lower edge: both eyes share their rows.
    inline Real inside(Real pixel_row) const {
        const Real min_row = Numbers::real(0.0f), max_row = Numbers::real(row.height * 0.99999994f);
        const Real low = pixel_row > min_row ? pixel_row : min_row;
        return low < max_row ? low : max_row;
    }
};
