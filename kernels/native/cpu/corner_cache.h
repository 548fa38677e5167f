// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Light at the corners of triangles, computed once for the pixels of a view that show the same triangle.

#pragma once

#include "cpu/number_lanes.h"
#include "shared/vertex_lighting.h"

// The light of triangles that pixels of a view show, by the object and the number of the triangle, where each has one
// place. A place contains the colors of the sum of lights, and then those of each light that is a pass: of red, green
// and blue, those of the corners.
struct CornerCache {
    enum { MAX_PLACES = 512, SPARE_PLACES = LANES, MEMORY = 8192, COLORS = 9, MAX_PASSES = 7 };

    int passes, places, width;
    int object[MAX_PLACES], number[MAX_PLACES];
    float colors[MEMORY];
    FlatCells cells;  // of the last object

    template <class Lights>
    inline void clear(const Lights& lights, bool has_shadows) {
        passes = has_shadows ? lights.shadow_count : 0, width = COLORS * (1 + passes);
        for (places = MAX_PLACES; (places + SPARE_PLACES) * width > MEMORY && places > 1;) places /= 2;
        for (int i = 0; i < places; ++i) object[i] = -1;
        cells.entry = -1;
    }
    template <class Whole>
    inline Whole place_of(int of, Whole triangle) const {
        return (triangle + (triangle >> 5) + of * 37) & (places - 1);
    }
    inline bool has(int place, int of, int triangle) const { return object[place] == of && number[place] == triangle; }
};

// Lights the pixels of a `ColorRow` at the corners of triangles.
template <class Row, class Lights, class Shadows>
struct CachedCorners {
    typedef Triple<PixelLanes> Vector;
    typedef typename Row::Shown Shown;
    enum { CORNERS = 3, TRIANGLES = LANES / CORNERS };

    const Row& row;
    const Lights& lights;
    const Shadows& shadows;
    CornerCache& cache;

    // Whether light at a corner is the same for all pixels that show its triangle.
    inline bool applies_to(const Shown& shown) const {
        const auto& material = row.materials.materials.data[shown.material];
        const bool has_colors = shown.has_plane() && shown.rows[Shown::COLORS] >= 0;
        return !has_colors && !material.is_unlit && !material.is_linear && !lights.is_linear &&
               !lights.occlusion.data && cache.passes <= CornerCache::MAX_PASSES;
    }
    // `which` are the pixels that show the material.
    template <class Triangles>
    inline Vector color(const Shown& shown, Ints which, const Triangles& triangles, long long place, int count) const {
        int places[LANES], queue[LANES], found = 0, missing = 0;
        Ints pixels[LANES];
        const Ints number = triangles.number;
        for (Ints remaining = which; Lanes::any(remaining); ++found) {
            const int pixel = PixelLanes::first(remaining), triangle = number[pixel];
            pixels[found] = number == Lanes::all_ints(triangle);
            remaining &= pixels[found] == 0;
            places[found] = cache.place_of(shown.object, triangle);
            if (!cache.has(places[found], shown.object, triangle)) queue[missing++] = found;
        }
        if (missing > 0) compute(shown, which, triangles, pixels, queue, missing, places);
        Floats fractions[CornerCache::MAX_PASSES];
        for (int i = 0; i < cache.passes; ++i) {
            const unsigned char* image = shadows.data + (long long)i * shadows.strides[0];
            fractions[i] = PixelLanes::to_real(PixelLanes::load(image + place, count)) * (1.0f / 255.0f);
        }
        const Floats b = triangles.weight_b, c = triangles.weight_c, a = 1.0f - b - c;
        const auto mix = [&](const float* of) { return of[0] * a + of[1] * b + of[2] * c; };
        Vector color = Vector::all(0.0f);
        for (int k = 0; k < found; ++k) {
            const float* from = cache.colors + places[k] * cache.width;
            Vector total = {mix(from), mix(from + CORNERS), mix(from + 2 * CORNERS)};
            for (int i = 0; i < cache.passes; ++i) {
                from += CornerCache::COLORS;
                total = total + Vector{mix(from), mix(from + CORNERS), mix(from + 2 * CORNERS)} * fractions[i];
            }
            color = Vector::select(pixels[k], total, color);
        }
        return shown.is_textured() ? color.times(shown.texel()) : color;
    }

