# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of 5 thousand to 1.2 million triangles, for benchmarks that are comparable between releases."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.labels import Label
from warpvis.core.poses import look_at
from warpvis.scene import Scene
from warpvis.scenes import shapes
from warpvis.scenes.preset import ScenePreset

_BLOB_COUNT = 60


def _orbit(count: int) -> NDArray[np.float64]:
    """Return poses of cameras on a circle of radius 3.5 m around the center, 0.8 to 1.4 m high, that look at it."""
    rng = np.random.default_rng(1)
    poses = []
    for _ in range(count):
        angle, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.8, 1.4)
        eye = (-3.5 * np.cos(angle), -3.5 * np.sin(angle), height)
        poses.append(look_at(eye, rng.uniform(-0.5, 0.5, 3) + [0, 0, 0.4]))
    return np.array(poses).reshape(count, 7)


def _add_room(scene: Scene) -> None:
    """Add a floor, two obstacles, a ball and a capsule of a person's height: 5,412 triangles, mostly small ones."""
    scene.add(shapes.floor(4, 4), name="floor", label=Label.GROUND)
    scene.add(shapes.standing_box((0.2, 0.6, 0.5), 0.5, 0.4), name="low obstacle")
    scene.add(shapes.standing_box((0.2, 0.6, 0.9), 0.5, -0.6), name="high obstacle")
    scene.add(shapes.ball(0.2, 1.0, 0.0), name="ball", label=Label.OBJECT)
    human = trimesh.creation.capsule(height=1.4, radius=0.2)
    scene.add(human, name="person", label=Label.HUMAN, pose=(1.5, 0.5, 0.9, 0, 0, 0, 1))


def _add_blobs(scene: Scene, subdivisions: int) -> None:
    """Add a floor and 60 dented balls of 20 * 4^subdivisions triangles each."""
    rng = np.random.default_rng(0)
    scene.add(shapes.floor(8, 8), name="floor", label=Label.GROUND)
    for i in range(_BLOB_COUNT):
        blob = trimesh.creation.icosphere(subdivisions=subdivisions, radius=rng.uniform(0.1, 0.5))
        blob.vertices += 0.02 * np.sin(20 * blob.vertices[:, [1, 2, 0]])
        place = rng.uniform(-3, 3, 3) * [1, 1, 0] + [0, 0, rng.uniform(0, 1.5)]
        scene.add((blob.vertices + place, blob.faces), name=f"blob_{i}", label=Label.OBJECT)


_CAMERA = Camera.from_fov(320, 240, hfov=0.994837, near=0.05, far=100.0)

BENCHMARK_SCENES: tuple[ScenePreset, ...] = (
    ScenePreset("room", "A room, 5.4 k triangles", _add_room, _CAMERA, _orbit),
    ScenePreset("blobs_77k", "Balls, 77 k triangles", lambda scene: _add_blobs(scene, 3), _CAMERA, _orbit),
    ScenePreset("blobs_1m", "Balls, 1.2 M triangles", lambda scene: _add_blobs(scene, 5), _CAMERA, _orbit),
)
"""A room, and the same balls coarse and fine; all with the same camera and orbit."""
