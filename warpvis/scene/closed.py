# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests whether a mesh is closed, so that its back faces can be culled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.core.threads import check_threads, run_each

# The total solid angle of a closed surface is a multiple of 4 pi.
_SOLID_ANGLE_TOLERANCE = 1e-6
# Tolerance of the signed volume a . (b x c), relative to |a| |b| |c|: far above its rounding error.
_VOLUME_TOLERANCE = 1e-12
# Temporaries of this many faces fit into a core's cache.
_FACES_AT_A_TIME = 1 << 15
_SEED = np.uint64(0x9E3779B97F4A7C15)


def provably_closed(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> bool:
    """Return whether the mesh's back faces are certainly hidden by its front faces, seen from outside of its bounds.

    True for star-shaped meshes, such as boxes, balls, capsules and most other convex meshes:

    1. The mesh has no boundary: each edge occurs equally often in both directions.
    2. All triangles with a nonzero area face away from one point c: the signed volumes of the tetrahedra that they form
       with c are positive. So the central projection from c to the unit sphere preserves all orientations, and with 1.
       it covers each direction equally often.
    3. The triangles' solid angles as seen from c add up to 4 pi (Van Oosterom and Strackee 1983): each direction is
       covered once.

    So every ray from c hits the surface exactly once: the surface does not intersect itself, bounds a solid, and its
    normals point outwards. A ray from outside enters that solid through a front face before it hits a back face.

    False is inconclusive: the mesh may still be closed. Corners at the same position count as one.
    """
    if not has_no_boundary(vertices, faces):
        return False
    points = np.asarray(vertices, dtype=np.float64)
    centers = points.mean(axis=0), (points.min(axis=0) + points.max(axis=0)) / 2
    return any(_is_star_shaped(vertices, faces, center) for center in centers)


def has_no_boundary(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> bool:
    """Return whether the sum of all directed edges is zero, with a 64-bit number for each that its opposite negates.

    The numbers are hashes of the positions of the ends, zero for an edge of zero length. The edges of a mesh with a
    boundary add up to zero by chance about once in 2^60.
    """
    place, totals = _hash_places(vertices), list[int]()

    def add_up(first: int) -> None:
        ends = [np.take(place, faces[first : first + _FACES_AT_A_TIME, corner]) for corner in range(3)]
        for start, end in ((0, 1), (1, 2), (2, 0)):
            number = _mix(ends[start] + ends[end])
            number *= ends[start] - ends[end]
            totals.append(int(number.sum(dtype=np.uint64)))

    run_each(add_up, range(0, len(faces), _FACES_AT_A_TIME), check_threads(None))
    return sum(totals) % 2**64 == 0


def may_contain_points(vertices: NDArray[np.float32], faces: NDArray[np.int32], points: NDArray[np.float32]) -> bool:
    """Return whether points may be inside of an object: some are in its box, and it is closed and faces outwards."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if not ((points >= low) & (points <= high)).all(axis=1).any() or not has_no_boundary(vertices, faces):
        return False
    a, b, c = (vertices.astype(np.float64) - vertices[0])[faces].swapaxes(0, 1)
    return bool((a * np.cross(b, c)).sum() > 0)


def contains_points(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], points: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Return which points are inside of a closed mesh that faces outwards: its solid angle from there is 4 pi."""
    if not may_contain_points(vertices, faces, points):
        return np.zeros(len(points), dtype=bool)
    return np.array([_solid_angle(vertices.astype(np.float64) - point, faces) > 2 * np.pi for point in points])


def _hash_places(vertices: NDArray[np.float32]) -> NDArray[np.uint64]:
    words = (np.asarray(vertices, dtype=np.float32) + np.float32(0.0)).view(np.uint32)  # -0.0 + 0.0 is 0.0
    result = np.full(len(words), _SEED)
    for axis in range(3):
        result = _mix(result + words[:, axis])
    return result


def _mix(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Apply one step of splitmix64 in place: every input bit flips half the output bits on average."""
    x += _SEED
    x ^= x >> np.uint64(30)
    x *= np.uint64(0xBF58476D1CE4E5B9)
    x ^= x >> np.uint64(27)
    x *= np.uint64(0x94D049BB133111EB)
    x ^= x >> np.uint64(31)
    return x


def _is_star_shaped(vertices: NDArray[np.float32], faces: NDArray[np.int32], center: NDArray[np.float64]) -> bool:
    points = np.ascontiguousarray((vertices - center).T)  # structure of arrays: coordinates are gathered separately
    lengths = np.sqrt((points * points).sum(axis=0))
    indices = [np.ascontiguousarray(faces[:, corner]) for corner in range(3)]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = ([np.take(axis, index) for axis in points] for index in indices)
    a, b, c = (np.take(lengths, index) for index in indices)
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    volume = ax * nx + ay * ny + az * nz
    product = a * b * c
    outward = volume > _VOLUME_TOLERANCE * product
    if not outward.all():
        corners = np.asarray(vertices, dtype=np.float64)[faces[~outward].T]
        if np.cross(corners[1] - corners[0], corners[2] - corners[0]).any():  # they have an area
            return False
    # tan(angle / 2) of a triangle's solid angle
    divisor = product + (ax * bx + ay * by + az * bz) * c + (bx * cx + by * cy + bz * cz) * a
    divisor += (cx * ax + cy * ay + cz * az) * b
    total = 2 * np.arctan2(np.maximum(volume, 0.0), divisor)[outward].sum()
    return bool(abs(total - 4 * np.pi) < _SOLID_ANGLE_TOLERANCE)


def _solid_angle(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> float:
    """Return the solid angle of a surface as seen from the origin (Van Oosterom and Strackee 1983)."""
    a, b, c = vertices[faces.T]
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=1)
    divisor = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return float(2 * np.arctan2(volume, divisor).sum())
