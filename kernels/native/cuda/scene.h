// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What a view is of: the triangles that stay, and the objects that move.

// Objects that are closed and stay.
struct ClosedObjects {
    const float* boxes;  // [closed object][BOX_WORDS] in the world
    const int* object;  // the index of each among all objects
    int count;
};

// Objects with frames of their own: the movable ones of one view's world, and behind them instances, which stay.
struct Movables {
    int count;
    int moving;  // those that are movable
    const int* object;  // -1 where several objects move together: then the owners of triangles tell
    const int* root;  // of the BVH in the nodes
    const int* leaf;  // the first leaf of the BVH
    const int* first_id;  // the number of the first triangle, ascending
    const int* closed;
    const float* boxes;  // [movable][BOX_WORDS] in its frame
    const int* solid;  // a SolidKind
    const float* size;  // [movable][SOLID_WORDS]
    const float* instance_poses;  // [instance][POSE_WORDS], object to world
    // [movable][POSE_WORDS], object to world; null where the view's world does not exist, and what is movable decides
    const float* poses;
    const float* sizes;  // [movable][SOLID_WORDS] there; nothing but for kernels that are RESIZED
    const unsigned char* excluded;  // [object]; null for none

    // What the number of a triangle is more than its slot in the leaves.
    inline int id_offset(int m) const { return __ldg(first_id + m) - __ldg(leaf + m) * LANES; }
    inline const float* box(int m) const { return boxes + BOX_WORDS * (long long)m; }
    inline bool is_resized(int m) const { return RESIZED && m < moving; }
    inline const float* solid_size(int m) const { return (is_resized(m) ? sizes : size) + SOLID_WORDS * (long long)m; }
    // How its triangles are stretched.
    inline Stretch stretch(int m) const {
        const long long row = SOLID_WORDS * (long long)m;
        return is_resized(m) ? Stretch::of(__ldg(solid + m), size + row, sizes + row) : Stretch::none();
    }
    inline Vec3 factors(int m) const {
        const Stretch all = stretch(m);
        return Vec3{(float)all.factor[0], (float)all.factor[1], (float)all.factor[2]};
    }
    inline const float* pose(int m) const {
        return m < moving ? poses + POSE_WORDS * (long long)m : instance_poses + POSE_WORDS * (long long)(m - moving);
    }

    // Which of them a triangle belongs to; -1 for what stays.
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

struct Scene {
    Bvh bvh;  // of what stays, and in the same arrays those of what moves
    ClosedObjects closed;
    Movables movables;

    // The object that a triangle belongs to.
    inline int object_of(unsigned id) const {
        const int m = movables.owner_of(id);
        const int alone = m < 0 ? -1 : __ldg(movables.object + m);
        if (alone >= 0) return alone;
        return Bvh::object_of(__ldg(bvh.owners + (m < 0 ? id : id - movables.id_offset(m))));
    }
};

// One image that is asked for.
struct View {
    int index;  // in the images
    int width, height;
    double focal[2], center[2];
    float near, far;
    float most_inv_z, clip_reach;
    const float* pose;  // [POSE_WORDS], camera to world
    bool cull_back_faces;  // those of all objects
};
