// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// What the random words of pixels follow from, beside y and x.
struct RandomKey {
    unsigned seed, view, frame;
};

// Random words of neighbouring pixels of a row: four of them share a counter. Here, of one.
struct PixelWords {
    enum { PIXELS = 1 };
    Word block[1];

    static inline PixelWords draw(const RandomKey& key, unsigned stream, int y, int x) {
        Philox numbers = {{(unsigned)x >> 2, (unsigned)y, key.view, key.frame}};
        numbers.mix(key.seed, stream);
        return PixelWords{{numbers.word[x & 3]}};
    }
};
