// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The models of kernels/sensors/kinect_noise.py applied to rows of pixels.

struct Khoshelham {
    float step, sigma;
    bool rounds;
    SensorRange range;

    inline void measure(const NoiseRow& row) const {
        for (int x = 0; x < row.width; x += PixelWords::PIXELS) {
            const PixelWords words = PixelWords::draw(row.key, STREAM_DISPARITY, row.y, x);
            for (int k = 0; k < PixelWords::WORDS && x + k * LANES < row.width; ++k)
                measure_lanes(row, x + k * LANES, sigma * Random::normal(words.block[k]));
        }
    }
    inline void measure_lanes(const NoiseRow& row, int x, Floats noise) const {
        const Floats depth = row.exact(x), scaled = step * depth;
        const Floats found = rounds ? Numbers::floor(1.0f / scaled + noise + 0.5f) : 1.0f + scaled * noise;
        const Floats unit = rounds ? Lanes::all(1.0f / step) : depth;
        // Beyond the last quantization step, depth is infinite.
        const Floats reported = range.report(found > 0.0f ? unit / found : Lanes::all(Numbers::endless()));
        const Ints has_surface = SensorRange::finite(depth);
        row.write(x, has_surface ? reported : depth,
                  has_surface ? SensorRange::reason(reported) : Lanes::all_ints(REASON_EMPTY));
    }
};

typedef double Doubles __attribute__((ext_vector_type(LANES)));

// The camera of a view, and its images.
struct NguyenView {
    double focal[2], center[2];
    double rotation[4];  // x y z w
    double forward[3];  // in the world
    int height, width;
    const float* depth;
    const float* normals;  // xyz in the world

    static inline Doubles wide(Floats a) { return __builtin_convertvector(a, Doubles); }
    static inline Floats narrow(Doubles a) { return __builtin_convertvector(a, Floats); }

    // Angles between normals and the optical axis, as `angle_of` of kernels/sensors/noise.py.
    inline Floats angle(const Floats* normal) const {
        const Doubles along =
            wide(normal[0]) * forward[0] + wide(normal[1]) * forward[1] + wide(normal[2]) * forward[2];
        const Floats x = Lanes::min(Lanes::max(Lanes::abs(narrow(along)), Lanes::all(0.0f)), Lanes::all(1.0f));
        Floats total = x * -0.0012624911f + 0.0066700901f;
        total = total * x - 0.0170881256f;
        total = total * x + 0.0308918810f;
        total = total * x - 0.0501743046f;
        total = total * x + 0.0889789874f;
        total = total * x - 0.2145988016f;
        total = total * x + 1.5707963050f;
        return Numbers::root(1.0f - x) * total;
    }
    inline Doubles across(Ints column) const {
        return (__builtin_convertvector(column, Doubles) + 0.5 - center[0]) / focal[0];
    }
    inline Doubles down(Ints row) const { return (__builtin_convertvector(row, Doubles) + 0.5 - center[1]) / focal[1]; }
    // Rotate normals into the camera frame, rounded as by Warp's quat_rotate_inv.
    inline void rotate_into_camera(const Floats* normal, Doubles* rotated) const {
        const double *q = rotation, w = rotation[3], c = 2.0 * w * w - 1.0;
        const Doubles n[3] = {wide(normal[0]), wide(normal[1]), wide(normal[2])};
        const Doubles d = 2.0 * (q[0] * n[0] + q[1] * n[1] + q[2] * n[2]);
        rotated[0] = n[0] * c + q[0] * d - (q[1] * n[2] - q[2] * n[1]) * w * 2.0;
        rotated[1] = n[1] * c + q[1] * d - (q[2] * n[0] - q[0] * n[2]) * w * 2.0;
        rotated[2] = n[2] * c + q[2] * d - (q[0] * n[1] - q[1] * n[0]) * w * 2.0;
    }
};

// The pixels whose surfaces are shown by LANES pixels of a row, displaced by lateral noise.
struct Shown {
    Ints row, column;
    Floats depth;
    Floats normal[3];

