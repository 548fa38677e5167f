// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Surfaces with metallic and roughness, and maps of their properties: appendix B of the glTF 2.0 specification, with
// the microfacet distribution of Trowbridge and Reitz (GGX), Smith's masking and Schlick's Fresnel term.

#pragma once

#include "shared/lighting.h"

// The reflection of light by a surface, relative to a white one that scatters it diffusely.
template <class Numbers>
struct Reflector {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Triple<Numbers> Vector;
    static constexpr float MIN_ROUGHNESS = 0.045f;  // below it, highlights of points have no size
    static constexpr float DIELECTRIC = 0.04f;  // reflectance at normal incidence of a refractive index of 1.5

    Vector normal, to_eye;
    Vector diffuse, facing_reflectance;  // reflectance: at normal incidence
    Real grazing_reflectance;
    Real roughness, square;  // square: of alpha, the fourth power of the roughness
    Real eye_cosine, eye_masking;
    bool is_webots;

    static inline Reflector of(const Vector& normal, const Vector& to_eye, const Vector& base, Real metallic,
                               Real roughness, bool is_webots) {
        Reflector surface;
        surface.is_webots = is_webots;
        surface.normal = normal, surface.to_eye = to_eye;
        surface.diffuse = base * (1.0f - metallic);
        surface.facing_reflectance = base * metallic + Vector::all(DIELECTRIC) * (1.0f - metallic);
        surface.grazing_reflectance = Numbers::real(1.0f);
        if (is_webots) {
            surface.diffuse = surface.diffuse * Numbers::real(1.0f - DIELECTRIC);
            const Vector& facing = surface.facing_reflectance;
            const Real largest = Numbers::max(Numbers::max(facing.x, facing.y), facing.z);
            surface.grazing_reflectance = Numbers::min(25.0f * largest, Numbers::real(1.0f));
        }
        surface.roughness = Numbers::max(roughness, Numbers::real(MIN_ROUGHNESS));
        const Real alpha = surface.roughness * surface.roughness;
        surface.square = alpha * alpha;
        surface.eye_cosine = Numbers::min(Numbers::abs(normal.dot(to_eye)), Numbers::real(1.0f));
        surface.eye_masking = surface.masking(surface.eye_cosine);
        return surface;
    }
    // The denominator of Smith's masking of a direction, with twice its cosine in the numerator.
    inline Real masking(Real cosine) const {
        return cosine + Numbers::root(square + (1.0f - square) * cosine * cosine);
    }
    // The part of a light that is reflected, times the cosine of its direction, which is positive; diffuse reflection
    // is multiplied by a factor.
    inline Vector direct(const Vector& to_light, Real cosine, float factor) const {
        const Vector half = (to_light + to_eye).direction(), across = half.cross(normal);
        const Real along = half.dot(normal);
        // With the sine of the angle between both, the difference from 1 of a cosine of about 1 is exact.
        const Real denominator = square * along * along + across.dot(across);
        const Real lobe = square / (denominator * denominator * (masking(cosine) * eye_masking));
        const Real shown = along > 0.0f ? lobe : Numbers::real(0.0f);
        const Real grazing = 1.0f - Numbers::min(Numbers::abs(half.dot(to_eye)), Numbers::real(1.0f));
        const Real square_of = grazing * grazing, share = square_of * square_of * grazing;
        const auto part = [&](Real color, Real facing) {
            const Real fresnel = facing + (grazing_reflectance - facing) * share;
            return cosine * (color * (1.0f - fresnel) * factor + fresnel * shown);
        };
        return Vector{part(diffuse.x, facing_reflectance.x), part(diffuse.y, facing_reflectance.y),
                      part(diffuse.z, facing_reflectance.z)};
    }
    // The part of uniform light from all directions that is reflected: the specular part, and diffusely what it leaves.
    // `table` is `DeviceMaterials.reflectances`, of surfaces that reflect all or no light at normal incidence.
    template <class Table>
    inline Vector ambient(const Table& table) const {
        const int rows = table.shape[0], columns = table.shape[1];
        const float* numbers = (const float*)table.data;
        const Real y = Numbers::root(eye_cosine) * (float)(rows - 1), x = roughness * (float)(columns - 1);
        const Real row = Numbers::min(Numbers::floor(y), Numbers::real((float)(rows - 2)));
        const Real column = Numbers::min(Numbers::floor(x), Numbers::real((float)(columns - 2)));
        const Whole first = (Numbers::truncate(row) * columns + Numbers::truncate(column)) * 2;
        const auto value = [&](int k) {
            const float *upper = numbers + k, *lower = upper + 2 * columns;
            const Real a = Numbers::gather(upper, first), b = Numbers::gather(lower, first);
            const Real above = a + (Numbers::gather(upper + 2, first) - a) * (x - column);
            const Real below = b + (Numbers::gather(lower + 2, first) - b) * (x - column);
            return above + (below - above) * (y - row);
        };
        const Real whole = value(0), least = value(1);
        const auto part = [&](Real color, Real facing) {
            const Real specular = facing * (whole - least) + least;
            return (is_webots ? color : color * (1.0f - specular)) + specular;
        };
        return Vector{part(diffuse.x, facing_reflectance.x), part(diffuse.y, facing_reflectance.y),
                      part(diffuse.z, facing_reflectance.z)};
    }
};

