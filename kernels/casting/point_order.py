# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Spatial sorting of image points for packets on CUDA.

Points in rows, such as the pixels of an image, are not sorted. Other points are counting-sorted by the cells of a grid,
in the order of a Hilbert curve, so that consecutive points are close. The order of points within a cell is arbitrary
and does not change results: see ``native/cuda/points.h``.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

POINTS_PER_THREAD = 8
"""Points per thread."""

BLOCK_COLUMNS, BLOCK_ROWS = 8, 4
"""Size of a block of points in rows, which a warp renders together."""

OUTSIDE_CELLS = wp.constant(1024)
"""Number of cells for points outside the image; points are distributed over them to reduce contention of atomics."""

SPREAD_UNIT = wp.constant(8.0)
"""Scale of the integers in `PointLists.spread`, per pixel."""

MAX_SPREAD = wp.constant(8)
"""Limit of a block's contribution to `PointLists.spread`, as a multiple of the permitted spread."""


@wp.struct
class PointLists:
    """Image points of all views, the same number in each view."""

    pixels: wp.array2d[wp.vec2]
    """(view, point): from the image's corner [px]."""
    used: wp.array[wp.int32]
    """(view): number of points that are cast, in the order of the list; None if all are, in rows or sorted."""
    step: int
    """Number of warps per view: each casts every `step`-th packet of the used points."""
    columns: int
    """Number of points per row, if the points are in rows."""
    spread: wp.array[wp.int32]
    """(view): sum of the spread of sampled blocks beyond the permitted spread; a view is sorted if positive."""
    cells: int
    """Number of cells per view: those of the grid, and `OUTSIDE_CELLS`."""
    counts: wp.array[wp.int32]
    """(view, cell), flattened: number of points in the cell that are not yet in `order`."""
    ends: wp.array[wp.int32]
    """(view, cell), flattened: end of the cell's points in `order`."""
    order: wp.array[wp.int32]
    """Point indices of the sorted views, one view after the other."""


@wp.func
def is_inside(pixel: wp.vec2, width: float, height: float) -> bool:
    return pixel[0] >= 0.0 and pixel[0] < width and pixel[1] >= 0.0 and pixel[1] < height


@wp.func
def along_hilbert(x: int, y: int, bits: int) -> int:
    """Return a cell's index along a Hilbert curve (Hamilton and Rau-Chaplin 2008): two bits per level of quadrants."""
    index = int(0)
    column, row = int(x), int(y)
    last = (1 << bits) - 1
    for level in range(bits):
        bit = bits - 1 - level
        right, below = (column >> bit) & 1, (row >> bit) & 1
        index = (index << 2) | ((3 * right) ^ below)
        if below == 0:
            rotated = row
            if right == 1:
                rotated, column = last - row, last - column
            row = column
            column = rotated
    return index


@wp.func
def cell_of(pixel: wp.vec2, point: int, width: float, height: float, bits: int) -> int:
    """Return the cell of a point: one of the last `OUTSIDE_CELLS` if the point is outside the image."""
    cell = (1 << (2 * bits)) + point % OUTSIDE_CELLS
    if is_inside(pixel, width, height):
        last = (1 << bits) - 1
        side = float(1 << bits)
        cell = along_hilbert(
            wp.min(int(pixel[0] / width * side), last), wp.min(int(pixel[1] / height * side), last), bits
        )
    return cell


@wp.kernel
def measure_blocks(
    # In:
    pixels: wp.array2d[wp.vec2],
    columns: int,
    width: float,
    height: float,
    step: int,
    max_spread: float,
    # Out:
    spread_out: wp.array[wp.int32],
):
    """Sum by how much the corners of sampled blocks of 8x4 points in rows spread farther than `max_spread` [px].

    In every row of blocks, each `step`-th block is sampled. `spread_out` must be 0 before the launch.
    """
    view, block_y, i = wp.tid()
    y, x = block_y * BLOCK_ROWS, i * step * BLOCK_COLUMNS
    rows = pixels.shape[1] // columns
    low, high = wp.vec2(wp.inf, wp.inf), wp.vec2(-wp.inf, -wp.inf)
    for corner in range(4):
        column = wp.min(x + (corner & 1) * (BLOCK_COLUMNS - 1), columns - 1)
        row = wp.min(y + (corner >> 1) * (BLOCK_ROWS - 1), rows - 1)
        point = pixels[view, row * columns + column]
        if is_inside(point, width, height):
            low, high = wp.min(low, point), wp.max(high, point)
    if high[0] >= low[0]:
        beyond = (high[0] - low[0]) + (high[1] - low[1]) - max_spread
        wp.atomic_add(spread_out, view, int(wp.min(beyond, float(MAX_SPREAD) * max_spread) * SPREAD_UNIT))


@wp.kernel
def count_points(
    # In:
    width: float,
    height: float,
    bits: int,
    # Out:
    points_out: PointLists,
):
    """Count the points in each cell for views that need sorting. `counts` must be 0 before the launch."""
    view, i = wp.tid()
    if points_out.spread[view] <= 0:
        return
    step = (points_out.pixels.shape[1] + POINTS_PER_THREAD - 1) // POINTS_PER_THREAD
    for k in range(POINTS_PER_THREAD):
        point = k * step + i
        if point < points_out.pixels.shape[1]:
            cell = cell_of(points_out.pixels[view, point], point, width, height, bits)
            wp.atomic_add(points_out.counts, view * points_out.cells + cell, 1)


@wp.kernel
def sort_points(
    # In:
    width: float,
    height: float,
    bits: int,
    # Out:
    points_out: PointLists,
):
    """Fill `order` from counts and ends. The counts are 0 afterwards."""
    view, i = wp.tid()
    if points_out.spread[view] <= 0:
        return
    step = (points_out.pixels.shape[1] + POINTS_PER_THREAD - 1) // POINTS_PER_THREAD
    for k in range(POINTS_PER_THREAD):
        point = k * step + i
        if point < points_out.pixels.shape[1]:
            cell = view * points_out.cells + cell_of(points_out.pixels[view, point], point, width, height, bits)
            points_out.order[points_out.ends[cell] - wp.atomic_sub(points_out.counts, cell, 1)] = point


@wp.kernel
def clear_unused(
    # In:
    used: wp.array[wp.int32],
    # Out:
    points_out: wp.array2d[wp.vec2],
):
    """Write NaN to the points of each view that are not used, so that their rays hit nothing."""
    view, point = wp.tid()
    if point >= used[view]:
        points_out[view, point] = wp.vec2(wp.nan, wp.nan)
