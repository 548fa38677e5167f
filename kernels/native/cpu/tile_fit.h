// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The fit of the columns and rows of a tile to the positions of its rays: see `RayFit`.

#pragma once

#include "cpu/ray_tree.h"

// Columns and rows of the rays of a tile whose packets have 1 << shift columns: see `RayFit`.
struct TileGrid {
    int shift, columns, rows;  // of a packet

    static inline TileGrid of(int shift) { return TileGrid{shift, 1 << shift, 1 << (RayFit::LANE_SHIFT - shift)}; }
    inline Floats column(int packet) const {
        const int first = packet % RayFit::PACKETS_ACROSS * columns;
        return __builtin_convertvector((Lanes::index() & (columns - 1)) + first, Floats);
    }
    inline Floats row(int packet) const {
        const int first = packet / RayFit::PACKETS_ACROSS * rows;
        return __builtin_convertvector((Lanes::index() >> shift) + first, Floats);
    }
    inline float across() const { return (float)(columns * RayFit::PACKETS_ACROSS); }
    inline float down() const { return (float)(rows * RayFit::PACKETS_ACROSS); }
    // Copy a tile's numbers to [row][column].
    inline void to_rows(const float* packets, float* to) const {
        const int width = columns * RayFit::PACKETS_ACROSS;
        for (int packet = 0; packet < LANES; ++packet) {
            const int column = packet % RayFit::PACKETS_ACROSS * columns, row = packet / RayFit::PACKETS_ACROSS * rows;
            for (int y = 0; y < rows; ++y)
                __builtin_memcpy(to + (row + y) * width + column, packets + packet * LANES + y * columns,
                                 columns * sizeof(float));
        }
    }
};

// The fit of a full tile, by least squares on its even grid: sums of columns, of rows and of their product are 0 about
// the middle. The conditions and error bounds are those of sorted_rays_cpu.py.
struct TileFit {
    static constexpr float MIN_DETERMINANT = 0.05f, MAX_ERROR = 0.75f, MARGIN = 1e-3f, ROUNDED = 2e-6f;

    TileGrid grid;
    float middle_column, middle_row;
    float middle[2], step[2][2], off[2];  // of u and v; along columns and rows; greatest deviation

    static inline TileFit of(int shift, const float* u, const float* v) {
        TileFit fit;
        fit.grid = TileGrid::of(shift);
        fit.middle_column = 0.5f * (fit.grid.across() - 1), fit.middle_row = 0.5f * (fit.grid.down() - 1);
        fit.set(0, u);
        fit.set(1, v);
        return fit;
    }
    inline void set(int k, const float* packets) {
        const float across = grid.across(), down = grid.down(), count = LANES * LANES;
        Floats sum = {}, by_column = {}, by_row = {};
        for (int packet = 0; packet < LANES; ++packet) {
            const Floats value = Lanes::load(packets + packet * LANES);
            sum += value;
            by_column += value * (grid.column(packet) - middle_column);
            by_row += value * (grid.row(packet) - middle_row);
        }
        middle[k] = Lanes::sum_of(sum) / count;
        step[k][0] = Lanes::sum_of(by_column) * 12.0f / (count * (across * across - 1));
        step[k][1] = Lanes::sum_of(by_row) * 12.0f / (count * (down * down - 1));
        Floats worst = {}, largest = {};
        for (int packet = 0; packet < LANES; ++packet) {
            const Floats value = Lanes::load(packets + packet * LANES);
            const Floats fitted = middle[k] + (step[k][0] * (grid.column(packet) - middle_column) +
                                               step[k][1] * (grid.row(packet) - middle_row));
            worst = Lanes::max(worst, Lanes::abs(fitted - value));
            largest = Lanes::max(largest, Lanes::abs(value));
        }
        off[k] = Lanes::max_of(worst) + ROUNDED * Lanes::max_of(largest);
    }

    // The words of the fit; no spacing if it does not meet the conditions.
    inline RayFit words() const {
        RayFit fit = RayFit();
        float size = 0.0f;
        for (int k = 0; k < 4; ++k) size = __builtin_fmaxf(size, __builtin_fabsf(step[k / 2][k % 2]));
        const float determinant = step[0][0] * step[1][1] - step[0][1] * step[1][0];
        if (!(__builtin_fabsf(determinant) > MIN_DETERMINANT * size * size)) return fit;
        fit.column_u = step[1][1] / determinant, fit.column_v = -step[0][1] / determinant;
        fit.row_u = -step[1][0] / determinant, fit.row_v = step[0][0] / determinant;
        fit.off_column = deviation(fit.column_u, fit.column_v), fit.off_row = deviation(fit.row_u, fit.row_v);
        fit.u = middle[0] - (step[0][0] * middle_column + step[0][1] * middle_row);
        fit.v = middle[1] - (step[1][0] * middle_column + step[1][1] * middle_row);
        fit.shift = (float)grid.shift;
        if (fit.off_column <= MAX_ERROR && fit.off_row <= MAX_ERROR) fit.spacing = size;
        return fit;
    }
    inline float deviation(float by_u, float by_v) const {
        return __builtin_fabsf(by_u) * off[0] + __builtin_fabsf(by_v) * off[1] + MARGIN;
    }
};
