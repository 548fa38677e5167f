// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The model of shared/stereo.h applied to rows of pixels, as many at a time as Numbers holds.

#pragma once

#include "shared/stereo.h"

// Fraction of the window of each pixel that shows the pixel's surface.
template <class Numbers, class Model>
struct StereoWindow {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef SensorRow<Numbers> Row;
    const Row& row;
    const Model& model;
    Real depth;
    Real in_row, in_column;

    inline void count_column(int x, int lag) {
        if (row.y + lag < 0 || row.y + lag >= row.height) return;
        count(Numbers::load(row.depth + row.place(x) + (long long)lag * row.width, row.count(x)), in_column);
    }
    inline void count(Real other, Real& number) const {
        const Whole same = model.disparity_scale * Numbers::abs(depth - other) < model.edge_step * depth * other;
        number = same ? number + 1.0f : number;
    }
    // Number of image pixels in the window, horizontally and vertically.
    inline Real of_row(int x) const {
        const Real first = Numbers::columns(x) - (float)model.window, last = first + (float)(2 * model.window);
        const Real first_column = Numbers::real(0.0f), last_column = Numbers::real((float)(row.width - 1));
        return (last < last_column ? last : last_column) - (first > first_column ? first : first_column) + 1.0f;
    }
    inline float of_column() const {
        const int first = row.y - model.window, last = row.y + model.window, last_row = row.height - 1;
        return (float)((last < last_row ? last : last_row) - (first > 0 ? first : 0) + 1);
    }

    // Whether all pixels of the windows belong to one surface, by their least and greatest depth: true in most of an
    // image, and faster than counting. Uncertain cases, within the rounding error, return false and are counted.
    static inline bool even(const Row& row, const Model& model, int x) {
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

    static inline Real support(const Row& row, const Model& model, int x) {
        const Real none = Numbers::real(0.0f);
        if (even(row, model, x)) return Numbers::real(1.0f);
        StereoWindow window = {row, model, row.exact(x), none, none};
        for (int lag = -model.window; lag <= model.window; ++lag) {
            // Pixels beyond the end of the row belong to no surface.
            window.count(row.exact(x + lag, row.y, Numbers::endless()), window.in_row);
            window.count_column(x, lag);
        }
        return (window.in_row / window.of_row(x)) * (window.in_column / window.of_column());
    }
};

template <class Numbers, class Model, class Eye>
struct Stereo {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef PixelWords<Numbers> Words;
    typedef StereoPixel<Numbers> Pixel;
    const SensorRow<Numbers>& row;
    const Model& model;
    const Eye& eye;  // an `OtherEye` of kernels/sensors/stereo.py

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
    // Noise interpolated between nodes, with weights whose squares sum to 1. The pixels of a register lie between a few
    // adjacent nodes.
    inline Real smooth_noise(int x) const {
        const auto& nodes = model.nodes;
        const int spacing = model.spacing, node_row = row.y / spacing, first = model.column_nodes.data[x];
        const int count = nodes.shape[2] - first;
        const float* above = nodes.data + ((long long)row.view * nodes.shape[1] + node_row) * nodes.shape[2] + first;
        const float* below = above + nodes.shape[2];
        const auto& down = model.weights.data[row.y - node_row * spacing];
        Real between[2];
        for (int side = 0; side < 2; ++side) {
            const Real upper = Numbers::load(above + side, count - side);
            const Real lower = Numbers::load(below + side, count - side);
            between[side] = upper * down[0] + lower * down[1];
        }
        const Real left = Numbers::load(model.left_weights.data + x, row.count(x));
        const Real right = Numbers::load(model.right_weights.data + x, row.count(x));
        if (Numbers::repeats(spacing))
            return left * Numbers::repeated(between[0], spacing) + right * Numbers::repeated(between[1], spacing);
        float stored[2][Numbers::PIXELS], at_pixels[2][Numbers::PIXELS] = {};
        for (int side = 0; side < 2; ++side) Numbers::store(stored[side], between[side], Numbers::PIXELS);
        for (int k = 0; k < Numbers::PIXELS && x + k < row.width; ++k) {
            const int node = model.column_nodes.data[x + k] - first;
            at_pixels[0][k] = stored[0][node];
            at_pixels[1][k] = stored[1][node];
        }
        return left * Numbers::load(at_pixels[0], Numbers::PIXELS) +
               right * Numbers::load(at_pixels[1], Numbers::PIXELS);
    }

    // Measure the pixels from x on that share random words.
    inline void measure(int x) const {
        Words noise, chance;
        const bool white = model.sigma > 0.0f && !model.nodes.data;
        bool has_chance = false;
        if (white) noise = row.draw(STREAM_DISPARITY, x);
        const int first = x;
        for (int k = 0; row.has_word(first, k); ++k, x += Numbers::PIXELS) {
            if (empty(x)) continue;
            Pixel pixel = load_pixel(x);
            if (white) pixel.noise = Random<Numbers>::normal(noise.block[k]);
            if (by_chance(x, pixel)) {
                if (!has_chance) chance = row.draw(STREAM_DROPOUT, first);
                has_chance = true;
                pixel.chance = Random<Numbers>::uniform(chance.block[k]);
            }
            Real depth;
            Whole reason;
            StereoMatcher<Numbers, Model>{model, row.range}.measure(pixel, depth, reason);
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
        const float* other_depth = row.image_of(model.other_depth.data);
        Pixel pixel;
        pixel.depth = row.exact(x);
        pixel.far_depth = pixel.depth - (float)eye.place[2];  // it may be in front of the first eye, due to rounding
        pixel.other_depth = other_depth ? Numbers::load(other_depth + row.place(x), row.count(x)) : endless;
        pixel.column = Numbers::columns(x) + 0.5f;
        pixel.support = model.window ? StereoWindow<Numbers, Model>::support(row, model, x) : one;
        pixel.cosine = one;
        pixel.noise = model.nodes.data ? smooth_noise(x) : none;
        pixel.chance = none;
        return pixel;
    }
};

// Project the points of pixels into the image of a view's other eye, x y x y ... [px]; NaN if they lie outside.
template <class Numbers, class Model, class Eye, class Points>
struct OtherPoints {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    const SensorRow<Numbers>& row;
    const Model& model;
    const Eye& eye;
    const Points& points;

    inline void measure(int x) const {
        for (int k = 0; row.has_word(x, k); ++k) project(x + k * Numbers::PIXELS);
    }
    inline void project(int x) const {
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
        Numbers::store_pairs((float*)row.image_of(points.data) + row.place(x) * 2, is_inside ? column : none,
                             is_inside ? inside(pixel_row) : none, row.count(x));
    }
    // Clamp rows that rounding moved beyond the upper or lower edge: both eyes share their rows.
    inline Real inside(Real pixel_row) const {
        const Real min_row = Numbers::real(0.0f), max_row = Numbers::real(row.height * 0.99999994f);
        const Real low = pixel_row > min_row ? pixel_row : min_row;
        return low < max_row ? low : max_row;
    }
};
