// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Triangle setup: the values of a triangle in the image, one triangle per lane.

#pragma once

#include "cuda/camera.h"
#include "shared/edges.h"

// Keys of a z-buffer, of which the greatest is the nearest: 1 / z of the nearest surface and, if objects or normals may
// be requested, the id of its triangle; at equal depth the lesser id wins, independent of the order of drawing.
typedef Select<WITH_ID>::Type<unsigned long long, unsigned> Key;

struct DepthKey {
    enum { ID_BITS = WITH_ID ? 32 : 0 };

    static inline Key of(float inv_z, unsigned id) {
        return (Key)__float_as_uint(inv_z) << ID_BITS | (WITH_ID ? ~id : 0);
    }
    static inline unsigned inv_z_bits(Key key) { return (unsigned)(key >> ID_BITS); }
    static inline unsigned id(Key key) { return WITH_ID ? ~(unsigned)key : 0; }
};

// The plane of a triangle in double precision: 1 / z is linear in u and v.
struct ExactPlane {
    double u, v, one;

    static inline ExactPlane of(const Camera& camera, const float* corners) {
        const Vec3d normal = Vec3d::normal(corners);
        const double scale = 1.0 / Vec3d::dot(normal, Vec3d::minus(Vec3d::of(corners, LANES), camera.exact_origin));
        return ExactPlane{Vec3d::dot(normal, camera.exact_rays[0]) * scale,
                          Vec3d::dot(normal, camera.exact_rays[1]) * scale,
                          Vec3d::dot(normal, camera.exact_rays[2]) * scale};
    }
    inline float at(ExactRayPlace p) const { return (float)Origins::along(u * p.u + (v * p.v + one), u, v, p); }
};

// A triangle, set up for an image.
struct alignas(16) Triangle {
    Edge edge[3];
    float error_bound;  // rounding error bound of the edge functions: smaller magnitudes may have the wrong sign
    float slope_u, slope_v;  // of 1 / z
    float u, v, inv_z;  // reference point of 1 / z: a corner
    float min_inv_z, max_inv_z;  // at the corners: every point of a triangle lies within this range
    int x0, x1, y0, y1;  // pixels of the packet whose centers may be inside, or cells whose points may be
    bool exact;  // single precision does not suffice for 1 / z
    bool uncertain_side;  // rays may see another side than the eye does
    unsigned slot;  // in the leaves

    inline bool sees_both_sides() const { return RAY_ORIGINS && uncertain_side; }
    // Minimum of the edge functions at a ray; at most the error bound if the ray may see the other side.
    inline float within(RayPlace p) const {
        const float a = edge[0].of_ray(p), b = edge[1].of_ray(p), c = edge[2].of_ray(p);
        const float minimum = Three::min(a, b, c);
        return sees_both_sides() ? fminf(fmaxf(minimum, -Three::max(a, b, c)), error_bound) : minimum;
    }
    // Whether the triangle may be visible where the z-buffer holds a key.
    inline bool may_show(Key stored) const { return __float_as_uint(max_inv_z) >= DepthKey::inv_z_bits(stored); }
    inline float clamp(float value) const { return fmaxf(fminf(value, max_inv_z), min_inv_z); }
    inline float inv_z_at(RayPlace p) const { return clamp(Origins::along(plane_at(p.u, p.v), slope_u, slope_v, p)); }
    // For a ray from the eye.
    inline float plane_at(float at_u, float at_v) const {
        return __fmaf_rn(slope_u, at_u - u, __fmaf_rn(slope_v, at_v - v, inv_z));
    }
};

// Margin for rounding in pixels: a constant part, and a multiple of `blur`, the distance by which rounding may move a
// corner.
constexpr float TRIANGLE_SLACK = 0.002f, TRIANGLE_SLACK_BLURS = 4.0f;
// If the extent of the corners exceeds the depth of the nearest one by this factor, each is transformed separately.
constexpr float COARSE = 4.0f;

// Pixels between two columns and two rows, which are integers; none if the first exceeds the last.
struct PixelBounds {
    float left, right, top, bottom;

    inline bool any() const { return left <= right && top <= bottom; }
};

