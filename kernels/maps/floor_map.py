# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The floor map: visible points projected to cells on the floor."""

import warp as wp

from warpvis.kernels.constants import LABEL_ROBOT
from warpvis.kernels.maps.labels import EMPTY, GroundLabels, is_ground, label_of, precedence
from warpvis.kernels.pinhole import Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

ROBOT = wp.constant(wp.uint8(LABEL_ROBOT))


@wp.struct
class Grid:
    """Square cells on the floor. Map coordinates count cells from the corner of minimal coordinates."""

    first_axis: int
    second_axis: int
    up_axis: int
    origin: wp.vec2
    cell: float
    level: float
    ground: GroundLabels


@wp.func
def map_coordinates(grid: Grid, point: wp.vec3) -> wp.vec2:
    return (wp.vec2(point[grid.first_axis], point[grid.second_axis]) - grid.origin) / grid.cell


@wp.func
def side(a: wp.vec2, b: wp.vec2, p: wp.vec2) -> float:
    """Return a value that is positive if p is to the left of the line from a to b (edge function)."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


@wp.func
def in_triangle(a: wp.vec2, b: wp.vec2, c: wp.vec2, p: wp.vec2) -> bool:
    """Return whether p is in a triangle of either orientation, or on its edge."""
    first = side(a, b, p)
    second = side(b, c, p)
    third = side(c, a, p)
    inside_left = first >= 0.0 and second >= 0.0 and third >= 0.0
    inside_right = first <= 0.0 and second <= 0.0 and third <= 0.0
    return inside_left or inside_right


@wp.func
def mark(cells: wp.array3d[wp.int32], view: int, row: int, column: int, order: int):
    if row >= 0 and row < cells.shape[1] and column >= 0 and column < cells.shape[2]:
        wp.atomic_max(cells, view, row, column, order)


@wp.func
def cell_of(coordinate: float, count: int) -> int:
    """Return the index of a cell, clamped to one cell beyond the map so that far points do not overflow an integer."""
    return int(wp.clamp(wp.floor(coordinate), -1.0, float(count)))


@wp.func
def level_height(grid: Grid, label: wp.uint8, a: wp.vec3, b: wp.vec3) -> bool:
    """Return whether two adjacent points can be on one horizontal surface. Ground counts as horizontal."""
    return is_ground(grid.ground, label) or wp.abs(a[grid.up_axis] - b[grid.up_axis]) < grid.level


@wp.kernel
def mark_cells(
    # Cameras:
    window: Window,
    # In:
    grid: Grid,
    points_in: wp.array3d[wp.vec3],
    labels_in: wp.array3d[wp.uint8],
    # Out:
    cells_out: wp.array3d[wp.int32],
):
    """Raise every cell to the highest precedence among the labels that fall on it.

    Far from the camera, adjacent pixels fall on distant cells. Where four of them have the same label and are on one
    horizontal surface, the cells between them are marked as well.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    label = labels_in[view, y, x]
    point = points_in[view, y, x]
    # Labeled points are finite if labels and points were computed from the same depth image.
    if label == EMPTY or not wp.isfinite(point):
        return
    rows = cells_out.shape[1]
    columns = cells_out.shape[2]
    order = precedence(grid.ground, label)
    a = map_coordinates(grid, point)
    mark(cells_out, view, cell_of(a[1], rows), cell_of(a[0], columns), order)

    if y + 1 >= points_in.shape[1] or x + 1 >= points_in.shape[2]:
        return
    right = points_in[view, y, x + 1]
    below = points_in[view, y + 1, x]
    across = points_in[view, y + 1, x + 1]
    if labels_in[view, y, x + 1] != label or labels_in[view, y + 1, x] != label:
        return
    if labels_in[view, y + 1, x + 1] != label:
        return
    if not (wp.isfinite(right) and wp.isfinite(below) and wp.isfinite(across)):
        return
    if not (level_height(grid, label, point, right) and level_height(grid, label, point, below)):
        return
    if not level_height(grid, label, point, across):
        return

    b = map_coordinates(grid, right)
    c = map_coordinates(grid, across)
    d = map_coordinates(grid, below)
    low = wp.min(wp.min(a, b), wp.min(c, d))
    high = wp.max(wp.max(a, b), wp.max(c, d))
    for row in range(wp.max(cell_of(low[1], rows), 0), wp.min(cell_of(high[1], rows) + 1, rows)):
        for column in range(wp.max(cell_of(low[0], columns), 0), wp.min(cell_of(high[0], columns) + 1, columns)):
            center = wp.vec2(float(column) + 0.5, float(row) + 0.5)
            if in_triangle(a, b, c, center) or in_triangle(a, c, d, center):
                mark(cells_out, view, row, column, order)


@wp.kernel
def finish_map(
    # Cameras:
    window: Window,
    # In:
    grid: Grid,
    cells_in: wp.array3d[wp.int32],
    robots: wp.array[wp.vec3],
    # Out:
    map_out: wp.array3d[wp.uint8],
):
    """Write labels of cells, and the robots' discs: the center [m] in x and y, and the radius [m] in z."""
    view, row, column = wp.tid()
    view, row = locate(window, view, row)

    label = label_of(cells_in[view, row, column])
    center = grid.origin + grid.cell * wp.vec2(float(column) + 0.5, float(row) + 0.5)
    for i in range(robots.shape[0]):
        if wp.length(center - wp.vec2(robots[i][0], robots[i][1])) <= robots[i][2]:
            label = ROBOT
    map_out[view, row, column] = label
