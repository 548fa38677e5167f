# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Find planes that may be a floor: cells of points, hypotheses from triples of cells, weighted total least squares."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BASE_NOISE = 0.004
"""Standard deviation of a measured point across a plane, in addition to the noise of depth [m]."""

# Cells are cubes, whose size is this fraction of the distance, rounded to a power of 2: levels 2^-3 to 2^6 m.
_CELL, _MIN_LEVEL, _MAX_LEVEL, _SIDE = 0.08, -3, 6, 38

# Minimum number of points in a cell, and of cells in a plane; maximum numbers of seeds, triples per seed, and planes.
_MIN_POINTS, _MIN_CELLS, _MAX_SEEDS, _TRIPLES, _MAX_PLANES = 6, 6, 160, 4, 8

# A plane ends where points are more than this many standard deviations away.
GATE = 3.0

# Limits of estimated noise at 1 m [m], and the factor for errors that neighboring points share.
_NOISES, _SAFETY = (0.001, 0.006), 2.0

# Fraction of cells, the thinnest, whose surface is flat: others contain edges and clutter, such as steps of a stair.
_FLAT_CELLS = 0.25

# Noise of depth at which a cell counts half [m].
_NOISE_AT_HALF = 0.1

# Tangent of the largest angle between a plane and its cells, without noise: steps of a stair are not a ramp.
_MAX_TANGENT = 0.36

# Cosine of the largest angle between a seed and the cells of its triples.
_SIMILAR = 0.85

# Directions from the camera are distinguished in cells of the unit cube: about 3 degrees.
_DIRECTIONS = 20


