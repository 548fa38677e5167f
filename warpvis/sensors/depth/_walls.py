# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Planes, residuals, quantization steps and noise of depth images of flat walls.

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
_PLANE_ITERATIONS = 12
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
    for _ in range(_PLANE_ITERATIONS):
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


# An image is quantized if it has at least _MIN_VALUES distinct values, at most _MAX_VALUES of the number of pixels, and
# if their RMS distance from multiples of a step is at most _MAX_ERROR [steps].
_MAX_VALUES, _MAX_ERROR, _MIN_VALUES = 0.05, 0.12, 4
# Minimum RMS distance from the plane [steps]: rounding alone gives 0.29.
_MIN_SPREAD = 0.15
# Minimum ratio of the step of 1 / z to the rounding error of depth.
_MIN_ROUNDINGS = 3.0
# Relative rounding error of depth in single precision.
_SINGLE = 2.0**-23
# Pixels per wall and iterations of the fit, and minimum deviation [steps]: smaller ones cannot be distinguished from 0.
_SAMPLES, _ITERATIONS, _MIN_SIGMA = 6000, 25, 1e-3
# Maximum lag of the autocorrelation [px], also limited to a quarter of the image; maximum spacing of noise nodes.
_MAX_LAG, _MAX_SPACING = 64, 64


def find_quantum(walls: list[Wall], depth_step: float) -> float:
    """Return the median step of 1 / z [1/m] over all images; 0 if most images are not quantized."""
    quanta = [_find_quantum_of_wall(wall, depth_step) for wall in walls]
    steps = [quantum for quantum in quanta if quantum > 0]
    # With a `depth_step`, a minority is enough: the steps of near walls may be finer than the depth_step.
    if not steps or (depth_step == 0.0 and len(steps) <= len(quanta) / 2):
        return 0.0
    median = float(np.median(steps))
    return float(np.median([_refine(wall, median) for wall, quantum in zip(walls, quanta, strict=True) if quantum > 0]))


def _find_quantum_of_wall(wall: Wall, depth_step: float) -> float:
    values, rounding = _find_distinct_values(wall, depth_step)
    if not _MIN_VALUES <= len(values) <= _MAX_VALUES * wall.known.sum():
        return 0.0
    gaps = np.diff(values)
    small = float(np.percentile(gaps, 10))
    quantum = float(np.median(gaps[gaps < 1.5 * small])) if (gaps < 1.5 * small).any() else small
    if quantum < _MIN_ROUNDINGS * rounding:
        return 0.0
    # Consecutive values are a few steps apart, so that their number is unambiguous.
    for _ in range(4):
        steps = np.concatenate([[0.0], np.cumsum(np.round(gaps / quantum))])
        quantum, first = np.polyfit(steps, values, 1)
    error = np.sqrt(np.mean((values - first - quantum * steps) ** 2)) / quantum
    # Without quantization, a wall that is slanted sideways has one value per column, evenly spaced, but on the plane.
    spread = np.sqrt(np.mean(wall.residuals[wall.known] ** 2)) / quantum
    return float(quantum) if error <= _MAX_ERROR and spread >= _MIN_SPREAD else 0.0


def _find_distinct_values(wall: Wall, depth_step: float) -> tuple[NDArray[np.float64], float]:
    """Return the values of 1 / z in an image, merged if they differ by rounding only, and the rounding error."""
    inverse = np.sort(wall.inverse[wall.known])
    rounding = float(inverse[-1]) * _SINGLE + depth_step * float(inverse[-1]) ** 2
    ends = np.flatnonzero(np.diff(inverse) > 2 * rounding)
    firsts = np.concatenate([[0], ends + 1])
    return np.add.reduceat(inverse, firsts) / np.diff(np.concatenate([firsts, [len(inverse)]])), rounding


def _refine(wall: Wall, quantum: float) -> float:
    """Fit the step to multiples counted from 1 / z = 0, which is more accurate, if all values agree with it."""
    values = wall.inverse[wall.known]
    steps = np.round(values / quantum)
    refined = float((values * steps).sum() / (steps**2).sum())
    error = np.sqrt(np.mean((values - refined * steps) ** 2)) / refined
    return refined if error <= _MAX_ERROR else quantum


