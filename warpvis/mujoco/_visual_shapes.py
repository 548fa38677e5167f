# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of MuJoCo's simple visual shapes (`renderGeom` in src/render/classic/render_gl3.c).

Shapes of one kind share one mesh, in which each shape is a scaled, rotated and translated block of the same triangles.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.mujoco import _tessellation as tessellation
from warpvis.scene import solids

_GEOM = mujoco.mjtGeom

ROUGHEST = 0.02
"""Maximum distance between triangles and the exact surface, in radii."""
_HEAD = 1.75
"""Radius of an arrow's head, in radii of the arrow."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Triangles of several shapes that have the same faces."""

    vertices: NDArray[np.floating]
    """Vertices in the world [m], shape ``(n, t, 3)``."""
    faces: NDArray[np.int32]
    """Faces of one block, shape ``(f, 3)``."""

    def filled_up(self, count: int) -> NDArray[np.float32]:
        """Return the vertices of `count` blocks, shape ``(count * t, 3)``, padded by copies of the last block."""
        missing = np.broadcast_to(self.vertices[-1:], (count - len(self.vertices), *self.vertices.shape[1:]))
        return np.concatenate([self.vertices, missing]).reshape(-1, 3).astype(np.float32)

    def all_faces(self, count: int) -> NDArray[np.int32]:
        """Return the faces of `count` blocks, shape ``(count * f, 3)``."""
        first = np.arange(count, dtype=np.int32) * self.vertices.shape[1]
        return (self.faces + first[:, None, None]).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class _Unit:
    """A shape of unit size."""

    corners: _Floats
    """Vertices that are multiplied by the sizes, ``(t, 3)``."""
    ends: _Floats
    """End of a capsule's axis to which a vertex belongs: -1, 1, or 0 for other shapes, ``(t,)``."""
    faces: NDArray[np.int32]
    """Faces, ``(f, 3)``."""


def is_simple(kind: int) -> bool:
    """Return whether `simple_shapes` supports a `mujoco.mjtGeom`."""
    return kind in _MAKERS


def simple_shapes(
    kind: int, sizes: _Floats, position: _Floats, rotation: _Floats, *, mesh_tolerance: float, open_ends: bool = False
) -> Blocks:
    """Build shapes of one kind.

    Args:
        kind: A `mujoco.mjtGeom` that `is_simple`.
        sizes: Sizes as in `mujoco.MjvGeom` [m], shape ``(n, 3)``.
        position: Positions [m], shape ``(n, 3)``.
        rotation: Shape-to-world rotations, ``(n, 3, 3)``.
        mesh_tolerance: Maximum distance between triangles and the exact surface [m], limited by `ROUGHEST`.
        open_ends: Whether to omit the caps of cylinders.
    """
    radius = float(sizes[:, :2].max())
    error = min(mesh_tolerance / radius, ROUGHEST) if radius > 0 else ROUGHEST
    # The error is halved in steps, so that slightly larger shapes keep their faces.
    unit = _unit(kind, ROUGHEST / 2.0 ** math.ceil(math.log2(ROUGHEST / error)), open_ends)
    stretch, half = sizes.astype(np.float64), np.zeros(len(sizes))
    if kind == _GEOM.mjGEOM_CAPSULE:
        half = stretch[:, 2].copy()
        stretch[:, 2] = stretch[:, :2].mean(axis=1)
    corners = unit.corners * stretch[:, None]
    corners[..., 2] += half[:, None] * unit.ends
    return Blocks(corners @ np.swapaxes(rotation, 1, 2) + position[:, None], unit.faces)


@functools.lru_cache(maxsize=64)
def _unit(kind: int, error: float, open_ends: bool) -> _Unit:
    corners, faces = _MAKERS[kind](error)
    ends = np.zeros(len(corners))
    if kind == _GEOM.mjGEOM_CAPSULE:
        ends = np.sign(corners[:, 2])
        corners = corners - np.outer(ends, [0, 0, 1])
    if open_ends:
        faces = faces[(faces < len(corners) - 2).all(axis=1)]  # the poles are the last vertices
    return _Unit(corners, ends, faces)


def _sphere(error: float) -> tessellation.Mesh:
    solid = solids.sphere(1.0, mesh_tolerance=error)
    return solid.vertices, solid.faces


def _capsule(error: float) -> tessellation.Mesh:
    solid = solids.capsule(1.0, 1.0, mesh_tolerance=error)
    return solid.vertices, solid.faces


def _cylinder(error: float) -> tessellation.Mesh:
    solid = solids.cylinder(1.0, 1.0, mesh_tolerance=error)
    return solid.vertices, solid.faces


def _box(error: float) -> tessellation.Mesh:
    return tessellation.box((1.0, 1.0, 1.0))


def _triangle(error: float) -> tessellation.Mesh:
    """Build the triangle spanned by the frame's x and y axes."""
    return np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]], dtype=np.int32)


def _arrow(error: float, head: float = _HEAD) -> tessellation.Mesh:
    """Build an arrow along z: the shaft is a third of its size, the head a sixth."""
    return _joined(_placed(_cylinder(error), 1.0, 1 / 6, 1 / 6), _cone(error, head, 1 / 6, 1 / 3))


def _plain_arrow(error: float) -> tessellation.Mesh:
    return _arrow(error, head=1.0)


def _double_arrow(error: float) -> tessellation.Mesh:
    up = _cone(error, _HEAD, 1 / 6, 1 / 3)
    down = up[0] * [1, -1, -1], up[1]
    return _joined(_placed(_cylinder(error), 1.0, 1 / 3, 0.0), up, down)


def _cone(error: float, radius: float, height: float, base: float) -> tessellation.Mesh:
    """Build a cone from z = base upward."""
    corners, _ = _cylinder(error)
    slices = (len(corners) - 2) // 2
    ring = corners[slices : 2 * slices] * [radius, radius, 0] + [0, 0, base]
    around = np.arange(slices)
    after = np.roll(around, -1)
    sides = np.stack([around, after, np.full(slices, slices)], axis=1)
    below = np.stack([after, around, np.full(slices, slices + 1)], axis=1)
    points = np.concatenate([ring, [[0, 0, base + height], [0, 0, base]]])
    return points, np.concatenate([sides, below]).astype(np.int32)


def _placed(mesh: tessellation.Mesh, across: float, along: float, up: float) -> tessellation.Mesh:
    return mesh[0] * [across, across, along] + [0, 0, up], mesh[1]


def _joined(*meshes: tessellation.Mesh) -> tessellation.Mesh:
    first = np.cumsum([0, *(len(corners) for corners, _ in meshes)])
    faces = [faces + start for (_, faces), start in zip(meshes, first, strict=False)]
    return np.concatenate([corners for corners, _ in meshes]), np.concatenate(faces).astype(np.int32)


_MAKERS = {
    int(_GEOM.mjGEOM_SPHERE): _sphere,
    int(_GEOM.mjGEOM_CAPSULE): _capsule,
    int(_GEOM.mjGEOM_ELLIPSOID): _sphere,
    int(_GEOM.mjGEOM_CYLINDER): _cylinder,
    int(_GEOM.mjGEOM_BOX): _box,
    int(_GEOM.mjGEOM_ARROW): _arrow,
    int(_GEOM.mjGEOM_ARROW1): _plain_arrow,
    int(_GEOM.mjGEOM_ARROW2): _double_arrow,
    int(_GEOM.mjGEOM_TRIANGLE): _triangle,
}
