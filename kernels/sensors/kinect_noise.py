# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measured noise models of the Kinect, by Nguyen, Izadi and Lovell, and by Khoshelham and Elberink."""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, forward_axis, locate, pose_rotation
from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs

wp.set_module_options(pixel_options("shared/kinect.h"))


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


@wp.func_native(
    """
const auto row = warpvis::sensor_row(inputs, images_out, view, y);
warpvis::measure<warpvis::Nguyen>(row, x, model, rotation, forward);
"""
)
def measure_nguyen_pixels(
    model: NguyenModel,
    inputs: SensorInputs,
    rotation: wp.quatd,
    forward: wp.vec3d,
    view: int,
    y: int,
    x: int,
    images_out: MeasuredImages,
): ...


@wp.kernel(cuda_max_registers=64)
def measure_nguyen(
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    model: NguyenModel,
    inputs: SensorInputs,
    # Out:
    images_out: MeasuredImages,
):
    """Write depth with lateral noise, and with axial noise by depth and angle."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    rotation = pose_rotation(camera_to_world[view])
    measure_nguyen_pixels(model, inputs, rotation, forward_axis(rotation), view, y, x, images_out)


@wp.struct
class KhoshelhamModel:
    """The parameters of `warpvis.sensors.KhoshelhamNoise`."""

    step: float
    sigma: float
    rounds: int


@wp.func_native("warpvis::measure<warpvis::Khoshelham>(warpvis::sensor_row(inputs, images_out, view, y), x, model);")
def measure_khoshelham_pixels(
    model: KhoshelhamModel,
    inputs: SensorInputs,
    view: int,
    y: int,
    x: int,
    images_out: MeasuredImages,
): ...


@wp.kernel
def measure_khoshelham(
    window: Window,
    # In:
    model: KhoshelhamModel,
    inputs: SensorInputs,
    # Out:
    images_out: MeasuredImages,
):
    """Write depth with noise of disparity, which is optionally rounded to whole steps."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    measure_khoshelham_pixels(model, inputs, view, y, x, images_out)
