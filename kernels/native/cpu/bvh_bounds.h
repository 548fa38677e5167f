// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/bvh_split.h"

// Bounds that a node stores for a child: its box and a cone that contains all its normals. A cone consists of an axis
// and a cutoff, the sine of its half angle plus a margin; the cutoff is never() if the cone does not bound the normals.
template <int LANES>
struct Bounds {
    typedef float Floats __attribute__((ext_vector_type(LANES)));
    typedef double Doubles __attribute__((ext_vector_type(LANES)));
    typedef int Ints __attribute__((ext_vector_type(LANES)));
    typedef decltype((Doubles)(0.0) < (Doubles)(0.0)) Truths;  // mask of a comparison of Doubles

    static constexpr float never() { return 2.0f; }
    static constexpr double min_cosine() { return 0.0872; }  // cosine of 85 degrees
    static constexpr double margin() { return 1e-3; }

    static float cutoff(double cosine) {
        if (!(cosine > min_cosine())) return never();
        const double sine_squared = 1.0 - cosine * cosine;
        const double result = __builtin_sqrt(sine_squared > 0.0 ? sine_squared : 0.0) + margin();
        return result < 1.0 ? (float)result : never();
    }

    // Normalized sum of the vectors, rounded to single precision as stored.
    static bool mean_axis(Doubles x, Doubles y, Doubles z, float* axis) {
        double sx = 0.0, sy = 0.0, sz = 0.0;
        for (int k = 0; k < LANES; ++k) sx += x[k], sy += y[k], sz += z[k];
        const double length = __builtin_sqrt(sx * sx + sy * sy + sz * sz);
        if (!(length > 1e-6)) return false;
        axis[0] = (float)(sx / length), axis[1] = (float)(sy / length), axis[2] = (float)(sz / length);
        return true;
    }

    static Doubles root(Doubles x) { return __builtin_elementwise_sqrt(__builtin_elementwise_max(x, (Doubles)(0.0))); }

    static double minimum_of(Doubles x) {
        double minimum = x[0];
        for (int k = 1; k < LANES; ++k) minimum = x[k] < minimum ? x[k] : minimum;
        return minimum;
    }

    // Compute the NODE_ROWS numbers of a leaf. Normals are computed in double precision: those of slivers are
    // inaccurate in single precision.
    static void of_leaf(const float* leaf, bool closed, float* bounds) {
        Floats row[LEAF_ROWS];
        __builtin_memcpy(row, leaf, sizeof(row));
        for (int axis = 0; axis < 3; ++axis) {
            const Floats a = row[axis], b = row[3 + axis], c = row[6 + axis];
            bounds[NODE_LOW_ROW + axis] =
                __builtin_reduce_min(__builtin_elementwise_min(a, __builtin_elementwise_min(b, c)));
            bounds[NODE_HIGH_ROW + axis] =
                __builtin_reduce_max(__builtin_elementwise_max(a, __builtin_elementwise_max(b, c)));
        }
        for (int axis = 0; axis < 3; ++axis) bounds[CONE_AXIS_ROW + axis] = 0.0f;
        bounds[CONE_CUTOFF_ROW] = never();
        if (!closed) return;
        Doubles corner[LEAF_ROWS];
        for (int r = 0; r < LEAF_ROWS; ++r) corner[r] = __builtin_convertvector(row[r], Doubles);
        const Doubles ux = corner[3] - corner[0], uy = corner[4] - corner[1], uz = corner[5] - corner[2];
        const Doubles vx = corner[6] - corner[0], vy = corner[7] - corner[1], vz = corner[8] - corner[2];
        Doubles nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
        const Doubles squared = nx * nx + ny * ny + nz * nz;
        const Truths flat = !(squared > (Doubles)(1e-300));
        const Doubles scale = flat ? (Doubles)(0.0) : 1.0 / __builtin_elementwise_sqrt(squared);
        nx *= scale, ny *= scale, nz *= scale;
        if (!mean_axis(nx, ny, nz, bounds + CONE_AXIS_ROW)) return;
        const float* axis = bounds + CONE_AXIS_ROW;
        const Doubles cosine = nx * (double)axis[0] + ny * (double)axis[1] + nz * (double)axis[2];
        bounds[CONE_CUTOFF_ROW] = cutoff(minimum_of(flat ? (Doubles)(1.0) : cosine));
    }

