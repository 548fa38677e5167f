// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Packets of points that look at one light: blocks of pixels, the shafts from their boxes to the light, and their rays.

#pragma once

#include "cpu/number_lanes.h"
#include "shared/pose.h"
#include "shared/shadow_volumes.h"

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

// The convex hull of the box of a packet and its light, or the box swept toward a directional light: bounds along the
// axes, and lines in the three planes of two axes that touch the box and contain, or are parallel to, the light.
struct Shaft {
    enum { LINES = 6 };

    float least[3], greatest[3];  // relative to the packet's center
    float line[LINES][2], offset[LINES];  // n.x + offset >= 0 in the shaft; axes of line i: i / 2 and the next one

    // Share of coordinates that covers their rounding in single precision, and that of the products and sums of a line.
    static constexpr float SLACK = 1e-6f;

    static inline Shaft of(const ShadowPacket& packet) {
        const double center[3] = {0, 0, 0};
        return of(packet.light, center, packet.half);
    }
    // The shaft of a box; the light, and the shaft, are relative to a center, as the center of the box is.
    static inline Shaft of(const LightPlace& light, const double* center, const double* box_half) {
        Shaft shaft;
        double half[3], at[3];
        for (int k = 0; k < 3; ++k) {
            at[k] = light.directional ? light.at[k] : light.at[k] - center[k];
            half[k] = box_half[k] * (1.0 + 1e-6) + 1e-6 * __builtin_fabs(center[k]) + 1e-30;
            double low = -half[k], high = half[k];
            if (light.directional) {
                low = at[k] < 0 ? -(double)NOWHERE : low;
                high = at[k] > 0 ? (double)NOWHERE : high;
            } else {
                const double margin = SLACK * __builtin_fabs(at[k]);
                low = at[k] - margin < low ? at[k] - margin : low;
                high = at[k] + margin > high ? at[k] + margin : high;
            }
            shaft.least[k] = (float)(low + center[k]), shaft.greatest[k] = (float)(high + center[k]);
        }
        for (int axis = 0; axis < 3; ++axis) {
            const int i = axis, j = (axis + 1) % 3;
            if (light.directional) {
                shaft.set(2 * axis, -at[j], at[i], 0, 0, half[i], half[j]);
                shaft.set(2 * axis + 1, at[j], -at[i], 0, 0, half[i], half[j]);
                continue;
            }
            // The corners of the rectangle at which lines from the light touch it.
            const int beside = at[i] > half[i] ? 1 : at[i] < -half[i] ? -1 : 0;
            const int above = at[j] > half[j] ? 1 : at[j] < -half[j] ? -1 : 0;
            double corner[2][2];
            if (beside != 0 && above != 0) {
                corner[0][0] = beside * half[i], corner[0][1] = -above * half[j];
                corner[1][0] = -beside * half[i], corner[1][1] = above * half[j];
            } else if (beside != 0) {
                corner[0][0] = corner[1][0] = beside * half[i];
                corner[0][1] = half[j], corner[1][1] = -half[j];
            } else {
                corner[0][1] = corner[1][1] = above * half[j];
                corner[0][0] = half[i], corner[1][0] = -half[i];
            }
            for (int c = 0; c < 2; ++c) {
                const double x = corner[c][0], y = corner[c][1];
                double n[2] = {at[j] - y, x - at[i]};
                // The center of the rectangle is in the shaft.
                if (n[0] * x + n[1] * y > 0) n[0] = -n[0], n[1] = -n[1];
                if (beside == 0 && above == 0) n[0] = n[1] = 0;
                shaft.set(2 * axis + c, n[0], n[1], x, y, half[i], half[j]);
            }
        }
        for (int i = 0; i < LINES; ++i)
            shaft.offset[i] -= (float)(shaft.line[i][0] * center[i / 2] + shaft.line[i][1] * center[(i / 2 + 1) % 3]);
        return shaft;
    }
    // Set a line with a normal through a point, or of the rectangle of a directional light.
    inline void set(int index, double nx, double ny, double x, double y, double half_x, double half_y) {
        const double size = __builtin_fabs(nx) > __builtin_fabs(ny) ? __builtin_fabs(nx) : __builtin_fabs(ny);
        const double scale = size > 0 ? 1.0 / size : 0.0;
        nx *= scale, ny *= scale;
        const double margin = __builtin_fabs(nx) * half_x + __builtin_fabs(ny) * half_y;
        const bool parallel = x == 0 && y == 0;
        line[index][0] = (float)nx, line[index][1] = (float)ny;
        offset[index] = (float)((parallel ? margin : -(nx * x + ny * y)) + 4e-6 * margin + 1e-37);
    }

    // Which boxes, relative to the center and not empty, may reach into the shaft.
    inline Ints meets(const Points& low, const Points& high) const {
        const Floats lows[3] = {low.x, low.y, low.z}, highs[3] = {high.x, high.y, high.z};
        Floats from[3], to[3];
        Ints inside = Lanes::all_ints(-1);
        for (int k = 0; k < 3; ++k) {
            from[k] = lows[k] - SLACK * Lanes::abs(lows[k]);
            to[k] = highs[k] + SLACK * Lanes::abs(highs[k]);
            inside &= (from[k] <= greatest[k]) & (to[k] >= least[k]);
        }
        for (int i = 0; i < LINES; ++i) {
            const int x = i / 2, y = (x + 1) % 3;
            const Floats farthest =
                (line[i][0] < 0.0f ? from[x] : to[x]) * line[i][0] + (line[i][1] < 0.0f ? from[y] : to[y]) * line[i][1];
            inside &= farthest + offset[i] >= 0.0f;
        }
        return inside;
    }
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
