// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Sub-rays of pixels at edges, and their mixed light: `mixing` of `warpvis.sensors.TimeOfFlight`.
//
// A map has tiles of 16 columns and rows, side by side. A tile belongs to 16 pixels in row-major order, each with a
// block of 4 x 4 sub-rays. A list, of one row, has the sub-rays of one pixel after the other.

#pragma once

#include "shared/time_of_flight.h"

enum { SUB_RAYS = BLOCK_SIDE * BLOCK_SIDE };  // of a pixel; as many pixels share a tile

// What sub-rays of a view show, from the first one of a tile on; `segmentation` is null if it is not used.
struct SubRayMap {
    bool is_list;
    int stride;  // distance of the rows of a pixel's sub-rays
    const float* depth;
    const float* normals;
    const int* segmentation;

    template <class Depth, class Normals, class Objects>
    static inline SubRayMap of(const Depth& depth, const Normals& normals, const Objects& objects, int view, int tile) {
        const bool is_list = depth.shape[1] == 1;
        const int width = depth.shape[2];
        const long long first =
            (long long)view * depth.shape[1] * width + (long long)tile * SUB_RAYS * (is_list ? SUB_RAYS : 1);
        return SubRayMap{is_list, is_list ? (int)BLOCK_SIDE : width, depth.data + first,
                         (const float*)(normals.data + first), objects.data ? objects.data + first : nullptr};
    }
    // Place of the first sub-ray of pixels of the tile.
    template <class Whole>
    inline Whole corner(Whole in_tile) const {
        const int side = BLOCK_SIDE, rays = SUB_RAYS;
        const Whole row = in_tile / side;
        if (is_list) return rays * in_tile;
        return side * (row * stride + (in_tile - side * row));
    }
};

// Mixed light of the sub-rays of pixels at edges.
template <class Numbers, class Model, class Inputs, class Axes>
struct FlightMix {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Double Double;
    typedef typename Numbers::Whole Whole;
    enum { MAX_FREQUENCIES = 3 };
    const Model& model;
    const Inputs& inputs;
    const Axes& axes;  // of the camera in the world
    const SubRayMap& map;
    Whole pixel;  // row-major, -1 for none
    Whole corner;  // of the sub-rays of each pixel, from the first one on

    // Sums over the sub-rays of each pixel.
    struct Sums {
        Double real[MAX_FREQUENCIES], imaginary[MAX_FREQUENCIES], all, straight;
    };

    static inline Double none() { return Numbers::wide(Numbers::real(0.0f)); }
    static inline Double absolute(Double a) { return a < 0.0 ? -a : a; }

    // Angles of phasors in [0, 1) [cycles], by a polynomial with an error below 2e-12.
    static inline Double angle(Double x, Double y) {
        const Double across = absolute(x), up = absolute(y);
        const Double small = across < up ? across : up, large = across > up ? across : up;
        const Double t = small / large, s = t * t;
        Double total = s * 6.846281285625003e-05 - 0.0005190813772065897;
        total = total * s + 0.0018465664310945834;
        total = total * s - 0.004181249885153829;
        total = total * s + 0.006987357495699451;
        total = total * s - 0.009610647637873044;
        total = total * s + 0.011940171744691598;
        total = total * s - 0.014405332246503474;
        total = total * s + 0.017675200770167324;
        total = total * s - 0.022735701388264275;
        total = total * s + 0.031830957350162684;
        total = total * s - 0.05305164715890183;
        total = total * s + 0.1591549430903502;
        Double turns = total * t;
        turns = up > across ? 0.25 - turns : turns;
        turns = x < 0.0 ? 0.5 - turns : turns;
        turns = y < 0.0 ? 1.0 - turns : turns;
        turns = turns < 1.0 ? turns : none();
        return large == 0.0 ? none() : turns;
    }
    // Ranges that fit the phases of all frequencies best, and the phase of the first one exactly.
    inline Double unwrap(const Double* phases) const {
        Double best = none(), min_error = Numbers::wide(Numbers::real(Numbers::endless()));
        for (int lap = 0; lap < model.laps; ++lap) {
            const Double found = (phases[0] + (double)lap) / model.turns[0];
            Double error = none();
#pragma unroll
            for (int k = 1; k < MAX_FREQUENCIES; ++k) {
                if (k >= model.frequencies) continue;
                Double difference = phases[k] - model.turns[k] * found;
                difference = difference - Numbers::floor(difference + 0.5);
                error = error + difference * difference;
            }
            best = error < min_error ? found : best;
            min_error = error < min_error ? error : min_error;
        }
        return best;
    }

