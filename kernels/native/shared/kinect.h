// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Measured noise models of the Kinect: `warpvis.sensors.KhoshelhamNoise` and `NguyenNoise`.

#pragma once

#include "shared/noise.h"

template <class Numbers, class Model>
struct Khoshelham {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef SensorRange<Numbers> Range;
    const SensorRow<Numbers>& row;
    const Model& model;

    // Measure the pixels from x on that share random words.
    inline void measure(int x) const {
        const PixelNormals<Numbers> normals = row.draw_normals(STREAM_DISPARITY, x);
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k)
            measure_pixels(x + k * Numbers::PIXELS, model.sigma * normals.block[k]);
    }
    inline void measure_pixels(int x, Real noise) const {
        const Real depth = row.exact(x), scaled = model.step * depth;
        const Real found = model.rounds ? Numbers::floor(1.0f / scaled + noise + 0.5f) : 1.0f + scaled * noise;
        const Real unit = model.rounds ? Numbers::real(1.0f / model.step) : depth;
        // Depth is infinite below the first step of disparity.
        const Real reported = row.range.report(found > 0.0f ? unit / found : Numbers::real(Numbers::endless()));
        const Whole has_surface = Range::finite(depth);
        row.write(x, has_surface ? reported : depth,
                  has_surface ? Range::reason(reported) : Numbers::whole(REASON_EMPTY));
    }
};

template <class Numbers, class Model, class Rotation, class Vector>
struct Nguyen {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Double Double;
    typedef typename Numbers::Whole Whole;
    typedef SensorRange<Numbers> Range;
    typedef PixelNormals<Numbers> Normals;
    const SensorRow<Numbers>& row;
    const Model& model;
    const Rotation& rotation;  // of the camera
    const Vector& forward;  // its axis in the world

    // The surfaces that pixels of a row show, displaced by lateral noise.
    struct Shown {
        Whole row, column;
        Real depth;
        Real normal[3];
    };

    // Angles between normals and the optical axis, with an error below 2e-8 before rounding: Abramowitz and Stegun,
    // "Handbook of Mathematical Functions", 4.4.46.
    inline Real angle_of(const Real* normal) const {
        const Double along = Numbers::wide(normal[0]) * forward[0] + Numbers::wide(normal[1]) * forward[1] +
                             Numbers::wide(normal[2]) * forward[2];
        const Real cosine = Numbers::abs(Numbers::narrow(along));
        const Real x = Numbers::min(Numbers::max(cosine, Numbers::real(0.0f)), Numbers::real(1.0f));
        Real total = x * -0.0012624911f + 0.0066700901f;
        total = total * x - 0.0170881256f;
        total = total * x + 0.0308918810f;
        total = total * x - 0.0501743046f;
        total = total * x + 0.0889789874f;
        total = total * x - 0.2145988016f;
        total = total * x + 1.5707963050f;
        return Numbers::root(1.0f - x) * total;
    }
    // Rotate normals into the camera frame, rounded as by Warp's quat_rotate_inv.
    inline void rotate_into_camera(const Real* normal, Double* rotated) const {
        const double q[3] = {rotation.x, rotation.y, rotation.z}, w = rotation.w, c = 2.0 * w * w - 1.0;
        const Double n[3] = {Numbers::wide(normal[0]), Numbers::wide(normal[1]), Numbers::wide(normal[2])};
        const Double d = 2.0 * (q[0] * n[0] + q[1] * n[1] + q[2] * n[2]);
        rotated[0] = n[0] * c + q[0] * d - (q[1] * n[2] - q[2] * n[1]) * w * 2.0;
        rotated[1] = n[1] * c + q[1] * d - (q[2] * n[0] - q[0] * n[2]) * w * 2.0;
        rotated[2] = n[2] * c + q[2] * d - (q[0] * n[1] - q[1] * n[0]) * w * 2.0;
    }
    inline void load(Shown& shown) const {
        const Whole place = shown.row * row.width + shown.column;
        shown.depth = Numbers::gather(row.depth + row.first, place);
        Numbers::gather_triples(row.normals + 3 * row.first, place, shown.normal);
    }
    // Depth at which the rays of a row's pixels meet the planes of these surfaces; the surface's own depth if they do
    // not meet, or if a pixel shows its own surface.
    inline Real met_depth(const Shown& shown, Whole column) const {
        const Whole is_displaced = (shown.row != row.y) | (shown.column != column);
        if (!Numbers::any(is_displaced)) return shown.depth;
        Double n[3];
        rotate_into_camera(shown.normal, n);
        const Double at_surface = n[0] * row.across(shown.column) + n[1] * row.down(shown.row) + n[2];
        const Double at_ray = n[0] * row.across(column) + n[1] * row.down(Numbers::whole(row.y)) + n[2];
        const Double ahead = at_surface / at_ray, own_depth = Numbers::wide(shown.depth);
        const Real displaced_depth = Numbers::narrow(ahead > 0.0 ? own_depth * ahead : own_depth);
        return is_displaced ? displaced_depth : shown.depth;
    }

