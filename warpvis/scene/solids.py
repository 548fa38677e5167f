# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Round solids. Where they are movable, rays meet the true surface; elsewhere triangles close to it stand for it.

Each is a mesh too, closed and wound outwards: rings of points on a circle that is a little larger than the true one, so
that the triangles lie outside it by as much at their corners as inside at their middles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_point, check_metres
from warpvis.errors import SceneError
from warpvis.kernels import constants

DEFAULT_TOLERANCE = 5e-4
"""How far triangles may be from a round surface [m], unless a call says otherwise."""

RELATIVE_TOLERANCE = 1e-4
"""Of a round shape's largest radius: where this is more than the tolerance in metres, it is the one that counts."""

_MIN_STACKS = 4
_MIN_SLICES = 8


class SolidKind(IntEnum):
    """What kernels call a movable object's shape."""

    MESH = constants.SOLID_NONE
    """Triangles."""
    BALL = constants.SOLID_BALL
    """The unit ball."""
    CYLINDER = constants.SOLID_CYLINDER
    """The unit circle about z, from -half to half along z."""
    CAPSULE = constants.SOLID_CAPSULE
    """The same with unit half balls at its ends."""


@dataclass(frozen=True)
class Solid:
    """A ball, a cylinder or a capsule, stretched along its axes; `Scene.add` takes it for a mesh."""

    kind: SolidKind
    radii: NDArray[np.float64]
    """Factors along x, y and z [m] that make it of the shape of its kind, shape ``(3,)``."""
    half: float
    """Half length of the kind's straight part, before stretching; 0 for a ball."""
    vertices: NDArray[np.float64] = field(repr=False)
    """Corners of its triangles [m], shape ``(n, 3)``."""
    faces: NDArray[np.int32] = field(repr=False)
    """Corner indices of the triangles, shape ``(m, 3)``."""

    @classmethod
    def of(
        cls,
        kind: SolidKind,
        radii: ArrayLike,
        half: float,
        ring: NDArray[np.float64],
        height: NDArray[np.float64],
        slices: int,
    ) -> Solid:
        """Make one whose triangles are those of a line turned about z, and stretched."""
        radii = np.asarray(radii, dtype=np.float64)
        vertices, faces = _revolve(ring, height, slices)
        return cls(kind, radii, half, vertices * radii, faces)

    @property
    def extent(self) -> NDArray[np.float64]:
        """How far it reaches along x, y and z [m], shape ``(3,)``."""
        ends = self.half + 1.0 if self.kind == SolidKind.CAPSULE else self.half
        return self.radii * [1.0, 1.0, 1.0 if self.kind == SolidKind.BALL else ends]

    def scaled(self, factors: ArrayLike) -> Solid:
        """Return the same, stretched further along its axes."""
        factors = np.asarray(factors, dtype=np.float64)
        return Solid(self.kind, self.radii * factors, self.half, self.vertices * factors, self.faces)


def largest_error(tolerance: float, radius: float) -> float:
    """Return the most that triangles of a round shape may be away from its true surface [m].

    Args:
        tolerance: The tolerance [m].
        radius: The shape's radius, or an ellipsoid's longest half axis [m].
    """
    return max(tolerance, RELATIVE_TOLERANCE * radius)


def sphere(radius: float, *, tolerance: float = DEFAULT_TOLERANCE) -> Solid:
    """Make a sphere.

    Args:
        radius: Its radius [m].
        tolerance: Most distance between its triangles and the true surface [m], or 1e-4 of the radius if that is more.

    Raises:
        SceneError: A size or the tolerance is not a positive number.
    """
    radius = _check_size(radius, "radius of a sphere")
    return ellipsoid((radius, radius, radius), tolerance=tolerance)


