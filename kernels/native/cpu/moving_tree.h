// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Bundles of the rays of a sensor that moves within a frame. In a short time, rays from a moving sensor are rays with
// distinct origins: each bundle of a view has its own `RayTree`, built from the sensor's poses at the times of its rays
// and relative to the pose in the middle of them. The order of rays in the tree is that of the sensor at rest.

#pragma once

#include "cpu/legs.h"
#include "cpu/table_job.h"
#include "cpu/tile_fit.h"

// Rays of the sensor frame, in the order of the tree: [coordinate][ray].
struct TimedRays {
    const double* direction;  // of depth 1
    const float* origin;  // null if all are 0
    const double* time;  // [ray]
    const double* span;  // [bundle]: its first and last time
    long long count;

    // Those of a `MovingRays` of kernels/casting/moving_ray_packets.py.
    template <class MovingRays>
    static inline TimedRays of(const MovingRays& rays) {
        return TimedRays{rays.directions.data, rays.origins.data, rays.times.data, rays.spans.data,
                         rays.times.shape[0]};
    }
    static inline Some some(const double* from) {
        Some value;
        __builtin_memcpy(&value, from, sizeof value);
        return value;
    }
    static inline Some some(const float* from) {
        SomeFloats value;
        __builtin_memcpy(&value, from, sizeof value);
        return __builtin_convertvector(value, Some);
    }
};

// Memory for the tree of one bundle.
struct MovingTree {
    float *u, *v, *rest_u, *rest_v, *scale, *p, *q, *begin, *clip_inv_z, *row_u, *row_v, *row_p, *row_q;
    float *packet_bounds, *tile_bounds, *group_bounds, *range;
    RayFit* fit;

    static inline MovingTree carve(Arena& arena, int groups) {
        const long long tiles = (long long)groups * LANES, packets = tiles * LANES, rays = packets * LANES;
        MovingTree tree;
        float** const arrays[] = {&tree.u,     &tree.v,     &tree.rest_u, &tree.rest_v,     &tree.scale,
                                  &tree.p,     &tree.q,     &tree.begin,  &tree.clip_inv_z, &tree.row_u,
                                  &tree.row_v, &tree.row_p, &tree.row_q};
        for (float** const array : arrays) *array = arena.floats(rays);
        tree.packet_bounds = arena.floats(packets * RayTree::BOUND_ROWS);
        tree.tile_bounds = arena.floats(tiles * RayTree::BOUND_ROWS);
        tree.group_bounds = arena.floats(LANES * RayTree::BOUND_ROWS);
        tree.range = arena.floats(tiles * RayOrigins::RANGE_WORDS);
        tree.fit = (RayFit*)arena.take(tiles * (long long)sizeof(RayFit));
        return tree;
    }
    // The tree of a bundle, with what does not depend on the motion from that of the sensor at rest.
    inline RayTree of(const RayTree& rest) const {
        RayTree tree = rest;
        tree.u = u, tree.v = v, tree.rest_u = rest_u, tree.rest_v = rest_v, tree.row_u = row_u, tree.row_v = row_v;
        tree.scale = scale, tree.fit = fit;
        tree.packet_bounds = packet_bounds, tree.tile_bounds = tile_bounds, tree.group_bounds = group_bounds;
        tree.origins = RayOrigins{
            .p = p, .q = q, .begin = begin, .clip_inv_z = clip_inv_z, .row_p = row_p, .row_q = row_q, .range = range};
        return tree;
    }
};

// Least and greatest of the numbers of some lanes.
struct LaneRange {
    Floats low = Lanes::all(NOWHERE), high = Lanes::all(-NOWHERE);

    inline void add(Floats value, Ints which) {
        low = Lanes::min(low, which ? value : Lanes::all(NOWHERE));
        high = Lanes::max(high, which ? value : Lanes::all(-NOWHERE));
    }
    inline float least() const { return Lanes::min_of(low); }
    inline float greatest() const { return Lanes::max_of(high); }
};

// The frames of a packet's rays at their times.
struct KnownFrames {
    enum { PARTS = LANES / SOME };
    enum { UNKNOWN = -2 };
    Some time[PARTS];
    int row[LANES];  // of poses of individual rays; -1 without a ray
    RayFrames frames[PARTS];

    inline KnownFrames() {
        for (Some& unknown : time) unknown = (Some)(__builtin_nan(""));
        for (int& unknown : row) unknown = UNKNOWN;
    }
};

