// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Visible surfaces of a row of pixels: their objects, materials, base colors and shading normals.

#pragma once

#include "shared/pose.h"
#include "shared/textures.h"
#include "shared/worlds.h"

// The images that are shaded, and the pixel that a row starts with.
struct SurfaceImages {
    const float* points;  // xyz in the world
    const int* segmentation;
    const int* faces;
    const float* normals;  // xyz in the world, facing the camera; null for base colors
    int view, width;
    long long first;

    template <class Numbers>
    static inline Triple<Numbers> triple(const float* image, long long place, int count) {
        typename Numbers::Real xyz[3];
        Numbers::load_triples(image + 3 * place, xyz, count);
        return Triple<Numbers>{xyz[0], xyz[1], xyz[2]};
    }
};

// Images of a row, as kernels/shading passes them.
template <class Points, class Integers, class Normals>
inline SurfaceImages surface_images(const Points& points, const Integers& segmentation, const Integers& faces,
                                    const Normals* normals, int view, int y) {
    const int width = points.shape[2];
    return SurfaceImages{(const float*)points.data,
                         segmentation.data,
                         faces.data,
                         normals ? (const float*)normals->data : nullptr,
                         view,
                         width,
                         ((long long)view * points.shape[1] + y) * width};
}

// Axes of a rotation in the world, in single precision.
struct Axes {
    // From a quaternion x y z w of any norm.
    static inline void turn(const float* q, float (*axis)[3]) {
        const float square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
        Pose::axes_of(q[0], q[1], q[2], q[3], 2.0f / square, axis);
    }
};

// A camera: its position and axes in a frame, and the size of a pixel, a `Footprint` of kernels/shading/base_colors.py.
struct Eye {
    enum Kind { NONE, PINHOLE, CONE, PARALLEL };
    Kind kind;
    float size[2];
    float position[3];
    float axis[3][3];  // right, down, forward

    // From a pose x y z qx qy qz qw, with a quaternion of any norm.
    template <class Footprint>
    static inline Eye of(const Footprint& footprint, const float* pose) {
        Eye eye;
        eye.kind = (Kind)footprint.kind;
        eye.size[0] = footprint.size[0], eye.size[1] = footprint.size[1];
        for (int k = 0; k < 3; ++k) eye.position[k] = pose[k];
        Axes::turn(pose + 3, eye.axis);
        return eye;
    }
};

// The frame of an object in the world of a view: points of the world in the object's frame, before and after its scale
// factors are divided out.
struct ObjectFrame {
    int entry;  // in the arrays of `DeviceMaterials`
    float position[3];
    float axis[3][3];  // x, y and z of the object in the world
    float factors[3], inverse_factors[3];
    bool has_sizes;  // whether sizes of worlds are given: the factors of a solid are its radii
    float straight;  // with sizes, half the length of a solid before scaling

