# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CUDA for image points: sorting of the points into packets, and the launch."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING

import warp as wp

from warpvis.cameras.pinhole import Camera
from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import CUDA_LANES
from warpvis.rendering.casters.base import CastOptions, ImagesByName, ViewBatch, images_struct, needs_ids
from warpvis.rendering.casters.found_objects_cuda import nothing_found

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.kernels.casting.point_order import PointLists

# With fewer points per view, single rays are faster. The limit is independent of the number of views, so that the
# last digits of a view's results are too.
_MIN_POINTS = 1 << 15
# Pairs of the number of points in a packet and the number of such packets per multiprocessor from which it is used.
_PACKETS = ((256, 24), (64, 0))
# Packets have the size for one in this many points if the host does not know how many are used.
_MIN_USED = 16
# Number of warps for points whose number the host does not know, per multiprocessor: enough that they end together.
_WARPS_PER_PROCESSOR = 256
# Maximum number of points sorted at a time: 4 bytes each, plus at most half as much for cells.
_MAX_POINTS = 1 << 26
# Maximum size of blocks of points in rows, relative to that of evenly spaced points.
_MAX_STRETCH = 2.5
# One in this many blocks of points in rows is measured.
_MEASURED_STEP = 4
# Maximum number of points in a cell for uniformly distributed points.
_POINTS_PER_CELL = 8
_MAX_BITS = 12  # of a cell's column index


def takes_packets(count: int) -> bool:
    """Return whether a view with `count` points is cast in packets."""
    return _MIN_POINTS <= count <= _MAX_POINTS


