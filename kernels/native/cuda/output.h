// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// From a packet's pixels to depth, points, normals, labels and segmentation, a row at a time, each written once.

struct Write {
    enum {
        ROWS = LANES / PACKET_WIDTH,  // that all lanes together take at a time
        INFINITY_BITS = 0x7f800000,
        NAN_BITS = 0x7fc00000,
    };
    static_assert(LANES % PACKET_WIDTH == 0, "lanes take whole rows");

    static inline void vector(float* image, long long at, Vec3 value) {
        image[3 * at] = value.x;
        image[3 * at + 1] = value.y;
        image[3 * at + 2] = value.z;
    }

    static inline Vec3 none() {
        const float nan = __int_as_float(NAN_BITS);
        return Vec3{nan, nan, nan};
    }

    // Of a triangle or a solid, in the world, against the direction from which it is seen.
    static inline Vec3 normal(const Scene& scene, const Camera& camera, unsigned id, int x, int y) {
        const double u = (double)x + camera.first_u, v = (double)y + camera.first_v;
        const Vec3d ray = {u * camera.exact_rays[0].x + v * camera.exact_rays[1].x + camera.exact_rays[2].x,
                           u * camera.exact_rays[0].y + v * camera.exact_rays[1].y + camera.exact_rays[2].y,
                           u * camera.exact_rays[0].z + v * camera.exact_rays[1].z + camera.exact_rays[2].z};
        const int m = scene.movables.owner_of(id);
        const Vec3d n = m < 0 ? Vec3d::normal(scene.bvh.corners(id)) : moved_normal(scene, camera, m, id, ray);
        const double towards = Vec3d::dot(n, ray);
        return Vec3d::times(n, (towards > 0.0 ? -1.0 : 1.0) / sqrt(Vec3d::dot(n, n))).rounded();
    }

    // Of a movable object, in the world, of any length.
    static inline Vec3d moved_normal(const Scene& scene, const Camera& camera, int m, unsigned id, Vec3d ray) {
        const Movables& movables = scene.movables;
        const float* pose = movables.pose(m);
        const int kind = __ldg(movables.solid + m);
        Vec3d axis[3];
        if (kind && !ObjectPass::is_cut(camera, movables, m)) {
            const float* size = movables.solid_size(m);
            const double half = __ldg(size + 3);
            UnitSolid::axes(pose, size, axis);
            const Vec3d o = UnitSolid::inside(axis, Vec3d::minus(camera.exact_origin, PoseRow::position(pose)));
            if (UnitSolid::outside(kind, half, o)) {
                const int part = id - __ldg(movables.first_id + m);
                const Vec3d d = UnitSolid::inside(axis, ray);
                return PoseRow::turned_out(axis, UnitSolid::gradient(kind, half, o, d, part));
            }
        }
        PoseRow::axes(pose, axis);
        Vec3d n = Vec3d::normal(scene.bvh.corners(id - movables.id_offset(m)));
        if (RESIZED) {
            const Stretch stretch = movables.stretch(m);
            n = Vec3d{n.x / stretch.factor[0], n.y / stretch.factor[1], n.z / stretch.factor[2]};
        }
        return PoseRow::turned_out(axis, n);
    }

    static inline Vec3 point(const Camera& camera, int x, int y, float z) {
        const float u = (float)x + camera.first_u, v = (float)y + camera.first_v;
        const Vec3 right = camera.exact_rays[0].rounded(), down = camera.exact_rays[1].rounded();
        const Vec3 forward = camera.exact_rays[2].rounded();
        return Vec3{__fmaf_rn(z, __fmaf_rn(u, right.x, __fmaf_rn(v, down.x, forward.x)), camera.origin.x),
                    __fmaf_rn(z, __fmaf_rn(u, right.y, __fmaf_rn(v, down.y, forward.y)), camera.origin.y),
                    __fmaf_rn(z, __fmaf_rn(u, right.z, __fmaf_rn(v, down.z, forward.z)), camera.origin.z)};
    }

    static inline void images(const Scene& scene, const View& view, const Camera& camera, const Packet& packet,
                              const Images& out) {
        const int column = Warp::lane() % PACKET_WIDTH;
        const int x = packet.first_x + column;
        for (int row = Warp::lane() / PACKET_WIDTH; row < PACKET_HEIGHT; row += ROWS) {
            const int y = packet.first_y + row;
            const Key key = packet.z_buffer[Packet::index_at(column, row)];
            if (x < view.width && y < view.height) pixel(scene, view, camera, out, x, y, key);
        }
    }

    static inline void pixel(const Scene& scene, const View& view, const Camera& camera, const Images& out, int x,
                             int y, Key key) {
        const float infinity = __int_as_float(INFINITY_BITS);
        const float inv_z = __uint_as_float(DepthKey::inv_z_bits(key)), z = 1.0f / inv_z;
        const bool far_enough = z >= view.near, seen = far_enough && z <= view.far && inv_z > 0.0f;
        const long long at = ((long long)view.index * view.height + y) * view.width + x;
        if (out.depth) out.depth[at] = seen ? z : far_enough ? infinity : -infinity;
        if (out.points) vector(out.points, at, seen ? point(camera, x, y, z) : none());
        if (!DepthKey::HAS_ID) return;
        const unsigned id = DepthKey::id(key);
        if (out.normals) vector(out.normals, at, seen ? normal(scene, camera, id, x, y) : none());
        if (!(out.segmentation || out.labels)) return;
        const int object = seen ? scene.object_of(id) : -1;
        if (out.segmentation) out.segmentation[at] = object;
        if (out.labels) out.labels[at] = object < 0 ? (unsigned char)LABEL_EMPTY : __ldg(out.object_label + object);
    }
};
