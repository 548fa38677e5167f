// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// A packet's pixels, in shared memory, and how triangles are drawn into them: small ones a lane each, larger ones by
// all lanes together, a block of pixels at a time.

struct Packet {
    enum { PIXELS = BLOCKS * LANES, NO_TRIANGLE = 0xffffffffu };

    Key* z_buffer;  // [block][pixel]
    int first_x, first_y;  // in the view
    unsigned block_min_inv_z;  // least 1 / z of this lane's block, as bits
    unsigned stale_blocks;  // blocks where that may be more by now

    // Where a pixel is. Blocks of one row begin at different banks, so that a row of pixels is read without conflict.
    static inline int index(int block, int pixel) {
        return block * LANES + ((pixel + block % BLOCK_COLUMNS * (LANES / BLOCK_COLUMNS)) & (LANES - 1));
    }
    static inline int block_of(int x, int y) {
        return (y >> BLOCK_HEIGHT_BITS) * BLOCK_COLUMNS + (x >> BLOCK_WIDTH_BITS);
    }
    static inline int index_at(int x, int y) {
        return index(block_of(x, y), (y & (BLOCK_HEIGHT - 1)) * BLOCK_WIDTH + (x & (BLOCK_WIDTH - 1)));
    }
    static inline int block_x(int block) { return block % BLOCK_COLUMNS * BLOCK_WIDTH; }
    static inline int block_y(int block) { return block / BLOCK_COLUMNS * BLOCK_HEIGHT; }
    // A lane's pixel in a block.
    static inline int pixel_x(int lane) { return lane & (BLOCK_WIDTH - 1); }
    static inline int pixel_y(int lane) { return lane >> BLOCK_WIDTH_BITS; }

    inline unsigned inv_z_bits(int x, int y) const { return DepthKey::inv_z_bits(z_buffer[index_at(x, y)]); }

    // Nothing seen yet. What lies outside the image counts as very near, so that it hides and never shows.
    inline void begin(int columns, int rows) {
        const int lane = Warp::lane();
        for (int block = 0; block < BLOCKS; ++block) {
            const bool inside = block_x(block) + pixel_x(lane) < columns && block_y(block) + pixel_y(lane) < rows;
            z_buffer[index(block, lane)] = DepthKey::of(inside ? 0.0f : NOWHERE, NO_TRIANGLE);
        }
        const bool seen = lane < BLOCKS && block_x(lane) < columns && block_y(lane) < rows;
        block_min_inv_z = __float_as_uint(seen ? 0.0f : NOWHERE);
        stale_blocks = 0;
        Warp::sync();
    }

    // Look again at the blocks that were drawn into.
    inline void refresh() {
        const int lane = Warp::lane();
        for (unsigned left = stale_blocks; left; left = Warp::without_first_lane(left)) {
            const int block = Warp::first_lane(left);
            const unsigned least = Warp::reduce_min(DepthKey::inv_z_bits(z_buffer[index(block, lane)]));
            if (lane == block) block_min_inv_z = least;
        }
        stale_blocks = 0;
    }
};

// What single precision leaves in doubt, drawn when the rest is: it is rare, and its numbers would take registers from
// what is always done.
struct Again {
    // All lanes on one triangle, a lane a pixel of a block.
    static inline void draw(const Bvh& bvh, const Camera& camera, Packet& packet, unsigned slot) {
        const float* corners = bvh.corners(slot);
        const Setup::CameraTriangle c = Setup::CameraTriangle::of(camera, corners);
        const Setup::Rounding rounding = c.rounding(camera);
        const bool edge_on = fabsf(c.volume) < rounding.volume;
        const float facing = edge_on ? Exactly::volume(camera, corners) : c.volume;
        const bool shown = !edge_on || Setup::faces(camera, __ldg(bvh.owners + slot), facing);
        Triangle t = Setup::seen(c, camera, packet.first_x, packet.first_y, slot, facing, shown);
        t.doubt = rounding.edge;
        t.exact = t.exact || edge_on;
        const int lane = Warp::lane();
        for (int block = 0; block < BLOCKS; ++block) {
            const int x = Packet::block_x(block) + Packet::pixel_x(lane),
                      y = Packet::block_y(block) + Packet::pixel_y(lane);
            const bool inside = x >= t.x0 && x <= t.x1 && y >= t.y0 && y <= t.y1;
            if (inside) pixel(bvh, camera, packet, t, edge_on, block, x, y);
            packet.stale_blocks |= (unsigned)Warp::any(inside) << block;
        }
        Warp::sync();
        packet.refresh();
    }

