// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Objects that move: each has a BVH in its own frame, drawn by a camera that is moved into that frame. Depth and pixels
// are the same there.

// Movable objects that a packet may see and that are not drawn yet, some at a time.
struct ObjectQueue {
    enum { SIZE = MOVABLE ? 256 : 1, WORDS = (SIZE + LANES - 1) / LANES };

    unsigned visits[SIZE];
    unsigned solids[WORDS];  // a bit each: whether its true surface is drawn

    inline bool is_solid(int at) const { return solids[at / LANES] >> (at % LANES) & 1; }
    // It is drawn by its triangles.
    inline void unset_solid(int at) { atomicAnd(solids + at / LANES, ~(1u << at % LANES)); }
};

enum {
    BVH_STACK = LEVELS - 1,  // all levels of nodes but the last
    SOLIDS_AT_A_TIME = (int)(BVH_STACK * sizeof(Walk::Level) / sizeof(Solid)),  // as many as have room there
};
static_assert(SOLIDS_AT_A_TIME >= 1 && SOLIDS_AT_A_TIME <= (int)LANES, "a lane sets up a solid");

// A warp's shared memory.
struct WarpMemory {
    Camera world;
    Triangle triangle;
    union {  // of a BVH, or of solids
        Walk::Level levels[BVH_STACK];
        Solid solids[SOLIDS_AT_A_TIME];
    };
    unsigned triangles[TriangleQueue::SIZE];
    Key z_buffer[Packet::PIXELS];
    Camera moved;  // into the frame of an object
    ObjectQueue objects;
};
static_assert(sizeof(WarpMemory) <= 48 * 1024, "what a block may have without asking for more");

// How much wider a box is in the frame of an object, by the rounding of the camera's distance.
constexpr float MOVED_BOX_SLACK = 1e-6f;

struct ObjectPass {
    // In single precision, which is enough for a box: one lane an object.
    static inline unsigned visit(const Camera& world, const Packet& packet, const Movables& movables, int m) {
        const int object = __ldg(movables.object + m);
        const bool shown = !(movables.excluded && object >= 0 && movables.excluded[object]);
        Vec3 axis[3];
        const Vec3 origin = camera_there(world, movables.pose(m), axis);
        const Vec3 rows[3] = {inside(axis, world.to_camera[0]), inside(axis, world.to_camera[1]),
                              inside(axis, world.to_camera[2])};
        const float* box = movables.box(m);
        // As much wider as the origin may be wrong.
        const float margin = MOVED_BOX_SLACK * (fabsf(origin.x) + fabsf(origin.y) + fabsf(origin.z));
        const Vec3 wider = {margin, margin, margin};
        const Vec3 by = movables.factors(m);
        const Vec3 least = {Box::side(box, by.x), Box::side(box + 1, by.y), Box::side(box + 2, by.z)};
        const Vec3 most = {Box::side(box + 3, by.x), Box::side(box + 4, by.y), Box::side(box + 5, by.z)};
        const Vec3 low = Vec3::minus(Vec3::minus(least, origin), wider);
        const Vec3 high = Vec3::plus(Vec3::minus(most, origin), wider);
        return Walk::visit(world, rows, packet, low, high, shown);
    }
    static inline Vec3 inside(const Vec3* axis, Vec3 v) {
        return Vec3{Vec3::dot(axis[0], v), Vec3::dot(axis[1], v), Vec3::dot(axis[2], v)};
    }

