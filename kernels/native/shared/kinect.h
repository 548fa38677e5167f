// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Measured noise models of the Kinect: `warpvis.sensors.KhoshelhamNoise` and `NguyenNoise`.

struct Khoshelham {
    float step, sigma;
    bool rounds;
    SensorRange range;

    // Measure the pixels from x on that share random words. Drawing them is most of the work of a single pixel.
    inline void measure(const NoiseRow& row, int x) const {
        if (Numbers::PIXELS == 1 && !Numbers::any(SensorRange::finite(row.exact(x)))) {
            return row.write(x, row.exact(x), Numbers::whole(REASON_EMPTY));
        }
        const PixelWords words = PixelWords::draw(row.key, STREAM_DISPARITY, row.y, x);
        for (int k = 0; row.has_word(x, k); ++k)
            measure_pixels(row, x + k * Numbers::PIXELS, sigma * Random::normal(words.block[k]));
    }
    inline void measure_pixels(const NoiseRow& row, int x, Real noise) const {
        const Real depth = row.exact(x), scaled = step * depth;
        const Real found = rounds ? Numbers::floor(1.0f / scaled + noise + 0.5f) : 1.0f + scaled * noise;
        const Real unit = rounds ? Numbers::real(1.0f / step) : depth;
        // Depth is infinite below the first step of disparity.
        const Real reported = range.report(found > 0.0f ? unit / found : Numbers::real(Numbers::endless()));
        const Whole has_surface = SensorRange::finite(depth);
        row.write(x, has_surface ? reported : depth,
                  has_surface ? SensorRange::reason(reported) : Numbers::whole(REASON_EMPTY));
    }
};

// The camera of a view, and its images.
struct NguyenView {
    double focal[2], center[2];
    double rotation[4];  // x y z w
    double forward[3];  // in the world
    int height, width;
    const float* depth;
    const float* normals;  // xyz in the world

    // Angles between normals and the optical axis, with an error below 2e-8 before rounding: Abramowitz and Stegun,
    // "Handbook of Mathematical Functions", 4.4.46.
    inline Real angle(const Real* normal) const {
        const Double along = Numbers::wide(normal[0]) * forward[0] + Numbers::wide(normal[1]) * forward[1] +
                             Numbers::wide(normal[2]) * forward[2];
        const Real cosine = Numbers::abs(Numbers::narrow(along));
        const Real x = Numbers::min(Numbers::max(cosine, Numbers::real(0.0f)), Numbers::real(1.0f));
        Real total = x * -0.0012624911f + 0.0066700901f;
        total = total * x - 0.0170881256f;
        total = total * x + 0.0308918810f;
        total = total * x - 0.0501743046f;
        total = total * x + 0.0889789874f;
        total = total * x - 0.2145988016f;
        total = total * x + 1.5707963050f;
        return Numbers::root(1.0f - x) * total;
    }
    inline Double across(Whole column) const { return (Numbers::to_double(column) + 0.5 - center[0]) / focal[0]; }
    inline Double down(Whole row) const { return (Numbers::to_double(row) + 0.5 - center[1]) / focal[1]; }
    // Rotate normals into the camera frame, rounded as by Warp's quat_rotate_inv.
    inline void rotate_into_camera(const Real* normal, Double* rotated) const {
        const double *q = rotation, w = rotation[3], c = 2.0 * w * w - 1.0;
        const Double n[3] = {Numbers::wide(normal[0]), Numbers::wide(normal[1]), Numbers::wide(normal[2])};
        const Double d = 2.0 * (q[0] * n[0] + q[1] * n[1] + q[2] * n[2]);
        rotated[0] = n[0] * c + q[0] * d - (q[1] * n[2] - q[2] * n[1]) * w * 2.0;
        rotated[1] = n[1] * c + q[1] * d - (q[2] * n[0] - q[0] * n[2]) * w * 2.0;
        rotated[2] = n[2] * c + q[2] * d - (q[0] * n[1] - q[1] * n[0]) * w * 2.0;
    }
};

// The surfaces that pixels of a row show, displaced by lateral noise.
struct Shown {
    Whole row, column;
    Real depth;
    Real normal[3];

