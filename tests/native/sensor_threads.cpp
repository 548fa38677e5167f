// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Formulas of depth cameras for one pixel, over random images: as a thread of a GPU runs them, if EMULATES_CUDA is
// defined, or row by row. Prints what they write; images have any width, and begin at multiples of 16 bytes.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#if defined(EMULATES_CUDA)
#define __CUDA_ARCH__ 900
struct float4 {
    float x, y, z, w;
};
struct int4 {
    int x, y, z, w;
};
struct uchar4 {
    unsigned char x, y, z, w;
};
static float4 make_float4(float x, float y, float z, float w) { return {x, y, z, w}; }
static int4 make_int4(int x, int y, int z, int w) { return {x, y, z, w}; }
static uchar4 make_uchar4(unsigned char x, unsigned char y, unsigned char z, unsigned char w) { return {x, y, z, w}; }
template <class To, class From>
static To bits(From from) {
    To to;
    memcpy(&to, &from, sizeof to);
    return to;
}
static unsigned __float_as_uint(float a) { return bits<unsigned>(a); }
static float __uint_as_float(unsigned a) { return bits<float>(a); }
static float __fsqrt_rn(float a) { return sqrtf(a); }
static double __dsqrt_rn(double a) { return sqrt(a); }
#endif

namespace warpvis {
struct OnePixel;
typedef OnePixel PixelNumbers;
#include "shared/fattening.h"
#include "shared/kinect.h"
#include "shared/stereo.h"
#include "shared/time_of_flight.h"
}  // namespace warpvis

template <class Number>
struct Array {
    Number* data;
    int shape[3];
};
template <class Number, int COUNT>
struct Vector {
    Number values[COUNT];
    Number operator[](int k) const { return values[k]; }
};
struct Camera {
    float width, height;
    double fx, fy, cx, cy;
    float near, far;
};
struct Inputs {
    Camera camera;
    Array<float> true_depth, normals;
    Array<int> segmentation, shown;
    Array<float> reflectivity;
    Array<double> column_slopes, row_slopes;
    Array<Vector<unsigned, 2>> draws;
    unsigned seed;
};
struct Images {
    Array<float> depth;
    Array<unsigned char> reasons;
};
struct FatteningModel {
    float disparity_scale, step;
    int reach;
    bool along_columns;
};
struct KhoshelhamModel {
    float step, sigma;
    int rounds;
};
struct Axes {
    float data[3][3];
};
struct Eye {
    double place[3];
    Axes axes;
};
struct SmoothField {
    Array<float> nodes;
    int spacing;
    Array<Vector<float, 2>> weights;
    Array<int> column_nodes;
    Array<float> left_weights, right_weights;
};
struct StereoModel {
    float disparity_scale = 10, shift_scale = 10, first_column = 0, last_column, max_disparity = 100;
    float shadow_tolerance = 1 / 64.0f, min_support = 0.6f, min_signal = 0.05f, signal_slope = 2, detection_rate = 0.9f;
    float sigma = 0.1f, locking = 0, levels = 8;
    int window;
    float edge_step = 1, other_width, added_columns = 0, min_depth = 0.1f;
    Array<float> other_depth;
    SmoothField noise = {}, holes = {};
    Array<float> column_slopes, row_slopes;
};

// Numbers at a multiple of 16 bytes.
template <class Number>
struct Aligned {
    std::vector<Number> memory;
    size_t count;

    explicit Aligned(size_t number) : memory(number + 16, Number()), count(number) {}
    Number* data() {
        const size_t address = (size_t)memory.data();
        return (Number*)((address + 15) / 16 * 16);
    }
    void print() {
        for (size_t i = 0; i < count; ++i) {
            unsigned shown = 0;
            memcpy(&shown, data() + i, sizeof(Number));
            printf("%x ", shown);
        }
        printf("\n");
    }
};

static int random_below(int end) { return rand() % end; }

