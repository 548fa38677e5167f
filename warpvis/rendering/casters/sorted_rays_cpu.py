# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Preparation of ray tables for packets on CPU cores: rays are split over pinholes and sorted into coherent packets.

Computed in double precision, once per ray table; used by ``kernels/native/cpu/ray_tree.h``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.kernels.constants import BLOCK_SIDE, CPU_LANES, NOWHERE, TILE_SIDE

if TYPE_CHECKING:
    from warpvis.kernels.casting.ray_bundle_packets import RayBundles

_LANES = CPU_LANES
_GROUP = _LANES * _LANES
# Maximum number of groups in a bundle, so that a bundle fits a core's cache and an image has a few units of work.
_MAX_GROUPS = 10
# For sensors that move within a frame: maximum number of groups in a bundle, minimum number of bundles in a frame, a
# time in which sensors do not move far [s], and the length of a frame relative to the largest side of a pinhole.
_MAX_MOVING_GROUPS, _MIN_BUNDLES, _SHORT_TIME, _TIME_WEIGHT = 2, 16, 0.004, 4.0
# Maximum tangent of the field of view of a single pinhole.
_MAX_TANGENT = 1.6
# Pixels of a bundle's image between neighboring rays: the resolution of positions and, nearly, of bounds.
_FINENESS = 32.0
_MIN_FOCAL, _MAX_FOCAL = 64.0, 2.0**15
_MARGIN = 1e-3  # of bounds [px]
# Maximum length of packets of neighbors in the table, relative to square packets; beyond it, rays are sorted.
_MAX_STRETCH = 2.0
_BLOCKS = ((4, 4), (2, 8), (1, 16))
_TILE_PACKETS = TILE_SIDE // BLOCK_SIDE  # packets per row or column of a tile
# Conditions for fitting a tile: minimum number of rays; minimum determinant of the steps along columns and rows,
# relative to the largest step squared; and maximum distance of rays from their fitted column and row.
_MIN_FITTED, _MIN_DETERMINANT, _MAX_FIT_ERROR = 16, 0.05, 0.75
# Error bounds of single precision: of fitted columns and rows, absolute, and of positions, relative.
_FIT_MARGIN, _ROUNDED = 1e-3, 5e-7
_FIT_WORDS = 10  # of a ``RayFit``

# Axes right, down and forward of the pinhole along each axis, by axis and whether it faces the negative direction. The
# bitwise complement of an axis is the negative axis.
_FACES: dict[tuple[int, bool], tuple[int, int, int]] = {
    (0, False): (~2, 1, 0),
    (0, True): (2, 1, ~0),
    (1, False): (0, ~2, 1),
    (1, True): (0, 2, ~1),
    (2, False): (0, 1, 2),
    (2, True): (~0, 1, ~2),
}


@dataclass(frozen=True)
class SplitRays:
    """Rays of a table, each assigned to one of several pinholes along the axes."""

    axes: list[tuple[int, int, int]]
    """Right, down and forward axis of each pinhole."""
    face: NDArray[np.int8]
    """Index of each ray's pinhole, -1 for none, shape (H, W)."""
    positions: NDArray[np.float64]
    """Position of each ray in its pinhole's image, from the principal point [px], shape (H * W, 2)."""
    forward: NDArray[np.float64]
    """Component of each ray along its pinhole's axis, shape (H * W)."""
    focal: float
    """Focal length of all pinholes [px]."""


@dataclass(frozen=True)
class PreparedRays:
    """A ray table prepared for packets."""

    struct: RayBundles
    longest: NDArray[np.float64]
    """Greatest z of the rays of each bundle at depth 1."""
    longest_ray: float
    """Greatest length of a ray at depth 1."""


