# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Many objects of one mesh: balls in rows and columns, movable or static."""

from __future__ import annotations

from functools import partial

import numpy as np
import trimesh
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.labels import Label
from warpvis.core.poses import look_at
from warpvis.scene import Scene
from warpvis.scenes.preset import ScenePreset

_RADIUS = 0.3
_EYE_HEIGHT = 5.0
_DOWN = 0.4  # downward component of viewing directions, per unit forward


def _side(count: int) -> int:
    return int(np.ceil(np.sqrt(count)))


def places(count: int) -> NDArray[np.float64]:
    """Return poses of the balls, 1 m apart on the ground, rows ``x y z qx qy qz qw``, shape ``(count, 7)``."""
    side = _side(count)
    number = np.arange(count)
    rows = np.zeros((count, 7))
    rows[:, 0], rows[:, 1] = number % side - side / 2, number // side - side / 2
    rows[:, 2], rows[:, 6] = _RADIUS, 1.0
    return rows


def _add_balls(scene: Scene, count: int, *, movable: bool) -> None:
    """Add balls of 320 triangles."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=_RADIUS)
    if movable:
        scene.add_instances(ball, places(count), names="ball", label=Label.OBJECT)
        return
    for number, row in enumerate(places(count)):
        scene.add(ball, name=f"ball_{number}", label=Label.OBJECT, pose=row)


def _walk(count: int, *, among: int) -> NDArray[np.float64]:
    """Return poses of cameras 5 m above the central part of `among` balls, that look forward and down."""
    rng = np.random.default_rng(0)
    reach = _side(among) / 3
    poses = []
    for _ in range(count):
        heading = rng.uniform(0, 2 * np.pi)
        eye = np.array([*rng.uniform(-reach, reach, 2), _EYE_HEIGHT])
        poses.append(look_at(eye, eye + [np.cos(heading), np.sin(heading), -_DOWN]))
    return np.array(poses).reshape(count, 7)


_CAMERA = Camera.from_fov(320, 240, hfov=1.0, near=0.1, far=2000.0)


def _preset(name: str, title: str, count: int, *, movable: bool) -> ScenePreset:
    add = partial(_add_balls, count=count, movable=movable)
    return ScenePreset(name, title, add, _CAMERA, partial(_walk, among=count))


CROWDS: tuple[ScenePreset, ...] = (
    _preset("crowd_1k", "1,000 balls that may move", 1000, movable=True),
    _preset("crowd_10k", "10,000 balls that may move", 10_000, movable=True),
    _preset("crowd_100k", "100,000 balls that may move", 100_000, movable=True),
    _preset("crowd_1k_static", "1,000 balls that stay", 1000, movable=False),
    _preset("crowd_10k_static", "10,000 balls that stay", 10_000, movable=False),
    _preset("crowd_100k_static", "100,000 balls that stay", 100_000, movable=False),
)
"""Movable balls, and the same balls as static objects, with identical images."""
