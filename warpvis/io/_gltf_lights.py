# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights of glTF files: punctual lights of nodes, and the image-based light of a scene as ambient light and as sky."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception, truncate
from warpvis.core.poses import poses_to_matrices
from warpvis.core.user_warnings import warn_user
from warpvis.io._gltf_data import GltfData
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Texture, linear_color

_PUNCTUAL, _IMAGE_BASED = "KHR_lights_punctual", "EXT_lights_image_based"
_KINDS = ("directional", "point", "spot")
_CONSTANT_HARMONIC = 0.5 / np.sqrt(np.pi)
"""The first spherical harmonic, which is the same in all directions."""


def node_light(
    data: GltfData, index: int, node: dict[str, Any], placement: NDArray[np.float64], unlit: list[str]
) -> list[Light]:
    """Read the light of a node, which shines along its -z; append to `unlit` if it cannot be read."""
    try:
        packed = (node.get("extensions") or {}).get(_PUNCTUAL)
        return [] if packed is None else [_light(_extensions(data), packed["light"], node, placement)]
    except Exception as error:  # malformed files may raise any exception
        unlit.append(f"node {index} ({truncate(describe_exception(error))})")
        return []


def image_based_light(data: GltfData, unlit: list[str]) -> list[Light]:
    """Read the image-based light of the default scene as ambient light; append to `unlit` if it cannot be read.

    The ambient light is that of the mean irradiance E over all directions, the constant spherical harmonic of the
    irradiance: a Lambertian surface reflects ``base_color * E / pi``. Its direction and reflections are ignored.
    """
    try:
        entry = _environment(data)
        if entry is None:
            return []
        constant = np.array(entry["irradianceCoefficients"], dtype=np.float64).reshape(9, 3)[0]
        color = np.maximum(constant * (_CONSTANT_HARMONIC / np.pi), 0.0) * float(entry.get("intensity", 1.0))
        name = str(entry.get("name") or "image-based light")
        ambient = tuple(color.tolist())
        return [Light("ambient", name, color=(0.0, 0.0, 0.0), ambient=ambient, color_space="linear", falloff="gltf")]
    except Exception as error:  # malformed files may raise any exception
        unlit.append(f"the scene ({truncate(describe_exception(error))})")
        return []


def image_based_sky(file: str, data: GltfData, image: Callable[[Any], tuple[Path | bytes, str]]) -> Background | None:
    """Read the image-based light of the default scene as a sky; None without one, or with a warning if it is invalid.

    The largest of the specular images are those of a cube map as in OpenGL, first row at the top. Colors are divided by
    opacity (RGBD), multiplied by the intensity, and clipped. `image` returns the source of an image and its name.
    """
    try:
        entry = _environment(data)
        if entry is None:
            return None
        rotation = np.array(entry.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
        if rotation.shape != (4,) or not np.isfinite(rotation).all() or not rotation.any():
            raise ValueError("the rotation of a light must be a quaternion")
        faces = [Texture(*image(number)).image for number in entry["specularImages"][0]]
        if len(faces) != 6 or len({face.shape[:2] for face in faces} | {faces[0].shape[1::-1]}) > 1:
            raise ValueError("specularImages must be six squares of equal size")
        intensity = float(entry.get("intensity", 1.0))
        sky = tuple(Texture(_unpacked(face, intensity)) for face in faces)
        rows = poses_to_matrices(np.concatenate([np.zeros(3), rotation / np.linalg.norm(rotation)]))[:3, :3].T
        return Background(sky=sky, world_to_cube=tuple(map(tuple, rows.tolist())))  # type: ignore[arg-type]
    except Exception as error:  # malformed files may raise any exception
        warn_user(f"{file}: left out the sky of the scene ({truncate(describe_exception(error))})", UserWarning)
        return None


def _unpacked(face: NDArray[np.uint8], intensity: float) -> NDArray[np.uint8]:
    """Return an image of a light, times its intensity, as colors in sRGB."""
    light = np.array(linear_color(np.arange(256) / 255))[face[..., :3]] * max(intensity, 0.0)
    if face.shape[2] == 4:
        light /= np.maximum(face[..., 3:], 1) / 255.0
    limits = np.array(linear_color((np.arange(255) + 0.5) / 255))
    return np.searchsorted(limits, light).astype(np.uint8)


def _environment(data: GltfData) -> dict[str, Any] | None:
    """Return the image-based light of the default scene; None without one."""
    scene = data.one("scenes", data.get("scene", 0)) if data.all("scenes") else {}
    packed = (scene.get("extensions") or {}).get(_IMAGE_BASED)
    return None if packed is None else _entry(_extensions(data)[_IMAGE_BASED]["lights"], packed["light"])


def _extensions(data: GltfData) -> Any:
    return data.get("extensions")


def _entry(known: list[dict[str, Any]], number: Any) -> dict[str, Any]:
    """Return a light of a list by its index."""
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < len(known):
        raise ValueError(f"it references light {number!r} of {len(known)}")
    return known[number]


def _light(root: Any, number: Any, node: dict[str, Any], placement: NDArray[np.float64]) -> Light:
    """Read a light (KHR_lights_punctual); scale does not affect it."""
    entry = _entry(root[_PUNCTUAL]["lights"], number)
    kind = entry.get("type")
    if kind not in _KINDS:
        raise ValueError(f"the type of a light must be one of {', '.join(_KINDS)}, got {kind!r}")
    cone = entry.get("spot") or {}
    return Light(
        kind,
        str(entry.get("name") or node.get("name") or ""),
        tuple(placement[:3, 3].tolist()),
        tuple((-placement[:3, 2]).tolist()),
        color=entry.get("color", (1.0, 1.0, 1.0)),
        intensity=entry.get("intensity", 1.0),
        color_space="linear",
        falloff="gltf",
        attenuation=(1.0, 0.0, 0.0) if kind == "directional" else (0.0, 0.0, 1.0),
        reach=np.inf if entry.get("range") is None else entry["range"],
        inner_angle=cone.get("innerConeAngle", 0.0),
        outer_angle=cone.get("outerConeAngle", np.pi / 4),
    )