    // `materials` is a `DeviceMaterials`, `worlds` a `Worlds` of kernels/casting/worlds.py.
    template <class Materials, class Worlds>
    static inline ObjectFrame of(const Materials& materials, const Worlds& worlds, int view, int entry) {
        ObjectFrame frame;
        frame.entry = entry, frame.has_sizes = false, frame.straight = 0.0f;
        const float* own = (const float*)(materials.object_pose.data + entry);
        const int column = materials.object_column.data[entry];
        for (int k = 0; k < 3; ++k) frame.position[k] = own[k], frame.factors[k] = 1.0f;
        if (column < 0) {
            Axes::turn(own + 3, frame.axis);
        } else {
            const int count = worlds.object_poses.shape[0];
            const int world = worlds.world.data ? worlds.world.data[view] : (count == 1 ? 0 : view);
            const long long row = (long long)world * worlds.object_poses.shape[1] + column;
            frame.place(own, (const float*)(worlds.object_poses.data + row));
            if (worlds.object_sizes.data) {
                for (int k = 0; k < 3; ++k) frame.factors[k] = worlds.object_sizes.data[row][k];
                frame.has_sizes = true, frame.straight = worlds.object_sizes.data[row][3];
            }
        }
        for (int k = 0; k < 3; ++k) frame.inverse_factors[k] = 1.0f / frame.factors[k];
        return frame;
    }
    // Set the position and the axes from a pose in the frame of another one, rows x y z qx qy qz qw.
    inline void place(const float* own, const float* other) {
        const float *a = other + 3, *b = own + 3;
        Axes::turn(a, axis);
        for (int k = 0; k < 3; ++k)
            position[k] = other[k] + own[0] * axis[0][k] + own[1] * axis[1][k] + own[2] * axis[2][k];
        const float product[4] = {
            a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
            a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
            a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
            a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
        };
        Axes::turn(product, axis);
    }
    // Rotate a direction of the world into the frame.
    inline void rotate_into(const float* direction, float* rotated) const {
        for (int k = 0; k < 3; ++k)
            rotated[k] = axis[k][0] * direction[0] + axis[k][1] * direction[1] + axis[k][2] * direction[2];
    }
    template <class Numbers>
    inline Triple<Numbers> into(const Triple<Numbers>& point) const {
        const Triple<Numbers> from_here = point.minus(position);
        return Triple<Numbers>{from_here.dot(axis[0]), from_here.dot(axis[1]), from_here.dot(axis[2])};
    }
    template <class Numbers>
    inline Triple<Numbers> out(const Triple<Numbers>& a) const {
        return Triple<Numbers>{
            a.x * axis[0][0] + a.y * axis[1][0] + a.z * axis[2][0],
            a.x * axis[0][1] + a.y * axis[1][1] + a.z * axis[2][1],
            a.x * axis[0][2] + a.y * axis[1][2] + a.z * axis[2][2],
        };
    }
};

// Rows of a table of numbers: one for each pixel, often the same for all.
template <class Numbers>
struct Rows {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    const float* numbers;
    Whole start;  // of each pixel's row
    int first;
    bool same;

    static inline Rows of(const float* numbers, int width, int first_row, Whole row, int shown, bool same) {
        return Rows{numbers + (long long)first_row * width, row * width, shown * width, same};
    }
    inline Real operator[](int k) const {
        return same ? Numbers::real(numbers[first + k]) : Numbers::gather(numbers + k, start);
    }
    inline Triple<Numbers> triple(int k) const { return Triple<Numbers>{(*this)[k], (*this)[k + 1], (*this)[k + 2]}; }
};

// Pixels that show one material of one object.
template <class Numbers, class Materials>
struct Surface {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Triple<Numbers> Vector;
    enum { PROJECTION_UV, PROJECTION_PLANE, PROJECTION_CUBE };
    // Numbers of a row of `DeviceMaterials`.
    enum { CORNERS, UV, COLORS, FACE_MATERIAL, NORMALS, MAPS_UV, OBJECT_ROWS = MAPS_UV + 4 };
    enum { PLANE_NUMBERS = 9, UV_NUMBERS = 6, COLOR_NUMBERS = 12, NORMAL_NUMBERS = 9 };

    const Materials& materials;
    const Eye& camera;
    const ObjectFrame& frame;
    const int* rows;  // OBJECT_ROWS first rows of the object
    int object;
    int material;
    float base[3], emission[3];  // of the material, or of the object in its world
    Whole face;
    int shown_face;  // of one of the pixels
    bool is_same_face;
    Vector point;  // in the object's frame
    Vector gradient_b, gradient_c;  // of the weights of corners b and c, in the frame divided by scale factors
    Real weight_b, weight_c;

