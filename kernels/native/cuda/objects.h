// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Movable objects: each has a BVH in its own frame and is drawn by the camera transformed into that frame. Depth and
// pixel coordinates are the same in both frames.

#pragma once

#include "cuda/scene.h"
#include "cuda/solids.h"
#include "cuda/walk.h"

// Queue of movable objects that a packet may see and that are not yet drawn; it holds a limited number at a time.
struct ObjectQueue {
    enum { SIZE = MOVABLE ? 64 : 1 };

    unsigned visits[SIZE];
    int objects[SIZE];  // object index; its complement if the analytic surface is drawn

    inline bool is_solid(int item) const { return objects[item] < 0; }
    inline int movable(int item) const { return objects[item] < 0 ? ~objects[item] : objects[item]; }
    // Draw the object by its triangles instead.
    inline void unset_solid(int item) { objects[item] = ~objects[item]; }
};

// As many as fit into the memory of the levels.
enum { SOLIDS_AT_A_TIME = (int)(LEVELS * sizeof(Walk::Level) / sizeof(Solid)) };
static_assert(SOLIDS_AT_A_TIME >= 1 && SOLIDS_AT_A_TIME <= (int)LANES, "each lane sets up one solid");

// A warp's shared memory.
struct WarpMemory {
    // The world's camera and, if objects may move, the camera in the frame of the object being drawn.
    enum { WORLD = 0, CURRENT = MOVABLE };
    Camera cameras[CURRENT + 1];
    Walk::Memory walk;
    union {  // levels of a BVH, or solids
        Walk::Level levels[LEVELS];
        Solid solids[SOLIDS_AT_A_TIME];
    };
    PixelMemory pixels;
    ObjectQueue objects;
};
static_assert(sizeof(WarpMemory) <= 48 * 1024, "shared memory of a block without opt-in");

// Relative margin of a box in the frame of an object, for the rounding of the camera's distance.
constexpr float MOVED_BOX_SLACK = 1e-6f;

struct ObjectPass {
    // In single precision, which suffices for a box: one object per lane.
    static inline Child visit(const Camera& world, const Packet& packet, const Movables& movables, int m,
                              bool is_active) {
        const MovedBox box = MovedBox::of(world, movables, m);
        return Walk::visit(world, box.rows, packet, box.low, box.high, is_active && !movables.excludes(m));
    }

    // The box of an object in its frame, relative to the camera, and the rotation from that frame into camera space.
    struct MovedBox {
        Vec3 rows[3], low, high;

        static inline MovedBox of(const Camera& world, const Movables& movables, int m) {
            MovedBox moved;
            Vec3 axis[3];
            const Vec3 origin = camera_in_frame(world, movables.pose(m), axis);
            for (int i = 0; i < 3; ++i) moved.rows[i] = Vec3::rotated(axis, world.to_camera[i]);
            const float* box = movables.box(m);
            // Margin for the rounding error of the origin.
            const float margin = MOVED_BOX_SLACK * (fabsf(origin.x) + fabsf(origin.y) + fabsf(origin.z));
            const Vec3 wider = {margin, margin, margin};
            const Vec3 factors = movables.factors(m);
            const Vec3 box_low = Box::corner(box, factors), box_high = Box::corner(box + 3, factors);
            moved.low = Vec3::minus(Vec3::minus(box_low, origin), wider);
            moved.high = Vec3::plus(Vec3::minus(box_high, origin), wider);
            return moved;
        }
    };

    // Position of the camera in the frame of an object, and that frame's axes in the world, in single precision.
    static inline Vec3 camera_in_frame(const Camera& world, const float* pose, Vec3* axis) {
        float x = __ldg(pose + 3), y = __ldg(pose + 4), z = __ldg(pose + 5), w = __ldg(pose + 6);
        const float scale = 1.0f / sqrtf(x * x + y * y + z * z + w * w);
        x *= scale, y *= scale, z *= scale, w *= scale;
        Pose::axes_of(x, y, z, w, 2.0f, (float (*)[3])axis);
        return Vec3::rotated(axis, Vec3::minus(world.origin, Vec3{__ldg(pose), __ldg(pose + 1), __ldg(pose + 2)}));
    }

    // Whether the near plane may cut an object open: then its triangles are drawn, even if it is a solid.
    static inline bool is_cut(const Camera& world, const Movables& movables, int m) {
        if (!CLIPS) return false;
        Vec3 axis[3];
        const Vec3 origin = camera_in_frame(world, movables.pose(m), axis);
        return Box::holds(movables.box(m), movables.factors(m), origin, world.near);
    }

