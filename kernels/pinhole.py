# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The pinhole camera on the device: OpenCV axes (x right, y down, z forward), pixel centers at +0.5, planar depth.

Geometry is computed in double precision from single-precision input and rounded once, on output.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


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
    clip_inv_z: float  # surfaces with greater 1 / z are invisible; infinite if near surfaces occlude what is behind
    clip_reach: float  # largest distance from the camera to such surfaces in the image [m]; 0 without clipping


@wp.struct
class Window:
    """The first view and row of a launch: each thread of the CPU pool launches its share of views and rows."""

    first_view: int
    first_row: int


@wp.func
def locate(window: Window, view: int, y: int) -> tuple[int, int]:
    """Return the view and the row of a thread from its indices in the launch."""
    return window.first_view + view, window.first_row + y


@wp.func
def pixel_ray(camera: PinholeCamera, y: int, x: int) -> wp.vec3d:
    """Return the camera-frame direction through a pixel center with z = 1: its ray parameter is planar depth."""
    half = wp.float64(0.5)
    return wp.vec3d(
        (wp.float64(x) + half - camera.cx) / camera.fx,
        (wp.float64(y) + half - camera.cy) / camera.fy,
        wp.float64(1.0),
    )


@wp.func
def pixel_center(y: int, x: int) -> wp.vec2:
    """Return a pixel's center [px]."""
    return wp.vec2(float(x) + 0.5, float(y) + 0.5)


@wp.func
def image_ray(camera: PinholeCamera, pixel: wp.vec2) -> wp.vec3d:
    """Return the camera-frame direction through an image point [px] with z = 1."""
    return wp.vec3d(
        (wp.float64(pixel[0]) - camera.cx) / camera.fx, (wp.float64(pixel[1]) - camera.cy) / camera.fy, wp.float64(1.0)
    )


@wp.func
def clip_depth(camera: PinholeCamera) -> float:
    """Return the depth below which surfaces are invisible; 0 if near surfaces occlude what is behind them."""
    return wp.where(camera.clip_reach > 0.0, camera.near, 0.0)


@wp.func
def pose_origin(pose: wp.transform) -> wp.vec3d:
    return wp.vec3d(wp.transform_get_translation(pose))


@wp.func
def pose_rotation(pose: wp.transform) -> wp.quatd:
    """Return the rotation, renormalized: a unit quaternion rounded to single precision is off by up to 1e-7."""
    q = wp.transform_get_rotation(pose)
    return wp.normalize(wp.quatd(wp.float64(q[0]), wp.float64(q[1]), wp.float64(q[2]), wp.float64(q[3])))


@wp.struct
class Frame:
    """The pose of a camera or an object, in the world or in the frame of an object."""

    origin: wp.vec3d
    rotation: wp.quatd


@wp.func
def frame_of(pose: wp.transform) -> Frame:
    frame = Frame()
    frame.origin = pose_origin(pose)
    frame.rotation = pose_rotation(pose)
    return frame


@wp.func
def forward_axis(rotation: wp.quatd) -> wp.vec3d:
    """Return a camera's viewing direction in the world: the third column of its rotation matrix."""
    x, y, z, w = rotation[0], rotation[1], rotation[2], rotation[3]
    one, two = wp.float64(1.0), wp.float64(2.0)
    return wp.vec3d(two * (x * z + y * w), two * (y * z - x * w), one - two * (x * x + y * y))


@wp.func
def shown_between(near: float, far: float, depth: float) -> float:
    """Return depth in the convention of REP 117: -inf below near, +inf beyond far, NaN without a measurement."""
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
    """Return depth in the convention of REP 117 for a camera's depth range."""
    return shown_between(camera.near, camera.far, depth)


@wp.func
def back_project_pixel(camera: PinholeCamera, pose: wp.transform, y: int, x: int, depth: float) -> wp.vec3:
    """Return the world point of a pixel and its depth by equations (3) to (6); NaN without depth."""
    if not wp.isfinite(depth):
        return wp.vec3(wp.nan, wp.nan, wp.nan)
    direction = wp.quat_rotate(pose_rotation(pose), pixel_ray(camera, y, x))
    return wp.vec3(pose_origin(pose) + wp.float64(depth) * direction)


@wp.kernel
def measure_slopes(
    # Cameras:
    camera: PinholeCamera,
    # Out:
    columns_out: wp.array[wp.float64],
    rows_out: wp.array[wp.float64],
):
    """Write x of the rays of columns, or y of the rays of rows, for z = 1."""
    i = wp.tid()
    center = wp.float64(i) + wp.float64(0.5)
    if i < columns_out.shape[0]:
        columns_out[i] = (center - camera.cx) / camera.fx
    if i < rows_out.shape[0]:
        rows_out[i] = (center - camera.cy) / camera.fy
