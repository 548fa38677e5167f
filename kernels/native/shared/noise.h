// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Common parts of the models of depth noise, for rows of pixels, as many at a time as Real holds.

// A row of a view's image.
struct NoiseRow {
    int width, y;
    RandomKey key;
    const float* depth;  // of the first surface
    float* depth_out;
    unsigned char* reasons_out;  // or null

    // Whether pixels remain for word k of the random words that pixels from x on share.
    inline bool has_word(int x, int k) const { return k < PixelWords::WORDS && x + k * Numbers::PIXELS < width; }
    inline Real exact(int x) const { return Numbers::load(depth + x, width - x); }
    inline void write(int x, Real reported, Whole reason) const {
        Numbers::store(depth_out + x, reported, width - x);
        if (reasons_out) Numbers::store(reasons_out + x, reason, width - x);
    }
};

// Range of a sensor [m].
struct SensorRange {
    float near, far;

    static inline Whole finite(Real depth) { return Numbers::abs(depth) < Numbers::endless(); }
    // The reported depth according to REP 117: inf beyond the range, -inf before it or if noise made depth 0.
    inline Real report(Real depth) const {
        const Real endless = Numbers::real(Numbers::endless());
        const Whole too_near = (depth < near) | !(depth > 0.0f);
        return depth > far ? endless : (too_near ? -endless : depth);
    }
    // Reason of a reported depth: valid if it is finite.
    static inline Whole reason(Real reported) {
        return finite(reported) ? Numbers::whole(REASON_VALID) : Numbers::whole(REASON_RANGE);
    }
};
