# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lines with a constant width in pixels: bands that face the camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.core.poses import poses_to_matrices
from warpvis.mujoco._visual_shapes import Blocks

_Floats = NDArray[np.float64]

# Pairs of corners of a box that an edge joins.
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
_EDGES = np.array([(i, j) for i in range(8) for j in range(i) if np.abs(_CORNERS[i] - _CORNERS[j]).sum() == 2])
_FACES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)  # the side that the camera sees


@dataclass(frozen=True, eq=False)
class Eye:
    """The camera, and its pose, that lines are drawn for."""

    camera: PlanarCamera
    pose: NDArray[np.float32]
    """Camera to world, ``x y z qx qy qz qw``."""


def facing(triangles: NDArray[np.floating], eye: Eye) -> NDArray[np.floating]:
    """Orient triangles so that the camera sees their front, corners ``(n, 3, 3)``: MuJoCo draws both sides of them."""
    a, b, c = np.swapaxes(triangles, 0, 1)
    place = poses_to_matrices(eye.pose.astype(np.float64))
    sight = place[:3, 2] if isinstance(eye.camera, OrthographicCamera) else a - place[:3, 3]
    away = (np.cross(b - a, c - a) * sight).sum(axis=1) > 0
    return np.where(away[:, None, None], triangles[:, [0, 2, 1]], triangles)


def bands(ends: _Floats, width: float, eye: Eye) -> Blocks:
    """Make lines of one width.

    Args:
        ends: Start and end points in the world [m], shape ``(n, 2, 3)``.
        width: Width [px].
        eye: The camera in whose image the lines have this width.
    """
    place = poses_to_matrices(eye.pose.astype(np.float64))
    forward, position = place[:3, 2], place[:3, 3]
    depth = (ends - position) @ forward
    # Parts behind the near plane are not visible and would be bands turned inside out.
    other = depth[:, ::-1]
    crosses = (depth < eye.camera.near) & (other > eye.camera.near)
    cut = np.where(crosses, (eye.camera.near - depth) / np.where(crosses, other - depth, 1.0), 0.0)
    along = ends[:, 1] - ends[:, 0]
    ends = ends + cut[..., None] * np.stack([along, -along], axis=1)
    depth = np.maximum((ends - position) @ forward, 0.0)
    orthographic = isinstance(eye.camera, OrthographicCamera)
    sight = np.broadcast_to(forward, along.shape) if orthographic else ends[:, 0] - position
    across = np.cross(along, sight)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across /= np.where(length > 0, length, 1)
    reach = np.ones_like(depth) if orthographic else depth
    half = _pixels(ends, depth, width, eye, place)[:, None] / 2 / eye.camera.fy * reach
    sides = half[..., None] * across[:, None]
    corners = np.concatenate([ends - sides, (ends + sides)[:, ::-1]], axis=1)
    return Blocks(corners, _FACES)


def _pixels(ends: _Floats, depth: _Floats, width: float, eye: Eye, place: _Floats) -> _Floats:
    """Return the widths of lines in an image [px], ``(n,)``: OpenGL measures whole pixels along a row or a column."""
    inside = (ends - place[:3, 3]) @ place[:3, :2]
    if not isinstance(eye.camera, OrthographicCamera):
        inside = inside / np.maximum(depth, eye.camera.near)[..., None]
    along = np.abs((inside[:, 1] - inside[:, 0]) * [eye.camera.fx, eye.camera.fy])
    length = np.linalg.norm(along, axis=1)
    slant = np.where(length > 0, along.max(axis=1) / np.where(length > 0, length, 1), 1)
    return max(1.0, math.floor(width + 0.5)) * slant


def line_ends(sizes: _Floats, position: _Floats, rotation: _Floats) -> _Floats:
    """Return both ends of lines that start at a position and extend along z by the third size."""
    return np.stack([position, position + rotation[:, :, 2] * sizes[:, 2:]], axis=1)


def box_edges(sizes: _Floats, position: _Floats, rotation: _Floats) -> _Floats:
    """Return both ends of all edges of boxes with the given half sizes, shape ``(12 n, 2, 3)``."""
    corners = (_CORNERS * sizes[:, None]) @ np.swapaxes(rotation, 1, 2) + position[:, None]
    return corners[:, _EDGES].reshape(-1, 2, 3)
