// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Counter-based random numbers: a function of the seed and the pixel only, bit-identical on every device.
//
// Modules that include this are compiled with "fuse_fp" False: each product and each sum is rounded, in the order
// written.

#pragma once

#include "shared/scalar.h"

// Philox4x32-10: Salmon, Moraes, Dror and Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3", SC 2011.
constexpr unsigned FIRST_FACTOR = 0xD2511F53u, SECOND_FACTOR = 0xCD9E8D57u;
constexpr unsigned FIRST_STEP = 0x9E3779B9u, SECOND_STEP = 0xBB67AE85u;
constexpr int PHILOX_ROUNDS = 10;
enum { RANDOM_WORDS = 4 };  // of a counter

// Loops over the words of a thread keep them in registers if they are unrolled.
#if defined(__CUDA_ARCH__)
#define UNROLL_ON_CUDA _Pragma("unroll")
#else
#define UNROLL_ON_CUDA
#endif

template <class Numbers>
struct Philox {
    typedef typename Numbers::Word Word;
    Word word[4];

    // Convert a counter into four random words.
    inline void mix(unsigned first_key, unsigned second_key) {
        for (int round = 0; round < PHILOX_ROUNDS; ++round) {
            const Word first = word[0], third = word[2];
            word[0] = Numbers::high_product(third, SECOND_FACTOR) ^ word[1] ^ first_key;
            word[2] = Numbers::high_product(first, FIRST_FACTOR) ^ word[3] ^ second_key;
            word[1] = third * SECOND_FACTOR;
            word[3] = first * FIRST_FACTOR;
            first_key += FIRST_STEP;
            second_key += SECOND_STEP;
        }
    }
};

// Distributions of random words.
template <class Numbers>
struct Random {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Word Word;

    // Uniform in (0, 1): the midpoints of 2^23 equal intervals, all exactly representable.
    static inline Real uniform(Word word) { return Numbers::from_whole((word >> 9) * 2u + 1u) * 0x1p-24f; }

    // log2 of a normal (not subnormal) number: its exponent plus a minimax polynomial of log2(1 + r), with 1 + r from
    // sqrt(1/2) to sqrt(2) and an error below 1.2e-6 r.
    static inline Real log2(Real a) {
        constexpr unsigned ROOT_OF_HALF = 0x3f3504f3u, EXPONENT_BIAS = 127u;
        const Word above = Numbers::bits_of(a) + ((EXPONENT_BIAS << 23) - ROOT_OF_HALF);
        const Real exponent = Numbers::from_whole(above >> 23) - (float)EXPONENT_BIAS;
        const Real r = Numbers::of_bits((above & 0x007fffffu) + ROOT_OF_HALF) - 1.0f;
        Real sum = r * 0.17162392f - 0.26931953f;
        sum = sum * r + 0.2956995f;
        sum = sum * r - 0.35937172f;
        sum = sum * r + 0.48062676f;
        sum = sum * r - 0.72136354f;
        sum = sum * r + 1.4426965f;
        return exponent + sum * r;
    }

    // Standard normal, by the inverse of the cumulative distribution function: for x = 2 u - 1 in (-1, 1), it is x
    // times a smooth function of t = -log2(1 - x^2), approximated by a minimax polynomial in s = sqrt(t + 5.5) - 3.75
    // with a relative error below 3e-5. The extreme words map to +-6.3.
    static inline Real normal(Word word) {
        constexpr unsigned MOST = 0x7fffffffu;
        // distance from the middle of the range, in units of 2^-31
        const Word above = (word ^ ((word >> 31) - 1u)) & MOST;
        const Real to_end = (Numbers::from_whole(MOST - above) + 0.5f) * 0x1p-31f;
        const Real to_middle = (Numbers::from_whole(above) + 0.5f) * 0x1p-31f;
        const Real s = Numbers::root(5.5f - log2(to_end * (2.0f - to_end))) - 3.75f;
        Real sum = s * -0.00051696796f + 0.002595633f;
        sum = sum * s - 0.0012092399f;
        sum = sum * s - 0.014979157f;
        sum = sum * s + 0.03480383f;
        sum = sum * s - 0.02056774f;
        sum = sum * s - 0.06026775f;
        sum = sum * s + 1.4751731f;
        sum = sum * s + 3.2151785f;
        const Real size = sum * to_middle;
        return Numbers::of_bits(Numbers::bits_of(size) | (~word & ~MOST));
    }

