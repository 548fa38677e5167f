// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Which rays of a moving sensor may hit objects that move within a frame: a sphere around an object and its path during
// the times of a bundle. Only these rays are then cast at the objects, one by one.

#pragma once

#include "cpu/moving_tree.h"

// A sphere in the frame of a bundle's eye.
struct PathSphere {
    float x, y, z, radius;
    int bit;

    static constexpr float MARGIN = 1e-4f;  // of the radius and the place, for single precision

    // Around a box (least and greatest corner in the object's frame) on its path between two times.
    static inline PathSphere of(const float* box, const SensorPath& path, double begin, double end, const Pose& eye,
                                int object) {
        double middle[3], square = 0.0, distance = 0.0, world[3], local[3];
        for (int k = 0; k < 3; ++k) {
            const double half = 0.5 * ((double)box[3 + k] - box[k]);
            middle[k] = 0.5 * ((double)box[3 + k] + box[k]);
            square += half * half, distance += middle[k] * middle[k];
        }
        const Pose pose = path.at(0.5 * (begin + end));
        pose.rotate_out(middle, world);
        for (int k = 0; k < 3; ++k) world[k] += pose.position[k];
        eye.transform_into(world, local);
        const double radius = __builtin_sqrt(square) + path.travel(begin, end, __builtin_sqrt(distance));
        double places = 0.0;
        for (int k = 0; k < 3; ++k) places += __builtin_fabs(local[k]) + __builtin_fabs(world[k]);
        return PathSphere{(float)local[0], (float)local[1], (float)local[2],
                          (float)(radius + MARGIN * (radius + places)), 1 << (object % 32)};
    }

    // Whether it may meet rays with u and v in a rectangle and p and q up to maxima, all in units of depth: no ray is
    // beyond the plane through each side of the rectangle.
    inline bool meets(const RayBox& box, float max_p, float max_q) const {
        if (z + radius < 0.0f) return false;
        return !(is_beyond(x, box.u1, max_p) || is_beyond(-x, -box.u0, max_p) || is_beyond(y, box.v1, max_q) ||
                 is_beyond(-y, -box.v0, max_q));
    }
    inline bool is_beyond(float across, float slope, float reach) const {
        return across - reach - z * slope > radius * __builtin_sqrtf(1.0f + slope * slope);
    }
    // Which rays, (p, q, 0) + z (u, v, 1), pass within the radius.
    inline Ints meets(Floats u, Floats v, Floats p, Floats q) const {
        const Floats a = p - x, b = q - y, along_x = b + z * v, along_y = -z * u - a, along_z = a * v - b * u;
        return along_x * along_x + along_y * along_y + along_z * along_z <= radius * radius * (u * u + v * v + 1.0f);
    }
};

// Memory for the objects of a bundle.
struct TouchedRays {
    PathSphere* spheres;  // [object]
    int* near;  // [object]: spheres that a tile may meet

    static inline TouchedRays carve(Arena& arena, int objects) {
        TouchedRays memory;
        memory.spheres = (PathSphere*)arena.take(objects * (long long)sizeof(PathSphere));
        memory.near = arena.ints(objects);
        return memory;
    }

    // Set the bits of the objects that each ray of a bundle may hit; bit 32 is shared with bit 0, and so on.
    inline void mark(const MovingTreeMaker& made, const Movables& movables, const SensorMotion& objects, int world,
                     double start, const Pose& eye, int* touched) const {
        const double begin = made.earliest + start, end = made.latest + start;
        const float unit = 1.0f / made.focal;
        const RayBox all = made.around(made.tree.group_bounds).scaled(unit);
        const float max_p = made.max_p / made.focal, max_q = made.max_q / made.focal;
        int count = 0;
        for (int k = 0; k < movables.moving; ++k) {
            const SensorPath path = {objects, world * movables.moving + k, start};
            const PathSphere sphere =
                PathSphere::of(movables.boxes + (long long)k * BOX_WORDS, path, begin, end, eye, k);
            if (sphere.meets(all, max_p, max_q)) spheres[count++] = sphere;
        }
        for (int tile = 0; count && tile < made.tiles; ++tile) mark_tile(made, tile, count, max_p, max_q, touched);
    }
    inline void mark_tile(const MovingTreeMaker& made, int tile, int count, float max_p, float max_q,
                          int* touched) const {
        const float* bounds = made.tree.tile_bounds + tile / LANES * (RayTree::BOUND_ROWS * LANES);
        const RayBox box = RayTree::box_of(bounds, tile % LANES);
        if (box.u0 > box.u1) return;
        const float unit = 1.0f / made.focal;
        const RayBox slopes = box.scaled(unit);
        int found = 0;
        for (int k = 0; k < count; ++k)
            if (spheres[k].meets(slopes, max_p, max_q)) near[found++] = k;
        for (int slot = tile * LANES * LANES; found && slot < (tile + 1) * LANES * LANES; slot += LANES) {
            const auto load = [=](const float* rays) { return unit * Lanes::load(rays + slot); };
            const Floats u = load(made.tree.u), v = load(made.tree.v), p = load(made.tree.p), q = load(made.tree.q);
            Ints bits = {};
            for (int k = 0; k < found; ++k) {
                const PathSphere& sphere = spheres[near[k]];
                bits |= sphere.meets(u, v, p, q) & sphere.bit;
            }
            const Ints place = Lanes::load(made.rest.place + slot);
            for (const int lane : Lanes::each((bits != 0) & (place >= 0))) touched[place[lane]] = bits[lane];
        }
    }
};
