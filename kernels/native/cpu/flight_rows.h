// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The model of kernels/sensors/time_of_flight.py and the edge detection of kernels/sensors/sub_rays.py, applied to rows
// of pixels.

typedef double Doubles __attribute__((ext_vector_type(LANES)));

struct Wide {
    static inline Doubles of(Floats a) { return __builtin_convertvector(a, Doubles); }
    static inline Doubles all(double a) { return (Doubles)(a); }
    static inline Floats narrow(Doubles a) { return __builtin_convertvector(a, Floats); }
    static inline Doubles root(Doubles a) { return __builtin_elementwise_sqrt(a); }
    static inline Doubles floor(Doubles a) { return __builtin_elementwise_floor(a); }

    // sin(2 pi turns), as `sine` of kernels/sensors/time_of_flight.py.
    static inline Doubles sine(Doubles turns) {
        const Doubles fraction = turns - floor(turns + 0.5);
        const Doubles t = fraction > 0.25 ? 0.5 - fraction : (fraction < -0.25 ? -0.5 - fraction : fraction);
        const Doubles s = t * t;
        Doubles total = s * 3.66586854013351 - 15.081485384046008;
        total = total * s + 42.058134991709764;
        total = total * s - 76.7058475461348;
        total = total * s + 81.6052491490158;
        total = total * s - 41.34170223990335;
        total = total * s + 6.283185307179269;
        return total * t;
    }
};

// Rays of a row of a view's pixels, and the surfaces that they hit.
struct FlightRow {
    int height, width, y;
    double focal[2], center[2];
    float axes[9];  // rotation from the camera frame to the world
    const float* depth;  // of the view, like all arrays below
    const float* normals;
    const int* segmentation;  // or null
    const float* reflectivity;  // [object]
    const int* slots;  // or null
    const float* mixes;  // [slot]: four numbers

    inline long long place(int x) const { return (long long)y * width + x; }
    inline Doubles across(int x) const { return (Wide::of(Numbers::columns(x)) + 0.5 - center[0]) / focal[0]; }
    inline double down() const { return ((double)y + 0.5 - center[1]) / focal[1]; }
    inline void normal(int x, Floats* n) const { Numbers::load_triples(normals + 3 * place(x), n, width - x); }
    // Dot product of rays, in single precision, and normals, both in the world.
    inline Floats along(Floats across, float down, const Floats* n) const {
        Floats ray[3];
        for (int k = 0; k < 3; ++k) ray[k] = axes[3 * k] * across + axes[3 * k + 1] * down + axes[3 * k + 2] * 1.0f;
        return n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2];
    }
    inline Doubles shares(int x) const {
        float found[LANES];
        for (int k = 0; k < LANES; ++k) {
            const int hit = x + k < width ? segmentation[place(x) + k] : -1;
            found[k] = hit < 0 ? 1.0f : reflectivity[hit];
        }
        return Wide::of(Lanes::load(found));
    }
};

// Light that returns to pixels: range [m], light in phase with it, all light, and the light that the first surface
// would return at normal incidence.
struct FlightLight {
    Floats range, signal, all, straight;
    Doubles length;  // of rays with z = 1
    Doubles depth;

    static inline FlightLight of(const FlightRow& row, int x) {
        const Doubles across = row.across(x);
        const double down = row.down();
        FlightLight light;
        light.length = Wide::root(across * across + down * down + 1.0);
        const Floats depth = Numbers::load(row.depth + row.place(x), row.width - x);
        light.depth = Wide::of(depth);
        Floats normal[3];
        row.normal(x, normal);
        const Doubles far = light.depth * light.length;
        const Doubles straight = (row.segmentation ? row.shares(x) : Wide::all(1.0)) / (far * far);
        const Floats along = Lanes::abs(row.along(Wide::narrow(across), (float)down, normal));
        const Ints has_surface = depth < Numbers::endless();
        const Floats none = Lanes::all(0.0f);
        light.range = has_surface ? Wide::narrow(far) : Lanes::all(Numbers::endless());
        light.signal = has_surface ? Wide::narrow(straight * (Wide::of(along) / light.length)) : none;
        light.all = light.signal;
        light.straight = has_surface ? Wide::narrow(straight) : none;
        if (row.slots) light.mix(row, x);
        return light;
    }
    // Pixels at edges combine the light of their sub-rays.
    inline void mix(const FlightRow& row, int x) {
        for (int k = 0; k < LANES && x + k < row.width; ++k) {
            const int slot = row.slots[row.place(x) + k];
            if (slot < 0) continue;
            const float* mixed = row.mixes + 4LL * slot;
            range[k] = mixed[0];
            signal[k] = mixed[1];
            all[k] = mixed[2];
            straight[k] = mixed[3];
            depth[k] = (double)mixed[0] / length[k];
        }
    }
};

struct Flight {
    double turns, unambiguous, offset, wiggle, wiggle_turns;
    float noise_scale, background, min_signal, max_signal;
    SensorRange range;