    inline void load(const NguyenView& view) {
        int place[LANES];
        float seen[LANES], normals[3][LANES];
        Lanes::store(place, row * view.width + column);
        for (int k = 0; k < LANES; ++k) {
            seen[k] = view.depth[place[k]];
            for (int c = 0; c < 3; ++c) normals[c][k] = view.normals[3LL * place[k] + c];
        }
        depth = Lanes::load(seen);
        for (int c = 0; c < 3; ++c) normal[c] = Lanes::load(normals[c]);
    }
    // Depth at which the rays of a row's pixels meet the planes of these surfaces; the surface's own depth if they do
    // not meet, or if a pixel shows its own surface.
    inline Floats met(const NguyenView& view, Ints column_of_ray, int y) const {
        Doubles n[3];
        view.rotate_into_camera(normal, n);
        const Doubles at_surface = n[0] * view.across(column) + n[1] * view.down(row) + n[2];
        const Doubles at_ray = n[0] * view.across(column_of_ray) + n[1] * view.down(Lanes::all_ints(y)) + n[2];
        const Doubles ahead = at_surface / at_ray, found = NguyenView::wide(depth) * ahead;
        const Floats displaced_depth = NguyenView::narrow(ahead > 0.0 ? found : NguyenView::wide(depth));
        const Ints is_displaced = (row != y) | (column != column_of_ray);
        return is_displaced ? displaced_depth : depth;
    }
};

struct Nguyen {
    float min_axial, axial_growth, best_depth, grazing_axial, grazing_angle, lateral, lateral_growth, max_angle;
    SensorRange range;

    static inline Floats steepness(Floats angle) {
        constexpr float RIGHT_ANGLE = 1.5707964f;
        return angle / (RIGHT_ANGLE - angle);
    }
    // Standard deviation of depth [m]: equations (3) and (4).
    inline Floats axial(Floats depth, Floats angle) const {
        const Floats away = depth - best_depth, steep = steepness(angle);
        const Floats sigma = min_axial + axial_growth * away * away;
        const Floats grazing_sigma = sigma + grazing_axial / Numbers::root(depth) * (steep * steep);
        return angle >= grazing_angle ? grazing_sigma : sigma;
    }
    // Displaced pixel centers along one axis, clamped to the image.
    static inline Ints jittered(Floats centers, Floats offset, int size) {
        const Floats place = Numbers::floor(centers + 0.5f + offset);
        const Floats last = Lanes::all((float)(size - 1));
        return __builtin_convertvector(Lanes::min(Lanes::max(place, Lanes::all(0.0f)), last), Ints);
    }

    inline void measure(const NoiseRow& row, const NguyenView& view) const {
        for (int x = 0; x < row.width; x += PixelWords::PIXELS) {
            const PixelWords across = PixelWords::draw(row.key, STREAM_ACROSS, row.y, x);
            const PixelWords down = PixelWords::draw(row.key, STREAM_DOWN, row.y, x);
            const PixelWords ahead = PixelWords::draw(row.key, STREAM_DEPTH, row.y, x);
            for (int k = 0; k < PixelWords::WORDS && x + k * LANES < row.width; ++k) {
                const Floats normals[3] = {Random::normal(across.block[k]), Random::normal(down.block[k]),
                                           Random::normal(ahead.block[k])};
                measure_lanes(row, view, x + k * LANES, normals);
            }
        }
    }
    inline void measure_lanes(const NoiseRow& row, const NguyenView& view, int x, const Floats* noise) const {
        Floats normal[3];
        Numbers::load_triples(view.normals + 3LL * ((long long)row.y * row.width + x), normal, row.width - x);
        const Floats source_angle = SensorRange::finite(row.exact(x)) ? view.angle(normal) : Lanes::all(0.0f);
        const Floats sigma = lateral + lateral_growth * steepness(Lanes::min(source_angle, Lanes::all(max_angle)));
        Shown shown;
        shown.column = jittered(Numbers::columns(x), sigma * noise[0], view.width);
        shown.row = jittered(Lanes::all((float)row.y), sigma * noise[1], view.height);
        shown.load(view);
        const Floats angle = view.angle(shown.normal), depth = shown.met(view, Lanes::index() + x, row.y);
        const Floats reported = range.report(depth + axial(depth, angle) * noise[2]);
        const Ints has_surface = SensorRange::finite(shown.depth), grazing = angle > max_angle;
        const Floats measured = grazing ? Lanes::all(Numbers::no_number()) : reported;
        const Ints reason = grazing ? Lanes::all_ints(REASON_GRAZING) : SensorRange::reason(reported);
        row.write(x, has_surface ? measured : shown.depth, has_surface ? reason : Lanes::all_ints(REASON_EMPTY));
    }
};
