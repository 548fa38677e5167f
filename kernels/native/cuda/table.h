// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Packets of a ray table, each rendered as a separate image: rotated, scaled and sheared so that adjacent rays pass
// near the centers of adjacent pixels, one each, or rotated and scaled so that unordered rays fill it
// (warpvis/rendering/casters/sorted_rays_cuda.py). All else is as in other packets. A packet is an image or, where
// smaller packets are faster, a square window of it: results are the same to the last bit.
//
// Rays may have distinct origins (ray_origins.h). Then each packet has its own eye.

#pragma once

#include "cuda/packets.h"

// Transformation from the camera space of the table into that of a packet.
struct TableFrame {
    double rows[3][3];  // u times z, v times z, and z of a point relative to the camera
    double rays[3][3];  // the inverse: a ray is u times the first, plus v times the second, plus the third
    double first_u, first_v;  // of the center of the packet's first pixel
    double spread[2];  // greatest distance of a ray from the center of its pixel, along each axis [px]
    double focal[2];  // lengths of the first two rows
    double longest;  // greatest z of the packet's rays at depth 1; 0 if it has none, or all are cast one by one
    double side;  // pixels of the image along each axis
};
static_assert(sizeof(TableFrame) == TABLE_FRAME_WORDS * sizeof(double) &&
                  (int)OriginRays::TableEye::WORDS == TABLE_EYE_WORDS,
              "Python stores rows of numbers");
static_assert(sizeof(ImageBox) == 4 * sizeof(float), "Python stores rows of left, right, top and bottom");

// A packet's rays, in the order of the z-buffer.
struct TablePacket {
    const TableFrame* frame;
    TableRays rays;
    const ImageBox* bounds;  // of blocks of rays, for rays anywhere in the image
    int pixels;  // number of pixels of the table's image
    TableEye eye;

    // A packet of a view, of a `RayPackets` of kernels/casting/packets_cuda.py.
    template <class RayPackets>
    static inline TablePacket of(const RayPackets& packets, int view, int packet) {
        const long long row = (long long)view * packets.per_view + packet, first = row * SLOTS;
        const int* window = packets.windows.data + 4 * packet;
        const long long image = (long long)view * packets.per_view + window[0];
        TablePacket result;
        result.frame = (const TableFrame*)(packets.frame.data + image * TABLE_FRAME_WORDS);
        result.rays.points = (const ImagePoint*)packets.points.data + first;
        result.rays.rests = (const ImagePoint*)packets.rests.data + first;
        result.rays.starts =
            RayStarts::from((const ImagePoint*)packets.asides.data + first, packets.begins.data + first);
        result.rays.scale = packets.scale.data + first;
        result.rays.place = packets.place.data + (long long)packet * SLOTS;
        result.rays.full = window[3];
        result.bounds = (const ImageBox*)packets.bounds.data + (long long)packet * SLOT_BLOCKS;
        result.pixels = packets.pixels;
        result.rays.first_x = window[1], result.rays.first_y = window[2];
        result.eye = TableEye::of(packets.eyes.data + image * TABLE_EYE_WORDS);
        return result;
    }
    // A view of the packet's image, in the range of a `RayRange` of kernels/casting/rays.py.
    template <class RayRange, class Poses>
    static inline View view_of(const RayRange& range, const Poses& poses, int index, bool cull_back_faces) {
        View view;
        view.index = index;
        view.width = PACKET_WIDTH, view.height = PACKET_HEIGHT;
        view.focal[0] = view.focal[1] = 1.0;
        view.center[0] = view.center[1] = 0.0;
        view.near = range.near, view.far = range.far;
        view.clip_inv_z = NOWHERE, view.clip_reach = 0.0f;
        view.pose = (const float*)(poses.data + index);
        view.cull_back_faces = cull_back_faces;
        return view;
    }

