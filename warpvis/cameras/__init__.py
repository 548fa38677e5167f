# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras: lenses, ray bundles, panoramas and orthographic images. The pinhole camera is `warpvis.Camera`."""

from __future__ import annotations

from warpvis.cameras import lenses
from warpvis.cameras.base import AnyCamera
from warpvis.cameras.image_cameras import (
    ImageCamera as ImageCamera,
    as_pinhole as as_pinhole,
    camera_from_dict as camera_from_dict,
    opencv_intrinsics as opencv_intrinsics,
    require_image_camera as require_image_camera,
)
from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.cameras.parameters import (
    origin_jacobian,
    parameter_names,
    parameter_values,
    ray_jacobian,
    with_parameters,
)
from warpvis.cameras.rays import RayCamera, Rays, WideCamera

__all__ = [
    "AnyCamera",
    "LensCamera",
    "OrthographicCamera",
    "RayCamera",
    "Rays",
    "WideCamera",
    "lenses",
    "origin_jacobian",
    "parameter_names",
    "parameter_values",
    "ray_jacobian",
    "with_parameters",
]
