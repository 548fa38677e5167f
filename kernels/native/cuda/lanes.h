// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The lanes of a CUDA warp, and number types for one lane.

#pragma once

#include "shared/constants.h"

// Warp-wide operations: all lanes of a warp call them together.

enum { LANES = CUDA_LANES };
static_assert(LANES == 32, "lanes of a warp, bits of a word, and threads that Python launches per packet");

struct Warp {
    enum { all = 0xffffffffu };

    static inline int lane() { return threadIdx.x & (LANES - 1); }
    static inline void sync() { __syncwarp(); }
    static inline unsigned ballot(bool condition) { return __ballot_sync(all, condition); }
    static inline bool any(bool condition) { return __any_sync(all, condition); }
    static inline int shuffle(int value, int lane) { return __shfl_sync(all, value, lane); }
    // A value that is equal in all lanes, returned so that the compiler knows it to be uniform: it needs no per-lane
    // register.
    static inline int uniform(int value) { return (int)reduce_max((unsigned)value); }
    static inline int first_lane(unsigned lanes) { return __ffs(lanes) - 1; }
    static inline unsigned without_first_lane(unsigned lanes) { return lanes & (lanes - 1); }

#if __CUDA_ARCH__ >= 800
    static inline unsigned reduce_min(unsigned value) { return __reduce_min_sync(all, value); }
    static inline unsigned reduce_max(unsigned value) { return __reduce_max_sync(all, value); }
    static inline unsigned reduce_or(unsigned bits) { return __reduce_or_sync(all, bits); }
#else
    static inline unsigned reduce_min(unsigned value) {
        for (int other = LANES / 2; other; other >>= 1) value = min(value, __shfl_xor_sync(all, value, other));
        return value;
    }
    static inline unsigned reduce_max(unsigned value) { return ~reduce_min(~value); }
    static inline unsigned reduce_or(unsigned bits) {
        for (int other = LANES / 2; other; other >>= 1) bits |= __shfl_xor_sync(all, bits, other);
        return bits;
    }
#endif
};

// The L2 cache, shared by all multiprocessors.
struct Cache {
    // Prefetch `rows` rows of one number per lane into L2; called by one thread.
    static inline void prefetch(const float* first, int rows) {
#if defined(__CUDACC_RTC__)
        for (int row = 0; row < rows; ++row) asm volatile("prefetch.global.L2 [%0];" ::"l"(first + row * LANES));
#else
        (void)first, (void)rows;
#endif
    }
};

// Three coordinates. Sums of products use explicit fused multiply-add, so that every kernel rounds in the same way.
struct Vec3 {
    float x, y, z;

    static inline Vec3 minus(Vec3 a, Vec3 b) { return Vec3{a.x - b.x, a.y - b.y, a.z - b.z}; }
    static inline Vec3 plus(Vec3 a, Vec3 b) { return Vec3{a.x + b.x, a.y + b.y, a.z + b.z}; }
    static inline float dot(Vec3 a, Vec3 b) { return __fmaf_rn(a.x, b.x, __fmaf_rn(a.y, b.y, __fmul_rn(a.z, b.z))); }
    // Cross product; its sign flips exactly if a is negated.
    static inline Vec3 cross(Vec3 a, Vec3 b) {
        return Vec3{__fmaf_rn(a.y, b.z, -__fmul_rn(a.z, b.y)), __fmaf_rn(a.z, b.x, -__fmul_rn(a.x, b.z)),
                    __fmaf_rn(a.x, b.y, -__fmul_rn(a.y, b.x))};
    }
    // The products of three rows and a vector.
    static inline Vec3 rotated(const Vec3* rows, Vec3 v) {
        return Vec3{dot(rows[0], v), dot(rows[1], v), dot(rows[2], v)};
    }
    // A point at a distance along a ray.
    static inline Vec3 along(Vec3 start, Vec3 ray, float z) {
        return Vec3{__fmaf_rn(z, ray.x, start.x), __fmaf_rn(z, ray.y, start.y), __fmaf_rn(z, ray.z, start.z)};
    }
};
static_assert(sizeof(Vec3) == 3 * sizeof(float), "rows of axes are read as numbers");

struct Reciprocal {
    // Approximation of 1 / x, correct but for the last digit or two; not valid for values close to 0 or to infinity.
    static inline float about(float x) {
#if defined(__CUDACC_RTC__)
        float value;
        asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(value) : "f"(x));
        return value;
#else
        return 1.0f / x;
#endif
    }
    // 1 / x, rounded, by one step of Newton's method: the same as a division, without the call for x = 0.
    static inline float of(float x) {
        const float value = about(x);
        return __fmaf_rn(value, -__fmaf_rn(x, value, -1.0f), value);
    }
};

struct Root {
    // Approximation of the square root of x, correct but for the last digits; NaN if x is 0.
    static inline float about(float x) {
#if defined(__CUDACC_RTC__)
        float value;
        asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(value) : "f"(x));
        return x * value;
#else
        return x * (1.0f / sqrtf(x));
#endif
    }
};

struct Three {
    static inline float min(float a, float b, float c) { return fminf(a, fminf(b, c)); }
    static inline float max(float a, float b, float c) { return fmaxf(a, fmaxf(b, c)); }
};

// An integer from 0 to 2^23 as a float by two cheap instructions; a conversion takes as long as four.
struct SmallInt {
    enum { BITS_OF_2_TO_23 = 0x4b000000 };
    static inline float to_float(int n) { return __int_as_float(BITS_OF_2_TO_23 | n) - (float)(1 << 23); }
};
