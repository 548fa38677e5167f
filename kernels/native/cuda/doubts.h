// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Pixels where single precision leaves in doubt whether a triangle covers them: double precision decides (see
// shared/edges.h). They are rare. So they are noted, and drawn many at a time, by code that takes neither registers nor
// room for instructions from what is always done.

// Those that are noted, in shared memory.
struct Doubts {
    // As many as are drawn at a time, and how many are enough for that: a warp's memory is short.
    enum { SIZE = LANES, ENOUGH = SIZE / 2 };

    unsigned slots[SIZE];  // of triangles in the leaves
    unsigned short pixels[SIZE];  // of the packet
    int count;  // of all, also of those that there was no room for

    // Any lanes call this.
    inline void add(unsigned slot, int x, int y) {
        const int at = atomicAdd(&count, 1);
        if (at < SIZE) slots[at] = slot, pixels[at] = (unsigned short)(y * PACKET_WIDTH + x);
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

    // What the z-buffer keeps of a triangle where a ray passes, if the ray meets it, on its edges too, by a side that
    // is drawn; 0 if not.
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
        if (!camera.draws_side(owner, volume) || !seen.meet(ray, volume)) return 0;
        float zmin, zmax;
        depths(camera, seen, zmin, zmax);
        const float least = 1.0f / zmax, most = zmin > 0.0f ? fminf(1.0f / zmin, MOST_INV_Z) : MOST_INV_Z;
        const float inv_z = fmaxf(fminf((float)(ExactCorners::dot(normal, ray) / volume), most), least);
        return camera.near.shows(inv_z, camera.near.cuts(most)) ? DepthKey::of(inv_z, id) : 0;
    }
    // No point of a triangle is nearer or farther than its corners.
    static inline void depths(const Camera& camera, const ExactCorners& seen, float& zmin, float& zmax) {
        const Vec3 forward = camera.to_camera[2];
        float z[3];
        for (int k = 0; k < 3; ++k)
            z[k] =
                Vec3::dot(forward, Vec3{(float)seen.corner[k][0], (float)seen.corner[k][1], (float)seen.corner[k][2]});
        zmin = Three::min(z[0], z[1], z[2]), zmax = Three::max(z[0], z[1], z[2]);
    }

    // Draw what is noted, a lane each, and where there was no room for all of it, what is in doubt of the last
    // triangles. Returns the blocks that were drawn into.
    static __noinline__ unsigned draw(const Bvh bvh, const Camera* camera, const Packet packet, Doubts* doubts,
                                      const unsigned* last_slots) {
        const int count = doubts->count, lane = Warp::lane();
        unsigned touched = 0;
        if (lane < count) {
            const int pixel = doubts->pixels[lane];
            touched = draw_pixel(bvh, *camera, packet, doubts->slots[lane], pixel % PACKET_WIDTH, pixel / PACKET_WIDTH);
        }
        for (int k = 0; count > Doubts::SIZE && k < LANES; ++k)
            touched |= draw_triangle(bvh, *camera, packet, last_slots[k]);
        touched = Warp::reduce_or(touched);
        if (lane == 0) doubts->count = 0;
        Warp::sync();
        return touched;
    }

    // What is in doubt of a triangle that all lanes have: each a pixel of a block.
    static inline unsigned draw_triangle(const Bvh& bvh, const Camera& camera, const Packet& packet, unsigned slot) {
        const Triangle t = Setup::triangle(bvh, camera, packet.first_x, packet.first_y, slot);
        unsigned touched = 0;
        for (int block = 0; block < SLOT_BLOCKS; ++block) {
            const int x = Packet::block_x(block) + Packet::pixel_x(Warp::lane()),
                      y = Packet::block_y(block) + Packet::pixel_y(Warp::lane());
            const RayPlace p = packet.point(camera, x, y, Packet::index(block, Warp::lane()));
            const bool inside = POINTS ? t.x0 <= t.x1 : x >= t.x0 && x <= t.x1 && y >= t.y0 && y <= t.y1;
            const float within = t.within(p);
            if (inside && within >= -t.doubt && (within <= t.doubt || camera.origins.may_hide(t.max_inv_z)))
                touched |= draw_pixel(bvh, camera, packet, slot, x, y);
        }
        return touched;
    }

    // Returns the block that was drawn into, as a bit.
    static inline unsigned draw_pixel(const Bvh& bvh, const Camera& camera, const Packet& packet, unsigned slot, int x,
                                      int y) {
        const int index = Packet::index_at(x, y);
        Key* at = packet.at(index);
        const Key found = key(camera, bvh.corners(slot), bvh.owners + slot, slot + bvh.first_id,
                              packet.exact_point(camera, x, y, index));
        if (found <= *at || packet.begins_behind(found, index)) return 0;
        atomicMax(at, found);
        return 1u << Packet::block_of(x, y);
    }
};
