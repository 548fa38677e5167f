// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The motion of a sensor, as in kernels/casting/motions.py, relative to a reference pose: for many rays at once.
//
// Within a leg, the pose at share s is the pose at share b times exp((s - b) w), where w is the leg's rotation vector:
// both rotate about the same axis of the body. With W the cross product matrix of w and x = (s - b)^2 |w|^2,
//
//     exp((s - b) w) = 1 + (s - b) S(x) W + (s - b)^2 C(x) W^2,    S(x) = sin(r) / r,  C(x) = (1 - cos(r)) / r^2
//
// with r = sqrt(x) (Rodrigues' formula). On a screw motion, s is the time, and the position moves by
//
//     (s - b) v + (s - b)^2 C(x) W v + (s - b)^3 D(x) W^2 v,    D(x) = (r - sin(r)) / r^3
//
// (Lynch and Park, "Modern Robotics", 2017, equation 3.88). Near the reference x is small: polynomials suffice.

#pragma once

#include "shared/pose.h"

// Doubles of some lanes: few enough that a ray's numbers stay in registers.
enum { SOME = 4 };
typedef double Some __attribute__((ext_vector_type(SOME)));
typedef float SomeFloats __attribute__((ext_vector_type(SOME)));

// The first terms of the series of S, C and D.
struct SmallAngle {
    Some sine, cosine, cube;

    static constexpr double MAX_SQUARE = 0.25;  // up to here, the terms left out are below 4e-14
    static constexpr double TINY_SQUARE = 2e-4;  // the same for those that `of_tiny` leaves out

    static inline SmallAngle of(Some x) {
        return SmallAngle{
            1 - x * (1.0 / 6 - x * (1.0 / 120 - x * (1.0 / 5040 - x * (1.0 / 362880 - x * (1.0 / 39916800))))),
            0.5 - x * (1.0 / 24 - x * (1.0 / 720 - x * (1.0 / 40320 - x * (1.0 / 3628800 - x * (1.0 / 479001600))))),
            1.0 / 6 - x * (1.0 / 120 - x * (1.0 / 5040 - x * (1.0 / 362880 - x * (1.0 / 39916800)))),
        };
    }
    static inline SmallAngle of_tiny(Some x) {
        return SmallAngle{1 - x * (1.0 / 6 - x * (1.0 / 120)), 0.5 - x * (1.0 / 24 - x * (1.0 / 720)),
                          1.0 / 6 - x * (1.0 / 120)};
    }
};

// Poses of a sensor for some rays, in the frame of a reference pose.
struct RayFrames {
    Some row[3][3], origin[3];

    static inline RayFrames select(decltype(Some() < Some()) which, const RayFrames& a, const RayFrames& b) {
        RayFrames mixed;
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) mixed.row[i][j] = which ? a.row[i][j] : b.row[i][j];
            mixed.origin[i] = which ? a.origin[i] : b.origin[i];
        }
        return mixed;
    }
    inline Some rotated(int i, const Some* v) const { return row[i][0] * v[0] + row[i][1] * v[1] + row[i][2] * v[2]; }
};

// A `Leg` of kernels/casting/motions.py: its pose is a function of the share of the leg that has passed.
struct SensorLeg {
    double origin[3], rotation[4], path[3], vector[3];

    // The pose at a share, with axes in the world.
    inline Pose at(double share, bool is_screw) const {
        const double square = share * share * dot(vector, vector), angle = __builtin_sqrt(square);
        const double sine = __builtin_sin(angle / 2), half = angle > 0 ? sine / angle : 0.5;
        double turn[4], moved[3];
        for (int k = 0; k < 3; ++k) turn[k] = half * share * vector[k];
        turn[3] = __builtin_cos(angle / 2);
        const double *a = rotation, *b = turn;
        const double x = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1];
        const double y = a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2];
        const double z = a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0];
        const double w = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
        Pose pose;
        Pose::axes_of(x, y, z, w, 2.0, pose.axis);
        if (is_screw)
            move_along_screw(share, square, half, angle, moved);
        else
            for (int k = 0; k < 3; ++k) moved[k] = share * path[k];
        for (int k = 0; k < 3; ++k) pose.position[k] = origin[k] + moved[k];
        return pose;
    }
    // How far a screw motion moves the position from share 0, in the world. `half` is sin(angle / 2) / angle.
    inline void move_along_screw(double share, double square, double half, double angle, double* moved) const {
        // (angle - sin(angle)) / angle^3 suffers from cancellation near 0, where its series is used.
        const double third = angle > 1e-2 ? (angle - __builtin_sin(angle)) / (square * angle) : (1 - square / 20) / 6;
        double once[3], twice[3], local[3];
        cross(vector, path, once);
        cross(vector, once, twice);
        for (int k = 0; k < 3; ++k)
            local[k] = share * (path[k] + share * (2 * half * half * once[k] + share * third * twice[k]));
        Pose first;
        Pose::axes_of(rotation[0], rotation[1], rotation[2], rotation[3], 2.0, first.axis);
        first.rotate_out(local, moved);
    }

    static inline double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
    static inline void cross(const double* a, const double* b, double* out) {
        for (int k = 0; k < 3; ++k) out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
    }
};

