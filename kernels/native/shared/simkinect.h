// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The Kinect model of Handa's simkinect: `warpvis.sensors.SimKinect`. Disparities are integers in 1/8 px throughout, so
// that sums over windows are exact in any order.

#pragma once

#include "shared/noise.h"

constexpr float DISPARITY_LEVELS = 8.0f;  // per pixel
// From this level on a pixel is empty, which prevents overflow of window sums: a depth of 3.4e-5 m by default.
constexpr float MAX_LEVEL = 8388608.0f;
constexpr int DOT_REACH = 4;  // half width of a dot's window, without the center [px]
// Largest deviation from the window's mean, in levels, at which a disparity at the window's center is near it; the same
// elsewhere, times the squared distance from the center: 0.1 px by weights of 1 / (1.2^2 r^2).
constexpr float NEAR_MEAN = 0.8f, NEAR_MEAN_SCALE = 1.152f;
constexpr float STEPS_AT_UNIT = 35130.0f;  // disparity in steps at a depth of one unit

// Disparity in levels from bilinear depth at shifted positions; 0 where there is no depth.
template <class Numbers>
struct ShiftedLevels {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    int width, height;
    const float* depth;  // of a view

    // Depth of pixels; 0 if it is not finite or outside of the image.
    inline Real depth_or_zero(Whole row, Whole column) const {
        const Whole is_inside = (row < height) & (column < width);
        const Real found = Numbers::gather(depth, is_inside ? row * width + column : Numbers::whole(0));
        return is_inside ? finite_or_zero(found) : Numbers::real(0.0f);
    }
    static inline Real finite_or_zero(Real depth) {
        return Numbers::abs(depth) < Numbers::endless() ? depth : Numbers::real(0.0f);
    }
    // Depth of pixels and of those on their right.
    inline void load_pair(Whole row, Whole column, bool are_inside, Real* pair) const {
        if (are_inside) {
            Numbers::gather_pairs(depth, row * width + column, pair);
            for (int k = 0; k < 2; ++k) pair[k] = finite_or_zero(pair[k]);
        } else {
            for (int k = 0; k < 2; ++k) pair[k] = depth_or_zero(row, column + k);
        }
    }
    static inline Real clamped(Real position, int size) {
        return Numbers::min(Numbers::max(position, Numbers::real(0.0f)), Numbers::real((float)size));
    }
    inline Whole of(Real column, float row, Real shift_across, Real shift_down, float scale) const {
        const Real across = clamped(column + shift_across, width), down = clamped(row + shift_down, height);
        const Whole left = Numbers::truncate(across), top = Numbers::truncate(down);
        const Real right = across - Numbers::to_real(left), below = down - Numbers::to_real(top);
        const bool are_inside = Numbers::all((left < width - 1) & (top < height - 1));
        Real above[2], under[2];
        load_pair(top, left, are_inside, above);
        load_pair(top + 1, left, are_inside, under);
        const Real upper = (1.0f - right) * above[0] + right * above[1];
        const Real lower = (1.0f - right) * under[0] + right * under[1];
        const Real between = (1.0f - below) * upper + below * lower;
        const Real level = Numbers::round(DISPARITY_LEVELS * (scale / (between + 1.0e-10f)));
        const Whole is_level = level < MAX_LEVEL;
        return is_level ? Numbers::truncate(is_level ? level : Numbers::real(0.0f)) : Numbers::whole(0);
    }
};

// The levels of rows of pixels, at randomly shifted positions.
template <class Numbers, class Model, class Levels>
struct LevelShift {
    typedef typename Numbers::Whole Whole;
    const SensorRow<Numbers>& row;
    const Model& model;
    const Levels& levels;

    inline void measure(int x) const {
        const ShiftedLevels<Numbers> shifted = {row.width, row.height, row.depth + row.first};
        const PixelNormals<Numbers> across = row.draw_normals(STREAM_ACROSS, x),
                                    down = row.draw_normals(STREAM_DOWN, x);
        GroupStore<Numbers, int> stored = {levels.data + row.place(x), row.count(x)};
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k) {
            const Whole found =
                shifted.of(Numbers::columns(x + k * Numbers::PIXELS), (float)row.y, model.shift * across.block[k],
                           model.shift * down.block[k], model.disparity_scale);
            stored.put(k, found);
        }
        stored.flush();
    }
};

// A dot is detected if its window receives enough light from dots near its mean. `Numbers` hold columns of a window.
template <class Numbers>
struct DotWindow {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    int width, dots_width;
    const int* levels;  // at the dot
    const unsigned char* dots;
    int count;  // of columns of the image and the pattern from the window's center on

