# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Base class of models of real devices."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import warp as wp

from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import is_number
from warpvis.errors import CameraError
from warpvis.rendering import DepthSensor, Exposure
from warpvis.scene import Scene
from warpvis.sensors._echoes import Reflectivity, reflectivities


@dataclass(frozen=True)
class Device(DepthSensor):
    """A model of a real device that measures reflected light."""

    reflectivity: Reflectivity = field(default=1.0, kw_only=True)
    """Reflectivity from 0 (black) to 1: one value for all objects, a mapping from object names to values (1 for
    others), or values in scene order."""
    native_camera: Camera | None = field(default=None, kw_only=True)
    """The camera of the device, returned by `camera`. Its range of depth also applies to any other camera."""

    def __post_init__(self) -> None:
        if self.native_camera is not None and not isinstance(self.native_camera, Camera):
            raise CameraError(f"native_camera must be a warpvis.Camera, got {self.native_camera!r}")

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Exact images that are read to compute reflected light."""
        plain = is_number(self.reflectivity) and self.reflectivity == 1.0
        return ("normals",) if plain else ("normals", "segmentation")

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera with its range of depth limited to that of the device.

        Raises:
            WarpvisError: If the sensor cannot be used with the camera, or if the ranges do not overlap.
        """
        reflectivities(scene, self.reflectivity)
        return super().check(scene, camera)

    def reflectivity_of_objects(self, exposure: Exposure) -> wp.array:
        """Return the reflectivity of each object of the scene, on its device, shape ``(objects,)``."""
        values = reflectivities(exposure.scene, self.reflectivity)
        return wp.array(values, dtype=wp.float32, device=exposure.scene.device)
