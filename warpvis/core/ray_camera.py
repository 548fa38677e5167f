# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What cameras are whose pixels have rays of their own, for those who render through them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Literal

from warpvis.errors import CameraError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from warpvis.core.poses import Convention
    from warpvis.kernels.ray_table import RayRange

DepthKind = Literal["z", "range"]
"""What depth is: along the camera's axis, or along the ray."""

MOST_RAYS = 2**26
"""So many rays may one camera have: they take 1.6 GB."""


class RayCamera(ABC):
    """A camera whose pixels have rays of their own.

    Subclasses have `width`, `height` [px], `near`, `far` [m], and `kind`, what depth is. Those that say nothing else
    have OpenCV axes, rays that all start at one point, and images of that width and height.
    """

    axes: Convention = "opencv"
    width: int
    height: int
    near: float
    far: float
    kind: DepthKind | None

    @property
    @abstractmethod
    def rays(self) -> NDArray[np.float64]:
        """Rays of all pixels, of depth 1, shape ``(*shape, 3)``; NaN where a pixel has none."""

    @property
    def origins(self) -> NDArray[np.float64] | None:
        """Where these rays start in the camera frame [m], of the same shape; None for its origin."""
        return None

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of one view's images: height and width, or of a list of rays their number."""
        return self.height, self.width

    def rays_at(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays through points of the image [px], shape ``(..., 2)``, likewise; NaN outside of it.

        Raises:
            CameraError: Between its rays the camera has no image.
        """
        raise CameraError(
            f"render_at is for points of an image, and {type(self).__name__} are rays without anything between them: "
            "render other Rays"
        )

    def device_struct(self, *, clip_near: bool = False) -> RayRange:
        """Return the camera's range as `warpvis.kernels.ray_table` takes it.

        Args:
            clip_near: Whether what is nearer than `near` is not there, instead of hiding what is behind it.
        """
        from warpvis.kernels.ray_table import RayRange

        struct = RayRange()
        struct.near, struct.far, struct.is_planar = self.near, self.far, self.kind == "z"
        struct.clip = self.near if clip_near else 0.0
        return struct


class LensedCamera(RayCamera):
    """A `RayCamera` whose rays come from a lens, so that points of the world have places in its image."""

    lens: Any
    """What maps directions to points of the image; equal lenses have equal images."""

    @abstractmethod
    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project camera-frame points [m], shape ``(..., 3)``, to ``(x, y)`` of the image [px]; NaN if nowhere."""

    @abstractmethod
    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Find the unit vectors that points ``(x, y)`` of the image [px] show; NaN where none has that image."""

    @abstractmethod
    def canvas_rays(self, canvas: tuple[int, int, int, int]) -> NDArray[np.float64]:
        """Return rays as `rays` has them, through so many pixels more at the left, top, right and bottom."""
