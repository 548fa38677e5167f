// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// SIMD lanes: Clang's vector types, which it maps to AVX-512, AVX2, SSE or NEON registers alike. Comparisons give
// integer lanes, -1 if true and 0 if false, and `mask ? a : b` selects lane by lane.

#pragma once

#include "shared/constants.h"

enum { LANES = CPU_LANES };
static_assert(LANES == 16, "the shuffles below are written for 16 lanes");

typedef float Floats __attribute__((ext_vector_type(LANES)));
typedef int Ints __attribute__((ext_vector_type(LANES)));
typedef double Doubles __attribute__((ext_vector_type(LANES)));

// Positions of the bits that are set, in ascending order.
struct SetBits {
    unsigned remaining;

    inline SetBits begin() const { return *this; }
    inline SetBits end() const { return SetBits{0}; }
    inline bool operator!=(SetBits) const { return remaining != 0; }
    inline int operator*() const { return __builtin_ctz(remaining); }
    inline void operator++() { remaining &= remaining - 1; }
};

struct Lanes {
    static inline Floats all(float value) { return (Floats)(value); }
    static inline Ints all_ints(int value) { return (Ints)(value); }
    static inline Ints index() { return Ints{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}; }
    static inline Floats index_floats() { return Floats{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}; }
    static inline Doubles index_doubles() { return __builtin_convertvector(index(), Doubles); }

    // Callers' arrays may start anywhere: no alignment is assumed.
    static inline Floats load(const float* from) {
        Floats value;
        __builtin_memcpy(&value, from, sizeof value);
        return value;
    }
    static inline Ints load(const int* from) {
        Ints value;
        __builtin_memcpy(&value, from, sizeof value);
        return value;
    }
    static inline void store(float* to, Floats value) { __builtin_memcpy(to, &value, sizeof value); }
    static inline void store(int* to, Ints value) { __builtin_memcpy(to, &value, sizeof value); }

    // As selections, these compile to one instruction each; the builtins take three, to handle NaN.
    static inline Floats min(Floats a, Floats b) { return a < b ? a : b; }
    static inline Floats max(Floats a, Floats b) { return a > b ? a : b; }
    static inline Floats min(Floats a, Floats b, Floats c) { return min(a, min(b, c)); }
    static inline Floats max(Floats a, Floats b, Floats c) { return max(a, max(b, c)); }
    // Minimum of all lanes, by halving. The builtin is slower because it handles NaN.
    static inline float min_of(Floats a) {
        a = min(a, __builtin_shufflevector(a, a, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7));
        a = min(a, __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3));
        a = min(a, __builtin_shufflevector(a, a, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1));
        return a[0] < a[1] ? a[0] : a[1];
    }
    static inline float max_of(Floats a) { return -min_of(-a); }
    static inline float sum_of(Floats a) {
        a += __builtin_shufflevector(a, a, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7);
        a += __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3);
        a += __builtin_shufflevector(a, a, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1);
        return a[0] + a[1];
    }
    static inline Floats abs(Floats a) { return __builtin_elementwise_abs(a); }
    // One bit for every true lane.
    static inline unsigned bits(Ints mask) {
        typedef bool Bools __attribute__((ext_vector_type(LANES)));
        const Bools narrow = __builtin_convertvector(mask, Bools);
        unsigned short word;
        __builtin_memcpy(&word, &narrow, sizeof word);
        return word;
    }
    static inline bool any(Ints mask) { return bits(mask) != 0; }
    static inline int first_lane(unsigned bits) { return __builtin_ctz(bits); }
    // The lanes whose bits are set, or true lanes, in a loop: `for (const int k : Lanes::each(bits))`.
    static inline SetBits each(unsigned bits) { return SetBits{bits}; }
    static inline SetBits each(Ints mask) { return SetBits{bits(mask)}; }
};

// Loads from a place of each lane, one by one or in pairs: they take at most as long as the gather instruction of AVX2.
struct LanePlaces {
    int place[LANES];

    // In memory, since extracting places from registers one by one takes longer.
    explicit inline LanePlaces(Ints places) {
        Lanes::store(place, places);
        __asm__("" : "+m"(place));
    }
    inline Floats numbers(const float* from) const {
        return collect<Floats>([&](int at) { return from[at]; });
    }
    // The first two numbers of items of `size` numbers.
    inline void pairs(const float* from, long long size, Floats* pair) const {
        typedef float Wide __attribute__((ext_vector_type(2 * LANES)));
        const Wide all = (Wide)collect<Doubles>([&](int at) {
            double two;
            __builtin_memcpy(&two, from + size * at, sizeof two);
            return two;
        });
        pair[0] = __builtin_shufflevector(all, all, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
        pair[1] = __builtin_shufflevector(all, all, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
    }
    template <class Values, class Load>
    inline Values collect(const Load& load) const {
        const int* at = place;
        return Values{load(at[0]),  load(at[1]),  load(at[2]),  load(at[3]), load(at[4]),  load(at[5]),
                      load(at[6]),  load(at[7]),  load(at[8]),  load(at[9]), load(at[10]), load(at[11]),
                      load(at[12]), load(at[13]), load(at[14]), load(at[15])};
    }
};

// Three coordinates of sixteen points.
struct Points {
    Floats x, y, z;

    static inline Points minus(Points a, Points b) { return Points{a.x - b.x, a.y - b.y, a.z - b.z}; }
    static inline Points all(float value) { return Points{Lanes::all(value), Lanes::all(value), Lanes::all(value)}; }
    static inline Points select(Ints mask, Points a, Points b) {
        return Points{mask ? a.x : b.x, mask ? a.y : b.y, mask ? a.z : b.z};
    }
    static inline Points plus(Points a, Points b) { return Points{a.x + b.x, a.y + b.y, a.z + b.z}; }
    static inline Floats dot(Points a, Points b) { return a.x * b.x + (a.y * b.y + a.z * b.z); }
    static inline Points cross(Points a, Points b) {
        return Points{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    }
    // Interleave as in memory, x0 y0 z0 x1 y1 z1 ...: x and y are put in place first, then z between them.
    static inline void interleave(const Points& p, Floats* rows) {
        const Floats a = __builtin_shufflevector(p.x, p.y, 0, 16, 0, 1, 17, 0, 2, 18, 0, 3, 19, 0, 4, 20, 0, 5);
        const Floats b = __builtin_shufflevector(p.x, p.y, 21, 0, 6, 22, 0, 7, 23, 0, 8, 24, 0, 9, 25, 0, 10, 26);
        const Floats c = __builtin_shufflevector(p.x, p.y, 0, 11, 27, 0, 12, 28, 0, 13, 29, 0, 14, 30, 0, 15, 31, 0);
        rows[0] = __builtin_shufflevector(a, p.z, 0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15);
        rows[1] = __builtin_shufflevector(b, p.z, 0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15);
        rows[2] = __builtin_shufflevector(c, p.z, 26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31);
    }
};
