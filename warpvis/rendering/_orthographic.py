# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras whose rays are parallel, as of plans and engineering drawings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from warpvis.core.camera import Camera, check_numbers, check_size
from warpvis.core.checks import is_number
from warpvis.core.ray_camera import RayCamera
from warpvis.errors import CameraError

if TYPE_CHECKING:
    from warpvis.kernels.pinhole import PinholeCamera


@dataclass(frozen=True)
class OrthographicCamera:
    """A camera of parallel rays, with OpenCV axes: x right, y down, z forward, which is where all rays go.

    Pixel ``(x, y)`` covers the square from ``(x, y)`` to ``(x + 1, y + 1)``. The camera-frame point ``(X, Y, Z)`` is
    seen at ``(fx X + cx, fy Y + cy)``, and its depth is Z. What lies behind the camera's plane is not seen.

    `Renderer` and `render` take it, and cast it ray by ray.
    """

    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    fx: float
    """Pixels a metre, across the image [px/m]."""
    fy: float
    """Pixels a metre, down the image [px/m]."""
    cx: float
    """Where the camera's axis meets the image, from its left edge [px]."""
    cy: float
    """Where the camera's axis meets the image, from its top edge [px]."""
    near: float = 0.0
    """Least depth [m]; what is nearer reads -inf and still occludes."""
    far: float = math.inf
    """Greatest depth [m]; what is farther reads +inf."""

    def __post_init__(self) -> None:
        check_numbers(self, "pixels a metre must be more than 0")

    @classmethod
    def from_extent(
        cls,
        width: int,
        height: int,
        *,
        across: float | None = None,
        down: float | None = None,
        near: float = 0.0,
        far: float = math.inf,
    ) -> OrthographicCamera:
        """Make a camera of square pixels whose axis meets the image in its middle.

        Args:
            width: Image width [px].
            height: Image height [px].
            across: How much of the world the image's width shows [m]. Give this or `down`.
            down: How much its height shows [m], which is ``fovy`` of MuJoCo's orthographic cameras.
            near: Least depth [m].
            far: Greatest depth [m].

        Raises:
            CameraError: The extent is missing, given twice, or not above 0.
        """
        width, height = check_size(width, "width"), check_size(height, "height")
        given = [(size, name, extent) for size, name, extent in ((width, "across", across), (height, "down", down))]
        asked = [entry for entry in given if entry[2] is not None]
        if len(asked) != 1:
            raise CameraError("give either across or down, in metres")
        size, name, extent = asked[0]
        if not is_number(extent) or not 0 < extent < math.inf:
            raise CameraError(f"{name} must be a number of metres above 0, got {extent!r}")
        scale = size / extent
        return cls(width, height, scale, scale, width / 2, height / 2, near, far)

    def device_struct(self, *, clip_near: bool = False) -> PinholeCamera:
        """Return the camera as `warpvis.kernels.orthographic` takes it.

        Args:
            clip_near: Whether what is nearer than `near` is not there, instead of hiding what is behind it.
        """
        from warpvis.kernels.pinhole import PinholeCamera

        camera = PinholeCamera()
        camera.width, camera.height = self.width, self.height
        camera.fx, camera.fy, camera.cx, camera.cy = self.fx, self.fy, self.cx, self.cy
        camera.near, camera.far = self.near, self.far
        camera.most_inv_z, camera.clip_reach = math.inf, self.near if clip_near else 0.0
        return camera


AnyCamera: TypeAlias = Camera | OrthographicCamera
"""A camera whose pixels are on a plane."""
RenderCamera: TypeAlias = AnyCamera | RayCamera
"""What `Renderer` takes."""
