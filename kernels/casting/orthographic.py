# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Orthographic images: all rays of a view are parallel to the camera's axis and start in the camera's plane.

A camera is a `PinholeCamera` with fx and fy in pixels per meter: the points at z = 1 of its rays are the origins of the
orthographic rays.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.rays import CUDA_REGISTERS, no_hit, pinhole_range, trace_ray, write_images
from warpvis.kernels.casting.triangle_scene import TriangleScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.mujoco.coinciding import Coinciding, last_coinciding, seen_in
from warpvis.kernels.pinhole import (
    PinholeCamera,
    Window,
    forward_axis,
    frame_of,
    image_ray,
    locate,
    pixel_center,
    pose_origin,
    pose_rotation,
)

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func
def eye_at(camera: PinholeCamera, pose: wp.transform, pixel: wp.vec2) -> wp.transform:
    """Return the camera pose, translated in its plane to the origin of the ray through an image point."""
    end = image_ray(camera, pixel)
    offset = wp.quat_rotate(pose_rotation(pose), wp.vec3d(end[0], end[1], wp.float64(0.0)))
    return wp.transform(wp.vec3(pose_origin(pose) + offset), wp.transform_get_rotation(pose))


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_parallel_rays(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    pixels_in: wp.array3d[wp.vec2],
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Write the requested images (None is skipped) of every view.

    `pixels_in` are image points [px], (view, 1, point), in which case images have that shape too; None for pixel
    centers. Points outside the image hit nothing.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    pixel = pixel_center(y, x)
    if pixels_in:
        pixel = pixels_in[view, y, x]
    eye = frame_of(camera_to_world[view])
    hit = no_hit()
    if pixel[0] >= 0.0 and pixel[0] < camera.width and pixel[1] >= 0.0 and pixel[1] < camera.height:
        eye = frame_of(eye_at(camera, camera_to_world[view], pixel))
        ahead = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
        hit = trace_ray(scene, pinhole_range(camera), eye, worlds, worlds, view, ahead, cull_backfaces)
    write_images(scene, eye.origin, worlds, worlds, view, hit, view, y, x, images_out)


@wp.kernel
def show_later_from_plane(
    # Scene:
    coinciding: Coinciding,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    depth: wp.array3d[float],
    cull_backfaces: bool,
    span: int,
    # Out:
    segmentation_out: wp.array3d[wp.int32],
    labels_out: wp.array3d[wp.uint8],
    faces_out: wp.array3d[wp.int32],
):
    """Correct coinciding surfaces as `warpvis.kernels.mujoco.coinciding.show_later` does, for orthographic images."""
    view, y, part = wp.tid()
    view, y = locate(window, view, y)

    ahead = forward_axis(pose_rotation(camera_to_world[view]))
    for x in range(part * span, wp.min((part + 1) * span, segmentation_out.shape[2])):
        seen = seen_in(segmentation_out, faces_out, view, y, x)
        if seen[0] >= 0:
            origin = pose_origin(eye_at(camera, camera_to_world[view], pixel_center(y, x)))
            seen_depth = wp.float64(depth[view, y, x])
            shown = last_coinciding(coinciding, worlds, view, seen, origin, ahead, seen_depth, cull_backfaces)
            if shown[0] != seen[0]:
                segmentation_out[view, y, x] = shown[0]
                if labels_out:
                    labels_out[view, y, x] = coinciding.label[shown[0]]
                if faces_out:
                    faces_out[view, y, x] = shown[1]
