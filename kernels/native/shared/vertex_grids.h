// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The vertices at which the fixed-function pipeline computes light: the corners of an object's triangles, or those of
// the cells into which a renderer divides a box, a rectangle or a round solid.

#pragma once

#include "shared/surfaces.h"

// The corners of the triangle that each pixel shows, in the world, and its barycentric coordinates.
template <class Numbers>
struct TriangleCorners {
    typedef typename Numbers::Real Real;
    typedef Triple<Numbers> Vector;
    enum { COUNT = 3 };
    Vector point[COUNT], normal[COUNT];
    Real weight[COUNT];

    inline Vector share(int k, const Vector& color) const { return color * weight[k]; }
};

// A cell between two edges along u and two along v, and the triangle of it that a pixel shows. The corners of the
// triangle are (u[0], v[0]), (u[1], v[0]) and (u[0], v[1]).
template <class Numbers>
struct CellTriangle {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    Real u[2], v[2], weight_u, weight_v;

    // Find the edges around a position in `count` cells from `low` to `high`. The first cell has the width `first`, the
    // last one what remains, and the others `step`.
    static inline void find_edges(Real a, Real low, Real high, Real first, Real step, Real count, Real* edges) {
        const Real counted = Numbers::floor((a - low - first) / step) + 1.0f;
        const Real number = Numbers::min(Numbers::max(counted, Numbers::real(0.0f)), count - 1.0f);
        const Real start = low + first + (number - 1.0f) * step;
        edges[0] = number > 0.0f ? start : low;
        edges[1] = number < count - 1.0f ? start + step : high;
    }
    // Select the triangle at a position between the edges. The diagonal goes from (u[1], v[0]) to (u[0], v[1]), or
    // between the other corners where `is_flipped`. At `poles`, the edge v[1] is a point, and there is one triangle.
    inline void select(Real at_u, Real at_v, Whole is_flipped, Whole poles) {
        weight_u = between(u, at_u), weight_v = between(v, at_v);
        reverse(u, weight_u, is_flipped);
        const Whole is_far = (weight_u + weight_v > 1.0f) & (poles == 0);
        reverse(u, weight_u, is_far), reverse(v, weight_v, is_far);
        weight_u = poles ? weight_u * (1.0f - weight_v) : weight_u;
    }
    // Swap two edges, and count from the other one.
    static inline void reverse(Real* edges, Real& weight, Whole which) {
        swap(edges, which);
        weight = which ? 1.0f - weight : weight;
    }
    static inline void swap(Real* edges, Whole which) {
        const Real first = edges[0];
        edges[0] = which ? edges[1] : first, edges[1] = which ? first : edges[1];
    }
    static inline Real between(const Real* edges, Real a) {
        const Real width = edges[1] - edges[0];
        const Real share = (a - edges[0]) / (width == 0.0f ? Numbers::real(1.0f) : width);
        return Numbers::min(Numbers::max(share, Numbers::real(0.0f)), Numbers::real(1.0f));
    }
};

// Finds the corners of the triangles that pixels show. `Shown` is a `Surface`, and `Grid` a `DeviceVertexGrid` of
// kernels/shading/base_colors.py.
template <class Numbers, class Shown, class Grid>
struct CornerFinder {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Triple<Numbers> Vector;
    typedef TriangleCorners<Numbers> Corners;
    enum Kind { TRIANGLES, BOX, PLANE, BALL, CYLINDER, CAPSULE };

    const Shown& shown;
    const Grid& grid;
    const Vector& flat;  // the normals of the surface in the world

    inline Corners find() const {
        if (grid.kind == BOX || grid.kind == PLANE) return of_flat_cells();
        if (grid.kind != TRIANGLES) return of_round_cells();
        return of_triangles();
    }