def cast_point_packets(
    scene: BvhScene, camera: Camera, options: CastOptions, views: ViewBatch, images: ImagesByName
) -> None:
    """Cast through image points in packets.

    Args:
        scene: The acceleration structures.
        camera: The camera of all views.
        options: Options of the caster.
        views: The views, with image points on the device.
        images: Images of the shape of the points.
    """
    pixels, count = views.pixels, views.count
    assert pixels is not None  # callers cast pixel centers otherwise
    step = max(1, _MAX_POINTS // (pixels.shape[1] * pixels.shape[2])) if views.used is None else count
    for first in range(0, count, step):
        part = slice(first, min(first + step, count))
        rows = {name: image[part] for name, image in images.items()}
        _cast(scene, camera, options, views if step >= count else views.part(part), rows)


def _cast(scene: BvhScene, camera: Camera, options: CastOptions, views: ViewBatch, images: ImagesByName) -> None:
    assert views.pixels is not None
    pixels, worlds, clip = views.pixels, views.worlds, options.clip_near
    moving = scene.drawn_count > 0
    lists = lists_of(views, camera)
    processors = pixels.device.sm_count
    size = packet_size(pixels.size if views.used is None else pixels.size // _MIN_USED, processors)
    packets = packet_count(lists, size)
    if views.used is not None:
        packets = lists.step = min(packets, -(-_WARPS_PER_PROCESSOR * processors // views.count))
    launch(
        _kernel(
            size,
            needs_ids(images),
            moving,
            clip,
            moving and worlds.object_sizes is not None,
            views.used is not None,
        ),
        (packets, views.count, 1, CUDA_LANES),
        [
            scene,
            camera.device_struct(clip_near=clip),
            views.poses_on(pixels.device),
            worlds,
            nothing_found(),
            lists,
            options.cull_backfaces,
            images_struct(images),
        ],
        pixels.device,
        block_dim=CUDA_LANES,
    )


def packet_size(points: int, processors: int) -> int:
    """Return the number of points in a packet: the largest that leaves enough packets for all multiprocessors."""
    return next(size for size, min_packets in _PACKETS if points >= size * min_packets * processors)


def packet_count(lists: PointLists, size: int) -> int:
    """Return the number of packets of `size` points per view, enough for points in rows and for sorted points."""
    count = lists.pixels.shape[1]
    if lists.used is not None:
        return -(-count // size)
    side = math.isqrt(size)
    rows = count // max(1, lists.columns)
    squares = -(-lists.columns // side) * -(-rows // side)
    return max(squares, -(-count // size))


def lists_of(views: ViewBatch, camera: Camera) -> PointLists:
    """Return the lists of points that packets read: in the order of `views.used` if it is given."""
    from warpvis.kernels.casting.point_order import PointLists

    assert views.pixels is not None
    pixels = views.pixels.contiguous()
    if views.used is None:
        lists = list_points(pixels, camera)
    else:
        lists = PointLists()
        lists.pixels, lists.used = pixels.reshape((pixels.shape[0], -1)), views.used
    return lists


def list_points(pixels: wp.array, camera: Camera) -> PointLists:
    """Check for each view whether its points are in rows, like the pixels of an image, and sort them otherwise.

    Args:
        pixels: Points [px], vec2 of shape ``(V, Y, X)``, contiguous. Lists, with Y = 1, may contain rows too.
        camera: The camera of all views.

    Returns:
        The point lists that packets read, on the same device.
    """
    from warpvis.kernels.casting.point_order import OUTSIDE_CELLS, PointLists, count_points, sort_points

    (views, rows, columns), device = pixels.shape, pixels.device
    count = rows * columns
    lists, bits = PointLists(), _cell_bits(count)
    lists.pixels, lists.cells = pixels.reshape((views, count)), (1 << 2 * bits) + int(OUTSIDE_CELLS)
    lists.columns = columns if rows > 1 else guess_columns(count, camera)
    lists.spread = _measure(lists.pixels, lists.columns, camera)
    lists.counts = wp.zeros(views * lists.cells, dtype=wp.int32, device=device)
    lists.ends = wp.empty(views * lists.cells, dtype=wp.int32, device=device)
    lists.order = wp.empty(views * count, dtype=wp.int32, device=device)
    inputs = [float(camera.width), float(camera.height), bits, lists]
    launch(count_points, _threads(views, count), inputs, device)
    wp.utils.array_scan(lists.counts, lists.ends, inclusive=True)
    launch(sort_points, _threads(views, count), inputs, device)
    return lists


def guess_columns(count: int, camera: Camera) -> int:
    """Return the number of points per row for equal spacing in both directions; 0 if it does not divide `count`."""
    columns = round(math.sqrt(count * camera.width / camera.height))
    return columns if columns > 0 and count % columns == 0 else 0


def _cell_bits(count: int) -> int:
    return min(_MAX_BITS, (1 + (count // _POINTS_PER_CELL).bit_length()) // 2)


def _threads(views: int, count: int) -> tuple[int, int]:
    from warpvis.kernels.casting.point_order import POINTS_PER_THREAD

    return views, -(-count // POINTS_PER_THREAD)


def _measure(pixels: wp.array, columns: int, camera: Camera) -> wp.array:
    """Sum up by how much blocks of points in rows exceed the allowed size, shape ``(V,)``; 1 without rows.

    Points are sorted where the sum is positive.
    """
    from warpvis.kernels.casting.point_order import BLOCK_COLUMNS, BLOCK_ROWS, measure_blocks

    (views, count), device = pixels.shape, pixels.device
    if not columns:
        return wp.ones(views, dtype=wp.int32, device=device)
    excess = wp.zeros(views, dtype=wp.int32, device=device)
    spacing = math.sqrt(camera.width * camera.height / count)
    max_size = _MAX_STRETCH * (BLOCK_COLUMNS + BLOCK_ROWS) * spacing
    block_columns = -(-columns // (BLOCK_COLUMNS * _MEASURED_STEP))
    inputs = [pixels, columns, float(camera.width), float(camera.height), _MEASURED_STEP, max_size, excess]
    launch(measure_blocks, (views, -(-(count // columns) // BLOCK_ROWS), block_columns), inputs, device)
    return excess


@cache
def _kernel(points: int, with_id: bool, movable: bool, clip: bool, resized: bool, used: bool) -> wp.Kernel:
    from warpvis.kernels.casting.packets_cuda import make_packet_kernel

    return make_packet_kernel(32, with_id, movable, clip, resized, points, used)
