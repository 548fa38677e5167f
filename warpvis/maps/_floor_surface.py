# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fit the plane of a floor to points, and estimate its errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from warpvis.maps._floor_candidates import GATE, Array, Cells, Plane, deviations, fit_plane

# Fraction of the standard deviation of points that is an error of whole regions, as of a depth camera's calibration.
_SHARED = 0.2

# Fewest points of a fit, and the number of fits, each to the points within a limit that shrinks with their deviation.
_MIN_POINTS, _ITERATIONS = 50, 8


@dataclass(frozen=True, eq=False)
class Surface:
    """A plane fitted to points, in coordinates relative to the camera, and its errors."""

    normal: Array
    """Unit normal towards the camera, shape ``(3,)``."""
    height: float
    """Distance of the camera [m]."""
    sigma: float
    """Robust standard deviation of the points across the plane [m]."""
    gate: float
    """Distance from the plane up to which points are on it, in units of `deviations`."""
    inlier_fraction: float
    """Fraction of all points that are on the floor."""
    width: float
    """Smaller width of the visible floor [m]."""
    tilt_sigma: float
    """Standard deviation of the normal [rad]."""
    height_sigma: float
    """Standard deviation of the height [m]."""
    bend: float
    """Root mean square of the angles between the normals of the floor's halves and `normal` [rad]."""


def fit_surface(cells: Cells, floor: Plane) -> Surface:
    """Fit a plane to the points of the cells of a floor.

    Cells of walls and furniture are excluded: their lowest points would lift the plane.
    """
    normal, height, gate = floor.normal, floor.height, GATE
    chosen = floor.members[cells.cell_of_point] & (cells.cell_of_point >= 0)
    points, distances = cells.points[chosen], cells.distances[chosen]
    near = np.zeros(0, dtype=bool)
    for _ in range(_ITERATIONS):
        limits = deviations(cells.noise, distances, height)
        relative = np.abs(points @ normal + height) / limits
        inside = relative[relative < GATE]
        gate = GATE * (float(np.clip(1.4826 * np.median(inside), 0.3, 1.0)) if len(inside) else 1.0)
        before, near = near, relative < gate
        if near.sum() < _MIN_POINTS or np.array_equal(near, before):
            break
        normal, height, _ = fit_plane(points[near], limits[near] ** -2)
    inliers, weights = points[near], limits[near] ** -2
    sigma = 1.4826 * float(np.median(np.abs(inliers @ normal + height)))
    centers = cells.centers[floor.members]
    _, _, variances = fit_plane(centers, cells.areas[floor.members])
    error = sigma * math.sqrt(1 / len(centers) + _SHARED**2)
    # One of the two axes of a tilt moves the plane below the camera, at this distance from the floor that is visible.
    distance = float(horizontal_distances(centers.mean(axis=0), normal))
    bend = _compare_halves(inliers, weights, normal)
    tilt = max(error / math.sqrt(max(variances[1], 1e-12)), bend)
    return Surface(
        normal=normal,
        height=height,
        sigma=sigma,
        gate=gate,
        inlier_fraction=float(near.sum() / len(cells.points)),
        width=math.sqrt(12 * variances[1]),
        tilt_sigma=tilt,
        height_sigma=math.hypot(error, tilt / math.sqrt(2) * distance),
        bend=bend,
    )


def _compare_halves(points: Array, weights: Array, normal: Array) -> float:
    """Return the root mean square of the angles between the normals of the floor's halves and of the whole [rad].

    The halves are near and far, left and right. They differ more than by random errors if depth is curved, as that of a
    camera that is not calibrated, or if the floor is not flat.
    """
    if len(points) < 4 * _MIN_POINTS:
        return 0.0
    right = np.cross(normal, points.mean(axis=0))
    cosines = []
    for side in (right, np.cross(normal, right)):
        position = points @ side
        first = position < np.median(position)
        cosines += [float(fit_plane(points[half], weights[half])[0] @ normal) for half in (first, ~first)]
    return float(np.sqrt(np.mean(np.square(np.arccos(np.minimum(cosines, 1.0))))))


def horizontal_distances(points: Array, normal: Array) -> Array:
    """Return the distance of points from the vertical through the camera [m]."""
    return np.linalg.norm(points - (points @ normal)[..., None] * normal, axis=-1)
