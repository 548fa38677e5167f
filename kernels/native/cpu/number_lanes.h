// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/lanes.h"

// Numbers of 16 pixels: the counterpart of OnePixel of shared/scalar.h.
struct PixelLanes {
    typedef Floats Real;
    typedef Doubles Double;
    typedef Ints Whole;
    typedef unsigned Word __attribute__((ext_vector_type(LANES)));
    enum { PIXELS = LANES };

    static inline Floats real(float a) { return Lanes::all(a); }
    static inline Ints whole(int a) { return Lanes::all_ints(a); }
    static inline Word high_product(Word a, unsigned b) {
        typedef unsigned long long Longs __attribute__((ext_vector_type(LANES)));
        return __builtin_convertvector((__builtin_convertvector(a, Longs) * (unsigned long long)b) >> 32, Word);
    }
    // Convert integers below 2^31, rounded to nearest.
    static inline Floats from_whole(Word a) { return __builtin_convertvector((Ints)a, Floats); }
    static inline Word bits_of(Floats a) { return (Word)a; }
    static inline Floats of_bits(Word bits) { return (Floats)bits; }
    static inline Floats floor(Floats a) { return __builtin_elementwise_floor(a); }
    static inline Floats round(Floats a) { return __builtin_elementwise_rint(a); }
    static inline Floats root(Floats a) { return __builtin_elementwise_sqrt(a); }
    static inline Double floor(Double a) { return __builtin_elementwise_floor(a); }
    static inline Double root(Double a) { return __builtin_elementwise_sqrt(a); }
    static inline Floats abs(Floats a) { return Lanes::abs(a); }
    static inline Floats min(Floats a, Floats b) { return Lanes::min(a, b); }
    static inline Floats max(Floats a, Floats b) { return Lanes::max(a, b); }
    static inline Double wide(Floats a) { return __builtin_convertvector(a, Double); }
    static inline Floats narrow(Double a) { return __builtin_convertvector(a, Floats); }
    static inline Double to_double(Ints a) { return __builtin_convertvector(a, Double); }
    static inline Ints truncate(Floats a) { return __builtin_convertvector(a, Ints); }
    static inline Floats to_real(Ints a) { return __builtin_convertvector(a, Floats); }
    static inline Floats gather(const float* from, Ints index) { return LanePlaces(index).numbers(from); }
    static inline Ints gather(const int* from, Ints index) { return (Ints)gather((const float*)from, index); }
    // The numbers at indices and after them, or the three numbers of triples.
    static inline void gather_pairs(const float* from, Ints index, Floats* pair) {
        LanePlaces(index).pairs(from, 1, pair);
    }
    static inline void gather_triples(const float* from, Ints index, Floats* triple) {
        const LanePlaces places(index);
        places.pairs(from, 3, triple);
        triple[2] = places.collect<Floats>([&](int place) { return from[3LL * place + 2]; });
    }

    // The numbers of other pixels.
    static inline Floats permuted(Floats a, Ints pixel) { return gather((const float*)&a, pixel); }
    static inline Ints permuted(Ints a, Ints pixel) { return gather((const int*)&a, pixel); }

    // Doubles by a mask of pixels.
    static inline Double select(Ints which, Double a, Double b) {
        typedef long long Longs __attribute__((ext_vector_type(LANES)));
        return __builtin_convertvector(which, Longs) ? a : b;
    }
    // Whether all numbers are from `first` to below `end`.
    static inline bool all_between(Double a, double first, double end) {
        return all(__builtin_convertvector((a >= first) & (a < end), Ints));
    }

    static inline bool all(Ints which) { return Lanes::bits(which) == (1u << LANES) - 1u; }
    static inline bool any(Ints which) { return Lanes::any(which); }
    static inline int first(Ints which) { return Lanes::first_lane(Lanes::bits(which)); }
    static inline int sum(Ints a) { return __builtin_reduce_add(a); }
    static inline int get(Ints a, int k) { return a[k]; }
    static inline float get(Floats a, int k) { return a[k]; }
    static inline double get(Double a, int k) { return a[k]; }
    static inline void set(Floats& a, int k, float value) { a[k] = value; }
    static inline void set(Double& a, int k, double value) { a[k] = value; }

    static inline float endless() { return __builtin_inff(); }
    static inline float no_number() { return __builtin_nanf(""); }

