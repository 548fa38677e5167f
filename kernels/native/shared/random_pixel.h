// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// Key of the random words of an image; y and x complete the counter.
struct RandomKey {
    unsigned seed, view, frame;
};

// Random words of adjacent pixels of a row: four share a counter. This version returns the word of one pixel.
struct PixelWords {
    enum { WORDS = 1, PIXELS = 1 };
    Word block[1];

    static inline PixelWords draw(const RandomKey& key, unsigned stream, int y, int x) {
        Philox numbers = {{(unsigned)x >> 2, (unsigned)y, key.view, key.frame}};
        numbers.mix(key.seed, stream);
        return PixelWords{{numbers.word[x & 3]}};
    }
};
