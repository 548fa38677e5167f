// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What packets know of a camera.

// Error bound of a triangle's volume, as a share of the product of the lengths of two sides, of the distance of their
// corner and of the rows of to_camera: 4 sqrt(3) roundings of each side, 5 sqrt(3) of the corner and 5 of the products
// and their sum are 28 roundings. It is 0 where two corners are one, as in unused lanes of a leaf.
constexpr float VOLUME_ERROR = 28.0f * 6e-8f;
// Error bound of a component of a triangle's normal, as a share of the product of the lengths of two sides and of two
// rows: four roundings.
constexpr float SLOPE_ERROR = 2.4e-7f;

// The camera in the world or in the frame of an object that moves, and how that frame turns into its space. It lies in
// shared memory: all lanes read the same.
struct Camera {
    Vec3 origin, rest;  // their sum is the origin: in an object's frame, single precision need not be enough for it
    Vec3 to_camera[3];  // rows: x scaled by fx, y scaled by fy, z
    // Rows of to_camera, divided by the exact rays; of a table, in double precision.
    double rows[RAY_TABLE ? 9 : 3];
    float first_u, first_v;  // u and v of the view's first pixel
    float last_x, last_y;  // the view's last column and row; of points, how far its sides are from the principal point
    float far;
    float blur;  // how far rounding may move a corner, in pixels
    float extent,
        per_extent;  // pixels to the image's farthest side, or the focal length if that is more; and 1 by that
    ImagePoint slope_error;  // SLOPE_ERROR times the lengths of the other two rows of to_camera
    float volume_error;  // VOLUME_ERROR times the lengths of the rows of to_camera
    Vec3 stretch;  // how many times as large as it was made the object is that is drawn; only where RESIZED
    float spread;  // of a table or points: how far from a pixel's centre its ray may pass, along each axis
    bool skip_back_faces;  // of objects that are closed, since the camera is outside them all
    bool cull_back_faces;  // of all objects
    CellGrid cells;  // of points
    Origins origins;  // of rays
    NearPlane near;
    Vec3d exact_origin;
    Vec3d exact_rays[3];  // a ray is u times the first, plus v times the second, plus the third

    inline Vec3 relative(Vec3 p) const {
        const Vec3 from = Vec3::minus(p, origin);
        return MOVABLE || RAY_ORIGINS ? Vec3::minus(from, rest) : from;
    }
    // A place as much farther, or less far, as a ray may pass from the centre of its pixel.
    inline float wider(float place) const { return RAY_TABLE ? place + spread : place; }
    inline float before(float place) const { return RAY_TABLE ? place - spread : place; }
    // A number of a row of to_camera in the frame of an object, of which the axis and the number of the ray are given.
    inline double turned_row(int row, Vec3d axis, double of_ray) const {
        return RAY_TABLE ? Vec3d::dot(axis, Vec3d{rows[3 * row], rows[3 * row + 1], rows[3 * row + 2]})
                         : of_ray * rows[row];
    }
    // Whether that side of a triangle is drawn of which the volume is negative in front.
    inline bool draws_side(const int* owner, double volume) const {
        return !(cull_back_faces || (skip_back_faces && __ldg(owner) < 0)) || volume < 0.0;
    }
    // Set error bounds by the lengths of the first two rows of to_camera; the third is a unit vector.
    inline void set_errors(float width, float height) {
        slope_error = ImagePoint{SLOPE_ERROR * height, SLOPE_ERROR * width};
        volume_error = VOLUME_ERROR * (width * height);
    }
    // At least how long a vector between two points of the drawn object is [m].
    inline float world_length(Vec3 v) const {
        return RESIZED ? fabsf(v.x * stretch.x) + fabsf(v.y * stretch.y) + fabsf(v.z * stretch.z)
                       : fabsf(v.x) + fabsf(v.y) + fabsf(v.z);
    }
    inline Vec3 turn(Vec3 p) const {
        return Vec3{Vec3::dot(to_camera[0], p), Vec3::dot(to_camera[1], p), Vec3::dot(to_camera[2], p)};
    }
};
