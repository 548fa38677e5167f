# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Inputs and the result of a learned depth sensor: normals in the camera's frame, and depth with reasons."""

import warp as wp

from warpvis.kernels.constants import REASON_DROPOUT, REASON_EMPTY, REASON_RANGE, REASON_VALID
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.sensors.noise import MeasuredImages, write_pixel

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def rotate_to_cameras(
    # Cameras:
    cameras_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    normals_in: wp.array3d[wp.vec3],
    # Out:
    normals_out: wp.array3d[wp.vec3],
):
    """Write world-frame normals in the frame of each view's camera; 0 without a surface."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    rotation = wp.transform_get_rotation(cameras_to_world[view])
    normal = wp.quat_rotate_inv(rotation, normals_in[view, y, x])
    normals_out[view, y, x] = wp.where(wp.isfinite(normal[0]), normal, wp.vec3(0.0))


@wp.kernel
def report_learned_depth(
    window: Window,
    # In:
    near: float,
    far: float,
    learned_in: wp.array3d[float],
    true_depth_in: wp.array3d[float],
    is_measured: bool,
    # Out:
    images_out: MeasuredImages,
):
    """Write learned depth with its reasons; NaN, 0 and negative depths are lost pixels.

    A lost pixel is EMPTY or out of range if its exact depth is, and otherwise a DROPOUT.

    `is_measured`: Whether `images_out` contains the depth of another sensor, which lost pixels keep if it has none.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    depth = float(learned_in[view, y, x])
    true_depth = true_depth_in[view, y, x]
    is_lost = not (depth > 0.0 or depth == -wp.inf)
    if is_lost:
        if is_measured and not wp.isfinite(images_out.depth[view, y, x]):
            return
        depth = float(true_depth)
    reason = int(REASON_VALID)
    if depth == wp.inf and true_depth == wp.inf:
        reason = int(REASON_EMPTY)
    elif depth < near:
        depth = -wp.inf
        reason = int(REASON_RANGE)
    elif depth > far or depth == wp.inf:
        depth = wp.inf
        reason = int(REASON_RANGE)
    elif is_lost:
        depth = wp.nan
        reason = int(REASON_DROPOUT)
    write_pixel(images_out, view, y, x, depth, reason)
