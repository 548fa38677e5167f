# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The lights and the sky of a MuJoCo model."""

from __future__ import annotations

import math

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import FARTHEST
from warpvis.mujoco._model_fields import check_light_numbers
from warpvis.scene.lights import Background, Light, LightKind
from warpvis.scene.materials import Texture

_SPOT, _DIRECTIONAL = int(mujoco.mjtLightType.mjLIGHT_SPOT), int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
_KINDS: dict[int, LightKind] = {
    _SPOT: "spot",
    _DIRECTIONAL: "directional",
    int(mujoco.mjtLightType.mjLIGHT_POINT): "point",
}

_SKYBOX = int(mujoco.mjtTexture.mjTEXTURE_SKYBOX)

_WORLD_TO_CUBE = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
"""Rotation of the sky's cube map (`settexture` in render_gl3.c)."""

_AMBIENT = (0.3, 0.3, 0.3)
"""Ambient light of a scene without other lights (`initLights` in render_gl3.c)."""


def model_lights(model: mujoco.MjModel) -> tuple[Light, ...]:
    """Return a model's active lights at its initial state; the headlight comes first.

    Image lights are omitted. MuJoCo's renderer does not draw point lights, either.
    """
    active = [number for number in range(model.nlight) if model.light_active[number]]
    check_light_numbers(model, active)
    found = [_headlight(model)] if model.vis.headlight.active else []
    if active:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        kinds = [(number, _KINDS.get(int(model.light_type[number]))) for number in active]
        found += [_light(model, data, number, kind) for number, kind in kinds if kind is not None]
    if not any(light.kind != "point" for light in found):
        found.append(Light("ambient", color=(0.0, 0.0, 0.0), ambient=_AMBIENT))
    return tuple(found)


def model_background(model: mujoco.MjModel) -> Background:
    """Return a model's sky, the first if it has several; black if it has none."""
    number = next((index for index in range(model.ntex) if int(model.tex_type[index]) == _SKYBOX), None)
    if number is None:
        return Background()
    width, channels = int(model.tex_width[number]), int(model.tex_nchannel[number])
    size = width * int(model.tex_height[number]) * channels
    first = int(model.tex_adr[number])
    images = np.asarray(model.tex_data[first : first + size]).reshape(-1, width, width, channels)
    if channels < 3:
        images = np.repeat(images[..., :1], 3, axis=-1)
    if len(images) == 1:  # one image for all sides of the cube
        images = np.repeat(images, 6, axis=0)
    name = model.texture(number).name
    return Background(sky=tuple(Texture(image, name) for image in images[:6]), world_to_cube=_WORLD_TO_CUBE)


def _headlight(model: mujoco.MjModel) -> Light:
    headlight = model.vis.headlight
    return Light(
        "headlight",
        "headlight",
        color=_color(headlight.diffuse),
        ambient=_color(headlight.ambient),
        specular=_color(headlight.specular),
        cast_shadow=False,
    )


def _light(model: mujoco.MjModel, data: mujoco.MjData, number: int, kind: LightKind) -> Light:
    """Return one light; only spotlights have an attenuation and a cone (`initLights` in render_gl3.c)."""
    spot = kind == "spot"
    attenuation = np.maximum(model.light_attenuation[number], 0)
    direction = data.light_xdir[number]
    return Light(
        kind,
        model.light(number).name,
        tuple(np.clip(data.light_xpos[number], -FARTHEST, FARTHEST).tolist()),
        tuple(direction.tolist()) if np.any(direction) else (0.0, 0.0, -1.0),
        color=_color(model.light_diffuse[number]),
        ambient=_color(model.light_ambient[number]),
        specular=_color(model.light_specular[number]),
        attenuation=tuple(attenuation.tolist()) if spot and attenuation.any() else (1.0, 0.0, 0.0),
        outer_angle=min(max(math.radians(float(model.light_cutoff[number])), 0.0), math.pi) if spot else math.pi,
        exponent=max(0.0, float(model.light_exponent[number])) if spot else 0.0,
        cast_shadow=bool(model.light_castshadow[number]),
    )


def _color(values: NDArray[np.floating]) -> tuple[float, float, float]:
    return tuple(np.maximum(values, 0).tolist())
