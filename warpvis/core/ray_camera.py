# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What cameras are whose pixels have rays of their own, for those who render through them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable
from threading import RLock
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from warpvis.errors import CameraError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from warpvis.core.poses import Convention
    from warpvis.kernels.rays import RayRange

DepthKind = Literal["z", "range"]
"""What depth is: along the camera's axis, or along the ray."""

MAX_RAYS = 2**26
"""So many rays may one camera have: they take 1.6 GB."""


_Made = TypeVar("_Made")


class OnceCache:
    """What is made once, when it is first asked for: who asks for it meanwhile waits."""

    def __init__(self) -> None:
        """Have nothing yet."""
        self._made: dict[Hashable, Any] = {}
        # What is being made may ask for other things.
        self._lock = RLock()

    def get(self, name: Hashable, make: Callable[[], _Made]) -> _Made:
        """Return what was made under this name, or make it."""
        if name not in self._made:
            with self._lock:
                if name not in self._made:
                    self._made[name] = make()
        return self._made[name]


class RayCamera(ABC):
    """A camera whose pixels have rays of their own.

    Subclasses have `width`, `height` [px], `near`, `far` [m], and `kind`, what depth is. Those that say nothing else
    have OpenCV axes, rays that all start at one point, and images of that width and height.
    """

    taken_by = "its rays have no image; wv.render takes it, and what is seen has points and labels of its own"
    """For messages: where it goes, to who took it elsewhere."""
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
    def times(self) -> NDArray[np.float64] | None:
        """When each ray is cast, after the frame's start [s], of that shape; None if nobody said."""
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

    def prepared(self, name: Hashable, make: Callable[[], _Made]) -> _Made:
        """Return what a caster makes of the camera's rays: once, whoever renders through it, as long as it lives.

        Args:
            name: What it is, such as a word and the alias of a device.
            make: Makes it of `rays` and `origins` alone: cameras that differ in their range may share it.
        """
        return self._kept().get(name, make)

    def prepare_in(self, kept: OnceCache) -> None:
        """Have what is prepared kept here, where cameras of the same rays find it, too."""
        self.__dict__["_prepared"] = kept

    def _kept(self) -> OnceCache:
        return self.__dict__.setdefault("_prepared", OnceCache())  # of two threads, the first one's

    def __getstate__(self) -> dict[str, Any]:
        """Return the camera's state without what was prepared, which copies prepare themselves."""
        return {name: value for name, value in self.__dict__.items() if name != "_prepared"}

    def device_struct(self, *, clip_near: bool = False) -> RayRange:
        """Return the camera's range as `warpvis.kernels.ray_table` takes it.

        Args:
            clip_near: Whether what is nearer than `near` is not there, instead of hiding what is behind it.
        """
        from warpvis.kernels.rays import RayRange

        struct = RayRange()
        struct.near, struct.far, struct.is_planar = self.near, self.far, self.kind == "z"
        struct.clip = self.near if clip_near else 0.0
        return struct


class LensedCamera(RayCamera):
    """A `RayCamera` whose rays come from a lens, so that points of the world have places in its image."""

    taken_by = "rendering, datasets, points, back-projection, classification and maps take lenses"
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
