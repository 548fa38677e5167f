# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of poses on the device: matrices to transforms, and other camera frames to OpenCV's."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def poses_from_matrices(
    # In:
    matrices_in: wp.array[wp.mat44],
    opencv_to_given: wp.quat,
    # Out:
    poses_out: wp.array[wp.transform],
):
    """Convert camera-to-world matrices of the given camera frame to transforms of the OpenCV frame."""
    view = wp.tid()
    matrix = matrices_in[view]
    rotation = wp.mat33(
        matrix[0, 0], matrix[0, 1], matrix[0, 2],
        matrix[1, 0], matrix[1, 1], matrix[1, 2],
        matrix[2, 0], matrix[2, 1], matrix[2, 2],
    )  # fmt: skip
    position = wp.vec3(matrix[0, 3], matrix[1, 3], matrix[2, 3])
    poses_out[view] = wp.transform(position, wp.normalize(wp.quat_from_matrix(rotation) * opencv_to_given))


@wp.kernel
def poses_to_opencv(
    # In:
    poses_in: wp.array[wp.transform],
    opencv_to_given: wp.quat,
    # Out:
    poses_out: wp.array[wp.transform],
):
    """Convert camera-to-world transforms of the given camera frame to the OpenCV frame."""
    view = wp.tid()
    pose = poses_in[view]
    rotation = wp.normalize(wp.transform_get_rotation(pose) * opencv_to_given)
    poses_out[view] = wp.transform(wp.transform_get_translation(pose), rotation)


@wp.kernel
def quaternions_to_xyzw(
    # In:
    rows_in: wp.array2d[float],
    # Out:
    rows_out: wp.array2d[float],
):
    """Convert rows ``x y z qw qx qy qz`` to rows ``x y z qx qy qz qw``."""
    row = wp.tid()
    for k in range(3):
        rows_out[row, k] = rows_in[row, k]
        rows_out[row, 3 + k] = rows_in[row, 4 + k]
    rows_out[row, 6] = rows_in[row, 3]
