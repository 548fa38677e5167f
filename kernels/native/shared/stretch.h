// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// How an object is stretched along its axes, in a world where it is of another size than it was made: its triangles
// are drawn in a frame divided by these factors, in which they are as they were. Rays keep their parameter there.
struct Stretch {
    double factor[3];

    static inline Stretch none() { return Stretch{{1.0, 1.0, 1.0}}; }

    // From rows of SOLID_WORDS, as it was made and as it is. Of a mesh, factors are what a row holds.
    static inline Stretch of(int kind, const float* made, const float* now) {
        Stretch stretch;
        for (int k = 0; k < 3; ++k) stretch.factor[k] = kind == SOLID_NONE ? now[k] : (double)now[k] / made[k];
        // Its triangles reach as far along z as it does: those of a capsule's ends are stretched as its middle is.
        const double end = kind == SOLID_CAPSULE ? 1.0 : 0.0;
        if (kind == SOLID_CYLINDER || kind == SOLID_CAPSULE) stretch.factor[2] *= (now[3] + end) / (made[3] + end);
        return stretch;
    }
};
