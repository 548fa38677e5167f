# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""OpenCV's pinhole camera with radial, tangential and thin-prism distortion, and a tilted sensor.

Source: https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from warpvis.cameras.lenses._bent import Bent, BentLens
from warpvis.cameras.lenses._lens import Floats

COUNTS = (4, 5, 8, 12, 14)
"""Valid numbers of coefficients of OpenCV's pinhole camera."""


@dataclass(frozen=True, eq=False)
class OpenCVPinhole(BentLens):
    """A pinhole camera with OpenCV's distortion, including ROS's ``plumb_bob`` (5) and ``rational_polynomial`` (8).

    With ``x = X / Z``, ``y = Y / Z`` and ``r2 = x^2 + y^2``::

        g  = (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3)
        x' = x g + 2 p1 x y + p2 (r2 + 2 x^2) + s1 r2 + s2 r2^2
        y' = y g + p1 (r2 + 2 y^2) + 2 p2 x y + s3 r2 + s4 r2^2

    Then the sensor is tilted by ``tx`` about x and ``ty`` about y [rad]; the pixel is ``(fx x' + cx, fy y' + cy)``.
    The principal point is half a pixel greater than OpenCV's. Missing coefficients are 0; lenses are equal if their
    intrinsics and all 14 coefficients are equal.
    """

    coefficients: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    """``k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty``: the first 4, 5, 8, 12, or all 14."""

    _limit: ClassVar[float] = math.pi / 2
    _counts: ClassVar[tuple[int, ...]] = COUNTS
    _coefficient_names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty")

    @cached_property
    def all_coefficients(self) -> tuple[float, ...]:
        """All 14 coefficients; missing ones are 0."""
        return self.coefficients + (0.0,) * (14 - len(self.coefficients))

    @property
    def _numbers(self) -> tuple[float, ...]:
        return (self.fx, self.fy, self.cx, self.cy, *self.all_coefficients)

    def __eq__(self, other: object) -> bool:
        return self._numbers == other._numbers if isinstance(other, OpenCVPinhole) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._numbers)

    @property
    def is_pinhole(self) -> bool:
        """Whether all coefficients are 0."""
        return not any(self.coefficients)

    @property
    def is_radial(self) -> bool:
        """Whether tangential and thin-prism coefficients are 0, and the sensor is not tilted."""
        c = self.all_coefficients
        return not any(c[2:4]) and not any(c[8:])

    def _gain(self, r2: Floats) -> tuple[Floats, Floats]:
        """Return the factor of the radius, and its derivative with respect to the squared radius."""
        k1, k2, _, _, k3, k4, k5, k6, *_ = self.all_coefficients
        numerator, denominator = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        numerator_slope, denominator_slope = k1 + r2 * (2 * k2 + r2 * 3 * k3), k4 + r2 * (2 * k5 + r2 * 3 * k6)
        return numerator / denominator, (numerator_slope * denominator - numerator * denominator_slope) / denominator**2

    def _radius(self, angle: Floats) -> tuple[Floats, Floats]:
        r = np.tan(angle)
        gain, slope = self._gain(r * r)
        return r * gain, (gain + 2 * r * r * slope) * (1 + r * r)

    def _bend(self, x: Floats, y: Floats) -> Bent:
        *_, tilt_x, tilt_y = c = self.all_coefficients
        r2 = x * x + y * y
        gain, slope = self._gain(r2)
        bent = decentered(x, y, c[2:4], c[8:12])
        bent = Bent(*(a + b for a, b in zip(bent, scaled(x, y, gain, slope), strict=True)))
        return _tilted(bent, self._tilt) if tilt_x or tilt_y else bent

    def _bend_slopes(self, x: Floats, y: Floats) -> Floats:
        *_, tilt_x, tilt_y = c = self.all_coefficients
        r2 = x * x + y * y
        denominator = 1 + r2 * (c[5] + r2 * (c[6] + r2 * c[7]))
        point, gain = np.stack([x, y], axis=1)[:, :, None], self._gain(r2)[0]
        powers = np.stack([r2, r2**2, r2**3], axis=1) / denominator[:, None]
        numerator, shifts = point * powers[:, None], decentered_slopes(x, y)
        parts = [numerator[:, :, :2], shifts[:, :, :2], numerator[:, :, 2:], -gain[:, None, None] * numerator]
        slopes = np.concatenate([*parts, shifts[:, :, 2:], np.zeros((len(x), 2, 2))], axis=2)
        if len(self.coefficients) == 14:
            flat = decentered(x, y, c[2:4], c[8:12])
            flat = Bent(flat.x + x * gain, flat.y + y * gain, *np.broadcast_arrays(1.0, 0.0, 0.0, 1.0, x)[:4])
            tilted = _tilted(flat, self._tilt)
            jacobian = np.stack([tilted.xx, tilted.xy, tilted.yx, tilted.yy], axis=1).reshape(-1, 2, 2)
            slopes = jacobian @ slopes
            points = np.stack([flat.x, flat.y, np.ones_like(x)])
            scale = self._tilt[2] @ points
            for column, change in enumerate(_tilt_slopes(tilt_x, tilt_y), start=12):
                shift = change @ points
                slopes[:, 0, column] = (shift[0] - tilted.x * shift[2]) / scale
                slopes[:, 1, column] = (shift[1] - tilted.y * shift[2]) / scale
        return slopes[:, :, : len(self.coefficients)]

    @cached_property
    def _tilt(self) -> Floats:
        """The homography of a tilted sensor."""
        r = _rotation_y(self.all_coefficients[13]) @ _rotation_x(self.all_coefficients[12])
        return _along_axis(r) @ r


