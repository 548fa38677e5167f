# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Preparation of packets of rays with distinct origins for CPU cores.

Computed in double precision, once per ray table; used by ``kernels/native/cpu/ray_raster.h``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.kernels.constants import CPU_LANES, NOWHERE
from warpvis.rendering.casters.sorted_rays_cpu import PreparedRays, component, prepare_rays, to_row_order

if TYPE_CHECKING:
    from warpvis.kernels.casting.ray_bundle_packets import RayOrigins

_ROUNDED = 1e-6  # relative rounding error bound of single precision
_GROUP = CPU_LANES * CPU_LANES


@dataclass(frozen=True)
class PreparedRayOrigins:
    """Rays of a table with distinct origins, prepared for packets."""

    rays: PreparedRays
    struct: RayOrigins
    max_origin_z: NDArray[np.float64]
    """Greatest z of a ray origin in each bundle [m]."""
    packet_spread: float
    """Mean over all packets of how far the origins of a packet's rays are from their middle [m]."""


def prepare_ray_origins(rays: NDArray[np.float64], origins: NDArray[np.float64]) -> PreparedRayOrigins:
    """Prepare rays of the camera frame, shape (H, W, 3), as `prepare_rays` does, and their origins, shape (H, W, 3)."""
    from warpvis.kernels.casting.ray_bundle_packets import RayOrigins

    prepared = prepare_rays(rays)
    bundle_arrays, ray_origins = prepared.struct, origins.reshape(-1, 3)
    pixel = bundle_arrays.place.numpy()
    positions = [
        getattr(bundle_arrays, n).numpy().astype(np.float64) + getattr(bundle_arrays, f"rest_{n}").numpy()
        for n in ("u", "v")
    ]
    offsets, origin_z = np.zeros((2, len(pixel))), np.zeros(len(pixel))
    bundles = bundle_arrays.bundle.numpy()
    eyes, max_offset = np.zeros((len(bundles), 3)), np.zeros((len(bundles), 3))
    max_origin_z = np.zeros(len(bundles))
    for number, (group, num_groups, *axes) in enumerate(bundles[:, :5].tolist()):
        group_slots = np.arange(group, group + num_groups)[:, None] * _GROUP * CPU_LANES + np.arange(_GROUP * CPU_LANES)
        slots = group_slots.ravel()[pixel[group_slots.ravel()] >= 0]
        local = np.stack([component(ray_origins[pixel[slots]], axis) for axis in axes])
        eyes[number, 2] = local[2].min()
        origin_z[slots] = np.abs(local[2] - eyes[number, 2])  # not -0, whose inverse is negative
        for k in range(2):
            crossing = local[k] - positions[k][slots] / bundle_arrays.focal * origin_z[slots]
            eyes[number, k] = (crossing.min() + crossing.max()) / 2
            offsets[k, slots] = (crossing - eyes[number, k]) * bundle_arrays.focal
            max_offset[number, k] = np.abs(offsets[k, slots]).max()
        max_offset[number, 2] = np.linalg.norm(local.T - eyes[number], axis=1).max()
        max_origin_z[number] = origin_z[slots].max()
    struct = RayOrigins()
    rounded = offsets.astype(np.float32)
    tiles = rounded.reshape(2, -1, CPU_LANES, CPU_LANES)
    row_p, row_q = to_row_order(tiles, _columns(bundle_arrays))
    with np.errstate(divide="ignore", over="ignore"):
        max_inv_z = np.minimum(1 / origin_z, NOWHERE)
    arrays = {
        "p": rounded[0],
        "q": rounded[1],
        "begin": origin_z.astype(np.float32),
        "clip_inv_z": max_inv_z.astype(np.float32),
        "row_p": row_p,
        "row_q": row_q,
        "range": _ranges(positions, offsets, pixel >= 0),
        "maxima": (max_offset * (1 + _ROUNDED)).astype(np.float32),
    }
    for name, array in arrays.items():
        setattr(struct, name, wp.array(array, dtype=wp.float32, device="cpu"))
    struct.eye = wp.array(eyes, dtype=wp.float64, device="cpu")
    spread = _spread(offsets / bundle_arrays.focal, pixel >= 0)
    return PreparedRayOrigins(prepared, struct, max_origin_z, spread)


def _spread(offsets: NDArray, has_ray: NDArray[np.bool_]) -> float:
    """Return the mean over all packets of half the greater extent of the offsets of a packet's rays, shape (2, N)."""
    has_ray = has_ray.reshape(-1, CPU_LANES)
    values, nonempty = offsets.reshape(2, -1, CPU_LANES), has_ray.any(axis=-1)
    extent = np.where(has_ray, values, -np.inf).max(axis=-1) - np.where(has_ray, values, np.inf).min(axis=-1)
    return float(extent[:, nonempty].max(axis=0).mean() / 2) if nonempty.any() else 0.0


def _columns(bundle_arrays: object) -> NDArray[np.int64]:
    """Return the number of columns of each tile's packets; 0 for tiles without a fit."""
    fit = bundle_arrays.fit.numpy()  # type: ignore[attr-defined]
    return np.where(fit[:, 9] > 0, 2 ** fit[:, 8].astype(np.int64), 0)


def _ranges(positions: list[NDArray], offsets: NDArray, has_ray: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return each tile's ranges of p, q and u q - v p: three centers, then three half widths, as in ``RayOrigins``."""
    (u, v), (p, q) = positions, offsets
    values = np.stack([p, q, u * q - v * p]).reshape(3, -1, _GROUP)
    has_ray = has_ray.reshape(-1, _GROUP)
    nonempty = has_ray.any(axis=-1)
    low = np.where(nonempty, np.where(has_ray, values, np.inf).min(axis=-1), 0)
    high = np.where(nonempty, np.where(has_ray, values, -np.inf).max(axis=-1), 0)
    center = ((low + high) / 2).astype(np.float32).astype(np.float64)
    half_width = np.maximum(high - center, center - low)
    # The rounding error of u q - v p in single precision is relative to its terms.
    terms = np.abs(u * q).reshape(-1, _GROUP) + np.abs(v * p).reshape(-1, _GROUP)
    magnitude = np.stack([np.abs(values[0]), np.abs(values[1]), terms]).max(axis=-1)
    return np.concatenate([center, half_width + _ROUNDED * magnitude]).T.astype(np.float32)
