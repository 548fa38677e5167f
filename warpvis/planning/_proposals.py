# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Proposals of poses from which a robot sees objects that only a person sees now."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import check_length
from warpvis.core.checks import as_items
from warpvis.core.poses import QuaternionOrder, check_up, to_xyzw
from warpvis.core.types import ObjectPoses
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.planning._best_views import best_views, pose_grid
from warpvis.planning._free_space import one_world, standing_room
from warpvis.scene import Scene, require_scene
from warpvis.visibility import Agent, Candidate, FieldOfView, State

# Step of scores within which the nearest position is chosen.
_TIE = 0.05


@dataclass(frozen=True, eq=False)
class Proposal:
    """A pose from which a robot's camera sees objects that it does not see now."""

    pose: NDArray[np.float64]
    """The camera's pose, ``x y z qx qy qz qw``, OpenCV camera to world, shape ``(7,)``."""
    distance: float
    """Straight-line distance to it on the floor [m]."""
    fractions: dict[str, float]
    """Visible fraction of the silhouette of every missed object, by name."""

    def report(self) -> dict[str, Any]:
        """Return the proposal as plain Python values for `json.dumps`."""
        return {"pose": self.pose.tolist(), "distance": self.distance, "fractions": self.fractions}


def propose_view(
    scene: Scene,
    robot: Agent,
    candidates: list[Candidate],
    *,
    max_distance: float = 2.0,
    step: float = 0.1,
    radius: float = 0.2,
    floor: float = 0.0,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
) -> Proposal | None:
    """Find a pose near the robot from which it sees the most of the objects that only the person sees.

    The camera keeps its height and looks at the most likely of these objects. Candidate positions are those of
    `pose_grid` at which the robot has `standing_room`. Objects are weighted by `Candidate.score`, their likelihood to
    be meant by the person. Among positions with similar scores, the nearest is chosen.

    Args:
        scene: The scene.
        robot: The robot, at one pose, with a `Camera`.
        candidates: Candidates of the person and the robot, from `Perspective.candidates`.
        max_distance: Maximum distance that the robot moves [m].
        step: Spacing of candidate positions [m].
        radius: Radius of the robot, an upright cylinder around its camera [m].
        floor: Height of the floor [m].
        object_poses: Poses of the movable objects in one world, as for `Renderer.render`; by default those of
            `candidates`.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.

    Returns:
        The pose; None if the robot sees all objects that the person sees, or sees none of the others from any position.
    """
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    require_scene(scene)
    if not isinstance(robot, Agent):
        raise SceneError(f"robot must be a warpvis.Agent, got {type(robot).__name__}")
    items = as_items(candidates, "candidates", SceneError)
    wrong = [type(item).__name__ for item in items if not isinstance(item, Candidate)]
    if wrong:
        raise SceneError(f"candidates must be Candidate objects from Perspective.candidates, got {wrong[0]}")
    if isinstance(robot.camera, FieldOfView):
        raise CameraError(f"camera of {robot.name!r} must be a warpvis.Camera, got a FieldOfView")
    if len(robot.poses) != 1:
        raise ArrayError(f"{robot.name!r} must have one pose, got {len(robot.poses)}")
    missed = [item for item in items if item.state == State.FIRST and item.object not in robot.body]
    if not missed:
        return None
    max_distance = check_length(max_distance, "max_distance")
    current_pose, vertical = robot.poses[0], check_up(scene.up)
    moved = missed[0].object_poses if object_poses is None else object_poses
    corners = one_world(scene, moved, None)[0][scene.index(missed[0].object)]
    target = np.stack([corners.min(axis=0), corners.max(axis=0)]).astype(np.float64).mean(axis=0)
    places = pose_grid(
        current_pose[:3],
        radius=max_distance,
        step=step,
        height=float(current_pose[vertical]),
        look_at=target,
        up=scene.up,
    )
    options: dict[str, Any] = {"object_poses": moved, "exclude": list(robot.body) or None}
    is_free = standing_room(scene, places, radius=radius, floor=floor, **options)
    if not is_free.any():
        return None
    found = best_views(
        scene,
        robot.camera,
        places[is_free],
        objects=[item.object for item in missed],
        weights=[item.score for item in missed],
        start=current_pose,
        tie=_TIE,
        **options,
    )
    best = int(found.order[0])
    if found.scores[best] <= 0:
        return None
    assert found.path_lengths is not None  # the start is given
    fractions = dict(zip(found.objects, found.values[best].astype(float).tolist(), strict=True))
    return Proposal(found.candidates[best], float(found.path_lengths[best]), fractions)