    // Call a function with the levels and the dots of parts of the window's rows, 0 outside of the window, and with
    // their squared distances from the center.
    template <class Function>
    inline void each(const Function& function) const {
        for (int row = -DOT_REACH; row <= DOT_REACH; ++row)
            for (int column = -DOT_REACH; column <= DOT_REACH; column += Numbers::PIXELS) {
                const Whole columns = Numbers::indices(column), is_inside = columns <= DOT_REACH;
                const Whole none = Numbers::whole(0);
                const Whole level = Numbers::load(levels + (long long)row * width + column, count - column);
                const Whole dot = Numbers::load(dots + (long long)row * dots_width + column, count - column);
                function(is_inside ? level : none, is_inside ? dot : none, columns * columns + row * row);
            }
    }
    inline bool is_detected() const {
        const Whole none = Numbers::whole(0);
        Whole number = none, total = none, light = none;
        each([&](Whole level, Whole dot, Whole) {
            total += level;
            number += level > 0 ? Numbers::whole(1) : none;
            light += dot;
        });
        const int levels_number = Numbers::sum(number), levels_total = Numbers::sum(total);
        Whole found = none;
        each([&](Whole level, Whole dot, Whole squared) {
            const Real scaled = NEAR_MEAN_SCALE * Numbers::to_real(squared);
            const Real share = squared > 0 ? scaled : Numbers::real(NEAR_MEAN);
            const Real difference = Numbers::abs(Numbers::to_real(level * levels_number - levels_total));
            const Whole is_near = (level > 0) & (difference < share * (float)levels_number);
            found += is_near ? dot : none;
        });
        // More than 1 / 1.2 of the light in the window.
        return 6 * Numbers::sum(found) > 5 * Numbers::sum(light);
    }
};

// The same for one dot, given where the dots of its window are: bits of three rows in each of three words.
struct ListedDot {
    enum { SIDE = 2 * DOT_REACH + 1, ROWS_OF_WORD = 3 };
    int width, dots_width;
    const int* levels;  // at the upper left corner of the window, as is the next one
    const unsigned char* dots;

    static inline int first_bit(unsigned word) {
#if defined(__CUDA_ARCH__)
        return __ffs(word) - 1;
#else
        return __builtin_ctz(word);
#endif
    }
    template <class Words>
    inline bool is_detected(const Words& words) const {
        int number = 0, total = 0;
        for (int row = 0; row < SIDE; ++row) {
            const int* of_row = levels + (long long)row * width;
#pragma unroll
            for (int column = 0; column < SIDE; ++column) {
                const int level = of_row[column];
                total += level;
                number += level > 0;
            }
        }
        int found = 0, light = 0;
        for (int part = 0; part < SIDE / ROWS_OF_WORD; ++part)
            for (unsigned word = words[part]; word; word &= word - 1) {
                const int bit = first_bit(word), row = bit / SIDE, column = bit - SIDE * row;
                const int y = row + ROWS_OF_WORD * part, down = y - DOT_REACH, across = column - DOT_REACH;
                const int level = levels[(long long)y * width + column], dot = dots[(long long)y * dots_width + column];
                const int squared = across * across + down * down;
                const float share = squared > 0 ? NEAR_MEAN_SCALE * (float)squared : NEAR_MEAN;
                const float difference = OnePixel::abs((float)(level * number - total));
                light += dot;
                found += level > 0 && difference < share * (float)number ? dot : 0;
            }
        return 6 * found > 5 * light;
    }
};

// Write the level of the dot at a pixel if it is detected.
template <class Dots, class Words, class Levels>
inline void detect_dot(const Dots& dots, int pixel, const Words& words, const Levels& levels, int view,
                       const Levels& detected) {
    const int height = levels.shape[1], width = levels.shape[2], dots_width = dots.shape[1];
    const int y = pixel / width, x = pixel - width * y, top = y - DOT_REACH, left = x - DOT_REACH;
    const long long first = (long long)view * height * width;
    const ListedDot dot = {width, dots_width, levels.data + first + (long long)top * width + left,
                           dots.data + (long long)top * dots_width + left};
    if (dot.is_detected(words)) detected.data[first + pixel] = levels.data[first + pixel];
}

// A row of the images of dots.
struct DotImages {
    int width, dots_width;
    bool has_windows;  // whether the windows of the row are inside the image and the pattern
    int end;  // first column from DOT_REACH on whose window is not
    const int* levels;
    const unsigned char* dots;
    int* detected;  // levels of detected dots, 0 elsewhere
};

// Writes the detected dots for the pixels of a thread: for a row in cpu/dot_rows.h.
template <class Numbers>
struct DotRow {
    const DotImages& images;

