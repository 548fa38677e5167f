# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fisheye lenses: polynomials of the angle from the axis.

Sources: https://docs.opencv.org/4.x/db/d58/group__calib3d__fisheye.html, COLMAP's ``src/colmap/sensor/models.h``
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from warpvis.cameras.lenses._bent import Bent, BentLens
from warpvis.cameras.lenses._lens import RadialLens, check_fields
from warpvis.cameras.lenses._pinhole import decentered, scaled
from warpvis.cameras.lenses._rising import Floats


def _gain(square: Floats, coefficients: Sequence[float]) -> tuple[Floats, Floats]:
    """Return ``1 + k1 s + k2 s^2 + ...`` and its derivative with respect to s."""
    polynomial = np.polynomial.Polynomial([1.0, *coefficients])
    return polynomial(square), polynomial.deriv()(square)


def _angle_radius(angle: Floats, coefficients: Sequence[float]) -> tuple[Floats, Floats]:
    gain, slope = _gain(angle * angle, coefficients)
    return angle * gain, gain + 2 * angle * angle * slope


@dataclass(frozen=True)
class KannalaBrandt(RadialLens):
    """OpenCV's fisheye, called equidistant in ROS and Kalibr: ``r = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8)``.

    t is the angle from the axis, up to pi. With zero coefficients, it is the equidistant fisheye.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    coefficients: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    """``k1 k2 k3 k4``."""

    def __post_init__(self) -> None:
        check_fields(self, (4,))

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        return _angle_radius(angle, self.coefficients)


@dataclass(frozen=True)
class ThinPrismFisheye(BentLens):
    """COLMAP's THIN_PRISM_FISHEYE: OpenCV's distortion applied to the angle, with a fourth radial coefficient."""

    fx: float
    fy: float
    cx: float
    cy: float
    coefficients: tuple[float, ...] = (0.0,) * 8
    """``k1 k2 p1 p2 k3 k4 sx1 sy1``."""

    _is_flat: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_fields(self, (8,))

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
        radial = scaled(x, y, *_gain(x * x + y * y, self._radial))
        added = decentered(x, y, (p1, p2), (sx1, 0.0, sy1, 0.0))
        return Bent(*(a + b for a, b in zip(radial, added, strict=True)))


@dataclass(frozen=True)
class RadTanThinPrismFisheye(BentLens):
    """COLMAP's RAD_TAN_THIN_PRISM_FISHEYE, called fisheye624 in Project Aria.

    A polynomial scales the angle first; the tangential and thin-prism terms are functions of the resulting point.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    coefficients: tuple[float, ...] = (0.0,) * 12
    """``k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3``."""

    _is_flat: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_fields(self, (12,))

    @property
    def is_radial(self) -> bool:
        """Whether all but the radial coefficients are 0."""
        return not any(self.coefficients[6:])

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        return _angle_radius(angle, self.coefficients[:6])

    def _bend(self, x: Floats, y: Floats) -> Bent:
        p0, p1, *prism = self.coefficients[6:]
        radial = scaled(x, y, *_gain(x * x + y * y, self.coefficients[:6]))
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
