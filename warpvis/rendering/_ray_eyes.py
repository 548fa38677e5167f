# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Eyes of packets of rays with distinct origins, for GPUs: points near all rays of a packet and behind their origins.

Computed in double precision, once per ray table; used by ``kernels/native/cuda/ray_origins.h``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.kernels.ray_packets_cuda import EYE_WORDS
from warpvis.rendering._ray_images import PacketImages

# Regularization weight that draws an eye to the mean of its rays' origins; for parallel rays, the nearest point is not
# unique along the rays.
_DRAWN_TO_ORIGINS = 1e-5
# Maximum distance of an eye from the mean origin, relative to the largest distance of an origin from it.
_MAX_AWAY = 2.0
_ROUNDED = 1e-6  # relative rounding error bound of single precision
# Rows of a table are sorted into at most this many groups of at least this many rows, if rays pass their packet's eye
# at more than _FAR_ASIDE times the distance of neighboring rays 1 m away, and grouping reduces this to _MUCH_NEARER.
_MAX_GROUPS, _FEWEST_ROWS = 4, 8
_FAR_ASIDE, _MUCH_NEARER = 3.0, 0.5


@dataclass(frozen=True)
class PacketEyes:
    """Eyes of packets and the positions of rays relative to them: arrays with a row per packet."""

    words: NDArray[np.float64]
    """Words of a ``TableEye`` in each row."""
    aside: NDArray[np.float32]
    """Offset of each ray from the eye, in the plane of the eye [px m], shape (packets, slots, 2); 0 without a ray."""
    begin: NDArray[np.float32]
    """Distance of each ray origin in front of that plane [m], shape (packets, slots); 0 without a ray."""

    @property
    def most_aside(self) -> NDArray[np.float64]:
        """Maximum offset of a packet's rays from its eye along either axis [px m], shape (packets,)."""
        return self.words[:, 3:5].max(axis=1)


def find_eyes(images: PacketImages, rays: NDArray[np.float64], origins: NDArray[np.float64]) -> PacketEyes:
    """Find the eyes of packets.

    Args:
        images: Images of the packets.
        rays: Rays of the camera frame, shape (N, 3).
        origins: Origins of the rays [m], shape (N, 3).
    """
    there = images.there[..., None]
    starts = np.where(there, origins[images.place], 0.0)
    eyes = _nearest_places(np.where(there, rays[images.place], 0.0), starts, images.there)
    forward = images.matrix[:, 2]
    ahead = np.where(images.there, np.einsum("pk,pik->pi", forward, starts - eyes[:, None]), np.inf).min(axis=1)
    eyes += np.minimum(ahead, 0.0)[:, None] * forward
    apart = np.where(there, starts - eyes[:, None], 0.0)
    at = np.einsum("prk,pik->pir", images.matrix, apart)
    aside = np.where(there, at[..., :2] - images.exact * at[..., 2:], 0.0)
    begin = at[..., 2]
    turn = images.exact[..., 0] * aside[..., 1] - images.exact[..., 1] * aside[..., 0]
    values = [*np.abs(aside).transpose(2, 0, 1), np.abs(turn), np.linalg.norm(apart, axis=-1), begin]
    most = np.stack([value.max(axis=1) for value in values], axis=1) * (1 + _ROUNDED)
    words = np.concatenate([eyes, most], axis=1)
    assert words.shape[1] == EYE_WORDS
    return PacketEyes(words, aside.astype(np.float32), begin.astype(np.float32))


def _nearest_places(rays: NDArray[np.float64], starts: NDArray[np.float64], there: NDArray[np.bool_]) -> NDArray:
    """Return the points nearest to each packet's rays, zeros for none, by least squares, shape (packets, 3)."""
    count = np.maximum(there.sum(axis=1), 1)[:, None]
    middle = starts.sum(axis=1) / count
    apart = np.where(there[..., None], starts - middle[:, None], 0.0)
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    ahead = rays / np.where(length > 0, length, 1.0)
    across = count[..., None] * (1 + _DRAWN_TO_ORIGINS) * np.eye(3) - np.einsum("pia,pib->pab", ahead, ahead)
    along = np.einsum("pia,pia->pi", ahead, apart)
    passed = (apart - along[..., None] * ahead).sum(axis=1)
    shift = np.linalg.solve(across, passed[..., None])[..., 0]
    most = _MAX_AWAY * np.linalg.norm(apart, axis=-1).max(axis=1)
    size = np.linalg.norm(shift, axis=-1)
    return middle + shift * np.where(size > most, most / np.where(size > 0, size, 1.0), 1.0)[:, None]


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
    there = first >= 0
    looks, starts = (np.where(there[..., None], values[first], 0.0) for values in (rays, origins))
    groups = [np.arange(len(index))]
    apart = _farthest(groups, looks, starts, there, side)
    neighbours = np.linalg.norm(np.diff(looks, axis=1), axis=-1)[there[:, 1:] & there[:, :-1]]
    if not len(neighbours) or apart <= _FAR_ASIDE * np.median(neighbours):
        return index
    # Use no more groups than needed, since each is padded to a multiple of a packet's rows.
    while _farthest(groups, looks, starts, there, side) > _MUCH_NEARER * apart:
        if len(groups) >= _MAX_GROUPS:
            return index
        groups = [half for part in groups for half in _halves(part, looks, starts, there)]
    return np.concatenate(
        [np.pad(index[rows], ((0, -len(rows) % side), (0, 0)), constant_values=-1) for rows in groups]
    )


def _halves(rows: NDArray[np.int64], rays: NDArray, starts: NDArray, there: NDArray[np.bool_]) -> list[NDArray]:
    """Split rows at the widest gap between the mean offsets of their rays."""
    middles = (
        _passing(rays[rows], starts[rows], there[rows]).sum(axis=1) / np.maximum(there[rows].sum(axis=1), 1)[:, None]
    )
    value = middles @ np.linalg.svd(middles - middles.mean(axis=0))[2][0]
    order = np.argsort(value, kind="stable")
    few = min(_FEWEST_ROWS, len(rows) // 2)
    gaps = np.diff(value[order])[few - 1 : len(rows) - few]
    cut = few + int(gaps.argmax()) if len(gaps) else len(rows)
    return [np.sort(part) for part in (rows[order[:cut]], rows[order[cut:]]) if len(part)]


def _farthest(groups: list[NDArray[np.int64]], rays: NDArray, starts: NDArray, there: NDArray, side: int) -> float:
    """Return the largest root mean square distance of a packet's rays from their nearest point, over groups of rows."""
    packets = [part[first : first + side] for part in groups for first in range(0, len(part), side)]
    return max(_size(_passing(rays[rows], starts[rows], there[rows])) for rows in packets)


def _size(aside: NDArray) -> float:
    return float(np.sqrt((aside**2).sum(axis=-1).mean()))


def _passing(rays: NDArray, starts: NDArray, there: NDArray[np.bool_]) -> NDArray:
    """Return the offset of each ray from the point nearest to all rays."""
    flat, begin = rays.reshape(1, -1, 3), starts.reshape(1, -1, 3)
    place = _nearest_places(flat, begin, there.reshape(1, -1))[0]
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    ahead = rays / np.where(length > 0, length, 1.0)
    to = np.where(there[..., None], starts - place, 0.0)
    return to - (to * ahead).sum(axis=-1, keepdims=True) * ahead