    inline Rows<Numbers> rows_of(const void* numbers, int width, int kind) const {
        return Rows<Numbers>::of((const float*)numbers, width, rows[kind], face, shown_face, is_same_face);
    }
    // Locate points of the world in triangles: the weights of a triangle's corners are linear in its plane.
    inline void locate(const Vector& world_point) {
        point = frame.into(world_point);
        if (rows[CORNERS] < 0 || shown_face < 0) return;
        const Rows<Numbers> plane = rows_of(materials.planes.data, PLANE_NUMBERS, CORNERS);
        const Vector offset = point.times(frame.inverse_factors) - plane.triple(0);
        gradient_b = plane.triple(3), gradient_c = plane.triple(6);
        weight_b = gradient_b.dot(offset), weight_c = gradient_c.dot(offset);
    }
    inline bool has_plane() const { return rows[CORNERS] >= 0 && shown_face >= 0; }
    // Numbers at corners a, b and c, `count` each, at the pixel.
    inline Real mixed(const Rows<Numbers>& row, int count, int k) const {
        const Real a = row[k];
        return a + weight_b * (row[count + k] - a) + weight_c * (row[2 * count + k] - a);
    }

    // The color of the material, times that of vertices or faces.
    inline Vector color() const {
        if (!has_plane() || rows[COLORS] < 0) return Vector::of(base);
        const Rows<Numbers> row = rows_of(materials.colors.data, COLOR_NUMBERS, COLORS);
        return Vector{mixed(row, 4, 0), mixed(row, 4, 1), mixed(row, 4, 2)}.times(base);
    }
    inline bool is_textured() const {
        const auto& of = materials.materials.data[material];
        return of.texture >= 0 && (of.projection != PROJECTION_UV || (has_plane() && rows[UV] >= 0));
    }
    // The opacity of vertices or faces, times that of the texture.
    inline Real opacity() const {
        Real opacity = Numbers::real(1.0f);
        if (has_plane() && rows[COLORS] >= 0)
            opacity = mixed(rows_of(materials.colors.data, COLOR_NUMBERS, COLORS), 4, 3);
        return is_textured() ? opacity * texel(true).x : opacity;
    }
    // The color of its texture, in the color space of the material; or its opacity, three times.
    inline Vector texel(bool takes_opacity = false) const {
        const auto& of = materials.materials.data[material];
        const TextureLayout texture = TextureLayout::of(materials.textures.data[of.texture]);
        typedef Sampler<Numbers> Texels;
        const Texels sampler = {
            texture,
            (const int*)materials.texels.data,
            materials.level_first.data,
            materials.linear_of.data,
            of.is_linear && !texture.is_linear,
            texture.is_linear && !of.is_linear,
            of.projection == PROJECTION_CUBE ? Texels::CUBE_SIDES : 1,
            takes_opacity,
        };
        return sampler.sample(texture_position(of, texture.width, texture.height / sampler.sides));
    }

    // The normal for shading, on the side of the flat normal; the flat normal without normals of vertices.
    inline Vector normal(const Vector& flat) const {
        if (rows[NORMALS] < 0 || shown_face < 0) return flat;
        const Rows<Numbers> row = rows_of(materials.normals.data, NORMAL_NUMBERS, NORMALS);
        const Vector bent = Vector{mixed(row, 3, 0), mixed(row, 3, 1), mixed(row, 3, 2)};
        const Vector turned = frame.out(bent.times(frame.inverse_factors));
        const Real length = turned.length();
        const Real side = frame.out(plane_normal()).dot(flat) < 0.0f ? Numbers::real(-1.0f) : Numbers::real(1.0f);
        return Vector::select(length > 1e-6f, turned * (side / length), flat);
    }

    // The normal of the triangle by the order of its corners, of any length, in the frame divided by scale factors.
    inline Vector plane_normal() const { return gradient_b.cross(gradient_c).times(frame.inverse_factors); }

