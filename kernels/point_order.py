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

APART_UNIT = wp.constant(8.0)
"""Scale of the integers in `PointLists.apart`, per pixel."""

MAX_APART = wp.constant(8)
"""Limit of a block's contribution to `PointLists.apart`, as a multiple of the permitted spread."""


@wp.struct
class PointLists:
    """Image points of all views, the same number in each view."""

    at: wp.array2d[wp.vec2]
    """(view, point): from the image's corner [px]."""
    columns: int
    """Number of points per row, if the points are in rows."""
    apart: wp.array[wp.int32]
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
def is_inside(at: wp.vec2, width: float, height: float) -> bool:
    return at[0] >= 0.0 and at[0] < width and at[1] >= 0.0 and at[1] < height


@wp.func
def along_hilbert(x: int, y: int, bits: int) -> int:
    """Return a cell's index along a Hilbert curve (Hamilton and Rau-Chaplin 2008): two bits per level of quadrants."""
    place = int(0)
    column, row = int(x), int(y)
    last = (1 << bits) - 1
    for level in range(bits):
        bit = bits - 1 - level
        right, below = (column >> bit) & 1, (row >> bit) & 1
        place = (place << 2) | ((3 * right) ^ below)
        if below == 0:
            turned = row
            if right == 1:
                turned, column = last - row, last - column
            row = column
            column = turned
    return place


@wp.func
def cell_of(at: wp.vec2, point: int, width: float, height: float, bits: int) -> int:
    """Return the cell of a point: one of the last `OUTSIDE_CELLS` if the point is outside the image."""
    cell = (1 << (2 * bits)) + point % OUTSIDE_CELLS
    if is_inside(at, width, height):
        last = (1 << bits) - 1
        side = float(1 << bits)
        cell = along_hilbert(wp.min(int(at[0] / width * side), last), wp.min(int(at[1] / height * side), last), bits)
    return cell


@wp.kernel
def measure_blocks(
    # In:
    at: wp.array2d[wp.vec2],
    columns: int,
    width: float,
    height: float,
    step: int,
    most: float,
    # Out:
    apart_out: wp.array[wp.int32],
):
    """Sum by how much the corners of sampled blocks of 8x4 points in rows spread farther than `most` [px].

    In every row of blocks, each `step`-th block is sampled. `apart_out` must be 0 before the launch.
    """
    view, block_y, i = wp.tid()
    y, x = block_y * BLOCK_ROWS, i * step * BLOCK_COLUMNS
    rows = at.shape[1] // columns
    least, greatest = wp.vec2(wp.inf, wp.inf), wp.vec2(-wp.inf, -wp.inf)
    for corner in range(4):
        column = wp.min(x + (corner & 1) * (BLOCK_COLUMNS - 1), columns - 1)
        row = wp.min(y + (corner >> 1) * (BLOCK_ROWS - 1), rows - 1)
        here = at[view, row * columns + column]
        if is_inside(here, width, height):
            least, greatest = wp.min(least, here), wp.max(greatest, here)
    if greatest[0] >= least[0]:
        beyond = (greatest[0] - least[0]) + (greatest[1] - least[1]) - most
        wp.atomic_add(apart_out, view, int(wp.min(beyond, float(MAX_APART) * most) * APART_UNIT))


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
    if points_out.apart[view] <= 0:
        return
    step = (points_out.at.shape[1] + POINTS_PER_THREAD - 1) // POINTS_PER_THREAD
    for k in range(POINTS_PER_THREAD):
        point = k * step + i
        if point < points_out.at.shape[1]:
            cell = cell_of(points_out.at[view, point], point, width, height, bits)
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
    if points_out.apart[view] <= 0:
        return
    step = (points_out.at.shape[1] + POINTS_PER_THREAD - 1) // POINTS_PER_THREAD
    for k in range(POINTS_PER_THREAD):
        point = k * step + i
        if point < points_out.at.shape[1]:
            cell = view * points_out.cells + cell_of(points_out.at[view, point], point, width, height, bits)
            points_out.order[points_out.ends[cell] - wp.atomic_sub(points_out.counts, cell, 1)] = point
