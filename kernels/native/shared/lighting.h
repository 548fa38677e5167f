// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Colors of rows of pixels: base colors, and colors under lights, with the formulas of `warpvis.scene.lights.Light`.

#pragma once

#include "shared/surfaces.h"

// A light that reaches surface points, and the light of a surface that it adds. `Light` is a `DeviceLight` of
// kernels/shading/lighting.py.
template <class Numbers, class Light>
struct Illumination {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Triple<Numbers> Vector;
    enum { AMBIENT, DIRECTIONAL, POINT, SPOT, HEADLIGHT };
    enum { OPENGL, WEBOTS, GLTF };

    const Light& light;
    const Eye& camera;

    // The fraction of a spot's light in a direction, given the cosine of its angle to the axis.
    inline Real cone_share(Real cosine) const {
        const Real none = Numbers::real(0.0f), all = Numbers::real(1.0f);
        if (light.falloff == GLTF) {
            const float range = light.cos_inner - light.cos_outer;
            const Real share = (cosine - light.cos_outer) * (1.0f / (range > 1e-3f ? range : 1e-3f));
            const Real limited = Numbers::min(Numbers::max(share, none), all);
            return limited * limited;
        }
        if (light.falloff == WEBOTS) {
            const Real angle = Powers<Numbers>::arc_cosine(cosine);
            const float range = light.outer_angle - light.inner_angle;
            const Real share = (light.outer_angle - angle) * (1.0f / (range > 1e-30f ? range : 1e-30f));
            return angle <= light.inner_angle ? all : Numbers::min(Numbers::max(share, none), all);
        }
        if (light.outer_angle >= 3.14159265f) return all;
        if (light.exponent == 0.0f) return cosine >= light.cos_outer ? all : none;
        return cosine >= light.cos_outer ? Powers<Numbers>::power(cosine, light.exponent) : none;
    }
    // The fraction of the light of a point or spot that reaches a distance, as in `Light.strength`.
    inline Real strength(Real distance, Real cosine) const {
        const Real divisor = (light.attenuation[2] * distance + light.attenuation[1]) * distance + light.attenuation[0];
        Real share = distance > light.reach ? Numbers::real(0.0f) : 1.0f / divisor;
        if (light.falloff == GLTF && light.reach < 1e30f) {
            const Real part = distance * (1.0f / light.reach), square = part * part;
            share = share * Numbers::max(1.0f - square * square, Numbers::real(0.0f));
        }
        return light.kind == SPOT ? share * cone_share(cosine) : share;
    }
    // The direction to a light that is not only ambient, and the fraction of it that reaches the points.
    inline Vector direction(const Vector& point, Real& share) const {
        Vector to_light = Vector::all(0.0f);
        share = Numbers::real(1.0f);
        if (light.kind == HEADLIGHT) {
            to_light = to_light.minus(camera.axis[2]);
        } else {
            const float position[3] = {light.position[0], light.position[1], light.position[2]};
            const float direction[3] = {light.direction[0], light.direction[1], light.direction[2]};
            to_light = to_light.minus(direction);
            if (light.kind != DIRECTIONAL) {
                const Vector offset = Vector::of(position) - point;
                const Real distance = offset.length();
                to_light = offset * (1.0f / Numbers::max(distance, Numbers::real(1e-12f)));
                share = strength(distance, -to_light.dot(direction));
            }
        }
        return to_light;
    }
    // A square of a cosine below which the power `shininess` is below 2^-14. With n for shininess, that holds below
    // exp(-28 ln 2 / n), which is at least 1 - 28 ln 2 / n.
    static inline float least_square(float shininess) {
        const float least = 1.0f - 19.40812f / (shininess > 1e-3f ? shininess : 1e-3f);
        return least > 0.0f ? least : 0.0f;
    }
    // The reflection of the light: `base` is the surface's color, `gloss` its specular color, and `unblocked` and
    // `open` the fractions of the light and of ambient light that no other surface blocks.
    inline Vector reflected(const Vector& point, const Vector& normal, const Vector& to_eye, const Vector& base,
                            const float* gloss, float shininess, Real unblocked, Real open) const {
        const float ambient[3] = {light.ambient[0], light.ambient[1], light.ambient[2]};
        if (light.kind == AMBIENT) return base.times(ambient) * open;
        Real share;
        const Vector to_light = direction(point, share);
        const Real none = Numbers::real(0.0f), facing = normal.dot(to_light);
        const float color[3] = {light.color[0], light.color[1], light.color[2]};
        // With glTF, Lambertian reflection of an illuminance [lx].
        const Real scattered = unblocked * Numbers::max(facing, none) * (light.falloff == GLTF ? 0.318309886f : 1.0f);
        Vector shown = base.times(ambient) * open + base.times(color) * scattered;
        const float shine[3] = {gloss[0] * light.specular[0], gloss[1] * light.specular[1],
                                gloss[2] * light.specular[2]};
        if (shine[0] > 0.0f || shine[1] > 0.0f || shine[2] > 0.0f) {
            // Of most pixels, the reflection is below what a color of 8 bits shows.
            const Vector half = to_light + to_eye;
            const Real along = half.dot(normal), product = along * along, square = half.dot(half);
            const Whole is_glossy = (facing > 0.0f) & (along > 0.0f) & (product > least_square(shininess) * square);
            if (Numbers::any(is_glossy)) {
                const Real cosine_square = product * (1.0f / Numbers::max(square, Numbers::real(1e-30f)));
                const Real glossy = Powers<Numbers>::power(cosine_square, 0.5f * shininess);
                shown = shown + Vector::of(shine) * (is_glossy ? unblocked * glossy : none);
            }
        }
        return shown * share;
    }
};

