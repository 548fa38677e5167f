# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of flat walls by a depth camera: the plane that each shows, and what is left.

1 / z of a plane is linear in the pixel's coordinates, and so is the disparity of a camera that triangulates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.core.checks import format_percent
from warpvis.errors import ArrayError

# Pixels farther from the plane than so many deviations of the others are not the wall's.
_OUTLIERS = 6.0
_ROUNDS = 12
# What is spread more than this part of 1 / z is no wall.
_MAX_SPREAD = 0.25
_MIN_PIXELS = 400
# A column or a row is of the invalid band if at most this share of it is there.
_BAND_SHARE = 0.02
# Share of a normal distribution's deviation that the median of its absolute values is.
_MEDIAN_SHARE = 0.6745


@dataclass(frozen=True)
class Wall:
    """One picture of a wall, over the part of the image that is looked at."""

    inverse: NDArray[np.float64]
    """1 / z of its pixels [1/m], shape (H, W); NaN where there is no depth."""
    plane: NDArray[np.float64]
    """The same of the plane."""
    known: NDArray[np.bool_]
    """Which pixels are there, and of the wall."""
    x: NDArray[np.float64]
    """Of its columns, x / z."""
    y: NDArray[np.float64]
    """Of its rows, y / z."""
    coefficients: tuple[float, float, float]
    """1 / z is the first by x / z, plus the second by y / z, plus the third [1/m]."""
    missing: float
    """Share of pixels that have no depth, from 0 to 1."""
    band: tuple[int, int]
    """How many columns at the left and the right side of the whole image have no depth."""
    edges: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Of every row, how many pixels from the left and from the right have none, shape (rows)."""
    edge_planes: tuple[NDArray[np.float64], NDArray[np.float64]]
    """1 / z of the plane at the first pixel that has depth, from either side [1/m]."""

    def rows(self, pixels: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return what of pixels, by their indices, the coefficients are multiplied with, shape (N, 3)."""
        row, column = np.divmod(pixels, len(self.x))
        return np.stack([self.x[column], self.y[row], np.ones(len(pixels))], axis=-1)

    def with_plane(self, coefficients: NDArray[np.float64]) -> Wall:
        """Return the picture with another plane."""
        plane = coefficients[0] * self.x + coefficients[1] * self.y[:, None] + coefficients[2]
        first, second, third = (float(number) for number in coefficients)
        return replace(self, plane=plane, coefficients=(first, second, third))

    @property
    def residuals(self) -> NDArray[np.float64]:
        """How much more 1 / z is than the plane's [1/m], shape (H, W); NaN where it is not known."""
        return np.where(self.known, self.inverse - self.plane, np.nan)

    @property
    def distance(self) -> float:
        """Depth of the wall on the camera's axis [m]."""
        return 1.0 / self.coefficients[2]

    @property
    def angle(self) -> float:
        """Angle between the camera's axis and the wall's normal [rad]."""
        return math.acos(min(1.0, abs(self.coefficients[2]) / float(np.linalg.norm(self.coefficients))))

    @property
    def plane_rms(self) -> float:
        """Root of the mean square of how far depth is from the plane's [m], Intel's plane-fit RMS error."""
        apart = 1.0 / self.inverse[self.known] - 1.0 / self.plane[self.known]
        return float(np.sqrt(np.mean(apart**2)))


def measure_wall(depth: NDArray[np.floating], camera: Camera, region: float, name: str) -> Wall:
    """Find the plane of a picture.

    Args:
        depth: Planar depth [m], shape ``(H, W)``; not finite, or 0, where there is none.
        camera: Its intrinsics.
        region: Which part of the image's width and height to look at, about its middle.
        name: What messages call the picture.

    Raises:
        ArrayError: It shows no wall.
    """
    there = np.isfinite(depth) & (depth > 0)
    inverse = np.where(there, 1.0 / np.where(there, depth.astype(np.float64), 1.0), np.nan)
    x = (np.arange(camera.width, dtype=np.float64) + 0.5 - camera.cx) / camera.fx
    y = (np.arange(camera.height, dtype=np.float64) + 0.5 - camera.cy) / camera.fy
    left, right = _band(there.mean(axis=0))
    top, bottom = _middle(camera.height, region)
    first, last = _middle(camera.width, region)
    part = slice(top, bottom), slice(max(first, left), min(last, camera.width - right))
    looked_at = inverse[part]
    if np.isfinite(looked_at).sum() < _MIN_PIXELS:
        raise ArrayError(f"{name} has depth at {np.isfinite(looked_at).sum()} pixels, too few for a wall")
    coefficients, known = _fit_plane(looked_at, x[part[1]], y[part[0]], name)
    planes = coefficients[0] * x + coefficients[1] * y[:, None] + coefficients[2]
    there = there[top:bottom]
    ends = there.argmax(axis=1).astype(float), there[:, ::-1].argmax(axis=1).astype(float)
    rows, some = np.arange(top, bottom), there.any(axis=1)
    at = ends[0].astype(int), camera.width - 1 - ends[1].astype(int)
    return Wall(
        inverse=looked_at,
        plane=planes[part],
        known=known,
        x=x[part[1]],
        y=y[part[0]],
        coefficients=coefficients,
        missing=float(np.isnan(looked_at).mean()),
        band=(left, right),
        edges=(ends[0][some], ends[1][some]),
        edge_planes=(planes[rows, at[0]][some], planes[rows, at[1]][some]),
    )


def _middle(size: int, share: float) -> tuple[int, int]:
    aside = int(size * (1.0 - share) / 2)
    return aside, size - aside


def _band(share: NDArray[np.floating]) -> tuple[int, int]:
    """Count columns at both sides that are empty."""
    empty = share <= _BAND_SHARE
    if empty.all():
        return 0, 0
    return int((~empty).argmax()), int((~empty[::-1]).argmax())


def _fit_plane(
    inverse: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], name: str
) -> tuple[tuple[float, float, float], NDArray[np.bool_]]:
    """Fit the plane that most pixels are of, by least squares of those that are not far from it, again and again."""
    grid = np.broadcast_arrays(x, y[:, None], np.ones_like(inverse))
    there = np.isfinite(inverse)
    rows, values = np.stack([axis[there] for axis in grid], axis=-1), inverse[there]
    near = np.abs(values - np.median(values)) <= np.median(values)
    found = np.zeros(3)
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(rows[near], values[near], rcond=None)[0]
        apart = np.abs(values - rows @ found)
        limit = _OUTLIERS * max(float(np.median(apart)) / _MEDIAN_SHARE, 1e-7 * abs(found[2]))
        closer = apart <= limit
        if (closer == near).all():
            break
        near = closer
    spread = float(np.median(np.abs(values - rows @ found))) / _MEDIAN_SHARE
    if near.mean() < 0.5 or found[2] <= 0 or spread > _MAX_SPREAD * found[2]:
        raise ArrayError(
            f"{name} shows no flat wall: {format_percent(near.mean())} of its pixels are of one plane, and 1 / z is "
            f"{format_percent(spread / abs(found[2]))} from it"
        )
    known = np.zeros_like(there)
    known[there] = near
    return (float(found[0]), float(found[1]), float(found[2])), known
