// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Bundles of a ray table, and the memory to render them.

#pragma once

#include "cpu/packets.h"

// A bundle: its right, down and forward axes in the camera frame. Axes are 0, 1, 2 for x, y, z; the complement is the
// opposite direction.
struct Bundle {
    int first_group, groups;
    int axis[3];
    int width, height;  // in pixels of the bundle
    int center[2];

    inline Pose face(const Pose& camera) const {
        Pose pose = camera;
        for (int i = 0; i < 3; ++i) {
            const int source = axis[i] < 0 ? ~axis[i] : axis[i];
            for (int k = 0; k < 3; ++k)
                pose.axis[i][k] = axis[i] < 0 ? -camera.axis[source][k] : camera.axis[source][k];
        }
        return pose;
    }
};

struct TableJob : Job {  // of the whole table, in any direction
    int bundles;
    const Bundle* bundle;
    const float* bundle_far;  // greatest z of rays that are in range
    RayTree tree;  // of all bundles
    const int* without_ray;  // pixel indices
    int without_rays;
    int max_groups;  // of any bundle
    const double* eye;  // [bundle]: its position in the bundle's frame; null if it is the camera's
    const float* origins;  // [bundle]: max_p, max_q and reach of its `RayOrigins`

    // The job of a `TableCall` of kernels/casting/ray_bundle_packets.py.
    template <class TableCall>
    static inline TableJob of(const TableCall& call) {
        const auto& rays = call.rays;
        TableJob job = {Job::of_call(call)};
        job.focal[0] = job.focal[1] = rays.focal;
        job.bundles = rays.bundle.shape[0];
        job.bundle = (const Bundle*)rays.bundle.data;
        job.bundle_far = call.job.bundle_far.data;
        job.tree = RayTree::of(call);
        job.without_ray = rays.without_ray.data;
        job.without_rays = rays.without_ray.shape[0];
        job.max_groups = rays.max_groups;
        job.eye = call.origins.eye.data;
        job.origins = call.origins.maxima.data;
        return job;
    }

    // The bundle as a job of a pinhole camera.
    inline Job job_of(int index) const {
        const Bundle& source = bundle[index];
        Job job = *this;
        job.width = source.width;
        job.height = source.height;
        job.center[0] = source.center[0];
        job.center[1] = source.center[1];
        job.far = bundle_far[index];
        // Rays begin up to this far from the eye: boxes within that distance may contain their origins.
        if (eye) job.clip_reach += origins[3 * index + 2];
        return job;
    }
    inline RayTree tree_of(int index) const {
        const int group = bundle[index].first_group, rows = RayTree::BOUND_ROWS * LANES, tile = group * LANES;
        const long long ray = (long long)tile * LANES * LANES;
        RayTree part = tree;
        part.group_bounds += (long long)index * rows;
        part.tile_bounds += (long long)group * rows;
        part.packet_bounds += (long long)tile * rows;
        part.u += ray, part.v += ray, part.rest_u += ray, part.rest_v += ray, part.place += ray;
        part.run += (long long)tile * LANES;
        part.row_u += ray, part.row_v += ray;
        part.corner += tile;
        part.fit += tile;
        if (part.scale) part.scale += ray;
        if (eye) {
            RayOrigins& rays = part.origins;
            rays.p += ray, rays.q += ray, rays.begin += ray, rays.clip_inv_z += ray;
            rays.row_p += ray, rays.row_q += ray;
            rays.range += tile * RayOrigins::RANGE_WORDS;
            rays.max_p = origins[3 * index], rays.max_q = origins[3 * index + 1], rays.reach = origins[3 * index + 2];
        }
        return part;
    }
    // The pose of the bundle's pinhole camera, at its eye.
    inline Pose face_of(int index, const Pose& camera) const {
        Pose pose = bundle[index].face(camera);
        for (int i = 0; eye && i < 3; ++i)
            for (int k = 0; k < 3; ++k) pose.position[k] += eye[3 * index + i] * pose.axis[i][k];
        return pose;
    }
};

// A worker's memory.
struct TableMemory {
    Image image;
    Traversal traversal;

    static inline TableMemory carve(Arena& arena, const TableJob& job, int movables, int levels) {
        return carve(arena, job.max_groups, movables, levels);
    }
    static inline TableMemory carve(Arena& arena, int max_groups, int movables, int levels) {
        TableMemory memory;
        Image& image = memory.image;
        const long long packets = (long long)max_groups * RayTree::GROUP_PACKETS;
        image.inv_z = arena.floats(packets * LANES);
        image.id = arena.ints(packets * LANES);
        image.take_blocks(arena, (long long)max_groups * LANES);
        image.first_packet = image.id;  // not null: rays may pass through any point of a pixel
        memory.traversal = Traversal::carve(arena, movables, levels);
        return memory;
    }
    inline Image image_of(const Job& job, const RayTree& tree) const {
        Image part = image;
        part.set_size(job.width, job.height, 0, job.height);
        part.set_center(job.center);
        part.tree = &tree;
        return part;
    }
};
