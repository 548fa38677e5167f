# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of UsdGeom prims in their own frames: meshes, the surfaces of tetrahedra, and simple shapes."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom

from warpvis.io.usd import _round_shapes as round_shapes
from warpvis.scene.normals import have_direction
from warpvis.scene.solids import Solid, SolidKind

Triangles = tuple[NDArray[np.float64], NDArray[np.integer]]
"""Vertices and faces."""

_MIN_RADIUS = 1e-6
"""Minimum radius of solids [m]."""
_MAX_SLENDERNESS = 1e4
"""Maximum half length of solids, divided by their radius."""

_AXES = {"X": [2, 0, 1], "Y": [1, 2, 0], "Z": [0, 1, 2]}
"""Columns of x, y and z of a shape about z, in the frame of a shape about each axis."""


@dataclass(eq=False)
class Geometry:
    """The triangles of a prim, and the polygons that they come from."""

    vertices: NDArray[np.float64]
    """Corners in the prim's frame and the stage's unit, shape ``(n, 3)``."""
    faces: NDArray[np.integer]
    """Corner indices of the triangles, shape ``(m, 3)``, wound counterclockwise as seen from outside."""
    polygons: NDArray[np.integer]
    """Polygon of each triangle, shape ``(m,)``."""
    corners: NDArray[np.integer]
    """Index of each triangle's corners among those of all polygons, shape ``(m, 3)``."""
    polygon_count: int
    corner_count: int
    normals: NDArray[np.float64] | None = None
    """Normals of the triangles' corners, shape ``(m, 3, 3)``; None if they are flat or given by primvars."""
    is_smooth: bool = False
    """Whether it is the cage of a subdivision surface, which is smooth."""
    key: bytes = b""
    """Equal for geometries with equal arrays."""
    solid: tuple[SolidKind, float, float] | None = None
    """The true surface of a round shape about z: its kind, radius and half length in the stage's unit; None for
    others."""

    @property
    def counts(self) -> dict[str, int]:
        """The number of values of a primvar, by its interpolation."""
        vertices = len(self.vertices)
        per_corner, per_polygon = self.corner_count, self.polygon_count
        return {
            "constant": 1, "uniform": per_polygon, "vertex": vertices, "varying": vertices, "faceVarying": per_corner
        }  # fmt: skip

    def spread(self, values: NDArray[Any], interpolation: str) -> NDArray[Any]:
        """Return values of a primvar for each vertex, ``(n, k)``, or for each corner of a triangle, ``(m, 3, k)``."""
        if interpolation in ("vertex", "varying"):
            return values
        if interpolation == "faceVarying":
            return values[self.corners]
        if interpolation == "uniform":
            return np.repeat(values[self.polygons][:, None], 3, axis=1)
        return np.broadcast_to(values[:1], (len(self.vertices), *values.shape[1:]))

    def scaled_solid(self, factors: NDArray[np.float64], mesh: Triangles) -> Solid | None:
        """Return the true surface, scaled along its axes, with scaled triangles; None if there is none."""
        if self.solid is None:
            return None
        kind, radius, half_length = self.solid
        radii = radius * np.abs(factors)
        if not (np.all(radii >= _MIN_RADIUS) and half_length <= _MAX_SLENDERNESS * radius):
            return None
        vertices, faces = mesh
        return Solid(kind, radii, half_length / radius, vertices, faces.astype(np.int32))


def read_geometry(prim: Any, kind: str, time: Any) -> Geometry | None:
    """Return the triangles of a prim; None if it has none. Raise a `ValueError` if it is malformed."""
    if kind == "Mesh":
        return _mesh(prim, time)
    if kind == "TetMesh":
        return _tetrahedra(prim, time)
    lengths = tuple(_length(prim, name, time) for name in _LENGTHS[kind])
    return _simple_shape(kind, lengths, _axis(prim, kind, time))


