// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rasterization of a leaf's triangles: small ones one pixel of each at a time, large ones block by block, slivers row
// by row.

#pragma once

#include "cpu/pixels.h"

// Least ratio of inv_z in a block to the slope of the plane for which sums in single precision suffice.
constexpr float STEEPEST = 0.1f;

struct Raster : Pixels {
    using Pixels::rasterize_uncertain, Pixels::find_uncertain;  // overloaded below

    // Functions with a mode are always inlined, so that each mode of the traversal has its own instantiation.
    //
    // Triangles of at most this many pixels per side are rasterized together, one per lane.
    enum { SMALL_SIDE = 6 };
    // Triangles that touch at most this many blocks are rasterized block by block, without a test of tiles.
    enum { MAX_BLOCKS = 20 };
    // Larger triangles that cover less than one pixel per this number of rows are rasterized row by row.
    enum { ROWS_OF_PIXEL = 2 };

    static inline __attribute__((always_inline)) void rasterize(const Camera& camera, const Image& image,
                                                                const Triangles& triangles, Mode mode) {
        // By size in the whole view: the method must not depend on where a strip cuts a triangle.
        const Ints small = triangles.shown & (triangles.x1 - triangles.x0 < Lanes::all_ints(SMALL_SIDE)) &
                           (triangles.view_y1 - triangles.view_y0 < Lanes::all_ints(SMALL_SIDE));
        Ints inexact = triangles.inexact;
        if (Lanes::any(small)) rasterize_small(camera, image, triangles, small, inexact, mode);
        const Ints larger = triangles.shown & ~small;
        if (!Lanes::any(larger)) return;
        inexact |= has_unstable_plane(camera, triangles);
        const Ints blocks = ((triangles.x1 >> BLOCK_SHIFT) - (triangles.x0 >> BLOCK_SHIFT) + 1) *
                            ((triangles.view_y1 >> BLOCK_SHIFT) - (triangles.view_y0 >> BLOCK_SHIFT) + 1);
        const Ints medium = larger & ~inexact & (blocks <= Lanes::all_ints(MAX_BLOCKS));
        for (const int k : Lanes::each(medium)) rasterize_medium(camera, image, triangles, k, mode);
        const Floats rows = __builtin_convertvector(triangles.view_y1 - triangles.view_y0 + 1, Floats);
        const Ints thin = larger & ~medium & (triangles.area * (float)ROWS_OF_PIXEL <= rows);
        for (const int k : Lanes::each(thin)) rasterize_sliver(camera, image, triangles, k, mode);
        for (const int k : Lanes::each(larger & ~medium & ~thin)) rasterize_large(camera, image, triangles, k, mode);
    }

    // Rounding of the corners may rotate the plane of a sliver: then single precision does not suffice for inv_z
    // either.
    static inline Ints has_unstable_plane(const Camera& camera, const Triangles& t) {
        const Floats width = __builtin_convertvector(t.x1 - t.x0, Floats);
        const Floats height = __builtin_convertvector(t.view_y1 - t.view_y0, Floats);
        return has_unstable_plane(camera, t, width, height);
    }
    static inline Ints has_unstable_plane(const Camera& camera, const Triangles& t, Floats width, Floats height) {
        const Floats change = Lanes::abs(t.inv_z.u) * width + Lanes::abs(t.inv_z.v) * height;
        return camera.blur * (width + height) * change > ALLOWED_ERROR * t.min_inv_z * t.area;
    }

