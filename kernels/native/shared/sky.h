// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Skies behind surfaces, and haze in front of distant ground, for rows of pixels.

#pragma once

#include "shared/surfaces.h"

// A sky and its haze, seen by a camera. `Sky` is a struct of kernels/shading/sky.py.
template <class Numbers, class Sky>
struct SkyView {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Triple<Numbers> Vector;
    static constexpr float FARTHEST = 3.0e38f, PI = 3.14159265358979f;

    const Sky& sky;
    Eye camera;
    float axis[3][3];  // of the camera, in the frame of the sky: right, down, forward

    static inline SkyView of(const Sky& sky, const Eye& camera) {
        SkyView view = {sky, camera, {}};
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j) view.axis[k][i] += sky.rotation.data[i][j] * camera.axis[k][j];
        return view;
    }

    inline bool is_hazy() const { return sky.haze.radius > 0.0f; }

    // Horizontal distance of surface points; infinite where the sky hides them.
    inline Real distance_of(const Vector& point) const {
        const float normal[3] = {sky.haze.normal[0], sky.haze.normal[1], sky.haze.normal[2]};
        const Vector offset = point.minus(camera.position);
        const Real up = offset.dot(normal), distance = (offset - Vector::of(normal) * up).length();
        const Whole is_hidden = (distance > sky.haze.radius) | (Numbers::abs(up) >= sky.haze.radius);
        return is_hidden ? Numbers::real(FARTHEST) : distance;
    }

    // Opacity of the haze in directions of the sky's frame, and its horizontal distance.
    inline Real haze_at(const Vector& ray, Real& distance) const {
        const auto& haze = sky.haze;
        const float normal[3] = {haze.sky_normal[0], haze.sky_normal[1], haze.sky_normal[2]};
        float above = 0.0f;
        for (int k = 0; k < 3; ++k) above += haze.normal[k] * (camera.position[k] - haze.position[k]);
        const Real none = Numbers::real(0.0f), up = ray.dot(normal);
        distance = none;
        if (!(above > 0.0f)) return none;
        const Real length = (ray - Vector::of(normal) * up).length();
        const Real slope = -up / length;
        // Depth below the horizon: 1 at the ground.
        const Real below = slope / (slope * haze.width + above / haze.radius), height = 1.0f - below;
        const Whole is_seen = (up < 0.0f) & (length > 0.0f) & (below < 1.0f);
        distance = is_seen ? haze.radius * (1.0f - haze.width * below) : none;
        const Real opacity = height < haze.peak ? height / haze.peak : below / (1.0f - haze.peak);
        return is_seen ? opacity : none;
    }

    // The angle from straight up, as a fraction of the angle to straight down.
    static inline Real angle_from_up(const Vector& ray) {
        return Powers<Numbers>::arc_tangent(Numbers::root(ray.x * ray.x + ray.y * ray.y), ray.z) * (1.0f / PI);
    }

    inline Vector gradient(const Vector& ray) const {
        const int last = sky.colors.shape[0] - 2;
        const Real position = angle_from_up(ray) * (float)(last + 1);
        const Whole step = Numbers::truncate(Numbers::min(position, Numbers::real((float)last)));
        const Real share = position - Numbers::to_real(step);
        const Rows<Numbers> row = Rows<Numbers>::of((const float*)sky.colors.data, 3, 0, step, 0, false);
        return row.triple(0) + (row.triple(3) - row.triple(0)) * share;
    }

    // The position of directions in the images of the sky. In the frame of the sky, the rays of the adjacent pixels
    // differ from a ray along the axes of the camera; around a cone, along two axes perpendicular to it.
    inline TexturePosition<Numbers> position(const Vector& ray) const {
        const bool is_parallel = camera.kind == Eye::PARALLEL;
        const float size[2] = {is_parallel ? 0.0f : camera.size[0], is_parallel ? 0.0f : camera.size[1]};
        const float width = (float)sky.texture.width, height = (float)sky.texture.height;
        TexturePosition<Numbers> at;
        at.side = Numbers::whole(0);
        if (!sky.is_cube) {
            at.u = 0.5f - Powers<Numbers>::arc_tangent(ray.y, ray.x) * (0.5f / PI);
            at.v = 1.0f - angle_from_up(ray);
            const float texels = (size[0] > size[1] ? size[0] : size[1]) * height * (1.0f / PI);
            at.square_footprint = texels * texels / ray.dot(ray);
            return at;
        }
        typedef CubeSide<Numbers> Side;
        at.side = Side::of(ray);
        Side::project(ray, at.side, at.u, at.v);
        Vector right = Vector::of(axis[0]), down = Vector::of(axis[1]);
        if (camera.kind == Eye::CONE) {
            right = ray.cross(Vector::select(Numbers::abs(ray.dot(down)) < 0.9f, down, right)).direction();
            down = ray.cross(right);
        }
        Real squares[2], u, v;
        for (int k = 0; k < 2; ++k) {
            Side::project(ray + (k ? down : right) * Numbers::real(size[k]), at.side, u, v);
            squares[k] = (u - at.u) * (u - at.u) + (v - at.v) * (v - at.v);
        }
        at.square_footprint = width * width * Numbers::max(squares[0], squares[1]);
        return at;
    }

    // The color in directions of the sky's frame, in display color space, from 0 to 1.
    inline Vector color(const Vector& ray) const {
        typedef Sampler<Numbers> Texels;
        Vector found;
        if (sky.is_gradient) {
            found = gradient(ray);
        } else {
            const int sides = sky.is_cube ? Texels::CUBE_SIDES : 1;
            const Texels sampler = {TextureLayout::of(sky.texture),
                                    (const int*)sky.texels.data,
                                    sky.level_first.data,
                                    nullptr,
                                    false,
                                    false,
                                    sides,
                                    false,
                                    sky.is_light};
            found = sampler.sample(position(ray));
        }
        const auto limited = [](Real a) {
            return Numbers::max(Numbers::min(a, Numbers::real(1.0f)), Numbers::real(0.0f));
        };
        found = Vector::map(found, limited);
        return sky.is_linear ? Vector::map(found, Powers<Numbers>::to_screen) : found;
    }

    // Paint those of `count` pixels that see no surface, and those that see one at a point through haze, along rays of
    // the camera's frame.
    inline void paint(const Vector& local, Whole is_sky, Whole is_surface, const Vector& point, int count,
                      unsigned char* pixels) const {
        const Vector ray = {local.x * axis[0][0] + local.y * axis[1][0] + local.z * axis[2][0],
                            local.x * axis[0][1] + local.y * axis[1][1] + local.z * axis[2][1],
                            local.x * axis[0][2] + local.y * axis[1][2] + local.z * axis[2][2]};
        Whole is_painted = is_sky;
        Real opacity = Numbers::real(0.0f);
        if (is_hazy()) {
            Real reach;
            const Real distance = distance_of(point);
            opacity = haze_at(ray, reach);
            is_sky = is_sky | (is_surface & (distance >= FARTHEST));
            is_painted = is_sky | (is_surface & (distance >= reach) & (opacity > 0.0f));
        }
        if (!Numbers::any(is_painted)) return;
        Vector shown = Numbers::any(is_sky) ? color(ray) : Vector::all(0.0f);
        if (is_hazy()) {
            for (int k = 0; k < Numbers::PIXELS && k < count; ++k) {
                if (Numbers::get(is_sky, k)) continue;
                Numbers::set(shown.x, k, (float)pixels[3 * k] * (1.0f / 255.0f));
                Numbers::set(shown.y, k, (float)pixels[3 * k + 1] * (1.0f / 255.0f));
                Numbers::set(shown.z, k, (float)pixels[3 * k + 2] * (1.0f / 255.0f));
            }
            const float haze[3] = {sky.haze.color[0], sky.haze.color[1], sky.haze.color[2]};
            shown = shown + (Vector::of(haze) - shown) * opacity;
        }
        const auto to_byte = [](Real a) { return Numbers::truncate(a * 255.0f + 0.5f); };
        const Whole red = to_byte(shown.x), green = to_byte(shown.y), blue = to_byte(shown.z);
        if (Numbers::all(is_painted)) return Numbers::store_triples(pixels, red, green, blue, count);
        for (int k = 0; k < Numbers::PIXELS && k < count; ++k) {
            if (!Numbers::get(is_painted, k)) continue;
            pixels[3 * k] = (unsigned char)Numbers::get(red, k);
            pixels[3 * k + 1] = (unsigned char)Numbers::get(green, k);
            pixels[3 * k + 2] = (unsigned char)Numbers::get(blue, k);
        }
    }
};

