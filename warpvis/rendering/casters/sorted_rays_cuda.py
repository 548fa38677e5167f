# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Preparation of ray tables for packets on a GPU, each with its own image: squares of neighbors, and other rays.

Used by ``kernels/native/cuda/table.h``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.kernels.constants import CUDA_LANES
from warpvis.rendering.casters.packet_images_cuda import POINTS_SIDE, PacketImages, fit_grid, fit_points, middle_cosines
from warpvis.rendering.casters.ray_origins_cuda import PacketEyes, find_eyes, group_rows
from warpvis.rendering.casters.sorted_rays_cpu import split_rays

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets_cuda import RayPackets

# Sides of images [px]: squares of rays that do not fit a large one are cut into small ones.
_LARGE_SIDE, _SMALL_SIDE = 32, 16
# Minimum number of rays of a table for large squares.
_MANY_RAYS = 200_000
# Size of the blocks of pixels that a warp processes together [px].
_BLOCK_WIDTH, _BLOCK_HEIGHT = 8, 4
# Minimum cosine of the angle between a ray and the axis of its packet.
_MIN_COSINE = 0.5
# Maximum distance of rays from pixel centers in squares of the table [px]; rays of other squares are sorted.
_MAX_SPREAD = 1.5
# The same for squares of 32x32, and the minimum fraction of their pixels with a ray.
_MAX_LARGE_SPREAD, _MIN_FILL = 0.4, 0.6
# The same for squares of sorted rays; other rays are cast as points.
_MAX_SORTED_SPREAD = 0.4

POINTS = 256
"""Number of rays in a packet of points."""


@dataclass(frozen=True)
class _SquareImages:
    """Images of one side with a ray per pixel, and their eyes if rays have distinct origins."""

    side: int
    images: PacketImages
    eyes: PacketEyes | None


