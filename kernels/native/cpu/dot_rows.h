// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The dots of rows of pixels.

#pragma once

#include "cpu/random_lanes.h"
#include "shared/simkinect.h"

// Detection of dots: sums over windows are made for all pixels of a row, first of columns.
template <>
struct DotRow<PixelLanes> {
    // Windows whose sums are made together, from a first column on.
    enum { WINDOWS = 16 * LANES, SIDE = 2 * DOT_REACH + 1, COLUMNS = WINDOWS + LANES };
    typedef int Octet __attribute__((ext_vector_type(8)));
    typedef float OctetFloats __attribute__((ext_vector_type(8)));

    const DotImages& images;

    inline void detect(int) const {
        __builtin_memset(images.detected, 0, images.width * sizeof(int));
        if (!images.has_windows) return;
        for (int first = 0; first + DOT_REACH < images.end; first += WINDOWS) detect_from(first);
    }
    // Detect the dots in the middle of windows from a column on.
    inline void detect_from(int first) const {
        int totals[COLUMNS], numbers[COLUMNS];
        const int windows = images.end - DOT_REACH - first, count = windows < WINDOWS ? windows : (int)WINDOWS;
        for (int i = 0; i < count + SIDE - 1; i += LANES) add_columns(first + i, totals + i, numbers + i);
        for (int i = 0; i < count; i += LANES) {
            const int center = first + i + DOT_REACH;
            const Ints dots = PixelLanes::load(images.dots + center, images.end - center);
            const unsigned bits = Lanes::bits(dots > 0);
            if (!bits) continue;
            int total[LANES], number[LANES];
            Lanes::store(total, sum(totals + i));
            Lanes::store(number, sum(numbers + i));
            for (const int k : Lanes::each(bits))
                if (is_detected(center + k, total[k], number[k]))
                    images.detected[center + k] = images.levels[center + k];
        }
    }
    // Sums of levels, and numbers of those above 0, in the rows of windows.
    inline void add_columns(int column, int* totals, int* numbers) const {
        Ints total = Lanes::all_ints(0), number = total;
        for (int row = -DOT_REACH; row <= DOT_REACH; ++row) {
            const Ints level =
                PixelLanes::load(images.levels + (long long)row * images.width + column, images.width - column);
            total += level;
            number -= level > 0;
        }
        Lanes::store(totals, total);
        Lanes::store(numbers, number);
    }
    static inline Ints sum(const int* columns) {
        Ints total = Lanes::all_ints(0);
        for (int k = 0; k < SIDE; ++k) total += Lanes::load(columns + k);
        return total;
    }

    // Sums of a `DotWindow` over eight of its places at a time: eight columns of each row, the rest of the last column,
    // and one place.
    inline bool is_detected(int center, int total, int number) const {
        const int* levels = images.levels + center;
        const unsigned char* dots = images.dots + center;
        const long long width = images.width, dots_width = images.dots_width;
        const Near near = {total, number};
        const Octet steps = {-4, -3, -2, -1, 0, 1, 2, 3};
        Octet found = (Octet)(0), light = found, last_levels, last_dots;
#pragma unroll
        for (int row = -DOT_REACH; row <= DOT_REACH; ++row) {
            const int* in_row = levels + row * width;
            const unsigned char* dots_in_row = dots + row * dots_width;
            Octet level;
            Bytes bytes;
            __builtin_memcpy(&level, in_row - DOT_REACH, sizeof level);
            __builtin_memcpy(&bytes, dots_in_row - DOT_REACH, sizeof bytes);
            const Octet dot = __builtin_convertvector(bytes, Octet);
            found += near.of(level, steps * steps + row * row) & dot;
            light += dot;
            if (row == DOT_REACH) continue;
            last_levels[row + DOT_REACH] = in_row[DOT_REACH];
            last_dots[row + DOT_REACH] = dots_in_row[DOT_REACH];
        }
        found += near.of(last_levels, steps * steps + DOT_REACH * DOT_REACH) & last_dots;
        light += last_dots;
        const int corner = dots[DOT_REACH * dots_width + DOT_REACH];
        const Octet at_corner =
            near.of((Octet)(levels[DOT_REACH * width + DOT_REACH]), (Octet)(2 * DOT_REACH * DOT_REACH));
        const int found_light = __builtin_reduce_add(found) + (at_corner[0] & corner);
        return 6 * found_light > 5 * (__builtin_reduce_add(light) + corner);
    }
    typedef unsigned char Bytes __attribute__((ext_vector_type(8)));

    // Which levels are near the mean of a window.
    struct Near {
        int total, number;

        inline Octet of(Octet level, Octet squared) const {
            const OctetFloats scaled = NEAR_MEAN_SCALE * __builtin_convertvector(squared, OctetFloats);
            const OctetFloats share = squared > 0 ? scaled : (OctetFloats)(NEAR_MEAN);
            const OctetFloats difference =
                __builtin_elementwise_abs(__builtin_convertvector(level * number - total, OctetFloats));
            return (level > 0) & (difference < share * (float)number);
        }
    };
};

// The nearest dots of 64 pixels: nearer dots replace farther ones.
template <class Offsets>
struct NearestDots<PixelLanes, Offsets> {
    enum { WORDS = PixelWords<PixelLanes>::WORDS, PIXELS = PixelWords<PixelLanes>::PIXELS, SIDE = 2 * DOT_REACH + 1 };
    int width, height;
    const int* detected;
    const Offsets& nearest;
    const unsigned* words;  // not used

    inline void find(int x, int y, Ints* levels) const {
        if (x >= DOT_REACH && x + PIXELS + DOT_REACH <= width)
            return find_in(detected + (long long)y * width + x, width, y, levels);
        // At the ends of a row, in a copy that is 0 beyond them.
        int padded[SIDE][PIXELS + 2 * DOT_REACH] = {};
        const int first = x < DOT_REACH ? 0 : x - DOT_REACH, end = x + PIXELS + DOT_REACH;
        const int count = (end < width ? end : width) - first;
        for (int k = 0; k < SIDE; ++k) {
            const int row = y + k - DOT_REACH;
            if (row < 0 || row >= height) continue;
            __builtin_memcpy(padded[k] + (first - (x - DOT_REACH)), detected + (long long)row * width + first,
                             count * sizeof(int));
        }
        find_in(padded[DOT_REACH] + DOT_REACH, PIXELS + 2 * DOT_REACH, y, levels);
    }
    // Find them for pixels from an address on, in rows of a length.
    inline void find_in(const int* from, int stride, int y, Ints* levels) const {
        Ints found[WORDS] = {};
        for (int i = nearest.shape[0] - 1; i >= 0; --i) {
            const auto& offset = nearest.data[i];
            const int row = y + offset[1];
            if (row < 0 || row >= height) continue;
            const int* others = from + (offset[1] * (long long)stride + offset[0]);
            for (int k = 0; k < WORDS; ++k) {
                const Ints other = PixelLanes::load(others + k * LANES, LANES);
                found[k] = other > 0 ? other : found[k];
            }
        }
        for (int k = 0; k < WORDS; ++k) levels[k] = found[k];
    }
};
