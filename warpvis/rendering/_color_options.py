# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Options of colors that everything takes that renders colors."""

from __future__ import annotations

from typing import TypedDict

from warpvis.cameras.base import AnyCamera
from warpvis.core.checks import check_flag
from warpvis.rendering._antialiasing import check_samples
from warpvis.rendering._shadows import check_occlusion
from warpvis.scene.lights import AmbientOcclusion


class ColorOptions(TypedDict, total=False):
    """Options of `Renderer` for the output ``"color"``: adapters take them as ``**colors`` and pass them on."""

    shadows: bool
    reflections: bool
    ambient_occlusion: AmbientOcclusion | None
    samples: int


def check_colors(
    camera: AnyCamera | None = None,
    *,
    shadows: bool = True,
    reflections: bool = True,
    ambient_occlusion: AmbientOcclusion | None = None,
    samples: int = 1,
) -> ColorOptions:
    """Return all options with their defaults; raise an error if one is invalid, or for this camera."""
    return {
        "shadows": check_flag(shadows, "shadows"),
        "reflections": check_flag(reflections, "reflections"),
        "ambient_occlusion": check_occlusion(ambient_occlusion),
        "samples": check_samples(samples, camera),
    }
