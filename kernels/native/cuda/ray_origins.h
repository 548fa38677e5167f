// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rays with distinct origins, as of a lidar. The eye of a packet lies amid its rays, behind all their origins.
//
// A ray (p, q, 0) + z (u, v, 1) has Plücker coordinates with direction d = (u, v, 1) and moment m = (-q, p, u q - v p)
// about the eye. The edge function of an edge from a to b is their side product (a x b) . d + (a - b) . m: its sign
// gives the side on which the ray passes, and its first term is the edge function of a ray from the eye. If N . d is 1
// / z of a plane for a ray from the eye, N . d / (1 - N . (p, q, 0)) is 1 / z for this ray. A point that the eye sees
// at u is seen at u - p / z by such a ray: bounds in the image are wider by that.

#pragma once

#include "cuda/bvh.h"

// All rays start at the eye.
struct EyeRays {
    typedef ImagePoint RayPlace;
    typedef ExactImagePoint ExactRayPlace;

    // Edge function of a triangle: positive where rays pass inside the edge.
    struct Edge : Linear {
        static inline Edge of(Vec3 product, Vec3) { return Edge{{product.x, product.y, product.z}}; }
        inline float of_ray(RayPlace p) const { return at(p.u, p.v); }
    };

    // Bounds on the ray origins of a packet.
    struct Origins {
        static inline float max_edge(const Edge& edge, float u, float v) { return edge.at(u, v); }
        static inline float min_edge(const Edge& edge, float u, float v) { return edge.at(u, v); }
        static inline ImagePoint aside() { return ImagePoint{0.0f, 0.0f}; }
        static inline ImagePoint aside_at(float) { return ImagePoint{0.0f, 0.0f}; }
        static inline ImagePoint seen(RayPlace p, float) { return p; }
        static inline float past(float along) { return along; }
        static inline float corner_distance(float farthest) { return farthest; }
        static inline float error(float of_inv_z) { return of_inv_z; }
        static inline float volume(float rounding, Vec3) { return rounding; }
        static inline bool is_side_uncertain(float, float, Vec3) { return false; }
        static inline float nearest(float inv_z, float, float) { return inv_z; }
        static inline bool may_hide(float) { return false; }
        static inline float along(float inv_z, float, float, RayPlace) { return inv_z; }
        static inline double along(double inv_z, double, double, ExactRayPlace) { return inv_z; }
        static inline Vec3d start(ExactRayPlace, Vec3d eye, const Vec3d*) { return eye; }
        static inline Vec3 start(RayPlace, Vec3 eye, Vec3, Vec3) { return eye; }
    };

    // Ray origins of a ray table.
    struct RayStarts {
        static inline RayStarts from(const ImagePoint*, const float*) { return RayStarts{}; }
        static inline RayPlace of(ImagePoint p, int) { return p; }
        static inline ExactRayPlace of(ExactImagePoint p, int) { return p; }
        static inline float begin_of(int) { return 0.0f; }
        static inline float from_begin(float z, float) { return z; }
        static inline bool is_behind(float, int) { return false; }
    };

    // The eye of a table's packet: the position of its camera.
    struct TableEye {
        static inline TableEye of(const double*) { return TableEye{}; }
        static inline Vec3d place(Vec3d camera, const Vec3d*) { return camera; }
        static inline Origins origins() { return Origins{}; }
        static inline float farthest(float z) { return z; }
        static inline float reach(float of_near_plane) { return of_near_plane; }
    };
};

struct OriginRays {
    // Position of a ray: u and v [px] at z = 1, and its offset p and q from the eye [px m].
    struct RayPlace : ImagePoint {
        float p, q;
    };
    struct ExactRayPlace : ExactImagePoint {
        double p, q;
    };

    // Edge function of a triangle: positive for rays that pass inside the edge.
    struct Edge : Linear {
        Vec3 side;  // edge vector a - b, scaled like the coefficients of `Linear`

        static inline Edge of(Vec3 product, Vec3 side) { return Edge{{product.x, product.y, product.z}, side}; }
        inline float of_ray(RayPlace r) const {
            const float moment_z = __fmaf_rn(r.u, r.q, -__fmul_rn(r.v, r.p));
            return at(r.u, r.v) + __fmaf_rn(side.y, r.p, __fmaf_rn(side.z, moment_z, -__fmul_rn(side.x, r.q)));
        }
    };

    // Bounds of the ray origins of a packet.
    struct Origins {
        float max_p, max_q;
        float max_moment_z;  // greatest magnitude of u q - v p
        float reach;  // greatest distance of a ray origin from the eye
        float first_inv_z;  // 1 / z of the farthest ray origin

        // Rounding errors of moments, relative to the error bound of an edge function.
        static inline float moment_roundings() { return 16.0f; }

