# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of MuJoCo's shapes: flat geoms, closed and facing outward, visual shapes, and lines.

Sizes and axes follow MuJoCo (https://mujoco.readthedocs.io/en/stable/XMLreference.html#body-geom-size), and visual
shapes `renderGeom` in src/render/classic/render_gl3.c. Round geoms are in `warpvis.scene.solids`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.scene import solids

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]
"""Vertices [m], shape ``(n, 3)``, and faces, shape ``(m, 3)``."""

SLAB = 1e-4
"""Distance of a plane's underside below it [m]."""

_ROUGHEST = 0.02
"""Maximum distance between triangles of visual shapes and the exact surface, in radii."""

_SHARP = 0.8
"""Cosine of the angle between faces at a sharp edge."""

_HEAD = 1.75
"""Radius of an arrow's head, in radii of the arrow."""

_GEOM = mujoco.mjtGeom
_Floats = NDArray[np.float64]

_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
# Pairs of corners of a box that an edge joins.
_EDGES = np.array([(i, j) for i in range(8) for j in range(i) if np.abs(_CORNERS[i] - _CORNERS[j]).sum() == 2])
_BAND = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)  # the side that the camera sees


def box(half_sizes: tuple[float, float, float]) -> Mesh:
    """Build a box of three half sizes [m]."""
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return _CORNERS * np.asarray(half_sizes, dtype=np.float64), _split_quads(quads)


def plane(half_x: float, half_y: float) -> Mesh:
    """Build the rectangle z = 0 of two half sizes [m] as the top of a slab, so that it is visible from both sides.

    MuJoCo draws planes from both sides although it culls back faces (`renderGeom` in src/render/classic/render_gl3.c).
    """
    vertices, faces = box((half_x, half_y, SLAB / 2))
    vertices[:, 2] = np.where(vertices[:, 2] > 0, 0.0, -SLAB)
    return vertices, faces


def height_field(elevation: NDArray[np.float64], size: NDArray[np.float64]) -> Mesh:
    """Build a height field with sides and bottom, identical to MuJoCo's.

    Cells are split along the diagonal from their lower corner (`mjr_uploadHField` in src/render/classic/
    render_context.c; collisions and rays do the same).

    Args:
        elevation: Heights as a fraction of ``size[2]``, shape ``(rows, columns)``: rows along y, columns along x.
        size: Half size in x, half size in y, maximum elevation, thickness of the base [m]: `mjModel.hfield_size`.
    """
    rows, columns = elevation.shape
    x, y = np.linspace(-size[0], size[0], columns), np.linspace(-size[1], size[1], rows)
    top = np.stack([*np.meshgrid(x, y), elevation * size[2]], axis=-1).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    lower, right, far, up = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    surface = np.stack([lower, right, far, lower, far, up], axis=-1).reshape(-1, 3)

    # The border, counterclockwise from above; under it its shadow on the base, and a fan from the base's middle.
    border = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    below = len(top) + np.arange(len(border))
    base = np.r_[top[border][:, :2], [[0.0, 0.0]]]
    sides = _split_quads(np.stack([border, below, np.roll(below, -1), np.roll(border, -1)], axis=-1))
    bottom = np.stack([np.full(len(border), len(top) + len(border)), np.roll(below, -1), below], axis=-1)
    vertices = np.concatenate([top, np.c_[base, np.full(len(base), -size[3])]])
    return vertices, np.concatenate([surface, sides, bottom]).astype(np.int32)


def _split_quads(quads: NDArray[np.int_]) -> NDArray[np.int32]:
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)


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


def simple_shapes(
    kind: int, sizes: _Floats, position: _Floats, rotation: _Floats, *, mesh_tolerance: float, open_ends: bool = False
) -> Blocks:
    """Build shapes of one kind of `SIMPLE_SHAPES`, with sizes as in `mujoco.MjvGeom` [m], ``(n, 3)``.

    The distance between triangles and the exact surface is at most `mesh_tolerance` [m] and 2 % of the radius. With
    `open_ends`, cylinders have no caps.
    """
    unit, ends, faces = _unit(kind, _unit_error(sizes, mesh_tolerance), open_ends)
    stretch, half = sizes.astype(np.float64), np.zeros(len(sizes))
    if kind == _GEOM.mjGEOM_CAPSULE:
        half = stretch[:, 2].copy()
        stretch[:, 2] = stretch[:, :2].mean(axis=1)
    corners = unit * stretch[:, None]
    corners[..., 2] += half[:, None] * ends
    return Blocks(corners @ np.swapaxes(rotation, 1, 2) + position[:, None], faces)


