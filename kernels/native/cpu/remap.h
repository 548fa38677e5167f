// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rendering of images at the places of a map, in units of trees: each is rendered like a bundle of a ray table
// (table.h).

#pragma once

#include "cpu/remap_tree.h"
#include "cpu/table.h"

// A worker's memory.
struct RemapMemory {
    TableMemory table;
    RemapTree tree;

    static inline RemapMemory carve(Arena& arena, const RemapJob& job, int movables, int levels) {
        const int max_groups = job.across() * job.down();
        RemapMemory memory;
        memory.table = TableMemory::carve(arena, max_groups, movables, levels);
        memory.tree = RemapTree::carve(arena, max_groups);
        return memory;
    }
};

// Parts of maps, as units of work.
struct Maps {
    typedef RemapJob Work;
    typedef RemapMemory Memory;

    static inline int count(const RemapJob& remap) { return remap.views * remap.trees(); }

    // A pinhole job for a rectangle of places.
    static inline Job tree_job(const RemapJob& remap, const RayBox& box) {
        const int x0 = (int)__builtin_floorf(box.u0) - 1, y0 = (int)__builtin_floorf(box.v0) - 1;
        Job job = remap;
        job.width = (int)__builtin_ceilf(box.u1) + 1 - x0;
        job.height = (int)__builtin_ceilf(box.v1) + 1 - y0;
        job.focal[0] = job.focal[1] = remap.tree_focal;
        job.center[0] = -x0;
        job.center[1] = -y0;
        return job;
    }

    static inline void unit(const Scene& scene, const RemapJob& remap, const Images& out, const RemapMemory& memory,
                            int unit, Mode mode) {
        const int index = unit / remap.trees();
        const RemapPart part = RemapPart::of(remap, unit % remap.trees());
        const RayBox box = memory.tree.set(remap, part, index, memory.table.image);
        const bool has_places = box.u0 <= box.u1;
        const Job job = tree_job(remap, has_places ? box : RayBox{0.0f, 0.0f, 0.0f, 0.0f});
        const RayTree tree = memory.tree.as_ray_tree(remap.clip_inv_z);
        const Image image = memory.table.image_of(job, tree);
        const View view = View::of<TABLE_RAYS>(scene, job, scene.movables.of_view(index), remap.pose_of(index));
        if (has_places && view.world.exists) Packets<TABLE_RAYS>::render(view, image, memory.table.traversal, mode);
        const bool moving = scene.movables.count > 0 && mode == MODE_TRIANGLES;
        const Lookup lookup = Lookup::of(scene, memory.table.traversal.frames, view.pose.position, moving);
        NormalCache normal_cache;
        Writer writer = {lookup, view.camera, Rays::of(view.camera), image, job, out, index, mode};
        writer.cache_normals(normal_cache);
        Job table = remap;
        table.width = remap.columns, table.height = remap.rows;
        write(TableWriter<TABLE_RAYS>{writer, table, tree, (long long)index * remap.rows * remap.columns}, remap, part,
              memory.tree);
    }

    static inline void write(TableWriter<TABLE_RAYS> writer, const RemapJob& remap, const RemapPart& part,
                             const RemapTree& tree) {
        const Images& out = writer.writer.out;
        const bool depth_only = writer.writer.mode == MODE_DEPTH && out.depth && !out.points;
        for (int index = 0; index < remap.across() * remap.down() * LANES; ++index) {
            const MapTile tile = MapTile::of(remap, part, writer.writer.view, index);
            if (!tile.in_map) continue;
            tree.show_outside(writer.writer.image, index);
            if (!tile.whole)
                writer.packets(index);
            else if (depth_only)
                writer.depth_blocks(index);
            else
                writer.blocks(index);
        }
    }
};
