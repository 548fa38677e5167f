// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The geometry of a scene: static triangles and movable objects, their poses in a view's world, and the owners of
// triangles.

#pragma once

#include "cpu/solids.h"

// An object's axes in the world and the camera in its frame, as needed for normals.
struct Frame {
    double axis[3][3], viewpoint[3];
    double shrink[3];  // inverse stretch factors, by which the viewpoint is scaled too
    // the solid with the camera outside; if its kind is not SOLID_NONE, the object is rendered as this solid
    Solid solid;
};

// The world of one view: poses of movable objects, and excluded objects.
struct World {
    bool exists;  // if false, nothing is visible
    const float* poses;  // [movable]: x y z qx qy qz qw, object to world
    const float* sizes;  // [movable][SOLID_WORDS]; null if all objects have their original sizes
    const unsigned char* excluded;  // [object]: not 0 for excluded objects; null if none is excluded

    // -1 stands for several objects.
    inline bool excludes(int object) const { return excluded && object >= 0 && excluded[object]; }
};

// Objects with separate frames: movable objects, followed by static instances.
struct Movables {
    int count;
    int moving;  // number of movable objects
    const int* object;  // [movable or instance], like the arrays below: its object index, -1 for several objects
    const int* root;  // root node of its tree
    const int* first_leaf;  // first leaf of its tree
    const int* first_id;  // number of its first triangle, ascending
    const int* closed;  // whether it is closed, so that its back faces are hidden from outside its box
    const float* boxes;  // [movable or instance][BOX_WORDS]: least and greatest corner in its frame
    const int* solid;  // kind of solid
    const float* size;  // [][SOLID_WORDS]: of a solid, factors along x, y and z, and the unscaled half length
    const float* instance_poses;  // [instance][POSE_WORDS]
    const float* poses;  // [world][movable][POSE_WORDS]
    // [world][movable][SOLID_WORDS]: factors of a mesh; null if all objects have their original sizes
    const float* sizes;
    int worlds;
    const int* world;  // [view]: index of its world; null for a single world, or one world per view
    const unsigned char* excluded;  // [view or 1][object], or null
    int excluded_views;
    int objects;  // of the scene
    const int* static_object;  // indices of static objects
    int static_count;

    // The world of a view, -1 if it does not exist.
    inline int world_of_view(int view) const {
        const int index = world ? world[view] : worlds == 1 ? 0 : view;
        return index >= 0 && index < worlds ? index : -1;
    }
    inline World of_view(int view) const {
        const int index = world_of_view(view);
        World result;
        result.exists = moving == 0 || index >= 0;
        const long long first = (long long)(result.exists ? index : 0) * moving;
        result.poses = poses + first * POSE_WORDS;
        result.sizes = sizes ? sizes + first * SOLID_WORDS : nullptr;
        const int row = view < excluded_views ? view : excluded_views - 1;
        result.excluded = excluded ? excluded + (long long)row * objects : nullptr;
        return result;
    }

    // Whether a view excludes any static object.
    inline bool excludes_static(const World& world) const {
        for (int i = 0; i < static_count && world.excluded; ++i)
            if (world.excluded[static_object[i]]) return true;
        return false;
    }

    // The poses of the objects from `movable` to `end_of(movable)`.
    inline const float* poses_from(int movable, const World& world) const {
        return movable < moving ? world.poses + (long long)movable * POSE_WORDS
                                : instance_poses + (long long)(movable - moving) * POSE_WORDS;
    }
    inline int end_of(int movable) const { return movable < moving ? moving : count; }

    // Stretch of an object's triangles in a world.
    inline Stretch stretch_of(int movable, const World& world) const {
        if (!world.sizes || movable >= moving) return Stretch::none();
        const long long row = (long long)movable * SOLID_WORDS;
        return Stretch::of(solid[movable], size + row, world.sizes + row);
    }