    // Each lane tests a pixel (x, y) of its triangle's bounds; all lanes step through x and y together.
    static inline __attribute__((always_inline)) void rasterize_small(const Camera& camera, const Image& image,
                                                                      const Triangles& t, Ints small, Ints inexact,
                                                                      Mode mode) {
        Floats closest = t.error_bound + t.error_bound;  // least magnitude of the edge functions at a pixel
        const Ints last_x = small ? t.x1 : Lanes::all_ints(-1), last_y = small ? t.y1 : Lanes::all_ints(-1);
        const unsigned rounded = Lanes::bits(inexact);
        const int steps_x = __builtin_reduce_max(small ? t.x1 - t.x0 : Lanes::all_ints(0));
        const int steps_y = __builtin_reduce_max(small ? t.y1 - t.y0 : Lanes::all_ints(0));
        for (int dy = 0; dy <= steps_y; ++dy) {
            const Ints y = t.y0 + dy;
            const Floats v = __builtin_convertvector(y + image.first_row, Floats) + camera.first_v;
            const Floats row0 = t.edge[0].row(v), row1 = t.edge[1].row(v), row2 = t.edge[2].row(v);
            const Floats row_inv_z = t.inv_z.row(v);
            const Ints in_row = y <= last_y;
            for (int dx = 0; dx <= steps_x; ++dx) {
                const Ints x = t.x0 + dx;
                const Floats u = __builtin_convertvector(x, Floats) + camera.first_u;
                const Floats inner = Lanes::min(t.edge[0].at(u, row0), t.edge[1].at(u, row1), t.edge[2].at(u, row2));
                closest = Lanes::min(closest, Lanes::abs(inner));
                const unsigned hits = Lanes::bits((inner > t.error_bound) & (x <= last_x) & in_row);
                if (!hits) continue;
                const Floats inv_z = Lanes::max(Lanes::min(t.inv_z.at(u, row_inv_z), t.max_inv_z), t.min_inv_z);
                float value[LANES];
                int at_x[LANES], at_y[LANES];
                Lanes::store(value, inv_z);
                Lanes::store(at_x, x);
                Lanes::store(at_y, y);
                for (const int k : Lanes::each(hits & rounded)) {
                    value[k] =
                        exact_inv_z(camera, t, k, camera.exact_u(at_x[k]), camera.exact_v(at_y[k] + image.first_row));
                }
                for (const int k : Lanes::each(hits)) {
                    const int pixel = Image::column_part(at_x[k]) + image.row_part(at_y[k]);
                    put(image, pixel, value[k], id_of(t, k, mode), mode);
                }
            }
        }
        for (const int k : Lanes::each(small & (closest <= t.error_bound))) {
            rasterize_uncertain(camera, image, UncertainTriangle::of(t, k, (rounded >> k) & 1, mode), mode);
        }
    }

    // Rasterize a triangle of a few blocks.
    static inline __attribute__((always_inline)) void rasterize_medium(const Camera& camera, const Image& image,
                                                                       const Triangles& t, int k, Mode mode) {
        const Linear e0 = Linear::of_lane(t.edge[0], k), e1 = Linear::of_lane(t.edge[1], k),
                     e2 = Linear::of_lane(t.edge[2], k);
        const Linear plane = Linear::of_lane(t.inv_z, k);
        const Floats min_inv_z = Lanes::all(t.min_inv_z[k]), max_inv_z = Lanes::all(t.max_inv_z[k]);
        const Floats error_bound = Lanes::all(t.error_bound[k]);
        Floats closest = Lanes::all(NOWHERE);  // least magnitude of the edge functions at a pixel
        const int id = id_of(t, k, mode);
        const int bx0 = t.x0[k] >> BLOCK_SHIFT, bx1 = t.x1[k] >> BLOCK_SHIFT, by0 = t.y0[k] >> BLOCK_SHIFT,
                  by1 = t.y1[k] >> BLOCK_SHIFT;
        for (int by = by0; by <= by1; ++by) {
            const Floats v = (Grid::row_floats() + (float)(by * BLOCK_SIDE + image.first_row)) + camera.first_v;
            const Floats row0 = e0.row(v), row1 = e1.row(v), row2 = e2.row(v), row_inv_z = plane.row(v);
            for (int bx = bx0; bx <= bx1; ++bx) {
                const Floats u = (Grid::column_floats() + (float)(bx * BLOCK_SIDE)) + camera.first_u;
                const Floats inv_z = Lanes::max(Lanes::min(plane.at(u, row_inv_z), max_inv_z), min_inv_z);
                const Floats inner = Lanes::min(e0.at(u, row0), e1.at(u, row1), e2.at(u, row2));
                closest = Lanes::min(closest, Lanes::abs(inner));
                const int block = image.block_at(bx, by);
                blend(image, block, block, inner > error_bound, inv_z, id, mode);
            }
        }
        if (__builtin_expect(Lanes::any(closest <= error_bound), 0))
            rasterize_uncertain(camera, image, UncertainTriangle::of(t, k, false, mode), mode);
    }

    // Depth test of each pixel of a block, or of each point of a packet in a cell.
    static inline __attribute__((always_inline)) void blend(const Image& image, int packet, int block, Ints inside,
                                                            Floats inv_z, int id, Mode mode) {
        float* stored = image.inv_z + packet * LANES;
        const Floats old = Lanes::load(stored);
        if (mode == MODE_DEPTH) {
            const Ints hit = inside & (inv_z > old) & (inv_z <= Lanes::all(image.clip_inv_z));
            if (!Lanes::any(hit)) return;
            Lanes::store(stored, hit ? inv_z : old);
        } else {
            int* id_at = image.id + packet * LANES;
            const Ints old_id = Lanes::load(id_at), new_id = Lanes::all_ints(id);
            const Ints hit = inside & (inv_z <= Lanes::all(image.clip_inv_z)) &
                             ((inv_z > old) | ((inv_z == old) & (new_id < old_id)));
            if (!Lanes::any(hit)) return;
            Lanes::store(stored, hit ? inv_z : old);
            Lanes::store(id_at, hit ? new_id : old_id);
        }
        image.touch(block);
    }

