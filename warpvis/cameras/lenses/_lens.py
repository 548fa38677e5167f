# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Base classes of lenses, and inverses of increasing functions."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.checks import as_rows
from warpvis.core.arrays import freeze
from warpvis.core.checks import as_items, is_number
from warpvis.errors import CameraError

Floats = NDArray[np.float64]

_SAMPLES = 4096
_MAX_STEPS = 200

_MAX_TABLES = 2  # an image and an enlarged canvas
_PIXELS_AT_ONCE = 2**18  # limits memory: intermediate values take 20 times as much memory as rays


class Lens(ABC):
    """A map from directions in the camera frame (x right, y down, z forward) to image points, and back.

    The center of pixel ``(x, y)`` is at ``(x + 0.5, y + 0.5)``. Principal points are half a pixel greater than in
    OpenCV, ROS and Kalibr, where pixel centers are at integers.
    """

    _coefficient_names: ClassVar[tuple[str, ...]] = ()
    """Names of the numbers in `coefficients`."""
    _settings: ClassVar[tuple[str, ...]] = ()
    """Fields that are numbers, but not parameters of the mapping."""

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project camera-frame points to the image.

        Args:
            points: Points [m], or directions of any length, shape ``(..., 3)``.

        Returns:
            Coordinates ``(x, y)`` [px] from the top left corner of the image, shape ``(..., 2)``; NaN where the mapping
            is undefined or has turned back, that is where two directions would have the same image point.
        """
        rows = as_rows(points, 3, "points")
        with np.errstate(all="ignore"):  # results that are not finite become NaN below
            result = self._project(np.ascontiguousarray(rows.reshape(-1, 3)))
        result[~np.isfinite(result).all(axis=1)] = np.nan
        return result.reshape(*rows.shape[:-1], 2)

    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return the directions of image points.

        Args:
            pixels: Coordinates ``(x, y)`` [px], shape ``(..., 2)``.

        Returns:
            Unit vectors, shape ``(..., 3)``; NaN where no direction maps to the image point.
        """
        rows = as_rows(pixels, 2, "pixels")
        with np.errstate(all="ignore"):
            result = self._unproject(np.ascontiguousarray(rows.reshape(-1, 2)))
        result[~np.isfinite(result).all(axis=1)] = np.nan
        return result.reshape(*rows.shape[:-1], 3)

    def directions(self, width: int, height: int, first: tuple[int, int] = (0, 0)) -> NDArray[np.float64]:
        """Return the directions of the pixel centers of an image. The result is cached and read-only.

        Args:
            width: Image width [px].
            height: Image height [px].
            first: Column and row of the first pixel; may be outside of the image.

        Returns:
            Unit vectors, shape ``(height, width, 3)``; NaN where no direction maps to the pixel center.
        """
        tables: dict[tuple[int, int, int, int], Floats] = self.__dict__.setdefault("_tables", {})
        part = (width, height, *first)
        if part not in tables:
            result, rows = np.empty((height, width, 3)), max(1, _PIXELS_AT_ONCE // width)
            columns = first[0] + np.arange(width) + 0.5
            for row in range(0, height, rows):
                centers = first[1] + np.arange(row, min(row + rows, height)) + 0.5
                result[row : row + rows] = self.unproject(np.stack(np.meshgrid(columns, centers), axis=-1))
            if len(tables) >= _MAX_TABLES:  # bound the cache
                tables.clear()
            tables[part] = freeze(result)
            return result  # another thread may clear the cache
        return tables[part]

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields without cached values."""
        return {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]

    @property
    def is_pinhole(self) -> bool:
        """Whether the lens has no distortion, that is equals a `warpvis.Camera` with the same intrinsics."""
        return False

    @property
    @abstractmethod
    def max_angle(self) -> float:
        """Angle from the axis up to which the lens is injective, at every azimuth [rad]."""

    @property
    @abstractmethod
    def turns_back(self) -> bool:
        """Whether the mapping turns back (fold-over) at `max_angle`, rather than being undefined beyond it."""

    @abstractmethod
    def _project(self, points: Floats) -> Floats: ...

    @abstractmethod
    def _unproject(self, pixels: Floats) -> Floats: ...

    def _direction_jacobian(self, pixels: Floats, directions: Floats) -> Floats | None:
        """Return derivatives of directions at fixed pixels, shape ``(n, 3, P)``; None without formulas for them."""
        return None


class Rising:
    """A function of one variable, restricted to the interval from 0 on which it increases strictly."""

    def __init__(self, function: Callable[[Floats], tuple[Floats, Floats]], limit: float) -> None:
        """Find the end of the interval; `function` returns values and derivatives up to `limit`, and is 0 at 0."""
        self._function = function
        self._samples = np.linspace(0.0, limit, _SAMPLES + 1)
        rises = self._rises(self._samples[1:])
        self.turns = not rises.all()
        """Whether the function stops increasing before the limit."""
        if self.turns:
            first = int(np.argmin(rises)) + 1
            self._samples = np.append(
                self._samples[:first], self._last_rise(self._samples[first - 1], self._samples[first])
            )
        self.end = float(self._samples[-1])
        """End of the interval."""
        with np.errstate(all="ignore"):
            self._values = np.maximum.accumulate(function(self._samples)[0])
        self.max_value = float(self._values[-1])
        """Value at the end of the interval."""

    def _rises(self, samples: Floats) -> NDArray[np.bool_]:
        with np.errstate(all="ignore"):
            values, slopes = self._function(samples)
            return (values > 0) & (slopes > 0)

    def _last_rise(self, low: float, high: float) -> float:
        """Bisect until the bounds are adjacent floating-point numbers."""
        while low < (midpoint := (low + high) / 2) < high:
            if self._rises(np.array([midpoint]))[0]:
                low = midpoint
            else:
                high = midpoint
        return low

    def inverse(self, values: Floats) -> Floats:
        """Return the inverse at non-negative values; NaN for values that are never reached.

        Newton's method starts from a table. A step that leaves the bracket is replaced by bisection, which guarantees
        convergence.
        """
        reached = (values >= 0) & (values <= self.max_value)
        target = values[reached]
        index = np.clip(np.searchsorted(self._values, target) - 1, 0, len(self._samples) - 2)
        low, high = self._samples[index], self._samples[index + 1]
        x = (low + high) / 2
        active = np.arange(len(target))
        for _ in range(_MAX_STEPS):
            current, a, b = x[active], low[active], high[active]
            with np.errstate(all="ignore"):
                value, slope = self._function(current)
                error = value - target[active]
                step = current - error / slope
            a, b = np.where(error <= 0, current, a), np.where(error >= 0, current, b)
            step = np.where((step >= a) & (step <= b), step, (a + b) / 2)
            x[active], low[active], high[active] = step, a, b
            moved = np.abs(step - current) > 4e-15 * np.abs(step)
            active = active[moved]
            if not len(active):
                break
        result = np.full(values.shape, np.nan)
        result[reached] = x
        return result


@dataclass(frozen=True)
class RadialLens(Lens):
    """A rotationally symmetric lens: the radius in the image is a function of the angle from the axis."""

    fx: float
    """Horizontal focal length [px]."""
    fy: float
    """Vertical focal length [px]."""
    cx: float
    """Principal point from the left edge of the image [px]."""
    cy: float
    """Principal point from the top edge of the image [px]."""

    _limit: ClassVar[float] = math.pi
    """Maximum angle for which the formula is defined [rad]."""
    _counts: ClassVar[Sequence[int]] = ()
    """Valid numbers of coefficients."""

    def __post_init__(self) -> None:
        check_fields(self, self._counts)

    @abstractmethod
    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        """Return the radius in the image, in focal lengths, and its derivative with respect to the angle."""

    @cached_property
    def _rising(self) -> Rising:
        return Rising(self._radius, self._limit)

    @property
    def max_angle(self) -> float:
        """Angle from the axis up to which the lens is injective [rad]."""
        return self._rising.end

    @property
    def turns_back(self) -> bool:
        """Whether the mapping turns back at `max_angle`."""
        return self._rising.turns

    def _project(self, points: Floats) -> Floats:
        x, y, z = points.T
        axis_distance = np.hypot(x, y)
        angle = np.arctan2(axis_distance, z)
        radius = np.where((angle <= self.max_angle) & (angle < self._limit), self._radius(angle)[0], np.nan)
        # On the axis the radius is 0; directly behind the camera the azimuth is undefined.
        scale = np.where(axis_distance > 0, radius / axis_distance, np.where(z > 0, 0.0, np.nan))
        return self._to_pixels(scale * x, scale * y)

    def _unproject(self, pixels: Floats) -> Floats:
        x, y = self._from_pixels(pixels)
        radius = np.hypot(x, y)
        return rays_of(self._rising.inverse(radius), x, y, radius)

    def _radius_slopes(self, angle: Floats) -> Floats | None:
        """Return derivatives of the radius at fixed angles, for all parameters after ``fx fy cx cy``, ``(n, C)``."""
        return None

    def _direction_jacobian(self, pixels: Floats, directions: Floats) -> Floats | None:
        angle = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2])
        slopes = self._radius_slopes(angle)
        if slopes is None:
            return None
        moved = np.concatenate([self._intrinsic_slopes(pixels), np.zeros((len(pixels), 2, slopes.shape[1]))], axis=2)
        widened = np.concatenate([np.zeros((len(pixels), 4)), slopes], axis=1)
        return radial_jacobian(angle, *self._from_pixels(pixels), self._radius(angle)[1], moved, widened)

    def _intrinsic_slopes(self, pixels: Floats) -> Floats:
        """Return derivatives of `_from_pixels` with respect to ``fx fy cx cy``, shape ``(n, 2, 4)``."""
        x, y = self._from_pixels(pixels)
        slopes = np.zeros((len(pixels), 2, 4))
        slopes[:, 0, 0], slopes[:, 1, 1] = -x / self.fx, -y / self.fy
        slopes[:, 0, 2], slopes[:, 1, 3] = -1 / self.fx, -1 / self.fy
        return slopes

    def _to_pixels(self, x: Floats, y: Floats) -> Floats:
        return np.stack([self.fx * x + self.cx, self.fy * y + self.cy], axis=-1)

    def _from_pixels(self, pixels: Floats) -> tuple[Floats, Floats]:
        return (pixels[:, 0] - self.cx) / self.fx, (pixels[:, 1] - self.cy) / self.fy


def rays_of(angle: Floats, x: Floats, y: Floats, radius: Floats) -> Floats:
    """Return unit vectors at an angle from the axis [rad], toward ``(x, y)`` with that radius."""
    scale = np.where(radius > 0, np.sin(angle) / np.where(radius > 0, radius, 1.0), 0.0)
    return np.stack([scale * x, scale * y, np.cos(angle)], axis=-1)


def radial_jacobian(angle: Floats, x: Floats, y: Floats, slope: Floats, moved: Floats, widened: Floats) -> Floats:
    """Return derivatives of the unit vectors ``(sin t e, cos t)``, where ``r(t) e`` is a point of a plane.

    With ``e'`` normal to ``e``, ``dt = (e . dx - dr) / (dr/dt)`` and the azimuth changes by ``(e' . dx) / r``.

    Args:
        angle: Angles t from the axis [rad], shape ``(n,)``.
        x: Coordinates of the points, shape ``(n,)``.
        y: Coordinates of the points, shape ``(n,)``.
        slope: Derivatives dr/dt of the radius with respect to the angle, shape ``(n,)``.
        moved: Derivatives dx of the points with respect to P parameters, shape ``(n, 2, P)``.
        widened: Derivatives dr of the radius at a fixed angle with respect to P parameters, shape ``(n, P)``.

    Returns:
        Shape ``(n, 3, P)``.
    """
    radius, sine, cosine = np.hypot(x, y), np.sin(angle), np.cos(angle)
    away = radius > 0
    divisor = np.where(away, radius, 1.0)
    # On the axis any azimuth will do: the radius grows equally in all directions.
    ex, ey = np.where(away, x / divisor, 1.0)[:, None], np.where(away, y / divisor, 0.0)[:, None]
    along = (ex * moved[:, 0] + ey * moved[:, 1] - widened) / slope[:, None]
    across = (ex * moved[:, 1] - ey * moved[:, 0]) * np.where(away, sine / divisor, 1 / slope)[:, None]
    outward = cosine[:, None] * along
    return np.stack([ex * outward - ey * across, ey * outward + ex * across, -sine[:, None] * along], axis=1)


def check_fields(lens: Lens, counts: Sequence[int] = (), positive: Sequence[str] = ("fx", "fy")) -> None:
    """Check the fields of a lens, a frozen dataclass, and convert them to floats and tuples of floats.

    `coefficients` is a sequence with one of the lengths `counts`; all other fields are numbers.
    """
    for field in fields(lens):  # type: ignore[arg-type]  # concrete lenses are dataclasses
        value = getattr(lens, field.name)
        if field.name == "coefficients":
            value = check_coefficients(value, type(lens).__name__, counts)
        else:
            if not is_number(value) or not math.isfinite(value) or (field.name in positive and value <= 0):
                expected = "a number of pixels above 0" if field.name in positive else "a finite number"
                raise CameraError(f"{field.name} of a lens must be {expected}, got {value!r}")
            value = float(value)
        object.__setattr__(lens, field.name, value)


def check_coefficients(
    values: object, name: str, counts: Sequence[int], noun: str = "coefficients"
) -> tuple[float, ...]:
    """Check the coefficients of a lens, and return them as a tuple."""
    items = np.ravel(values).tolist() if isinstance(values, np.ndarray) else as_items(values, noun, CameraError)
    if len(items) not in counts:
        raise CameraError(f"{noun} of {name} must be {format_alternatives(counts)} numbers, got {len(items)}")
    wrong = [item for item in items if not is_number(item) or not math.isfinite(item)]
    if wrong:
        raise CameraError(f"{noun} of {name} must be finite numbers, got {wrong[0]!r}")
    return tuple(float(item) for item in items)


def format_alternatives(counts: Sequence[int]) -> str:
    """Format alternatives: ``4, 5 or 8``."""
    *initial, last = map(str, counts)
    return f"{', '.join(initial)} or {last}" if initial else last
