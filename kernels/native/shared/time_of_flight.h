// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Time-of-flight depth from the phase of modulated light: `warpvis.sensors.TimeOfFlight`.

// Phases in cycles, in double precision by polynomials, so that all devices agree.
struct Phase {
    // sin(2 pi turns), with an error below 1e-13.
    static inline Double sine(Double turns) {
        const Double fraction = turns - Numbers::floor(turns + 0.5);
        const Double t = fraction > 0.25 ? 0.5 - fraction : (fraction < -0.25 ? -0.5 - fraction : fraction);
        const Double s = t * t;
        Double total = s * 3.66586854013351 - 15.081485384046008;
        total = total * s + 42.058134991709764;
        total = total * s - 76.7058475461348;
        total = total * s + 81.6052491490158;
        total = total * s - 41.34170223990335;
        total = total * s + 6.283185307179269;
        return total * t;
    }
};

// Light that returns along rays (across, down, 1) in the camera frame.
struct FlightReturn {
    Double length;  // of the ray
    Double range;  // [m]
    Double signal;  // in units of that of a white surface at 1 m at normal incidence
    Double straight;  // the same if incidence were normal

    // `axes` rotate the camera frame to the world, in which normals are given.
    static inline FlightReturn of(const float* axes, Double across, Double down, Real depth, const Real* normal,
                                  Real reflectivity) {
        FlightReturn light;
        light.length = Numbers::root(across * across + down * down + 1.0);
        light.range = Numbers::wide(depth) * light.length;
        light.straight = Numbers::wide(reflectivity) / (light.range * light.range);
        const Real x = Numbers::narrow(across), y = Numbers::narrow(down);
        Real ray[3];
        for (int k = 0; k < 3; ++k) ray[k] = axes[3 * k] * x + axes[3 * k + 1] * y + axes[3 * k + 2] * 1.0f;
        const Real along = Numbers::abs(normal[0] * ray[0] + normal[1] * ray[1] + normal[2] * ray[2]);
        light.signal = light.straight * (Numbers::wide(along) / light.length);
        return light;
    }
};

// The camera of a view, a row of its pixels, and its images; null if they are not used.
struct FlightRow {
    int height, width, y;
    double focal[2], center[2];
    float axes[9];  // rotation from the camera frame to the world
    const float* depth;
    const float* normals;  // xyz in the world
    const int* segmentation;
    const float* reflectivity;  // [object]
    const int* slots;  // number of an edge pixel with sub-rays, -1 for other pixels
    const float* mixes;  // [slot]: range, signal, all light, and signal at normal incidence of its sub-rays

    inline long long place(int x) const { return (long long)y * width + x; }
    inline Double across(int x) const { return (Numbers::wide(Numbers::columns(x)) + 0.5 - center[0]) / focal[0]; }
    inline Double down() const {
        return Numbers::wide(Numbers::real(1.0f)) * (((double)y + 0.5 - center[1]) / focal[1]);
    }
    inline Real depths(int x) const { return Numbers::load(depth + place(x), width - x); }
    inline void normal(int x, Real* n) const { Numbers::load_triples(normals + 3 * place(x), n, width - x); }
    inline Real reflectivities(int x) const {
        if (!segmentation) return Numbers::real(1.0f);
        float found[Numbers::PIXELS];
        for (int k = 0; k < Numbers::PIXELS; ++k) {
            const int hit = x + k < width ? segmentation[place(x) + k] : -1;
            found[k] = hit < 0 ? 1.0f : reflectivity[hit];
        }
        return Numbers::load(found, Numbers::PIXELS);
    }
};

// Light that returns to pixels of a row: range [m], light in phase with it, all light, and the light in phase if
// incidence were normal.
struct FlightLight {
    Real range, signal, all, straight;
    Double length;  // of rays with z = 1
    Double depth;

    static inline FlightLight of(const FlightRow& row, int x) {
        const Real depth = row.depths(x), none = Numbers::real(0.0f);
        Real normal[3];
        row.normal(x, normal);
        const FlightReturn found =
            FlightReturn::of(row.axes, row.across(x), row.down(), depth, normal, row.reflectivities(x));
        const Whole has_surface = depth < Numbers::endless();
        FlightLight light;
        light.length = found.length;
        light.depth = Numbers::wide(depth);
        light.range = has_surface ? Numbers::narrow(found.range) : Numbers::real(Numbers::endless());
        light.signal = has_surface ? Numbers::narrow(found.signal) : none;
        light.all = light.signal;
        light.straight = has_surface ? Numbers::narrow(found.straight) : none;
        if (row.slots) light.mix(row, x);
        return light;
    }
    // Pixels at edges combine the light of their sub-rays.
    inline void mix(const FlightRow& row, int x) {
        for (int k = 0; k < Numbers::PIXELS && x + k < row.width; ++k) {
            const int slot = row.slots[row.place(x) + k];
            if (slot < 0) continue;
            const float* mixed = row.mixes + 4LL * slot;
            Numbers::set(range, k, mixed[0]);
            Numbers::set(signal, k, mixed[1]);
            Numbers::set(all, k, mixed[2]);
            Numbers::set(straight, k, mixed[3]);
            Numbers::set(depth, k, (double)mixed[0] / Numbers::get(length, k));
        }
    }
};

struct Flight {
    double turns, unambiguous, offset, wiggle, wiggle_turns;
    float noise_scale, background, min_signal, max_signal;
    SensorRange range;

