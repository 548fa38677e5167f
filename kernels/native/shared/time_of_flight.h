// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Time-of-flight depth from the phase of modulated light: `warpvis.sensors.TimeOfFlight`.

#pragma once

#include "shared/noise.h"

// Phases in cycles, in double precision by polynomials, so that all devices agree.
template <class Numbers>
struct Phase {
    typedef typename Numbers::Double Double;

    // sin(2 pi turns), with an error below 1e-13.
    static inline Double sine(Double turns) {
        const Double fraction = turns - Numbers::floor(turns + 0.5);
        const Double t = fraction > 0.25 ? 0.5 - fraction : (fraction < -0.25 ? -0.5 - fraction : fraction);
        const Double s = t * t;
        Double total = s * 3.66586854013351 - 15.081485384046008;
        total = total * s + 42.058134991709764;
        total = total * s - 76.7058475461348;
        total = total * s + 81.6052491490158;
        total = total * s - 41.34170223990335;
        total = total * s + 6.283185307179269;
        return total * t;
    }
};

// Light that returns along rays (across, down, 1) in the camera frame.
template <class Numbers>
struct FlightReturn {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Double Double;
    Double length;  // of the ray
    Double range;  // [m]
    Double signal;  // in units of that of a white surface at 1 m at normal incidence
    Double straight;  // the same if incidence were normal

    // `axes` rotate the camera frame to the world, in which normals are given.
    template <class Axes>
    static inline FlightReturn of(const Axes& axes, Double across, Double down, Real depth, const Real* normal,
                                  Real reflectivity) {
        FlightReturn light;
        light.length = Numbers::root(across * across + down * down + 1.0);
        light.range = Numbers::wide(depth) * light.length;
        light.straight = Numbers::wide(reflectivity) / (light.range * light.range);
        const Real x = Numbers::narrow(across), y = Numbers::narrow(down);
        Real ray[3];
        for (int k = 0; k < 3; ++k) ray[k] = axes.data[k][0] * x + axes.data[k][1] * y + axes.data[k][2] * 1.0f;
        const Real along = Numbers::abs(normal[0] * ray[0] + normal[1] * ray[1] + normal[2] * ray[2]);
        light.signal = light.straight * (Numbers::wide(along) / light.length);
        return light;
    }
};

// Light that returns to pixels of a row: range [m], light in phase with it, all light, and the light in phase if
// incidence were normal.
template <class Numbers>
struct FlightLight {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Double Double;
    typedef typename Numbers::Whole Whole;
    typedef SensorRow<Numbers> Row;
    Real range, signal, all, straight;
    Double length;  // of rays with z = 1
    Double depth;

    template <class Axes>
    static inline FlightLight of(const Row& row, const Axes& axes, int x) {
        const Real depth = row.exact(x), none = Numbers::real(0.0f);
        const Double across = row.across_from(x), down = row.down(Numbers::whole(row.y));
        Real normal[3];
        row.normal(x, normal);
        const auto found = FlightReturn<Numbers>::of(axes, across, down, depth, normal, row.reflectivities(x));
        const Whole has_surface = depth < Numbers::endless();
        FlightLight light;
        light.length = found.length;
        light.depth = Numbers::wide(depth);
        light.range = has_surface ? Numbers::narrow(found.range) : Numbers::real(Numbers::endless());
        light.signal = has_surface ? Numbers::narrow(found.signal) : none;
        light.all = light.signal;
        light.straight = has_surface ? Numbers::narrow(found.straight) : none;
        return light;
    }
    // Pixels at edges combine the light of their sub-rays.
    template <class Model>
    inline void mix(const Row& row, const Model& model, int x) {
        const Whole slots = Numbers::load(model.slots.data + row.place(x), row.count(x));
        const Whole is_mixed = (slots >= 0) & (Numbers::indices(x) < row.width);
        if (!Numbers::any(is_mixed)) return;
        const float* mixes = (const float*)(model.mixes.data + (long long)row.view * model.mixes.shape[1]);
        const Whole first = is_mixed ? 4 * slots : Numbers::whole(0);
        const Real mixed_range = Numbers::gather(mixes, first);
        range = is_mixed ? mixed_range : range;
        signal = is_mixed ? Numbers::gather(mixes + 1, first) : signal;
        all = is_mixed ? Numbers::gather(mixes + 2, first) : all;
        straight = is_mixed ? Numbers::gather(mixes + 3, first) : straight;
        depth = Numbers::select(is_mixed, Numbers::wide(mixed_range) / length, depth);
    }
};

