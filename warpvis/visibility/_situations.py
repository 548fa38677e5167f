# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations: matching poses of several agents with worlds of movable objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_warp
from warpvis.core.checks import pluralize
from warpvis.core.poses import poses_to_matrices
from warpvis.core.types import ArrayInput, ObjectPoses
from warpvis.errors import ArrayError
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds, pose_columns
from warpvis.visibility._agents import Agent


@dataclass(frozen=True)
class Situations:
    """Poses of the movable objects in each of `count` situations."""

    count: int
    """Number of situations."""
    object_poses: wp.array | None
    """Poses of the movable objects in the worlds, ``(W, M)`` transforms; None if nothing is movable."""
    world_index: NDArray[np.int32] | None
    """World of each situation, ``(count,)``; None if there is only one world."""

    @classmethod
    def parse(
        cls, scene: Scene, agents: Sequence[Agent], object_poses: ObjectPoses, world_index: ArrayInput | None
    ) -> Situations:
        """Combine agents' poses and worlds to situations: each has one for all situations, or one for each.

        Raises:
            ArrayError: If the numbers of poses and worlds do not match.
            PoseError: If the poses of the objects are malformed.
        """
        counts = {f"{agent.name!r} has {pluralize(len(agent.poses), 'pose')}": len(agent.poses) for agent in agents}
        if world_index is None:
            # Parse for a single view, since the number of situations is not yet known.
            poses = parse_worlds(scene, 1, object_poses, [0], None).object_poses
            worlds = np.arange(len(poses), dtype=np.int32)
        else:
            worlds = as_warp(world_index, wp.int32, ("V",), name="world_index", device=scene.device).numpy()
            poses = parse_worlds(scene, len(worlds), object_poses, worlds, None).object_poses
        if world_index is not None or len(worlds) > 1:
            counts[
                f"{'object_poses' if world_index is None else 'world_index'} has {pluralize(len(worlds), 'world')}"
            ] = len(worlds)
        count = max(counts.values())
        if any(number not in (1, count) for number in counts.values()):
            raise ArrayError(f"agents and worlds must have one situation or the same number: {', '.join(counts)}")
        several = len(poses) > 1
        return cls(
            count=count,
            object_poses=poses if scene.movable else None,
            world_index=np.ascontiguousarray(np.broadcast_to(worlds, count)) if several else None,
        )

    def rows(self) -> NDArray[np.float32] | None:
        """Return the poses of movable objects, ``(count, M, 7)`` or ``(1, M, 7)``; None if nothing is movable."""
        if self.object_poses is None:
            return None
        rows = np.array(self.object_poses.numpy(), dtype=np.float32)
        return rows if self.world_index is None else rows[self.world_index]

    def centers(self, scene: Scene, indices: Sequence[int]) -> NDArray[np.float64]:
        """Return the centers of objects' boxes in each situation's world [m], ``(count, K, 3)`` or ``(1, K, 3)``.

        Boxes of movable objects are aligned with their frames, boxes of static objects with the world.
        """
        rows = None if self.object_poses is None else self.object_poses.numpy()
        columns = pose_columns(scene)
        all_centers = np.empty((1 if rows is None else len(rows), len(indices), 3))
        for k, index in enumerate(indices):
            corners = scene.objects[index].frame_vertices
            center = (corners.min(axis=0).astype(np.float64) + corners.max(axis=0)) / 2
            if rows is not None and columns[index] >= 0:
                frames = poses_to_matrices(rows[:, columns[index]])
                center = frames[:, :3, :3] @ center + frames[:, :3, 3]
            all_centers[:, k] = center
        return all_centers if self.world_index is None else all_centers[self.world_index]
