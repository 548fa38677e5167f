// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Objects that move: each is a tree in its own frame, drawn by a camera that is moved into that frame. Depth and pixels
// are the same there.

struct Pose {
    // The axes of a pose x y z qx qy qz qw, in double precision: what its x, y and z axis are outside of its frame.
    static inline void axes(const float* pose, Exact* axis) {
        const double x = __ldg(pose + 3), y = __ldg(pose + 4), z = __ldg(pose + 5), w = __ldg(pose + 6);
        const double two = 2.0 / (x * x + y * y + z * z + w * w);  // which normalises the quaternion
        axis[0] = Exact{1 - two * (y * y + z * z), two * (x * y + z * w), two * (x * z - y * w)};
        axis[1] = Exact{two * (x * y - z * w), 1 - two * (x * x + z * z), two * (y * z + x * w)};
        axis[2] = Exact{two * (x * z + y * w), two * (y * z - x * w), 1 - two * (x * x + y * y)};
    }
    static inline Exact position(const float* pose) { return Exact{__ldg(pose), __ldg(pose + 1), __ldg(pose + 2)}; }
    // A direction out of its frame.
    static inline Exact outside(const Exact* axis, Exact v) {
        return Exact{axis[0].x * v.x + axis[1].x * v.y + axis[2].x * v.z, axis[0].y * v.x + axis[1].y * v.y + axis[2].y * v.z,
                     axis[0].z * v.x + axis[1].z * v.y + axis[2].z * v.z};
    }
};

// The movable objects of one view's world.
struct Movables {
    int count;
    const int* object;
    const int* root;       // of the tree in the nodes
    const int* leaf;       // the first leaf of the tree
    const int* first_id;   // the number of the first triangle, ascending
    const int* closed;
    const float* boxes;    // in the objects' frames
    const float* poses;    // object to world
    const unsigned char* excluded;  // by object; null for none

    static inline int first_of(const Movables& all, int m) { return __ldg(all.first_id + m) - __ldg(all.leaf + m) * LANES; }

    // Which of them a triangle belongs to; -1 for what stays.
    static inline int owner_of(const Movables& all, unsigned id) {
        int low = -1, high = all.count;
        while (high - low > 1) {
            const int middle = (low + high) >> 1;
            if ((unsigned)__ldg(all.first_id + middle) <= id)
                low = middle;
            else
                high = middle;
        }
        return low;
    }
};

struct Objects {
    enum { AT_A_TIME = 256 };

    // In single precision, which is enough for a box: one lane an object.
    static inline unsigned visit(const Eye& world, const Packet& packet, const Movables& all, int m) {
        const float* pose = all.poses + 7 * (long long)m;
        const bool shown = !(all.excluded && all.excluded[__ldg(all.object + m)]);
        float x = __ldg(pose + 3), y = __ldg(pose + 4), z = __ldg(pose + 5), w = __ldg(pose + 6);
        const float scale = 1.0f / sqrtf(x * x + y * y + z * z + w * w);
        x *= scale, y *= scale, z *= scale, w *= scale;
        const Vec axis[3] = {{1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)},
                             {2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)},
                             {2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)}};
        const Vec origin = inside(axis, Vec::minus(world.origin, Vec{__ldg(pose), __ldg(pose + 1), __ldg(pose + 2)}));
        const Vec rows[3] = {inside(axis, world.to_camera[0]), inside(axis, world.to_camera[1]),
                             inside(axis, world.to_camera[2])};
        const float* box = all.boxes + 6 * (long long)m;
        // As much wider as the origin may be wrong.
        const float margin = 1e-6f * (fabsf(origin.x) + fabsf(origin.y) + fabsf(origin.z));
        const Vec wider = {margin, margin, margin};
        const Vec low = Vec::minus(Vec::minus(Vec{__ldg(box), __ldg(box + 1), __ldg(box + 2)}, origin), wider);
        const Vec high = Vec::plus(Vec::minus(Vec{__ldg(box + 3), __ldg(box + 4), __ldg(box + 5)}, origin), wider);
        return Walk::visit(world, rows, packet, low, high, shown);
    }
    static inline Vec inside(const Vec* axis, Vec v) {
        return Vec{Vec::dot(axis[0], v), Vec::dot(axis[1], v), Vec::dot(axis[2], v)};
    }

    // Move the world's camera into the frame of an object; a lane takes a coordinate of a ray, or of the origin.
    static inline void move(const Eye& world, const Movables& all, int m, bool cull, Eye* moved) {
        const int lane = Warp::lane(), row = lane / 3, k = lane % 3;
        const float* pose = all.poses + 7 * (long long)m;
        Exact axis[3];
        Pose::axes(pose, axis);
        const Exact along = k == 0 ? axis[0] : k == 1 ? axis[1] : axis[2];
        if (row < 3) {
            const double value = Exact::dot(along, world.exact_rays[row]);
            (&moved->exact_rays[row].x)[k] = value;
            (&moved->to_camera[row].x)[k] = (float)(value * world.focal_squared[row]);
        } else if (row == 3) {
            const double value = Exact::dot(along, Exact::minus(world.exact_origin, Pose::position(pose)));
            (&moved->exact_origin.x)[k] = value;
            (&moved->origin.x)[k] = (float)value;
            (&moved->rest.x)[k] = (float)(value - (float)value);
        }
        Warp::sync();
        const bool inside = Box::holds(all.boxes + 6 * (long long)m, moved->origin);
        if (lane == 0) {
            moved->skip_back_faces = __ldg(all.closed + m) && !inside;
            moved->cull_back_faces = cull || moved->skip_back_faces;
        }
        Warp::sync();
    }

    // Draw all that is seen of the objects, the nearest first. `visits` has room for AT_A_TIME, `eye` for one.
    static inline void draw(Tree tree, const Eye& world, Packet& packet, const Movables& all, bool cull, Eye* eye,
                            unsigned* visits, Walk::Level* levels, Queue queue, Triangle* slot) {
        const int lane = Warp::lane();
        tree.excluded = nullptr;
        if (lane == 0) *eye = world;
        Warp::sync();
        for (int first = 0; first < all.count; first += AT_A_TIME) {
            const int count = min(all.count - first, (int)AT_A_TIME);
            for (int i = lane; i < (count + 31) / 32 * 32; i += 32) {
                const unsigned found = visit(world, packet, all, first + min(i, count - 1));
                visits[i] = i < count ? found : 0;
            }
            for (;;) {
                unsigned best = 0;
                int at = 0;
                for (int i = lane; i < count; i += 32)
                    if (visits[i] > best) best = visits[i], at = i;
                const unsigned next = Warp::most(best);
                if (next == 0) break;
                const int k = Warp::first_of(Warp::lanes_where(best == next));
                if (lane == k) visits[at] = 0;
                if (Walk::hidden(packet, next)) continue;
                const int m = first + Warp::from(at, k);
                move(world, all, m, cull, eye);
                tree.root = __ldg(all.root + m);
                tree.first_id = Movables::first_of(all, m);
                Walk::draw(tree, *eye, packet, levels, queue, slot);
                Warp::sync();
            }
        }
    }
};
