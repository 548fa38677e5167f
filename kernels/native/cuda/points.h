// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Packets of arbitrary image points.
//
// The bounding rectangle of a packet's points is divided into the packet's pixels, by which nodes and triangles are
// culled as in other packets. But a slot of the z-buffer is a point, and a block is 32 consecutive points with known
// bounds. A triangle is rasterized by all lanes: each tests whether the triangle may cover points of one block, and
// then each tests a point of the blocks that pass.
//
// The size of the packet's pixels is 2^n camera pixels, chosen so that the rectangle spans at most 32 of them. All
// numbers are those of the camera times a power of two, which rounds nothing: the result of a point does not depend on
// the other points of its packet.

#pragma once

#include "cuda/packets.h"

// The points of a view, in rows or sorted by position.
struct PointList {
    const ImagePoint* pixels;  // [px], from the image's corner
    int count;
    const int* order;  // order of the points sorted by position; null if they are in rows
    int columns;  // columns of each row; packets take squares of rows and columns

    // The points of a view, of a `PointLists` of kernels/casting/point_order.py.
    template <class PointLists>
    static inline PointList of(const PointLists& points, int view) {
        static_assert(sizeof(*points.pixels.data) == sizeof(ImagePoint), "points are read as two numbers");
        const bool sorted = points.spread.data[view] > 0;
        const int first = sorted && view > 0 ? points.ends.data[(long long)view * points.cells - 1] : 0;
        PointList list;
        list.count = points.pixels.shape[1];
        list.pixels = (const ImagePoint*)points.pixels.data + (long long)view * list.count;
        list.order = sorted ? points.order.data + first : nullptr;
        list.columns = points.columns;
        return list;
    }

    enum {
        COLUMNS = SLOTS >= 1024 ? 32
        : SLOTS >= 256          ? 16
                                : 8,
        ROWS = SLOTS / COLUMNS,
        ACROSS = COLUMNS / BLOCK_WIDTH
    };

    // This lane's point of a block; -1 if it has no point.
    inline int index(int packet, int block) const {
        const int lane = Warp::lane();
        if (order) {
            const int i = packet * SLOTS + block * LANES + lane;
            return i < count ? order[i] : -1;
        }
        const int across = (columns + COLUMNS - 1) / COLUMNS;
        const int x = packet % across * COLUMNS + block % ACROSS * BLOCK_WIDTH + Packet::pixel_x(lane);
        const int y = packet / across * ROWS + block / ACROSS * BLOCK_HEIGHT + Packet::pixel_y(lane);
        const long long i = (long long)y * columns + x;
        return x < columns && i < count ? (int)i : -1;
    }
};

// The first points of a view, in order. They have a separate kernel: with both orders in one, its code no longer fits
// the instruction cache.
struct UsedPoints {
    const ImagePoint* pixels;
    int count;
    int used;  // number of points that are cast

    template <class PointLists>
    static inline UsedPoints of(const PointLists& points, int view) {
        const int count = points.pixels.shape[1];
        return UsedPoints{(const ImagePoint*)points.pixels.data + (long long)view * count, count,
                          points.used.data[view]};
    }
    inline int index(int packet, int block) const {
        const int i = packet * SLOTS + block * LANES + Warp::lane();
        return i < used ? i : -1;
    }
};

// Bounds of a set of image points without negative coordinates.
struct PointBounds {
    unsigned left, right, top, bottom;  // bits of floats, which sort like the floats

    static inline PointBounds none() { return PointBounds{~0u, 0, ~0u, 0}; }
    static inline PointBounds of(bool is_inside, ImagePoint pixel) {
        if (!is_inside) return none();
        // Adding 0 turns -0 into 0.
        const unsigned u = __float_as_uint(pixel.u + 0.0f), v = __float_as_uint(pixel.v + 0.0f);
        return PointBounds{u, u, v, v};
    }
    // Bounds of all lanes' points.
    inline PointBounds of_all() const {
        return PointBounds{Warp::reduce_min(left), Warp::reduce_max(right), Warp::reduce_min(top),
                           Warp::reduce_max(bottom)};
    }
    inline bool any() const { return left <= right; }
    inline float u0() const { return __uint_as_float(left); }
    inline float u1() const { return __uint_as_float(right); }
    inline float v0() const { return __uint_as_float(top); }
    inline float v1() const { return __uint_as_float(bottom); }
};

struct PointPacket {
    // Greatest distance of a point from the center of its pixel [packet pixels], with a margin for rounding.
    static inline float spread() { return 0.501f; }
    // Greatest extent of the bounding rectangle [packet pixels].
    static inline float max_extent() { return min((int)PACKET_WIDTH, (int)PACKET_HEIGHT) - 0.52f; }
    // Greatest number of packet pixels per camera pixel: at most 16, and at most 2^21 along a side of the image.
    static inline float max_scale(float side) { return fminf(16.0f, (float)(1 << 21) / side); }

    static inline bool inside(const View& view, ImagePoint pixel) {
        return pixel.u >= 0.0f && pixel.u < (float)view.width && pixel.v >= 0.0f && pixel.v < (float)view.height;
    }

    // Write the points' indices in the list to shared memory and set the bounds of this lane's block. Returns the
    // bounds of all points.
    template <class List>
    static inline PointBounds find(const View& view, const List& list, int number, Places& places,
                                   PointBounds& of_block) {
        of_block = PointBounds::none();
        for (int block = 0; block < SLOT_BLOCKS; ++block) {
            const int i = list.index(number, block);
            const ImagePoint pixel = list.pixels[max(i, 0)];
            const bool is_inside = i >= 0 && inside(view, pixel);
            places.place[Packet::index(block, Warp::lane())] = is_inside ? i : i >= 0 ? ~i : (int)Places::NO_POINT;
            const PointBounds bounds = PointBounds::of(is_inside, pixel).of_all();
            if (Warp::lane() == block) of_block = bounds;
        }
        return of_block.of_all();
    }

