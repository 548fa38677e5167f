# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The nearest pixel to a point of the image that another object blocks, or that nothing blocks.

A visible point is hidden when a blocked pixel reaches it: one that shows another object in front of the point, or is
outside the image. A hidden point is revealed when a free pixel reaches it: one of the image that shows nothing in front
of the point. Pixels are searched in tiles, whose ranges of depth exclude most of them.

Image points are integers in units of 1 / (2 scale) px, so that distances are exact and equal on all devices.
"""

import warp as wp

from warpvis.kernels.visibility.fractions import Targets, is_member

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

TILE_SIDE = 8
TILE = wp.constant(TILE_SIDE)
"""Side of a tile [px]."""


@wp.struct
class Search:
    """Images of all objects, rendered with a depth range from 0 to inf, and how they are searched."""

    depth: wp.array3d[float]
    segmentation: wp.array3d[wp.int32]
    tiles: wp.array3d[wp.vec2]
    """(view, row, column): least and greatest depth of a tile's pixels [m]."""
    reach: float
    """Maximum distance of the search [px]."""
    hidden_only: int
    """Whether to examine only targets of which no pixel is visible."""


@wp.struct
class Spot:
    """A point of a surface in the image."""

    x: int
    y: int
    """Its place, in units of 1 / (2 scale) px."""
    scale: int
    depth: float
    """Its depth [m]."""
    target: int
    """The target that it belongs to, -1 for none."""
    owner: int
    """The object whose pixels never block the point, if it belongs to no target; -1 for none."""


@wp.struct
class Nearest:
    """The nearest pixel that differs."""

    squared: wp.int64
    """Squared distance, in units of the spot's place; greater than the limit of the search if no pixel was found."""
    x: int
    y: int
    """Column and row; -1 or the image's width or height beyond the border."""
    is_border: bool


@wp.kernel
def bound_depth_tiles(
    # In:
    depth: wp.array3d[float],
    # Out:
    tiles_out: wp.array3d[wp.vec2],
):
    """Write the least and the greatest depth of each tile."""
    view, row, column = wp.tid()
    low, high = float(wp.inf), float(0.0)
    for y in range(row * TILE, wp.min((row + 1) * TILE, depth.shape[1])):
        for x in range(column * TILE, wp.min((column + 1) * TILE, depth.shape[2])):
            low, high = wp.min(low, depth[view, y, x]), wp.max(high, depth[view, y, x])
    tiles_out[view, row, column] = wp.vec2(low, high)


@wp.func
def floor_divide(a: int, b: int) -> int:
    if a >= 0:
        return a // b
    return -((-a + b - 1) // b)


@wp.func
def square(a: int) -> wp.int64:
    return wp.int64(a) * wp.int64(a)


@wp.func
def reach_limit(reach: float, scale: int) -> wp.int64:
    """Return the square of the reach in units of 1 / (2 scale) px."""
    length = wp.float64(reach) * wp.float64(2 * scale)
    return wp.int64(wp.floor(length * length))


@wp.func
def is_sought(search: Search, targets: Targets, spot: Spot, view: int, y: int, x: int, seeks_blocked: bool) -> bool:
    """Return whether a pixel of the image is blocked for a spot, or, if `seeks_blocked` is False, free."""
    is_nearer = search.depth[view, y, x] < spot.depth
    if not seeks_blocked:
        return not is_nearer
    if not is_nearer:
        return False
    shown = search.segmentation[view, y, x]
    if spot.target >= 0:
        return not is_member(targets, spot.target, shown)
    return shown != spot.owner


@wp.func
def nearest_border(search: Search, spot: Spot) -> Nearest:
    """Return the nearest place beyond the border of the image: half a pixel outside, as centers of pixels are."""
    width, height = search.depth.shape[2], search.depth.shape[1]
    unit = 2 * spot.scale
    found = Nearest()
    found.is_border = True
    found.x = -1
    found.y = floor_divide(spot.y, unit)
    distance = spot.x + spot.scale
    if width * unit + spot.scale - spot.x < distance:
        distance = width * unit + spot.scale - spot.x
        found.x = width
    if spot.y + spot.scale < distance:
        distance = spot.y + spot.scale
        found.x = floor_divide(spot.x, unit)
        found.y = -1
    if height * unit + spot.scale - spot.y < distance:
        distance = height * unit + spot.scale - spot.y
        found.x = floor_divide(spot.x, unit)
        found.y = height
    found.squared = square(distance)
    return found


@wp.func
def search_tile(
    search: Search,
    targets: Targets,
    spot: Spot,
    view: int,
    row: int,
    column: int,
    seeks_blocked: bool,
    nearest: Nearest,
) -> Nearest:
    """Return the nearer of `nearest` and the nearest sought pixel of a tile."""
    found = nearest
    y1 = wp.min((row + 1) * TILE, search.depth.shape[1])
    x1 = wp.min((column + 1) * TILE, search.depth.shape[2])
    for y in range(row * TILE, y1):
        across_rows = square((2 * y + 1) * spot.scale - spot.y)
        if across_rows < found.squared:
            for x in range(column * TILE, x1):
                squared = across_rows + square((2 * x + 1) * spot.scale - spot.x)
                if squared < found.squared:
                    if is_sought(search, targets, spot, view, y, x, seeks_blocked):
                        found.squared = squared
                        found.x = x
                        found.y = y
                        found.is_border = False
    return found


@wp.func
def find_nearest(
    search: Search,
    targets: Targets,
    spot: Spot,
    view: int,
    seeks_blocked: bool,
    limit: wp.int64,
    enough: wp.int64,
) -> Nearest:
    """Return the nearest blocked or free pixel for a spot, at a squared distance of at most `limit`.

    The search ends early at a pixel whose squared distance is less than `enough`.
    """
    nearest = Nearest()
    nearest.squared = limit + wp.int64(1)
    if seeks_blocked:
        border = nearest_border(search, spot)
        if border.squared < nearest.squared:
            nearest = border
    unit = 2 * spot.scale
    rows, columns = search.tiles.shape[1], search.tiles.shape[2]
    middle_row = floor_divide(floor_divide(spot.y, unit), TILE)
    middle_column = floor_divide(floor_divide(spot.x, unit), TILE)
    ring, lower = int(0), wp.int64(0)
    while lower < nearest.squared and nearest.squared >= enough:
        count = wp.max(8 * ring, 1)
        for k in range(count):
            side, step = int(0), int(0)
            if ring > 0:
                side, step = k // (2 * ring), k % (2 * ring)
            dx, dy = step - ring, -ring
            if side == 1:
                dx, dy = ring, step - ring
            if side == 2:
                dx, dy = ring - step, ring
            if side == 3:
                dx, dy = -ring, ring - step
            row, column = middle_row + dy, middle_column + dx
            if row >= 0 and row < rows and column >= 0 and column < columns and nearest.squared >= enough:
                bounds = search.tiles[view, row, column]
                if (seeks_blocked and bounds[0] < spot.depth) or (not seeks_blocked and bounds[1] >= spot.depth):
                    nearest = search_tile(search, targets, spot, view, row, column, seeks_blocked, nearest)
        # Pixel centers of the next ring are at least half a pixel farther than the side of the inner tiles.
        lower = square((2 * ring * TILE + 1) * spot.scale)
        ring += 1
    return nearest