    // Transform the world's camera into the frame of an object's triangles; each lane computes one coordinate of a ray
    // or of the origin.
    static inline void move(const Camera& world, const Movables& movables, int m, bool cull, Camera& moved) {
        const int lane = Warp::lane(), row = lane / 3, k = lane % 3;
        const float* pose = movables.pose(m);
        Vec3d axis[3];
        PoseRow::axes(pose, axis);
        const Vec3d along = k == 0 ? axis[0] : k == 1 ? axis[1] : axis[2];
        const double factor = RESIZED ? movables.stretch(m).factor[k] : 1.0;
        if (row < 3) {
            const double value = Vec3d::dot(along, world.exact_rays[row]);
            (&moved.exact_rays[row].x)[k] = RESIZED ? value / factor : value;
            (&moved.to_camera[row].x)[k] = (float)(world.rotated_row(row, along, value) * factor);
        } else if (row == 3) {
            const double local = Vec3d::dot(along, Vec3d::minus(world.exact_origin, PoseRow::position(pose)));
            const double value = RESIZED ? local / factor : local;
            (&moved.exact_origin.x)[k] = value;
            (&moved.origin.x)[k] = (float)value;
            (&moved.origin_error.x)[k] = (float)(value - (float)value);
        }
        Warp::sync();
        const Vec3 factors = movables.factors(m), o = moved.origin;
        const Vec3 scaled_origin = RESIZED ? Vec3{o.x * factors.x, o.y * factors.y, o.z * factors.z} : o;
        const bool inside = Box::holds(movables.box(m), factors, scaled_origin, world.near);
        if (lane == 0) {
            if (RESIZED) moved.stretch = factors;
            moved.skip_back_faces = __ldg(movables.closed + m) && !inside;
            moved.cull_back_faces = cull || moved.skip_back_faces;
        }
        Warp::sync();
    }

    // Number of objects in the queue (including drawn ones), and number of objects examined.
    struct QueuedRange {
        int count, next;
    };

    // Draw static triangles, then the objects front to back.
    static inline void render(const Scene& scene, const View& view, Packet& packet, WarpMemory& memory) {
        render(scene, view, packet, QueuedRange{0, 0}, scene.bvh.root >= 0, memory);
    }
    // Draw static triangles if there are any, then the queued objects and those that were not examined.
    static inline void render(const Scene& scene, const View& view, Packet& packet, QueuedRange queued,
                              bool has_triangles, WarpMemory& memory) {
        const Movables& movables = scene.movables;
        Bvh bvh = scene.bvh;
        if (Warp::lane() == 0) memory.cameras[WarpMemory::CURRENT] = memory.cameras[WarpMemory::WORLD];
        Warp::sync();
        for (;;) {
            // A single call for both, though the camera is the world's at first: the code of a traversal is long.
            if (has_triangles)
                Walk::traverse(bvh, memory.cameras[WarpMemory::CURRENT], packet, memory.levels, memory.walk);
            Warp::sync();
            const int m = render_until_triangles(scene, packet, queued, memory);
            if (m < 0) return;
            move(memory.cameras[WarpMemory::WORLD], movables, m, view.cull_back_faces,
                 memory.cameras[WarpMemory::CURRENT]);
            bvh.root = __ldg(movables.root + m);
            bvh.first_id = movables.id_offset(m);
            bvh.excluded = __ldg(movables.object + m) < 0 ? scene.bvh.excluded : nullptr;
            has_triangles = true;
        }
    }

    // Draw solids until the next object is one that is drawn by its triangles, and return that object; -1 at the end.
    static inline int render_until_triangles(const Scene& scene, Packet& packet, QueuedRange& queued,
                                             WarpMemory& memory) {
        for (;;) {
            const Taken taken = take(memory.objects, queued.count);
            if (taken.solids > 0) {
                render_solids(scene.movables, packet, taken, memory);
            } else if (taken.solids < 0) {
                const int m = memory.objects.movable(taken.item);
                if (!Walk::hidden(packet, taken.visit)) return m;
            } else {
                fill(scene, packet, queued, memory);
                if (queued.count == 0) return -1;
            }
        }
    }

    // Queue the next objects that the packet may see, one per lane, until the queue is full or all are examined.
    static inline void fill(const Scene& scene, const Packet& packet, QueuedRange& queued, WarpMemory& memory) {
        const int lane = Warp::lane();
        const bool sorted = scene.found.entries != nullptr;
        const FoundObjects::Listed listed =
            sorted ? scene.found.listed(packet.first_x, packet.first_y) : FoundObjects::Listed{0, 0, 0};
        const int all = sorted ? listed.all() : scene.movables.count;
        queued.count = 0;
        Warp::sync();
        for (; queued.next < all && queued.count <= ObjectQueue::SIZE - LANES; queued.next += LANES) {
            const int i = min(queued.next + lane, all - 1);
            const bool exists = queued.next + lane < all;
            int m = i;
            const Child found = sorted ? look_up(scene, memory.cameras[WarpMemory::WORLD], packet, listed, i, exists, m)
                                       : visit(memory.cameras[WarpMemory::WORLD], packet, scene.movables, i, exists);
            const unsigned lanes = Warp::ballot(found.visit != 0);
            if (found.visit) {
                const int item = queued.count + __popc(lanes & ((1u << lane) - 1));
                memory.objects.visits[item] = found.visit;
                memory.objects.objects[item] = __ldg(scene.movables.solid + m) != SOLID_NONE ? ~m : m;
            }
            queued.count += __popc(lanes);
        }
        Warp::sync();
    }