    // The camera with pixels scaled by 2^n, so that a rectangle has no more pixels than a packet.
    static inline Camera camera_of(const View& view, const PointBounds& all, float& scale) {
        View middle = view;
        middle.center[0] = middle.center[1] = 0.5;  // u and v are 0 there, so that nothing is rounded
        Camera camera = Packets::camera_of(middle);
        const float right = (float)fmax(view.center[0], view.width - view.center[0]);
        const float below = (float)fmax(view.center[1], view.height - view.center[1]);
        const float across = fmaxf(fmaxf(all.u1() - all.u0(), all.v1() - all.v0()), 1e-3f);
        const float limit = fminf(max_extent() / across, max_scale(fmaxf(right, below)));
        scale = __uint_as_float(__float_as_uint(limit) & Write::INFINITY_BITS);  // round down to a power of two
        const float per_scale = 1.0f / scale;
        camera.extent = Three::max(camera.extent, right, below) * scale;
        camera.per_extent = 1.0f / camera.extent;
        camera.last_x = right * scale, camera.last_y = below * scale;
        camera.blur *= scale;
        camera.set_errors((float)view.focal[0] * scale, (float)view.focal[1] * scale);
        camera.spread = ImagePoint{spread(), spread()};
        for (int i = 0; i < 2; ++i) {
            camera.exact_rays[i] = Vec3d::times(camera.exact_rays[i], per_scale);
            camera.to_camera[i] =
                Vec3{camera.to_camera[i].x * scale, camera.to_camera[i].y * scale, camera.to_camera[i].z * scale};
        }
        return camera;
    }

    // Rows of the camera in double precision, for objects in their own frames.
    static inline void set_rows(const View& view, double scale, Camera& camera) {
        for (int i = 0; i < 3; ++i) {
            const double f = i < 2 ? view.focal[i] * scale : 1.0;
            const Vec3d row = Vec3d::times(camera.exact_rays[i], f * f);
            camera.rows[3 * i] = row.x, camera.rows[3 * i + 1] = row.y, camera.rows[3 * i + 2] = row.z;
        }
    }

    // Write the camera and the points to shared memory.
    static inline void set(const View& view, const PointBounds& all, const PointBounds& of_block, Camera& camera,
                           Places& places) {
        const int lane = Warp::lane();
        float scale;
        Camera scaled = camera_of(view, all, scale);
        if (lane == 0) places.scale = scale, places.center[0] = view.center[0], places.center[1] = view.center[1];
        Warp::sync();
        scaled.first_u = u_of(places, all.u0(), 0);
        scaled.first_v = u_of(places, all.v0(), 1);
        scaled.cells.per_u = CellGrid::per_side(u_of(places, all.u1(), 0) - scaled.first_u);
        scaled.cells.per_v = CellGrid::per_side(u_of(places, all.v1(), 1) - scaled.first_v);
        if (MOVABLE) set_rows(view, scale, scaled);
        if (lane == 0) camera = scaled;
        if (lane >= SLOT_BLOCKS) return;
        const ImageBox box = {u_of(places, of_block.u0(), 0), u_of(places, of_block.u1(), 0),
                              u_of(places, of_block.v0(), 1), u_of(places, of_block.v1(), 1)};
        places.set_block(scaled, lane, box, of_block.any());
    }
    static inline float u_of(const Places& places, float pixel, int axis) {
        return (float)(((double)pixel - places.center[axis]) * places.scale);
    }
    // Write the points to shared memory; the packet's corner for slots without a point.
    static inline void set_points(const Camera& camera, Places& places) {
        for (int slot = Warp::lane(); slot < (int)SLOTS; slot += LANES) {
            const int i = places.place[slot];
            const ExactImagePoint p = places.exact(places.list[max(i, 0)]);
            places.points[slot] =
                i >= 0 ? ImagePoint{(float)p.u, (float)p.v} : ImagePoint{camera.first_u, camera.first_v};
        }
        Warp::sync();
    }

    // Draw and write one in `step` packets of the points that are used.
    static inline void cast_used(const Scene& scene, const View& view, const UsedPoints& list, int number, int step,
                                 const Images& out, WarpMemory& memory) {
        for (; number * (int)SLOTS < list.used; number += step) {
            cast(scene, view, list, number, out, memory);
            Warp::sync();
        }
    }
    // Draw and write a packet of a view. If the view's world does not exist, nothing is visible.
    template <class List>
    static inline void cast(const Scene& scene, const View& view, const List& list, int number, const Images& out,
                            WarpMemory& memory) {
        Camera& camera = memory.cameras[WarpMemory::WORLD];
        PointBounds of_block;
        const PointBounds all = find(view, list, number, memory.pixels, of_block);
        if (Warp::lane() == 0) memory.pixels.list = list.pixels;
        // If no point is inside the image, use the image's corner.
        set(view, all.any() ? all : PointBounds{0, 0, 0, 0}, of_block, camera, memory.pixels);
        Warp::sync();
        set_points(camera, memory.pixels);
        Packets::cast_slots(scene, view, memory.pixels, list.count, out, memory, all.any());
    }
};
static_assert(!POINTS || (BLOCK_PIXELS == (int)LANES && PACKET_WIDTH == PACKET_HEIGHT),
              "a block has a slot for each lane");
static_assert(!POINTS || (SLOTS <= 1024 && PointList::COLUMNS % BLOCK_WIDTH == 0), "packets are squares of blocks");
