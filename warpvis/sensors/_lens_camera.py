# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras with lenses: what their pixels show, as depth along the axis or along the ray."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.camera import Camera, check_range, check_size
from warpvis.core.checks import check_choice
from warpvis.core.ray_camera import DepthKind, RayCamera
from warpvis.errors import CameraError, IntrinsicsWarning
from warpvis.sensors.lenses import Lens

# Their rays take 1.6 GB.
_MOST_PIXELS = 2**26


@dataclass(frozen=True)
class LensCamera(RayCamera):
    """A camera with a lens, and OpenCV axes: x right, y down, z forward.

    Pixel ``(x, y)`` covers the square from ``(x, y)`` to ``(x + 1, y + 1)``; its ray goes through the centre at +0.5.
    `Renderer` and `render` take it. Rays come from the lens in double precision, once; nothing is interpolated.
    """

    lens: Lens
    """What maps directions to points of the image: one of `warpvis.sensors.lenses`."""
    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    near: float = 0.0
    """Least depth the camera measures [m]; what is nearer reads -inf and still occludes."""
    far: float = math.inf
    """Greatest depth the camera measures [m]; what is farther reads +inf."""
    kind: DepthKind | None = None
    """What depth is, of which `near` and `far` are too: ``"z"``, along the axis, or ``"range"``, along the ray. By
    default z where all rays are less than 90 degrees from the axis, else range, which wider lenses need."""

    def __post_init__(self) -> None:
        if not isinstance(self.lens, Lens):
            raise CameraError(f"lens must be one of warpvis.sensors.lenses, got {type(self.lens).__name__}")
        for name in ("width", "height"):
            object.__setattr__(self, name, check_size(getattr(self, name), name))
        if self.width * self.height > _MOST_PIXELS:
            raise CameraError(
                f"a LensCamera has a ray for each pixel, of which there may be {_MOST_PIXELS}, got {self.width} x "
                f"{self.height}"
            )
        check_range(self)
        shown = ~self.mask
        if not shown.any():
            raise CameraError("no pixel of the image has a ray: intrinsics are in pixels, of an image of this size")
        ahead = bool((self.directions[shown][:, 2] > 0).all())
        if self.kind is None:
            object.__setattr__(self, "kind", "z" if ahead else "range")
        check_choice(self.kind, "kind", ("z", "range"), CameraError)
        if self.kind == "z" and not ahead:
            count = int((self.directions[shown][:, 2] <= 0).sum())
            raise CameraError(
                f'kind="z" is for what is ahead, and {count} pixels look 90 degrees or more away: "range"'
            )
        self._warn_of_mask()

    def _warn_of_mask(self) -> None:
        count = int(self.mask.sum())
        if count:
            degrees = math.degrees(self.lens.max_angle)
            why = "turns back" if self.lens.turns_back else "ends"
            warnings.warn(
                f"{count} of {self.mask.size} pixels have no ray, since the lens {why} {degrees:.4g} degrees from its "
                "axis: they stay empty, and the camera's mask shows them",
                IntrinsicsWarning,
                stacklevel=4,
            )

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vectors through all pixels' centres, shape ``(height, width, 3)``, read-only; NaN if there is none."""
        return self.lens.directions(self.width, self.height)

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """Which pixels have no ray, shape ``(height, width)``: the lens maps no direction to them."""
        found = np.isnan(self.directions[..., 0])
        found.flags.writeable = False
        return found

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project camera-frame points [m], shape ``(..., 3)``; see `warpvis.sensors.lenses.Lens.project`."""
        return self.lens.project(points)

    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Find the unit vectors that image points show; see `warpvis.sensors.lenses.Lens.unproject`."""
        return self.lens.unproject(pixels)

    @cached_property
    def rays(self) -> NDArray[np.float64]:
        """Rays through all pixels' centres, of depth 1, shape ``(height, width, 3)``; NaN where a pixel has none."""
        return self._of_depth_one(self.directions)

    def rays_at(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays of depth 1 through points of the image [px], shape ``(..., 2)``; NaN outside of it."""
        rays = self._of_depth_one(self.unproject(pixels))
        at = np.asarray(pixels)
        inside = ((at >= 0) & (at < (self.width, self.height))).all(axis=-1, keepdims=True)
        return np.where(inside & (rays[..., 2:] > 0 if self.kind == "z" else True), rays, np.nan)

    def _of_depth_one(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.kind == "range":
            return directions
        with np.errstate(all="ignore"):  # between pixels' centres a lens may look aside
            return directions / directions[..., 2:]

    def __getstate__(self) -> dict[str, Any]:
        """Return what the camera is, without what has been computed of it."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


CalibratedCamera: TypeAlias = Camera | LensCamera
"""What a calibration makes: without distortion a pinhole."""


def camera_of(
    lens: Lens,
    width: int,
    height: int,
    *,
    near: float = 0.0,
    far: float = math.inf,
    kind: DepthKind | None = None,
) -> CalibratedCamera:
    """Make a `Camera` of a lens without distortion, whose depth is along the axis, or else a `LensCamera`.

    Raises:
        CameraError: The numbers make no camera.
    """
    if kind is not None:
        check_choice(kind, "kind", ("z", "range"), CameraError)
    if lens.is_pinhole and kind != "range":
        fx, fy, cx, cy = (getattr(lens, name) for name in ("fx", "fy", "cx", "cy"))
        return Camera(width, height, fx, fy, cx, cy, near, far)
    return LensCamera(lens, width, height, near, far, kind)
