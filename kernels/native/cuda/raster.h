// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// A packet's pixels, in shared memory, and how triangles are drawn into them: small ones a lane each, larger ones by all
// lanes together, a block of 8 x 4 pixels at a time.

struct Packet {
    Key* nearest;  // [block][pixel]
    int first_x, first_y;  // in the view
    unsigned block_least;  // least w of this lane's block, in bits
    unsigned stale;  // blocks where that may be more by now

    // Where a pixel is. Blocks of one row begin at different banks, so that a row of pixels is read without conflict.
    static inline int slot(int block, int pixel) {
        return block * 32 + ((pixel + block % BLOCK_COLUMNS * (32 / BLOCK_COLUMNS)) & 31);
    }
    static inline int block_of(int x, int y) { return (y >> 2) * BLOCK_COLUMNS + (x >> 3); }
    static inline int slot_at(int x, int y) { return slot(block_of(x, y), (y & 3) * 8 + (x & 7)); }
    static inline int block_x(int block) { return block % BLOCK_COLUMNS * 8; }
    static inline int block_y(int block) { return block / BLOCK_COLUMNS * 4; }

    // Nothing seen yet. What lies outside the image counts as very near, so that it hides and never shows.
    inline void begin(int columns, int rows) {
        const int lane = Warp::lane();
        for (int block = 0; block < BLOCKS; ++block) {
            const bool inside = block_x(block) + (lane & 7) < columns && block_y(block) + (lane >> 3) < rows;
            nearest[slot(block, lane)] = Nearest::key(inside ? 0.0f : 3e38f, 0xffffffffu);
        }
        const bool seen = lane < BLOCKS && block_x(lane) < columns && block_y(lane) < rows;
        block_least = __float_as_uint(seen ? 0.0f : 3e38f);
        stale = 0;
        Warp::sync();
    }

    inline void refresh() {
        const int lane = Warp::lane();
        for (unsigned left = stale; left; left = Warp::without_first(left)) {
            const int block = Warp::first_of(left);
            const unsigned least = Warp::least(Nearest::w_bits(nearest[slot(block, lane)]));
            if (lane == block) block_least = least;
        }
        stale = 0;
    }
};

struct Raster {
    // A triangle of at most this many pixels is drawn by its lane alone, if enough others are.
    enum { SMALL_AREA = 64, STEPS_PER_LANE = 5 };

    // Draw each lane's triangle, of the first so many lanes. `slot` has room for one.
    static inline void draw(const Tree& tree, const Eye& eye, Packet& packet, const Triangle& t, int count,
                            Triangle* slot) {
        const int lane = Warp::lane();
        const int area = lane < count ? (t.x1 - t.x0 + 1) * (t.y1 - t.y0 + 1) : 0;
        const bool small = area > 0 && area <= SMALL_AREA;
        unsigned larger = Warp::lanes_where(area > 0);
        const unsigned small_lanes = Warp::lanes_where(small);
        if (small_lanes) {
            const int steps = Warp::most(small ? area : 0);
            if (steps <= STEPS_PER_LANE * __popc(small_lanes)) {
                draw_small(tree, eye, packet, t, small ? area : 0, steps);
                larger &= ~small_lanes;
            }
        }
        for (; larger; larger = Warp::without_first(larger)) {
            if (lane == Warp::first_of(larger)) *slot = t;
            Warp::sync();
            draw_large(tree, eye, packet, *slot);
            Warp::sync();
        }
        packet.refresh();
    }

