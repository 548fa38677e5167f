# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Hilly terrain from the air, with meshes so fine that most triangles are smaller than a pixel."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.labels import Label
from warpvis.core.poses import look_at
from warpvis.scene import Scene
from warpvis.scenes.preset import ScenePreset

_WIDTH = 1000.0
_WAVES = 12
_ROUGHNESS = 0.15  # relative to the grid spacing
_FLIGHT_HEIGHT = 40.0
_DOWN = 0.25  # downward component of viewing directions, per unit forward


def _waves() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return wave vectors, amplitudes and phases of the waves that form the hills."""
    rng = np.random.default_rng(0)
    octave = 2.0 ** (np.arange(_WAVES) / 2)
    return (
        2 * np.pi / _WIDTH * octave[:, None] * rng.normal(size=(_WAVES, 2)),
        12 / octave,
        rng.uniform(0, 2 * np.pi, _WAVES),
    )


def _heights(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the smooth part of the terrain's height [m]."""
    heights = np.zeros(np.broadcast_shapes(x.shape, y.shape))
    for (along_x, along_y), height, phase in zip(*_waves(), strict=True):
        heights += height * np.sin(along_x * x + along_y * y + phase)
    return heights


def ground(side: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Build a rough square of 1 km with ``side * side`` vertices; return vertices [m] and faces."""
    x = np.linspace(-_WIDTH / 2, _WIDTH / 2, side)
    rough = np.random.default_rng(1).normal(size=(side, side)) * (_ROUGHNESS * _WIDTH / side)
    vertices = np.empty((side, side, 3), dtype=np.float32)
    vertices[..., 0], vertices[..., 1] = x[:, None], x
    vertices[..., 2] = _heights(x[:, None], x) + rough
    return vertices.reshape(-1, 3), grid_faces(side)


def grid_faces(side: int) -> NDArray[np.int32]:
    """Return the faces of a grid of ``side * side`` vertices in row-major order, two per cell."""
    index = np.arange(side * side, dtype=np.int32).reshape(side, side)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])


def _add_ground(side: int, scene: Scene) -> None:
    scene.add(ground(side), name="ground", label=Label.GROUND)


def _flight(count: int) -> NDArray[np.float64]:
    """Return poses of cameras 40 m above the central part of the terrain, that look forward and slightly down."""
    rng = np.random.default_rng(1)
    poses = []
    for _ in range(count):
        x, y, heading = *rng.uniform(-300, 300, 2), rng.uniform(0, 2 * np.pi)
        eye = np.array([x, y, _heights(np.array(x), np.array(y)) + _FLIGHT_HEIGHT])
        poses.append(look_at(eye, eye + [np.cos(heading), np.sin(heading), -_DOWN]))
    return np.array(poses).reshape(count, 7)


_CAMERA = Camera.from_fov(320, 240, hfov=np.pi / 3, near=0.1, far=2000.0)


def _preset(name: str, title: str, side: int) -> ScenePreset:
    return ScenePreset(name, f"Hills from the air, {title} triangles", partial(_add_ground, side), _CAMERA, _flight)


TERRAINS: tuple[ScenePreset, ...] = (
    _preset("terrain_200k", "200 k", 317),
    _preset("terrain_2m", "2 M", 1001),
    _preset("terrain_10m", "10 M", 2237),
    _preset("terrain_50m", "50 M", 5001),
)
"""The same hills with grid spacings of 3.2, 1, 0.45 and 0.2 m."""