// A leg relative to a reference pose, in its frame.
struct RelativeLeg {
    double begin;  // time from which on the leg applies [s]; -infinity for the first one
    double base, rate;  // s - b = (time - base) * rate
    double square;  // |w|^2
    double turn[3][3][3];  // the rotation is turn[0] + (s - b) S turn[1] + (s - b)^2 C turn[2]
    // The position is path[0] + (s - b) path[1] + (s - b)^2 C path[2] + (s - b)^3 D path[3].
    double path[4][3];

    static inline RelativeLeg of(const SensorLeg& leg, double share, bool is_screw, const Pose& reference) {
        RelativeLeg part;
        part.square = SensorLeg::dot(leg.vector, leg.vector);
        const Pose base = leg.at(share, is_screw);
        for (int j = 0; j < 3; ++j) {
            double axis[3], once[3] = {0, 0, 0}, across[3][3];
            once[j] = 1;
            SensorLeg::cross(leg.vector, once, across[0]);
            SensorLeg::cross(leg.vector, across[0], across[1]);
            for (int order = 0; order < 3; ++order) {
                double world[3];
                base.rotate_out(order ? across[order - 1] : once, world);
                reference.rotate_into(world, axis);
                for (int i = 0; i < 3; ++i) part.turn[order][i][j] = axis[i];
            }
        }
        reference.transform_into(base.position, part.path[0]);
        if (is_screw) {
            part.set_screw(leg, base, reference);
        } else {
            reference.rotate_into(leg.path, part.path[1]);
            for (int k = 0; k < 3; ++k) part.path[2][k] = part.path[3][k] = 0;
        }
        return part;
    }
    inline void set_screw(const SensorLeg& leg, const Pose& base, const Pose& reference) {
        double along[3] = {leg.path[0], leg.path[1], leg.path[2]}, world[3], next[3];
        for (int order = 1; order < 4; ++order) {
            base.rotate_out(along, world);
            reference.rotate_into(world, path[order]);
            SensorLeg::cross(leg.vector, along, next);
            for (int k = 0; k < 3; ++k) along[k] = next[k];
        }
    }

    // The poses at times, of which the greatest rotation since the base has the square `most`.
    inline RayFrames at(Some time, double most) const {
        const Some share = (time - base) * rate, x = share * share * square;
        const SmallAngle small = most <= SmallAngle::TINY_SQUARE ? SmallAngle::of_tiny(x) : SmallAngle::of(x);
        const Some once = share * small.sine, twice = share * share * small.cosine;
        const Some thrice = share * share * share * small.cube;
        RayFrames frames;
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) frames.row[i][j] = turn[0][i][j] + once * turn[1][i][j] + twice * turn[2][i][j];
            frames.origin[i] = path[0][i] + share * path[1][i] + twice * path[2][i] + thrice * path[3][i];
        }
        return frames;
    }
    // The square of the rotation between the base and a time.
    inline double square_at(double time) const {
        const double share = (time - base) * rate;
        return share * share * square;
    }
};

// Poses of individual rays: [view][y][x], where any dimension may be 1 to share poses; null if a sensor follows legs.
struct RayPoses {
    const float* pose;
    int views, height, width;
    int image_width;  // [px]

