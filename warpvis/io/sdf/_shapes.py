# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of the geometries that SDF defines by numbers: boxes, round solids, planes, extruded polylines, terrain."""

from __future__ import annotations

import itertools
import math
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception
from warpvis.core.file_content import require_content, require_package
from warpvis.errors import FileFormatError
from warpvis.io.sdf._xml import Node, parse_numbers
from warpvis.scene.solids import DEFAULT_MESH_TOLERANCE, Solid, capsule, cylinder, ellipsoid, largest_error, sphere

Triangles = tuple[NDArray[np.float64], NDArray[np.integer]]
Corners = NDArray[np.float32]
"""Texture coordinates of corners of faces, shape ``(m, 3, 2)``."""

_MAX_POINTS = 20_000
"""Maximum number of points of polylines."""
_MAX_CELLS = 16_000_000
"""Maximum number of cells of a terrain."""
_DEM_SUFFIXES = (".tif", ".tiff", ".dem", ".asc", ".hgt", ".img", ".nc", ".vrt")
_QUAD = np.array([(0, 1, 2), (0, 2, 3)])
_QUAD_UV = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float32)


def round_solid(shape: Node) -> Solid | None:
    """Return a sphere, an ellipsoid, a cylinder or a capsule, centered, along z; None for other shapes."""
    match shape.tag:
        case "sphere":
            return sphere(shape.positive("radius", 1.0))
        case "ellipsoid":
            return ellipsoid(shape.positives("radii", (1.0, 1.0, 1.0)))
        case "cylinder":
            return cylinder(shape.positive("radius", 1.0), shape.positive("length", 1.0) / 2)
        case "capsule":
            return capsule(shape.positive("radius", 0.5), shape.positive("length", 1.0) / 2)
    return None


def box(size: tuple[float, ...]) -> tuple[Triangles, Corners]:
    """Return a box around the origin, and texture coordinates with the whole image on each side."""
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    # Sides counterclockwise from outside; the vertical ones begin at the lower left corner.
    sides = np.array([(4, 6, 7, 5), (2, 0, 1, 3), (6, 2, 3, 7), (0, 4, 5, 1), (1, 5, 7, 3), (2, 6, 4, 0)])
    faces = sides[:, _QUAD].reshape(-1, 3).astype(np.int32)
    uv = np.tile(_QUAD_UV[_QUAD], (6, 1, 1))
    return (signs * size / 2, faces), uv


def plane(shape: Node) -> tuple[Triangles, Corners]:
    """Return a rectangle of finite size around the origin, perpendicular to its normal."""
    x, y = np.array(shape.positives("size", (1.0, 1.0))) / 2
    normal = np.array(shape.numbers("normal", (0.0, 0.0, 1.0)))
    length = np.linalg.norm(normal)
    if length == 0:
        shape.fail("must have a normal other than 0")
    corners = np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)]) @ _rotation_from_z(normal / length).T
    return (corners, _QUAD.astype(np.int32)), _QUAD_UV[_QUAD]