def prepare_rays(rays: NDArray[np.float64], times: NDArray[np.float64] | None = None) -> PreparedRays:
    """Prepare rays of depth 1 in the camera frame, shape (H, W, 3); NaN for pixels without a ray.

    With times of rays [s], shape (H, W), bundles are small, and the rays of a bundle are cast at about the same time.
    """
    from warpvis.kernels.casting.ray_bundle_packets import RayBundles

    split = split_rays(rays)
    tiles, columns, bundles = _sort(split, times)
    layout = _Layout(tiles, columns, bundles, split)
    struct = RayBundles()
    struct.bundle = wp.array(np.array(layout.bundle, dtype=np.int32).reshape(-1, 9), dtype=wp.int32, device="cpu")
    for name, array in layout.arrays.items():
        setattr(struct, name, wp.array(array, device="cpu"))
    has_ray = split.face.ravel() >= 0
    if (split.forward[has_ray] != 1).any():
        scale = np.ones(layout.place.size, dtype=np.float32)
        occupied = layout.place.ravel() >= 0
        scale[occupied] = 1 / split.forward[layout.place.ravel()[occupied]]
        struct.scale = wp.array(scale, device="cpu")
    struct.without_ray = wp.array(np.flatnonzero(~has_ray).astype(np.int32), dtype=wp.int32, device="cpu")
    struct.focal, struct.max_groups = split.focal, layout.max_groups
    pixels = [tiles[first:end] for _, first, end in bundles]
    longest = [split.forward[bundle_pixels[bundle_pixels >= 0]].max() for bundle_pixels in pixels]
    length = np.linalg.norm(rays.reshape(-1, 3)[has_ray], axis=-1).max(initial=0)
    return PreparedRays(struct, np.array(longest), float(length))


def split_rays(rays: NDArray) -> SplitRays:
    """Assign rays to one pinhole along the camera's axis if it sees them all, otherwise to pinholes along all axes."""
    has_ray = np.isfinite(rays).all(axis=-1) & (rays != 0).any(axis=-1)
    size = np.where(has_ray[..., None], np.abs(rays), 0)
    if (rays[..., 2][has_ray] > 0).all() and (size[..., :2].max(axis=-1) <= _MAX_TANGENT * size[..., 2]).all():
        dominant_axis = np.full(has_ray.shape, 2)
    else:
        dominant_axis = size.argmax(axis=-1)
    forward = np.take_along_axis(rays, dominant_axis[..., None], axis=-1)[..., 0]
    face = np.full(has_ray.shape, -1, dtype=np.int8)
    positions_of_rays, area = np.full((*has_ray.shape, 2), np.nan), 0.0
    axes: list[tuple[int, int, int]] = []
    for (axis, is_negative), directions in _FACES.items():
        in_face = has_ray & (dominant_axis == axis) & ((forward < 0) == is_negative)
        if in_face.any():
            face[in_face] = len(axes)
            axes.append(directions)
            face_rays = rays[in_face]
            positions = np.stack([component(face_rays, direction) for direction in directions[:2]], axis=-1)
            positions_of_rays[in_face] = positions / np.abs(forward[in_face])[:, None]
            area += float(np.ptp(positions_of_rays[in_face], axis=0).prod())
    spacing = math.sqrt(area / max(1, int(has_ray.sum())))
    focal = _MAX_FOCAL if spacing == 0 else 2.0 ** round(math.log2(_FINENESS / spacing))
    focal = min(max(focal, _MIN_FOCAL), _MAX_FOCAL)
    return SplitRays(axes, face, (positions_of_rays * focal).reshape(-1, 2), np.abs(forward).ravel(), focal)


def component(rays: NDArray, axis: int) -> NDArray:
    """Return the component of vectors along an axis: an index, or its bitwise complement for the negative axis."""
    return -rays[..., ~axis] if axis < 0 else rays[..., axis]


