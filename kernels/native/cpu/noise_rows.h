// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rows of pixels through models of noisy depth, sixteen at a time: what the models share, as in kernels/noise.py.

// A row of a view's image.
struct NoiseRow {
    int width, y;
    RandomKey key;
    const float* depth;  // of the first surface
    float* depth_out;
    unsigned char* reasons_out;  // or null

    inline Floats exact(int x) const { return Numbers::load(depth + x, width - x); }
    inline void say(int x, Floats said, Ints reason) const {
        Numbers::store(depth_out + x, said, width - x);
        if (reasons_out) Numbers::store(reasons_out + x, reason, width - x);
    }
};

// Of a sensor [m].
struct SensorRange {
    float near, far;

    static inline Ints finite(Floats depth) { return Lanes::abs(depth) < Numbers::endless(); }
    // What was measured, as REP 117 has it.
    inline Floats said(Floats depth) const {
        const Floats endless = Lanes::all(Numbers::endless());
        const Ints too_near = (depth < near) | ~(depth > 0.0f);
        return depth > far ? endless : (too_near ? -endless : depth);
    }
    // Whether that is a depth.
    static inline Ints reason(Floats said) {
        return finite(said) ? Lanes::all_ints(REASON_VALID) : Lanes::all_ints(REASON_RANGE);
    }
};
