// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Measurement model of a triangulation sensor at a pixel: `warpvis.sensors.StereoDepth`.

// Inputs of the model at a pixel.
struct StereoPixel {
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

struct Stereo {
    float disparity_scale;  // focal length times baseline [px m]: disparity is this divided by depth
    float shift_scale;  // the same in pixels of the image, positive if the other eye is on the right
    float first_column, last_column;  // of the other eye's image [px]
    float near, far;  // [m]
    float max_disparity;  // [px]
    float shadow_tolerance;  // [px]
    float min_support;
    // signal at which pixels begin to be detected, and slope of the detection probability
    float min_signal, signal_slope;
    float detection_rate;  // fraction of pixels with sufficient signal that are detected
    float sigma, locking;  // [px]
    float levels;  // subpixel steps per pixel of disparity; 0 disables quantization
    int spacing;  // of the noise nodes [px]
    int window;  // reach of a pixel's window [px]
    float edge_step;  // disparity difference from which two pixels belong to different surfaces [px]

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
        const Real locked = locking == 0.0f ? disparity : disparity + locking * wave(disparity);
        const Real found = locked + sigma * noise;
        return levels > 0.0f ? Numbers::floor(found * levels + 0.5f) / levels : found;
    }
    // If the disparity is unchanged, the depth is unchanged to the last bit.
    inline Real depth_of(Real found, Real depth, Real disparity) const {
        return levels > 0.0f ? disparity_scale / found : depth * (disparity / found);
    }
    // Whether a surface occludes this one from the other eye: its disparity is greater by more than the tolerance.
    inline Whole hidden(const StereoPixel& pixel) const {
        const float scale = shift_scale < 0.0f ? -shift_scale : shift_scale;
        return scale * (pixel.far_depth - pixel.other_depth) > shadow_tolerance * pixel.far_depth * pixel.other_depth;
    }
    inline Whole is_outside(const StereoPixel& pixel, Real nearness) const {
        const Real column = pixel.column - shift_scale * nearness;
        return (column < first_column) | (column > last_column);
    }
    // Fraction of pixels with a given signal that are detected.
    inline Real found_share(Real signal) const {
        const Real share = (signal - min_signal) * signal_slope;
        return share < 1.0f ? share : Numbers::real(1.0f);
    }

    inline void measure(const StereoPixel& pixel, Real& depth, Whole& reason) const {
        const Real nearness = 1.0f / pixel.depth, disparity = disparity_scale * nearness;
        const Real found = measured(disparity, pixel.noise);
        const Real reported = depth_of(found, pixel.depth, disparity);
        const Real endless = Numbers::real(Numbers::endless()), none = Numbers::real(Numbers::no_number());
        const Whole too_far = (reported > far) | (found <= 0.0f), in_range = (reported >= near) & (reported <= far);
        const Whole lost = pixel.chance >= found_share(pixel.reflectivity * pixel.cosine) * detection_rate;
        const Whole grazing = pixel.chance >= found_share(pixel.cosine);
        const Whole too_much = disparity > max_disparity, empty = !(pixel.depth < endless);

        reason = in_range ? Numbers::whole(REASON_VALID) : Numbers::whole(REASON_RANGE);
        reason = lost ? (grazing ? Numbers::whole(REASON_GRAZING) : Numbers::whole(REASON_DROPOUT)) : reason;
        reason = pixel.support < min_support ? Numbers::whole(REASON_EDGE) : reason;
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
