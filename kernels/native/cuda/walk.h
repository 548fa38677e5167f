// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// A packet's way down the cluster tree: nearest first, past what is outside of it, faces away, or is hidden behind what
// has been drawn.

// What a lane holds of one child of a node, in a word that orders them: how near it may be, as the bits of 1 / z rounded
// up, and below them the blocks it may cover; 0 if there is nothing to visit.
struct Visit {
    enum { BLOCK_BITS = 10, BLOCK_MASK = (1 << BLOCK_BITS) - 1 };

    static inline unsigned of(float near_w, int x0, int y0, int x1, int y1) {
        const unsigned bits = (__float_as_uint(near_w) + BLOCK_MASK) & ~BLOCK_MASK;
        return bits | (x0 >> 3) | (x1 >> 3) << 2 | (y0 >> 2) << 4 | (y1 >> 2) << 7;
    }
    static inline bool touches(unsigned visit, int block) {
        const int bx = block % BLOCK_COLUMNS, by = block / BLOCK_COLUMNS;
        return bx >= (int)(visit & 3) && bx <= (int)(visit >> 2 & 3) && by >= (int)(visit >> 4 & 7) &&
               by <= (int)(visit >> 7 & 7);
    }
    static inline unsigned nearest(unsigned visit) { return visit & ~BLOCK_MASK; }
};

struct Walk {
    // Where a walk goes on when a node's child is done: what is left of the nodes above.
    struct Level {
        unsigned visit[LANES];
        int child[LANES];
    };

    // All triangles of the child face away: the directions from the camera to anywhere in its box make less than a right
    // angle with every normal in the cone.
    static inline bool faces_away(const float* node, Vec low, Vec high) {
        const Vec sum = Vec::plus(low, high), size = Vec::minus(high, low);
        const Vec axis = {__ldg(node + 6 * LANES), __ldg(node + 7 * LANES), __ldg(node + 8 * LANES)};
        // Both sides twice what they are: of the centre, and of half the diagonal.
        return Vec::dot(sum, axis) >=
               __ldg(node + 9 * LANES) * sqrtf(Vec::dot(sum, sum)) + 1.0001f * sqrtf(Vec::dot(size, size));
    }

    // How far along a direction a box reaches.
    static inline float farthest(Vec direction, Vec low, Vec high) {
        return fmaxf(direction.x * low.x, direction.x * high.x) + fmaxf(direction.y * low.y, direction.y * high.y) +
               fmaxf(direction.z * low.z, direction.z * high.z);
    }

    // Whether a box reaches into the packet's pyramid, by its five planes.
    static inline bool enters(const Eye& eye, const Vec* to_camera, const Packet& packet, Vec low, Vec high) {
        const Vec x = to_camera[0], y = to_camera[1], z = to_camera[2];
        const float u0 = (float)packet.first_x + eye.first_u - 0.5f, u1 = u0 + PACKET_WIDTH;
        const float v0 = (float)packet.first_y + eye.first_v - 0.5f, v1 = v0 + PACKET_HEIGHT;
        return farthest(z, low, high) >= 0.0f && farthest(combined(x, z, -u0, 1.0f), low, high) >= 0.0f &&
               farthest(combined(x, z, u1, -1.0f), low, high) >= 0.0f &&
               farthest(combined(y, z, -v0, 1.0f), low, high) >= 0.0f &&
               farthest(combined(y, z, v1, -1.0f), low, high) >= 0.0f;
    }
    static inline Vec combined(Vec x, Vec z, float of_z, float of_x) {
        return Vec{of_z * z.x + of_x * x.x, of_z * z.y + of_x * x.y, of_z * z.z + of_x * x.z};
    }

    // A box in the image, in pixels from the principal point.
    struct Projection {
        float left, right, top, bottom;
        float zmin;
        bool crossing;  // comes so near to the camera, or behind it, that it may be anywhere

        static inline Projection of(const Vec* m, Vec low, Vec high) {
            // The eight corners in camera space are sums of one term an axis.
            const Vec x[2] = {scaled(m, 0, low.x), scaled(m, 0, high.x)};
            const Vec y[2] = {scaled(m, 1, low.y), scaled(m, 1, high.y)};
            const Vec z[2] = {scaled(m, 2, low.z), scaled(m, 2, high.z)};
            Projection p;
            p.zmin = fminf(x[0].z, x[1].z) + fminf(y[0].z, y[1].z) + fminf(z[0].z, z[1].z);
            p.crossing = p.zmin <= 0.02f * (largest(x) + largest(y) + largest(z));
            p.left = p.top = 3e38f;
            p.right = p.bottom = -3e38f;
            for (int corner = 0; corner < 8; ++corner) {
                const Vec at = Vec::plus(Vec::plus(x[corner & 1], y[corner >> 1 & 1]), z[corner >> 2]);
                const float w = __fdividef(1.0f, at.z), u = at.x * w, v = at.y * w;
                p.left = fminf(p.left, u), p.right = fmaxf(p.right, u);
                p.top = fminf(p.top, v), p.bottom = fmaxf(p.bottom, v);
            }
            return p;
        }
        static inline Vec scaled(const Vec* rows, int axis, float by) {
            const float* m = &rows[0].x + axis;
            return Vec{m[0] * by, m[3] * by, m[6] * by};
        }
        static inline float largest(const Vec* terms) { return fmaxf(fabsf(terms[0].z), fabsf(terms[1].z)); }
    };

