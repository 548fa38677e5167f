# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Panoramic projections: equirectangular and cylindrical."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from warpvis.cameras.lenses._lens import Floats, Lens, check_fields


@dataclass(frozen=True)
class Equirectangular(Lens):
    """The whole sphere: columns are longitudes ``2 pi (x / width - 1/2)``, rows latitudes ``pi (1/2 - y / height)``.

    The center of the image points forward, its top row up (-y of the camera). The left and right borders are the same
    meridian; directions exactly backward are projected to the right border.
    """

    width: float
    """Image width, 360 degrees [px]."""
    height: float
    """Image height, 180 degrees [px]."""

    def __post_init__(self) -> None:
        check_fields(self, positive=("width", "height"))

    @property
    def max_angle(self) -> float:
        """Pi: all directions."""
        return math.pi

    @property
    def turns_back(self) -> bool:
        """Always False."""
        return False

    def _project(self, points: Floats) -> Floats:
        x, y, z = points.T
        longitude, down = np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))
        is_zero = ~(np.abs(points).sum(axis=1) > 0)
        column = (longitude / (2 * math.pi) + 0.5) * self.width
        row = (down / math.pi + 0.5) * self.height
        return np.where(is_zero[:, None], np.nan, np.stack([column, row], axis=-1))

    def _unproject(self, pixels: Floats) -> Floats:
        x, y = pixels.T
        inside = (x >= 0) & (x <= self.width) & (y >= 0) & (y <= self.height)
        longitude = np.where(inside, 2 * math.pi * (x / self.width - 0.5), np.nan)
        return np.stack(directions_on_sphere(longitude, math.pi * (y / self.height - 0.5)), axis=-1)

    def _direction_jacobian(self, pixels: Floats, directions: Floats) -> Floats:
        x, y = pixels.T
        azimuth, down = 2 * math.pi * (x / self.width - 0.5), math.pi * (y / self.height - 0.5)
        slopes = np.zeros((len(x), 2, 2))
        slopes[:, 0, 0], slopes[:, 1, 1] = -2 * math.pi * x / self.width**2, -math.pi * y / self.height**2
        return jacobian_on_sphere(azimuth, down) @ slopes


def jacobian_on_sphere(azimuth: Floats, down: Floats) -> Floats:
    """Return derivatives of `directions_on_sphere` with respect to both angles, shape ``(..., 3, 2)``."""
    sin_azimuth, cos_azimuth, sin_down, cos_down = np.sin(azimuth), np.cos(azimuth), np.sin(down), np.cos(down)
    right = [cos_down * cos_azimuth, np.zeros_like(cos_down * azimuth), -cos_down * sin_azimuth]
    below = [-sin_down * sin_azimuth, cos_down + 0 * azimuth, -sin_down * cos_azimuth]
    return np.stack([np.stack(right, axis=-1), np.stack(below, axis=-1)], axis=-1)


def directions_on_sphere(azimuth: Floats, down: Floats) -> tuple[Floats, Floats, Floats]:
    """Return unit vectors by their angles to the right of the axis, and below the horizon [rad]."""
    across = np.cos(down)
    return across * np.sin(azimuth), np.sin(down), across * np.cos(azimuth)


@dataclass(frozen=True)
class Cylindrical(Lens):
    """A cylinder about the camera's y axis: columns are azimuths, rows are heights.

    ``x = fx atan2(X, Z) + cx``, ``y = fy Y / sqrt(X^2 + Z^2) + cy``. Lines parallel to y stay straight.
    """

    fx: float
    """Pixels per radian."""
    fy: float
    """Pixels per radius of the cylinder."""
    cx: float
    """Column of the forward direction, from the left edge of the image [px]."""
    cy: float
    """Row of the horizon, from the top edge of the image [px]."""

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def max_angle(self) -> float:
        """Angle between the forward direction and the axis of the cylinder: pi / 2."""
        return math.pi / 2

    @property
    def turns_back(self) -> bool:
        """Always False: only the directions of the cylinder's axis have no image."""
        return False

    def _project(self, points: Floats) -> Floats:
        x, y, z = points.T
        axis_distance = np.hypot(x, z)
        azimuth = np.where(axis_distance > 0, np.arctan2(x, z), np.nan)
        return np.stack([self.fx * azimuth + self.cx, self.fy * y / axis_distance + self.cy], axis=-1)

    def _unproject(self, pixels: Floats) -> Floats:
        azimuth, height = (pixels[:, 0] - self.cx) / self.fx, (pixels[:, 1] - self.cy) / self.fy
        azimuth = np.where(np.abs(azimuth) <= math.pi, azimuth, np.nan)
        axis_distance = 1 / np.sqrt(1 + height * height)
        return np.stack(
            [axis_distance * np.sin(azimuth), axis_distance * height, axis_distance * np.cos(azimuth)], axis=-1
        )

    def _direction_jacobian(self, pixels: Floats, directions: Floats) -> Floats:
        azimuth, height = (pixels[:, 0] - self.cx) / self.fx, (pixels[:, 1] - self.cy) / self.fy
        slopes = np.zeros((len(pixels), 2, 4))
        slopes[:, 0, 0], slopes[:, 0, 2] = -azimuth / self.fx, -1 / self.fx
        slopes[:, 1, 1], slopes[:, 1, 3] = -height / self.fy, -1 / self.fy
        slopes[:, 1] /= (1 + height * height)[:, None]
        return jacobian_on_sphere(azimuth, np.arctan(height)) @ slopes
