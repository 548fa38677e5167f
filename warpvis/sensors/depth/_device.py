# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What models of devices have in common: surfaces that reflect, and a camera of their own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import warp as wp

from warpvis.core.camera import Camera
from warpvis.core.checks import is_number
from warpvis.errors import CameraError
from warpvis.rendering import DepthSensor, Exposure
from warpvis.scene import Scene
from warpvis.sensors._echoes import Reflectivity, reflectivities


@dataclass(frozen=True)
class Device(DepthSensor):
    """A model of a device that one can buy, which sees a surface by the light that comes back of it."""

    reflectivity: Reflectivity = field(default=1.0, kw_only=True)
    """Of all objects; by their names, 1 for others; or of each, in the scene's order: from 0 (black) to 1."""
    native_camera: Camera | None = field(default=None, kw_only=True)
    """The camera that the device has: what `camera` returns. Depth keeps to its range through any other camera."""

    def __post_init__(self) -> None:
        if self.native_camera is not None and not isinstance(self.native_camera, Camera):
            raise CameraError(f"native_camera must be a warpvis.Camera, got {self.native_camera!r}")

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Which images of the first surface are read, to know what comes back of it."""
        plain = is_number(self.reflectivity) and self.reflectivity == 1.0
        return ("normals",) if plain else ("normals", "segmentation")

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera with the range of depth that it and the device have in common.

        Raises:
            WarpvisError: If the sensor is not a model of such a camera, or there is no such range.
        """
        reflectivities(scene, self.reflectivity)
        return super().check(scene, camera)

    def reflectivity_of_objects(self, exposure: Exposure) -> wp.array:
        """Return the reflectivity of every object of the scene, on its device, ``(objects,)``."""
        shares = reflectivities(exposure.scene, self.reflectivity)
        return wp.array(shares, dtype=wp.float32, device=exposure.scene.device)
