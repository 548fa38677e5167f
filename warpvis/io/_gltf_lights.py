# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights of glTF files (KHR_lights_punctual)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.scene.lights import Light

LIGHTS = "KHR_lights_punctual"
_KINDS = ("directional", "point", "spot")


def gltf_light(root: Any, node: dict[str, Any], placement: NDArray[np.float64]) -> Light | None:
    """Read the light of a node, which shines along its -z; scale does not affect it. None for nodes without a light.

    Args:
        root: The file's ``extensions``.
        node: The node.
        placement: Matrix from the node to the file's frame, ``(4, 4)``.
    """
    packed = (node.get("extensions") or {}).get(LIGHTS)
    if packed is None:
        return None
    known, number = root[LIGHTS]["lights"], packed["light"]
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < len(known):
        raise ValueError(f"it references light {number!r} of {len(known)}")
    entry = known[number]
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
