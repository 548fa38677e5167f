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

    // Corrupt the pixels from x on that share random words. Drawing them is most of the work of a single pixel.
    inline void corrupt(const NoiseRow& row, int x) const {
        Words words;
        if (Numbers::PIXELS == 1 && !Numbers::any(SensorRange::finite(before_of(row, x))))
            return corrupt_pixels(row, words, 0, x);
        if (dropout > 0.0f) words.lost = PixelWords::draw(row.key, STREAM_LOST, row.y, x);
        if (multiplied > 0.0f) words.multiplied = PixelWords::draw(row.key, STREAM_MULTIPLIED, row.y, x);
        if (added > 0.0f) words.added = PixelWords::draw(row.key, STREAM_ADDED, row.y, x);
        for (int k = 0; row.has_word(x, k); ++k) corrupt_pixels(row, words, k, x + k * Numbers::PIXELS);
    }
    // Reported depth before corruptions, and its reason.
    inline Real before_of(const NoiseRow& row, int x) const {
        return row.depth ? range.report(row.exact(x)) : Numbers::load(row.depth_out + x, row.width - x);
    }
    inline Whole reason_of(const NoiseRow& row, int x, Real before) const {
        const Whole empty = Numbers::whole(REASON_EMPTY);
        if (row.depth) return SensorRange::finite(row.exact(x)) ? SensorRange::reason(before) : empty;
        return row.reasons_out ? Numbers::load(row.reasons_out + x, row.width - x) : empty;
    }
    inline void corrupt_pixels(const NoiseRow& row, const Words& words, int k, int x) const {
        const Real before = before_of(row, x);
        const Whole reason = reason_of(row, x, before), has_surface = SensorRange::finite(before);
        if (!Numbers::any(has_surface)) return row.write(x, before, reason);
        Real depth = before;
        if (multiplied > 0.0f) depth = depth * (1.0f + multiplied * Random::normal(words.multiplied.block[k]));
        if (added > 0.0f) depth = depth + added * Random::normal(words.added.block[k]);
        depth = range.report(depth);
        const Whole lost = is_lost(words, k, x, row.y);
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
