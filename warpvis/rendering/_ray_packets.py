# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rays of a table as packets draw them on a GPU: blocks of neighbours, each in an image of its own.

All in double precision, once for a table. What is made of it is in ``kernels/native/cuda/table.h``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.kernels.constants import CUDA_LANES
from warpvis.kernels.ray_packets_cuda import FRAME_WORDS
from warpvis.rendering._ray_bundles import split_rays

if TYPE_CHECKING:
    from warpvis.kernels.ray_packets_cuda import RayPackets

# Sides of packets [px]; large ones are faster where there are enough of them in one view.
_LARGE_SIDE, _SMALL_SIDE = 32, 16
_MANY_RAYS = 200_000
# Of the pixels that a warp looks at together.
_BLOCK_WIDTH, _BLOCK_HEIGHT = 8, 4
# Rays of a packet are no farther than this from its middle: the cosine.
_LEAST_COSINE = 0.5
# And of rays from where their image looks.
_LEAST_AHEAD = 0.3
# Rays of neighbours in the table that are farther than this from their pixels' centres are sorted instead.
_MOST_SPREAD = 1.5
# Packets of 32x32 have nearer ones, and few pixels without.
_MOST_LARGE_SPREAD, _LEAST_FILL = 0.4, 0.6
# So far apart from them, rays are scattered.
_SCATTERED = 0.4
# Of what is sorted, squares that are farther leave some pixels without a ray instead.
_MOST_SORTED_SPREAD = 1.0
# Rays in cells of a grid, one each, leave others for the next round.
_MOST_ROUNDS = 12
_MARGIN = 1e-3  # of bounds [px]
# Where pixels would be more than so many times as high as wide, rays are all in a line, and pixels are squares. Of one
# ray, there are so many of them a radian.
_NARROWEST = 1e5
_PLAIN_FOCAL = 256.0


@dataclass(frozen=True)
class PreparedPackets:
    """A table of rays for packets on a GPU."""

    packets: list[tuple[int, RayPackets]]
    """Sides of packets, and the packets: one or two kinds."""
    is_scattered: bool
    """Whether rays are not in rows and columns, and pass far from the centres of most packets' pixels."""


def prepare_packets(rays: NDArray[np.float64], device: wp.Device) -> PreparedPackets:
    """Prepare rays of the camera frame, shape (H, W, 3), where depth is 1; NaN for pixels without one.

    What packets there are depends on nothing else: a view's last digits do not change with the number of views.
    """
    flat, index = _flat(rays), np.arange(rays.shape[0] * rays.shape[1]).reshape(rays.shape[:2])
    places = []
    if len(flat) >= _MANY_RAYS:
        place = _near_blocks(index, flat, _LARGE_SIDE, _MOST_LARGE_SPREAD)
        full = (place >= 0).mean(axis=1) >= _LEAST_FILL
        places.append((_LARGE_SIDE, place[full]))
        index = np.where(np.isin(index, place[full]), -1, index)
    places.append((_SMALL_SIDE, _arrange(index, flat, _SMALL_SIDE)))
    made = [(side, _Images(place, flat, side)) for side, place in places if len(place)]
    spread = np.concatenate([np.zeros(1), *(images.spread for _, images in made)])
    return PreparedPackets(
        [(side, _to_device(images, side, len(flat), device)) for side, images in made],
        bool(np.median(spread) > _SCATTERED),
    )


def prepare_all(rays: NDArray[np.float64], side: int, device: wp.Device) -> RayPackets:
    """Prepare rays likewise in packets of one side."""
    flat, index = _flat(rays), np.arange(rays.shape[0] * rays.shape[1]).reshape(rays.shape[:2])
    return _to_device(_Images(_arrange(index, flat, side), flat, side), side, len(flat), device)


