# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stereo depth on CPU cores: the model of `warpvis.kernels.sensors.stereo` for 16 pixels of a row at a time."""

import warp as wp

from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera, Window
from warpvis.kernels.sensors.random_rows import LANE_HEADERS
from warpvis.kernels.sensors.stereo import MEASURE, PLACE, STEREO_HEADERS, OtherEye, StereoModel, StereoViews

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

_HEADERS = read_native(*LANE_HEADERS, *STEREO_HEADERS)


@wp.func_native(_HEADERS + MEASURE + "StereoRows::measure_row(stereo, images, seen, y);")
def measure_row(
    model: StereoModel,
    views: StereoViews,
    eye: OtherEye,
    draw: wp.vec2ui,
    view: int,
    y: int,
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
    views: StereoViews,
    # Out:
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    """Write the output of `measure_stereo`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view += window.first_view
    y += window.first_row
    measure_row(model, views, eyes[view], views.draws[view], view, y, depth_out, reasons_out)


@wp.func_native(_HEADERS + PLACE + "image.project_row(images, view, y, (float*)points_out.data);")
def place_row(
    camera: PinholeCamera,
    views: StereoViews,
    eye: OtherEye,
    added_columns: float,
    min_depth: float,
    view: int,
    y: int,
    points_out: wp.array3d[wp.vec2],
): ...


@wp.kernel
def place_rows_in_other_eyes(
    # Cameras:
    other: PinholeCamera,
    eyes: wp.array[OtherEye],
    window: Window,
    # In:
    views: StereoViews,
    added_columns: float,
    min_depth: float,
    # Out:
    points_out: wp.array3d[wp.vec2],
):
    """Write the output of `place_in_other_eyes`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view += window.first_view
    y += window.first_row
    place_row(other, views, eyes[view], added_columns, min_depth, view, y, points_out)
