# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras with lenses."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.base import DepthKind, ProjectingCamera
from warpvis.cameras.checks import check_image_size, check_pixel_units, check_range, check_ray_count
from warpvis.cameras.lenses import Lens, lens_to_dict
from warpvis.cameras.rays import OnceCache, RayCamera
from warpvis.core.arrays import freeze
from warpvis.core.checks import as_items, check_choice, check_whole, truncate
from warpvis.core.types import Json
from warpvis.core.user_warnings import warn_user
from warpvis.errors import CameraError, IntrinsicsWarning


@dataclass(frozen=True)
class LensCamera(ProjectingCamera, RayCamera):
    """A camera with a lens, and OpenCV axes: x right, y down, z forward.

    Pixel ``(x, y)`` covers the square from ``(x, y)`` to ``(x + 1, y + 1)``; its ray passes through the center at +0.5.
    `Renderer` and `render` accept it. The lens computes the ray of each pixel once, in double precision, without
    interpolation.
    """

    lens: Lens
    """Mapping of directions to image points: an instance of a class in `warpvis.cameras.lenses`."""
    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    near: float = 0.0
    """Minimum measured depth [m]; nearer surfaces read -inf and still occlude."""
    far: float = math.inf
    """Maximum measured depth [m]; farther surfaces read +inf."""
    kind: DepthKind | None = None
    """Definition of depth, `near` and `far`: ``"z"``, along the axis, or ``"range"``, along the ray. By default
    ``"z"`` if all rays are less than 90 degrees from the axis, else ``"range"``."""

    usage_hint = "rendering, datasets, points, back-projection, classification and maps accept lenses"

    def __post_init__(self) -> None:
        if not isinstance(self.lens, Lens):
            raise CameraError(f"lens must be one of warpvis.cameras.lenses, got {type(self.lens).__name__}")
        check_image_size(self)
        check_range(self)
        if all(hasattr(self.lens, name) for name in ("fx", "fy", "cx", "cy")):
            check_pixel_units(self.width, self.height, self.lens)
        shown = ~self.mask
        if not shown.any():
            raise CameraError("no pixel of the image has a ray. Intrinsics must be in pixels of an image of this size.")
        ahead = bool((self.directions[shown][:, 2] > 0).all())
        if self.kind is None:
            object.__setattr__(self, "kind", "z" if ahead else "range")
        check_choice(self.kind, "kind", ("z", "range"), CameraError)
        if self.kind == "z" and not ahead:
            count = int((self.directions[shown][:, 2] <= 0).sum())
            raise CameraError(
                f'kind must be "range" for rays 90 degrees or more from the axis, got "z" with {count} such pixels'
            )
        self._warn_of_mask()

    def _warn_of_mask(self) -> None:
        count = int(self.mask.sum())
        if count:
            degrees = math.degrees(self.lens.max_angle)
            verb = "turns back" if self.lens.turns_back else "ends"
            warn_user(
                f"{count} of {self.mask.size} pixels have no ray because the lens {verb} {degrees:.4g} degrees from "
                "its axis: they stay empty, and are True in the camera's mask",
                IntrinsicsWarning,
            )

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vectors through the pixel centers, shape ``(height, width, 3)``, read-only; NaN without a ray."""
        return self.lens.directions(self.width, self.height)

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """Mask of pixels without a ray, shape ``(height, width)``: the lens maps no direction to them."""
        return freeze(np.isnan(self.directions[..., 0]))

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project camera-frame points [m], shape ``(..., 3)``; see `warpvis.cameras.lenses.Lens.project`."""
        return self.lens.project(points)

    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return the unit vectors of image points [px]; see `warpvis.cameras.lenses.Lens.unproject`."""
        return self.lens.unproject(pixels)

    @cached_property
    def rays(self) -> NDArray[np.float64]:
        """Rays of depth 1 through the pixel centers, shape ``(height, width, 3)``; NaN where a pixel has no ray."""
        return self._scale_to_depth_one(self.directions)

    def canvas_rays(self, canvas: tuple[int, int, int, int]) -> NDArray[np.float64]:
        """Return the rays of the image enlarged by a margin (left, top, right, bottom) [px], like `rays`."""
        margins = as_items(canvas, "canvas", CameraError)
        if len(margins) != 4:
            raise CameraError(f"canvas must be four numbers of pixels (left, top, right, bottom), got {len(margins)}")
        left, top, right, bottom = (check_whole(margin, "canvas", minimum=0, error=CameraError) for margin in margins)
        if not any(margins):
            return self.rays
        width, height = self.width + left + right, self.height + top + bottom
        check_ray_count(width, height)
        return self._scale_to_depth_one(self.lens.directions(width, height, (-left, -top)))

    def depth_rays(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays of depth 1 through points [px] in the image or beyond, shape ``(..., 2)``; NaN without a ray."""
        return self._scale_to_depth_one(self.unproject(pixels))

    def _scale_to_depth_one(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.kind == "range":
            return directions
        with np.errstate(all="ignore"):  # outside of the pixel centers, rays may be 90 degrees or more from the axis
            return np.where(directions[..., 2:] > 0, directions / directions[..., 2:], np.nan)

    def _cache(self) -> OnceCache:
        """Return the cache, shared with live cameras of the same lens, image size and kind (`dataclasses.replace`)."""
        if "_prepared" not in self.__dict__:
            caches = self.lens.__dict__.setdefault("_prepared", WeakValueDictionary())
            shared = caches.setdefault((self.width, self.height, self.kind), OnceCache())
            return self.__dict__.setdefault("_prepared", shared)
        return self.__dict__["_prepared"]

    def describe(self) -> str:
        """Describe the image size and the lens in a few words."""
        return f"{self.width}x{self.height} pixels, {truncate(repr(self.lens))}"

    def to_dict(self) -> dict[str, Json]:
        """Return the fields as a JSON object, for `camera_from_dict`; an infinite `far` becomes None.

        Raises:
            CameraError: If the lens is not a dataclass of numbers, strings and tuples of these.
        """
        far = None if math.isinf(self.far) else self.far
        return {**self.__getstate__(), "lens": lens_to_dict(self.lens), "far": far}

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields without cached values."""
        return {field.name: getattr(self, field.name) for field in fields(self)}
