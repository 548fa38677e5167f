// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Views and strips of views: what a thread takes from the work.

struct Scratch {
    // The image of one thread in a piece of memory, given in units of four bytes, and the rest of it. Everything has its
    // place there whatever the height of a strip, so that what one leaves empty is empty for the next.
    static inline Image carve(float* memory, const Job& job, int strip, bool with_id, float** rest) {
        Image image;
        image.width = job.width;
        image.first_row = job.strip_rows[strip];
        image.height = job.strip_rows[strip + 1] - image.first_row;
        image.view_height = job.height;
        image.tiles_x = (image.width + 15) >> 4;
        image.tiles_y = (image.height + 15) >> 4;
        const int points = job.points;
        const long long tiles = (long long)image.tiles_x * ((job.most_rows + 15) >> 4);
        memory += (-(unsigned long long)memory & 63) / 4;  // a register's worth must not straddle two cache lines
        image.empty = (int*)memory;
        memory += 16;
        image.rows = memory;
        image.id_rows = (int*)(memory + image.tiles_x * 64);
        memory += image.tiles_x * 128;
        image.first_packet = nullptr;
        image.judge = nullptr;
        if (points > 0) {
            const long long cells = tiles * 16, spare = cells < points ? cells : points;
            const long long lanes = (points + 15 * spare + 15) / 16 * 16;
            image.first_packet = (int*)memory;
            memory += (cells + 16) / 16 * 16;
            image.point_index = (int*)memory;
            image.point_u = memory + lanes;
            image.point_v = memory + 2 * lanes;
            memory += 3 * lanes;
            image.w = memory;
            image.id = (int*)(memory + lanes);
            memory += 2 * lanes;
            return carve_blocks(image, memory, tiles, rest);
        }
        image.w = memory;
        memory += tiles * 256;
        image.id = with_id ? (int*)memory : nullptr;
        if (with_id) memory += tiles * 256;
        return carve_blocks(image, memory, tiles, rest);
    }

    static inline Image carve_blocks(Image image, float* memory, long long tiles, float** rest) {
        image.block_least = memory;
        memory += tiles * 16;
        image.tile_least = memory;
        memory += tiles;
        image.block_stale = (unsigned char*)memory;
        memory += tiles * 4;
        image.tile_stale = (unsigned char*)memory;
        memory += (tiles + 3) / 4;
        *rest = memory;
        return image;
    }
};

// What a thread notes of movable objects, and the stack of its walks.
struct Notes {
    Frame* frames;  // [movable], of those that are drawn
    Visit* visits;  // [movable]
    int* order;  // [movable]
    Visit* stack;

    static inline Notes carve(float* memory, int movables) {
        Notes notes;
        memory += (-(unsigned long long)memory & 7) / 4;
        notes.frames = (Frame*)memory;
        notes.visits = (Visit*)(notes.frames + movables);
        notes.order = (int*)(notes.visits + movables);
        notes.stack = (Visit*)(notes.order + movables);
        return notes;
    }
};

struct Packets {
    static inline void unit(const Tree& tree, const Movables& movables, const Job& job, const Images& out,
                            float* scratch, int unit, bool with_id, bool owner_id) {
        const int view = unit / job.strips;
        float* rest;
        const Image image = Scratch::carve(scratch, job, unit % job.strips, with_id, &rest);
        if (job.points)
            Sparse::place(image, job.at + (long long)view * job.points * 2, job.points, job.center[0], job.center[1]);
        else
            image.begin();
        const Notes notes = Notes::carve(rest, movables.count);
        const World world = movables.of_view(view);
        const Pose pose = Pose::from(job.poses + (long long)view * 7);
        const Eye eye = View::eye(pose, job);
        if (world.known) draw(tree, movables, world, job, pose, eye, image, notes, with_id, owner_id);
        // Two copies of the code again: one that knows that no triangle belongs to a movable object, and is faster.
        const double* camera = eye.exact_origin;
        if (movables.count > 0 && !owner_id)
            write(Lookup::of(tree, movables, notes.frames, camera, true), eye, image, job, out, view, true, false);
        else
            write(Lookup::of(tree, movables, notes.frames, camera, false), eye, image, job, out, view, with_id,
                  owner_id);
    }

    static inline void write(Lookup lookup, const Eye& eye, const Image& image, const Job& job, const Images& out,
                             int view, bool with_id, bool owner_id) {
        if (job.points)
            Sparse::write(lookup, eye, View::rays(eye), image, job, out, view, owner_id);
        else
            Strip::write(lookup, eye, View::rays(eye), image, job, out, view, with_id, owner_id);
    }

