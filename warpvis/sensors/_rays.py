# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray patterns: sensors of which every ray has a direction of its own, and where it needs them an origin and a time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.camera import check_range
from warpvis.core.checks import check_choice
from warpvis.core.poses import Convention, check_convention
from warpvis.core.ray_camera import MAX_RAYS, DepthKind, RayCamera
from warpvis.errors import ArrayError, CameraError, PoseError

_LENGTH_TOLERANCE = 1e-6


class Rays(RayCamera):
    """A ray pattern: a lidar, a scanner, or any other sensor that is a list or an image of rays.

    `Renderer` and `render` take it as they take a camera. An image of rays, ``(H, W, 3)``, gives images of shape
    ``(V, H, W)``; a list, ``(N, 3)``, gives results of shape ``(V, N)``.

    Poses are of the frame that the directions are in, whatever its axes: a lidar whose directions have x forward is
    rendered from poses whose x is forward. `axes` says which axes those are, for calls whose `convention` names others.
    """

    def __init__(
        self,
        directions: ArrayLike,
        origins: ArrayLike | None = None,
        times: ArrayLike | None = None,
        rings: ArrayLike | None = None,
        *,
        near: float = 0.0,
        far: float = math.inf,
        kind: DepthKind = "range",
        axes: Convention = "opencv",
    ) -> None:
        """Take the rays.

        Args:
            directions: Unit vectors of the sensor frame, shape ``(H, W, 3)`` or ``(N, 3)``; single precision will do.
            origins: Where the rays start in that frame [m], of the same shape; all at its origin by default.
            times: When each is cast, after the frame's start [s], shape ``(H, W)`` or ``(N,)``.
            rings: Which channel each is of, likewise; whole numbers.
            near: Least depth the sensor measures [m]; what is nearer reads -inf and still occludes.
            far: Greatest depth it measures [m]; what is farther reads +inf.
            kind: What depth is, of which `near` and `far` are too: ``"range"``, the length of the ray from where it
                starts, or ``"z"``, along the z axis, for rays less than 90 degrees from it and `axes` whose z is
                forward.
            axes: The axes of the sensor frame: ``"opencv"`` (x right, y down, z forward), ``"ros_body"`` (x forward,
                y left, z up, as of lidars), ``"opengl"`` or ``"ros_optical"``.

        Raises:
            CameraError: They are no rays: of another shape, not of length 1, not finite.
        """
        self._directions = _vectors(directions, "directions")
        self.height, self.width = self.shape if len(self.shape) == 2 else (1, *self.shape)
        length = np.linalg.norm(self._directions, axis=-1, keepdims=True)
        _check_lengths(length[..., 0])
        self._rays = _kept(self._directions / length)
        self._origins = None if origins is None else self._same_shape(_vectors(origins, "origins"), "origins")
        self._times = None if times is None else self._numbers(times, "times")
        self._rings = None if rings is None else self._whole_numbers(rings)
        self.near, self.far = near, far
        check_range(self)
        try:
            self.axes = check_convention(axes)
        except PoseError as error:
            raise CameraError(str(error).replace("convention", "axes", 1)) from None
        check_choice(kind, "kind", ("z", "range"), CameraError)
        self.kind: DepthKind = kind
        if kind == "z":
            self._look_along_z()

    @property
    def shape(self) -> tuple[int, ...]:
        """``(H, W)`` or ``(N,)``."""
        return self._directions.shape[:-1]

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vectors of the sensor frame as they were given, shape ``(H, W, 3)`` or ``(N, 3)``, read-only."""
        return self._directions

    @property
    def origins(self) -> NDArray[np.float64] | None:
        """Where the rays start in the sensor frame [m], of the same shape; None for its origin."""
        return self._origins

    @property
    def times(self) -> NDArray[np.float64] | None:
        """When each ray is cast, after the frame's start [s], shape ``(H, W)`` or ``(N,)``; None if nobody said."""
        return self._times

    @property
    def rings(self) -> NDArray[np.int32] | None:
        """Which channel each ray is of, shape ``(H, W)`` or ``(N,)``; None if nobody said."""
        return self._rings

    @property
    def rays(self) -> NDArray[np.float64]:
        """Rays of depth 1, of the directions' shape: in double precision of length 1, or of z 1."""
        return self._rays

    def __len__(self) -> int:
        """Count the rays."""
        return math.prod(self.shape)

    def __repr__(self) -> str:
        """Say what it is, not each ray."""
        given = [name for name in ("origins", "times", "rings") if getattr(self, name) is not None]
        more = f" with {', '.join(given)}" if given else ""
        return f"Rays({self.shape}{more}, near={self.near}, far={self.far}, kind={self.kind!r}, axes={self.axes!r})"

    def _look_along_z(self) -> None:
        if self.axes != "opencv":
            raise CameraError(f'kind="z" is for axes whose z is forward, "opencv", got axes={self.axes!r}')
        aside = int((self._rays[..., 2] <= 0).sum())
        if aside:
            raise CameraError(
                f'kind="z" is for what is ahead, and {aside} of {len(self)} rays look 90 degrees or more away: "range"'
            )
        self._rays = _kept(self._rays / self._rays[..., 2:])

    def _same_shape(self, array: NDArray, name: str) -> NDArray:
        leading = array.shape[: len(self.shape)]
        if leading != self.shape or array.ndim - len(self.shape) > 1:
            raise CameraError(f"{name} must be one for each of the {self.shape} rays, got shape {array.shape}")
        return array

    def _numbers(self, value: ArrayLike, name: str) -> NDArray[np.float64]:
        array = _floats(value, name)
        if array.shape != self.shape:
            raise CameraError(f"{name} must be one for each of the {self.shape} rays, got shape {array.shape}")
        if not np.isfinite(array).all():
            raise CameraError(f"{name} must be finite, and {int((~np.isfinite(array)).sum())} are not")
        return _kept(array)

    def _whole_numbers(self, value: ArrayLike) -> NDArray[np.int32]:
        array = self._numbers(value, "rings")
        wrong = (array != np.round(array)) | (array < 0) | (array >= 2**31)
        if wrong.any():
            raise CameraError(f"rings must be whole numbers from 0 up, got {array[wrong][0]:g}")
        return _kept(array.astype(np.int32))


