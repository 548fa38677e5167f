// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rendering with rays of a ray table, in units of bundles: each is rendered as a separate image of a pinhole camera
// that faces along one of the camera's axes, with pixels much smaller than the spacing of the rays.

#pragma once

#include "cpu/table_output.h"

// One bundle of a view.
struct BundleView {
    const Job& job;
    const RayTree& tree;
    const Bundle& bundle;
    const Pose& pose;  // of its pinhole camera
    int index;  // of the view
};

template <RayKind KIND>
struct Bundles {
    typedef TableJob Work;
    typedef TableMemory Memory;

    static inline int count(const TableJob& table) { return table.views * table.bundles; }

    static inline void unit(const Scene& scene, const TableJob& table, const Images& out, const TableMemory& memory,
                            int unit, Mode mode) {
        const int index = unit % table.views, bundle = unit / table.views;
        const Job job = table.job_of(bundle);
        const RayTree tree = table.tree_of(bundle);
        const Pose pose = table.face_of(bundle, table.pose_of(index));
        cast(scene, table, out, memory, {job, tree, table.bundle[bundle], pose, index}, mode);
        for (int i = 0; bundle == 0 && i < table.without_rays; ++i)
            Writer::put_empty(out, (long long)index * table.height * table.width + table.without_ray[i]);
    }

    static inline __attribute__((always_inline)) void cast(const Scene& scene, const TableJob& table, const Images& out,
                                                           const TableMemory& memory, const BundleView& part,
                                                           Mode mode) {
        const Image image = memory.image_of(part.job, part.tree);
        const int groups = part.bundle.groups, index = part.index;
        part.tree.begin(image, groups);
        const View view = View::of<KIND>(scene, part.job, scene.movables.of_view(index), part.pose);
        if (view.world.exists) Packets<KIND>::render(view, image, memory.traversal, mode);
        const long long first = (long long)index * table.height * table.width;
        // Two instantiations, as for pixels: one for scenes without movable objects.
        const auto write = [&](bool moving) __attribute__((always_inline)) {
            const Lookup lookup = Lookup::of(scene, memory.traversal.frames, view.pose.position, moving);
            NormalCache normal_cache;
            Writer writer = {lookup, view.camera, Rays::of(view.camera), image, part.job, out, index, mode};
            writer.cache_normals(normal_cache);
            TableWriter<KIND>{writer, table, part.tree, first}.tiles(groups);
        };
        if (scene.movables.count > 0 && mode == MODE_TRIANGLES)
            write(true);
        else
            write(false);
    }
};
