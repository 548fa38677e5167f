// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Write a packet's pixels to depth, points, normals, labels, segmentation and faces, row by row, each pixel once.

#pragma once

#include "cuda/objects.h"
#include "shared/images.h"

// The pixels of a packet that one lane writes: they are in one column.
struct Column {
    enum { ROWS = LANES / PACKET_WIDTH };  // rows that all lanes write together at a time
    static_assert(LANES % PACKET_WIDTH == 0, "lanes write whole rows");

    int column, row;  // in the packet
    int rows;  // number of the packet's rows inside the image; 0 if the column is outside
    int step;  // stride to the next pixel in the images
    long long offset;  // index in the images

    static inline Column of(const View& view, const Packet& packet) {
        const int column = Warp::lane() % PACKET_WIDTH, row = Warp::lane() / PACKET_WIDTH;
        const int x = packet.first_x + column, y = packet.first_y + row;
        const int rows = x < view.width ? min((int)PACKET_HEIGHT, view.height - packet.first_y) : 0;
        return Column{column, row, rows, ROWS * view.width, ((long long)view.index * view.height + y) * view.width + x};
    }
    inline bool any() const { return row < rows; }
    inline void next() { row += ROWS, offset += step; }
    inline Key key(const Packet& packet) const { return *packet.at(Packet::index_at(column, row)); }
};

struct Write {
    enum { INFINITY_BITS = 0x7f800000, NAN_BITS = 0x7fc00000 };

    static inline float inv_z_of(Key key) { return __uint_as_float(DepthKey::inv_z_bits(key)); }

    static inline void vector(float* image, long long offset, Vec3 value) {
        image[3 * offset] = value.x;
        image[3 * offset + 1] = value.y;
        image[3 * offset + 2] = value.z;
    }

    static inline Vec3 none() {
        const float nan = __int_as_float(NAN_BITS);
        return Vec3{nan, nan, nan};
    }

    // Normal of a triangle or a solid in the world, facing the viewer.
    static inline Vec3 normal(const Scene& scene, const Camera& camera, unsigned id, ExactImagePoint p) {
        const Vec3d ray = {p.u * camera.exact_rays[0].x + p.v * camera.exact_rays[1].x + camera.exact_rays[2].x,
                           p.u * camera.exact_rays[0].y + p.v * camera.exact_rays[1].y + camera.exact_rays[2].y,
                           p.u * camera.exact_rays[0].z + p.v * camera.exact_rays[1].z + camera.exact_rays[2].z};
        const int m = scene.movables.owner_of(id);
        const Vec3d n = m < 0 ? Vec3d::normal(scene.bvh.corners(id)) : moved_normal(scene, camera, m, id, ray);
        const double toward = Vec3d::dot(n, ray);
        return Vec3d::times(n, (toward > 0.0 ? -1.0 : 1.0) / sqrt(Vec3d::dot(n, n))).rounded();
    }