// The place on a surface where a pixel's light is computed.
template <class Numbers>
struct PixelPlace {
    typedef Triple<Numbers> Vector;
    enum { COUNT = 1 };
    Vector point[COUNT], normal[COUNT];

    // The share of a place in the pixel.
    inline const Vector& share(int, const Vector& color) const { return color; }
};

// Shades the pixels of a row. `Materials`, `Worlds` and `Lights` are structs of kernels/shading and kernels/casting.
template <class Numbers, class Materials, class Worlds>
struct ColorRow {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Triple<Numbers> Vector;
    typedef Surface<Numbers, Materials> Shown;

    const Materials& materials;
    const Worlds& worlds;
    const SurfaceImages& images;
    Eye camera;
    unsigned char* out;
    ObjectFrame frame;

    // Write the colors of the pixels from x on: those of each visible surface by a function of pixels that show one
    // material of one object, and the background elsewhere. If `is_placed` is false, surfaces of one color are not
    // located.
    template <class Function>
    inline void write(int x, const Function& color_of, bool is_placed = true) {
        const long long place = images.first + x;
        const int count = images.width - x;
        const Whole object = Numbers::load(images.segmentation + place, count);
        const bool has_places = is_placed || materials.textures.shape[0] > 0 || materials.colors.shape[0] > 0;
        const bool has_faces = has_places || materials.face_material.shape[0] > 0;
        const Whole faces = has_faces ? Numbers::load(images.faces + place, count) : Numbers::whole(-1);
        const Vector points =
            has_places ? SurfaceImages::triple<Numbers>(images.points, place, count) : Vector::all(0.0f);
        Vector color = background();
        Whole remaining = (object >= 0) & (Numbers::indices(0) < count);
        while (Numbers::any(remaining)) {
            const int pixel = Numbers::first(remaining);
            Whole which = remaining & (object == Numbers::whole(Numbers::get(object, pixel)));
            const Shown shown = surface(which, faces, points, Numbers::get(object, pixel), pixel, is_placed);
            color = Vector::select(which, color_of(shown, which, points, place, count), color);
            remaining = remaining & (which == 0);
        }
        const auto to_byte = [](Real a) {
            const Real limited = Numbers::min(Numbers::max(a, Numbers::real(0.0f)), Numbers::real(1.0f));
            return Numbers::truncate(limited * 255.0f + 0.5f);
        };
        Numbers::store_triples(out + 3 * place, to_byte(color.x), to_byte(color.y), to_byte(color.z), count);
    }

    // The entry in `materials` of an object in the world of the view.
    inline int entry_of(int object) const {
        const auto& entries = materials.world_entry;
        if (!entries.data) return object;
        return entries.data[(long long)world_row(worlds, images.view, entries.shape[0]) * entries.shape[1] + object];
    }