// Builds the tree of a bundle in two passes: rays in the reference frame, then their intersections with the plane of
// the eye, which is chosen in between.
struct MovingTreeMaker {
    const MovingTree& tree;
    const RayTree& rest;  // at rest
    const Bundle& bundle;
    float focal;
    double earliest, latest;  // times of rays
    int tiles = bundle.groups * LANES;
    LaneRange from[3];  // origins of rays
    LaneRange per_z;  // 1 / z of directions of depth 1
    float eye[3], max_p = 0.0f, max_q = 0.0f, max_origin_z = 0.0f;
    enum { MAX_LEGS = 64 };
    RelativeLeg leg[MAX_LEGS];  // during the times of the rays
    int legs = 0;
    double most = 0.0;  // square of the greatest rotation of a leg

    static constexpr float MARGIN = 1e-3f;  // of bounds [px]
    static constexpr float MAX_TANGENT = 4.0f;  // of the angle between a ray and the bundle's axis
    static constexpr float ROUNDED = 1e-6f;  // bound of the relative rounding error of single precision, with a margin

    // Whether a tree could be built. It is not if the sensor moves too far, or rotates too much.
    inline bool make(const TimedRays& rays, const SensorPath& path, const Pose& reference, double middle,
                     long long first) {
        if (!move(rays, path, reference, middle, first)) return false;
        for (int i = 0; i < 3; ++i)
            if (!(from[i].greatest() - from[i].least() <= CPU_MAX_ORIGIN_EXTENT)) return false;
        eye[0] = 0.5f * (from[0].least() + from[0].greatest());
        eye[1] = 0.5f * (from[1].least() + from[1].greatest());
        eye[2] = from[2].least();
        max_origin_z = (from[2].greatest() - eye[2]) * (1.0f + ROUNDED);
        for (int tile = 0; tile < tiles; ++tile) cross_plane(tile);
        bound_tiles();
        return is_ahead() && is_coherent();
    }
    // Whether origins of a packet are close to each other, judged by the first packet of each tile.
    inline bool is_coherent() const {
        float sum = 0.0f;
        int count = 0;
        for (int slot = 0; slot < tiles * (LANES * LANES); slot += LANES * LANES) {
            const Ints which = has_ray(slot);
            if (!Lanes::any(which)) continue;
            LaneRange at_p, at_q;
            at_p.add(Lanes::load(tree.p + slot), which), at_q.add(Lanes::load(tree.q + slot), which);
            sum += 0.5f * __builtin_fmaxf(at_p.greatest() - at_p.least(), at_q.greatest() - at_q.least());
            ++count;
        }
        return sum <= CPU_MAX_SPREAD * focal * (float)count;
    }
    inline bool is_ahead() const {
        if (!(per_z.least() > 0.0f)) return false;
        const RayBox box = around(tree.group_bounds);
        const float reach = MAX_TANGENT * focal;
        return box.u0 >= -reach && box.v0 >= -reach && box.u1 <= reach && box.v1 <= reach;
    }

