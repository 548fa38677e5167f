# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fisheye lenses: polynomials of the angle from the axis; NVIDIA's F-theta maps it to the radius in pixels, or back.

Sources: https://docs.opencv.org/4.x/db/d58/group__calib3d__fisheye.html, COLMAP's ``src/colmap/sensor/models.h``
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from warpvis.cameras.lenses._bent import Bent, BentLens
from warpvis.cameras.lenses._lens import Floats, Lens, RadialLens, Rising, check_coefficients, radial_jacobian, rays_of
from warpvis.cameras.lenses._pinhole import decentered, decentered_slopes, scaled
from warpvis.core.checks import check_choice, is_number
from warpvis.errors import CameraError

MAX_RADIUS = 2.0**20
"""Upper bound of the radius of images [px]."""


def angle_gain(square: Floats, coefficients: Sequence[float]) -> tuple[Floats, Floats]:
    """Return ``1 + k1 s + k2 s^2 + ...`` and its derivative with respect to s."""
    polynomial = np.polynomial.Polynomial([1.0, *coefficients])
    return polynomial(square), polynomial.deriv()(square)


def _angle_radius(angle: Floats, coefficients: Sequence[float]) -> tuple[Floats, Floats]:
    gain, slope = angle_gain(angle * angle, coefficients)
    return angle * gain, gain + 2 * angle * angle * slope


def gain_slopes(square: Floats, count: int) -> Floats:
    """Return derivatives of `angle_gain` with respect to the first `count` coefficients, shape ``(n, count)``."""
    return square[:, None] ** np.arange(1, count + 1)


@dataclass(frozen=True)
class KannalaBrandt(RadialLens):
    """OpenCV's fisheye, called equidistant in ROS and Kalibr: ``r = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8)``.

    t is the angle from the axis, up to pi. With zero coefficients, it is the equidistant fisheye.
    """

    coefficients: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    """``k1 k2 k3 k4``."""

    _counts: ClassVar[tuple[int, ...]] = (4,)
    _coefficient_names = ("k1", "k2", "k3", "k4")

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        return _angle_radius(angle, self.coefficients)

    def _radius_slopes(self, angle: Floats) -> Floats:
        return angle[:, None] * gain_slopes(angle * angle, 4)


@dataclass(frozen=True)
class ThinPrismFisheye(BentLens):
    """COLMAP's THIN_PRISM_FISHEYE: OpenCV's distortion applied to the angle, with a fourth radial coefficient."""

    coefficients: tuple[float, ...] = (0.0,) * 8
    """``k1 k2 p1 p2 k3 k4 sx1 sy1``."""

    _counts: ClassVar[tuple[int, ...]] = (8,)
    _coefficient_names = ("k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1")
    _is_flat: ClassVar[bool] = False

    @property
    def is_radial(self) -> bool:
        """Whether all but the radial coefficients are 0."""
        return not any(self.coefficients[2:4]) and not any(self.coefficients[6:])

    @property
    def _radial(self) -> tuple[float, ...]:
        k1, k2, _, _, k3, k4, _, _ = self.coefficients
        return k1, k2, k3, k4

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        return _angle_radius(angle, self._radial)

    def _bend(self, x: Floats, y: Floats) -> Bent:
        _, _, p1, p2, _, _, sx1, sy1 = self.coefficients
        radial = scaled(x, y, *angle_gain(x * x + y * y, self._radial))
        added = decentered(x, y, (p1, p2), (sx1, 0.0, sy1, 0.0))
        return Bent(*(a + b for a, b in zip(radial, added, strict=True)))

    def _bend_slopes(self, x: Floats, y: Floats) -> Floats:
        radial = np.stack([x, y], axis=1)[:, :, None] * gain_slopes(x * x + y * y, 4)[:, None]
        shifts = decentered_slopes(x, y)
        return np.concatenate([radial[:, :, :2], shifts[:, :, :2], radial[:, :, 2:], shifts[:, :, [2, 4]]], axis=2)


@dataclass(frozen=True)
class RadTanThinPrismFisheye(BentLens):
    """COLMAP's RAD_TAN_THIN_PRISM_FISHEYE, called fisheye624 in Project Aria.

    A polynomial scales the angle first; the tangential and thin-prism terms are functions of the resulting point.
    """

    coefficients: tuple[float, ...] = (0.0,) * 12
    """``k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3``."""

    _counts: ClassVar[tuple[int, ...]] = (12,)
    _coefficient_names = ("k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3")
    _is_flat: ClassVar[bool] = False

    @property
    def is_radial(self) -> bool:
        """Whether all but the radial coefficients are 0."""
        return not any(self.coefficients[6:])

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        return _angle_radius(angle, self.coefficients[:6])

    def _bend(self, x: Floats, y: Floats) -> Bent:
        p0, p1, *prism = self.coefficients[6:]
        radial = scaled(x, y, *angle_gain(x * x + y * y, self.coefficients[:6]))
        added = decentered(radial.x, radial.y, (p1, p0), tuple(prism))
        xx, xy, yx, yy = 1 + added.xx, added.xy, added.yx, 1 + added.yy
        return Bent(
            radial.x + added.x,
            radial.y + added.y,
            xx * radial.xx + xy * radial.yx,
            xx * radial.xy + xy * radial.yy,
            yx * radial.xx + yy * radial.yx,
            yx * radial.xy + yy * radial.yy,
        )

    def _bend_slopes(self, x: Floats, y: Floats) -> Floats:
        p0, p1, *prism = self.coefficients[6:]
        gain = angle_gain(x * x + y * y, self.coefficients[:6])[0]
        scaled_x, scaled_y = x * gain, y * gain
        added = decentered(scaled_x, scaled_y, (p1, p0), tuple(prism))
        jacobian = np.stack([1 + added.xx, added.xy, added.yx, 1 + added.yy], axis=1).reshape(-1, 2, 2)
        radial = np.stack([x, y], axis=1)[:, :, None] * gain_slopes(x * x + y * y, 6)[:, None]
        shifts = decentered_slopes(scaled_x, scaled_y)[:, :, [1, 0, 2, 3, 4, 5]]
        return np.concatenate([jacobian @ radial, shifts], axis=2)


