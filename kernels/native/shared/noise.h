// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Common parts of models of depth sensors, for rows of pixels, as many at a time as Numbers holds.

#pragma once

#include "shared/random.h"

// Range of a sensor [m].
template <class Numbers>
struct SensorRange {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    float near, far;

    static inline Whole finite(Real depth) { return Numbers::abs(depth) < Numbers::endless(); }
    // The reported depth according to REP 117: inf beyond the range, -inf before it or if noise made depth 0.
    inline Real report(Real depth) const {
        const Real endless = Numbers::real(Numbers::endless());
        const Whole too_near = (depth < near) | !(depth > 0.0f);
        return depth > far ? endless : (too_near ? -endless : depth);
    }
    // Reason of a reported depth: valid if it is finite.
    static inline Whole reason(Real reported) {
        return finite(reported) ? Numbers::whole(REASON_VALID) : Numbers::whole(REASON_RANGE);
    }
};

#if defined(__CUDA_ARCH__)
// What the pixels of a thread report, which is stored together.
struct ThreadPixels {
    float reported[RANDOM_WORDS];
    unsigned char reasons[RANDOM_WORDS];

    // Load numbers, of which `count` exist; the others are infinite.
    template <int SIZE>
    static inline void load(const float* from, int count, float* to) {
        const bool is_aligned = ((unsigned long long)from & (sizeof(float4) - 1)) == 0;
#pragma unroll
        for (int k = 0; k < SIZE; k += 4) {
            if (is_aligned && k + 4 <= count) {
                const float4 four = *(const float4*)(from + k);
                to[k] = four.x, to[k + 1] = four.y, to[k + 2] = four.z, to[k + 3] = four.w;
                continue;
            }
#pragma unroll
            for (int i = k; i < k + 4; ++i) to[i] = i < count ? from[i] : OnePixel::endless();
        }
    }
};
#endif

// A row of a view, and images of all views, [view][y][x]; null if they are not used.
template <class Numbers>
struct SensorRow {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Double Double;
    typedef typename Numbers::Whole Whole;
    typedef SensorRange<Numbers> Range;
    typedef PixelWords<Numbers> Words;
    typedef PixelNormals<Numbers> Normals;

    int view, height, width, y;
    long long first;  // place of the view's first pixel in images
    RandomKey key;
    Range range;
    double focal[2], center[2];
    const double *column_slopes, *row_slopes;  // of rays; null if they are computed
    const float* depth;  // of the first surface
    const float* normals;  // xyz in the world
    const int* segmentation;
    const int* shown;  // index in the view of the pixel whose normal and object a pixel has; null: its own
    const float* reflectivity;  // [object]
    float* depth_out;
    unsigned char* reasons_out;
#if defined(__CUDA_ARCH__)
    mutable ThreadPixels own;
#endif

    template <class Inputs>
    static inline SensorRow of(const Inputs& inputs, int view, int y) {
        SensorRow row;
        row.view = view, row.y = y;
        row.depth_out = nullptr, row.reasons_out = nullptr;
        row.height = (int)inputs.camera.height, row.width = (int)inputs.camera.width;
        row.first = (long long)view * row.height * row.width;
        row.key = RandomKey{inputs.seed, inputs.draws.data[view][0], inputs.draws.data[view][1]};
        row.range = Range{inputs.camera.near, inputs.camera.far};
        row.focal[0] = inputs.camera.fx, row.focal[1] = inputs.camera.fy;
        row.center[0] = inputs.camera.cx, row.center[1] = inputs.camera.cy;
        row.column_slopes = inputs.column_slopes.data, row.row_slopes = inputs.row_slopes.data;
        row.depth = inputs.true_depth.data;
        row.normals = (const float*)inputs.normals.data;
        row.segmentation = inputs.segmentation.data;
        row.shown = inputs.shown.data;
        row.reflectivity = inputs.reflectivity.data;
        return row;
    }
    inline long long place(int x) const { return first + (long long)y * width + x; }
    inline int count(int x) const { return width - x; }
    // Whether pixels remain for word k of the random words that pixels from x on share.
    inline bool has_word(int x, int k) const { return k < Words::WORDS && x + k * Numbers::PIXELS < width; }
    inline Words draw(unsigned stream, int x) const { return Words::draw(key, stream, y, x); }
    inline Normals draw_normals(unsigned stream, int x) const { return Normals::of(draw(stream, x)); }

    // Slopes of the rays of columns and rows, in the camera frame. CUDA looks them up: divisions in double precision
    // would be much of the work of a pixel.
#if defined(__CUDA_ARCH__)
    inline Double across(Whole column) const { return column_slopes[column]; }
    inline Double down(Whole row) const { return row_slopes[row]; }
#else
    inline Double across(Whole column) const { return (Numbers::to_double(column) + 0.5 - center[0]) / focal[0]; }
    inline Double down(Whole row) const { return (Numbers::to_double(row) + 0.5 - center[1]) / focal[1]; }
#endif
    // Those of the pixels from x on, whose divisions take longer than a load.
    inline Double across_from(int x) const {
        if (Numbers::PIXELS > 1 && column_slopes) return Numbers::load(column_slopes + x, width - x);
        return across(Numbers::indices(x));
    }

