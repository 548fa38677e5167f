// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The corruptions of kernels/sensors/corruptions.py applied to rows of pixels.

struct Corruption {
    float added, multiplied, dropout;
    SensorRange range;
    const int* rectangles;  // of the view: left, top, right and bottom of each
    int rectangle_count;

    // Random words of the pixels that share counters; those of disabled corruptions are not drawn.
    struct Words {
        PixelWords lost, multiplied, added;
    };

    inline void corrupt(const NoiseRow& row) const {
        for (int x = 0; x < row.width; x += PixelWords::PIXELS) {
            Words words;
            if (dropout > 0.0f) words.lost = PixelWords::draw(row.key, STREAM_LOST, row.y, x);
            if (multiplied > 0.0f) words.multiplied = PixelWords::draw(row.key, STREAM_MULTIPLIED, row.y, x);
            if (added > 0.0f) words.added = PixelWords::draw(row.key, STREAM_ADDED, row.y, x);
            for (int k = 0; k < PixelWords::WORDS && x + k * LANES < row.width; ++k)
                corrupt_lanes(row, words, k, x + k * LANES);
        }
    }
    inline void corrupt_lanes(const NoiseRow& row, const Words& words, int k, int x) const {
        Floats before;
        Ints reason = Lanes::all_ints(REASON_EMPTY);
        if (row.depth) {
            const Floats exact = row.exact(x);
            before = range.report(exact);
            reason = SensorRange::finite(exact) ? SensorRange::reason(before) : reason;
        } else {
            before = Numbers::load(row.depth_out + x, row.width - x);
            if (row.reasons_out) reason = Numbers::load(row.reasons_out + x, row.width - x);
        }
        Floats depth = before;
        if (multiplied > 0.0f) depth = depth * (1.0f + multiplied * Random::normal(words.multiplied.block[k]));
        if (added > 0.0f) depth = depth + added * Random::normal(words.added.block[k]);
        depth = range.report(depth);
        const Ints lost = is_lost(words, k, x, row.y), has_surface = SensorRange::finite(before);
        const Ints cause = lost ? Lanes::all_ints(REASON_DROPOUT) : SensorRange::reason(depth);
        depth = lost ? Lanes::all(Numbers::no_number()) : depth;
        row.write(x, has_surface ? depth : before, has_surface ? cause : reason);
    }
    inline Ints is_lost(const Words& words, int k, int x, int y) const {
        Ints lost = Lanes::all_ints(0);
        if (dropout > 0.0f) lost = Random::uniform(words.lost.block[k]) < dropout;
        const Ints column = Lanes::index() + x;
        for (int i = 0; i < rectangle_count; ++i) {
            const int* box = rectangles + 4 * i;
            if (y >= box[1] && y < box[3]) lost |= (column >= box[0]) & (column < box[2]);
        }
        return lost;
    }
};
