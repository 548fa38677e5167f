# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses and sizes of all objects from those of movable objects."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def spread_poses(
    # In:
    object_poses: wp.array2d[wp.transform],
    columns: wp.array[wp.int32],
    static_poses: wp.array2d[wp.transform],
    # Out:
    poses_out: wp.array2d[wp.transform],
):
    """Write every object's pose in every world from the poses of movable objects; column -1 is a static object."""
    world, index = wp.tid()
    pose = static_poses[0, index]
    if columns[index] >= 0:
        pose = object_poses[world, columns[index]]
    poses_out[world, index] = pose


@wp.kernel
def spread_sizes(
    # In:
    object_sizes: wp.array2d[wp.vec4],
    original: wp.array[wp.vec4],
    isolated: wp.array[wp.vec4],
    columns: wp.array[wp.int32],
    is_attached: wp.array[wp.uint8],
    # Out:
    sizes_out: wp.array2d[wp.vec4],
):
    """Write `Worlds.object_sizes` of every object from the sizes of movable objects.

    `original` are the sizes of movable objects before scaling, and `isolated` those of all objects. An attached object
    is scaled like the one that it moves with; column -1 is a static object.
    """
    world, index = wp.tid()
    column = columns[index]
    if column < 0:
        sizes_out[world, index] = isolated[index]
    elif is_attached[index] == wp.uint8(0):
        sizes_out[world, index] = object_sizes[world, column]
    else:
        size, current, before = isolated[index], object_sizes[world, column], original[column]
        factor = wp.cw_div(current, before)
        sizes_out[world, index] = wp.vec4(size[0] * factor[0], size[1] * factor[1], size[2] * factor[2], size[3])
