# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Orthographic cameras, whose rays are parallel, as for plans and engineering drawings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.base import AnyCamera, planar_struct
from warpvis.cameras.checks import check_numbers, check_size
from warpvis.core.checks import is_number
from warpvis.errors import CameraError

if TYPE_CHECKING:
    from warpvis.kernels.pinhole import PinholeCamera


@dataclass(frozen=True)
class OrthographicCamera(AnyCamera):
    """A camera of parallel rays with OpenCV axes: x right, y down, z forward, the direction of all rays.

    Pixel ``(x, y)`` covers the square from ``(x, y)`` to ``(x + 1, y + 1)``. The camera-frame point ``(X, Y, Z)`` is
    projected to ``(fx X + cx, fy Y + cy)``, and its depth is Z. Surfaces behind the camera's plane are not visible.

    `Renderer` and `render` accept it, and cast it ray by ray.
    """

    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    fx: float
    """Horizontal scale [px/m]."""
    fy: float
    """Vertical scale [px/m]."""
    cx: float
    """Horizontal position of the camera's axis in the image, from the left edge [px]."""
    cy: float
    """Vertical position of the camera's axis in the image, from the top edge [px]."""
    near: float = 0.0
    """Minimum depth [m]; nearer surfaces have depth -inf and still occlude."""
    far: float = math.inf
    """Maximum depth [m]; farther surfaces have depth +inf."""

    kind = "z"
    ray_model: ClassVar[Literal["parallel"]] = "parallel"

    def __post_init__(self) -> None:
        check_numbers(self, "fx and fy must be greater than 0 px/m")

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
        """Create a camera with square pixels whose axis is at the center of the image.

        Args:
            width: Image width [px].
            height: Image height [px].
            across: Width of the visible region [m]. Give either this or `down`.
            down: Height of the visible region [m], as ``fovy`` of MuJoCo's orthographic cameras.
            near: Minimum depth [m].
            far: Maximum depth [m].

        Raises:
            CameraError: If neither or both of `across` and `down` are given, or the given one is not greater than 0.
        """
        width, height = check_size(width, "width"), check_size(height, "height")
        extents = [(size, name, extent) for size, name, extent in ((width, "across", across), (height, "down", down))]
        given_extents = [entry for entry in extents if entry[2] is not None]
        if len(given_extents) != 1:
            raise CameraError("either across or down must be given, in meters")
        size, name, extent = given_extents[0]
        if not is_number(extent) or not 0 < extent < math.inf:
            raise CameraError(f"{name} must be a positive number of meters, got {extent!r}")
        scale = size / extent
        return cls(width, height, scale, scale, width / 2, height / 2, near, far)

    @property
    def rays(self) -> NDArray[np.float64]:
        """Rays of depth 1, shape ``(height, width, 3)``: the camera's axis."""
        return np.broadcast_to([0.0, 0.0, 1.0], (self.height, self.width, 3))

    @property
    def origins(self) -> NDArray[np.float64]:
        """Ray origins in the camera's plane [m], shape ``(height, width, 3)``."""
        y, x = np.mgrid[: self.height, : self.width] + 0.5
        return np.stack([(x - self.cx) / self.fx, (y - self.cy) / self.fy, np.zeros_like(x)], axis=-1)

    def pixel_size(self) -> tuple[float, float]:
        """Return the width and the height of a pixel [m]."""
        return 1 / self.fx, 1 / self.fy

    def device_struct(self, *, clip_near: bool = False) -> PinholeCamera:
        """Return the camera in the format of `warpvis.kernels.casting.orthographic`; `clip_near` as for `ray_range`."""
        return planar_struct(self, math.inf, self.near if clip_near else 0.0)
