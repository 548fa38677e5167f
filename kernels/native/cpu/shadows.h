// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Shadows: which lights shine on the visible points of pixels.

#pragma once

#include "cpu/shadow_walk.h"
#include "shared/surfaces.h"

// The images of a call of kernels/shading/shadow_packets.py, and the rows of pixels that a thread writes.
template <class Light>
struct ShadowRows {
    const Light* lights;
    int light_count;
    bool is_limited;  // whether lights end at their reach and cone
    const float *points, *normals, *camera;  // camera: its position
    const int* segmentation;
    long long first, light_step;  // index of the first pixel of the view, and from one light's image to the next
    int view, width, height;
    unsigned char* out;

    enum Kind { AMBIENT, DIRECTIONAL, POINT, SPOT, HEADLIGHT };

    // Rays start above a surface by this multiple of the sum of a point's coordinates and its distance from the camera.
    // The reason is in kernels/shading/shadow_rays.py.
    static constexpr float LIFT = 6e-7f;

    // The pixels of a packet, row by row.
    struct Pixels {
        float p[3][ShadowPacket::HEIGHT][LANES], n[3][ShadowPacket::HEIGHT][LANES];
        int object[ShadowPacket::HEIGHT][LANES];
    };

    inline Pixels read(int y, int x) const {
        Pixels pixels;
        for (int r = 0; r < ShadowPacket::HEIGHT; ++r) {
            const long long place = first + (long long)(y + r) * width + x;
            const int count = y + r < height ? width - x : 0;
            Floats p[3], n[3];
            PixelLanes::load_triples(points + 3 * place, p, count);
            PixelLanes::load_triples(normals + 3 * place, n, count);
            const Ints object = PixelLanes::load(segmentation + place, count);
            Lanes::store(pixels.object[r], Lanes::index() < count ? object : Lanes::all_ints(-1));
            for (int k = 0; k < 3; ++k) Lanes::store(pixels.p[k][r], p[k]), Lanes::store(pixels.n[k][r], n[k]);
        }
        return pixels;
    }
    // The points of a packet that face a light, just above their surfaces; those within its reach and cone, if limited.
    inline ShadowPacket load(const Light& light, const Pixels& pixels, bool is_limited) const {
        ShadowPacket packet;
        packet.light.directional = light.kind == DIRECTIONAL;
        for (int k = 0; k < 3; ++k)
            packet.light.at[k] = packet.light.directional ? -(double)light.direction[k] : (double)light.position[k];
        for (int b = 0; b < ShadowPacket::BLOCKS; ++b) {
            const Ints seen = block<Ints>(pixels.object, b) >= 0;
            Floats p[3], n[3];
            Floats facing = Lanes::all(0.0f), square = facing, along = facing, range = facing, size = facing;
            for (int k = 0; k < 3; ++k) {
                p[k] = block<Floats>(pixels.p[k], b), n[k] = block<Floats>(pixels.n[k], b);
                const Floats offset =
                    packet.light.directional ? Lanes::all(-light.direction[k]) : light.position[k] - p[k];
                const Floats from_camera = p[k] - camera[k];
                facing += n[k] * offset;
                square += offset * offset;
                along -= offset * light.direction[k];
                range += from_camera * from_camera;
                size += Lanes::abs(p[k]);
            }
            Ints lit = seen & (facing > 0.0f);
            if (is_limited && !packet.light.directional) {
                const Floats distance = __builtin_elementwise_sqrt(square);
                lit &= distance <= light.reach;
                if (light.kind == SPOT && !(light.falloff == 0 && light.outer_angle >= 3.14159265f))
                    lit &= along >= light.cos_outer * distance;
            }
            packet.active[b] = Lanes::bits(lit);
            const Floats lift = LIFT * (size + __builtin_elementwise_sqrt(range));
            for (int k = 0; k < 3; ++k)
                packet.at[b][k] = __builtin_convertvector(p[k], Doubles) +
                                  __builtin_convertvector(n[k], Doubles) * __builtin_convertvector(lift, Doubles);
            packet.limit[b] = (Doubles)(1e300);
            if (light.shadow_plane) {
                Doubles ahead = (Doubles)(0.0);
                for (int k = 0; k < 3; ++k)
                    ahead += (packet.at[b][k] - (double)light.position[k]) * (double)light.direction[k];
                packet.limit[b] = ahead;
            }
        }
        return packet;
    }
    // A block of rows of numbers.
    template <class Numbers, class Number>
    static inline Numbers block(const Number (*rows)[LANES], int b) {
        Number found[LANES];
        for (int r = 0; r < BLOCK_SIDE; ++r)
            __builtin_memcpy(found + r * BLOCK_SIDE, rows[r] + b * BLOCK_SIDE, BLOCK_SIDE * sizeof(Number));
        Numbers numbers;
        __builtin_memcpy(&numbers, found, sizeof numbers);
        return numbers;
    }
    // The bits of a row of pixels, from those of blocks.
    static inline unsigned row_bits(const ShadowPacket& packet, int r) {
        unsigned bits = 0;
        for (int b = 0; b < ShadowPacket::BLOCKS; ++b)
            bits |= (packet.active[b] >> r * BLOCK_SIDE & ((1u << BLOCK_SIDE) - 1)) << b * BLOCK_SIDE;
        return bits;
    }
    inline void store(const Light& light, const ShadowPacket& packet, int y, int x) const {
        for (int r = 0; r < ShadowPacket::HEIGHT && y + r < height; ++r) {
            const Ints shine = (Lanes::all_ints((int)row_bits(packet, r)) >> Lanes::index()) & 1;
            const long long place = first + (long long)(y + r) * width + x;
            PixelLanes::store(out + light.shadow * light_step + place, shine * 255, width - x);
        }
    }