    // This lane's pixel of a block, if it is in doubt or if `all` are wanted, and covered.
    static inline void pixel(const Bvh& bvh, const Camera& camera, Packet& packet, const Triangle& t, bool all,
                             int block, int x, int y) {
        const float* corners = bvh.corners(t.slot);
        const float view_x = SmallInt::to_float(packet.first_x + x), view_y = SmallInt::to_float(packet.first_y + y);
        const float u = view_x + camera.first_u, v = view_y + camera.first_v, within = t.within(u, v);
        if (within < -t.doubt || !(all || within <= t.doubt)) return;
        if (within <= t.doubt && !Exactly::covers(camera, corners, packet.first_x + x, packet.first_y + y)) return;
        const double exact_u = (double)view_x + camera.first_u, exact_v = (double)view_y + camera.first_v;
        const float inv_z = t.exact ? t.clamp(ExactPlane::of(camera, corners).at(exact_u, exact_v)) : t.inv_z_at(u, v);
        Key* at = packet.z_buffer + Packet::index(block, Warp::lane());
        const Key key = DepthKey::of(inv_z, t.slot + bvh.first_id);
        if (camera.near.shows(inv_z, camera.near.cuts(t.max_inv_z)) && key > *at) *at = key;
    }
};

struct Raster {
    // A triangle of at most this many pixels is drawn by its lane alone, if enough others are.
    enum { SMALL_AREA = 64, STEPS_PER_LANE = 5 };

    // Draw each lane's triangle, of the first so many lanes. `broadcast` has room for one. Returns the lanes of which
    // something is in doubt, and was not drawn.
    static inline unsigned draw(const Bvh& bvh, const Camera& camera, Packet& packet, const Triangle& t, int count,
                                Triangle* broadcast) {
        const int lane = Warp::lane();
        unsigned unsure = Warp::ballot(lane < count && t.edge_on);
        const int area = lane < count ? (t.x1 - t.x0 + 1) * (t.y1 - t.y0 + 1) : 0;
        const bool small = area > 0 && area <= SMALL_AREA;
        unsigned larger = Warp::ballot(area > 0);
        const unsigned small_lanes = Warp::ballot(small);
        if (small_lanes) {
            const int steps = Warp::reduce_max(small ? area : 0);
            if (steps <= STEPS_PER_LANE * __popc(small_lanes)) {
                unsure |= draw_small(bvh, camera, packet, t, small ? area : 0, steps);
                larger &= ~small_lanes;
            }
        }
        for (; larger; larger = Warp::without_first_lane(larger)) {
            const int k = Warp::first_lane(larger);
            if (lane == k) *broadcast = t;
            Warp::sync();
            unsure |= (unsigned)draw_large(bvh, camera, packet, *broadcast) << k;
            Warp::sync();
        }
        packet.refresh();
        return unsure;
    }

    // Each lane goes through the pixels of its own triangle's bounds, all lanes at the same time. Returns the lanes of
    // which some are in doubt.
    static inline unsigned draw_small(const Bvh& bvh, const Camera& camera, Packet& packet, const Triangle& t, int area,
                                      int steps) {
        unsigned touched = 0;
        bool unsure = false;
        const bool cut = camera.near.cuts(t.max_inv_z);
        int x = t.x0, y = t.y0;
        // The same as floats, in the view: whole numbers, so that counting them up is exact.
        const float first_x = SmallInt::to_float(packet.first_x + x);
        float view_x = first_x, view_y = SmallInt::to_float(packet.first_y + y);
        for (int step = 0; step < steps; ++step) {
            if (step < area) {
                const float u = view_x + camera.first_u, v = view_y + camera.first_v;
                const float within = t.within(u, v);
                unsure |= fabsf(within) <= t.doubt;
                if (within > t.doubt) {
                    const float inv_z =
                        t.exact ? t.clamp(ExactPlane::of(camera, bvh.corners(t.slot))
                                              .at((double)view_x + camera.first_u, (double)view_y + camera.first_v))
                                : t.inv_z_at(u, v);
                    const Key key = DepthKey::of(inv_z, t.slot + bvh.first_id);
                    Key* at = packet.z_buffer + Packet::index_at(x, y);
                    if (camera.near.shows(inv_z, cut) && key > *at) {
                        atomicMax(at, key);
                        touched |= 1u << Packet::block_of(x, y);
                    }
                }
                ++x;
                view_x += 1.0f;
                if (x > t.x1) {
                    x = t.x0;
                    view_x = first_x;
                    ++y;
                    view_y += 1.0f;
                }
            }
        }
        packet.stale_blocks |= Warp::reduce_or(touched);
        Warp::sync();
        return Warp::ballot(unsure);
    }

