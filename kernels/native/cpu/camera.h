// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Cameras in the frame of the geometry that they see.
//
// Coordinates are the camera's, with x and y scaled by the focal lengths: the ray of a pixel is (u, v, 1), where u and
// v are its distances in pixels from the principal point. The edge functions of a triangle, whose signs give the side
// on which the ray passes, and inv_z = 1 / z of the triangle's plane are then linear in u and v.
//
// An edge function is evaluated by the same expressions in the same order wherever it is needed, and if rounding leaves
// its sign uncertain, it is evaluated in double precision (shared/edges.h): no ray slips between triangles.

#pragma once

#include "cpu/ray_tree.h"
#include "shared/edges.h"
#include "shared/pose.h"

// The images to render, in units of strips.
struct Job {
    int views, height, width;
    int strips;  // per view
    // first row of each strip, and the end of the last one; multiples of TILE_SIDE except for that end
    const int* strip_rows;
    int max_rows;  // of any strip
    double focal[2], center[2];
    float near, far;
    // Surfaces with a greater 1 / z are clipped, and the distance from the camera up to which the image may contain
    // clipped ones. If surfaces nearer than `near` still occlude, these are infinity and 0.
    float clip_inv_z, clip_reach;
    bool cull_back_faces;
    bool shows_back_faces;  // whether those of closed objects may be visible from outside
    const float* poses;  // [view]: x y z qx qy qz qw
    int points;  // per view, if rays pass through points instead of pixel centers; else 0
    const float* pixels;  // [view][point]: x and y in pixels

    // The images of a `PinholeCamera` of kernels/pinhole.py, at a multiple of its resolution.
    template <class PinholeCamera, class Poses>
    static inline Job of_camera(const PinholeCamera& camera, const Poses& poses, double scale = 1.0) {
        Job job = Job();
        job.views = poses.shape[0];
        job.height = (int)__builtin_ceil(camera.height * scale);
        job.width = (int)__builtin_ceil(camera.width * scale);
        job.focal[0] = camera.fx * scale, job.focal[1] = camera.fy * scale;
        job.center[0] = camera.cx * scale, job.center[1] = camera.cy * scale;
        job.near = camera.near, job.far = camera.far;
        job.clip_inv_z = camera.clip_inv_z, job.clip_reach = camera.clip_reach;
        job.poses = (const float*)poses.data;
        return job;
    }
    // The images of a call of kernels/casting/packets.py or ray_bundle_packets.py.
    template <class Call>
    static inline Job of_call(const Call& call) {
        Job job = of_camera(call.job.camera, call.poses);
        job.cull_back_faces = call.job.cull_backfaces != 0;
        return job;
    }
    // The job of a `PacketCall` of kernels/casting/packets.py.
    template <class PacketCall>
    static inline Job of(const PacketCall& call) {
        Job job = of_call(call);
        job.strips = call.job.strip_rows.shape[0] - 1;
        job.strip_rows = call.job.strip_rows.data;
        job.max_rows = call.job.max_rows;
        job.points = call.job.points;
        job.pixels = call.job.pixels.data;
        return job;
    }
    inline Pose pose_of(int view) const { return Pose::from(poses + (long long)view * POSE_WORDS); }
};

typedef float Row[3];
typedef double ExactRow[3];

// A camera in the frame of a tree, the world's or an object's, and the transformation from that frame into camera
// space.
struct Camera {
    float origin[3];
    float to_camera[3][3];  // rows: x scaled by fx, y scaled by fy, z
    double exact_origin[3];
    // rows: x and y divided by the focal lengths, z; a ray is their linear combination with coefficients u, v and 1
    double exact_to_camera[3][3];
    float origin_error[3];  // rounding error of the origin, in camera space: 0 in the world frame
    float first_u, first_v;  // u and v of pixel (0, 0) of the view
    double exact_first_u, exact_first_v;
    // pixels from the principal point to the farthest side of the image, or the focal length if that is greater
    float extent;
    float per_extent;  // 1 / that
    float edge_error_bound;  // relative error bound of edge functions: see shared/error_bounds.h
    float far;
    float blur;  // distance by which rounding may move a corner, in pixels
    bool skip_back_faces;  // of closed objects, because the camera is outside all of them
    bool cull_back_faces;  // of all objects, because the caller requested it
    const unsigned char* excluded;  // [object]: not 0 for excluded objects; null if no object is excluded

    template <RayKind KIND>
    static inline Camera of(const Pose& pose, const Job& job) {
        Camera camera;
        for (int k = 0; k < 3; ++k) {
            camera.exact_origin[k] = pose.position[k];
            camera.origin[k] = (float)pose.position[k];
            for (int i = 0; i < 3; ++i) {
                const double f = i < 2 ? job.focal[i] : 1.0;
                camera.to_camera[i][k] = (float)(pose.axis[i][k] * f);
                camera.exact_to_camera[i][k] = pose.axis[i][k] / f;
            }
        }
        for (int i = 0; i < 3; ++i) {
            double error = 0.0;
            for (int k = 0; k < 3; ++k) error += pose.axis[i][k] * (camera.exact_origin[k] - camera.origin[k]);
            camera.origin_error[i] = (float)(i < 2 ? error * job.focal[i] : error);
        }
        camera.first_u = (float)(0.5 - job.center[0]);
        camera.first_v = (float)(0.5 - job.center[1]);
        camera.exact_first_u = 0.5 - job.center[0];
        camera.exact_first_v = 0.5 - job.center[1];
        const double reach = reach_of(job), focal = job.focal[0] < job.focal[1] ? job.focal[0] : job.focal[1];
        camera.extent = (float)(reach > focal ? reach : focal);
        camera.per_extent = 1.0f / camera.extent;
        camera.edge_error_bound =
            EDGE_ERROR_BOUND * (KIND == PIXEL_RAYS ? 1.0f : ROUNDED_RAY_FACTOR) * (float)(1.0 + reach / focal);
        camera.far = job.far * FARTHER;
        camera.blur = ROUNDING * ((float)(job.focal[0] + job.focal[1]) + (float)(job.width + job.height));
        camera.skip_back_faces = false;
        camera.cull_back_faces = job.cull_back_faces;
        camera.excluded = nullptr;
        return camera;
    }

