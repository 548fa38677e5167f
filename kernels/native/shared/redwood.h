// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The Kinect model of the Redwood data set's simulator: `warpvis.sensors.RedwoodNoise`.

#pragma once

#include "shared/noise.h"

template <class Numbers, class Model, class Table>
struct Redwood {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef SensorRow<Numbers> Row;
    typedef SensorRange<Numbers> Range;
    // Image size of the table, size of its cells [px], and number of its columns and of the entries of a cell.
    enum { TABLE_WIDTH = 640, TABLE_HEIGHT = 480, CELL_WIDTH = 8, CELL_HEIGHT = 6, COLUMNS = 80, ENTRIES = 5 };
    const Row& row;
    const Model& model;
    const Table& table;

    inline void measure(int x) const {
        const typename Row::Normals across = row.draw_normals(STREAM_ACROSS, x),
                                    down = row.draw_normals(STREAM_DOWN, x),
                                    normals = row.draw_normals(STREAM_DISPARITY, x);
        const float jitter = model.jitter * model.multiplier, sigma = model.disparity_sigma * model.multiplier;
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k) {
            const int first = x + k * Numbers::PIXELS;
            const Whole column = moved(Numbers::columns(first), jitter * across.block[k], row.width);
            const Whole line = moved(Numbers::real((float)row.y), jitter * down.block[k], row.height);
            measure_pixels(first, line, column, sigma * normals.block[k]);
        }
    }
    // The pixels nearest to shifted pixels along one axis, clamped to the image.
    static inline Whole moved(Real pixel, Real shift, int size) {
        const Real none = Numbers::real(0.0f), last = Numbers::real((float)(size - 1));
        return Numbers::truncate(Numbers::min(Numbers::max(none, pixel + shift), last) + 0.5f);
    }
    // The table's cells along one axis for pixels of an image of any size.
    static inline Whole cell_of(Whole pixel, int size, int table_size, int cell) {
        const float last = (float)(size > 1 ? size - 1 : 1);
        return Numbers::truncate(Numbers::to_real(pixel) / last * (float)(table_size - 1) + 0.5f) / cell;
    }
    // Divisors of depth, interpolated between the entries of cells at 1, 3, 5, 7 and 9 m.
    inline Real distortion_of(Whole line, Whole column, Real depth) const {
        const Whole none = Numbers::whole(0), last = Numbers::whole(ENTRIES - 1);
        const Whole after = Numbers::truncate((depth + 1.0f) / 2.0f), before = after - 1;
        const Real share = (depth - Numbers::to_real(2 * after - 1)) / 2.0f;
        const Whole entries = (line * (int)COLUMNS + column) * (int)ENTRIES;
        const Real lower = Numbers::gather(table.data, entries + (before > 0 ? before : none));
        const Real upper = Numbers::gather(table.data, entries + (after < last ? after : last));
        return (1.0f - share) * lower + share * upper;
    }
    // Measure pixels from x on, which show those of other lines and columns.
    inline void measure_pixels(int x, Whole line, Whole column, Real noise) const {
        const Whole place = (line - line % 2) * row.width + (column - column % 2);
        const Real depth = Numbers::gather(row.depth + row.first, place);
        const Real endless = Numbers::real(Numbers::endless()), none = Numbers::real(Numbers::no_number());
        const Whole has_surface = Range::finite(depth), is_near = has_surface & (depth < model.farthest);
        const Real near_depth = is_near ? depth : Numbers::real(1.0f);
        const Real factor = distortion_of(cell_of(line, row.height, TABLE_HEIGHT, CELL_HEIGHT),
                                          cell_of(column, row.width, TABLE_WIDTH, CELL_WIDTH), near_depth);
        const Real levels = Numbers::round((model.disparity_scale * factor / near_depth + noise) * model.levels);
        // Depth is infinite below the first step of disparity.
        const Real reported = row.range.report(levels > 0.0f ? model.disparity_scale * model.levels / levels : endless);
        const Whole is_lost = factor < model.min_factor;
        const Real measured = is_lost ? none : reported;
        const Whole cause = is_lost ? Numbers::whole(REASON_DROPOUT) : Range::reason(reported);
        const Whole far_cause = has_surface ? Numbers::whole(REASON_RANGE) : Numbers::whole(REASON_EMPTY);
        row.write(x, is_near ? measured : (has_surface ? endless : depth), is_near ? cause : far_cause);
    }
};
