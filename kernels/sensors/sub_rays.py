# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of edge pixels, which see several surfaces, and placement of sub-rays within them."""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate, pose_rotation
from warpvis.kernels.sensors.noise import SensorInputs

wp.set_module_options(pixel_options("shared/sub_rays.h"))

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


@wp.kernel
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


@wp.kernel
def flag_edges(
    # In:
    edges: wp.array[wp.int32],
    # Out:
    flags_out: wp.array[wp.int32],
):
    """Write 1 for edge pixels, as found by `find_edges`, and 0 for other pixels."""
    pixel = wp.tid()
    flags_out[pixel] = wp.where(edges[pixel] >= 0, 1, 0)


@wp.kernel
def number_edges(
    # In:
    sums: wp.array2d[wp.int32],
    # Out:
    edges_out: wp.array2d[wp.int32],
    pixels_out: wp.array2d[wp.int32],
):
    """Number the edge pixels of each view in row-major order, from an inclusive scan of flags over all views.

    `edges_out` contains pixel indices on input and edge numbers on output; `pixels_out` is the inverse mapping.
    """
    view, pixel = wp.tid()
    index = edges_out[view, pixel]
    if index < 0:
        return
    number = sums[view, pixel] - 1
    if view > 0:
        number -= sums[view - 1, sums.shape[1] - 1]
    edges_out[view, pixel] = number
    pixels_out[view, number] = index


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