    // The legs of all rays, which are between those of the first and the last time; false if there are too many, or the
    // sensor rotates too much.
    inline bool find_legs(const SensorPath& path, const Pose& reference, double middle) {
        const int first_leg = path.leg_at(earliest + path.start);
        legs = path.leg_at(latest + path.start) - first_leg + 1;
        if (legs > MAX_LEGS) return false;
        for (int k = 0; k < legs; ++k) leg[k] = path.relative(first_leg + k, middle, reference);
        for (int k = 0; k < legs; ++k) {
            const double begin = k == 0 ? earliest + path.start : leg[k].begin;
            const double end = k + 1 == legs ? latest + path.start : leg[k + 1].begin;
            most = __builtin_fmax(most, __builtin_fmax(leg[k].square_at(begin), leg[k].square_at(end)));
        }
        return most <= SmallAngle::MAX_SQUARE;
    }
    // First pass.
    inline bool move(const TimedRays& rays, const SensorPath& path, const Pose& reference, double middle,
                     long long first) {
        if (!path.motion.of_rays.pose && !find_legs(path, reference, middle)) return false;
        KnownFrames known;
        // Local, because ranges in memory would be updated by masked stores, which are slow.
        LaneRange places[3], inverses;
        for (int tile = 0; tile < tiles; ++tile) {
            const int slots = tile * (LANES * LANES), end = slots + LANES * LANES;
            for (int k = 0; k < LANES; ++k) {
                // By columns of packets, whose times are the same if a sensor measures its columns one by one.
                const int slot =
                    slots + (k % RayFit::PACKETS_ACROSS * RayFit::PACKETS_ACROSS + k / RayFit::PACKETS_ACROSS) * LANES;
                if (Lanes::any(has_ray(slot))) move_packet(rays, path, reference, first + slot, slot, known);
            }
            // Only now, because numbers that were just stored in parts cannot be loaded as a whole without a stall.
            for (int slot = slots; slot < end; slot += LANES) {
                const Ints which = has_ray(slot);
                places[0].add(Lanes::load(tree.p + slot), which), places[1].add(Lanes::load(tree.q + slot), which);
                places[2].add(Lanes::load(tree.begin + slot), which);
                inverses.add(Lanes::load(tree.scale + slot), which);
            }
        }
        for (int i = 0; i < 3; ++i) from[i] = places[i];
        per_z = inverses;
        return true;
    }
    inline Ints has_ray(int slot) const { return Lanes::load(rest.place + slot) >= Lanes::all_ints(0); }
    // Neighbors often share times.
    inline void move_packet(const TimedRays& rays, const SensorPath& path, const Pose& reference, long long first,
                            int slot, KnownFrames& known) {
        const RayPoses& of_rays = path.motion.of_rays;
        for (int part = 0; part < LANES; part += SOME) {
            const long long ray = first + part;
            const Some time = TimedRays::some(rays.time + ray);
            Some& known_time = known.time[part / SOME];
            RayFrames& frames = known.frames[part / SOME];
            if (of_rays.pose) {
                int rows[SOME];
                for (int k = 0; k < SOME; ++k) {
                    const int pixel = rest.place[slot + part + k];
                    rows[k] = pixel < 0 ? -1 : of_rays.row(path.view, pixel);
                }
                of_rays.update(rows, reference, known.row + part, frames);
            } else if (__builtin_reduce_or(time != known_time)) {
                known_time = time;
                frames = frames_at(time + path.start);
            }
            Some along[3], direction[3], origin[3];
            for (int i = 0; i < 3; ++i) along[i] = TimedRays::some(rays.direction + i * rays.count + ray);
            for (int i = 0; i < 3; ++i) direction[i] = frames.rotated(i, along), origin[i] = frames.origin[i];
            if (rays.origin) {
                for (int i = 0; i < 3; ++i) along[i] = TimedRays::some(rays.origin + i * rays.count + ray);
                for (int i = 0; i < 3; ++i) origin[i] += frames.rotated(i, along);
            }
            const Some inverse = 1.0 / direction[2], exact_u = focal * direction[0] * inverse,
                       exact_v = focal * direction[1] * inverse;
            put(tree.rest_u + slot + part, exact_u - put(tree.u + slot + part, exact_u));
            put(tree.rest_v + slot + part, exact_v - put(tree.v + slot + part, exact_v));
            put(tree.scale + slot + part, inverse);
            put(tree.p + slot + part, origin[0]), put(tree.q + slot + part, origin[1]);
            put(tree.begin + slot + part, origin[2]);
        }
    }
    // Store numbers in single precision; returns the rounded ones.
    static inline Some put(float* to, Some value) {
        const SomeFloats rounded = __builtin_convertvector(value, SomeFloats);
        __builtin_memcpy(to, &rounded, sizeof rounded);
        return __builtin_convertvector(rounded, Some);
    }
    inline RayFrames frames_at(Some time) const {
        RayFrames frames = leg[0].at(time, most);
        for (int k = 1; k < legs; ++k) {
            const auto later = time >= leg[k].begin;
            if (!__builtin_reduce_or(later)) break;
            frames = RayFrames::select(later, leg[k].at(time, most), frames);
        }
        return frames;
    }

    // Second pass.
    inline void cross_plane(int tile) {
        LaneRange moments[3];
        Floats size[3] = {};
        bool full = true;
        for (int child = 0; child < LANES; ++child) {
            const int ray = (tile * LANES + child) * LANES;
            const Ints has_ray = Lanes::load(rest.place + ray) >= Lanes::all_ints(0);
            full &= Lanes::bits(has_ray) == (1u << LANES) - 1;
            float* bounds = tree.packet_bounds + tile * (RayTree::BOUND_ROWS * LANES);
            if (!Lanes::any(has_ray)) {
                set_bounds(bounds, child, RayBox{NOWHERE, NOWHERE, -NOWHERE, -NOWHERE});
                continue;
            }
            const Floats u = Lanes::load(tree.u + ray), v = Lanes::load(tree.v + ray);
            const Floats z = Lanes::max(Lanes::load(tree.begin + ray) - eye[2], Lanes::all(0.0f));
            const Floats p = focal * (Lanes::load(tree.p + ray) - eye[0]) - u * z;
            const Floats q = focal * (Lanes::load(tree.q + ray) - eye[1]) - v * z;
            const Floats per_z = 1.0f / z;
            Lanes::store(tree.p + ray, p), Lanes::store(tree.q + ray, q), Lanes::store(tree.begin + ray, z);
            Lanes::store(tree.clip_inv_z + ray, Lanes::min(per_z, Lanes::all(NOWHERE)));
            const Floats terms[3] = {Lanes::abs(p), Lanes::abs(q), Lanes::abs(u * q) + Lanes::abs(v * p)};
            moments[0].add(p, has_ray), moments[1].add(q, has_ray), moments[2].add(u * q - v * p, has_ray);
            for (int i = 0; i < 3; ++i) size[i] = Lanes::max(size[i], has_ray ? terms[i] : Lanes::all(0.0f));
            LaneRange at_u, at_v;
            at_u.add(u, has_ray), at_v.add(v, has_ray);
            set_bounds(bounds, child,
                       RayBox{at_u.least() - MARGIN, at_v.least() - MARGIN, at_u.greatest() + MARGIN,
                              at_v.greatest() + MARGIN});
        }
        float* range = tree.range + tile * RayOrigins::RANGE_WORDS;
        for (int i = 0; i < 3; ++i) {
            const float low = moments[i].least(), high = moments[i].greatest(), most = Lanes::max_of(size[i]);
            const bool empty = low > high;
            range[i] = empty ? 0.0f : 0.5f * (low + high);
            range[i + 3] = empty ? 0.0f : 0.5f * (high - low) + 2.0f * ROUNDED * most;
            if (i == 0) max_p = __builtin_fmaxf(max_p, most * (1.0f + ROUNDED));
            if (i == 1) max_q = __builtin_fmaxf(max_q, most * (1.0f + ROUNDED));
        }
        set_fit(tile, full);
    }
    static inline void set_bounds(float* rows, int child, const RayBox& box) {
        rows[child] = box.u0, rows[LANES + child] = box.v0;
        rows[2 * LANES + child] = box.u1, rows[3 * LANES + child] = box.v1;
    }

