# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check the arguments of a `DepthWatcher`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import as_items, check_mapping, check_text, is_number
from warpvis.core.poses import Convention, QuaternionOrder, poses_to_opencv, to_xyzw
from warpvis.core.types import PoseLike
from warpvis.errors import ArrayError, PoseError, SceneError
from warpvis.maps import FloorFit
from warpvis.visibility._agents import Agent
from warpvis.visibility.watching._sights import Target


def read_row(pose: PoseLike, convention: Convention, quaternion: QuaternionOrder) -> NDArray[np.float64]:
    """Return the pose of the camera as a row with OpenCV axes."""
    values = as_numpy(to_xyzw(pose, quaternion, "camera_to_world"), name="camera_to_world")
    rows = poses_to_opencv(values, convention, name="camera_to_world")
    if len(rows) != 1:
        raise PoseError(f"camera_to_world must be one pose, got {len(rows)}")
    return rows[0]


def read_places(places: Mapping[str, ArrayLike] | None) -> list[Target]:
    targets = []
    for name, values in check_mapping({} if places is None else places, "places").items():
        row = as_numpy(values, name=f"place {check_text(name, 'name of a place')!r}").astype(np.float64)
        if row.shape not in ((3,), (4,)) or not np.isfinite(row).all() or (len(row) == 4 and row[3] < 0):
            raise ArrayError(f"place {name!r} must be a point x y z or a sphere x y z diameter [m], got {row.tolist()}")
        targets.append(Target(name, row[:3], float(row[3]) if len(row) == 4 else 0.0))
    return targets


def read_floor(floor: object) -> NDArray[np.float64]:
    """Return the transform to the floor's world."""
    if isinstance(floor, FloorFit):
        return floor.world_from_input
    if not is_number(floor) or not math.isfinite(floor):
        raise ArrayError(f"floor must be the result of fit_floor or the height of the floor [m], got {floor!r}")
    return np.array([0.0, 0.0, -floor, 0.0, 0.0, 0.0, 1.0])


def read_people(people: Sequence[Agent], robot: str) -> list[Agent]:
    agents = as_items(people, "people", SceneError)
    names = [robot]
    for agent in agents:
        if not isinstance(agent, Agent):
            raise SceneError(f"people must be warpvis.Agent, such as Agent.human, got {type(agent).__name__}")
        if len(agent.poses) != 1:
            raise SceneError(f"{agent.name!r} must have one pose, got {len(agent.poses)}")
        if agent.name in names:
            raise SceneError(f"people and the robot must have different names, got {agent.name!r} more than once")
        names.append(agent.name)
    return agents


def read_angles(angles: object) -> tuple[float, float]:
    """Return two numbers."""
    items = as_items(angles, "angles")
    if len(items) != 2 or not all(is_number(item) for item in items):
        raise ArrayError(f"angles must be two numbers, to the right and up [rad], got {angles!r}")
    return items[0], items[1]
