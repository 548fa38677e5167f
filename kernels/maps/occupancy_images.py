# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Intervals of depth that contain the surface, for pixels and tiles of the depth images of an occupancy map."""

import warp as wp

from warpvis.kernels.pinhole import PinholeCamera, Window, locate, shown_between

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

TILE = 8
"""Pixels along an edge of a tile, and tiles along an edge of a large tile."""

MAX_SAME_SURFACE_STEP = 0.03
"""Largest relative difference in depth of neighboring pixels of one surface.

A plane that the line of sight meets at an angle of 4 degrees has this difference with a focal length of 525 pixels.
"""


@wp.struct
class DepthView:
    """Camera, pose and noise of one depth image, and the changes of log-odds."""

    camera: PinholeCamera
    origin: wp.vec3d
    rotation: wp.mat33d  # world to camera
    reach: float  # depth to which the image is used [m]
    sigma: wp.vec3  # standard deviation of depth [m]: coefficients of 1, z and z^2
    hit: wp.int32
    miss: wp.int32  # negative
    minimum: wp.int32
    maximum: wp.int32


@wp.func
def depth_sigma(view: DepthView, z: float) -> float:
    """Return the standard deviation of depth [m]."""
    return wp.max(view.sigma[0] + z * (view.sigma[1] + z * view.sigma[2]), 0.0)


@wp.func
def widen(bounds: wp.vec2, depth: float, neighbor: float, max_step: float) -> wp.vec2:
    """Extend an interval to the border with a neighbor pixel, if that is on the same surface."""
    if not wp.abs(neighbor - depth) <= max_step:
        return bounds
    border = 0.5 * (depth + neighbor)
    return wp.vec2(wp.min(bounds[0], border), wp.max(bounds[1], border))


@wp.kernel
def bound_surface(
    # Cameras:
    window: Window,
    image: int,
    views: wp.array[DepthView],
    # In:
    depth_in: wp.array3d[float],
    # Out:
    bounds_out: wp.array3d[wp.vec2],
):
    """Write the interval of depth that contains the surface of each pixel.

    In front of the interval the pixel is free, behind it hidden. On a surface that continues in the neighbor pixels the
    interval extends to the pixel's borders, and by one standard deviation on both sides. It is (0, inf) without a
    measurement, and (inf, inf) without a surface within the range.
    """
    index, y, x = wp.tid()
    index, y = locate(window, index, y)

    view = views[image]
    depth = shown_between(view.camera.near, view.reach, depth_in[image, y, x])
    if wp.isnan(depth):
        bounds_out[index, y, x] = wp.vec2(0.0, wp.inf)
        return
    if not wp.isfinite(depth):
        bounds_out[index, y, x] = wp.where(depth > 0.0, wp.vec2(wp.inf, wp.inf), wp.vec2(0.0, view.camera.near))
        return
    sigma = depth_sigma(view, depth)
    max_step = 3.0 * sigma + MAX_SAME_SURFACE_STEP * depth
    bounds = wp.vec2(depth, depth)
    if x > 0:
        bounds = widen(bounds, depth, depth_in[image, y, x - 1], max_step)
    if x + 1 < depth_in.shape[2]:
        bounds = widen(bounds, depth, depth_in[image, y, x + 1], max_step)
    if y > 0:
        bounds = widen(bounds, depth, depth_in[image, y - 1, x], max_step)
    if y + 1 < depth_in.shape[1]:
        bounds = widen(bounds, depth, depth_in[image, y + 1, x], max_step)
    bounds_out[index, y, x] = wp.vec2(bounds[0] - sigma, bounds[1] + sigma)


@wp.struct
class SurfaceLimits:
    """What the pixels of a region show."""

    low: float  # minimum of the intervals that contain the surface, inf without a measurement
    high: float  # their maximum, 0 without a measurement
    has_gaps: bool  # whether pixels without a measurement are among them


@wp.func
def include(limits: SurfaceLimits, tile: wp.vec3) -> SurfaceLimits:
    limits.low = wp.min(limits.low, tile[0])
    limits.high = wp.max(limits.high, tile[1])
    limits.has_gaps = limits.has_gaps or tile[2] > 0.0
    return limits


@wp.kernel
def bound_tiles(
    # Cameras:
    window: Window,
    # In:
    bounds_in: wp.array3d[wp.vec2],
    # Out:
    tiles_out: wp.array3d[wp.vec3],
):
    """Write the `SurfaceLimits` of tiles."""
    index, row, column = wp.tid()
    index, row = locate(window, index, row)

    low, high, gaps = float(wp.inf), float(0.0), float(0.0)
    for y in range(row * TILE, wp.min(row * TILE + TILE, bounds_in.shape[1])):
        for x in range(column * TILE, wp.min(column * TILE + TILE, bounds_in.shape[2])):
            bounds = bounds_in[index, y, x]
            if bounds[0] == 0.0 and bounds[1] == wp.inf:
                gaps = 1.0
            else:
                low, high = wp.min(low, bounds[0]), wp.max(high, bounds[1])
    tiles_out[index, row, column] = wp.vec3(low, high, gaps)


@wp.kernel
def merge_tiles(
    # Cameras:
    window: Window,
    # In:
    tiles_in: wp.array3d[wp.vec3],
    # Out:
    large_tiles_out: wp.array3d[wp.vec3],
):
    """Write the `SurfaceLimits` of large tiles, for blocks near the camera, which most of the image may show."""
    index, row, column = wp.tid()
    index, row = locate(window, index, row)

    end_row = wp.min(row * TILE + TILE, tiles_in.shape[1])
    end_column = wp.min(column * TILE + TILE, tiles_in.shape[2])
    merged = wp.vec3(wp.inf, 0.0, 0.0)
    for y in range(row * TILE, end_row):
        for x in range(column * TILE, end_column):
            tile = tiles_in[index, y, x]
            merged = wp.vec3(wp.min(merged[0], tile[0]), wp.max(merged[1], tile[1]), wp.max(merged[2], tile[2]))
    large_tiles_out[index, row, column] = merged


@wp.struct
class Tiles:
    """`SurfaceLimits` of the tiles of an image, and of large tiles."""

    small: wp.array3d[wp.vec3]
    large: wp.array3d[wp.vec3]


@wp.func
def merge_limits(
    tiles: wp.array3d[wp.vec3], first: wp.vec2i, last: wp.vec2i, near_z: float, far_z: float
) -> SurfaceLimits:
    """Return what a rectangle of tiles shows, or its first rows if these may contain a surface in an interval of z."""
    limits = SurfaceLimits()
    limits.low = wp.inf
    limits.high = 0.0
    for row in range(first[1], last[1] + 1):
        for column in range(first[0], last[0] + 1):
            limits = include(limits, tiles[0, row, column])
        if limits.low <= far_z and limits.high >= near_z:
            return limits
    return limits
