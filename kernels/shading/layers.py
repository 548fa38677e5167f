# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Surfaces behind each other: the opacity of each, and colors blended front to back."""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.shading.base_colors import DeviceMaterials, Footprint

wp.set_module_options(pixel_options("shared/opacity.h"))

MAX_LAYERS = 8
"""Maximum number of surfaces that are blended along a ray; the last one counts as opaque."""


@wp.struct
class Layers:
    """The color of a pixel from the surfaces so far, and how much of what is behind them it shows."""

    over: wp.array3d[wp.vec3]
    """Colors blended over what is behind them."""
    under: wp.array3d[wp.vec3]
    """Colors of surfaces that are blended twice, from their first pass: each one over those in front of it."""
    clear: wp.array3d[wp.vec2]
    """Transparency of `over` and of `under`; (0, 0) for pixels that are finished."""


@wp.func_native(
    """
const auto images = warpvis::surface_images(points_in, segmentation_in, faces_in, &points_in, view, y);
auto row = warpvis::opacity_row(appearance, worlds, images, footprint, camera_to_world);
typedef warpvis::PixelNumbers Numbers;
for (int x = x_first; x < x_end; x += Numbers::PIXELS) {
    const long long place = images.first + x;
    const int count = x_end - x;
    if (Numbers::PIXELS == 1 && images.segmentation[place] < -1) continue;
    Numbers::Real opacity, passes;
    row.find(x, is_back_in.data ? Numbers::load(is_back_in.data + place, count) : Numbers::whole(0), opacity, passes);
    Numbers::store_pairs((float*)opacity_out.data + 2 * place, opacity, passes, count);
}
"""
)
def find_opacity_of_pixels(
    appearance: DeviceMaterials,
    footprint: Footprint,
    camera_to_world: wp.array[wp.transform],
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    faces_in: wp.array3d[wp.int32],
    is_back_in: wp.array3d[wp.uint8],
    view: int,
    y: int,
    x_first: int,
    x_end: int,
    opacity_out: wp.array3d[wp.vec2],
): ...


@wp.kernel
def find_opacity(
    # Scene:
    appearance: DeviceMaterials,
    # Cameras:
    footprint: Footprint,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    faces_in: wp.array3d[wp.int32],
    is_back_in: wp.array3d[wp.uint8],
    # Out:
    opacity_out: wp.array3d[wp.vec2],
):
    """Write the opacity of visible surfaces, 1 where no surface is visible, and how often each is blended.

    `is_back_in` is 1 where a triangle is seen from behind; None if none is. Pixels with the object -2 are skipped.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    find_opacity_of_pixels(
        appearance,
        footprint,
        camera_to_world,
        worlds,
        points_in,
        segmentation_in,
        faces_in,
        is_back_in,
        view,
        y,
        x,
        x + 1,
        opacity_out,
    )


@wp.func
def to_bytes(color: wp.vec3) -> wp.vec3ub:
    return wp.vec3ub(
        wp.uint8(wp.clamp(color[0], 0.0, 1.0) * 255.0 + 0.5),
        wp.uint8(wp.clamp(color[1], 0.0, 1.0) * 255.0 + 0.5),
        wp.uint8(wp.clamp(color[2], 0.0, 1.0) * 255.0 + 0.5),
    )


@wp.func
def blend_surface(
    layers: Layers, number: int, opacity: wp.vec2, shown: wp.vec3ub, view: int, y: int, x: int
) -> tuple[bool, wp.vec3ub]:
    """Blend a surface with those in front of it; return whether the pixel is finished, and its color if it is."""
    clear = wp.vec2(1.0, 1.0)
    over, under = wp.vec3(), wp.vec3()
    if number > 0:
        clear = wp.cw_mul(clear, layers.clear[view, y, x])
        over += layers.over[view, y, x]
        under += layers.under[view, y, x]
    alpha = float(opacity[0])
    if number == MAX_LAYERS - 1:
        alpha = float(1.0)
    color = wp.vec3(float(shown[0]), float(shown[1]), float(shown[2])) / 255.0
    if alpha == 1.0:
        layers.clear[view, y, x] = wp.vec2(0.0, 0.0)
        return True, to_bytes(over + clear[0] * (under + clear[1] * color))
    over += clear[0] * alpha * color
    if opacity[1] > 1.0:
        under = under * (1.0 - alpha) + alpha * color
        clear = wp.vec2(clear[0], clear[1] * (1.0 - alpha))
    layers.over[view, y, x] = over
    layers.under[view, y, x] = under
    layers.clear[view, y, x] = wp.vec2(clear[0] * (1.0 - alpha), clear[1])
    return False, shown


@wp.kernel
def blend_layer(
    # Cameras:
    window: Window,
    # In:
    number: int,
    color_in: wp.array3d[wp.vec3ub],
    opacity_in: wp.array3d[wp.vec2],
    # Out:
    layers_out: Layers,
    color_out: wp.array3d[wp.vec3ub],
):
    """Blend a layer, counted from 0 at the front, with those in front of it, and write the colors of finished pixels.

    A surface of opacity a and color c is painted over what is behind it, a c + (1 - a) B. If all surfaces are blended
    twice, they are first painted front to back over the background, then back to front.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    if number > 0:
        if layers_out.clear[view, y, x][0] == 0.0:
            return
    opacity = opacity_in[view, y, x]
    if number == 0 and opacity[0] == 1.0:
        layers_out.clear[view, y, x] = wp.vec2(0.0, 0.0)
        return
    finished, color = blend_surface(layers_out, number, opacity, color_in[view, y, x], view, y, x)
    if finished:
        color_out[view, y, x] = color
