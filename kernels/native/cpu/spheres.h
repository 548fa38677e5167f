// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/lanes.h"
#include "cpu/rows.h"

// Bounding spheres of the geoms that rays can hit, in one world, in blocks of LANES geoms in the scratch memory of a
// worker. `Geoms` are `RayGeoms` of kernels/mujoco/rangefinders.py.
struct Spheres {
    enum { X, Y, Z, RADIUS, BODY, ROWS };

    double* blocks;  // [block][ROWS][LANES]

    template <class Scratch>
    static inline Spheres of(const Scratch& scratch, int worker) {
        return Spheres{scratch.data + (long long)worker * scratch.shape[1]};
    }

    // Copy the spheres of a world. Those of unbounded geoms are infinite, and those of missing lanes meet no ray.
    template <class Geoms, class Places>
    inline void place(const Geoms& geoms, const Places& geom_xpos, int world) const {
        const auto* places = geom_xpos.data + (long long)world * geom_xpos.shape[1];
        const int count = geoms.geom.shape[0];
        for (int first = 0; first < count; first += LANES) {
            double* rows = blocks + first * ROWS;
            for (int lane = 0; lane < LANES; ++lane) {
                const int index = first + lane;
                const bool exists = index < count;
                const auto& center = places[geoms.geom.data[exists ? index : first]];
                for (int axis = 0; axis < 3; ++axis) rows[axis * LANES + lane] = center[axis];
                const double radius = exists ? geoms.bound.data[index] : -1.0;
                rows[RADIUS * LANES + lane] = radius == 0.0 ? __builtin_inf() : exists ? radius : -__builtin_inf();
                rows[BODY * LANES + lane] = exists ? geoms.body.data[index] : -1;
            }
        }
    }

    // One bit for each sphere of a block that a ray reaches before `nearest`, except those of `body`: `may_meet` of
    // kernels/mujoco/rangefinders.py.
    template <class Ray>
    inline unsigned met(int block, const Ray& ray, double nearest, int body) const {
        const double* rows = blocks + (long long)block * LANES * ROWS;
        const Doubles x = row(rows, X) - ray.origin[0], y = row(rows, Y) - ray.origin[1],
                      z = row(rows, Z) - ray.origin[2];
        const Doubles radius = row(rows, RADIUS),
                      along = x * ray.direction[0] + (y * ray.direction[1] + z * ray.direction[2]);
        const auto inside = (along + radius >= 0.0) & (along - radius <= nearest) &
                            (x * x + (y * y + z * z) - along * along <= radius * radius) &
                            (row(rows, BODY) != (double)body);
        return Lanes::bits(__builtin_convertvector(inside, Ints));
    }

  private:
    static inline Doubles row(const double* rows, int kind) {
        Doubles values;
        __builtin_memcpy(&values, rows + kind * LANES, sizeof values);
        return values;
    }
};
