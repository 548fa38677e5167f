// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Objects that move: each is a tree in its own frame, drawn by a camera that is moved into that frame. Depth and pixels
// are the same there.

// The movable objects of one view's world.
struct Movables {
    int count;
    const int* object;  // -1 where several objects move together: then the owners of triangles tell
    const int* root;  // of the tree in the nodes
    const int* leaf;  // the first leaf of the tree
    const int* first_id;  // the number of the first triangle, ascending
    const int* closed;
    const float* boxes;  // in the objects' frames
    const int* solid;  // which kind of Shape they are
    const float* size;  // of a shape: three sizes, and half its length
    const float* poses;  // object to world
    const unsigned char* excluded;  // by object; null for none

    static inline int first_of(const Movables& all, int m) {
        return __ldg(all.first_id + m) - __ldg(all.leaf + m) * LANES;
    }

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
    enum {
        AT_A_TIME = MOVABLE ? 256 : 1,
        SOLIDS = (int)((LEVELS - 1) * sizeof(Walk::Level) / sizeof(Solid)),  // that have room where levels are
    };
    // What is to be drawn yet.
    struct List {
        unsigned visits[AT_A_TIME];
        unsigned round[(AT_A_TIME + 31) / 32];  // which are solids, a bit each
    };

    // In single precision, which is enough for a box: one lane an object.
    static inline unsigned visit(const Eye& world, const Packet& packet, const Movables& all, int m) {
        const float* pose = all.poses + 7 * (long long)m;
        const int object = __ldg(all.object + m);
        const bool shown = !(all.excluded && object >= 0 && all.excluded[object]);
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

    // Draw what stays and then the objects, the nearest first. `eye` and `list` are room for one each, `solids` for SOLIDS;
    // `levels` may be in the same place.
    static inline void draw(Tree tree, const Eye& world, Packet& packet, const Movables& all, bool cull, Eye* eye,
                            List* list, Solid* solids, Walk::Level* levels, Queue queue, Triangle* slot) {
        const unsigned char* excluded = tree.excluded;
        if (Warp::lane() == 0) *eye = world;
        Warp::sync();
        Chunk chunk = {0, 0};
        bool some = tree.root >= 0;
        for (;;) {
            // One place for both, though the eye is the world's at first: the code of a walk is long.
            if (some) Walk::draw(tree, *eye, packet, levels, queue, slot);
            Warp::sync();
            const int m = draw_to_triangles(world, packet, all, chunk, list, solids);
            if (m < 0) return;
            move(world, all, m, cull, eye);
            tree.root = __ldg(all.root + m);
            tree.first_id = Movables::first_of(all, m);
            tree.excluded = __ldg(all.object + m) < 0 ? excluded : nullptr;
            some = true;
        }
    }

    // The objects that are in a list.
    struct Chunk {
        int first, count;
    };

    // Draw solids until it is the turn of an object that is seen by its triangles, which is returned; -1 at the end.
    static inline int draw_to_triangles(const Eye& world, Packet& packet, const Movables& all, Chunk& chunk, List* list,
                                        Solid* solids) {
        for (;;) {
            int at;
            unsigned visit;
            const int taken = take(*list, chunk.count, at, visit);
            if (taken > 0) {
                draw_solids(world, packet, all, chunk.first, at, visit, taken, *list, solids);
            } else if (taken < 0) {
                if (!Walk::hidden(packet, visit)) return chunk.first + at;
            } else {
                chunk.first += chunk.count;
                chunk.count = min(all.count - chunk.first, (int)AT_A_TIME);
                if (chunk.count == 0) return -1;
                look(world, packet, all, chunk.first, chunk.count, *list);
            }
        }
    }

    static inline void look(const Eye& world, const Packet& packet, const Movables& all, int first, int count,
                            List& list) {
        const int lane = Warp::lane();
        Warp::sync();
        for (int i = lane; i < (count + 31) / 32 * 32; i += 32) {
            const int m = first + min(i, count - 1);
            const unsigned found = visit(world, packet, all, m), round = Warp::lanes_where(__ldg(all.solid + m) != 0);
            list.visits[i] = i < count ? found : 0;
            if (lane == 0) list.round[i / 32] = round;
        }
        Warp::sync();
    }

    // The next objects of a list, the nearest first, each a lane's: as many solids as there is room for, or, if that comes
    // first, one to be drawn by its triangles, which all lanes get. How many solids; -1 for the other.
    static inline int take(List& list, int count, int& mine, unsigned& my_visit) {
        const int lane = Warp::lane();
        int taken = 0;
        mine = 0, my_visit = 0;
        while (taken < SOLIDS) {
            unsigned best = 0;
            int at = 0;
            for (int i = lane; i < count; i += 32)
                if (list.visits[i] > best) best = list.visits[i], at = i;
            const unsigned next = Warp::most(best);
            if (next == 0) break;
            const int k = Warp::first_of(Warp::lanes_where(best == next));
            const int found = Warp::from(at, k);
            const bool round = list.round[found / 32] >> (found % 32) & 1;
            if (!round && taken > 0) break;
            if (lane == k) list.visits[at] = 0;
            if (lane == taken || !round) mine = found, my_visit = next;
            if (!round) return -1;
            ++taken;
        }
        return taken;
    }

    // Each of the first lanes sets up a solid, then all draw one after the other.
    static inline void draw_solids(const Eye& world, Packet& packet, const Movables& all, int first, int at,
                                   unsigned visit, int taken, List& list, Solid* solids) {
        const int lane = Warp::lane(), m = first + at;
        bool outside = false;
        Warp::sync();
        if (lane < taken) {
            outside = solids[lane].set_up(world, all.poses + 7 * (long long)m, __ldg(all.solid + m),
                                          all.size + 4 * (long long)m, __ldg(all.first_id + m));
            if (!outside) {  // it is triangles that are seen, and it is still to be drawn
                list.visits[at] = visit;
                atomicAnd(list.round + at / 32, ~(1u << at % 32));
            }
        }
        Warp::sync();
        for (unsigned left = Warp::lanes_where(outside); left; left = Warp::without_first(left)) {
            const int k = Warp::first_of(left);
            const unsigned blocks = Walk::open_blocks(packet, Warp::from(visit, k));
            if (blocks) solids[k].draw(packet, blocks);
        }
        Warp::sync();
    }
};
