# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of sight through an occupancy map in double precision: all voxels of a line at once."""

import numpy as np
from numpy.typing import NDArray
from reference_occupancy import NOT_MEASURED, DenseMap

from warpvis import Visibility


def _cells(dense: DenseMap, eye: NDArray, direction: NDArray, first: float, last: float) -> tuple[NDArray, NDArray]:
    """Return where a line passes from voxel to voxel, and their values."""
    crossings = [first, last]
    for axis in range(3):
        if direction[axis] != 0:
            faces = (dense.first[axis] + np.arange(dense.size[axis] + 1)) * dense.cell
            crossings.extend((faces - eye[axis]) / direction[axis])
    t = np.unique(np.clip(crossings, first, last))
    middles = eye + direction * ((t[:-1] + t[1:]) / 2)[:, None]
    voxels = np.floor(middles / dense.cell).astype(int) - dense.first
    inside = ((voxels >= 0) & (voxels < dense.size)).all(axis=1)
    values = np.full(len(voxels), NOT_MEASURED)
    values[inside] = dense.values[tuple(voxels[inside].T)]
    return t, values


def trace_line(
    dense: DenseMap, eye: NDArray, target: NDArray, clearance: float, margin: float
) -> tuple[float, float, float]:
    """Return the distance of the first surface, and the length of unknown space before it, also as a share."""
    length = np.linalg.norm(target - eye)
    first, last = clearance, length - margin
    if not last > first:
        return np.inf, 0.0, 0.0
    t, values = _cells(dense, eye, (target - eye) / length, first, last)
    solid = np.flatnonzero(values >= 0)
    others = np.flatnonzero(values < 0)
    blocked = len(solid) > 0 and len(others) > 0 and others[-1] > solid[0]
    seen = slice(0, solid[0]) if blocked else slice(None)
    lengths = np.diff(t)[seen]
    unknown = lengths[values[seen] <= NOT_MEASURED].sum()
    return (t[solid[0]] if blocked else np.inf), unknown, unknown / (last - first)


def judge_lines(
    dense: DenseMap, eye: NDArray, points: NDArray, clearance: float, margin: float, max_unknown: float
) -> tuple[NDArray, NDArray]:
    """Return the status of points that are in view, and the unknown share of their lines of sight."""
    lines = [trace_line(dense, eye, point, clearance, margin) for point in points.astype(np.float64)]
    surface, unknown, share = np.array(lines).T
    status = np.where(unknown > max_unknown, Visibility.UNKNOWN, Visibility.VISIBLE)
    return np.where(np.isfinite(surface), Visibility.OCCLUDED, status), share


def render_map(dense: DenseMap, eye: NDArray, rays: NDArray, near: float, far: float) -> NDArray:
    """Return the depth of the first surface along rays of depth 1: NaN behind unknown space, inf without a surface.

    It is in the middle of the first run of surface voxels, at most 1.5 voxels behind its beginning.
    """
    depths = []
    for ray in rays.reshape(-1, 3):
        length = np.linalg.norm(ray)
        t, values = _cells(dense, eye, ray / length, near * length, far * length)
        unknown, solid = (np.flatnonzero(mask) for mask in (values <= NOT_MEASURED, values >= 0))
        if not len(solid) or (len(unknown) and unknown[0] < solid[0]):
            depths.append(np.nan if len(unknown) else np.inf)
            continue
        after = np.flatnonzero(values[solid[0] :] < 0)
        end = t[solid[0] + after[0]] if len(after) else t[-1]
        depths.append((t[solid[0]] + min((end - t[solid[0]]) / 2, 1.5 * dense.cell)) / length)
    return np.array(depths).reshape(rays.shape[:-1])


# Pixels are hidden like points.
hide_pixels = judge_lines


def judge_unknown(image: NDArray, visible: NDArray, unknown: NDArray, status: NDArray) -> NDArray:
    """Return the status of objects: UNKNOWN if that is the reason for most of their hidden pixels."""
    most = (status == Visibility.OCCLUDED) & (2 * unknown > image - visible)
    return np.where(most, Visibility.UNKNOWN, status)