    // Each lane goes through the pixels of its own triangle's bounds, all lanes at the same time.
    static inline void draw_small(const Tree& tree, const Eye& eye, Packet& packet, const Triangle& t, int area,
                                  int steps) {
        unsigned touched = 0;
        int x = t.x0, y = t.y0;
        // The same as floats, in the view: whole numbers, so that counting them up is exact.
        const float first_x = Whole::of(packet.first_x + x);
        float view_x = first_x, view_y = Whole::of(packet.first_y + y);
        for (int step = 0; step < steps; ++step) {
            if (step < area) {
                const float u = view_x + eye.first_u, v = view_y + eye.first_v;
                if (t.covers(u, v)) {
                    const float w =
                        t.exact ? t.clamp(ExactPlane::of(eye, tree.corners(t.place)).at(u, v)) : t.w_at(u, v);
                    const Key key = Nearest::key(w, t.place + tree.first_id);
                    Key* at = packet.nearest + Packet::slot_at(x, y);
                    if (key > *at) {
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
        packet.stale |= Warp::united(touched);
        Warp::sync();
    }

    // All lanes on one triangle: first each on a block, to see which are touched, then each on a pixel of those.
    static inline void draw_large(const Tree& tree, const Eye& eye, Packet& packet, const Triangle t) {
        const int lane = Warp::lane();
        const int block_x = Packet::block_x(lane), block_y = Packet::block_y(lane);
        const float u0 = Whole::of(packet.first_x + block_x) + eye.first_u,
                    u1 = Whole::of(packet.first_x + block_x + 7) + eye.first_u;
        const float v0 = Whole::of(packet.first_y + block_y) + eye.first_v,
                    v1 = Whole::of(packet.first_y + block_y + 3) + eye.first_v;
        bool touched =
            lane < BLOCKS && block_x + 7 >= t.x0 && block_x <= t.x1 && block_y + 3 >= t.y0 && block_y <= t.y1;
        bool covered = true;
        for (int e = 0; e < 3; ++e) {
            // An edge's value is greatest, and least, at corners of a block. Rounding keeps the order, so that the test
            // of the corner pixel never contradicts that of another pixel.
            const bool right = t.edge[e].u >= 0.0f, down = t.edge[e].v >= 0.0f;
            touched &= t.edge[e].at(right ? u1 : u0, down ? v1 : v0) >= 0.0f;
            covered &= t.edge[e].at(right ? u0 : u1, down ? v0 : v1) >= 0.0f;
        }
        const float near_w = t.exact ? t.most_w : t.w_at(t.slope_u >= 0.0f ? u1 : u0, t.slope_v >= 0.0f ? v1 : v0);
        touched &= __float_as_uint(near_w) >= packet.block_least;
        const unsigned whole = Warp::lanes_where(covered);
        const unsigned blocks = Warp::lanes_where(touched);
        if (!blocks) return;
        packet.stale |= blocks;
        const unsigned id = t.place + tree.first_id;
        if (t.exact) {
            const ExactPlane plane = ExactPlane::of(eye, tree.corners(t.place));
            for (unsigned left = blocks; left; left = Warp::without_first(left)) {
                const int block = Warp::first_of(left);
                float u, v;
                pixel(eye, packet, block, u, v);
                put(packet, block, (whole >> block & 1) || t.covers(u, v), t.clamp(plane.at(u, v)), id);
            }
        } else {
            for (unsigned left = blocks; left; left = Warp::without_first(left)) {
                const int block = Warp::first_of(left);
                float u, v;
                pixel(eye, packet, block, u, v);
                put(packet, block, (whole >> block & 1) || t.covers(u, v), t.w_at(u, v), id);
            }
        }
    }

    // This lane's pixel of a block.
    static inline void pixel(const Eye& eye, const Packet& packet, int block, float& u, float& v) {
        const int lane = Warp::lane();
        u = Whole::of(packet.first_x + Packet::block_x(block) + (lane & 7)) + eye.first_u;
        v = Whole::of(packet.first_y + Packet::block_y(block) + (lane >> 3)) + eye.first_v;
    }

    static inline void put(Packet& packet, int block, bool inside, float w, unsigned id) {
        Key* at = packet.nearest + Packet::slot(block, Warp::lane());
        const Key key = Nearest::key(w, id);
        if (inside && key > *at) *at = key;
    }
};

// Triangles that wait until there are enough for all lanes. Of most leaves, only few are seen.
struct Queue {
    unsigned* places;  // two for a lane
    int count;

    inline void add(bool wanted, unsigned place) {
        const unsigned lanes = Warp::lanes_where(wanted);
        if (wanted) places[count + __popc(lanes & ((1u << Warp::lane()) - 1))] = place;
        count += __popc(lanes);
        Warp::sync();
    }

    // One for each lane, as far as there are; the others wait on.
    inline int take(unsigned& place) {
        const int lane = Warp::lane(), taken = min(count, (int)LANES);
        place = places[min(lane, taken - 1)];
        count -= taken;
        const unsigned next = places[LANES + lane];
        Warp::sync();
        places[lane] = next;
        Warp::sync();
        return taken;
    }
};