template <class Numbers, class Model, class Axes>
struct Flight {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Double Double;
    typedef typename Numbers::Whole Whole;
    typedef FlightLight<Numbers> Light;
    const SensorRow<Numbers>& row;
    const Model& model;
    const Axes& axes;  // of the camera in the world

    // Measure the pixels from x on that share random words.
    inline void measure(int x) const {
        PixelNormals<Numbers> normals;
        if (model.noise_scale > 0.0f) normals = row.draw_normals(STREAM_RANGE, x);
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k) measure_pixels(x + k * Numbers::PIXELS, normals.block[k]);
    }
    inline void measure_pixels(int x, Real normal) const {
        Light light = Light::of(row, axes, x);
        if (model.slots.data) light.mix(row, model, x);
        Real deviation = Numbers::real(0.0f);
        if (model.noise_scale > 0.0f) deviation = noise_of(light, normal);
        write(light, deviation, x);
    }
    inline Real noise_of(const Light& light, Real normal) const {
        return model.noise_scale * Numbers::root(light.all + model.background) / light.signal * normal;
    }
    // Error of ranges [m]: offset, wiggling and noise, minus whole unambiguous ranges on overflow. Wiggling has four
    // periods per cycle of the phase: the number of phase samples.
    inline Double error(Double far, Real noise) const {
        Double found =
            model.offset + model.wiggle * Phase<Numbers>::sine(4.0 * (far * model.turns[0]) + model.wiggle_turns);
        if (model.noise_scale > 0.0f) found = found + Numbers::wide(noise);
        // Most ranges do not overflow: the quotient's floor is 0.
        const Double sum = far + found;
        if (Numbers::all_between(sum, 0.0, model.unambiguous)) return found;
        return found - Numbers::floor(sum / model.unambiguous) * model.unambiguous;
    }
    // Reason why the light yields no range, if any.
    inline Whole judge(const Light& light) const {
        const Whole straight = (light.straight > 0.0f) & (light.straight >= model.min_signal);
        const Whole has_signal = (light.signal > 0.0f) & (light.signal >= model.min_signal);
        const Whole dark = straight ? Numbers::whole(REASON_GRAZING) : Numbers::whole(REASON_DROPOUT);
        Whole reason = has_signal ? Numbers::whole(REASON_VALID) : dark;
        reason = light.all > model.max_signal ? Numbers::whole(REASON_SATURATED) : reason;
        reason = light.range != light.range ? Numbers::whole(REASON_EDGE) : reason;
        return light.range == Numbers::endless() ? Numbers::whole(REASON_EMPTY) : reason;
    }
    inline void write(const Light& light, Real noise, int x) const {
        const Real endless = Numbers::real(Numbers::endless()), none = Numbers::real(Numbers::no_number());
        const Whole judged = judge(light), valid = judged == Numbers::whole(REASON_VALID);
        Real reported = judged == Numbers::whole(REASON_EMPTY) ? endless : none;
        if (!Numbers::any(valid)) return row.write(x, reported, judged);
        const Double added = error(light.depth * light.length, noise) / light.length;
        const Real found = Numbers::narrow(light.depth + added);
        // `unknown` if the noise overflowed
        const Whole beyond = found > row.range.far, before = found < row.range.near, unknown = found != found;
        const Real measured = beyond ? endless : (before ? -endless : (unknown ? none : found));
        Whole reason = beyond | before ? Numbers::whole(REASON_RANGE) : judged;
        reason = unknown ? Numbers::whole(REASON_DROPOUT) : reason;
        row.write(x, valid ? measured : reported, valid ? reason : judged);
    }
};

// Pixels of a row with a neighbor, of eight, that differs from the pixel's plane by at least `edge_step` in depth.
template <class Numbers, class Axes, class Length, class Edges>
struct FlightEdges {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    const SensorRow<Numbers>& row;
    const Axes& axes;  // of the camera in the world
    const Length& edge_step;
    const Edges& edges;

