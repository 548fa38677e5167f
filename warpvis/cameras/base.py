# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of all cameras."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from warpvis.core.poses import Convention
    from warpvis.kernels.casting.rays import RayRange

DepthKind = Literal["z", "range"]
"""Definition of depth: along the axis of the camera, or along the ray."""


class AnyCamera(ABC):
    """A camera: the ray of each pixel, and a range of depth.

    By default, the camera frame has OpenCV axes, rays have a common origin and no times, and the image has `height`
    rows and `width` columns.
    """

    width: int
    height: int
    near: float
    far: float
    kind: DepthKind | None
    axes: Convention = "opencv"
    usage_hint = ""
    """Text for error messages: functions that accept the camera."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the image of one view: height and width, or the number of rays of a list."""
        return self.height, self.width

    @property
    def origins(self) -> NDArray[np.float64] | None:
        """Ray origins in the camera frame [m], with the shape of the rays; None if all are zero."""
        return None

    @property
    def times(self) -> NDArray[np.float64] | None:
        """Time of each ray, after the start of the frame [s], shape ``shape``; None if not given."""
        return None

    def _contains(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Return whether image points [px], shape ``(..., 2)``, are in the image, shape ``(..., 1)``."""
        import numpy as np

        points = np.asarray(pixels)
        inside = (points >= 0) & (points < (self.width, self.height))
        return np.all(inside, axis=-1, keepdims=True)

    def ray_range(self, *, clip_near: bool = False) -> RayRange:
        """Return the range of depth as the struct of kernels that read rays from arrays.

        Args:
            clip_near: Whether surfaces nearer than `near` are transparent, instead of occluding what is behind them.
        """
        from warpvis.kernels.casting.rays import RayRange

        struct = RayRange()
        struct.near, struct.far, struct.is_planar = self.near, self.far, self.kind == "z"
        struct.clip = self.near if clip_near else 0.0
        return struct

    @abstractmethod
    def device_struct(self, *, clip_near: bool = False) -> Any:
        """Return the camera as the struct that its kernels use.

        Args:
            clip_near: Whether surfaces nearer than `near` are transparent, instead of occluding what is behind them.
        """
