# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights and background of a Webots world, and the ambient light of its background.

Webots converts the colors of lights and materials to linear RGB (src/wren/LightNode.cpp) and sums light in that space.
Fields and their defaults are those of its reference: light.md, directionallight.md, pointlight.md, spotlight.md, and
background.md. Its two models of materials have different ambient light: that of a PBRAppearance is the light of the
Background's images, or else its `skyColor`, times its `luminosity` (resources/wren/shaders/pbr.frag); that of an
Appearance is the `ambientIntensity` of the lights (phong.frag). A scene here has one, that of the more frequent model.
Irradiance images, in Radiance's format, replace the Background's images as light (src/webots/nodes/WbBackground.cpp).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import FileFormatError, WarpvisError
from warpvis.scene.lights import Background, Light, LightKind, read_light
from warpvis.scene.materials import Texture, linear_color
from warpvis.webots._nodes import Node, Transform, Value, new_node

LIGHTS: dict[str, LightKind] = {"DirectionalLight": "directional", "PointLight": "point", "SpotLight": "spot"}

_SKY_FACES = ("right", "left", "top", "bottom", "front", "back")
"""Faces of a background, in the order of OpenGL's cube maps (src/webots/nodes/WbBackground.cpp)."""

# The shader samples (x, y, -z), resources/wren/shaders/skybox.frag. For worlds with z up, WbBackground.cpp swaps and
# rotates the images (gCoordinateSystemSwap, gCoordinateSystemRotate), which is equivalent to rotating the world.
_WORLD_TO_CUBE = {
    "y": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    "z": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)),
}

_WORLD_TO_GRADIENT = {
    "y": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}

Irradiance = tuple[Path, ...] | tuple[float, ...]
"""Irradiance images of a background, or their mean linear color, or empty."""

_NO_ATTENUATION = (1.0, 0.0, 0.0)
_LOCATIONS = {"SpotLight": (0.0, 0.0, 10.0)}
_THUMBNAIL = (32, 32)  # pixels of an image whose mean is taken

_Row = tuple[tuple[float, float, float], tuple[float, float, float], float]