    // Load the numbers of pixels from an address on; `count` pixels of the row remain.
    static inline Floats load(const float* from, int count) {
        if (count >= LANES) return Lanes::load(from);
        Floats value = Lanes::all(0.0f);
        __builtin_memcpy(&value, from, count * sizeof(float));
        return value;
    }
    static inline Ints load(const int* from, int count) { return (Ints)load((const float*)from, count); }
    static inline Doubles load(const double* from, int count) {
        Doubles value = (Doubles)(0.0);
        if (count >= LANES)
            __builtin_memcpy(&value, from, sizeof value);
        else
            __builtin_memcpy(&value, from, count * sizeof(double));
        return value;
    }
    // Repeat each number `times` times.
    static inline bool repeats(int times) { return times == 2 || times == 4 || times == 8; }
    static inline Floats repeated(Floats a, int times) {
        if (times == 2) return __builtin_shufflevector(a, a, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7);
        if (times == 4) return __builtin_shufflevector(a, a, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
        return __builtin_shufflevector(a, a, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1);
    }
    static inline Ints load(const unsigned char* from, int count) {
        typedef unsigned char Bytes __attribute__((ext_vector_type(LANES)));
        Bytes bytes = (Bytes)(0);
        __builtin_memcpy(&bytes, from, count < LANES ? count : LANES);
        return __builtin_convertvector(bytes, Ints);
    }
    // Load interleaved triples x y z x y z ...
    static inline void load_triples(const float* from, Floats* triple, int count) {
        float padded[3 * LANES] = {};
        if (count < LANES) {
            __builtin_memcpy(padded, from, 3 * count * sizeof(float));
            from = padded;
        }
        const Floats a = Lanes::load(from), b = Lanes::load(from + LANES), c = Lanes::load(from + 2 * LANES);
        const Floats x = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0);
        const Floats y = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0);
        const Floats z = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0);
        triple[0] = __builtin_shufflevector(x, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29);
        triple[1] = __builtin_shufflevector(y, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30);
        triple[2] = __builtin_shufflevector(z, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31);
    }
    // With a constant size, a copy is one instruction instead of a call.
    template <class Number, class Numbers>
    static inline void store(Number* to, Numbers value, int count) {
        if (count >= LANES)
            __builtin_memcpy(to, &value, LANES * sizeof(Number));
        else
            __builtin_memcpy(to, &value, count * sizeof(Number));
    }
    static inline void store(unsigned char* to, Ints value, int count) {
        typedef unsigned char Bytes __attribute__((ext_vector_type(LANES)));
        store<unsigned char>(to, __builtin_convertvector(value, Bytes), count);
    }
    static inline void store_pairs(float* to, Floats first, Floats second, int count) {
        const Floats low =
            __builtin_shufflevector(first, second, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
        const Floats high =
            __builtin_shufflevector(first, second, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
        store(to, low, 2 * count);
        if (count > LANES / 2) store(to + LANES, high, 2 * count - LANES);
    }
    // Interleave the bytes of three colors.
    static inline void store_triples(unsigned char* to, Ints red, Ints green, Ints blue, int count) {
        typedef unsigned char Bytes __attribute__((ext_vector_type(LANES)));
        const Bytes r = __builtin_convertvector(red, Bytes), g = __builtin_convertvector(green, Bytes);
        const Bytes b = __builtin_convertvector(blue, Bytes);
        // Red and green with gaps (-1), then blue in the gaps.
        const Bytes p = __builtin_shufflevector(r, g, 0, 16, -1, 1, 17, -1, 2, 18, -1, 3, 19, -1, 4, 20, -1, 5);
        const Bytes q = __builtin_shufflevector(r, g, 21, -1, 6, 22, -1, 7, 23, -1, 8, 24, -1, 9, 25, -1, 10, 26);
        const Bytes s = __builtin_shufflevector(r, g, -1, 11, 27, -1, 12, 28, -1, 13, 29, -1, 14, 30, -1, 15, 31, -1);
        const Bytes bytes[3] = {
            __builtin_shufflevector(p, b, 0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15),
            __builtin_shufflevector(q, b, 0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15),
            __builtin_shufflevector(s, b, 26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31),
        };
        if (count >= LANES)
            __builtin_memcpy(to, bytes, sizeof bytes);
        else
            __builtin_memcpy(to, bytes, 3 * count);
    }
    static inline Floats columns(int first) { return Lanes::index_floats() + (float)first; }
    static inline Ints indices(int first) { return Lanes::index() + first; }
};