    // Compute the NODE_ROWS numbers of a node from its rows. The half angle of the cone is the largest sum of the angle
    // between the axes and a child's half angle.
    static void of_node(const float* node, const int* children, float* bounds) {
        Floats row[NODE_ROWS];
        __builtin_memcpy(row, node, sizeof(row));
        for (int axis = 0; axis < 3; ++axis) {
            bounds[NODE_LOW_ROW + axis] = __builtin_reduce_min(row[NODE_LOW_ROW + axis]);
            bounds[NODE_HIGH_ROW + axis] = __builtin_reduce_max(row[NODE_HIGH_ROW + axis]);
        }
        for (int axis = 0; axis < 3; ++axis) bounds[CONE_AXIS_ROW + axis] = 0.0f;
        bounds[CONE_CUTOFF_ROW] = never();
        Ints used;
        __builtin_memcpy(&used, children, sizeof(used));
        used = used != 0;
        if (__builtin_reduce_max(used ? row[CONE_CUTOFF_ROW] : (Floats)(0.0f)) >= 1.0f) return;
        const Doubles x = __builtin_convertvector(used ? row[CONE_AXIS_ROW] : (Floats)(0.0f), Doubles);
        const Doubles y = __builtin_convertvector(used ? row[CONE_AXIS_ROW + 1] : (Floats)(0.0f), Doubles);
        const Doubles z = __builtin_convertvector(used ? row[CONE_AXIS_ROW + 2] : (Floats)(0.0f), Doubles);
        if (!mean_axis(x, y, z, bounds + CONE_AXIS_ROW)) return;
        const float* axis = bounds + CONE_AXIS_ROW;
        const Doubles between =
            __builtin_elementwise_min(x * (double)axis[0] + y * (double)axis[1] + z * (double)axis[2], (Doubles)(1.0));
        const Doubles sine = __builtin_convertvector(row[CONE_CUTOFF_ROW], Doubles);
        const Doubles cosine = between * root(1.0 - sine * sine) - root(1.0 - between * between) * sine;
        bounds[CONE_CUTOFF_ROW] = cutoff(minimum_of(__builtin_convertvector(used, Truths) ? cosine : (Doubles)(1.0)));
    }
};

// The triangles and the properties of their objects.
struct Mesh {
    const float* vertices;
    const int* faces;
    const int* owner;  // [triangle]: object index
    const unsigned char* closed;  // [object]
};

// Contents of leaves, as in warpvis/scene/acceleration/bvh.py.
template <int LANES>
struct Leaves {
    float* rows;  // [leaf][LEAF_ROWS][lane]
    int* triangles;  // [leaf][lane]
    int* owners;  // [leaf][lane]
    float* bounds;  // [leaf][NODE_ROWS]

    // `range` holds the first item of each leaf and the end of its items.
    inline void fill(const Mesh& mesh, const v8* items, const int* range, long long leaf) const {
        const int begin = range[2 * leaf], count = range[2 * leaf + 1] - begin;
        float* target = rows + leaf * LEAF_ROWS * LANES;
        bool all_closed = true;
        for (int k = 0; k < LANES; ++k) {
            const int triangle = Items::triangle(items[begin + (k < count ? k : 0)]);
            const int* corners = mesh.faces + 3 * (long long)triangle;
            const int first = first_corner(mesh.vertices, corners);
            triangles[leaf * LANES + k] = k < count ? triangle : -1;
            owners[leaf * LANES + k] = mesh.owner[triangle];
            all_closed &= mesh.closed[mesh.owner[triangle]] != 0;
            for (int corner = 0; corner < 3; ++corner) {
                const float* p = mesh.vertices + 3 * (long long)corners[k < count ? (first + corner) % 3 : 0];
                for (int axis = 0; axis < 3; ++axis) target[(3 * corner + axis) * LANES + k] = p[axis];
            }
        }
        Bounds<LANES>::of_leaf(target, all_closed, bounds + leaf * NODE_ROWS);
    }

    // Index of the corner opposite to the longest side, which is stored first. Casters compute a triangle's normal from
    // the two sides that meet there, and its rounding error is proportional to the product of their lengths: the two
    // long sides of a sliver would give it an error larger than its area. kernels/bvh/refit.py chooses the same corner:
    // L1 distances have no products, which a compiler may round in different ways.
    static inline int first_corner(const float* vertices, const int* corners) {
        float opposite[3];
        for (int k = 0; k < 3; ++k)
            opposite[k] = l1_distance(vertices + 3 * (long long)corners[(k + 1) % 3],
                                      vertices + 3 * (long long)corners[(k + 2) % 3]);
        const int first = opposite[1] > opposite[0] ? 1 : 0;
        return opposite[2] > opposite[first] ? 2 : first;
    }
    static inline float l1_distance(const float* a, const float* b) {
        float sum = 0.0f;
        for (int axis = 0; axis < 3; ++axis) sum += a[axis] > b[axis] ? a[axis] - b[axis] : b[axis] - a[axis];
        return sum;
    }
};

template <int LANES>
struct Nodes {
    // Compute bounds from the last node to the first: a node's children follow it.
    static void fit(const int* children, const float* leaf_bounds, int count, float* nodes) {
        for (long long node = count - 1; node >= 0; --node) {
            float* rows = nodes + node * NODE_ROWS * LANES;
            for (int k = 0; k < LANES; ++k) {
                const int child = children[node * LANES + k];
                float bounds[NODE_ROWS] = {NOWHERE,  NOWHERE, NOWHERE, -NOWHERE, -NOWHERE,
                                           -NOWHERE, 0.0f,    0.0f,    0.0f,     Bounds<LANES>::never()};
                if (child < 0) __builtin_memcpy(bounds, leaf_bounds + (long long)~child * NODE_ROWS, sizeof(bounds));
                if (child > 0)
                    Bounds<LANES>::of_node(nodes + (long long)child * NODE_ROWS * LANES,
                                           children + (long long)child * LANES, bounds);
                for (int r = 0; r < NODE_ROWS; ++r) rows[r * LANES + k] = bounds[r];
            }
        }
    }
};
