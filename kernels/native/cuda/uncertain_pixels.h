// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Pixels where single precision cannot decide whether a triangle covers them; they are decided in double precision (see
// shared/edges.h). They are rare, so they are recorded and drawn in batches by separate code, which adds neither
// registers nor instruction-cache pressure to the common path.

#pragma once

#include "cuda/image.h"

// The recorded pixels, in shared memory.
struct UncertainPixels {
    // Size of a batch, and the count from which a batch is drawn: a warp's shared memory is small.
    enum { SIZE = LANES, ENOUGH = SIZE / 2 };

    unsigned slots[SIZE];  // slots of triangles in the leaves
    unsigned short pixels[SIZE];  // pixels of the packet
    int count;  // count of all, including those that did not fit

    // May be called by any subset of lanes.
    inline void add(unsigned slot, int x, int y) {
        const int index = atomicAdd(&count, 1);
        if (index < SIZE) slots[index] = slot, pixels[index] = (unsigned short)(y * PACKET_WIDTH + x);
    }
};

struct Exactly {
    static inline ExactCorners corners(Vec3d start, const float* from) {
        const double origin[3] = {start.x, start.y, start.z};
        ExactCorners seen;
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < 3; ++i) seen.corner[k][i] = __ldg(from + (3 * k + i) * LANES) - origin[i];
        return seen;
    }

    // The z-buffer key of a triangle where a ray hits it, edges included, on a side that is drawn; 0 if the ray misses.
    static __noinline__ Key key(const Camera& camera, const float* from, const int* owner, unsigned id,
                                ExactRayPlace p) {
        const Vec3d* rays = camera.exact_rays;
        const double ray[3] = {p.u * rays[0].x + (p.v * rays[1].x + rays[2].x),
                               p.u * rays[0].y + (p.v * rays[1].y + rays[2].y),
                               p.u * rays[0].z + (p.v * rays[1].z + rays[2].z)};
        const ExactCorners seen = corners(Origins::start(p, camera.exact_origin, rays), from);
        double normal[3];
        seen.normal(normal);
        const double volume = seen.volume(normal);
        if (!camera.shows_side(owner, volume) || !seen.meet(ray, volume)) return 0;
        float zmin, zmax;
        depths(camera, seen, zmin, zmax);
        const float min_inv_z = 1.0f / zmax, max_inv_z = zmin > 0.0f ? fminf(1.0f / zmin, MAX_INV_Z) : MAX_INV_Z;
        const float inv_z = fmaxf(fminf((float)(ExactCorners::dot(normal, ray) / volume), max_inv_z), min_inv_z);
        return camera.near.shows(inv_z, camera.near.cuts(max_inv_z)) ? DepthKey::of(inv_z, id) : 0;
    }
    // Depth range of the corners; every point of the triangle lies within it.
    static inline void depths(const Camera& camera, const ExactCorners& seen, float& zmin, float& zmax) {
        const Vec3 forward = camera.to_camera[2];
        float z[3];
        for (int k = 0; k < 3; ++k)
            z[k] =
                Vec3::dot(forward, Vec3{(float)seen.corner[k][0], (float)seen.corner[k][1], (float)seen.corner[k][2]});
        zmin = Three::min(z[0], z[1], z[2]), zmax = Three::max(z[0], z[1], z[2]);
    }

    // Draw the recorded pixels, one per lane, and, if they did not all fit, all uncertain pixels of the last triangles.
    // Returns a bit mask of the blocks that were drawn into.
    static __noinline__ unsigned rasterize(const Bvh bvh, const Camera* camera, const Packet packet,
                                           UncertainPixels* uncertain, const unsigned* last_slots) {
        const int count = uncertain->count, lane = Warp::lane();
        unsigned touched = 0;
        if (lane < count) {
            const int pixel = uncertain->pixels[lane];
            touched = rasterize_pixel(bvh, *camera, packet, uncertain->slots[lane], pixel % PACKET_WIDTH,
                                      pixel / PACKET_WIDTH);
        }
        for (int k = 0; count > UncertainPixels::SIZE && k < LANES; ++k)
            touched |= rasterize_triangle(bvh, *camera, packet, last_slots[k]);
        touched = Warp::reduce_or(touched);
        if (lane == 0) uncertain->count = 0;
        Warp::sync();
        return touched;
    }

    // Draw the uncertain pixels of a triangle that is the same in all lanes: one pixel of a block per lane.
    static inline unsigned rasterize_triangle(const Bvh& bvh, const Camera& camera, const Packet& packet,
                                              unsigned slot) {
        const Triangle t = Setup::triangle(bvh, camera, packet.first_x, packet.first_y, slot);
        unsigned touched = 0;
        for (int block = 0; block < SLOT_BLOCKS; ++block) {
            const int x = Packet::block_x(block) + Packet::pixel_x(Warp::lane()),
                      y = Packet::block_y(block) + Packet::pixel_y(Warp::lane());
            const RayPlace p = packet.point(camera, x, y, Packet::index(block, Warp::lane()));
            const bool inside = POINTS ? t.x0 <= t.x1 : x >= t.x0 && x <= t.x1 && y >= t.y0 && y <= t.y1;
            const float within = t.within(p);
            if (inside && within >= -t.error_bound && (within <= t.error_bound || camera.origins.may_hide(t.max_inv_z)))
                touched |= rasterize_pixel(bvh, camera, packet, slot, x, y);
        }
        return touched;
    }

    // Returns the block that was drawn into, as a bit mask.
    static inline unsigned rasterize_pixel(const Bvh& bvh, const Camera& camera, const Packet& packet, unsigned slot,
                                           int x, int y) {
        const int index = Packet::index_at(x, y);
        Key* stored = packet.at(index);
        const Key found = key(camera, bvh.corners(slot), bvh.owners + slot, slot + bvh.first_id,
                              packet.exact_point(camera, x, y, index));
        if (found <= *stored || packet.begins_behind(found, index)) return 0;
        atomicMax(stored, found);
        return 1u << Packet::block_of(x, y);
    }
};
