# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measured noise models of the Kinect, by Nguyen, Izadi and Lovell, and by Khoshelham and Elberink."""

import warp as wp

from warpvis.kernels.constants import (
    REASON_EMPTY,
    REASON_GRAZING,
    REASON_VALID,
    STREAM_ACROSS,
    STREAM_DEPTH,
    STREAM_DISPARITY,
    STREAM_DOWN,
)
from warpvis.kernels.pinhole import PinholeCamera, Window, forward_axis, pixel_ray, pose_rotation
from warpvis.kernels.sensors.noise import angle_of, draw_normal, limit_depth, range_reason

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

RIGHT_ANGLE = wp.constant(1.5707964)


@wp.struct
class NguyenModel:
    """The parameters of `warpvis.sensors.NguyenNoise`."""

    min_axial: float
    axial_growth: float
    best_depth: float
    grazing_axial: float
    grazing_angle: float
    lateral: float
    lateral_growth: float
    max_angle: float
    seed: wp.uint32


@wp.func
def steepness(angle: float) -> float:
    """Return the factor by which noise grows toward grazing angles: angle / (90 degrees - angle)."""
    return angle / (RIGHT_ANGLE - angle)


@wp.func
def axial_sigma(model: NguyenModel, depth: float, angle: float) -> float:
    """Return the standard deviation of depth [m] by equations (3) and (4)."""
    offset = depth - model.best_depth
    sigma = model.min_axial + model.axial_growth * offset * offset
    if angle >= model.grazing_angle:
        steep = steepness(angle)
        sigma += model.grazing_axial / wp.sqrt(depth) * (steep * steep)
    return sigma


@wp.func
def jittered(pixel: int, sigma: float, normal: float, size: int) -> int:
    """Return the pixel of a displaced pixel center along one axis, clamped to the image."""
    return int(wp.clamp(wp.floor(float(pixel) + 0.5 + sigma * normal), 0.0, float(size - 1)))


@wp.func
def intersect_plane(
    camera: PinholeCamera, normal: wp.vec3d, depth: float, row: int, column: int, y: int, x: int
) -> float:
    """Intersect the ray of pixel (y, x) with the plane of pixel (row, column), whose depth is the fallback."""
    ahead = wp.dot(normal, pixel_ray(camera, row, column)) / wp.dot(normal, pixel_ray(camera, y, x))
    return wp.where(ahead > wp.float64(0.0), float(wp.float64(depth) * ahead), depth)


@wp.kernel
def measure_nguyen(
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    model: NguyenModel,
    true_depth: wp.array3d[float],
    normals: wp.array3d[wp.vec3],
    draws: wp.array[wp.vec2ui],
    # Out:
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    """Write depth with lateral noise, and with axial noise by depth and angle; reasons may be None."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row
    rotation, draw = pose_rotation(camera_to_world[view]), draws[view]
    forward = forward_axis(rotation)
    angle = float(0.0)
    if wp.isfinite(true_depth[view, y, x]):
        angle = angle_of(wp.abs(float(wp.dot(wp.vec3d(normals[view, y, x]), forward))))
    sigma = model.lateral + model.lateral_growth * steepness(wp.min(angle, model.max_angle))
    row = jittered(y, sigma, draw_normal(model.seed, STREAM_DOWN, draw, y, x), true_depth.shape[1])
    column = jittered(x, sigma, draw_normal(model.seed, STREAM_ACROSS, draw, y, x), true_depth.shape[2])
    depth = float(true_depth[view, row, column])
    reason = int(REASON_VALID)
    if not wp.isfinite(depth):
        reason = REASON_EMPTY
    else:
        normal = wp.vec3d(normals[view, row, column])
        angle = angle_of(wp.abs(float(wp.dot(normal, forward))))
        if angle > model.max_angle:
            reason = REASON_GRAZING
            depth = wp.nan
        else:
            if row != y or column != x:
                depth = intersect_plane(camera, wp.quat_rotate_inv(rotation, normal), depth, row, column, y, x)
            noise = draw_normal(model.seed, STREAM_DEPTH, draw, y, x)
            depth = limit_depth(camera.near, camera.far, depth + axial_sigma(model, depth, angle) * noise)
            reason = range_reason(depth)
    depth_out[view, y, x] = depth
    if reasons_out:
        reasons_out[view, y, x] = wp.uint8(reason)


@wp.struct
class KhoshelhamModel:
    """The parameters of `warpvis.sensors.KhoshelhamNoise`."""

    step: float
    sigma: float
    rounds: int
    seed: wp.uint32


@wp.kernel
def measure_khoshelham(
    # Cameras:
    camera: PinholeCamera,
    window: Window,
    # In:
    model: KhoshelhamModel,
    true_depth: wp.array3d[float],
    draws: wp.array[wp.vec2ui],
    # Out:
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    """Write depth with noise of disparity, which is optionally rounded to whole steps; reasons may be None."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row
    depth = float(true_depth[view, y, x])
    reason = int(REASON_EMPTY)
    if wp.isfinite(depth):
        noise = model.sigma * draw_normal(model.seed, STREAM_DISPARITY, draws[view], y, x)
        found = 1.0 + model.step * depth * noise
        if model.rounds != 0:
            found = wp.floor(1.0 / (model.step * depth) + noise + 0.5)
            depth = 1.0 / model.step
        # Depth is infinite below the first step of disparity.
        depth = limit_depth(camera.near, camera.far, wp.where(found > 0.0, depth / found, wp.inf))
        reason = range_reason(depth)
    depth_out[view, y, x] = depth
    if reasons_out:
        reasons_out[view, y, x] = wp.uint8(reason)