    // Factor by which noise grows toward grazing angles.
    static inline Real steepness(Real angle) {
        constexpr float RIGHT_ANGLE = 1.5707964f;
        return angle / (RIGHT_ANGLE - angle);
    }
    // Standard deviation of depth [m]: equations (3) and (4).
    inline Real axial(Real depth, Real angle) const {
        const Real away = depth - model.best_depth, steep = steepness(angle);
        const Real sigma = model.min_axial + model.axial_growth * away * away;
        const Real grazing_sigma = sigma + model.grazing_axial / Numbers::root(depth) * (steep * steep);
        return angle >= model.grazing_angle ? grazing_sigma : sigma;
    }
    // Displaced pixel centers along one axis, clamped to the image.
    static inline Whole jittered(Real centers, Real offset, int size) {
        const Real place = Numbers::floor(centers + 0.5f + offset);
        const Real last = Numbers::real((float)(size - 1));
        return Numbers::truncate(Numbers::min(Numbers::max(place, Numbers::real(0.0f)), last));
    }

    // Measure the pixels from x on that share random words.
    inline void measure(int x) const {
        const Normals across = row.draw_normals(STREAM_ACROSS, x), down = row.draw_normals(STREAM_DOWN, x),
                      ahead = row.draw_normals(STREAM_DEPTH, x);
        UNROLL_ON_CUDA
        for (int k = 0; row.has_word(x, k); ++k) {
            const Real offsets[2] = {across.block[k], down.block[k]};
            measure_pixels(x + k * Numbers::PIXELS, offsets, ahead, k);
        }
    }
    inline void measure_pixels(int x, const Real* offsets, const Normals& ahead, int k) const {
        Real normal[3];
        row.normal(x, normal);
        const Real max_angle = Numbers::real(model.max_angle);
        const Real source_angle = Range::finite(row.exact(x)) ? angle_of(normal) : Numbers::real(0.0f);
        const Real sigma = model.lateral + model.lateral_growth * steepness(Numbers::min(source_angle, max_angle));
        Shown shown;
        shown.column = jittered(Numbers::columns(x), sigma * offsets[0], row.width);
        shown.row = jittered(Numbers::real((float)row.y), sigma * offsets[1], row.height);
        load(shown);
        const Whole has_surface = Range::finite(shown.depth);
        if (!Numbers::any(has_surface)) return row.write(x, shown.depth, Numbers::whole(REASON_EMPTY));
        const Real angle = angle_of(shown.normal), depth = met_depth(shown, Numbers::indices(x));
        const Real reported = row.range.report(depth + axial(depth, angle) * ahead.block[k]);
        const Whole grazing = angle > max_angle;
        const Real measured = grazing ? Numbers::real(Numbers::no_number()) : reported;
        const Whole reason = grazing ? Numbers::whole(REASON_GRAZING) : Range::reason(reported);
        row.write(x, has_surface ? measured : shown.depth, has_surface ? reason : Numbers::whole(REASON_EMPTY));
    }
};