def _mesh(prim: Any, time: Any) -> Geometry | None:
    """Read a mesh, whose polygons become fans of triangles from their first corner, as in Hydra."""
    mesh = UsdGeom.Mesh(prim)
    vertices = _rows(mesh.GetPointsAttr(), time, 3)
    counts, indices = (
        _whole(attribute, time) for attribute in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
    )
    if not len(vertices) or not len(counts):
        return None
    if counts.min() < 0 or counts.sum() != len(indices):
        raise ValueError(f"faceVertexCounts of <{prim.GetPath()}> must sum to its {len(indices)} faceVertexIndices")
    _check_indices(indices, len(vertices), f"faceVertexIndices of <{prim.GetPath()}>")
    sizes = np.maximum(counts - 2, 0)
    holes = _whole(mesh.GetHoleIndicesAttr(), time)
    sizes[holes[(holes >= 0) & (holes < len(sizes))]] = 0
    polygons = np.repeat(np.arange(len(counts)), sizes)
    step = np.arange(len(polygons)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    first = np.repeat(np.cumsum(counts) - counts, sizes)
    corners = np.stack([first, first + step + 1, first + step + 2], axis=1)
    if mesh.GetOrientationAttr().Get(time) == "leftHanded":
        corners = corners[:, [0, 2, 1]]
    if not len(corners):
        return None
    is_smooth = mesh.GetSubdivisionSchemeAttr().Get(time) != "none"
    key = digest(vertices, indices, counts, corners[:1], holes, np.array(is_smooth))
    faces, count = indices[corners], len(counts)
    return Geometry(vertices, faces, polygons, corners, count, len(indices), is_smooth=is_smooth, key=key)


def _tetrahedra(prim: Any, time: Any) -> Geometry | None:
    """Read the surface of a mesh of tetrahedra."""
    mesh = UsdGeom.TetMesh(prim)
    vertices = _rows(mesh.GetPointsAttr(), time, 3)
    faces = _rows(mesh.GetSurfaceFaceVertexIndicesAttr(), time, 3).astype(np.int64)
    if not len(faces):
        tetrahedra = _rows(mesh.GetTetVertexIndicesAttr(), time, 4).astype(np.int64)
        sides = np.concatenate([tetrahedra[:, [1, 2, 3]], tetrahedra[:, [0, 3, 2]], *_other_sides(tetrahedra)])
        _, where, uses = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
        faces = sides[np.sort(where[uses == 1])]
    if not len(vertices) or not len(faces):
        return None
    _check_indices(faces, len(vertices), f"indices of <{prim.GetPath()}>")
    if mesh.GetOrientationAttr().Get(time) == "leftHanded":
        faces = faces[:, [0, 2, 1]]
    return _simple((vertices, faces, None))


def _other_sides(tetrahedra: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    return [tetrahedra[:, [0, 1, 3]], tetrahedra[:, [0, 2, 1]]]


_Shape = tuple[NDArray[np.float64], NDArray[np.integer], NDArray[np.float64] | None]
"""Vertices, faces and normals of their corners."""


def _simple(shape: _Shape) -> Geometry:
    """Return the geometry of triangles that are their own polygons."""
    vertices, faces, normals = shape
    count = len(faces)
    corners = np.arange(3 * count).reshape(-1, 3)
    key = digest(vertices, faces, np.array(normals is None))
    return Geometry(vertices, faces, np.arange(count), corners, count, 3 * count, normals=normals, key=key)


@lru_cache(maxsize=256)
def _simple_shape(kind: str, lengths: tuple[float, ...], axis: str) -> Geometry:
    """Return the geometry of a simple shape, from the values of `_LENGTHS`; equal ones are the same object."""
    if kind == "Cube":
        return _simple(round_shapes.box(lengths[0] / 2))
    if kind == "Plane":
        return _simple(_plane(lengths[0], lengths[1], axis))
    if kind == "Sphere":
        found = _simple(round_shapes.capsule(lengths[0], lengths[0], 0.0))
        return replace(found, solid=(SolidKind.BALL, lengths[0], 0.0))
    height, bottom = lengths[:2]
    top = lengths[-1] if kind != "Cone" else 0.0
    make = round_shapes.capsule if kind.startswith("Capsule") else round_shapes.frustum
    vertices, faces, normals = make(bottom, top, height)
    order = _AXES[axis]
    found = _simple((vertices[:, order], faces, None if normals is None else normals[..., order]))
    if axis != "Z" or bottom != top or not height:
        return found
    solid = SolidKind.CAPSULE if kind.startswith("Capsule") else SolidKind.CYLINDER
    return replace(found, solid=(solid, bottom, height / 2))


def _plane(width: float, length: float, axis: str) -> _Shape:
    """Return a plane; its width is along x, or z if it is normal to x, and its length along y, or z if normal to y."""
    u, v = {"X": (2, 1), "Y": (0, 2), "Z": (0, 1)}[axis]
    vertices = np.zeros((4, 3))
    vertices[:, u], vertices[:, v] = np.array([-1, 1, 1, -1]) * width / 2, np.array([-1, -1, 1, 1]) * length / 2
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return vertices, faces if axis == "Z" else faces[:, ::-1], None


_LENGTHS = {
    "Cube": ("size",),
    "Sphere": ("radius",),
    "Cylinder": ("height", "radius"),
    "Cylinder_1": ("height", "radiusBottom", "radiusTop"),
    "Cone": ("height", "radius"),
    "Capsule": ("height", "radius"),
    "Capsule_1": ("height", "radiusBottom", "radiusTop"),
    "Plane": ("width", "length"),
}
"""Attributes of simple shapes."""


def _axis(prim: Any, kind: str, time: Any) -> str:
    """Return the axis of a simple shape."""
    axis = str(prim.GetAttribute("axis").Get(time)) if kind not in ("Cube", "Sphere") else "Z"
    if axis not in _AXES:
        raise ValueError(f"axis of <{prim.GetPath()}> must be X, Y or Z, got {axis!r}")
    return axis


def _length(prim: Any, name: str, time: Any) -> float:
    value = prim.GetAttribute(name).Get(time)
    if value is None or not 0 <= value < np.inf:
        raise ValueError(f"{name} of <{prim.GetPath()}> must be at least 0, got {value}")
    return float(value)


def _rows(attribute: Any, time: Any, width: int) -> NDArray[np.float64]:
    value = attribute.Get(time)
    return np.zeros((0, width)) if value is None else np.array(value, dtype=np.float64).reshape(-1, width)


def _whole(attribute: Any, time: Any) -> NDArray[np.int64]:
    value = attribute.Get(time)
    return np.zeros(0, dtype=np.int64) if value is None else np.array(value, dtype=np.int64)


def digest(*arrays: NDArray[Any]) -> bytes:
    """Return a key that is equal for equal arrays."""
    found = hashlib.blake2b(digest_size=16)
    for array in arrays:
        found.update(f"{array.dtype}{array.shape}".encode())
        found.update(array.tobytes())
    return found.digest()


def _check_indices(indices: NDArray[np.integer], count: int, subject: str) -> None:
    if len(indices) and not 0 <= indices.min() <= indices.max() < count:
        wrong = indices.min() if indices.min() < 0 else indices.max()
        raise ValueError(f"{subject} must be from 0 to {count - 1}, got {wrong}")


def face_normals(vertices: NDArray[np.float64], faces: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return normals of triangles, as long as twice their area, shape ``(m, 3)``; z for those without area."""
    a, b, c = (vertices[faces[:, number]] for number in range(3))
    normals = np.cross(b - a, c - a)
    normals[~have_direction(normals)] = (0.0, 0.0, 1.0)
    return normals


def smooth_normals(vertices: NDArray[np.float64], faces: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return normals of vertices: the sum of those of the triangles around them, weighted by area, shape ``(n, 3)``."""
    flat = face_normals(vertices, faces)
    columns = [
        np.bincount(faces.ravel(), weights=np.repeat(flat[:, axis], 3), minlength=len(vertices)) for axis in range(3)
    ]
    return np.stack(columns, axis=1)
