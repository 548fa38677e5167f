// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Exact ray-triangle test, for cases that single precision cannot decide.
//
// In single precision, the edge functions of two triangles that share an edge may disagree at a pixel, as may those of
// all triangles that share a corner, so that a ray could slip between them. To be watertight, an edge function whose
// magnitude is within its rounding error bound is evaluated in double precision from the corners as stored; a value
// within the error bound of double precision counts as inside both triangles.

#pragma once

#include "shared/error_bounds.h"

// A triangle relative to the ray origin, in the frame of its tree.
struct ExactCorners {
    double corner[3][3];

    static inline double size(double a) { return a < 0 ? -a : a; }
    static inline double size(const double* v) { return size(v[0]) + size(v[1]) + size(v[2]); }
    static inline void minus(const double* a, const double* b, double* c) {
        for (int k = 0; k < 3; ++k) c[k] = a[k] - b[k];
    }
    static inline double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
    static inline void cross(const double* a, const double* b, double* c) {
        c[0] = a[1] * b[2] - a[2] * b[1];
        c[1] = a[2] * b[0] - a[0] * b[2];
        c[2] = a[0] * b[1] - a[1] * b[0];
    }

    inline void normal(double* to) const {
        double ab[3], ac[3];
        minus(corner[1], corner[0], ab);
        minus(corner[2], corner[0], ac);
        cross(ab, ac, to);
    }
    // Signed volume of the tetrahedron of the triangle and the ray origin, up to a factor: negative if the ray origin
    // is on the front side; 0 if the plane is seen edge-on within the rounding error bound.
    inline double volume() const {
        double to[3];
        normal(to);
        return volume(to);
    }
    inline double volume(const double* normal) const {
        double ab[3], ac[3];
        minus(corner[1], corner[0], ab);
        minus(corner[2], corner[0], ac);
        const double value = dot(normal, corner[0]);
        return size(value) > EXACT_ERROR_BOUND * size(ab) * size(ac) * size(corner[0]) ? value : 0.0;
    }

    // Whether a ray hits the triangle, edges and corners included. Edge-on triangles are never hit; the adjacent
    // triangles cover those pixels.
    inline bool meet(const double* ray) const { return meet(ray, volume()); }
    inline bool meet(const double* ray, double volume) const {
        const double sign = volume < 0 ? -1.0 : 1.0;
        return volume != 0.0 && inside(corner[1], corner[2], ray, sign) && inside(corner[2], corner[0], ray, sign) &&
               inside(corner[0], corner[1], ray, sign);
    }
    // Whether a ray passes on the inner side of an edge, or through the edge. The plane through the edge is computed
    // from the nearer end: the rounding error of the farther one would amount to many pixels there.
    static inline bool inside(const double* a, const double* b, const double* ray, double sign) {
        double edge[3], plane[3];
        minus(a, b, edge);
        const double* nearer = size(a) < size(b) ? a : b;
        cross(edge, nearer, plane);
        return sign * dot(plane, ray) >= -EXACT_ERROR_BOUND * size(edge) * size(nearer) * size(ray);
    }
};