    inline void detect(int x) const {
        for_groups<1>(images.width, x, [&](int column) {
            int level = 0;
            if (images.has_windows && column >= DOT_REACH && column < images.end && images.dots[column]) {
                const int* place = images.levels + column;
                const DotWindow<Numbers> window = {images.width, images.dots_width, place, images.dots + column,
                                                   images.end + DOT_REACH + 1 - column};
                if (window.is_detected()) level = *place;
            }
            images.detected[column] = level;
        });
    }
};

template <class Numbers, class Dots, class Levels>
inline void detect_dots(const Dots& dots, const Levels& levels, int view, int y, int x, const Levels& detected) {
    const int height = levels.shape[1], width = levels.shape[2], dots_width = dots.shape[1];
    const int rows = height < dots.shape[0] ? height : dots.shape[0], columns = width < dots_width ? width : dots_width;
    const long long first = ((long long)view * height + y) * width;
    const bool has_windows = y >= DOT_REACH && y < rows - DOT_REACH - 1;
    const unsigned char* row = dots.data + (has_windows ? (long long)y * dots_width : 0);
    const DotImages images = {width, dots_width,           has_windows, columns - DOT_REACH - 1, levels.data + first,
                              row,   detected.data + first};
    DotRow<Numbers>{images}.detect(x);
}

// Levels of the detected dots that are nearest to pixels, 0 if none is near: for a row in cpu/dot_rows.h. `nearest`
// contains column and row offsets by increasing distance, of at most DOT_REACH.
template <class Numbers, class Offsets>
struct NearestDots {
    typedef typename Numbers::Whole Whole;
    int width, height;
    const int* detected;  // of a view
    const Offsets& nearest;
    const unsigned* words;  // bits of the offsets of each pixel at which the pattern has dots; null if unknown

    // Find them for the pixels of a thread from x on.
    inline void find(int x, int y, Whole* levels) const {
        UNROLL_ON_CUDA
        for (int k = 0; k < PixelWords<Numbers>::WORDS && x + k < width; ++k)
            levels[k] = words ? listed_level_at(x + k, y) : level_at(x + k, y);
    }
    inline int listed_level_at(int x, int y) const {
        const int place = y * width + x;
        for (unsigned word = words[place]; word; word &= word - 1) {
            const auto& offset = nearest.data[ListedDot::first_bit(word)];
            if (const int level = detected[place + offset[1] * width + offset[0]]) return level;
        }
        return 0;
    }
    inline int level_at(int x, int y) const {
        for (int i = 0; i < nearest.shape[0]; ++i) {
            const int column = x + nearest.data[i][0], row = y + nearest.data[i][1];
            if (column < 0 || column >= width || row < 0 || row >= height) continue;
            if (const int level = detected[(long long)row * width + column]) return level;
        }
        return 0;
    }
};

// Depth of the nearest detected dots, as quantized disparity with noise.
template <class Numbers, class Model, class Levels, class Offsets, class Words>
struct DotFill {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    const SensorRow<Numbers>& row;
    const Model& model;
    const Levels& detected;
    const Offsets& nearest;
    const Words& words;

    inline void measure(int x) const {
        const NearestDots<Numbers, Offsets> dots = {row.width, row.height, detected.data + row.first, nearest,
                                                    words.data};
        const PixelNormals<Numbers> normals = row.draw_normals(STREAM_DISPARITY, x);
        Whole levels[PixelWords<Numbers>::WORDS];
        dots.find(x, row.y, levels);
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k) measure_pixels(x + k * Numbers::PIXELS, levels[k], normals.block[k]);
    }
    inline void measure_pixels(int x, Whole level, Real normal) const {
        const Whole has_level = level > 0;
        const Real endless = Numbers::real(Numbers::endless()), none = Numbers::real(Numbers::no_number());
        const Real units =
            Numbers::round(model.disparity_scale / (Numbers::to_real(level) / DISPARITY_LEVELS) * model.units);
        const Real steps = Numbers::round(STEPS_AT_UNIT / units + model.sigma * normal + 0.5f);
        // Depth is infinite below the first step of disparity.
        const Real reported = row.range.report(steps > 0.0f ? STEPS_AT_UNIT / steps / model.units : endless);
        const Whole has_surface = SensorRange<Numbers>::finite(row.exact(x));
        const Whole lost = has_surface ? Numbers::whole(REASON_EDGE) : Numbers::whole(REASON_EMPTY);
        row.write(x, has_level ? reported : (has_surface ? none : endless),
                  has_level ? SensorRange<Numbers>::reason(reported) : lost);
    }
};