def fit_spread(walls: list[Wall], quantum: float) -> tuple[list[Wall], float]:
    """Return walls with refitted planes, and the standard deviation of 1 / z about them before rounding.

    Without quantization, the planes are not changed. With it, planes and standard deviation maximize the likelihood: a
    value is observed where the plane plus noise is within half a step of it. The estimate is also valid if noise is
    below a step, where the mean square is not informative, and for walls with few steps. The likelihood is maximized
    alternately over the planes and the deviation by the BHHH algorithm (Berndt, Hall, Hall and Hausman 1974).
    """
    if quantum == 0.0:
        return walls, float(np.sqrt(np.mean(np.concatenate([wall.residuals[wall.known] for wall in walls]) ** 2)))
    samples = [_Sample.of(wall, quantum, seed) for seed, wall in enumerate(walls)]
    errors = np.concatenate([sample.value - sample.rows @ sample.plane for sample in samples])
    sigma = max(float(np.sqrt(max(np.mean(errors**2) - 1 / 12, 0.0))), _MIN_SIGMA)
    for _ in range(_ITERATIONS):
        slopes = [sample.improve(sigma) for sample in samples]
        slope = np.concatenate(slopes)
        step = float(slope.sum() / max((slope**2).sum(), 1e-30))
        sigma = max(sigma * math.exp(min(max(step, -0.5), 0.5)), _MIN_SIGMA)
    fitted = [wall.with_plane(sample.plane * quantum) for wall, sample in zip(walls, samples, strict=True)]
    return fitted, sigma * quantum


@dataclass
class _Sample:
    """Values of a random sample of pixels of a wall [steps]."""

    value: NDArray[np.float64]
    rows: NDArray[np.float64]
    plane: NDArray[np.float64]

    @classmethod
    def of(cls, wall: Wall, quantum: float, seed: int) -> _Sample:
        """Draw a sample of pixels."""
        known = np.flatnonzero(wall.known)
        chosen = np.random.default_rng(seed).choice(known, min(_SAMPLES, len(known)), replace=False)
        return cls(wall.inverse.ravel()[chosen] / quantum, wall.rows(chosen), np.array(wall.coefficients) / quantum)

    def improve(self, sigma: float) -> NDArray[np.float64]:
        """Update the plane by one step; return the derivatives of the log-likelihood by the logarithm of `sigma`."""
        residual = self.value - self.rows @ self.plane
        lower, upper = (residual - 0.5) / sigma, (residual + 0.5) / sigma
        probability = np.maximum(_normal_cdf(upper) - _normal_cdf(lower), 1e-12)
        lower_density, upper_density = _normal_pdf(lower), _normal_pdf(upper)
        slopes = ((lower_density - upper_density) / (probability * sigma))[:, None] * self.rows
        self.plane = self.plane + np.linalg.lstsq(slopes.T @ slopes, slopes.sum(axis=0), rcond=None)[0]
        return (lower * lower_density - upper * upper_density) / probability


_erf = np.frompyfunc(math.erf, 1, 1)


def _normal_cdf(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return (1.0 + np.asarray(_erf(x / math.sqrt(2.0)), dtype=np.float64)) / 2


def _normal_pdf(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.exp(-(x**2) / 2) / math.sqrt(2 * math.pi)


def correlation(walls: list[Wall], rounding: float) -> NDArray[np.float64]:
    """Return the autocorrelation of 1 / z about the planes, along rows and columns, at lags of 0, 1, 2, ... px.

    `rounding` is the variance of the rounding error [1/m^2], which is uncorrelated between pixels.
    """
    max_lag = min(_MAX_LAG, *(min(wall.known.shape) // 4 for wall in walls))
    sums, counts = np.zeros(max_lag + 1), np.zeros(max_lag + 1)
    for wall in walls:
        filled, known = np.where(wall.known, wall.inverse - wall.plane, 0.0), wall.known
        for lag in range(max_lag + 1):
            for rows, valid in ((filled, known), (filled.T, known.T)):
                sums[lag] += (rows[lag:] * rows[: len(rows) - lag]).sum()
                counts[lag] += (valid[lag:] & valid[: len(valid) - lag]).sum()
    products = sums / np.maximum(counts, 1)
    products[0] = max(products[0] - rounding, products[0] * 1e-3)
    return products / products[0]


def expected_correlation(spacing: int, count: int) -> NDArray[np.float64]:
    """Return the autocorrelation of the noise of `StereoDepth` at lags of 0, 1, 2, ... px along a row.

    It is averaged over a cell. Pixel i of a cell is the sum of the previous node times cos(a) and the next node times
    sin(a), with a = pi / 2 i / spacing.
    """
    angle = np.arange(spacing) / spacing * (np.pi / 2)
    weights = np.zeros((spacing, 2 * spacing + count + 2))
    result = np.empty(count)
    for lag in range(count):
        pixel = np.arange(spacing) + lag
        cell, lagged = pixel // spacing, pixel % spacing / spacing * (np.pi / 2)
        weights = np.where(cell == 0, np.cos(angle) * np.cos(lagged) + np.sin(angle) * np.sin(lagged), 0.0)
        weights = np.where(cell == 1, np.sin(angle) * np.cos(lagged), weights)
        result[lag] = weights.mean()
    return result


def find_spacing(measured: NDArray[np.float64]) -> int:
    """Return the spacing whose autocorrelation fits best in the sense of least squares."""
    spacings = range(1, min(_MAX_SPACING, len(measured) - 1) + 1)
    errors = [float(((expected_correlation(spacing, len(measured)) - measured) ** 2).sum()) for spacing in spacings]
    return spacings[int(np.argmin(errors))]
