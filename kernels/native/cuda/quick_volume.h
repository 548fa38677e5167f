// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Shadow volumes in single precision, with bounds of their errors: most points are far from the planes of a volume, and
// only others need shared/shadow_volumes.h.
//
// Let u be 2^-24, and let a light L (or a direction toward it), corners a, b and c, their edges e and a point p be
// relative to the center of a box. The normal of a plane is n = (a - L) x e, or that with b instead of a. Coordinates
// of a, b and L are rounded once, so that a - L is wrong by at most 3 u G with G = |L| + |a| + |a - b|, where |x| is
// the sum of magnitudes; an edge is the rounded difference of two given corners. So each component of n is at most
// G |e|, and wrong by 6 u G |e|. The point minus a is wrong by 2 u D, where D bounds |p| + |a| + |a - b|. Their
// product, n.(p - a), is wrong by at most 11 u G |e| D. The plane of the triangle has an edge instead of G, which is
// wrong by less.

#pragma once

#include "cuda/lanes.h"
#include "shared/shadow_volumes.h"

// A point, and the greatest parameter of its ray toward a directional light at which a surface blocks it.
struct alignas(16) QuickPoint {
    float x, y, z, limit;
};

// A triangle's volume. The functions of its planes are divided by the bounds of their errors.
struct QuickVolume {
    enum { AROUND = 3, CAP = 3, PLANES = 4 };
    static constexpr float ERROR = 12.0f / (1 << 24);
    static constexpr float SAFE = 0.99f;  // covers the rounding of the limit's product

    float corner[3];
    float normal[PLANES][3];
    float offset;  // of the second plane, which does not contain the corner
    float steepness;  // the last function per unit of a ray's parameter; a lower bound

    // Compute from three corners and a center. `reach` bounds |p|. Returns whether the triangle has an area.
    inline bool set(const float (*given)[3], const double* center, const LightPlace& light, float reach) {
        Vec3 edge[AROUND], from = {0, 0, 0};
        float size[AROUND] = {0, 0, 0}, at_light = 0.0f, at_corner = 0.0f;
        for (int k = 0; k < 3; ++k) {
            corner[k] = given[0][k] - (float)center[k];
            const float place = (float)light.at[k];
            at_light += fabsf(place), at_corner += fabsf(corner[k]);
            (&from.x)[k] = light.directional ? -place : corner[k] - place;
            for (int i = 0; i < AROUND; ++i) {
                (&edge[i].x)[k] = given[(i + 1) % 3][k] - given[i][k];
                size[i] += fabsf((&edge[i].x)[k]);
            }
        }
        const Vec3 cap = Vec3::cross(edge[0], edge[1]);
        const float side = Vec3::dot(cap, from), distance = at_light + at_corner + size[0];
        const float extent = ERROR * (reach + at_corner + size[0]);
        const float side_error = ERROR * size[0] * size[1] * distance;
        const bool is_sure = fabsf(side) > side_error;
        const Vec3 second = light.directional ? from : Vec3::plus(from, edge[0]);
        set_plane(0, Vec3::cross(from, edge[0]), side, extent * distance * size[0], is_sure);
        set_plane(1, Vec3::cross(second, edge[1]), side, extent * distance * size[1], is_sure);
        set_plane(2, Vec3::cross(from, edge[2]), side, extent * distance * size[2], is_sure);
        set_plane(CAP, cap, side, extent * size[0] * size[1], is_sure);
        offset = -Vec3::dot(Vec3{normal[1][0], normal[1][1], normal[1][2]}, edge[0]);
        steepness = is_sure ? SAFE * (fabsf(side) - side_error) / (extent * size[0] * size[1]) : 0.0f;
        return size[0] > 0.0f && size[1] > 0.0f && size[2] > 0.0f;
    }
    // Divide a plane by its error. It becomes 0, which is uncertain, where the side of the light is uncertain.
    inline void set_plane(int index, Vec3 of_plane, float side, float error, bool is_sure) {
        const float scale = is_sure ? (side < 0.0f ? -1.0f : 1.0f) / fmaxf(error, LEAST_ERROR) : 0.0f;
        for (int k = 0; k < 3; ++k) normal[index][k] = scale * (&of_plane.x)[k];
    }
    static constexpr float LEAST_ERROR = 1e-30f;

    // The least function of the planes at a point: a point is inside above 1, and outside below -1, unless its limit
    // makes it uncertain.
    inline float least(QuickPoint point) const {
        const Vec3 p = {point.x - corner[0], point.y - corner[1], point.z - corner[2]};
        const float beyond = value(CAP, p);
        const float around = Three::min(value(0, p), value(1, p) + offset, value(2, p));
        const float found = fminf(beyond, around);
        return beyond + 1.0f <= steepness * point.limit ? found : fminf(found, 0.0f);
    }
    inline float value(int plane, Vec3 p) const {
        return Vec3::dot(Vec3{normal[plane][0], normal[plane][1], normal[plane][2]}, p);
    }
    // Whether points of a box about the center may be inside.
    inline bool meets(const float* half) const {
        const Vec3 middle = {-corner[0], -corner[1], -corner[2]};
        bool inside = true;
        for (int i = 0; i < PLANES; ++i) {
            const Vec3 size = {fabsf(normal[i][0]), fabsf(normal[i][1]), fabsf(normal[i][2])};
            const float greatest = value(i, middle) + Vec3::dot(size, Vec3{half[0], half[1], half[2]});
            inside &= greatest + (i == 1 ? offset : 0.0f) >= -1.0f;
        }
        return inside;
    }
};
