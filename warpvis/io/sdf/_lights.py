# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights, ambient light and background of SDF worlds.

Light is summed in linear space, as by gz-sim's renderer (gz-rendering, ogre2), which divides ambient light by pi.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from warpvis.core.checks import truncate
from warpvis.errors import SceneError
from warpvis.io.sdf._scopes import Matrix
from warpvis.io.sdf._xml import Node
from warpvis.scene.lights import Background, Light

_KINDS = ("point", "spot", "directional")
_SKY = (0.5, 0.7, 0.9, 1.0)
"""Color of a sky."""
_AMBIENT = (0.4, 0.4, 0.4, 1.0)
_BACKGROUND = (0.7, 0.7, 0.7, 1.0)


def read_light(node: Node, name: str, pose: Matrix) -> Light | None:
    """Return a light with a pose in the file's frame; None if it is off.

    The angles of a spot's cones are full angles. Between them, its light decreases linearly with the angle, for a
    `falloff` of about 1; for a larger one, faster; and without one, the whole cone has full brightness.
    """
    kind = (node.get("type") or "point").strip()
    if kind not in _KINDS:
        node.fail(f"must have a type {', '.join(_KINDS[:2])} or {_KINDS[2]}, got {truncate(kind)!r}")
    if not node.flag("light_on", True):
        return None
    direction = np.array(node.numbers("direction", (0.0, 0.0, -1.0)))
    if not direction.any():
        node.fail("must have a direction other than 0")
    options: dict[str, Any] = {}
    if kind != "directional":
        constant, linear, quadratic = (
            max(0.0, node.number(f"attenuation/{tag}", default))
            for tag, default in (("constant", 1.0), ("linear", 1.0), ("quadratic", 0.0))
        )
        attenuation = (constant, linear, quadratic)
        options["attenuation"] = attenuation if any(attenuation) else (1.0, 0.0, 0.0)
        options["reach"] = node.number("attenuation/range", 10.0, minimum=0.0)
    if kind == "spot":
        inner, outer = (
            min(node.number(f"spot/{tag}_angle", 0.0, minimum=0.0) / 2, math.pi) for tag in ("inner", "outer")
        )
        falloff = node.number("spot/falloff", 0.0, minimum=0.0)
        options |= {"inner_angle": min(inner, outer), "outer_angle": outer}
        options["falloff"] = "opengl" if falloff == 0 else "webots" if falloff < 1.5 else "gltf"
    diffuse = node.color("diffuse") or (1.0, 1.0, 1.0, 1.0)
    specular = node.color("specular") or (0.1, 0.1, 0.1, 1.0)
    try:
        return Light(
            kind,  # type: ignore[arg-type]
            name,
            position=tuple(pose[:3, 3].tolist()),
            direction=tuple((pose[:3, :3] @ direction).tolist()),
            color=diffuse[:3],
            specular=specular[:3],
            intensity=node.number("intensity", 1.0, minimum=0.0),
            cast_shadow=node.flag("cast_shadows", False),
            color_space="linear",
            **options,
        )
    except SceneError as error:
        node.fail(f"is no valid light: {error}")


def read_environment(world: Node) -> tuple[Light, Background]:
    """Return the ambient light and the background of a world."""
    ambient, color = world.color("scene/ambient"), world.color("scene/background")
    if world.child("scene/sky") is not None:
        color = _SKY
    red, green, blue = (part / math.pi for part in (ambient or _AMBIENT)[:3])
    light = Light("ambient", "ambient", ambient=(red, green, blue), color=(0.0, 0.0, 0.0), color_space="linear")
    return light, Background((color or _BACKGROUND)[:3])