def _floats(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Copy numbers in double precision."""
    try:
        array = as_numpy(value, name=name)
    except ArrayError as error:
        raise CameraError(str(error)) from None
    return np.array(array, dtype=np.float64)


def _vectors(value: ArrayLike, name: str) -> NDArray[np.float64]:
    array = _floats(value, name)
    if array.ndim not in (2, 3) or array.shape[-1] != 3 or not array.size:
        raise CameraError(f"{name} must have shape (H, W, 3) or (N, 3), got {array.shape}")
    if array.size // 3 > MAX_RAYS:
        raise CameraError(f"a pattern may have {MAX_RAYS} rays, got {array.size // 3}")
    wrong = ~np.isfinite(array).all(axis=-1)
    if wrong.any():
        first = ", ".join(map(str, np.argwhere(wrong)[0]))
        raise CameraError(
            f"{name} must be finite, and {int(wrong.sum())} of {wrong.size} are not, first at [{first}]: leave out "
            "rays that are not cast"
        )
    return _kept(array)


def _check_lengths(length: NDArray[np.float64]) -> None:
    wrong = ~(np.abs(length - 1) <= _LENGTH_TOLERANCE)
    if wrong.any():
        at = tuple(np.argwhere(wrong)[0])
        first = ", ".join(map(str, at))
        raise CameraError(
            f"directions must have length 1 to within {_LENGTH_TOLERANCE:g}, and {int(wrong.sum())} of {wrong.size} "
            f"have not, first at [{first}], which has {length[at]:.9g}"
        )


def _kept(array: NDArray) -> NDArray:
    """Have nobody change what has been checked."""
    array.flags.writeable = False
    return array
