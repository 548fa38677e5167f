# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Occupancy maps in double precision: every voxel of a box is updated by every image."""

import math

import numpy as np
from numpy.typing import NDArray
from reference_poses import poses_to_matrices

from warpvis.maps import Voxel

UNIT = 1.0 / 1024.0
NEVER_SEEN, NOT_MEASURED = -32768, -32767

# Distances [m] and image coordinates [px] within which single precision may decide otherwise.
_NEAR_TIE, _NEAR_PIXEL_BORDER = 2e-5, 2e-3


def to_units(probability: float) -> int:
    return round(math.log(probability / (1.0 - probability)) / UNIT)


def shown_between(depth: NDArray, near: float, reach: float) -> NDArray:
    depth = depth.astype(np.float64)
    with np.errstate(invalid="ignore"):
        shown = np.where(depth < near, -np.inf, np.where(depth > reach, np.inf, depth))
        return np.where(depth == -np.inf, -np.inf, np.where(depth > 0, shown, np.nan))


def bound_surface(depth: NDArray, near: float, reach: float, sigma) -> tuple[NDArray, NDArray]:
    """Return the ends of the interval that contains the surface of each pixel."""
    shown = shown_between(depth, near, reach)
    finite = np.isfinite(shown)
    d = np.where(finite, shown, 1.0)
    deviation = sigma(d)
    low, high = d.copy(), d.copy()
    padded = np.pad(depth.astype(np.float64), 1, constant_values=np.nan)
    for rows, columns in ((0, 1), (2, 1), (1, 0), (1, 2)):
        neighbor = padded[rows : rows + d.shape[0], columns : columns + d.shape[1]]
        with np.errstate(invalid="ignore"):
            same = np.abs(neighbor - d) <= 3 * deviation + 0.03 * d
        border = np.where(same, (d + neighbor) / 2, d)
        low, high = np.minimum(low, border), np.maximum(high, border)
    low = np.where(finite, low - deviation, np.where(shown == np.inf, np.inf, 0.0))
    high = np.where(finite, high + deviation, np.where(shown == -np.inf, near, np.inf))
    return low, high


class DenseMap:
    """The values of all voxels of a box, and which of them may differ in single precision."""

    def __init__(self, bounds, cell: float, *, hit=0.7, miss=0.4, limits=(0.12, 0.97)) -> None:
        self.cell = cell
        self.first = np.floor(np.asarray(bounds[0]) / cell + 1e-6).astype(int)
        self.size = np.ceil(np.asarray(bounds[1]) / cell - 1e-6).astype(int) - self.first
        self.values = np.full(self.size, NEVER_SEEN)
        self.uncertain = np.zeros(self.size, dtype=bool)
        self.hit, self.miss = to_units(hit), to_units(miss)
        self.limits = tuple(map(to_units, limits))

    def states(self) -> NDArray:
        known = np.where(self.values >= 0, Voxel.SURFACE, Voxel.FREE)
        return np.where(
            self.values == NEVER_SEEN, Voxel.UNKNOWN, np.where(self.values == NOT_MEASURED, Voxel.HIDDEN, known)
        )

    def mark_points(self, depth: NDArray, camera, matrix: NDArray, reach: float) -> NDArray:
        """Return which voxels contain the point of a pixel; points near a face are uncertain."""
        shown = shown_between(depth, camera.near, reach)
        rows, columns = np.nonzero(np.isfinite(shown))
        rays = camera.depth_rays(np.stack([columns + 0.5, rows + 0.5], axis=-1))
        points = (rays * shown[rows, columns][:, None]) @ matrix[:3, :3].T + matrix[:3, 3]
        places = points / self.cell - self.first
        for offset in (-1e-6, 1e-6):
            self._at(np.floor(places + offset), self.uncertain, np.floor(places))
        marks = np.zeros(self.size, dtype=bool)
        self._at(np.floor(places), marks)
        return marks

    def _at(self, voxels: NDArray, target: NDArray, unless: NDArray | None = None) -> None:
        inside = ((voxels >= 0) & (voxels < self.size)).all(axis=1)
        if unless is not None:
            inside &= (voxels != unless).any(axis=1)
        target[tuple(voxels[inside].astype(int).T)] = True

    def update_voxels(self, depth: NDArray, camera, pose: NDArray, sigma=lambda d: 0.0 * d, reach: float = 5.0) -> None:
        """Update all voxels by one image."""
        matrix = poses_to_matrices(np.asarray(pose, dtype=np.float32)[None])[0]
        reach = min(reach, camera.far)
        low, high = bound_surface(depth, camera.near, reach, sigma)
        marks = self.mark_points(depth, camera, matrix, reach)
        centers = (self.first + np.moveaxis(np.indices(self.size), 0, -1) + 0.5) * self.cell
        sight = centers - matrix[:3, 3]
        p = sight @ matrix[:3, :3]
        z = p[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = camera.fx * p[..., 0] / z + camera.cx, camera.fy * p[..., 1] / z + camera.cy
            seen = (z > 0) & (z <= reach)
            seen &= (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
            column, row = np.where(seen, x, 0).astype(int), np.where(seen, y, 0).astype(int)
            margin = self.cell / 2 * z / np.abs(sight).max(axis=-1)
            to_low, to_high = z - (low[row, column] - margin), z - (high[row, column] + margin)
            missed, hidden = seen & (to_low < 0), seen & (to_high > 0)
            missed, hidden = missed & ~marks, hidden & ~marks
            hit = seen & ~missed & ~hidden & ((low[row, column] > 0) | marks)
            border = np.minimum(np.abs(x - np.rint(x)), np.abs(y - np.rint(y))) < _NEAR_PIXEL_BORDER
            tie = np.minimum(np.abs(to_low), np.abs(to_high)) < _NEAR_TIE * np.maximum(1.0, z)
            tie |= np.minimum(np.abs(z), np.abs(z - reach)) < _NEAR_TIE
        # The image of a voxel that is nearly on a border may be the next pixel, or outside.
        self.uncertain |= (border | tie) & (z > 0)
        odds = np.where(self.values > NOT_MEASURED, self.values, 0) + np.where(hit, self.hit, self.miss)
        odds = np.clip(odds, *self.limits)
        unseen = hidden & (self.values == NEVER_SEEN)
        self.values = np.where(hit | missed, odds, np.where(unseen, NOT_MEASURED, self.values))


def rectify_depth(depth: NDArray, lens, pinhole) -> NDArray:
    """Return planar depth of the pixels of a pinhole from the pixels of a lens that contain their rays."""
    shown = shown_between(depth, lens.near, lens.far)
    result = np.full((pinhole.height, pinhole.width), np.nan)
    for row in range(pinhole.height):
        for column in range(pinhole.width):
            ray = pinhole.depth_rays((column + 0.5, row + 0.5))
            x, y = lens.project(ray)
            if 0 <= x < lens.width and 0 <= y < lens.height and not lens.mask[int(y), int(x)]:
                length = np.linalg.norm(ray) if lens.kind == "range" else 1.0
                result[row, column] = shown[int(y), int(x)] / length
    return result


def fade(values: NDArray, factor: float) -> NDArray:
    return np.where(values > NOT_MEASURED, np.trunc(values * factor), values)


def write_states(dense: DenseMap) -> NDArray:
    return dense.states()


def update_voxels(dense: DenseMap, *image, **options) -> None:
    dense.update_voxels(*image, **options)


# Blocks save time and memory, but the result is that of updating every voxel.
bound_tiles = merge_tiles = judge_blocks = list_blocks = fill_blocks = mark_points = update_voxels
release_blocks = update_voxels
write_states_at = write_states
