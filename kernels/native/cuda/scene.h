// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The geometry of a scene: static triangles and movable objects.

#pragma once

#include "cuda/bvh.h"

// Closed static objects.
struct ClosedObjects {
    const float* boxes;  // [closed object][BOX_WORDS] in the world
    const int* object;  // object index of each
    int count;
};

// Objects with separate frames: the movable objects of one view's world, followed by static instances.
struct Movables {
    int count;
    int moving;  // number of movable objects
    const int* object;  // object index; -1 if several objects move together, whose owners are stored per triangle
    const int* root;  // root node of its BVH
    const int* leaf;  // first leaf of its BVH
    const int* first_id;  // number of its first triangle, ascending
    const int* closed;
    const float* boxes;  // [movable][BOX_WORDS] in the object's frame
    const int* solid;  // SolidKind
    const float* size;  // [movable][SOLID_WORDS]
    const float* instance_poses;  // [instance][POSE_WORDS], object to world
    // [movable][POSE_WORDS], object to world; null if the view's world does not exist, unless there are no movable
    // objects
    const float* poses;
    const float* sizes;  // [movable][SOLID_WORDS] in that world; only in kernels that are RESIZED
    const unsigned char* excluded;  // [object]; null if none is excluded

    // The objects of a view's world, but for those that it excludes.
    template <class BvhScene, class Worlds>
    static inline Movables of(const BvhScene& scene, const Worlds& worlds, int view) {
        Movables all;
        all.count = MOVABLE ? scene.drawn_count : 0;
        all.moving = scene.movable_count;
        all.object = scene.movable_object.data;
        all.root = scene.movable_root.data;
        all.leaf = scene.movable_leaf.data;
        all.first_id = scene.movable_first_id.data;
        all.closed = scene.movable_closed.data;
        all.boxes = scene.movable_boxes.data;
        all.solid = scene.movable_solid.data;
        all.size = (const float*)scene.movable_size.data;
        all.instance_poses = (const float*)scene.instance_pose.data;
        all.poses = all.sizes = nullptr;
        const int world_count = worlds.object_poses.shape[0];
        const int world = worlds.world.data ? worlds.world.data[view] : world_count == 1 ? 0 : view;
        if (world >= 0 && world < world_count) {
            const long long first = (long long)world * scene.movable_count;
            all.poses = (const float*)worlds.object_poses.data + first * POSE_WORDS;
            if (RESIZED) all.sizes = (const float*)worlds.object_sizes.data + first * SOLID_WORDS;
        }
        // Without movable objects there is one world.
        if (scene.movable_count == 0) all.poses = all.instance_poses;
        return all;
    }

    // Number of a triangle minus its slot in the leaves.
    inline int id_offset(int m) const { return __ldg(first_id + m) - __ldg(leaf + m) * LANES; }
    inline const float* box(int m) const { return boxes + BOX_WORDS * (long long)m; }
    inline bool is_resized(int m) const { return RESIZED && m < moving; }
    inline const float* solid_size(int m) const { return (is_resized(m) ? sizes : size) + SOLID_WORDS * (long long)m; }
    // Stretch of an object's triangles.
    inline Stretch stretch(int m) const {
        const long long row = SOLID_WORDS * (long long)m;
        return is_resized(m) ? Stretch::of(__ldg(solid + m), size + row, sizes + row) : Stretch::none();
    }
    inline Vec3 factors(int m) const {
        const Stretch all = stretch(m);
        return Vec3{(float)all.factor[0], (float)all.factor[1], (float)all.factor[2]};
    }
    inline bool excludes(int m) const {
        const int index = __ldg(object + m);
        return excluded && index >= 0 && excluded[index];
    }
    inline const float* pose(int m) const {
        return m < moving ? poses + POSE_WORDS * (long long)m : instance_poses + POSE_WORDS * (long long)(m - moving);
    }

    // The object that owns a triangle; -1 for static triangles.
    inline int owner_of(unsigned id) const {
        int low = -1, high = count;
        while (high - low > 1) {
            const int middle = (low + high) >> 1;
            if ((unsigned)__ldg(first_id + middle) <= id)
                low = middle;
            else
                high = middle;
        }
        return low;
    }
};

// Objects with separate frames that a view may see, found before its packets are rendered and sorted into tiles of the
// image, so that no packet examines all objects. Python: `FoundObjects` of kernels/casting/packets_cuda.py.
struct FoundObjects {
    enum { TILE = 1 << TILE_BITS };

    struct Entry {
        float nearest_inv_z;  // NOWHERE if it is so close to the camera that it may cover any part of the image
        unsigned columns, rows;  // first pixel that it may cover, and in the upper half the last one
        int movable;

        static inline unsigned pair(float first, float last) { return (unsigned)first | (unsigned)last << 16; }
        static inline int first(unsigned pair) { return pair & 0xffff; }
        static inline int last(unsigned pair) { return pair >> 16; }
    };
    static_assert(sizeof(Entry) == 4 * sizeof(float), "Python allocates rows of four numbers");

    // [movable]: objects in few tiles from the front, others from the back; null if objects were not searched
    Entry* entries;
    int* count;  // number of those in few tiles, and of others
    int* tile_count;  // [tile]; not available to packets, which run after it has been consumed
    const int* tile_end;  // [tile]: end of its objects in `order`, where those of the next tile begin
    const int* order;  // objects in few tiles, sorted by tiles
    int tiles_x, first_tile;  // index among the tiles of all views

    // The objects of a tile, and all objects in many tiles.
    struct Listed {
        int first, count;  // range in `order`
        int large;

