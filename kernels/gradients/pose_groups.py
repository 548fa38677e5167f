# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses that move together: one motion for all views of a group, in the frame of the moving camera or object.

View v of the group g has the pose ``A_v D_g``: the initial pose A_v, and the motion D_g of the group. A twist of D_g
along the axes of the initial frame is one of the pose along the axes of the world, rotated by the rotation R_v of A_v.
With T = diag(R_v, R_v), the sums of the group are ``sum T^T H_v T`` and ``sum T^T b_v``.
"""

import warp as wp

from warpvis.kernels.gradients.pose_steps import COST, SIDE, rounded_pose
from warpvis.kernels.pinhole import pose_origin, pose_rotation

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

NUM_COUNTS = wp.constant(3)  # cost, inliers, measured pixels, from the column `COST`


@wp.struct
class Groups:
    """Groups of views."""

    group: wp.array[int]
    """Group of each view."""
    first: wp.array[int]
    """First entry of each group in `views`, and the number of views."""
    views: wp.array[int]
    """Views in the order of groups."""
    initial: wp.array[wp.transform]
    """Initial poses of the views."""


@wp.func
def sums_block(sums: wp.array2d[wp.float64], row: int, i: int, k: int) -> wp.mat33d:
    """Return a block of H: i and k are 0 for rotations, 1 for translations."""
    block = wp.mat33d()
    size = int(3)
    for m in range(size):
        for n in range(size):
            block[m, n] = sums[row, 6 * (3 * i + m) + 3 * k + n]
    return block


@wp.func
def add_rotated_sums(
    rotation: wp.mat33d, sums: wp.array2d[wp.float64], row: int, out_row: int, sums_out: wp.array2d[wp.float64]
):
    """Add sums along rotated axes to a row."""
    size = int(3)
    for i in range(2):
        for k in range(2):
            block = rotation * sums_block(sums, row, i, k) * wp.transpose(rotation)
            for m in range(size):
                for n in range(size):
                    sums_out[out_row, 6 * (3 * i + m) + 3 * k + n] += block[m, n]
        first = SIDE + 3 * i
        side = rotation * wp.vec3d(sums[row, first], sums[row, first + 1], sums[row, first + 2])
        for m in range(size):
            sums_out[out_row, first + m] += side[m]
    for k in range(NUM_COUNTS):
        sums_out[out_row, COST + k] += sums[row, COST + k]


@wp.kernel
def add_groups(
    # In:
    groups: Groups,
    sums_in: wp.array2d[wp.float64],
    # Out:
    sums_out: wp.array2d[wp.float64],
):
    """Add the sums of the views of each group in a fixed order, along the axes of their initial poses."""
    group = wp.tid()
    for k in range(sums_out.shape[1]):
        sums_out[group, k] = wp.float64(0.0)
    for entry in range(groups.first[group], groups.first[group + 1]):
        view = groups.views[entry]
        rotation = wp.transpose(wp.quat_to_matrix(pose_rotation(groups.initial[view])))
        add_rotated_sums(rotation, sums_in, view, group, sums_out)


@wp.kernel
def spread_sums(
    # In:
    groups: Groups,
    sums_in: wp.array2d[wp.float64],
    # Out:
    sums_out: wp.array2d[wp.float64],
):
    """Write the sums of each view's group along the axes of the world."""
    view = wp.tid()
    for k in range(sums_out.shape[1]):
        sums_out[view, k] = wp.float64(0.0)
    rotation = wp.quat_to_matrix(pose_rotation(groups.initial[view]))
    add_rotated_sums(rotation, sums_in, groups.group[view], view, sums_out)


@wp.kernel
def move_views(
    # In:
    groups: Groups,
    motions: wp.array2d[wp.transform],
    column: int,
    # Out:
    poses_out: wp.array2d[wp.transform],
):
    """Write the poses (view, column) after the motions (group, 0)."""
    view = wp.tid()
    initial, motion = groups.initial[view], motions[groups.group[view], 0]
    rotation = pose_rotation(initial)
    origin = pose_origin(initial) + wp.quat_rotate(rotation, pose_origin(motion))
    poses_out[view, column] = rounded_pose(origin, rotation * pose_rotation(motion))