    // Write the rows of all lights from y on, of one packet's height.
    inline void write(const Scene& scene, int levels, int y) const {
        const World world = scene.movables.of_view(view);
        Blocker::Visit* stack = (Blocker::Visit*)__builtin_alloca((levels + 2) * LANES * sizeof(Blocker::Visit));
        const Blocker blocker = {scene, world, stack};
        const int* owners = scene.movables.excludes_static(world) ? scene.bvh.owners : nullptr;
        ObjectBoxes boxes;
        int next = 0;
        do {
            boxes.fill(scene.movables, world, next);
            for (int i = 0; i < light_count; ++i) {
                const Light& light = lights[i];
                if (light.shadow < 0 || light.sample_count > 0) continue;
                for (int x = 0; x < width; x += ShadowPacket::WIDTH) {
                    ShadowPacket packet = load(light, read(y, x), is_limited);
                    if (next > 0) keep_lit(light, packet, y, x);
                    if (packet.any() && world.exists) {
                        packet.bound();
                        if (next == 0 && scene.bvh.root >= 0) blocker.tree(packet, scene.bvh.root, owners);
                        if (boxes.count && packet.any()) blocker.objects(packet, boxes);
                    }
                    store(light, packet, y, x);
                }
            }
            next += boxes.count;
        } while (next < scene.movables.count);
    }
    // Keep the points that the objects before have not blocked.
    inline void keep_lit(const Light& light, ShadowPacket& packet, int y, int x) const {
        for (int r = 0; r < ShadowPacket::HEIGHT && y + r < height; ++r) {
            const long long place = first + (long long)(y + r) * width + x;
            const Ints lit = PixelLanes::load(out + light.shadow * light_step + place, width - x);
            const unsigned bits = Lanes::bits(lit != 0);
            for (int b = 0; b < ShadowPacket::BLOCKS; ++b) {
                const unsigned kept = bits >> b * BLOCK_SIDE & ((1u << BLOCK_SIDE) - 1);
                packet.active[b] &= ~(((1u << BLOCK_SIDE) - 1) << r * BLOCK_SIDE) | kept << r * BLOCK_SIDE;
            }
        }
    }
};

// The images of a view, as kernels/shading/shadow_packets.py passes them.
template <class Lights, class Poses, class Worlds, class Vectors, class Objects, class Out>
inline auto shadow_rows(const Lights& lights, const Poses& poses, const Worlds& worlds, const Vectors& points,
                        const Objects& segmentation, const Vectors& normals, const Out& out, int view) {
    const int count = lights.all.shape[1], height = points.shape[1], width = points.shape[2];
    return ShadowRows<typename LightOf<decltype(lights.all.data)>::Type>{
        .lights = lights.all.data + (long long)world_row(worlds, view, lights.all.shape[0]) * count,
        .light_count = count,
        .is_limited = !lights.is_at_vertices,
        .points = (const float*)points.data,
        .normals = (const float*)normals.data,
        .camera = (const float*)(poses.data + view),
        .segmentation = segmentation.data,
        .first = (long long)view * height * width,
        .light_step = (long long)out.strides[0],
        .view = view,
        .width = width,
        .height = height,
        .out = (unsigned char*)out.data,
    };
}