    inline Real exact(int x) const { return Numbers::load(depth + place(x), width - x); }
    // Depth of pixels of any row, from a column on that may be outside of the image; `outside` for pixels that are.
    inline Real exact(int column, int row, float outside) const {
        const float* depths = depth + first + (long long)row * width;
        if (column >= 0 && column + Numbers::PIXELS <= width) return Numbers::load(depths + column, Numbers::PIXELS);
        return collect([&](int k) { return column + k >= 0 && column + k < width ? depths[column + k] : outside; });
    }
    inline void normal(int x, Real* xyz) const {
        if (!shows_others(x)) return Numbers::load_triples(normals + 3 * place(x), xyz, width - x);
        for (int i = 0; i < 3; ++i) xyz[i] = collect([&](int k) { return normals[3 * shown_place(x + k) + i]; });
    }
    inline bool shows_others(int x) const {
        if (!shown) return false;
        const Whole own = Numbers::indices(y * width + x);
        return Numbers::any((Numbers::load(shown + place(x), width - x) != own) & (Numbers::indices(x) < width));
    }
    // Place of the pixel that pixel x shows; of the last one of the row beyond its end.
    inline long long shown_place(int x) const {
        const long long own = place(x < width ? x : width - 1);
        return shown ? first + shown[own] : own;
    }
    // Reflectivity of the surfaces; 1 without a surface.
    inline Real reflectivities(int x) const {
        if (!segmentation) return Numbers::real(1.0f);
        return collect([&](int k) {
            const int object = x + k < width ? segmentation[shown_place(x + k)] : -1;
            return object < 0 ? 1.0f : reflectivity[object];
        });
    }
    // Numbers of pixels 0, 1, ... as a function returns them.
    template <class Function>
    static inline Real collect(const Function& function) {
        float values[Numbers::PIXELS];
        for (int k = 0; k < Numbers::PIXELS; ++k) values[k] = function(k);
        return Numbers::load(values, Numbers::PIXELS);
    }

#if defined(__CUDA_ARCH__)
    inline void write(int x, float depth, int reason) const {
        own.reported[x & (RANDOM_WORDS - 1)] = depth;
        own.reasons[x & (RANDOM_WORDS - 1)] = (unsigned char)reason;
    }
    inline void flush(int x) const {
        GroupStore<Numbers, float> depths = {depth_out + place(x), count(x)};
        GroupStore<Numbers, unsigned char> causes = {reasons_out + place(x), count(x)};
#pragma unroll
        for (int k = 0; k < RANDOM_WORDS; ++k) depths.put(k, own.reported[k]), causes.put(k, own.reasons[k]);
        if (depth_out) depths.flush();
        if (reasons_out) causes.flush();
    }
#else
    inline void write(int x, Real reported, Whole reason) const {
        Numbers::store(depth_out + place(x), reported, width - x);
        if (reasons_out) Numbers::store(reasons_out + place(x), reason, width - x);
    }
    inline void flush(int) const {}
#endif
};

#if defined(__CUDA_ARCH__)
// Depths of the pixels of a thread and of as many on both sides, in its row or `lag` rows below.
struct DepthStrip {
    enum { REACH = RANDOM_WORDS, COUNT = RANDOM_WORDS + 2 * REACH };
    float depths[COUNT];

    // Pixels outside of the image have infinite depth.
    static inline DepthStrip of(const SensorRow<OnePixel>& row, int x, int lag = 0) {
        const bool is_inside = row.y + lag >= 0 && row.y + lag < row.height;
        const float* from = row.depth + row.place(x) + (long long)lag * row.width;
        DepthStrip strip;
        for (int part = -1; part <= 1; ++part) {
            const int first = x + part * REACH;
            load(from + part * REACH, is_inside && first >= 0 ? row.count(first) : 0,
                 strip.depths + (part + 1) * REACH);
        }
        return strip;
    }
    static inline void load(const float* from, int count, float* to) { ThreadPixels::load<REACH>(from, count, to); }
    // The depth of a neighbor of pixel k of the thread.
    inline float at(int k, int lag) const { return depths[REACH + k + lag]; }
};
#endif

// A row of a `SensorInputs`, and of the `MeasuredImages` that are written, of kernels/sensors/noise.py.
template <class Inputs>
inline SensorRow<PixelNumbers> sensor_row(const Inputs& inputs, int view, int y) {
    return SensorRow<PixelNumbers>::of(inputs, view, y);
}
template <class Inputs, class Images>
inline SensorRow<PixelNumbers> sensor_row(const Inputs& inputs, const Images& images, int view, int y) {
    SensorRow<PixelNumbers> row = sensor_row(inputs, view, y);
    row.depth_out = images.depth.data;
    row.reasons_out = images.reasons.data;
    return row;
}

// Measure the pixels of a thread with a sensor: a struct of a row, its model, and other data of the view.
template <template <class...> class Sensor, class... Data>
inline void measure(const SensorRow<PixelNumbers>& row, int x, const Data&... data) {
    const Sensor<PixelNumbers, Data...> sensor = {row, data...};
    for_pixels<PixelNumbers>(row.width, x, [&](int column) {
        sensor.measure(column);
        row.flush(column);
    });
}
