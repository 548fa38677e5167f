# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Noisy depth on CPU cores: `kernels.sensors.kinect_noise` and `corruptions` for 16 pixels of a row at a time."""

import warp as wp

from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera, Window, forward_axis, pose_rotation
from warpvis.kernels.sensors.corruptions import CorruptionModel
from warpvis.kernels.sensors.kinect_noise import KhoshelhamModel, NguyenModel
from warpvis.kernels.sensors.random_rows import LANE_HEADERS

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

_HEADERS = read_native(*LANE_HEADERS, "cpu/noise_rows.h")
_ROW = """
const int height = depth_out.shape[1], width = depth_out.shape[2];
const long long first = ((long long)view * height + y) * width;
const SensorRange range = {camera.near, camera.far};
const NoiseRow row = {width, y, {model.seed, draw[0], draw[1]}, true_depth.data ? true_depth.data + first : nullptr,
                      depth_out.data + first, reasons_out.data ? reasons_out.data + first : nullptr};
"""
"""C++ that defines the row ``y`` of a view."""


@wp.func_native(
    _HEADERS
    + read_native("cpu/kinect_rows.h")
    + _ROW
    + """
const NguyenView seen = {{camera.fx, camera.fy}, {camera.cx, camera.cy},
                         {rotation.x, rotation.y, rotation.z, rotation.w}, {forward[0], forward[1], forward[2]},
                         height, width, true_depth.data + (first - (long long)y * width),
                         (const float*)normals.data + 3 * (first - (long long)y * width)};
const Nguyen nguyen = {model.min_axial, model.axial_growth, model.best_depth, model.grazing_axial,
                       model.grazing_angle, model.lateral, model.lateral_growth, model.max_angle, range};
nguyen.measure(row, seen);
"""
)
def measure_nguyen_row(
    camera: PinholeCamera,
    rotation: wp.quatd,
    forward: wp.vec3d,
    model: NguyenModel,
    true_depth: wp.array3d[float],
    normals: wp.array3d[wp.vec3],
    draw: wp.vec2ui,
    view: int,
    y: int,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


@wp.kernel
def measure_nguyen_rows(
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
    """Write the output of `measure_nguyen`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view += window.first_view
    y += window.first_row
    rotation = pose_rotation(camera_to_world[view])
    forward = forward_axis(rotation)
    measure_nguyen_row(
        camera, rotation, forward, model, true_depth, normals, draws[view], view, y, depth_out, reasons_out
    )


@wp.func_native(
    _HEADERS
    + read_native("cpu/kinect_rows.h")
    + _ROW
    + "Khoshelham{model.step, model.sigma, model.rounds != 0, range}.measure(row);"
)
def measure_khoshelham_row(
    camera: PinholeCamera,
    model: KhoshelhamModel,
    true_depth: wp.array3d[float],
    draw: wp.vec2ui,
    view: int,
    y: int,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


@wp.kernel
def measure_khoshelham_rows(
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
    """Write the output of `measure_khoshelham`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view += window.first_view
    y += window.first_row
    measure_khoshelham_row(camera, model, true_depth, draws[view], view, y, depth_out, reasons_out)


@wp.func_native(
    _HEADERS
    + read_native("cpu/corruption_rows.h")
    + _ROW
    + """
const int* boxes = (const int*)rectangles.data + 4LL * view * rectangles.shape[1];
const Corruption corruption = {model.added, model.multiplied, model.dropout, range, boxes, model.max_count};
corruption.corrupt(row);
"""
)
def corrupt_row(
    camera: PinholeCamera,
    model: CorruptionModel,
    true_depth: wp.array3d[float],
    rectangles: wp.array2d[wp.vec4i],
    draw: wp.vec2ui,
    view: int,
    y: int,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


@wp.kernel
def corrupt_depth_rows(
    # Cameras:
    camera: PinholeCamera,
    window: Window,
    # In:
    model: CorruptionModel,
    true_depth: wp.array3d[float],
    rectangles: wp.array2d[wp.vec4i],
    draws: wp.array[wp.vec2ui],
    # Out:
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    """Write the output of `corrupt_depth`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view += window.first_view
    y += window.first_row
    corrupt_row(camera, model, true_depth, rectangles, draws[view], view, y, depth_out, reasons_out)