    // Set the camera in shared memory. Each lane computes one coordinate of a ray or of a row.
    inline void set_camera(const View& view, Camera& camera) const {
        const int lane = Warp::lane(), row = lane / 3, k = lane % 3;
        Vec3d axis[3];  // right, down and forward in the world
        PoseRow::axes(view.pose, axis);
        if (row < 6) {
            const double* weights = row < 3 ? frame->rays[row] : frame->rows[row - 3];
            const double value =
                (&axis[0].x)[k] * weights[0] + (&axis[1].x)[k] * weights[1] + (&axis[2].x)[k] * weights[2];
            if (row < 3) {
                (&camera.exact_rays[row].x)[k] = value;
            } else {
                (&camera.to_camera[row - 3].x)[k] = (float)value;
                if (RAY_TABLE) camera.rows[3 * (row - 3) + k] = value;
            }
        }
        if (lane == 0) set_numbers(view, axis, camera);
        Warp::sync();
    }
    inline void set_numbers(const View& view, const Vec3d* axis, Camera& camera) const {
        camera.exact_origin = eye.place(PoseRow::position(view.pose), axis);
        camera.origin = camera.exact_origin.rounded();
        const Vec3 o = camera.origin;
        camera.origin_error = Vec3d::minus(camera.exact_origin, Vec3d{o.x, o.y, o.z}).rounded();
        camera.origins = eye.origins();
        camera.first_u = (float)frame->first_u;
        camera.first_v = (float)frame->first_v;
        const float last = (float)frame->side - 1.0f;
        camera.last_x = POINTS ? fmaxf(fabsf(camera.first_u), fabsf(camera.first_u + last)) + 1.0f : last;
        camera.last_y = POINTS ? fmaxf(fabsf(camera.first_v), fabsf(camera.first_v + last)) + 1.0f : last;
        if (POINTS) camera.cells = CellGrid{CellGrid::per_side(last), CellGrid::per_side(last)};
        camera.spread = ImagePoint{(float)frame->spread[0], (float)frame->spread[1]};
        camera.far = fminf(eye.farthest(view.far * (float)frame->longest) * FARTHER, NOWHERE);
        camera.near = NearPlane{view.clip_inv_z, eye.reach(view.clip_reach)};
        const float width = (float)frame->focal[0], height = (float)frame->focal[1];
        // Distance of the first pixel from the principal point; that of the last one is at most the image size more.
        const float first =
            POINTS ? fmaxf(camera.last_x, camera.last_y) : fmaxf(fabsf(camera.first_u), fabsf(camera.first_v));
        camera.extent = fmaxf(0.5f * (width + height + camera.last_x + camera.last_y), first) +
                        fmaxf(camera.spread.u, camera.spread.v);
        camera.per_extent = 1.0f / camera.extent;
        camera.set_errors(width, height);
        camera.stretch = Vec3{1.0f, 1.0f, 1.0f};
        camera.blur = ROUNDING * (width + height + 2.0f * first + camera.last_x + camera.last_y);
    }

    // Write the rays to shared memory. A block without rays has a greater left than right.
    inline void set_rays(const Camera& camera, PixelMemory& memory) const {
        const int block = Warp::lane();
        if (block == 0) static_cast<TableRays&>(memory) = rays;
        if (POINTS && block < SLOT_BLOCKS)
            memory.set_block(camera, block, bounds[block], bounds[block].left <= bounds[block].right);
        Warp::sync();
    }

    // Render and write a packet of a view. If the view's world does not exist, nothing is visible. The rays are read
    // from shared memory, so that no addresses stay in registers.
    inline void cast(const Scene& scene, const View& view, const Images& out, WarpMemory& memory) const {
        set_camera(view, memory.cameras[WarpMemory::WORLD]);
        set_rays(memory.cameras[WarpMemory::WORLD], memory.pixels);
        Packets::cast_slots(scene, view, memory.pixels, pixels, out, memory, !RAY_ORIGINS || frame->longest > 0.0);
    }
};
static_assert((int)BLOCK_PIXELS == (int)LANES, "a block has a pixel for each lane");