@dataclass(frozen=True)
class FTheta(Lens):
    """A fisheye lens with a polynomial of degree up to 10 without constant term.

    DriveWorks and Isaac Sim use ``pixeldistance-to-angle`` and ``angle-to-pixeldistance`` polynomials; they write the
    constant term, 0, as first coefficient ``k0``, which is left out here.
    """

    cx: float
    """Principal point from the left edge of the image [px]."""
    cy: float
    """Principal point from the top edge of the image [px]."""
    coefficients: tuple[float, ...]
    """``k1 k2 ...``, at most 10, of ``k1 t + k2 t^2 + ...``."""
    maps: Literal["angle_to_radius", "radius_to_angle"] = "radius_to_angle"
    """Direction of the polynomial, between radians and pixels."""
    max_view_angle: float = math.pi
    """Maximum angle from the axis that the camera sees [rad]."""

    _coefficient_names = ("k1", "k2", "k3", "k4", "k5", "k6", "k7", "k8", "k9", "k10")
    _settings = ("max_view_angle",)

    def __post_init__(self) -> None:
        for name in ("cx", "cy"):
            value = getattr(self, name)
            if not is_number(value) or not math.isfinite(value):
                raise CameraError(f"{name} of a lens must be a finite number, got {value!r}")
            object.__setattr__(self, name, float(value))
        object.__setattr__(self, "coefficients", check_coefficients(self.coefficients, "FTheta", range(1, 11)))
        check_choice(self.maps, "maps", ("angle_to_radius", "radius_to_angle"), CameraError)
        if not is_number(self.max_view_angle) or not 0 < self.max_view_angle <= math.pi:
            raise CameraError(f"max_view_angle must be above 0 and at most pi radians, got {self.max_view_angle!r}")
        object.__setattr__(self, "max_view_angle", float(self.max_view_angle))
        if self.coefficients[0] <= 0:
            hint = ". Leave out the constant term, k0." if self.coefficients[0] == 0 else ""
            raise CameraError(f"the first coefficient of FTheta must be above 0, got {self.coefficients[0]!r}{hint}")

    @property
    def max_angle(self) -> float:
        """Angle from the axis up to which the lens is injective [rad]."""
        return self._rising.end if self._is_forward else min(self._rising.max_value, self.max_view_angle)

    @property
    def turns_back(self) -> bool:
        """Whether the polynomial turns back at `max_angle`."""
        return self._rising.turns and (self._is_forward or self._rising.max_value < self.max_view_angle)

    @property
    def _is_forward(self) -> bool:
        return self.maps == "angle_to_radius"

    @cached_property
    def _rising(self) -> Rising:
        polynomial = np.polynomial.Polynomial([0.0, *self.coefficients])
        slope = polynomial.deriv()
        limit = self.max_view_angle
        if not self._is_forward:
            limit = 1.0
            while limit < MAX_RADIUS and polynomial(limit) < self.max_view_angle and slope(limit) > 0:
                limit *= 2
        return Rising(lambda x: (polynomial(x), slope(x)), limit)

    def _value(self, x: Floats) -> Floats:
        return np.polynomial.Polynomial([0.0, *self.coefficients])(x)

    def _project(self, points: Floats) -> Floats:
        x, y, z = points.T
        axis_distance = np.hypot(x, y)
        angle = np.arctan2(axis_distance, z)
        angle = np.where(angle <= self.max_angle, angle, np.nan)
        radius = self._value(angle) if self._is_forward else self._rising.inverse(angle)
        scale = np.where(axis_distance > 0, radius / axis_distance, np.where(z > 0, 0.0, np.nan))
        return np.stack([self.cx + scale * x, self.cy + scale * y], axis=-1)

    def _unproject(self, pixels: Floats) -> Floats:
        x, y = pixels[:, 0] - self.cx, pixels[:, 1] - self.cy
        radius = np.hypot(x, y)
        if self._is_forward:
            angle = self._rising.inverse(radius)
        else:
            angle = np.where(radius <= self._rising.end, self._value(radius), np.nan)
        return rays_of(np.where(angle <= self.max_angle, angle, np.nan), x, y, radius)

    def _direction_jacobian(self, pixels: Floats, directions: Floats) -> Floats:
        x, y = pixels[:, 0] - self.cx, pixels[:, 1] - self.cy
        angle = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2])
        argument = angle if self._is_forward else np.hypot(x, y)
        slope = np.polynomial.Polynomial([0.0, *self.coefficients]).deriv()(argument)
        powers = argument[:, None] ** np.arange(1, len(self.coefficients) + 1)
        if not self._is_forward:  # the inverse function: dr/dt = 1 / (dt/dr), dr = -dt / (dt/dr)
            powers, slope = -powers / slope[:, None], 1 / slope
        widened = np.concatenate([np.zeros((len(x), 2)), powers], axis=1)
        moved = np.zeros((len(x), 2, widened.shape[1]))
        moved[:, 0, 0] = moved[:, 1, 1] = -1.0
        return radial_jacobian(angle, x, y, slope, moved, widened)
