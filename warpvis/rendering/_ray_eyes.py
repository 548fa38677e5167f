# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Eyes of packets on a GPU whose rays begin apart from each other: amidst the rays, and behind all their origins.

All in double precision, once for a table. What is made of it is in ``kernels/native/cuda/ray_origins.h``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.kernels.ray_packets_cuda import EYE_WORDS
from warpvis.rendering._ray_images import PacketImages

# How much an eye is drawn to the middle of its rays' origins: those of parallel rays are anywhere along them.
_DRAWN_TO_ORIGINS = 1e-5
# Eyes are no farther than so many times as far from there as origins are.
_MAX_AWAY = 2.0
_ROUNDED = 1e-6  # of what single precision holds
# Rows of a table are sorted into so many groups, of no fewer rows, where rays pass farther beside their eye than so
# many times what neighbours are apart 1 m away, and pass so much nearer to a group's.
_MAX_GROUPS, _FEWEST_ROWS = 4, 8
_FAR_ASIDE, _MUCH_NEARER = 3.0, 0.5


@dataclass(frozen=True)
class PacketEyes:
    """What is known of each packet's eye and rays: arrays of a row each."""

    words: NDArray[np.float64]
    """Rows of a ``TableEye`` each."""
    aside: NDArray[np.float32]
    """Where rays pass the plane of the eye [px m], shape (packets, slots, 2); 0 where there is none."""
    begin: NDArray[np.float32]
    """How far ahead of that plane they begin [m], shape (packets, slots); 0 where there is none."""

    @property
    def most_aside(self) -> NDArray[np.float64]:
        """How far beside each packet's eye rays pass, at most [px m]."""
        return self.words[:, 3:5].max(axis=1)


def find_eyes(images: PacketImages, rays: NDArray[np.float64], origins: NDArray[np.float64]) -> PacketEyes:
    """Find eyes of packets.

    Args:
        images: Of the packets.
        rays: Rays of the camera frame, shape (N, 3).
        origins: Where they begin [m], likewise.
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
    """Return the places that rays, zeros for none, pass the nearest, by least squares, shape (packets, 3)."""
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
    """Sort the rows of a table so that those whose rays begin alike follow each other: a lidar's left and right lasers.

    Args:
        index: Of each ray, -1 for none, shape (H, W); columns look about the same way in all rows.
        rays: Rays of the camera frame, shape (N, 3).
        origins: Where they begin [m], likewise.
        side: Of packets; groups are filled up to so many rows by rows of -1.
    """
    first = index[:, :side]
    there = first >= 0
    looks, starts = (np.where(there[..., None], values[first], 0.0) for values in (rays, origins))
    groups = [np.arange(len(index))]
    apart = _farthest(groups, looks, starts, there, side)
    neighbours = np.linalg.norm(np.diff(looks, axis=1), axis=-1)[there[:, 1:] & there[:, :-1]]
    if not len(neighbours) or apart <= _FAR_ASIDE * np.median(neighbours):
        return index
    # No more groups than needed: each is filled up to a multiple of a packet's rows.
    while _farthest(groups, looks, starts, there, side) > _MUCH_NEARER * apart:
        if len(groups) >= _MAX_GROUPS:
            return index
        groups = [half for part in groups for half in _halves(part, looks, starts, there)]
    return np.concatenate(
        [np.pad(index[rows], ((0, -len(rows) % side), (0, 0)), constant_values=-1) for rows in groups]
    )


def _halves(rows: NDArray[np.int64], rays: NDArray, starts: NDArray, there: NDArray[np.bool_]) -> list[NDArray]:
    """Split rows at the widest gap between where rays pass."""
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
    """Return how far from one place the rays of a packet pass, at most over all packets of groups of rows."""
    packets = [part[first : first + side] for part in groups for first in range(0, len(part), side)]
    return max(_size(_passing(rays[rows], starts[rows], there[rows])) for rows in packets)


def _size(aside: NDArray) -> float:
    return float(np.sqrt((aside**2).sum(axis=-1).mean()))


def _passing(rays: NDArray, starts: NDArray, there: NDArray[np.bool_]) -> NDArray:
    """How far beside the place that all rays pass the nearest each of them does."""
    flat, begin = rays.reshape(1, -1, 3), starts.reshape(1, -1, 3)
    place = _nearest_places(flat, begin, there.reshape(1, -1))[0]
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    ahead = rays / np.where(length > 0, length, 1.0)
    to = np.where(there[..., None], starts - place, 0.0)
    return to - (to * ahead).sum(axis=-1, keepdims=True) * ahead
