// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Shadows: which lights shine on the visible points of a block of pixels, one per lane; on the CPU: cpu/shadows.h.

#pragma once

#include "cuda/shadow_walk.h"
#include "shared/worlds.h"

// This lane's pixel of a view.
struct ShadowPixel {
    enum { DIRECTIONAL = 1, SPOT = 3 };  // kinds of lights
    // Rays start above a surface by this multiple of the sum of a point's coordinates and its distance from the camera.
    // The reason is in kernels/shading/shadow_rays.py.
    static constexpr float LIFT = 6e-7f;
    static constexpr float PI = 3.14159265f;

    bool is_seen;
    float point[3], normal[3];
    double start[3];  // just above the surface

    static inline ShadowPixel of(const float* points, const float* normals, const float* camera, bool is_seen) {
        ShadowPixel pixel;
        pixel.is_seen = is_seen;
        float size = 0.0f, square = 0.0f;
        for (int k = 0; k < 3; ++k) {
            pixel.point[k] = points[k], pixel.normal[k] = normals[k];
            const float from_camera = points[k] - camera[k];
            size += fabsf(points[k]);
            square += from_camera * from_camera;
        }
        const float lift = LIFT * (size + sqrtf(square));
        for (int k = 0; k < 3; ++k) pixel.start[k] = (double)pixel.point[k] + (double)pixel.normal[k] * lift;
        return pixel;
    }
    // Whether the surface faces a light and is, if it is limited, within the light's reach and cone.
    template <class Light>
    inline bool can_be_lit(const Light& light, bool is_limited) const {
        const bool directional = light.kind == DIRECTIONAL;
        float facing = 0.0f, square = 0.0f, along = 0.0f;
        for (int k = 0; k < 3; ++k) {
            const float offset = directional ? -light.direction[k] : light.position[k] - point[k];
            facing += normal[k] * offset;
            square += offset * offset;
            along -= offset * light.direction[k];
        }
        if (!is_seen || !(facing > 0.0f)) return false;
        if (directional || !is_limited) return true;
        const float distance = sqrtf(square);
        const bool is_open = light.kind != SPOT || (light.falloff == 0 && light.outer_angle >= PI);
        return distance <= light.reach && (is_open || along >= light.cos_outer * distance);
    }
    // The point at which a ray toward a light starts, in the world. All lanes have the same light, which is written.
    template <class Light>
    inline ShadowPoint point_of(const Light& light, LightPlace& place) const {
        ShadowPoint found;
        const bool directional = light.kind == DIRECTIONAL;
        double ahead = 0.0;
        for (int k = 0; k < 3; ++k) {
            found.at[k] = start[k];
            ahead += (start[k] - light.position[k]) * light.direction[k];
            if (Warp::lane() == k) place.at[k] = directional ? -(double)light.direction[k] : (double)light.position[k];
        }
        if (Warp::lane() == 0) place.directional = directional;
        found.limit = light.shadow_plane ? ahead : (double)NOWHERE;
        Warp::sync();
        return found;
    }
};

// The images of a call of kernels/shading/shadow_packets_cuda.py.
template <class Light>
struct ShadowBlocks {
    const Light* lights;  // of a view's world
    int light_count;
    bool is_limited;  // whether lights end at their reach and cone
    const float *points, *normals, *camera;  // camera: its position
    const int* segmentation;
    int view, width, height;
    long long light_step;  // from one light's image to the next
    unsigned char* out;

    // Write a block of pixels for all lights that surfaces may block, but for soft ones.
    inline void write(const Scene& scene, int packet_y, int packet_x, ShadowMemory& memory) const {
        const int y = packet_y * BLOCK_HEIGHT + Warp::lane() / BLOCK_WIDTH;
        const int x = packet_x * BLOCK_WIDTH + Warp::lane() % BLOCK_WIDTH;
        const bool is_inside = y < height && x < width;
        const long long place = is_inside ? ((long long)view * height + y) * width + x : 0;
        const ShadowPixel pixel =
            ShadowPixel::of(points + 3 * place, normals + 3 * place, camera, is_inside && segmentation[place] >= 0);
        const ShadowWalk walk = {scene, memory};
        const bool exists = scene.movables.moving == 0 || scene.movables.poses;  // the world
        for (int i = 0; i < light_count; ++i) {
            const Light& light = lights[i];
            if (light.shadow < 0 || light.sample_count > 0) continue;
            const ShadowPoint point = pixel.point_of(light, memory.world.light);
            unsigned lit = Warp::ballot(pixel.can_be_lit(light, is_limited));
            if (lit != 0 && exists) lit = walk.lit(point, lit);
            if (is_inside) out[light.shadow * light_step + place] = lit >> Warp::lane() & 1 ? 255 : 0;
            Warp::sync();
        }
    }
};

template <class Lights, class Poses, class Worlds, class Vectors, class Objects, class Out>
inline auto shadow_blocks(const Lights& lights, const Poses& poses, const Worlds& worlds, const Vectors& points,
                          const Objects& segmentation, const Vectors& normals, const Out& out, int view) {
    const int count = lights.all.shape[1], height = points.shape[1], width = points.shape[2];
    ShadowBlocks<typename LightOf<decltype(lights.all.data)>::Type> blocks;
    blocks.lights = lights.all.data + (long long)world_row(worlds, view, lights.all.shape[0]) * count;
    blocks.light_count = count, blocks.is_limited = !lights.is_at_vertices;
    blocks.points = (const float*)points.data;
    blocks.normals = (const float*)normals.data;
    blocks.camera = (const float*)(poses.data + view);
    blocks.segmentation = segmentation.data;
    blocks.view = view, blocks.width = width, blocks.height = height;
    blocks.light_step = (long long)points.shape[0] * height * width;
    blocks.out = (unsigned char*)out.data;
    return blocks;
}
