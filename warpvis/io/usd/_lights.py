# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights of UsdLux, at an exposure that shows a white surface lit by all of them as white.

UsdLux has luminance in nits and no exposure of a camera, so only the lights' ratios are meaningful in a picture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom, UsdLux

from warpvis.core.checks import describe_exception, truncate
from warpvis.io.usd._appearances import open_asset
from warpvis.scene import Part
from warpvis.scene.lights import Background, Light, read_light
from warpvis.scene.materials import Texture

_AREA = ("SphereLight", "DiskLight", "RectLight", "CylinderLight")
_DOMES = ("DomeLight", "DomeLight_1")
_MAX_POINTS = 200_000

# Directions of the sky's frame (x is the center of the image, z is up) in the dome's frame, whose pole is y, or z.
_POLE_Y = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
_POLE_Z = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def read_lights(
    prims: Sequence[tuple[Any, NDArray[np.float64]]], meters: float, time: Any, parts: Sequence[Part]
) -> tuple[list[Light], Background | None, list[str]]:
    """Read the lights of a stage.

    Args:
        prims: Their prims and matrices to the stage in meters.
        meters: The stage's unit [m].
        time: Time at which they are read.
        parts: Parts of the stage; the exposure is that of the center of their bounds.

    Returns:
        The lights, the background, and what is not read.
    """
    lights: list[Light] = []
    background, notes = None, list[str]()
    for prim, matrix in prims:
        kind = str(prim.GetTypeName())
        try:
            if kind == "DistantLight":
                lights.append(_distant(prim, matrix, time))
            elif kind in _AREA:
                lights.append(_area(prim, kind, matrix, meters, time))
            elif kind in _DOMES:
                light, sky = _dome(prim, kind, matrix, time)
                lights.append(light)
                background = background or sky
            else:
                notes.append(f"{kind} <{prim.GetPath()}>")
        except Exception as error:  # malformed files may raise any exception
            notes.append(f"{kind} <{prim.GetPath()}> ({truncate(describe_exception(error))})")
    return *_exposed([light for light in lights if light.intensity > 0], background, parts), notes


def _exposed(
    lights: list[Light], background: Background | None, parts: Sequence[Part]
) -> tuple[list[Light], Background | None]:
    """Scale all lights so that a white surface at the center, facing each of them, has the display value 1."""
    center = _center(parts)
    total = 0.0
    for light in lights:
        brightest = max(light.color) if light.kind != "ambient" else max(light.ambient) * math.pi
        strength = float(light.strength(center)) if light.kind != "spot" else _unaimed(light, center)
        total += light.intensity * brightest * min(strength, 1e12)
    if not 0 < total < math.inf:
        return lights, background
    factor = math.pi / total
    exposed = [replace(light, intensity=light.intensity * factor) for light in lights]
    if background is not None:
        background = replace(background, exposure=background.exposure * factor)
    return exposed, background


def _unaimed(light: Light, point: NDArray[np.float64]) -> float:
    """Return the strength of a spot as if it were aimed at a point."""
    aim = point - np.array(light.position)
    return float(replace(light, direction=tuple(aim) if np.linalg.norm(aim) > 0 else (0, 0, -1)).strength(point))


def _center(parts: Sequence[Part]) -> NDArray[np.float64]:
    """Return the mean position of the parts' origins, about the center of the stage."""
    poses = [part.pose[:3] for part in parts[:_MAX_POINTS] if part.pose is not None]
    if not poses:
        return np.zeros(3)
    rows = np.array(poses)
    return (rows.min(axis=0) + rows.max(axis=0)) / 2


def _emission(prim: Any, time: Any) -> tuple[tuple[float, float, float], float]:
    """Return the color and the luminance of a light [nt], before it is normalized by its size."""
    api = UsdLux.LightAPI(prim)
    color = np.array(api.GetColorAttr().Get(time), dtype=np.float64)
    if api.GetEnableColorTemperatureAttr().Get(time):
        color *= np.array(UsdLux.BlackbodyTemperatureAsRgb(api.GetColorTemperatureAttr().Get(time)))
    intensity = float(api.GetIntensityAttr().Get(time)) * 2.0 ** float(api.GetExposureAttr().Get(time))
    intensity *= float(api.GetDiffuseAttr().Get(time))
    if not (np.isfinite(color).all() and math.isfinite(intensity)):
        raise ValueError("its color and intensity must be finite")
    red, green, blue = np.maximum(color, 0.0).tolist()
    return (red, green, blue), max(intensity, 0.0)


def _normalizes(prim: Any, time: Any) -> bool:
    return bool(UsdLux.LightAPI(prim).GetNormalizeAttr().Get(time))


