// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rendering with rays of a ray table, in units of bundles: each is rendered as a separate image of a pinhole camera
// that faces along one of the camera's axes, with pixels much smaller than the spacing of the rays.

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

struct TableJob {
    int views, height, width;
    int bundles;
    const Bundle* bundle;
    const float* bundle_far;  // greatest z of rays that are in range
    double focal;
    float near, far, clip_inv_z, clip_reach;
    bool cull_back_faces;
    const float* poses;  // [view]: x y z qx qy qz qw
    RayTree tree;  // of all bundles
    const int* without_ray;  // pixel indices
    int without_rays;
    int max_groups;  // of any bundle
    const double* eye;  // [bundle]: its position in the bundle's frame; null if it is the camera's
    const float* origins;  // [bundle]: max_p, max_q and reach of its `RayOrigins`

    // The bundle as a job of a pinhole camera.
    inline Job job_of(int index) const {
        const Bundle& source = bundle[index];
        Job job = Job();
        job.views = views;
        job.width = source.width;
        job.height = source.height;
        job.focal[0] = job.focal[1] = focal;
        job.center[0] = source.center[0];
        job.center[1] = source.center[1];
        job.near = near;
        job.far = bundle_far[index];
        job.clip_inv_z = clip_inv_z;
        job.clip_reach = clip_reach;
        job.cull_back_faces = cull_back_faces;
        // Rays begin up to this far from the eye: boxes within that distance may contain their origins.
        if (RAY_ORIGINS) job.clip_reach += origins[3 * index + 2];
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
        if (RAY_ORIGINS) {
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
        for (int i = 0; RAY_ORIGINS && i < 3; ++i)
            for (int k = 0; k < 3; ++k) pose.position[k] += eye[3 * index + i] * pose.axis[i][k];
        return pose;
    }
};

// A worker's memory.
struct TableMemory {
    Image image;
    Traversal traversal;

