// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Soft shadows and ambient occlusion: the fraction of a light's points, or of directions, that surfaces do not block.
//
// Packets have a common light. So that adjacent pixels may have different points of it, a packet consists of every
// fourth pixel of every fourth row: pixels of one class of warpvis/scene/light_samples.py.

#pragma once

#include "cpu/shadows.h"

// A right-handed frame whose third axis is a unit vector (Duff et al. 2017, "Building an Orthonormal Basis,
// Revisited"); as `across_of` of kernels/shading/shadow_rays.py.
struct LightFrame {
    float across[2][3];

    template <class Vector>
    static inline LightFrame of(const Vector& axis) {
        const float x = axis[0], y = axis[1], z = axis[2], sign = z < 0.0f ? -1.0f : 1.0f;
        const float a = -1.0f / (sign + z), b = x * y * a;
        return {{{1.0f + sign * x * x * a, sign * b, -sign * x}, {b, sign + y * y * a, -y}}};
    }
};

template <class Light>
struct SoftRows {
    typedef ShadowRows<Light> Rows;
    enum { SIDE = 4, HEIGHT = SIDE * ShadowPacket::HEIGHT, WIDTH = SIDE * ShadowPacket::WIDTH };

    const Rows& rows;
    const Scene& scene;
    const Blocker& blocker;
    const World& world;
    ObjectBoxes& boxes;
    const int* owners;

    // The pixels of a class, from its first one on.
    inline typename Rows::Pixels read(int y, int x) const {
        typename Rows::Pixels pixels;
        for (int r = 0; r < ShadowPacket::HEIGHT; ++r) {
            for (int i = 0; i < LANES; ++i) {
                const int row = y + SIDE * r, column = x + SIDE * i;
                const bool is_inside = row < rows.height && column < rows.width;
                const long long place = is_inside ? rows.first + (long long)row * rows.width + column : rows.first;
                pixels.object[r][i] = is_inside ? rows.segmentation[place] : -1;
                for (int k = 0; k < 3; ++k) {
                    pixels.p[k][r][i] = rows.points[3 * place + k];
                    pixels.n[k][r][i] = rows.normals[3 * place + k];
                }
            }
        }
        return pixels;
    }
    // Deactivate the points that surfaces block.
    inline void block(ShadowPacket& packet) const {
        if (!packet.any() || !world.exists) return;
        packet.bound();
        if (scene.bvh.root >= 0) blocker.tree(packet, scene.bvh.root, owners);
        for (int next = 0; next < scene.movables.count && packet.any(); next += boxes.count) {
            if (scene.movables.count > ObjectBoxes::CAPACITY) boxes.fill(scene.movables, world, next);
            blocker.objects(packet, boxes);
        }
    }
    // Write values of blocks of pixels, in the order of their lanes.
    inline void store(unsigned char* out, const unsigned char (*values)[LANES], int y, int x) const {
        for (int b = 0; b < ShadowPacket::BLOCKS; ++b) {
            for (int i = 0; i < LANES; ++i) {
                const int row = y + SIDE * (i / BLOCK_SIDE), column = x + SIDE * (b * BLOCK_SIDE + i % BLOCK_SIDE);
                if (row < rows.height && column < rows.width)
                    out[rows.first + (long long)row * rows.width + column] = values[b][i];
            }
        }
    }
    // Call a function of the first pixel and the class of each packet of the rows from y on.
    template <class Function>
    inline void each_packet(int y, const Function& function) const {
        for (int part = 0; part < SIDE * SIDE; ++part) {
            const int row = y + part / SIDE;
            if (row >= rows.height) continue;
            for (int x = part % SIDE; x < rows.width; x += WIDTH) function(row, x, part);
        }
    }

