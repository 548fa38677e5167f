// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rendering of views and strips of views, the units of work.

#pragma once

#include "cpu/objects.h"
#include "cpu/workers.h"

// Memory of a traversal: the movable objects as the view sees them, and the stack of nodes.
struct Traversal {
    Frame* frames;  // [movable], of those that are rendered
    Visit* visits;  // [movable]
    int* order;  // [movable]
    Visit* stack;  // pending visits: at most all children of a node on every level

    static inline Traversal carve(Arena& arena, int movables, int levels) {
        Traversal traversal;
        traversal.frames = (Frame*)arena.take(movables * (long long)sizeof(Frame));
        traversal.visits = (Visit*)arena.take(movables * (long long)sizeof(Visit));
        traversal.order = arena.ints(movables);
        traversal.stack = (Visit*)arena.take((levels + 1LL) * LANES * (long long)sizeof(Visit));
        return traversal;
    }
};
static_assert(alignof(Frame) <= Arena::ALIGNMENT, "pieces of an arena are aligned to ALIGNMENT only");

// A worker's memory for strips of a job. The layout does not depend on the height of a strip, so that a z-buffer that
// one strip leaves cleared is clear for the next.
struct StripMemory {
    Image image;
    Traversal traversal;

    static inline StripMemory carve(Arena& arena, const Job& job, int movables, int levels) {
        StripMemory memory;
        Image& image = memory.image;
        image.set_size(job.width, job.max_rows, 0, job.height);
        const long long tiles = image.tiles(), cells = tiles * TILE_BLOCKS;
        image.empty = arena.ints(1);
        image.rows = arena.floats((long long)image.tiles_x * TILE_SIDE * BLOCK_SIDE);
        image.id_rows = arena.ints((long long)image.tiles_x * TILE_SIDE * BLOCK_SIDE);
        image.clip_inv_z = job.clip_inv_z;
        const long long lanes = job.points > 0 ? Sparse::max_lanes(job.points, cells) : tiles * TILE_PIXELS;
        image.inv_z = arena.floats(lanes);
        image.id = arena.ints(lanes);
        if (job.points > 0) {
            image.first_packet = arena.ints(cells + 1);
            image.point_index = arena.ints(lanes);
            image.point_u = arena.floats(lanes);
            image.point_v = arena.floats(lanes);
        }
        image.take_blocks(arena, tiles);
        memory.traversal = Traversal::carve(arena, movables, levels);
        return memory;
    }

    // The image of one strip.
    inline Image strip(const Job& job, int strip) const {
        Image part = image;
        part.set_size(job.width, job.strip_rows[strip + 1] - job.strip_rows[strip], job.strip_rows[strip], job.height);
        part.set_center(job.center);
        return part;
    }
};

template <RayKind KIND>
struct Packets {
    // Rasterize static geometry, then movable objects: much faster than the reverse order if much is occluded, and
    // otherwise as fast.
    static inline void render(const View& view, const Image& image, const Traversal& traversal, Mode mode) {
        const Bvh& bvh = view.scene.bvh;
        const Movables& movables = view.scene.movables;
        if (bvh.root >= 0) {
            const Instance instance = {bvh.root, 0, bvh.owners, LANES};
            Walk<KIND>::traverse(bvh, instance, static_camera(view), image, traversal.stack, mode);
        }
        if (movables.count == 0) return;
        Queue<KIND> queue = {traversal.visits, traversal.order, 0};
        queue.fill(view, image);
        for (int i = 0; i < queue.count; ++i) {
            const Visit& visit = queue.visits[queue.order[i]];
            if (!is_hidden<KIND>(image, visit)) render_movable(view, image, traversal, visit, mode);
        }
    }

    static inline void render_movable(const View& view, const Image& image, const Traversal& traversal,
                                      const Visit& visit, Mode mode) {
        const Movables& movables = view.scene.movables;
        const int movable = visit.child;
        // After rasterization, only normals need the frames; otherwise all objects share one entry.
        Frame& frame = traversal.frames[mode == MODE_TRIANGLES ? movable : 0];
        const Camera camera = movable_camera(view, movable, frame);
        const Solid& solid = frame.solid;
        if (solid.kind != SOLID_NONE) {
            const int id = mode == MODE_TRIANGLES ? movables.first_id[movable] : movables.object[movable];
            if constexpr (KIND == TABLE_RAYS)
                RayRaster<KIND>::render_solid(solid, view, camera, image, visit, id, mode);
            else if constexpr (KIND == PIXEL_RAYS)
                Solids::render(solid, camera, image, view.job.center, visit, id, mode);
            return;  // scenes with solids do not use rays with distinct origins
        }
        const Ints owner = Lanes::all_ints(movables.object[movable]);
        const Instance instance = movables.instance(view.scene.bvh, movable, (const int*)&owner);
        Walk<KIND>::traverse(view.scene.bvh, instance, camera, image, traversal.stack, mode);
    }

    static inline Camera static_camera(const View& view) {
        Camera camera = view.camera;
        camera.skip_back_faces =
            !view.job.shows_back_faces && view.scene.outside_all(view.world, view.pose, view.job.clip_reach);
        // If all static objects are closed, this covers all back faces, without a lookup of their owners.
        camera.cull_back_faces |= camera.skip_back_faces && view.scene.bvh.all_closed;
        if (view.scene.movables.excludes_static(view.world)) camera.excluded = view.world.excluded;
        return camera;
    }

