# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray patterns: sensors defined by the direction of each ray, optionally with an origin and a time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.base import DepthKind
from warpvis.cameras.checks import check_range
from warpvis.cameras.ray_camera import MAX_RAYS, RayCamera
from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_choice
from warpvis.core.poses import Convention, check_convention
from warpvis.errors import ArrayError, CameraError, PoseError

_LENGTH_TOLERANCE = 1e-6


class Rays(RayCamera):
    """A ray pattern: a lidar, a scanner, or any other sensor that is a list or an image of rays.

    `Renderer` and `render` accept it like a camera. An image of rays, ``(H, W, 3)``, gives results of shape
    ``(V, H, W)``; a list, ``(N, 3)``, gives results of shape ``(V, N)``.

    Poses refer to the frame of the directions: a lidar whose directions have x forward is rendered from poses with x
    forward. `axes` specifies these axes, for conversion from poses with another `convention`.
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
        """Create a ray pattern.

        Args:
            directions: Unit vectors in the sensor frame, shape ``(H, W, 3)`` or ``(N, 3)``. They may have single
                precision; their length must be 1 to within 1e-6.
            origins: Ray origins in that frame [m], of the same shape; zeros by default.
            times: Time at which each ray is cast, after the start of the frame [s], shape ``(H, W)`` or ``(N,)``.
            rings: Channel of each ray, integers of the same shape as `times`.
            near: Minimum measured depth [m]; nearer surfaces read -inf and still occlude.
            far: Maximum measured depth [m]; farther surfaces read +inf.
            kind: Definition of depth, `near` and `far`: ``"range"``, distance from the origin of the ray, or ``"z"``,
                along the z axis. ``"z"`` requires ``axes="opencv"`` and rays less than 90 degrees from z.
            axes: The axes of the sensor frame: ``"opencv"`` (x right, y down, z forward), ``"ros_body"`` (x forward,
                y left, z up, as for lidars), ``"opengl"`` or ``"ros_optical"``.

        Raises:
            CameraError: If an argument is invalid: a wrong shape, directions not of length 1, values not finite.
        """
        self._directions = _vectors(directions, "directions")
        self.height, self.width = self.shape if len(self.shape) == 2 else (1, *self.shape)
        length = np.linalg.norm(self._directions, axis=-1, keepdims=True)
        _check_lengths(length[..., 0])
        self._rays = _freeze(self._directions / length)
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
            self._scale_to_unit_z()

    @property
    def shape(self) -> tuple[int, ...]:
        """``(H, W)`` or ``(N,)``."""
        return self._directions.shape[:-1]

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vectors in the sensor frame as given, shape ``(H, W, 3)`` or ``(N, 3)``, read-only."""
        return self._directions

    @property
    def origins(self) -> NDArray[np.float64] | None:
        """Ray origins in the sensor frame [m], with the shape of `directions`; None if all are zero."""
        return self._origins

    @property
    def times(self) -> NDArray[np.float64] | None:
        """Time of each ray, after the start of the frame [s], shape ``(H, W)`` or ``(N,)``; None if not given."""
        return self._times

    @property
    def rings(self) -> NDArray[np.int32] | None:
        """Channel of each ray, shape ``(H, W)`` or ``(N,)``; None if not given."""
        return self._rings

    @property
    def rays(self) -> NDArray[np.float64]:
        """Rays of depth 1, with the shape of `directions`, normalized in double precision: length 1, or z = 1."""
        return self._rays

    def __len__(self) -> int:
        """Return the number of rays."""
        return math.prod(self.shape)

    def __repr__(self) -> str:
        """Return the shape and the options; arrays are not listed."""
        names = [name for name in ("origins", "times", "rings") if getattr(self, name) is not None]
        more = f" with {', '.join(names)}" if names else ""
        return f"Rays({self.shape}{more}, near={self.near}, far={self.far}, kind={self.kind!r}, axes={self.axes!r})"

    def _scale_to_unit_z(self) -> None:
        if self.axes != "opencv":
            raise CameraError(f'axes must be "opencv" (z forward) for kind="z", got {self.axes!r}')
        aside = int((self._rays[..., 2] <= 0).sum())
        if aside:
            raise CameraError(
                f'kind must be "range" for rays 90 degrees or more from z, got "z" for {aside} such rays of {len(self)}'
            )
        self._rays = _freeze(self._rays / self._rays[..., 2:])

    def _same_shape(self, array: NDArray, name: str) -> NDArray:
        leading = array.shape[: len(self.shape)]
        if leading != self.shape or array.ndim - len(self.shape) > 1:
            raise CameraError(f"{name} must be one for each ray, shape {self.shape}, got {array.shape}")
        return array

    def _numbers(self, value: ArrayLike, name: str) -> NDArray[np.float64]:
        array = _floats(value, name)
        if array.shape != self.shape:
            raise CameraError(f"{name} must be one for each ray, shape {self.shape}, got {array.shape}")
        if not np.isfinite(array).all():
            raise CameraError(f"{name} must be finite, and {int((~np.isfinite(array)).sum())} are not")
        return _freeze(array)

    def _whole_numbers(self, value: ArrayLike) -> NDArray[np.int32]:
        array = self._numbers(value, "rings")
        wrong = (array != np.round(array)) | (array < 0) | (array >= 2**31)
        if wrong.any():
            raise CameraError(f"rings must be whole numbers from 0 up, got {array[wrong][0]:g}")
        return _freeze(array.astype(np.int32))


def _floats(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Copy values to a new array in double precision."""
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
        raise CameraError(f"{name} must have at most {MAX_RAYS} rays, got {array.size // 3}")
    wrong = ~np.isfinite(array).all(axis=-1)
    if wrong.any():
        first = ", ".join(map(str, np.argwhere(wrong)[0]))
        raise CameraError(
            f"{name} must be finite, got {int(wrong.sum())} of {wrong.size} that are not, the first at [{first}]. "
            "Leave out rays that are not cast."
        )
    return _freeze(array)


def _check_lengths(length: NDArray[np.float64]) -> None:
    wrong = ~(np.abs(length - 1) <= _LENGTH_TOLERANCE)
    if wrong.any():
        index = tuple(np.argwhere(wrong)[0])
        first = ", ".join(map(str, index))
        raise CameraError(
            f"directions must have length 1 to within {_LENGTH_TOLERANCE:g}, got {int(wrong.sum())} of {wrong.size} "
            f"that have not, the first at [{first}] of length {length[index]:.9g}"
        )


def _freeze(array: NDArray) -> NDArray:
    """Make a checked array read-only and return it."""
    array.flags.writeable = False
    return array