// Shades the pixels of a row whose materials may have a `PbrMaterial`; see `ColorRow`.
template <class Numbers, class Materials, class Worlds>
struct PbrRow {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Triple<Numbers> Vector;
    typedef Surface<Numbers, Materials> Shown;
    enum { PHONG, PBR, WEBOTS };
    enum { METALLIC_ROUGHNESS, NORMAL, OCCLUSION, EMISSION };

    typedef ColorRow<Numbers, Materials, Worlds> Base;

    Base row;

    template <class Lights, class Shadows>
    inline void lit_colors(int x, const Lights& lights, const Shadows& shadows) {
        row.write(x, [&](const Shown& shown, Whole, const Vector& points, long long place, int count) {
            const Vector flat = SurfaceImages::triple<Numbers>(row.images.normals, place, count);
            const Vector normal = shown.normal(flat);
            const bool has_shadows = shadows.data != nullptr;
            const auto unblocked = [&](int shadow) {
                const unsigned char* image = shadows.data + (long long)shadow * shadows.strides[0];
                return Numbers::to_real(Numbers::load(image + place, count)) * (1.0f / 255.0f);
            };
            const auto& pbr = row.materials.pbr.data[shown.material];
            const Real open = row.open(lights, place, count);
            if (pbr.shading != PHONG) return lit(shown, points, flat, normal, lights, has_shadows, open, unblocked);
            const PixelPlace<Numbers> place_of = {{points}, {normal}};
            const Vector color = row.lit(shown, place_of, lights, has_shadows, open, unblocked);
            return pbr.tone_mapped && lights.is_linear ? tone_mapped(row.to_linear(color)) : color;
        });
    }

  private:
    // The maps of a surface at its pixels.
    template <class Pbr>
    struct Maps {
        const Materials& materials;
        const Shown& shown;
        const Pbr& pbr;
        bool is_linear;  // the color space of the material
        Vector across, below;

