# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""World points: projection into images, and visibility.

Points are in rows of `POINTS_PER_ROW`, so that threads of the CPU pool can share the points of one view.
"""

import warp as wp

from warpvis.kernels import constants
from warpvis.kernels.pinhole import PinholeCamera, Window, pose_origin, pose_rotation, shown_depth

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

POINTS_PER_ROW = 1024

OUT_OF_VIEW = wp.constant(wp.uint8(constants.POINT_OUT_OF_VIEW))
TOO_NEAR = wp.constant(wp.uint8(constants.POINT_TOO_NEAR))
TOO_FAR = wp.constant(wp.uint8(constants.POINT_TOO_FAR))
OCCLUDED = wp.constant(wp.uint8(constants.POINT_OCCLUDED))
VISIBLE = wp.constant(wp.uint8(constants.POINT_VISIBLE))
UNKNOWN = wp.constant(wp.uint8(constants.POINT_UNKNOWN))
"""Status values as bytes."""


@wp.func
def locate_point(window: Window, view: int, row: int, column: int) -> tuple[int, int]:
    """Return the view and the index of the point of a thread from its indices in the launch."""
    return window.first_view + view, (window.first_row + row) * POINTS_PER_ROW + column


@wp.func
def within(coordinate: float, end: float) -> float:
    """Clamp a coordinate from 0 to the greatest single-precision number below the image's width or height."""
    return wp.clamp(coordinate, 0.0, end * 0.99999994)


@wp.kernel
def camera_frames(
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    # Out:
    origin_out: wp.array[wp.vec3d],
    rotation_out: wp.array[wp.mat33d],
):
    """Write camera origins and world-to-camera rotations: once per view, not once per point."""
    view = wp.tid()
    origin_out[view] = pose_origin(camera_to_world[view])
    rotation_out[view] = wp.transpose(wp.quat_to_matrix(pose_rotation(camera_to_world[view])))


@wp.kernel
def project_points(
    # Cameras:
    camera: PinholeCamera,
    origin: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    window: Window,
    # In:
    points: wp.array[wp.vec3],
    # Out:
    pixels_out: wp.array2d[wp.vec2],
    depth_out: wp.array2d[float],
):
    """Write every point's pixel coordinates in every view [px], NaN if outside the image, and its depth [m]."""
    view, row, column = wp.tid()
    view, index = locate_point(window, view, row, column)
    if index >= points.shape[0]:
        return

    p = rotation[view] * (wp.vec3d(points[index]) - origin[view])
    pixel = wp.vec2(wp.nan, wp.nan)
    zero, width, height = wp.float64(0.0), wp.float64(camera.width), wp.float64(camera.height)
    # Compare products: the rounding of quotients would decide for points on a border.
    scaled_x, scaled_y = camera.fx * p[0] + camera.cx * p[2], camera.fy * p[1] + camera.cy * p[2]
    if p[2] > zero and scaled_x >= zero and scaled_x < width * p[2] and scaled_y >= zero and scaled_y < height * p[2]:
        x, y = camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy
        pixel = wp.vec2(within(float(x), camera.width), within(float(y), camera.height))
    pixels_out[view, index] = pixel
    depth_out[view, index] = float(p[2])


@wp.func
def judge(camera: PinholeCamera, pixel: wp.vec2, depth: float, surface: float, tolerance: float) -> wp.uint8:
    """Return the visibility of a point, given the depth of the first surface at its image point.

    The tolerance is along the ray [m]: difference in depth times the length of the ray with z = 1.
    """
    if not wp.isfinite(pixel[0]):
        return OUT_OF_VIEW
    if depth < camera.near:
        return TOO_NEAR
    if depth > camera.far:
        return TOO_FAR
    x, y = (pixel[0] - float(camera.cx)) / float(camera.fx), (pixel[1] - float(camera.cy)) / float(camera.fy)
    if (depth - surface) * wp.sqrt(x * x + y * y + 1.0) > tolerance:
        return OCCLUDED
    return VISIBLE


@wp.kernel
def judge_points(
    # Cameras:
    camera: PinholeCamera,
    window: Window,
    # In:
    pixels: wp.array2d[wp.vec2],
    depth: wp.array2d[float],
    surface: wp.array2d[float],
    segmentation: wp.array2d[wp.int32],
    tolerance: float,
    # Out:
    status_out: wp.array2d[wp.uint8],
    occluders_out: wp.array2d[wp.int32],
):
    """Write each point's status, given the surface at its image point, and the object that occludes it, or -1."""
    view, row, column = wp.tid()
    view, index = locate_point(window, view, row, column)
    if index >= depth.shape[1]:
        return

    status = judge(camera, pixels[view, index], depth[view, index], surface[view, index], tolerance)
    status_out[view, index] = status
    if occluders_out:
        occluder = int(-1)
        if status == OCCLUDED:
            occluder = segmentation[view, index]
        occluders_out[view, index] = occluder


@wp.kernel
def judge_points_measured(
    # Cameras:
    camera: PinholeCamera,
    window: Window,
    # In:
    pixels: wp.array2d[wp.vec2],
    depth: wp.array2d[float],
    measured: wp.array3d[float],
    tolerance: float,
    # Out:
    status_out: wp.array2d[wp.uint8],
):
    """Write each point's status, given its pixel in a depth image: unknown without depth, occluded if too near."""
    view, row, column = wp.tid()
    view, index = locate_point(window, view, row, column)
    if index >= depth.shape[1]:
        return

    pixel = pixels[view, index]
    surface = float(wp.inf)
    if wp.isfinite(pixel[0]):
        surface = shown_depth(camera, measured[view, int(pixel[1]), int(pixel[0])])
    status = judge(camera, pixel, depth[view, index], surface, tolerance)
    in_range = status == VISIBLE or status == OCCLUDED
    if in_range and wp.isnan(surface):
        status = UNKNOWN
    status_out[view, index] = status
