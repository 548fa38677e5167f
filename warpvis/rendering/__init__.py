# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Turn poses into images: depth, points, normals, labels and segmentation, by two casters on CPU and CUDA.

`packets` is the fast caster, `rays` the reference. `render_wide` makes cylindrical and spherical images, and an
`OrthographicCamera` images without perspective.
"""

from __future__ import annotations

from warpvis.rendering._along import render_along as render_along
from warpvis.rendering._orthographic import AnyCamera, OrthographicCamera
from warpvis.rendering._panorama import render_wide
from warpvis.rendering._renderer import (
    Caster,
    Fill,
    NearPlane,
    Output,
    Renderer as Renderer,
    render as render,
)
from warpvis.rendering._views import (
    OUTPUTS,
    Views as Views,
    check_outputs as check_outputs,
    views_for as views_for,
)

__all__ = [
    "OUTPUTS",
    "AnyCamera",
    "Caster",
    "Fill",
    "NearPlane",
    "OrthographicCamera",
    "Output",
    "render_wide",
]