def _flat(rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rays in a row; zeros for those that are none."""
    flat = rays.reshape(-1, 3)
    return np.where(np.isfinite(flat).all(axis=-1, keepdims=True), flat, 0.0)


def _to_device(images: _Images, side: int, pixels: int, device: wp.Device) -> RayPackets:
    from warpvis.kernels.ray_packets_cuda import RayPackets

    packets, order = RayPackets(), _z_buffer_order(side)
    packets.frame = wp.array(images.frames(), dtype=wp.float64, device=device)
    rounded, rest = images.rounded, (images.exact - images.rounded).astype(np.float32)
    scale = np.where(images.there, 1 / images.ahead, 0.0).astype(np.float32)
    packets.points = wp.array(rounded[:, order], dtype=wp.vec2, device=device)
    packets.rests = wp.array(rest[:, order], dtype=wp.vec2, device=device)
    packets.scale = wp.array(scale[:, order], dtype=wp.float32, device=device)
    packets.place = wp.array(images.place[:, order].astype(np.int32), dtype=wp.int32, device=device)
    packets.pixels = pixels
    return packets


class _Images:
    """Packets' images: rays, zeros for none, in the pixels that places name."""

    def __init__(self, place: NDArray[np.int64], rays: NDArray[np.float64], side: int) -> None:
        """Turn, scale and shear them so that rays pass near the centres of pixels."""
        given, pixels = _rays_of(place, rays), _grid(side)
        middles = _middles(given)
        # Facing their rays, most images are the straightest; what is sorted by its places in a face is so there.
        bases = np.stack([_basis(middles), _basis(_nearest_axes(middles))])
        fits = [_fit(given, basis, pixels) for basis in bases]
        best = np.argmin([fit.spread for fit in fits], axis=0)
        index = np.arange(len(place))
        basis, mirrored = bases[best, index], np.array([np.linalg.det(fit.linear) < 0 for fit in fits])[best, index]
        # In a mirrored image, triangles would turn their backs.
        self.place = np.where(mirrored[:, None], place.reshape(-1, side, side)[..., ::-1].reshape(place.shape), place)
        given = _rays_of(self.place, rays)
        fit = _fit(given, basis, pixels)
        self.there, self.first, self.ahead, self.spread = fit.there, fit.first, fit.ahead, fit.spread + _MARGIN
        self.exact = np.where(fit.there[..., None], fit.places @ fit.linear.transpose(0, 2, 1), fit.centers)
        self.rounded = self.exact.astype(np.float32)
        self.matrix = basis.copy()
        self.matrix[:, :2] = fit.linear @ basis[:, :2]
        length = np.linalg.norm(given, axis=-1)
        self.cosine = np.where(self.there, self.ahead / np.where(self.there, length, 1.0), 1.0).min(axis=1)

    def frames(self) -> NDArray[np.float64]:
        """Make rows of a `TableFrame` each."""
        matrix = self.matrix
        rows = [
            matrix.reshape(-1, 9),
            np.linalg.inv(matrix).transpose(0, 2, 1).reshape(-1, 9),
            self.first,
            self.spread[:, None],
            np.linalg.norm(matrix[:, :2], axis=-1),
            np.linalg.svd(matrix[:, :2], compute_uv=False)[:, 1:],
            np.where(self.there, self.ahead, 0.0).max(axis=1)[:, None],
        ]
        table = np.concatenate(rows, axis=1)
        assert table.shape[1] == FRAME_WORDS
        return table


def _near_blocks(index: NDArray[np.int64], rays: NDArray, side: int, most_spread: float) -> NDArray[np.int64]:
    """Cut a table into squares; return those whose rays pass near their pixels' centres, shape (packets, pixels)."""
    unrolled = _unrolled(index, rays)
    tables = [index] if (unrolled == index).all() else [index, unrolled]
    cuts = [_blocks(table, side) for table in tables]
    images = [_Images(place, rays, side) for place in cuts]
    best = int(np.argmin([np.median(image.spread) for image in images]))
    near = (images[best].spread <= most_spread) & (images[best].cosine >= _LEAST_COSINE)
    return cuts[best][near & (cuts[best] >= 0).any(axis=1)]


def _arrange(index: NDArray[np.int64], rays: NDArray[np.float64], side: int) -> NDArray[np.int64]:
    """Choose packets: the index of every pixel's ray, -1 for none, shape (packets, pixels).

    They are squares of the table where rays that are neighbours there are so in space, and of the others groups that
    are sorted by where they look.
    """
    place = _near_blocks(index, rays, side, _MOST_SPREAD)
    others = index[(index >= 0) & ~np.isin(index, place)]
    split = split_rays(rays.reshape(*index.shape, 3))
    face = split.face.ravel()[others]
    packets = [place, _padded(others[face < 0], side * side)]
    for number in range(len(split.axes)):
        packets += _sort(others[face == number], split.places, rays, side)
    return np.concatenate(packets)


def _unrolled(index: NDArray[np.int64], rays: NDArray[np.float64]) -> NDArray[np.int64]:
    """Roll each row of a table to where its rays look as the first row's: lidars' beams look aside of each other."""
    waves = np.fft.rfft(np.where((index >= 0)[..., None], rays[index], 0.0), axis=1)
    alike = np.fft.irfft((waves * waves[:1].conj()).sum(axis=-1), n=index.shape[1], axis=1)
    start = alike.argmax(axis=1)[:, None]
    return np.take_along_axis(index, (start + np.arange(index.shape[1])) % index.shape[1], axis=1)


def _sort(items: NDArray[np.int64], places: NDArray, rays: NDArray, side: int) -> list[NDArray[np.int64]]:
    """Sort rays of a face into packets, by their places in it."""
    most = side * side
    packets: list[NDArray[np.int64]] = []
    for _ in range(_MOST_ROUNDS):
        if not len(items):
            return packets
        parts = list(_parts(items, places, rays, most))
        full = np.array([part for part in parts if len(part) == most], dtype=np.int64).reshape(-1, most)
        squares = _as_squares(full, places)
        near = _Images(squares, rays, side).spread <= _MOST_SORTED_SPREAD
        packets.append(squares[near])
        cells = [
            _as_cells(part, places, side) for part in [*squares[~near], *(part for part in parts if len(part) < most)]
        ]
        packets += [place for place, _ in cells]
        items = np.concatenate([np.zeros(0, dtype=np.int64), *(rest for _, rest in cells)])
    return packets + [_padded(part, most) for part in _parts(items, places, rays, most)]


def _padded(items: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Fill packets, the last one with nothing."""
    return np.pad(items, (0, -len(items) % most), constant_values=-1).reshape(-1, most)


def _parts(items: NDArray, places: NDArray, rays: NDArray, most: int) -> Iterator[NDArray[np.int64]]:
    """Halve rays where they are longest until each part is a packet's, and looks one way."""
    if not len(items):
        return
    some = rays[items] / np.linalg.norm(rays[items], axis=-1, keepdims=True)
    middle = some.mean(axis=0)
    if len(items) <= most and (some @ middle >= _LEAST_COSINE * np.linalg.norm(middle)).all():
        yield items
        return
    at = places[items]
    order = np.argsort(at[:, int(np.argmax(np.ptp(at, axis=0)))], kind="stable")
    # All but the last are full.
    half = most * -(-len(items) // (2 * most)) if len(items) > most else len(items) // 2
    yield from _parts(items[order[:half]], places, rays, most)
    yield from _parts(items[order[half:]], places, rays, most)


def _as_squares(full: NDArray[np.int64], places: NDArray) -> NDArray[np.int64]:
    """Sort rays of packets, as many as there are pixels, into squares: halved by columns and rows in turns."""
    most = full.shape[1]
    levels = most.bit_length() - 1
    for level in range(levels):
        halves = full.reshape(-1, most >> level)
        order = np.argsort(places[halves, level % 2], axis=-1, kind="stable")
        full = np.take_along_axis(halves, order, axis=-1)
    rows, columns = range(2, levels + 1, 2), range(1, levels, 2)
    return full.reshape(-1, *((2,) * levels)).transpose(0, *rows, *columns).reshape(-1, most)


def _as_cells(items: NDArray[np.int64], places: NDArray, side: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Put rays into the cells of a grid where they are; return them, and rays whose cells others have taken."""
    at = places[items] - places[items].min(axis=0)
    column, row = np.minimum(at * side / np.maximum(at.max(axis=0), 1e-12), side - 1).astype(np.int64).T
    cells, first = np.unique(row * side + column, return_index=True)
    place = np.full((1, side * side), -1)
    place[0, cells] = items[first]
    return place, np.delete(items, first)


def _grid(side: int) -> NDArray[np.float64]:
    """Columns and rows of a packet's pixels, row by row."""
    y, x = np.divmod(np.arange(side * side), side)
    return np.stack([x, y], axis=-1).astype(np.float64)


def _z_buffer_order(side: int) -> NDArray[np.int64]:
    """Which of the pixels, row by row, are in a z-buffer: `Packet::index` of ``native/cuda/pixels.h``."""
    x, y = _grid(side).astype(np.int64).T
    columns = side // _BLOCK_WIDTH
    block = y // _BLOCK_HEIGHT * columns + x // _BLOCK_WIDTH
    pixel = y % _BLOCK_HEIGHT * _BLOCK_WIDTH + x % _BLOCK_WIDTH
    index = block * CUDA_LANES + (pixel + block % columns * (CUDA_LANES // columns)) % CUDA_LANES
    return np.argsort(index)


def _blocks(index: NDArray[np.int64], side: int) -> NDArray[np.int64]:
    """Cut a table of indices into squares, -1 beyond the table, shape (packets, pixels)."""
    height, width = index.shape
    index = np.pad(index, ((0, -height % side), (0, -width % side)), constant_values=-1)
    rows, columns = (length // side for length in index.shape)
    return index.reshape(rows, side, columns, side).transpose(0, 2, 1, 3).reshape(-1, side * side)


def _middles(rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean directions of packets, unit vectors; zeros are no rays."""
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    total = (rays / np.where(length > 0, length, 1)).sum(axis=1)
    size = np.linalg.norm(total, axis=-1, keepdims=True)
    return np.where(size > 0, total / np.where(size > 0, size, 1), [0.0, 0.0, 1.0])


def _basis(middles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows right, down and forward of cameras that look along directions, shape (packets, 3, 3)."""
    right = np.cross(middles, np.where(np.abs(middles[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]))
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(middles, right), middles], axis=1)


def _rays_of(place: NDArray[np.int64], rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rays of packets' pixels, shape (packets, pixels, 3); zeros where there is none."""
    return np.where((place >= 0)[..., None], rays[place], 0.0)


def _nearest_axes(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the axes of the camera, and the other ways, those that are the nearest to directions."""
    axis = np.abs(directions).argmax(axis=-1)[:, None]
    ahead = np.sign(np.take_along_axis(directions, axis, axis=-1))
    nearest = np.zeros_like(directions)
    np.put_along_axis(nearest, axis, ahead, axis=-1)
    return nearest


@dataclass(frozen=True)
class _Fit:
    """Images in which rays pass near the centres of pixels."""

    there: NDArray[np.bool_]
    """Which pixels have rays, shape (packets, pixels), as of what follows."""
    ahead: NDArray[np.float64]
    """How far ahead rays of depth 1 reach; 1 where there is none."""
    places: NDArray[np.float64]
    """Where rays pass 1 ahead."""
    linear: NDArray[np.float64]
    """What makes places in the packets' images of these, shape (packets, 2, 2)."""
    first: NDArray[np.float64]
    """Place of the centre of each packet's first pixel, shape (packets, 2)."""
    centers: NDArray[np.float64]
    """Of all pixels."""
    spread: NDArray[np.float64]
    """How far rays pass from these, at most, shape (packets); endless where some look aside."""


def _fit(rays: NDArray, basis: NDArray, pixels: NDArray) -> _Fit:
    """Fit images to rays: columns and rows are linear in the places of rays, by least squares."""
    there = (rays != 0).any(axis=-1)
    flat = np.einsum("prk,pik->pir", basis, rays)
    aside = (there & (flat[..., 2] < _LEAST_AHEAD * np.linalg.norm(rays, axis=-1))).any(axis=1)
    ahead = np.where(there & ~aside[:, None], flat[..., 2], 1.0)
    places = flat[..., :2] / ahead[..., None]
    count = np.maximum(there.sum(axis=1), 1)[:, None]
    mean = (places * there[..., None]).sum(axis=1) / count
    grid = pixels * there[..., None]
    grid_mean = grid.sum(axis=1) / count
    apart = (places - mean[:, None]) * there[..., None]
    normal = np.einsum("pia,pib->pab", apart, apart)
    wanted = np.einsum("pia,pib->pab", apart, grid - grid_mean[:, None])
    linear = np.linalg.pinv(normal, rcond=1e-12, hermitian=True) @ wanted
    # Rays that are too few, or all in a line, leave some of it open.
    left, size, right = np.linalg.svd(linear.transpose(0, 2, 1))
    size[size[:, 0] < 1e-6] = _PLAIN_FOCAL
    narrow = size[:, 1] < size[:, 0] / _NARROWEST
    size[narrow, 1] = size[narrow, 0]
    left[narrow, :, 1] *= np.sign(np.linalg.det(left @ right))[narrow, None]
    linear = (left * size[:, None]) @ right
    first = np.einsum("pab,pb->pa", linear, mean) - grid_mean
    centers = first[:, None] + pixels
    off = np.abs(places @ linear.transpose(0, 2, 1) - centers) * there[..., None]
    spread = np.where(aside, np.inf, off.max(axis=(1, 2), initial=0))
    return _Fit(there, ahead, places, linear, first, centers, spread)