    inline void set_fit(int tile, bool full) {
        RayFit& fit = tree.fit[tile];
        fit = RayFit();
        const RayFit& at_rest = rest.fit[tile];
        if (!full || at_rest.spacing <= 0.0f) return;
        const long long first = (long long)tile * (LANES * LANES);
        const TileFit found = TileFit::of((int)at_rest.shift, tree.u + first, tree.v + first);
        fit = found.words();
        if (fit.spacing <= 0.0f) return;
        found.grid.to_rows(tree.u + first, tree.row_u + first);
        found.grid.to_rows(tree.v + first, tree.row_v + first);
        found.grid.to_rows(tree.p + first, tree.row_p + first);
        found.grid.to_rows(tree.q + first, tree.row_q + first);
    }

    // Bounds of tiles from those of packets, and of groups from those of tiles.
    inline void bound_tiles() {
        const int rows = RayTree::BOUND_ROWS * LANES;
        for (int tile = 0; tile < tiles; ++tile)
            set_bounds(tree.tile_bounds + tile / LANES * rows, tile % LANES, around(tree.packet_bounds + tile * rows));
        for (int group = 0; group < LANES; ++group)
            set_bounds(tree.group_bounds, group,
                       group < bundle.groups ? around(tree.tile_bounds + group * rows)
                                             : RayBox{NOWHERE, NOWHERE, -NOWHERE, -NOWHERE});
    }
    static inline RayBox around(const float* rows) {
        return RayBox{Lanes::min_of(Lanes::load(rows)), Lanes::min_of(Lanes::load(rows + LANES)),
                      Lanes::max_of(Lanes::load(rows + 2 * LANES)), Lanes::max_of(Lanes::load(rows + 3 * LANES))};
    }

    // A pixel whose ray is about in the middle of the bundle.
    inline int middle_pixel() const {
        const int slots = tiles * (LANES * LANES);
        for (int k = 0; k < slots; ++k) {
            const int pixel = rest.place[(slots / 2 + k) % slots];
            if (pixel >= 0) return pixel;
        }
        return 0;
    }
    inline int rays() const {
        int count = 0;
        for (int slot = 0; slot < tiles * (LANES * LANES); slot += LANES)
            count += __builtin_popcount(Lanes::bits(has_ray(slot)));
        return count;
    }
    // Greatest distance of the origin of a ray from the eye.
    inline float reach() const {
        double square = (double)max_origin_z * max_origin_z;
        for (int i = 0; i < 2; ++i) {
            const double half = 0.5 * ((double)from[i].greatest() - from[i].least());
            square += half * half;
        }
        return (float)__builtin_sqrt(square) * (1.0f + 2.0f * ROUNDED);
    }
    // The bundle's image: whole pixels that contain all rays.
    inline Bundle image_bundle() const {
        const RayBox box = around(tree.group_bounds);
        Bundle part = bundle;
        const int left = (int)__builtin_floorf(box.u0) - 1, top = (int)__builtin_floorf(box.v0) - 1;
        part.width = (int)__builtin_ceilf(box.u1) + 1 - left, part.height = (int)__builtin_ceilf(box.v1) + 1 - top;
        part.center[0] = -left, part.center[1] = -top;
        return part;
    }
};
