# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The images that casters write."""

import warp as wp

from warpvis.kernels.pinhole import Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class Images:
    """Rendered images of all views, ``[view, y, x]``; None if not requested."""

    depth: wp.array3d[float]
    points: wp.array3d[wp.vec3]
    normals: wp.array3d[wp.vec3]
    labels: wp.array3d[wp.uint8]
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]


NAMES = ("depth", "points", "normals", "labels", "segmentation", "faces")


@wp.kernel
def fill_depth(
    window: Window,
    # In:
    empty: float,
    too_near: float,
    # Out:
    depth_out: wp.array3d[float],
):
    """Replace -inf in depth images by `too_near`, and other values that are not finite by `empty`."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    depth = depth_out[view, y, x]
    if not wp.isfinite(depth):
        depth_out[view, y, x] = wp.where(depth == -wp.inf, too_near, empty)
