# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights of a scene on a device, which `kernels.shading.lighting` reads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, get_args

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.scene.light_samples import sphere_samples
from warpvis.scene.lights import Falloff, Light
from warpvis.scene.materials import linear_color

if TYPE_CHECKING:
    from warpvis.kernels.shading.lighting import Lights

_ENDLESS = 3e38  # about the largest single-precision number [m]
_LIGHT_KINDS = ("ambient", "directional", "point", "spot", "headlight")
"""In the order of `kernels.shading.lighting`."""


def pack_lights(lights: Sequence[Light], device: wp.Device) -> Lights:
    """Copy lights to a device. If one of them has linear colors, all are summed in linear space."""
    from warpvis.kernels.shading.lighting import DeviceLight, Lights

    packed, is_linear = Lights(), any(light.color_space == "linear" for light in lights)
    rows, samples = [], list[NDArray[np.float32]]()
    for light in lights:
        record = DeviceLight()
        record.kind, record.falloff = _LIGHT_KINDS.index(light.kind), get_args(Falloff).index(light.falloff)
        for name in ("position", "direction", "attenuation"):
            setattr(record, name, wp.vec3(*getattr(light, name)))
        specular = light.color if light.specular is None else light.specular
        for name, color in (("color", light.color), ("ambient", light.ambient), ("specular", specular)):
            values = linear_color(color) if is_linear and light.color_space == "srgb" else color
            setattr(record, name, wp.vec3(*(light.intensity * value for value in values)))
        record.reach, record.intensity = min(light.reach, _ENDLESS), light.intensity
        record.inner_angle, record.outer_angle, record.exponent = light.inner_angle, light.outer_angle, light.exponent
        record.cos_inner, record.cos_outer = math.cos(light.inner_angle), math.cos(light.outer_angle)
        if light.casts_shadow and light.radius > 0:
            record.radius = math.tan(light.radius) if light.kind == "directional" else light.radius
            record.first_sample, record.sample_count = sum(map(len, samples)), light.shadow_samples
            samples.append(sphere_samples(light.shadow_samples).reshape(-1, 3))
        record.shadow, record.shadow_plane = -1, light.shadow_plane and light.kind == "directional"
        if light.casts_shadow:
            record.shadow = packed.shadow_count
            packed.shadow_count += 1
        rows.append(record)
    packed.all = wp.array(rows, dtype=DeviceLight, device=device).reshape((1, len(rows)))
    packed.is_linear = is_linear
    if samples:
        packed.samples = wp.array(np.concatenate(samples), dtype=wp.vec3, device=device)
    return packed