    // Where the camera is in the frame of an object, and that frame's axes in the world, in single precision.
    static inline Vec3 camera_there(const Camera& world, const float* pose, Vec3* axis) {
        float x = __ldg(pose + 3), y = __ldg(pose + 4), z = __ldg(pose + 5), w = __ldg(pose + 6);
        const float scale = 1.0f / sqrtf(x * x + y * y + z * z + w * w);
        x *= scale, y *= scale, z *= scale, w *= scale;
        // As Pose::axes_of, which is in double precision.
        axis[0] = Vec3{1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)};
        axis[1] = Vec3{2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)};
        axis[2] = Vec3{2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)};
        return inside(axis, Vec3::minus(world.origin, Vec3{__ldg(pose), __ldg(pose + 1), __ldg(pose + 2)}));
    }

    // Whether the near plane may cut an object open: then its triangles are seen, whatever it is.
    static inline bool is_cut(const Camera& world, const Movables& movables, int m) {
        if (!NearPlane::clips()) return false;
        Vec3 axis[3];
        const Vec3 origin = camera_there(world, movables.pose(m), axis);
        return Box::holds(movables.box(m), movables.factors(m), origin, world.near);
    }

    // Move the world's camera into the frame of an object's triangles; a lane takes a coordinate of a ray, or of the
    // origin.
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
            (&moved.to_camera[row].x)[k] = (float)(value * world.focal_squared[row] * factor);
        } else if (row == 3) {
            const double there = Vec3d::dot(along, Vec3d::minus(world.exact_origin, PoseRow::position(pose)));
            const double value = RESIZED ? there / factor : there;
            (&moved.exact_origin.x)[k] = value;
            (&moved.origin.x)[k] = (float)value;
            (&moved.rest.x)[k] = (float)(value - (float)value);
        }
        Warp::sync();
        const Vec3 by = movables.factors(m), o = moved.origin;
        const Vec3 from = RESIZED ? Vec3{o.x * by.x, o.y * by.y, o.z * by.z} : o;
        const bool inside = Box::holds(movables.box(m), by, from, world.near);
        if (lane == 0) {
            moved.skip_back_faces = __ldg(movables.closed + m) && !inside;
            moved.cull_back_faces = cull || moved.skip_back_faces;
        }
        Warp::sync();
    }

    // Draw what stays and then the objects, the nearest first.
    static inline void draw(const Scene& scene, const View& view, Packet& packet, WarpMemory& memory) {
        const Movables& movables = scene.movables;
        Bvh bvh = scene.bvh;
        if (Warp::lane() == 0) memory.moved = memory.world;
        Warp::sync();
        QueuedRange queued = {0, 0};
        bool some = bvh.root >= 0;
        for (;;) {
            // One call for both, though the camera is the world's at first: the code of a walk is long.
            if (some) Walk::draw(bvh, memory.moved, packet, memory.levels, {memory.triangles, 0}, &memory.triangle);
            Warp::sync();
            const int m = draw_to_triangles(movables, packet, queued, memory);
            if (m < 0) return;
            move(memory.world, movables, m, view.cull_back_faces, memory.moved);
            bvh.root = __ldg(movables.root + m);
            bvh.first_id = movables.id_offset(m);
            bvh.excluded = __ldg(movables.object + m) < 0 ? scene.bvh.excluded : nullptr;
            some = true;
        }
    }

    // The objects that are in the queue, or have been.
    struct QueuedRange {
        int first, count;
    };

    // Draw solids until it is the turn of an object that is seen by its triangles, which is returned; -1 at the end.
    static inline int draw_to_triangles(const Movables& movables, Packet& packet, QueuedRange& queued,
                                        WarpMemory& memory) {
        for (;;) {
            const Taken taken = take(memory.objects, queued.count);
            if (taken.solids > 0) {
                draw_solids(movables, packet, queued.first, taken, memory);
            } else if (taken.solids < 0) {
                if (!Walk::hidden(packet, taken.visit)) return queued.first + taken.at;
            } else {
                queued.first += queued.count;
                queued.count = min(movables.count - queued.first, (int)ObjectQueue::SIZE);
                if (queued.count == 0) return -1;
                fill(movables, packet, queued, memory);
            }
        }
    }

    // Queue objects, a lane each.
    static inline void fill(const Movables& movables, const Packet& packet, QueuedRange queued, WarpMemory& memory) {
        const int lane = Warp::lane();
        Warp::sync();
        for (int i = lane; i < (queued.count + LANES - 1) / LANES * LANES; i += LANES) {
            const int m = queued.first + min(i, queued.count - 1);
            const unsigned found = visit(memory.world, packet, movables, m);
            const unsigned solids = Warp::ballot(__ldg(movables.solid + m) != SOLID_NONE);
            memory.objects.visits[i] = i < queued.count ? found : 0;
            if (lane == 0) memory.objects.solids[i / LANES] = solids;
        }
        Warp::sync();
    }

    // What is drawn next: so many solids, each of them a lane's, or, where `solids` is -1, an object by its triangles,
    // which is every lane's. 0 for nothing.
    struct Taken {
        int solids;
        int at;  // in the queue
        unsigned visit;
    };

    // Take the nearest objects from the queue: as many solids as there is room for, or, if that comes first, one that
    // is drawn by its triangles.
    static inline Taken take(ObjectQueue& queue, int count) {
        const int lane = Warp::lane();
        Taken mine = {0, 0, 0};
        while (mine.solids < SOLIDS_AT_A_TIME) {
            unsigned best = 0;
            int at = 0;
            for (int i = lane; i < count; i += LANES)
                if (queue.visits[i] > best) best = queue.visits[i], at = i;
            const unsigned next = Warp::reduce_max(best);
            if (next == 0) break;
            const int k = Warp::first_lane(Warp::ballot(best == next));
            const int found = Warp::shuffle(at, k);
            const bool solid = queue.is_solid(found);
            if (!solid && mine.solids > 0) break;
            if (lane == k) queue.visits[at] = 0;
            if (lane == mine.solids || !solid) mine.at = found, mine.visit = next;
            if (!solid) {
                mine.solids = -1;
                break;
            }
            ++mine.solids;
        }
        return mine;
    }

    // Each of the first lanes sets up a solid, then all draw one after the other.
    static inline void draw_solids(const Movables& movables, Packet& packet, int first, Taken taken,
                                   WarpMemory& memory) {
        const int lane = Warp::lane(), m = first + taken.at;
        bool outside = false;
        Warp::sync();
        if (lane < taken.solids) {
            outside = !is_cut(memory.world, movables, m) &&
                      memory.solids[lane].set_up(memory.world, movables.pose(m), __ldg(movables.solid + m),
                                                 movables.solid_size(m), __ldg(movables.first_id + m));
            if (!outside) {  // it is triangles that are seen, and it is still to be drawn
                memory.objects.visits[taken.at] = taken.visit;
                memory.objects.unset_solid(taken.at);
            }
        }
        Warp::sync();
        for (unsigned left = Warp::ballot(outside); left; left = Warp::without_first_lane(left)) {
            const int k = Warp::first_lane(left);
            const unsigned blocks = Walk::open_blocks(packet, Warp::shuffle(taken.visit, k));
            if (blocks) memory.solids[k].draw(memory.world, packet, blocks);
        }
        Warp::sync();
    }
};