# Direction with y up, color and intensity of the light that TexturedBackgroundLight.proto of R2023b defines for a
# texture; textures without a row have no light.
_LIGHT_OF_TEXTURE: dict[str, _Row] = {
    "dawn_cloudy_empty": ((0.022, -0.12, -1), (1.0, 0.75, 0.5), 0.8),
    "dusk": ((-1.2, -0.3, -0.6), (1.0, 0.95, 0.8), 0.5),
    "empty_office": ((-0.2, -0.5, -0.9), (1.0, 1.0, 1.0), 0.05),
    "mars": ((0, -1, 0), (0.83, 0.83, 0.75), 1.0),
    "morning_cloudy_empty": ((1, -0.8, -0.1), (1.0, 0.75, 0.5), 0.9),
    "mountains": ((-0.6, -1, 0.55), (1.0, 1.0, 1.0), 2.7),
    "music_hall": ((-0.78, -0.6, -0.17), (0.9, 0.9, 1.0), 0.5),
    "noon_cloudy_countryside": ((-0.3, -1, -0.1), (0.95, 0.95, 1.0), 3.0),
    "noon_cloudy_empty": ((0.2, -1, 0.2), (0.9, 0.9, 1.0), 1.0),
    "noon_cloudy_mountains": ((0, -1, -0.5), (0.9, 0.9, 1.0), 0.9),
    "noon_park_empty": ((-0.023, -1, -0.08), (0.996, 1.0, 0.92), 3.5),
    "noon_stormy_empty": ((0.1, -1, 0.2), (0.9, 0.9, 1.0), 0.8),
    "noon_sunny_empty": ((0.9, -0.59, 0.28), (1.0, 1.0, 1.0), 1.0),
    "noon_sunny_garden": ((-0.1, -0.3, 0.3), (0.9, 0.9, 1.0), 1.0),
    "stadium": ((-2.1, -0.5, 2.1), (0.95, 0.95, 1.0), 2.9),
    "stadium_dry": ((-2.1, -0.5, 2.1), (0.95, 0.95, 1.0), 2.9),
    "twilight_cloudy_empty": ((1, -0.2, -0.7), (1.0, 0.75, 0.5), 1.8),
}
# Mean colors of the images of TexturedBackground (sRGB), estimated by eye, used if the images are not available.
_SKY_OF_TEXTURE = {
    "dawn_cloudy_empty": (0.6, 0.52, 0.48),
    "dusk": (0.5, 0.44, 0.42),
    "empty_office": (0.62, 0.6, 0.57),
    "entrance_hall": (0.55, 0.5, 0.44),
    "factory": (0.6, 0.6, 0.57),
    "mars": (0.68, 0.55, 0.43),
    "music_hall": (0.5, 0.46, 0.41),
    "noon_stormy_empty": (0.45, 0.48, 0.52),
    "twilight_cloudy_empty": (0.55, 0.48, 0.48),
}
_NOON = (0.58, 0.63, 0.68)
# Colors of their sky from straight up to straight down (sRGB), estimated by eye; textures of rooms have one color.
_GRADIENTS = {
    "dusk": ((0.3, 0.35, 0.5), (0.45, 0.45, 0.52), (0.75, 0.55, 0.42), (0.3, 0.26, 0.23), (0.27, 0.24, 0.21)),
    "mars": ((0.68, 0.55, 0.43), (0.7, 0.56, 0.43), (0.74, 0.58, 0.43), (0.56, 0.38, 0.26), (0.52, 0.35, 0.24)),
    "mountains": ((0.42, 0.5, 0.68), (0.42, 0.48, 0.62), (0.36, 0.39, 0.43), (0.36, 0.36, 0.32), (0.36, 0.36, 0.32)),
    "noon_park_empty": ((0.55, 0.68, 0.85), (0.6, 0.7, 0.8), (0.42, 0.5, 0.34), (0.4, 0.48, 0.3), (0.4, 0.48, 0.3)),
    "noon_stormy_empty": ((0.32, 0.36, 0.42), (0.42, 0.46, 0.5), (0.58, 0.6, 0.62), (0.3, 0.31, 0.32), (0.26,) * 3),
    **dict.fromkeys(
        ("dawn_cloudy_empty", "morning_cloudy_empty", "twilight_cloudy_empty"),
        ((0.4, 0.43, 0.55), (0.55, 0.5, 0.55), (0.82, 0.64, 0.5), (0.33, 0.29, 0.27), (0.3, 0.27, 0.25)),
    ),
}
_NOON_GRADIENT = ((0.38, 0.55, 0.82), (0.55, 0.68, 0.85), (0.78, 0.83, 0.87), (0.45, 0.45, 0.42), (0.4, 0.4, 0.36))
_ROOMS = ("cinema_lobby", "empty_office", "entrance_hall", "factory", "music_hall")
# Mean linear light of irradiance images, fitted to matt surfaces in published pictures of worlds by Webots.
_IRRADIANCE = {
    "empty_office": (0.33, 0.33, 0.32),
    "entrance_hall": (1.25, 1.05, 0.78),
    "factory": (0.75, 0.75, 0.72),
    "music_hall": (0.65, 0.6, 0.52),
}
# Textures for which TexturedBackground.proto has irradiance images.
_HDR_TEXTURES = (
    *("cinema_lobby", "dusk", "empty_office", "entrance_hall", "factory", "mars", "noon_building_overcast"),
    *("noon_cloudy_countryside", "noon_park_empty", "mountains", "stadium", "stadium_dry"),
)
_IMAGES = "webots://projects/default/worlds/textures/cubic"


def expand_background(node: Node, up: Literal["z", "y"]) -> Node:
    """Build the Background of a TexturedBackground, or the DirectionalLight of a TexturedBackgroundLight.

    Other nodes are returned unchanged. The images are those of a Webots installation or of its download cache; without
    them, the color is an estimate of their mean.
    """
    if node.type not in ("TexturedBackground", "TexturedBackgroundLight"):
        return node
    try:
        texture = node.text("texture", "mountains")
        luminosity = max(0.0, node.number("luminosity", 1.0))
        casts, has_sky = node.flag("castShadows", True), node.flag("skybox", True)
        reflects = node.flag("reflections", True)
        colors = node.numbers("skyColor")
    except WarpvisError:  # does not affect depth
        texture, luminosity, colors = "mountains", 1.0, np.zeros(0)
        casts = has_sky = reflects = True
    if node.type == "TexturedBackground":
        sky = _SKY_OF_TEXTURE.get(texture, _NOON) if has_sky else (*colors, 0.0, 0.0, 0.0)[:3]
        background: dict[str, Value] = {"skyColor": [*map(float, sky)], "luminosity": [luminosity]}
        for face in _SKY_FACES if has_sky else ():
            base = "stadium" if (texture, face) == ("stadium_dry", "top") else texture
            background[f"{face}Url"] = [f"{_IMAGES}/{base}_{face}.jpg"]
        for face in _SKY_FACES if reflects and texture in _HDR_TEXTURES else ():
            background[f"{face}IrradianceUrl"] = [f"{_IMAGES}/{texture}_{face}.hdr"]
        return new_node(node, "Background", background, node.name)
    (x, y, z), color, intensity = _LIGHT_OF_TEXTURE.get(texture, ((0, -1, 0), (1.0, 1.0, 1.0), 0.0))
    direction = (z, x, y) if up == "z" else (x, y, z)
    fields: dict[str, Value] = {
        "ambientIntensity": [1.0],
        "direction": [*map(float, direction)],
        "color": [*color],
        "intensity": [luminosity * intensity],
        "on": [texture in _LIGHT_OF_TEXTURE],
        "castShadows": [casts],
    }
    return new_node(node, "DirectionalLight", fields, node.name)


