# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Planes of deforming triangles, as `kernels.shading.base_colors` reads them."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


@wp.func
def in_frame(frame: wp.transform, point: wp.vec3) -> wp.vec3d:
    """Return a point in a frame, in double precision as gradients of thin triangles need it."""
    return wp.vec3d(wp.transform_point(wp.transform_inverse(frame), point))


@wp.kernel
def find_planes(
    # In:
    points: wp.array[wp.vec3],
    faces: wp.array2d[wp.int32],
    frame: wp.transform,
    first: int,
    # Out:
    planes_out: wp.array2d[float],
):
    """Write corner a of faces in a frame, and the gradients of the weights of corners b and c, from row `first` on."""
    face = wp.tid()
    a = in_frame(frame, points[faces[face, 0]])
    ab, ac = in_frame(frame, points[faces[face, 1]]) - a, in_frame(frame, points[faces[face, 2]]) - a
    normal = wp.cross(ab, ac)
    square = wp.dot(normal, normal)
    of_b, of_c = wp.vec3d(), wp.vec3d()
    if square > wp.float64(0.0):
        of_b, of_c = wp.cross(ac, normal) / square, wp.cross(normal, ab) / square
    for axis in range(3):
        planes_out[first + face, axis] = float(a[axis])
        planes_out[first + face, 3 + axis] = float(of_b[axis])
        planes_out[first + face, 6 + axis] = float(of_c[axis])
