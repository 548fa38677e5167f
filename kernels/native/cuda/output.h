// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// From a packet's pixels to depth, points, normals, labels and objects, a row at a time, each written once.

struct Outputs {
    float* depth;  // [view][y][x], and so the others; null where nobody asks
    float* points;  // xyz
    float* normals;  // xyz
    unsigned char* labels;
    int* objects;
    const unsigned char* object_label;
};

struct Write {
    enum { ROWS = LANES / PACKET_WIDTH };  // that all lanes together take at a time

    static inline void vector(float* image, long long at, Vec value) {
        image[3 * at] = value.x;
        image[3 * at + 1] = value.y;
        image[3 * at + 2] = value.z;
    }

    static inline Vec none() {
        const float nan = __int_as_float(0x7fc00000);
        return Vec{nan, nan, nan};
    }

    // Of a triangle or a solid, in the world, against the direction from which it is seen.
    static inline Vec normal(const Tree& tree, const Eye& eye, const Movables& movables, unsigned id, int x, int y) {
        const double u = (double)x + eye.first_u, v = (double)y + eye.first_v;
        const Exact ray = {u * eye.exact_rays[0].x + v * eye.exact_rays[1].x + eye.exact_rays[2].x,
                           u * eye.exact_rays[0].y + v * eye.exact_rays[1].y + eye.exact_rays[2].y,
                           u * eye.exact_rays[0].z + v * eye.exact_rays[1].z + eye.exact_rays[2].z};
        const int m = Movables::owner_of(movables, id);
        const Exact n = m < 0 ? Exact::normal(tree.corners(id)) : moved_normal(tree, eye, movables, m, id, ray);
        const double towards = Exact::dot(n, ray);
        return Exact::times(n, (towards > 0.0 ? -1.0 : 1.0) / sqrt(Exact::dot(n, n))).rounded();
    }

    // Of a movable object, in the world, of any length.
    static inline Exact moved_normal(const Tree& tree, const Eye& eye, const Movables& movables, int m, unsigned id,
                                     Exact ray) {
        const float* pose = movables.poses + 7 * (long long)m;
        const int kind = __ldg(movables.solid + m);
        Exact axis[3];
        if (kind) {
            const float* size = movables.size + 4 * (long long)m;
            const double half = __ldg(size + 3);
            Shape::axes(pose, size, axis);
            const Exact o = Shape::inside(axis, Exact::minus(eye.exact_origin, Pose::position(pose)));
            if (Shape::outside(kind, half, o)) {
                const int part = id - __ldg(movables.first_id + m);
                return Pose::outside(axis, Shape::gradient(kind, half, o, Shape::inside(axis, ray), part));
            }
        }
        Pose::axes(pose, axis);
        return Pose::outside(axis, Exact::normal(tree.corners(id - Movables::first_of(movables, m))));
    }

    static inline int object(const Tree& tree, const Movables& movables, unsigned id) {
        const int m = Movables::owner_of(movables, id);
        const int alone = m < 0 ? -1 : __ldg(movables.object + m);
        if (alone >= 0) return alone;
        return Tree::object_of(__ldg(tree.owners + (m < 0 ? id : id - Movables::first_of(movables, m))));
    }

    static inline Vec point(const Eye& eye, int x, int y, float z) {
        const float u = (float)x + eye.first_u, v = (float)y + eye.first_v;
        const Vec right = eye.exact_rays[0].rounded(), down = eye.exact_rays[1].rounded();
        const Vec forward = eye.exact_rays[2].rounded();
        return Vec{__fmaf_rn(z, __fmaf_rn(u, right.x, __fmaf_rn(v, down.x, forward.x)), eye.origin.x),
                   __fmaf_rn(z, __fmaf_rn(u, right.y, __fmaf_rn(v, down.y, forward.y)), eye.origin.y),
                   __fmaf_rn(z, __fmaf_rn(u, right.z, __fmaf_rn(v, down.z, forward.z)), eye.origin.z)};
    }

    static inline void images(const Tree& tree, const Eye& eye, const Packet& packet, const Movables& movables,
                              const Outputs& out, int view, int width, int height, float near, float far) {
        const float infinity = __int_as_float(0x7f800000);
        const int column = Warp::lane() % PACKET_WIDTH;
        const int x = packet.first_x + column;
        for (int row = Warp::lane() / PACKET_WIDTH; row < PACKET_HEIGHT; row += ROWS) {
            const int y = packet.first_y + row;
            const bool here = x < width && y < height;
            const Key key = packet.nearest[Packet::slot_at(column, row)];
            const float w = __uint_as_float(Nearest::w_bits(key)), z = 1.0f / w;
            const bool far_enough = z >= near, seen = far_enough && z <= far && w > 0.0f;
            const long long at = ((long long)view * height + y) * width + x;
            if (!here) continue;
            if (out.depth) out.depth[at] = seen ? z : far_enough ? infinity : -infinity;
            if (out.points) vector(out.points, at, seen ? point(eye, x, y, z) : none());
            if (!Nearest::has_id) continue;
            const unsigned id = Nearest::id(key);
            if (out.normals) vector(out.normals, at, seen ? normal(tree, eye, movables, id, x, y) : none());
            if (!(out.objects || out.labels)) continue;
            const int index = seen ? object(tree, movables, id) : -1;
            if (out.objects) out.objects[at] = index;
            if (out.labels) out.labels[at] = index < 0 ? 0 : __ldg(out.object_label + index);
        }
    }
};
