# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The pinhole camera on the device: OpenCV axes (x right, y down, z forward), pixel centres at +0.5, planar depth.

Geometry is computed in double precision from single-precision input and rounded once, when it is written.
"""

import warp as wp


@wp.struct
class PinholeCamera:
    """Image size [px], intrinsics [px] and depth range [m] of a pinhole camera."""

    width: float
    height: float
    fx: wp.float64
    fy: wp.float64
    cx: wp.float64
    cy: wp.float64
    near: float
    far: float
    most_inv_z: float  # surfaces of more 1 / z than this are not there; endless where near ones hide what is behind
    clip_reach: float  # how far from the camera such surfaces may be in the image [m]; 0 where there are none


@wp.struct
class Window:
    """Where a launch begins in the images: threads of the CPU pool each launch their own views and rows."""

    first_view: int
    first_row: int


@wp.func
def pixel_ray(camera: PinholeCamera, y: int, x: int) -> wp.vec3d:
    """Camera-frame direction through a pixel centre with z = 1, so that a parameter along it is planar depth."""
    half = wp.float64(0.5)
    return wp.vec3d(
        (wp.float64(x) + half - camera.cx) / camera.fx,
        (wp.float64(y) + half - camera.cy) / camera.fy,
        wp.float64(1.0),
    )


@wp.func
def image_ray(camera: PinholeCamera, at: wp.vec2) -> wp.vec3d:
    """Camera-frame direction through any point of the image [px] with z = 1."""
    return wp.vec3d(
        (wp.float64(at[0]) - camera.cx) / camera.fx, (wp.float64(at[1]) - camera.cy) / camera.fy, wp.float64(1.0)
    )


@wp.func
def clip_depth(camera: PinholeCamera) -> float:
    """Depth below which surfaces are not there; 0 where near ones hide what is behind them."""
    return wp.where(camera.clip_reach > 0.0, camera.near, 0.0)


@wp.func
def pose_origin(pose: wp.transform) -> wp.vec3d:
    return wp.vec3d(wp.transform_get_translation(pose))


@wp.func
def pose_rotation(pose: wp.transform) -> wp.quatd:
    """The rotation, normalised again: a unit quaternion rounded to single precision is off by up to 1e-7."""
    q = wp.transform_get_rotation(pose)
    return wp.normalize(wp.quatd(wp.float64(q[0]), wp.float64(q[1]), wp.float64(q[2]), wp.float64(q[3])))


@wp.func
def forward_axis(rotation: wp.quatd) -> wp.vec3d:
    """Where a camera looks, in the world: the third column of its rotation matrix."""
    x, y, z, w = rotation[0], rotation[1], rotation[2], rotation[3]
    one, two = wp.float64(1.0), wp.float64(2.0)
    return wp.vec3d(two * (x * z + y * w), two * (y * z - x * w), one - two * (x * x + y * y))


@wp.func
def shown_between(near: float, far: float, depth: float) -> float:
    """What was measured, as REP 117 has it: -inf nearer than near, +inf beyond far; NaN where nothing was."""
    if depth == -wp.inf:
        return depth
    if not depth > 0.0:
        return wp.nan
    if depth < near:
        return -wp.inf
    if depth > far:
        return wp.inf
    return depth


@wp.func
def shown_depth(camera: PinholeCamera, depth: float) -> float:
    """The same of a camera's range."""
    return shown_between(camera.near, camera.far, depth)


@wp.func
def back_project_pixel(camera: PinholeCamera, pose: wp.transform, y: int, x: int, depth: float) -> wp.vec3:
    """World point of a pixel and its depth: equations (3) to (6), and NaN where there is no depth."""
    if not wp.isfinite(depth):
        return wp.vec3(wp.nan, wp.nan, wp.nan)
    direction = wp.quat_rotate(pose_rotation(pose), pixel_ray(camera, y, x))
    return wp.vec3(pose_origin(pose) + wp.float64(depth) * direction)
