// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rays that pass beside the eye, since they begin apart from each other: a lidar's. The eye is amidst a packet's rays,
// and behind all their origins.
//
// A ray (p, q, 0) + z (u, v, 1) has the moment m = (-q, p, u q - v p) about the eye, and passes an edge from a to b on
// the side that the sign of (a x b) . (u, v, 1) + (a - b) . m says: two terms, of which the first is that of a ray from
// the eye. Of a plane whose 1 / z is N . (u, v, 1) there, it is that divided by 1 - N . (p, q, 0) here. What is seen
// from the eye at u is seen at u - p / z by such a ray: bounds in the image are that much wider.
//
// See no_origins.h for rays from the eye.

// Where a ray passes: 1 ahead of the eye, in pixels, and beside it, in pixels times depth.
struct RayPlace : ImagePoint {
    float p, q;
};
struct ExactRayPlace : ExactImagePoint {
    double p, q;
};

// An edge of a triangle: a value that is positive where rays pass inside of it.
struct Edge : Linear {
    Vec3 side;  // from its end to its beginning, as long as `Linear` is of their product

    static inline Edge of(Vec3 product, Vec3 side) {
        Edge edge;
        edge.u = product.x, edge.v = product.y, edge.one = product.z;
        edge.side = side;
        return edge;
    }
    inline float of_ray(RayPlace r) const {
        const float turn = __fmaf_rn(r.u, r.q, -__fmul_rn(r.v, r.p));
        return at(r.u, r.v) + __fmaf_rn(side.y, r.p, __fmaf_rn(side.z, turn, -__fmul_rn(side.x, r.q)));
    }
};

// What is known of where rays of a packet begin.
struct Origins {
    float most_p, most_q;
    float most_turn;  // of u q - v p
    float reach;  // how far from the eye a ray begins
    float first_inv_z;  // 1 / z where the last one begins

    // Roundings of moments, in parts of the doubt of an edge.
    static inline float doubts() { return 16.0f; }

    // Of a place in the image, what an edge is at most, or at least.
    inline float most(const Edge& edge, float u, float v) const { return edge.at(u, v) + differs(edge); }
    inline float least(const Edge& edge, float u, float v) const { return edge.at(u, v) - differs(edge); }
    inline float differs(const Edge& edge) const {
        const Vec3 side = {fabsf(edge.side.x), fabsf(edge.side.y), fabsf(edge.side.z)};
        return 1.0001f * __fmaf_rn(most_p, side.y, __fmaf_rn(most_q, side.x, most_turn * side.z));
    }
    // How far beside the eye a ray passes [px m], and how much wider that makes what is no nearer than 1 / z [px].
    inline ImagePoint aside() const { return ImagePoint{most_p, most_q}; }
    inline ImagePoint aside_at(float inv_z) const { return ImagePoint{most_p * inv_z, most_q * inv_z}; }
    // Where in the image is what a ray meets at 1 / z.
    static inline ImagePoint seen(RayPlace r, float inv_z) {
        return ImagePoint{__fmaf_rn(r.p, inv_z, r.u), __fmaf_rn(r.q, inv_z, r.v)};
    }
    // Of a normal of any length, how much of it that may be.
    inline float along(Vec3 normal) const { return __fmaf_rn(most_p, fabsf(normal.x), most_q * fabsf(normal.y)); }
    // Of twice a box from the eye: how far it has to be along a direction for all origins, if it has so for the eye.
    inline float past(float along) const { return along + 4.0f * reach; }
    // How far away corners are, as roundings of an edge are part of.
    inline float away(float farthest) const { return farthest + doubts() * (most_p + most_q); }
    // Of 1 / z, which is divided by no less than a half.
    static inline float error(float of_inv_z) { return 2.0f * of_inv_z; }
    // What is wrong with the volume of a triangle and the eye, as that of one and an origin.
    inline float volume(float rounding, Vec3 normal) const { return rounding + along(normal); }
    // Whether rays begin so near to a triangle's plane that they may see it from another side than the eye does.
    inline bool is_beside(float of_eye, float rounding, Vec3 normal) const {
        return fabsf(of_eye) < rounding + 2.0f * along(normal);
    }
    // The greatest 1 / z of a plane, given that of a ray from the eye.
    inline float nearest(float inv_z, float slope_u, float slope_v) const {
        return 1.0001f * inv_z / (1.0f - fminf(along(Vec3{slope_u, slope_v, 0.0f}), 0.5f));
    }
    // Whether a ray may begin behind a place.
    inline bool may_hide(float inv_z) const { return inv_z > first_inv_z; }
    static inline float along(float inv_z, float slope_u, float slope_v, RayPlace r) {
        return inv_z / (1.0f - __fmaf_rn(slope_u, r.p, __fmul_rn(slope_v, r.q)));
    }
    static inline double along(double inv_z, double slope_u, double slope_v, ExactRayPlace r) {
        return inv_z / (1.0 - (slope_u * r.p + slope_v * r.q));
    }
    // Where a ray passes the plane of the eye, in the frame of the eye and of what (u, v, 1) are the coordinates of.
    static inline Vec3d start(ExactRayPlace r, Vec3d eye, const Vec3d* rays) {
        return Vec3d{eye.x + (r.p * rays[0].x + r.q * rays[1].x), eye.y + (r.p * rays[0].y + r.q * rays[1].y),
                     eye.z + (r.p * rays[0].z + r.q * rays[1].z)};
    }
    static inline Vec3 start(RayPlace r, Vec3 eye, Vec3 right, Vec3 down) {
        return Vec3{__fmaf_rn(r.p, right.x, __fmaf_rn(r.q, down.x, eye.x)),
                    __fmaf_rn(r.p, right.y, __fmaf_rn(r.q, down.y, eye.y)),
                    __fmaf_rn(r.p, right.z, __fmaf_rn(r.q, down.z, eye.z))};
    }
};