    inline int row(int view, int pixel) const {
        const int y = pixel / image_width, x = pixel % image_width;
        return ((views > 1 ? view : 0) * height + (height > 1 ? y : 0)) * width + (width > 1 ? x : 0);
    }
    inline Pose of(int row) const { return Pose::from(pose + 7ll * row); }
    // Set the frames of lanes whose rows have changed, relative to a pose, which is that of rows below 0.
    inline void update(const int* rows, const Pose& reference, int* known, RayFrames& frames) const {
        for (int k = 0; k < SOME; ++k) {
            if (rows[k] == known[k]) continue;
            known[k] = rows[k];
            const Pose here = (rows[k] < 0 ? reference : of(rows[k])).seen_from(reference);
            for (int i = 0; i < 3; ++i) {
                for (int j = 0; j < 3; ++j) frames.row[i][j][k] = here.axis[j][i];
                frames.origin[i][k] = here.position[i];
            }
        }
    }
};

// A `Motion` of kernels/casting/motions.py.
struct SensorMotion {
    const SensorLeg* legs;  // [instant][view], or one for all views; [instant][world][object]
    int rows, instants;  // of legs
    const double *times, *starts;  // [instant]; [view]: start of its frame [s]; null if there is one instant, or for 0
    bool is_screw;
    RayPoses of_rays;

    template <class Motion>
    static inline SensorMotion of(const Motion& motion, int image_width = 1) {
        static_assert(sizeof *motion.legs.data == sizeof(SensorLeg), "Python stores rows of numbers");
        return SensorMotion{(const SensorLeg*)motion.legs.data,
                            motion.legs.shape[1] * motion.legs.shape[2],
                            motion.legs.shape[0],
                            motion.times.data,
                            motion.starts.data,
                            motion.is_screw,
                            {(const float*)motion.poses.data, motion.poses.shape[0], motion.poses.shape[1],
                             motion.poses.shape[2], image_width}};
    }
};

// The path of one view's sensor, or of an object.
struct SensorPath {
    const SensorMotion& motion;
    int row;
    double start;  // of the view's frame [s]
    int view = 0;

    static inline SensorPath of(const SensorMotion& motion, int view) {
        return SensorPath{motion, view < motion.rows ? view : motion.rows - 1,
                          motion.starts ? motion.starts[view] : 0.0, view};
    }
    inline const SensorLeg& leg(int instant) const { return motion.legs[(long long)instant * motion.rows + row]; }
    // The last leg that has begun at a time, or the first one.
    inline int leg_at(double time) const {
        int low = 0;
        if (motion.times)
            for (int high = motion.instants; high - low > 1;) {
                const int middle = (low + high) / 2;
                (motion.times[middle] <= time ? low : high) = middle;
            }
        return low;
    }
    inline bool has_end(int instant) const { return motion.times && instant + 1 < motion.instants; }
    inline double begin(int instant) const { return motion.times ? motion.times[instant] : 0.0; }
    // The share of a leg that passes in a second; a leg without end does not move.
    inline double rate(int instant) const {
        if (motion.is_screw) return 1.0;
        return has_end(instant) ? 1.0 / (motion.times[instant + 1] - motion.times[instant]) : 0.0;
    }
    inline double share(int instant, double time) const { return (time - begin(instant)) * rate(instant); }

    inline Pose at(double time) const {
        const int instant = leg_at(time);
        return leg(instant).at(share(instant, time), motion.is_screw);
    }
    // Bound of the way between two times of a point at a distance from the body's origin.
    inline double travel(double from, double to, double distance) const {
        double way = 0.0;
        for (int k = leg_at(from), last = leg_at(to); k <= last; ++k) {
            const SensorLeg& part = leg(k);
            const double begin_here = motion.times && from < begin(k) ? begin(k) : from;
            const double end_here = has_end(k) && to > begin(k + 1) ? begin(k + 1) : to;
            way += (end_here - begin_here) * rate(k) *
                   (__builtin_sqrt(SensorLeg::dot(part.path, part.path)) +
                    distance * __builtin_sqrt(SensorLeg::dot(part.vector, part.vector)));
        }
        return way;
    }
    // A leg near a time, relative to a pose.
    inline RelativeLeg relative(int instant, double time, const Pose& reference) const {
        if (motion.times && time < motion.times[instant]) time = motion.times[instant];
        if (has_end(instant) && time > motion.times[instant + 1]) time = motion.times[instant + 1];
        RelativeLeg part = RelativeLeg::of(leg(instant), share(instant, time), motion.is_screw, reference);
        part.base = time, part.rate = rate(instant);
        part.begin = instant == 0 ? -__builtin_inf() : begin(instant);
        return part;
    }
};