    // Rasterize a sliver, one row of pixels per lane: in most rows it passes between two pixel centers.
    static inline __attribute__((always_inline)) void rasterize_sliver(const Camera& camera, const Image& image,
                                                                       const Triangles& t, int k, Mode mode) {
        const Ints lane = Lanes::index();
        const int id = id_of(t, k, mode);
        const float error_bound = t.error_bound[k];
        Linear edge[3];
        for (int e = 0; e < 3; ++e) edge[e] = Linear::of_lane(t.edge[e], k);
        for (int first = t.y0[k]; first <= t.y1[k]; first += LANES) {
            const Ints y = lane + first;
            const Floats v = __builtin_convertvector(y + image.first_row, Floats) + camera.first_v;
            Floats left = Lanes::all((float)t.x0[k]), right = Lanes::all((float)t.x1[k]);
            for (const Linear& of : edge) narrow(camera, of, error_bound, v, v, left, right);
            Ints active = y <= Lanes::all_ints(t.y1[k]);
            for (Floats x = __builtin_elementwise_ceil(left);; x += 1.0f) {
                active &= x <= right;
                if (!Lanes::any(active)) break;
                const Floats u = x + camera.first_u;
                const Floats inner = Lanes::min(edge[0].at(u, edge[0].row(v)), edge[1].at(u, edge[1].row(v)),
                                                edge[2].at(u, edge[2].row(v)));
                for (const int r : Lanes::each(active & (inner >= Lanes::all(-error_bound)))) {
                    const int at_x = (int)x[r], at_y = first + r;
                    if (inner[r] <= error_bound && !covers(camera, image, t.corners, k, at_x, at_y)) continue;
                    const int pixel = Image::column_part(at_x) + image.row_part(at_y);
                    const double exact_v = camera.exact_v(at_y + image.first_row);
                    put(image, pixel, exact_inv_z(camera, t, k, camera.exact_u(at_x), exact_v), id, mode);
                }
            }
        }
    }

    // Shrink the interval from `left` to `right` of each row, between v0 and v1 in the image, by the part that lies
    // outside an edge by more than the rounding error bound.
    static inline void narrow(const Camera& camera, const Linear& edge, float error_bound, Floats v0, Floats v1,
                              Floats& left, Floats& right) {
        const float slope = -1.0f / edge.u[0];
        if (!(__builtin_fabsf(slope) < 1e30f)) return;  // parallel to the rows
        const Floats x0 = edge.row(v0) * slope - camera.first_u, x1 = edge.row(v1) * slope - camera.first_u;
        const Floats size = Lanes::abs(edge.v) * Lanes::max(Lanes::abs(v0), Lanes::abs(v1)) + Lanes::abs(edge.one);
        const Floats slack = 0.01f + __builtin_fabsf(slope) * (4e-7f * size + error_bound);
        if (edge.u[0] > 0.0f)
            left = Lanes::max(left, Lanes::min(x0, x1) - slack);
        else
            right = Lanes::min(right, Lanes::max(x0, x1) + slack);
    }

    // Scalar values of a large triangle, which is tested with LANES pixels or blocks at a time.
    struct Large {
        Linear edge[3];
        float error_bound;
        const float* corners;
        int lane;
        ExactPlane plane;
        Floats slope;  // inv_z at each pixel of a block minus inv_z at its first pixel
        float min_inv_z, max_inv_z;
        float resolvable_inv_z;  // least inv_z for which single precision resolves adjacent pixels of a block
        int id;
        int x0, x1, y0, y1;

        static inline Large of(const Camera& camera, const Triangles& t, int k, Mode mode) {
            Large one;
            for (int e = 0; e < 3; ++e) one.edge[e] = Linear::of_lane(t.edge[e], k);
            one.error_bound = t.error_bound[k];
            one.corners = t.corners;
            one.lane = k;
            one.plane = ExactPlane::of(camera, t.corners, k);
            one.slope = (float)one.plane.u * Grid::column_floats() + (float)one.plane.v * Grid::row_floats();
            one.resolvable_inv_z = STEEPEST * (float)(__builtin_fabs(one.plane.u) + __builtin_fabs(one.plane.v));
            one.min_inv_z = t.min_inv_z[k];
            one.max_inv_z = t.max_inv_z[k];
            one.id = id_of(t, k, mode);
            one.x0 = t.x0[k], one.x1 = t.x1[k], one.y0 = t.y0[k], one.y1 = t.y1[k];
            return one;
        }
    };