        inline bool has(int map) const { return pbr.maps[map] >= 0 && shown.has_plane() && uv_row(map) >= 0; }
        inline bool has_any() const {
            return has(METALLIC_ROUGHNESS) || has(NORMAL) || has(OCCLUSION) || has(EMISSION);
        }
        inline int uv_row(int map) const { return shown.rows[Shown::MAPS_UV + map]; }
        inline bool are_same(int one, int other) const {
            return pbr.maps[one] == pbr.maps[other] && uv_row(one) == uv_row(other);
        }
        inline Rows<Numbers> corners(int map) const {
            return shown.rows_of(materials.uv.data, Shown::UV_NUMBERS, Shown::MAPS_UV + map);
        }
        inline Vector texel(int map) const {
            const TextureLayout texture = TextureLayout::of(materials.textures.data[pbr.maps[map]]);
            const auto& of = materials.materials.data[shown.material];
            const float repeat[2] = {of.repeat[0], of.repeat[1]};
            const bool is_color = map == EMISSION;
            const Sampler<Numbers> sampler = {
                texture,
                (const int*)materials.texels.data,
                materials.level_first.data,
                materials.linear_of.data,
                is_color && is_linear && !texture.is_linear,
                is_color && !is_linear && texture.is_linear,
                1,
            };
            const Rows<Numbers> uv = corners(map);
            TexturePosition<Numbers> at;
            at.side = Numbers::whole(0);
            at.u = shown.mixed(uv, 2, 0) * repeat[0], at.v = shown.mixed(uv, 2, 1) * repeat[1];
            const Vector of_u = gradient(uv, 0) * Numbers::real(repeat[0] * (float)texture.width);
            const Vector of_v = gradient(uv, 1) * Numbers::real(repeat[1] * (float)texture.height);
            const auto square = [&](const Vector& offset) {
                const Real u = of_u.dot(offset), v = of_v.dot(offset);
                return u * u + v * v;
            };
            at.square_footprint = Numbers::max(square(across), square(below));
            return sampler.sample(at);
        }
        // The gradient of a texture coordinate on the triangle, in the object's frame.
        inline Vector gradient(const Rows<Numbers>& uv, int k) const {
            const Vector b = shown.gradient_b * (uv[2 + k] - uv[k]), c = shown.gradient_c * (uv[4 + k] - uv[k]);
            return (b + c).times(shown.frame.inverse_factors);
        }
        // The normal of the map: z along the normal, x in the plane of the triangle along increasing u, as seen along
        // the normal, and y perpendicular to both, toward increasing v. Seen from behind, all of it is reversed.
        inline Vector normal(const Vector& flat, const Vector& normal) const {
            const Vector tilt = texel(NORMAL) * Numbers::real(2.0f) - Vector::all(1.0f);
            const Rows<Numbers> uv = corners(NORMAL);
            const Vector plane = shown.plane_normal(), of_u = gradient(uv, 0), of_v = gradient(uv, 1);
            const Real one = Numbers::real(1.0f);
            const Real side = shown.frame.out(plane).dot(flat) < 0.0f ? -one : one;
            const Real hand = of_u.cross(of_v).dot(plane) < 0.0f ? -one : one;
            const Vector z = normal * side;
            const Vector along = shown.frame.out(of_v.cross(plane)) * hand;
            const Vector x = (along - z * along.dot(z)).direction(), y = z.cross(x) * hand;
            const Real scale = Numbers::real(pbr.normal_scale);
            const Vector tilted = x * (tilt.x * scale) + y * (tilt.y * scale) + z * tilt.z;
            const Real length = tilted.length();
            return Vector::select(length > 1e-6f, tilted * (side / length), normal);
        }
    };

    // Light as Webots displays it at an exposure of 1.
    static inline Vector tone_mapped(const Vector& light) {
        return Vector::map(light, [](Real a) {
            const Real shown = 1.0f - Powers<Numbers>::power_of_two(a * -1.44269504f);
            return Powers<Numbers>::power(shown, 1.0f / 2.2f);
        });
    }

