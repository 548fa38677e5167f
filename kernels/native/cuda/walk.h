// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// A packet's way down the BVH: nearest first, past what is outside of it, faces away, or is hidden behind what
// has been drawn.

// What a lane holds of one child of a node, in a word that orders them: how near it may be, as the bits of 1 / z
// rounded up, and below them the blocks it may cover; 0 if there is nothing to visit.
struct Visit {
    enum {
        COLUMN_BITS = 2,
        ROW_BITS = 3,
        BLOCK_BITS = 2 * (COLUMN_BITS + ROW_BITS),
        BLOCK_MASK = (1 << BLOCK_BITS) - 1,
        // Where the first and the last column and row are.
        X0 = 0,
        X1 = COLUMN_BITS,
        Y0 = 2 * COLUMN_BITS,
        Y1 = 2 * COLUMN_BITS + ROW_BITS,
    };

    static inline unsigned of(float nearest_inv_z, int x0, int y0, int x1, int y1) {
        const unsigned bits = (__float_as_uint(nearest_inv_z) + BLOCK_MASK) & ~BLOCK_MASK;
        const unsigned columns = (x0 >> BLOCK_WIDTH_BITS) << X0 | (x1 >> BLOCK_WIDTH_BITS) << X1;
        const unsigned rows = (y0 >> BLOCK_HEIGHT_BITS) << Y0 | (y1 >> BLOCK_HEIGHT_BITS) << Y1;
        return bits | columns | rows;
    }
    static inline int column(unsigned visit, int at) { return visit >> at & ((1 << COLUMN_BITS) - 1); }
    static inline int row(unsigned visit, int at) { return visit >> at & ((1 << ROW_BITS) - 1); }
    static inline bool touches(unsigned visit, int block) {
        const int bx = block % BLOCK_COLUMNS, by = block / BLOCK_COLUMNS;
        // Without a branch: every step of a walk asks this.
        return (bx >= column(visit, X0)) & (bx <= column(visit, X1)) & (by >= row(visit, Y0)) & (by <= row(visit, Y1));
    }
    static inline unsigned nearest_inv_z(unsigned visit) { return visit & ~BLOCK_MASK; }
};

static_assert(BLOCK_COLUMNS <= 1 << Visit::COLUMN_BITS && BLOCK_ROWS <= 1 << Visit::ROW_BITS,
              "a word holds all blocks");

// How much rounding may be wrong: of 1 / z; of a radius.
constexpr float NEARER = 1.00001f, WIDER = 1.0001f;

struct Walk {
    // Where a walk goes on when a node's child is done: what is left of the nodes above.
    struct Level {
        unsigned visit[LANES];
        int child[LANES];
    };

    // All triangles of the child face away: the directions from the camera to anywhere in its box make less than a
    // right angle with every normal in the cone.
    static inline bool faces_away(const float* node, Vec3 low, Vec3 high) {
        const Vec3 sum = Vec3::plus(low, high), size = Vec3::minus(high, low);
        const Vec3 axis = {__ldg(node + CONE_AXIS_ROW * LANES), __ldg(node + (CONE_AXIS_ROW + 1) * LANES),
                           __ldg(node + (CONE_AXIS_ROW + 2) * LANES)};
        // Both sides twice what they are: of the centre, and of half the diagonal.
        return Vec3::dot(sum, axis) >= __ldg(node + CONE_CUTOFF_ROW * LANES) * sqrtf(Vec3::dot(sum, sum)) +
                                           WIDER * sqrtf(Vec3::dot(size, size));
    }

    // How far along a direction a box reaches.
    static inline float farthest_along(Vec3 direction, Vec3 low, Vec3 high) {
        return fmaxf(direction.x * low.x, direction.x * high.x) + fmaxf(direction.y * low.y, direction.y * high.y) +
               fmaxf(direction.z * low.z, direction.z * high.z);
    }

