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
        for (int k = 0; row.has_word(x, k); ++k) write(x + k * Numbers::PIXELS);
    }
    inline void write(int x) const {
        Surface surface = {row.exact(x), shown_at(x, row.y)};
        // A surface is in front if its disparity is at least this.
        const Real least = model.disparity_scale / surface.depth + model.step;
        // Most pixels have nothing in front of them, which the minimum depth of the window shows.
        if (is_at_end(x) || Numbers::any(is_in_front(nearest(x), least))) spread(surface, x, least);
        Numbers::store(depth_out.data + row.place(x), surface.depth, row.count(x));
        if (shown_out.data) Numbers::store(shown_out.data + row.place(x), surface.shown, row.count(x));
    }
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
