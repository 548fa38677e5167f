# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Order of single rays on a GPU: a warp casts rays of similar directions and origins, which visit the same nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.kernels.constants import CUDA_LANES
from warpvis.rendering.casters.ray_origins_cuda import group_rows
from warpvis.rendering.casters.sorted_rays_cpu import split_rays
from warpvis.rendering.casters.sorted_rays_cuda import cut_table, unroll_rows, z_buffer_order

# Bits of a position along each axis of a cube face.
_BITS = 12
# Side of squares of the table whose blocks of 8x4 rays are warps.
_SIDE = 16
# Typical distance of surfaces [m]: origins as far apart as directions at this distance count as much.
_DISTANCE = 3.0


def sorted_order(rays: NDArray[np.float64], origins: NDArray[np.float64] | None) -> NDArray[np.int64]:
    """Return the indices of all rays of a table, shape (H, W, 3), in an order for single rays.

    The order is that of blocks of the table or that of a curve through all directions, whichever has closer rays in a
    warp.
    """
    flat = rays.reshape(-1, 3)
    index = unroll_rows(np.arange(len(flat)).reshape(rays.shape[:2]), np.nan_to_num(flat))
    features = flat / np.linalg.norm(flat, axis=-1, keepdims=True)
    if origins is not None:
        index = group_rows(index, np.nan_to_num(flat), origins.reshape(-1, 3), _SIDE)
        features = np.concatenate([features, origins.reshape(-1, 3) / _DISTANCE], axis=1)
    blocks = cut_table(index, _SIDE)[:, z_buffer_order(_SIDE)].ravel()
    orders = blocks[blocks >= 0], curve_order(flat)
    return min(orders, key=lambda order: _spread(np.nan_to_num(features[order])))


def _spread(features: NDArray[np.float64]) -> float:
    """Return the mean distance of a warp's rays from their center."""
    groups = features[: len(features) // CUDA_LANES * CUDA_LANES].reshape(-1, CUDA_LANES, features.shape[1])
    return float(np.sqrt(groups.var(axis=1).sum(axis=-1)).mean()) if len(groups) else 0.0


def curve_order(rays: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the order of rays, shape (N, 3), along a Z-order curve on the faces of a cube; NaN rays come first."""
    split = split_rays(rays[None])
    with np.errstate(invalid="ignore"):
        low = np.nanmin(split.positions, axis=0, initial=np.inf)
        high = np.nanmax(split.positions, axis=0, initial=-np.inf)
        cells = (split.positions - low) * ((2**_BITS - 1) / max(float((high - low).max()), 1e-12))
        cells = np.where(np.isfinite(cells), cells, 0.0).astype(np.int64)
    code = split.face.ravel().astype(np.int64) << (2 * _BITS)
    for bit in range(_BITS):
        code |= (cells[:, 0] >> bit & 1) << (2 * bit) | (cells[:, 1] >> bit & 1) << (2 * bit + 1)
    return np.argsort(code, kind="stable")