def stand_in_sky(node: Node, background: Background, up: Literal["z", "y"]) -> tuple[Background, Irradiance]:
    """Return the background of a TexturedBackground without images, with a gradient, and an estimate of its light.

    The estimate is empty if the color of the background is the best one.
    """
    try:
        texture = node.text("texture", "mountains")
        has_sky, reflects = node.flag("skybox", True), node.flag("reflections", True)
    except WarpvisError:  # does not affect depth
        return background, ()
    if has_sky and texture not in _ROOMS:
        gradient = _GRADIENTS.get(texture, _NOON_GRADIENT)
        background = replace(background, gradient=gradient, world_to_cube=_WORLD_TO_GRADIENT[up])
    light: Irradiance = _IRRADIANCE.get(texture, ())
    if not (light or has_sky) and texture in _HDR_TEXTURES:
        light = linear_color(_SKY_OF_TEXTURE.get(texture, _NOON))
    return background, light if reflects else ()


def scene_lights(
    lights: Sequence[Light], background: Background | None, irradiance: Irradiance, *, is_pbr: bool
) -> tuple[Light, ...]:
    """Return the lights of a scene whose materials are PBRAppearances (`is_pbr`) or Appearances.

    `irradiance` are the irradiance images of the background, an estimate of their mean linear color, or empty.
    """
    if not is_pbr:
        return tuple(lights)
    direct = [light for light in lights if light.kind != "ambient"]
    color = (0.0, 0.0, 0.0) if background is None else _mean_radiance(background, irradiance)
    if not any(color):
        return tuple(direct)
    return (Light("ambient", "background", color=(0.0, 0.0, 0.0), ambient=color, color_space="linear"), *direct)


def _mean_radiance(background: Background, irradiance: Irradiance) -> tuple[float, float, float]:
    """Return the mean linear color of irradiance images, or of a background's images, times its luminosity.

    Without readable images, it is that of the background's color.
    """
    color = np.array(linear_color(background.color))
    try:
        files = [item for item in irradiance if isinstance(item, Path)]
        light = [read_light(file).mean(axis=(0, 1), dtype=np.float64) for file in files]
    except FileFormatError:
        light = []
    if irradiance and not files:
        color = np.array(irradiance, dtype=np.float64)
    elif light:
        color = np.mean(light, axis=0)
    elif background.sky:
        try:
            color = np.mean([_mean_color(face.source) for face in background.sky], axis=0)
        except Exception:  # decoders may raise any exception; a warning follows where the sky is used
            color = np.zeros(3)
    return tuple((background.luminosity * color).tolist())


def _mean_color(image: NDArray[np.uint8] | Path | bytes) -> NDArray[np.float64]:
    """Return the mean linear color of an image file, decoded at a low resolution if its format allows it."""
    from PIL import Image

    assert isinstance(image, Path)  # read_background creates it
    with Image.open(image) as file:
        file.draft("RGB", _THUMBNAIL)
        small = np.asarray(file.convert("RGB").resize(_THUMBNAIL, Image.Resampling.BOX)) / 255
    return np.array(linear_color(small)).mean(axis=(0, 1))


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


def read_background(node: Node, up: Literal["z", "y"], find: Callable[[str, Node], Path | None]) -> Background | None:
    """Read a Background; return None if it cannot be read. The sky is skipped unless all six images are available."""
    try:
        colors = node.numbers("skyColor")
        color = np.clip(colors[:3], 0, 1) if len(colors) >= 3 else np.zeros(3)
        luminosity = max(0.0, node.number("luminosity", 1.0))
        urls = [next(iter(node.texts(f"{face}Url")), "") for face in _SKY_FACES]
        files = [find(url, node) if url else None for url in urls]
    except WarpvisError:  # does not affect depth
        return None
    sky = tuple(Texture(file) for file in files if file is not None)
    return Background(
        tuple(color.tolist()),
        sky=sky if len(sky) == len(_SKY_FACES) else (),
        world_to_cube=_WORLD_TO_CUBE[up],
        luminosity=luminosity,
    )


def find_irradiance(node: Node, find: Callable[[str, Node], Path | None]) -> tuple[Path, ...]:
    """Return the six irradiance images of a Background; empty unless all are available."""
    try:
        urls = [next(iter(node.texts(f"{face}IrradianceUrl")), "") for face in _SKY_FACES]
        files = [find(url, node) if url else None for url in urls]
    except WarpvisError:  # does not affect depth
        return ()
    found = tuple(file for file in files if file is not None)
    return found if len(found) == len(_SKY_FACES) else ()
