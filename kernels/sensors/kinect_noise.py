# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measured noise models of the Kinect, by Nguyen, Izadi and Lovell, and by Khoshelham and Elberink."""

import warp as wp

from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera, Window, forward_axis, locate, pose_rotation
from warpvis.kernels.sensors.noise import NOISE, noise_row
from warpvis.kernels.sensors.random_numbers import for_pixels

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

_NATIVE = NOISE + read_native("shared/kinect.h") + noise_row()


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


@wp.func_native(
    _NATIVE
    + """
const NguyenView seen = {{camera.fx, camera.fy}, {camera.cx, camera.cy},
                         {rotation.x, rotation.y, rotation.z, rotation.w}, {forward[0], forward[1], forward[2]},
                         height, width, true_depth.data + view_place, (const float*)normals.data + 3 * view_place};
const Nguyen nguyen = {model.min_axial, model.axial_growth, model.best_depth, model.grazing_axial,
                       model.grazing_angle, model.lateral, model.lateral_growth, model.max_angle, range};
"""
    + for_pixels("nguyen.measure(row, seen, x);")
)
def measure_nguyen_pixels(
    camera: PinholeCamera,
    rotation: wp.quatd,
    forward: wp.vec3d,
    model: NguyenModel,
    true_depth: wp.array3d[float],
    normals: wp.array3d[wp.vec3],
    draw: wp.vec2ui,
    view: int,
    y: int,
    x: int,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


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
    view, y = locate(window, view, y)
    rotation = pose_rotation(camera_to_world[view])
    forward = forward_axis(rotation)
    measure_nguyen_pixels(
        camera, rotation, forward, model, true_depth, normals, draws[view], view, y, x, depth_out, reasons_out
    )


@wp.struct
class KhoshelhamModel:
    """The parameters of `warpvis.sensors.KhoshelhamNoise`."""

    step: float
    sigma: float
    rounds: int
    seed: wp.uint32


@wp.func_native(
    _NATIVE
    + "const Khoshelham khoshelham = {model.step, model.sigma, model.rounds != 0, range};"
    + for_pixels("khoshelham.measure(row, x);")
)
def measure_khoshelham_pixels(
    camera: PinholeCamera,
    model: KhoshelhamModel,
    true_depth: wp.array3d[float],
    draw: wp.vec2ui,
    view: int,
    y: int,
    x: int,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


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
    view, y = locate(window, view, y)
    measure_khoshelham_pixels(camera, model, true_depth, draws[view], view, y, x, depth_out, reasons_out)
