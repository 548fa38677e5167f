// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Images of sensors that move within a frame, in units of bundles.

#pragma once

#include "cpu/moving_tree.h"
#include "cpu/table.h"
#include "cpu/touched_rays.h"

struct MovingJob : TableJob {
    TimedRays rays;
    SensorMotion motion;
    SensorMotion objects;  // without legs if no object moves
    int* left;  // [view]: becomes 1 if packets cannot cast it
    int* touched;  // [view][pixel]: bits of the objects that its ray may hit

    // The job of a `MovingCall` of kernels/casting/moving_ray_packets.py.
    template <class MovingCall>
    static inline MovingJob of(const MovingCall& call) {
        MovingJob job = {TableJob::of(call)};
        job.views = call.moving.left.shape[0];
        job.rays = TimedRays::of(call.moving);
        job.motion = SensorMotion::of(call.sensor, job.width);
        job.objects = SensorMotion::of(call.objects);
        job.touched = call.moving.touched.data;
        job.left = call.moving.left.data;
        return job;
    }
    // The bundle's job, for rays of a tree that was made.
    inline Job job_of(const MovingTreeMaker& made) const {
        const Bundle source = made.image_bundle();
        Job job = *this;
        job.width = source.width, job.height = source.height;
        job.center[0] = source.center[0], job.center[1] = source.center[1];
        job.far = __builtin_fminf(far / made.per_z.least() * (1.0f + made.ROUNDED) + made.max_origin_z, NOWHERE);
        job.clip_reach += made.reach();
        return job;
    }
};

// A worker's memory.
struct MovingMemory {
    TableMemory table;
    MovingTree tree;
    TouchedRays touched;

    static inline MovingMemory carve(Arena& arena, const MovingJob& job, int movables, int levels) {
        const TableMemory table = TableMemory::carve(arena, job.max_groups, movables, levels);
        const MovingTree tree = MovingTree::carve(arena, job.max_groups);
        return MovingMemory{table, tree, TouchedRays::carve(arena, movables)};
    }
};

// Bundles of a moving sensor, as units of work.
struct MovingBundles {
    // A view of a surface so near that more tests in double precision than this are made for a ray is left.
    enum { MAX_EXACT_TESTS = 12 };
    typedef MovingJob Work;
    typedef MovingMemory Memory;

    static inline int count(const MovingJob& table) { return table.views * table.bundles; }

    static inline void unit(const Scene& scene, const MovingJob& table, const Images& out, const MovingMemory& memory,
                            int unit, Mode mode) {
        const int index = unit % table.views, number = unit / table.views;
        if (table.left[index]) return;  // since another bundle cannot be cast
        const Bundle& bundle = table.bundle[number];
        const RayTree rest = table.tree_of(number);
        const SensorPath path = SensorPath::of(table.motion, index);
        const double *span = table.rays.span + 2 * number, middle = 0.5 * (span[0] + span[1]) + path.start;
        MovingTreeMaker made = {memory.tree, rest, bundle, (float)table.focal[0], span[0], span[1]};
        const RayPoses& of_rays = table.motion.of_rays;
        Pose pose = bundle.face(of_rays.pose ? of_rays.of(of_rays.row(index, made.middle_pixel())) : path.at(middle));
        const long long first = (long long)bundle.first_group * (LANES * LANES * LANES);
        if (!made.make(table.rays, path, pose, middle, first)) {
            table.left[index] = 1;
            return;
        }
        RayTree tree = memory.tree.of(rest);
        int exact_tests = MAX_EXACT_TESTS * made.rays();
        tree.origins.exact_tests = &exact_tests;
        tree.origins.max_p = made.max_p, tree.origins.max_q = made.max_q, tree.origins.reach = made.reach();
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k) pose.position[k] += made.eye[i] * pose.axis[i][k];
        const Job job = table.job_of(made);
        const int world = scene.movables.world_of_view(index);
        if (table.objects.legs && world >= 0)
            memory.touched.mark(made, scene.movables, table.objects, world, path.start, pose,
                                table.touched + (long long)index * table.height * table.width);
        Bundles<ORIGIN_RAYS>::cast(scene, table, out, memory.table, {job, tree, bundle, pose, index}, mode);
        if (tree.origins.is_exhausted()) table.left[index] = 1;
        for (int i = 0; number == 0 && i < table.without_rays; ++i)
            Writer::put_empty(out, (long long)index * table.height * table.width + table.without_ray[i]);
    }
};
