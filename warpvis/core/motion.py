# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Motion of a sensor or of movable objects during a frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, freeze, on_gpu
from warpvis.core.poses import QuaternionOrder, check_quaternion, poses_to_opencv, quaternion_product, to_xyzw
from warpvis.core.types import ArrayInput, PoseLike
from warpvis.errors import ArrayError, PoseError

_TIME_TOLERANCE = 1e-9
"""Tolerance for times outside of the interval of a motion [s], because times are rounded."""


class Motion:
    """The motion of a sensor, or of movable objects, during a frame.

    Pass it to `Renderer.render` or `render` as `camera_to_world`, as `object_poses`, or as both: each ray is then cast
    from the pose of the sensor at the time of the ray, and objects have their poses at that time. All times are in
    seconds and refer to the same clock.

    Between two instants, positions are interpolated linearly, and rotations by spherical linear interpolation
    (Shoemake 1985). `from_twist` defines a screw motion.

    Example:
        >>> motion = wv.sensors.Motion([start, end], [0.0, 0.1])
        >>> views = wv.render(scene, lidar, motion)
    """

    def __init__(
        self,
        poses: PoseLike | Sequence[PoseLike],
        times: ArrayLike,
        *,
        starts: ArrayLike | None = None,
        quaternion: QuaternionOrder = "xyzw",
    ) -> None:
        """Create a motion from poses at T instants.

        Args:
            poses: For one sensor, rows ``x y z qx qy qz qw`` of shape ``(T, 7)`` or matrices ``(T, 4, 4)``; for V views
                ``(T, V, 7)`` or ``(T, V, 4, 4)``; for M movable objects, rows ``(T, M, 7)``, or ``(T, W, M, 7)`` in W
                worlds. Poses on a GPU have the same shapes, or are a list of T arrays.
            times: Times of the instants [s], strictly increasing, shape ``(T,)``, T at least 2.
            starts: Start of the frame of each view on this clock [s], shape ``(V,)``. Poses of one sensor are then a
                trajectory common to all views. By default, frames start at 0.
            quaternion: Order of the quaternions, ``"xyzw"`` or ``"wxyz"``.
        """
        check_quaternion(quaternion)
        self.of_rays = False
        self._linear: NDArray[np.float64] | None = None
        self._angular: NDArray[np.float64] | None = None
        self._starts = None if starts is None else _numbers(starts, "starts")
        self._times: NDArray[np.float64] | None = _numbers(times, "times")
        self._rows: NDArray[np.float64] | None
        self._parts: list[PoseLike]
        self._rows, self._parts = _read_poses(poses, quaternion)
        count = len(self._parts) if self._rows is None else len(self._rows)
        if count < 2 or len(self._times) != count:
            raise ArrayError(
                f"times must be one for each instant of poses, at least two, got {len(self._times)} for {count}"
            )
        if not (np.diff(self._times) > 0).all():
            raise ArrayError("times must increase strictly")
        self._check_starts()

    @classmethod
    def from_twist(
        cls,
        poses: PoseLike,
        linear: ArrayLike,
        angular: ArrayLike,
        *,
        starts: ArrayLike | None = None,
        quaternion: QuaternionOrder = "xyzw",
    ) -> Motion:
        """Create an exact screw motion: linear and angular velocity are constant in the body frame.

        The pose at time t is the pose at 0 s times the exponential of t times the twist (Lynch and Park, "Modern
        Robotics", 2017, equation 3.88). The motion is defined for all times, including negative ones.

        Args:
            poses: Poses at 0 s on the host: rows of shape ``(7,)``, ``(V, 7)`` for V views, or matrices; ``(M, 7)`` or
                ``(W, M, 7)`` for movable objects.
            linear: Linear velocity in the body frame [m/s], shape ``(3,)``, or one for each pose.
            angular: Angular velocity in the body frame [rad/s], as measured by a gyroscope; same shapes.
            starts: As in the constructor.
            quaternion: Order of the quaternions, ``"xyzw"`` or ``"wxyz"``.
        """
        motion = cls._from_single_instant(poses, starts, quaternion)
        motion._linear, motion._angular = (
            _velocities(value, name, motion.shape) for value, name in ((linear, "linear"), (angular, "angular"))
        )
        motion._check_starts()
        return motion

    @classmethod
    def per_ray(cls, poses: PoseLike, *, quaternion: QuaternionOrder = "xyzw") -> Motion:
        """Create the motion of a sensor from a pose for each ray, or for each row or column of rays.

        Args:
            poses: Rows ``x y z qx qy qz qw`` for each ray on the host, shape ``(V, H, W, 7)``, or ``(V, N, 7)`` for a
                list of rays, or matrices; the first axis may be omitted for one view. An axis may have length 1, for
                one pose per row, ``(V, H, 1, 7)``, or per column, ``(V, 1, W, 7)``.
            quaternion: Order of the quaternions, ``"xyzw"`` or ``"wxyz"``.
        """
        motion = cls._from_single_instant(poses, None, quaternion)
        motion.of_rays = True
        return motion

    @classmethod
    def _from_single_instant(cls, poses: PoseLike, starts: ArrayLike | None, quaternion: QuaternionOrder) -> Motion:
        check_quaternion(quaternion)
        if on_gpu(poses):
            raise PoseError("poses must be on the host for a motion without times, got an array on a GPU")
        motion = cls.__new__(cls)
        host = as_numpy(poses, name="poses")
        motion._rows, motion._parts = _host_rows(host[None], quaternion), []
        motion._times = motion._linear = motion._angular = None
        motion._starts = None if starts is None else _numbers(starts, "starts")
        motion.of_rays = False
        return motion

    @property
    def times(self) -> NDArray[np.float64] | None:
        """Times of the poses [s], shape ``(T,)``; None for `from_twist` and `per_ray`."""
        return self._times

    @property
    def twist(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Linear [m/s] and angular velocity [rad/s] of each pose, shape ``(*shape, 3)``; None unless `from_twist`."""
        return None if self._linear is None or self._angular is None else (self._linear, self._angular)

    @property
    def starts(self) -> NDArray[np.float64] | None:
        """Start of the frame of each view [s], shape ``(V,)``; None if all start at 0."""
        return self._starts

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the poses at one instant: ``()`` for one sensor, ``(V,)``, ``(M,)`` or ``(W, M)``."""
        return self._host_rows().shape[1:-1]

    def at(self, times: ArrayLike = 0.0) -> NDArray[np.float64]:
        """Compute poses at times, in double precision.

        Args:
            times: Times after the start of each frame [s], of any shape.

        Returns:
            Rows ``x y z qx qy qz qw``, shape ``(*times, 7)`` for one sensor, ``(*times, V, 7)`` for V views, and so on.

        Raises:
            ArrayError: If the times are not numbers, or if the motion does not cover them.
            PoseError: If the poses are on a GPU, or are poses of rays.
        """
        moments = _numbers(times, "times", axes=None)
        shape = self.shape or (() if self._starts is None else self._starts.shape)
        check_times(self, moments)
        poses = [self._poses_of(column, moments.ravel()) for column in range(int(np.prod(shape)))]
        return np.stack(poses, axis=1).reshape(*moments.shape, *shape, 7)

    def __array__(self, *_: object, **__: object) -> NDArray[np.float64]:
        """Prevent implicit conversion to a pose array."""
        raise TypeError("a Motion cannot be converted to an array. Use Motion.at to compute poses at times.")

    def __repr__(self) -> str:
        """Return the kind and the shape; poses are not listed."""
        kind = "per_ray, " if self.of_rays else "from_twist, " if self._times is None else f"{len(self._times)} times, "
        shape = f"shape={self.shape}" if self._rows is not None else "on a GPU"
        starts = "" if self._starts is None else f", {len(self._starts)} starts"
        return f"Motion({kind}{shape}{starts})"

    def _check_starts(self) -> None:
        if self._starts is not None and self._rows is not None and self.shape not in ((), self._starts.shape):
            raise ArrayError(
                f"starts must be one for each of the {self.shape[0]} views, got {len(self._starts)}. Leave them out "
                "for poses of objects."
            )

    def _host_rows(self) -> NDArray[np.float64]:
        if self._rows is None:
            raise PoseError("poses of the motion must be on the host, got a GPU, from which they are not copied")
        return self._rows

    def _poses_of(self, index: int, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute poses of one view or object at times after the start of its frame, shape ``(N,)``, as rows."""
        rows = self._host_rows()
        column = index if self.shape else 0
        rows = rows.reshape(len(rows), -1, 7)[:, column]
        if self._starts is not None:
            times = times + self._starts[index]
        if self.twist is not None:
            linear, angular = (velocities.reshape(-1, 3)[column] for velocities in self.twist)
            return _along_screw(rows[0], linear, angular, times)
        assert self._times is not None
        first = np.clip(np.searchsorted(self._times, times, side="right") - 1, 0, len(rows) - 2)
        fraction = np.clip((times - self._times[first]) / (self._times[first + 1] - self._times[first]), 0.0, 1.0)
        return interpolate(rows[first], rows[first + 1], fraction[:, None])


def check_times(motion: Motion, times: NDArray, starts: NDArray[np.float64] | None = None) -> None:
    """Check that a motion covers times after the starts of frames [s]; by default, after its own starts.

    Times may be outside of its interval by their rounding error, which is greater in single precision.
    """
    if motion.of_rays:
        raise PoseError("motion must have poses at times, got poses of rays (Motion.per_ray)")
    if motion.times is None or not times.size:
        return
    starts = motion.starts if starts is None else starts
    first, last = (0.0, 0.0) if starts is None else (starts.min(), starts.max())
    begin, end = first + float(times.min()), last + float(times.max())
    rounding = float(np.spacing(np.abs(times).max())) if times.dtype.kind == "f" else 0.0
    slack = _TIME_TOLERANCE + rounding + 4 * np.spacing(max(abs(begin), abs(end)))
    if begin < motion.times[0] - slack or end > motion.times[-1] + slack:
        raise ArrayError(
            f"times must be within those of the motion, {motion.times[0]:.9g} to {motion.times[-1]:.9g} s, got "
            f"{begin:.9g} to {end:.9g} s"
        )


def poses_of_view(motion: Motion, view: int, times: NDArray) -> NDArray[np.float64]:
    """Compute poses of one view at times after the start of its frame, shape ``(N,)``, as rows ``(N, 7)``."""
    check_times(motion, times)
    return motion._poses_of(view, times.astype(np.float64))


def instants_of(motion: Motion) -> NDArray[np.float64] | list[PoseLike]:
    """Return the poses of all instants: rows ``(T, ..., 7)`` on the host, or a list of GPU arrays, one per instant."""
    return motion._parts if motion._rows is None else motion._rows


def stacked(arrays: list[wp.array]) -> wp.array:
    """Stack GPU arrays of poses at instants to one array of transforms, shape ``(T, ...)``."""
    first = arrays[0]
    if any(array.shape != first.shape for array in arrays):
        raise PoseError(
            f"poses must have the same shape at each instant, got {', '.join(str(a.shape) for a in arrays[:5])}"
        )
    out = wp.empty((len(arrays), *first.shape), dtype=wp.transform, device=first.device)
    for k, array in enumerate(arrays):
        wp.copy(out[k], array)
    return out


def _read_poses(
    poses: PoseLike | Sequence[PoseLike], quaternion: QuaternionOrder
) -> tuple[NDArray[np.float64] | None, list[PoseLike]]:
    """Return checked rows ``(T, ..., 7)`` on the host, or a list of GPU arrays, one per instant."""
    several = isinstance(poses, list | tuple)
    if several and any(on_gpu(part) for part in poses):
        return None, [to_xyzw(part, quaternion, "poses") for part in poses]
    if on_gpu(poses):
        array: Any = poses
        is_trajectory = isinstance(array, wp.array) and array.ndim == 1
        parts = [array[k : k + 1] if is_trajectory else array[k] for k in range(array.shape[0])]
        return None, [to_xyzw(part, quaternion, "poses") for part in parts]
    host = as_numpy([as_numpy(part, name="poses") for part in poses] if several else poses, name="poses")
    return _host_rows(host, quaternion), []


def _host_rows(host: NDArray, quaternion: QuaternionOrder) -> NDArray[np.float64]:
    """Return checked rows of poses at T instants, shape ``(T, ..., 7)``."""
    matrices = host.ndim >= 3 and host.shape[-2:] == (4, 4) and host.shape[-1] != 7
    if not matrices and (host.ndim < 2 or host.shape[-1] != 7):
        raise PoseError(
            "poses must have shape (T, ..., 7), rows x y z qx qy qz qw, or (T, ..., 4, 4), at T instants, got "
            f"{host.shape}"
        )
    rows = host if matrices else to_xyzw(host, quaternion, "poses")
    flat = np.asarray(rows).reshape(-1, *((4, 4) if matrices else (7,)))
    if not len(flat):
        raise PoseError(f"poses must not be empty, got shape {host.shape}")
    return freeze(poses_to_opencv(flat, name="poses").reshape(*host.shape[: -2 if matrices else -1], 7))


def _numbers(value: ArrayInput, name: str, axes: int | None = 1) -> NDArray[np.float64]:
    """Check that a value is finite numbers with `axes` axes, and return them in double precision, read-only."""
    values = as_numpy(value, name=name)
    if axes is not None and (values.ndim != axes or not values.size):
        raise ArrayError(f"{name} must be a list of numbers of seconds, got shape {values.shape}")
    array = values.astype(np.float64)
    if not np.isfinite(array).all():
        raise ArrayError(f"{name} must be finite, and {int((~np.isfinite(array)).sum())} are not")
    return freeze(array)


def _velocities(value: ArrayLike, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    values = as_numpy(value, name=name).astype(np.float64)
    if values.shape not in ((3,), (*shape, 3)) or not np.isfinite(values).all():
        raise ArrayError(
            f"{name} must be three finite numbers, or three for each of the poses, of shape {(*shape, 3)}, got "
            f"{values.tolist() if values.size < 5 else values.shape}"
        )
    return freeze(np.broadcast_to(values, (*shape, 3)).copy())


def interpolate(a: NDArray[np.float64], b: NDArray[np.float64], fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate between pose rows; `fraction`, shape ``(N, 1)``, is 0 at `a` and 1 at `b`.

    The host version of `warpvis.kernels.casting.motions.between`.
    """
    p, q = a[:, 3:], b[:, 3:]
    q = np.where((p * q).sum(axis=1, keepdims=True) < 0, -q, q)
    angle = 2 * np.arctan2(*(np.linalg.norm(side, axis=1, keepdims=True) for side in (q - p, q + p)))
    rotation = np.where(angle > 0, p * np.sin((1 - fraction) * angle) + q * np.sin(fraction * angle), p)
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    return np.concatenate([a[:, :3] + fraction * (b[:, :3] - a[:, :3]), rotation], axis=1)


def _along_screw(
    row: NDArray[np.float64], linear: NDArray[np.float64], angular: NDArray[np.float64], times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return rows of a screw motion; the host version of `warpvis.kernels.casting.motions.along_screw`."""
    rotation_vector, along = times[:, None] * angular, times[:, None] * linear
    angle = np.linalg.norm(rotation_vector, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = np.where(angle > 1e-8, np.sin(angle / 2) / angle, 0.5)
        third = np.where(angle > 1e-2, (angle - np.sin(angle)) / angle**3, (1 - angle**2 / 20) / 6)
    across = np.cross(rotation_vector, along)
    displacement = along + 2 * sine**2 * across + third * np.cross(rotation_vector, across)
    start = np.broadcast_to(row[3:], (len(times), 4))
    rotation = quaternion_product(start, np.concatenate([sine * rotation_vector, np.cos(angle / 2)], axis=1))
    position = row[:3] + rotate(start, displacement)
    return np.concatenate([position, rotation / np.linalg.norm(rotation, axis=1, keepdims=True)], axis=1)


def rotate(quaternions: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotate vectors, shape ``(..., 3)``, by unit quaternions ``x y z w``, shape ``(..., 4)``."""
    axis, w = quaternions[..., :3], quaternions[..., 3:]
    cross = 2 * np.cross(axis, vectors)
    return vectors + w * cross + np.cross(axis, cross)
