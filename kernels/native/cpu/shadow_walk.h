// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Blocking of the points of packets by the triangles of a BVH and by objects with their own frames.
//
// A block of points traverses a tree together: nodes and triangles outside of the shaft from the block to the light are
// skipped, as are boxes that no ray of the block enters, and traversal ends when all points are blocked. Triangles in
// the shaft are tested in double precision, by their shadow volumes (shared/shadow_volumes.h): all of a leaf for one
// point after the other, or one after the other for all points of the block, whichever are fewer.

#pragma once

#include "cpu/scene.h"
#include "cpu/shadow_packet.h"

// Boxes of objects with their own frames in the world, in groups of 16.
struct ObjectBoxes {
    enum { GROUPS = 32, CAPACITY = GROUPS * LANES };

    int first, count;
    Points low[GROUPS], high[GROUPS];

    // Bound the objects from `first` on in the world of a view, as many as fit.
    inline void fill(const Movables& movables, const World& world, int from) {
        first = from;
        count = movables.count - from < CAPACITY ? movables.count - from : (int)CAPACITY;
        for (int i = 0; i < count; ++i) {
            float box[BOX_WORDS];
            bound(movables, world, first + i, box);
            Points& l = low[i / LANES];
            Points& h = high[i / LANES];
            l.x[i % LANES] = box[0], l.y[i % LANES] = box[1], l.z[i % LANES] = box[2];
            h.x[i % LANES] = box[3], h.y[i % LANES] = box[4], h.z[i % LANES] = box[5];
        }
    }
    static inline void bound(const Movables& movables, const World& world, int m, float* box) {
        const Pose pose = pose_of(movables, world, m);
        const float* local = movables.boxes + (long long)m * BOX_WORDS;
        double factors[3], extent[3];
        const bool is_solid = movables.solid[m] != SOLID_NONE;
        factors_of(movables, world, m, factors);
        if (is_solid) {
            const double half = solid_size(movables, world, m)[3];
            extent[0] = extent[1] = extent[2] = 1.0;
            if (movables.solid[m] != SOLID_BALL) extent[2] = half + (movables.solid[m] == SOLID_CAPSULE ? 1.0 : 0.0);
        }
        double middle[3] = {pose.position[0], pose.position[1], pose.position[2]}, half[3] = {0, 0, 0};
        for (int i = 0; i < 3; ++i) {
            const double low = is_solid ? -extent[i] : local[i], high = is_solid ? extent[i] : local[3 + i];
            for (int k = 0; k < 3; ++k) {
                middle[k] += pose.axis[i][k] * factors[i] * 0.5 * (low + high);
                half[k] += __builtin_fabs(pose.axis[i][k] * factors[i] * 0.5 * (high - low));
            }
        }
        for (int k = 0; k < 3; ++k) {
            const double margin = 1e-6 * (__builtin_fabs(middle[k]) + half[k]);
            box[k] = (float)(middle[k] - half[k] - margin), box[3 + k] = (float)(middle[k] + half[k] + margin);
        }
    }

    static inline Pose pose_of(const Movables& movables, const World& world, int m) {
        const bool moves = m < movables.moving;
        return Pose::from(moves ? world.poses + (long long)m * POSE_WORDS
                                : movables.instance_poses + (long long)(m - movables.moving) * POSE_WORDS);
    }
    static inline const float* solid_size(const Movables& movables, const World& world, int m) {
        const float* sizes = world.sizes && m < movables.moving ? world.sizes : movables.size;
        return sizes + (long long)m * SOLID_WORDS;
    }
    // The factors of a mesh along its axes, or the sizes of a solid.
    static inline void factors_of(const Movables& movables, const World& world, int m, double* factors) {
        const Stretch stretch = movables.stretch_of(m, world);
        for (int k = 0; k < 3; ++k)
            factors[k] = movables.solid[m] == SOLID_NONE ? stretch.factor[k] : solid_size(movables, world, m)[k];
    }
};

// Blocks the points of packets.
struct Blocker {
    // A node, or the complement of a leaf, and the points of a block whose rays may enter its box.
    struct Visit {
        int child;
        unsigned rays;
    };