def _sort(
    split: SplitRays, times: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.int64], NDArray[np.int64], list[tuple[int, int, int]]]:
    """Return tiles, the number of table columns of each tile's packets, and bundles: (face, first tile, end tile).

    A tile consists of sixteen packets of pixel indices, or -1 for none, shape (tiles, 16, 16). The number of columns is
    0 for tiles that are not blocks of the table.
    """
    tiles, columns = [np.zeros((0, _LANES, _LANES), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    bundles, first = [], 0
    for number in range(len(split.axes)):
        in_face = split.face == number
        face_tiles, num_columns = _tiles(in_face, split.positions, _with_times(in_face, split.positions, times))
        centers = _centers(face_tiles.reshape(len(face_tiles), -1), split.positions)
        whole, size = np.arange(len(face_tiles)), _MAX_GROUPS * _LANES
        parts = _split(centers, whole, _LANES, size) if times is None else _split_in_time(face_tiles, centers, times)
        for bundle in parts:
            order = np.concatenate(list(_split(centers, bundle, _LANES, _LANES)))
            tiles.append(face_tiles[order])
            columns.append(np.full(len(order), num_columns))
            bundles.append((number, first, first + len(order)))
            first += len(order)
    return np.concatenate(tiles), np.concatenate(columns), bundles


def _split_in_time(tiles: NDArray[np.int64], centers: NDArray, times: NDArray[np.float64]) -> Iterator[NDArray]:
    """Split tiles into small bundles, of which each takes a small part of a frame if single tiles do."""
    moments = np.where(tiles >= 0, times.ravel()[tiles], np.nan).reshape(len(tiles), -1)
    first, last = np.nanmin(moments, axis=1), np.nanmax(moments, axis=1)
    longest = max(float(np.ptp(times)) / _MIN_BUNDLES, _SHORT_TIME, float(np.mean(last - first)))
    middle = (first + last) / 2
    part = np.floor((middle - middle.min()) / longest)
    for number in np.unique(part):
        yield from _split(centers, np.flatnonzero(part == number), _LANES, _MAX_MOVING_GROUPS * _LANES)


def _with_times(in_face: NDArray[np.bool_], positions: NDArray, times: NDArray[np.float64] | None) -> NDArray:
    """Append times to positions, scaled such that rays at opposite ends of a frame are far apart."""
    if times is None or np.ptp(times) == 0:
        return positions
    largest = float(np.ptp(positions[in_face.ravel()], axis=0).max())
    return np.column_stack([positions, times.ravel() * (_TIME_WEIGHT * largest / float(np.ptp(times)))])


def _tiles(in_face: NDArray[np.bool_], places: NDArray, keys: NDArray) -> tuple[NDArray[np.int64], int]:
    """Return tiles of neighbors in the table, or of rays sorted by `keys` if neighbors in the table are incoherent.

    Also return the number of table columns of their packets; 0 if rays are sorted.
    """
    index = np.where(in_face, np.arange(in_face.size).reshape(in_face.shape), -1)
    cuts = [_cut(index, block) for block in _BLOCKS]
    lengths = [_lengths(tiles, places) for tiles in cuts]
    best = int(np.argmin(lengths))
    rays = index[in_face]
    # Total length if all packets were squares.
    count = len(rays) / _LANES
    ideal = 2 * math.sqrt(float(np.ptp(places[rays], axis=0).prod()) / count) * count
    if lengths[best] <= _MAX_STRETCH * ideal:
        return cuts[best], _BLOCKS[best][1]
    packets = _pad_rows(list(_split(keys, rays, _GROUP, _LANES)))
    middles = _centers(packets, keys)
    order = _pad_rows(list(_split(middles, np.arange(len(packets)), _LANES, _LANES)))
    tiles = np.where((order >= 0)[..., None], packets[order], -1)
    return (tiles, 0) if _lengths(tiles, places) < lengths[best] else (cuts[best], _BLOCKS[best][1])


def _cut(index: NDArray, block: tuple[int, int]) -> NDArray[np.int64]:
    """Cut a table into tiles of 4 x 4 blocks of sixteen pixels, and drop tiles without a ray."""
    (rows, columns), side = block, _TILE_PACKETS
    height, width = side * rows, side * columns
    padded = np.pad(index, ((0, -len(index) % height), (0, -index.shape[1] % width)), constant_values=-1)
    cut = padded.reshape(padded.shape[0] // height, side, rows, padded.shape[1] // width, side, columns)
    tiles = cut.transpose(0, 3, 1, 4, 2, 5).reshape(-1, _LANES, _LANES)
    return tiles[(tiles >= 0).any(axis=(1, 2))]


def _pad_rows(parts: list[NDArray]) -> NDArray[np.int64]:
    """Pad parts of at most sixteen items to rows of sixteen with -1."""
    rows = np.full((len(parts), _LANES), -1, dtype=np.int64)
    for row, part in zip(rows, parts, strict=True):
        row[: len(part)] = part
    return rows


def _lengths(tiles: NDArray, places: NDArray) -> float:
    """Return the sum of the half perimeters of the packets' bounds."""
    packets = tiles.reshape(-1, _LANES)
    packets = packets[(packets >= 0).any(axis=1)]
    occupied = (packets >= 0)[..., None]
    positions = places[packets]
    return float(
        (np.where(occupied, positions, -np.inf).max(axis=1) - np.where(occupied, positions, np.inf).min(axis=1)).sum()
    )


def _centers(rows: NDArray, places: NDArray) -> NDArray:
    """Return the mean position of the indices in each row, ignoring -1."""
    occupied = (rows >= 0)[..., None]
    return np.where(occupied, places[rows], 0).sum(axis=1) / occupied.sum(axis=1)


def _split(places: NDArray, items: NDArray, unit: int, max_size: int) -> Iterator[NDArray]:
    """Halve items along their longest axis until no part has more than `max_size`.

    Cuts are at multiples of `unit`, or of sixteen in smaller parts, so that all parts but the last are full.
    """
    count = len(items)
    if count <= max_size:
        yield items
        return
    step = unit if count > unit else _LANES
    cut = step * math.ceil(math.ceil(count / step) / 2)
    positions = places[items]
    axis = int(np.argmax(np.ptp(positions, axis=0)))
    order = np.argpartition(positions[:, axis], cut - 1)
    yield from _split(places, items[order[:cut]], unit, max_size)
    yield from _split(places, items[order[cut:]], unit, max_size)


class _Layout:
    """Arrays of rays, packets, tiles and groups, padded to full packets, tiles and groups."""

    def __init__(self, tiles: NDArray, columns: NDArray, bundles: list[tuple[int, int, int]], split: SplitRays) -> None:
        counts = [-(-(end - first) // _LANES) for _, first, end in bundles]
        starts = [0, *np.cumsum(counts).tolist()]
        self.max_groups = max(counts, default=1)
        self.place = np.full((starts[-1] * _LANES, _LANES, _LANES), -1, dtype=np.int32)
        positions, num_columns = np.zeros((2, *self.place.shape)), np.zeros(len(self.place), dtype=np.int64)
        for (_, first, end), group in zip(bundles, starts, strict=False):
            slots, bundle_tiles = slice(group * _LANES, group * _LANES + end - first), tiles[first:end]
            self.place[slots], num_columns[slots] = bundle_tiles, columns[first:end]
            positions[:, slots] = np.where(bundle_tiles >= 0, split.positions.T[:, bundle_tiles], 0)
        rounded = positions.astype(np.float32)
        errors = (positions - rounded).astype(np.float32)
        packet_rows, low, high = _rows(*self._packet_bounds(rounded))
        tile_rows, low, high = _rows(low, high)
        parts = [slice(*ends) for ends in pairwise(starts)]
        ends = [_rows(_pad_groups(low[part], NOWHERE), _pad_groups(high[part], -NOWHERE)) for part in parts]
        self.bundle = [
            (group, count, *split.axes[number], *_rectangle(lowest[0], highest[0]))
            for (number, _, _), group, count, (_, lowest, highest) in zip(bundles, starts, counts, ends, strict=False)
        ]
        self.arrays = {
            "group_bounds": np.concatenate([np.zeros(0, dtype=np.float32), *(rows.ravel() for rows, _, _ in ends)]),
            "tile_bounds": tile_rows.ravel(),
            "packet_bounds": packet_rows.ravel(),
            **dict(zip(("u", "v"), rounded.reshape(2, -1), strict=True)),
            **dict(zip(("rest_u", "rest_v"), errors.reshape(2, -1), strict=True)),
            **dict(zip(("row_u", "row_v"), to_row_order(rounded, num_columns), strict=True)),
            "place": self.place.ravel(),
            "run": _runs(self.place.reshape(-1, _LANES)),
            "corner": _corners(self.place, split.face.shape[1]),
            "fit": _fits(rounded, self.place >= 0, num_columns),
        }

    def _packet_bounds(self, rounded: NDArray) -> tuple[NDArray, NDArray]:
        occupied = self.place >= 0
        low = np.where(occupied, rounded, np.float32(NOWHERE)).min(axis=-1) - np.float32(_MARGIN)
        high = np.where(occupied, rounded, np.float32(-NOWHERE)).max(axis=-1) + np.float32(_MARGIN)
        return low.transpose(1, 2, 0), high.transpose(1, 2, 0)


def _rows(low: NDArray, high: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return bounds of children in rows of sixteen, [parent][u0 v0 u1 v1][child], and the parents' low and high."""
    low, high = low.reshape(-1, _LANES, 2), high.reshape(-1, _LANES, 2)
    rows = np.concatenate([low.transpose(0, 2, 1), high.transpose(0, 2, 1)], axis=1)
    return rows.astype(np.float32), low.min(axis=1), high.max(axis=1)


def _pad_groups(bounds: NDArray, fill: float) -> NDArray:
    """Pad the bounds of a bundle's groups to sixteen."""
    return np.pad(bounds, ((0, _LANES - len(bounds)), (0, 0)), constant_values=fill)


def _rectangle(low: NDArray, high: NDArray) -> tuple[int, int, int, int]:
    """Return the width, height and principal point of an image of whole pixels that contains all positions."""
    first = np.floor(low).astype(int) - 1
    size = np.ceil(high).astype(int) + 1 - first
    return int(size[0]), int(size[1]), int(-first[0]), int(-first[1])


def _runs(place: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the length of the runs of consecutive pixels that each packet consists of: 16, 8, 4, or 1."""
    runs = np.ones(len(place), dtype=np.int32)
    for run in (4, 8, 16):
        rows = place.reshape(len(place), _LANES // run, run)
        runs[((rows == rows[..., :1] + np.arange(run)) & (rows[..., :1] >= 0)).all(axis=(1, 2))] = run
    return runs


def _corners(place: NDArray[np.int32], width: int) -> NDArray[np.int32]:
    """Return the first pixel of each tile that is a 16 x 16 square of an image, in blocks of 4 x 4; -1 for others."""
    pixel = np.arange(TILE_SIDE * TILE_SIDE).reshape(TILE_SIDE, TILE_SIDE)
    blocks = _cut(pixel, _BLOCKS[0])[0]
    expected = place[:, :1, :1] + blocks // TILE_SIDE * width + blocks % TILE_SIDE
    nonempty = place[:, 0, 0] >= 0
    return np.where(nonempty & (place == expected).all(axis=(1, 2)), place[:, 0, 0], -1).astype(np.int32)


def _slots(columns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the column and the row of each ray of a tile with packets of `columns` columns."""
    packet, lane = np.divmod(np.arange(_GROUP), _LANES)
    return packet % _TILE_PACKETS * columns + lane % columns, packet // _TILE_PACKETS * (
        _LANES // columns
    ) + lane // columns


def to_row_order(places: NDArray[np.float32], num_columns: NDArray[np.int64]) -> NDArray[np.float32]:
    """Reorder positions, shape (2, tiles, 16, 16), by rows and columns of each tile, shape (2, tiles * 256)."""
    rows = np.zeros((2, len(num_columns), _GROUP), dtype=np.float32)
    for columns in np.unique(num_columns[num_columns > 0]):
        column, row = _slots(columns)
        tiles = np.flatnonzero(num_columns == columns)
        rows[:, tiles[:, None], row * columns * _TILE_PACKETS + column] = places[:, tiles].reshape(
            2, len(tiles), _GROUP
        )
    return rows.reshape(2, -1)


def _fits(
    places: NDArray[np.float32], occupied: NDArray[np.bool_], num_columns: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Fit columns and rows as linear functions of positions, shape (2, tiles, 16, 16): words of a ``RayFit`` per tile.

    Tiles that do not meet the conditions for a fit have zeros.
    """
    fits = np.zeros((len(occupied), _FIT_WORDS), dtype=np.float32)
    for columns in np.unique(num_columns[num_columns > 0]):
        cells = np.stack([np.ones(_GROUP), *_slots(columns)], axis=-1)
        tiles = np.flatnonzero((num_columns == columns) & (occupied.sum(axis=(1, 2)) >= _MIN_FITTED))
        weight = occupied[tiles].reshape(len(tiles), _GROUP).astype(np.float64)
        positions = places[:, tiles].reshape(2, len(tiles), _GROUP).astype(np.float64)
        # For rays in one row or one column, the pseudoinverse gives the solution of minimum norm.
        normal_inverse = np.linalg.pinv(np.einsum("ts,si,sj->tij", weight, cells, cells), hermitian=True)
        linear = np.einsum("tij,sj,ts,kts->kti", normal_inverse, cells, weight, positions).astype(np.float32)
        error = (np.abs(np.einsum("si,kti->kts", cells, linear.astype(np.float64)) - positions) * weight).max(axis=-1)
        step = linear[..., 1:].astype(np.float64)  # (u and v, tile, along column and row)
        size = np.abs(step).max(axis=(0, 2))
        determinant = step[0, :, 0] * step[1, :, 1] - step[0, :, 1] * step[1, :, 0]
        valid = np.abs(determinant) > _MIN_DETERMINANT * size**2
        tiles, linear, error, step = tiles[valid], linear[:, valid], error[:, valid], step[:, valid]
        inverse_step = np.linalg.inv(step.transpose(1, 0, 2))  # (tile, column and row, along u and v)
        error += _ROUNDED * np.abs(positions[:, valid]).max(axis=-1)
        tolerance = np.einsum("tik,kt->ti", np.abs(inverse_step), error) + _FIT_MARGIN
        accurate = (tolerance <= _MAX_FIT_ERROR).all(axis=1)
        words = [
            *linear[..., 0],
            *inverse_step.reshape(-1, 4).T,
            *tolerance.T,
            np.full(len(tiles), np.log2(columns)),
            size[valid],
        ]
        fits[tiles[accurate]] = np.stack(words, axis=-1)[accurate]
    return fits