// A row of a view whose sky is painted.
template <class Numbers, class Sky>
struct SkyRow {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Triple<Numbers> Vector;

    SkyView<Numbers, Sky> view;
    SurfaceImages images;
    const double* rays;  // xyz of each pixel; null for a pinhole or parallel rays
    const float* pixels;  // image points xy of each pixel of a pinhole; null for pixel centers
    float y, width, height, center[2], inverse[2];  // of a pinhole

    // Paint the pixels from x on, in an image of colors.
    inline void paint(int x, unsigned char* out) const {
        const long long place = images.first + x;
        const int count = images.width - x;
        const Whole object = Numbers::load(images.segmentation + place, count);
        const Whole is_inside = Numbers::indices(0) < count;
        Whole is_sky = is_inside & (object == -1), is_surface = is_inside & (object >= 0);
        if (!Numbers::any(view.is_hazy() ? is_sky | is_surface : is_sky)) return;
        Whole has_ray;
        const Vector local = ray(x, count, has_ray);
        is_sky = is_sky & has_ray, is_surface = is_surface & has_ray;
        Vector point = Vector::all(0.0f);
        if (view.is_hazy()) point = SurfaceImages::triple<Numbers>(images.points, place, count);
        view.paint(local, is_sky, is_surface, point, count, out + 3 * place);
    }

