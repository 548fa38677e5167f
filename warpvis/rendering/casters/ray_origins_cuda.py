# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Eyes of packets of rays with distinct origins, for GPUs: points near all rays of a packet and behind their origins.

Computed in double precision, once per ray table; used by ``kernels/native/cuda/ray_origins.h``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.rendering.casters.packet_images_cuda import PacketImages, mean_directions

# Regularization weight that draws an eye to the mean of its rays' origins; for parallel rays, the nearest point is not
# unique along the rays.
_ORIGIN_WEIGHT = 1e-5
# Maximum distance of an eye from the mean origin, relative to the largest distance of an origin from it.
_MAX_EYE_DISTANCE = 2.0
_ROUNDED = 1e-6  # relative rounding error bound of single precision
# Rows of a table are sorted into at most this many groups of at least this many rows, if rays pass their packet's eye
# at more than _FAR_ASIDE times the distance of neighboring rays 1 m away, and grouping reduces this to _MUCH_NEARER.
_MAX_GROUPS, _MIN_ROWS = 4, 8
_SPREAD_LIMIT, _SPREAD_REDUCTION = 3.0, 0.5


@dataclass(frozen=True)
class PacketEyes:
    """Eyes of packets and the positions of rays relative to them: arrays with a row per packet."""

    words: NDArray[np.float64]
    """Words of a ``TableEye`` in each row."""
    offset: NDArray[np.float32]
    """Offset of each ray from the eye, in the plane of the eye [px m], shape (packets, slots, 2); 0 without a ray."""
    origin_z: NDArray[np.float32]
    """Distance of each ray origin in front of that plane [m], shape (packets, slots); 0 without a ray."""

    @property
    def max_offset(self) -> NDArray[np.float64]:
        """Maximum offset of a packet's rays from its eye along either axis [px m], shape (packets,)."""
        return self.words[:, 3:5].max(axis=1)


def find_eyes(images: PacketImages, rays: NDArray[np.float64], origins: NDArray[np.float64]) -> PacketEyes:
    """Find the eyes of packets.

    Args:
        images: Images of the packets.
        rays: Rays of the camera frame, shape (N, 3).
        origins: Origins of the rays [m], shape (N, 3).
    """
    from warpvis.kernels.casting.packets_cuda import EYE_WORDS

    occupied = images.occupied[..., None]
    ray_origins = np.where(occupied, origins[images.place], 0.0)
    packet_rays = np.where(occupied, rays[images.place], 0.0)
    eyes = _nearest_points(packet_rays, ray_origins, images.occupied)
    forward = images.matrix[:, 2]
    first_z = np.where(images.occupied, np.einsum("pk,pik->pi", forward, ray_origins - eyes[:, None]), np.inf).min(
        axis=1
    )
    # Back along the middle of the rays: moved along the axis of the image, oblique rays would pass the eye far away.
    middle = mean_directions(packet_rays)
    eyes += (np.minimum(first_z, 0.0) / (middle * forward).sum(axis=-1))[:, None] * middle
    offsets = np.where(occupied, ray_origins - eyes[:, None], 0.0)
    local = np.einsum("prk,pik->pir", images.matrix, offsets)
    crossing = np.where(occupied, local[..., :2] - images.positions * local[..., 2:], 0.0)
    origin_z = local[..., 2]
    moment = images.positions[..., 0] * crossing[..., 1] - images.positions[..., 1] * crossing[..., 0]
    values = [*np.abs(crossing).transpose(2, 0, 1), np.abs(moment), np.linalg.norm(offsets, axis=-1), origin_z]
    bounds = np.stack([value.max(axis=1) for value in values], axis=1) * (1 + _ROUNDED)
    words = np.concatenate([eyes, bounds], axis=1)
    assert words.shape[1] == EYE_WORDS
    return PacketEyes(words, crossing.astype(np.float32), origin_z.astype(np.float32))


