// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Triangle setup: the values of a leaf's triangles in the image, one triangle per lane.

#pragma once

#include "cpu/bvh.h"
#include "cpu/camera.h"

// A value that is linear in u and v, for each lane's triangle.
struct Linear {
    Floats u, v, one;

    inline Floats row(Floats at_v) const { return v * at_v + one; }
    inline Floats at(Floats at_u, Floats row) const { return u * at_u + row; }
    static inline Linear of_lane(const Linear& all, int k) {
        return Linear{Lanes::all(all.u[k]), Lanes::all(all.v[k]), Lanes::all(all.one[k])};
    }
};

// A leaf's triangles, set up for an image.
struct Triangles {
    const float* corners;  // [LEAF_ROWS][lane] in the frame of the tree
    int first_id;
    const int* owners;
    Linear edge[3];  // edge functions, positive inside
    Floats error_bound;  // rounding error bound of the edge functions: smaller magnitudes may have the wrong sign
    Ints inexact;  // lanes in which single precision does not suffice for inv_z, whatever the pixel
    Linear inv_z;
    Floats min_inv_z, max_inv_z;  // at the corners: every point of a triangle lies within this range
    Floats area;  // in pixels, of the whole triangle; NOWHERE if it reaches behind the camera
    Ints shown;  // lanes that may cover a pixel
    Ints x0, x1, y0, y1;  // pixels of the strip whose centers may be inside
    Ints view_y0, view_y1;  // the same rows of the whole view
    // Only for ORIGIN_RAYS:
    Points side[3];  // twice the edges, with the sign of the edge functions
    Ints uncertain_side;  // lanes of triangles of which rays may see another side than the eye does, or nearly so
    Floats place[4];  // least u and v, greatest u and v of rays from the eye
};

// Evaluation of one triangle of a leaf in double precision.
struct Exactly {
    static inline ExactCorners corners(const Camera& camera, const float* corners, int lane) {
        ExactCorners seen;
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < 3; ++i)
                seen.corner[k][i] = corners[(3 * k + i) * LANES + lane] - camera.exact_origin[i];
        return seen;
    }
    // Whether the triangle covers an image point, edges included.
    static __attribute__((noinline, cold)) bool covers(const Camera& camera, const float* leaf, int lane, double u,
                                                       double v) {
        double ray[3];
        camera.ray_at(u, v, ray);
        return corners(camera, leaf, lane).meet(ray);
    }
};

struct Setup {
    // cross(a - b, a + b) is 2 a x b, and exactly its negative if a and b are swapped.
    static inline Linear edge(Points a, Points b, Floats sign) {
        const Points product = Points::cross(Points::minus(a, b), Points::plus(a, b));
        return Linear{product.x * sign, product.y * sign, product.z * sign};
    }

    // Lanes of triangles that the view excludes.
    static inline Ints excluded_lanes(const unsigned char* excluded, const int* owners) {
        Ints mask;
        for (int k = 0; k < LANES; ++k) mask[k] = excluded[Bvh::object_of(owners[k])] ? -1 : 0;
        return mask;
    }

    // Bounding rectangles of the triangles, in pixels, whether inside the image or not: their size, and their greatest
    // distance from the principal point.
    struct Box {
        Floats width, height, reach_u, reach_v;
    };

    // Load a corner, from the row of its x coordinates; y and z are the next rows.
    static inline Points corner(const Camera& camera, const float* rows) {
        return camera.relative(Lanes::load(rows), Lanes::load(rows + LANES), Lanes::load(rows + 2 * LANES));
    }

    // Replace volumes of triangles that are edge-on in single precision by values of the correct sign; 0 if they are
    // edge-on in double precision too.
    static __attribute__((noinline, cold)) void settle_volumes(const Camera& camera, const float* corners, Ints edge_on,
                                                               Floats volume_error, Floats& volume) {
        for (const int k : Lanes::each(edge_on)) {
            const double exact = Exactly::corners(camera, corners, k).volume();
            volume[k] = exact < 0.0 ? -volume_error[k] : exact > 0.0 ? volume_error[k] : 0.0f;
        }
    }

