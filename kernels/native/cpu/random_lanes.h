// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// What the random words of pixels follow from, beside y and x.
struct RandomKey {
    unsigned seed, view, frame;
};

// Random words of neighbouring pixels of a row, as in shared/random_pixel.h: of four times sixteen, from a multiple of
// four on.
struct PixelWords {
    enum { WORDS = 4, PIXELS = WORDS * LANES };
    Word block[WORDS];

    static inline PixelWords draw(const RandomKey& key, unsigned stream, int y, int x) {
        const Word counters = (Word)Lanes::index() + ((unsigned)x >> 2);
        Philox numbers = {{counters, all((unsigned)y), all(key.view), all(key.frame)}};
        numbers.mix(key.seed, stream);
        unsigned in_order[PIXELS];
        for (int k = 0; k < LANES; ++k)
            for (int word = 0; word < WORDS; ++word) in_order[k * WORDS + word] = numbers.word[word][k];
        PixelWords words;
        __builtin_memcpy(words.block, in_order, sizeof in_order);
        return words;
    }
    static inline Word all(unsigned value) { return (Word)(value); }
};