        // Bounds of an edge function at an image point, for all rays there.
        inline float max_edge(const Edge& edge, float u, float v) const { return edge.at(u, v) + differs(edge); }
        inline float min_edge(const Edge& edge, float u, float v) const { return edge.at(u, v) - differs(edge); }
        inline float differs(const Edge& edge) const {
            const Vec3 side = {fabsf(edge.side.x), fabsf(edge.side.y), fabsf(edge.side.z)};
            return 1.0001f * __fmaf_rn(max_p, side.y, __fmaf_rn(max_q, side.x, max_moment_z * side.z));
        }
        // Greatest distance of rays from the eye [px m], and the margin that it adds to bounds of surfaces no nearer
        // than 1 / z [px].
        inline ImagePoint aside() const { return ImagePoint{max_p, max_q}; }
        inline ImagePoint aside_at(float inv_z) const { return ImagePoint{max_p * inv_z, max_q * inv_z}; }
        // Image point at which the eye sees a ray's intersection at 1 / z.
        static inline ImagePoint seen(RayPlace r, float inv_z) {
            return ImagePoint{__fmaf_rn(r.p, inv_z, r.u), __fmaf_rn(r.q, inv_z, r.v)};
        }
        // Greatest magnitude of N . (p, q, 0).
        inline float along(Vec3 normal) const { return __fmaf_rn(max_p, fabsf(normal.x), max_q * fabsf(normal.y)); }
        // Threshold of twice a box's distance along a direction, raised from the eye's to one that holds for all ray
        // origins.
        inline float past(float along) const { return along + 4.0f * reach; }
        // Distance of the corners to which the error bound of an edge function is proportional.
        inline float corner_distance(float farthest) const { return farthest + moment_roundings() * (max_p + max_q); }
        // Error bound of 1 / z, which is divided by at least 1/2.
        static inline float error(float of_inv_z) { return 2.0f * of_inv_z; }
        // Error bound of the volume of a triangle and the eye as that of the triangle and any ray origin.
        inline float volume(float rounding, Vec3 normal) const { return rounding + along(normal); }
        // Whether rays begin so close to a triangle's plane that they may see another side than the eye does.
        inline bool is_side_uncertain(float of_eye, float rounding, Vec3 normal) const {
            return fabsf(of_eye) < rounding + 2.0f * along(normal);
        }
        // Greatest 1 / z of a plane, given that of a ray from the eye.
        inline float nearest(float inv_z, float slope_u, float slope_v) const {
            return 1.0001f * inv_z / (1.0f - fminf(along(Vec3{slope_u, slope_v, 0.0f}), 0.5f));
        }
        // Whether a ray may begin behind a surface.
        inline bool may_hide(float inv_z) const { return inv_z > first_inv_z; }
        static inline float along(float inv_z, float slope_u, float slope_v, RayPlace r) {
            return inv_z / (1.0f - __fmaf_rn(slope_u, r.p, __fmul_rn(slope_v, r.q)));
        }
        static inline double along(double inv_z, double slope_u, double slope_v, ExactRayPlace r) {
            return inv_z / (1.0 - (slope_u * r.p + slope_v * r.q));
        }
        // Intersection of a ray with the plane of the eye, in the frame of the eye's position and the basis vectors.
        static inline Vec3d start(ExactRayPlace r, Vec3d eye, const Vec3d* rays) {
            return Vec3d{eye.x + (r.p * rays[0].x + r.q * rays[1].x), eye.y + (r.p * rays[0].y + r.q * rays[1].y),
                         eye.z + (r.p * rays[0].z + r.q * rays[1].z)};
        }
        static inline Vec3 start(RayPlace r, Vec3 eye, Vec3 right, Vec3 down) {
            return Vec3::along(Vec3::along(eye, down, r.q), right, r.p);
        }
    };

    // Ray origins of a ray table, in the order of the z-buffer.
    struct RayStarts {
        const ImagePoint* aside;  // p and q of each ray
        const float* begin;  // z of each origin

        static inline RayStarts from(const ImagePoint* aside, const float* begin) { return RayStarts{aside, begin}; }
        inline RayPlace of(ImagePoint point, int slot) const {
            const ImagePoint offset = aside[slot];
            return RayPlace{point, offset.u, offset.v};
        }
        inline ExactRayPlace of(ExactImagePoint point, int slot) const {
            const ImagePoint offset = aside[slot];
            return ExactRayPlace{point, offset.u, offset.v};
        }
        inline float begin_of(int slot) const { return __ldg(begin + slot); }
        static inline float from_begin(float z, float begin) { return z - begin; }
        inline bool is_behind(float inv_z, int slot) const { return inv_z * begin[slot] > 1.0f; }
    };

    // Eye of a packet of a ray table, in the camera frame of the table, and bounds of its ray origins.
    struct TableEye {
        const double* numbers;  // [WORDS]

        enum { P = 3, Q, MOMENT_Z, REACH, LAST, WORDS };

        static inline TableEye of(const double* numbers) { return TableEye{numbers}; }
        inline Vec3d place(Vec3d camera, const Vec3d* axis) const {
            Vec3d eye = camera;
            for (int i = 0; i < 3; ++i) {
                const Vec3d step = Vec3d::times(axis[i], numbers[i]);
                eye = Vec3d{eye.x + step.x, eye.y + step.y, eye.z + step.z};
            }
            return eye;
        }
        inline Origins origins() const {
            const float last = (float)numbers[LAST];
            return Origins{(float)numbers[P], (float)numbers[Q], (float)numbers[MOMENT_Z], (float)numbers[REACH],
                           last > 0.0f ? 0.9999f / last : NOWHERE};
        }
        // Greatest z from the eye of a point at distance z from a ray origin.
        inline float farthest(float z) const { return z + (float)numbers[LAST]; }
        // Greatest distance of a ray origin from the eye.
        inline float reach(float) const { return (float)numbers[REACH]; }
    };
};

typedef Select<RAY_ORIGINS>::Type<OriginRays, EyeRays> Rays;
typedef Rays::RayPlace RayPlace;
typedef Rays::ExactRayPlace ExactRayPlace;
typedef Rays::Edge Edge;
typedef Rays::Origins Origins;
typedef Rays::RayStarts RayStarts;
typedef Rays::TableEye TableEye;
