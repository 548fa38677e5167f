# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of movable objects in every world."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def scale_sizes(
    # In:
    original: wp.array[wp.vec4],
    scales: wp.array2d[wp.vec3],
    # Out:
    sizes_out: wp.array2d[wp.vec4],
):
    """Write `warpvis.kernels.worlds.Worlds.object_sizes` from scale factors per world, or for all worlds if one row."""
    world, movable = wp.tid()
    size, scale = original[movable], scales[world % scales.shape[0], movable]
    sizes_out[world, movable] = wp.vec4(size[0] * scale[0], size[1] * scale[1], size[2] * scale[2], size[3])