    // Bounds, in a packet, of an object that was found for the view.
    static inline Child look_up(const Scene& scene, const Camera& world, const Packet& packet,
                                const FoundObjects::Listed& listed, int i, bool exists, int& m) {
        const FoundObjects::Entry found = scene.found.entry(listed, i, scene.movables.count);
        const int x0 = max(FoundObjects::Entry::first(found.columns) - packet.first_x, 0);
        const int x1 = min(FoundObjects::Entry::last(found.columns) - packet.first_x, PACKET_WIDTH - 1);
        const int y0 = max(FoundObjects::Entry::first(found.rows) - packet.first_y, 0);
        const int y1 = min(FoundObjects::Entry::last(found.rows) - packet.first_y, PACKET_HEIGHT - 1);
        m = found.movable;
        const bool shown = exists && x0 <= x1 && y0 <= y1, anywhere = shown && found.nearest_inv_z == NOWHERE;
        if (Warp::any(anywhere)) {
            const Child visible = visit(world, packet, scene.movables, m, anywhere);
            if (anywhere) return visible;
        }
        return shown ? Walk::child_of(found.nearest_inv_z, x0, y0, x1, y1) : Child{0, 0};
    }

    // Record an object if the view may see it: one object per lane, in any order.
    static inline void find(const Camera& world, const Movables& movables, const FoundObjects& found, int m,
                            bool exists) {
        const MovedBox box = MovedBox::of(world, movables, m);
        const bool is_active = exists && !movables.excludes(m);
        const Walk::ScreenBounds p = Walk::ScreenBounds::of(box.rows, box.low, box.high, world.blur, is_active);
        const PixelBounds in =
            p.pixels({world.first_u, world.first_v}, {world.last_x, world.last_y}, {p.slack, p.slack}, p.crossing);
        if (!is_active || p.zmin > world.far || !in.any()) return;
        // Without this test, all objects behind the camera would be recorded.
        if (p.crossing && !Walk::reaches_frustum(box.rows, world.first_u, world.first_v, world.last_x + 1.0f,
                                                 world.last_y + 1.0f, box.low, box.high, world.origins.aside()))
            return;
        found.add({p.nearest_inv_z(), FoundObjects::Entry::pair(in.left, in.right),
                   FoundObjects::Entry::pair(in.top, in.bottom), m},
                  movables.count);
    }

    // The next item to render: `solids` solids, one per lane, or, if `solids` is -1, one object by its triangles with
    // all lanes. 0 if nothing is left.
    struct Taken {
        int solids;
        int item;  // position in the queue
        unsigned visit;
    };

    // Take the nearest objects from the queue: as many solids as fit, or, if it comes first, one object that is drawn
    // by its triangles.
    static inline Taken take(ObjectQueue& queue, int count) {
        const int lane = Warp::lane();
        Taken mine = {0, 0, 0};
        while (mine.solids < SOLIDS_AT_A_TIME) {
            unsigned best = 0;
            int item = 0;
            for (int i = lane; i < count; i += LANES)
                if (queue.visits[i] > best) best = queue.visits[i], item = i;
            const unsigned next = Warp::reduce_max(best);
            if (next == 0) break;
            const int k = Warp::first_lane(Warp::ballot(best == next));
            const int found = Warp::shuffle(item, k);
            const bool solid = queue.is_solid(found);
            if (!solid && mine.solids > 0) break;
            if (lane == k) queue.visits[item] = 0;
            if (lane == mine.solids || !solid) mine.item = found, mine.visit = next;
            if (!solid) {
                mine.solids = -1;
                break;
            }
            ++mine.solids;
        }
        return mine;
    }

    // Each of the first lanes sets up a solid, then the solids are drawn one after the other.
    static inline void render_solids(const Movables& movables, Packet& packet, Taken taken, WarpMemory& memory) {
        const int lane = Warp::lane(), m = memory.objects.movable(taken.item);
        bool outside = false;
        Warp::sync();
        if (lane < taken.solids) {
            outside = !is_cut(memory.cameras[WarpMemory::WORLD], movables, m) &&
                      memory.solids[lane].set_up(memory.cameras[WarpMemory::WORLD], movables.pose(m),
                                                 __ldg(movables.solid + m), movables.solid_size(m),
                                                 __ldg(movables.first_id + m));
            if (!outside) {  // the camera is inside: the triangles are drawn later instead
                memory.objects.visits[taken.item] = taken.visit;
                memory.objects.unset_solid(taken.item);
            }
        }
        Warp::sync();
        for (unsigned remaining = Warp::ballot(outside); remaining; remaining = Warp::without_first_lane(remaining)) {
            const int k = Warp::first_lane(remaining);
            const unsigned blocks = Walk::open_blocks(packet, Warp::shuffle(taken.visit, k));
            if (blocks) memory.solids[k].render(memory.cameras[WarpMemory::WORLD], packet, blocks);
        }
        Warp::sync();
    }
};
