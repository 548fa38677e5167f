# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of the kernels of `warpvis.kernels.sensors.learned`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis import Camera
from warpvis.core.poses import poses_to_matrices
from warpvis.sensors import Reason


def rotate_to_cameras(poses: NDArray, normals: NDArray) -> NDArray[np.float64]:
    """Return world-frame normals (V, H, W, 3) in the frames of cameras; 0 instead of NaN."""
    rotations = poses_to_matrices(poses)[:, :3, :3].astype(np.float64)
    return np.nan_to_num(np.einsum("vji,vyxj->vyxi", rotations, normals.astype(np.float64)), nan=0.0)


def report_learned_depth(
    camera: Camera, learned: NDArray, true_depth: NDArray, measured: tuple[NDArray, NDArray] | None = None
) -> tuple[NDArray, NDArray]:
    """Return depth and reasons; `measured` are those of a sensor below, whose holes lost pixels keep."""
    lost = np.isnan(learned) | ((learned <= 0) & (learned > -np.inf))
    depth = np.where(lost, true_depth, learned).astype(np.float64)
    empty = (depth == np.inf) & (true_depth == np.inf)
    near, far = depth < camera.near, (depth > camera.far) | (depth == np.inf)
    cases = [empty, near, far, lost]
    reasons = np.select(cases, [Reason.EMPTY, Reason.RANGE, Reason.RANGE, Reason.DROPOUT], Reason.VALID)
    depth = np.select(cases, [np.inf, -np.inf, np.inf, np.nan], depth)
    if measured is None:
        return depth, reasons
    keeps = lost & ~np.isfinite(measured[0])
    return np.where(keeps, measured[0], depth), np.where(keeps, measured[1], reasons)
