// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Camera data of packets.

#pragma once

#include "cuda/ray_origins.h"
#include "shared/error_bounds.h"

// The cells of a packet's points (points.h), used to find the points that a small triangle may cover. Packets of pixels
// need none.
struct CellGrid {
    enum { SIDE = !POINTS ? 1 : POINT_BLOCKS >= 32 ? 32 : POINT_BLOCKS >= 8 ? 16 : 8, COUNT = SIDE * SIDE };

    float per_u, per_v;  // cells per pixel of the packet

    // Cells per pixel for a side of `pixels` pixels, with no point beyond the last cell.
    static inline float per_side(float pixels) { return (SIDE - 0.01f) / fmaxf(pixels, 0.01f); }
};

// A range of cells, possibly empty.
struct Cells {
    int x0, y0, x1, y1;

    inline bool any() const { return POINTS && x0 <= x1 && y0 <= y1; }
    inline int count() const { return POINTS ? (x1 - x0 + 1) * (y1 - y0 + 1) : 0; }
    static inline Cells all() { return Cells{0, 0, CellGrid::SIDE - 1, CellGrid::SIDE - 1}; }
    // The cells between two positions, given as distances from the first points.
    static inline Cells between(const CellGrid& grid, float left, float top, float right, float bottom) {
        if (!POINTS) return all();
        const int last = CellGrid::SIDE - 1;
        return Cells{max(__float2int_rd(left * grid.per_u), 0), max(__float2int_rd(top * grid.per_v), 0),
                     min(__float2int_rd(right * grid.per_u), last), min(__float2int_rd(bottom * grid.per_v), last)};
    }
};

// The camera in the world or in the frame of a movable object, and the rotation from that frame into camera space. It
// is stored in shared memory because all lanes read the same values.
struct Camera {
    Vec3 origin, origin_error;  // their sum is the origin: single precision may not suffice for it in an object's frame
    Vec3 to_camera[3];  // rows: x scaled by fx, y scaled by fy, z
    // Rows of to_camera, divided by the exact rays; for a ray table, in double precision.
    double rows[RAY_TABLE ? 9 : 3];
    float first_u, first_v;  // u and v of the view's first pixel
    // the view's last column and row; for points, the distances of its sides from the principal point
    float last_x, last_y;
    float far;
    float blur;  // bound on the displacement of a corner by rounding, in pixels
    float extent,
        // distance in pixels to the farthest side of the image, at least the focal length; and its reciprocal
        per_extent;
    ImagePoint slope_error;  // SLOPE_ERROR times the lengths of the other two rows of to_camera
    float volume_error;  // VOLUME_ERROR times the lengths of the rows of to_camera
    Vec3 stretch;  // scale factors of the object being drawn relative to its built size; only if RESIZED
    ImagePoint spread;  // for a ray table or points: greatest distance of a ray from the center of its pixel
    bool skip_back_faces;  // for closed objects, since the camera is outside all of them
    bool cull_back_faces;  // for all objects
    CellGrid cells;  // for points
    Origins origins;  // of the rays
    NearPlane near;
    Vec3d exact_origin;
    Vec3d exact_rays[3];  // a ray is u times the first, plus v times the second, plus the third

    inline Vec3 relative(Vec3 p) const {
        const Vec3 offset = Vec3::minus(p, origin);
        return MOVABLE || RAY_ORIGINS ? Vec3::minus(offset, origin_error) : offset;
    }
    // A coordinate, moved outward or inward by the greatest distance of a ray from the center of its pixel. Points of
    // an image have the same along both axes: one number takes fewer registers.
    inline float right_of(float u) const { return RAY_TABLE ? u + spread.u : u; }
    inline float left_of(float u) const { return RAY_TABLE ? u - spread.u : u; }
    inline float below(float v) const { return IS_TABLE ? v + spread.v : right_of(v); }
    inline float above(float v) const { return IS_TABLE ? v - spread.v : left_of(v); }
    // A margin around a ray as one around the center of its pixel.
    inline ImagePoint wider(float margin) const { return ImagePoint{right_of(margin), below(margin)}; }
    // An element of a row of to_camera in the frame of an object, given the axis and the ray's component.
    inline double rotated_row(int row, Vec3d axis, double of_ray) const {
        return RAY_TABLE ? Vec3d::dot(axis, Vec3d{rows[3 * row], rows[3 * row + 1], rows[3 * row + 2]})
                         : of_ray * rows[row];
    }
    // Whether the side of a triangle is drawn whose volume is negative in front.
    inline bool shows_side(const int* owner, double volume) const {
        return !(cull_back_faces || (skip_back_faces && __ldg(owner) < 0)) || volume < 0.0;
    }
    // Set error bounds from the lengths of the first two rows of to_camera; the third is a unit vector.
    inline void set_errors(float width, float height) {
        slope_error = ImagePoint{SLOPE_ERROR * height, SLOPE_ERROR * width};
        volume_error = VOLUME_ERROR * (width * height);
    }
    // Upper bound on the length of a vector between two points of the object being drawn [m]: its L1 norm.
    inline float world_length(Vec3 v) const {
        return RESIZED ? fabsf(v.x * stretch.x) + fabsf(v.y * stretch.y) + fabsf(v.z * stretch.z)
                       : fabsf(v.x) + fabsf(v.y) + fabsf(v.z);
    }
    inline Vec3 rotate(Vec3 p) const { return Vec3::rotated(to_camera, p); }
};
