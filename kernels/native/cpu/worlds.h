// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Objects that move: where they are in a view's world, and which of them a triangle belongs to.

// A tree to draw, what stays where it is or one object that moves, and whose its triangles are.
struct Piece {
    int root;
    int number;  // of a triangle, less its place in the leaves
    const int* owners;  // of leaf 0
    int owner_step;  // from the owners of a leaf to those of the next: 0 where there is but one
};

// An object's axes in the world, and the camera in its frame: what normals take of a pose.
struct Frame {
    double axis[3][3], camera[3];
    Solid solid;  // with the camera outside; of another kind than none, it is what the object is drawn as
};

// What one view sees: where movable objects are, and what is left out.
struct World {
    bool known;  // if there is no such world, nothing is seen
    const float* poses;  // [movable]: x y z qx qy qz qw, object to world
    const unsigned char* excluded;  // [object]: not 0 for what is not seen; null if nothing is excluded

    // -1 stands for several objects.
    inline bool excludes(int object) const { return excluded && object >= 0 && excluded[object]; }
};

struct Movables {
    int count;
    const int* object;  // [movable], and so the others: its index among all objects, -1 where several move together
    const int* root;  // node
    const int* first_leaf;  // of its tree
    const int* first_id;  // number of its first triangle, ascending
    const int* closed;  // whether its back faces are hidden from outside of its box
    const float* boxes;  // [movable][6]: least and greatest corner in its frame
    const int* solid;  // its kind
    const float* size;  // [movable][4]: of a solid, factors along x, y and z, and half length before them
    const float* poses;  // [world][movable][7]
    int worlds;
    const int* world;  // [view]; null: the one world, or if there are several, for each view its own
    const unsigned char* excluded;  // [view or 1][object], or null
    int excluded_views;
    int objects;  // of the scene
    const int* still;  // those that stay
    int still_count;

    inline World of_view(int view) const {
        const int index = world ? world[view] : worlds == 1 ? 0 : view;
        World result;
        result.known = count == 0 || (index >= 0 && index < worlds);
        result.poses = poses + (long long)(result.known ? index : 0) * count * 7;
        const int row = view < excluded_views ? view : excluded_views - 1;
        result.excluded = excluded ? excluded + (long long)row * objects : nullptr;
        return result;
    }

    // Whether a view leaves out anything that stays where it is.
    inline bool excludes_static(const World& world) const {
        for (int i = 0; i < still_count && world.excluded; ++i)
            if (world.excluded[still[i]]) return true;
        return false;
    }

    // Its tree; `owner` is its index among all objects, sixteen times.
    inline Piece piece(const Tree& tree, int movable, const int* owner) const {
        const int number = first_id[movable] - first_leaf[movable] * 16;
        return object[movable] < 0 ? Piece{root[movable], number, tree.owners, 16}
                                   : Piece{root[movable], number, owner, 0};
    }

    // The object that a triangle belongs to, by the triangle's number; the first one also answers for lesser numbers.
    inline int find(int id) const {
        int low = 0;
        for (int left = count; left > 1;) {
            const int half = left >> 1;
            low += first_id[low + half] <= id ? half : 0;
            left -= half;
        }
        return low;
    }
};

// Triangles by their numbers: whose they are, and how they face. Neighbouring pixels mostly ask for the same object.
struct Lookup {
    const Tree& tree;
    const Movables& movables;
    const Frame* frames;  // of movable objects that were drawn
    const double* camera;  // in the world
    int first_movable;  // numbers from here on are of movable objects
    int first, end;  // numbers of the object found last
    int movable;  // which that is
    bool moving;  // whether any can be; a constant, so that there is code that knows that none is

    static inline Lookup of(const Tree& tree, const Movables& movables, const Frame* frames, const double* camera,
                            bool moving) {
        return Lookup{tree, movables, frames, camera, moving ? movables.first_id[0] : 0, 0, 0, 0, moving};
    }

    inline void find(int id) {
        if (id >= first && id < end) return;
        movable = movables.find(id);
        first = movables.first_id[movable];
        end = movable + 1 < movables.count ? movables.first_id[movable + 1] : 0x7fffffff;
    }

    inline int object_of(int id) {
        if (!moving || id < first_movable) return Tree::object_of(tree.owners[id]);
        find(id);
        const int alone = movables.object[movable];
        return alone >= 0 ? alone : Tree::object_of(tree.owners[id - first + movables.first_leaf[movable] * 16]);
    }

    // Unit normal of a triangle in the world, towards the camera.
    inline void normal_of(int id, float* n) {
        if (!moving || id < first_movable)
            normal_there(camera, id, n);
        else
            movable_normal(id, n);
    }
    inline void movable_normal(int id, float* n) {
        find(id);
        const Frame& frame = frames[movable];
        float there[3];
        normal_there(frame.camera, id - first + movables.first_leaf[movable] * 16, there);
        for (int k = 0; k < 3; ++k)
            n[k] = (float)(there[0] * frame.axis[0][k] + there[1] * frame.axis[1][k] + there[2] * frame.axis[2][k]);
    }

    // Unit normals where sixteen rays show solids, into those lanes of `n`; which these are.
    inline Ints solid_normals(Ints ids, Ints seen, Doubles u, Doubles v, Points& n) {
        int id[16];
        Ints solid = Lanes::all_ints(0);
        Lanes::store(id, ids);
        for (unsigned left = Lanes::bits(seen & (ids >= first_movable)); left;) {
            find(id[Lanes::first_lane(left)]);
            const Ints here = seen & (ids >= first) & (ids < end);
            if (frames[movable].solid.kind != Solid::none) {
                const Points found = normals_of(frames[movable], ids - first, u, v);
                n.x = here ? found.x : n.x;
                n.y = here ? found.y : n.y;
                n.z = here ? found.z : n.z;
                solid |= here;
            }
            left &= ~Lanes::bits(here);
        }
        return solid;
    }
    static inline Points normals_of(const Frame& frame, Ints part, Doubles u, Doubles v) {
        const ExactPoints there = frame.solid.normals(part, u, v);
        Floats n[3];
        for (int k = 0; k < 3; ++k) {
            const Doubles in_world =
                there.x * frame.axis[0][k] + (there.y * frame.axis[1][k] + there.z * frame.axis[2][k]);
            n[k] = __builtin_convertvector(in_world, Floats);
        }
        return Points{n[0], n[1], n[2]};
    }

    // In the frame of its tree, of the triangle at a place in the leaves.
    inline void normal_there(const double* eye, int slot, float* n) const {
        const ExactTriangle t = ExactTriangle::of(eye, tree.leaves + (long long)(slot >> 4) * 144, slot & 15);
        const double* c = t.normal;
        const double towards = t.volume() > 0 ? -1.0 : 1.0;
        const double length = __builtin_sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
        for (int k = 0; k < 3; ++k) n[k] = (float)(c[k] * towards / length);
    }
};