    static inline __attribute__((always_inline)) void rasterize_large(const Camera& camera, const Image& image,
                                                                      const Triangles& t, int k, Mode mode) {
        const Large one = Large::of(camera, t, k, mode);
        const int ty0 = one.y0 >> TILE_SHIFT, ty1 = one.y1 >> TILE_SHIFT;
        int from[LANES], to[LANES];  // tiles of a row
        for (int ty = ty0; ty <= ty1; ++ty) {
            const int row = (ty - ty0) & (LANES - 1);
            if (row == 0) touched_tiles(camera, image, one, ty, from, to);
            for (int tx = from[row]; tx <= to[row]; ++tx) rasterize_tile(camera, image, one, tx, ty, mode);
        }
    }

    // Find the tiles between a triangle's edges, one row of tiles per lane; all tiles of the row if there is little to
    // gain.
    static inline void touched_tiles(const Camera& camera, const Image& image, const Large& t, int first, int* from,
                                     int* to) {
        const int tx0 = t.x0 >> TILE_SHIFT, tx1 = t.x1 >> TILE_SHIFT;
        Ints begin = Lanes::all_ints(tx0), end = Lanes::all_ints(tx1);
        if (tx1 - tx0 > 2) {
            const Ints y = (Lanes::index() + first) * (int)TILE_SIDE + image.first_row;
            const Floats top = __builtin_convertvector(y, Floats) + camera.first_v;
            const float last = TILE_SIDE - 1;
            Floats left = Lanes::all((float)(tx0 * TILE_SIDE)), right = Lanes::all((float)(tx1 * TILE_SIDE) + last);
            for (const Linear& edge : t.edge) narrow(camera, edge, t.error_bound, top, top + last, left, right);
            const Ints nonempty = left <= right;
            const Floats nowhere = Lanes::all((float)TILE_SIDE), none = Lanes::all(0.0f);  // an empty range
            begin = __builtin_convertvector(nonempty ? left : nowhere, Ints) >> TILE_SHIFT;
            end = __builtin_convertvector(nonempty ? Lanes::max(right, none) : none, Ints) >> TILE_SHIFT;
        }
        Lanes::store(from, begin);
        Lanes::store(to, end);
    }

    // A block of a tile, touched by a large triangle.
    struct TouchedBlock {
        int index, x, y;
        float inv_z;  // at its first pixel
        bool covered;
    };

    // The extremes of an edge function are at corners of a block. Rounding is monotonic, so the test of a corner pixel
    // never contradicts that of another pixel.
    static inline __attribute__((always_inline)) void rasterize_tile(const Camera& camera, const Image& image,
                                                                     const Large& t, int tx, int ty, Mode mode) {
        const int last = BLOCK_SIDE - 1;
        const Ints block_x = Grid::block_x(), block_y = Grid::block_y();
        const Ints x = block_x + tx * TILE_SIDE, y = block_y + ty * TILE_SIDE;
        const Floats none = Lanes::all(0.0f);
        const Floats u0 = __builtin_convertvector(x, Floats) + camera.first_u;
        const Floats u1 = __builtin_convertvector(x + last, Floats) + camera.first_u;
        const Floats v0 = __builtin_convertvector(y + image.first_row, Floats) + camera.first_v;
        const Floats v1 = __builtin_convertvector(y + last + image.first_row, Floats) + camera.first_v;
        unsigned uncertain = 0;
        Ints touched = (x + last >= t.x0) & (x <= t.x1) & (y + last >= t.y0) & (y <= t.y1);
        Ints covered = touched;
        for (const Linear& edge : t.edge) {
            const Ints right = edge.u >= none, down = edge.v >= none;
            touched &= edge.at(right ? u1 : u0, edge.row(down ? v1 : v0)) >= Lanes::all(-t.error_bound);
            covered &= edge.at(right ? u0 : u1, edge.row(down ? v0 : v1)) > Lanes::all(t.error_bound);
        }
        if (!Lanes::any(touched)) return;

        // Upper bound of the plane's inv_z in each block, with a margin for rounding.
        const int tile = ty * image.tiles_x + tx;
        const float pu = (float)t.plane.u, pv = (float)t.plane.v;
        const double base =
            t.plane.one + t.plane.u * camera.exact_u(x[0]) + t.plane.v * camera.exact_v(y[0] + image.first_row);
        const Floats offset_x = __builtin_convertvector(block_x, Floats),
                     offset_y = __builtin_convertvector(block_y, Floats);
        const float reach = 3.0f * ((pu > 0 ? pu : 0) + (pv > 0 ? pv : 0));
        Floats nearest = (pu * offset_x + pv * offset_y) + ((float)base + reach);
        nearest = Lanes::min(nearest * 1.00001f + 1e-30f, Lanes::all(t.max_inv_z));
        touched &= ~(Lanes::load(image.block_min + tile * TILE_BLOCKS) > nearest);

        const unsigned covered_blocks = Lanes::bits(covered);
        for (const int b : Lanes::each(touched)) {
            const double at_block = base + t.plane.u * block_x[b] + t.plane.v * block_y[b];
            const TouchedBlock block = {tile * TILE_BLOCKS + b, x[b], y[b], (float)at_block,
                                        ((covered_blocks >> b) & 1) != 0};
            if (rasterize_block(camera, image, t, block, mode)) uncertain |= 1u << b;
        }
        for (const int b : Lanes::each(uncertain)) {
            const double at_block = base + t.plane.u * block_x[b] + t.plane.v * block_y[b];
            const TouchedBlock block = {tile * TILE_BLOCKS + b, x[b], y[b], (float)at_block, false};
            const Large copy = t;  // so that the original can stay in registers
            rasterize_uncertain(camera, image, copy, block, mode);
        }
    }