  private:
    static inline void weigh(Corners& corners, Real b, Real c) {
        corners.weight[0] = 1.0f - b - c, corners.weight[1] = b, corners.weight[2] = c;
    }
    // Points and normals of the object's frame in the world.
    inline Vector to_world(const Vector& a) const { return shown.frame.out(a) + Vector::of(shown.frame.position); }
    // The normals as triangles of the mesh; without triangles, the pixels themselves.
    inline Corners of_triangles() const {
        Corners corners;
        if (!shown.has_plane()) {
            for (int k = 0; k < 3; ++k) corners.point[k] = to_world(shown.point), corners.normal[k] = flat;
            weigh(corners, Numbers::real(0.0f), Numbers::real(0.0f));
            return corners;
        }
        // The sides ab and ac are dual to the gradients of the weights of b and c.
        const Vector normal = shown.gradient_b.cross(shown.gradient_c);
        const Real inverse = 1.0f / Numbers::max(normal.dot(normal), Numbers::real(1e-37f));
        const Vector a = shown.rows_of(shown.materials.planes.data, Shown::PLANE_NUMBERS, Shown::CORNERS).triple(0);
        const Vector at[3] = {a, a + shown.gradient_c.cross(normal) * inverse,
                              a + normal.cross(shown.gradient_b) * inverse};
        for (int k = 0; k < 3; ++k)
            corners.point[k] = to_world(at[k].times(shown.frame.factors)), corners.normal[k] = flat;
        weigh(corners, shown.weight_b, shown.weight_c);
        if (shown.rows[Shown::NORMALS] < 0) return corners;
        const Rows<Numbers> row = shown.rows_of(shown.materials.normals.data, Shown::NORMAL_NUMBERS, Shown::NORMALS);
        const Real outside = shown.frame.out(normal.times(shown.frame.inverse_factors)).dot(flat);
        const Real side = outside < 0.0f ? Numbers::real(-1.0f) : Numbers::real(1.0f);
        for (int k = 0; k < 3; ++k) {
            const Vector turned = shown.frame.out(row.triple(3 * k).times(shown.frame.inverse_factors));
            corners.normal[k] = turned.direction() * side;
        }
        return corners;
    }
    // Boxes and rectangles.
    inline Corners of_flat_cells() const {
        const ObjectFrame& frame = shown.frame;
        ObjectFrame own;  // of the grid, in the frame of the object
        const float* place = (const float*)&grid.place;
        for (int k = 0; k < 3; ++k) own.position[k] = place[k];
        Axes::turn(place + 3, own.axis);
        float eye[3], eye_in_frame[3], eye_in_grid[3], low[3], high[3], first[3], step[3], count[3];
        for (int k = 0; k < 3; ++k) eye[k] = shown.camera.position[k] - frame.position[k];
        frame.rotate_into(eye, eye_in_frame);
        for (int k = 0; k < 3; ++k) eye[k] = eye_in_frame[k] * frame.inverse_factors[k] - own.position[k];
        own.rotate_into(eye, eye_in_grid);
        for (int k = 0; k < 3; ++k) {
            const float period = grid.period[k];  // an endless grid follows the camera in steps
            const float moved = period > 0.0f ? period * OnePixel::floor(eye_in_grid[k] / period + 0.5f) : 0.0f;
            low[k] = moved - grid.half[k], high[k] = moved + grid.half[k];
            first[k] = grid.first[k], step[k] = grid.step[k], count[k] = (float)grid.count[k];
        }
        const Vector a = own.into(shown.point.times(frame.inverse_factors));
        const Vector turned = Vector{flat.dot(frame.axis[0]), flat.dot(frame.axis[1]), flat.dot(frame.axis[2])};
        const Vector normal = Vector{turned.dot(own.axis[0]), turned.dot(own.axis[1]), turned.dot(own.axis[2])};
        const Real x = Numbers::abs(normal.x), y = Numbers::abs(normal.y), z = Numbers::abs(normal.z);
        const Whole all = Numbers::whole(grid.kind == PLANE ? -1 : 0), none = Numbers::whole(0);
        const Whole on_x = (x > y) & (x > z) & (all == 0), on_z = ((on_x == 0) & (z >= y)) | all;
        const Whole on_y = (on_x == 0) & (on_z == 0);
        // Sides of x are divided along y and z, those of y along x and z, and those of z along x and y.
        const auto of_u = [&](const float* b) { return on_x ? Numbers::real(b[1]) : Numbers::real(b[0]); };
        const auto of_v = [&](const float* b) { return on_z ? Numbers::real(b[1]) : Numbers::real(b[2]); };
        const Real u = on_x ? a.y : a.x, v = on_z ? a.y : a.z;
        CellTriangle<Numbers> cell;
        cell.find_edges(u, of_u(low), of_u(high), of_u(first), of_u(step), of_u(count), cell.u);
        cell.find_edges(v, of_v(low), of_v(high), of_v(first), of_v(step), of_v(count), cell.v);
        const Whole below = (on_x & (normal.x < 0.0f)) | (on_z & (normal.z < 0.0f)) | (on_y & (normal.y > 0.0f));
        cell.select(u, v, below & (all == 0), none);
        Corners corners;
        weigh(corners, cell.weight_u, cell.weight_v);
        for (int k = 0; k < 3; ++k) {
            const Real p = cell.u[k == 1], q = cell.v[k == 2];
            const Vector corner = {on_x ? a.x : p, on_y ? a.y : (on_x ? p : q), on_z ? a.z : q};
            const Vector moved = own.out(corner) + Vector::of(own.position);
            corners.point[k] = to_world(moved.times(frame.factors)), corners.normal[k] = flat;
        }
        return corners;
    }
    // Round solids. Balls and the ends of capsules are divided by angles, cylinders and the middle of capsules by
    // heights, and the ends of cylinders by radii.
    inline Corners of_round_cells() const {
        const ObjectFrame& frame = shown.frame;
        const float half_turn = 1.57079633f, straight = frame.has_sizes ? frame.straight : grid.straight;
        float factors[3], inverse[3];
        for (int k = 0; k < 3; ++k) {
            factors[k] = frame.has_sizes ? frame.factors[k] : grid.half[k];
            inverse[k] = 1.0f / factors[k];
        }
        const Vector a = shown.point.times(inverse);
        const Real least = Numbers::real(1e-20f), none = Numbers::real(0.0f), all = Numbers::real(1.0f);
        const Real middle = Numbers::real(straight), top = Numbers::real(half_turn);
        const Real radius = Numbers::root(a.x * a.x + a.y * a.y);
        const Real above = a.z < 0.0f ? -all : all;
        const Whole on_cap = Numbers::abs(flat.dot(frame.axis[2])) > (grid.kind == CYLINDER ? 0.5f : 2.0f);
        const Whole on_end = Numbers::abs(a.z) >= (grid.kind == CYLINDER ? 3e38f : grid.kind == BALL ? 0.0f : straight);
        const Real height = a.z - above * middle;
        const Real distance = Numbers::root(radius * radius + height * height);
        const Real elevation = top - Powers<Numbers>::arc_cosine(height / Numbers::max(distance, least));
        const Real side = Powers<Numbers>::arc_cosine(a.x / Numbers::max(radius, least));
        const Real u = a.y < 0.0f ? 4.0f * half_turn - side : side;
        const Real v = on_cap ? radius : (on_end ? elevation : a.z);
        const Real low = on_cap ? none : (on_end ? -top : -middle), high = on_cap ? all : (on_end ? top : middle);
        const float slices = (float)grid.count[0], stacks = (float)grid.count[1], rings = (float)grid.count[2];
        const Real count =
            on_cap ? Numbers::real(rings) : (on_end ? Numbers::real(2.0f * rings) : Numbers::real(stacks));
        const Real turn = Numbers::real(4.0f * half_turn), slice = turn / slices, stack = (high - low) / count;
        CellTriangle<Numbers> cell;
        cell.find_edges(u, none, turn, slice, slice, Numbers::real(slices), cell.u);
        cell.find_edges(v, low, high, stack, stack, count, cell.v);
        const Whole first_pole = (on_cap | on_end) & (cell.v[0] == low), last_pole = on_end & (cell.v[1] == high);
        cell.swap(cell.v, first_pole);
        cell.select(u, v, on_cap & (above > 0.0f) & (first_pole == 0), first_pole | last_pole);
        Corners corners;
        weigh(corners, cell.weight_u, cell.weight_v);
        for (int k = 0; k < 3; ++k) {
            const Real p = cell.u[k == 1], q = cell.v[k == 2];
            const Real across = Powers<Numbers>::cosine(p), along = Powers<Numbers>::cosine(p - half_turn);
            const Real flatter = on_end ? Powers<Numbers>::cosine(q) : all;
            const Real upward = on_cap ? above : (on_end ? Powers<Numbers>::sine(q) : none);
            const Real ring = on_cap ? q : flatter;
            const Real z = on_cap ? above * middle : (on_end ? upward + above * middle : q);
            corners.point[k] = to_world(Vector{ring * across, ring * along, z}.times(factors));
            const Real slope = on_cap ? none : flatter;
            const Vector turned = frame.out(Vector{slope * across, slope * along, upward}.times(inverse)).direction();
            corners.normal[k] = turned * (turned.dot(flat) < 0.0f ? -all : all);
        }
        return corners;
    }
};

template <class Numbers, class Shown, class Grid>
inline TriangleCorners<Numbers> find_corners(const Shown& shown, const Grid& grid, const Triple<Numbers>& flat) {
    return CornerFinder<Numbers, Shown, Grid>{shown, grid, flat}.find();
}