    // The solid as which a camera in the object's frame sees it; none if the camera is inside, where triangles are
    // used.
    inline Solid solid_of(int movable, const World& world, const Camera& camera) const {
        if (solid[movable] == SOLID_NONE) return Solid::none();
        const float* current_sizes = world.sizes && movable < moving ? world.sizes : size;
        Solid found = Solid::of(solid[movable], current_sizes + (long long)movable * SOLID_WORDS, camera);
        if (!found.outside()) found.kind = SOLID_NONE;
        return found;
    }

    // The object's tree; `owner` is its object index in every lane.
    inline Instance instance(const Bvh& bvh, int movable, const int* owner) const {
        const int number = first_id[movable] - first_leaf[movable] * LANES;
        return object[movable] < 0 ? Instance{root[movable], number, bvh.owners, LANES}
                                   : Instance{root[movable], number, owner, 0};
    }

    // Find the movable object that owns a triangle number; numbers below the first object's also give the first.
    inline int find(int id) const {
        int low = 0;
        for (int range = count; range > 1;) {
            const int half = range >> 1;
            low += first_id[low + half] <= id ? half : 0;
            range -= half;
        }
        return low;
    }
};

struct Scene {
    Bvh bvh;  // of static geometry, and of each mesh of movable objects
    Movables movables;

    // The scene of a `BvhScene` of kernels/casting/packets.py and a `Worlds` of kernels/casting/worlds.py.
    template <class BvhScene, class Worlds>
    static inline Scene of(const BvhScene& scene, const Worlds& worlds) {
        static_assert(sizeof(*worlds.object_poses.data) == POSE_WORDS * sizeof(float) &&
                          sizeof(*scene.movable_size.data) == SOLID_WORDS * sizeof(float),
                      "poses and solids are read as rows of numbers");
        return Scene{.bvh = {.leaves = scene.leaves.data,
                             .owners = scene.owners.data,
                             .nodes = scene.nodes.data,
                             .children = scene.children.data,
                             .root = scene.static_root,
                             .all_closed = scene.all_closed != 0,
                             .closed_boxes = scene.closed_boxes.data,
                             .closed_object = scene.closed_object.data,
                             .closed_count = scene.closed_count},
                     .movables = {.count = scene.drawn_count,
                                  .moving = scene.movable_count,
                                  .object = scene.movable_object.data,
                                  .root = scene.movable_root.data,
                                  .first_leaf = scene.movable_leaf.data,
                                  .first_id = scene.movable_first_id.data,
                                  .closed = scene.movable_closed.data,
                                  .boxes = scene.movable_boxes.data,
                                  .solid = scene.movable_solid.data,
                                  .size = (const float*)scene.movable_size.data,
                                  .instance_poses = (const float*)scene.instance_pose.data,
                                  .poses = (const float*)worlds.object_poses.data,
                                  .sizes = (const float*)worlds.object_sizes.data,
                                  .worlds = worlds.object_poses.shape[0],
                                  .world = worlds.world.data,
                                  .excluded = worlds.excluded.data,
                                  .excluded_views = worlds.excluded.shape[0],
                                  .objects = scene.object_count,
                                  .static_object = scene.static_object.data,
                                  .static_count = scene.static_object.shape[0]}};
    }

    // Whether a camera is outside the boxes of all closed static objects that are not excluded, and clips none of them,
    // so that their back faces are hidden by their front faces.
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

    template <RayKind KIND>
    static inline View of(const Scene& scene, const Job& job, const World& world, const Pose& pose) {
        return View{scene, job, world, pose, Camera::of<KIND>(pose, job)};
    }
};

