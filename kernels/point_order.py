# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Points of images, sorted by where they are, for packets on CUDA.

Points that are in rows, as an image's pixels are, are left as they are. Others are counted by the cells of a grid that
they are in, and written in the order of these: along a Hilbert curve, so that those that follow each other are near.
In what order those of one cell are is by chance, and counts for nothing: see ``native/cuda/points.h``.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

POINTS_PER_THREAD = 8
"""That a thread looks at."""

BLOCK_COLUMNS, BLOCK_ROWS = 8, 4
"""Of points in rows that lanes draw together."""

OUTSIDE_CELLS = wp.constant(1024)
"""For points that are not in the image, in turns: threads that count in one and the same would wait for each other."""

APART_UNIT = wp.constant(8.0)
"""Of `PointLists.apart` to a pixel."""

MAX_APART = wp.constant(8)
"""So many times as far apart as blocks may be, and no more, counts a block."""


@wp.struct
class PointLists:
    """Points of the image of every view, as many in each."""

    at: wp.array2d[wp.vec2]
    """(view, point): from the image's corner [px]."""
    columns: int
    """Of rows that they may be in."""
    apart: wp.array[wp.int32]
    """(view): by how much farther apart points of a block are than they may be; above 0, they are sorted."""
    cells: int
    """Of the grid, and `OUTSIDE_CELLS`."""
    counts: wp.array[wp.int32]
    """(view, cell) in a row: how many points are in it and not yet in `order`."""
    ends: wp.array[wp.int32]
    """(view, cell) in a row: where in `order` its points end."""
    order: wp.array[wp.int32]
    """Points of the views that are sorted, one view after the other."""


@wp.func
def is_inside(at: wp.vec2, width: float, height: float) -> bool:
    return at[0] >= 0.0 and at[0] < width and at[1] >= 0.0 and at[1] < height


@wp.func
def along_hilbert(x: int, y: int, bits: int) -> int:
    """How far along a Hilbert curve a cell is (Hamilton and Rau-Chaplin 2008): a quadrant a bit, each turned."""
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
    """The cell of a point; one of the last where it is not in the image."""
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
    """Add up by how much the corners of some blocks of 8x4 points in rows are farther apart than `most` [px].

    Of columns of blocks one is looked at, and so many are not, less one. `apart_out` is 0 before.
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
    """Count the points in each cell, of views that are to be sorted. `counts` are 0 before."""
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
    """Fill `order` by counts and ends. Of what is counted nothing is left then."""
    view, i = wp.tid()
    if points_out.apart[view] <= 0:
        return
    step = (points_out.at.shape[1] + POINTS_PER_THREAD - 1) // POINTS_PER_THREAD
    for k in range(POINTS_PER_THREAD):
        point = k * step + i
        if point < points_out.at.shape[1]:
            cell = view * points_out.cells + cell_of(points_out.at[view, point], point, width, height, bits)
            points_out.order[points_out.ends[cell] - wp.atomic_sub(points_out.counts, cell, 1)] = point
