// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Processing of one packet, from its view's pose to its part of the images.

#pragma once

#include "cuda/output.h"

struct Packets {
    static inline Camera camera_of(const View& view) {
        Vec3d axis[3];  // right, down and forward in the world
        PoseRow::axes(view.pose, axis);
        Camera camera;
        camera.exact_origin = PoseRow::position(view.pose);
        camera.origin = camera.exact_origin.rounded();
        camera.origin_error = Vec3{0.0f, 0.0f, 0.0f};
        camera.stretch = Vec3{1.0f, 1.0f, 1.0f};
        for (int i = 0; i < 3; ++i) {
            const double f = i < 2 ? view.focal[i] : 1.0;
            camera.exact_rays[i] = Vec3d::times(axis[i], 1.0 / f);
            camera.to_camera[i] = Vec3d::times(axis[i], f).rounded();
            camera.rows[i] = f * f;
        }
        camera.first_u = (float)(0.5 - view.center[0]);
        camera.first_v = (float)(0.5 - view.center[1]);
        // The exact rays compensate for the rounding of these values.
        const double error[2] = {0.5 - view.center[0] - camera.first_u, 0.5 - view.center[1] - camera.first_v};
        for (int i = 0; i < 2; ++i)
            camera.exact_rays[2] = Vec3d::minus(camera.exact_rays[2], Vec3d::times(camera.exact_rays[i], -error[i]));
        camera.last_x = (float)(view.width - 1);
        camera.last_y = (float)(view.height - 1);
        camera.far = view.far * FARTHER;
        camera.near = NearPlane{view.clip_inv_z, view.clip_reach};
        camera.extent = Three::max(0.5f * ((float)(view.focal[0] + view.focal[1]) + camera.last_x + camera.last_y),
                                   fabsf(camera.first_u), fabsf(camera.first_v));
        camera.per_extent = 1.0f / camera.extent;
        const float fx = (float)view.focal[0], fy = (float)view.focal[1];
        camera.set_errors(fx, fy);
        camera.blur = ROUNDING * ((fx + fy) + camera.last_x + camera.last_y);
        return camera;
    }

    // Whether the camera is outside the boxes of all closed objects that it sees, with none cut by the near plane, so
    // that their back faces are hidden behind their front faces.
    static inline bool outside_all(const ClosedObjects& closed, const unsigned char* excluded, const Camera& camera) {
        bool inside = false;
        for (int i = Warp::lane(); i < closed.count; i += LANES)
            inside |= Box::holds(closed.boxes + BOX_WORDS * i, Vec3{1.0f, 1.0f, 1.0f}, camera.origin, camera.near) &&
                      !(excluded && excluded[__ldg(closed.object + i)]);
        return !Warp::any(inside);
    }

    // Find one object for a view, called by all lanes; `object` may exceed the number of objects.
    static inline void find(const Scene& scene, const View& view, int object) {
        if (!scene.movables.poses) return;
        const bool is_object = object < scene.movables.count;
        ObjectPass::find(camera_of(view), scene.movables, scene.found, is_object ? object : scene.movables.count - 1,
                         is_object);
    }

    // Draw and write a view's packet. If the view's world does not exist, nothing is visible.
    static inline void cast(const Scene& scene, const View& view, const Images& out, int packet_x, int packet_y,
                            WarpMemory& memory) {
        {
            Camera camera = camera_of(view);
            set_sides(scene, view, camera);
            if (Warp::lane() == 0) memory.cameras[WarpMemory::WORLD] = camera;
        }
        Packet packet;
        packet.memory = &memory.pixels;
        packet.first_x = Warp::uniform(packet_x * PACKET_WIDTH);
        packet.first_y = Warp::uniform(packet_y * PACKET_HEIGHT);
        packet.begin(view.width - packet.first_x, view.height - packet.first_y);
        render(scene, view, packet, memory);
        Write::images(scene, view, memory.cameras[WarpMemory::WORLD], packet, out);
    }
    // The same for rays of a table or points, of which a view has `count`; the camera is in shared memory.
    template <class Rays>
    static inline void cast_slots(const Scene& scene, const View& view, const Rays& rays, int count, const Images& out,
                                  WarpMemory& memory, bool has_rays = true) {
        Camera& camera = memory.cameras[WarpMemory::WORLD];
        set_sides(scene, view, camera);
        Packet packet;
        packet.memory = &memory.pixels;
        packet.first_x = rays.first_x, packet.first_y = rays.first_y;
        packet.begin_slots(camera, rays);
        if (has_rays) render(scene, view, packet, memory);
        Write::slots(scene, view, camera, packet, rays, count, out);
    }

    // Set which sides of triangles a camera sees. All lanes write the same values, which may be in shared memory.
    static inline void set_sides(const Scene& scene, const View& view, Camera& camera) {
        const bool outside = outside_all(scene.closed, scene.bvh.excluded, camera);
        camera.skip_back_faces = outside;
        // If all objects are closed, skip the lookup of owners by culling all back faces.
        camera.cull_back_faces = view.cull_back_faces || (outside && scene.bvh.all_closed);
    }
    static inline void render(const Scene& scene, const View& view, Packet& packet, WarpMemory& memory) {
        const bool exists = !MOVABLE || scene.movables.poses;
        if (MOVABLE && exists)
            ObjectPass::render(scene, view, packet, memory);
        else if (scene.bvh.root >= 0 && exists)
            Walk::traverse(scene.bvh, memory.cameras[WarpMemory::WORLD], packet, memory.levels, memory.walk);
        Warp::sync();
    }
};