    // Whether a box reaches into the packet's pyramid, by its five planes.
    static inline bool reaches_frustum(const Camera& camera, const Vec3* to_camera, const Packet& packet, Vec3 low,
                                       Vec3 high) {
        const Vec3 x = to_camera[0], y = to_camera[1], z = to_camera[2];
        const float u0 = (float)packet.first_x + camera.first_u - 0.5f, u1 = u0 + PACKET_WIDTH;
        const float v0 = (float)packet.first_y + camera.first_v - 0.5f, v1 = v0 + PACKET_HEIGHT;
        return farthest_along(z, low, high) >= 0.0f && farthest_along(combined(x, z, -u0, 1.0f), low, high) >= 0.0f &&
               farthest_along(combined(x, z, u1, -1.0f), low, high) >= 0.0f &&
               farthest_along(combined(y, z, -v0, 1.0f), low, high) >= 0.0f &&
               farthest_along(combined(y, z, v1, -1.0f), low, high) >= 0.0f;
    }
    static inline Vec3 combined(Vec3 x, Vec3 z, float of_z, float of_x) {
        return Vec3{of_z * z.x + of_x * x.x, of_z * z.y + of_x * x.y, of_z * z.z + of_x * x.z};
    }

    // A box in the image, in pixels from the principal point.
    struct ScreenBounds {
        float left, right, top, bottom;
        float zmin;
        bool crossing;  // comes so near to the camera, or behind it, that it may be anywhere

        static inline ScreenBounds of(const Vec3* m, Vec3 low, Vec3 high) {
            // The eight corners in camera space are sums of one term an axis.
            const Vec3 x[2] = {scaled(m, 0, low.x), scaled(m, 0, high.x)};
            const Vec3 y[2] = {scaled(m, 1, low.y), scaled(m, 1, high.y)};
            const Vec3 z[2] = {scaled(m, 2, low.z), scaled(m, 2, high.z)};
            ScreenBounds p;
            p.zmin = fminf(x[0].z, x[1].z) + fminf(y[0].z, y[1].z) + fminf(z[0].z, z[1].z);
            p.crossing = p.zmin <= BOX_CROSSING_SHARE * (largest(x) + largest(y) + largest(z));
            p.left = p.top = NOWHERE;
            p.right = p.bottom = -NOWHERE;
            for (int corner = 0; corner < 8; ++corner) {
                const Vec3 at = Vec3::plus(Vec3::plus(x[corner & 1], y[corner >> 1 & 1]), z[corner >> 2]);
                const float inv_z = __fdividef(1.0f, at.z), u = at.x * inv_z, v = at.y * inv_z;
                p.left = fminf(p.left, u), p.right = fmaxf(p.right, u);
                p.top = fminf(p.top, v), p.bottom = fmaxf(p.bottom, v);
            }
            return p;
        }
        static inline Vec3 scaled(const Vec3* rows, int axis, float by) {
            const float* m = &rows[0].x + axis;
            return Vec3{m[0] * by, m[3] * by, m[6] * by};
        }
        static inline float largest(const Vec3* terms) { return fmaxf(fabsf(terms[0].z), fabsf(terms[1].z)); }
    };

    static inline Vec3 corner(const float* rows) {
        return Vec3{__ldg(rows), __ldg(rows + LANES), __ldg(rows + 2 * LANES)};
    }

    // This lane's child of a node: 0 if it is not seen.
    static inline unsigned open(const Bvh& bvh, const Camera& camera, const Packet& packet, int index) {
        const float* node = bvh.nodes + (long long)index * NODE_WORDS + Warp::lane();
        const Vec3 least = corner(node + NODE_LOW_ROW * LANES), most = corner(node + NODE_HIGH_ROW * LANES);
        const Vec3 low = camera.relative(least), high = camera.relative(most);
        bool shown = least.x <= most.x;
        if (camera.skip_back_faces) shown = shown && !faces_away(node, low, high);
        return visit(camera, camera.to_camera, packet, low, high, shown);
    }