def _direction(matrix: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = (-matrix[:3, 2]).tolist()
    return x, y, z


def _position(matrix: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = matrix[:3, 3].tolist()
    return x, y, z


def _casts_shadow(prim: Any, time: Any) -> bool:
    shadow = UsdLux.ShadowAPI(prim).GetShadowEnableAttr()
    return shadow.Get(time) is not False if shadow else True


def _distant(prim: Any, matrix: NDArray[np.float64], time: Any) -> Light:
    """Read a distant light, whose illuminance is its luminance times the projected solid angle of its disk."""
    color, intensity = _emission(prim, time)
    half = math.radians(float(UsdLux.DistantLight(prim).GetAngleAttr().Get(time))) / 2
    if half > 0 and not _normalizes(prim, time):
        intensity *= math.pi * math.sin(half) ** 2
    return Light(
        "directional",
        str(prim.GetPath()),
        direction=_direction(matrix),
        color=color,
        intensity=intensity,
        color_space="linear",
        falloff="gltf",
        radius=min(half, 1.5),
        cast_shadow=_casts_shadow(prim, time),
    )


def _area(prim: Any, kind: str, matrix: NDArray[np.float64], meters: float, time: Any) -> Light:
    """Read a light with a surface as a point or spot of the same luminous intensity, in the direction of its axis."""
    color, luminance = _emission(prim, time)
    scales = np.linalg.norm(matrix[:3, :3], axis=0)  # meters per unit along its axes
    get = {name: prim.GetAttribute(f"inputs:{name}") for name in ("radius", "width", "height", "length")}
    size = {name: float(item.Get(time)) for name, item in get.items() if item and item.Get(time) is not None}
    if kind == "RectLight":
        projected = area = size["width"] * scales[0] * size["height"] * scales[1]
    elif kind == "DiskLight":
        projected = area = math.pi * size["radius"] ** 2 * scales[0] * scales[1]
    elif kind == "SphereLight":
        radius = size["radius"] * float(scales.mean())
        projected, area = math.pi * radius**2, 4 * math.pi * radius**2
    else:
        radius, length = size["radius"] * float(scales[1:].mean()), size["length"] * scales[0]
        projected, area = 2 * radius * length, 2 * math.pi * radius * length
    point = kind == "SphereLight" and bool(UsdLux.SphereLight(prim).GetTreatAsPointAttr().Get(time))
    intensity = luminance * projected
    if _normalizes(prim, time):  # by the area in the stage's unit
        intensity = luminance * (projected / area if area > 0 else 0.25) * meters**2
    shaped = "ShapingAPI" in prim.GetAppliedSchemas()
    cone = float(UsdLux.ShapingAPI(prim).GetShapingConeAngleAttr().Get(time)) if shaped else 90.0
    soft = float(UsdLux.ShapingAPI(prim).GetShapingConeSoftnessAttr().Get(time)) if shaped else 0.0
    flat = kind in ("RectLight", "DiskLight")
    outer = math.radians(min(max(cone, 0.0), 90.0 if flat else 180.0))
    is_spot = flat or (shaped and cone < 90.0)
    return Light(
        "spot" if is_spot else "point",
        str(prim.GetPath()),
        position=_position(matrix),
        direction=_direction(matrix),
        color=color,
        intensity=intensity,
        color_space="linear",
        falloff="opengl" if flat else "gltf",
        attenuation=(0.0, 0.0, 1.0),
        inner_angle=outer * (1 - min(max(soft, 0.0), 1.0)),
        outer_angle=outer,
        exponent=1.0 if flat else 0.0,
        radius=0.0 if point else math.sqrt(projected / math.pi),
        cast_shadow=_casts_shadow(prim, time),
    )


def _dome(prim: Any, kind: str, matrix: NDArray[np.float64], time: Any) -> tuple[Light, Background | None]:
    """Read a dome as ambient light of its mean luminance; its texture is the background."""
    color, intensity = _emission(prim, time)
    source = prim.GetAttribute("inputs:texture:file").Get(time)
    sky = None
    if source is not None and source.path:
        path = str(source.resolvedPath)
        if not path:
            raise ValueError(f"its texture {source.path!r} was not found")
        file = open_asset(path)
        if path.lower().endswith((".hdr", ".exr")):
            panorama = read_light(path)
            mean = _mean(panorama)
            sky = Background(panorama=(panorama * np.array(color)).astype(np.float32), exposure=intensity)
        else:
            texture = Texture(file, source.path, color_space="srgb")
            mean = _mean((texture.image[..., :3] / 255.0) ** 2.2)
            sky = Background(panorama=texture)
        color = tuple((np.array(color) * mean).tolist())
        axes = _POLE_Z if kind == "DomeLight_1" and _pole(prim) == "Z" else _POLE_Y
        rotation = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
        first, second, third = (tuple(row) for row in (axes @ rotation.T).tolist())
        sky = replace(sky, world_to_cube=(first, second, third))
    ambient = Light(
        "ambient",
        str(prim.GetPath()),
        color=(0.0, 0.0, 0.0),
        ambient=color,
        intensity=intensity,
        color_space="linear",
        falloff="gltf",
    )
    return ambient, sky


def _pole(prim: Any) -> str:
    """Return the axis of a dome's pole."""
    pole = str(prim.GetAttribute("poleAxis").Get())
    return str(UsdGeom.GetStageUpAxis(prim.GetStage())) if pole == "scene" else pole


def _mean(panorama: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the mean color of all directions of a panorama."""
    height = np.cos((np.arange(len(panorama)) + 0.5) / len(panorama) * np.pi - np.pi / 2)
    return (panorama.mean(axis=1) * height[:, None]).sum(axis=0) / height.sum()
