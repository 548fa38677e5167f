// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "shared/constants.h"

// Numbers of one pixel, of formulas that are compiled for one pixel and for 16 pixels at a time (cpu/number_lanes.h).
struct OnePixel {
    typedef float Real;
    typedef double Double;
    typedef int Whole;
    typedef unsigned Word;
    enum { PIXELS = 1 };

    // Broadcast a number to all pixels.
    static inline float real(float a) { return a; }
    static inline int whole(int a) { return a; }
    static inline unsigned high_product(unsigned a, unsigned b) { return (unsigned)((unsigned long long)a * b >> 32); }
    // Convert an integer below 2^31, rounded to nearest.
    static inline float from_whole(unsigned a) { return (float)(int)a; }
#if defined(__CUDA_ARCH__)
    static inline unsigned bits_of(float a) { return __float_as_uint(a); }
    static inline float of_bits(unsigned bits) { return __uint_as_float(bits); }
    static inline float floor(float a) { return floorf(a); }
    static inline double floor(double a) { return ::floor(a); }
    static inline float round(float a) { return rintf(a); }
    static inline float root(float a) { return __fsqrt_rn(a); }
    static inline double root(double a) { return __dsqrt_rn(a); }
#else
    static inline unsigned bits_of(float a) {
        unsigned bits;
        __builtin_memcpy(&bits, &a, sizeof bits);
        return bits;
    }
    static inline float of_bits(unsigned bits) {
        float a;
        __builtin_memcpy(&a, &bits, sizeof a);
        return a;
    }
    static inline float floor(float a) { return __builtin_floorf(a); }
    static inline double floor(double a) { return __builtin_floor(a); }
    static inline float round(float a) { return __builtin_rintf(a); }  // half to even
    static inline float root(float a) { return __builtin_sqrtf(a); }
    static inline double root(double a) { return __builtin_sqrt(a); }
#endif
    static inline float abs(float a) { return of_bits(bits_of(a) & 0x7fffffffu); }

    static inline float min(float a, float b) { return a < b ? a : b; }
    static inline float max(float a, float b) { return a > b ? a : b; }
    static inline double wide(float a) { return (double)a; }
    static inline float narrow(double a) { return (float)a; }
    static inline double to_double(int a) { return (double)a; }
    static inline int truncate(float a) { return (int)a; }
    static inline float to_real(int a) { return (float)a; }
    static inline float gather(const float* from, int index) { return from[index]; }
    static inline int gather(const int* from, int index) { return from[index]; }
    // The numbers at an index and after it, or the three numbers of a triple.
    static inline void gather_pairs(const float* from, int index, float* pair) {
        pair[0] = from[index];
        pair[1] = from[index + 1];
    }
    static inline void gather_triples(const float* from, int index, float* triple) {
        for (int k = 0; k < 3; ++k) triple[k] = from[3LL * index + k];
    }

    static inline double select(int which, double a, double b) { return which ? a : b; }
    static inline bool all_between(double a, double first, double end) { return a >= first && a < end; }

    static inline bool all(int which) { return which != 0; }
    static inline bool any(int which) { return which != 0; }
    static inline int first(int) { return 0; }
    static inline int sum(int a) { return a; }
    static inline int get(int a, int) { return a; }
    // The number of pixel k.
    static inline float get(float a, int) { return a; }
    static inline double get(double a, int) { return a; }
    static inline void set(float& a, int, float value) { a = value; }
    static inline void set(double& a, int, double value) { a = value; }

    static inline float endless() { return of_bits(0x7f800000u); }
    static inline float no_number() { return of_bits(0x7fc00000u); }

    // Load the numbers of pixels from an address on; `count` pixels of the row remain.
    static inline float load(const float* from, int) { return *from; }
    static inline int load(const int* from, int) { return *from; }
    static inline double load(const double* from, int) { return *from; }
    static inline int load(const unsigned char* from, int) { return *from; }
    // Repeat each number `times` times: does not apply to a single pixel.
    static inline bool repeats(int) { return false; }
    static inline float repeated(float a, int) { return a; }
    // Load interleaved triples x y z x y z ...
    static inline void load_triples(const float* from, float* triple, int) {
        for (int k = 0; k < 3; ++k) triple[k] = from[k];
    }
    static inline void store(float* to, float value, int) { *to = value; }
    static inline void store(int* to, int value, int) { *to = value; }
    static inline void store(unsigned char* to, int value, int) { *to = (unsigned char)value; }
    static inline void store_pairs(float* to, float first, float second, int) {
        to[0] = first;
        to[1] = second;
    }
    static inline void store_triples(unsigned char* to, int red, int green, int blue, int) {
        to[0] = (unsigned char)red, to[1] = (unsigned char)green, to[2] = (unsigned char)blue;
    }
    static inline float columns(int first) { return (float)first; }
    static inline int indices(int first) { return first; }
};