// Bounds in the image.
struct ImageBox {
    float left, right, top, bottom;

    inline void widen(ImagePoint by) { left -= by.u, right += by.u, top -= by.v, bottom += by.v; }
    inline bool holds(ImagePoint p, float slack) const {
        return p.u >= left - slack && p.u <= right + slack && p.v >= top - slack && p.v <= bottom + slack;
    }
    // Pixels whose centers may be inside, given the image point of the first pixel, and the last column and row; all if
    // `anywhere`.
    inline PixelBounds pixels(ImagePoint first, ImagePoint last, ImagePoint slack, bool anywhere) const {
        return PixelBounds{fmaxf(anywhere ? 0.0f : ceilf(left - first.u - slack.u), 0.0f),
                           fminf(anywhere ? last.u : floorf(right - first.u + slack.u), last.u),
                           fmaxf(anywhere ? 0.0f : ceilf(top - first.v - slack.v), 0.0f),
                           fminf(anywhere ? last.v : floorf(bottom - first.v + slack.v), last.v)};
    }
    // Cells whose points may be inside.
    inline Cells cells(const Camera& camera, float slack) const {
        return Cells::between(camera.cells, left - camera.first_u - slack, top - camera.first_v - slack,
                              right - camera.first_u + slack, bottom - camera.first_v + slack);
    }
};

struct Setup {
    enum { LARGE = 64 };  // pixels of the bounds from which the edge functions of a triangle are tested

    // cross(a - b, a + b) is 2 a x b, and exactly its negative if a and b are swapped.
    static inline Edge edge(Vec3 a, Vec3 b, float sign) {
        const Vec3 side = Vec3::minus(a, b), product = Vec3::cross(side, Vec3::plus(a, b));
        const float twice = 2.0f * sign;
        return Edge::of(Vec3{product.x * sign, product.y * sign, product.z * sign},
                        Vec3{side.x * twice, side.y * twice, side.z * twice});
    }

    // A triangle's corners in the image, in pixels from the principal point, and their 1 / z.
    struct ProjectedTriangle {
        float u[3], v[3], inv_z[3];
        ImageBox box;  // bounds
        float zmax;
        bool crossing;  // reaches behind the camera: may cover any part of the image

        // Area in pixels.
        inline float area() const {
            return 0.5f * fabsf((u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0]));
        }
        // Estimated number of covered pixels, given the number in the bounds.
        inline int cover(int bounds) const {
            return crossing || !(area() < (float)bounds) ? bounds : min(bounds, (int)area() + 1);
        }

