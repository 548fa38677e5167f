# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Wide-angle cameras, up to 360 degrees: cylindrical and spherical (fisheye) projections."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.checks import check_range, check_size
from warpvis.cameras.ray_camera import MAX_RAYS, RayCamera
from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_choice, degrees_hint, is_number
from warpvis.errors import CameraError

Projection = Literal["cylindrical", "spherical"]

# Two pi, rounded to four decimals as in files.
_MAX_HFOV = 6.2832


@dataclass(frozen=True)
class WideCamera(RayCamera):
    """A wide-angle camera with one ray through the center of every pixel, in equal steps of angle.

    `Renderer` and `render` accept it. With u to the right and v downwards from the image's center, both from -1/2 to
    1/2 from border to border:

    * ``"cylindrical"``: the ray's azimuth is ``u * hfov`` to the right, its elevation ``v * hfov * height / width``
      downwards. Columns are equally spaced meridians and rows are equally spaced parallels (equirectangular).
    * ``"spherical"``: an equidistant fisheye. The angle between the ray and the camera's axis is
      ``hfov * sqrt(u^2 + v^2)``. It is ``hfov / 2`` at the centers of all four borders, so that an image that is not
      square is stretched, and larger at the corners.

    The formulas also apply to pixels with an angle of more than pi to the axis, or more than pi / 2 above or below the
    horizon: their rays go over the pole. These are the projections of Webots cameras (its shader
    ``merge_spherical.frag``).

    Depth is the *length* of the ray from the camera to the surface [m].
    """

    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    hfov: float
    """Horizontal field of view [rad], up to 2 pi."""
    projection: Projection = "cylindrical"
    """``"cylindrical"`` or ``"spherical"``."""
    near: float = 0.0
    """Minimum length of a ray [m]; nearer surfaces have depth -inf and still occlude."""
    far: float = math.inf
    """Maximum length of a ray [m]; farther surfaces have depth +inf."""

    kind = "range"
    usage_hint = "wv.render accepts it, and renders points and labels"

    def __post_init__(self) -> None:
        check_choice(self.projection, "projection", get_args(Projection), CameraError)
        for name in ("width", "height"):
            object.__setattr__(self, name, check_size(getattr(self, name), name))
        if self.width * self.height > MAX_RAYS:
            raise CameraError(f"width x height must be at most {MAX_RAYS} rays, got {self.width} x {self.height}")
        if not is_number(self.hfov):
            raise CameraError(f"hfov must be a number, got {self.hfov!r}")
        if not 0 < self.hfov <= _MAX_HFOV:
            hint = degrees_hint(self.hfov)
            raise CameraError(f"hfov must be more than 0 and at most 2 pi radians, got {self.hfov}{hint}")
        object.__setattr__(self, "hfov", float(self.hfov))
        check_range(self)

    @property
    def rays(self) -> NDArray[np.float64]:
        """Unit vectors through the centers of all pixels, shape ``(height, width, 3)``."""
        return self._directions(np.arange(self.width) + 0.5, (np.arange(self.height) + 0.5)[:, None])

    def rays_at(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return unit vectors through image points [px], shape ``(..., 2)``; NaN outside the image.

        Raises:
            WarpvisError: If `pixels` is not a numeric array of this shape.
        """
        points = as_numpy(pixels, name="pixels").astype(np.float64)
        if points.shape[-1:] != (2,):
            raise CameraError(f"pixels must have shape (..., 2), got {points.shape}")
        x, y = np.moveaxis(points, -1, 0)
        inside = (x >= 0) & (x < self.width) & (y >= 0) & (y < self.height)
        return self._directions(np.where(inside, x, np.nan), np.where(inside, y, np.nan))

    def _directions(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.float64]:
        u, v = x / self.width - 0.5, y / self.height - 0.5
        if self.projection == "spherical":
            angle = self.hfov * np.hypot(u, v)
            scale = self.hfov * np.sinc(angle / math.pi)  # sin(away) / hypot(u, v)
            parts = scale * u, scale * v, np.cos(angle)
        else:
            azimuth, elevation = u * self.hfov, v * (self.hfov * self.height / self.width)
            horizontal = np.cos(elevation)
            parts = horizontal * np.sin(azimuth), np.sin(elevation), horizontal * np.cos(azimuth)
        return np.stack(np.broadcast_arrays(*parts), axis=-1)
