# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Decide occlusion of points by triangles in double precision: for all points at once, or for one with its margins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis import Camera
from warpvis.core.poses import poses_to_matrices

MARGIN = 1e-6
"""Distance of a ray from an edge, or of a point from the limit of occlusion, that leaves the result open [m]."""

_DIRECTIONS = 8
_CELL = 4  # pixels


def hidden_points(
    corners: NDArray[np.float64],
    camera: Camera,
    pose: NDArray[np.float32],
    points: NDArray[np.float32],
    tolerance: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Return whether any triangle is between the camera and each point, less its tolerance along the ray [m].

    Every triangle is tested against all points within the bounding box of its image: no acceleration structure, no
    tolerance.

    Args:
        corners: Triangles in the world frame [m], shape ``(T, 3, 3)``.
        camera: Camera whose image contains all points.
        pose: Camera pose, shape ``(7,)``.
        points: Points in the world frame [m], shape ``(N, 3)``.
        tolerance: Distance behind a surface at which a point still counts as visible [m], shape ``(N,)``.
    """
    matrix = poses_to_matrices(pose)
    local = (points.astype(np.float64) - matrix[:3, 3]) @ matrix[:3, :3]
    ends = local * (1 - tolerance / np.linalg.norm(local, axis=1))[:, None]
    triangles = (corners - matrix[:3, 3]) @ matrix[:3, :3]
    pixels = camera.project(local)
    columns, rows = -(-camera.width // _CELL), -(-camera.height // _CELL)
    cell = np.clip(pixels // _CELL, 0, [columns - 1, rows - 1]).astype(np.int64) @ [1, columns]
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(columns * rows + 1))

    hidden = np.zeros(len(points), dtype=bool)
    behind = triangles[:, :, 2] <= 0
    outlines = camera.project(np.where(behind[..., None], np.nan, triangles))
    for triangle, outline, back in zip(triangles, outlines, behind, strict=True):
        if back.all():
            continue
        low, high = np.array([0, 0]), np.array([columns - 1, rows - 1])
        if not back.any():
            low = np.maximum(np.floor((outline.min(axis=0) - 0.01) / _CELL), low).astype(int)
            high = np.minimum(np.floor((outline.max(axis=0) + 0.01) / _CELL), high).astype(int)
        if (low > high).any():
            continue
        spans = [(first[y * columns + low[0]], first[y * columns + high[0] + 1]) for y in range(low[1], high[1] + 1)]
        near = np.concatenate([order[begin:end] for begin, end in spans])
        near = near[~hidden[near]]
        if len(near):
            hidden[near] = _between(triangle[None], ends[near])[0]
    return hidden


def _between(triangles: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether triangles ``(T, 3, 3)`` are between the origin and points ``(N, 3)``, shape ``(T, N)``."""
    a, b, c = triangles.swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    sides = np.stack([np.cross(p, q) @ ends.T for p, q in ((a, b), (b, c), (c, a))])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (normal * a).sum(axis=1)[:, None] / (normal @ ends.T)
    return ((sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)) & (share > 0) & (share < 1)


def is_sure(
    corners: NDArray[np.float64], eye: NDArray[np.float64], point: NDArray[np.float64], tolerance: float
) -> tuple[bool, bool]:
    """Return whether a point is occluded, and whether it is within a margin across or along the ray."""
    along = (point - eye) / np.linalg.norm(point - eye)
    right = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    right /= np.linalg.norm(right)
    down, end = np.cross(along, right), point - tolerance * along
    turns = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS

    def hides(eye: NDArray[np.float64], end: NDArray[np.float64]) -> bool:
        return bool(_between(corners - eye, (end - eye)[None]).any())

    offsets = MARGIN * (np.outer(np.cos(turns), right) + np.outer(np.sin(turns), down))
    hidden = hides(eye, end)
    shifted = [hides(eye + step, end + step) for step in offsets]
    shifted += [hides(eye, end + step * along) for step in (-MARGIN, MARGIN)]
    return hidden, all(other == hidden for other in shifted)