    // Measure the pixels from x on that share random words.
    inline void measure(const NoiseRow& row, const FlightRow& seen, int x) const {
        PixelWords words;
        if (noise_scale > 0.0f) words = PixelWords::draw(row.key, STREAM_RANGE, row.y, x);
        for (int k = 0; row.has_word(x, k); ++k) {
            const FlightLight light = FlightLight::of(seen, x + k * Numbers::PIXELS);
            Real deviation = Numbers::real(0.0f);
            if (noise_scale > 0.0f) deviation = noise_of(light, Random::normal(words.block[k]));
            write(row, light, deviation, x + k * Numbers::PIXELS);
        }
    }
    inline Real noise_of(const FlightLight& light, Real normal) const {
        return noise_scale * Numbers::root(light.all + background) / light.signal * normal;
    }
    // Error of ranges [m]: offset, wiggling and noise, minus whole unambiguous ranges on overflow. Wiggling has four
    // periods per cycle of the phase: the number of phase samples.
    inline Double error(Double far, Real noise) const {
        Double found = offset + wiggle * Phase::sine(4.0 * (far * turns) + wiggle_turns);
        if (noise_scale > 0.0f) found = found + Numbers::wide(noise);
        return found - Numbers::floor((far + found) / unambiguous) * unambiguous;
    }
    // Reason why the light yields no range, if any.
    inline Whole judge(const FlightLight& light) const {
        const Whole straight = (light.straight > 0.0f) & (light.straight >= min_signal);
        const Whole has_signal = (light.signal > 0.0f) & (light.signal >= min_signal);
        const Whole dark = straight ? Numbers::whole(REASON_GRAZING) : Numbers::whole(REASON_DROPOUT);
        Whole reason = has_signal ? Numbers::whole(REASON_VALID) : dark;
        reason = light.all > max_signal ? Numbers::whole(REASON_SATURATED) : reason;
        reason = light.range != light.range ? Numbers::whole(REASON_EDGE) : reason;
        return light.range == Numbers::endless() ? Numbers::whole(REASON_EMPTY) : reason;
    }
    inline void write(const NoiseRow& row, const FlightLight& light, Real noise, int x) const {
        const Real endless = Numbers::real(Numbers::endless()), none = Numbers::real(Numbers::no_number());
        const Whole judged = judge(light), valid = judged == Numbers::whole(REASON_VALID);
        Real reported = judged == Numbers::whole(REASON_EMPTY) ? endless : none;
        if (!Numbers::any(valid)) return row.write(x, reported, judged);
        const Double added = error(light.depth * light.length, noise) / light.length;
        const Real found = Numbers::narrow(light.depth + added);
        // `unknown` if the noise overflowed
        const Whole beyond = found > range.far, before = found < range.near, unknown = found != found;
        const Real measured = beyond ? endless : (before ? -endless : (unknown ? none : found));
        Whole reason = beyond | before ? Numbers::whole(REASON_RANGE) : judged;
        reason = unknown ? Numbers::whole(REASON_DROPOUT) : reason;
        row.write(x, valid ? measured : reported, valid ? reason : judged);
    }
};

// Pixels of a row with a neighbor, of eight, that differs from the pixel's plane by at least `edge_step` in depth.
struct FlightEdges {
    const FlightRow& row;
    float edge_step;

    // Write the row-major indices of such pixels, of those of a thread from x on, and -1 for others.
    inline void find(int* edges, int x) const {
        for (int k = 0; k < PixelWords::WORDS && x < row.width; ++k, x += Numbers::PIXELS) {
            const Whole places = Numbers::indices((int)row.place(x));
            Numbers::store(edges + row.place(x), is_edge(x) ? places : Numbers::whole(-1), row.width - x);
        }
    }
    inline Whole is_edge(int x) const {
        Real normal[3], rotated[3];
        row.normal(x, normal);
        for (int k = 0; k < 3; ++k)
            rotated[k] = row.axes[k] * normal[0] + row.axes[3 + k] * normal[1] + row.axes[6 + k] * normal[2];
        const Real depth = row.depths(x);
        const Whole has_surface = depth < Numbers::endless();
        const Real ahead =
            rotated[0] * Numbers::narrow(row.across(x)) + rotated[1] * Numbers::narrow(row.down()) + rotated[2] * 1.0f;
        const Real plane = depth * ahead;
        const Real across = rotated[0] / (float)row.focal[0], down = rotated[1] / (float)row.focal[1];
        Whole edge = Numbers::whole(0);
        for (int k = 0; k < 9; ++k) {
            const int i = k % 3 - 1, j = k / 3 - 1;
            if (k == 4 || row.y + j < 0 || row.y + j >= row.height) continue;
            Whole in;
            const Real other = neighbors(x + i, row.y + j, in);
            const Real slope = ahead + (float)i * across + (float)j * down;
            const Whole off_plane =
                (slope * plane <= 0.0f) | (Numbers::abs(other * slope - plane) >= edge_step * Numbers::abs(slope));
            edge |= in & (((other < Numbers::endless()) ^ has_surface) | (has_surface & off_plane));
            if (Numbers::PIXELS == 1 && Numbers::all(edge)) break;
        }
        return edge;
    }
    // Depth of pixels from a column on, and a mask of those inside the image.
    inline Real neighbors(int x, int y, Whole& in) const {
        const float* depths = row.depth + (long long)y * row.width;
        const Whole column = Numbers::indices(x);
        in = (column >= 0) & (column < row.width);
        if (x >= 0 && x + Numbers::PIXELS <= row.width) return Numbers::load(depths + x, Numbers::PIXELS);
        float values[Numbers::PIXELS];
        for (int k = 0; k < Numbers::PIXELS; ++k) values[k] = x + k >= 0 && x + k < row.width ? depths[x + k] : 0.0f;
        return Numbers::load(values, Numbers::PIXELS);
    }
};
