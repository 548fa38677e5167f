// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/lanes.h"
#include "cpu/rows.h"

// Bounding spheres of the geoms that rays can hit, in one world, in blocks of LANES geoms in the scratch memory of a
// worker. `Geoms` are `RayGeoms` of kernels/mujoco/rangefinders.py.
//
// Single precision suffices to find the few spheres that a ray may reach; `may_meet` of that module tests those again.
struct Spheres {
    enum { X, Y, Z, RADIUS, BODY, ROWS };
    // Bound of rounding errors, relative to the squares of distances from the ray's origin and of it from the world's.
    static constexpr float MAX_ERROR = 4e-6f;

    float* blocks;  // [block][ROWS][LANES]

    template <class Scratch>
    static inline Spheres of(const Scratch& scratch, int worker) {
        return Spheres{scratch.data + (long long)worker * scratch.shape[1]};
    }

    // Copy the spheres of a world. Those of unbounded geoms are infinite; lanes without a geom have another one's.
    template <class Geoms, class Places>
    inline void place(const Geoms& geoms, const Places& geom_xpos, int world) const {
        const auto* places = geom_xpos.data + (long long)world * geom_xpos.shape[1];
        const int count = geoms.geom.shape[0];
        for (int first = 0; first < count; first += LANES) {
            float* rows = blocks + first * ROWS;
            for (int lane = 0; lane < LANES; ++lane) {
                const int index = first + lane < count ? first + lane : first;
                const auto& center = places[geoms.geom.data[index]];
                for (int axis = 0; axis < 3; ++axis) rows[axis * LANES + lane] = center[axis];
                const double radius = geoms.bound.data[index];
                rows[RADIUS * LANES + lane] = radius == 0.0 ? __builtin_inff() : (float)radius;
                rows[BODY * LANES + lane] = __builtin_bit_cast(float, geoms.body.data[index]);
            }
        }
    }

    // One bit for each sphere of a block that a ray may reach before `nearest`, except those of `body`; `count` geoms
    // remain from this block on. Comparisons that fail for NaN keep a sphere.
    template <class Ray>
    inline unsigned met(int block, int count, const Ray& ray, double nearest, int body) const {
        const float* rows = blocks + (long long)block * LANES * ROWS;
        const float o[3] = {(float)ray.origin[0], (float)ray.origin[1], (float)ray.origin[2]};
        const float d[3] = {(float)ray.direction[0], (float)ray.direction[1], (float)ray.direction[2]};
        const Floats x = row(rows, X) - o[0], y = row(rows, Y) - o[1], z = row(rows, Z) - o[2];
        const Floats along = x * d[0] + (y * d[1] + z * d[2]), square = x * x + (y * y + z * z);
        const Floats error = (square + (o[0] * o[0] + o[1] * o[1] + o[2] * o[2])) * MAX_ERROR;
        // Errors of lengths are less than those of squares, or less than 1e-6.
        const Floats radius = row(rows, RADIUS), reach = radius + error + MAX_ERROR;
        const Ints missed = (along + reach < 0.0f) | (along - reach > (float)nearest) |
                            (square - along * along > radius * radius + error) |
                            (Lanes::load((const int*)(rows + BODY * LANES)) == body);
        const int lanes = count < LANES ? count : LANES;
        return ~Lanes::bits(missed) & ((1u << lanes) - 1u);
    }

  private:
    static inline Floats row(const float* rows, int kind) { return Lanes::load(rows + kind * LANES); }
};
