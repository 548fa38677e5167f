# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of MuJoCo's arrays on the device: poses of geoms and cameras, sizes, visibility, and ids of objects."""

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
    """Write geom-to-world transforms of selected geoms in selected worlds."""
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
    """Write camera-to-world transforms of selected cameras in selected worlds; camera -1 is skipped.

    MuJoCo's cameras look along -z with y up; OpenCV's look along z with y down.
    """
    row, column = wp.tid()
    camera, world = cameras[row], worlds[column]
    if camera < 0:
        return
    opengl = wp.quat_from_matrix(cam_xmat[world, camera])
    rotation = wp.normalize(opengl * wp.quat(1.0, 0.0, 0.0, 0.0))
    poses_out[row, column] = wp.transform(cam_xpos[world, camera], rotation)


@wp.kernel
def viewer_transforms(
    # In:
    subtree_com: wp.array2d[wp.vec3],
    cameras: wp.array[wp.int32],
    bodies: wp.array[wp.int32],
    poses: wp.array[wp.transform],
    worlds: wp.array[wp.int32],
    # Out:
    poses_out: wp.array2d[wp.transform],
):
    """Write camera-to-world transforms of a viewer's cameras (-1 in `cameras`), relative to a body's center of mass."""
    row, column = wp.tid()
    if cameras[row] >= 0:
        return
    position = wp.transform_get_translation(poses[row])
    if bodies[row] >= 0:
        position += subtree_com[worlds[column], bodies[row]]
    poses_out[row, column] = wp.transform(position, wp.transform_get_rotation(poses[row]))


# Values of mujoco.mjtGeom.
SPHERE, CAPSULE, ELLIPSOID, CYLINDER = wp.constant(2), wp.constant(3), wp.constant(4), wp.constant(5)


@wp.kernel
def geom_sizes(
    # In:
    geom_size: wp.array2d[wp.vec3],
    worlds: wp.array[wp.int32],
    geoms: wp.array[wp.int32],
    geom_type: wp.array[wp.int32],
    model_sizes: wp.array[wp.vec3],
    original: wp.array[wp.vec4],
    # Out:
    sizes_out: wp.array2d[wp.vec4],
):
    """Write `warpvis.kernels.casting.worlds.Worlds.object_sizes` in selected worlds from geom sizes.

    Objects that are not resizable geoms (-1 in `geoms`) and geoms that have the model's size keep their original size.
    """
    row, column = wp.tid()
    geom = geoms[column]
    size = original[column]
    if geom >= 0:
        current_size, model_size = geom_size[worlds[row] % geom_size.shape[0], geom], model_sizes[geom]
        if not (current_size == model_size):
            kind = geom_type[geom]
            if kind == SPHERE:
                size = wp.vec4(current_size[0], current_size[0], current_size[0], size[3])
            elif kind == CAPSULE or kind == CYLINDER:
                size = wp.vec4(current_size[0], current_size[0], current_size[0], current_size[1] / current_size[0])
            elif kind == ELLIPSOID:
                size = wp.vec4(current_size[0], current_size[1], current_size[2], size[3])
            else:
                size = wp.vec4(
                    current_size[0] / model_size[0],
                    current_size[1] / model_size[1],
                    current_size[2] / model_size[2],
                    size[3],
                )
    sizes_out[row, column] = size


@wp.kernel
def hidden_objects(
    # In:
    geom_rgba: wp.array2d[wp.vec4],
    geom_matid: wp.array2d[wp.int32],
    mat_rgba: wp.array2d[wp.vec4],
    worlds: wp.array[wp.int32],
    geoms: wp.array[wp.int32],
    # Out:
    hidden_out: wp.array2d[wp.uint8],
):
    """Write whether an object is hidden in each view because its geom is fully transparent in the view's world.

    Views are ordered by camera, then by world. A geom has the color of its material unless it defines its own
    (`setMaterial` in src/engine/engine_vis_visualize.c).
    """
    view, column = wp.tid()
    world, geom = worlds[view % worlds.shape[0]], geoms[column]
    hidden = wp.uint8(0)
    if geom >= 0:
        rgba = geom_rgba[world % geom_rgba.shape[0], geom]
        material = geom_matid[world % geom_matid.shape[0], geom]
        is_known = material >= 0 and material < mat_rgba.shape[1]
        if is_known and rgba == wp.vec4(0.5, 0.5, 0.5, 1.0):
            rgba = mat_rgba[world % mat_rgba.shape[0], material]
        if rgba[3] == 0.0:
            hidden = wp.uint8(1)
    hidden_out[view, column] = hidden


@wp.kernel
def geoms_of_objects(
    # In:
    objects: wp.array[wp.int32],
    geom_ids: wp.array[wp.int32],
    # Out:
    geoms_out: wp.array[wp.int32],
):
    """Write the geom of every pixel's object; -1 without an object."""
    pixel = wp.tid()
    index = objects[pixel]
    if index < 0:
        geoms_out[pixel] = -1
    else:
        geoms_out[pixel] = geom_ids[index]


@wp.kernel
def pairs_of_objects(
    # In:
    objects: wp.array[wp.int32],
    pairs: wp.array[wp.vec2i],
    # Out:
    pairs_out: wp.array2d[wp.int32],
):
    """Write a pair of numbers of every pixel's object; -1 and -1 without an object."""
    pixel = wp.tid()
    index = objects[pixel]
    pair = wp.vec2i(-1, -1)
    if index >= 0:
        pair = pairs[index]
    pairs_out[pixel, 0] = pair[0]
    pairs_out[pixel, 1] = pair[1]