    // 1 / z of a triangle at a block's pixels, and the minimum of its edge functions.
    static inline Floats inv_z_in(const Large& t, const TouchedBlock& block) {
        return Lanes::max(Lanes::min(t.slope + block.inv_z, Lanes::all(t.max_inv_z)), Lanes::all(t.min_inv_z));
    }
    static inline Floats within(const Camera& camera, const Image& image, const Large& t, const TouchedBlock& block) {
        const Floats u = (Grid::column_floats() + (float)block.x) + camera.first_u;
        const Floats v = (Grid::row_floats() + (float)(block.y + image.first_row)) + camera.first_v;
        const Linear* e = t.edge;
        return Lanes::min(e[0].at(u, e[0].row(v)), e[1].at(u, e[1].row(v)), e[2].at(u, e[2].row(v)));
    }

    // Pixels where single precision cannot decide coverage, or cannot resolve inv_z.
    static inline Ints find_uncertain(const Large& t, Floats inner, Floats inv_z) {
        Ints uncertain = find_uncertain(inner, t.error_bound);
        if (t.resolvable_inv_z > t.min_inv_z)
            uncertain |= (inner > Lanes::all(t.error_bound)) & (inv_z < Lanes::all(t.resolvable_inv_z));
        return uncertain;
    }

    // Rasterize a block except for uncertain pixels; returns whether there are any.
    static inline __attribute__((always_inline)) bool rasterize_block(const Camera& camera, const Image& image,
                                                                      const Large& t, const TouchedBlock& block,
                                                                      Mode mode) {
        const Floats inv_z = inv_z_in(t, block);
        if (block.covered && !(t.resolvable_inv_z > t.min_inv_z)) {
            blend(image, block.index, block.index, Lanes::all_ints(-1), inv_z, t.id, mode);
            return false;
        }
        const Floats inner = within(camera, image, t, block);
        const Ints uncertain = find_uncertain(t, inner, inv_z);
        blend(image, block.index, block.index, (inner > Lanes::all(t.error_bound)) & ~uncertain, inv_z, t.id, mode);
        return Lanes::any(uncertain);
    }
    static __attribute__((noinline, cold)) void rasterize_uncertain(const Camera& camera, const Image& image,
                                                                    const Large& t, const TouchedBlock block,
                                                                    Mode mode) {
        const Floats inv_z = inv_z_in(t, block);
        const Ints uncertain = find_uncertain(t, within(camera, image, t, block), inv_z);
        for (const int k : Lanes::each(uncertain)) {
            const int x = block.x + (k & (BLOCK_SIDE - 1)), y = block.y + (k >> BLOCK_SHIFT);
            if (!covers(camera, image, t.corners, t.lane, x, y)) continue;
            const double u = camera.exact_u(x), v = camera.exact_v(y + image.first_row);
            const float value = inv_z[k] < t.resolvable_inv_z
                                    ? exact_inv_z(camera, t.corners, t.lane, t.min_inv_z, t.max_inv_z, u, v)
                                    : inv_z[k];
            put(image, block.index * BLOCK_PIXELS + k, value, t.id, mode);
        }
    }
};
