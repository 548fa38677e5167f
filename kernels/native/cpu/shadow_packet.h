// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Packets of points that look at one light: blocks of pixels, and their rays.

#pragma once

#include "cpu/number_lanes.h"
#include "shared/pose.h"
#include "shared/shafts.h"

typedef decltype((Doubles)(0.0) < (Doubles)(0.0)) Longs;  // masks of Doubles

// The points of a row of blocks of 4 x 4 pixels, relative to a center, in the world or in the frame of an object.
struct ShadowPacket {
    enum { BLOCKS = 4, HEIGHT = BLOCK_SIDE, WIDTH = BLOCKS * BLOCK_SIDE };

    double center[3];  // of their box; in single precision without loss
    double half[3];  // of the box
    double block_center[BLOCKS][3], block_half[BLOCKS][3];  // of the boxes of blocks, relative to the center
    Doubles at[BLOCKS][3];
    Doubles limit[BLOCKS];  // greatest parameter of a ray toward a directional light at which a surface blocks it
    unsigned active[BLOCKS];  // points that nothing blocks yet
    LightPlace light;  // relative to the center

    inline bool any() const {
        unsigned all = 0;
        for (int b = 0; b < BLOCKS; ++b) all |= active[b];
        return all != 0;
    }

    // Bound the active points, of the packet and of each block; their coordinates and the light's become relative to
    // the packet's center.
    inline void bound() {
        for (int k = 0; k < 3; ++k) {
            double low[BLOCKS], high[BLOCKS], least = 1e300, greatest = -1e300;
            for (int b = 0; b < BLOCKS; ++b) {
                if (active[b] == 0) continue;
                const Longs which = lanes_of(active[b]);
                low[b] = __builtin_reduce_min(which ? at[b][k] : (Doubles)(1e300));
                high[b] = __builtin_reduce_max(which ? at[b][k] : (Doubles)(-1e300));
                least = low[b] < least ? low[b] : least;
                greatest = high[b] > greatest ? high[b] : greatest;
            }
            const double middle = (float)(0.5 * (least + greatest));
            half[k] = greatest - middle > middle - least ? greatest - middle : middle - least;
            center[k] = middle;
            for (int b = 0; b < BLOCKS; ++b) {
                if (active[b] == 0) continue;
                at[b][k] -= middle;
                block_center[b][k] = 0.5 * (low[b] + high[b]) - middle;
                block_half[b][k] = 0.5 * (high[b] - low[b]) + 1e-15 * (half[k] + __builtin_fabs(middle));
            }
            if (!light.directional) light.at[k] -= middle;
        }
    }
    inline Shaft shaft() const {
        const double middle[3] = {0, 0, 0};
        return Shaft::of(light, middle, half);
    }
    // The points and the light in the frame of an object, divided by factors along its axes.
    inline ShadowPacket seen_from(const Pose& object, const double* factors) const {
        ShadowPacket moved;
        double from[3], to_light[3];
        for (int k = 0; k < 3; ++k) {
            from[k] = center[k] - object.position[k];
            to_light[k] = light.directional ? light.at[k] : light.at[k] + from[k];
        }
        moved.light.directional = light.directional;
        for (int i = 0; i < 3; ++i) {
            const double* axis = object.axis[i];
            const double scale = 1.0 / factors[i];
            const double x = axis[0] * scale, y = axis[1] * scale, z = axis[2] * scale;
            const double start = from[0] * x + from[1] * y + from[2] * z;
            moved.light.at[i] = to_light[0] * x + to_light[1] * y + to_light[2] * z;
            for (int b = 0; b < BLOCKS; ++b) moved.at[b][i] = at[b][0] * x + at[b][1] * y + at[b][2] * z + start;
        }
        __builtin_memcpy(moved.limit, limit, sizeof limit);
        __builtin_memcpy(moved.active, active, sizeof active);
        return moved;
    }

    static inline Longs lanes_of(unsigned bits) {
        const Ints lanes = (Lanes::all_ints((int)bits) >> Lanes::index()) & 1;
        return __builtin_convertvector(lanes, Longs) != 0;
    }
    static inline unsigned bits_of(Longs mask) { return Lanes::bits(__builtin_convertvector(mask, Ints)); }
};

// The rays of the points of a block to a light, in single precision relative to the center of a packet.
struct BlockRays {
    Floats origin[3], inverse[3], limit;
    float margin;

    static inline BlockRays of(const ShadowPacket& packet, int b) {
        BlockRays rays;
        const Floats limit = __builtin_convertvector(packet.limit[b], Floats);
        rays.limit = packet.light.directional ? 1.00001f * limit : Lanes::all(1.00001f);
        double reach = 0;
        for (int k = 0; k < 3; ++k) {
            rays.origin[k] = __builtin_convertvector(packet.at[b][k], Floats);
            const Floats to_light = Lanes::all((float)packet.light.at[k]);
            const Floats along = packet.light.directional ? to_light : to_light - rays.origin[k];
            rays.inverse[k] = 1.0f / (Lanes::abs(along) < 1e-18f ? Lanes::all(1e-18f) : along);
            reach += packet.half[k];
        }
        rays.margin = (float)(Shaft::SLACK * reach);
        return rays;
    }
    // Which rays may enter box k of boxes relative to the center.
    inline unsigned enter(const float (*low)[LANES], const float (*high)[LANES], int k) const {
        Floats begin = Lanes::all(0.0f), end = limit;
        for (int i = 0; i < 3; ++i) {
            const float from = low[i][k] - Shaft::SLACK * __builtin_fabsf(low[i][k]) - margin;
            const float to = high[i][k] + Shaft::SLACK * __builtin_fabsf(high[i][k]) + margin;
            const Floats near = (from - origin[i]) * inverse[i], far = (to - origin[i]) * inverse[i];
            begin = Lanes::max(begin, Lanes::min(near, far));
            end = Lanes::min(end, Lanes::max(near, far));
        }
        return Lanes::bits(begin <= end * 1.00001f);
    }
};
