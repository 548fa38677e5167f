# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Planes and residuals of depth images of flat walls.

1 / z of a plane is linear in the pixel coordinates, and so is the disparity of a stereo camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import format_percent
from warpvis.errors import ArrayError

# Pixels farther from the plane than this number of standard deviations do not belong to the wall.
_OUTLIERS = 6.0
_ITERATIONS = 12
# Maximum standard deviation of 1 / z about the plane, relative to 1 / z.
_MAX_SPREAD = 0.25
_MIN_PIXELS = 400
# Maximum fraction of pixels with depth in a column of the invalid band.
_BAND_SHARE = 0.02
# Median absolute deviation of a normal distribution with standard deviation 1.
_NORMAL_MAD = 0.6745


@dataclass(frozen=True)
class Wall:
    """One depth image of a wall, cropped to the evaluated region."""

    inverse: NDArray[np.float64]
    """1 / z of the pixels [1/m], shape (H, W); NaN where there is no depth."""
    plane: NDArray[np.float64]
    """1 / z of the plane [1/m], shape (H, W)."""
    known: NDArray[np.bool_]
    """Mask of pixels that have depth and belong to the wall."""
    x: NDArray[np.float64]
    """x / z of the columns."""
    y: NDArray[np.float64]
    """y / z of the rows."""
    coefficients: tuple[float, float, float]
    """The plane is 1 / z = a x / z + b y / z + c, with coefficients (a, b, c) [1/m]."""
    missing: float
    """Fraction of pixels without depth, from 0 to 1."""
    band: tuple[int, int]
    """Number of columns without depth at the left and the right side of the whole image."""
    edges: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Number of pixels without depth at the left and the right end of each row, shape (rows)."""
    edge_planes: tuple[NDArray[np.float64], NDArray[np.float64]]
    """1 / z of the plane at the first pixel with depth from the left and the right [1/m]."""

    def rows(self, pixels: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the factors (x / z, y / z, 1) of the coefficients for pixel indices, shape (N, 3)."""
        row, column = np.divmod(pixels, len(self.x))
        return np.stack([self.x[column], self.y[row], np.ones(len(pixels))], axis=-1)

    def with_plane(self, coefficients: NDArray[np.float64]) -> Wall:
        """Return the wall with another plane."""
        plane = coefficients[0] * self.x + coefficients[1] * self.y[:, None] + coefficients[2]
        first, second, third = (float(number) for number in coefficients)
        return replace(self, plane=plane, coefficients=(first, second, third))

    @property
    def residuals(self) -> NDArray[np.float64]:
        """1 / z of the pixels minus 1 / z of the plane [1/m], shape (H, W); NaN outside of `known`."""
        return np.where(self.known, self.inverse - self.plane, np.nan)

    @property
    def distance(self) -> float:
        """Depth of the wall on the axis of the camera [m]."""
        return 1.0 / self.coefficients[2]

    @property
    def angle(self) -> float:
        """Angle between the axis of the camera and the normal of the wall [rad]."""
        return math.acos(min(1.0, abs(self.coefficients[2]) / float(np.linalg.norm(self.coefficients))))

    @property
    def plane_rms(self) -> float:
        """RMS error of depth about the plane [m], Intel's plane-fit RMS error."""
        errors = 1.0 / self.inverse[self.known] - 1.0 / self.plane[self.known]
        return float(np.sqrt(np.mean(errors**2)))


def measure_wall(depth: NDArray[np.floating], camera: Camera, region: float, name: str) -> Wall:
    """Fit a plane to planar depth [m], ``(H, W)``; 0 or not finite where there is no depth.

    `region` is the fraction of the width and height of the image to evaluate, about its center.

    Raises:
        ArrayError: If the image shows no wall; the message begins with `name`.
    """
    valid = np.isfinite(depth) & (depth > 0)
    inverse = np.where(valid, 1.0 / np.where(valid, depth.astype(np.float64), 1.0), np.nan)
    x = (np.arange(camera.width, dtype=np.float64) + 0.5 - camera.cx) / camera.fx
    y = (np.arange(camera.height, dtype=np.float64) + 0.5 - camera.cy) / camera.fy
    left, right = _band(valid.mean(axis=0))
    top, bottom = _central_part(camera.height, region)
    first, last = _central_part(camera.width, region)
    part = slice(top, bottom), slice(max(first, left), min(last, camera.width - right))
    evaluated = inverse[part]
    if np.isfinite(evaluated).sum() < _MIN_PIXELS:
        raise ArrayError(f"{name} must have depth at {_MIN_PIXELS} or more pixels, got {np.isfinite(evaluated).sum()}")
    coefficients, known = _fit_plane(evaluated, x[part[1]], y[part[0]], name)
    planes = coefficients[0] * x + coefficients[1] * y[:, None] + coefficients[2]
    valid = valid[top:bottom]
    ends = valid.argmax(axis=1).astype(float), valid[:, ::-1].argmax(axis=1).astype(float)
    rows, nonempty = np.arange(top, bottom), valid.any(axis=1)
    columns = ends[0].astype(int), camera.width - 1 - ends[1].astype(int)
    return Wall(
        inverse=evaluated,
        plane=planes[part],
        known=known,
        x=x[part[1]],
        y=y[part[0]],
        coefficients=coefficients,
        missing=float(np.isnan(evaluated).mean()),
        band=(left, right),
        edges=(ends[0][nonempty], ends[1][nonempty]),
        edge_planes=(planes[rows, columns[0]][nonempty], planes[rows, columns[1]][nonempty]),
    )


def _central_part(size: int, share: float) -> tuple[int, int]:
    margin = int(size * (1.0 - share) / 2)
    return margin, size - margin


def _band(share: NDArray[np.floating]) -> tuple[int, int]:
    """Return the number of empty columns at the left and the right side."""
    empty = share <= _BAND_SHARE
    if empty.all():
        return 0, 0
    return int((~empty).argmax()), int((~empty[::-1]).argmax())


def _fit_plane(
    inverse: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], name: str
) -> tuple[tuple[float, float, float], NDArray[np.bool_]]:
    """Fit the plane of the majority of pixels by iterated least squares with rejection of outliers."""
    grid = np.broadcast_arrays(x, y[:, None], np.ones_like(inverse))
    valid = np.isfinite(inverse)
    rows, values = np.stack([axis[valid] for axis in grid], axis=-1), inverse[valid]
    inliers = np.abs(values - np.median(values)) <= np.median(values)
    plane = np.zeros(3)
    for _ in range(_ITERATIONS):
        plane = np.linalg.lstsq(rows[inliers], values[inliers], rcond=None)[0]
        errors = np.abs(values - rows @ plane)
        limit = _OUTLIERS * max(float(np.median(errors)) / _NORMAL_MAD, 1e-7 * abs(plane[2]))
        closer = errors <= limit
        if (closer == inliers).all():
            break
        inliers = closer
    spread = float(np.median(np.abs(values - rows @ plane))) / _NORMAL_MAD
    if inliers.mean() < 0.5 or plane[2] <= 0 or spread > _MAX_SPREAD * plane[2]:
        raise ArrayError(
            f"{name} must show a flat wall, got {format_percent(inliers.mean())} of its pixels on one plane, with a "
            f"deviation of {format_percent(spread / abs(plane[2]))} of 1 / z"
        )
    known = np.zeros_like(valid)
    known[valid] = inliers
    return (float(plane[0]), float(plane[1]), float(plane[2])), known