def _unit_error(sizes: _Floats, mesh_tolerance: float) -> float:
    """Return the distance between the triangles of shapes of unit size and the exact surface."""
    radius = float(sizes[:, :2].max())
    error = min(mesh_tolerance / radius, _ROUGHEST) if radius > 0 else _ROUGHEST
    # The error is halved in steps, so that slightly larger shapes keep their faces.
    return _ROUGHEST / 2.0 ** math.ceil(math.log2(_ROUGHEST / error))


def simple_normals(
    kind: int, sizes: _Floats, rotation: _Floats, *, mesh_tolerance: float, open_ends: bool = False
) -> _Floats:
    """Return normals of the corners of the triangles of `simple_shapes` in the world, shape ``(n, f, 3, 3)``."""
    normals = _unit_normals(kind, _unit_error(sizes, mesh_tolerance), open_ends)
    stretch = sizes.astype(np.float64)
    if kind == _GEOM.mjGEOM_CAPSULE:
        stretch[:, 2] = stretch[:, :2].mean(axis=1)
    across = normals / np.maximum(stretch, 1e-12)[:, None, None]
    across = across @ np.swapaxes(rotation, 1, 2)[:, None]
    return across / np.linalg.norm(across, axis=-1, keepdims=True)


@functools.lru_cache(maxsize=64)
def _unit_normals(kind: int, error: float, open_ends: bool) -> _Floats:
    """Return normals at the corners of a shape of unit size, ``(f, 3, 3)``: smooth but at sharp edges."""
    _, _, faces = _unit(kind, error, open_ends)
    corners, _ = SIMPLE_SHAPES[kind](error)
    a, b, c = np.swapaxes(corners[faces], 0, 1)
    flat = np.cross(b - a, c - a)
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    members: list[list[int]] = [[] for _ in corners]
    for face, triangle in enumerate(faces.tolist()):
        for corner in triangle:
            members[corner].append(face)
    normals = np.empty((len(faces), 3, 3))
    for face, triangle in enumerate(faces.tolist()):
        for place, corner in enumerate(triangle):
            near = flat[members[corner]]
            normals[face, place] = near[near @ flat[face] > _SHARP].sum(axis=0)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


@functools.lru_cache(maxsize=64)
def _unit(kind: int, error: float, open_ends: bool) -> tuple[_Floats, _Floats, NDArray[np.int32]]:
    """Return a shape's vertices at unit size, the ends of a capsule's axis to which they belong, or 0, and faces."""
    corners, faces = SIMPLE_SHAPES[kind](error)
    ends = np.zeros(len(corners))
    if kind == _GEOM.mjGEOM_CAPSULE:
        ends = np.sign(corners[:, 2])
        corners = corners - np.outer(ends, [0, 0, 1])
    if open_ends:
        faces = faces[(faces < len(corners) - 2).all(axis=1)]  # the poles are the last vertices
    return corners, ends, faces


def _triangles(solid: solids.Solid) -> Mesh:
    return solid.vertices, solid.faces


def _sphere(error: float) -> Mesh:
    return _triangles(solids.sphere(1.0, mesh_tolerance=error))


def _cylinder(error: float) -> Mesh:
    return _triangles(solids.cylinder(1.0, 1.0, mesh_tolerance=error))


def _triangle(error: float) -> Mesh:
    """Build the triangle spanned by the frame's x and y axes."""
    return np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]], dtype=np.int32)


def _arrow(error: float, head: float = _HEAD) -> Mesh:
    """Build an arrow along z: the shaft is a third of its size, the head a sixth."""
    return _joined(_placed(_cylinder(error), 1.0, 1 / 6, 1 / 6), _cone(error, head, 1 / 6, 1 / 3))


def _double_arrow(error: float) -> Mesh:
    up = _cone(error, _HEAD, 1 / 6, 1 / 3)
    down = up[0] * [1, -1, -1], up[1]
    return _joined(_placed(_cylinder(error), 1.0, 1 / 3, 0.0), up, down)


def _cone(error: float, radius: float, height: float, base: float) -> Mesh:
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


def _placed(mesh: Mesh, across: float, along: float, up: float) -> Mesh:
    return mesh[0] * [across, across, along] + [0, 0, up], mesh[1]


