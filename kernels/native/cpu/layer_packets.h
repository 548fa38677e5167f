// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The next surfaces behind those that points of the image show, in packets of points (cpu/sparse.h): each lane has the
// greatest inv_z of what is behind its surface. Rays that need more than that comparison are left to the reference,
// kernels/casting/layers.py.

#pragma once

#include "cpu/packets.h"

// The arguments of a call of kernels/casting/layer_packets.py.
struct LayerWork {
    Job job;
    int points;  // per view
    double gap;
    // [view][point]: the surfaces in front
    const float* places;
    const int *segmentation, *faces;
    unsigned char *is_back, *is_left;  // [view][point]: whether triangles are seen from behind, and rays left
    int* left;  // becomes 1 if there are any

    template <class Call>
    static inline LayerWork of(const Call& call) {
        LayerWork work = {Job::of(call),          call.job.points, call.gap,          (const float*)call.points.data,
                          call.segmentation.data, call.faces.data, call.is_back.data, call.is_left.data,
                          call.left.data};
        Job& job = work.job;
        job.near = 0.0f, job.clip_inv_z = __builtin_inff(), job.clip_reach = 0.0f;  // `gap` replaces the near plane
        job.shows_back_faces = !job.cull_back_faces;
        return work;
    }
};

struct LayerMemory {
    StripMemory strips;
    float* limit;  // [packet][lane], as below
    int* passed;

    static inline LayerMemory carve(Arena& arena, const LayerWork& work, int movables, int levels) {
        LayerMemory memory;
        memory.strips = StripMemory::carve(arena, work.job, movables, levels);
        const long long cells = (long long)memory.strips.image.tiles() * TILE_BLOCKS;
        const long long lanes = Sparse::max_lanes(work.points, cells);
        memory.limit = arena.floats(lanes);
        memory.passed = arena.ints(lanes);
        return memory;
    }
};

struct LayerStrips {
    typedef LayerWork Work;
    typedef LayerMemory Memory;

    static inline int count(const Work& work) { return Strips::count(work.job); }

    static inline void unit(const Scene& scene, const Work& work, const Images& out, const Memory& memory, int unit,
                            Mode) {
        const Job& job = work.job;
        const int index = unit / job.strips;
        const long long first = (long long)index * job.points;
        Image image = memory.strips.strip(job, unit % job.strips);
        image.limit = memory.limit, image.passed = memory.passed;
        Sparse::place(image, job.pixels + 2 * first, job.points, job.center);
        const View view = View::of<PIXEL_RAYS>(scene, job, scene.movables.of_view(index), job.pose_of(index));
        limit(work, image, view.pose, first);
        if (view.world.exists) Packets<PIXEL_RAYS>::render(view, image, memory.strips.traversal, MODE_TRIANGLES);
        const Lookup lookup =
            Lookup::of(scene, memory.strips.traversal.frames, view.pose.position, scene.movables.count > 0);
        Writer writer = {lookup, view.camera, Rays::of(view.camera), image, job, out, index, MODE_TRIANGLES};
        const int lanes = image.first_packet[image.tiles() * TILE_BLOCKS] * LANES;
        for (int i = 0; i < lanes; ++i)
            if (image.point_index[i] >= 0) write(work, writer, i, first + image.point_index[i]);
        // Points that are finished are not in the image, and in no strip.
        for (int i = 0; i < job.points && image.first_row == 0; ++i) {
            const float* pixel = job.pixels + 2 * (first + i);
            if (pixel[0] == pixel[0]) continue;
            out.segmentation[first + i] = -2;
            work.is_left[first + i] = 0;
        }
    }

    // Set the limits of all lanes.
    static inline void limit(const Work& work, const Image& image, const Pose& pose, long long first) {
        const int lanes = image.first_packet[image.tiles() * TILE_BLOCKS] * LANES;
        for (int i = 0; i < lanes; ++i) {
            image.passed[i] = 0;
            image.limit[i] = 0.0f;
            if (image.point_index[i] < 0) continue;
            const float* point = work.places + 3 * (first + image.point_index[i]);
            const double place[3] = {point[0], point[1], point[2]};
            double local[3];
            pose.transform_into(place, local);
            const double depth = local[2];
            image.limit[i] = 1.0f / (float)(depth + work.gap * (depth > 1.0 ? depth : 1.0));
        }
    }

    // Write the surface that a lane shows. A ray is left if it shows the same triangle or solid again, or may show the
    // inside of a solid.
    static inline void write(const Work& work, Writer& writer, int lane, long long place) {
        const Image& image = writer.image;
        const int id = image.id[lane];
        Sparse::write_point(writer, place,
                            Sparse::Ray{image.inv_z[lane], id, image.point_u[lane], image.point_v[lane]});
        const int object = writer.out.segmentation[place];
        const bool is_same = object == work.segmentation[place] && writer.out.faces[place] == work.faces[place];
        const bool is_left = (object >= 0 && is_same) || (image.passed[lane] && writer.job.shows_back_faces);
        work.is_back[place] = object >= 0 && writer.job.shows_back_faces && writer.lookup.is_back(id);
        work.is_left[place] = is_left;
        if (is_left) __atomic_store_n(work.left, 1, __ATOMIC_RELAXED);
    }
};