    // Set up a leaf; returns false if no lane can be visible: all face away, or none reaches a pixel center.
    template <RayKind KIND>
    static inline bool leaf(const Camera& camera, const Image& image, Triangles& out) {
        const float* p = out.corners;
        Points c[3];
        for (int k = 0; k < 3; ++k) c[k] = camera.transform(corner(camera, p + 3 * LANES * k));
        const Points ab = Points::minus(c[1], c[0]), ac = Points::minus(c[2], c[0]);
        const Points normal = Points::cross(ab, ac);
        Floats volume = Points::dot(normal, c[0]);  // negative if the camera sees the front
        const Floats zmin = Lanes::min(c[0].z, c[1].z, c[2].z), zmax = Lanes::max(c[0].z, c[1].z, c[2].z);
        // The extent of the corners, and their distance from the camera if any part is in the image, in pixels times
        // depth.
        const Floats extent = ((Lanes::abs(ab.x) + Lanes::abs(ac.x)) + (Lanes::abs(ab.y) + Lanes::abs(ac.y))) +
                              camera.extent * (zmax - zmin);
        const Floats distance = (2.0f * camera.extent) * zmax + extent;
        const Floats rounded = camera.edge_error_bound * distance;
        const Floats volume_error = (rounded * extent) * (camera.per_extent * distance);
        const Ints edge_on = Lanes::abs(volume) < volume_error;
        if (__builtin_expect(Lanes::any(edge_on), 0)) settle_volumes(camera, p, edge_on, volume_error, volume);
        Ints shown = volume != Lanes::all(0.0f);
        if (camera.cull_back_faces)
            shown &= volume < Lanes::all(0.0f);
        else if (camera.skip_back_faces)
            shown &= (volume < Lanes::all(0.0f)) | (Lanes::load(out.owners) >= Lanes::all_ints(0));
        if constexpr (KIND == ORIGIN_RAYS)
            shown |= find_uncertain_sides(image.tree->origins, normal, volume, volume_error, out);
        if (camera.excluded) shown &= ~excluded_lanes(camera.excluded, out.owners);
        if (!Lanes::any(shown)) return false;

        const Floats one = Lanes::all(1.0f), none = Lanes::all(0.0f);
        const Floats inverse[3] = {one / c[0].z, one / c[1].z, one / c[2].z};
        // Triangles that reach behind the camera may cover any part of the image.
        const Ints crossing = zmin <= CROSSING_SHARE * zmax + Lanes::all(CROSSING_MIN);
        out.shown = shown & (zmax > none);
        Box box;
        if (!bound<KIND>(image, c, inverse, crossing, out, box)) return false;
        if constexpr (KIND == ORIGIN_RAYS) set_sides(c, volume, out);

        const Floats sign = volume < none ? -one : one;
        out.edge[0] = edge(c[1], c[2], sign);
        out.edge[1] = edge(c[2], c[0], sign);
        out.edge[2] = edge(c[0], c[1], sign);
        out.error_bound = rounded * (extent + (EDGE_MARGIN * camera.per_extent) * distance);
        if constexpr (KIND == ORIGIN_RAYS)
            out.error_bound += moment_error_bound(camera, image.tree->origins) * (distance + extent);
        const Floats scale = one / volume;
        out.inv_z = Linear{normal.x * scale, normal.y * scale, normal.z * scale};
        out.min_inv_z = crossing ? one / zmax : Lanes::min(inverse[0], inverse[1], inverse[2]);
        out.max_inv_z = crossing ? Lanes::all(3e37f) : Lanes::max(inverse[0], inverse[1], inverse[2]);
        out.area = crossing ? Lanes::all(NOWHERE) : 0.5f * Lanes::abs(volume) * (inverse[0] * inverse[1] * inverse[2]);
        const Floats slope_u = Lanes::abs(out.inv_z.u), slope_v = Lanes::abs(out.inv_z.v);
        // At a grazing angle, inv_z is a small difference of large terms.
        const Floats terms = slope_u * box.reach_u + (slope_v * box.reach_v + Lanes::abs(out.inv_z.one));
        const Floats rotation = camera.blur * (box.width + box.height) * (slope_u * box.width + slope_v * box.height);
        out.inexact = (terms > MAX_TERMS * out.min_inv_z) | (rotation > MAX_PLANE_ROTATION * out.min_inv_z * out.area) |
                      edge_on | crossing;
        return true;
    }

    // Find triangles of which rays may see another side than the eye does, or nearly so: 1 - N . (p, q, 0), the
    // denominator of 1 / z (ray_raster.h), is not always above 0.5.
    static inline Ints find_uncertain_sides(const RayOrigins& origins, const Points& normal, Floats volume,
                                            Floats volume_error, Triangles& out) {
        const Floats aside = Lanes::abs(normal.x) * origins.max_p + Lanes::abs(normal.y) * origins.max_q;
        return out.uncertain_side = 2.0f * aside + volume_error >= Lanes::abs(volume);
    }
    static inline void set_sides(const Points* c, Floats volume, Triangles& out) {
        const Floats twice = volume < Lanes::all(0.0f) ? Lanes::all(-2.0f) : Lanes::all(2.0f);
        for (int e = 0; e < 3; ++e) {
            const Points side = Points::minus(c[(e + 1) % 3], c[(e + 2) % 3]);
            out.side[e] = Points{side.x * twice, side.y * twice, side.z * twice};
        }
    }
    // Rounding error bound of the product of a side and a ray's moment about the eye.
    static inline float moment_error_bound(const Camera& camera, const RayOrigins& origins) {
        return camera.edge_error_bound * (4.0f * (origins.max_p + origins.max_q));
    }

