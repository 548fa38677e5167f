# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The next surface behind listed pixels, ray by ray on CPU cores: `layers.cast_layer` in a launch packed once."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.layers import cast_behind, is_seen_from_behind
from warpvis.kernels.casting.rays import RayRange, write_images
from warpvis.kernels.casting.triangle_scene import TriangleScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import frame_of
from warpvis.kernels.rows import RowJob, enter_rows, finish_rows, rows_of, take_rows

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/rows.h")}
)


@wp.struct
class BehindCall:
    """The arguments of a launch over rows of a list of pixels (`kernels.shading.layer_rows.PixelList`)."""

    scene: TriangleScene
    camera: RayRange
    is_parallel: int
    cull_backfaces: int
    origins: wp.array2d[wp.vec3d]  # of rays, in the camera frame, (y, x); may be None
    camera_to_world: wp.array[wp.transform]
    worlds: Worlds
    pixels: wp.array3d[wp.int32]
    clear: wp.array3d[wp.vec2]
    points: wp.array3d[wp.vec3]  # of the surfaces in front, as below
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]
    is_left: wp.array3d[wp.uint8]  # 0 where the surfaces behind are known; None if all are unknown
    job: RowJob


@wp.struct
class BehindImages:
    """The surfaces behind those in front, and 1 where a triangle is seen from behind."""

    images: Images
    is_back: wp.array3d[wp.uint8]


@wp.func
def is_unknown(call: BehindCall, view: int, row: int, column: int) -> bool:
    """Return whether the surface behind that of a listed pixel is unknown."""
    if call.is_left:
        return call.is_left[view, row, column] != wp.uint8(0)
    return True


@wp.func
def cast_listed_pixel(call: BehindCall, view: int, row: int, column: int, behind: BehindImages):
    images = behind.images
    eye = frame_of(call.camera_to_world[view])
    local = wp.quat_rotate_inv(eye.rotation, wp.vec3d(call.points[view, row, column]) - eye.origin)
    aside = wp.vec3d()
    if call.is_parallel != 0:
        aside = wp.vec3d(local[0], local[1], wp.float64(0.0))
    elif call.origins:
        pixel = call.pixels[view, row, column]
        aside = call.origins[pixel // call.origins.shape[1], pixel % call.origins.shape[1]]
    local = local - aside
    eye.origin = eye.origin + wp.quat_rotate(eye.rotation, aside)
    index, face = call.segmentation[view, row, column], call.faces[view, row, column]
    hit = cast_behind(call.scene, call.camera, eye, local, call.worlds, view, call.cull_backfaces != 0, index, face)
    write_images(call.scene, eye.origin, call.worlds, call.worlds, view, hit, view, row, column, images)
    is_back = is_seen_from_behind(call.scene, call.worlds, view, hit)
    behind.is_back[view, row, column] = wp.uint8(wp.where(is_back, 1, 0))


@wp.kernel
def cast_layer_rows(
    # In:
    calls: wp.array[BehindCall],
    # Out:
    images_out: wp.array[BehindImages],
):
    """Write the surfaces behind those of listed pixels; the object -2 if none is needed.

    Each array contains one element. Every worker launches this kernel.
    """
    _ = wp.tid()
    call, behind = calls[0], images_out[0]
    enter_rows(call.job)
    unit = take_rows(call.job)
    while unit >= 0:
        rows = rows_of(call.job, unit)
        for row in range(rows[1], rows[2]):
            for column in range(call.pixels.shape[2]):
                if call.clear[rows[0], row, column][0] == 0.0:
                    behind.images.segmentation[rows[0], row, column] = -2
                elif is_unknown(call, rows[0], row, column):
                    cast_listed_pixel(call, rows[0], row, column, behind)
        unit = take_rows(call.job)
    finish_rows(call.job)
