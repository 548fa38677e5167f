# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's primitive shapes as closed triangle meshes, wound outwards, within a tolerance of the true surface.

Sizes and axes are MuJoCo's (https://mujoco.readthedocs.io/en/stable/XMLreference.html#body-geom-size): half sizes, and
the axis of a capsule or a cylinder is z. Round shapes are rings of points on a circle that is a little larger than the
true one, so that the triangles lie outside it by as much at their corners as inside at their middles.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]
"""Vertices [m], shape ``(n, 3)``, and corner indices, shape ``(m, 3)``."""

RELATIVE_TOLERANCE = 1e-4
"""Of a round shape's largest radius: where this is more than the tolerance in metres, it is the one that counts."""

SLAB = 1e-4
"""How far below a plane its underside is [m]."""

_LEAST_STACKS = 4
_LEAST_SLICES = 8


def largest_error(tolerance: float, radius: float) -> float:
    """The most that triangles of a round shape may be away from its true surface [m].

    Args:
        tolerance: The tolerance [m].
        radius: The shape's radius, or an ellipsoid's longest half axis [m].
    """
    return max(tolerance, RELATIVE_TOLERANCE * radius)


def sphere(radius: float, tolerance: float) -> Mesh:
    """A sphere of a radius [m]."""
    return ellipsoid((radius, radius, radius), tolerance)


def ellipsoid(half_axes: tuple[float, float, float], tolerance: float) -> Mesh:
    """An ellipsoid of three half axes [m]: a unit sphere, stretched; its error grows at most by the longest of them."""
    stacks, growth = _ball_grid(max(half_axes), tolerance)
    angles = np.linspace(-np.pi / 2, np.pi / 2, stacks + 1)
    vertices, faces = _revolve(growth * np.cos(angles), growth * np.sin(angles), 2 * stacks)
    return vertices * np.asarray(half_axes, dtype=np.float64), faces


def capsule(radius: float, half_length: float, tolerance: float) -> Mesh:
    """A capsule of a radius [m] about the z axis; `half_length` [m] is that of the cylinder between the half balls."""
    stacks, growth = _ball_grid(radius, tolerance)
    angles = np.linspace(-np.pi / 2, 0, stacks // 2 + 1)
    ring, height = growth * radius * np.cos(angles), growth * radius * np.sin(angles) - half_length
    return _revolve(np.r_[ring, ring[::-1]], np.r_[height, -height[::-1]], 2 * stacks)


def cylinder(radius: float, half_length: float, tolerance: float) -> Mesh:
    """A cylinder of a radius [m] about the z axis, from ``-half_length`` to ``half_length`` [m]."""
    error = largest_error(tolerance, radius) / radius
    least_cosine = (1 - error) / (1 + error)
    slices = max(_LEAST_SLICES, math.ceil(math.pi / math.acos(max(least_cosine, 0.0))))
    ring = radius * 2 / (1 + math.cos(math.pi / slices))
    ends = np.array([-half_length, -half_length, half_length, half_length])
    return _revolve(np.array([0, ring, ring, 0]), ends, slices)


def box(half_sizes: tuple[float, float, float]) -> Mesh:
    """A box of three half sizes [m], exactly."""
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners * np.asarray(half_sizes, dtype=np.float64), _split_quads(quads)


def plane(half_x: float, half_y: float) -> Mesh:
    """The rectangle z = 0 of two half sizes [m] as the top of a slab, so that it shows from both sides.

    MuJoCo draws planes from both sides though it culls back faces (`renderGeom` in src/render/classic/render_gl3.c).
    """
    vertices, faces = box((half_x, half_y, SLAB / 2))
    vertices[:, 2] = np.where(vertices[:, 2] > 0, 0.0, -SLAB)
    return vertices, faces


def height_field(elevation: NDArray[np.float64], size: NDArray[np.float64]) -> Mesh:
    """A height field with its sides and bottom, exactly as MuJoCo draws it.

    Cells are split along the diagonal from their least corner (`mjr_uploadHField` in src/render/classic/
    render_context.c; collisions and rays do the same).

    Args:
        elevation: Heights as a fraction of ``size[2]``, shape ``(rows, columns)``: rows along y, columns along x.
        size: Half size in x, half size in y, greatest elevation, thickness of the base [m]: `mjModel.hfield_size`.
    """
    rows, columns = elevation.shape
    x, y = np.linspace(-size[0], size[0], columns), np.linspace(-size[1], size[1], rows)
    top = np.stack([*np.meshgrid(x, y), elevation * size[2]], axis=-1).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    least, right, far, up = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    surface = np.stack([least, right, far, least, far, up], axis=-1).reshape(-1, 3)

    # The border, counterclockwise from above; under it its shadow on the base, and a fan from the base's middle.
    border = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    below = len(top) + np.arange(len(border))
    base = np.r_[top[border][:, :2], [[0.0, 0.0]]]
    sides = _split_quads(np.stack([border, below, np.roll(below, -1), np.roll(border, -1)], axis=-1))
    bottom = np.stack([np.full(len(border), len(top) + len(border)), np.roll(below, -1), below], axis=-1)
    vertices = np.concatenate([top, np.c_[base, np.full(len(base), -size[3])]])
    return vertices, np.concatenate([surface, sides, bottom]).astype(np.int32)


def _ball_grid(radius: float, tolerance: float) -> tuple[int, float]:
    """Stacks of a unit ball of twice as many slices, an even number, and how far from the middle its corners are.

    A ball of m stacks and 2 m slices with its corners at distance 1 comes as near as ``q = cos(pi / 2m)^2`` to the
    middle, at the middles of the faces by the equator. Corners at ``2 / (1 + q)`` make both errors ``(1-q) / (1+q)``.
    """
    error = largest_error(tolerance, radius) / radius
    least = max((1 - error) / (1 + error), 0.0)
    stacks = max(_LEAST_STACKS, math.ceil(math.pi / 2 / math.acos(math.sqrt(least))))
    stacks += stacks % 2
    return stacks, 2 / (1 + math.cos(math.pi / (2 * stacks)) ** 2)


def _revolve(ring: NDArray[np.float64], height: NDArray[np.float64], slices: int) -> Mesh:
    """The surface that a line from the z axis back to it, going up on the right, makes when it is turned about z.

    Args:
        ring: Distance of the line's points from the axis [m], shape ``(k,)``; the first and the last count as 0.
        height: Their z [m], shape ``(k,)``.
        slices: Steps of a turn.
    """
    angles = 2 * np.pi * np.arange(slices) / slices
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    rings = np.empty((len(ring) - 2, slices, 3))
    rings[..., :2], rings[..., 2] = ring[1:-1, None, None] * circle, height[1:-1, None]
    poles = np.array([[0, 0, height[0]], [0, 0, height[-1]]])

    index = np.arange(rings.shape[0] * slices).reshape(-1, slices)
    after = np.roll(index, -1, axis=1)
    quads = np.stack([index[:-1], after[:-1], after[1:], index[1:]], axis=-1).reshape(-1, 4)
    bottom = np.stack([after[0], index[0], np.full(slices, index.size)], axis=-1)
    top = np.stack([index[-1], after[-1], np.full(slices, index.size + 1)], axis=-1)
    faces = np.concatenate([_split_quads(quads), bottom, top])
    return np.concatenate([rings.reshape(-1, 3), poles]), faces.astype(np.int32)


def _split_quads(quads: NDArray[np.int_]) -> NDArray[np.int32]:
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
