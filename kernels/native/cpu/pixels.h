// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Depth test of one pixel and one triangle, and evaluation in double precision.

#pragma once

#include "cpu/setup.h"

struct Pixels {
    static inline int id_of(const Triangles& triangles, int lane, Mode mode) {
        if (mode == MODE_DEPTH) return 0;
        if (mode == MODE_TRIANGLES) return triangles.first_id + lane;
        return Bvh::object_of(triangles.owners[lane]);
    }

    // Of two surfaces at the same depth, the one with the lower id is visible, whichever is rasterized first.
    static inline __attribute__((always_inline)) void put(const Image& image, int pixel, float inv_z, int id,
                                                          Mode mode) {
        float& old = image.inv_z[pixel];
        if (inv_z > image.clip_inv_z) return;
        if (mode != MODE_DEPTH) {
            if (inv_z < old || (inv_z == old && id >= image.id[pixel])) return;
            image.id[pixel] = id;
        } else if (inv_z <= old) {
            return;
        }
        old = inv_z;
        image.touch((unsigned)pixel / BLOCK_PIXELS);
    }

    // 1 / z of the plane in double precision, clamped to the depth range of the corners.
    static inline float exact_inv_z(const Camera& camera, const float* corners, int k, float min_inv_z, float max_inv_z,
                                    double u, double v) {
        const ExactPlane plane = ExactPlane::of(camera, corners, k);
        const float inv_z = (float)(plane.u * u + (plane.v * v + plane.one));
        return inv_z < min_inv_z ? min_inv_z : inv_z > max_inv_z ? max_inv_z : inv_z;
    }
    static inline float exact_inv_z(const Camera& camera, const Triangles& t, int k, double u, double v) {
        return exact_inv_z(camera, t.corners, k, t.min_inv_z[k], t.max_inv_z[k], u, v);
    }

    // Pixels where an edge function leaves coverage uncertain are skipped at first, and rasterized after the rest of
    // the triangle by separate code: keeping its values in registers in between would cost more than these pixels do.
    static inline bool covers(const Camera& camera, const Image& image, const float* corners, int k, int x, int y) {
        const double v = camera.exact_v(y + image.first_row);
        return Exactly::covers(camera, corners, k, camera.exact_u(x), v);
    }
    // A copy of a triangle's values for that code, so that the originals can stay in registers.
    struct UncertainTriangle {
        float edge[3][3], plane[3];
        float min_inv_z, max_inv_z, error_bound;
        const float* corners;
        int lane, id, x0, x1, y0, y1;
        bool inexact;

        static inline UncertainTriangle of(const Triangles& t, int k, bool inexact, Mode mode) {
            UncertainTriangle one;
            for (int e = 0; e < 3; ++e) put(t.edge[e], k, one.edge[e]);
            put(t.inv_z, k, one.plane);
            one.min_inv_z = t.min_inv_z[k], one.max_inv_z = t.max_inv_z[k], one.error_bound = t.error_bound[k];
            one.corners = t.corners, one.lane = k, one.id = id_of(t, k, mode);
            one.x0 = t.x0[k], one.x1 = t.x1[k], one.y0 = t.y0[k], one.y1 = t.y1[k];
            one.inexact = inexact;
            return one;
        }
        static inline void put(const Linear& all, int k, float* to) {
            to[0] = all.u[k], to[1] = all.v[k], to[2] = all.one[k];
        }
        static inline Linear linear(const float* from) {
            return Linear{Lanes::all(from[0]), Lanes::all(from[1]), Lanes::all(from[2])};
        }
    };
    static __attribute__((noinline, cold)) void rasterize_uncertain(const Camera& camera, const Image& image,
                                                                    const UncertainTriangle& t, Mode mode) {
        const Linear e0 = UncertainTriangle::linear(t.edge[0]), e1 = UncertainTriangle::linear(t.edge[1]),
                     e2 = UncertainTriangle::linear(t.edge[2]);
        const Linear plane = UncertainTriangle::linear(t.plane);
        for (int y = t.y0; y <= t.y1; ++y) {
            const Floats v = Lanes::all((float)(y + image.first_row)) + camera.first_v;
            const Floats row0 = e0.row(v), row1 = e1.row(v), row2 = e2.row(v), row_inv_z = plane.row(v);
            for (int first = t.x0; first <= t.x1; first += LANES) {
                const Floats u = (Lanes::index_floats() + (float)first) + camera.first_u;
                const Ints uncertain =
                    find_uncertain(Lanes::min(e0.at(u, row0), e1.at(u, row1), e2.at(u, row2)), t.error_bound);
                const Ints within = Lanes::index() <= Lanes::all_ints(t.x1 - first);
                const Floats inv_z =
                    Lanes::max(Lanes::min(plane.at(u, row_inv_z), Lanes::all(t.max_inv_z)), Lanes::all(t.min_inv_z));
                for (unsigned remaining = Lanes::bits(uncertain & within); remaining; remaining &= remaining - 1) {
                    const int k = Lanes::first_lane(remaining), x = first + k;
                    if (!covers(camera, image, t.corners, t.lane, x, y)) continue;
                    const float value = t.inexact ? exact_inv_z(camera, t.corners, t.lane, t.min_inv_z, t.max_inv_z,
                                                                camera.exact_u(x), camera.exact_v(y + image.first_row))
                                                  : inv_z[k];
                    put(image, Image::column_part(x) + image.row_part(y), value, t.id, mode);
                }
            }
        }
    }
    static inline Ints find_uncertain(Floats inner, float error_bound) {
        return Lanes::abs(inner) <= Lanes::all(error_bound);
    }
};
