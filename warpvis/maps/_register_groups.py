# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Registration of poses that move together, such as those of a camera on a robot's hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, take_rows
from warpvis.core.kernel_cache import launch
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.maps._register_poses import PoseSolver
from warpvis.maps._register_sums import NUM_SUMS, DepthSums


def parse_groups(groups: ArrayInput, count: int) -> NDArray[np.int32]:
    """Return the groups of views, numbered without gaps; any number of views if all else is of one view."""
    host = as_numpy(groups, name="groups")
    count = len(host) if count == 1 and host.ndim == 1 and len(host) else count
    expected = f"groups must be the number of each view's group, {count} integers from 0"
    if host.shape != (count,) or host.dtype.kind not in "iu":
        raise ArrayError(f"{expected}, got {host.dtype} {host.shape}")
    if (host < 0).any():
        raise ArrayError(f"{expected}, got {host.min()}")
    return np.unique(host, return_inverse=True)[1].reshape(-1).astype(np.int32)


class GroupSolver(PoseSolver):
    """Registration of poses that have one motion in each group of views."""

    def __init__(self, sums: DepthSums, tolerance: float, iterations: int, groups: NDArray[np.int32]) -> None:
        """Initialize with the group of each view, numbered without gaps."""
        super().__init__(sums, tolerance, iterations)
        self.groups = groups

    def _solve(self, poses: wp.array, worlds: Any) -> tuple[wp.array, Any]:
        from warpvis.kernels.gradients.pose_groups import add_groups, move_views, spread_sums
        from warpvis.kernels.gradients.pose_steps import SolverState, step_poses

        views, groups = len(poses), int(self.groups.max()) + 1
        column, moved = max(self.column, 0), self._initial(poses, worlds)
        members = self._members(wp.clone(moved[:, column]))
        motions = wp.array(np.tile([[0, 0, 0, 0, 0, 0, 1]], (groups, 1)), dtype=wp.transform, device=self.device)
        motions = motions.reshape((groups, 1))
        state = self._state(groups)
        sums = wp.zeros((views, NUM_SUMS), dtype=wp.float64, device=self.device)
        of_groups = wp.zeros((groups, NUM_SUMS), dtype=wp.float64, device=self.device)
        poses, worlds = self._shown(poses, moved, worlds)
        blocks = self.sums.blocks(views)
        for iteration in range(self.iterations + 1):
            chosen = self._running(blocks, state)
            for part in chosen:
                self.sums.add(part, poses, worlds, [sums])
            if not chosen:
                break
            launch(add_groups, groups, [members, sums, of_groups], self.device)
            is_last = iteration == self.iterations
            launch(step_poses, groups, [self.limits, 0, is_last, of_groups, state, motions], self.device)
            launch(move_views, views, [members, motions, column, moved], self.device)

        of_views = SolverState()
        for name in ("status", "iterations"):
            setattr(of_views, name, take_rows(getattr(state, name), self.groups))
        of_views.best = wp.clone(moved[:, column])
        of_views.sums = sums
        launch(spread_sums, views, [members, state.sums, sums], self.device)
        return moved, of_views

    def _running(self, blocks: list[slice], state: Any) -> list[slice | NDArray[np.integer]]:
        """Return the views to render: all on CUDA, those of groups that are not finished on a CPU."""
        if not self.device.is_cpu:
            return list(blocks)
        is_running = (state.status.numpy() == 0)[self.groups]
        parts = [(block, np.flatnonzero(is_running[block]).astype(np.int32) + block.start) for block in blocks]
        return [
            block if len(numbers) == block.stop - block.start else numbers for block, numbers in parts if len(numbers)
        ]

    def _members(self, initial: wp.array) -> Any:
        """Return the views of each group as a struct for kernels."""
        from warpvis.kernels.gradients.pose_groups import Groups

        order = np.argsort(self.groups, kind="stable")
        first = np.searchsorted(self.groups[order], np.arange(self.groups.max() + 2))
        groups = Groups()
        for name, values in (("group", self.groups), ("first", first), ("views", order)):
            setattr(groups, name, wp.array(values.astype(np.int32), dtype=wp.int32, device=self.device))
        groups.initial = initial
        return groups