    inline void load(const NguyenView& view) {
        int place[Numbers::PIXELS];
        float seen[Numbers::PIXELS], normals[3][Numbers::PIXELS];
        Numbers::store(place, row * view.width + column, Numbers::PIXELS);
        for (int k = 0; k < Numbers::PIXELS; ++k) {
            seen[k] = view.depth[place[k]];
            for (int c = 0; c < 3; ++c) normals[c][k] = view.normals[3LL * place[k] + c];
        }
        depth = Numbers::load(seen, Numbers::PIXELS);
        for (int c = 0; c < 3; ++c) normal[c] = Numbers::load(normals[c], Numbers::PIXELS);
    }
    // Depth at which the rays of a row's pixels meet the planes of these surfaces; the surface's own depth if they do
    // not meet, or if a pixel shows its own surface.
    inline Real met(const NguyenView& view, Whole column_of_ray, int y) const {
        const Whole is_displaced = (row != y) | (column != column_of_ray);
        if (!Numbers::any(is_displaced)) return depth;
        Double n[3];
        view.rotate_into_camera(normal, n);
        const Double at_surface = n[0] * view.across(column) + n[1] * view.down(row) + n[2];
        const Double at_ray = n[0] * view.across(column_of_ray) + n[1] * view.down(Numbers::whole(y)) + n[2];
        const Double ahead = at_surface / at_ray, own_depth = Numbers::wide(depth);
        const Real displaced_depth = Numbers::narrow(ahead > 0.0 ? own_depth * ahead : own_depth);
        return is_displaced ? displaced_depth : depth;
    }
};

struct Nguyen {
    float min_axial, axial_growth, best_depth, grazing_axial, grazing_angle, lateral, lateral_growth, max_angle;
    SensorRange range;

    // Factor by which noise grows toward grazing angles.
    static inline Real steepness(Real angle) {
        constexpr float RIGHT_ANGLE = 1.5707964f;
        return angle / (RIGHT_ANGLE - angle);
    }
    // Standard deviation of depth [m]: equations (3) and (4).
    inline Real axial(Real depth, Real angle) const {
        const Real away = depth - best_depth, steep = steepness(angle);
        const Real sigma = min_axial + axial_growth * away * away;
        const Real grazing_sigma = sigma + grazing_axial / Numbers::root(depth) * (steep * steep);
        return angle >= grazing_angle ? grazing_sigma : sigma;
    }
    // Displaced pixel centers along one axis, clamped to the image.
    static inline Whole jittered(Real centers, Real offset, int size) {
        const Real place = Numbers::floor(centers + 0.5f + offset);
        const Real last = Numbers::real((float)(size - 1));
        return Numbers::truncate(Numbers::min(Numbers::max(place, Numbers::real(0.0f)), last));
    }

    // Measure the pixels from x on that share random words.
    inline void measure(const NoiseRow& row, const NguyenView& view, int x) const {
        const PixelWords across = PixelWords::draw(row.key, STREAM_ACROSS, row.y, x);
        const PixelWords down = PixelWords::draw(row.key, STREAM_DOWN, row.y, x);
        PixelWords ahead;
        if (Numbers::PIXELS > 1) ahead = PixelWords::draw(row.key, STREAM_DEPTH, row.y, x);
        for (int k = 0; row.has_word(x, k); ++k) {
            const Real offsets[2] = {Random::normal(across.block[k]), Random::normal(down.block[k])};
            measure_pixels(row, view, x + k * Numbers::PIXELS, offsets, ahead, k);
        }
    }
    inline void measure_pixels(const NoiseRow& row, const NguyenView& view, int x, const Real* offsets,
                               PixelWords& ahead, int k) const {
        Real normal[3];
        Numbers::load_triples(view.normals + 3LL * ((long long)row.y * row.width + x), normal, row.width - x);
        const Real source_angle = SensorRange::finite(row.exact(x)) ? view.angle(normal) : Numbers::real(0.0f);
        const Real sigma = lateral + lateral_growth * steepness(Numbers::min(source_angle, Numbers::real(max_angle)));
        Shown shown;
        shown.column = jittered(Numbers::columns(x), sigma * offsets[0], view.width);
        shown.row = jittered(Numbers::real((float)row.y), sigma * offsets[1], view.height);
        shown.load(view);
        const Whole has_surface = SensorRange::finite(shown.depth);
        if (!Numbers::any(has_surface)) return row.write(x, shown.depth, Numbers::whole(REASON_EMPTY));
        // A single pixel draws the noise of depth only if it has a depth: drawing is most of its work.
        if (Numbers::PIXELS == 1) ahead = PixelWords::draw(row.key, STREAM_DEPTH, row.y, x);
        const Real angle = view.angle(shown.normal), depth = shown.met(view, Numbers::indices(x), row.y);
        const Real reported = range.report(depth + axial(depth, angle) * Random::normal(ahead.block[k]));
        const Whole grazing = angle > max_angle;
        const Real measured = grazing ? Numbers::real(Numbers::no_number()) : reported;
        const Whole reason = grazing ? Numbers::whole(REASON_GRAZING) : SensorRange::reason(reported);
        row.write(x, has_surface ? measured : shown.depth, has_surface ? reason : Numbers::whole(REASON_EMPTY));
    }
};