def _joined(*meshes: Mesh) -> Mesh:
    first = np.cumsum([0, *(len(corners) for corners, _ in meshes)])
    faces = [faces + start for (_, faces), start in zip(meshes, first, strict=False)]
    return np.concatenate([corners for corners, _ in meshes]), np.concatenate(faces).astype(np.int32)


SIMPLE_SHAPES: dict[int, Callable[[float], Mesh]] = {
    int(_GEOM.mjGEOM_SPHERE): _sphere,
    int(_GEOM.mjGEOM_CAPSULE): lambda error: _triangles(solids.capsule(1.0, 1.0, mesh_tolerance=error)),
    int(_GEOM.mjGEOM_ELLIPSOID): _sphere,
    int(_GEOM.mjGEOM_CYLINDER): _cylinder,
    int(_GEOM.mjGEOM_BOX): lambda error: box((1.0, 1.0, 1.0)),
    int(_GEOM.mjGEOM_ARROW): _arrow,
    int(_GEOM.mjGEOM_ARROW1): functools.partial(_arrow, head=1.0),
    int(_GEOM.mjGEOM_ARROW2): _double_arrow,
    int(_GEOM.mjGEOM_TRIANGLE): _triangle,
}


class Eye(NamedTuple):
    """The camera that lines are drawn for."""

    camera: PlanarCamera
    place: _Floats
    """Camera to world, ``(4, 4)``."""


def facing(triangles: NDArray[np.floating], eye: Eye) -> NDArray[np.floating]:
    """Orient triangles so that the camera sees their front, corners ``(n, 3, 3)``: MuJoCo draws both sides of them."""
    a, b, c = np.swapaxes(triangles, 0, 1)
    sight = eye.place[:3, 2] if eye.camera.ray_model == "parallel" else a - eye.place[:3, 3]
    away = (np.cross(b - a, c - a) * sight).sum(axis=1) > 0
    return np.where(away[:, None, None], triangles[:, [0, 2, 1]], triangles)


def bands(ends: _Floats, width: float, eye: Eye) -> Blocks:
    """Make lines between ends in the world [m], shape ``(n, 2, 3)``, whose width is in pixels of the camera."""
    forward, position = eye.place[:3, 2], eye.place[:3, 3]
    depth = (ends - position) @ forward
    # Parts behind the near plane are not visible and would be bands turned inside out.
    other = depth[:, ::-1]
    crosses = (depth < eye.camera.near) & (other > eye.camera.near)
    cut = np.where(crosses, (eye.camera.near - depth) / np.where(crosses, other - depth, 1.0), 0.0)
    along = ends[:, 1] - ends[:, 0]
    ends = ends + cut[..., None] * np.stack([along, -along], axis=1)
    depth = np.maximum((ends - position) @ forward, 0.0)
    orthographic = eye.camera.ray_model == "parallel"
    sight = np.broadcast_to(forward, along.shape) if orthographic else ends[:, 0] - position
    across = np.cross(along, sight)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across /= np.where(length > 0, length, 1)
    reach = np.ones_like(depth) if orthographic else depth
    half = _pixels(ends, depth, width, eye)[:, None] / 2 / eye.camera.fy * reach
    sides = half[..., None] * across[:, None]
    corners = np.concatenate([ends - sides, (ends + sides)[:, ::-1]], axis=1)
    return Blocks(corners, _BAND)


def _pixels(ends: _Floats, depth: _Floats, width: float, eye: Eye) -> _Floats:
    """Return the widths of lines in an image [px], ``(n,)``: OpenGL measures whole pixels along a row or a column."""
    inside = (ends - eye.place[:3, 3]) @ eye.place[:3, :2]
    if eye.camera.ray_model != "parallel":
        inside = inside / np.maximum(depth, eye.camera.near)[..., None]
    along = np.abs((inside[:, 1] - inside[:, 0]) * [eye.camera.fx, eye.camera.fy])
    length = np.linalg.norm(along, axis=1)
    slant = np.where(length > 0, along.max(axis=1) / np.where(length > 0, length, 1), 1)
    return max(1.0, math.floor(width + 0.5)) * slant


def box_edges(sizes: _Floats, position: _Floats, rotation: _Floats) -> _Floats:
    """Return both ends of all edges of boxes with the given half sizes, shape ``(12 n, 2, 3)``."""
    corners = (_CORNERS * sizes[:, None]) @ np.swapaxes(rotation, 1, 2) + position[:, None]
    return corners[:, _EDGES].reshape(-1, 2, 3)
