// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Shadow volumes: the points whose segment to a light, or whose ray toward it, crosses a triangle or a solid.
//
// Points are relative to the center of a packet, so that double precision has digits to spare. Numbers are `double`, or
// one double per lane: the formulas are those of both devices.

#pragma once

#include "shared/constants.h"

// A light in some frame: its position, or if it is directional, the direction toward it, of any length.
struct LightPlace {
    bool directional;
    double at[3];
};

// The type of the lights of an array.
template <class Pointer>
struct LightOf;
template <class Light>
struct LightOf<Light*> {
    typedef Light Type;
};

// The shadow volume of a triangle: points p with n.p + k >= 0 for four planes. Three contain the light and an edge, and
// the last is the triangle's, beyond which points are in shadow.
template <class Number>
struct ShadowVolume {
    typedef decltype(Number() < Number()) Truth;
    enum { CAP = 3, PLANES = 4 };
    // Share of the terms of n.p + k that covers their rounding, 8 steps of 2^-53: triangles that share an edge overlap
    // by it, so that no ray slips between them.
    static constexpr double OVERLAP = 9e-16;

    struct Plane {
        Number normal[3], offset;
    };
    Plane plane[PLANES];
    // For a directional light, n.p + k of the last plane, per unit of the ray's parameter.
    Number steepness;

    // `corner` are corners a, b and c relative to the center, and `reach` bounds the coordinates of the points.
    static inline ShadowVolume of(const Number (*corner)[3], const LightPlace& light, double reach) {
        ShadowVolume volume;
        Number edge[3][3], from[3][3];  // from the light, or its direction of travel
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k) {
                edge[i][k] = corner[(i + 1) % 3][k] - corner[i][k];
                from[i][k] = light.directional ? corner[i][k] * 0.0 - light.at[k] : corner[i][k] - light.at[k];
            }
        cross(edge[0], edge[1], volume.plane[CAP].normal);
        // Positive if the light is on the side that the normal points away from.
        const Number side = dot(volume.plane[CAP].normal, from[0]);
        volume.steepness = size(side);
        const Number sign = side < 0.0 ? side * 0.0 - 1.0 : side * 0.0 + 1.0;
        for (int i = 0; i < 3; ++i) {
            cross(from[i], edge[i], volume.plane[i].normal);
            for (int k = 0; k < 3; ++k) volume.plane[i].normal[k] *= sign;
            volume.plane[i].offset = OVERLAP * sum(from[i]) * sum(edge[i]) * (sum(corner[i]) + reach) -
                                     dot(volume.plane[i].normal, corner[i]);
        }
        for (int k = 0; k < 3; ++k) volume.plane[CAP].normal[k] *= sign;
        volume.plane[CAP].offset = -dot(volume.plane[CAP].normal, corner[0]);
        // A triangle that the light sees edge-on, or that is a line, blocks nothing.
        volume.plane[CAP].offset = side == 0.0 ? side * 0.0 - 1e300 : volume.plane[CAP].offset;
        return volume;
    }
    // Whether a point is in the volume, if the ray's parameter at the triangle is at most `limit`.
    inline Truth contains(double x, double y, double z, double limit) const {
        const Number beyond = value(CAP, x, y, z);
        Truth inside = (beyond >= 0.0) & (beyond <= steepness * limit);
        for (int i = 0; i < CAP; ++i) inside &= value(i, x, y, z) >= 0.0;
        return inside;
    }
    inline Number value(int index, double x, double y, double z) const {
        const Number* n = plane[index].normal;
        return n[0] * x + n[1] * y + n[2] * z + plane[index].offset;
    }
    // The greatest n.p + k of a plane in a box.
    inline Number greatest(int index, const double* center, const double* half) const {
        const Number* n = plane[index].normal;
        return plane[index].offset + (n[0] * center[0] + n[1] * center[1] + n[2] * center[2]) +
               (size(n[0]) * half[0] + size(n[1]) * half[1] + size(n[2]) * half[2]);
    }

    static inline Number size(Number a) { return a < 0.0 ? -a : a; }
    static inline Number sum(const Number* a) { return size(a[0]) + size(a[1]) + size(a[2]); }
    static inline Number dot(const Number* a, const Number* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
    static inline void cross(const Number* a, const Number* b, Number* product) {
        for (int k = 0; k < 3; ++k) {
            const int i = (k + 1) % 3, j = (k + 2) % 3;
            product[k] = a[i] * b[j] - a[j] * b[i];
        }
    }
};

