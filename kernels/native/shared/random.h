// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Random numbers that follow from where they are used alone, the same bits on every device.
//
// Modules that use this are compiled with "fuse_fp" False: each product and each sum is rounded, in the order written.

// Philox4x32-10: Salmon, Moraes, Dror and Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3", SC 2011.
constexpr unsigned FIRST_FACTOR = 0xD2511F53u, SECOND_FACTOR = 0xCD9E8D57u;
constexpr unsigned FIRST_STEP = 0x9E3779B9u, SECOND_STEP = 0xBB67AE85u;
constexpr int PHILOX_ROUNDS = 10;

struct Philox {
    Word word[4];

    // Turn a counter into four random words.
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

// What random words are made into.
struct Random {
    // Uniform in (0, 1): the middles of 2^23 equal parts, none of which is rounded.
    static inline Real uniform(Word word) { return Numbers::from_whole((word >> 9) * 2u + 1u) * 0x1p-24f; }

    // log2 of normal numbers: of 1 + r from sqrt(1/2) to sqrt(2), a minimax polynomial, wrong by less than 1.2e-6 r.
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

    // Standard normal, by the inverse of its distribution: of x = 2 u - 1 in (-1, 1) it is x times a smooth function of
    // -log2(1 - x^2), for which a minimax polynomial of a root of that stands, wrong by less than 3e-5 of the result.
    // The words' ends are 6.3 from the middle.
    static inline Real normal(Word word) {
        constexpr unsigned MOST = 0x7fffffffu;
        const Word above = (word ^ ((word >> 31) - 1u)) & MOST;  // how far from the middle, in 2^31 parts
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
};
