# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lens models with at most two parameters: double sphere, EUCM, FOV and division.

Sources: Usenko, Demmel, Cremers: The Double Sphere Camera Model, 3DV 2018 (double sphere, EUCM); Devernay, Faugeras:
Straight lines have to be straight, 2001 (FOV); Fitzgibbon: Simultaneous linear estimation of multiple view geometry and
lens distortion, CVPR 2001 (division).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from warpvis.cameras.lenses._lens import Floats, RadialLens
from warpvis.errors import CameraError

_SERIES_OMEGA = 1e-4
"""Omega of `FOV` below which its derivative is a series [rad]."""


@dataclass(frozen=True)
class DoubleSphere(RadialLens):
    """The double sphere model, with centers `xi` apart: ``x = X / (alpha d2 + (1 - alpha) (xi d1 + Z))``.

    ``d1 = |(X, Y, Z)|`` and ``d2 = |(X, Y, xi d1 + Z)|``.
    """

    xi: float
    alpha: float
    """From 0 to 1."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_alpha(self.alpha)
        if self.xi <= -1:
            raise CameraError(f"xi of a double sphere must be above -1, got {self.xi!r}")

    @property
    def is_pinhole(self) -> bool:
        """Whether alpha and xi are 0."""
        return self.alpha == 0 and self.xi == 0

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        sine, cosine, xi, alpha = np.sin(angle), np.cos(angle), self.xi, self.alpha
        second = np.sqrt(sine * sine + (xi + cosine) ** 2)
        denominator = alpha * second + (1 - alpha) * (xi + cosine)
        denominator_slope = -alpha * xi * sine / second - (1 - alpha) * sine
        return sine / denominator, (cosine * denominator - sine * denominator_slope) / denominator**2

    def _radius_slopes(self, angle: Floats) -> Floats:
        sine, depth, alpha = np.sin(angle), self.xi + np.cos(angle), self.alpha
        second = np.sqrt(sine * sine + depth * depth)
        factor = -sine / (alpha * second + (1 - alpha) * depth) ** 2
        return np.stack([factor * (alpha * depth / second + 1 - alpha), factor * (second - depth)], axis=1)


@dataclass(frozen=True)
class EUCM(RadialLens):
    """The extended unified camera model: ``x = X / (alpha d + (1 - alpha) Z)``, ``d^2 = beta (X^2 + Y^2) + Z^2``.

    With ``beta = 1`` it is the unified camera model (UCM); the `xi` of Mei's model is ``alpha / (1 - alpha)``.
    """

    alpha: float
    """From 0 to 1."""
    beta: float = 1.0
    """Greater than 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_alpha(self.alpha)
        if self.beta <= 0:
            raise CameraError(f"beta of a lens must be a number above 0, got {self.beta!r}")

    @property
    def is_pinhole(self) -> bool:
        """Whether alpha is 0."""
        return self.alpha == 0

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        sine, cosine, alpha, beta = np.sin(angle), np.cos(angle), self.alpha, self.beta
        length = np.sqrt(beta * sine * sine + cosine * cosine)
        denominator = alpha * length + (1 - alpha) * cosine
        denominator_slope = alpha * (beta - 1) * sine * cosine / length - (1 - alpha) * sine
        return sine / denominator, (cosine * denominator - sine * denominator_slope) / denominator**2

    def _radius_slopes(self, angle: Floats) -> Floats:
        sine, cosine, alpha = np.sin(angle), np.cos(angle), self.alpha
        length = np.sqrt(self.beta * sine * sine + cosine * cosine)
        factor = -sine / (alpha * length + (1 - alpha) * cosine) ** 2
        return np.stack([factor * (length - cosine), factor * alpha * sine * sine / (2 * length)], axis=1)


@dataclass(frozen=True)
class FOV(RadialLens):
    """The field-of-view model of COLMAP, ORB-SLAM and Kalibr: ``r = atan(2 tan(angle) tan(omega / 2)) / omega``."""

    omega: float
    """Between -pi and pi [rad]; 0 is a pinhole camera."""

    _limit: ClassVar[float] = math.pi / 2

    def __post_init__(self) -> None:
        super().__post_init__()
        if not abs(self.omega) < math.pi:
            raise CameraError(f"omega of a lens must be between -pi and pi radians, got {self.omega!r}")

    @property
    def is_pinhole(self) -> bool:
        """Whether omega is 0."""
        return self.omega == 0

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        r = np.tan(angle)
        if self.omega == 0:
            return r, 1 + r * r
        factor = 2 * math.tan(self.omega / 2)
        # Sine and cosine are accurate at 90 degrees, the tangent is not.
        sine, cosine = np.sin(angle), np.cos(angle)
        return np.arctan2(factor * sine, cosine) / self.omega, factor / self.omega / (cosine**2 + (factor * sine) ** 2)

    def _radius_slopes(self, angle: Floats) -> Floats:
        if abs(self.omega) < _SERIES_OMEGA:  # r = tan + omega^2 (tan / 12 - tan^3 / 3) + ...; differences cancel
            r = np.tan(angle)
            return 2 * self.omega * (r / 12 - r**3 / 3)[:, None]
        sine, cosine, factor = np.sin(angle), np.cos(angle), 2 * math.tan(self.omega / 2)
        slope = sine * cosine * (1 + factor * factor / 4) / (cosine**2 + (factor * sine) ** 2)
        return ((slope - self._radius(angle)[0]) / self.omega)[:, None]


@dataclass(frozen=True)
class Division(RadialLens):
    """Fitzgibbon's division model: the direction of image point ``(x, y)`` with radius r is ``(x, y, 1 + k r^2)``."""

    k: float
    """Negative for barrel distortion, with angles beyond 90 degrees."""

    @property
    def is_pinhole(self) -> bool:
        """Whether k is 0."""
        return self.k == 0

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        sine, cosine = np.sin(angle), np.cos(angle)
        root = np.sqrt(cosine * cosine - 4 * self.k * sine * sine)
        denominator = cosine + root
        denominator_slope = -sine - (1 + 4 * self.k) * sine * cosine / root
        return 2 * sine / denominator, 2 * (cosine * denominator - sine * denominator_slope) / denominator**2

    def _radius_slopes(self, angle: Floats) -> Floats:
        sine, cosine = np.sin(angle), np.cos(angle)
        root = np.sqrt(cosine * cosine - 4 * self.k * sine * sine)
        return (4 * sine**3 / ((cosine + root) ** 2 * root))[:, None]


def _check_alpha(alpha: float) -> None:
    if not 0 <= alpha <= 1:
        raise CameraError(f"alpha of a lens must be from 0 to 1, got {alpha!r}")