// Whether rays o + t d with 0 <= t <= limit cross the surface of a solid from either side, in the frame in which it is
// a unit ball, or a cylinder of radius 1 about z: see kernels/casting/solids.py.
template <class Number>
struct SolidShadow {
    typedef decltype(Number() < Number()) Truth;

    static inline Truth crosses(int kind, double half, const Number* o, const Number* d, Number limit) {
        if (kind == SOLID_BALL) return ball(o, d, 0.0, limit);
        const Truth side = tube(o, d, half, limit);
        if (kind == SOLID_CYLINDER) return side | end(o, d, half, limit) | end(o, d, -half, limit);
        return side | ball(o, d, half, limit) | ball(o, d, -half, limit);
    }

  private:
    static inline Number dot(const Number* a, const Number* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
    static inline Number root(Number a) {
        const Number positive = a > 0.0 ? a : a * 0.0;
#if defined(__CUDA_ARCH__)
        return sqrt(positive);
#else
        return __builtin_elementwise_sqrt(positive);
#endif
    }

    // The unit ball about a height on the axis. The discriminant without cancellation is A - |o x d|^2.
    static inline Truth ball(const Number* o, const Number* d, double height, Number limit) {
        const Number p[3] = {o[0], o[1], o[2] - height};
        const Number e[3] = {p[1] * d[2] - p[2] * d[1], p[2] * d[0] - p[0] * d[2], p[0] * d[1] - p[1] * d[0]};
        const Number a = dot(d, d), b = dot(p, d), c = dot(p, p) - 1.0, square = a - dot(e, e), near = root(square);
        const Truth enters = (c > 0.0) & (b < 0.0) & (-b - near <= limit * a);
        const Truth leaves = (c <= 0.0) & (near - b <= limit * a);
        return (square >= 0.0) & (a > 0.0) & (enters | leaves);
    }
    static inline Truth tube(const Number* o, const Number* d, double half, Number limit) {
        const Number e = o[0] * d[1] - o[1] * d[0], a = d[0] * d[0] + d[1] * d[1], b = o[0] * d[0] + o[1] * d[1];
        const Number c = o[0] * o[0] + o[1] * o[1] - 1.0, square = a - e * e, near = root(square);
        const Number inverse = 1.0 / (a > 0.0 ? a : a * 0.0 + 1.0);
        const Number enter = (-b - near) * inverse, leave = (near - b) * inverse;
        const Number low = o[2] + enter * d[2], high = o[2] + leave * d[2];
        const Truth enters = (c > 0.0) & (enter >= 0.0) & (enter <= limit) & (low <= half) & (low >= -half);
        const Truth leaves = (leave >= 0.0) & (leave <= limit) & (high <= half) & (high >= -half);
        return (square >= 0.0) & (a > 0.0) & (enters | leaves);
    }
    static inline Truth end(const Number* o, const Number* d, double height, Number limit) {
        const Number steep = d[2] < 0.0 ? -d[2] : d[2];
        const Number t = (height - o[2]) / (steep > 0.0 ? d[2] : d[2] * 0.0 + 1.0);
        const Number x = o[0] + t * d[0], y = o[1] + t * d[1];
        return (steep > 0.0) & (t >= 0.0) & (t <= limit) & (x * x + y * y <= 1.0);
    }
};