  private:
    // Compute the triangles in a queue, several at a time, which then have places.
    template <class Triangles>
    inline void compute(const Shown& shown, Ints which, const Triangles& triangles, const Ints* pixels,
                        const int* queue, int missing, int* places) const {
        const Ints used = cache.place_of(shown.object, triangles.number);
        for (int first = 0; first < missing; first += TRIANGLES) {
            const int end = first + TRIANGLES < missing ? first + TRIANGLES : missing;
            Ints source = Lanes::all_ints(0);
            for (int i = first; i < end; ++i) {
                int& place = places[queue[i]];
                const Ints own = pixels[queue[i]];
                const int pixel = PixelLanes::first(own);
                // Places of other triangles of the packet are not overwritten.
                if (Lanes::any(which & (own == 0) & (used == Lanes::all_ints(place)))) {
                    place = cache.places + i;
                } else {
                    cache.object[place] = shown.object, cache.number[place] = triangles.number[pixel];
                }
                source = Lanes::index() < Lanes::all_ints(CORNERS * (i - first)) ? source : Lanes::all_ints(pixel);
            }
            PixelPlace<PixelLanes> corners;
            const Ints corner = Lanes::index() % (int)CORNERS;
            triangles.permuted(source).corner(triangles.grid.kind, corner, corners.point[0], corners.normal[0]);
            write(shown, corners, places, queue + first, end - first);
        }
    }
    // Write the light at corners to the places of `count` triangles, as `ColorRow::lit` computes it.
    inline void write(const Shown& shown, const PixelPlace<PixelLanes>& corners, const int* places, const int* queue,
                      int count) const {
        typedef Illumination<PixelLanes, typename Row::template Value<decltype(lights.all.data)>::Type> Lit;
        const auto& material = row.materials.materials.data[shown.material];
        const float dimming = lights.is_of_views ? lights.dimming : 1.0f;
        const Floats all = Lanes::all(1.0f);
        const Vector base = Vector::of(shown.base) * Lanes::all(dimming);
        const Vector& point = corners.point[0];
        const Vector to_eye = (Vector::of(row.camera.position) - point).direction();
        Vector total = Vector::of(shown.emission) * Lanes::all(dimming);
        float gloss[3];
        for (int k = 0; k < 3; ++k) gloss[k] = material.specular[k];
        const int number = lights.all.shape[1];
        const int light_row =
            lights.is_of_views ? row.images.view : world_row(row.worlds, row.images.view, lights.all.shape[0]);
        for (int i = 0; i < number; ++i) {
            const Lit lit = {lights.all.data[(long long)light_row * number + i], row.camera};
            const Vector part =
                lit.reflected(point, corners.normal[0], to_eye, base, gloss, material.shininess, all, all);
            if (shadows.data && lit.light.shadow >= 0)
                put(part, 1 + lit.light.shadow, places, queue, count);
            else
                total = total + part;
        }
        put(total, 0, places, queue, count);
    }
    // Write the colors of the corners for the sum of lights, 0, or for a pass.
    inline void put(const Vector& color, int pass, const int* places, const int* queue, int count) const {
        const Floats most = Lanes::all(1.0f);
        const Floats channels[3] = {Lanes::min(color.x, most), Lanes::min(color.y, most), Lanes::min(color.z, most)};
        const float* numbers = (const float*)channels;
        for (int i = 0; i < count; ++i) {
            float* const to = cache.colors + places[queue[i]] * cache.width + CornerCache::COLORS * pass;
            for (int k = 0; k < CornerCache::COLORS; ++k)
                to[k] = numbers[k / CORNERS * LANES + i * CORNERS + k % CORNERS];
        }
    }
};

// Write the colors of pixels of a `ColorRow` from x on, as `vertex_lit_colors`.
template <class Row, class Lights, class Shadows>
inline void cached_vertex_lit_colors(Row& row, int x, const Lights& lights, const Shadows& shadows,
                                     CornerCache& cache) {
    typedef Triple<PixelLanes> Vector;
    const CachedCorners<Row, Lights, Shadows> cached = {row, lights, shadows, cache};
    row.write(x, [&](const typename Row::Shown& shown, Ints which, const Vector&, long long place, int count) {
        const Vector flat = SurfaceImages::triple<PixelLanes>(row.images.normals, place, count);
        auto triangles = corner_finder<PixelLanes>(row, shown, cache.cells, flat);
        triangles.locate(triangles.grid.kind);
        if (triangles.has_numbers() && cached.applies_to(shown))
            return cached.color(shown, which, triangles, place, count);
        return row.lit_by_images(shown, triangles.corners(triangles.grid.kind), lights, shadows, place, count);
    });
}
