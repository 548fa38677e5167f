# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of edge pixels, which see several surfaces, and placement of sub-rays within them."""

import warp as wp

from warpvis.kernels.casting.point_order import along_hilbert
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate, pose_rotation
from warpvis.kernels.sensors.noise import SensorInputs

wp.set_module_options(pixel_options("shared/sub_rays.h"))

SUB_RAYS = wp.constant(16)  # of an edge pixel
TILE_PIXELS = wp.constant(16)  # per tile; tiles are placed side by side in a map of sub-rays


@wp.kernel
def find_axes(
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    # Out:
    axes_out: wp.array[wp.mat33],
):
    """Write each camera's axes in the world, as columns."""
    view = wp.tid()
    axes_out[view] = wp.mat33(wp.quat_to_matrix(pose_rotation(camera_to_world[view])))


@wp.func_native(
    """
warpvis::measure<warpvis::FlightEdges>(warpvis::sensor_row(inputs, view, y), x, axes, edge_step, edges_out);
"""
)
def find_pixel_edges(
    axes: wp.mat33,
    inputs: SensorInputs,
    edge_step: float,
    view: int,
    y: int,
    x: int,
    edges_out: wp.array3d[wp.int32],
): ...


@wp.kernel(cuda_max_registers=64)
def find_edges(
    # Cameras:
    axes: wp.array[wp.mat33],
    window: Window,
    # In:
    inputs: SensorInputs,
    edge_step: float,
    # Out:
    edges_out: wp.array3d[wp.int32],
):
    """Write the row-major index of each pixel that is at an edge between surfaces, and -1 for other pixels."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    find_pixel_edges(axes[view], inputs, edge_step, view, y, x, edges_out)


TILE_SIDE = wp.constant(8)  # of tiles in which edge pixels are numbered [px]


@wp.struct
class EdgeTiles:
    """Tiles of the images in the order of a Hilbert curve: numbers of edge pixels, (tile of a view), flattened."""

    bits: int  # log2 of the number of tiles along a side of the curve
    counts: wp.array[wp.int32]  # edge pixels that are not numbered yet
    ends: wp.array[wp.int32]  # sum of the numbers of edge pixels up to this tile


@wp.func
def tile_of(tiles: EdgeTiles, view: int, strip: int, x: int) -> int:
    """Return the tile of a strip, which is a column of a tile."""
    return (view << 2 * tiles.bits) + along_hilbert(x // TILE_SIDE, strip, tiles.bits)


@wp.func
def edges_in_strip(edges: wp.array3d[wp.int32], view: int, strip: int, x: int) -> int:
    count = int(0)
    for y in range(strip * TILE_SIDE, wp.min((strip + 1) * TILE_SIDE, edges.shape[1])):
        if edges[view, y, x] >= 0:
            count += 1
    return count


@wp.kernel
def count_edges(
    # In:
    edges: wp.array3d[wp.int32],
    # Out:
    tiles_out: EdgeTiles,
):
    """Count the edge pixels of each tile. The counts must be 0 before the launch."""
    view, strip, x = wp.tid()
    count = edges_in_strip(edges, view, strip, x)
    if count > 0:
        wp.atomic_add(tiles_out.counts, tile_of(tiles_out, view, strip, x), count)


@wp.kernel
def number_edges(
    # Out:
    tiles_out: EdgeTiles,
    edges_out: wp.array3d[wp.int32],
    pixels_out: wp.array2d[wp.int32],
    counts_out: wp.array[wp.int32],
):
    """Number the edge pixels of each view, tile after tile, so that neighbors have similar numbers.

    `edges_out` contains pixel indices on input and edge numbers on output; `pixels_out` is the inverse mapping.
    `counts_out` is the number of edge pixels of each view. Within a tile, the order is arbitrary.
    """
    view, strip, x = wp.tid()
    last = ((view + 1) << 2 * tiles_out.bits) - 1
    first = int(0)
    if view > 0:
        first = tiles_out.ends[(view << 2 * tiles_out.bits) - 1]
    if strip == 0 and x == 0:
        counts_out[view] = tiles_out.ends[last] - first
    count = edges_in_strip(edges_out, view, strip, x)
    if count == 0:
        return
    tile = tile_of(tiles_out, view, strip, x)
    number = tiles_out.ends[tile] - wp.atomic_sub(tiles_out.counts, tile, count) - first
    for y in range(strip * TILE_SIDE, wp.min((strip + 1) * TILE_SIDE, edges_out.shape[1])):
        pixel = edges_out[view, y, x]
        if pixel >= 0:
            edges_out[view, y, x] = number
            pixels_out[view, number] = pixel
            number += 1


@wp.func_native("warpvis::place_sub_rays(pixels, first, width, view, y, x, points_out);")
def place(
    pixels: wp.array2d[wp.int32],
    first: int,
    width: int,
    view: int,
    y: int,
    x: int,
    points_out: wp.array3d[wp.vec2],
): ...


@wp.kernel
def place_sub_rays(
    window: Window,
    # In:
    pixels: wp.array2d[wp.int32],
    first: int,
    width: int,
    # Out:
    points_out: wp.array3d[wp.vec2],
):
    """Write the image coordinates [px] of 4 x 4 sub-rays for each edge pixel from `first` on; NaN for pixel -1.

    A tile of 16 columns and rows of the map belongs to 16 pixels in row-major order. Each pixel has one sub-ray in each
    of 16 equal squares, and in each of 16 rows and 16 columns. On CUDA, each thread writes one sub-ray, so that
    adjacent threads write adjacent memory.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    place(pixels, first, width, view, y, x, points_out)


@wp.kernel
def list_sub_rays(
    # In:
    pixels: wp.array2d[wp.int32],
    counts: wp.array[wp.int32],
    first: int,
    width: int,
    step: int,
    # Out:
    points_out: wp.array2d[wp.vec2],
    used_out: wp.array[wp.int32],
):
    """Write the sub-rays of `place_sub_rays` pixel by pixel, for edge pixels from `first` on.

    `points_out` has room for a part of the pixels of a view; `used_out` is the number of points written. A thread
    writes one in `step` points.
    """
    view, thread = wp.tid()
    used = wp.clamp((counts[view] - first) * SUB_RAYS, 0, points_out.shape[1])
    if thread == 0:
        used_out[view] = used
    for i in range(thread, used, step):
        pixel, k = pixels[view, first + i // SUB_RAYS], i % SUB_RAYS
        column, row = k % 4, k // 4
        u = (float(column) + (float(row) + 0.5) * 0.25) * 0.25
        v = (float(row) + (float(column) + 0.5) * 0.25) * 0.25
        points_out[view, i] = wp.vec2(float(pixel % width) + u, float(pixel // width) + v)
