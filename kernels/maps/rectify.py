# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images of lenses as those of a pinhole."""

import warp as wp

from warpvis.kernels.pinhole import Window, locate, shown_between

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def rectify_depth(
    # Cameras:
    window: Window,
    # In:
    near: float,
    far: float,
    pixels: wp.array2d[wp.int32],
    factors: wp.array2d[float],
    depth_in: wp.array3d[float],
    # Out:
    depth_out: wp.array3d[float],
):
    """Write the planar depth of the pixel of a lens that contains the ray of each pixel of a pinhole.

    `pixels` are indices into the rows of the lens image, -1 outside of it, and `factors` convert its depth to planar
    depth. Depth out of range becomes -inf or +inf (REP 117).
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    depth = float(wp.nan)
    pixel = pixels[y, x]
    if pixel >= 0:
        width = depth_in.shape[2]
        depth = shown_between(near, far, depth_in[view, pixel / width, pixel % width]) * factors[y, x]
    depth_out[view, y, x] = depth
