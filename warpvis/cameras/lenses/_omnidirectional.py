# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Omnidirectional cameras: Mei's unified model with distortion, and Scaramuzza's polynomial.

Sources: Mei, Rives: Single view point omnidirectional camera calibration from planar grids, ICRA 2007; Scaramuzza,
Martinelli, Siegwart: A flexible technique for accurate omnidirectional camera calibration, ICVS 2006.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from warpvis.cameras.lenses._bent import Bent, BentLens
from warpvis.cameras.lenses._fisheyes import MAX_RADIUS, angle_gain, gain_slopes
from warpvis.cameras.lenses._lens import Floats, Lens, Rising, check_coefficients, radial_jacobian, rays_of
from warpvis.cameras.lenses._pinhole import decentered, decentered_slopes, scaled
from warpvis.core.checks import is_number
from warpvis.errors import CameraError

_NEAR_LIMIT = 1e-9
"""Decrement of the maximum angle until the denominator is positive [rad]."""


@dataclass(frozen=True)
class Mei(BentLens):
    """Mei's model, called MEI in camodocal, omni in Kalibr and omnidir in OpenCV.

    Directions are projected to ``x = X / (Z + xi d)``, ``y = Y / (Z + xi d)`` with ``d = |(X, Y, Z)|``, then OpenCV's
    distortion ``k1 k2 p1 p2`` is applied. Without distortion it equals `EUCM` with alpha ``xi / (1 + xi)``, whose focal
    lengths are divided by ``1 + xi``.
    """

    xi: float
    """At least 0: 0 for a pinhole, 1 for a parabolic mirror, greater for fisheye lenses."""
    coefficients: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    """``k1 k2 p1 p2``."""

    _counts: ClassVar[tuple[int, ...]] = (4,)
    _coefficient_names = ("k1", "k2", "p1", "p2")
    _is_flat: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.xi < 0:
            raise CameraError(f"xi of a lens must be at least 0, got {self.xi!r}")

    @property
    def is_pinhole(self) -> bool:
        """Whether xi and all coefficients are 0."""
        return self.xi == 0 and not any(self.coefficients)

    @property
    def is_radial(self) -> bool:
        """Whether tangential coefficients are 0."""
        return not any(self.coefficients[2:])

    @property
    def turns_back(self) -> bool:
        """Whether the mapping turns back at `max_angle`."""
        return self.xi > 1 or super().turns_back

    @cached_property
    def _limit(self) -> float:  # type: ignore[override]  # depends on xi
        """Angle at which the denominator is 0, or beyond which the undistorted radius decreases (xi above 1)."""
        limit = math.acos(-self.xi if self.xi < 1 else -1 / self.xi)
        while math.cos(limit) + self.xi <= 0:
            limit -= _NEAR_LIMIT
        return limit

    @property
    def _has_rim(self) -> bool:  # type: ignore[override]
        return self.xi > 1

    def _plane_radius(self, angle: Floats) -> Floats:
        return np.sin(angle) / (np.cos(angle) + self.xi)

    def _plane_angle(self, radius: Floats) -> Floats:
        square = radius * radius
        with np.errstate(invalid="ignore"):  # NaN beyond the maximum radius
            scale = (self.xi + np.sqrt(1 + (1 - self.xi * self.xi) * square)) / (square + 1)
        return np.arctan2(scale * radius, scale - self.xi)

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        radius, denominator = self._plane_radius(angle), np.cos(angle) + self.xi
        gain, slope = angle_gain(radius * radius, self.coefficients[:2])
        plane_slope = (1 + self.xi * np.cos(angle)) / (denominator * denominator)
        return radius * gain, (gain + 2 * radius * radius * slope) * plane_slope

    def _plane_slopes(self, angle: Floats) -> tuple[Floats, Floats]:
        square = (np.cos(angle) + self.xi) ** 2
        widened = np.zeros((len(angle), 5))
        widened[:, 0] = -np.sin(angle) / square
        return (1 + self.xi * np.cos(angle)) / square, widened

    def _bend_slopes(self, x: Floats, y: Floats) -> Floats:
        radial = np.stack([x, y], axis=1)[:, :, None] * gain_slopes(x * x + y * y, 2)[:, None]
        return np.concatenate([np.zeros((len(x), 2, 1)), radial, decentered_slopes(x, y)[:, :, :2]], axis=2)

    def _bend(self, x: Floats, y: Floats) -> Bent:
        radial = scaled(x, y, *angle_gain(x * x + y * y, self.coefficients[:2]))
        added = decentered(x, y, self.coefficients[2:], (0.0,) * 4)
        return Bent(*(a + b for a, b in zip(radial, added, strict=True)))


