# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What all lenses are: maps between directions and points of the image."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import fields
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import as_items, is_number
from warpvis.errors import ArrayError, CameraError
from warpvis.sensors.lenses._rising import Floats, Rising

_MAX_TABLES = 2  # an image, and a canvas around it
_PIXELS_AT_ONCE = 2**18  # what is computed on the way takes 20 times as much memory as rays


class Lens(ABC):
    """A map from directions of the camera frame (x right, y down, z forward) to points of the image, and back.

    The centre of pixel ``(x, y)`` is at ``(x + 0.5, y + 0.5)``: principal points of OpenCV, ROS and Kalibr, for which
    it is at whole numbers, are half a pixel less.
    """

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project camera-frame points to the image.

        Args:
            points: Points [m], or directions of any length, shape ``(..., 3)``.

        Returns:
            Coordinates ``(x, y)`` [px] from the image's top left corner, shape ``(..., 2)``; NaN where the lens maps
            nothing, or has turned back: there a second direction would have the same image.

        Raises:
            CameraError: `points` are no numbers of this shape.
        """
        given = _as_rows(points, 3, "points")
        with np.errstate(all="ignore"):  # what is at infinity, or nowhere, is NaN in the end
            found = self._project(np.ascontiguousarray(given.reshape(-1, 3)))
        found[~np.isfinite(found).all(axis=1)] = np.nan
        return found.reshape(*given.shape[:-1], 2)

    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Find the directions that points of the image show.

        Args:
            pixels: Coordinates ``(x, y)`` [px], shape ``(..., 2)``.

        Returns:
            Unit vectors, shape ``(..., 3)``; NaN where no direction has this image.

        Raises:
            CameraError: `pixels` are no numbers of this shape.
        """
        given = _as_rows(pixels, 2, "pixels")
        with np.errstate(all="ignore"):
            found = self._unproject(np.ascontiguousarray(given.reshape(-1, 2)))
        found[~np.isfinite(found).all(axis=1)] = np.nan
        return found.reshape(*given.shape[:-1], 3)

    def directions(self, width: int, height: int, first: tuple[int, int] = (0, 0)) -> NDArray[np.float64]:
        """Find what the centres of an image's pixels show; the same array, read-only, when it is asked for again.

        Args:
            width: Image width [px].
            height: Image height [px].
            first: Column and row of the first pixel, which may lie beside the image.

        Returns:
            Unit vectors, shape ``(height, width, 3)``; NaN where no direction has this image.
        """
        tables: dict[tuple[int, int, int, int], Floats] = self.__dict__.setdefault("_tables", {})
        part = (width, height, *first)
        if part not in tables:
            found, rows = np.empty((height, width, 3)), max(1, _PIXELS_AT_ONCE // width)
            columns = first[0] + np.arange(width) + 0.5
            for row in range(0, height, rows):
                some = first[1] + np.arange(row, min(row + rows, height)) + 0.5
                found[row : row + rows] = self.unproject(np.stack(np.meshgrid(columns, some), axis=-1))
            found.flags.writeable = False
            if len(tables) >= _MAX_TABLES:  # a lens is of one sensor: what is kept does not grow
                tables.clear()
            tables[part] = found
            return found
        return tables[part]

    def __getstate__(self) -> dict[str, Any]:
        """Return what the lens is, without what has been computed of it."""
        return {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]

    @property
    def is_pinhole(self) -> bool:
        """Whether it has no distortion: a `warpvis.Camera` of the same intrinsics has the same image."""
        return False

    @property
    @abstractmethod
    def max_angle(self) -> float:
        """The angle from the axis up to which the lens maps one to one, in every direction [rad]."""

    @property
    @abstractmethod
    def turns_back(self) -> bool:
        """Whether it ends there because the mapping turns back (fold-over), or is not defined beyond."""

    @abstractmethod
    def _project(self, points: Floats) -> Floats: ...

    @abstractmethod
    def _unproject(self, pixels: Floats) -> Floats: ...


class RadialLens(Lens):
    """A lens that is the same all around its axis: the image's radius is a function of the angle.

    Subclasses have fields `fx`, `fy`, `cx`, `cy` [px].
    """

    fx: float
    fy: float
    cx: float
    cy: float

    _limit: ClassVar[float] = math.pi
    """The greatest angle that the formula is for [rad]."""

    @abstractmethod
    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        """Compute the image's radius, in focal lengths, and its slope."""

    @cached_property
    def _rising(self) -> Rising:
        return Rising(self._radius, self._limit)

    @property
    def max_angle(self) -> float:
        """The angle from the axis up to which the lens maps one to one [rad]."""
        return self._rising.end

    @property
    def turns_back(self) -> bool:
        """Whether it ends there because the mapping turns back."""
        return self._rising.turns

    def _project(self, points: Floats) -> Floats:
        x, y, z = points.T
        aside = np.hypot(x, y)
        angle = np.arctan2(aside, z)
        radius = np.where((angle <= self.max_angle) & (angle < self._limit), self._radius(angle)[0], np.nan)
        # In the axis the radius is 0, and straight behind it has no azimuth.
        scale = np.where(aside > 0, radius / aside, np.where(z > 0, 0.0, np.nan))
        return self._to_pixels(scale * x, scale * y)

    def _unproject(self, pixels: Floats) -> Floats:
        x, y = self._from_pixels(pixels)
        radius = np.hypot(x, y)
        return rays_of(self._rising.inverse(radius), x, y, radius)

    def _to_pixels(self, x: Floats, y: Floats) -> Floats:
        return np.stack([self.fx * x + self.cx, self.fy * y + self.cy], axis=-1)

    def _from_pixels(self, pixels: Floats) -> tuple[Floats, Floats]:
        return (pixels[:, 0] - self.cx) / self.fx, (pixels[:, 1] - self.cy) / self.fy


def rays_of(angle: Floats, x: Floats, y: Floats, radius: Floats) -> Floats:
    """Return unit vectors at an angle [rad] from the axis, towards ``(x, y)`` of that radius."""
    aside = np.where(radius > 0, np.sin(angle) / np.where(radius > 0, radius, 1.0), 0.0)
    return np.stack([aside * x, aside * y, np.cos(angle)], axis=-1)


def check_fields(lens: Lens, counts: Sequence[int] = (), positive: Sequence[str] = ("fx", "fy")) -> None:
    """Check a lens's numbers, and make floats and tuples of them, whichever types they were given as.

    Args:
        lens: A frozen dataclass, of which `coefficients` is a sequence, all others are numbers.
        counts: How many coefficients there may be.
        positive: Which numbers have to be above 0.

    Raises:
        CameraError: One is not what it has to be.
    """
    for field in fields(lens):  # type: ignore[arg-type]  # lenses that are built are dataclasses
        value = getattr(lens, field.name)
        if field.name == "coefficients":
            value = check_coefficients(value, type(lens).__name__, counts)
        else:
            if not is_number(value) or not math.isfinite(value) or (field.name in positive and value <= 0):
                wanted = "a number above 0" if field.name in positive else "a finite number"
                raise CameraError(f"{field.name} of a lens must be {wanted}, got {value!r}")
            value = float(value)
        object.__setattr__(lens, field.name, value)


def check_coefficients(
    values: object, name: str, counts: Sequence[int], noun: str = "coefficients"
) -> tuple[float, ...]:
    """Return a lens's coefficients: one of so many finite numbers.

    Raises:
        CameraError: They are others.
    """
    items = np.ravel(values).tolist() if isinstance(values, np.ndarray) else as_items(values, noun, CameraError)
    if len(items) not in counts:
        raise CameraError(f"{name} has {listed(counts)} {noun}, got {len(items)}")
    wrong = [item for item in items if not is_number(item) or not math.isfinite(item)]
    if wrong:
        raise CameraError(f"{noun} of {name} must be finite numbers, got {wrong[0]!r}")
    return tuple(float(item) for item in items)


def listed(counts: Sequence[int]) -> str:
    """Write numbers to choose from: ``4, 5 or 8``."""
    *most, last = map(str, counts)
    return f"{', '.join(most)} or {last}" if most else last


def _as_rows(values: ArrayLike, count: int, name: str) -> Floats:
    try:
        rows = as_numpy(values, name=name).astype(np.float64)
    except ArrayError as error:
        raise CameraError(str(error)) from None
    if rows.shape[-1:] != (count,):
        raise CameraError(f"{name} must have shape (..., {count}), got {rows.shape}")
    return rows