    // In the frame of a stretched object, divided by the factors.
    template <RayKind KIND>
    static inline Camera of(const Pose& pose, const Stretch& stretch, const Job& job) {
        Pose scaled = pose;
        for (int k = 0; k < 3; ++k) {
            scaled.position[k] /= stretch.factor[k];
            for (int i = 0; i < 3; ++i) scaled.axis[i][k] *= stretch.factor[k];
        }
        Camera camera = of<KIND>(scaled, job);
        // Points are multiplied by the factors on the way into camera space, rays divided by them on the way out.
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < 3; ++i) camera.exact_to_camera[i][k] /= stretch.factor[k] * stretch.factor[k];
        return camera;
    }

    // Distance from the principal point to the farthest side of the image, in pixels.
    static inline double reach_of(const Job& job) {
        const double size[2] = {(double)job.width, (double)job.height};
        double extent = 0.0;
        for (int k = 0; k < 2; ++k) {
            const double sides[2] = {__builtin_fabs(job.center[k]), __builtin_fabs(size[k] - job.center[k])};
            for (double pixels : sides) extent = pixels > extent ? pixels : extent;
        }
        return extent;
    }

    // u and v of a pixel of the view.
    inline double exact_u(int x) const { return x + exact_first_u; }
    inline double exact_v(int y) const { return y + exact_first_v; }
    // The ray through an image point, in the frame of the tree.
    inline void ray_at(double u, double v, double* ray) const {
        const ExactRow* m = exact_to_camera;
        for (int k = 0; k < 3; ++k) ray[k] = u * m[0][k] + (v * m[1][k] + m[2][k]);
    }

    inline Points relative(Floats x, Floats y, Floats z) const {
        return Points{x - origin[0], y - origin[1], z - origin[2]};
    }
    // Transform points relative to the rounded origin into camera space.
    inline Points transform(Points p) const {
        const Row* m = to_camera;
        return Points{m[0][0] * p.x + (m[0][1] * p.y + (m[0][2] * p.z - origin_error[0])),
                      m[1][0] * p.x + (m[1][1] * p.y + (m[1][2] * p.z - origin_error[1])),
                      m[2][0] * p.x + (m[2][1] * p.y + (m[2][2] * p.z - origin_error[2]))};
    }
};

// The view frustum: a point relative to the rounded origin is inside if every plane evaluates to more than `least`.
struct Frustum {
    enum { PLANES = 5 };  // plane of the camera, left, right, top, bottom

    float plane[PLANES][3], min_product[PLANES];

    template <RayKind KIND>
    static inline Frustum of(const Camera& camera, const Image& image) {
        Frustum frustum;
        const Row* m = camera.to_camera;
        const float center_x = image.center_x, center_y = image.center_y;
        for (int k = 0; k < 3; ++k) {
            frustum.plane[0][k] = m[2][k];
            frustum.plane[1][k] = m[0][k] + center_x * m[2][k];
            frustum.plane[2][k] = (image.width - center_x) * m[2][k] - m[0][k];
            frustum.plane[3][k] = m[1][k] + center_y * m[2][k];
            frustum.plane[4][k] = (image.height - center_y) * m[2][k] - m[1][k];
        }
        const float* error = camera.origin_error;
        frustum.min_product[0] = error[2];
        frustum.min_product[1] = error[0] + center_x * error[2];
        frustum.min_product[2] = (image.width - center_x) * error[2] - error[0];
        frustum.min_product[3] = error[1] + center_y * error[2];
        frustum.min_product[4] = (image.height - center_y) * error[2] - error[1];
        if constexpr (KIND == ORIGIN_RAYS) {
            frustum.min_product[1] -= image.tree->origins.max_p, frustum.min_product[2] -= image.tree->origins.max_p;
            frustum.min_product[3] -= image.tree->origins.max_q, frustum.min_product[4] -= image.tree->origins.max_q;
        }
        return frustum;
    }
};

// Basis of the camera's rays in the world: a ray is forward + u * right + v * down.
struct Rays {
    float right[3], down[3], forward[3];

    static inline Rays of(const Camera& camera) {
        Rays rays;
        for (int k = 0; k < 3; ++k) {
            rays.right[k] = (float)camera.exact_to_camera[0][k];
            rays.down[k] = (float)camera.exact_to_camera[1][k];
            rays.forward[k] = (float)camera.exact_to_camera[2][k];
        }
        return rays;
    }
    template <class Number>
    inline Points at(Floats u, Number v) const {
        return Points{u * right[0] + (v * down[0] + forward[0]), u * right[1] + (v * down[1] + forward[1]),
                      u * right[2] + (v * down[2] + forward[2])};
    }
};