// Where rays of a table begin, in the order of the z-buffer.
struct RayStarts {
    const ImagePoint* aside;  // where they pass the plane of the eye
    const float* begin;  // z

    inline RayPlace of(ImagePoint at, int slot) const {
        const ImagePoint by = aside[slot];
        RayPlace place;
        place.u = at.u, place.v = at.v, place.p = by.u, place.q = by.v;
        return place;
    }
    inline ExactRayPlace of(ExactImagePoint at, int slot) const {
        const ImagePoint by = aside[slot];
        ExactRayPlace place;
        place.u = at.u, place.v = at.v, place.p = by.u, place.q = by.v;
        return place;
    }
    inline float from_start(float z, int slot) const { return z - begin[slot]; }
    inline bool is_behind(float inv_z, int slot) const { return inv_z * begin[slot] > 1.0f; }
};

// Of a table's packet, where its eye is in the space of the table's camera, and what is known of its rays.
struct TableEye {
    const double* numbers;  // [TABLE_EYE_WORDS]

    enum { P = 3, Q, TURN, REACH, LAST, WORDS };

    inline Vec3d place(Vec3d camera, const Vec3d* axis) const {
        Vec3d at = camera;
        for (int i = 0; i < 3; ++i) {
            const Vec3d by = Vec3d::times(axis[i], numbers[i]);
            at = Vec3d{at.x + by.x, at.y + by.y, at.z + by.z};
        }
        return at;
    }
    inline Origins origins() const {
        const float last = (float)numbers[LAST];
        return Origins{(float)numbers[P], (float)numbers[Q], (float)numbers[TURN], (float)numbers[REACH],
                       last > 0.0f ? 0.9999f / last : NOWHERE};
    }
    // Of a place so far ahead of where a ray begins, how far ahead of the eye it is at most.
    inline float farthest(float z) const { return z + (float)numbers[LAST]; }
    // How far from the eye a ray begins.
    inline float reach(float) const { return (float)numbers[REACH]; }
};
static_assert((int)TableEye::WORDS == (int)TABLE_EYE_WORDS, "Python makes rows of numbers");