    // The color of surfaces under all lights. Ambient light is uniform. In Webots' model, the intensity of a light is
    // squared in its diffuse reflection (resources/wren/shaders/pbr.frag).
    template <class Lights, class Unblocked>
    inline Vector lit(const Shown& shown, const Vector& point, const Vector& flat, Vector normal, const Lights& lights,
                      bool has_shadows, Real open, const Unblocked& unblocked) const {
        typedef Illumination<Numbers, typename Base::template Value<decltype(lights.all.data)>::Type> Lit;
        typedef Maps<typename Base::template Value<decltype(row.materials.pbr.data)>::Type> Textures;
        const auto& material = row.materials.materials.data[shown.material];
        const auto& pbr = row.materials.pbr.data[shown.material];
        const bool to_linear = lights.is_linear, is_webots = pbr.shading == WEBOTS;
        Vector base = shown.is_textured() ? shown.color().times(shown.texel()) : shown.color();
        const float dimming = lights.is_of_views ? lights.dimming : 1.0f;
        base = row.in_space(base, material.is_linear, to_linear) * Numbers::real(dimming);
        Vector glow = Vector::of(shown.emission);
        Real metallic = Numbers::real(pbr.metallic), roughness = Numbers::real(pbr.roughness);
        Real strength = pbr.ambient_strength * open;
        Textures maps = {row.materials, shown, pbr, (bool)material.is_linear, {}, {}};
        if (maps.has_any()) {
            shown.offsets(maps.across, maps.below);
            Vector packed = Vector::all(1.0f);
            if (maps.has(METALLIC_ROUGHNESS)) {
                packed = maps.texel(METALLIC_ROUGHNESS);
                metallic = metallic * packed.z, roughness = roughness * packed.y;
            }
            if (maps.has(OCCLUSION)) {
                const bool is_packed = maps.has(METALLIC_ROUGHNESS) && maps.are_same(OCCLUSION, METALLIC_ROUGHNESS);
                const Real in_map = is_packed ? packed.x : maps.texel(OCCLUSION).x;
                strength = strength * (1.0f + pbr.occlusion_strength * (in_map - 1.0f));
            }
            if (maps.has(EMISSION) && Numbers::any(glow.is_positive())) glow = glow.times(maps.texel(EMISSION));
            if (maps.has(NORMAL)) normal = maps.normal(flat, normal);
        }
        Vector total = row.in_space(glow, material.is_linear, to_linear) * Numbers::real(dimming);
        const Vector to_eye = (Vector::of(row.camera.position) - point).direction();
        const auto surface = Reflector<Numbers>::of(normal, to_eye, base, metallic, roughness, is_webots);
        Vector uniform = Vector::all(0.0f);
        const int count = lights.all.shape[1], view = row.images.view;
        const int first = lights.is_of_views ? view : world_row(row.worlds, view, lights.all.shape[0]);
        const auto* all = lights.all.data + (long long)first * count;
        for (int i = 0; i < count; ++i) {
            const Lit lit = {all[i], row.camera};
            const Vector ambient = Vector::from(all[i].ambient);
            if (all[i].kind == Lit::AMBIENT) {
                uniform = uniform + ambient;
                continue;
            }
            Real share;
            const Vector to_light = lit.direction(point, share);
            uniform = uniform + ambient * share;
            const Real facing = normal.dot(to_light);
            if (!Numbers::any((facing > 0.0f) & (share > 0.0f))) continue;
            if (has_shadows && all[i].shadow >= 0) share = share * unblocked(all[i].shadow);
            share = facing > 0.0f ? share : Numbers::real(0.0f);
            // With glTF, the light is an illuminance [lx], of which a diffuse surface reflects 1 / pi.
            const Real scale = share * (all[i].falloff == Lit::GLTF || is_webots ? 0.318309886f : 1.0f);
            const float factor = is_webots ? all[i].intensity : 1.0f;
            total = total + surface.direct(to_light, facing, factor).times(Vector::from(all[i].color)) * scale;
        }
        if (Numbers::any(uniform.is_positive()))
            total = total + surface.ambient(row.materials.reflectances).times(uniform) * strength;
        if (!to_linear) return total;
        return pbr.tone_mapped ? tone_mapped(total) : row.to_screen(total);
    }
};

// Start a row of colors.
template <class Materials, class Worlds, class Footprint, class Poses, class Colors>
inline PbrRow<PixelNumbers, Materials, Worlds> pbr_row(const Materials& materials, const Worlds& worlds,
                                                       const SurfaceImages& images, const Footprint& footprint,
                                                       const Poses& poses, Colors& colors) {
    return {color_row(materials, worlds, images, footprint, poses, colors)};
}
