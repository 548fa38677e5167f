# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras: lenses, ray bundles, panoramas and orthographic images. The pinhole camera is `warpvis.Camera`."""

from __future__ import annotations

from warpvis.cameras import lenses
from warpvis.cameras.base import AnyCamera
from warpvis.cameras.fields import (
    lens_camera_from_fields as lens_camera_from_fields,
    lens_camera_to_fields as lens_camera_to_fields,
    opencv_intrinsics as opencv_intrinsics,
)
from warpvis.cameras.image_cameras import (
    CalibratedCamera as CalibratedCamera,
    require_calibrated as require_calibrated,
)
from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.cameras.ray_camera import RayCamera
from warpvis.cameras.rays import Rays
from warpvis.cameras.wide import WideCamera

__all__ = ["AnyCamera", "LensCamera", "OrthographicCamera", "RayCamera", "Rays", "WideCamera", "lenses"]
