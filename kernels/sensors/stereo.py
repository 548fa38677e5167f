# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stereo depth by triangulation: the view of the other eye, and the disparity of a matcher.

The other eye, a second imager or a projector, has the same axes as the first one and lies on its x axis. Its position
is rounded to single precision, as all poses are; the resulting offset is taken into account in double precision.
"""

import warp as wp

from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera, Window, locate, pose_origin, pose_rotation
from warpvis.kernels.sensors.random_numbers import PIXEL_NUMBERS, for_pixels

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})


@wp.struct
class StereoModel:
    """Parameters of `Stereo` of ``native/shared/stereo.h``, and of its inputs."""

    disparity_scale: float
    shift_scale: float
    first_column: float
    last_column: float
    near: float
    far: float
    max_disparity: float
    shadow_tolerance: float
    min_support: float
    min_signal: float
    signal_slope: float
    detection_rate: float
    sigma: float
    locking: float
    levels: float
    seed: wp.uint32
    spacing: int  # distance of the nodes between which noise is interpolated [px]
    window: int  # half width of a pixel's matching window [px]
    edge_step: float  # smallest difference in disparity between two surfaces [px]


@wp.struct
class StereoViews:
    """Inputs of all views; None if the model does not use them."""

    true_depth: wp.array3d[float]
    other_depth: wp.array3d[float]  # None without shadows
    normals: wp.array3d[wp.vec3]
    segmentation: wp.array3d[wp.int32]
    reflectivity: wp.array[float]  # of objects
    nodes: wp.array3d[float]  # None if every pixel is a node
    weights: wp.array[wp.vec2]  # of the two nodes around a pixel, by its position between them
    column_nodes: wp.array[wp.int32]  # the node to the left of each column, and the weights of both nodes
    left_weights: wp.array[float]
    right_weights: wp.array[float]
    column_slopes: wp.array[float]  # x of the camera-frame ray with z = 1, for each column
    row_slopes: wp.array[float]  # y of that ray, for each row
    draws: wp.array[wp.vec2ui]


@wp.struct
class OtherEye:
    """The position of a view's other eye in the frame of the first one [m], and the axes of both in the world."""

    place: wp.vec3d
    axes: wp.mat33


@wp.kernel
def place_other_eyes(
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    # In:
    baseline: wp.float64,
    # Out:
    pose_out: wp.array[wp.transform],
    eye_out: wp.array[OtherEye],
):
    """Write poses of the other eyes, `baseline` [m] along x, and their actual offset after rounding."""
    view = wp.tid()
    pose = camera_to_world[view]
    rotation = pose_rotation(pose)
    origin = pose_origin(pose)
    position = wp.vec3(origin + wp.quat_rotate(rotation, wp.vec3d(baseline, wp.float64(0.0), wp.float64(0.0))))
    pose_out[view] = wp.transform(position, wp.transform_get_rotation(pose))
    eye = OtherEye()
    eye.place = wp.quat_rotate_inv(rotation, wp.vec3d(position) - origin)
    eye.axes = wp.mat33(wp.quat_to_matrix(rotation))
    eye_out[view] = eye


_IMAGES = """
const int width = views.true_depth.shape[2];
const StereoImages images = {views.true_depth.shape[1], width, views.true_depth.data,
                             views.other_depth.data, (const float*)views.normals.data, views.segmentation.data,
                             views.reflectivity.data, views.nodes.data, views.nodes.shape[1], views.nodes.shape[2],
                             (const float*)views.weights.data, views.column_nodes.data, views.left_weights.data,
                             views.right_weights.data, views.column_slopes.data, views.row_slopes.data,
                             DEPTH_OUT, REASONS_OUT};
"""
_PLACE = (
    _IMAGES.replace("DEPTH_OUT", "nullptr").replace("REASONS_OUT", "nullptr")
    + """
const OtherImage image = {{(float)eye.place[0], (float)eye.place[1], (float)eye.place[2]},
                          {(float)camera.fx, (float)camera.fy}, added_columns, camera.width, camera.height,
                          min_depth};
"""
)
_MEASURE = (
    _IMAGES.replace("DEPTH_OUT", "depth_out.data").replace("REASONS_OUT", "reasons_out.data")
    + """
const Stereo stereo = {model.disparity_scale, model.shift_scale, model.first_column, model.last_column, model.near,
                       model.far, model.max_disparity, model.shadow_tolerance, model.min_support,
                       model.min_signal, model.signal_slope, model.detection_rate, model.sigma, model.locking,
                       model.levels, model.spacing, model.window, model.edge_step};
StereoView seen = {view, {model.seed, draw[0], draw[1]}, {}, (float)eye.place[2]};
for (int k = 0; k < 9; ++k) seen.axes[k] = eye.axes.data[k / 3][k % 3];
"""
)
_NATIVE = PIXEL_NUMBERS + read_native("shared/stereo.h", "shared/stereo_rows.h")


@wp.func_native(_NATIVE + _MEASURE + for_pixels("StereoRows::measure(stereo, images, seen, y, x);"))
def measure_pixels(
    model: StereoModel,
    views: StereoViews,
    eye: OtherEye,
    draw: wp.vec2ui,
    view: int,
    y: int,
    x: int,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


@wp.kernel
def measure_stereo(
    # Cameras:
    eyes: wp.array[OtherEye],
    window: Window,
    # In:
    model: StereoModel,
    views: StereoViews,
    # Out:
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    """Write the measured depth of every pixel, and the reason for missing depth; reasons may be None."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    measure_pixels(model, views, eyes[view], views.draws[view], view, y, x, depth_out, reasons_out)


@wp.func_native(_NATIVE + _PLACE + for_pixels("image.project(images, view, y, x, (float*)points_out.data);"))
def place_pixels(
    camera: PinholeCamera,
    views: StereoViews,
    eye: OtherEye,
    added_columns: float,
    min_depth: float,
    view: int,
    y: int,
    x: int,
    points_out: wp.array3d[wp.vec2],
): ...


@wp.kernel
def place_in_other_eyes(
    # Cameras:
    other: PinholeCamera,
    eyes: wp.array[OtherEye],
    window: Window,
    # In:
    views: StereoViews,
    added_columns: float,
    min_depth: float,
    # Out:
    points_out: wp.array3d[wp.vec2],
):
    """Project every pixel's point into the other eye's image [px], which is extended by `added_columns` on the left.

    The result is NaN if there is no point, if it is nearer than `min_depth`, or if it is outside that image.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    place_pixels(other, views, eyes[view], added_columns, min_depth, view, y, x, points_out)