    const Scene& scene;
    const World& world;
    Visit* stack;  // at most all children of a node on every level

    // Block points by the triangles of a tree. `owners` are null if no triangle is excluded.
    inline void tree(ShadowPacket& packet, int root, const int* owners) const {
        Children children = Children::of(scene.bvh, root, packet.center);
        if (!Lanes::any(children.meet(packet.shaft()))) return;
        for (int b = 0; b < ShadowPacket::BLOCKS; ++b)
            if (packet.active[b] != 0) block(packet, b, root, owners);
    }

    // Boxes of the children of a node, relative to a center.
    struct Children {
        Floats low[3], high[3];

        static inline Children of(const Bvh& bvh, int index, const double* center) {
            const float* node = bvh.node(index);
            Children children;
            for (int k = 0; k < 3; ++k) {
                children.low[k] = row(node, NODE_LOW_ROW + k) - (float)center[k];
                children.high[k] = row(node, NODE_HIGH_ROW + k) - (float)center[k];
            }
            return children;
        }
        inline Ints meet(const Shaft& shaft) const { return shaft.meets(low, high); }
    };
    static inline Floats row(const float* rows, int index) { return Lanes::load(rows + index * LANES); }

    // Block points of one block.
    inline void block(ShadowPacket& packet, int b, int root, const int* owners) const {
        const Shaft shaft = Shaft::of(packet.light, packet.block_center[b], packet.block_half[b]);
        const BlockRays rays = BlockRays::of(packet, b);
        const Bvh& bvh = scene.bvh;
        int depth = 0;
        stack[depth++] = Visit{root, packet.active[b]};
        while (depth > 0) {
            const Visit visit = stack[--depth];
            if ((visit.rays & packet.active[b]) == 0) continue;
            if (visit.child < 0) {
                leaf(packet, b, shaft, ~visit.child, visit.rays, owners);
                if (packet.active[b] == 0) return;
                continue;
            }
            const Children boxes = Children::of(bvh, visit.child, packet.center);
            float low[3][LANES], high[3][LANES];
            __builtin_memcpy(low, boxes.low, sizeof low);
            __builtin_memcpy(high, boxes.high, sizeof high);
            const int* children = bvh.children_of(visit.child);
            for (const int k : Lanes::each(boxes.meet(shaft))) {
                const unsigned entering = packet.active[b] & rays.enter(low, high, k);
                if (entering != 0) stack[depth++] = Visit{children[k], entering};
            }
        }
    }

