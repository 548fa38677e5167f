# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Latency: a ring buffer that delays images by some frames."""

import warp as wp

from warpvis.kernels.pinhole import Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class SensorImages:
    """Output of a depth sensor; images that were not requested are empty."""

    depth: wp.array3d[float]
    points: wp.array3d[wp.vec3]
    reasons: wp.array3d[wp.uint8]


@wp.kernel
def delay_images(
    window: Window,
    # In:
    current: SensorImages,
    slots: wp.array[wp.vec2i],
    # Out:
    stored_depth_out: wp.array4d[float],
    stored_points_out: wp.array4d[wp.vec3],
    stored_reasons_out: wp.array4d[wp.uint8],
    depth_out: wp.array3d[float],
    points_out: wp.array3d[wp.vec3],
    reasons_out: wp.array3d[wp.uint8],
):
    """Store images in the first of a view's two slots, and write those of the second slot, which may be the same.

    Points and reasons may be None.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    first, second = slots[view][0], slots[view][1]
    stored_depth_out[first, view, y, x] = current.depth[view, y, x]
    depth_out[view, y, x] = stored_depth_out[second, view, y, x]
    if points_out:
        stored_points_out[first, view, y, x] = current.points[view, y, x]
        points_out[view, y, x] = stored_points_out[second, view, y, x]
    if reasons_out:
        stored_reasons_out[first, view, y, x] = current.reasons[view, y, x]
        reasons_out[view, y, x] = stored_reasons_out[second, view, y, x]