// Owners and normals of triangles by number. Adjacent pixels mostly look up the same object.
struct Lookup {
    const Bvh& bvh;
    const Movables& movables;
    const Frame* frames;  // of the movable objects that were rasterized
    const double* viewpoint;  // in the world
    int first_movable;  // numbers from here on belong to movable objects
    int first, end;  // range of numbers of the last object found
    int movable;  // that object
    // whether any object may be movable; a constant, so that an instantiation without movable objects exists
    bool moving;

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
        const int index = movables.object[movable];
        return index >= 0 ? index : Bvh::object_of(bvh.owners[id - first + movables.first_leaf[movable] * LANES]);
    }

    // Slot of a triangle in the leaves; -1 for a solid, whose triangles are rendered only from inside.
    inline int slot_of(int id) {
        if (!moving || id < first_movable) return id;
        find(id);
        if (movables.solid[movable] != SOLID_NONE) return -1;
        return id - first + movables.first_leaf[movable] * LANES;
    }

    // Unit normal of a triangle in the world, facing the camera.
    inline void normal_of(int id, float* n) {
        if (!moving || id < first_movable)
            local_normal(viewpoint, nullptr, id, n);
        else
            movable_normal(id, n);
    }
    inline void movable_normal(int id, float* n) {
        find(id);
        const Frame& frame = frames[movable];
        float local[3];
        local_normal(frame.viewpoint, frame.shrink, id - first + movables.first_leaf[movable] * LANES, local);
        for (int k = 0; k < 3; ++k)
            n[k] = (float)(local[0] * frame.axis[0][k] + local[1] * frame.axis[1][k] + local[2] * frame.axis[2][k]);
    }

    // Unit normals at rays that hit solids, stored in those lanes of `n`; returns a mask of the lanes.
    inline Ints solid_normals(Ints ids, Ints seen, Doubles u, Doubles v, Points& n) {
        int id[LANES];
        Ints solid = Lanes::all_ints(0);
        Lanes::store(id, ids);
        for (unsigned remaining = Lanes::bits(seen & (ids >= first_movable)); remaining;) {
            find(id[Lanes::first_lane(remaining)]);
            const Ints on_movable = seen & (ids >= first) & (ids < end);
            if (frames[movable].solid.kind != SOLID_NONE) {
                const Points found = normals_of(frames[movable], ids - first, u, v);
                n.x = on_movable ? found.x : n.x;
                n.y = on_movable ? found.y : n.y;
                n.z = on_movable ? found.z : n.z;
                solid |= on_movable;
            }
            remaining &= ~Lanes::bits(on_movable);
        }
        return solid;
    }
    static inline Points normals_of(const Frame& frame, Ints part, Doubles u, Doubles v) {
        const ExactPoints local = frame.solid.normals(part, u, v);
        Floats n[3];
        for (int k = 0; k < 3; ++k) {
            const Doubles in_world =
                local.x * frame.axis[0][k] + (local.y * frame.axis[1][k] + local.z * frame.axis[2][k]);
            n[k] = __builtin_convertvector(in_world, Floats);
        }
        return Points{n[0], n[1], n[2]};
    }

    // Whether the camera sees the back of a triangle; not of a solid.
    inline bool is_back(int id) {
        const double* from = viewpoint;
        int slot = id;
        if (moving && id >= first_movable) {
            find(id);
            if (frames[movable].solid.kind != SOLID_NONE) return false;
            from = frames[movable].viewpoint;
            slot = id - first + movables.first_leaf[movable] * LANES;
        }
        return ExactTriangle::of(from, bvh.leaf((unsigned)slot / LANES), (unsigned)slot % LANES).volume() > 0;
    }

    // Unit normal of the triangle in a slot, in the frame of its tree; `shrink` undoes stretching.
    inline void local_normal(const double* from, const double* shrink, int slot, float* n) const {
        const float* corners = bvh.leaf((unsigned)slot / LANES);
        ExactTriangle t = ExactTriangle::of(from, corners, (unsigned)slot % LANES);
        double* c = t.normal;
        const double toward = t.volume() > 0 ? -1.0 : 1.0;
        for (int k = 0; k < 3 && shrink; ++k) c[k] *= shrink[k];
        const double length = __builtin_sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
        for (int k = 0; k < 3; ++k) n[k] = (float)(c[k] * toward / length);
    }
};