    // Block points of a block, whose rays enter the box of a leaf, by its triangles.
    inline void leaf(ShadowPacket& packet, int b, const Shaft& shaft, long long index, unsigned rays,
                     const int* owners) const {
        typedef ShadowVolume<Doubles> Volume;
        const float* rows = scene.bvh.leaf(index);
        Floats low[3], high[3];
        for (int k = 0; k < 3; ++k) {
            low[k] = Lanes::all(NOWHERE), high[k] = Lanes::all(-NOWHERE);
            for (int c = 0; c < 3; ++c) {
                const Floats corner = row(rows, 3 * c + k) - (float)packet.center[k];
                low[k] = Lanes::min(low[k], corner), high[k] = Lanes::max(high[k], corner);
            }
        }
        unsigned found = Lanes::bits(shaft.meets(low, high));
        for (const int k : Lanes::each(owners ? found : 0u))
            if (world.excludes(Bvh::object_of(owners[index * LANES + k]))) found &= ~(1u << k);
        if (found == 0) return;
        Doubles corner[3][3];
        for (int c = 0; c < 3; ++c)
            for (int k = 0; k < 3; ++k)
                corner[c][k] = __builtin_convertvector(row(rows, 3 * c + k), Doubles) - packet.center[k];
        const Volume volume = Volume::of(corner, packet.light, packet.half[0] + packet.half[1] + packet.half[2]);
        Longs reaches = volume.greatest(0, packet.block_center[b], packet.block_half[b]) >= 0.0;
        for (int plane = 1; plane < Volume::PLANES; ++plane)
            reaches &= volume.greatest(plane, packet.block_center[b], packet.block_half[b]) >= 0.0;
        found &= ShadowPacket::bits_of(reaches);
        if (found == 0) return;
        rays &= packet.active[b];
        if (__builtin_popcount(rays) <= __builtin_popcount(found)) {
            double points[3][LANES], limits[LANES];
            __builtin_memcpy(points, packet.at[b], sizeof points);
            __builtin_memcpy(limits, &packet.limit[b], sizeof limits);
            for (const int ray : Lanes::each(rays)) {
                const Longs inside = volume.contains(points[0][ray], points[1][ray], points[2][ray], limits[ray]);
                if (ShadowPacket::bits_of(inside) & found) packet.active[b] &= ~(1u << ray);
            }
            return;
        }
        double planes[Volume::PLANES][4][LANES], steepness[LANES];
        __builtin_memcpy(planes, volume.plane, sizeof planes);
        __builtin_memcpy(steepness, &volume.steepness, sizeof steepness);
        const Doubles* p = packet.at[b];
        for (const int lane : Lanes::each(found)) {
            const auto value = [&](int plane) {
                const double (*n)[LANES] = planes[plane];
                return n[0][lane] * p[0] + n[1][lane] * p[1] + n[2][lane] * p[2] + n[3][lane];
            };
            const Doubles beyond = value(Volume::CAP);
            Longs inside = (beyond >= 0.0) & (beyond <= steepness[lane] * packet.limit[b]);
            for (int plane = 0; plane < Volume::CAP; ++plane) inside &= value(plane) >= 0.0;
            packet.active[b] &= ~ShadowPacket::bits_of(inside);
            if (packet.active[b] == 0) return;
        }
    }

    // Block points by objects with their own frames whose boxes the shaft meets.
    inline void objects(ShadowPacket& packet, const ObjectBoxes& boxes) const {
        const Shaft shaft = packet.shaft();
        const float center[3] = {(float)packet.center[0], (float)packet.center[1], (float)packet.center[2]};
        for (int first = 0; first < boxes.count; first += LANES) {
            const Points &low = boxes.low[first / LANES], &high = boxes.high[first / LANES];
            const Floats from[3] = {low.x - center[0], low.y - center[1], low.z - center[2]};
            const Floats to[3] = {high.x - center[0], high.y - center[1], high.z - center[2]};
            const Ints filled = Lanes::index() < boxes.count - first;
            for (const int k : Lanes::each(filled & shaft.meets(from, to)))
                if (object(packet, boxes.first + first + k)) return;
        }
    }
    // Block points by one object; returns whether all are blocked.
    inline bool object(ShadowPacket& packet, int m) const {
        const Movables& movables = scene.movables;
        const int owner = movables.object[m];
        if (world.excludes(owner)) return false;
        double factors[3];
        ObjectBoxes::factors_of(movables, world, m, factors);
        ShadowPacket local = packet.seen_from(ObjectBoxes::pose_of(movables, world, m), factors);
        if (movables.solid[m] != SOLID_NONE) {
            solid(local, movables.solid[m], ObjectBoxes::solid_size(movables, world, m)[3]);
        } else {
            local.bound();
            tree(local, movables.root[m], owner < 0 && world.excluded ? scene.bvh.owners : nullptr);
        }
        __builtin_memcpy(packet.active, local.active, sizeof packet.active);
        return !packet.any();
    }
    static inline void solid(ShadowPacket& packet, int kind, double half) {
        const LightPlace& light = packet.light;
        for (int r = 0; r < ShadowPacket::BLOCKS; ++r) {
            if (packet.active[r] == 0) continue;
            Doubles toward[3];
            for (int k = 0; k < 3; ++k)
                toward[k] = light.directional ? (Doubles)(light.at[k]) : light.at[k] - packet.at[r][k];
            const Doubles limit = light.directional ? packet.limit[r] : (Doubles)(1.0);
            const Longs blocked = SolidShadow<Doubles>::crosses(kind, half, packet.at[r], toward, limit);
            packet.active[r] &= ~ShadowPacket::bits_of(blocked);
        }
    }
};
