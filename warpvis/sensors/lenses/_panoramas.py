# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images all around: a sphere's longitudes and latitudes, and a cylinder."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from warpvis.sensors.lenses._lens import Lens, check_fields
from warpvis.sensors.lenses._rising import Floats


@dataclass(frozen=True)
class Equirectangular(Lens):
    """The whole sphere: columns are longitudes, rows latitudes: ``2 pi (x / width - 1/2)``, ``pi (1/2 - y / height)``.

    The image's middle is straight ahead, its top row up (the camera's -y). Of the two borders, which are one meridian,
    what lies straight behind is at the right.
    """

    width: float
    """What 360 degrees are [px]: the image's width."""
    height: float
    """What 180 degrees are [px]: the image's height."""

    def __post_init__(self) -> None:
        check_fields(self, positive=("width", "height"))

    @property
    def max_angle(self) -> float:
        """All of them: pi."""
        return math.pi

    @property
    def turns_back(self) -> bool:
        """Never."""
        return False

    def _project(self, points: Floats) -> Floats:
        x, y, z = points.T
        longitude, down = np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))
        nowhere = ~(np.abs(points).sum(axis=1) > 0)
        column = (longitude / (2 * math.pi) + 0.5) * self.width
        row = (down / math.pi + 0.5) * self.height
        return np.where(nowhere[:, None], np.nan, np.stack([column, row], axis=-1))

    def _unproject(self, pixels: Floats) -> Floats:
        x, y = pixels.T
        inside = (x >= 0) & (x <= self.width) & (y >= 0) & (y <= self.height)
        longitude = np.where(inside, 2 * math.pi * (x / self.width - 0.5), np.nan)
        down = math.pi * (y / self.height - 0.5)
        across = np.cos(down)
        return np.stack([across * np.sin(longitude), np.sin(down), across * np.cos(longitude)], axis=-1)


@dataclass(frozen=True)
class Cylindrical(Lens):
    """A cylinder around the camera's y axis: columns are angles around it, rows are heights on it.

    ``x = fx atan2(X, Z) + cx``, ``y = fy Y / sqrt(X^2 + Z^2) + cy``: upright lines stay straight.
    """

    fx: float
    """Pixels a radian."""
    fy: float
    """Pixels a radius of the cylinder."""
    cx: float
    """Where straight ahead is, from the image's left edge [px]."""
    cy: float
    """Where the horizon is, from the image's top edge [px]."""

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def max_angle(self) -> float:
        """Up to the cylinder's axis: pi / 2."""
        return math.pi / 2

    @property
    def turns_back(self) -> bool:
        """Never: it sees all around, but for what is straight above and below."""
        return False

    def _project(self, points: Floats) -> Floats:
        x, y, z = points.T
        away = np.hypot(x, z)
        azimuth = np.where(away > 0, np.arctan2(x, z), np.nan)
        return np.stack([self.fx * azimuth + self.cx, self.fy * y / away + self.cy], axis=-1)

    def _unproject(self, pixels: Floats) -> Floats:
        azimuth, height = (pixels[:, 0] - self.cx) / self.fx, (pixels[:, 1] - self.cy) / self.fy
        azimuth = np.where(np.abs(azimuth) <= math.pi, azimuth, np.nan)
        away = 1 / np.sqrt(1 + height * height)
        return np.stack([away * np.sin(azimuth), away * height, away * np.cos(azimuth)], axis=-1)
