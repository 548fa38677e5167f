# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Foreground fattening: near surfaces spread over their background, as in window-based stereo matching."""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.sensors.noise import SensorInputs

wp.set_module_options(pixel_options("shared/fattening.h"))


@wp.struct
class FatteningModel:
    """The parameters of `warpvis.sensors.StereoDepth` that affect fattening."""

    disparity_scale: float  # f b [px m]
    step: float  # smallest difference in disparity between two surfaces [px]
    reach: int  # half width of the window [px]
    along_columns: bool  # instead of rows


@wp.func_native(
    "warpvis::measure<warpvis::Fattening>(warpvis::sensor_row(inputs, view, y), x, model, depth_out, shown_out);"
)
def fatten_pixels(
    model: FatteningModel,
    inputs: SensorInputs,
    view: int,
    y: int,
    x: int,
    depth_out: wp.array3d[float],
    shown_out: wp.array3d[wp.int32],
): ...


@wp.kernel
def fatten_surfaces(
    window: Window,
    # In:
    model: FatteningModel,
    inputs: SensorInputs,
    # Out:
    depth_out: wp.array3d[float],
    shown_out: wp.array3d[wp.int32],
):
    """Write the depth of the closest pixel of the row or column in front of a pixel's own surface, or the pixel's own.

    `shown_out`, which may be None, is the index in the view of the pixel that has this surface.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    fatten_pixels(model, inputs, view, y, x, depth_out, shown_out)