    // Cumulative distribution function of the standard normal distribution, below 1, with an error below 2e-6:
    // Hastings' approximation of the error function (Abramowitz and Stegun 7.1.28) for arguments over sqrt(2).
    static inline Real cumulative(Real a) {
        const Real size = Numbers::abs(a);
        Real sum = size * 5.3829750e-6f + 4.8890636e-5f;
        sum = sum * size + 3.8003575e-5f;
        sum = sum * size + 3.2776264e-3f;
        sum = sum * size + 2.1141006e-2f;
        sum = sum * size + 4.9867347e-2f;
        sum = sum * size + 1.0f;
        for (int k = 0; k < 4; ++k) sum = sum * sum;
        const Real tail = 0.5f / sum, most = Numbers::real(1.0f - 0x1p-24f);
        return a < 0.0f ? tail : Numbers::min(1.0f - tail, most);
    }
};

// Key of the random words of an image; y and x complete the counter.
struct RandomKey {
    unsigned seed, view, frame;
};

// Random words of adjacent pixels of a row, from a multiple of four on: four share a counter. This version is for four
// pixels, one after the other.
template <class Numbers>
struct PixelWords {
    enum { WORDS = RANDOM_WORDS, PIXELS = WORDS };
    unsigned block[WORDS];

    static inline PixelWords draw(const RandomKey& key, unsigned stream, int y, int x) {
        Philox<Numbers> numbers = {{(unsigned)x >> 2, (unsigned)y, key.view, key.frame}};
        numbers.mix(key.seed, stream);
        return PixelWords{{numbers.word[0], numbers.word[1], numbers.word[2], numbers.word[3]}};
    }
    // The word of any pixel.
    static inline unsigned draw_one(const RandomKey& key, unsigned stream, int y, int x) {
        const PixelWords words = draw(key, stream, y, x);
        // Selected, because an index would move the words to memory.
        const unsigned low = x & 1 ? words.block[1] : words.block[0], high = x & 1 ? words.block[3] : words.block[2];
        return x & 2 ? high : low;
    }
};

// Standard normal numbers of the same pixels.
template <class Numbers>
struct PixelNormals {
    typename Numbers::Real block[PixelWords<Numbers>::WORDS];

    static inline PixelNormals of(const PixelWords<Numbers>& words) {
        PixelNormals normals;
        UNROLL_ON_CUDA
        for (int k = 0; k < PixelWords<Numbers>::WORDS; ++k) normals.block[k] = Random<Numbers>::normal(words.block[k]);
        return normals;
    }
};

// Numbers of a thread's pixels at adjacent places, of which `count` remain in the row. On CUDA, they are stored at
// once: partial writes of sectors of memory would take as long as whole ones.
template <class Numbers, class Number>
struct GroupStore {
    Number* to;
    int count;
#if defined(__CUDA_ARCH__)
    Number values[RANDOM_WORDS];

    inline void put(int k, Number value) { values[k] = value; }
    inline void flush() const {
        if (count >= RANDOM_WORDS && ((unsigned long long)to & (RANDOM_WORDS * sizeof(Number) - 1)) == 0) {
            store_all(to);
        } else {
#pragma unroll
            for (int k = 0; k < RANDOM_WORDS; ++k)
                if (k < count) to[k] = values[k];
        }
    }
    inline void store_all(float* all) const { *(float4*)all = make_float4(values[0], values[1], values[2], values[3]); }
    inline void store_all(int* all) const { *(int4*)all = make_int4(values[0], values[1], values[2], values[3]); }
    inline void store_all(unsigned char* all) const {
        *(uchar4*)all = make_uchar4(values[0], values[1], values[2], values[3]);
    }
#else
    template <class Value>
    inline void put(int k, Value value) {
        Numbers::store(to + k * Numbers::PIXELS, value, count - k * Numbers::PIXELS);
    }
    inline void flush() const {}
#endif
};

// Call a function with the first column of every `PIXELS` pixels of a thread, which processes as many on CUDA, those of
// group x, and a row on a CPU.
template <int PIXELS, class Function>
inline void for_groups(int width, int x, const Function& function) {
#if defined(__CUDA_ARCH__)
    if (x * PIXELS < width) function(x * PIXELS);
#else
    for (x = 0; x < width; x += PIXELS) function(x);
#endif
}
// The same for pixels that share random words.
template <class Numbers, class Function>
inline void for_pixels(int width, int x, const Function& function) {
    for_groups<PixelWords<Numbers>::PIXELS>(width, x, function);
}

// Write standard normal numbers for the pixels of a thread.
template <class Numbers, class Image>
inline void draw_normals(const RandomKey& key, unsigned stream, const Image& image, int view, int y, int x) {
    const int width = image.shape[2];
    float* row = image.data + ((long long)view * image.shape[1] + y) * width;
    for_pixels<Numbers>(width, x, [&](int column) {
        const auto normals = PixelNormals<Numbers>::of(PixelWords<Numbers>::draw(key, stream, y, column));
        GroupStore<Numbers, float> stored = {row + column, width - column};
        UNROLL_ON_CUDA
        for (int k = 0; k < PixelWords<Numbers>::WORDS && column + k * Numbers::PIXELS < width; ++k)
            stored.put(k, normals.block[k]);
        stored.flush();
    });
}