        inline int all() const { return count + large; }
    };
    inline Listed listed(int x, int y) const {
        const int tile = first_tile + (y >> TILE_BITS) * tiles_x + (x >> TILE_BITS);
        const int first = tile > 0 ? tile_end[tile - 1] : 0;
        return Listed{first, tile_end[tile] - first, count[1]};
    }
    inline const Entry& entry(const Listed& listed, int i, int movable_count) const {
        return entries[i < listed.large ? movable_count - 1 - i : order[listed.first + i - listed.large]];
    }

    // Record an object; called by any thread, in any order.
    inline void add(const Entry& entry, int movable_count) const {
        const int x0 = Entry::first(entry.columns) >> TILE_BITS, x1 = Entry::last(entry.columns) >> TILE_BITS;
        const int y0 = Entry::first(entry.rows) >> TILE_BITS, y1 = Entry::last(entry.rows) >> TILE_BITS;
        if ((x1 - x0 + 1) * (y1 - y0 + 1) > MAX_TILES) {
            entries[movable_count - 1 - atomicAdd(count + 1, 1)] = entry;
            return;
        }
        entries[atomicAdd(count, 1)] = entry;
        for (int y = y0; y <= y1; ++y)
            for (int x = x0; x <= x1; ++x) atomicAdd(tile_count + first_tile + y * tiles_x + x, 1);
    }
};
static_assert((int)PACKET_WIDTH <= FoundObjects::TILE && (int)PACKET_HEIGHT <= FoundObjects::TILE,
              "a packet is in one tile");

struct Scene {
    Bvh bvh;  // of the static geometry; the arrays also contain those of movable objects
    ClosedObjects closed;
    Movables movables;
    FoundObjects found;

    // The scene of a view, of a `BvhScene` of kernels/casting/packets.py, a `Worlds` of kernels/casting/worlds.py and a
    // `FoundObjects` of kernels/casting/packets_cuda.py.
    template <class BvhScene, class Worlds, class CallFound>
    static inline Scene of(const BvhScene& scene, const Worlds& worlds, const CallFound& found, int view) {
        static_assert(sizeof(*worlds.object_poses.data) == POSE_WORDS * sizeof(float) &&
                          sizeof(*worlds.object_sizes.data) == SOLID_WORDS * sizeof(float),
                      "poses and sizes are read as rows of numbers");
        const unsigned char* excluded = nullptr;
        const int excluded_row = min(view, worlds.excluded.shape[0] - 1);
        if (worlds.excluded.data) excluded = worlds.excluded.data + excluded_row * scene.object_count;
        Scene all;
        all.bvh.leaves = scene.leaves.data;
        all.bvh.owners = scene.owners.data;
        all.bvh.nodes = scene.nodes.data;
        all.bvh.children = scene.children.data;
        all.bvh.root = scene.static_root;
        all.bvh.first_id = 0;
        all.bvh.all_closed = scene.all_closed != 0;
        all.bvh.is_large = scene.leaves.shape[0] > CACHED_NUMBERS;
        all.bvh.excluded = excluded;
        all.closed.boxes = scene.closed_boxes.data;
        all.closed.object = scene.closed_object.data;
        all.closed.count = scene.closed_count;
        all.movables = Movables::of(scene, worlds, view);
        all.movables.excluded = excluded;
        all.found.entries = found.entries.data
                                ? (FoundObjects::Entry*)(found.entries.data + (long long)view * scene.drawn_count)
                                : nullptr;
        all.found.count = found.counts.data + 2 * view;
        all.found.tile_count = found.tile_counts.data;
        all.found.tile_end = found.tile_ends.data;
        all.found.order = found.order.data;
        all.found.tiles_x = found.tiles_x;
        all.found.first_tile = view * found.tiles_y * found.tiles_x;
        return all;
    }
    // Index of the object that owns a triangle.
    inline int object_of(unsigned id) const {
        const int m = movables.owner_of(id);
        const int index = m < 0 ? -1 : __ldg(movables.object + m);
        if (index >= 0) return index;
        return Bvh::object_of(__ldg(bvh.owners + (m < 0 ? id : id - movables.id_offset(m))));
    }
    // Slot of a triangle in the leaves; -1 for a solid, whose triangles are rendered only from inside.
    inline int slot_of(unsigned id) const {
        const int m = MOVABLE ? movables.owner_of(id) : -1;
        if (m < 0) return (int)id;
        return __ldg(movables.solid + m) ? -1 : (int)id - movables.id_offset(m);
    }
};

// One requested image.
struct View {
    int index;  // index in the output images
    int width, height;
    double focal[2], center[2];
    float near, far;
    float clip_inv_z, clip_reach;
    const float* pose;  // [POSE_WORDS], camera to world
    bool cull_back_faces;  // of all objects

    // A view of a `PinholeCamera` of kernels/pinhole.py.
    template <class PinholeCamera, class Poses>
    static inline View of(const PinholeCamera& camera, const Poses& poses, int index, bool cull_back_faces) {
        View view;
        view.index = index;
        view.width = (int)camera.width, view.height = (int)camera.height;
        view.focal[0] = camera.fx, view.focal[1] = camera.fy;
        view.center[0] = camera.cx, view.center[1] = camera.cy;
        view.near = camera.near, view.far = camera.far;
        view.clip_inv_z = camera.clip_inv_z, view.clip_reach = camera.clip_reach;
        view.pose = (const float*)(poses.data + index);
        view.cull_back_faces = cull_back_faces;
        return view;
    }
};
