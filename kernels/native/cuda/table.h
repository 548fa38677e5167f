// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Packets of a ray table, each rendered as a separate image: rotated, scaled and sheared so that adjacent rays pass
// near the centers of adjacent pixels, one each, or rotated and scaled so that unordered rays fill it
// (warpvis/rendering/casters/sorted_rays_cuda.py). All else is as in other packets.
//
// Rays may have distinct origins (ray_origins.h). Then each packet has its own eye.

#pragma once

#include "cuda/packets.h"
#include "cuda/table_slots.h"

// Transformation from the camera space of the table into that of a packet.
struct TableFrame {
    double rows[3][3];  // u times z, v times z, and z of a point relative to the camera
    double rays[3][3];  // the inverse: a ray is u times the first, plus v times the second, plus the third
    double first_u, first_v;  // of the center of the packet's first pixel
    double spread;  // greatest distance of a ray from the center of its pixel, along each axis [px]
    double focal[2];  // lengths of the first two rows
    double longest;  // greatest z of the packet's rays at depth 1
};
static_assert(sizeof(TableFrame) == TABLE_FRAME_WORDS * sizeof(double) &&
                  (int)OriginRays::TableEye::WORDS == TABLE_EYE_WORDS,
              "Python stores rows of numbers");

// A packet's rays, in the order of the z-buffer.
struct TablePacket {
    const TableFrame* frame;
    const ImagePoint *points, *rests;  // see `Places`
    const float* scale;  // depth at z = 1; 0 if there is no ray
    const int* place;  // pixel in the table's image; -1 if there is none
    const ImageBox* bounds;  // of blocks of rays, for rays anywhere in the image
    int pixels;  // number of pixels of the table's image
    TableEye eye;
    RayStarts starts;

    // A packet of a `RayPackets` of kernels/casting/ray_bundle_packets_cuda.py.
    template <class RayPackets>
    static inline TablePacket of(const RayPackets& packets, int packet) {
        const long long first = (long long)packet * SLOTS;
        TablePacket rays;
        rays.frame = (const TableFrame*)(packets.frame.data + (long long)packet * TABLE_FRAME_WORDS);
        rays.points = (const ImagePoint*)packets.points.data + first;
        rays.rests = (const ImagePoint*)packets.rests.data + first;
        rays.scale = packets.scale.data + first;
        rays.place = packets.place.data + first;
        rays.bounds = (const ImageBox*)packets.bounds.data + (long long)packet * SLOT_BLOCKS;
        rays.pixels = packets.pixels;
        rays.eye = TableEye::of(packets.eyes.data + (long long)packet * TABLE_EYE_WORDS);
        rays.starts = RayStarts::from((const ImagePoint*)packets.asides.data + first, packets.begins.data + first);
        return rays;
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
    inline void set_camera(const Scene& scene, const View& view, Camera& camera) const {
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
        Packets::set_sides(scene, view, camera);
    }
    inline void set_numbers(const View& view, const Vec3d* axis, Camera& camera) const {
        camera.exact_origin = eye.place(PoseRow::position(view.pose), axis);
        camera.origin = camera.exact_origin.rounded();
        const Vec3 o = camera.origin;
        camera.origin_error = Vec3d::minus(camera.exact_origin, Vec3d{o.x, o.y, o.z}).rounded();
        camera.origins = eye.origins();
        camera.first_u = (float)frame->first_u;
        camera.first_v = (float)frame->first_v;
        TableSlots::set_sides(camera);
        camera.spread = (float)frame->spread;
        camera.far = fminf(eye.farthest(view.far * (float)frame->longest) * FARTHER, NOWHERE);
        camera.near = NearPlane::of(view.clip_inv_z, eye.reach(view.clip_reach));
        const float width = (float)frame->focal[0], height = (float)frame->focal[1];
        const float first = TableSlots::farthest(camera);
        camera.extent = fmaxf(0.5f * (width + height + camera.last_x + camera.last_y), first) + camera.spread;
        camera.per_extent = 1.0f / camera.extent;
        camera.set_errors(width, height);
        camera.stretch = Vec3{1.0f, 1.0f, 1.0f};
        camera.blur = ROUNDING * (width + height + 2.0f * first + camera.last_x + camera.last_y);
    }

    // Clear the z-buffer. A pixel without a ray counts as very near, so that it hides everything and is never shown.
    inline void begin(const Camera& camera, Packet& packet) const {
        const int lane = Warp::lane();
        if (lane == 0) packet.memory->points = points, packet.memory->rests = rests, packet.memory->starts = starts;
        Warp::sync();
        TableSlots::index(camera, *packet.memory, bounds);
        unsigned filled = 0;
        for (int block = 0; block < SLOT_BLOCKS; ++block) {
            const int index = block * LANES + lane;
            const bool has_ray = __ldg(scale + index) > 0.0f;
            *packet.at(index) = DepthKey::of(has_ray ? 0.0f : NOWHERE, Packet::NO_TRIANGLE);
            if (has_ray) TableSlots::add(camera, *packet.memory, index);
            if (Warp::any(has_ray)) filled |= 1u << block;
        }
        packet.block_min_inv_z = __float_as_uint(filled >> lane & 1 ? 0.0f : NOWHERE);
        packet.stale_blocks = 0;
        Warp::sync();
    }

    inline void write(const Scene& scene, const View& view, const Camera& camera, const Packet& packet,
                      const Images& out) const {
        const long long first = (long long)view.index * pixels;
        const bool more = Write::more_than_depth(out);
        const Write::Frame frame = Write::Frame::of(camera);
        for (int index = Warp::lane(); index < (int)SLOTS; index += LANES) {
            const int pixel = __ldg(place + index);
            const float to_depth = __ldg(scale + index);
            if (pixel < 0) continue;
            const Key key = *packet.at(index);
            const float inv_z = to_depth > 0.0f ? Write::inv_z_of(key) : 0.0f, z = Reciprocal::of(inv_z);
            const float depth = __fmul_rn(starts.from_start(z, index), to_depth);
            const bool shown = Write::seen(view, inv_z, depth);
            const Write::Found found = {key, z, shown ? depth : Write::nothing(view, inv_z, depth), shown};
            if (more)
                Write::pixel(scene, frame, camera, packet, out, Write::Spot{first + pixel, 0, 0, index}, found);
            else if (out.depth)
                out.depth[first + pixel] = found.depth;
        }
    }

    // Render and write a packet of a view. If the view's world does not exist, nothing is visible.
    inline void cast(const Scene& scene, const View& view, const Images& out, WarpMemory& memory) const {
        set_camera(scene, view, memory.cameras[WarpMemory::WORLD]);
        Packet packet;
        packet.memory = &memory.pixels;
        packet.first_x = packet.first_y = 0;
        begin(memory.cameras[WarpMemory::WORLD], packet);
        Packets::render(scene, view, packet, memory);
        write(scene, view, memory.cameras[WarpMemory::WORLD], packet, out);
    }
};
static_assert((int)BLOCK_PIXELS == (int)LANES, "a block has a pixel for each lane");
