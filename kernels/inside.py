# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests whether points are inside closed objects."""

import warp as wp

from warpvis.kernels.clearance import Cylinder, is_inside
from warpvis.kernels.pinhole import Window
from warpvis.kernels.points import point_index

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})


@wp.kernel
def find_inside(
    # Scene:
    mesh: wp.uint64,
    solid: wp.array[wp.uint8],
    up: int,
    # Cameras:
    window: Window,
    # In:
    points: wp.array[wp.vec3],
    # Out:
    inside_out: wp.array[wp.uint8],
):
    """Write whether each point is inside the triangles of closed objects, whose normals face outward."""
    _, row, column = wp.tid()
    index = point_index(window, row, column)
    if index >= points.shape[0]:
        return

    point = points[index]
    cylinder = Cylinder()
    cylinder.x = wp.float64(point[(up + 1) % 3])
    cylinder.y = wp.float64(point[(up + 2) % 3])
    cylinder.high = wp.float64(point[up])
    inside_out[index] = wp.uint8(is_inside(mesh, solid, cylinder, up))