    // Offsets to where the rays of the next pixels across and below meet the surface's plane.
    inline void offsets(Vector& across, Vector& below) const {
        float axis[3][3], eye[3], eye_in_frame[3];
        for (int i = 0; i < 3; ++i) frame.rotate_into(camera.axis[i], axis[i]);
        for (int k = 0; k < 3; ++k) eye[k] = camera.position[k] - frame.position[k];
        frame.rotate_into(eye, eye_in_frame);
        Vector ray = point.minus(eye_in_frame), right = Vector::of(axis[0]), down = Vector::of(axis[1]);
        Real depth = Numbers::real(1.0f);
        if (camera.kind == Eye::PARALLEL) {
            ray = Vector::of(axis[2]);
        } else {
            depth = camera.kind == Eye::PINHOLE ? ray.dot(axis[2]) : ray.length();
            depth = Numbers::max(depth, Numbers::real(1e-12f));
            ray = ray * (1.0f / depth);
        }
        if (camera.kind == Eye::CONE) {  // any two axes perpendicular to the ray
            right = ray.cross(Vector::select(Numbers::abs(ray.dot(down)) < 0.9f, down, right)).direction();
            down = ray.cross(right);
        }
        const Vector plane = has_plane() ? plane_normal() : ray;
        across = offset_to(ray, right * Numbers::real(camera.size[0]), depth, plane);
        below = offset_to(ray, down * Numbers::real(camera.size[1]), depth, plane);
    }

  private:
    // The offset from the point to the intersection of the ray of the next pixel with the plane of the surface.
    static inline Vector offset_to(const Vector& ray, const Vector& step, Real depth, const Vector& plane) {
        Real steepness = plane.dot(ray);
        const Real least = 1e-8f * plane.dot(plane) * ray.dot(ray);
        const Whole is_edge_on = steepness * steepness <= least;
        if (Numbers::any(is_edge_on)) {
            const Real limit = Numbers::root(least);
            steepness = is_edge_on ? (steepness < 0.0f ? -limit : limit) : steepness;
        }
        return (step - ray * (plane.dot(step) / steepness)) * depth;
    }
    // Change of texture coordinates along an offset; of a cube, from a position on a side.
    template <class Material>
    inline void uv_along(const Material& of, const Vector& offset, Real& u, Real& v) const {
        if (of.projection == PROJECTION_PLANE) {
            u = offset.x, v = offset.y;
        } else {
            const Rows<Numbers> row = rows_of(materials.uv.data, UV_NUMBERS, UV);
            const Vector unscaled = offset.times(frame.inverse_factors);
            const Real b = gradient_b.dot(unscaled), c = gradient_c.dot(unscaled);
            u = b * (row[2] - row[0]) + c * (row[4] - row[0]);
            v = b * (row[3] - row[1]) + c * (row[5] - row[1]);
        }
        u = u * of.repeat[0], v = v * of.repeat[1];
    }
    template <class Material>
    inline TexturePosition<Numbers> texture_position(const Material& of, int width, int height) const {
        TexturePosition<Numbers> at;
        Vector across, below;
        offsets(across, below);
        Real across_u, across_v, below_u, below_v;
        at.side = Numbers::whole(0);
        if (of.projection == PROJECTION_CUBE) {
            typedef CubeSide<Numbers> Side;
            const float scale[3] = {of.scale[0], of.scale[1], of.scale[2]};
            const Vector center = point.times(scale);
            at.side = Side::of(center);
            Side::project(center, at.side, at.u, at.v);
            Side::project(center + across.times(scale), at.side, across_u, across_v);
            Side::project(center + below.times(scale), at.side, below_u, below_v);
            across_u -= at.u, across_v -= at.v, below_u -= at.u, below_v -= at.v;
        } else {
            uv_along(of, across, across_u, across_v);
            uv_along(of, below, below_u, below_v);
            if (of.projection == PROJECTION_PLANE) {
                at.u = point.x * of.repeat[0], at.v = point.y * of.repeat[1];
            } else {
                const Rows<Numbers> row = rows_of(materials.uv.data, UV_NUMBERS, UV);
                at.u = mixed(row, 2, 0) * of.repeat[0], at.v = mixed(row, 2, 1) * of.repeat[1];
            }
        }
        const float wide = (float)width, high = (float)height;
        const Real square_across = across_u * across_u * (wide * wide) + across_v * across_v * (high * high);
        const Real square_below = below_u * below_u * (wide * wide) + below_v * below_v * (high * high);
        at.square_footprint = Numbers::max(square_across, square_below);
        return at;
    }
};