@dataclass(frozen=True, eq=False)
class Cells:
    """Points of a measurement, grouped by cells; coordinates are relative to the camera."""

    points: Array
    """Points [m], shape ``(N, 3)``."""
    distances: Array
    """Distance of each point from the camera [m], shape ``(N,)``."""
    cell_of_point: NDArray[np.intp]
    """Cell of each point, -1 for cells with too few points, shape ``(N,)``."""
    counts: Array
    """Number of points, shape ``(M,)``."""
    centers: Array
    """Mean of the points [m], shape ``(M, 3)``."""
    covariances: Array
    """Covariance of the points [m^2], shape ``(M, 3, 3)``."""
    ranges: Array
    """Distance of the center from the camera [m], shape ``(M,)``."""
    sides: Array
    """Side [m], shape ``(M,)``."""
    areas: Array
    """Area of a side [m^2], reduced where the noise is large, shape ``(M,)``."""
    normals: Array
    """Normal towards the camera, shape ``(M, 3)``."""
    planar: NDArray[np.bool_]
    """Whether the points define a normal, shape ``(M,)``."""
    noise: float
    """Standard deviation of depth at 1 m [m]; it grows with the square of the distance."""

    @cached_property
    def directions(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Direction of each point from the camera, as an index, and number of points of each direction."""
        keys = _direction_keys(self.points / np.maximum(self.distances, 1e-9)[:, None])
        return keys, np.bincount(keys, minlength=(2 * _DIRECTIONS + 1) ** 3)


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane ``normal . p + height = 0`` in coordinates relative to the camera, whose normal is towards it."""

    normal: Array
    """Unit normal, shape ``(3,)``."""
    height: float
    """Distance of the camera [m], positive."""
    members: NDArray[np.bool_] = field(repr=False)
    """Cells of the plane, shape ``(M,)``."""
    area: float
    """Area of these cells [m^2]."""
    below: float
    """Area of cells below the plane that are visible past its border, as a fraction of this area plus `area`."""


def group_points(points: Array, noise: float | None) -> Cells:
    """Group points, shape ``(N, 3)``, relative to the camera [m], by cells whose size grows with the distance.

    If `noise` is None, it is estimated from the thickness of cells.
    """
    distances = np.sqrt(np.einsum("ij,ij->i", points, points))
    level = np.clip(np.rint(np.log2(np.maximum(distances, 1e-3))), _MIN_LEVEL, _MAX_LEVEL)
    sizes = _CELL * np.exp2(level)
    index = np.clip(np.floor(points / sizes[:, None]) + _SIDE // 2, 0, _SIDE - 1).astype(np.intp)
    key = (((level.astype(np.intp) - _MIN_LEVEL) * _SIDE + index[:, 0]) * _SIDE + index[:, 1]) * _SIDE + index[:, 2]
    occupied = np.bincount(key)
    kept = np.flatnonzero(occupied >= _MIN_POINTS)
    cell_of_key = np.full(len(occupied), -1)
    cell_of_key[kept] = np.arange(len(kept))
    cell = cell_of_key[key]
    inside = cell >= 0
    rows, cells, number = points[inside], cell[inside], len(kept)
    counts = occupied[kept].astype(np.float64)
    centers = np.stack([np.bincount(cells, rows[:, k], number) for k in range(3)], axis=1) / counts[:, None]
    offsets = rows - centers[cells]
    covariances = np.empty((number, 3, 3))
    for i in range(3):
        for j in range(i + 1):
            moment = np.bincount(cells, offsets[:, i] * offsets[:, j], number) / counts
            covariances[:, i, j] = covariances[:, j, i] = moment
    variances, axes = np.linalg.eigh(covariances)
    normals = axes[:, :, 0] * np.where(np.einsum("ij,ij->i", axes[:, :, 0], centers) > 0, -1.0, 1.0)[:, None]
    side = np.zeros(number)
    side[cells] = sizes[inside]
    ranges = np.linalg.norm(centers, axis=1)
    planar = (variances[:, 1] > (0.08 * side) ** 2) & (variances[:, 0] < 0.2 * variances[:, 1])
    if noise is None:
        noise = _estimate_noise(np.sqrt(np.maximum(variances[planar, 0], 0)), centers[planar], normals[planar])
    return Cells(
        points=points,
        distances=distances,
        cell_of_point=cell,
        counts=counts,
        centers=centers,
        covariances=covariances,
        ranges=ranges,
        sides=side,
        areas=side**2 / (1 + (noise * ranges**2 / _NOISE_AT_HALF) ** 2),
        normals=normals,
        planar=planar,
        noise=noise,
    )


def _estimate_noise(thickness: Array, centers: Array, normals: Array) -> float:
    """Return the standard deviation of depth at 1 m [m], from cells of flat surfaces.

    Errors that are equal for all points of a cell do not contribute: a quantile is multiplied by a safety factor.
    """
    across = np.linalg.norm(centers, axis=1) * np.abs(np.einsum("ij,ij->i", normals, centers))
    if not len(thickness):
        return _NOISES[0]
    return float(np.clip(_SAFETY * np.quantile(thickness / np.maximum(across, 1e-3), _FLAT_CELLS), *_NOISES))


def find_planes(cells: Cells, up: Array, tolerance: float, min_area: float, seed: int) -> list[Plane]:
    """Return planes whose normal is within `tolerance` [rad] of `up`, by decreasing area of cells not in others."""
    upright = np.flatnonzero(cells.planar & (cells.normals @ up > np.cos(min(tolerance + 0.35, 1.57))))
    normals, heights = _hypotheses(cells, upright, up, tolerance, seed)
    if not len(normals):
        return []
    fits = _agreement(cells, normals, heights, GATE / 2)
    planes: list[Plane] = []
    free = np.ones(len(cells.areas), dtype=bool)
    for _ in range(_MAX_PLANES):
        gains = fits @ np.where(free, cells.areas, 0.0)
        best = int(np.argmax(gains))
        if gains[best] < min_area:
            break
        normal, height, agreement = normals[best], heights[best], fits[best] * free
        others = free.copy()
        free[agreement > 0] = False
        for _ in range(4):
            if np.count_nonzero(agreement) < _MIN_CELLS:
                break
            normal, height = _fit(cells, agreement, height, up)
            agreement = _agreement(cells, normal[None], np.array([height]), GATE)[0] * others
        members = agreement > 0
        # A plane of area A passes A |n|_1 / s^2 cubes of side s.
        area = float(cells.areas[members].sum() / np.abs(normal).sum())
        if members.sum() < _MIN_CELLS or height <= 0 or area < min_area or normal @ up < np.cos(tolerance):
            continue
        free[members] = False
        planes.append(Plane(normal, height, members, area, _area_below(cells, normal, height, members, area)))
    return planes


def deviations(noise: float, distances: Array, height: Array | float) -> Array:
    """Return the standard deviation of points across a plane [m].

    Depth noise ``noise * r^2`` is along the ray, whose component across a plane at distance `height` is ``height / r``.
    """
    return BASE_NOISE + noise * distances * height


def fit_plane(points: Array, weights: Array) -> tuple[Array, float, Array]:
    """Fit a plane by weighted total least squares; return the normal, the offset and the variances along its axes."""
    total = weights.sum()
    mean = weights @ points / total
    offsets = points - mean
    variances, axes = np.linalg.eigh((offsets * weights[:, None]).T @ offsets / total)
    normal = axes[:, 0]
    offset = -float(normal @ mean)
    return (normal, offset, variances) if offset > 0 else (-normal, -offset, variances)


def _hypotheses(cells: Cells, upright: NDArray[np.intp], up: Array, tolerance: float, seed: int) -> tuple[Array, Array]:
    """Return normals and heights of planes through triples of cells that are nearly coplanar with a seed."""
    random = np.random.default_rng(seed)
    if len(upright) < _MIN_CELLS:
        return np.empty((0, 3)), np.empty(0)
    seeds = np.sort(random.permutation(len(upright))[:_MAX_SEEDS])
    centers, normals = cells.centers[upright], cells.normals[upright]
    offsets = centers[None] - centers[seeds, None]
    across = np.abs(np.einsum("sj,smj->sm", normals[seeds], offsets))
    along = np.linalg.norm(offsets, axis=2)
    similar = (across < 0.03 + 0.15 * along) & (normals[seeds] @ normals.T > _SIMILAR)
    # Random numbers are negative for other cells: the largest ones are a random choice of similar cells.
    lots = np.where(similar, random.random(similar.shape), -1.0)
    chosen = np.argpartition(lots, -2 * _TRIPLES, axis=1)[:, -2 * _TRIPLES :] if len(upright) > 2 * _TRIPLES else None
    if chosen is None:
        chosen = np.tile(np.arange(len(upright)), (len(seeds), 2))[:, : 2 * _TRIPLES]
    first, second = np.take_along_axis(offsets, chosen[:, :, None], axis=1).reshape(len(seeds), 2, -1, 3).swapaxes(0, 1)
    crosses = np.cross(first, second).reshape(-1, 3)
    lengths = np.linalg.norm(crosses, axis=1)
    triples = crosses[lengths > 1e-6] / lengths[lengths > 1e-6, None]
    origins = np.repeat(centers[seeds], first.shape[1], axis=0)[lengths > 1e-6]
    normals = np.concatenate([normals[seeds], triples])
    origins = np.concatenate([centers[seeds], origins])
    heights = -np.einsum("ij,ij->i", normals, origins)
    normals, heights = np.where(heights > 0, 1, -1)[:, None] * normals, np.abs(heights)
    valid = normals @ up > np.cos(tolerance)
    return normals[valid], heights[valid]


def _agreement(cells: Cells, normals: Array, heights: Array, gate: float) -> Array:
    """Return how well cells agree with planes, shape ``(planes, M)``: near them, thin across them, and parallel.

    It decreases from 1 to 0 with the square of the distance, up to `gate` standard deviations, as the score of MSAC
    (Torr and Zisserman, MLESAC, 2000): a count of cells prefers planes between two levels, as of a floor and a low
    object, if both are within the limit.
    """
    x, y, z = normals.T
    quadratic = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z], axis=1)
    c = cells.covariances
    moments = np.stack([c[:, 0, 0], c[:, 1, 1], c[:, 2, 2], c[:, 0, 1], c[:, 0, 2], c[:, 1, 2]])
    sigmas = deviations(cells.noise, cells.ranges[None], heights[:, None])
    squared = (normals @ cells.centers.T + heights[:, None]) ** 2 + quadratic @ moments
    cosines = normals @ cells.normals.T
    parallel = cosines * (_MAX_TANGENT + 2 * sigmas / cells.sides) > np.sqrt(np.maximum(1 - cosines**2, 0.0))
    return np.where(parallel | ~cells.planar, np.maximum(1 - squared / (gate * sigmas) ** 2, 0.0), 0.0)


