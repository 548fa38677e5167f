// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "shared/constants.h"

// Stretch of an object along its axes, in a world in which its size differs from the size it was built with. Its
// triangles are rasterized in a frame divided by these factors, in which their coordinates are unchanged; ray
// parameters are the same in both frames.
struct Stretch {
    double factor[3];

    static inline Stretch none() { return Stretch{{1.0, 1.0, 1.0}}; }

    // From rows of SOLID_WORDS, as built and as resized. For a mesh, the row holds the factors.
    static inline Stretch of(int kind, const float* built, const float* resized) {
        Stretch stretch;
        for (int k = 0; k < 3; ++k) stretch.factor[k] = kind == SOLID_NONE ? resized[k] : (double)resized[k] / built[k];
        // The triangles extend as far along z as the solid: those of a capsule's ends are stretched like its middle.
        const double end = kind == SOLID_CAPSULE ? 1.0 : 0.0;
        if (kind == SOLID_CYLINDER || kind == SOLID_CAPSULE) stretch.factor[2] *= (resized[3] + end) / (built[3] + end);
        return stretch;
    }
};