    inline void measure(const NoiseRow& row, const FlightRow& seen) const {
        for (int x = 0; x < row.width; x += PixelWords::PIXELS) {
            PixelWords words;
            if (noise_scale > 0.0f) words = PixelWords::draw(row.key, STREAM_RANGE, row.y, x);
            for (int k = 0; k < PixelWords::WORDS && x + k * LANES < row.width; ++k) {
                const FlightLight light = FlightLight::of(seen, x + k * LANES);
                Floats deviation = Lanes::all(0.0f);
                if (noise_scale > 0.0f) deviation = noise_of(light, Random::normal(words.block[k]));
                write(row, light, deviation, x + k * LANES);
            }
        }
    }
    inline Floats noise_of(const FlightLight& light, Floats normal) const {
        return noise_scale * Numbers::root(light.all + background) / light.signal * normal;
    }
    // Error of ranges [m].
    inline Doubles error(Doubles far, Floats noise) const {
        Doubles found = offset + wiggle * Wide::sine(4.0 * (far * turns) + wiggle_turns);
        if (noise_scale > 0.0f) found = found + Wide::of(noise);
        return found - Wide::floor((far + found) / unambiguous) * unambiguous;
    }
    // Reason why the light yields no range, if any.
    inline Ints judge(const FlightLight& light) const {
        const Ints straight = (light.straight > 0.0f) & (light.straight >= min_signal);
        const Ints has_signal = (light.signal > 0.0f) & (light.signal >= min_signal);
        const Ints dark = straight ? Lanes::all_ints(REASON_GRAZING) : Lanes::all_ints(REASON_DROPOUT);
        Ints reason = has_signal ? Lanes::all_ints(REASON_VALID) : dark;
        reason = light.all > max_signal ? Lanes::all_ints(REASON_SATURATED) : reason;
        reason = light.range != light.range ? Lanes::all_ints(REASON_EDGE) : reason;
        return light.range == Numbers::endless() ? Lanes::all_ints(REASON_EMPTY) : reason;
    }
    inline void write(const NoiseRow& row, const FlightLight& light, Floats noise, int x) const {
        const Floats endless = Lanes::all(Numbers::endless()), none = Lanes::all(Numbers::no_number());
        const Doubles added = error(light.depth * light.length, noise) / light.length;
        const Floats found = Wide::narrow(light.depth + added);
        const Ints judged = judge(light), valid = judged == Lanes::all_ints(REASON_VALID);
        const Ints beyond = found > range.far, before = found < range.near, unknown = found != found;
        const Floats reported = beyond ? endless : (before ? -endless : (unknown ? none : found));
        Ints reason = beyond | before ? Lanes::all_ints(REASON_RANGE) : judged;
        reason = unknown ? Lanes::all_ints(REASON_DROPOUT) : reason;
        const Floats lost = judged == Lanes::all_ints(REASON_EMPTY) ? endless : none;
        row.write(x, valid ? reported : lost, valid ? reason : judged);
    }
};

// Pixels adjacent to another surface, as `is_edge` of kernels/sensors/sub_rays.py.
struct FlightEdges {
    const FlightRow& row;
    float edge_step;

    inline void find(int* edges) const {
        for (int x = 0; x < row.width; x += LANES) {
            const Ints places = Lanes::index() + (int)row.place(x);
            const Ints found = is_edge(x) ? places : Lanes::all_ints(-1);
            __builtin_memcpy(edges + row.place(x), &found,
                             (row.width - x < LANES ? row.width - x : LANES) * sizeof(int));
        }
    }
    inline Ints is_edge(int x) const {
        Floats normal[3], rotated[3];
        row.normal(x, normal);
        for (int k = 0; k < 3; ++k)
            rotated[k] = row.axes[k] * normal[0] + row.axes[3 + k] * normal[1] + row.axes[6 + k] * normal[2];
        const Floats depth = Numbers::load(row.depth + row.place(x), row.width - x);
        const Ints has_surface = depth < Numbers::endless();
        const Floats ahead =
            rotated[0] * Wide::narrow(row.across(x)) + rotated[1] * (float)row.down() + rotated[2] * 1.0f;
        const Floats plane = depth * ahead;
        const Floats across = rotated[0] / (float)row.focal[0], down = rotated[1] / (float)row.focal[1];
        Ints edge = Lanes::all_ints(0);
        for (int k = 0; k < 9; ++k) {
            const int i = k % 3 - 1, j = k / 3 - 1;
            if (k == 4 || row.y + j < 0 || row.y + j >= row.height) continue;
            Ints in;
            const Floats other = neighbors(x + i, row.y + j, in);
            const Floats slope = ahead + (float)i * across + (float)j * down;
            const Ints off_plane =
                (slope * plane <= 0.0f) | (Lanes::abs(other * slope - plane) >= edge_step * Lanes::abs(slope));
            edge |= in & (((other < Numbers::endless()) ^ has_surface) | (has_surface & off_plane));
        }
        return edge;
    }
    // Depth of pixels from a column on, and a mask of those inside the image.
    inline Floats neighbors(int x, int y, Ints& in) const {
        const float* depths = row.depth + (long long)y * row.width;
        const Ints column = Lanes::index() + x;
        in = (column >= 0) & (column < row.width);
        if (x >= 0 && x + LANES <= row.width) return Lanes::load(depths + x);
        float values[LANES];
        for (int k = 0; k < LANES; ++k) values[k] = x + k >= 0 && x + k < row.width ? depths[x + k] : 0.0f;
        return Lanes::load(values);
    }
};
