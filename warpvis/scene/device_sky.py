# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The background of a scene on a device, and its sky, which `kernels.shading.sky` reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.scene._mip_levels import CUBE_SIDES, CUBE_WRAP, count_texels, mip_levels, pack_texels
from warpvis.scene.lights import Background, Haze
from warpvis.scene.materials import Filter, Wrap, screen_color

if TYPE_CHECKING:
    from warpvis.kernels.shading.base_colors import DeviceMaterials
    from warpvis.kernels.shading.sky import Haze as DeviceHaze, Sky

_MAX_LIGHT = float(np.finfo(np.float16).max)
"""Light is stored in half precision; it is clipped at 1 after filtering."""

_PANORAMA_WRAP = "repeat", "clamp"


@dataclass(frozen=True)
class DeviceSkies:
    """Skies on a device."""

    all: wp.array
    """Array of `kernels.shading.sky.Sky`: that of the scene, and those that worlds may have."""
    packed: tuple[Sky, ...]
    """The elements of `all`, which keep their arrays alive."""


def pack_skies(own: Background | None, others: Sequence[Background], device: wp.Device) -> DeviceSkies:
    """Copy skies to a device: that of a scene, which may be absent, and others, which may be of one color."""
    from warpvis.kernels.shading.sky import Sky

    first = _pack_sky(own, device)
    if first is None:
        first = Sky()
        first.is_absent = True
    packed = (first, *(_pack_other(item, device) for item in others))
    return DeviceSkies(wp.array(packed, dtype=Sky, device=device), packed)


def _pack_other(background: Background, device: wp.Device) -> Sky:
    """Copy the sky of a background to a device; without one, its color in all directions."""
    found = _pack_sky(background, device)
    if found is None:
        plain = replace(background, sky=(), panorama=None, gradient=(background.color, background.color))
        found = _pack_sky(plain, device)
    assert found is not None  # gradients have no images that may be missing
    return found


def _pack_sky(background: Background | None, device: wp.Device) -> Sky | None:
    """Copy the sky of a background to a device; None if it has none, or if its images do not fit each other."""
    if background is None or not background.has_sky:
        return None
    from warpvis.kernels.shading import sky as kernels

    sky = kernels.Sky()
    sky.rotation = wp.mat33(*np.array(background.world_to_cube).ravel().tolist())
    sky.is_linear, filter_mode = background.color_space == "linear", "linear"
    if background.haze is not None:
        sky.haze = _pack_haze(background.haze, np.array(background.world_to_cube))
    if background.gradient:
        sky.is_gradient = True
        sky.colors = wp.array(np.array(background.gradient), dtype=wp.vec3, device=device)
        return sky
    panorama = background.panorama
    sky.is_cube = panorama is None
    image: NDArray[Any] | None
    if isinstance(panorama, np.ndarray):
        image = panorama
    else:
        texture = background.sky[0] if panorama is None else panorama
        image = background.image if panorama is None else panorama.image
        sky.is_linear, filter_mode = texture.color_space == "linear", texture.filter
    if image is None:
        return None
    sides = CUBE_SIDES if sky.is_cube else 1
    sky.is_light = image.dtype != np.uint8
    if sky.is_light:
        sky.is_linear = True
        image = np.minimum(image * np.float32(background.exposure), np.float32(_MAX_LIGHT))
    levels = mip_levels(image, sides)
    shapes: list[tuple[int, ...]] = [level.shape[:2] for level in levels]
    layout = sky.texture
    layout.height, layout.width = shapes[0]
    layout.levels, layout.filter = len(levels), get_args(Filter).index(filter_mode)
    layout.wrap_u, layout.wrap_v = (CUBE_WRAP, CUBE_WRAP) if sky.is_cube else map(get_args(Wrap).index, _PANORAMA_WRAP)
    sky.texels = wp.array(pack_texels(levels, sides), dtype=wp.uint32, device=device)
    first = np.cumsum([0, *count_texels(shapes, sides)[:-1]])
    sky.level_first = wp.array(first, dtype=wp.int32, device=device)
    return sky


def _pack_haze(haze: Haze, world_to_sky: NDArray[np.float64]) -> DeviceHaze:
    from warpvis.kernels.shading.sky import Haze as DeviceHaze

    packed = DeviceHaze()
    color = haze.color if haze.color_space == "srgb" else screen_color(haze.color)
    packed.color, packed.position, packed.normal = (wp.vec3(*item) for item in (color, haze.position, haze.normal))
    packed.sky_normal = wp.vec3(*(world_to_sky @ np.array(haze.normal)).tolist())
    packed.radius, packed.width, packed.peak = haze.radius, haze.width, haze.peak
    return packed


def set_background(scene_materials: DeviceMaterials, background: Background | None) -> None:
    """Set the color of pixels that see no object; black under a sky, which is painted later."""
    color: tuple[float, ...] = (0.0, 0.0, 0.0)
    if background is not None and not background.has_sky:
        color = background.color if background.color_space == "srgb" else screen_color(background.color)
    scene_materials.background = wp.vec3(*color)