    // Write the fraction of a light's points that shine on each pixel, of those above the plane of its surface; 0 where
    // the center of the light does not shine on it without other surfaces.
    inline void light(const Light& light, const float* samples, int y) const {
        const LightFrame frame = LightFrame::of(light.direction);
        each_packet(y, [&](int row, int x, int part) {
            const typename Rows::Pixels pixels = read(row, x);
            const ShadowPacket center = rows.load(light, pixels, rows.is_limited);
            unsigned char values[ShadowPacket::BLOCKS][LANES] = {};
            Ints above[ShadowPacket::BLOCKS] = {}, lit[ShadowPacket::BLOCKS] = {};
            for (int i = 0; i < light.sample_count && center.any(); ++i) {
                const float* s = samples + 3 * (light.first_sample + (long long)part * light.sample_count + i);
                ShadowPacket packet = rows.load(moved(light, frame, s), pixels, false);
                for (int b = 0; b < ShadowPacket::BLOCKS; ++b) {
                    packet.active[b] &= center.active[b];
                    above[b] += ones(packet.active[b]);
                }
                block(packet);
                for (int b = 0; b < ShadowPacket::BLOCKS; ++b) lit[b] += ones(packet.active[b]);
            }
            for (int b = 0; b < ShadowPacket::BLOCKS; ++b)
                for (int i = 0; i < LANES; ++i)
                    if (above[b][i])
                        values[b][i] = (unsigned char)((510 * lit[b][i] + above[b][i]) / (2 * above[b][i]));
            store(rows.out + light.shadow * rows.light_step, values, row, x);
        });
    }
    // The light at one of its points.
    static inline Light moved(const Light& light, const LightFrame& frame, const float* s) {
        Light at = light;
        float length = 0.0f;
        for (int k = 0; k < 3; ++k) {
            const float aside = light.radius * (s[0] * frame.across[0][k] + s[1] * frame.across[1][k]);
            at.position[k] = light.position[k];
            if (light.kind != Rows::DIRECTIONAL)
                at.position[k] += aside + light.radius * s[2] * light.direction[k];
            else
                at.direction[k] = light.direction[k] + aside;
            length += at.direction[k] * at.direction[k];
        }
        const float scale = 1.0f / __builtin_sqrtf(length);
        for (int k = 0; k < 3; ++k) at.direction[k] *= scale;
        return at;
    }

    // Write the fraction of ambient light that surfaces within a distance do not block, by directions of each class:
    // the mean over those above the surface, weighted by their cosines.
    inline void ambient(const float* directions, int count, float distance, int y) const {
        Light light = {};
        light.kind = Rows::DIRECTIONAL;
        each_packet(y, [&](int row, int x, int part) {
            const typename Rows::Pixels pixels = read(row, x);
            unsigned char values[ShadowPacket::BLOCKS][LANES];
            Floats all[ShadowPacket::BLOCKS] = {}, open[ShadowPacket::BLOCKS] = {};
            for (int i = 0; i < count; ++i) {
                const float* d = directions + 3 * ((long long)part * count + i);
                for (int k = 0; k < 3; ++k) light.direction[k] = -d[k];
                ShadowPacket packet = rows.load(light, pixels, false);
                Floats cosine[ShadowPacket::BLOCKS];
                for (int b = 0; b < ShadowPacket::BLOCKS; ++b) {
                    packet.limit[b] = (Doubles)((double)distance);
                    cosine[b] = Lanes::all(0.0f);
                    for (int k = 0; k < 3; ++k) cosine[b] += d[k] * Rows::template block<Floats>(pixels.n[k], b);
                    all[b] += ones(packet.active[b]) != 0 ? cosine[b] : Lanes::all(0.0f);
                }
                block(packet);
                for (int b = 0; b < ShadowPacket::BLOCKS; ++b)
                    open[b] += ones(packet.active[b]) != 0 ? cosine[b] : Lanes::all(0.0f);
            }
            for (int b = 0; b < ShadowPacket::BLOCKS; ++b)
                for (int i = 0; i < LANES; ++i)
                    values[b][i] = all[b][i] > 0.0f ? (unsigned char)(255.0f * (open[b][i] / all[b][i]) + 0.5f) : 255;
            store(rows.out, values, row, x);
        });
    }
    static inline Ints ones(unsigned bits) { return (Lanes::all_ints((int)bits) >> Lanes::index()) & 1; }
};

// Call a function of the `SoftRows` of a view.
template <class Rows, class Light, class Function>
inline void soft_rows(const Rows& rows, const Light*, const Scene& scene, int levels, const Function& function) {
    const World world = scene.movables.of_view(rows.view);
    Blocker::Visit* stack = (Blocker::Visit*)__builtin_alloca((levels + 2) * LANES * sizeof(Blocker::Visit));
    const Blocker blocker = {scene, world, stack};
    ObjectBoxes boxes;
    boxes.fill(scene.movables, world, 0);
    const int* owners = scene.movables.excludes_static(world) ? scene.bvh.owners : nullptr;
    function(SoftRows<Light>{rows, scene, blocker, world, boxes, owners});
}