def _fit(cells: Cells, agreement: Array, height: float, up: Array) -> tuple[Array, float]:
    """Fit a plane to all points of cells, by total least squares, weighted by agreement and precision."""
    members = agreement > 0
    weights = (agreement * cells.counts)[members] / deviations(cells.noise, cells.ranges[members], height) ** 2
    weights /= weights.sum()
    centers = cells.centers[members]
    mean = weights @ centers
    offsets = centers - mean
    scatter = (offsets * weights[:, None]).T @ offsets + np.einsum("i,ijk->jk", weights, cells.covariances[members])
    normal = np.linalg.eigh(scatter)[1][:, 0]
    normal = normal if normal @ up > 0 else -normal
    return normal, -float(normal @ mean)


def _area_below(cells: Cells, normal: Array, height: float, members: NDArray[np.bool_], area: float) -> float:
    """Return the area below a plane as a fraction of the total.

    A ray cannot pass an opaque floor: cells that are seen through the plane are reflections or noise, and ignored.
    """
    depths = -(cells.centers @ normal) - height
    below = depths > 2 * GATE * deviations(cells.noise, cells.ranges, depths + height)
    if not below.any():
        return 0.0
    on_plane = members[cells.cell_of_point] & (cells.cell_of_point >= 0)
    keys, counts = cells.directions
    share = np.bincount(keys[on_plane], minlength=len(counts)) / np.maximum(counts, 1)
    past_border = share[_direction_keys(cells.centers[below] / cells.ranges[below, None])] < 0.5
    past_border &= cells.planar[below]
    hidden = float(cells.areas[below][past_border].sum() / np.abs(normal).sum())
    return hidden / (hidden + area)


def _direction_keys(unit: Array) -> NDArray[np.intp]:
    index = np.floor((np.clip(unit, -1, 1) + 1) * _DIRECTIONS).astype(np.intp)
    return (index[:, 0] * (2 * _DIRECTIONS + 1) + index[:, 1]) * (2 * _DIRECTIONS + 1) + index[:, 2]