    // Compute bounds in pixels, with a margin for rounding; returns false if no lane can be visible.
    template <RayKind KIND>
    static inline bool bound(const Image& image, const Points* c, const Floats* inverse, Ints crossing, Triangles& out,
                             Box& box) {
        const Floats one = Lanes::all(1.0f), none = Lanes::all(0.0f);
        const Floats px0 = c[0].x * inverse[0], px1 = c[1].x * inverse[1], px2 = c[2].x * inverse[2];
        const Floats py0 = c[0].y * inverse[0], py1 = c[1].y * inverse[1], py2 = c[2].y * inverse[2];
        const float slack = 0.004f + 2e-6f * (float)(image.width + image.height);
        const Floats wide = Lanes::all((float)image.width), tall = Lanes::all((float)image.height);
        const Floats u0 = Lanes::min(px0, px1, px2), u1 = Lanes::max(px0, px1, px2);
        const Floats v0 = Lanes::min(py0, py1, py2), v1 = Lanes::max(py0, py1, py2);
        box.width = u1 - u0, box.height = v1 - v0;
        box.reach_u = Lanes::max(Lanes::abs(u0), Lanes::abs(u1));
        box.reach_v = Lanes::max(Lanes::abs(v0), Lanes::abs(v1));
        Floats left = u0 + (image.center_x - 0.5f - slack);
        Floats right = u1 + (image.center_x - 0.5f + slack);
        Floats top = v0 + (image.center_y - 0.5f - slack);
        Floats bottom = v1 + (image.center_y - 0.5f + slack);
        if constexpr (KIND == ORIGIN_RAYS) {
            const Floats nearest = Lanes::max(inverse[0], inverse[1], inverse[2]), all = Lanes::all(1e30f);
            const Floats aside = image.tree->origins.max_p * nearest, along = image.tree->origins.max_q * nearest;
            left -= aside, right += aside, top -= along, bottom += along;
            out.place[0] = crossing ? -all : u0 - slack, out.place[2] = crossing ? all : u1 + slack;
            out.place[1] = crossing ? -all : v0 - slack, out.place[3] = crossing ? all : v1 + slack;
        }
        left = Lanes::max(crossing ? none : image.first_pixel(left), none);
        const float first = (float)image.first_row, last = (float)(image.view_height - 1);
        const Floats view_top = Lanes::max(crossing ? none : image.first_pixel(top) + first, none);
        const Floats view_bottom =
            Lanes::min(crossing ? Lanes::all(last) : image.last_pixel(bottom) + first, Lanes::all(last));
        top = Lanes::max(view_top - first, none);
        right = Lanes::min(crossing ? wide : image.last_pixel(right), wide - one);
        bottom = Lanes::min(view_bottom - first, tall - one);
        const Ints shown = out.shown & (left <= right) & (top <= bottom);
        if (!Lanes::any(shown)) return false;
        out.shown = shown;
        out.x0 = __builtin_convertvector(shown ? left : none, Ints);
        out.x1 = __builtin_convertvector(shown ? right : -one, Ints);
        out.y0 = __builtin_convertvector(shown ? top : none, Ints);
        out.y1 = __builtin_convertvector(shown ? bottom : -one, Ints);
        out.view_y0 = __builtin_convertvector(shown ? view_top : none, Ints);
        out.view_y1 = __builtin_convertvector(shown ? view_bottom : -one, Ints);
        return true;
    }
};

// A triangle in double precision: its first corner relative to the camera, and its normal, not normalized.
struct ExactTriangle {
    double a[3], normal[3];

    static inline ExactTriangle of(const double* viewpoint, const float* corners, int lane) {
        ExactTriangle t;
        double ab[3], ac[3];
        for (int k = 0; k < 3; ++k) {
            t.a[k] = corners[k * LANES + lane] - viewpoint[k];
            ab[k] = (double)corners[(k + 3) * LANES + lane] - corners[k * LANES + lane];
            ac[k] = (double)corners[(k + 6) * LANES + lane] - corners[k * LANES + lane];
        }
        t.normal[0] = ab[1] * ac[2] - ab[2] * ac[1];
        t.normal[1] = ab[2] * ac[0] - ab[0] * ac[2];
        t.normal[2] = ab[0] * ac[1] - ab[1] * ac[0];
        return t;
    }
    // Negative if the camera sees the front.
    inline double volume() const { return normal[0] * a[0] + normal[1] * a[1] + normal[2] * a[2]; }
};

// The plane of a triangle in double precision. In single precision, inv_z loses its digits at grazing angles: it is a
// small difference of large terms.
struct ExactPlane {
    double u, v, one;

    static inline ExactPlane of(const Camera& camera, const float* corners, int lane) {
        const ExactTriangle t = ExactTriangle::of(camera.exact_origin, corners, lane);
        const double* n = t.normal;
        const double scale = 1.0 / t.volume();
        const ExactRow* m = camera.exact_to_camera;
        return ExactPlane{(n[0] * m[0][0] + n[1] * m[0][1] + n[2] * m[0][2]) * scale,
                          (n[0] * m[1][0] + n[1] * m[1][1] + n[2] * m[1][2]) * scale,
                          (n[0] * m[2][0] + n[1] * m[2][1] + n[2] * m[2][2]) * scale};
    }
};
