# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights and the background of Webots' worlds.

Webots converts the colors of lights and materials to linear RGB (src/wren/LightNode.cpp) and sums light in that space.
Fields and their defaults are those of its reference: light.md, directionallight.md, pointlight.md, spotlight.md, and
background.md.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from warpvis.errors import WarpvisError
from warpvis.scene.colors import linear_color
from warpvis.scene.lights import Background, Light, LightKind
from warpvis.scene.materials import Texture
from warpvis.webots._nodes import Node, Transform

LIGHTS: dict[str, LightKind] = {"DirectionalLight": "directional", "PointLight": "point", "SpotLight": "spot"}

_FACES = ("right", "left", "top", "bottom", "front", "back")
"""Faces of a background, in the order of OpenGL's cube maps (src/webots/nodes/WbBackground.cpp)."""

# The shader samples (x, y, -z), resources/wren/shaders/skybox.frag. For worlds with z up, WbBackground.cpp swaps and
# rotates the images (gCoordinateSystemSwap, gCoordinateSystemRotate), which is equivalent to rotating the world.
_WORLD_TO_CUBE = {
    "y": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    "z": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)),
}

_NO_ATTENUATION = (1.0, 0.0, 0.0)


def read_lights(node: Node, transform: Transform) -> list[Light]:
    """Read a light and its ambient light; return an empty list if it is off or cannot be read.

    Directional lights are in the world frame, regardless of parent nodes; others in the frame of their node.
    """
    try:
        return _lights(node, transform) if node.flag("on", True) else []
    except WarpvisError:  # does not affect depth
        return []


def _lights(node: Node, transform: Transform) -> list[Light]:
    kind, name = LIGHTS[node.type], node.name or ""
    color = linear_color(np.clip(node.vector("color", (1.0, 1.0, 1.0)), 0, 1))
    attenuation = tuple(np.maximum(node.vector("attenuation", _NO_ATTENUATION), 0).tolist())
    ambient = max(0.0, node.number("ambientIntensity", 0.0))
    found = []
    if kind == "directional":
        attenuation = _NO_ATTENUATION
    elif attenuation != _NO_ATTENUATION:
        ambient = 0.0  # the reference allows only one of the two
    if ambient:
        added = tuple(ambient * part for part in color)
        found.append(Light("ambient", name, color=(0.0, 0.0, 0.0), ambient=added, color_space="linear"))  # type: ignore[arg-type]
    direction = node.vector("direction", (0.0, 0.0, -1.0))
    outer = float(np.clip(node.number("cutOffAngle", np.pi / 4), 0, np.pi / 2))
    place = transform.offset + transform.linear @ node.vector("location", _LOCATIONS.get(node.type, (0.0, 0.0, 0.0)))
    turned = transform.rotation @ direction if kind == "spot" else direction
    found.append(
        Light(
            kind,
            name,
            tuple(place.tolist()),
            tuple(turned.tolist()) if turned.any() else (0.0, 0.0, -1.0),
            color=color,  # type: ignore[arg-type]
            intensity=max(0.0, node.number("intensity", 1.0)),
            color_space="linear",
            falloff="webots",
            attenuation=attenuation if any(attenuation) else _NO_ATTENUATION,
            reach=np.inf if kind == "directional" else max(0.0, node.number("radius", 100.0)),
            inner_angle=float(np.clip(node.number("beamWidth", np.pi / 2), 0, outer)),
            outer_angle=outer,
            cast_shadow=node.flag("castShadows", False),
        )
    )
    return found


_LOCATIONS = {"SpotLight": (0.0, 0.0, 10.0)}


def read_background(node: Node, up: Literal["z", "y"], find: Callable[[str, Node], Path | None]) -> Background | None:
    """Read a Background; return None if it cannot be read. The sky is skipped unless all six images are available."""
    try:
        colors = node.numbers("skyColor")
        color = np.clip(colors[:3], 0, 1) if len(colors) >= 3 else np.zeros(3)
        luminosity = max(0.0, node.number("luminosity", 1.0))
        urls = [next(iter(node.texts(f"{face}Url")), "") for face in _FACES]
        files = [find(url, node) if url else None for url in urls]
    except WarpvisError:  # does not affect depth
        return None
    sky = tuple(Texture(file) for file in files if file is not None)
    return Background(
        tuple(color.tolist()),
        sky=sky if len(sky) == len(_FACES) else (),
        world_to_cube=_WORLD_TO_CUBE[up],
        luminosity=luminosity,
    )
