# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stereo depth by triangulation: the view of the other eye, and the disparity of a matcher.

The other eye, a second imager or a projector, has the same axes as the first one and lies on its x axis. Its position
is rounded to single precision, as all poses are; the resulting offset is taken into account in double precision.
"""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate, pose_origin, pose_rotation
from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs

wp.set_module_options(pixel_options("shared/stereo.h"))


@wp.struct
class SmoothField:
    """Standard normal numbers at nodes, and the weights that interpolate them; None if every pixel is a node."""

    nodes: wp.array3d[float]
    spacing: int  # distance of the nodes [px]
    weights: wp.array[wp.vec2]  # of the two nodes around a pixel, by its position between them
    column_nodes: wp.array[wp.int32]  # the node to the left of each column, and the weights of both nodes
    left_weights: wp.array[float]
    right_weights: wp.array[float]


@wp.struct
class StereoModel:
    """Parameters of `warpvis.sensors.StereoDepth` for a camera, and arrays; None if they are not used."""

    disparity_scale: float  # focal length times baseline [px m]: disparity is this divided by depth
    shift_scale: float  # the same in pixels of the image, positive if the other eye is on the right
    first_column: float  # of the other eye's image [px]
    last_column: float
    max_disparity: float  # [px]
    shadow_tolerance: float  # [px]
    min_support: float
    min_signal: float  # at which pixels begin to be detected
    signal_slope: float  # of the detection probability
    detection_rate: float  # fraction of pixels with sufficient signal that are detected
    sigma: float  # [px]
    locking: float  # [px]
    levels: float  # subpixel steps per pixel of disparity; 0 disables quantization
    window: int  # half width of a pixel's matching window [px]
    edge_step: float  # smallest difference in disparity between two surfaces [px]
    other_width: float  # of the other eye's image, for shadows [px]
    added_columns: float  # of that image, to the left of the first one's [px]
    min_depth: float  # nearer points are not projected into that image [m]
    other_depth: wp.array3d[float]  # that the other eye measures at the point of each pixel; None without shadows
    noise: SmoothField  # of disparity
    holes: SmoothField  # that decides which pixels are lost
    column_slopes: wp.array[float]  # x of the camera-frame ray with z = 1, for each column
    row_slopes: wp.array[float]  # y of that ray, for each row


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


@wp.func_native("warpvis::measure<warpvis::Stereo>(warpvis::sensor_row(inputs, images_out, view, y), x, model, eye);")
def measure_pixels(
    model: StereoModel,
    inputs: SensorInputs,
    eye: OtherEye,
    view: int,
    y: int,
    x: int,
    images_out: MeasuredImages,
): ...


@wp.kernel(cuda_max_registers=64)
def measure_stereo(
    # Cameras:
    eyes: wp.array[OtherEye],
    window: Window,
    # In:
    model: StereoModel,
    inputs: SensorInputs,
    # Out:
    images_out: MeasuredImages,
):
    """Write the measured depth of every pixel, and the reason for missing depth."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    measure_pixels(model, inputs, eyes[view], view, y, x, images_out)


@wp.func_native(
    """
warpvis::measure<warpvis::OtherPoints>(warpvis::sensor_row(inputs, view, y), x, model, eye, points_out, limits_out);
"""
)
def place_pixels(
    model: StereoModel,
    inputs: SensorInputs,
    eye: OtherEye,
    view: int,
    y: int,
    x: int,
    points_out: wp.array3d[wp.vec2],
    limits_out: wp.array3d[float],
): ...


@wp.kernel
def place_in_other_eyes(
    # Cameras:
    eyes: wp.array[OtherEye],
    window: Window,
    # In:
    model: StereoModel,
    inputs: SensorInputs,
    # Out:
    points_out: wp.array3d[wp.vec2],
    limits_out: wp.array3d[float],
):
    """Project every pixel's point into the other eye's image [px], which has `model.added_columns` on the left.

    The result is NaN if there is no point, if it is nearer than `model.min_depth`, or if it is outside that image.
    `limits_out`, which may be None, is an inverse depth [1/m]: only nearer surfaces can hide the point.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    place_pixels(model, inputs, eyes[view], view, y, x, points_out, limits_out)
