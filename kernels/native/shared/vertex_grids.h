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
    Whole is_far;  // whether it is the second triangle of the cell

    // Find the edges around a position in `count` cells from `low` to `high`, and return the number of the cell. The
    // first cell has the width `first`, the last one what remains, and the others `step`.
    static inline Real find_edges(Real a, Real low, Real high, Real first, Real step, Real count, Real* edges) {
        const Real counted = Numbers::floor((a - low - first) / step) + 1.0f;
        const Real number = Numbers::min(Numbers::max(counted, Numbers::real(0.0f)), count - 1.0f);
        const Real start = low + first + (number - 1.0f) * step;
        edges[0] = number > 0.0f ? start : low;
        edges[1] = number < count - 1.0f ? start + step : high;
        return number;
    }
    // Select the triangle at a position between the edges. The diagonal goes from (u[1], v[0]) to (u[0], v[1]), or
    // between the other corners where `is_flipped`. At `poles`, the edge v[1] is a point, and there is one triangle.
    inline void select(Real at_u, Real at_v, Whole is_flipped, Whole poles) {
        weight_u = between(u, at_u), weight_v = between(v, at_v);
        reverse(u, weight_u, is_flipped);
        is_far = (weight_u + weight_v > 1.0f) & (poles == 0);
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

// The cells of a box or a rectangle in the world of a view.
struct FlatCells {
    int entry;  // in the arrays of `DeviceMaterials`; -1 for none
    ObjectFrame own;  // in the frame of the object
    float low[3], high[3], first[3], step[3], count[3];

    template <class Grid>
    static inline FlatCells of(const Grid& grid, const ObjectFrame& frame, const Eye& camera) {
        FlatCells cells;
        cells.entry = frame.entry;
        const float* place = (const float*)&grid.place;
        for (int k = 0; k < 3; ++k) cells.own.position[k] = place[k];
        Axes::turn(place + 3, cells.own.axis);
        float eye[3], eye_in_frame[3], eye_in_grid[3];
        for (int k = 0; k < 3; ++k) eye[k] = camera.position[k] - frame.position[k];
        frame.rotate_into(eye, eye_in_frame);
        for (int k = 0; k < 3; ++k) eye[k] = eye_in_frame[k] * frame.inverse_factors[k] - cells.own.position[k];
        cells.own.rotate_into(eye, eye_in_grid);
        for (int k = 0; k < 3; ++k) {
            const float period = grid.period[k];  // an endless grid follows the camera in steps
            const float moved = period > 0.0f ? period * OnePixel::floor(eye_in_grid[k] / period + 0.5f) : 0.0f;
            cells.low[k] = moved - grid.half[k], cells.high[k] = moved + grid.half[k];
            cells.first[k] = grid.first[k], cells.step[k] = grid.step[k], cells.count[k] = (float)grid.count[k];
        }
        return cells;
    }
};

// Finds the triangles that pixels show, and their corners, which depend only on the numbers of the triangles, the
// object and the view. `Shown` is a `Surface`, and `Grid` a `DeviceVertexGrid` of kernels/shading/base_colors.py.
template <class Numbers, class Shown, class Grid>
struct CornerFinder {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Triple<Numbers> Vector;
    typedef TriangleCorners<Numbers> Corners;
    enum Kind { TRIANGLES, BOX, PLANE, BALL, CYLINDER, CAPSULE };
    enum { MAX_CELLS = 4096 };  // along an axis, so that numbers of triangles differ
    // Bits of `number`: whether it is the second triangle of a cell; whether the side is visible that the order of a
    // triangle's corners does not face; the half of an object, by its axis; and its part: flat sides by their axis, or
    // a cylinder's cap or a round end.
    enum {
        IS_FAR = 1,
        IS_BACK = 1,
        IS_BELOW = 2,
        IS_INSIDE = 4,
        ON_X = 8,
        ON_Z = 16,
        ON_CAP = 8,
        ON_END = 16,
        BITS = 5
    };

    const Shown& shown;
    const Grid& grid;
    const FlatCells& cells;  // of boxes and rectangles
    const Vector& flat;  // the normals of the surface in the world
    Whole number;  // of each triangle among those of the object, each of whose sides has its own
    Real weight_b, weight_c;
    Whole face;  // of meshes
    Vector gradient_b, gradient_c;
    CellTriangle<Numbers> cell;  // of others

    static inline bool has_flat_cells(const Grid& grid) { return grid.kind == BOX || grid.kind == PLANE; }
    // The point and the normal of corner k of each triangle of a kind.
    inline void corner(int kind, Whole k, Vector& point, Vector& normal) const {
        if (kind == PLANE || kind == BOX)
            flat_corner(k, point, normal);
        else if (kind == TRIANGLES)
            mesh_corner(k, point, normal);
        else
            round_corner(k, point, normal);
    }
    inline Corners corners(int kind) const {
        Corners corners;
        for (int k = 0; k < 3; ++k) corner(kind, Numbers::whole(k), corners.point[k], corners.normal[k]);
        corners.weight[0] = 1.0f - weight_b - weight_c, corners.weight[1] = weight_b, corners.weight[2] = weight_c;
        return corners;
    }
    inline void locate(int kind) {
        if (kind == PLANE)
            locate_in_flat_cells<true>();
        else if (kind == BOX)
            locate_in_flat_cells<false>();
        else if (kind == TRIANGLES)
            locate_in_triangles();
        else
            locate_in_round_cells();
    }
    // Locate pixels and return the corners: with one branch for both, a GPU needs less memory.
    inline Corners locate_corners() {
        const auto of_kind = [&](int kind) { return locate(kind), corners(kind); };
        if (grid.kind == PLANE) return of_kind(PLANE);
        if (grid.kind == BOX) return of_kind(BOX);
        return grid.kind == TRIANGLES ? of_kind(TRIANGLES) : of_kind(BALL);
    }
    // The triangles of other pixels, whose corners can be computed.
    inline CornerFinder permuted(Whole pixel) const {
        CornerFinder other = *this;
        other.number = Numbers::permuted(number, pixel);
        if (grid.kind == TRIANGLES) {
            other.face = Numbers::permuted(face, pixel);
            const Rows<Numbers> plane =
                Rows<Numbers>::of((const float*)shown.materials.planes.data, Shown::PLANE_NUMBERS,
                                  shown.rows[Shown::CORNERS], other.face, shown.shown_face, false);
            other.gradient_b = plane.triple(3), other.gradient_c = plane.triple(6);
            return other;
        }
        for (int i = 0; i < 2; ++i) {
            other.cell.u[i] = Numbers::permuted(cell.u[i], pixel);
            other.cell.v[i] = Numbers::permuted(cell.v[i], pixel);
        }
        return other;
    }
    // Whether the numbers of triangles differ.
    inline bool has_numbers() const {
        if (grid.kind == TRIANGLES) return shown.has_plane();
        return grid.count[0] <= MAX_CELLS && grid.count[1] <= MAX_CELLS && grid.count[2] <= MAX_CELLS;
    }

  private:
    static inline Whole bit(Whole which, int value) { return which ? Numbers::whole(value) : Numbers::whole(0); }
    inline Whole has(int bit) const { return (number & bit) != 0; }
    // Points of the object's frame in the world.
    inline Vector to_world(const Vector& a) const { return shown.frame.out(a) + Vector::of(shown.frame.position); }
    // The normal of a triangle by the order of its corners, in the world, of any length.
    inline Vector triangle_normal() const {
        return shown.frame.out(gradient_b.cross(gradient_c).times(shown.frame.inverse_factors));
    }
    inline void locate_in_triangles() {
        weight_b = weight_c = Numbers::real(0.0f);
        if (!shown.has_plane()) return;
        weight_b = shown.weight_b, weight_c = shown.weight_c;
        face = shown.face, gradient_b = shown.gradient_b, gradient_c = shown.gradient_c;
        number = face * 2 + bit(triangle_normal().dot(flat) < 0.0f, IS_BACK);
    }
    // The normals as triangles of the mesh; without triangles, the pixels themselves.
    inline void mesh_corner(Whole k, Vector& point, Vector& normal) const {
        if (!shown.has_plane()) {
            point = to_world(shown.point), normal = flat;
            return;
        }
        // The sides ab and ac are dual to the gradients of the weights of b and c.
        const Vector up = gradient_b.cross(gradient_c), none = Vector::all(0.0f);
        const Real inverse = 1.0f / Numbers::max(up.dot(up), Numbers::real(1e-37f));
        const Vector side =
            Vector::select(k == 1, gradient_c.cross(up), Vector::select(k == 2, up.cross(gradient_b), none));
        const Vector a = rows_of(shown.materials.planes.data, Shown::PLANE_NUMBERS, Shown::CORNERS).triple(0);
        point = to_world((a + side * inverse).times(shown.frame.factors));
        normal = triangle_normal();
        if (shown.rows[Shown::NORMALS] >= 0) {
            Rows<Numbers> row = rows_of(shown.materials.normals.data, Shown::NORMAL_NUMBERS, Shown::NORMALS);
            row.start = row.start + k * 3;
            normal = shown.frame.out(row.triple(0).times(shown.frame.inverse_factors));
        }
        normal = normal.direction() * (has(IS_BACK) ? Numbers::real(-1.0f) : Numbers::real(1.0f));
    }
    inline Rows<Numbers> rows_of(const void* numbers, int width, int kind) const {
        return Rows<Numbers>::of((const float*)numbers, width, shown.rows[kind], face, shown.shown_face, false);
    }
    template <bool IS_PLANE>
    inline void locate_in_flat_cells() {
        const ObjectFrame &frame = shown.frame, &own = cells.own;
        const Vector a = own.into(shown.point.times(frame.inverse_factors));
        const Vector turned = Vector{flat.dot(frame.axis[0]), flat.dot(frame.axis[1]), flat.dot(frame.axis[2])};
        const Vector normal = Vector{turned.dot(own.axis[0]), turned.dot(own.axis[1]), turned.dot(own.axis[2])};
        const Real x = Numbers::abs(normal.x), y = Numbers::abs(normal.y), z = Numbers::abs(normal.z);
        const Whole none = Numbers::whole(0), all = Numbers::whole(-1);
        const Whole on_x = IS_PLANE ? none : (x > y) & (x > z), on_z = IS_PLANE ? all : (on_x == 0) & (z >= y);
        // Sides of x are divided along y and z, those of y along x and z, and those of z along x and y.
        const auto of_u = [&](const float* b) {
            return IS_PLANE ? Numbers::real(b[0]) : (on_x ? Numbers::real(b[1]) : Numbers::real(b[0]));
        };
        const auto of_v = [&](const float* b) {
            return IS_PLANE ? Numbers::real(b[1]) : (on_z ? Numbers::real(b[1]) : Numbers::real(b[2]));
        };
        const Real u = IS_PLANE ? a.x : (on_x ? a.y : a.x), v = IS_PLANE ? a.y : (on_z ? a.y : a.z);
        const Real count_u = of_u(cells.count);
        const Real at_u =
            cell.find_edges(u, of_u(cells.low), of_u(cells.high), of_u(cells.first), of_u(cells.step), count_u, cell.u);
        const Real at_v = cell.find_edges(v, of_v(cells.low), of_v(cells.high), of_v(cells.first), of_v(cells.step),
                                          of_v(cells.count), cell.v);
        const Real outside = IS_PLANE ? normal.z : (on_x ? normal.x : (on_z ? normal.z : normal.y));
        const Whole is_below = outside < 0.0f, on_y = (on_x | on_z) == 0;
        cell.select(u, v, IS_PLANE ? none : (on_y ? is_below == 0 : is_below), none);
        weight_b = cell.weight_u, weight_c = cell.weight_v;
        number = Numbers::truncate(at_v * count_u + at_u) * (1 << BITS) + bit(on_x, ON_X) + bit(on_z, ON_Z) +
                 bit(is_below, IS_BELOW) + bit(cell.is_far, IS_FAR);
    }
    inline void flat_corner(Whole k, Vector& point, Vector& normal) const {
        const ObjectFrame &frame = shown.frame, &own = cells.own;
        const Whole on_x = has(ON_X), on_z = has(ON_Z), on_y = (on_x | on_z) == 0, is_below = has(IS_BELOW);
        const Real sign = is_below ? Numbers::real(-1.0f) : Numbers::real(1.0f), none = Numbers::real(0.0f);
        const Vector side = Vector::select(is_below, Vector::of(cells.low), Vector::of(cells.high));
        const Real p = k == 1 ? cell.u[1] : cell.u[0], q = k == 2 ? cell.v[1] : cell.v[0];
        const Vector corner = {on_x ? side.x : p, on_y ? side.y : (on_x ? p : q), on_z ? side.z : q};
        point = to_world((own.out(corner) + Vector::of(own.position)).times(frame.factors));
        normal = frame.out(own.out(Vector{on_x ? sign : none, on_y ? sign : none, on_z ? sign : none}));
    }
    // The radii of a round solid, and half the length of its middle before scaling.
    inline float find_sizes(float* factors, float* inverse) const {
        const ObjectFrame& frame = shown.frame;
        for (int k = 0; k < 3; ++k) {
            factors[k] = frame.has_sizes ? frame.factors[k] : grid.half[k];
            inverse[k] = 1.0f / factors[k];
        }
        return frame.has_sizes ? frame.straight : grid.straight;
    }
    // Round solids. Balls and the ends of capsules are divided by angles, cylinders and the middle of capsules by
    // heights, and the ends of cylinders by radii.
    inline void locate_in_round_cells() {
        const float half_turn = 1.57079633f;
        float factors[3], inverse[3];
        const float straight = find_sizes(factors, inverse);
        const Vector a = shown.point.times(inverse);
        const Real least = Numbers::real(1e-20f), none = Numbers::real(0.0f), all = Numbers::real(1.0f);
        const Real middle = Numbers::real(straight), top = Numbers::real(half_turn);
        const Real radius = Numbers::root(a.x * a.x + a.y * a.y);
        const Whole is_below = a.z < 0.0f;
        const Real above = is_below ? -all : all;
        const Whole on_cap = Numbers::abs(flat.dot(shown.frame.axis[2])) > (grid.kind == CYLINDER ? 0.5f : 2.0f);
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
        const Real at_u = cell.find_edges(u, none, turn, slice, slice, Numbers::real(slices), cell.u);
        const Real at_v = cell.find_edges(v, low, high, stack, stack, count, cell.v);
        const Whole first_pole = (on_cap | on_end) & (cell.v[0] == low), last_pole = on_end & (cell.v[1] == high);
        cell.swap(cell.v, first_pole);
        cell.select(u, v, on_cap & (above > 0.0f) & (first_pole == 0), first_pole | last_pole);
        weight_b = cell.weight_u, weight_c = cell.weight_v;
        const Vector outside = {on_cap ? none : a.x, on_cap ? none : a.y, on_cap ? above : (on_end ? height : none)};
        const Whole is_inside = shown.frame.out(outside.times(inverse)).dot(flat) < 0.0f;
        number = Numbers::truncate(at_v * slices + at_u) * (1 << BITS) + bit(on_cap, ON_CAP) + bit(on_end, ON_END) +
                 bit(is_below, IS_BELOW) + bit(is_inside, IS_INSIDE) + bit(cell.is_far, IS_FAR);
    }
    inline void round_corner(Whole k, Vector& point, Vector& normal) const {
        float factors[3], inverse[3];
        const Real middle = Numbers::real(find_sizes(factors, inverse));
        const Real none = Numbers::real(0.0f), all = Numbers::real(1.0f), above = has(IS_BELOW) ? -all : all;
        const Whole on_cap = has(ON_CAP), on_end = has(ON_END);
        const Real p = k == 1 ? cell.u[1] : cell.u[0], q = k == 2 ? cell.v[1] : cell.v[0];
        const Real across = Powers<Numbers>::cosine(p), along = Powers<Numbers>::cosine(p - 1.57079633f);
        const Real flatter = on_end ? Powers<Numbers>::cosine(q) : all;
        const Real upward = on_cap ? above : (on_end ? Powers<Numbers>::sine(q) : none);
        const Real ring = on_cap ? q : flatter, slope = on_cap ? none : flatter;
        const Real z = on_cap ? above * middle : (on_end ? upward + above * middle : q);
        point = to_world(Vector{ring * across, ring * along, z}.times(factors));
        const Vector turned = Vector{slope * across, slope * along, upward}.times(inverse);
        normal = shown.frame.out(turned).direction() * (has(IS_INSIDE) ? -all : all);
    }
};

// Return a finder of the triangles of a surface of a `ColorRow`. `cells` may be those of another object, which are
// replaced.
template <class Numbers, class Row>
inline auto corner_finder(const Row& row, const typename Row::Shown& shown, FlatCells& cells,
                          const Triple<Numbers>& flat) {
    const auto& grid = row.materials.vertex_grids.data[row.frame.entry];
    typedef CornerFinder<Numbers, typename Row::Shown, typename Row::template Value<decltype(&grid)>::Type> Finder;
    if (Finder::has_flat_cells(grid) && (Numbers::PIXELS == 1 || cells.entry != row.frame.entry))
        cells = FlatCells::of(grid, row.frame, row.camera);
    return Finder{shown, grid, cells, flat};
}
