# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Registration of poses of the camera or of one object: Levenberg-Marquardt steps on the device."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.kernel_cache import launch
from warpvis.core.poses import Convention, parse_poses
from warpvis.maps._register_sums import NUM_SUMS, DepthSums
from warpvis.maps._registration import Registration

# Largest step [rad, m].
MAX_ROTATION, MAX_TRANSLATION = 0.35, 0.5


class PoseSolver:
    """Registration of poses, block by block."""

    def __init__(self, sums: DepthSums, tolerance: float, iterations: int) -> None:
        from warpvis.kernels.gradients.pose_steps import StepLimits

        self.sums, self.device, self.iterations = sums, sums.device, iterations
        (self.column,) = sums.bodies
        self.limits = StepLimits()
        self.limits.max_rotation, self.limits.max_translation = MAX_ROTATION, MAX_TRANSLATION
        self.limits.tolerance = tolerance

    def run(self, poses: wp.array, worlds: Any, axes: Convention) -> Registration:
        """Return the results of all views: poses of the camera in the given convention, or of the object."""
        moved, state = self._solve(poses, worlds)
        return self._results(moved, state, axes)

    def _solve(self, poses: wp.array, worlds: Any) -> tuple[wp.array, Any]:
        """Return the moved poses, ``(V, 1)`` or ``(V, M)``, and the state of the solver."""
        count = len(poses)
        moved, state = self._initial(poses, worlds), self._state(count)
        sums = wp.zeros((count, NUM_SUMS), dtype=wp.float64, device=self.device)
        poses, worlds = self._shown(poses, moved, worlds)
        for block in self.sums.blocks(count):
            self._run_block(block, poses, moved, worlds, state, sums)
        return moved, state

    def _initial(self, poses: wp.array, worlds: Any) -> wp.array:
        """Return the poses that will be moved, ``(V, 1)``, or with those of all movable objects, ``(V, M)``."""
        from warpvis.kernels.gradients.normal_equations import spread_object_poses

        if self.column < 0:
            return wp.clone(poses).reshape((len(poses), 1))
        moved = wp.empty((len(poses), worlds.object_poses.shape[1]), dtype=wp.transform, device=self.device)
        launch(spread_object_poses, moved.shape, [worlds, moved], self.device)
        return moved

    def _shown(self, poses: wp.array, moved: wp.array, worlds: Any) -> tuple[wp.array, Any]:
        """Return camera poses and worlds that share the memory of the moved poses."""
        from warpvis.kernels.casting.worlds import Worlds

        if self.column < 0:
            return moved.reshape((len(poses),)), worlds
        shown = Worlds()
        shown.object_poses, shown.excluded = moved, worlds.excluded
        return poses, shown

    def _state(self, count: int) -> Any:
        """Return the first state of the solver of this many poses."""
        from warpvis.kernels.gradients.pose_steps import SolverState

        state = SolverState()
        state.status = wp.zeros(count, dtype=wp.int32, device=self.device)
        state.iterations = wp.zeros(count, dtype=wp.int32, device=self.device)
        state.damping = wp.zeros(count, dtype=wp.float64, device=self.device)
        state.lengths = wp.zeros(count, dtype=wp.float64, device=self.device)
        state.best = wp.empty(count, dtype=wp.transform, device=self.device)
        state.sums = wp.zeros((count, NUM_SUMS), dtype=wp.float64, device=self.device)
        return state

    def _run_block(
        self, block: slice, poses: wp.array, moved: wp.array, worlds: Any, state: Any, sums: wp.array
    ) -> None:
        """Register some views: all of them in each iteration on CUDA, those that are not finished on a CPU."""
        from warpvis.kernels.gradients.pose_steps import SolverState, step_poses

        part = SolverState()
        for name in ("status", "iterations", "damping", "lengths", "best", "sums"):
            setattr(part, name, getattr(state, name)[block])
        sums_in, moved_out = sums[block], moved[block]
        numbers = np.arange(block.start, block.stop, dtype=np.int32)
        chosen: slice | NDArray[np.integer] = block
        for iteration in range(self.iterations + 1):
            if self.device.is_cpu:
                running = numbers[part.status.numpy() == 0]
                chosen = block if len(running) == len(numbers) else running
                if not len(running):
                    break
            self.sums.add(chosen, poses, worlds, [sums])
            is_last = iteration == self.iterations
            inputs = [self.limits, max(self.column, 0), is_last, sums_in, part, moved_out]
            launch(step_poses, len(numbers), inputs, self.device)

    def _results(self, moved: wp.array, state: Any, axes: Convention) -> Registration:
        """Return the results of the accepted poses."""
        from warpvis.kernels.gradients.pose_steps import write_results

        count = len(moved)
        arrays: dict[str, wp.array] = {}
        for name, shape, dtype in (
            ("H", (6, 6), wp.float64),
            ("b", (6,), wp.float64),
            ("e", (), wp.float64),
            ("covariance", (6, 6), wp.float64),
            ("num_inliers", (), wp.int32),
            ("num_measured", (), wp.int32),
            ("converged", (), wp.uint8),
        ):
            arrays[name] = wp.empty((count, *shape), dtype=dtype, device=self.device)
        launch(write_results, count, [state, *arrays.values()], self.device)
        poses = state.best
        if self.column < 0 and axes != "opencv":
            poses = parse_poses(poses, convention="opencv", axes=axes, device=self.device)
        return Registration(
            poses, iterations=state.iterations, object_poses=None if self.column < 0 else moved, **arrays
        )