        static inline ProjectedTriangle of(const Camera& camera, Vec3 a, Vec3 b, Vec3 c) {
            ProjectedTriangle p;
            const float zmin = Three::min(a.z, b.z, c.z);
            p.zmax = Three::max(a.z, b.z, c.z);
            p.crossing = zmin <= CROSSING_SHARE * p.zmax + CROSSING_MIN;
            p.inv_z[0] = Reciprocal::of(a.z), p.inv_z[1] = Reciprocal::about(b.z), p.inv_z[2] = Reciprocal::about(c.z);
            // Rounded explicitly: the compiler would fuse these products with later subtractions.
            p.u[0] = __fmul_rn(a.x, p.inv_z[0]), p.u[1] = __fmul_rn(b.x, p.inv_z[1]),
            p.u[2] = __fmul_rn(c.x, p.inv_z[2]);
            p.v[0] = __fmul_rn(a.y, p.inv_z[0]), p.v[1] = __fmul_rn(b.y, p.inv_z[1]),
            p.v[2] = __fmul_rn(c.y, p.inv_z[2]);
            p.box = ImageBox{Three::min(p.u[0], p.u[1], p.u[2]), Three::max(p.u[0], p.u[1], p.u[2]),
                             Three::min(p.v[0], p.v[1], p.v[2]), Three::max(p.v[0], p.v[1], p.v[2])};
            if (RAY_ORIGINS) p.box.widen(camera.origins.aside_at(Three::max(p.inv_z[0], p.inv_z[1], p.inv_z[2])));
            return p;
        }
    };

    // Margin of a triangle's bounds for rounding, in pixels.
    static inline float rounding_of(const Camera& camera) {
        return TRIANGLE_SLACK + TRIANGLE_SLACK_BLURS * camera.blur;
    }
    static inline ImagePoint slack_of(const Camera& camera) { return camera.wider(rounding_of(camera)); }

    // Set the pixels of the packet that begins at a pixel of the view, among those whose centers may be inside a
    // triangle.
    static inline void cut_pixels(const PixelBounds& view, int first_x, int first_y, bool has_area, Triangle& t) {
        const float x0 = fmaxf(view.left - (float)first_x, 0.0f),
                    x1 = fminf(view.right - (float)first_x, PACKET_WIDTH - 1.0f);
        const float y0 = fmaxf(view.top - (float)first_y, 0.0f),
                    y1 = fminf(view.bottom - (float)first_y, PACKET_HEIGHT - 1.0f);
        const bool covers = has_area && x0 <= x1 && y0 <= y1;
        t.x0 = covers ? (int)x0 : 0, t.x1 = covers ? (int)x1 : -1;
        t.y0 = covers ? (int)y0 : 0, t.y1 = covers ? (int)y1 : -1;
    }

    // Set the cells whose points may be inside a triangle.
    static inline void cut_cells(const Camera& camera, const ProjectedTriangle& p, bool has_area, Triangle& t) {
        const Cells cells = p.crossing ? Cells::all() : p.box.cells(camera, rounding_of(camera));
        const bool covers = has_area && cells.any();
        t.x0 = covers ? cells.x0 : 0, t.x1 = covers ? cells.x1 : -1;
        t.y0 = covers ? cells.y0 : 0, t.y1 = covers ? cells.y1 : -1;
    }

    // Greatest distance from a reference point to points that lie between two coordinates and inside the image. Not
    // rounded to pixels, whose size differs between packets.
    static inline float farthest(float low, float high, float from, bool crossing, float side) {
        const float first = crossing ? -side : fmaxf(low, -side), last = crossing ? side : fminf(high, side);
        return fmaxf(fabsf(first - from), fabsf(last - from));
    }

    // Whether 1 / z may exceed its allowed error: by rounding of its terms, by that of the corner's position, and by
    // that of the slopes, which is large for slivers and at grazing angles. Evaluated for the whole view, so that 1 / z
    // of a pixel is the same in every packet.
    static inline bool loses_digits(const Camera& camera, const ProjectedTriangle& p, const PixelBounds& b,
                                    const Triangle& t, float sides, float scale) {
        float du, dv;
        if (POINTS) {
            du = farthest(p.box.left, p.box.right, t.u, p.crossing, camera.last_x);
            dv = farthest(p.box.top, p.box.bottom, t.v, p.crossing, camera.last_y);
        } else {
            du = camera.right_of(fmaxf(fabsf(b.left + camera.first_u - t.u), fabsf(b.right + camera.first_u - t.u)));
            dv = camera.below(fmaxf(fabsf(b.top + camera.first_v - t.v), fabsf(b.bottom + camera.first_v - t.v)));
        }
        const float change = __fmaf_rn(fabsf(t.slope_u), du, __fmul_rn(fabsf(t.slope_v), dv));
        const float per_side = __fmaf_rn(camera.slope_error.u, du, __fmul_rn(camera.slope_error.v, dv));
        const float slopes = __fmul_rn(sides, __fmul_rn(per_side, fabsf(scale)));
        const float corner = __fmul_rn(camera.blur, fabsf(t.slope_u) + fabsf(t.slope_v));
        const float error = __fmaf_rn(TERM_ERROR, change + t.inv_z, slopes + corner);
        return p.crossing || !(Origins::error(error) <= ALLOWED_ERROR * t.min_inv_z);
    }

    // The corners of a triangle as stored.
    struct Corners {
        Vec3 a, b, c;

        static inline Corners of(const float* source) {
            return Corners{Place::load(source), Place::load(source + 3 * LANES), Place::load(source + 6 * LANES)};
        }
    };

    // A triangle in camera space. Differences of corners are computed before the transformation: the corners are closer
    // to each other than to the camera, so that less precision is lost.
    struct CameraTriangle {
        Vec3 a, b, c, ab, ac, normal;
        float volume;  // negative where the camera sees the front
        float sides;  // product of the lengths of ab and ac [m2]
        float volume_error;  // error bound

        static inline CameraTriangle of(const Camera& camera, const Corners& stored) {
            CameraTriangle t;
            const Vec3 a = camera.relative(stored.a), ab = Vec3::minus(stored.b, stored.a),
                       ac = Vec3::minus(stored.c, stored.a);
            t.a = camera.rotate(a), t.ab = camera.rotate(ab), t.ac = camera.rotate(ac);
            // Proportional to both sides: for a sliver, far less than the bound by its longest side alone.
            t.sides = __fmul_rn(camera.world_length(ab), camera.world_length(ac));
            t.volume_error = __fmul_rn(__fmul_rn(camera.volume_error, camera.world_length(a)), t.sides);
            t.b = Vec3::plus(t.a, t.ab);
            t.c = Vec3::plus(t.a, t.ac);
            if (t.is_coarse(camera)) {
                t.b = camera.rotate(camera.relative(stored.b));
                t.c = camera.rotate(camera.relative(stored.c));
            }
            t.normal = Vec3::cross(t.ab, t.ac);
            t.volume = Vec3::dot(t.normal, t.a);
            return t;
        }
        // Whether a corner may be so much nearer than the others that it must not inherit the rounding error of their
        // depth.
        inline bool is_coarse(const Camera& camera) const {
            return zmax() > 0.0f && spread(camera) > COARSE * camera.extent * zmin();
        }
        inline bool has_area() const { return volume != 0.0f && fabsf(volume) <= NOWHERE; }
        inline float zmin() const { return Three::min(a.z, b.z, c.z); }
        inline float zmax() const { return Three::max(a.z, b.z, c.z); }
        // Extent of the corners [px m].
        inline float spread(const Camera& camera) const {
            return __fmaf_rn(camera.extent, zmax() - zmin(), (fabsf(ab.x) + fabsf(ac.x)) + (fabsf(ab.y) + fabsf(ac.y)));
        }
        // Error bound of the edge functions inside the image; see shared/error_bounds.h.
        inline float edge_error(const Camera& camera) const {
            const float extent = spread(camera);
            const float distance = camera.origins.corner_distance(__fmaf_rn(2.0f * camera.extent, zmax(), extent));
            return __fmul_rn(__fmul_rn(EDGE_ERROR_BOUND, distance),
                             __fmaf_rn(EDGE_MARGIN * camera.per_extent, distance, extent));
        }
    };

    // A packet's pixels as distances from the principal point, with a margin for rounding.
    struct PacketBounds {
        // Center of the first column and row, minus and plus the margin.
        float left_less, left_more, top_less, top_more;

        static inline PacketBounds of(const Camera& camera, int first_x, int first_y) {
            const float u = camera.first_u + (float)first_x, v = camera.first_v + (float)first_y;
            const ImagePoint slack = slack_of(camera);
            return PacketBounds{u - slack.u, u + slack.u, v - slack.v, v + slack.v};
        }
        // Whether the center of one of `pixels` pixels lies between two coordinates.
        static inline bool has_center(float low, float high, float less, float more, float pixels) {
            const float begin = low - more;
            return floorf(high - less) >= fmaxf(begin, 0.0f) && begin <= pixels - 1.0f;
        }
    };

    // Whether this lane's triangle of a leaf may cover a pixel center of the packet; the leaf is small in the image and
    // entirely in front of the camera.
    static inline bool may_cover(const Bvh& bvh, const Camera& camera, const PacketBounds& bounds,
                                 const Corners& stored, unsigned slot, ImageBox& box, float& inv_z) {
        const Vec3 a = camera.rotate(camera.relative(stored.a)), b = camera.rotate(camera.relative(stored.b)),
                   c = camera.rotate(camera.relative(stored.c));
        const float a_inv_z = Reciprocal::about(a.z), b_inv_z = Reciprocal::about(b.z),
                    c_inv_z = Reciprocal::about(c.z);
        const float a_u = a.x * a_inv_z, b_u = b.x * b_inv_z, c_u = c.x * c_inv_z;
        const float a_v = a.y * a_inv_z, b_v = b.y * b_inv_z, c_v = c.y * c_inv_z;
        box = ImageBox{Three::min(a_u, b_u, c_u), Three::max(a_u, b_u, c_u), Three::min(a_v, b_v, c_v),
                       Three::max(a_v, b_v, c_v)};
        ImageBox wide = box;
        inv_z = a_inv_z;
        if (RAY_ORIGINS) {
            const float min_inv_z = Three::min(a_inv_z, b_inv_z, c_inv_z),
                        max_inv_z = Three::max(a_inv_z, b_inv_z, c_inv_z);
            inv_z = 0.5f * (min_inv_z + max_inv_z);
            box.widen(camera.origins.aside_at(0.50001f * (max_inv_z - min_inv_z)));
            wide.widen(camera.origins.aside_at(max_inv_z));
        }
        const bool shown =
            PacketBounds::has_center(wide.left, wide.right, bounds.left_less, bounds.left_more, PACKET_WIDTH) &&
            PacketBounds::has_center(wide.top, wide.bottom, bounds.top_less, bounds.top_more, PACKET_HEIGHT);
        const bool sorted_out = camera.cull_back_faces || camera.skip_back_faces || bvh.excluded;
        return shown && (!sorted_out || is_shown(bvh, camera, CameraTriangle::of(camera, stored), slot));
    }

    // Whether a view shows a triangle: it is not excluded, and not hidden or culled as a back face.
    static inline bool is_shown(const Bvh& bvh, const Camera& camera, const CameraTriangle& t, unsigned slot) {
        bool shown = true;
        if (camera.cull_back_faces || camera.skip_back_faces) {
            const float error_bound = camera.origins.volume(t.volume_error, t.normal);
            const bool front = t.volume < error_bound;  // or the side is uncertain
            shown = front || (!camera.cull_back_faces && __ldg(bvh.owners + slot) >= 0);
        }
        if (bvh.excluded) shown = shown && !bvh.excluded[Bvh::object_of(__ldg(bvh.owners + slot))];
        return shown;
    }

    // Estimated number of pixels of the packet that this lane's triangle of a leaf covers; 0 if it covers no pixel
    // center.
    static inline int area(const Bvh& bvh, const Camera& camera, int first_x, int first_y, int leaf) {
        const unsigned slot = leaf * LANES + Warp::lane();
        const CameraTriangle c = CameraTriangle::of(camera, Corners::of(bvh.corners(slot)));
        // Triangles without area or seen edge-on are decided in Setup::triangle.
        bool shown = fabsf(c.volume) <= NOWHERE && is_shown(bvh, camera, c, slot);
        if (!Warp::any(shown)) return 0;
        const ProjectedTriangle p = ProjectedTriangle::of(camera, c.a, c.b, c.c);
        if (!(p.zmax > 0.0f)) shown = false;
        if (!MOVABLE && p.crossing) return shown ? PACKET_WIDTH * PACKET_HEIGHT : 0;
        const ImagePoint slack = slack_of(camera);
        const float to_x = camera.first_u + (float)first_x, to_y = camera.first_v + (float)first_y;
        const int x0 = p.crossing ? 0 : max(__float2int_ru(p.box.left - to_x - slack.u), 0);
        const int y0 = p.crossing ? 0 : max(__float2int_ru(p.box.top - to_y - slack.v), 0);
        const int x1 =
            p.crossing ? PACKET_WIDTH - 1 : min(__float2int_rd(p.box.right - to_x + slack.u), PACKET_WIDTH - 1);
        const int y1 =
            p.crossing ? PACKET_HEIGHT - 1 : min(__float2int_rd(p.box.bottom - to_y + slack.v), PACKET_HEIGHT - 1);
        const int count = shown && x0 <= x1 && y0 <= y1 ? (x1 - x0 + 1) * (y1 - y0 + 1) : 0;
        // Worthwhile if a packet sees much that is near: static scenes of small triangles become slower.
        const bool large = MOVABLE && count > LARGE;
        if (large && passes_by(camera, c, camera.left_of(SmallInt::to_float(first_x + x0) + camera.first_u),
                               camera.right_of(SmallInt::to_float(first_x + x1) + camera.first_u),
                               camera.above(SmallInt::to_float(first_y + y0) + camera.first_v),
                               camera.below(SmallInt::to_float(first_y + y1) + camera.first_v)))
            return 0;
        return p.cover(count);
    }

    // Whether a triangle lies outside a rectangle of the image, by its edge functions.
    static inline bool passes_by(const Camera& camera, const CameraTriangle& c, float u0, float u1, float v0,
                                 float v1) {
        const float edge_error = c.edge_error(camera);
        const float sign = c.volume < 0.0f ? -1.0f : 1.0f;
        if (camera.origins.is_side_uncertain(c.volume, c.volume_error, c.normal)) return false;
        return fabsf(c.volume) >= c.volume_error &&
               (beyond(camera.origins, edge(c.b, c.c, sign), edge_error, u0, u1, v0, v1) ||
                beyond(camera.origins, edge(c.c, c.a, sign), edge_error, u0, u1, v0, v1) ||
                beyond(camera.origins, edge(c.a, c.b, sign), edge_error, u0, u1, v0, v1));
    }
    // An edge function is greatest at a corner. Rounding is monotonic: no pixel of the rectangle contradicts the
    // corner.
    static inline bool beyond(const Origins& origins, const Edge& edge, float error_bound, float u0, float u1, float v0,
                              float v1) {
        return origins.max_edge(edge, edge.u >= 0.0f ? u1 : u0, edge.v >= 0.0f ? v1 : v0) < -error_bound;
    }

    // Set up a triangle of a leaf.
    static inline Triangle triangle(const Bvh& bvh, const Camera& camera, int first_x, int first_y, unsigned slot) {
        const CameraTriangle c = CameraTriangle::of(camera, Corners::of(bvh.corners(slot)));
        const float edge_error = c.edge_error(camera);
        // Single precision cannot decide whether the front or the back is visible.
        const bool edge_on = fabsf(c.volume) < c.volume_error;
        const ProjectedTriangle p = ProjectedTriangle::of(camera, c.a, c.b, c.c);
        const PixelBounds bounds = p.box.pixels({camera.first_u, camera.first_v}, {camera.last_x, camera.last_y},
                                                slack_of(camera), p.crossing);
        const float sign = c.volume < 0.0f ? -1.0f : 1.0f, scale = 1.0f / c.volume;
        Triangle t;
        t.slot = slot;
        const bool has_area = fabsf(c.volume) <= NOWHERE && (edge_on || c.volume != 0.0f);
        if (POINTS)
            cut_cells(camera, p, has_area, t);
        else
            cut_pixels(bounds, first_x, first_y, has_area, t);
        t.edge[0] = edge(c.b, c.c, sign);
        t.edge[1] = edge(c.c, c.a, sign);
        t.edge[2] = edge(c.a, c.b, sign);
        t.slope_u = c.normal.x * scale;
        t.slope_v = c.normal.y * scale;
        t.u = p.u[0], t.v = p.v[0], t.inv_z = p.inv_z[0];
        t.min_inv_z = p.crossing ? 1.0f / p.zmax : Three::min(p.inv_z[0], p.inv_z[1], p.inv_z[2]);
        t.max_inv_z = p.crossing ? MAX_INV_Z : Three::max(p.inv_z[0], p.inv_z[1], p.inv_z[2]);
        t.uncertain_side = camera.origins.is_side_uncertain(c.volume, c.volume_error, c.normal);
        t.exact = edge_on || t.sees_both_sides() || loses_digits(camera, p, bounds, t, c.sides, scale);
        // Inside a triangle, an edge function is at most the volume times 1 / z: this bounds it if the volume is within
        // its error bound.
        t.error_bound = edge_error;
        if (edge_on && !t.sees_both_sides())
            t.error_bound = p.crossing ? NOWHERE : __fmaf_rn(2.0f * c.volume_error, t.max_inv_z, edge_error);
        return t;
    }
};
