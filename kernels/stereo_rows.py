# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth by triangulation on CPU cores: the model of `warpvis.kernels.stereo`, sixteen pixels at a time."""

import warp as wp

from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera, Window
from warpvis.kernels.random_rows import LANE_HEADERS, PIXELS_AT_ONCE
from warpvis.kernels.stereo import MEASURE, PLACE, STEREO_HEADERS, OtherEye, StereoModel, StereoViews

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})


@wp.func_native(read_native(*LANE_HEADERS, *STEREO_HEADERS) + MEASURE)
def measure_pixels(
    model: StereoModel,
    given: StereoViews,
    eye: OtherEye,
    draw: wp.vec2ui,
    view: int,
    y: int,
    x: int,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


@wp.kernel
def measure_stereo_rows(
    # Cameras:
    eyes: wp.array[OtherEye],
    window: Window,
    # In:
    model: StereoModel,
    given: StereoViews,
    # Out:
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    """Write the same on CPU cores, `PIXELS_AT_ONCE` pixels of a row a thread of the kernel."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row
    measure_pixels(model, given, eyes[view], given.draws[view], view, y, x * PIXELS_AT_ONCE, depth_out, reasons_out)


@wp.func_native(read_native(*LANE_HEADERS, *STEREO_HEADERS) + PLACE)
def place_pixels(
    camera: PinholeCamera,
    given: StereoViews,
    eye: OtherEye,
    added_columns: float,
    least_depth: float,
    view: int,
    y: int,
    x: int,
    points_out: wp.array3d[wp.vec2],
): ...


@wp.kernel
def place_rows_in_other_eyes(
    # Cameras:
    other: PinholeCamera,
    eyes: wp.array[OtherEye],
    window: Window,
    # In:
    given: StereoViews,
    added_columns: float,
    least_depth: float,
    # Out:
    points_out: wp.array3d[wp.vec2],
):
    """Write what `place_in_other_eyes` does, `PIXELS_AT_ONCE` pixels of a row a thread of the kernel."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row
    place_pixels(other, given, eyes[view], added_columns, least_depth, view, y, x * PIXELS_AT_ONCE, points_out)