    // All lanes on one triangle: first each on a block, to see which are touched, then each on a pixel of those.
    // Returns whether some of these are in doubt.
    static inline bool draw_large(const Bvh& bvh, const Camera& camera, Packet& packet, const Triangle t) {
        const int lane = Warp::lane();
        const int block_x = Packet::block_x(lane), block_y = Packet::block_y(lane);
        const float u0 = SmallInt::to_float(packet.first_x + block_x) + camera.first_u,
                    u1 = SmallInt::to_float(packet.first_x + block_x + BLOCK_WIDTH - 1) + camera.first_u;
        const float v0 = SmallInt::to_float(packet.first_y + block_y) + camera.first_v,
                    v1 = SmallInt::to_float(packet.first_y + block_y + BLOCK_HEIGHT - 1) + camera.first_v;
        bool touched = lane < BLOCKS && block_x + BLOCK_WIDTH - 1 >= t.x0 && block_x <= t.x1 &&
                       block_y + BLOCK_HEIGHT - 1 >= t.y0 && block_y <= t.y1;
        bool covered = true;
        for (int e = 0; e < 3; ++e) {
            // An edge's value is greatest, and least, at corners of a block. Rounding keeps the order, so that the test
            // of the corner pixel never contradicts that of another pixel.
            const bool right = t.edge[e].u >= 0.0f, down = t.edge[e].v >= 0.0f;
            touched &= t.edge[e].at(right ? u1 : u0, down ? v1 : v0) >= -t.doubt;
            covered &= t.edge[e].at(right ? u0 : u1, down ? v0 : v1) > t.doubt;
        }
        const float nearest_inv_z =
            t.exact ? t.max_inv_z : t.inv_z_at(t.slope_u >= 0.0f ? u1 : u0, t.slope_v >= 0.0f ? v1 : v0);
        touched &= __float_as_uint(nearest_inv_z) >= packet.block_min_inv_z;
        const unsigned whole = Warp::ballot(covered);
        const unsigned blocks = Warp::ballot(touched);
        if (!blocks) return false;
        packet.stale_blocks |= blocks;
        const unsigned id = t.slot + bvh.first_id;
        const bool cut = camera.near.cuts(t.max_inv_z);
        bool unsure = false;
        if (t.exact) {
            const ExactPlane plane = ExactPlane::of(camera, bvh.corners(t.slot));
            for (unsigned left = blocks; left; left = Warp::without_first_lane(left)) {
                const int block = Warp::first_lane(left);
                float u, v;
                pixel(camera, packet, block, u, v);
                const float within = whole >> block & 1 ? NOWHERE : t.within(u, v);
                const int x = packet.first_x + Packet::block_x(block) + Packet::pixel_x(lane),
                          y = packet.first_y + Packet::block_y(block) + Packet::pixel_y(lane);
                const float inv_z = plane.at(x + (double)camera.first_u, y + (double)camera.first_v);
                unsure |= fabsf(within) <= t.doubt;
                put(camera, packet, block, within > t.doubt, t.clamp(inv_z), id, cut);
            }
        } else {
            for (unsigned left = blocks; left; left = Warp::without_first_lane(left)) {
                const int block = Warp::first_lane(left);
                float u, v;
                pixel(camera, packet, block, u, v);
                const float within = whole >> block & 1 ? NOWHERE : t.within(u, v);
                unsure |= fabsf(within) <= t.doubt;
                put(camera, packet, block, within > t.doubt, t.inv_z_at(u, v), id, cut);
            }
        }
        return Warp::any(unsure);
    }

    // This lane's pixel of a block.
    static inline void pixel(const Camera& camera, const Packet& packet, int block, float& u, float& v) {
        const int lane = Warp::lane();
        u = SmallInt::to_float(packet.first_x + Packet::block_x(block) + Packet::pixel_x(lane)) + camera.first_u;
        v = SmallInt::to_float(packet.first_y + Packet::block_y(block) + Packet::pixel_y(lane)) + camera.first_v;
    }

    static inline void put(const Camera& camera, Packet& packet, int block, bool inside, float inv_z, unsigned id,
                           bool cut) {
        Key* at = packet.z_buffer + Packet::index(block, Warp::lane());
        const Key key = DepthKey::of(inv_z, id);
        if (inside && camera.near.shows(inv_z, cut) && key > *at) *at = key;
    }
};

// Triangles that wait until there are enough for all lanes. Of most leaves, only few are seen.
struct TriangleQueue {
    enum { SIZE = 2 * LANES };  // less than a lane each waits when as many are added

    unsigned* slots;
    int count;

    inline void add(bool wanted, unsigned slot) {
        const unsigned lanes = Warp::ballot(wanted);
        if (wanted) slots[count + __popc(lanes & ((1u << Warp::lane()) - 1))] = slot;
        count += __popc(lanes);
        Warp::sync();
    }

    // One for each lane, as far as there are; the others wait on.
    inline int take(unsigned& slot) {
        const int lane = Warp::lane(), taken = min(count, (int)LANES);
        slot = slots[min(lane, taken - 1)];
        count -= taken;
        const unsigned next = slots[LANES + lane];
        Warp::sync();
        slots[lane] = next;
        Warp::sync();
        return taken;
    }
};