    static inline TableMemory carve(Arena& arena, const TableJob& job, int movables, int levels) {
        TableMemory memory;
        Image& image = memory.image;
        const long long packets = (long long)job.max_groups * RayTree::GROUP_PACKETS;
        image.empty = nullptr;
        image.rows = nullptr;
        image.id_rows = nullptr;
        image.occlusion = nullptr;
        image.clip_inv_z = __builtin_inff();
        image.inv_z = arena.floats(packets * LANES);
        image.id = arena.ints(packets * LANES);
        image.take_blocks(arena, (long long)job.max_groups * LANES);
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

// Writes the results of a bundle's rays to their pixels, packet by packet.
struct TableWriter {
    Writer writer;
    const TableJob& table;
    const RayTree& tree;
    long long first;  // index of the view's first pixel

    inline void tiles(int groups) {
        const bool depth_only = writer.mode == MODE_DEPTH && writer.out.depth && !writer.out.points;
        for (int group = 0; group < groups; ++group) {
            const float* bounds = tree.bounds_of_tiles(group);
            for (int tile = 0; tile < LANES; ++tile) {
                const int index = group * LANES + tile;
                if (tree.corner[index] >= 0 && depth_only)
                    depth_blocks(index);
                else if (tree.corner[index] >= 0)
                    blocks(index);
                else if (bounds[tile] <= bounds[2 * LANES + tile])
                    packets(index);
            }
        }
    }

    // Depth, and a mask of rays with a hit in range.
    struct InRange {
        Floats depth;
        Ints seen;
    };
    static inline InRange in_range(Floats inv_z, Floats depth, float near, float far) {
        const Floats infinity = Lanes::all(__builtin_inff());
        const Ints far_enough = depth >= Lanes::all(near);
        const Ints seen = far_enough & (depth <= Lanes::all(far)) & (inv_z > Lanes::all(0.0f));
        return InRange{seen ? depth : (far_enough ? infinity : -infinity), seen};
    }

    // Results of the rays of a packet.
    struct Row {
        Floats depth;
        Points point, normal;
        Ints object;
    };
    inline InRange range_of(int packet, Floats inv_z, Floats z) const {
        const Floats along = RAY_ORIGINS ? z - Lanes::load(tree.origins.begin + packet * LANES) : z;
        const Floats depth = tree.scale ? along * Lanes::load(tree.scale + packet * LANES) : along;
        return in_range(inv_z, depth, table.near, table.far);
    }
    inline void resolve(int packet, Row& row) {
        const Images& out = writer.out;
        const Floats inv_z = Lanes::load(writer.image.inv_z + packet * LANES), z = 1.0f / inv_z;
        const InRange range = range_of(packet, inv_z, z);
        const Ints seen = range.seen;
        row.depth = range.depth;
        if (out.points) row.point = points(packet, seen ? z : Lanes::all(__builtin_nanf("")));
        if (writer.mode == MODE_DEPTH) return;
        const Ints id = Lanes::load(writer.image.id + packet * LANES);
        if (writer.mode == MODE_TRIANGLES && out.normals) row.normal = normals(packet, id, seen);
        if (out.segmentation || out.labels) row.object = writer.objects(id, seen);
    }
    inline Points points(int packet, Floats reach) const {
        const Rays& rays = writer.rays;
        const float* origin = writer.camera.origin;
        const Floats u = Lanes::load(tree.u + packet * LANES), v = Lanes::load(tree.v + packet * LANES);
        Floats position[3];
        for (int k = 0; k < 3; ++k)
            position[k] = reach * (u * rays.right[k] + (v * rays.down[k] + rays.forward[k])) + origin[k];
        if (RAY_ORIGINS) {
            const Floats p = Lanes::load(tree.origins.p + packet * LANES),
                         q = Lanes::load(tree.origins.q + packet * LANES);
            for (int k = 0; k < 3; ++k) position[k] += p * rays.right[k] + q * rays.down[k];
        }
        return Points{position[0], position[1], position[2]};
    }
    inline Points normals(int packet, Ints id, Ints seen) {
        if (RAY_ORIGINS) return toward(packet, writer.triangle_normals(id, Lanes::bits(seen)));
        if (!writer.lookup.moving) return writer.triangle_normals(id, Lanes::bits(seen));
        Points round = {Lanes::all(0.0f), Lanes::all(0.0f), Lanes::all(0.0f)};
        const Ints solid = writer.lookup.solid_normals(id, seen, RayRaster::exact_u(tree, packet),
                                                       RayRaster::exact_v(tree, packet), round);
        const Points n = writer.triangle_normals(id, Lanes::bits(seen & ~solid));
        return Points{solid ? round.x : n.x, solid ? round.y : n.y, solid ? round.z : n.z};
    }

    // Flip normals toward the origins of the rays, which may see another side than the eye does.
    inline Points toward(int packet, Points n) const {
        const Rays& rays = writer.rays;
        const Floats u = Lanes::load(tree.u + packet * LANES), v = Lanes::load(tree.v + packet * LANES);
        Floats ray[3];
        for (int k = 0; k < 3; ++k) ray[k] = u * rays.right[k] + (v * rays.down[k] + rays.forward[k]);
        const Ints faces_away = Points::dot(n, Points{ray[0], ray[1], ray[2]}) > Lanes::all(0.0f);
        return Points{faces_away ? -n.x : n.x, faces_away ? -n.y : n.y, faces_away ? -n.z : n.z};
    }

    // Write a tile of the image if only depth is requested.
    inline void depth_blocks(int tile) const {
        float* target = writer.out.depth + (first + tree.corner[tile]);
        const float near = table.near, far = table.far;
        const float* source = writer.image.inv_z + tile * (LANES * LANES);
        const float* scale = tree.scale ? tree.scale + tile * (LANES * LANES) : nullptr;
        const float* begin = RAY_ORIGINS ? tree.origins.begin + tile * (LANES * LANES) : nullptr;
        const int width = table.width;
        for (int y = 0; y < BLOCKS_ACROSS; ++y) {
            Floats inv_z[BLOCK_SIDE], factor[BLOCK_SIDE], first[BLOCK_SIDE];
            Blocks::transpose(source + y * (BLOCKS_ACROSS * LANES), inv_z);
            if (scale) Blocks::transpose(scale + y * (BLOCKS_ACROSS * LANES), factor);
            if (RAY_ORIGINS) Blocks::transpose(begin + y * (BLOCKS_ACROSS * LANES), first);
            for (int r = 0; r < BLOCK_SIDE; ++r, target += width) {
                const Floats z = RAY_ORIGINS ? 1.0f / inv_z[r] - first[r] : 1.0f / inv_z[r];
                Write::stream(target, in_range(inv_z[r], scale ? z * factor[r] : z, near, far).depth);
            }
        }
    }

    // Write a tile of the image, four rows of pixels at a time, with whole cache lines that bypass the caches.
    inline void blocks(int tile) {
        const Images& out = writer.out;
        for (int y = 0; y < TILE_SIDE; y += BLOCK_SIDE) {
            Row row[BLOCKS_ACROSS];
            for (int x = 0; x < BLOCKS_ACROSS; ++x)
                resolve(tile * TILE_BLOCKS + y / BLOCK_SIDE * BLOCKS_ACROSS + x, row[x]);
            const long long offset = first + tree.corner[tile] + (long long)y * table.width;
            Floats rows[3][BLOCK_SIDE];
            if (out.depth) {
                transpose(&row[0].depth, rows[0]);
                for (int r = 0; r < BLOCK_SIDE; ++r) Write::stream(out.depth + offset + r * table.width, rows[0][r]);
            }
            if (out.points) rows_of(out.points + offset * 3, &row[0].point, rows);
            if (writer.mode == MODE_DEPTH) continue;
            if (writer.mode == MODE_TRIANGLES && out.normals) rows_of(out.normals + offset * 3, &row[0].normal, rows);
            if (!(out.segmentation || out.labels)) continue;
            transpose((const Floats*)&row[0].object, rows[0]);
            for (int r = 0; r < BLOCK_SIDE; ++r) {
                const Ints object = (Ints)rows[0][r];
                if (out.segmentation) Write::stream(out.segmentation + offset + r * table.width, object);
                if (out.labels) Writer::labels(out.labels + offset + r * table.width, out.object_label, object, LANES);
            }
        }
        if (writer.mode == MODE_TRIANGLES && out.faces) face_blocks(tile);
    }

    // Write the faces of both kinds of tiles, separately because they are rarely requested.
    inline void face_blocks(int tile) {
        int* target = writer.out.faces + (first + tree.corner[tile]);
        for (int y = 0; y < BLOCKS_ACROSS; ++y) {
            int side_by_side[BLOCKS_ACROSS * BLOCK_PIXELS];
            for (int x = 0; x < BLOCKS_ACROSS; ++x)
                Lanes::store(side_by_side + x * BLOCK_PIXELS, faces(tile * TILE_BLOCKS + y * BLOCKS_ACROSS + x));
            Ints rows[BLOCK_SIDE];
            Blocks::transpose(side_by_side, rows);
            for (int r = 0; r < BLOCK_SIDE; ++r, target += table.width) Write::stream(target, rows[r]);
        }
    }
    inline void face_packets(int tile) {
        const float* bounds = tree.bounds_of_packets(tile);
        for (int child = 0; child < LANES; ++child) {
            const int packet = tile * LANES + child;
            if (bounds[child] <= bounds[2 * LANES + child])
                Write::put((float*)writer.out.faces + first, tree.place + packet * LANES, tree.run[packet],
                           (Floats)faces(packet));
        }
    }
    inline Ints faces(int packet) {
        const Floats inv_z = Lanes::load(writer.image.inv_z + packet * LANES);
        const Ints seen = range_of(packet, inv_z, 1.0f / inv_z).seen;
        return writer.faces(Lanes::load(writer.image.id + packet * LANES), seen);
    }

    // Convert the blocks of adjacent `Row`s to rows of pixels.
    static inline void transpose(const Floats* block, Floats* rows) {
        float side_by_side[BLOCKS_ACROSS * BLOCK_PIXELS];
        for (int x = 0; x < BLOCKS_ACROSS; ++x) {
            Lanes::store(side_by_side + x * BLOCK_PIXELS, *block);
            block = (const Floats*)((const char*)block + sizeof(Row));
        }
        Blocks::transpose(side_by_side, rows);
    }
    inline void rows_of(float* to, const Points* block, Floats (*rows)[BLOCK_SIDE]) const {
        transpose(&block->x, rows[0]);
        transpose(&block->y, rows[1]);
        transpose(&block->z, rows[2]);
        for (int r = 0; r < BLOCK_SIDE; ++r)
            Write::row(to + 3LL * r * table.width, Points{rows[0][r], rows[1][r], rows[2][r]}, LANES);
    }

    // Write a tile whose packets are not blocks of the image, packet by packet.
    inline void packets(int tile) {
        const Images& out = writer.out;
        const float* bounds = tree.bounds_of_packets(tile);
        for (int child = 0; child < LANES; ++child) {
            if (bounds[child] > bounds[2 * LANES + child]) continue;
            const int packet = tile * LANES + child, run = tree.run[packet];
            const int* place = tree.place + packet * LANES;
            Row row;
            resolve(packet, row);
            if (out.depth) Write::put(out.depth + first, place, run, row.depth);
            if (out.points) Write::put(out.points + first * 3, place, row.point);
            if (writer.mode == MODE_DEPTH) continue;
            if (writer.mode == MODE_TRIANGLES && out.normals) Write::put(out.normals + first * 3, place, row.normal);
            if (out.segmentation) Write::put((float*)out.segmentation + first, place, run, (Floats)row.object);
            if (!out.labels) continue;
            unsigned char label[LANES];
            Writer::labels(label, out.object_label, row.object, LANES);
            for (int lane = 0; lane < LANES; ++lane)
                if (place[lane] >= 0) out.labels[first + place[lane]] = label[lane];
        }
        if (writer.mode == MODE_TRIANGLES && out.faces) face_packets(tile);
    }

    // Write pixels without a ray as empty.
    static inline void empty(const TableJob& table, const Images& out, long long first) {
        const float nothing = __builtin_nanf("");
        for (int i = 0; i < table.without_rays; ++i) {
            const long long offset = first + table.without_ray[i];
            if (out.depth) out.depth[offset] = __builtin_inff();
            for (int k = 0; k < 3; ++k) {
                if (out.points) out.points[offset * 3 + k] = nothing;
                if (out.normals) out.normals[offset * 3 + k] = nothing;
            }
            if (out.segmentation) out.segmentation[offset] = -1;
            if (out.faces) out.faces[offset] = -1;
            if (out.labels) out.labels[offset] = LABEL_EMPTY;
        }
    }
};

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
        const View view = View::of(scene, job, scene.movables.of_view(index), table.face_of(bundle, pose));
        if (view.world.exists) Packets::render(view, image, memory.traversal, mode);
        const double* viewpoint = view.pose.position;
        const Frame* frames = memory.traversal.frames;
        const long long first = (long long)index * table.height * table.width;
        // Two instantiations, as for pixels: one for scenes without movable objects.
        const Rays rays = Rays::of(view.camera);
        if (scene.movables.count > 0 && mode == MODE_TRIANGLES)
            TableWriter{{Lookup::of(scene, frames, viewpoint, true), view.camera, rays, image, job, out, index, mode},
                        table,
                        tree,
                        first}
                .tiles(groups);
        else
            TableWriter{{Lookup::of(scene, frames, viewpoint, false), view.camera, rays, image, job, out, index, mode},
                        table,
                        tree,
                        first}
                .tiles(groups);
        if (bundle == 0) TableWriter::empty(table, out, first);
    }

    static inline void work(const Scene& scene, const TableJob& table, const Images& out, const TableMemory& memory,
                            int* counter, Mode mode) {
        const int units = table.views * table.bundles;
        for (int next; (next = Workers::take(counter)) < units;) unit(scene, table, out, memory, next, mode);
    }

    // Take units of work, bundles of views, until none remain, as `Packets::run` does.
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
