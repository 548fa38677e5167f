// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Generic noise and holes: `warpvis.sensors.Corruptions`.

struct Corruption {
    float added, multiplied, dropout;
    SensorRange range;
    const int* rectangles;  // of the view: left, top, right and bottom of each
    int rectangle_count;

    // Random words of the pixels that share counters; those of disabled corruptions are not drawn.
    struct Words {
        PixelWords lost, multiplied, added;
    };

    // Corrupt the pixels from x on that share random words.
    inline void corrupt(const NoiseRow& row, int x) const {
        Words words;
        if (dropout > 0.0f) words.lost = PixelWords::draw(row.key, STREAM_LOST, row.y, x);
        if (multiplied > 0.0f) words.multiplied = PixelWords::draw(row.key, STREAM_MULTIPLIED, row.y, x);
        if (added > 0.0f) words.added = PixelWords::draw(row.key, STREAM_ADDED, row.y, x);
        for (int k = 0; row.has_word(x, k); ++k) corrupt_pixels(row, words, k, x + k * Numbers::PIXELS);
    }
    inline void corrupt_pixels(const NoiseRow& row, const Words& words, int k, int x) const {
        Real before;
        Whole reason = Numbers::whole(REASON_EMPTY);
        if (row.depth) {
            const Real exact = row.exact(x);
            before = range.report(exact);
            reason = SensorRange::finite(exact) ? SensorRange::reason(before) : reason;
        } else {
            before = Numbers::load(row.depth_out + x, row.width - x);
            if (row.reasons_out) reason = Numbers::load(row.reasons_out + x, row.width - x);
        }
        Real depth = before;
        if (multiplied > 0.0f) depth = depth * (1.0f + multiplied * Random::normal(words.multiplied.block[k]));
        if (added > 0.0f) depth = depth + added * Random::normal(words.added.block[k]);
        depth = range.report(depth);
        const Whole lost = is_lost(words, k, x, row.y), has_surface = SensorRange::finite(before);
        const Whole cause = lost ? Numbers::whole(REASON_DROPOUT) : SensorRange::reason(depth);
        depth = lost ? Numbers::real(Numbers::no_number()) : depth;
        row.write(x, has_surface ? depth : before, has_surface ? cause : reason);
    }
    inline Whole is_lost(const Words& words, int k, int x, int y) const {
        Whole lost = Numbers::whole(0);
        if (dropout > 0.0f) lost = Random::uniform(words.lost.block[k]) < dropout;
        const Whole column = Numbers::indices(x);
        for (int i = 0; i < rectangle_count; ++i) {
            const int* box = rectangles + 4 * i;
            if (y >= box[1] && y < box[3]) lost |= (column >= box[0]) & (column < box[2]);
        }
        return lost;
    }
};