    // Add the light of sub-ray k of all pixels; `column` and `row` are those of the pixels.
    inline void add(Sums& sums, int k, Real column, Real row) const {
        const int i = k % BLOCK_SIDE, j = k / BLOCK_SIDE;
        const Whole place = corner + (j * map.stride + i);
        const Real found = Numbers::gather(map.depth, place), nothing = Numbers::real(0.0f);
        const Whole has_surface = found < Numbers::endless();
        if (!Numbers::any(has_surface)) return;
        Real normal[3], reflectivity = Numbers::real(1.0f);
        Numbers::gather_triples(map.normals, place, normal);
        for (int axis = 0; axis < 3; ++axis) normal[axis] = has_surface ? normal[axis] : nothing;
        if (map.segmentation) {
            const Whole object = Numbers::gather(map.segmentation, place), has_object = object >= 0;
            if (Numbers::any(has_object)) {
                const Real shared = Numbers::gather(inputs.reflectivity.data, has_object ? object : Numbers::whole(0));
                reflectivity = has_object ? shared : reflectivity;
            }
        }
        const float u = ((float)i + ((float)j + 0.5f) / (float)BLOCK_SIDE) / (float)BLOCK_SIDE;
        const float v = ((float)j + ((float)i + 0.5f) / (float)BLOCK_SIDE) / (float)BLOCK_SIDE;
        const auto& camera = inputs.camera;
        const Double across = (Numbers::wide(column + u) - camera.cx) / camera.fx;
        const Double down = (Numbers::wide(row + v) - camera.cy) / camera.fy;
        // Sub-rays without a surface return no light.
        const Real known = has_surface ? found : Numbers::real(1.0f);
        const auto light =
            FlightReturn<Numbers>::of(axes, across, down, known, normal, has_surface ? reflectivity : nothing);
#pragma unroll
        for (int f = 0; f < MAX_FREQUENCIES; ++f) {
            if (f >= model.frequencies) continue;
            const Double turns = light.range * model.turns[f];
            sums.real[f] = sums.real[f] + light.signal * Phase<Numbers>::sine(turns + 0.25);
            sums.imaginary[f] = sums.imaginary[f] + light.signal * Phase<Numbers>::sine(turns);
        }
        sums.all = sums.all + light.signal;
        sums.straight = sums.straight + light.straight;
    }

    // Write range [m], amplitude, total light and amplitude at normal incidence of each pixel.
    template <class Mix>
    inline void write(Mix* mixes) const {
        if (!Numbers::any(pixel >= 0)) return;
        Sums sums;
        for (int f = 0; f < MAX_FREQUENCIES; ++f) sums.real[f] = sums.imaginary[f] = none();
        sums.all = sums.straight = none();
        const int width = (int)inputs.camera.width;
        const Whole row = pixel / width;
        const Real at_row = Numbers::to_real(row), at_column = Numbers::to_real(pixel - row * width);
        for (int k = 0; k < SUB_RAYS; ++k) add(sums, k, at_column, at_row);
        Double phases[MAX_FREQUENCIES] = {none(), none(), none()}, least = none() + 1.0, coherence = none();
#pragma unroll
        for (int f = 0; f < MAX_FREQUENCIES; ++f) {
            if (f >= model.frequencies) continue;
            phases[f] = angle(sums.real[f], sums.imaginary[f]);
            const Double of_frequency =
                Numbers::root(sums.real[f] * sums.real[f] + sums.imaginary[f] * sums.imaginary[f]) / sums.all;
            least = least < of_frequency ? least : of_frequency;
            if (f == 0) coherence = of_frequency;
        }
        const Double no_number = Numbers::wide(Numbers::real(Numbers::no_number()));
        const Double endless = Numbers::wide(Numbers::real(Numbers::endless()));
        const Double found = least < (double)model.min_coherence ? no_number : unwrap(phases);
        const double part = 1.0 / SUB_RAYS;
        const Double light[4] = {found, part * coherence * sums.all, part * sums.all, part * coherence * sums.straight};
        Real mix[4];
        for (int c = 0; c < 4; ++c) mix[c] = Numbers::narrow(sums.all > 0.0 ? light[c] : (c ? none() : endless));
        for (int k = 0; k < Numbers::PIXELS; ++k) {
            if (Numbers::get(pixel, k) < 0) continue;
            for (int c = 0; c < 4; ++c) mixes[k][c] = Numbers::get(mix[c], k);
        }
    }
};

// Write the mixed light of a thread's pixels of a tile, of which `count` remain: all of them on a CPU.
template <class Model, class Inputs, class Axes, class Mix>
inline void mix_sub_rays(const Model& model, const Inputs& inputs, const Axes& axes, const SubRayMap& map,
                         const int* pixels, int count, int index, Mix* mixes) {
    typedef FlightMix<PixelNumbers, Model, Inputs, Axes> Mixed;
    for_groups<PixelNumbers::PIXELS>(count < SUB_RAYS ? count : (int)SUB_RAYS, index, [&](int first) {
        const auto in_tile = PixelNumbers::indices(first), found = PixelNumbers::load(pixels + first, count - first);
        const auto numbers = in_tile < count ? found : PixelNumbers::whole(-1);
        const Mixed mixed = {model, inputs, axes, map, numbers, map.corner(in_tile)};
        mixed.write(mixes + first);
    });
}

// Write the image coordinates of a thread's sub-rays of row y of the map: all of them on a CPU.
template <class Pixels, class Points>
inline void place_sub_rays(const Pixels& pixels, int first, int width, int view, int y, int x, const Points& points) {
    const int side = BLOCK_SIDE, tile = SUB_RAYS, columns = points.shape[2], j = y % side;
    const int* numbers = pixels.data + (long long)view * pixels.shape[1] + first;
    float* row = (float*)points.data + 2 * ((long long)view * points.shape[1] + y) * columns;
#if defined(__CUDA_ARCH__)
    const int end = x + 1;
#else
    const int end = columns;
#endif
    while (x < end) {
        const int pixel = numbers[x / tile * tile + y / side * side + x % tile / side];
        const float left = pixel < 0 ? OnePixel::no_number() : (float)(pixel % width);
        const float top = pixel < 0 ? OnePixel::no_number() : (float)(pixel / width);
        do {
            const int i = x % side;
            row[2 * x] = left + ((float)i + ((float)j + 0.5f) / (float)side) / (float)side;
            row[2 * x + 1] = top + ((float)j + ((float)i + 0.5f) / (float)side) / (float)side;
        } while (++x < end && x % side);
    }
}
