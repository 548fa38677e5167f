// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Views and strips of views: what a thread takes from the work.

struct Pose {
    double position[3];
    double axis[3][3];  // right, down, forward in the world

    // From x y z qx qy qz qw.
    static inline Pose from(const float* row) {
        Pose pose;
        double q[4];
        double length = 0;
        for (int k = 0; k < 4; ++k) length += (double)row[3 + k] * row[3 + k];
        length = 1.0 / __builtin_sqrt(length);
        for (int k = 0; k < 4; ++k) q[k] = row[3 + k] * length;
        for (int k = 0; k < 3; ++k) pose.position[k] = row[k];
        const double x = q[0], y = q[1], z = q[2], w = q[3];
        const double axis[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)},
                                   {2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)},
                                   {2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)}};
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k) pose.axis[i][k] = axis[i][k];
        return pose;
    }
};

struct View {
    static inline Eye eye(const Pose& pose, const Job& job) {
        Eye eye;
        for (int k = 0; k < 3; ++k) {
            eye.exact_origin[k] = pose.position[k];
            eye.origin[k] = (float)pose.position[k];
            for (int i = 0; i < 3; ++i) {
                const double f = i < 2 ? job.focal[i] : 1.0;
                eye.to_camera[i][k] = (float)(pose.axis[i][k] * f);
                eye.exact_to_camera[i][k] = pose.axis[i][k] / f;
            }
        }
        eye.first_u = (float)(0.5 - job.center[0]);
        eye.first_v = (float)(0.5 - job.center[1]);
        eye.far = job.far * 1.00001f;
        return eye;
    }

    static inline Pyramid pyramid(const Eye& eye, const Image& image, float center_x, float center_y) {
        Pyramid pyramid;
        const Row* m = eye.to_camera;
        for (int k = 0; k < 3; ++k) {
            pyramid.plane[0][k] = m[2][k];
            pyramid.plane[1][k] = m[0][k] + center_x * m[2][k];
            pyramid.plane[2][k] = (image.width - center_x) * m[2][k] - m[0][k];
            pyramid.plane[3][k] = m[1][k] + center_y * m[2][k];
            pyramid.plane[4][k] = (image.height - center_y) * m[2][k] - m[1][k];
        }
        return pyramid;
    }

    static inline Rays rays(const Eye& eye) {
        Rays rays;
        for (int k = 0; k < 3; ++k) {
            rays.right[k] = (float)eye.exact_to_camera[0][k];
            rays.down[k] = (float)eye.exact_to_camera[1][k];
            rays.forward[k] = (float)eye.exact_to_camera[2][k];
        }
        return rays;
    }

    // Whether the camera is outside the boxes of all closed objects, so that their back faces are hidden behind their
    // front faces.
    static inline bool outside_all(const float* boxes, int count, const Pose& pose) {
        for (int i = 0; i < count; ++i) {
            bool inside = true;
            for (int k = 0; k < 3; ++k)
                inside &= pose.position[k] >= boxes[i * 6 + k] && pose.position[k] <= boxes[i * 6 + 3 + k];
            if (inside) return false;
        }
        return true;
    }
};

struct Scratch {
    // The image and the stack of one thread in one piece of memory, given in units of four bytes. Everything has its
    // place there whatever the height of a strip, so that what one leaves empty is empty for the next.
    static inline Image carve(float* memory, const Job& job, int strip, bool with_id, Visit** stack) {
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
            return carve_blocks(image, memory, tiles, stack);
        }
        image.w = memory;
        memory += tiles * 256;
        image.id = with_id ? (int*)memory : nullptr;
        if (with_id) memory += tiles * 256;
        return carve_blocks(image, memory, tiles, stack);
    }

    static inline Image carve_blocks(Image image, float* memory, long long tiles, Visit** stack) {
        image.block_least = memory;
        memory += tiles * 16;
        image.tile_least = memory;
        memory += tiles;
        image.block_stale = (unsigned char*)memory;
        memory += tiles * 4;
        image.tile_stale = (unsigned char*)memory;
        memory += (tiles + 3) / 4;
        *stack = (Visit*)memory;
        return image;
    }
};

struct Packets {
    static inline void unit(const Tree& tree, const Job& job, const Outputs& out, float* scratch, int unit, bool with_id,
                            bool owner_id) {
        const int view = unit / job.strips;
        Visit* stack;
        const Image image = Scratch::carve(scratch, job, unit % job.strips, with_id, &stack);
        if (job.points)
            Sparse::place(image, job.at + (long long)view * job.points * 2, job.points, job.center[0], job.center[1]);
        else
            image.begin();
        const Pose pose = Pose::from(job.poses + (long long)view * 7);
        Eye eye = View::eye(pose, job);
        eye.skip_back_faces = View::outside_all(job.closed_boxes, job.closed_count, pose);
        // Where that means all back faces, it need not be looked up whose they are.
        eye.cull_back_faces = job.cull_back_faces || (eye.skip_back_faces && tree.all_closed);
        const float center_x = (float)job.center[0], center_y = (float)(job.center[1] - image.first_row);
        const Pyramid pyramid = View::pyramid(eye, image, center_x, center_y);
        Walk::draw(tree, eye, pyramid, image, center_x, center_y, stack, with_id, owner_id);
        if (job.points)
            Sparse::write(tree, eye, View::rays(eye), image, job, out, view, owner_id);
        else
            Strip::write(tree, eye, View::rays(eye), image, job, out, view, with_id, owner_id);
    }

    // Counters that the workers of a job share.
    enum { next_unit, entered, finished };

    // Wait for the other workers that have begun, but not for long: one may have lost its core. Whoever launched them
    // sees by `finished` whether all are done.
    static inline void await_others(int* counter) {
        __atomic_thread_fence(__ATOMIC_SEQ_CST);  // what was written past the caches has to be there
        __atomic_fetch_add(counter + finished, 1, __ATOMIC_SEQ_CST);
        for (int spin = 0; spin < 100000; ++spin)
            if (__atomic_load_n(counter + finished, __ATOMIC_ACQUIRE) >= __atomic_load_n(counter + entered, __ATOMIC_ACQUIRE))
                return;
    }

    // Take units of work, strips of views, until none are left; other threads take from the same counter.
    static inline void run(const Tree& tree, const Job& job, const Outputs& out, float* scratch, int* counter) {
        const int units = job.views * job.strips;
        const bool owner_id = !out.normals;
        const bool with_id = out.normals || out.objects || out.labels || job.points;
        for (;;) {
            const int next = __atomic_fetch_add(counter + next_unit, 1, __ATOMIC_RELAXED);
            if (next >= units) break;
            // Two copies of the code: one that knows that nobody asks for objects, and is faster.
            if (with_id)
                unit(tree, job, out, scratch, next, true, owner_id);
            else
                unit(tree, job, out, scratch, next, false, true);
        }
        await_others(counter);
    }
};
