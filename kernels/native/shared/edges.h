// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Whether a ray meets a triangle, where single precision cannot tell.
//
// Of the edge values at a pixel in single precision, those of two triangles that share the edge need not fit, nor those
// of all that meet at a corner: a ray would slip between them. So where a value is within what rounding may change of
// it, its sign is that of the corners as they are stored, in double precision; and what is within rounding of that is
// inside of both triangles.

// An edge's value may be wrong by this part of the product of how far apart the triangle's corners are and how far
// away, both in pixels times depth. Of millions of triangles made to be hard, the worst was wrong by 0.81 of it.
constexpr float EDGE_DOUBT = 1.5e-7f;

// Pixels within so much of a triangle may be looked at, however small it is.
constexpr float EDGE_DOUBT_MIN = 0.01f;

// The same of double precision, eight roundings.
constexpr double EXACT_DOUBT = 1e-15;

// One triangle seen from where rays begin, in the frame of its tree.
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
    // Negative where the front is seen; 0 where the plane is seen edge-on, as nearly as can be told.
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
        return size(value) > EXACT_DOUBT * size(ab) * size(ac) * size(corner[0]) ? value : 0.0;
    }

    // Whether a ray meets it, on an edge or a corner too. What is seen edge-on meets nothing: its neighbours do.
    inline bool meet(const double* ray) const { return meet(ray, volume()); }
    inline bool meet(const double* ray, double volume) const {
        const double sign = volume < 0 ? -1.0 : 1.0;
        return volume != 0.0 && inside(corner[1], corner[2], ray, sign) && inside(corner[2], corner[0], ray, sign) &&
               inside(corner[0], corner[1], ray, sign);
    }
    // Whether a ray passes on that side of an edge where the triangle is, or through the edge. The plane through the
    // edge, from the nearer of its ends: beside that one, rounding of the farther one would be many pixels' worth.
    static inline bool inside(const double* a, const double* b, const double* ray, double sign) {
        double apart[3], plane[3];
        minus(a, b, apart);
        const double* nearer = size(a) < size(b) ? a : b;
        cross(apart, nearer, plane);
        return sign * dot(plane, ray) >= -EXACT_DOUBT * size(apart) * size(nearer) * size(ray);
    }
};