    // What stays where it is, then what moves: where much is hidden, that is much faster than the other way round, and
    // elsewhere as fast.
    static inline void draw(const Tree& tree, const Movables& movables, const World& world, const Job& job,
                            const Pose& pose, const Eye& in_world, const Image& image, const Notes& notes, bool with_id,
                            bool owner_id) {
        const float center_x = (float)job.center[0], center_y = (float)(job.center[1] - image.first_row);
        if (tree.root >= 0) {
            Eye eye = in_world;
            look_at_static(eye, tree, movables, world, job, pose);
            const Piece piece = {tree.root, 0, tree.owners, 16};
            const Pyramid pyramid = View::pyramid(eye, image, center_x, center_y);
            Walk::draw(tree, piece, eye, pyramid, image, center_x, center_y, notes.stack, with_id, owner_id);
        }
        if (movables.count == 0) return;
        Queue queue = {notes.visits, notes.order, 0};
        queue.fill(movables, world, pose, in_world, image, job.focal, center_x, center_y);
        for (int i = 0; i < queue.count; ++i) {
            const Visit& visit = queue.visits[queue.order[i]];
            if (image.hides(visit.x0, visit.y0, visit.x1, visit.y1, visit.nearest_w)) continue;
            const Eye eye = look_at_movable(movables, world, visit.child, job, pose, notes.frames);
            const Solid& solid = notes.frames[visit.child].solid;
            if (solid.kind != Solid::none) {
                const int id = owner_id ? movables.object[visit.child] : movables.first_id[visit.child];
                const Solids::Place place = {visit.x0, visit.y0, visit.x1, visit.y1, visit.nearest_w};
                Solids::draw(solid, eye, image, job.center, place, id, with_id, !owner_id);
                continue;
            }
            const Ints owner = Lanes::all_ints(movables.object[visit.child]);
            const Piece piece = movables.piece(tree, visit.child, (const int*)&owner);
            const Pyramid pyramid = View::pyramid(eye, image, center_x, center_y);
            Walk::draw(tree, piece, eye, pyramid, image, center_x, center_y, notes.stack, with_id, owner_id);
        }
    }

    static inline void look_at_static(Eye& eye, const Tree& tree, const Movables& movables, const World& world,
                                      const Job& job, const Pose& pose) {
        eye.skip_back_faces = View::outside_all(job, world, pose);
        // Where that means all back faces, it need not be looked up whose they are.
        eye.cull_back_faces = job.cull_back_faces || (eye.skip_back_faces && tree.all_closed);
        eye.excluded = movables.excludes_static(world) ? world.excluded : nullptr;
    }

    // The camera in the frame of an object, which is noted.
    static inline Eye look_at_movable(const Movables& movables, const World& world, int movable, const Job& job,
                                      const Pose& pose, Frame* frames) {
        const Pose place = Pose::from(world.poses + (long long)movable * 7), there = pose.seen_from(place);
        __builtin_memcpy(frames[movable].axis, place.axis, sizeof place.axis);
        __builtin_memcpy(frames[movable].camera, there.position, sizeof there.position);
        Eye eye = View::eye(there, job);
        note_solid(frames[movable].solid, movables, movable, eye);
        eye.skip_back_faces = movables.closed[movable] && !there.inside(movables.boxes + (long long)movable * 6);
        eye.cull_back_faces = job.cull_back_faces || eye.skip_back_faces;
        if (movables.object[movable] < 0) eye.excluded = world.excluded;
        return eye;
    }

    // From inside, an object's triangles are seen whatever it is.
    static inline void note_solid(Solid& noted, const Movables& movables, int movable, const Eye& eye) {
        noted.kind = Solid::none;
        if (movables.solid[movable] == Solid::none) return;
        noted = Solid::of(movables.solid[movable], movables.size + (long long)movable * 4, eye);
        if (!noted.outside()) noted.kind = Solid::none;
    }

    // Counters that the workers of a job share.
    enum { next_unit, entered, finished };

    // Wait for the other workers that have begun, but not for long: one may have lost its core. Whoever launched them
    // sees by `finished` whether all are done.
    static inline void await_others(int* counter) {
        __atomic_thread_fence(__ATOMIC_SEQ_CST);  // what was written past the caches has to be there
        __atomic_fetch_add(counter + finished, 1, __ATOMIC_SEQ_CST);
        for (int spin = 0; spin < 100000; ++spin)
            if (__atomic_load_n(counter + finished, __ATOMIC_ACQUIRE) >=
                __atomic_load_n(counter + entered, __ATOMIC_ACQUIRE))
                return;
    }

    // Take units of work, strips of views, until none are left; other threads take from the same counter.
    static inline void run(const Tree& tree, const Movables& movables, const Job& job, const Images& out,
                           float* scratch, int* counter) {
        const int units = job.views * job.strips;
        const bool owner_id = !out.normals;
        const bool with_id = out.normals || out.segmentation || out.labels || job.points;
        for (;;) {
            const int next = __atomic_fetch_add(counter + next_unit, 1, __ATOMIC_RELAXED);
            if (next >= units) break;
            // Two copies of the code: one that knows that nobody asks for objects, and is faster.
            if (with_id)
                unit(tree, movables, job, out, scratch, next, true, owner_id);
            else
                unit(tree, movables, job, out, scratch, next, false, true);
        }
        await_others(counter);
    }
};
