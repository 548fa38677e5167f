# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the rays of `warpvis.cameras.WideCamera`, by rotating one direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def wide_rays(width: int, height: int, hfov: float, projection: str) -> NDArray[np.float64]:
    """Return unit rays of all pixels, shape (H, W, 3), by rotating the axis (0, 0, 1) into each pixel's direction."""
    u = (np.arange(width) + 0.5) / width - 0.5
    v = (np.arange(height) + 0.5) / height - 0.5
    u, v = np.meshgrid(u, v)
    if projection == "spherical":
        away, roll = hfov * np.hypot(u, v), np.arctan2(v, u)
        return _about_z(roll) @ _about_y(away) @ np.array([0.0, 0.0, 1.0])
    return _about_y(u * hfov) @ _about_x(-v * hfov * height / width) @ np.array([0.0, 0.0, 1.0])


def _about_x(angle: NDArray) -> NDArray[np.float64]:
    one, none, c, s = np.ones_like(angle), np.zeros_like(angle), np.cos(angle), np.sin(angle)
    return _matrix([[one, none, none], [none, c, -s], [none, s, c]])


def _about_y(angle: NDArray) -> NDArray[np.float64]:
    one, none, c, s = np.ones_like(angle), np.zeros_like(angle), np.cos(angle), np.sin(angle)
    return _matrix([[c, none, s], [none, one, none], [-s, none, c]])


def _about_z(angle: NDArray) -> NDArray[np.float64]:
    one, none, c, s = np.ones_like(angle), np.zeros_like(angle), np.cos(angle), np.sin(angle)
    return _matrix([[c, -s, none], [s, c, none], [none, none, one]])


def _matrix(rows: list[list[NDArray]]) -> NDArray[np.float64]:
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
