// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The 32 lanes of a CUDA warp. All of them call these together.
//
// Text of this file and the next is pasted into a function: local structs of static functions only.

struct Warp {
    enum { all = 0xffffffffu };

    static inline int lane() { return threadIdx.x & 31; }
    static inline void sync() { __syncwarp(); }
    static inline unsigned lanes_where(bool condition) { return __ballot_sync(all, condition); }
    static inline bool any(bool condition) { return __any_sync(all, condition); }
    static inline int from(int value, int lane) { return __shfl_sync(all, value, lane); }
    static inline int first_of(unsigned lanes) { return __ffs(lanes) - 1; }
    static inline unsigned without_first(unsigned lanes) { return lanes & (lanes - 1); }

#if __CUDA_ARCH__ >= 800
    static inline unsigned least(unsigned value) { return __reduce_min_sync(all, value); }
    static inline unsigned most(unsigned value) { return __reduce_max_sync(all, value); }
    static inline unsigned united(unsigned bits) { return __reduce_or_sync(all, bits); }
#else
    static inline unsigned least(unsigned value) {
        for (int other = 16; other; other >>= 1) value = min(value, __shfl_xor_sync(all, value, other));
        return value;
    }
    static inline unsigned most(unsigned value) { return ~least(~value); }
    static inline unsigned united(unsigned bits) {
        for (int other = 16; other; other >>= 1) bits |= __shfl_xor_sync(all, bits, other);
        return bits;
    }
#endif
};

// Three coordinates. Products that are summed are fused by name, so that every kernel rounds in the same way.
struct Vec {
    float x, y, z;

    static inline Vec minus(Vec a, Vec b) { return Vec{a.x - b.x, a.y - b.y, a.z - b.z}; }
    static inline Vec plus(Vec a, Vec b) { return Vec{a.x + b.x, a.y + b.y, a.z + b.z}; }
    static inline float dot(Vec a, Vec b) { return __fmaf_rn(a.x, b.x, __fmaf_rn(a.y, b.y, __fmul_rn(a.z, b.z))); }
    // Exactly the negative where a is negated.
    static inline Vec cross(Vec a, Vec b) {
        return Vec{__fmaf_rn(a.y, b.z, -__fmul_rn(a.z, b.y)), __fmaf_rn(a.z, b.x, -__fmul_rn(a.x, b.z)),
                   __fmaf_rn(a.x, b.y, -__fmul_rn(a.y, b.x))};
    }
};

struct Three {
    static inline float least(float a, float b, float c) { return fminf(a, fminf(b, c)); }
    static inline float most(float a, float b, float c) { return fmaxf(a, fmaxf(b, c)); }
};

// A whole number from 0 to 2^23 as a float: two cheap instructions, where a conversion takes as long as four.
struct Whole {
    static inline float of(int n) { return __int_as_float(0x4b000000 | n) - 8388608.0f; }
};
