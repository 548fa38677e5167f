# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's arrays as poses of objects and cameras, and objects as geoms: nothing of it goes through the host."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def geom_transforms(
    # In:
    geom_xpos: wp.array2d[wp.vec3],
    geom_xmat: wp.array2d[wp.mat33],
    worlds: wp.array[wp.int32],
    geoms: wp.array[wp.int32],
    # Out:
    poses_out: wp.array2d[wp.transform],
):
    """Geom to world of some geoms in some worlds."""
    row, column = wp.tid()
    world, geom = worlds[row], geoms[column]
    rotation = wp.normalize(wp.quat_from_matrix(geom_xmat[world, geom]))
    poses_out[row, column] = wp.transform(geom_xpos[world, geom], rotation)


@wp.kernel
def camera_transforms(
    # In:
    cam_xpos: wp.array2d[wp.vec3],
    cam_xmat: wp.array2d[wp.mat33],
    cameras: wp.array[wp.int32],
    worlds: wp.array[wp.int32],
    # Out:
    poses_out: wp.array2d[wp.transform],
):
    """Camera to world of some cameras in some worlds: MuJoCo's look along -z, y up; OpenCV's along z, y down."""
    row, column = wp.tid()
    camera, world = cameras[row], worlds[column]
    opengl = wp.quat_from_matrix(cam_xmat[world, camera])
    rotation = wp.normalize(opengl * wp.quat(1.0, 0.0, 0.0, 0.0))
    poses_out[row, column] = wp.transform(cam_xpos[world, camera], rotation)


@wp.kernel
def geoms_of_objects(
    # In:
    objects: wp.array[wp.int32],
    geom_ids: wp.array[wp.int32],
    # Out:
    geoms_out: wp.array[wp.int32],
):
    """The geom of every pixel's object; -1 where there is none."""
    pixel = wp.tid()
    index = objects[pixel]
    if index < 0:
        geoms_out[pixel] = -1
    else:
        geoms_out[pixel] = geom_ids[index]
