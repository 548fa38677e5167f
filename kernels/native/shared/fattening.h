// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Near surfaces that spread over their background: `fattening` of `warpvis.sensors.StereoDepth`.

#pragma once

#include "shared/noise.h"

// Along rows or columns, write the depth of the closest pixel in front of each pixel, and its index in the view. Pixels
// that already show the surface of another one have its index.
template <class Numbers, class Model, class Depth, class Shown>
struct Fattening {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    const SensorRow<Numbers>& row;
    const Model& model;
    const Depth& depth_out;
    const Shown& shown_out;

    struct Surface {
        Real depth;
        Whole shown;
    };

    inline void measure(int x) const {
        GroupStore<Numbers, float> depths = {depth_out.data + row.place(x), row.count(x)};
        GroupStore<Numbers, int> shown = {shown_out.data + row.place(x), row.count(x)};
#if defined(__CUDA_ARCH__)
        float near[RANDOM_WORDS];
        find_nearest(x, near);
#endif
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k) {
            const int column = x + k * Numbers::PIXELS;
            Surface surface = {row.exact(column), shown_at(column, row.y)};
            // A surface is in front if its disparity is at least this.
            const Real least = model.disparity_scale / surface.depth + model.step;
            // Most pixels have nothing in front of them, which the minimum depth of the window shows.
#if defined(__CUDA_ARCH__)
            const bool spreads = is_in_front(near[k], least);
#else
            const bool spreads = is_at_end(column) || Numbers::any(is_in_front(nearest(column), least));
#endif
            if (spreads) spread(surface, column, least);
            depths.put(k, surface.depth);
            if (shown_out.data) shown.put(k, surface.shown);
        }
        depths.flush();
        if (shown_out.data) shown.flush();
    }
#if defined(__CUDA_ARCH__)
    // Minimum depth in the windows of the pixels of a thread, inside of the image.
    inline void find_nearest(int x, float* near) const {
        const int reach = model.reach;
#pragma unroll
        for (int k = 0; k < RANDOM_WORDS; ++k) near[k] = OnePixel::endless();
        if (model.along_columns) {
            for (int y = max(row.y - reach, 0); y <= min(row.y + reach, row.height - 1); ++y) {
                float depths[RANDOM_WORDS];
                DepthStrip::load(row.depth + row.place(x) + (long long)(y - row.y) * row.width, row.count(x), depths);
#pragma unroll
                for (int k = 0; k < RANDOM_WORDS; ++k) near[k] = fminf(near[k], depths[k]);
            }
        } else if (reach <= (int)DepthStrip::REACH) {
            const DepthStrip strip = DepthStrip::of(row, x);
#pragma unroll
            for (int lag = -DepthStrip::REACH; lag <= (int)DepthStrip::REACH; ++lag) {
                if (lag < -reach || lag > reach) continue;
#pragma unroll
                for (int k = 0; k < RANDOM_WORDS; ++k) near[k] = fminf(near[k], strip.at(k, lag));
            }
        } else {
            for (int column = max(x - reach, 0); column < min(x + RANDOM_WORDS + reach, row.width); ++column) {
                const float depth = row.depth[row.place(column)];
#pragma unroll
                for (int k = 0; k < RANDOM_WORDS; ++k)
                    if (abs(column - x - k) <= reach) near[k] = fminf(near[k], depth);
            }
        }
    }
#endif
    inline Whole is_in_front(Real depth, Real least) const { return least * depth <= model.disparity_scale; }
    inline Whole shown_at(int x, int y) const {
        const int index = y * row.width + x;
        return row.shown ? Numbers::load(row.shown + row.first + index, row.count(x)) : Numbers::indices(index);
    }
    // Whether pixels, or pixels in their windows, are beyond the ends of the row.
    inline bool is_at_end(int x) const {
        const int reach = model.along_columns ? 0 : model.reach;
        return x < reach || x + Numbers::PIXELS + reach > row.width;
    }
    // Minimum depth in the window of each pixel.
    inline Real nearest(int x) const {
        const int stride = model.along_columns ? row.width : 1, reach = model.reach;
        const int below = model.along_columns ? row.height - 1 - row.y : reach;
        const int first = model.along_columns && row.y < reach ? row.y : reach, last = below < reach ? below : reach;
        const float* depths = row.depth + row.place(x);
        Real least = Numbers::load(depths - first * stride, Numbers::PIXELS);
        for (int lag = 1 - first; lag <= last; ++lag)
            least = Numbers::min(least, Numbers::load(depths + lag * stride, Numbers::PIXELS));
        return least;
    }

    // Replace the surface by those of pixels in front, closer ones last.
    inline void spread(Surface& surface, int x, Real least) const {
        for (int lag = model.reach; lag > 0; --lag) {
            if (!model.along_columns) {
                replace(surface, x + lag, row.y, least);
                replace(surface, x - lag, row.y, least);
                continue;
            }
            if (row.y + lag < row.height) replace(surface, x, row.y + lag, least);
            if (row.y >= lag) replace(surface, x, row.y - lag, least);
        }
    }
    inline void replace(Surface& surface, int x, int y, Real least) const {
        const Real depth = row.exact(x, y, Numbers::endless());
        const Whole in_front = is_in_front(depth, least);
        surface.depth = in_front ? depth : surface.depth;
        if (shown_out.data) surface.shown = in_front ? shown_at(x, y) : surface.shown;
    }
};
