# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""NVIDIA's F-theta lens: a polynomial between the angle from the axis and the radius in pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from warpvis.cameras.lenses._lens import Lens, check_coefficients, rays_of
from warpvis.cameras.lenses._rising import Floats, Rising
from warpvis.core.checks import check_choice, is_number
from warpvis.errors import CameraError

_MAX_RADIUS = 2.0**20
"""Upper bound of the radius of images [px]."""


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
            raise CameraError(f"the first coefficient of FTheta must be above 0, got {self.coefficients[0]!r}")

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
            while limit < _MAX_RADIUS and polynomial(limit) < self.max_view_angle and slope(limit) > 0:
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
