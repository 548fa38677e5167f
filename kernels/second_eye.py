# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which points of a depth image a second eye beside the camera sees, as the imagers and projectors of a stereo pair."""

import warp as wp

from warpvis.kernels.pinhole import Window

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def shift_places(
    window: Window,
    # In:
    depth_in: wp.array3d[float],
    shift: float,
    # Out:
    places_out: wp.array3d[wp.vec2],
):
    """Where a second eye has the point of every pixel [px]: ``shift / depth`` to the left; NaN where there is none."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row

    depth = depth_in[view, y, x]
    place = wp.vec2(wp.nan, wp.nan)
    if wp.isfinite(depth) and depth > 0.0:
        place = wp.vec2(float(x) + 0.5 - shift / depth, float(y) + 0.5)
    places_out[view, y, x] = place


@wp.kernel
def judge_hidden(
    window: Window,
    # In:
    depth_in: wp.array3d[float],
    surface_in: wp.array3d[float],
    slack: float,
    # Out:
    hidden_out: wp.array3d[wp.uint8],
):
    """Whether a second eye's first surface is nearer than a pixel's point, by more than that part of its depth."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row

    depth = depth_in[view, y, x]
    hidden = wp.uint8(0)
    if wp.isfinite(depth) and depth > 0.0 and surface_in[view, y, x] * (1.0 + slack) < depth:
        hidden = wp.uint8(1)
    hidden_out[view, y, x] = hidden
