// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Texture sampling with mip maps: the level follows from the longer side of a pixel's footprint in texels (OpenGL 4.6
// core specification, 8.14.1), and colors are interpolated linearly between texels and between levels. Around each side
// of a cube, the texels have a border of those of the adjacent sides, so that edges are seamless (8.13.1).

#pragma once

#include "shared/powers.h"
#include "shared/triples.h"

// A position in a texture: u and v, from 0 to 1 and repeated, v upwards; the side of a cube; and the square of the
// longer side of the pixel's footprint, in texels of the finest level.
template <class Numbers>
struct TexturePosition {
    typename Numbers::Real u, v;
    typename Numbers::Whole side;
    typename Numbers::Real square_footprint;
};

// A texture in the arrays of all texels: a `DeviceTexture` of kernels/shading/textures.py.
struct TextureLayout {
    int first_level;  // its first row in `Sampler::level_first`
    int levels, width, height;  // of the finest level; of a cube, the height of its six sides together
    int wrap_u, wrap_v, filter;
    bool is_linear;

    template <class DeviceTexture>
    static inline TextureLayout of(const DeviceTexture& of) {
        return TextureLayout{of.first_level, of.levels, of.width,  of.height,
                             of.wrap_u,      of.wrap_v, of.filter, of.is_linear};
    }
};

// The sides of a cube map: 0 to 5 for +x, -x, +y, -y, +z, -z (OpenGL 4.6 core specification, table 8.19).
template <class Numbers>
struct CubeSide {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef Triple<Numbers> Vector;

    // The side that a direction points to.
    static inline Whole of(const Vector& a) {
        const Real x = Numbers::abs(a.x), y = Numbers::abs(a.y), z = Numbers::abs(a.z);
        const Whole of_z = a.z >= 0.0f ? Numbers::whole(4) : Numbers::whole(5);
        const Whole of_y = a.y >= 0.0f ? Numbers::whole(2) : Numbers::whole(3);
        const Whole of_x = a.x >= 0.0f ? Numbers::whole(0) : Numbers::whole(1);
        return ((x >= y) & (x >= z)) ? of_x : (y >= z ? of_y : of_z);
    }
    // The position of a direction on a side, from 0 to 1, v upwards.
    static inline void project(const Vector& a, Whole side, Real& u, Real& v) {
        const Real s = side == 0 ? -a.z : (side == 1 ? a.z : (side == 5 ? -a.x : a.x));
        const Real t = side == 2 ? a.z : (side == 3 ? -a.z : -a.y);
        const Real positive = side == 0 ? a.x : (side == 2 ? a.y : a.z);
        const Real negative = side == 1 ? -a.x : (side == 3 ? -a.y : -a.z);
        const Whole is_negative = (side & 1) == 1;
        const Real along = Numbers::max(is_negative ? negative : positive, Numbers::real(1e-12f));
        u = 0.5f * (s / along + 1.0f), v = 1.0f - 0.5f * (t / along + 1.0f);
    }
};

// Samples a texture.
template <class Numbers>
struct Sampler {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    typedef typename Numbers::Word Word;
    typedef Triple<Numbers> Color;
    enum { REPEAT, MIRROR, CLAMP, BORDER, CUBE_SIDES = 6 };  // cubes have a border
    enum { NEAREST, LINEAR };

    TextureLayout texture;
    const int* texels;  // RGBA, red in the lowest byte; or two words of four half-precision numbers
    const int* level_first;  // first texel of each level of all textures
    const float* linear_of;  // linear light of the 256 display values
    bool to_linear, to_screen;  // the conversion of texels
    int sides;  // CUBE_SIDES, below each other, or 1
    bool takes_opacity = false;  // whether samples are the opacity of texels, three times, instead of their color
    bool is_light = false;  // whether texels are numbers in half precision

    inline Color sample(const TexturePosition<Numbers>& position) const {
        const Real last = Numbers::real((float)(texture.levels - 1));
        const Whole is_reduced = position.square_footprint > 1.0f;
        if (texture.filter == NEAREST || !Numbers::any(is_reduced))
            return scaled(level_color(position, Numbers::whole(0)));
        const Real limited = Numbers::max(position.square_footprint, Numbers::real(1.0f));
        const Real level = Numbers::min(0.5f * Powers<Numbers>::logarithm(limited), last);
        const Real finer = Numbers::floor(level), rest = level - finer;
        const Color color = level_color(position, Numbers::truncate(finer));
        if (!Numbers::any(rest > 0.0f)) return scaled(color);
        const Color coarser = level_color(position, Numbers::truncate(Numbers::min(finer + 1.0f, last)));
        return scaled(between(color, coarser, rest));
    }

