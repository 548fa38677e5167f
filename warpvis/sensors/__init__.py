# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What devices make of a scene: lenses."""

from __future__ import annotations

from warpvis.sensors import lenses
from warpvis.sensors._lens_camera import CalibratedCamera as CalibratedCamera, LensCamera, camera_of as camera_of

__all__ = ["LensCamera", "lenses"]
