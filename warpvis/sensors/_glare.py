# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Glare of a lidar: which rays receive light of the surfaces of others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.rays import Rays
from warpvis.core.file_content import require_package

if TYPE_CHECKING:
    from warpvis.kernels.sensors.lidar_noise import Glare

_REACH = 3.0  # standard deviations beyond which the glare of a surface is ignored


def prepare_glare(rays: Rays, share: float, sigma: float, device: wp.Device) -> Glare:
    """Return the neighbors of all rays; `share` and `sigma` [rad] are `LidarNoise.glare` and `glare_angle`.

    Raises:
        FileFormatError: If SciPy is missing.
    """
    from warpvis.kernels.sensors.lidar_noise import Glare

    def make() -> tuple[wp.array, ...]:
        firsts, neighbors, angles = find_neighbors(rays.directions.reshape(-1, 3), _REACH * sigma)
        return tuple(wp.array(part, device=device) for part in (firsts, neighbors, angles))

    glare = Glare()
    glare.firsts, glare.neighbors, glare.angles = rays.prepared(("glare", sigma, device.alias), make)
    glare.share, glare.sigma = share, sigma
    return glare


def find_neighbors(directions: NDArray, reach: float) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray]:
    """Find the neighbors of each direction up to an angle.

    Args:
        directions: Directions of any length, shape ``(N, 3)``; NaN for none.
        reach: The angle [rad].

    Returns:
        The index of the first neighbor of each direction and the number of all neighbors, shape ``(N + 1,)``; the
        neighbors, shape ``(P,)``; and their angles [rad], float32, shape ``(P,)``.
    """
    spatial = require_package("scipy.spatial", "glare needs SciPy", "lidar")
    given = np.flatnonzero(np.isfinite(directions).all(axis=1))
    units = directions[given] / np.linalg.norm(directions[given], axis=1, keepdims=True)
    pairs = spatial.cKDTree(units).query_pairs(2.0 * np.sin(0.5 * min(reach, np.pi)), output_type="ndarray")
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.lexsort(both.T[::-1])]
    chords = np.linalg.norm(units[both[:, 0]] - units[both[:, 1]], axis=1)
    counts = np.bincount(given[both[:, 0]], minlength=len(directions))
    firsts = np.concatenate([[0], np.cumsum(counts)])
    return (
        firsts.astype(np.int32),
        given[both[:, 1]].astype(np.int32),
        (2.0 * np.arcsin(0.5 * chords)).astype(np.float32),
    )