def ellipsoid(half_axes: ArrayLike, *, tolerance: float = DEFAULT_TOLERANCE) -> Solid:
    """Make an ellipsoid.

    Args:
        half_axes: Its half axes along x, y and z [m].
        tolerance: Most distance between its triangles and the true surface [m], or 1e-4 of the longest half axis if
            that is more.

    Raises:
        SceneError: A size or the tolerance is not a positive number.
    """
    half_axes = as_point(half_axes, "half_axes of an ellipsoid", SceneError)
    _check_size(float(half_axes.min()), "each of half_axes of an ellipsoid")
    tolerance = _check_size(tolerance, "tolerance")
    stacks, growth = _ball_grid(float(np.max(half_axes)), tolerance)
    angles = np.linspace(-np.pi / 2, np.pi / 2, stacks + 1)
    return Solid.of(SolidKind.BALL, half_axes, 0.0, growth * np.cos(angles), growth * np.sin(angles), 2 * stacks)


def capsule(radius: float, half_length: float, *, tolerance: float = DEFAULT_TOLERANCE) -> Solid:
    """Make a cylinder about the z axis with half balls at its ends.

    Args:
        radius: Its radius [m].
        half_length: Half the length of the cylinder between the half balls [m].
        tolerance: Most distance between its triangles and the true surface [m], or 1e-4 of the radius if that is more.

    Raises:
        SceneError: A size or the tolerance is not a positive number.
    """
    radius = _check_size(radius, "radius of a capsule")
    half_length = _check_size(half_length, "half_length of a capsule")
    tolerance = _check_size(tolerance, "tolerance")
    stacks, growth = _ball_grid(radius, tolerance)
    half = half_length / radius
    angles = np.linspace(-np.pi / 2, 0, stacks // 2 + 1)
    ring, height = growth * np.cos(angles), growth * np.sin(angles) - half
    rings = np.r_[ring, ring[::-1]], np.r_[height, -height[::-1]]
    return Solid.of(SolidKind.CAPSULE, (radius, radius, radius), half, *rings, 2 * stacks)


def cylinder(radius: float, half_length: float, *, tolerance: float = DEFAULT_TOLERANCE) -> Solid:
    """Make a cylinder about the z axis, from ``-half_length`` to ``half_length``.

    Args:
        radius: Its radius [m].
        half_length: Half its length [m].
        tolerance: Most distance between its triangles and the true surface [m], or 1e-4 of the radius if that is more.

    Raises:
        SceneError: A size or the tolerance is not a positive number.
    """
    radius = _check_size(radius, "radius of a cylinder")
    half_length = _check_size(half_length, "half_length of a cylinder")
    tolerance = _check_size(tolerance, "tolerance")
    error = largest_error(tolerance, radius) / radius
    least_cosine = (1 - error) / (1 + error)
    slices = max(_MIN_SLICES, math.ceil(math.pi / math.acos(max(least_cosine, 0.0))))
    ring = 2 / (1 + math.cos(math.pi / slices))
    half = half_length / radius
    rings = np.array([0, ring, ring, 0]), np.array([-half, -half, half, half])
    return Solid.of(SolidKind.CYLINDER, (radius, radius, radius), half, *rings, slices)


def _check_size(value: float, name: str) -> float:
    return check_metres(value, name, zero=False, error=SceneError)


def _ball_grid(radius: float, tolerance: float) -> tuple[int, float]:
    """Make stacks of a unit ball of twice as many slices, an even number, and say how far out its corners are.

    A ball of m stacks and 2 m slices with its corners at distance 1 comes as near as ``q = cos(pi / 2m)^2`` to the
    middle, at the middles of the faces by the equator. Corners at ``2 / (1 + q)`` make both errors ``(1-q) / (1+q)``.
    """
    error = largest_error(tolerance, radius) / radius
    least = max((1 - error) / (1 + error), 0.0)
    stacks = max(_MIN_STACKS, math.ceil(math.pi / 2 / math.acos(math.sqrt(least))))
    stacks += stacks % 2
    return stacks, 2 / (1 + math.cos(math.pi / (2 * stacks)) ** 2)


def _revolve(
    ring: NDArray[np.float64], height: NDArray[np.float64], slices: int
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Make the surface that a line from the z axis back to it, going up on the right, makes when turned about z.

    Args:
        ring: Distance of the line's points from the axis, shape ``(k,)``; the first and the last count as 0.
        height: Their z, shape ``(k,)``.
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
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]], bottom, top])
    return np.concatenate([rings.reshape(-1, 3), poles]), faces.astype(np.int32)
