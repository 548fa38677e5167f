# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Round solids. Movable ones are rendered as the true surface; others as triangles close to it.

Each solid is also a mesh, closed and wound outwards. Its rings have a radius slightly larger than the true one, so that
the triangles lie as far outside of the surface at their corners as inside at their centers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_point, check_length
from warpvis.errors import SceneError
from warpvis.kernels import constants

DEFAULT_MESH_TOLERANCE = 5e-4
"""Default maximum distance between triangles and the true surface [m]."""

RELATIVE_MESH_TOLERANCE = 1e-4
"""Tolerance relative to a shape's largest radius; the greater one of this and the tolerance in meters applies."""

_MIN_STACKS = 4
_MIN_SLICES = 8


class SolidKind(IntEnum):
    """Shape of a movable object in the kernels."""

    MESH = constants.SOLID_NONE
    """A triangle mesh."""
    BALL = constants.SOLID_BALL
    """The unit ball."""
    CYLINDER = constants.SOLID_CYLINDER
    """A cylinder of unit radius about z, from -half to half along z."""
    CAPSULE = constants.SOLID_CAPSULE
    """The same with unit half balls at its ends."""


@dataclass(frozen=True)
class Solid:
    """A ball, a cylinder or a capsule, scaled along its axes; `Scene.add` accepts it as a mesh."""

    kind: SolidKind
    radii: NDArray[np.float64]
    """Scale factors along x, y and z [m] of the unit shape, shape ``(3,)``."""
    half: float
    """Half length of the straight part of the unit shape; 0 for a ball."""
    vertices: NDArray[np.float64] = field(repr=False)
    """Corners of its triangles [m], shape ``(n, 3)``."""
    faces: NDArray[np.int32] = field(repr=False)
    """Corner indices of the triangles, shape ``(m, 3)``."""

    @property
    def extent(self) -> NDArray[np.float64]:
        """Half extent along x, y and z [m], shape ``(3,)``."""
        ends = self.half + 1.0 if self.kind == SolidKind.CAPSULE else self.half
        return self.radii * [1.0, 1.0, 1.0 if self.kind == SolidKind.BALL else ends]

    def scaled(self, factors: ArrayLike) -> Solid:
        """Return the solid scaled along its axes."""
        factors = np.asarray(factors, dtype=np.float64)
        return Solid(self.kind, self.radii * factors, self.half, self.vertices * factors, self.faces)


def largest_error(mesh_tolerance: float, radius: float) -> float:
    """Return the maximum distance of triangles from a round shape with this largest radius [m]."""
    return max(mesh_tolerance, RELATIVE_MESH_TOLERANCE * radius)


def sphere(radius: float, *, mesh_tolerance: float = DEFAULT_MESH_TOLERANCE) -> Solid:
    """Create a sphere.

    Args:
        radius: Its radius [m].
        mesh_tolerance: Maximum distance of its triangles from the true surface [m], or 1e-4 of the radius if that is
            more.
    """
    radius = _check_size(radius, "radius of a sphere")
    return ellipsoid((radius, radius, radius), mesh_tolerance=mesh_tolerance)


def ellipsoid(half_axes: ArrayLike, *, mesh_tolerance: float = DEFAULT_MESH_TOLERANCE) -> Solid:
    """Create an ellipsoid.

    Args:
        half_axes: Its half axes along x, y and z [m].
        mesh_tolerance: Maximum distance of its triangles from the true surface [m], or 1e-4 of the longest half axis if
            that is more.
    """
    half_axes = as_point(half_axes, "half_axes of an ellipsoid", SceneError)
    _check_size(float(half_axes.min()), "each of half_axes of an ellipsoid")
    mesh_tolerance = _check_size(mesh_tolerance, "mesh_tolerance")
    stacks, growth = _ball_grid(float(np.max(half_axes)), mesh_tolerance)
    angles = np.linspace(-np.pi / 2, np.pi / 2, stacks + 1)
    return _revolve(SolidKind.BALL, half_axes, 0.0, growth * np.cos(angles), growth * np.sin(angles), 2 * stacks)


