// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What is drawn: what stays, and objects that move; where they are in a view's world, and whose a triangle is.

// An object's axes in the world, and the camera in its frame: what normals take of a pose and a size.
struct Frame {
    double axis[3][3], viewpoint[3];
    double shrink[3];  // 1 / factors by which it is stretched, of which the viewpoint is a multiple too
    Solid solid;  // with the camera outside; of another kind than none, it is what the object is drawn as
};

// What one view sees: where movable objects are, and what is left out.
struct World {
    bool exists;  // if it does not, nothing is seen
    const float* poses;  // [movable]: x y z qx qy qz qw, object to world
    const float* sizes;  // [movable][SOLID_WORDS]; null if all are as they were made
    const unsigned char* excluded;  // [object]: not 0 for what is not seen; null if nothing is excluded

    // -1 stands for several objects.
    inline bool excludes(int object) const { return excluded && object >= 0 && excluded[object]; }
};

// Objects with frames of their own: those that are movable, and behind them instances, which stay.
struct Movables {
    int count;
    int moving;  // those that are movable
    const int* object;  // [movable, instance], and so the others: its index among all objects, -1 for several together
    const int* root;  // node
    const int* first_leaf;  // of its tree
    const int* first_id;  // number of its first triangle, ascending
    const int* closed;  // whether its back faces are hidden from outside of its box
    const float* boxes;  // [movable or instance][BOX_WORDS]: least and greatest corner in its frame
    const int* solid;  // its kind
    const float* size;  // [][SOLID_WORDS]: of a solid, factors along x, y and z, and half length before them
    const float* instance_poses;  // [instance][POSE_WORDS]
    const float* poses;  // [world][movable][POSE_WORDS]
    const float* sizes;  // [world][movable][SOLID_WORDS]: of a mesh, factors; null if all are as they were made
    int worlds;
    const int* world;  // [view]; null: the one world, or if there are several, for each view its own
    const unsigned char* excluded;  // [view or 1][object], or null
    int excluded_views;
    int objects;  // of the scene
    const int* static_object;  // those that stay
    int static_count;

    inline World of_view(int view) const {
        const int index = world ? world[view] : worlds == 1 ? 0 : view;
        World result;
        result.exists = moving == 0 || (index >= 0 && index < worlds);
        const long long first = (long long)(result.exists ? index : 0) * moving;
        result.poses = poses + first * POSE_WORDS;
        result.sizes = sizes ? sizes + first * SOLID_WORDS : nullptr;
        const int row = view < excluded_views ? view : excluded_views - 1;
        result.excluded = excluded ? excluded + (long long)row * objects : nullptr;
        return result;
    }

    // Whether a view leaves out anything that stays where it is.
    inline bool excludes_static(const World& world) const {
        for (int i = 0; i < static_count && world.excluded; ++i)
            if (world.excluded[static_object[i]]) return true;
        return false;
    }

    // The poses of an object and of those that follow it, as many as `end_of` says.
    inline const float* poses_from(int movable, const World& world) const {
        return movable < moving ? world.poses + (long long)movable * POSE_WORDS
                                : instance_poses + (long long)(movable - moving) * POSE_WORDS;
    }
    inline int end_of(int movable) const { return movable < moving ? moving : count; }

    // How its triangles are stretched in a world.
    inline Stretch stretch_of(int movable, const World& world) const {
        if (!world.sizes || movable >= moving) return Stretch::none();
        const long long row = (long long)movable * SOLID_WORDS;
        return Stretch::of(solid[movable], size + row, world.sizes + row);
    }

    // The solid as which it is seen by a camera in its frame: from inside, triangles are seen whatever it is.
    inline Solid solid_of(int movable, const World& world, const Camera& camera) const {
        if (solid[movable] == SOLID_NONE) return Solid::none();
        const float* sizes_there = world.sizes && movable < moving ? world.sizes : size;
        Solid found = Solid::of(solid[movable], sizes_there + (long long)movable * SOLID_WORDS, camera);
        if (!found.outside()) found.kind = SOLID_NONE;
        return found;
    }

