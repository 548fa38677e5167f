# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of the kernels of `warpvis.kernels.sensors.echoes`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices


def measure_incidence(poses: NDArray, directions: NDArray, normals: NDArray) -> NDArray[np.float64]:
    """Return cosines between rays (H, W, 3) in the frame of each pose and normals (V, H, W, 3)."""
    rotations = poses_to_matrices(poses)[:, :3, :3]
    along = np.einsum("vij,yxj->vyxi", rotations, directions)
    return np.abs((along * normals).sum(axis=-1))


def reflect_rays(
    depth: NDArray, incidence: NDArray, segmentation: NDArray, reflectivity: NDArray, *, falls_off: bool
) -> NDArray[np.float64]:
    """Return intensities of rays, in the shape of `depth`."""
    seen = (segmentation >= 0) & np.isfinite(depth)
    distance = np.where(seen, depth, 1.0).astype(np.float64)
    found = np.asarray(reflectivity, dtype=np.float64)[segmentation] * incidence
    return np.where(seen, found / distance**2 if falls_off else found, 0.0)


def gather_returns(
    depth: NDArray, intensity: NDArray, count: int, separation: float, min_intensity: float, *, keeps_last: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return ranges and intensities of two returns of each beam, shape (V, 2, H, W), by sorting."""
    views, height, width = depth.shape
    beams = depth.astype(np.float64).reshape(views, height, width // count, count)
    strengths = intensity.astype(np.float64).reshape(beams.shape)
    ranges = np.empty((views, 2, height, width // count))
    intensities = np.empty_like(ranges)
    for view, y, x in np.ndindex(beams.shape[:3]):
        found = _returns_of(beams[view, y, x], strengths[view, y, x], separation, min_intensity)
        nothing = (-np.inf if (beams[view, y, x] == -np.inf).all() else np.inf, 0.0)
        strongest = max(found, key=lambda back: back[1], default=nothing)
        others = [back for back in found if back is not strongest]
        second = max(others, key=lambda back: back[1], default=nothing)
        if found and found[-1] is not strongest:
            second = found[-1]
        if keeps_last:
            strongest = found[-1] if found else nothing
        for place, (distance, strength) in enumerate((strongest, second)):
            ranges[view, place, y, x], intensities[view, place, y, x] = distance, strength
    return ranges, intensities


def _returns_of(beam: NDArray, strength: NDArray, separation: float, min_intensity: float) -> list[tuple[float, float]]:
    """Return range and intensity of the returns of one beam, nearest first."""
    order = np.argsort(beam, kind="stable")
    order = order[np.isfinite(beam[order])]
    if not len(order):
        return []
    groups = np.split(order, np.flatnonzero(np.diff(beam[order]) > separation) + 1)
    found = []
    for group in groups:
        total = strength[group].sum()
        if total / len(beam) >= min_intensity and total > 0:
            found.append((float((beam[group] * strength[group]).sum() / total), float(total / len(beam))))
    return found