def capsule(radius: float, half_length: float, *, mesh_tolerance: float = DEFAULT_MESH_TOLERANCE) -> Solid:
    """Create a cylinder about the z axis with half balls at its ends.

    Args:
        radius: Its radius [m].
        half_length: Half the length of the cylinder between the half balls [m].
        mesh_tolerance: As for `sphere`.
    """
    radius = _check_size(radius, "radius of a capsule")
    half_length = _check_size(half_length, "half_length of a capsule")
    mesh_tolerance = _check_size(mesh_tolerance, "mesh_tolerance")
    stacks, growth = _ball_grid(radius, mesh_tolerance)
    half = half_length / radius
    angles = np.linspace(-np.pi / 2, 0, stacks // 2 + 1)
    ring, height = growth * np.cos(angles), growth * np.sin(angles) - half
    rings = np.r_[ring, ring[::-1]], np.r_[height, -height[::-1]]
    return _revolve(SolidKind.CAPSULE, (radius, radius, radius), half, *rings, 2 * stacks)


def cylinder(radius: float, half_length: float, *, mesh_tolerance: float = DEFAULT_MESH_TOLERANCE) -> Solid:
    """Create a cylinder about the z axis, from ``-half_length`` to ``half_length``.

    Args:
        radius: Its radius [m].
        half_length: Half its length [m].
        mesh_tolerance: As for `sphere`.
    """
    radius = _check_size(radius, "radius of a cylinder")
    half_length = _check_size(half_length, "half_length of a cylinder")
    mesh_tolerance = _check_size(mesh_tolerance, "mesh_tolerance")
    error = largest_error(mesh_tolerance, radius) / radius
    min_cosine = (1 - error) / (1 + error)
    slices = max(_MIN_SLICES, math.ceil(math.pi / math.acos(max(min_cosine, 0.0))))
    ring = 2 / (1 + math.cos(math.pi / slices))
    half = half_length / radius
    rings = np.array([0, ring, ring, 0]), np.array([-half, -half, half, half])
    return _revolve(SolidKind.CYLINDER, (radius, radius, radius), half, *rings, slices)


def _check_size(value: float, name: str) -> float:
    return check_length(value, name, zero=False, error=SceneError)


def _ball_grid(radius: float, mesh_tolerance: float) -> tuple[int, float]:
    """Return the number of stacks of a unit ball, an even number, and the distance of its corners from the center.

    With corners at distance 1, a ball of m stacks and 2 m slices comes within ``q = cos(pi / 2m)^2`` of the center, at
    the centers of the faces at the equator. Corners at ``2 / (1 + q)`` make both errors ``(1-q) / (1+q)``.
    """
    error = largest_error(mesh_tolerance, radius) / radius
    min_radius = max((1 - error) / (1 + error), 0.0)
    stacks = max(_MIN_STACKS, math.ceil(math.pi / 2 / math.acos(math.sqrt(min_radius))))
    stacks += stacks % 2
    return stacks, 2 / (1 + math.cos(math.pi / (2 * stacks)) ** 2)


def _revolve(
    kind: SolidKind, radii: ArrayLike, half: float, ring: NDArray[np.float64], height: NDArray[np.float64], slices: int
) -> Solid:
    """Create a solid from a profile, from bottom to top, that is revolved about z and scaled; its ends are on the axis.

    `ring` is the distance of the profile's points from the axis, ``(k,)``, of which the first and the last count as 0.
    """
    radii = np.asarray(radii, dtype=np.float64)
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
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]], bottom, top])
    vertices = np.concatenate([rings.reshape(-1, 3), poles])
    return Solid(kind, radii, half, vertices * radii, faces.astype(np.int32))
