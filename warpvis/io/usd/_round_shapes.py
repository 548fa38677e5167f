# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of boxes and round shapes about z, with the normals of the true surface at their corners.

The corners lie slightly outside of the true surface, so that the triangles lie as far outside of it at their corners as
inside at the middles of their edges, or on spheres, at the middles of quadrilaterals. The tolerance is relative, since
shapes are scaled afterwards.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

RELATIVE_TOLERANCE = 5e-4
"""Maximum distance between triangles and the true surface, as a fraction of the radius."""


class _Grid(NamedTuple):
    """The corners of a revolved profile."""

    slices: int
    growth: float
    """Distance of the corners from the center, for a radius of 1."""


def _grid(curved_directions: int) -> _Grid:
    """Return the coarsest grid within the tolerance, with an even number of slices.

    With corners at distance 1 and angles of ``2 pi / slices``, triangles come within ``q`` of the axis of a cylinder or
    the center of a sphere: ``cos(pi / slices)``, to the power of the number of curved directions. Corners at
    ``2 / (1 + q)`` make both errors ``(1 - q) / (1 + q)``.
    """
    inner = (1 - RELATIVE_TOLERANCE) / (1 + RELATIVE_TOLERANCE)
    slices = 2 * math.ceil(math.pi / math.acos(inner ** (1 / curved_directions)) / 2)
    return _Grid(slices, 2 / (1 + math.cos(math.pi / slices) ** curved_directions))


_CYLINDER, _SPHERE = _grid(1), _grid(2)

_Shape = tuple[NDArray[np.float64], NDArray[np.integer], NDArray[np.float64] | None]
"""Vertices, faces and normals of their corners, shape ``(m, 3, 3)``."""


def box(half: float) -> _Shape:
    """Create a cube from ``-half`` to ``half``."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64) * half
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), None


def frustum(bottom: float, top: float, height: float) -> _Shape:
    """Create a closed frustum of a cone about z, with the center of its axis in the origin."""
    slope = math.atan2(bottom - top, height)
    half = height / 2
    down, up = -math.pi / 2, math.pi / 2
    lower = [(0.0, -half, down), (bottom, -half, down), (bottom, -half, slope)]
    return _revolve([*lower, (top, half, slope), (top, half, up), (0.0, half, up)], _CYLINDER)


def capsule(bottom: float, top: float, height: float) -> _Shape:
    """Create a frustum about z as `frustum` does, with parts of spheres at its ends that are tangent to its side."""
    slope = math.atan2(bottom - top, height)
    cosine, half = math.cos(slope), height / 2
    if cosine < 1e-9:  # a disk
        return frustum(bottom, top, height)
    steps = _SPHERE.slices // 2
    lower = np.linspace(-math.pi / 2, slope, max(2, math.ceil(steps * (slope / math.pi + 0.5))) + 1)
    upper = np.linspace(slope, math.pi / 2, max(2, math.ceil(steps * (0.5 - slope / math.pi))) + 1)
    profile = []
    for radius, end, angles in ((bottom, -half, lower), (top, half, upper[int(height == 0) :])):
        center, ball = end - radius * math.tan(slope), radius / cosine
        profile += [(ball * math.cos(a), center + _SPHERE.growth * ball * math.sin(a), a) for a in angles.tolist()]
    profile[0], profile[-1] = (0.0, *profile[0][1:]), (0.0, *profile[-1][1:])  # cos(pi / 2) is not exactly 0
    return _revolve(profile, _SPHERE)


def _revolve(profile: list[tuple[float, float, float]], grid: _Grid) -> _Shape:
    """Revolve a profile about z: radii, heights, and elevations of the normals, from bottom to top."""
    slices, growth = grid
    radius, height, elevation = np.array(profile, dtype=np.float64).T
    angles = 2 * np.pi * np.arange(slices) / slices
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    rings, normals = np.empty((len(radius), slices, 3)), np.empty((len(radius), slices, 3))
    rings[..., :2], rings[..., 2] = growth * radius[:, None, None] * circle, height[:, None]
    normals[..., :2], normals[..., 2] = np.cos(elevation)[:, None, None] * circle, np.sin(elevation)[:, None]
    index = np.arange(len(radius) * slices).reshape(-1, slices)
    after = np.roll(index, -1, axis=1)
    faces = []
    for row in range(len(radius) - 1):
        if (radius[row], height[row]) == (radius[row + 1], height[row + 1]):
            continue  # an edge, where the normal changes
        if radius[row] > 0:
            faces.append(np.stack([index[row], after[row], after[row + 1]], axis=1))
        if radius[row + 1] > 0:
            faces.append(np.stack([index[row], after[row + 1], index[row + 1]], axis=1))
    triangles = np.concatenate(faces) if faces else np.zeros((0, 3), dtype=np.int64)
    vertices, merged = np.unique(rings.reshape(-1, 3), axis=0, return_inverse=True)
    return vertices, merged.reshape(-1)[triangles], normals.reshape(-1, 3)[triangles]
