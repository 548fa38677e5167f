// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The samples of an image that a target, one or several objects, may cover.

#pragma once

#include "shared/pose.h"
#include "shared/stretch.h"

// The rectangle of a canvas that a target may cover, in samples.
struct SampleWindow {
    int across;  // samples along the side of a pixel
    int x0, y0, x1, y1;  // relative to the image's first sample, end exclusive

    // Extend a rectangle in pixels by the corners of a stretched box, which a view with a focal length and a center
    // sees from a pose in the frame of the box; returns how many of them are behind the camera.
    template <class View>
    static inline int add_box(const Pose& camera, const View& view, const float* box, const Stretch& stretch,
                              double* low, double* high) {
        int behind = 0;
        for (int corner = 0; corner < 8; ++corner) {
            double place[3], seen[3];
            for (int k = 0; k < 3; ++k) place[k] = stretch.factor[k] * box[(corner >> k & 1) * 3 + k];
            camera.transform_into(place, seen);
            behind += seen[2] <= 0.0;
            if (seen[2] <= 0.0) continue;
            for (int k = 0; k < 2; ++k) {
                const double at = view.focal[k] * seen[k] / seen[2] + view.center[k];
                low[k] = at < low[k] ? at : low[k];
                high[k] = at > high[k] ? at : high[k];
            }
        }
        return behind;
    }
    // The least odd number of samples along the side of a pixel that gives a rectangle of pixels enough samples. From
    // one to the next, sides grow to at most three times their length: they are at most `3 * min_samples` unless it is
    // 1.
    static inline int samples_across(double width, double height, int min_samples) {
        int across = 1;
        while (across < MAX_SAMPLES_ACROSS && (width * across + 1) * (height * across + 1) < min_samples) across += 2;
        return across;
    }
    // All of a canvas, sampled at the centers of pixels.
    static inline SampleWindow all(const int* canvas) {
        return SampleWindow{1, canvas[0], canvas[1], canvas[2], canvas[3]};
    }
    // The window of a rectangle in pixels, with a margin of a sample; empty if it is outside of the canvas.
    static inline SampleWindow of(const double* low, const double* high, const int* canvas, int min_samples) {
        double from[2], to[2];
        for (int k = 0; k < 2; ++k) {
            from[k] = low[k] > canvas[k] ? low[k] : canvas[k];
            to[k] = high[k] < canvas[2 + k] ? high[k] : canvas[2 + k];
            if (from[k] > to[k]) return SampleWindow{1, 0, 0, 0, 0};
        }
        const int across = samples_across(to[0] - from[0], to[1] - from[1], min_samples);
        int window[4];
        for (int k = 0; k < 2; ++k) {
            const int first = (int)floor_of(from[k] * across) - 1, end = -(int)floor_of(-to[k] * across) + 1;
            window[k] = first > canvas[k] * across ? first : canvas[k] * across;
            window[2 + k] = end < canvas[2 + k] * across ? end : canvas[2 + k] * across;
        }
        return SampleWindow{across, window[0], window[1], window[2], window[3]};
    }
    static inline double floor_of(double value) {
#if defined(__CUDA_ARCH__)
        return floor(value);
#else
        return __builtin_floor(value);
#endif
    }
    inline bool empty() const { return x0 >= x1 || y0 >= y1; }
};