def decentered(x: Floats, y: Floats, tangential: tuple[float, ...], prism: tuple[float, ...]) -> Bent:
    """Return the offsets of points by ``p1 p2`` (tangential) and ``s1 s2 s3 s4`` (thin prism), and their Jacobian."""
    (p1, p2), (s1, s2, s3, s4) = tangential, prism
    r2 = x * x + y * y
    slope_x, slope_y = s1 + 2 * s2 * r2, s3 + 2 * s4 * r2
    mixed = 2 * p1 * x + 2 * p2 * y
    return Bent(
        2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + s2 * r2),
        p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + s4 * r2),
        2 * p1 * y + 6 * p2 * x + 2 * x * slope_x,
        mixed + 2 * y * slope_x,
        mixed + 2 * x * slope_y,
        6 * p1 * y + 2 * p2 * x + 2 * y * slope_y,
    )


def decentered_slopes(x: Floats, y: Floats) -> Floats:
    """Return derivatives of `decentered` with respect to ``p1 p2 s1 s2 s3 s4``, shape ``(n, 2, 6)``."""
    r2, zero = x * x + y * y, np.zeros_like(x)
    first = np.stack([2 * x * y, r2 + 2 * x * x, r2, r2 * r2, zero, zero], axis=1)
    second = np.stack([r2 + 2 * y * y, 2 * x * y, zero, zero, r2, r2 * r2], axis=1)
    return np.stack([first, second], axis=1)


def scaled(x: Floats, y: Floats, gain: Floats, slope: Floats) -> Bent:
    """Scale points by a gain that is a function of the squared radius, with derivative `slope`."""
    mixed = 2 * x * y * slope
    return Bent(x * gain, y * gain, gain + 2 * x * x * slope, mixed, mixed, gain + 2 * y * y * slope)


def _tilted(bent: Bent, tilt: Floats) -> Bent:
    """Apply a homography to distorted points, and to their Jacobian."""
    (a, b, c), (d, e, f), (g, h, i) = tilt
    denominator = g * bent.x + h * bent.y + i
    x, y = (a * bent.x + b * bent.y + c) / denominator, (d * bent.x + e * bent.y + f) / denominator
    xx, xy, yx, yy = (
        (a - x * g) / denominator,
        (b - x * h) / denominator,
        (d - y * g) / denominator,
        (e - y * h) / denominator,
    )
    return Bent(
        x,
        y,
        xx * bent.xx + xy * bent.yx,
        xx * bent.xy + xy * bent.yy,
        yx * bent.xx + yy * bent.yx,
        yx * bent.xy + yy * bent.yy,
    )


def _rotation_x(angle: float) -> Floats:
    sine, cosine = math.sin(angle), math.cos(angle)
    return np.array([[1, 0, 0], [0, cosine, sine], [0, -sine, cosine]])


def _rotation_y(angle: float) -> Floats:
    sine, cosine = math.sin(angle), math.cos(angle)
    return np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])


def _along_axis(r: Floats, last: float = 1.0) -> Floats:
    """Return the matrix that projects points of a tilted plane along the axis; it is linear in `r` and `last`."""
    return np.array([[r[2, 2], 0, -r[0, 2]], [0, r[2, 2], -r[1, 2]], [0, 0, last]])


def _tilt_slopes(tilt_x: float, tilt_y: float) -> tuple[Floats, Floats]:
    """Return derivatives of the homography of a tilted sensor with respect to both angles [1/rad]."""
    about_x, about_y = _rotation_x(tilt_x), _rotation_y(tilt_y)
    # The derivative of a rotation is the rotation by 90 degrees more, without its axis.
    x_slope = _rotation_x(tilt_x + math.pi / 2) * [[0, 0, 0], [0, 1, 1], [0, 1, 1]]
    y_slope = _rotation_y(tilt_y + math.pi / 2) * [[1, 0, 1], [0, 0, 0], [1, 0, 1]]
    r = about_y @ about_x
    changes = about_y @ x_slope, y_slope @ about_x
    return tuple(_along_axis(dr, 0.0) @ r + _along_axis(r) @ dr for dr in changes)  # type: ignore[return-value]