    // Write the row-major indices of such pixels, of those of a thread from x on, and -1 for others.
    inline void measure(int x) const {
        GroupStore<Numbers, int> stored = {edges.data + row.place(x), row.count(x)};
        const Nearby nearby = Nearby::of(row, x);
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k) {
            const int column = x + k * Numbers::PIXELS;
            const Whole places = Numbers::indices(row.y * row.width + column);
            stored.put(k, is_edge(column, nearby) ? places : Numbers::whole(-1));
        }
        stored.flush();
    }
    // Depths of the neighbors of pixels.
#if defined(__CUDA_ARCH__)
    struct Nearby {
        DepthStrip strips[3];

        static inline Nearby of(const SensorRow<Numbers>& row, int x) {
            return Nearby{{DepthStrip::of(row, x, -1), DepthStrip::of(row, x), DepthStrip::of(row, x, 1)}};
        }
        template <bool INNER>
        inline float depth(const SensorRow<Numbers>&, int x, int i, int j) const {
            return strips[j + 1].at(x & (RANDOM_WORDS - 1), i);
        }
    };
#else
    struct Nearby {
        static inline Nearby of(const SensorRow<Numbers>&, int) { return Nearby(); }
        template <bool INNER>
        inline Real depth(const SensorRow<Numbers>& row, int x, int i, int j) const {
            return INNER ? Numbers::load(row.depth + row.place(x) + (j * row.width + i), Numbers::PIXELS)
                         : row.exact(x + i, row.y + j, 0.0f);
        }
    };
#endif
    inline Whole is_edge(int x, const Nearby& nearby) const {
        // Most warps have a pixel at the end of a row: a single pixel is checked in any case.
        const bool inner =
            Numbers::PIXELS > 1 && x > 0 && x + Numbers::PIXELS < row.width && row.y > 0 && row.y + 1 < row.height;
        return inner ? is_edge<true>(x, nearby) : is_edge<false>(x, nearby);
    }
    // Comparisons with all neighbors are made once, with the extremes of their numbers: a mask for each neighbor would
    // take longer. Unless pixels are `INNER`, neighbors may be outside of the image.
    template <bool INNER>
    inline Whole is_edge(int x, const Nearby& nearby) const {
        Real normal[3], rotated[3];
        row.normal(x, normal);
        for (int k = 0; k < 3; ++k)
            rotated[k] = axes.data[0][k] * normal[0] + axes.data[1][k] * normal[1] + axes.data[2][k] * normal[2];
        const Real depth = row.exact(x);
        const Real ahead = rotated[0] * Numbers::narrow(row.across_from(x)) +
                           rotated[1] * Numbers::narrow(row.down(Numbers::whole(row.y))) + rotated[2] * 1.0f;
        const Real plane = depth * ahead;
        const Real across = rotated[0] / (float)row.focal[0], down = rotated[1] / (float)row.focal[1];
        // Of all neighbors: depths, the least product of slopes, the greatest distance from the plane beyond the step.
        Real nearest = depth, farthest = depth, least = Numbers::real(1.0f), greatest = Numbers::real(-1.0f);
#pragma unroll
        for (int k = 0; k < 9; ++k) {
            const int i = k % 3 - 1, j = k / 3 - 1;
            if (k == 4 || (!INNER && (row.y + j < 0 || row.y + j >= row.height))) continue;
            Real other = nearby.template depth<INNER>(row, x, i, j);
            const Real slope = ahead + (float)i * across + (float)j * down;
            Real product = slope * plane;
            Real beyond = Numbers::abs(other * slope - plane) - edge_step * Numbers::abs(slope);
            if (!INNER && i != 0) {
                const Whole column = Numbers::indices(x + i), outside = (column < 0) | (column >= row.width);
                other = outside ? depth : other;
                product = outside ? Numbers::real(1.0f) : product;
                beyond = outside ? Numbers::real(-1.0f) : beyond;
            }
            nearest = Numbers::min(other, nearest);
            farthest = Numbers::max(other, farthest);
            least = Numbers::min(product, least);
            greatest = Numbers::max(beyond, greatest);
        }
        const Real endless = Numbers::real(Numbers::endless());
        const Whole has_surface = depth < endless;
        const Whole beside_surface = nearest < endless, beside_none = farthest == endless;
        return has_surface ? beside_none | (least <= 0.0f) | (greatest >= 0.0f) : beside_surface;
    }
};