    // Rays of pixels in the camera's frame: of depth 1 for a pinhole and parallel rays, else of length 1.
    inline Vector ray(int x, int count, Whole& has_ray) const {
        Vector found = Vector::all(1.0f);
        has_ray = Numbers::whole(-1);
        if (rays) {
            for (int k = 0; k < Numbers::PIXELS && k < count; ++k) {
                const double* of = rays + 3LL * (x + k);
                Numbers::set(found.x, k, (float)of[0]);
                Numbers::set(found.y, k, (float)of[1]);
                Numbers::set(found.z, k, (float)of[2]);
            }
            has_ray = found.x == found.x;
            return found * (1.0f / found.length());
        }
        if (view.camera.kind == Eye::PARALLEL) return Vector{Numbers::real(0.0f), Numbers::real(0.0f), found.z};
        Real across = Numbers::columns(x) + 0.5f, below = Numbers::real(y);
        if (pixels) {
            for (int k = 0; k < Numbers::PIXELS && k < count; ++k) {
                Numbers::set(across, k, pixels[2 * (x + k)]);
                Numbers::set(below, k, pixels[2 * (x + k) + 1]);
            }
            has_ray = (across >= 0.0f) & (across < width) & (below >= 0.0f) & (below < height);
        }
        found.x = (across - center[0]) * inverse[0], found.y = (below - center[1]) * inverse[1];
        return found;
    }
};

// The sky of the world of a view: the first one is that of the scene.
template <class Skies, class Numbers, class Worlds>
inline const auto& sky_of(const Skies& skies, const Numbers& world_sky, const Worlds& worlds, int view) {
    const int number = world_sky.data ? world_sky.data[world_row(worlds, view, world_sky.shape[0])] : -1;
    return skies.data[number >= 0 && number < skies.shape[0] - 1 ? number + 1 : 0];
}

// Start row y of the sky of a view. `Camera` is a `PinholeCamera` of kernels/pinhole.py; rays and pixels are arrays of
// kernels.
template <class Sky, class Camera, class Footprint, class Poses, class Rays, class Pixels>
inline SkyRow<PixelNumbers, Sky> sky_row(const Sky& sky, const Camera& camera, const Footprint& footprint,
                                         const Poses& poses, const Rays& rays, const Pixels& pixels,
                                         const SurfaceImages& images, int y) {
    const int view_of_rays = images.view < rays.shape[0] ? images.view : 0;
    const long long first_ray = ((long long)view_of_rays * rays.shape[1] + y) * images.width;
    const Eye eye = Eye::of(footprint, (const float*)(poses.data + images.view));
    return {
        SkyView<PixelNumbers, Sky>::of(sky, eye),
        images,
        rays.data ? (const double*)rays.data + 3 * first_ray : nullptr,
        pixels.data ? (const float*)pixels.data + 2 * images.first : nullptr,
        (float)y + 0.5f,
        camera.width,
        camera.height,
        {(float)camera.cx, (float)camera.cy},
        {(float)(1.0 / camera.fx), (float)(1.0 / camera.fy)},
    };
}
