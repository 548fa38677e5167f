# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights and sky of a MuJoCo model."""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import FARTHEST
from warpvis.errors import SceneError
from warpvis.mujoco._appearances import texture_image, unit_color
from warpvis.mujoco._model_fields import check_light_numbers
from warpvis.scene.lights import Background, Haze, Light, LightKind
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

_SKY_DISTANCE = 0.7
"""Distance of the sky from the camera, as a fraction of that of the far clipping plane (`mjr_render`)."""

_AMBIENT = (0.3, 0.3, 0.3)
"""Ambient light of a scene without other lights (`initLights` in render_gl3.c)."""


class LightPlaces(NamedTuple):
    """Positions and directions of a model's lights in the world."""

    light_xpos: NDArray[np.float64]
    light_xdir: NDArray[np.float64]


def model_lights(
    model: mujoco.MjModel, places: LightPlaces | None = None, *, inactive: bool = False
) -> tuple[Light, ...]:
    """Return a model's active lights at their places, by default at its initial state; the headlight comes first.

    Image lights are omitted. MuJoCo's renderer does not draw point lights, either. With `inactive`, inactive lights and
    image lights are among them, with an intensity of 0.
    """
    numbers = [number for number in light_ids(model, inactive=inactive) if number >= 0]
    check_light_numbers(model, numbers)
    found = [_headlight(model)] if model.vis.headlight.active else []
    if numbers:
        places = _initial_places(model) if places is None else places
        found += [_light(model, places, number) for number in numbers]
    is_lit = any(light.kind != "point" and light.intensity for light in found)
    if not is_lit or (inactive and not model.vis.headlight.active):
        found.append(Light("ambient", color=(0.0, 0.0, 0.0), ambient=_AMBIENT, intensity=0.0 if is_lit else 1.0))
    return tuple(found)


def light_ids(model: mujoco.MjModel, *, inactive: bool = False) -> list[int]:
    """Return the ids of the lights of `model_lights`, which are preceded by -1 if there is a headlight."""
    numbers = [
        number
        for number in range(model.nlight)
        if inactive or (int(model.light_type[number]) in _KINDS and model.light_active[number])
    ]
    return [-1] * bool(model.vis.headlight.active) + numbers


def lights_from_mujoco(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Light, ...]:
    """Return the lights of a model where they are now, for `Scene.lights`: lights may move with bodies.

    Args:
        model: A `mujoco.MjModel`.
        data: Its data after `mj_forward` or `mj_camlight`.

    Returns:
        The headlight, if it is active, and the active lights; ambient light if there are none.

    Raises:
        SceneError: If an argument has another type, or a number of a light is not finite.
    """
    if not isinstance(model, mujoco.MjModel) or not isinstance(data, mujoco.MjData):
        raise SceneError(
            f"model and data must be a mujoco.MjModel and its MjData, got {type(model).__name__} and "
            f"{type(data).__name__}"
        )
    if len(data.light_xpos) != model.nlight:
        raise SceneError(f"data must be of the model, which has {model.nlight} lights, got {len(data.light_xpos)}")
    if not np.isfinite(data.light_xpos).all() or not np.isfinite(data.light_xdir).all():
        raise SceneError("light_xpos and light_xdir of data must be finite")
    return model_lights(model, LightPlaces(data.light_xpos, data.light_xdir))


def _initial_places(model: mujoco.MjModel) -> LightPlaces:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    return LightPlaces(data.light_xpos, data.light_xdir)


def model_background(model: mujoco.MjModel) -> Background:
    """Return a model's sky, the first if it has several; black if it has none."""
    number = next((index for index in range(model.ntex) if int(model.tex_type[index]) == _SKYBOX), None)
    if number is None:
        return Background()
    width = int(model.tex_width[number])
    images = texture_image(model, number).reshape(6, width, width, -1)
    sky = tuple(Texture(image, model.texture(number).name) for image in images)
    return Background(sky=sky, world_to_cube=_WORLD_TO_CUBE, haze=_haze(model))


def _haze(model: mujoco.MjModel) -> Haze | None:
    """Return the haze at the first infinite plane that MuJoCo draws by default; None without one (`mjr_render`)."""
    infinite = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & ~model.geom_size[:, :2].any(axis=1)
    planes = np.flatnonzero(infinite & (model.geom_group < 3))
    radius = _SKY_DISTANCE * model.vis.map.zfar * model.stat.extent
    width = float(model.vis.map.haze)
    if not len(planes) or not 0 < radius < FARTHEST or not 0 <= width <= 1:
        return None
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    normal = data.geom_xmat[planes[0]].reshape(3, 3)[:, 2]
    position = np.clip(data.geom_xpos[planes[0]], -FARTHEST, FARTHEST)
    color = unit_color((*model.vis.rgba.haze[:3].tolist(), 1.0))[:3]
    return Haze(color, radius=radius, width=width, position=tuple(position.tolist()), normal=tuple(normal.tolist()))


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


def _light(model: mujoco.MjModel, data: LightPlaces, number: int) -> Light:
    """Return one light; only spotlights have an attenuation and a cone (`initLights` in render_gl3.c)."""
    known = _KINDS.get(int(model.light_type[number]))
    kind, spot = known or "point", known == "spot"
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
        intensity=float(known is not None and bool(model.light_active[number])),
        cast_shadow=bool(model.light_castshadow[number]),
        shadow_plane=kind == "directional",
    )


def _color(values: NDArray[np.floating]) -> tuple[float, float, float]:
    return tuple(np.maximum(values, 0).tolist())
