// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "shared/lighting.h"
#include "shared/scalar.h"

// Opacity of visible surfaces, from materials, textures and colors of vertices or faces.
template <class Numbers, class Materials, class Worlds>
struct OpacityRow {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Surface<Numbers, Materials> Shown;
    enum { MASK = 1, BLEND = 2 };  // of `DeviceMaterial.alpha_mode`
    static constexpr float OPAQUE_FROM = 0.995f;  // as for MuJoCo (`mjr_render`)

    ColorRow<Numbers, Materials, Worlds> row;
    int opaque_object;  // an object that is known to be opaque; -1 without

    // Find pixels that show what is behind their surfaces, among those from x on: their opacity, 1 elsewhere, and how
    // often each is blended. `is_back` is not 0 where a triangle is seen from behind.
    inline Whole find(int x, Whole is_back, Real& opacity, Real& passes) {
        const long long place = row.images.first + x;
        const int count = row.images.width - x;
        const Whole object = Numbers::load(row.images.segmentation + place, count);
        opacity = passes = Numbers::real(1.0f);
        Whole remaining = (object >= 0) & (object != opaque_object) & (Numbers::indices(0) < count);
        if (!Numbers::any(remaining)) return remaining;
        const Whole faces = Numbers::load(row.images.faces + place, count);
        while (Numbers::any(remaining)) {
            const int pixel = Numbers::first(remaining), index = Numbers::get(object, pixel);
            Whole which = remaining & (object == Numbers::whole(index));
            const int material = material_of(index, faces, pixel, which);
            const float* color = world_numbers(row.materials.world_color, row.worlds, row.images.view, index);
            if (!is_opaque(material, color, index)) {
                const auto points = SurfaceImages::triple<Numbers>(row.images.points, place, count);
                blend(row.surface(which, faces, points, index, pixel), color, which, is_back, opacity, passes);
            }
            remaining = remaining & (which == 0);
        }
        return opacity < 1.0f;
    }

  private:
    // The material that a pixel shows, and those of `which` that show the same one, which become `which`.
    inline int material_of(int object, Whole faces, int pixel, Whole& which) {
        const int entry = row.entry_of(object);
        const int first = row.materials.object_rows.data[(long long)Shown::OBJECT_ROWS * entry + Shown::FACE_MATERIAL];
        const int face = Numbers::get(faces, pixel);
        if (face < 0 || first < 0) return row.materials.object_material.data[entry];
        const int* of_faces = row.materials.face_material.data + first;
        const Whole shown = which ? faces : Numbers::whole(face);
        which = which & (Numbers::gather(of_faces, shown) == Numbers::whole(of_faces[face]));
        return of_faces[face];
    }
    // Whether all pixels of a material of an object are opaque, by its mode and color.
    inline bool is_opaque(int number, const float* color, int object) {
        const auto& material = row.materials.materials.data[number];
        if (material.alpha_mode == MASK) return false;
        if (material.alpha_mode != BLEND && !(color && material.blends_twice)) return note_opaque(object);
        const int* rows = row.materials.object_rows.data + (long long)Shown::OBJECT_ROWS * row.entry_of(object);
        if (material.texture >= 0 || rows[Shown::COLORS] >= 0) return false;
        return (color ? color[3] : material.color[3]) >= OPAQUE_FROM && note_opaque(object);
    }
    // Skip an object from here on, unless its triangles have several materials.
    inline bool note_opaque(int object) {
        const long long entry = row.entry_of(object);
        if (row.materials.object_rows.data[Shown::OBJECT_ROWS * entry + Shown::FACE_MATERIAL] < 0)
            opaque_object = object;
        return true;
    }
    // Set the opacity of the pixels `which` of a surface, and how often it is blended; `color` is its object's in the
    // world, or null.
    inline void blend(const Shown& shown, const float* color, Whole which, Whole is_back, Real& opacity, Real& passes) {
        const auto& material = row.materials.materials.data[shown.material];
        const Real none = Numbers::real(0.0f), all = Numbers::real(1.0f);
        Real own = Numbers::real(color ? color[3] : material.color[3]) * shown.opacity();
        const Whole hidden = material.is_double_sided ? is_back & 0 : is_back != 0;
        if (material.alpha_mode == MASK) {
            own = own >= Numbers::real(material.alpha_cutoff) ? all : none;
            own = hidden ? none : own;
        } else {
            const Whole full = own >= Numbers::real(OPAQUE_FROM);
            own = hidden ? none : own;
            own = full ? all : own;
            passes = which ? Numbers::real(material.blends_twice ? 2.0f : 1.0f) : passes;
        }
        opacity = which ? own : opacity;
    }
};

template <class Materials, class Worlds, class Footprint, class Poses>
inline OpacityRow<PixelNumbers, Materials, Worlds> opacity_row(const Materials& materials, const Worlds& worlds,
                                                               const SurfaceImages& images, const Footprint& footprint,
                                                               const Poses& poses) {
    const Eye camera = Eye::of(footprint, (const float*)(poses.data + images.view));
    ObjectFrame none;
    none.entry = -1;
    return {{materials, worlds, images, camera, nullptr, none}, -1};
}
