# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Where a robot could go to see what a person may mean and it does not see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import check_metres
from warpvis.core.checks import as_items
from warpvis.core.poses import QuaternionOrder, check_up, to_xyzw
from warpvis.core.types import ObjectPoses
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.planning._best_views import best_views, pose_grid
from warpvis.planning._free_space import one_world, standing_room
from warpvis.scene import Scene, require_scene
from warpvis.visibility import Agent, Candidate, FieldOfView, State

# Places that see the objects equally well up to this: the nearest is taken.
_TIE = 0.05


@dataclass(frozen=True, eq=False)
class Proposal:
    """A pose from which a robot's camera sees objects that it does not see now."""

    pose: NDArray[np.float64]
    """The camera's pose, row ``x y z qx qy qz qw`` of the OpenCV frame, shape ``(7,)``."""
    distance: float
    """Way to it in a straight line on the floor [m]."""
    fractions: dict[str, float]
    """Visible share of the silhouette of every object that has to be seen, by name."""

    def report(self) -> dict[str, Any]:
        """Report the same in plain Python values that `json.dumps` takes."""
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
    """Find where a robot near its present place sees the most of the objects that only the person sees.

    The camera keeps its height and looks at the likeliest of the objects. Places are those of `pose_grid` at which the
    robot has `standing_room`. Objects weigh as much as the person is likely to mean them, by `Candidate.score`. Of
    places that see about as much, the nearest is taken.

    Args:
        scene: The world.
        robot: The robot, at one pose, with a `Camera`.
        candidates: What `Perspective.candidates` found of the person and the robot.
        max_distance: How far the robot may go [m].
        step: Distance of neighbouring places [m].
        radius: Radius of the robot, an upright cylinder around its camera [m].
        floor: Height of the floor [m].
        object_poses: Where the movable objects are, as for `Renderer.render`, in one world; by default where they were
            when the candidates were found.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.

    Returns:
        The pose; None if the robot sees all that the person sees, or no place in reach shows any of it.

    Raises:
        WarpvisError: An argument is not what it has to be.
    """
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    require_scene(scene)
    if not isinstance(robot, Agent):
        raise SceneError(f"robot must be a warpvis.Agent, got {type(robot).__name__}")
    given = as_items(candidates, "candidates", SceneError)
    wrong = [type(item).__name__ for item in given if not isinstance(item, Candidate)]
    if wrong:
        raise SceneError(f"candidates must be what Perspective.candidates found, got {wrong[0]}")
    if isinstance(robot.camera, FieldOfView):
        raise CameraError(f"camera of {robot.name!r} must be a warpvis.Camera to be placed, got a FieldOfView")
    if len(robot.poses) != 1:
        raise ArrayError(f"{robot.name!r} must have one pose to start from, got {len(robot.poses)}")
    missed = [item for item in given if item.state == State.FIRST and item.object not in robot.body]
    if not missed:
        return None
    max_distance = check_metres(max_distance, "max_distance")
    here, vertical = robot.poses[0], check_up(scene.up)
    moved = missed[0].object_poses if object_poses is None else object_poses
    corners = one_world(scene, moved, None)[0][scene.index(missed[0].object)]
    target = np.stack([corners.min(axis=0), corners.max(axis=0)]).astype(np.float64).mean(axis=0)
    places = pose_grid(
        here[:3], radius=max_distance, step=step, height=float(here[vertical]), look_at=target, up=scene.up
    )
    options: dict[str, Any] = {"object_poses": moved, "exclude": list(robot.body) or None}
    room = standing_room(scene, places, radius=radius, floor=floor, **options)
    if not room.any():
        return None
    found = best_views(
        scene,
        robot.camera,
        places[room],
        objects=[item.object for item in missed],
        weights=[item.score for item in missed],
        start=here,
        tie=_TIE,
        **options,
    )
    best = int(found.order[0])
    if found.scores[best] <= 0:
        return None
    assert found.path_lengths is not None  # the start is given
    fractions = dict(zip(found.objects, found.values[best].astype(float).tolist(), strict=True))
    return Proposal(found.candidates[best], float(found.path_lengths[best]), fractions)
