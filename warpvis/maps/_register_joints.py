# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Registration of joint positions: Levenberg-Marquardt steps on the host, in double precision.

Joints move several bodies. With the information matrix H_m and the gradient b_m of the twist of each body m, and its
geometric Jacobian J_m, those of the joint positions are ``sum J_m^T H_m J_m`` and ``sum J_m^T b_m``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.poses import Convention, parse_poses
from warpvis.maps._register_poses import MAX_ROTATION, MAX_TRANSLATION
from warpvis.maps._register_sums import NUM_SUMS, DepthSums
from warpvis.maps._registration import Registration
from warpvis.scene.moving_joints import MovingJoints

_SINGULAR = 1e-12
"""Smallest eigenvalue of H with a diagonal of ones that is not a rounding error."""


@dataclass
class _Sums:
    """Sums of V views at some joint positions."""

    H: NDArray[np.float64]
    b: NDArray[np.float64]
    e: NDArray[np.float64]
    inliers: NDArray[np.float64]
    measured: NDArray[np.float64]

    def put(self, rows: NDArray[np.integer], other: _Sums, chosen: NDArray[np.bool_]) -> None:
        for name, values in vars(self).items():
            values[rows[chosen]] = getattr(other, name)[chosen]


class JointSolver:
    """Registration of the joint positions of all views."""

    def __init__(
        self,
        sums: DepthSums,
        joints: MovingJoints,
        poses: wp.array,
        worlds: Any,
        tolerance: float,
        iterations: int,
        groups: NDArray[np.int32] | None = None,
    ) -> None:
        """Initialize.

        Args:
            sums: The sums of each moving body.
            joints: The joints that move.
            poses: Camera poses, ``(V,)`` transform.
            worlds: Worlds with the initial poses of objects.
            tolerance: Step at which iterations end.
            iterations: Maximum number of steps.
            groups: Group of each view, numbered without gaps, whose positions have one offset; None for one per view.
        """
        from warpvis.kernels.casting.worlds import Worlds

        self.sums, self.joints, self.poses = sums, joints, poses
        self.tolerance, self.last = tolerance, iterations
        count = len(poses)
        indices = np.arange(count) if len(joints.positions) > 1 else np.zeros(count, dtype=np.int32)
        self.world = indices if worlds.world is None or not worlds.world.size else worlds.world.numpy()
        self.worlds = Worlds()
        self.worlds.excluded = worlds.excluded
        self.groups = np.arange(count) if groups is None else groups
        # Positions are those of the first view of each group. Those of its other views differ by `offsets`.
        initial, count = joints.positions[self.world], int(self.groups.max()) + 1
        self.best = initial[np.unique(self.groups, return_index=True)[1]]
        self.trial = self.best.copy()
        self.offsets = initial - self.best[self.groups]
        # Offsets correct the readings of encoders, which a view at a limit should not stop.
        limits = joints.limits if groups is None else np.array([-np.inf, np.inf])
        self.lower, self.upper = np.broadcast_to(limits, (*self.best.shape, 2)).transpose(2, 0, 1)
        self.object_poses = joints.poses[self.world]
        self.status = np.zeros(count, dtype=np.int32)
        self.iterations = np.zeros(count, dtype=np.int32)
        self.damping, self.lengths = np.zeros(count), np.zeros(count)
        size = len(joints.names)
        self.accepted = _Sums(np.zeros((count, size, size)), np.zeros((count, size)), *np.zeros((3, count)))

    def run(self, axes: Convention) -> Registration:
        """Return the results of all views."""
        from warpvis.kernels.gradients.pose_steps import RUNNING

        count, device = len(self.poses), self.sums.device
        self.block = self.sums.blocks(count)[0].stop
        self.memory = [wp.zeros((count, NUM_SUMS), dtype=wp.float64, device=device) for _ in self.sums.bodies]
        for iteration in range(self.last + 1):
            running = np.flatnonzero(self.status == RUNNING)
            if not len(running):
                break
            self._step(running, self._sum(running), is_last=iteration == self.last)
        return self._results(axes)

    def _sum(self, running: NDArray[np.integer]) -> _Sums:
        """Return the sums of some groups at their trial positions; waits for the device."""
        slots = np.full(len(self.best), -1)
        slots[running] = np.arange(len(running))
        views = np.flatnonzero(slots[self.groups] >= 0)
        groups = self.groups[views]
        positions = self.trial[groups] + self.offsets[views]
        self.object_poses[views], jacobians = self.joints.evaluate(positions, self.world[views])
        self.worlds.object_poses = wp.array(self.object_poses, dtype=wp.transform, device=self.sums.device)
        for first in range(0, len(views), self.block):
            self.sums.add(views[first : first + self.block], self.poses, self.worlds, self.memory)
        rows = np.stack([sums.numpy()[views] for sums in self.memory], axis=1)  # (view, body, sum)
        jacobians = jacobians[:, list(self.sums.bodies)]
        matrices, sides = rows[..., :36].reshape(*rows.shape[:2], 6, 6), rows[..., 36:42, None]
        transposed = jacobians.swapaxes(2, 3)

        def add(values: NDArray[np.float64]) -> NDArray[np.float64]:
            total = np.zeros((len(running), *values.shape[1:]))
            np.add.at(total, slots[groups], values)
            return total

        return _Sums(
            add((transposed @ matrices @ jacobians).sum(axis=1)),
            add((transposed @ sides).sum(axis=1)[..., 0]),
            add(rows[:, 0, 42]),
            add(rows[..., 43].sum(axis=1)),
            add(rows[:, 0, 44]),
        )

    def _step(self, rows: NDArray[np.integer], sums: _Sums, is_last: bool) -> None:
        """Accept or reject the trial positions of some groups, and compute the next ones: as `step_poses`."""
        from warpvis.kernels.gradients import pose_steps as steps

        is_first = self.iterations[rows] == 0
        enough = sums.inliers >= float(steps.MIN_INLIERS)
        is_cheap = sums.e <= (1 + float(steps.COST_TOLERANCE)) * self.accepted.e[rows]
        is_cheap |= self.lengths[rows] <= float(steps.SHORT)
        is_accepted = is_first | (enough & is_cheap)
        self.best[rows[is_accepted]] = self.trial[rows[is_accepted]]
        self.accepted.put(rows, sums, is_accepted)
        factor, damping = float(steps.DAMPING_FACTOR), self.damping[rows]
        decreased = np.where(is_first, float(steps.FIRST_DAMPING), damping / factor)
        damping = np.where(is_accepted, np.maximum(decreased, float(steps.MIN_DAMPING)), factor * damping)
        self.damping[rows] = damping
        is_stopped = (is_first & ~enough) | (damping > float(steps.MAX_DAMPING))
        self.status[rows[is_stopped]] = steps.STOPPED
        rows, is_first, damping = rows[~is_stopped], is_first[~is_stopped], damping[~is_stopped]

        best, lower, upper = self.best[rows], self.lower[rows], self.upper[rows]
        matrices = self.accepted.H[rows]
        sides = self.accepted.b[rows]
        is_stopped = ((best <= lower) & (sides > 0)) | ((best >= upper) & (sides < 0))
        step = self._solve(matrices, sides, damping, is_stopped)
        change = np.clip(best + step, lower, upper) - best
        lengths = np.einsum("vi,vij,vj->v", change, matrices, change)
        is_repeated = ~is_first & (lengths <= float(steps.REPEATED)) & (lengths >= self.lengths[rows])
        is_small = np.abs(change).max(axis=1) <= self.tolerance
        is_small |= (lengths <= float(steps.INSIGNIFICANT)) | is_repeated
        self.lengths[rows] = lengths
        limits = np.where(self.joints.is_rotation, MAX_ROTATION, MAX_TRANSLATION)
        scale = np.maximum(np.abs(step / limits).max(axis=1), 1.0)
        moved = np.clip(best + step / scale[:, None], lower, upper)
        is_converged = is_small & (damping <= 1)
        self.status[rows[is_converged]] = steps.CONVERGED
        self.best[rows[is_converged]] = moved[is_converged]
        self.trial[rows] = moved
        self.iterations[rows[is_converged] if is_last else rows] += 1

    def _solve(
        self,
        matrices: NDArray[np.float64],
        sides: NDArray[np.float64],
        damping: NDArray[np.float64],
        is_stopped: NDArray[np.bool_],
    ) -> NDArray[np.float64]:
        """Return damped steps, 0 for joints whose links are invisible and for those that a limit stops."""
        diagonal = np.diagonal(matrices, axis1=1, axis2=2)
        is_free = (diagonal > 0) & ~is_stopped
        scales = np.ones(diagonal.shape)
        for joints in (self.joints.is_rotation, ~self.joints.is_rotation):
            used = is_free & joints
            mean = (diagonal * used).sum(axis=1) / np.maximum(used.sum(axis=1), 1)
            scales = np.where(used, damping[:, None] * mean[:, None], scales)
        free = matrices * is_free[:, :, None] * is_free[:, None, :]
        damped = free + scales[:, :, None] * np.eye(matrices.shape[-1])
        return np.linalg.solve(damped, -(sides * is_free)[..., None])[..., 0].astype(np.float64)

    def _results(self, axes: Convention) -> Registration:
        from warpvis.kernels.gradients.pose_steps import CONVERGED

        device, accepted = self.sums.device, self.accepted

        def upload(values: NDArray, dtype: type) -> wp.array:
            return wp.array(np.ascontiguousarray(values[self.groups]), dtype=dtype, device=device)

        positions = self.best[self.groups] + self.offsets
        poses, object_poses = wp.clone(self.poses), self.joints.evaluate(positions, self.world)[0]
        if axes != "opencv":
            poses = parse_poses(poses, convention="opencv", axes=axes, device=device)
        return Registration(
            poses,
            upload(covariance_of(accepted.H), wp.float64),
            upload(accepted.H, wp.float64),
            upload(accepted.b, wp.float64),
            upload(accepted.e, wp.float64),
            upload(accepted.inliers.astype(np.int32), wp.int32),
            upload(accepted.measured.astype(np.int32), wp.int32),
            upload((self.status == CONVERGED).astype(np.uint8), wp.uint8),
            upload(self.iterations, wp.int32),
            wp.array(object_poses, dtype=wp.transform, device=device),
            wp.array(positions, dtype=wp.float64, device=device),
        )


def covariance_of(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return inverses of information matrices, ``(V, J, J)``; +inf if the visible joints are not determined.

    A joint whose links are invisible has the variance +inf, and no correlation with others.
    """
    diagonal = np.diagonal(matrices, axis1=1, axis2=2)
    is_seen = diagonal > 0
    scale = 1 / np.sqrt(np.where(is_seen, diagonal, 1.0))
    both = scale[:, :, None] * scale[:, None, :]
    identity = np.eye(matrices.shape[-1])
    normalized = matrices * both + identity * ~is_seen[:, None, :]
    is_singular = np.linalg.eigvalsh(normalized)[:, 0] <= _SINGULAR
    normalized[is_singular] = identity
    found = both * np.linalg.inv(normalized)
    found[is_singular] = np.inf
    return np.where(identity * ~is_seen[:, None, :] > 0, np.inf, found)
