// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/number_lanes.h"
#include "shared/random.h"

// Numbers of two registers of pixels: a core computes both at once, as long chains of operations leave it waiting.
struct PixelPairs {
    typedef float Real __attribute__((ext_vector_type(2 * LANES)));
    typedef unsigned Word __attribute__((ext_vector_type(2 * LANES)));
    typedef int Whole __attribute__((ext_vector_type(2 * LANES)));

    static inline Real from_whole(Word a) { return __builtin_convertvector((Whole)a, Real); }
    static inline Word bits_of(Real a) { return (Word)a; }
    static inline Real of_bits(Word bits) { return (Real)bits; }
    static inline Real root(Real a) { return __builtin_elementwise_sqrt(a); }
};

// Random words of 4 x 16 pixels, from a multiple of four on.
template <>
struct PixelWords<PixelLanes> {
    typedef PixelLanes::Word Word;
    enum { WORDS = 4, PIXELS = WORDS * LANES };
    Word block[WORDS];

    static inline PixelWords draw(const RandomKey& key, unsigned stream, int y, int x) {
        const Word counters = (Word)Lanes::index() + ((unsigned)x >> 2);
        Philox<PixelLanes> numbers = {{counters, all((unsigned)y), all(key.view), all(key.frame)}};
        numbers.mix(key.seed, stream);
        const Word* word = numbers.word;
        const Word low[2] = {lower(word[0], word[1]), lower(word[2], word[3])};
        const Word high[2] = {upper(word[0], word[1]), upper(word[2], word[3])};
        return PixelWords{{pairs_of_lower(low[0], low[1]), pairs_of_upper(low[0], low[1]),
                           pairs_of_lower(high[0], high[1]), pairs_of_upper(high[0], high[1])}};
    }
    // Interleave the first halves of a and b, or the second halves.
    static inline Word lower(Word a, Word b) {
        return __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
    }
    static inline Word upper(Word a, Word b) {
        return __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
    }
    // Interleave pairs of a and b.
    static inline Word pairs_of_lower(Word a, Word b) {
        return __builtin_shufflevector(a, b, 0, 1, 16, 17, 2, 3, 18, 19, 4, 5, 20, 21, 6, 7, 22, 23);
    }
    static inline Word pairs_of_upper(Word a, Word b) {
        return __builtin_shufflevector(a, b, 8, 9, 24, 25, 10, 11, 26, 27, 12, 13, 28, 29, 14, 15, 30, 31);
    }
    static inline Word all(unsigned value) { return (Word)(value); }
};

template <>
inline PixelNormals<PixelLanes> PixelNormals<PixelLanes>::of(const PixelWords<PixelLanes>& words) {
    PixelNormals normals;
    for (int k = 0; k < PixelWords<PixelLanes>::WORDS; k += 2) {
        PixelPairs::Word pair;
        __builtin_memcpy(&pair, words.block + k, sizeof pair);
        const PixelPairs::Real both = Random<PixelPairs>::normal(pair);
        __builtin_memcpy(normals.block + k, &both, sizeof both);
    }
    return normals;
}
