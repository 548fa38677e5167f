// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Measurement model of a triangulation sensor at a pixel: `warpvis.sensors.StereoDepth`.

#pragma once

#include "shared/noise.h"

// Inputs of the model at a pixel.
template <class Numbers>
struct StereoPixel {
    typedef typename Numbers::Real Real;
    Real depth;  // of the first surface [m], +inf if there is none
    Real far_depth;  // the same along the optical axis of the other eye [m]
    Real other_depth;  // depth that the other eye measures there [m]
    Real column;  // of the pixel's center [px]
    Real support;  // fraction of the surrounding window that shows the same surface, from 0 to 1
    Real cosine;  // of the angle of incidence
    Real reflectivity;
    Real noise;  // standard normal
    Real chance;  // uniform in (0, 1)
};

// The model is a `StereoModel` of kernels/sensors/stereo.py.
template <class Numbers, class Model>
struct StereoMatcher {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef StereoPixel<Numbers> Pixel;
    const Model& model;
    const SensorRange<Numbers>& range;

    // sin(2 pi a), by a minimax polynomial with exact zeros and a relative error below 4e-7.
    static inline Real wave(Real a) {
        const Real t = a - Numbers::floor(a + 0.5f), square = t * t;
        Real sum = square * 3.0019321f - 9.507514f;
        sum = sum * square + 16.758163f;
        sum = sum * square - 16.208584f;
        sum = sum * square + 6.283183f;
        return sum * (t * (1.0f - 4.0f * square));
    }
    inline Real measured(Real disparity, Real noise) const {
        const Real locked = model.locking == 0.0f ? disparity : disparity + model.locking * wave(disparity);
        const Real found = locked + model.sigma * noise;
        return model.levels > 0.0f ? Numbers::floor(found * model.levels + 0.5f) / model.levels : found;
    }
    // If the disparity is unchanged, the depth is unchanged to the last bit.
    inline Real depth_of(Real found, Real depth, Real disparity) const {
        return model.levels > 0.0f ? model.disparity_scale / found : depth * (disparity / found);
    }
    // Whether a surface occludes this one from the other eye: its disparity is greater by more than the tolerance.
    inline Whole hidden(const Pixel& pixel) const {
        const float scale = model.shift_scale < 0.0f ? -model.shift_scale : model.shift_scale;
        return scale * (pixel.far_depth - pixel.other_depth) >
               model.shadow_tolerance * pixel.far_depth * pixel.other_depth;
    }
    inline Whole is_outside(const Pixel& pixel, Real nearness) const {
        const Real column = pixel.column - model.shift_scale * nearness;
        return (column < model.first_column) | (column > model.last_column);
    }
    // Fraction of pixels with a given signal that are detected.
    inline Real found_share(Real signal) const {
        const Real share = (signal - model.min_signal) * model.signal_slope;
        return share < 1.0f ? share : Numbers::real(1.0f);
    }

    inline void measure(const Pixel& pixel, Real& depth, Whole& reason) const {
        const Real nearness = 1.0f / pixel.depth, disparity = model.disparity_scale * nearness;
        const Real found = measured(disparity, pixel.noise);
        const Real reported = depth_of(found, pixel.depth, disparity);
        const Real endless = Numbers::real(Numbers::endless()), none = Numbers::real(Numbers::no_number());
        const Whole too_far = (reported > range.far) | (found <= 0.0f),
                    in_range = (reported >= range.near) & (reported <= range.far);
        const Whole lost = pixel.chance >= found_share(pixel.reflectivity * pixel.cosine) * model.detection_rate;
        const Whole grazing = pixel.chance >= found_share(pixel.cosine);
        const Whole too_much = disparity > model.max_disparity, empty = !(pixel.depth < endless);

        reason = in_range ? Numbers::whole(REASON_VALID) : Numbers::whole(REASON_RANGE);
        reason = lost ? (grazing ? Numbers::whole(REASON_GRAZING) : Numbers::whole(REASON_DROPOUT)) : reason;
        reason = pixel.support < model.min_support ? Numbers::whole(REASON_EDGE) : reason;
        reason = hidden(pixel) ? Numbers::whole(REASON_SHADOW) : reason;
        reason = is_outside(pixel, nearness) ? Numbers::whole(REASON_BAND) : reason;
        reason = too_much ? Numbers::whole(REASON_RANGE) : reason;
        reason = empty ? Numbers::whole(REASON_EMPTY) : reason;

        depth = in_range ? reported : (too_far ? endless : -endless);
        depth = too_much ? -endless : depth;
        depth = reason > (int)REASON_RANGE ? none : depth;
        depth = empty ? endless : depth;
    }
};
