// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Generic noise and holes: `warpvis.sensors.Corruptions`.

#pragma once

#include "shared/noise.h"

template <class Numbers, class Model>
struct Corruption {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef SensorRange<Numbers> Range;
    const SensorRow<Numbers>& row;
    const Model& model;

    // Random numbers of the pixels that share counters; those of disabled corruptions are not drawn.
    struct Drawn {
        PixelWords<Numbers> lost;
        PixelNormals<Numbers> multiplied, added;
    };

    // Corrupt the pixels from x on that share random words.
    inline void measure(int x) const {
        Drawn drawn;
        if (model.dropout > 0.0f) drawn.lost = row.draw(STREAM_LOST, x);
        if (model.multiplied > 0.0f) drawn.multiplied = row.draw_normals(STREAM_MULTIPLIED, x);
        if (model.added > 0.0f) drawn.added = row.draw_normals(STREAM_ADDED, x);
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k) corrupt_pixels(drawn, k, x + k * Numbers::PIXELS);
    }
    // Reported depth before corruptions, and its reason.
    inline Real before_of(int x) const {
        return row.depth ? row.range.report(row.exact(x)) : Numbers::load(row.depth_out + row.place(x), row.count(x));
    }
    inline Whole reason_of(int x, Real before) const {
        const Whole empty = Numbers::whole(REASON_EMPTY);
        if (row.depth) return Range::finite(row.exact(x)) ? Range::reason(before) : empty;
        return row.reasons_out ? Numbers::load(row.reasons_out + row.place(x), row.count(x)) : empty;
    }
    inline void corrupt_pixels(const Drawn& drawn, int k, int x) const {
        const Real before = before_of(x);
        const Whole reason = reason_of(x, before), has_surface = Range::finite(before);
        if (!Numbers::any(has_surface)) return row.write(x, before, reason);
        Real depth = before;
        if (model.multiplied > 0.0f) depth = depth * (1.0f + model.multiplied * drawn.multiplied.block[k]);
        if (model.added > 0.0f) depth = depth + model.added * drawn.added.block[k];
        depth = row.range.report(depth);
        const Whole lost = is_lost(drawn, k, x);
        const Whole cause = lost ? Numbers::whole(REASON_DROPOUT) : Range::reason(depth);
        depth = lost ? Numbers::real(Numbers::no_number()) : depth;
        row.write(x, has_surface ? depth : before, has_surface ? cause : reason);
    }
    inline Whole is_lost(const Drawn& drawn, int k, int x) const {
        Whole lost = Numbers::whole(0);
        if (model.dropout > 0.0f) lost = Random<Numbers>::uniform(drawn.lost.block[k]) < model.dropout;
        const Whole column = Numbers::indices(x);
        for (int i = 0; i < model.max_count; ++i) {
            const auto& box = model.rectangles.data[row.view * model.max_count + i];  // left, top, right, bottom
            if (row.y >= box[1] && row.y < box[3]) lost |= (column >= box[0]) & (column < box[2]);
        }
        return lost;
    }
};