    // The surface that a pixel shows, and those of `which` that show the same material of the same object, which become
    // `which`.
    inline Shown surface(Whole& which, Whole faces, const Vector& points, int object, int pixel,
                         bool is_placed = true) {
        const int entry = entry_of(object);
        const int* rows = materials.object_rows.data + (long long)Shown::OBJECT_ROWS * entry;
        const int face = Numbers::get(faces, pixel);
        int material = materials.object_material.data[entry];
        Whole shown_faces = which ? faces : Numbers::whole(face);
        if (face >= 0 && rows[Shown::FACE_MATERIAL] >= 0) {
            const int* of_faces = materials.face_material.data + rows[Shown::FACE_MATERIAL];
            material = of_faces[face];
            which = which & (Numbers::gather(of_faces, shown_faces) == Numbers::whole(material));
            shown_faces = which ? shown_faces : Numbers::whole(face);
        }
        const bool is_same = Numbers::PIXELS > 1 && Numbers::all(shown_faces == Numbers::whole(face));
        Shown shown = {materials, camera, frame, rows, object, material, {}, {}, shown_faces, face, is_same};
        const auto& own = materials.materials.data[material];
        const float* color = world_numbers(materials.world_color, worlds, images.view, object);
        for (int k = 0; k < 3; ++k) shown.base[k] = color ? converted(color[k], false, own.is_linear) : own.color[k];
        const float* emission = world_numbers(materials.world_emission, worlds, images.view, object);
        for (int k = 0; k < 3; ++k) shown.emission[k] = emission ? emission[k] : own.emission[k];
        if (is_placed || own.texture >= 0 || rows[Shown::COLORS] >= 0) {
            if (frame.entry != entry) frame = ObjectFrame::of(materials, worlds, images.view, entry);
            shown.locate(points);
        }
        return shown;
    }
    // The color where no surface is visible, in the world of the view.
    inline Vector background() const {
        const auto& rows = materials.world_background;
        // Without a pointer into `materials`: with one, CUDA copies it to local memory for every pixel.
        auto color = materials.background;
        if (rows.data) color = rows.data[world_row(worlds, images.view, rows.shape[0])];
        return Vector{Numbers::real(color[0]), Numbers::real(color[1]), Numbers::real(color[2])};
    }

    static inline Vector to_linear(const Vector& a) { return Vector::map(a, Powers<Numbers>::to_linear); }
    static inline Vector to_screen(const Vector& a) { return Vector::map(a, Powers<Numbers>::to_screen); }
    // Convert a color between display color space and linear space.
    static inline Vector in_space(const Vector& color, bool is_linear, bool target_linear) {
        if (is_linear == target_linear) return color;
        return target_linear ? to_linear(color) : to_screen(color);
    }

    inline void base_colors(int x) {
        const auto base_color = [&](const Shown& shown, Whole, const Vector&, long long, int) {
            Vector color = shown.color();
            if (shown.is_textured()) color = color.times(shown.texel());
            return in_space(color, materials.materials.data[shown.material].is_linear, false);
        };
        write(x, base_color, false);
    }

    // `shadows` are images of the lights that may be blocked, 255 where nothing blocks them; or an array without data.
    template <class Lights, class Shadows>
    inline void lit_colors(int x, const Lights& lights, const Shadows& shadows) {
        write(x, [&](const Shown& shown, Whole, const Vector& points, long long place, int count) {
            const Vector normal = shown.normal(SurfaceImages::triple<Numbers>(images.normals, place, count));
            return lit_by_images(shown, PixelPlace<Numbers>{{points}, {normal}}, lights, shadows, place, count);
        });
    }
    template <class Places, class Lights, class Shadows>
    inline Vector lit_by_images(const Shown& shown, const Places& places, const Lights& lights, const Shadows& shadows,
                                long long place, int count) const {
        return lit(shown, places, lights, shadows.data != nullptr, open(lights, place, count), [&](int shadow) {
            const unsigned char* image = shadows.data + (long long)shadow * shadows.strides[0];
            return Numbers::to_real(Numbers::load(image + place, count)) * (1.0f / 255.0f);
        });
    }

    // The fraction of ambient light that other surfaces do not block.
    template <class Lights>
    static inline Real open(const Lights& lights, long long place, int count) {
        if (!lights.occlusion.data) return Numbers::real(1.0f);
        return Numbers::to_real(Numbers::load(lights.occlusion.data + place, count)) * (1.0f / 255.0f);
    }