    // Normal of a movable object in the world, not normalized.
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
                return PoseRow::rotated_out(axis, UnitSolid::gradient(kind, half, o, d, part));
            }
        }
        PoseRow::axes(pose, axis);
        Vec3d n = Vec3d::normal(scene.bvh.corners(id - movables.id_offset(m)));
        if (RESIZED) {
            const Stretch stretch = movables.stretch(m);
            n = Vec3d{n.x / stretch.factor[0], n.y / stretch.factor[1], n.z / stretch.factor[2]};
        }
        return PoseRow::rotated_out(axis, n);
    }

    static inline bool more_than_depth(const Images& out) {
        return out.points || (WITH_ID && (out.of_triangles() || out.segmentation || out.labels));
    }
    static inline void images(const Scene& scene, const View& view, const Camera& camera, const Packet& packet,
                              const Images& out) {
        if (more_than_depth(out))
            all(scene, view, camera, packet, out);
        else if (out.depth)
            depths(view, packet, out.depth);
    }

    static inline void all(const Scene& scene, const View& view, const Camera& camera, const Packet& packet,
                           const Images& out) {
        const Frame frame = Frame::of(camera);
        for (Column column = Column::of(view, packet); column.any(); column.next()) {
            const Key key = column.key(packet);
            const float inv_z = inv_z_of(key), z = Reciprocal::of(inv_z);
            const Spot spot = {column.offset, column.column, column.row, 0};
            pixel(scene, frame, camera, packet, out, spot, Found::of(view, key, inv_z, z, z));
        }
    }
    static inline void depths(const View& view, const Packet& packet, float* depth) {
        for (Column column = Column::of(view, packet); column.any(); column.next()) {
            const Key key = column.key(packet);
            const float inv_z = inv_z_of(key), z = Reciprocal::of(inv_z);
            depth[column.offset] = Found::of(view, key, inv_z, z, z).depth;
        }
    }
    // Write the pixels of slots with rays of a table or points, of which a view has `count`.
    template <class Rays>
    static inline void slots(const Scene& scene, const View& view, const Camera& camera, const Packet& packet,
                             const Rays& rays, int count, const Images& out) {
        const long long first = (long long)view.index * count;
        const bool more = more_than_depth(out);
        // Packets of points have only few slots.
        if (IS_TABLE && !more) {
            if (out.depth) slot_depths(view, packet, rays, out.depth + first);
            return;
        }
        const Frame frame = Frame::of(camera);
        for (int slot = Warp::lane(); slot < (int)SLOTS; slot += LANES) {
            const int at = rays.pixel_of(slot);
            if (at < 0) continue;
            const Key key = *packet.at(slot);
            const float inv_z = slot_inv_z(key), z = Reciprocal::of(inv_z);
            const Found found = Found::of(view, key, inv_z, z, rays.measure_of(slot).depth(z));
            if (more) pixel(scene, frame, camera, packet, out, Spot{first + at, 0, 0, slot}, found);
            if (!more && out.depth) out.depth[first + at] = found.depth;
        }
    }
    // Slots without a ray count as very near; they show nothing.
    static inline float slot_inv_z(Key key) {
        const float inv_z = inv_z_of(key);
        return inv_z < NOWHERE ? inv_z : 0.0f;
    }
    // Write depth alone. Several slots are loaded before the first use, so that there is a single wait.
    template <class Rays>
    static inline void slot_depths(const View& view, const Packet& packet, const Rays& rays, float* depth) {
        enum { AT_ONCE = SLOT_BLOCKS < 8 ? SLOT_BLOCKS : 8 };
        for (int first = Warp::lane(); first < (int)SLOTS; first += AT_ONCE * LANES) {
            int at[AT_ONCE];
            float inv_z[AT_ONCE];
            typename Rays::Measure measure[AT_ONCE];
            for (int k = 0; k < AT_ONCE; ++k) {
                at[k] = rays.pixel_of(first + k * LANES);
                inv_z[k] = slot_inv_z(*packet.at(first + k * LANES));
                if (inv_z[k] > 0.0f) measure[k] = rays.measure_of(first + k * LANES);
            }
            for (int k = 0; k < AT_ONCE; ++k) {
                const float z = Reciprocal::of(inv_z[k]);
                const Found found = Found::of(view, 0, inv_z[k], z, measure[k].depth(z));
                if (at[k] >= 0) depth[at[k]] = found.depth;
            }
        }
    }

    // Transform of a camera from image coordinates to the world.
    struct Frame {
        Vec3 right, down, forward;

        static inline Frame of(const Camera& camera) {
            return Frame{camera.exact_rays[0].rounded(), camera.exact_rays[1].rounded(),
                         camera.exact_rays[2].rounded()};
        }
        inline Vec3 ray(ImagePoint p) const { return Vec3::along(Vec3::along(forward, down, p.v), right, p.u); }
    };
    // Indices of a pixel in the images and in the packet.
    struct Spot {
        long long offset;
        int x, y, index;
    };
    // Result at a pixel.
    struct Found {
        Key key;
        float z, depth;  // depth is infinite if nothing in range is shown
        bool shown;

        // `z` and `depth` are valid only where a surface was hit, that is, where `inv_z` is greater than 0.
        static inline Found of(const View& view, Key key, float inv_z, float z, float depth) {
            const bool shown = inv_z > 0.0f && depth >= view.near && depth <= view.far;
            const float infinity = __int_as_float(INFINITY_BITS);
            return Found{key, z, shown ? depth : inv_z > 0.0f && depth < view.near ? -infinity : infinity, shown};
        }
    };

    static inline void pixel(const Scene& scene, const Frame& frame, const Camera& camera, const Packet& packet,
                             const Images& out, const Spot& spot, const Found& found) {
        const bool objects = WITH_ID && (out.segmentation || out.labels), shown = found.shown;
        const unsigned id = DepthKey::id(found.key);
        // Loaded before the rest, to hide the latency of the load.
        const int owner = !MOVABLE && objects && shown ? __ldg(scene.bvh.owners + id) : 0;
        if (out.depth) out.depth[spot.offset] = found.depth;
        if (out.points) {
            const RayPlace p = packet.point(camera, spot.x, spot.y, spot.index);
            const Vec3 start = Origins::start(p, camera.origin, frame.right, frame.down);
            vector(out.points, spot.offset, shown ? Vec3::along(start, frame.ray(p), found.z) : none());
        }
        if (WITH_ID && out.normals)
            vector(out.normals, spot.offset,
                   shown ? normal(scene, camera, id, packet.exact_point(camera, spot.x, spot.y, spot.index)) : none());
        if (WITH_ID && out.faces) out.faces[spot.offset] = shown ? face(scene, out, id) : -1;
        if (!objects) return;
        int object = -1;
        if (shown) object = MOVABLE ? scene.object_of(id) : Bvh::object_of(owner);
        if (out.segmentation) out.segmentation[spot.offset] = object;
        if (out.labels)
            out.labels[spot.offset] = object < 0 ? (unsigned char)LABEL_EMPTY : __ldg(out.object_label + object);
    }
    // Index of a triangle in its object's own mesh; -1 for a solid.
    static inline int face(const Scene& scene, const Images& out, unsigned id) {
        const int slot = scene.slot_of(id);
        return slot < 0 ? -1 : __ldg(out.slot_face + slot);
    }
};
