# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Motion within a frame: where a sensor, or movable objects, are at every moment of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, on_gpu
from warpvis.core.poses import QuaternionOrder, check_quaternion, poses_to_opencv, quaternion_product, to_xyzw
from warpvis.core.types import ArrayInput, PoseLike
from warpvis.errors import ArrayError, PoseError

_ROUNDING = 1e-9
"""So far out of a motion's time a ray may be [s]: what numbers of seconds are rounded by."""


class Motion:
    """Where a sensor, or movable objects, are at every moment of a frame.

    `Renderer.render` and `render` take one in place of `camera_to_world`, of `object_poses`, or of both: every ray is
    then cast from where the sensor is at the ray's time, and meets objects where they are then. The times of all are
    on one clock, in seconds.

    Between two instants a place moves along a straight line, and a rotation about one axis on the shorter way, both at
    a constant rate (Shoemake 1985). `from_twist` moves along a screw.

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
        """Take poses at instants.

        Args:
            poses: Poses at each of T instants, first of all axes: of one sensor rows ``x y z qx qy qz qw`` of shape
                ``(T, 7)`` or matrices ``(T, 4, 4)``; of V views ``(T, V, 7)`` or ``(T, V, 4, 4)``; of M movable objects
                rows ``(T, M, 7)``, in W worlds ``(T, W, M, 7)``. On a GPU likewise, or a list of T arrays.
            times: When those are [s], rising, shape ``(T,)``, T at least 2.
            starts: When each view's frame starts on this clock [s], shape ``(V,)``. Poses of one sensor, a trajectory,
                are then of V views. By default frames start at 0.
            quaternion: Order of the quaternions, ``"xyzw"`` or ``"wxyz"``.

        Raises:
            PoseError: The poses are malformed.
            ArrayError: The times are.
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
                f"times must be one for each instant of poses, of which there are two or more, got {len(self._times)} "
                f"for {count}"
            )
        if not (np.diff(self._times) > 0).all():
            raise ArrayError("times must rise from instant to instant")
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
        """Make the motion of what keeps its velocities along and about its own axes: a screw, exactly.

        The pose at time t is the pose at 0 s times the exponential of t times the twist (Lynch and Park, "Modern
        Robotics", 2017, equation 3.88). It goes on for good, before 0 s, too.

        Args:
            poses: Poses at 0 s: rows of shape ``(7,)``, of V views ``(V, 7)`` or matrices; of movable objects
                ``(M, 7)`` or ``(W, M, 7)``. On the host.
            linear: Velocity along the moving thing's own axes [m/s], shape ``(3,)``, or one for each pose.
            angular: Angular velocity about these axes [rad/s], likewise; what a gyroscope measures.
            starts: As for instants.
            quaternion: Order of the quaternions, ``"xyzw"`` or ``"wxyz"``.

        Raises:
            PoseError: The poses are malformed.
            ArrayError: The velocities are.
        """
        made = cls._of_one_instant(poses, starts, quaternion)
        made._linear, made._angular = (
            _velocities(value, name, made.shape) for value, name in ((linear, "linear"), (angular, "angular"))
        )
        made._check_starts()
        return made

    @classmethod
    def per_ray(cls, poses: PoseLike, *, quaternion: QuaternionOrder = "xyzw") -> Motion:
        """Make the motion of a sensor of which every ray, or every row or column, has a pose of its own.

        Args:
            poses: Rows ``x y z qx qy qz qw`` for each ray, shape ``(V, H, W, 7)``, or ``(V, N, 7)`` of a list of rays,
                or matrices; without the first axis of one view. An axis may be 1, for one pose a row,
                ``(V, H, 1, 7)``, or a column, ``(V, 1, W, 7)``. On the host.
            quaternion: Order of the quaternions, ``"xyzw"`` or ``"wxyz"``.

        Raises:
            PoseError: The poses are malformed.
        """
        made = cls._of_one_instant(poses, None, quaternion)
        made.of_rays = True
        return made

    @classmethod
    def _of_one_instant(cls, poses: PoseLike, starts: ArrayLike | None, quaternion: QuaternionOrder) -> Motion:
        check_quaternion(quaternion)
        if on_gpu(poses):
            raise PoseError("poses must be in the host's memory, since there is no time to read them at, got a GPU's")
        made = cls.__new__(cls)
        host = as_numpy(poses.numpy() if isinstance(poses, wp.array) else poses, name="poses")
        made._rows, made._parts = _host_rows(host[None], quaternion), []
        made._times = made._linear = made._angular = None
        made._starts = None if starts is None else _numbers(starts, "starts")
        made.of_rays = False
        return made

    @property
    def times(self) -> NDArray[np.float64] | None:
        """When the poses are [s], shape ``(T,)``; None of a twist, and of poses of rays."""
        return self._times

    @property
    def twist(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Linear [m/s] and angular velocity [rad/s] of each pose, shape ``(*shape, 3)``; None without a twist."""
        return None if self._linear is None or self._angular is None else (self._linear, self._angular)

    @property
    def starts(self) -> NDArray[np.float64] | None:
        """When each view's frame starts [s], shape ``(V,)``; None for 0."""
        return self._starts

    @property
    def shape(self) -> tuple[int, ...]:
        """The axes of the poses of one instant: ``()`` of one sensor, ``(V,)``, ``(M,)``, ``(W, M)``.

        Raises:
            PoseError: They are on a GPU.
        """
        return self._host_rows().shape[1:-1]

    def at(self, times: ArrayLike = 0.0) -> NDArray[np.float64]:
        """Compute poses at moments of the frames, in double precision.

        Args:
            times: Seconds after each frame's start, of any shape.

        Returns:
            Rows ``x y z qx qy qz qw``, shape ``(*times, 7)`` of one sensor, ``(*times, V, 7)`` of V views, and so on.

        Raises:
            ArrayError: The times are no numbers, or the motion says nothing of then.
            PoseError: The poses are on a GPU, or of rays.
        """
        moments = _numbers(times, "times", axes=None)
        shape = self.shape or (() if self._starts is None else self._starts.shape)
        check_times(self, moments)
        found = [self._poses_of(column, moments.ravel()) for column in range(int(np.prod(shape)))]
        return np.stack(found, axis=1).reshape(*moments.shape, *shape, 7)

    def __array__(self, *_: object, **__: object) -> NDArray[np.float64]:
        """Refuse to be taken for poses by who sees nothing move."""
        raise TypeError("a Motion is for render, Renderer.render and measure_incidence")

    def __repr__(self) -> str:
        """Say what it is, not each pose."""
        kind = "per_ray, " if self.of_rays else "from_twist, " if self._times is None else f"{len(self._times)} times, "
        of = f"shape={self.shape}" if self._rows is not None else "on a GPU"
        starts = "" if self._starts is None else f", {len(self._starts)} starts"
        return f"Motion({kind}{of}{starts})"

    def _check_starts(self) -> None:
        if self._starts is not None and self._rows is not None and self.shape not in ((), self._starts.shape):
            raise ArrayError(
                f"starts must be one for each of the {self.shape[0]} views, got {len(self._starts)}; poses of objects "
                "have none"
            )

    def _host_rows(self) -> NDArray[np.float64]:
        if self._rows is None:
            raise PoseError("the poses of this motion are on a GPU, and are not read back")
        return self._rows

    def _poses_of(self, index: int, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the poses of one view, or thing, at times after its frame's start, shape ``(N,)``, as rows."""
        rows = self._host_rows()
        column = index if self.shape else 0
        rows = rows.reshape(len(rows), -1, 7)[:, column]
        if self._starts is not None:
            times = times + self._starts[index]
        if self.twist is not None:
            linear, angular = (each.reshape(-1, 3)[column] for each in self.twist)
            return _along_screw(rows[0], linear, angular, times)
        assert self._times is not None
        at = np.clip(np.searchsorted(self._times, times, side="right") - 1, 0, len(rows) - 2)
        share = np.clip((times - self._times[at]) / (self._times[at + 1] - self._times[at]), 0.0, 1.0)
        return _between(rows[at], rows[at + 1], share[:, None])


def check_times(motion: Motion, times: NDArray, starts: NDArray[np.float64] | None = None) -> None:
    """Raise an error if a motion says nothing of some times after frames' starts [s], by default its own.

    Times may lie outside by what they are rounded by, which in single precision is more.

    Raises:
        ArrayError: They are before or behind all its poses.
        PoseError: Its poses are of rays, and of no time.
    """
    if motion.of_rays:
        raise PoseError("a motion whose rays have poses of their own has none at a time")
    if motion.times is None or not times.size:
        return
    starts = motion.starts if starts is None else starts
    first, last = (0.0, 0.0) if starts is None else (starts.min(), starts.max())
    begin, end = first + float(times.min()), last + float(times.max())
    rounding = float(np.spacing(np.abs(times).max())) if times.dtype.kind == "f" else 0.0
    slack = _ROUNDING + rounding + 4 * np.spacing(max(abs(begin), abs(end)))
    if begin < motion.times[0] - slack or end > motion.times[-1] + slack:
        raise ArrayError(
            f"times from {begin:.9g} to {end:.9g} s must lie in the motion's, from {motion.times[0]:.9g} to "
            f"{motion.times[-1]:.9g} s: give it poses around them"
        )


def poses_of_view(motion: Motion, view: int, times: NDArray) -> NDArray[np.float64]:
    """Compute the poses of one view at times after its frame's start, shape ``(N,)``: rows ``(N, 7)``."""
    check_times(motion, times)
    return motion._poses_of(view, times.astype(np.float64))


def instants_of(motion: Motion) -> NDArray[np.float64] | list[PoseLike]:
    """Return the poses of all instants: rows ``(T, ..., 7)``, or of a GPU what there is for each."""
    return motion._parts if motion._rows is None else motion._rows


def stacked(arrays: list[wp.array]) -> wp.array:
    """Copy poses of instants on a device, all of one shape, into one array, shape ``(T, ...)`` transform.

    Raises:
        PoseError: They are of several shapes.
    """
    first = arrays[0]
    if any(array.shape != first.shape for array in arrays):
        raise PoseError(f"poses must be as many at each instant, got {', '.join(str(a.shape) for a in arrays[:5])}")
    out = wp.empty((len(arrays), *first.shape), dtype=wp.transform, device=first.device)
    for k, array in enumerate(arrays):
        wp.copy(out[k], array)
    return out


def _read_poses(
    poses: PoseLike | Sequence[PoseLike], quaternion: QuaternionOrder
) -> tuple[NDArray[np.float64] | None, list[PoseLike]]:
    """Return checked rows ``(T, ..., 7)`` of the host, or what there is for each instant on a GPU."""
    several = isinstance(poses, list | tuple)
    if several and any(on_gpu(part) for part in poses):
        return None, [to_xyzw(part, quaternion, "poses") for part in poses]
    if on_gpu(poses):
        given: Any = poses
        one = isinstance(given, wp.array) and given.ndim == 1
        parts = [given[k : k + 1] if one else given[k] for k in range(given.shape[0])]
        return None, [to_xyzw(part, quaternion, "poses") for part in parts]
    if several:
        poses = [part.numpy() if isinstance(part, wp.array) else part for part in poses]
    host = as_numpy(poses.numpy() if isinstance(poses, wp.array) else poses, name="poses")
    return _host_rows(host, quaternion), []


def _host_rows(host: NDArray, quaternion: QuaternionOrder) -> NDArray[np.float64]:
    """Return checked rows of poses whose first axis is instants, shape ``(T, ..., 7)``."""
    matrices = host.ndim >= 3 and host.shape[-2:] == (4, 4) and host.shape[-1] != 7
    if not matrices and (host.ndim < 2 or host.shape[-1] != 7):
        raise PoseError(
            "poses must have shape (T, ..., 7), rows x y z qx qy qz qw, or (T, ..., 4, 4), at T instants, got "
            f"{host.shape}"
        )
    rows = host if matrices else to_xyzw(host, quaternion, "poses")
    flat = np.asarray(rows).reshape(-1, *((4, 4) if matrices else (7,)))
    if not len(flat):
        raise PoseError(f"poses must be there, got shape {host.shape}")
    return _kept(poses_to_opencv(flat, name="poses").reshape(*host.shape[: -2 if matrices else -1], 7))


def _numbers(value: ArrayInput, name: str, axes: int | None = 1) -> NDArray[np.float64]:
    """Return finite numbers in double precision, of so many axes."""
    given = as_numpy(value.numpy() if isinstance(value, wp.array) else value, name=name)
    if axes is not None and (given.ndim != axes or not given.size):
        raise ArrayError(f"{name} must be a list of numbers of seconds, got shape {given.shape}")
    array = given.astype(np.float64)
    if not np.isfinite(array).all():
        raise ArrayError(f"{name} must be finite, and {int((~np.isfinite(array)).sum())} are not")
    return _kept(array)


def _velocities(value: ArrayLike, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    given = as_numpy(value, name=name).astype(np.float64)
    if given.shape not in ((3,), (*shape, 3)) or not np.isfinite(given).all():
        raise ArrayError(
            f"{name} must be three finite numbers, or three for each of the poses, of shape {(*shape, 3)}, got "
            f"{given.tolist() if given.size < 5 else given.shape}"
        )
    return _kept(np.broadcast_to(given, (*shape, 3)).copy())


def _between(a: NDArray[np.float64], b: NDArray[np.float64], share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows between rows, after a share of the way: `warpvis.kernels.motions.between`."""
    p, q = a[:, 3:], b[:, 3:]
    q = np.where((p * q).sum(axis=1, keepdims=True) < 0, -q, q)
    angle = 2 * np.arctan2(*(np.linalg.norm(side, axis=1, keepdims=True) for side in (q - p, q + p)))
    turned = np.where(angle > 0, p * np.sin((1 - share) * angle) + q * np.sin(share * angle), p)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    return np.concatenate([a[:, :3] + share * (b[:, :3] - a[:, :3]), turned], axis=1)


def _along_screw(
    row: NDArray[np.float64], linear: NDArray[np.float64], angular: NDArray[np.float64], times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Rows of what has kept its velocities: `warpvis.kernels.motions.along_screw`."""
    turn, along = times[:, None] * angular, times[:, None] * linear
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = np.where(angle > 1e-8, np.sin(angle / 2) / angle, 0.5)
        third = np.where(angle > 1e-2, (angle - np.sin(angle)) / angle**3, (1 - angle**2 / 20) / 6)
    across = np.cross(turn, along)
    moved = along + 2 * sine**2 * across + third * np.cross(turn, across)
    rotation = np.broadcast_to(row[3:], (len(times), 4))
    turned = quaternion_product(rotation, np.concatenate([sine * turn, np.cos(angle / 2)], axis=1))
    place = row[:3] + rotate(rotation, moved)
    return np.concatenate([place, turned / np.linalg.norm(turned, axis=1, keepdims=True)], axis=1)


def rotate(quaternions: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotate vectors, shape ``(..., 3)``, by unit quaternions ``x y z w``, shape ``(..., 4)``."""
    axis, w = quaternions[..., :3], quaternions[..., 3:]
    side = 2 * np.cross(axis, vectors)
    return vectors + w * side + np.cross(axis, side)


def _kept(array: NDArray) -> NDArray:
    array.flags.writeable = False
    return array
