// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Powers, angles and conversions of color spaces, for one pixel and for 16 pixels at a time, with relative errors of
// about 1e-6. Without the standard library, CPU and CUDA compute the same formulas.

#pragma once

#include "shared/scalar.h"

template <class Numbers>
struct Powers {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef typename Numbers::Word Word;

    // Base-2 logarithm of a positive number. With the mantissa m between sqrt(1/2) and sqrt(2) and
    // t = (m - 1) / (m + 1), ln m = 2 (t + t^3 / 3 + t^5 / 5 + ...); the first omitted term is below 4e-10.
    static inline Real logarithm(Real x) {
        const Word bits = Numbers::bits_of(x);
        const Whole is_upper = (Whole)(bits & 0x007fffffu) >= 0x003504f3;  // the mantissa of sqrt(2)
        const Real exponent = Numbers::to_real((Whole)(bits >> 23) - 127);
        const Real mantissa = Numbers::of_bits((bits & 0x007fffffu) | 0x3f800000u);
        const Real m = is_upper ? 0.5f * mantissa : mantissa;
        const Real t = (m - 1.0f) / (m + 1.0f), square = t * t;
        const Real series = (((square * (1.0f / 9.0f) + 1.0f / 7.0f) * square + 0.2f) * square + 1.0f / 3.0f) * square;
        const Real log2_e = Numbers::real(1.4426950408889634f);
        return (is_upper ? exponent + 1.0f : exponent) + 2.0f * log2_e * (t + t * series);
    }

    // 2 to the power of a number, at least 2^-126: of its whole part by the exponent, and of the rest, from -0.5 to
    // 0.5, by the series of exp; the first omitted term is below 2e-7.
    static inline Real power_of_two(Real x) {
        const Real limited = Numbers::min(Numbers::max(x, Numbers::real(-126.0f)), Numbers::real(127.0f));
        const Real whole = Numbers::floor(limited + 0.5f);
        const Real y = (limited - whole) * 0.6931471805599453f;
        Real series = y * (1.0f / 720.0f) + 1.0f / 120.0f;
        series = series * y + 1.0f / 24.0f;
        series = series * y + 1.0f / 6.0f;
        series = series * y + 0.5f;
        series = series * y + 1.0f;
        series = series * y + 1.0f;
        return series * Numbers::of_bits((Word)(Numbers::truncate(whole) + 127) << 23);
    }

    // x to the power of an exponent of at least 0; 0 to the power of 0 is 1, and x below 0 counts as 0.
    static inline Real power(Real x, float exponent) {
        const Real least = Numbers::real(1e-37f);
        const Real raised = power_of_two(exponent * logarithm(Numbers::max(x, least)));
        return x > least ? raised : Numbers::real(exponent == 0.0f ? 1.0f : 0.0f);
    }

    // The angle of a cosine, with an error below 2e-8 before rounding: Abramowitz and Stegun, "Handbook of Mathematical
    // Functions", 4.4.46.
    static inline Real arc_cosine(Real cosine) {
        const Real x = Numbers::min(Numbers::abs(cosine), Numbers::real(1.0f));
        Real total = x * -0.0012624911f + 0.0066700901f;
        total = total * x - 0.0170881256f;
        total = total * x + 0.0308918810f;
        total = total * x - 0.0501743046f;
        total = total * x + 0.0889789874f;
        total = total * x - 0.2145988016f;
        total = total * x + 1.5707963050f;
        const Real angle = Numbers::root(1.0f - x) * total;
        return cosine < 0.0f ? 3.14159265f - angle : angle;
    }

    // The angle of (x, y) from the x axis, from -pi to pi, with an error below 3e-8 before rounding: Abramowitz and
    // Stegun, 4.4.49.
    static inline Real arc_tangent(Real y, Real x) {
        const Real wide = Numbers::abs(x), high = Numbers::abs(y);
        const Whole is_steep = high > wide;
        const Real larger = is_steep ? high : wide, smaller = is_steep ? wide : high;
        const Real ratio = smaller / Numbers::max(larger, Numbers::real(1e-37f)), square = ratio * ratio;
        Real total = square * 0.0028662257f - 0.0161657367f;
        total = total * square + 0.0429096138f;
        total = total * square - 0.0752896400f;
        total = total * square + 0.1065626393f;
        total = total * square - 0.1420889944f;
        total = total * square + 0.1999355085f;
        total = total * square - 0.3333314528f;
        total = ratio + ratio * square * total;
        total = is_steep ? 1.57079633f - total : total;
        total = x < 0.0f ? 3.14159265f - total : total;
        return y < 0.0f ? -total : total;
    }

    // The sine of an angle from -pi / 2 to pi / 2, by its series; the first omitted term is below 6e-8.
    static inline Real sine(Real angle) {
        const Real square = angle * angle;
        Real series = square * (-1.0f / 39916800.0f) + 1.0f / 362880.0f;
        series = series * square - 1.0f / 5040.0f;
        series = series * square + 1.0f / 120.0f;
        series = series * square - 1.0f / 6.0f;
        return angle + angle * square * series;
    }
    // The cosine of any angle: 1 - 2 sin(a / 2)^2, with the nearest multiple of 2 pi subtracted.
    static inline Real cosine(Real angle) {
        const Real turns = angle * 0.159154943f;
        const Real half = sine((turns - Numbers::floor(turns + 0.5f)) * 3.14159265f);
        return 1.0f - 2.0f * half * half;
    }

    // Linear light of a display value, and the inverse (IEC 61966-2-1).
    static inline Real to_linear(Real value) {
        return value <= 0.04045f ? value * (1.0f / 12.92f) : power((value + 0.055f) * (1.0f / 1.055f), 2.4f);
    }
    static inline Real to_screen(Real value) {
        return value <= 0.0031308f ? value * 12.92f : 1.055f * power(value, 1.0f / 2.4f) - 0.055f;
    }
};