@dataclass(frozen=True)
class Scaramuzza(Lens):
    """Scaramuzza's model, as OCamCalib and camodocal write it: a polynomial of the radius in pixels.

    The direction of the point ``(x, y)`` at radius r is ``(x, y, -(a0 + a1 r + a2 r^2 + ...))``, and the pixel is
    ``(cx, cy)`` plus the matrix `affine` times ``(x, y)``. The inverse polynomial of these files approximates the same
    mapping to some hundredths of a pixel; it is not used.
    """

    cx: float
    """Center from the left edge of the image [px]."""
    cy: float
    """Center from the top edge of the image [px]."""
    coefficients: tuple[float, ...]
    """``a0 a1 a2 ...``, 1 to 12 numbers; ``a0`` [px] is negative."""
    affine: tuple[float, ...] = (1.0, 0.0, 0.0, 1.0)
    """The matrix ``((a, b), (c, d))`` as ``a b c d``."""

    _coefficient_names = ("a0", "a1", "a2", "a3", "a4", "a5", "a6", "a7", "a8", "a9", "a10", "a11")

    def __post_init__(self) -> None:
        for name in ("cx", "cy"):
            value = getattr(self, name)
            if not is_number(value) or not math.isfinite(value):
                raise CameraError(f"{name} of a lens must be a finite number, got {value!r}")
            object.__setattr__(self, name, float(value))
        object.__setattr__(self, "coefficients", check_coefficients(self.coefficients, "Scaramuzza", range(1, 13)))
        object.__setattr__(self, "affine", check_coefficients(self.affine, "Scaramuzza", (4,), "affine"))
        if self.coefficients[0] >= 0:
            raise CameraError(f"the first coefficient of Scaramuzza must be below 0, got {self.coefficients[0]!r}")
        a, b, c, d = self.affine
        if a * d - b * c <= 0:
            raise CameraError(f"affine of Scaramuzza must be a matrix with a positive determinant, got {self.affine}")

    @property
    def max_angle(self) -> float:
        """Angle from the axis up to which the lens is injective [rad]."""
        return self._rising.max_value

    @property
    def turns_back(self) -> bool:
        """Whether the angle decreases again beyond the radius of `max_angle`."""
        return self._rising.turns

    def _angle(self, radius: Floats) -> tuple[Floats, Floats]:
        """Return the angle at a radius [px], and its derivative."""
        depth = np.polynomial.Polynomial([-a for a in self.coefficients])
        z = depth(radius)
        return np.arctan2(radius, z), (z - radius * depth.deriv()(radius)) / (radius * radius + z * z)

    @cached_property
    def _rising(self) -> Rising:
        limit = 1.0
        while limit < MAX_RADIUS and self._angle(np.array(limit))[1] > 0:
            limit *= 2
        return Rising(self._angle, limit)

    def _project(self, points: Floats) -> Floats:
        x, y, z = points.T
        axis_distance = np.hypot(x, y)
        radius = self._rising.inverse(np.arctan2(axis_distance, z))
        scale = np.where(axis_distance > 0, radius / axis_distance, np.where(z > 0, 0.0, np.nan))
        a, b, c, d = self.affine
        x, y = scale * x, scale * y
        return np.stack([self.cx + a * x + b * y, self.cy + c * x + d * y], axis=-1)

    def _unproject(self, pixels: Floats) -> Floats:
        a, b, c, d = self.affine
        u, v = (pixels - (self.cx, self.cy)).T / (a * d - b * c)
        x, y = d * u - b * v, a * v - c * u
        radius = np.hypot(x, y)
        angle = np.where(radius <= self._rising.end, self._angle(radius)[0], np.nan)
        return rays_of(angle, x, y, radius)

    def _direction_jacobian(self, pixels: Floats, directions: Floats) -> Floats:
        (a, b, c, d), count = self.affine, len(self.coefficients)
        inverse = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
        x, y = inverse @ (pixels - (self.cx, self.cy)).T
        radius = np.hypot(x, y)
        angle, slope = self._angle(radius)
        depth = np.polynomial.Polynomial([-a for a in self.coefficients])(radius)
        moved, widened = np.zeros((len(x), 2, 6 + count)), np.zeros((len(x), 6 + count))
        moved[:, :, :2] = -inverse
        for column, (row, coordinate) in enumerate([(0, x), (0, y), (1, x), (1, y)], start=2 + count):
            moved[:, :, column] = -coordinate[:, None] * inverse[:, row]
        # dt = r^(i + 1) / (r^2 + z^2) for a_i at a fixed radius; the radius changes by -dt / (dt/dr) at a fixed angle.
        powers = radius[:, None] ** np.arange(1, count + 1)
        widened[:, 2 : 2 + count] = -powers / ((radius * radius + depth * depth) * slope)[:, None]
        return radial_jacobian(angle, x, y, 1 / slope, moved, widened)
