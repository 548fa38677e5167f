# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What devices make of a scene: lenses, ray patterns."""

from __future__ import annotations

from warpvis.sensors import lenses
from warpvis.sensors._fields import (
    lens_camera_from_fields as lens_camera_from_fields,
    lens_camera_to_fields as lens_camera_to_fields,
    opencv_intrinsics as opencv_intrinsics,
)
from warpvis.sensors._lens_camera import (
    CalibratedCamera as CalibratedCamera,
    LensCamera,
    camera_of as camera_of,
    require_calibrated as require_calibrated,
)
from warpvis.sensors._rays import Rays

__all__ = ["LensCamera", "Rays", "lenses"]
