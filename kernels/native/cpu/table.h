// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rendering with rays of a ray table, in units of bundles: each is rendered as a separate image of a pinhole camera
// that faces along one of the camera's axes, with pixels much smaller than the spacing of the rays.

#pragma once

#include "cpu/table_output.h"

template <RayKind KIND>
struct TablePackets {
    static inline void unit(const Scene& scene, const TableJob& table, const Images& out, const TableMemory& memory,
                            int unit, Mode mode) {
        const int index = unit % table.views, bundle = unit / table.views;
        const Job job = table.job_of(bundle);
        const RayTree tree = table.tree_of(bundle);
        const Image image = memory.image_of(job, tree);
        const int groups = table.bundle[bundle].groups;
        tree.begin(image, groups);
        const Pose pose = Pose::from(table.poses + (long long)index * POSE_WORDS);
        const View view = View::of<KIND>(scene, job, scene.movables.of_view(index), table.face_of(bundle, pose));
        if (view.world.exists) Packets<KIND>::render(view, image, memory.traversal, mode);
        const double* viewpoint = view.pose.position;
        const Frame* frames = memory.traversal.frames;
        const long long first = (long long)index * table.height * table.width;
        // Two instantiations, as for pixels: one for scenes without movable objects.
        const Rays rays = Rays::of(view.camera);
        const auto write = [&](Lookup lookup) __attribute__((always_inline)) {
            TableWriter<KIND>{{lookup, view.camera, rays, image, job, out, index, mode}, table, tree, first}.tiles(
                groups);
        };
        if (scene.movables.count > 0 && mode == MODE_TRIANGLES)
            write(Lookup::of(scene, frames, viewpoint, true));
        else
            write(Lookup::of(scene, frames, viewpoint, false));
        if (bundle == 0) TableWriter<KIND>::empty(table, out, first);
    }

    static inline void work(const Scene& scene, const TableJob& table, const Images& out, const TableMemory& memory,
                            int* counter, Mode mode) {
        const int units = table.views * table.bundles;
        for (int next; (next = Workers::take(counter)) < units;) unit(scene, table, out, memory, next, mode);
    }

    // Take units of work, bundles of views, until none remain. With `run_units`, which does the same, Clang makes code
    // that takes 10 % longer for the objects that a lidar sees.
    static inline void run(const Scene& scene, const TableJob& table, const Images& out, const TableMemory& memory,
                           int* counter) {
        if (out.of_triangles())
            work(scene, table, out, memory, counter, MODE_TRIANGLES);
        else if (out.segmentation || out.labels)
            work(scene, table, out, memory, counter, MODE_OBJECTS);
        else
            work(scene, table, out, memory, counter, MODE_DEPTH);
        Workers::finish(counter);
    }
};

struct TableLaunch : Launch {
    // See kernels/casting/ray_bundle_packets.py.
    template <RayKind KIND, class TableCall, class Outputs>
    static inline void table(const TableCall& call, const Outputs& images) {
        const Scene scene = Scene::of(call.scene, call.worlds);
        const Images out = Images::of(images, call.scene);
        const TableJob job = TableJob::of(call);
        worker(
            call.job,
            [&](Arena& arena) { return TableMemory::carve(arena, job, scene.movables.count, call.scene.levels); },
            [&](const TableMemory& memory) {
                TablePackets<KIND>::run(scene, job, out, memory, call.job.counter.data);
            });
    }
};
