# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering of depth, points, normals, labels, segmentation, faces and colors, on CPU cores and CUDA.

`packets` is the fast caster, `rays` the reference.
"""

from __future__ import annotations

from warpvis.core.outputs import OUTPUTS, OutputSpec
from warpvis.rendering._along import render_along as render_along
from warpvis.rendering._blindness import (
    seen_objects as seen_objects,
    warn_of_eyes_inside as warn_of_eyes_inside,
    warn_of_units as warn_of_units,
)
from warpvis.rendering._choices import (
    CasterName,
    Fill,
    Lighting,
    NearPlane,
    Output,
    check_fill as check_fill,
    check_output_names as check_output_names,
    choose_caster as choose_caster,
    fill_numbers as fill_numbers,
)
from warpvis.rendering._color_options import ColorOptions as ColorOptions, check_colors as check_colors
from warpvis.rendering._computed import Frame, register_output
from warpvis.rendering._depth_kernels import (
    launch_back_project as launch_back_project,
    launch_classify as launch_classify,
    launch_label_objects as launch_label_objects,
)
from warpvis.rendering._depth_sensor import (
    DepthSensor,
    Exposure,
    TakesLens as TakesLens,
    require_sensor as require_sensor,
)
from warpvis.rendering._panorama import render_wide
from warpvis.rendering._render import render as render
from warpvis.rendering._renderer import Renderer as Renderer
from warpvis.rendering._sensing import (
    check_word as check_word,
    next_frame as next_frame,
    view_numbers as view_numbers,
)
from warpvis.rendering._views import (
    Views as Views,
    as_views as as_views,
    check_outputs as check_outputs,
    pixel_bytes as pixel_bytes,
    pixel_type as pixel_type,
    views_for as views_for,
)
from warpvis.rendering.casters.base import Pool as Pool
from warpvis.rendering.casters.moving import parse_sensor as parse_sensor
from warpvis.rendering.casters.rays import rays_on_device as rays_on_device

__all__ = [
    "OUTPUTS",
    "CasterName",
    "DepthSensor",
    "Exposure",
    "Fill",
    "Frame",
    "Lighting",
    "NearPlane",
    "Output",
    "OutputSpec",
    "register_output",
    "render_wide",
]
