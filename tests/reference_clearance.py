# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of `kernels.visibility.clearance`; see `reference`. `corners` have shape (T, 3, 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def nearest_surface(corners: NDArray, points: NDArray, most: float = np.inf) -> NDArray[np.float64]:
    """Return distances to the nearest triangle, shape (N,): to its plane above its interior, else to its edges."""
    corners, points = np.asarray(corners, dtype=np.float64), np.asarray(points, dtype=np.float64)
    nearest = np.full(len(points), np.inf)
    for triangle in corners:
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        over = np.full(len(points), bool(normal.any()))
        for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
            over &= (points - a) @ np.cross(normal, b - a) >= 0
            t = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0, 1)
            nearest = np.minimum(nearest, np.linalg.norm(a + t[:, None] * (b - a) - points, axis=1))
        if over.any():
            height = np.abs((points - triangle[0]) @ normal) / np.linalg.norm(normal)
            nearest = np.where(over, np.minimum(nearest, height), nearest)
    return np.where(nearest < most, nearest, np.inf)


def find_free_poses(
    corners: NDArray, solid: NDArray, up: int, cameras: NDArray, low: float, radius: float
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return whether every camera has room, and the margin of the radius to the opposite result [m]."""
    floor = [(up + 1) % 3, (up + 2) % 3]
    corners = np.asarray(corners, dtype=np.float64)
    room, margin = np.zeros(len(cameras), dtype=bool), np.full(len(cameras), np.inf)
    for i, camera in enumerate(np.asarray(cameras, dtype=np.float64)):
        parts = [_clip(_clip(triangle, up, low, 1), up, camera[up], -1) for triangle in corners]
        distances = [_distance(part[:, floor] - camera[floor]) for part in parts if len(part) and np.ptp(part[:, up])]
        level = (corners[..., up].min(axis=1) == corners[..., up].max(axis=1)) & (corners[:, 0, up] > low)
        level &= corners[:, 0, up] < camera[up]
        distances += [_distance(triangle[:, floor] - camera[floor]) for triangle in corners[level]]
        nearest = min(distances, default=np.inf)
        below = camera - 1e-9 * np.eye(3)[up]
        room[i] = camera[up] > low and nearest >= radius and _windings(corners[solid], below) < 0.5
        margin[i] = abs(nearest - radius)
    return room, margin


def _clip(polygon: NDArray, axis: int, limit: float, sign: int) -> NDArray[np.float64]:
    """Return the part of a polygon where sign * (coordinate - limit) >= 0 (Sutherland and Hodgman 1974)."""
    result = []
    for p, q in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        over, next_over = sign * (p[axis] - limit), sign * (q[axis] - limit)
        if over >= 0:
            result.append(p)
        if over * next_over < 0:
            result.append(p + over / (over - next_over) * (q - p))
    return np.array(result).reshape(-1, 3)


def _distance(polygon: NDArray) -> float:
    """Return the distance from the origin to a convex polygon in the plane."""
    after = np.roll(polygon, -1, axis=0)
    sides = polygon[:, 0] * after[:, 1] - polygon[:, 1] * after[:, 0]
    if abs(sides.sum()) > 1e-12 and ((sides >= 0).all() or (sides <= 0).all()):
        return 0.0
    way = after - polygon
    t = np.clip(-(polygon * way).sum(axis=1) / np.maximum((way * way).sum(axis=1), 1e-300), 0, 1)
    return float(np.linalg.norm(polygon + t[:, None] * way, axis=1).min())


def _windings(corners: NDArray, point: NDArray) -> float:
    """Return the winding number of triangles around a point, from solid angles (Van Oosterom and Strackee 1983)."""
    a, b, c = (corners - point).swapaxes(0, 1)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=1)
    divisor = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return float(2 * np.arctan2(volume, divisor).sum() / (4 * np.pi))
