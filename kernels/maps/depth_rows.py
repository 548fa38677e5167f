# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""World points and labels on CPU cores: `kernels.maps.classify` for 16 pixels of a row at a time.

A pose is read once per row, and without spheres only the height of a pixel's point is computed.
"""

import warp as wp

from warpvis.kernels.maps.classify import Ground, Spheres
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import PinholeCamera, Window, locate

wp.set_module_options(
    {
        "enable_backward": False,
        "default_grid_stride": False,
        "fuse_fp": False,
        "extra_build_options": include_native("cpu/depth_rows.h"),
    }
)

_ROW = """
const long long width = depth_in.shape[2], first = ((long long)view * depth_in.shape[1] + y) * width;
const warpvis::DepthRange range = warpvis::DepthRange::of(NEAR, FAR);
"""
_DEPTH_ROW = """
const warpvis::Pose pose = warpvis::Pose::from((const float*)camera_to_world.data + 7LL * view);
const double focal[2] = {camera.fx, camera.fy}, center[2] = {camera.cx, camera.cy};
const double* rays = rays_in.data ? (const double*)rays_in.data + 3LL * y * width : nullptr;
const warpvis::DepthRow row = {.width = (int)width,
                               .depth = depth_in.data + first,
                               .range = range,
                               .origin = pose.position,
                               .directions = warpvis::RowDirections::of(pose, focal, center, y, rays)};
"""


@wp.func_native(
    _ROW.replace("NEAR", "camera.near").replace("FAR", "camera.far")
    + _DEPTH_ROW
    + "row.back_project((float*)points_out.data + 3 * first);"
)
def back_project_row(
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    view: int,
    y: int,
    rays_in: wp.array2d[wp.vec3d],
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
    rays_in: wp.array2d[wp.vec3d],
    depth_in: wp.array3d[float],
    # Out:
    points_out: wp.array3d[wp.vec3],
):
    """Write the points of `back_project`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view, y = locate(window, view, y)
    back_project_row(camera, camera_to_world, view, y, rays_in, depth_in, points_out)


@wp.func_native(
    _ROW.replace("NEAR", "camera.near").replace("FAR", "max_range")
    + _DEPTH_ROW
    + """
const warpvis::RowCases cases = {.normal = {ground.normal[0], ground.normal[1], ground.normal[2]},
                                 .offset = ground.offset,
                                 .height = ground.height,
                                 .tolerance = ground.tolerance,
                                 .growth = {ground.growth[0], ground.growth[1], ground.growth[2]},
                                 .below_label = ground.below_label,
                                 .sphere_count = spheres.center.shape[0],
                                 .centers = (const float*)spheres.center.data,
                                 .sizes = spheres.size.data,
                                 .sphere_labels = spheres.label.data};
cases.classify(row, labels_out.data + first, spheres_out.data ? spheres_out.data + first : nullptr);
"""
)
def classify_row(
    camera: PinholeCamera,
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
def classify_rows(
    # Cameras:
    camera: PinholeCamera,
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
    """Write the labels of `classify_depth`; each thread of the kernel takes a row of pixels."""
    view, y, _x = wp.tid()
    view, y = locate(window, view, y)
    classify_row(
        camera, camera_to_world, view, y, rays_in, depth_in, max_range, ground, spheres, labels_out, spheres_out
    )


@wp.func_native(
    _ROW.replace("NEAR", "0.0f").replace("FAR", "max_range")
    + """
const warpvis::ObjectRow row = {.width = (int)width,
                                .object_count = object_label.shape[0],
                                .object_labels = object_label.data,
                                .range = range};
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