    // The camera in the frame of an object, divided by its stretch factors if its triangles are rasterized; `frame`
    // receives the object's frame.
    static inline Camera movable_camera(const View& view, int movable, Frame& frame) {
        const Movables& movables = view.scene.movables;
        const Pose object = Pose::from(movables.poses_from(movable, view.world));
        const Pose local = view.pose.seen_from(object);
        const Stretch stretch = movables.stretch_of(movable, view.world);
        __builtin_memcpy(frame.axis, object.axis, sizeof object.axis);
        __builtin_memcpy(frame.viewpoint, local.position, sizeof local.position);
        frame.shrink[0] = frame.shrink[1] = frame.shrink[2] = 1.0;
        Camera camera = Camera::of<KIND>(local, view.job);
        const float* box = movables.boxes + (long long)movable * BOX_WORDS;
        const bool in_box = local.inside(box, stretch, view.job.clip_reach);
        const bool clipped = view.job.clip_reach > 0.0f && in_box;
        frame.solid = clipped ? Solid::none() : movables.solid_of(movable, view.world, camera);
        if (view.world.sizes && frame.solid.kind == SOLID_NONE) {
            camera = Camera::of<KIND>(local, stretch, view.job);
            __builtin_memcpy(frame.viewpoint, camera.exact_origin, sizeof camera.exact_origin);
            for (int k = 0; k < 3; ++k) frame.shrink[k] = 1.0 / stretch.factor[k];
        }
        camera.skip_back_faces = movables.closed[movable] && !in_box && !view.job.shows_back_faces;
        camera.cull_back_faces |= camera.skip_back_faces;
        if (movables.object[movable] < 0) camera.excluded = view.world.excluded;
        return camera;
    }
};

// Strips of the images of pinhole cameras, as units of work.
struct Strips {
    typedef Job Work;
    typedef StripMemory Memory;

    static inline int count(const Job& job) { return job.views * job.strips; }

    static inline void unit(const Scene& scene, const Job& job, const Images& out, const StripMemory& memory, int unit,
                            Mode mode) {
        const int index = unit / job.strips;
        const Image image = memory.strip(job, unit % job.strips);
        if (job.points)
            Sparse::place(image, job.pixels + (long long)index * job.points * 2, job.points, job.center);
        else
            image.begin();
        const View view = View::of<PIXEL_RAYS>(scene, job, scene.movables.of_view(index), job.pose_of(index));
        if (view.world.exists) Packets<PIXEL_RAYS>::render(view, image, memory.traversal, mode);
        // Two instantiations again: the one without movable objects, where `moving` is a constant, is faster.
        const bool moving = scene.movables.count > 0 && mode == MODE_TRIANGLES;
        if (moving)
            write(view, image, out, index, Lookup::of(scene, memory.traversal.frames, view.pose.position, true),
                  MODE_TRIANGLES);
        else
            write(view, image, out, index, Lookup::of(scene, memory.traversal.frames, view.pose.position, false), mode);
    }

    static inline void write(const View& view, const Image& image, const Images& out, int index, Lookup lookup,
                             Mode mode) {
        Writer writer = {lookup, view.camera, Rays::of(view.camera), image, view.job, out, index, mode};
        if (view.job.points) return Sparse::write(writer);
        NormalCache normal_cache;
        writer.cache_normals(normal_cache);
        writer.strip();
    }
};

// The work of one thread of a launch.
struct Launch {
    // Run a worker of a launch with a `WorkerMemory` of kernels/casting/packets.py: `carve` takes its memory from an
    // arena, and `run` uses it. Without memory, measure how many bytes a worker needs.
    template <class WorkerMemory, class Carve, class Run>
    static inline void worker(const WorkerMemory& workers, Carve carve, Run run) {
        if (!workers.scratch.data) {
            Arena measured = Arena::at(nullptr);
            carve(measured);
            workers.scratch_bytes.data[0] = measured.used;
            return;
        }
        const int worker = Workers::enter(workers.counter.data);
        Arena arena = Arena::at((char*)workers.scratch.data + (long long)worker * workers.scratch.strides[0]);
        run(carve(arena));
    }

    // Do the units of work of a job: `Strips`, `Bundles` or `Maps`. Each mode has its own instantiation: those without
    // triangles, or without objects, are faster.
    template <class Units>
    static inline void run(const Scene& scene, const typename Units::Work& job, const Images& out,
                           const typename Units::Memory& memory, int* counter) {
        if (out.of_triangles())
            work<Units>(scene, job, out, memory, counter, MODE_TRIANGLES);
        else if (out.segmentation || out.labels || job.points > 0)
            work<Units>(scene, job, out, memory, counter, MODE_OBJECTS);
        else
            work<Units>(scene, job, out, memory, counter, MODE_DEPTH);
        Workers::finish(counter);
    }
    // Take units until none remain. With `Workers::run` and a lambda, which do the same, Clang makes code that takes up
    // to 30 % longer for the objects that a lidar sees.
    template <class Units>
    static inline void work(const Scene& scene, const typename Units::Work& job, const Images& out,
                            const typename Units::Memory& memory, int* counter, Mode mode) {
        const int units = Units::count(job);
        for (int next; (next = Workers::take(counter)) < units;) Units::unit(scene, job, out, memory, next, mode);
    }

    // Write the images of a call of kernels/casting/packets.py or ray_bundle_packets.py.
    template <class Units, class Call, class Outputs>
    static inline void cast(const Call& call, const Outputs& images) {
        const Scene scene = Scene::of(call.scene, call.worlds);
        const auto job = Units::Work::of(call);
        const Images out = Images::of(images, call.scene);
        worker(
            call.workers,
            [&](Arena& arena) { return Units::Memory::carve(arena, job, scene.movables.count, call.scene.levels); },
            [&](const typename Units::Memory& memory) {
                run<Units>(scene, job, out, memory, call.workers.counter.data);
            });
    }
};