def _nearest_points(
    rays: NDArray[np.float64], ray_origins: NDArray[np.float64], occupied: NDArray[np.bool_]
) -> NDArray:
    """Return the points nearest to each packet's rays, zeros for none, by least squares, shape (packets, 3)."""
    count = np.maximum(occupied.sum(axis=1), 1)[:, None]
    center = ray_origins.sum(axis=1) / count
    offsets = np.where(occupied[..., None], ray_origins - center[:, None], 0.0)
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    directions = rays / np.where(length > 0, length, 1.0)
    normal_matrix = count[..., None] * (1 + _ORIGIN_WEIGHT) * np.eye(3) - np.einsum(
        "pia,pib->pab", directions, directions
    )
    along = np.einsum("pia,pia->pi", directions, offsets)
    right_side = (offsets - along[..., None] * directions).sum(axis=1)
    shift = np.linalg.solve(normal_matrix, right_side[..., None])[..., 0]
    limit = _MAX_EYE_DISTANCE * np.linalg.norm(offsets, axis=-1).max(axis=1)
    size = np.linalg.norm(shift, axis=-1)
    return center + shift * np.where(size > limit, limit / np.where(size > 0, size, 1.0), 1.0)[:, None]


def group_rows(
    index: NDArray[np.int64], rays: NDArray[np.float64], origins: NDArray[np.float64], side: int
) -> NDArray[np.int64]:
    """Sort the rows of a table so that rows with similar ray origins are adjacent, as a lidar's left and right lasers.

    Args:
        index: Index of each ray, -1 for none, shape (H, W); rays of a column have similar directions in all rows.
        rays: Rays of the camera frame, shape (N, 3).
        origins: Origins of the rays [m], shape (N, 3).
        side: Side of packets; groups are padded to a multiple of it with rows of -1.
    """
    first = index[:, :side]
    has_ray = first >= 0
    directions, ray_origins = (np.where(has_ray[..., None], values[first], 0.0) for values in (rays, origins))
    groups = [np.arange(len(index))]
    spread = _max_spread(groups, directions, ray_origins, has_ray, side)
    spacings = np.linalg.norm(np.diff(directions, axis=1), axis=-1)[has_ray[:, 1:] & has_ray[:, :-1]]
    if not len(spacings) or spread <= _SPREAD_LIMIT * np.median(spacings):
        return index
    # Use no more groups than needed, since each is padded to a multiple of a packet's rows.
    while _max_spread(groups, directions, ray_origins, has_ray, side) > _SPREAD_REDUCTION * spread:
        if len(groups) >= _MAX_GROUPS:
            return index
        groups = [half for group in groups for half in _halves(group, directions, ray_origins, has_ray)]
    return np.concatenate(
        [np.pad(index[rows], ((0, -len(rows) % side), (0, 0)), constant_values=-1) for rows in groups]
    )


def _halves(rows: NDArray[np.int64], rays: NDArray, ray_origins: NDArray, has_ray: NDArray[np.bool_]) -> list[NDArray]:
    """Split rows at the widest gap between the mean offsets of their rays."""
    centers = (
        _offsets(rays[rows], ray_origins[rows], has_ray[rows]).sum(axis=1)
        / np.maximum(has_ray[rows].sum(axis=1), 1)[:, None]
    )
    value = centers @ np.linalg.svd(centers - centers.mean(axis=0))[2][0]
    order = np.argsort(value, kind="stable")
    min_rows = min(_MIN_ROWS, len(rows) // 2)
    gaps = np.diff(value[order])[min_rows - 1 : len(rows) - min_rows]
    cut = min_rows + int(gaps.argmax()) if len(gaps) else len(rows)
    return [np.sort(half) for half in (rows[order[:cut]], rows[order[cut:]]) if len(half)]


def _max_spread(
    groups: list[NDArray[np.int64]], rays: NDArray, ray_origins: NDArray, has_ray: NDArray, side: int
) -> float:
    """Return the largest root mean square distance of a packet's rays from their nearest point, over groups of rows."""
    packets = [group[first : first + side] for group in groups for first in range(0, len(group), side)]
    return max(_rms(_offsets(rays[rows], ray_origins[rows], has_ray[rows])) for rows in packets)


def _rms(offsets: NDArray) -> float:
    return float(np.sqrt((offsets**2).sum(axis=-1).mean()))


def _offsets(rays: NDArray, ray_origins: NDArray, has_ray: NDArray[np.bool_]) -> NDArray:
    """Return the offset of each ray from the point nearest to all rays."""
    flat, flat_origins = rays.reshape(1, -1, 3), ray_origins.reshape(1, -1, 3)
    center = _nearest_points(flat, flat_origins, has_ray.reshape(1, -1))[0]
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    directions = rays / np.where(length > 0, length, 1.0)
    relative = np.where(has_ray[..., None], ray_origins - center, 0.0)
    return relative - (relative * directions).sum(axis=-1, keepdims=True) * directions