// Run a function for all threads of all rows.
template <class Function>
static void launch(int views, int height, int width, const Function& function) {
#if defined(EMULATES_CUDA)
    const int threads = (width + warpvis::RANDOM_WORDS - 1) / warpvis::RANDOM_WORDS;
#else
    const int threads = width ? 1 : 0;
#endif
    for (int view = 0; view < views; ++view)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < threads; ++x) function(view, y, x);
}

static void check(int number) {
    using namespace warpvis;
    const int views = 2, height = 1 + random_below(20);
    const int width = number % 2 ? 4 * (1 + random_below(12)) : 1 + random_below(50);
    const int count = views * height * width;
    Aligned<float> depth(count), normals(3 * count), other(count), measured(count), points(2 * count);
    Aligned<int> shown(count), edges(count);
    Aligned<unsigned char> reasons(count);
    const bool is_smooth = number % 3 == 0;
    const float values[] = {0.5f, 1.0f, 2.0f, INFINITY, 1.02f};
    for (int i = 0; i < count; ++i) {
        depth.data()[i] = is_smooth && random_below(40) ? 1.0f : values[random_below(5)];
        other.data()[i] = values[random_below(5)];
        for (int k = 0; k < 3; ++k)
            normals.data()[3 * i + k] = is_smooth ? -(float)(k == 2) : 0.01f * random_below(100) - 0.5f;
    }
    std::vector<double> columns, rows;
    for (int x = 0; x < width; ++x) columns.push_back((x + 0.5 - width / 2.0) / 50.0);
    for (int y = 0; y < height; ++y) rows.push_back((y + 0.5 - height / 2.0) / 50.0);
    std::vector<float> across(columns.begin(), columns.end()), down(rows.begin(), rows.end());
    Vector<unsigned, 2> draws[views] = {{{3, 4}}, {{5, 6}}};

    Inputs inputs = {};
    inputs.camera = {(float)width, (float)height, 50, 50, width / 2.0, height / 2.0, 0.3f, 5.0f};
    inputs.true_depth.data = depth.data(), inputs.draws.data = draws, inputs.seed = 9;
    inputs.column_slopes.data = columns.data(), inputs.row_slopes.data = rows.data();
    for (int variant = 0; variant < 4; ++variant) {
        const FatteningModel model = {10.0f, 2.0f, 1 + random_below(6), variant % 2 == 1};
        const Array<float> depth_out = {measured.data(), {views, height, width}};
        const Array<int> shown_out = {variant < 2 ? shown.data() : nullptr, {views, height, width}};
        launch(views, height, width, [&](int view, int y, int x) {
            measure<Fattening>(sensor_row(inputs, view, y), x, model, depth_out, shown_out);
        });
        measured.print();
        if (variant < 2) shown.print();
    }

    const Images images = {{measured.data(), {views, height, width}}, {reasons.data(), {views, height, width}}};
    const KhoshelhamModel khoshelham = {2.85e-3f, 0.4f, 1};
    launch(views, height, width,
           [&](int view, int y, int x) { measure<Khoshelham>(sensor_row(inputs, images, view, y), x, khoshelham); });
    measured.print(), reasons.print();

    inputs.normals.data = normals.data();
    const Axes axes = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    const Array<int> edges_out = {edges.data(), {views, height, width}};
    launch(views, height, width, [&](int view, int y, int x) {
        measure<FlightEdges>(sensor_row(inputs, view, y), x, axes, 0.02f, edges_out);
    });
    edges.print();

    const Eye eye = {{0.1, 0.0, 0.0}, axes};
    StereoModel model;
    model.last_column = model.other_width = (float)width, model.window = random_below(6);
    model.other_depth.data = other.data();
    model.column_slopes.data = across.data(), model.row_slopes.data = down.data();
    const Array<float> points_out = {points.data(), {views, height, width}}, limits_out = {nullptr, {0, 0, 0}};
    launch(views, height, width, [&](int view, int y, int x) {
        measure<Stereo>(sensor_row(inputs, images, view, y), x, model, eye);
        measure<OtherPoints>(sensor_row(inputs, view, y), x, model, eye, points_out, limits_out);
    });
    measured.print(), reasons.print(), points.print();
}

int main() {
    srand(1);
    for (int number = 0; number < 60; ++number) check(number);
}
