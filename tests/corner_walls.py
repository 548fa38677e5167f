# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Walls whose triangles have vertices on the rays of pixel centers."""

import numpy as np

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.scenes.terrain import grid_faces

_TURNS = [(0, 0, 0, 1), (1, 0, 0, 0), (0.5, -0.5, 0.5, -0.5)]


def wall(seed: int) -> tuple[wv.Camera, np.ndarray, np.ndarray, np.ndarray]:
    """Return a camera, its pose, and the vertices and faces of a wall with a vertex at every pixel center."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-1, 1)
    turn = rng.normal(size=4)
    turn = _TURNS[seed] if seed < len(_TURNS) else turn / np.linalg.norm(turn)
    x = np.arange(-24.0, 24.25, 0.5) * scale  # a pixel is 1 m at 100 m, times the scale
    corners = np.stack([*np.meshgrid(x, x, indexing="ij"), np.full((len(x), len(x)), 100.0 * scale)], -1)
    pose = np.r_[rng.normal(size=3) * 10.0 ** rng.uniform(0, 2), turn].astype(np.float32)
    placed = poses_to_matrices(pose)
    vertices = (corners.reshape(-1, 3) @ placed[:3, :3].T + placed[:3, 3]).astype(np.float32)
    return wv.Camera(40, 40, 100.0, 100.0, 20.5, 20.5), pose, vertices, grid_faces(len(x))
