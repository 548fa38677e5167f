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
from warpvis.errors import ArrayError

if TYPE_CHECKING:
    from warpvis.kernels.sensors.lidar_noise import Glare

_REACH = 3.0  # standard deviations beyond which the glare of a surface is ignored
_MAX_NEIGHBORS = 1 << 28  # of all rays: they take 8 bytes each, and 70 while they are searched


def prepare_glare(rays: Rays, share: float, sigma: float, device: wp.Device) -> Glare:
    """Return the neighbors of all rays; `share` and `sigma` [rad] are `LidarNoise.glare` and `glare_angle`.

    Raises:
        FileFormatError: If SciPy is missing.
        ArrayError: If rays have too many neighbors.
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

    Raises:
        ArrayError: If there are more than `_MAX_NEIGHBORS`.
    """
    spatial = require_package("scipy.spatial", "glare needs SciPy", "lidar")
    given = np.flatnonzero(np.isfinite(directions).all(axis=1))
    units = directions[given] / np.linalg.norm(directions[given], axis=1, keepdims=True)
    tree, chord = spatial.cKDTree(units), 2.0 * np.sin(0.5 * min(reach, np.pi))
    number = tree.count_neighbors(tree, chord) - len(units)
    if number > _MAX_NEIGHBORS:
        raise ArrayError(
            f"glare_angle must be smaller for {len(units)} rays: they must have at most {_MAX_NEIGHBORS} neighbors "
            f"within {reach:g} rad, got {number}"
        )
    pairs = tree.query_pairs(chord, output_type="ndarray")
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