def _rotation_from_z(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shortest rotation from the z axis to a unit vector; half a turn about x to -z."""
    x, y, z = normal
    if z < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    factor = 1 / (1 + z)
    return np.array([(1 - x * x * factor, -x * y * factor, x), (-x * y * factor, 1 - y * y * factor, y), (-x, -y, z)])


def cone(shape: Node) -> Triangles:
    """Return a cone along z, with its tip at half its length and its base at minus half its length."""
    radius, half = shape.positive("radius", 0.5), shape.positive("length", 1.0) / 2
    error = largest_error(DEFAULT_MESH_TOLERANCE, radius) / radius
    slices = max(8, math.ceil(math.pi / math.acos(max((1 - error) / (1 + error), 0.0))))
    angles = 2 * np.pi * np.arange(slices) / slices
    ring = radius * 2 / (1 + math.cos(math.pi / slices))
    base = np.stack([ring * np.cos(angles), ring * np.sin(angles), np.full(slices, -half)], axis=-1)
    first = np.arange(slices)
    after = np.roll(first, -1)
    sides = np.stack([first, after, np.full(slices, slices)], axis=-1)
    bottom = np.stack([after, first, np.full(slices, slices + 1)], axis=-1)
    vertices = np.concatenate([base, [(0, 0, half), (0, 0, -half)]])
    return vertices, np.concatenate([sides, bottom]).astype(np.int32)


def polylines(shapes: list[Node]) -> Triangles:
    """Return polygons in the plane z = 0 that are extruded upwards by their height.

    Several polygons are filled by the even-odd rule: one within another is a hole.
    """
    loops, heights, count = [], [], 0
    for shape in shapes:
        points = np.array([parse_numbers(point, point.string(), 2) for point in shape.children("point")])
        count += len(points)
        if len(points) > 1 and np.array_equal(points[0], points[-1]):
            points = points[:-1]
        if len(points) < 3:
            shape.fail(f"must have at least 3 points, got {len(points)}")
        if count > _MAX_POINTS:
            shape.fail(f"must have at most {_MAX_POINTS} points")
        loops.append(points)
        heights.append(shape.positive("height", 1.0))
    height = heights[0]
    vertices, faces = _fill(loops)
    corners = [np.c_[vertices, np.full(len(vertices), z)] for z in (height, 0.0)]
    triangles = [faces, faces[:, ::-1] + len(vertices)]
    start = 2 * len(vertices)
    for loop in loops:
        lower = np.arange(len(loop)) + start
        after = np.roll(lower, -1)
        corners += [np.c_[loop, np.zeros(len(loop))], np.c_[loop, np.full(len(loop), height)]]
        upper = len(loop)
        sides = [
            np.stack([lower, after, after + upper], axis=-1),
            np.stack([lower, after + upper, lower + upper], axis=-1),
        ]
        triangles += sides if _is_outer(loop, loops) == (_area(loop) > 0) else [side[:, ::-1] for side in sides]
        start += 2 * len(loop)
    return np.concatenate(corners), np.concatenate(triangles).astype(np.int32)


def _area(loop: NDArray[np.float64]) -> float:
    x, y = loop.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum()) / 2


def _is_outer(loop: NDArray[np.float64], loops: list[NDArray[np.float64]]) -> bool:
    """Return whether a loop is in an even number of others."""
    (x, y), count = loop[0], 0
    for other in loops:
        if other is not loop:
            ends = np.roll(other, -1, axis=0)
            crossed = (other[:, 1] > y) != (ends[:, 1] > y)
            (ax, ay), (bx, by) = other[crossed].T, ends[crossed].T
            count += int((x < ax + (y - ay) / (by - ay) * (bx - ax)).sum() % 2)
    return count % 2 == 0


def _fill(loops: list[NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Fill loops by the even-odd rule with trapezoids between the heights of their points."""
    starts = np.concatenate(loops)
    ends = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    levels = np.unique(starts[:, 1])
    quads = []
    for low, high in itertools.pairwise(levels):
        middle = (low + high) / 2
        crossed = (starts[:, 1] > middle) != (ends[:, 1] > middle)
        a, b = starts[crossed], ends[crossed]
        slope = (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
        order = np.argsort(a[:, 0] + (middle - a[:, 1]) * slope, kind="stable")
        x_low, x_high = (a[order, 0] + (y - a[order, 1]) * slope[order] for y in (low, high))
        for left, right in zip(range(0, len(order), 2), range(1, len(order), 2), strict=True):
            quads.append([(x_low[left], low), (x_low[right], low), (x_high[right], high), (x_high[left], high)])
    corners = np.array(quads).reshape(-1, 2)
    faces = (4 * np.arange(len(quads)))[:, None, None] + _QUAD
    return corners, faces.reshape(-1, 3)


def terrain(shape: Node, path: Path) -> tuple[Triangles, Corners]:
    """Return the surface of a height map, whose brightest pixel is at the height of its `size`.

    The image's right is x and its top is y. Elevations of a digital elevation model (GeoTIFF, ...) are in meters, from
    its lowest point; without a `size`, it has its true size.
    """
    is_dem = path.suffix.lower() in _DEM_SUFFIXES
    heights, size = _read_dem(path) if is_dem else (_read_image(path), (1.0, 1.0, 1.0))
    rows, columns = heights.shape
    if rows < 2 or columns < 2 or rows * columns > _MAX_CELLS:
        raise FileFormatError(f"{path}: must be a height map of 2 x 2 to {_MAX_CELLS} pixels, got {columns} x {rows}")
    x, y, z = shape.numbers("size", size)
    top = float(heights.max())
    scale = abs(z) / top if top > 0 else 0.0
    offset = shape.numbers("pos", (0.0, 0.0, 0.0))
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(1, 0, rows))
    vertices = np.stack([(u - 0.5) * x, (v - 0.5) * y, heights * scale], axis=-1).reshape(-1, 3) + offset
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    quads = np.stack([index[1:, :-1], index[1:, 1:], index[:-1, 1:], index[:-1, :-1]], axis=-1).reshape(-1, 4)
    faces = quads[:, _QUAD].reshape(-1, 3)
    uv = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32)
    return (vertices, faces), uv[faces]


def _read_image(path: Path) -> NDArray[np.float64]:
    """Read the heights of an image: its first channel."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                wide = image.mode.startswith(("I", "F"))
                pixels = np.asarray(image if wide else image.convert("RGB"), dtype=np.float64)
    except Exception as error:  # decoders may raise any exception
        require_content(path, "an image", images=False)
        raise FileFormatError(f"{path}: cannot be read as an image: {describe_exception(error)}") from None
    return pixels[..., 0] if pixels.ndim == 3 else pixels


def _read_dem(path: Path) -> tuple[NDArray[np.float64], tuple[float, float, float]]:
    """Read the elevations of a digital elevation model above its lowest point [m], and its size [m]."""
    rasterio = require_package("rasterio", f"{path}: reading elevations needs rasterio", "geo")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with rasterio.open(path) as data:
                heights = np.ma.filled(data.read(1, masked=True).astype(np.float64), np.nan)
                degrees = bool(data.crs and data.crs.is_geographic)
                width, height = abs(data.bounds.right - data.bounds.left), abs(data.bounds.top - data.bounds.bottom)
                middle = math.radians((data.bounds.top + data.bounds.bottom) / 2)
    except Exception as error:  # GDAL's drivers may raise any exception
        raise FileFormatError(f"{path}: cannot be read as an elevation model: {describe_exception(error)}") from None
    if not np.isfinite(heights).any():
        raise FileFormatError(f"{path}: must have finite elevations")
    heights = np.nan_to_num(heights - np.nanmin(heights), nan=0.0)
    if degrees:  # of the WGS 84 ellipsoid's mean radius
        radius = math.radians(1) * 6_371_008.8
        width, height = width * radius * math.cos(middle), height * radius
    return heights, (width, height, float(heights.max()))
