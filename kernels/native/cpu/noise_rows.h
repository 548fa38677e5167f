// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Common parts of the models of depth noise in kernels/sensors/noise.py, for rows of pixels, 16 at a time.

// A row of a view's image.
struct NoiseRow {
    int width, y;
    RandomKey key;
    const float* depth;  // of the first surface
    float* depth_out;
    unsigned char* reasons_out;  // or null

    inline Floats exact(int x) const { return Numbers::load(depth + x, width - x); }
    inline void write(int x, Floats reported, Ints reason) const {
        Numbers::store(depth_out + x, reported, width - x);
        if (reasons_out) Numbers::store(reasons_out + x, reason, width - x);
    }
};

// Range of a sensor [m].
struct SensorRange {
    float near, far;

    static inline Ints finite(Floats depth) { return Lanes::abs(depth) < Numbers::endless(); }
    // The reported depth according to REP 117: inf beyond the range, -inf before it.
    inline Floats report(Floats depth) const {
        const Floats endless = Lanes::all(Numbers::endless());
        const Ints too_near = (depth < near) | ~(depth > 0.0f);
        return depth > far ? endless : (too_near ? -endless : depth);
    }
    // Reason of a reported depth: valid if it is finite.
    static inline Ints reason(Floats reported) {
        return finite(reported) ? Lanes::all_ints(REASON_VALID) : Lanes::all_ints(REASON_RANGE);
    }
};