class PreparedPackets:
    """A ray table prepared for packets on a GPU."""

    points: RayPackets | None
    """Packets of `POINTS` rays each that are in no square; None if there are no such rays, or if they are single."""
    single: NDArray[np.int64]
    """Indices of rays that are to be cast one by one; only if a maximum eye offset is given."""
    eye_offset: float
    """Median over all images of the maximum offset of a ray from the image's eye [px m]; 0 for a common origin."""

    def __init__(
        self, maker: _Maker, squares: list[_SquareImages], points: NDArray[np.int64], single: NDArray[np.int64]
    ) -> None:
        """Copy points to the device; squares are copied when a launch needs them, in packets of its side."""
        self._maker, self._squares, self.single = maker, squares, single
        self._packets: dict[int, list[tuple[int, RayPackets]]] = {}
        self.points = maker.points(points) if len(points) else None
        self.eye_offset = float(np.median(np.concatenate(maker.eye_offsets))) if maker.eye_offsets else 0.0

    def count(self, side: int) -> int:
        """Return the number of square packets of at most a side."""
        return sum(len(group.images.place) * max(group.side // side, 1) ** 2 for group in self._squares)

    def packets(self, side: int) -> list[tuple[int, RayPackets]]:
        """Return square packets of at most a side, in groups of one side: the side [px], and the packets.

        A packet is an image or a window of it. Results do not depend on the side, to the last bit.
        """
        if side not in self._packets:
            sides = sorted({min(group.side, side) for group in self._squares}, reverse=True)
            groups = {size: [group for group in self._squares if min(group.side, side) == size] for size in sides}
            self._packets[side] = [(size, self._maker.windows(groups[size], size)) for size in sides]
        return self._packets[side]


def prepare_packets(
    rays: NDArray[np.float64],
    device: wp.Device,
    origins: NDArray[np.float64] | None = None,
    max_eye_offset: float | None = None,
) -> PreparedPackets:
    """Prepare rays of depth 1 in the camera frame, shape (H, W, 3); NaN for pixels without a ray.

    Rays start at the camera's origin, or at `origins`, shape (H, W, 3), which must be close to it. With origins and
    `max_eye_offset`, rays that are in no square are single, and squares with a ray that passes their eye at a greater
    distance [px m], too. Rays from one origin never are: single rays may pass through a vertex of a closed surface.

    The packets depend on the arguments only, so that the last digits of a view do not change with the number of views.
    """
    flat, index, maker = _flat(rays), _indices(rays), _Maker(rays, origins, device)
    grouped = index
    if origins is not None:
        unrolled = unroll_rows(index, flat)
        grouped = group_rows(unrolled, flat, origins.reshape(-1, 3), _SMALL_SIDE)
        grouped = index if grouped is unrolled else grouped
    large = np.zeros((0, _LARGE_SIDE**2), dtype=np.int64)
    if len(flat) >= _MANY_RAYS and grouped is index:  # rows of a large square of groups may have distant origins
        large = _near_blocks(index, flat, _LARGE_SIDE, _MAX_LARGE_SPREAD)
        large = large[(large >= 0).mean(axis=1) >= _MIN_FILL]
    index = grouped
    small, scattered = _arrange(np.where(np.isin(index, large), -1, index), flat, _SMALL_SIDE)
    places, single = [(_LARGE_SIDE, large), (_SMALL_SIDE, small)], np.zeros(0, dtype=np.int64)
    if max_eye_offset is not None and origins is not None:
        near = [maker.eye_offsets_of(place, side) <= max_eye_offset for side, place in places]
        # Warps of single rays are blocks of squares.
        others = [place[~is_near][:, z_buffer_order(side)] for (side, place), is_near in zip(places, near, strict=True)]
        single = np.concatenate([part.ravel() for part in (scattered, *others)])
        single, scattered = single[single >= 0], scattered[:0]
        places = [(side, place[is_near]) for (side, place), is_near in zip(places, near, strict=True)]
    squares = [maker.squares(place, side) for side, place in places if len(place)]
    return PreparedPackets(maker, squares, scattered, single)


def _flat(rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rays with shape (N, 3); zeros for pixels without a ray."""
    flat = rays.reshape(-1, 3)
    return np.where(np.isfinite(flat).all(axis=-1, keepdims=True), flat, 0.0)


def _indices(rays: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.arange(rays.shape[0] * rays.shape[1]).reshape(rays.shape[:2])


class _Maker:
    """Creates packets of a ray table on a device."""

    def __init__(self, rays: NDArray[np.float64], origins: NDArray[np.float64] | None, device: wp.Device) -> None:
        """Store the rays; the arguments are those of `prepare_packets`."""
        self.eye_offsets: list[NDArray[np.float64]] = []
        self._rays = _flat(rays)
        self._origins = None if origins is None else origins.reshape(-1, 3)
        self._device = device

    def squares(self, place: NDArray[np.int64], side: int) -> _SquareImages:
        """Fit square images; `place` is the index of each pixel's ray, -1 for none."""
        return self._with_eyes(side, fit_grid(place, self._rays, side))

    def eye_offsets_of(self, place: NDArray[np.int64], side: int) -> NDArray[np.float64]:
        """Return the maximum offset of a ray from the eye of each square image [px m]."""
        if self._origins is None or not len(place):
            return np.zeros(len(place))
        return find_eyes(fit_grid(place, self._rays, side), self._rays, self._origins).max_offset

    def points(self, place: NDArray[np.int64]) -> RayPackets:
        """Create packets of points; `place` is the index of each slot's ray, -1 for none."""
        group = self._with_eyes(POINTS_SIDE, fit_points(place, self._rays))
        windows = np.stack([np.arange(len(place)), *np.zeros((2, len(place)), dtype=np.int64)], axis=1)
        packets = self._put([group], windows, [lambda values: values])
        packets.bounds = wp.array(group.images.block_bounds(), dtype=wp.vec4, device=self._device)
        return packets

    def windows(self, groups: list[_SquareImages], side: int) -> RayPackets:
        """Create packets of a side from square images, with slots in the order of the z-buffer."""
        order, cuts, windows, first = z_buffer_order(side), [], [], 0
        for group in groups:
            count, columns = len(group.images.place), group.side // side
            image, y, x = np.indices((count, columns, columns)).reshape(3, -1)
            windows.append(np.stack([first + image, x * side, y * side], axis=1))
            cuts.append(lambda values, columns=columns: _cut(values, columns, side)[:, order])
            first += count
        return self._put(groups, np.concatenate(windows), cuts)

    def _with_eyes(self, side: int, images: PacketImages) -> _SquareImages:
        eyes = None
        if self._origins is not None:
            eyes = find_eyes(images, self._rays, self._origins)
            self.eye_offsets.append(eyes.max_offset)
        return _SquareImages(side, images, eyes)

    def _put(
        self, groups: list[_SquareImages], windows: NDArray[np.int64], cuts: Sequence[Callable[[NDArray], NDArray]]
    ) -> RayPackets:
        """Copy packets to the device; `cuts` convert the rows of each group's images to those of its packets."""
        from warpvis.kernels.casting.packets_cuda import RayPackets

        def put(rows: Iterable[NDArray], dtype: Any) -> wp.array:
            return wp.array(np.concatenate(list(rows)), dtype=dtype, device=self._device)

        def put_slots(rows: Iterable[NDArray], dtype: Any) -> wp.array:
            return put((cut(values) for cut, values in zip(cuts, rows, strict=True)), dtype)

        packets, images = RayPackets(), [group.images for group in groups]
        packets.frame = put((group.images.frames(group.side) for group in groups), wp.float64)
        full = np.concatenate([cut(image.occupied).all(axis=1) for cut, image in zip(cuts, images, strict=True)])
        packets.windows = put([np.column_stack([windows, full]).astype(np.int32)], wp.int32)
        packets.points = put_slots((image.rounded for image in images), wp.vec2)
        packets.rests = put_slots(((image.positions - image.rounded).astype(np.float32) for image in images), wp.vec2)
        packets.scale = put_slots(
            (np.where(image.occupied, 1 / image.forward, 0.0).astype(np.float32) for image in images), wp.float32
        )
        packets.place = put_slots((image.place.astype(np.int32) for image in images), wp.int32)
        packets.pixels = len(self._rays)
        eyes = [group.eyes for group in groups if group.eyes is not None]
        if eyes:
            packets.eyes = put((eye.words for eye in eyes), wp.float64)
            packets.asides = put_slots((eye.offset for eye in eyes), wp.vec2)
            packets.begins = put_slots((eye.origin_z for eye in eyes), wp.float32)
        return packets


def _near_blocks(index: NDArray[np.int64], rays: NDArray, side: int, max_spread: float) -> NDArray[np.int64]:
    """Cut a table into squares; return those whose rays pass near pixel centers, shape (packets, pixels)."""
    unrolled = unroll_rows(index, rays)
    tables = [index] if (unrolled == index).all() else [index, unrolled]
    cuts = [cut_table(table, side) for table in tables]
    images = [fit_grid(place, rays, side) for place in cuts]
    best = int(np.argmin([np.median(image.spread) for image in images]))
    near = (images[best].spread <= max_spread) & (middle_cosines(images[best], rays) >= _MIN_COSINE)
    return cuts[best][near & (cuts[best] >= 0).any(axis=1)]


def _arrange(
    index: NDArray[np.int64], rays: NDArray[np.float64], side: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return square packets and packets of `POINTS` rays: indices of rays, -1 for none, shape (packets, slots).

    Squares of the table are used where neighbors in the table are neighbors in space; other rays are sorted by
    direction.
    """
    place = _near_blocks(index, rays, side, _MAX_SPREAD)
    scattered = index[(index >= 0) & ~np.isin(index, place)]
    full, partial_packets, without = _sorted(scattered, rays[None], side * side)
    squares = _as_squares(full)
    near = fit_grid(squares, rays, side).spread <= _MAX_SORTED_SPREAD
    points = _in_points(full[~near], partial_packets)
    return np.concatenate([place, squares[near], _padded(without, side * side)]), points


def unroll_rows(index: NDArray[np.int64], rays: NDArray[np.float64]) -> NDArray[np.int64]:
    """Roll each row of a table to align its directions with the first row's: lidar beams have azimuth offsets."""
    waves = np.fft.rfft(np.where((index >= 0)[..., None], rays[index], 0.0), axis=1)
    alike = np.fft.irfft((waves * waves[:1].conj()).sum(axis=-1), n=index.shape[1], axis=1)
    start = alike.argmax(axis=1)[:, None]
    return np.take_along_axis(index, (start + np.arange(index.shape[1])) % index.shape[1], axis=1)


def _sorted(
    items: NDArray[np.int64], rays: NDArray[np.float64], size: int
) -> tuple[NDArray[np.int64], list[NDArray[np.int64]], NDArray[np.int64]]:
    """Sort rays of a table, shape (H, W, 3), by direction; return full packets, partial ones, items without a ray."""
    split, flat = split_rays(rays), rays.reshape(-1, 3)
    face = split.face.ravel()[items]
    full, partial_packets = [np.zeros((0, size), dtype=np.int64)], []
    for number in range(len(split.axes)):
        parts = list(_split(items[face == number], split.positions, flat, size))
        full += [packet[None] for packet in parts if len(packet) == size]
        partial = [packet for packet in parts if len(packet) < size]
        partial_packets += [
            np.concatenate(list(_split(packet, split.positions, flat, CUDA_LANES))) for packet in partial
        ]
    return _halved(np.concatenate(full), split.positions), partial_packets, items[face < 0]


def _in_points(full: NDArray[np.int64], partial_packets: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Return packets of points, filled with sorted rays."""
    return np.concatenate([_padded(packet.ravel(), POINTS) for packet in (full, *partial_packets)])


def _padded(items: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """Split items into packets of `size`, the last one padded with -1."""
    return np.pad(items, (0, -len(items) % size), constant_values=-1).reshape(-1, size)


def _split(items: NDArray, places: NDArray, rays: NDArray, size: int) -> Iterator[NDArray[np.int64]]:
    """Halve rays along their longest axis until each part fits a packet and its directions are close."""
    if not len(items):
        return
    directions = rays[items] / np.linalg.norm(rays[items], axis=-1, keepdims=True)
    mean_direction = directions.mean(axis=0)
    if len(items) <= size and (directions @ mean_direction >= _MIN_COSINE * np.linalg.norm(mean_direction)).all():
        yield items
        return
    positions = places[items]
    order = np.argsort(positions[:, int(np.argmax(np.ptp(positions, axis=0)))], kind="stable")
    # All but the last are full.
    cut = size * -(-len(items) // (2 * size)) if len(items) > size else len(items) // 2
    yield from _split(items[order[:cut]], places, rays, size)
    yield from _split(items[order[cut:]], places, rays, size)


def _halved(full: NDArray[np.int64], places: NDArray) -> NDArray[np.int64]:
    """Sort the rays of packets, whose size is a power of two, by halving alternately by columns and rows."""
    size = full.shape[1]
    for level in range(size.bit_length() - 1):
        halves = full.reshape(-1, size >> level)
        order = np.argsort(places[halves, level % 2], axis=-1, kind="stable")
        full = np.take_along_axis(halves, order, axis=-1)
    return full.reshape(-1, size)


def _as_squares(halved: NDArray[np.int64]) -> NDArray[np.int64]:
    """Reorder rays sorted by `_halved` into rows and columns of squares."""
    size = halved.shape[1]
    levels = size.bit_length() - 1
    rows, columns = range(2, levels + 1, 2), range(1, levels, 2)
    return halved.reshape(-1, *((2,) * levels)).transpose(0, *rows, *columns).reshape(-1, size)


def z_buffer_order(side: int) -> NDArray[np.int64]:
    """Return the pixel, row by row, of each z-buffer entry: the inverse of the index in ``native/cuda/image.h``."""
    y, x = np.divmod(np.arange(side * side), side)
    columns = side // _BLOCK_WIDTH
    block = y // _BLOCK_HEIGHT * columns + x // _BLOCK_WIDTH
    pixel = y % _BLOCK_HEIGHT * _BLOCK_WIDTH + x % _BLOCK_WIDTH
    index = block * CUDA_LANES + (pixel + block % columns * (CUDA_LANES // columns)) % CUDA_LANES
    return np.argsort(index)


def _cut(values: NDArray, columns: int, side: int) -> NDArray:
    """Cut images of pixels, row by row, into windows of a side; `columns` is the number of windows along each axis."""
    rest = values.shape[2:]
    cells = values.reshape(-1, columns, side, columns, side, *rest).swapaxes(2, 3)
    return cells.reshape(-1, side * side, *rest)


def cut_table(index: NDArray[np.int64], side: int) -> NDArray[np.int64]:
    """Cut a table of indices into squares, padded with -1, shape (packets, pixels)."""
    height, width = index.shape
    index = np.pad(index, ((0, -height % side), (0, -width % side)), constant_values=-1)
    rows, columns = (length // side for length in index.shape)
    return index.reshape(rows, side, columns, side).transpose(0, 2, 1, 3).reshape(-1, side * side)
