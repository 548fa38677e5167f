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
    const double* column_slopes;  // [x]; null if they are computed
    const float* depth;  // of the first surface
    const float* normals;  // xyz in the world
    const int* segmentation;
    const int* shown;  // index in the view of the pixel whose normal and object a pixel has; null: its own
    const float* reflectivity;  // [object]
    float* depth_out;
    unsigned char* reasons_out;

    template <class Inputs>
    static inline SensorRow of(const Inputs& inputs, int view, int y) {
        SensorRow row;
        row.view = view, row.y = y;
        row.height = (int)inputs.camera.height, row.width = (int)inputs.camera.width;
        row.first = (long long)view * row.height * row.width;
        row.key = RandomKey{inputs.seed, inputs.draws.data[view][0], inputs.draws.data[view][1]};
        row.range = Range{inputs.camera.near, inputs.camera.far};
        row.focal[0] = inputs.camera.fx, row.focal[1] = inputs.camera.fy;
        row.center[0] = inputs.camera.cx, row.center[1] = inputs.camera.cy;
        row.column_slopes = inputs.column_slopes.data;
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

    // Slopes of the rays of columns and rows, in the camera frame.
    inline Double across(Whole column) const { return (Numbers::to_double(column) + 0.5 - center[0]) / focal[0]; }
    inline Double down(Whole row) const { return (Numbers::to_double(row) + 0.5 - center[1]) / focal[1]; }
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

    inline void write(int x, Real reported, Whole reason) const {
        Numbers::store(depth_out + place(x), reported, width - x);
        if (reasons_out) Numbers::store(reasons_out + place(x), reason, width - x);
    }
};

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
    for_pixels<PixelNumbers>(row.width, x, [&](int column) { sensor.measure(column); });
}