  private:
    static inline int length(int a) { return a > 1 ? a : 1; }
    // Colors are interpolated as bytes where they are not converted, as is opacity.
    inline Color scaled(const Color& color) const {
        const bool is_converted = (to_linear || to_screen) && !takes_opacity;
        return is_converted || is_light ? color : color * Numbers::real(1.0f / 255.0f);
    }
    // A coordinate from 0 to 1 within a repetition; 0 for NaN.
    static inline Real wrapped(Real u, int mode) {
        if (mode == REPEAT) {
            u = u - Numbers::floor(u);
        } else if (mode == MIRROR) {
            const Real twice = u - 2.0f * Numbers::floor(0.5f * u);
            u = Numbers::min(twice, 2.0f - twice);
        }
        return Numbers::max(Numbers::min(u, Numbers::real(1.0f)), Numbers::real(0.0f));
    }
    // The index before the first or after the last texel: of the other end, or of the edge, which mirrored textures
    // repeat.
    static inline Whole at_least_0(Whole index, Whole size, int mode) {
        if (mode == BORDER) return index;
        return index < 0 ? (mode == REPEAT ? size - 1 : Numbers::whole(0)) : index;
    }
    static inline Whole below(Whole index, Whole size, int mode) {
        if (mode == BORDER) return index;
        return index < size ? index : (mode == REPEAT ? Numbers::whole(0) : size - 1);
    }
    inline Color level_color(const TexturePosition<Numbers>& at, Whole level) const {
        const Whole wide = Numbers::whole(texture.width) >> level;
        const Whole high = Numbers::whole(texture.height / sides) >> level;
        const Whole width = wide > 1 ? wide : Numbers::whole(1), height = high > 1 ? high : Numbers::whole(1);
        Whole first = Numbers::gather(level_first + texture.first_level, level);
        Whole stride = width;
        if (sides > 1) {
            stride = width + 2;
            first += (at.side * (height + 2) + 1) * stride + 1;
        }
        const Real columns = Numbers::to_real(width), rows = Numbers::to_real(height);
        const Real x = wrapped(at.u, texture.wrap_u) * columns, y = wrapped(1.0f - at.v, texture.wrap_v) * rows;
        if (texture.filter == NEAREST) {
            const Whole row = below(Numbers::truncate(y), height, CLAMP);
            return texel(first + row * stride + below(Numbers::truncate(x), width, CLAMP));
        }
        const Real left = Numbers::floor(x - 0.5f), above = Numbers::floor(y - 0.5f);
        const Real right_share = x - 0.5f - left, lower_share = y - 0.5f - above;
        const Whole before = Numbers::truncate(left), over = Numbers::truncate(above);
        const Whole column = at_least_0(before, width, texture.wrap_u);
        const Whole next = below(before + 1, width, texture.wrap_u);
        const Whole upper_row = first + at_least_0(over, height, texture.wrap_v) * stride;
        const Whole lower_row = first + below(over + 1, height, texture.wrap_v) * stride;
        const Color upper = between(texel(upper_row + column), texel(upper_row + next), right_share);
        const Color lower = between(texel(lower_row + column), texel(lower_row + next), right_share);
        return between(upper, lower, lower_share);
    }
    static inline Color between(const Color& a, const Color& b, Real share) { return a + (b - a) * share; }
    // A number from 0 up in half precision.
    static inline Real of_half(Word bits) { return Numbers::of_bits(bits << 13) * 0x1p112f; }
    // A texel in the color space of the material.
    inline Color texel(Whole index) const {
        if (is_light) {
            const Word first = (Word)Numbers::gather(texels, index * 2);
            const Word second = (Word)Numbers::gather(texels + 1, index * 2);
            return Color{of_half(first & 0xffffu), of_half(first >> 16), of_half(second & 0xffffu)};
        }
        const Word word = (Word)Numbers::gather(texels, index);
        if (takes_opacity) {
            const Real opacity = Numbers::to_real((Whole)(word >> 24));
            return Color{opacity, opacity, opacity};
        }
        const Whole red = (Whole)(word & 255u), green = (Whole)((word >> 8) & 255u);
        const Whole blue = (Whole)((word >> 16) & 255u);
        if (to_linear) {
            return Color{Numbers::gather(linear_of, red), Numbers::gather(linear_of, green),
                         Numbers::gather(linear_of, blue)};
        }
        const Color color = Color{Numbers::to_real(red), Numbers::to_real(green), Numbers::to_real(blue)};
        if (!to_screen) return color;
        return Color::map(color * Numbers::real(1.0f / 255.0f), Powers<Numbers>::to_screen);
    }
};