    // The color of surfaces under all lights. The fixed-function pipeline lights the untextured surface, clamps the
    // result and multiplies it by the texture; each light with shadows is a separate pass, which is added and whose
    // ambient part is blocked, too (`mjr_render` in MuJoCo's render_gl3.c). In linear space, light is reflected by the
    // textured surface. Unlit surfaces show their base color. `places` are where light is computed, `unblocked` returns
    // the fraction of a light that reaches the pixels, by the light's index of shadows, and `open` is that of ambient
    // light.
    template <class Places, class Lights, class Unblocked>
    inline Vector lit(const Shown& shown, const Places& places, const Lights& lights, bool has_shadows, Real open,
                      const Unblocked& unblocked) const {
        typedef Illumination<Numbers, typename Value<decltype(lights.all.data)>::Type> Lit;
        const auto& material = materials.materials.data[shown.material];
        const bool is_textured = shown.is_textured(), to_linear = lights.is_linear;
        const bool multiplies_first = to_linear || material.is_linear;
        Vector base = shown.color(), texel = is_textured ? shown.texel() : Vector::all(1.0f);
        if (multiplies_first) base = in_space(is_textured ? base.times(texel) : base, material.is_linear, to_linear);
        const float dimming = lights.is_of_views ? lights.dimming : 1.0f;
        base = base * Numbers::real(dimming);
        if (material.is_unlit) {
            if (to_linear) return to_screen(base);
            return is_textured && !multiplies_first ? base.times(texel) : base;
        }
        float gloss[3], emission[3];
        for (int k = 0; k < 3; ++k) {
            gloss[k] = converted(material.specular[k], material.is_linear, to_linear);
            emission[k] = dimming * converted(shown.emission[k], material.is_linear, to_linear);
        }
        Vector to_eye[Places::COUNT], totals[Places::COUNT], passes = Vector::all(0.0f);
        for (int k = 0; k < Places::COUNT; ++k) {
            to_eye[k] = (Vector::of(camera.position) - places.point[k]).direction();
            totals[k] = Vector::of(emission);
        }
        const auto limited = [](Real a) { return Numbers::min(a, Numbers::real(1.0f)); };
        const Real all_light = Numbers::real(1.0f);
        const int count = lights.all.shape[1];
        const int row = lights.is_of_views ? images.view : world_row(worlds, images.view, lights.all.shape[0]);
        const auto* all = lights.all.data + (long long)row * count;
        for (int i = 0; i < count; ++i) {
            const Lit lit = {all[i], camera};
            const Real fraction = has_shadows && all[i].shadow >= 0 ? unblocked(all[i].shadow) : all_light;
            const bool is_pass = has_shadows && all[i].shadow >= 0 && !to_linear;
            for (int k = 0; k < Places::COUNT; ++k) {
                const Vector part = lit.reflected(places.point[k], places.normal[k], to_eye[k], base, gloss,
                                                  material.shininess, is_pass ? all_light : fraction, open);
                if (is_pass)
                    passes = passes + places.share(k, Vector::map(part, limited)) * fraction;
                else
                    totals[k] = totals[k] + part;
            }
        }
        const auto shared = [&](int k) {
            return places.share(k, to_linear ? totals[k] : Vector::map(totals[k], limited));
        };
        Vector total = shared(0);
        for (int k = 1; k < Places::COUNT; ++k) total = total + shared(k);
        if (to_linear) return to_screen(total);
        total = total + passes;
        return is_textured && !multiplies_first ? total.times(texel) : total;
    }

    template <class Pointer>
    struct Value;
    template <class Number>
    struct Value<Number*> {
        typedef Number Type;
    };
    static inline float converted(float a, bool is_linear, bool target_linear) {
        if (is_linear == target_linear || a == 0.0f) return a;
        return target_linear ? Powers<OnePixel>::to_linear(a) : Powers<OnePixel>::to_screen(a);
    }
};

// Start a row of colors.
template <class Materials, class Worlds, class Footprint, class Poses, class Colors>
inline ColorRow<PixelNumbers, Materials, Worlds> color_row(const Materials& materials, const Worlds& worlds,
                                                           const SurfaceImages& images, const Footprint& footprint,
                                                           const Poses& poses, Colors& colors) {
    const Eye camera = Eye::of(footprint, (const float*)(poses.data + images.view));
    ObjectFrame none;
    none.entry = -1;
    return {materials, worlds, images, camera, (unsigned char*)colors.data, none};
}
