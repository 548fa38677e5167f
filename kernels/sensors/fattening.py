# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Foreground fattening: near surfaces spread over their background, as in window-based stereo matching."""

import warp as wp

from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.sensors.noise import SensorInputs

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})


@wp.struct
class FatteningModel:
    """The parameters of `warpvis.sensors.StereoDepth` that affect fattening."""

    disparity_scale: float  # f b [px m]
    step: float  # smallest difference in disparity between two surfaces [px]
    reach: int  # half width of the window [px]


@wp.func
def is_before(model: FatteningModel, nearer: float, depth: float) -> bool:
    """Return whether a depth belongs to a surface in front of another."""
    return model.disparity_scale / nearer - model.disparity_scale / depth >= model.step


@wp.kernel
def find_nearest_in_rows(
    window: Window,
    # In:
    model: FatteningModel,
    true_depth: wp.array3d[float],
    # Out:
    nearest_out: wp.array3d[float],
):
    """Write the minimum depth in a horizontal window around each pixel."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    nearest = float(wp.inf)
    for column in range(wp.max(x - model.reach, 0), wp.min(x + model.reach + 1, true_depth.shape[2])):
        nearest = wp.min(nearest, true_depth[view, y, column])
    nearest_out[view, y, x] = nearest


@wp.kernel
def fatten_surfaces(
    window: Window,
    # In:
    model: FatteningModel,
    inputs: SensorInputs,
    nearest: wp.array3d[float],
    offsets: wp.array[wp.vec2i],
    # Out:
    depth_out: wp.array3d[float],
    normals_out: wp.array3d[wp.vec3],
    segmentation_out: wp.array3d[wp.int32],
):
    """Write the surface of the closest pixel in the window that is in front of a pixel's own, or the pixel's own.

    `nearest` is the output of `find_nearest_in_rows`; `offsets` contains column and row offsets by increasing distance.
    Normals and segmentation may be None.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    height, width = inputs.true_depth.shape[1], inputs.true_depth.shape[2]
    depth = inputs.true_depth[view, y, x]
    nearest_depth = float(wp.inf)
    for row in range(wp.max(y - model.reach, 0), wp.min(y + model.reach + 1, height)):
        nearest_depth = wp.min(nearest_depth, nearest[view, row, x])
    from_row, from_column = int(y), int(x)
    if is_before(model, nearest_depth, depth):
        for number in range(offsets.shape[0]):
            column, row = x + offsets[number][0], y + offsets[number][1]
            if row >= 0 and column >= 0 and row < height and column < width:
                if is_before(model, inputs.true_depth[view, row, column], depth):
                    from_row = row
                    from_column = column
                    break
    depth_out[view, y, x] = inputs.true_depth[view, from_row, from_column]
    if normals_out:
        normals_out[view, y, x] = inputs.normals[view, from_row, from_column]
    if segmentation_out:
        segmentation_out[view, y, x] = inputs.segmentation[view, from_row, from_column]