    // The visit of a box, given from the camera in a frame that turns into the camera's by three rows.
    static inline unsigned visit(const Camera& camera, const Vec3* to_camera, const Packet& packet, Vec3 low, Vec3 high,
                                 bool shown) {
        if (!Warp::any(shown)) return 0;
        const ScreenBounds p = ScreenBounds::of(to_camera, low, high);
        // Pixels of the packet whose centres may be inside: more than rounding can be wrong.
        const float slack = BOX_SLACK + BOX_SLACK_BLURS * camera.blur;
        const float to_x = camera.first_u + (float)packet.first_x, to_y = camera.first_v + (float)packet.first_y;
        const float left = fmaxf(p.crossing ? 0.0f : ceilf(p.left - to_x - slack), 0.0f);
        const float top = fmaxf(p.crossing ? 0.0f : ceilf(p.top - to_y - slack), 0.0f);
        const float right =
            fminf(p.crossing ? (float)PACKET_WIDTH : floorf(p.right - to_x + slack), PACKET_WIDTH - 1.0f);
        const float bottom =
            fminf(p.crossing ? (float)PACKET_HEIGHT : floorf(p.bottom - to_y + slack), PACKET_HEIGHT - 1.0f);
        shown = shown && p.zmin <= camera.far && left <= right && top <= bottom;
        if (shown && p.crossing) shown = reaches_frustum(camera, to_camera, packet, low, high);
        const float nearest_inv_z = p.crossing ? NOWHERE : NEARER * __fdividef(1.0f, p.zmin);
        return shown ? Visit::of(nearest_inv_z, (int)left, (int)top, (int)right, (int)bottom) : 0;
    }

    // Blocks that the child may cover and that have not been drawn nearer.
    static inline bool open_block(const Packet& packet, unsigned visit) {
        return Visit::touches(visit, Warp::lane()) && packet.block_min_inv_z <= Visit::nearest_inv_z(visit);
    }
    static inline unsigned open_blocks(const Packet& packet, unsigned visit) {
        return Warp::ballot(open_block(packet, visit));
    }
    static inline bool hidden(const Packet& packet, unsigned visit) { return !Warp::any(open_block(packet, visit)); }

    // Draw all that is seen of a bvh. `levels` has room for every level of it but the last, `queue` is empty.
    static inline void draw(const Bvh& bvh, const Camera& camera, Packet& packet, Level* levels, TriangleQueue queue,
                            Triangle* broadcast) {
        const int lane = Warp::lane();
        int level = 0;
        bool at_once = false;  // whether what is queued must not wait
        unsigned visit = open(bvh, camera, packet, bvh.root);
        int child = __ldg(bvh.children + (long long)bvh.root * LANES + lane);
        for (;;) {
            if (queue.count >= LANES || (at_once && queue.count > 0)) {
                unsigned slot;
                const int count = queue.take(slot);
                const Triangle t = Setup::triangle(bvh, camera, packet.first_x, packet.first_y, slot);
                Raster::draw(bvh, camera, packet, t, count, broadcast);
                continue;
            }
            at_once = false;
            const unsigned next = Warp::reduce_max(visit);
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
            const int k = Warp::first_lane(Warp::ballot(visit == next));
            if (lane == k) visit = 0;
            if (hidden(packet, next)) continue;
            const int index = Warp::shuffle(child, k);
            if (index < 0) {
                const int area = Setup::area(bvh, camera, packet.first_x, packet.first_y, ~index);
                queue.add(area > 0, ~index * LANES + lane);
                at_once = Warp::any(area > Raster::SMALL_AREA);  // it may hide what comes next
            } else {
                levels[level].visit[lane] = visit;
                levels[level].child[lane] = child;
                ++level;
                visit = open(bvh, camera, packet, index);
                child = __ldg(bvh.children + (long long)index * LANES + lane);
            }
        }
    }
};
