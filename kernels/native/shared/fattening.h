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
#if defined(__CUDA_ARCH__)
        if (!shown_out.data && (model.along_columns || model.reach <= (int)DepthStrip::REACH)) return spread_all(x);
#endif
        GroupStore<Numbers, float> depths = {depth_out.data + row.place(x), row.count(x)};
        GroupStore<Numbers, int> shown = {shown_out.data + row.place(x), row.count(x)};
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k) {
            const int column = x + k * Numbers::PIXELS;
            Surface surface = {row.exact(column), shown_at(column, row.y)};
            const Real least = least_in_front(surface.depth);
            // Most pixels have nothing in front of them, which the minimum depth of the window shows.
            if (is_at_end(column) || Numbers::any(is_in_front(nearest(column), least))) spread(surface, column, least);
            depths.put(k, surface.depth);
            if (shown_out.data) shown.put(k, surface.shown);
        }
        depths.flush();
        if (shown_out.data) shown.flush();
    }
#if defined(__CUDA_ARCH__)
    // Depths alone, of all pixels of a thread at once: closer neighbors come last, as in `spread`.
    inline void spread_all(int x) const {
        const DepthStrip own = DepthStrip::of(row, x);
        float depth[RANDOM_WORDS], least[RANDOM_WORDS];
#pragma unroll
        for (int k = 0; k < RANDOM_WORDS; ++k) depth[k] = own.at(k, 0), least[k] = least_in_front(depth[k]);
        if (model.along_columns) {
            for (int lag = model.reach; lag > 0; --lag)
#pragma unroll
                for (int side = 0; side < 2; ++side) {
                    const int y = side ? row.y - lag : row.y + lag;
                    if (y < 0 || y >= row.height) continue;
                    float others[RANDOM_WORDS];
                    DepthStrip::load(row.depth + row.place(x) + (long long)(y - row.y) * row.width, row.count(x),
                                     others);
#pragma unroll
                    for (int k = 0; k < RANDOM_WORDS; ++k)
                        depth[k] = is_in_front(others[k], least[k]) ? others[k] : depth[k];
                }
        } else {
#pragma unroll
            for (int lag = DepthStrip::REACH; lag > 0; --lag) {
                if (lag > model.reach) continue;
#pragma unroll
                for (int side = 1; side >= -1; side -= 2)
#pragma unroll
                    for (int k = 0; k < RANDOM_WORDS; ++k) {
                        const float other = own.at(k, side * lag);
                        depth[k] = is_in_front(other, least[k]) ? other : depth[k];
                    }
            }
        }
        GroupStore<Numbers, float> depths = {depth_out.data + row.place(x), row.count(x)};
#pragma unroll
        for (int k = 0; k < RANDOM_WORDS; ++k) depths.put(k, depth[k]);
        depths.flush();
    }
#endif
    // A surface is in front of another one if its disparity is at least this.
    inline Real least_in_front(Real depth) const { return model.disparity_scale / depth + model.step; }
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
