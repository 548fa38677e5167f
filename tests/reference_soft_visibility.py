# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Float64 twins of `warpvis.kernels.gradients.silhouette_masks` and `coverage`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from reference_gradients import rotation_matrix

SLOPE_TOLERANCE, DEPTH_TOLERANCE = 1e-3, 1e-5


def mark_silhouettes(camera, row, images) -> NDArray[np.bool_]:
    """Return the mask of pixels beside silhouettes of a view, by comparing the image with shifted copies."""
    depth, normals = images["depth"].astype(np.float64), images["normals"] @ rotation_matrix(row[3:])
    rays = np.asarray(camera.rays)
    origins = np.zeros(rays.shape) if camera.origins is None else np.asarray(camera.origins)
    height, width = depth.shape
    mask = np.zeros(depth.shape, dtype=bool)
    with np.errstate(invalid="ignore", divide="ignore"):
        points = origins + depth[..., None] * rays
        for dy, dx in ((0, 1), (1, -1), (1, 0), (1, 1)):
            a = np.s_[: height - dy, max(-dx, 0) : width - max(dx, 0)]
            b = np.s_[dy:, max(dx, 0) : width + min(dx, 0)]
            there = ((points[a] - origins[b]) * normals[a]).sum(axis=-1) / (rays[b] * normals[a]).sum(axis=-1)
            here = ((points[b] - origins[a]) * normals[b]).sum(axis=-1) / (rays[a] * normals[b]).sum(axis=-1)
            bound = (np.abs(there - depth[a]) + np.abs(here - depth[b])) * (1 + SLOPE_TOLERANCE)
            connected = np.abs(depth[b] - depth[a]) <= bound + DEPTH_TOLERANCE * depth[a]
            connected &= (there > 0) & (here > 0) & (images["segmentation"][a] == images["segmentation"][b])
            connected |= ~np.isfinite(depth[a]) & ~np.isfinite(depth[b])
            mask[a] |= ~connected
            mask[b] |= ~connected
    return mask