    // This lane's child of a node: 0 if it is not seen.
    static inline unsigned open(const Tree& tree, const Eye& eye, const Packet& packet, int index) {
        const float* node = tree.nodes + (long long)index * NODE_WORDS + Warp::lane();
        const Vec least = {__ldg(node), __ldg(node + LANES), __ldg(node + 2 * LANES)};
        const Vec most = {__ldg(node + 3 * LANES), __ldg(node + 4 * LANES), __ldg(node + 5 * LANES)};
        const Vec low = Eye::relative(eye, least), high = Eye::relative(eye, most);
        bool shown = least.x <= most.x;
        if (eye.skip_back_faces) shown = shown && !faces_away(node, low, high);
        return visit(eye, eye.to_camera, packet, low, high, shown);
    }

    // The visit of a box, given from the camera in a frame that turns into the camera's by three rows.
    static inline unsigned visit(const Eye& eye, const Vec* to_camera, const Packet& packet, Vec low, Vec high,
                                 bool shown) {
        if (!Warp::any(shown)) return 0;
        const Projection p = Projection::of(to_camera, low, high);
        // Pixels of the packet whose centres may be inside: more than rounding can be wrong.
        const float slack = 0.01f + 256.0f * eye.blur;
        const float to_x = eye.first_u + (float)packet.first_x, to_y = eye.first_v + (float)packet.first_y;
        const float left = fmaxf(p.crossing ? 0.0f : ceilf(p.left - to_x - slack), 0.0f);
        const float top = fmaxf(p.crossing ? 0.0f : ceilf(p.top - to_y - slack), 0.0f);
        const float right = fminf(p.crossing ? (float)PACKET_WIDTH : floorf(p.right - to_x + slack), PACKET_WIDTH - 1.0f);
        const float bottom = fminf(p.crossing ? (float)PACKET_HEIGHT : floorf(p.bottom - to_y + slack), PACKET_HEIGHT - 1.0f);
        shown = shown && p.zmin <= eye.far && left <= right && top <= bottom;
        if (shown && p.crossing) shown = enters(eye, to_camera, packet, low, high);
        const float near_w = p.crossing ? 3e38f : 1.00001f * __fdividef(1.0f, p.zmin);
        return shown ? Visit::of(near_w, (int)left, (int)top, (int)right, (int)bottom) : 0;
    }

    // Blocks that the child may cover and that have not been drawn nearer.
    static inline bool open_block(const Packet& packet, unsigned visit) {
        return Visit::touches(visit, Warp::lane()) && packet.block_least <= Visit::nearest(visit);
    }
    static inline unsigned open_blocks(const Packet& packet, unsigned visit) {
        return Warp::lanes_where(open_block(packet, visit));
    }
    static inline bool hidden(const Packet& packet, unsigned visit) { return !Warp::any(open_block(packet, visit)); }

    // Draw all that is seen of a tree. `levels` has room for every level of it but the last, `queue` is empty.
    static inline void draw(const Tree& tree, const Eye& eye, Packet& packet, Level* levels, Queue queue,
                            Triangle* slot) {
        const int lane = Warp::lane();
        int level = 0;
        bool at_once = false;  // whether what is queued must not wait
        unsigned visit = open(tree, eye, packet, tree.root);
        int child = __ldg(tree.children + (long long)tree.root * LANES + lane);
        for (;;) {
            if (queue.count >= LANES || (at_once && queue.count > 0)) {
                unsigned place;
                const int count = queue.take(place);
                const Triangle t = Setup::triangle(tree, eye, packet.first_x, packet.first_y, place);
                Raster::draw(tree, eye, packet, t, count, slot);
                continue;
            }
            at_once = false;
            const unsigned next = Warp::most(visit);
            if (next == 0) {
                if (level > 0) {
                    --level;
                    visit = levels[level].visit[lane];
                    child = levels[level].child[lane];
                    continue;
                }
                if (queue.count == 0) return;
                at_once = true;
                continue;
            }
            const int k = Warp::first_of(Warp::lanes_where(visit == next));
            if (lane == k) visit = 0;
            if (hidden(packet, next)) continue;
            const int index = Warp::from(child, k);
            if (index < 0) {
                const int area = Setup::area(tree, eye, packet.first_x, packet.first_y, ~index);
                queue.add(area > 0, ~index * LANES + lane);
                at_once = Warp::any(area > Raster::SMALL_AREA);  // it may hide what comes next
            } else {
                levels[level].visit[lane] = visit;
                levels[level].child[lane] = child;
                ++level;
                visit = open(tree, eye, packet, index);
                child = __ldg(tree.children + (long long)index * LANES + lane);
            }
        }
    }
};
