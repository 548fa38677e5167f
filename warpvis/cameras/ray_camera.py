# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Base classes of cameras that define the ray of each pixel explicitly."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Hashable
from threading import RLock
from typing import TYPE_CHECKING, Any, TypeVar

from warpvis.cameras.base import AnyCamera
from warpvis.core.checks import truncate
from warpvis.errors import CameraError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from warpvis.kernels.casting.rays import RayRange

MAX_RAYS = 2**26
"""Maximum number of rays of a camera; they take 1.6 GB."""


_Value = TypeVar("_Value")


class OnceCache:
    """A thread-safe cache: each value is created once; concurrent requests for it wait."""

    def __init__(self) -> None:
        """Create an empty cache."""
        self._values: dict[Hashable, Any] = {}
        # Reentrant, because creating a value may request other values.
        self._lock = RLock()

    def get(self, name: Hashable, make: Callable[[], _Value]) -> _Value:
        """Return the cached value of this name; create it if it is missing."""
        if name not in self._values:
            with self._lock:
                if name not in self._values:
                    self._values[name] = make()
        return self._values[name]


class RayCamera(AnyCamera):
    """A camera with an array of rays, one per pixel.

    Subclasses have `width`, `height` [px], `near`, `far` [m] and `kind`, the definition of depth.
    """

    usage_hint = "its rays have no image. wv.render accepts it, and its views have points and labels."

    @property
    @abstractmethod
    def rays(self) -> NDArray[np.float64]:
        """Rays of depth 1 for all pixels, shape ``(*shape, 3)``; NaN where a pixel has no ray."""

    def rays_at(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays of depth 1 through image points [px], shape ``(..., 2)``; NaN outside of the image.

        Raises:
            CameraError: If the image is not defined between the rays of the camera.
        """
        raise CameraError(
            f"camera must have a continuous image for render_at, got {type(self).__name__}. Render other Rays instead."
        )

    def prepared(self, name: Hashable, make: Callable[[], _Value]) -> _Value:
        """Return acceleration data of a caster for the rays; it is created once and cached as long as the camera lives.

        Args:
            name: Key of the data, such as a name and the alias of a device.
            make: Function that creates the data. It must depend only on `rays` and `origins`, because cameras with
                different ranges may share the data.
        """
        return self._cache().get(name, make)

    def prepare_in(self, cache: OnceCache) -> None:
        """Share a cache of prepared data between cameras with the same rays."""
        self.__dict__["_prepared"] = cache

    def _cache(self) -> OnceCache:
        return self.__dict__.setdefault("_prepared", OnceCache())  # atomic: concurrent callers get the same cache

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without prepared data, which copies prepare again."""
        return {name: value for name, value in self.__dict__.items() if name != "_prepared"}

    def device_struct(self, *, clip_near: bool = False) -> RayRange:
        """Return the range of the camera as a struct for `warpvis.kernels.casting.ray_bundles`; see `ray_range`."""
        return self.ray_range(clip_near=clip_near)


class LensedCamera(RayCamera):
    """A `RayCamera` with a lens, so that points can be projected to its image."""

    usage_hint = "rendering, datasets, points, back-projection, classification and maps accept lenses"
    lens: Any
    """Mapping of directions to image points; equal lenses have equal images."""

    @abstractmethod
    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project camera-frame points [m], shape ``(..., 3)``, to image points ``(x, y)`` [px]; NaN if impossible."""

    @abstractmethod
    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return the unit vectors of image points ``(x, y)`` [px]; NaN where no direction maps to the point."""

    @abstractmethod
    def canvas_rays(self, canvas: tuple[int, int, int, int]) -> NDArray[np.float64]:
        """Return the rays of the image enlarged by a margin (left, top, right, bottom) [px], like `rays`."""

    def has_pixels_of(self, other: object) -> bool:
        """Return whether another camera has the same size, lens and kind of depth; depth ranges may differ."""
        mine = (self.lens, self.width, self.height, self.kind)
        return isinstance(other, LensedCamera) and mine == (other.lens, other.width, other.height, other.kind)

    def describe(self) -> str:
        """Describe the image size and the lens in a few words."""
        return f"{self.width}x{self.height} pixels, {truncate(repr(self.lens))}"