    // Its tree; `owner` is its index among all objects, in every lane.
    inline Instance instance(const Bvh& bvh, int movable, const int* owner) const {
        const int number = first_id[movable] - first_leaf[movable] * LANES;
        return object[movable] < 0 ? Instance{root[movable], number, bvh.owners, LANES}
                                   : Instance{root[movable], number, owner, 0};
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

struct Scene {
    Bvh bvh;  // of what stays, and of each mesh that moves
    Movables movables;

    // Whether a camera is outside the boxes of all closed objects that stay where they are and may be seen, and cuts
    // nothing of them away, so that their back faces are hidden behind their front faces.
    inline bool outside_all(const World& world, const Pose& pose, float clip_reach) const {
        for (int i = 0; i < bvh.closed_count; ++i) {
            const bool inside = pose.inside(bvh.closed_boxes + i * BOX_WORDS, clip_reach);
            if (inside && !world.excludes(bvh.closed_object[i])) return false;
        }
        return true;
    }
};

// One view of a scene.
struct View {
    const Scene& scene;
    const Job& job;
    World world;
    Pose pose;
    Camera camera;  // in the world

    static inline View of(const Scene& scene, const Job& job, const World& world, const Pose& pose) {
        return View{scene, job, world, pose, Camera::of(pose, job)};
    }
};

// Triangles by their numbers: whose they are, and how they face. Neighbouring pixels mostly ask for the same object.
struct Lookup {
    const Bvh& bvh;
    const Movables& movables;
    const Frame* frames;  // of movable objects that were drawn
    const double* viewpoint;  // in the world
    int first_movable;  // numbers from here on are of movable objects
    int first, end;  // numbers of the object found last
    int movable;  // which that is
    bool moving;  // whether any can be; a constant, so that there is code that knows that none is

    static inline Lookup of(const Scene& scene, const Frame* frames, const double* viewpoint, bool moving) {
        return Lookup{scene.bvh, scene.movables, frames, viewpoint, moving ? scene.movables.first_id[0] : 0, 0, 0,
                      0,         moving};
    }

    inline void find(int id) {
        if (id >= first && id < end) return;
        movable = movables.find(id);
        first = movables.first_id[movable];
        end = movable + 1 < movables.count ? movables.first_id[movable + 1] : __INT_MAX__;
    }

    inline int object_of(int id) {
        if (!moving || id < first_movable) return Bvh::object_of(bvh.owners[id]);
        find(id);
        const int alone = movables.object[movable];
        return alone >= 0 ? alone : Bvh::object_of(bvh.owners[id - first + movables.first_leaf[movable] * LANES]);
    }

    // A triangle's place in the leaves; -1 of a solid, which has triangles only where it is seen from inside.
    inline int slot_of(int id) {
        if (!moving || id < first_movable) return id;
        find(id);
        if (movables.solid[movable] != SOLID_NONE) return -1;
        return id - first + movables.first_leaf[movable] * LANES;
    }

    // Unit normal of a triangle in the world, towards the camera.
    inline void normal_of(int id, float* n) {
        if (!moving || id < first_movable)
            normal_there(viewpoint, nullptr, id, n);
        else
            movable_normal(id, n);
    }
    inline void movable_normal(int id, float* n) {
        find(id);
        const Frame& frame = frames[movable];
        float there[3];
        normal_there(frame.viewpoint, frame.shrink, id - first + movables.first_leaf[movable] * LANES, there);
        for (int k = 0; k < 3; ++k)
            n[k] = (float)(there[0] * frame.axis[0][k] + there[1] * frame.axis[1][k] + there[2] * frame.axis[2][k]);
    }

    // Unit normals where rays show solids, into those lanes of `n`; which these are.
    inline Ints solid_normals(Ints ids, Ints seen, Doubles u, Doubles v, Points& n) {
        int id[LANES];
        Ints solid = Lanes::all_ints(0);
        Lanes::store(id, ids);
        for (unsigned left = Lanes::bits(seen & (ids >= first_movable)); left;) {
            find(id[Lanes::first_lane(left)]);
            const Ints here = seen & (ids >= first) & (ids < end);
            if (frames[movable].solid.kind != SOLID_NONE) {
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

    // In the frame of its tree, of the triangle at a place in the leaves, which `shrink` undoes the stretching of.
    inline void normal_there(const double* from, const double* shrink, int slot, float* n) const {
        const float* corners = bvh.leaf((unsigned)slot / LANES);
        ExactTriangle t = ExactTriangle::of(from, corners, (unsigned)slot % LANES);
        double* c = t.normal;
        const double towards = t.volume() > 0 ? -1.0 : 1.0;
        for (int k = 0; k < 3 && shrink; ++k) c[k] *= shrink[k];
        const double length = __builtin_sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
        for (int k = 0; k < 3; ++k) n[k] = (float)(c[k] * towards / length);
    }
};
