# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights of glTF files: punctual lights of nodes, and the image-based light of a scene as ambient light."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception, truncate
from warpvis.io._gltf_data import GltfData
from warpvis.scene.lights import Light

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
        scene = data.one("scenes", data.get("scene", 0)) if data.all("scenes") else {}
        packed = (scene.get("extensions") or {}).get(_IMAGE_BASED)
        if packed is None:
            return []
        entry = _entry(_extensions(data)[_IMAGE_BASED]["lights"], packed["light"])
        constant = np.array(entry["irradianceCoefficients"], dtype=np.float64).reshape(9, 3)[0]
        color = np.maximum(constant * (_CONSTANT_HARMONIC / np.pi), 0.0) * float(entry.get("intensity", 1.0))
        name = str(entry.get("name") or "image-based light")
        ambient = tuple(color.tolist())
        return [Light("ambient", name, color=(0.0, 0.0, 0.0), ambient=ambient, color_space="linear", falloff="gltf")]
    except Exception as error:  # malformed files may raise any exception
        unlit.append(f"the scene ({truncate(describe_exception(error))})")
        return []


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
