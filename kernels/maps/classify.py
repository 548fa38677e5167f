# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Back-projection and labels of depth images, measured or rendered, of a pinhole or with a ray for each pixel."""

import warp as wp

from warpvis.kernels.casting.rays import RayRange
from warpvis.kernels.constants import LABEL_EMPTY, LABEL_GROUND, LABEL_OBSTACLE
from warpvis.kernels.pinhole import (
    PinholeCamera,
    Window,
    back_project_pixel,
    locate,
    pose_origin,
    pose_rotation,
    shown_depth,
)

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

EMPTY = wp.constant(wp.uint8(LABEL_EMPTY))
GROUND = wp.constant(wp.uint8(LABEL_GROUND))
OBSTACLE = wp.constant(wp.uint8(LABEL_OBSTACLE))


@wp.struct
class Spheres:
    """Objects as defined in the paper: spheres with a center, a size (diameter) and a label."""

    center: wp.array[wp.vec3]
    size: wp.array[float]
    label: wp.array[wp.uint8]


@wp.struct
class Ground:
    """The floor: a plane, and the heights of points that belong to it."""

    axis: int
    """The world axis to which the plane is perpendicular, or -1."""
    normal: wp.vec3d
    offset: wp.float64
    height: float
    """Height of the floor above the plane [m]."""
    tolerance: float
    growth: wp.vec3
    """Coefficients of 1, depth and its square in the tolerance along the ray [m]."""
    below_label: wp.uint8


@wp.func
def height_above(ground: Ground, point: wp.vec3) -> float:
    """Return the height of a point above the floor."""
    height = float(0.0)
    if ground.axis >= 0:
        height = point[ground.axis]
    else:
        height = float(wp.dot(ground.normal, wp.vec3d(point)) + ground.offset)
    return height - ground.height


@wp.func
def tolerance_at(ground: Ground, camera: wp.vec3, height: float, depth: float) -> float:
    """Return the tolerance for a point: the error of depth moves a point by its component across the plane."""
    tolerance = ground.tolerance
    growth = ground.growth
    if growth[0] != 0.0 or growth[1] != 0.0 or growth[2] != 0.0:
        rise = wp.abs(height - height_above(ground, camera))
        tolerance += rise * (growth[0] / depth + growth[1] + growth[2] * depth)
    return tolerance


@wp.func
def nearest_sphere(spheres: Spheres, point: wp.vec3) -> int:
    """Return the sphere that contains a point, by ``||C_obj - P|| < size/2``; the deepest if several do; else -1."""
    best = int(-1)
    best_ratio = float(1.0)
    for i in range(spheres.center.shape[0]):
        ratio = wp.length(point - spheres.center[i]) / (0.5 * spheres.size[i])
        if ratio < best_ratio:
            best_ratio = ratio
            best = i
    return best


@wp.func
def has_depth(depth: float, near: float, max_range: float) -> bool:
    """Return False for every encoding of "no point": NaN, infinities, non-positive, too near, beyond max_range."""
    return wp.isfinite(depth) and depth > 0.0 and depth >= near and depth <= max_range


@wp.struct
class Case:
    """The class of a point: its label, and the sphere that contains it, or -1."""

    label: wp.uint8
    sphere: int


@wp.func
def no_point() -> Case:
    case = Case()
    case.label = EMPTY
    case.sphere = -1
    return case


@wp.func
def case_of(point: wp.vec3, camera: wp.vec3, depth: float, ground: Ground, spheres: Spheres) -> Case:
    """Classify a point by the cases of the paper: ground, else part of an object, else obstacle."""
    case = no_point()
    height = height_above(ground, point)
    tolerance = tolerance_at(ground, camera, height, depth)
    if height < tolerance:
        case.label = GROUND
        if height < -tolerance:
            case.label = ground.below_label
        return case
    case.label = OBSTACLE
    case.sphere = nearest_sphere(spheres, point)
    if case.sphere >= 0:
        case.label = spheres.label[case.sphere]
    return case


@wp.func
def point_along(pose: wp.transform, ray: wp.vec3d, depth: float) -> wp.vec3:
    """Return the world point at a depth along a ray of the camera frame, whose depth is 1; NaN for NaN rays."""
    return wp.vec3(pose_origin(pose) + wp.float64(depth) * wp.quat_rotate(pose_rotation(pose), ray))


# With rays in the same kernel, classification of a pinhole's images takes 5 % longer on a GPU.
@wp.kernel
def back_project(
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    depth_in: wp.array3d[float],
    # Out:
    points_out: wp.array3d[wp.vec3],
):
    """Write world points of depth images by equations (3) to (6); NaN without depth in the camera's range."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    depth = shown_depth(camera, depth_in[view, y, x])
    points_out[view, y, x] = back_project_pixel(camera, camera_to_world[view], y, x, depth)


@wp.kernel
def back_project_rays(
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
    """Write world points as `back_project` does; NaN also for pixels without a ray."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    depth = depth_in[view, y, x]
    point = wp.vec3(wp.nan, wp.nan, wp.nan)
    if has_depth(depth, camera.near, camera.far):
        point = point_along(camera_to_world[view], rays_in[y, x], depth)
    points_out[view, y, x] = point


@wp.kernel
def back_project_bundle(
    # Cameras:
    camera: RayRange,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    rays_in: wp.array2d[wp.vec3d],
    origins_in: wp.array2d[wp.vec3d],
    depth_in: wp.array3d[float],
    # Out:
    points_out: wp.array3d[wp.vec3],
):
    """Write world points as `back_project_rays` does, of rays with distinct origins in the camera frame."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    depth = depth_in[view, y, x]
    point = wp.vec3(wp.nan, wp.nan, wp.nan)
    if has_depth(depth, camera.near, camera.far):
        pose = camera_to_world[view]
        offset = origins_in[y, x] + wp.float64(depth) * rays_in[y, x]
        point = wp.vec3(pose_origin(pose) + wp.quat_rotate(pose_rotation(pose), offset))
    points_out[view, y, x] = point


@wp.kernel
def classify_depth(
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
    """Write the case of the paper for every pixel: empty, ground, part of an object, else obstacle."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    depth = depth_in[view, y, x]
    case = no_point()
    if has_depth(depth, camera.near, max_range):
        pose = camera_to_world[view]
        point = back_project_pixel(camera, pose, y, x, depth)
        case = case_of(point, wp.transform_get_translation(pose), depth, ground, spheres)

    labels_out[view, y, x] = case.label
    if spheres_out:
        spheres_out[view, y, x] = case.sphere


@wp.kernel
def classify_rays(
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
    """Write cases as `classify_depth` does; pixels without a ray are empty."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    depth = depth_in[view, y, x]
    ray = rays_in[y, x]
    case = no_point()
    if has_depth(depth, camera.near, max_range) and ray[2] == ray[2]:
        pose = camera_to_world[view]
        case = case_of(point_along(pose, ray, depth), wp.transform_get_translation(pose), depth, ground, spheres)

    labels_out[view, y, x] = case.label
    if spheres_out:
        spheres_out[view, y, x] = case.sphere


@wp.kernel
def label_objects(
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
    """Write labels of rendered images by the object of each pixel; pixels without a valid object are empty."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    index = segmentation_in[view, y, x]
    label = EMPTY
    if has_depth(depth_in[view, y, x], 0.0, max_range) and index >= 0 and index < object_label.shape[0]:
        label = object_label[index]
    labels_out[view, y, x] = label
