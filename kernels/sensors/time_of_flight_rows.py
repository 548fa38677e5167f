# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Time-of-flight depth on CPU cores: `kernels.sensors.time_of_flight` and edges for 16 pixels of a row at a time."""

import warp as wp

from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera, Window
from warpvis.kernels.sensors.random_rows import LANE_HEADERS
from warpvis.kernels.sensors.time_of_flight import FlightModel, FlightViews

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

_HEADERS = read_native(*LANE_HEADERS, "cpu/noise_rows.h", "cpu/flight_rows.h")
_SEEN = """
const int height = SEEN.shape[1], width = SEEN.shape[2];
const long long view_place = (long long)view * height * width;
FlightRow seen = {height, width, y, {camera.fx, camera.fy}, {camera.cx, camera.cy}, {}, SEEN.data + view_place,
                  (const float*)NORMALS.data + 3 * view_place, nullptr, nullptr, nullptr, nullptr};
for (int k = 0; k < 9; ++k) seen.axes[k] = axes.data[k / 3][k % 3];
"""


@wp.func_native(
    _HEADERS
    + _SEEN.replace("SEEN", "views.true_depth").replace("NORMALS", "views.normals")
    + """
if (views.segmentation.data) seen.segmentation = views.segmentation.data + view_place;
seen.reflectivity = views.reflectivity.data;
if (views.slots.data) seen.slots = views.slots.data + view_place;
if (views.slots.data) seen.mixes = (const float*)views.mixes.data + 4LL * view * views.mixes.shape[1];
const long long row_place = view_place + (long long)y * width;
const NoiseRow row = {width, y, {model.seed, draw[0], draw[1]}, nullptr, depth_out.data + row_place,
                      reasons_out.data ? reasons_out.data + row_place : nullptr};
const Flight flight = {model.turns[0], model.unambiguous, model.offset, model.wiggle, model.wiggle_turns,
                       model.noise_scale, model.background, model.min_signal, model.max_signal,
                       {model.near, model.far}};
flight.measure(row, seen);
"""
)
def measure_row(
    camera: PinholeCamera,
    axes: wp.mat33,
    model: FlightModel,
    views: FlightViews,
    draw: wp.vec2ui,
    view: int,
    y: int,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


@wp.kernel
def measure_time_of_flight_rows(
    # Cameras:
    camera: PinholeCamera,
    axes: wp.array[wp.mat33],
    window: Window,
    # In:
    model: FlightModel,
    views: FlightViews,
    # Out:
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    """Write the output of `measure_time_of_flight`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view += window.first_view
    y += window.first_row
    measure_row(camera, axes[view], model, views, views.draws[view], view, y, depth_out, reasons_out)


@wp.func_native(
    _HEADERS
    + _SEEN.replace("SEEN", "true_depth").replace("NORMALS", "normals")
    + "FlightEdges{seen, edge_step}.find(edges_out.data + view_place);"
)
def find_row_edges(
    camera: PinholeCamera,
    axes: wp.mat33,
    true_depth: wp.array3d[float],
    normals: wp.array3d[wp.vec3],
    edge_step: float,
    view: int,
    y: int,
    edges_out: wp.array3d[wp.int32],
): ...


@wp.kernel
def find_edges_rows(
    # Cameras:
    camera: PinholeCamera,
    axes: wp.array[wp.mat33],
    window: Window,
    # In:
    true_depth: wp.array3d[float],
    normals: wp.array3d[wp.vec3],
    edge_step: float,
    # Out:
    edges_out: wp.array3d[wp.int32],
):
    """Write the output of `find_edges`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view += window.first_view
    y += window.first_row
    find_row_edges(camera, axes[view], true_depth, normals, edge_step, view, y, edges_out)
