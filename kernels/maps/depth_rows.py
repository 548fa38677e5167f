# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""World points and labels on CPU cores: `kernels.maps.classify` and `ray_points` for 16 pixels of a row at a time.

A pose is read once per row, and without spheres only the vertical coordinate of a pixel's point is computed.
"""

import warp as wp

from warpvis.kernels.casting.rays import RayRange
from warpvis.kernels.maps.classify import Ground, Spheres
from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera, Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

_HEADERS = (
    read_native(
        "shared/constants.h",
        "cpu/lanes.h",
        "cpu/number_lanes.h",
        "shared/stretch.h",
        "shared/pose.h",
        "cpu/depth_rows.h",
    )
    + """
const long long width = depth_in.shape[2], first = ((long long)view * depth_in.shape[1] + y) * width;
"""
)
_POSE = """
const Pose pose = Pose::from((const float*)camera_to_world.data + 7LL * view);
"""
_PINHOLE = (
    _POSE
    + """
const double focal[2] = {camera.fx, camera.fy}, center[2] = {camera.cx, camera.cy};
const RowDirections directions = RowDirections::of_pinhole(pose, focal, center, y);
"""
)
_TABLE = (
    _POSE
    + """
const RowDirections directions = RowDirections::of_table(pose, (const double*)rays_in.data + 3LL * y * width);
"""
)
_BACK_PROJECT = """
const DepthRow row = {(int)width, depth_in.data + first, {camera.near, camera.far}, pose.position, directions};
row.back_project((float*)points_out.data + 3 * first);
"""
_CLASSIFY = """
const DepthRow row = {(int)width, depth_in.data + first, {camera.near, max_range}, pose.position, directions};
const RowCases cases = {ground.up, ground.height, ground.sigma, spheres.center.shape[0],
                        (const float*)spheres.center.data, spheres.size.data, spheres.label.data};
cases.classify(row, labels_out.data + first, spheres_out.data ? spheres_out.data + first : nullptr);
"""


@wp.func_native(_HEADERS + _PINHOLE + _BACK_PROJECT)
def back_project_row(
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    view: int,
    y: int,
    depth_in: wp.array3d[float],
    points_out: wp.array3d[wp.vec3],
): ...


@wp.kernel
def back_project_rows(
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    depth_in: wp.array3d[float],
    # Out:
    points_out: wp.array3d[wp.vec3],
):
    """Write the points of `back_project`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view, y = locate(window, view, y)
    back_project_row(camera, camera_to_world, view, y, depth_in, points_out)


@wp.func_native(_HEADERS + _PINHOLE + _CLASSIFY)
def classify_depth_row(
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    view: int,
    y: int,
    depth_in: wp.array3d[float],
    max_range: float,
    ground: Ground,
    spheres: Spheres,
    labels_out: wp.array3d[wp.uint8],
    spheres_out: wp.array3d[wp.int32],
): ...


@wp.kernel
def classify_depth_rows(
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    depth_in: wp.array3d[float],
    max_range: float,
    ground: Ground,
    spheres: Spheres,
    # Out:
    labels_out: wp.array3d[wp.uint8],
    spheres_out: wp.array3d[wp.int32],
):
    """Write the labels of `classify_depth`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view, y = locate(window, view, y)
    classify_depth_row(camera, camera_to_world, view, y, depth_in, max_range, ground, spheres, labels_out, spheres_out)


@wp.func_native(_HEADERS + _TABLE + _BACK_PROJECT)
def back_project_table_row(
    camera: RayRange,
    camera_to_world: wp.array[wp.transform],
    view: int,
    y: int,
    rays_in: wp.array2d[wp.vec3d],
    depth_in: wp.array3d[float],
    points_out: wp.array3d[wp.vec3],
): ...


@wp.kernel
def back_project_ray_rows(
    # Cameras:
    camera: RayRange,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    rays_in: wp.array2d[wp.vec3d],
    depth_in: wp.array3d[float],
    # Out:
    points_out: wp.array3d[wp.vec3],
):
    """Write the points of `back_project_rays`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view, y = locate(window, view, y)
    back_project_table_row(camera, camera_to_world, view, y, rays_in, depth_in, points_out)


@wp.func_native(_HEADERS + _TABLE + _CLASSIFY)
def classify_table_row(
    camera: RayRange,
    camera_to_world: wp.array[wp.transform],
    view: int,
    y: int,
    rays_in: wp.array2d[wp.vec3d],
    depth_in: wp.array3d[float],
    max_range: float,
    ground: Ground,
    spheres: Spheres,
    labels_out: wp.array3d[wp.uint8],
    spheres_out: wp.array3d[wp.int32],
): ...


@wp.kernel
def classify_ray_rows(
    # Cameras:
    camera: RayRange,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    rays_in: wp.array2d[wp.vec3d],
    depth_in: wp.array3d[float],
    max_range: float,
    ground: Ground,
    spheres: Spheres,
    # Out:
    labels_out: wp.array3d[wp.uint8],
    spheres_out: wp.array3d[wp.int32],
):
    """Write the labels of `classify_rays`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view, y = locate(window, view, y)
    classify_table_row(
        camera, camera_to_world, view, y, rays_in, depth_in, max_range, ground, spheres, labels_out, spheres_out
    )


@wp.func_native(
    _HEADERS
    + """
const ObjectRow row = {(int)width, object_label.shape[0], object_label.data, {0.0f, max_range}};
row.label(depth_in.data + first, segmentation_in.data + first, labels_out.data + first);
"""
)
def label_objects_row(
    object_label: wp.array[wp.uint8],
    view: int,
    y: int,
    depth_in: wp.array3d[float],
    segmentation_in: wp.array3d[wp.int32],
    max_range: float,
    labels_out: wp.array3d[wp.uint8],
): ...


@wp.kernel
def label_objects_rows(
    # Scene:
    object_label: wp.array[wp.uint8],
    # Cameras:
    window: Window,
    # In:
    depth_in: wp.array3d[float],
    segmentation_in: wp.array3d[wp.int32],
    max_range: float,
    # Out:
    labels_out: wp.array3d[wp.uint8],
):
    """Write the labels of `label_objects`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view, y = locate(window, view, y)
    label_objects_row(object_label, view, y, depth_in, segmentation_in, max_range, labels_out)
