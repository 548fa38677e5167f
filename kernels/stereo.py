# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth by triangulation: what the other eye sees of each point, and what a matcher makes of it.

The other eye, a second imager or a projector, has the first one's axes and stands on its x axis. Its place is rounded
to single precision as all poses are; what that moves it by is taken into account, in double precision.
"""

import warp as wp

from warpvis.kernels.constants import STREAM_DISPARITY, STREAM_DROPOUT
from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera, Window, pixel_ray, pose_origin, pose_rotation
from warpvis.kernels.random_numbers import random_word, to_normal, to_uniform

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

NOISE_STREAM = wp.constant(wp.uint32(STREAM_DISPARITY))
CHANCE_STREAM = wp.constant(wp.uint32(STREAM_DROPOUT))


@wp.struct
class StereoModel:
    """What `Stereo` of ``native/shared/stereo.h`` holds, and what is looked up for it."""

    disparity_scale: float
    shift_scale: float
    first_column: float
    last_column: float
    near: float
    far: float
    most_disparity: float
    shadow_tolerance: float
    least_support: float
    least_signal: float
    signal_slope: float
    kept: float
    sigma: float
    locking: float
    levels: float
    seed: wp.uint32
    spacing: int  # of the nodes between which noise is interpolated [px]
    window: int  # how far the window of a pixel reaches [px]
    edge_step: float  # disparities that differ by so much are of different surfaces [px]


@wp.struct
class StereoViews:
    """What is read of every view; None where the model does not need it."""

    true_depth: wp.array3d[float]
    other_depth: wp.array3d[float]  # None without shadows
    normals: wp.array3d[wp.vec3]
    segmentation: wp.array3d[wp.int32]
    reflectivity: wp.array[float]  # of objects
    nodes: wp.array3d[float]  # None if every pixel is one
    weights: wp.array[wp.vec2]  # of the two nodes beside a pixel, by its place between them
    draws: wp.array[wp.vec2ui]


@wp.struct
class OtherEye:
    """Where the other eye of a view is in the first one's frame [m], and the first one's axes in the world."""

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
    """Write poses of the other eyes, `baseline` [m] along x, as single precision has them, and what follows."""
    view = wp.tid()
    pose = camera_to_world[view]
    rotation = pose_rotation(pose)
    origin = pose_origin(pose)
    place = wp.vec3(origin + wp.quat_rotate(rotation, wp.vec3d(baseline, wp.float64(0.0), wp.float64(0.0))))
    pose_out[view] = wp.transform(place, wp.transform_get_rotation(pose))
    eye = OtherEye()
    eye.place = wp.quat_rotate_inv(rotation, wp.vec3d(place) - origin)
    eye.axes = wp.mat33(wp.quat_to_matrix(rotation))
    eye_out[view] = eye


@wp.kernel
def place_in_other_eyes(
    # Cameras:
    camera: PinholeCamera,
    other: PinholeCamera,
    eyes: wp.array[OtherEye],
    window: Window,
    # In:
    true_depth: wp.array3d[float],
    least_depth: float,
    # Out:
    points_out: wp.array3d[wp.vec2],
):
    """Write where every pixel's point is in the other eye's image [px]; NaN where there is none or it is nearer than
    `least_depth`, or if it is not in that image.
    """
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row
    depth = true_depth[view, y, x]
    at = wp.vec2(wp.nan, wp.nan)
    if depth < wp.inf and depth >= least_depth:
        p = wp.float64(depth) * pixel_ray(camera, y, x) - eyes[view].place
        column, row = other.fx * p[0] / p[2] + other.cx, other.fy * p[1] / p[2] + other.cy
        # What rounding puts beyond the upper or lower edge is in the image: rows of both eyes are the same.
        row = wp.clamp(row, wp.float64(0.0), wp.float64(other.height * 0.99999994))
        if column >= wp.float64(0.0) and column < wp.float64(other.width):
            at = wp.vec2(wp.min(float(column), other.width * 0.99999994), float(row))
    points_out[view, y, x] = at


@wp.func
def same_surface(model: StereoModel, depth: float, other: float) -> bool:
    """Whether two depths are of disparities that differ by less than `edge_step`."""
    return model.disparity_scale * wp.abs(depth - other) < model.edge_step * depth * other


@wp.func
def measure_support(model: StereoModel, true_depth: wp.array3d[float], view: int, y: int, x: int) -> float:
    """The share of a pixel's row of the window that is of its surface, times that of its column; of the image only."""
    if model.window == 0:
        return 1.0
    depth = true_depth[view, y, x]
    in_row, of_row, in_column, of_column = float(0.0), float(0.0), float(0.0), float(0.0)
    for i in range(wp.max(x - model.window, 0), wp.min(x + model.window + 1, true_depth.shape[2])):
        of_row += 1.0
        if same_surface(model, depth, true_depth[view, y, i]):
            in_row += 1.0
    for i in range(wp.max(y - model.window, 0), wp.min(y + model.window + 1, true_depth.shape[1])):
        of_column += 1.0
        if same_surface(model, depth, true_depth[view, i, x]):
            in_column += 1.0
    return (in_row / of_row) * (in_column / of_column)


@wp.func
def draw_noise(model: StereoModel, given: StereoViews, view: int, y: int, x: int) -> float:
    """A standard normal number, interpolated between nodes by weights whose squares add up to one."""
    if model.spacing == 1:
        number = given.draws[view]
        return to_normal(random_word(model.seed, NOISE_STREAM, number[0], number[1], y, x))
    column, row = x / model.spacing, y / model.spacing
    across, down = given.weights[x - column * model.spacing], given.weights[y - row * model.spacing]
    above = across[0] * given.nodes[view, row, column] + across[1] * given.nodes[view, row, column + 1]
    below = across[0] * given.nodes[view, row + 1, column] + across[1] * given.nodes[view, row + 1, column + 1]
    return down[0] * above + down[1] * below


@wp.func
def measure_cosine(camera: PinholeCamera, axes: wp.mat33, normal: wp.vec3, y: int, x: int) -> float:
    """The cosine between a pixel's ray and the normal of what it meets."""
    ray = wp.vec3(pixel_ray(camera, y, x))
    return wp.abs(wp.dot(normal, axes * ray)) / wp.sqrt(wp.dot(ray, ray))


@wp.func_native(
    read_native("shared/constants.h", "shared/scalar.h", "shared/stereo.h")
    + """
const Stereo stereo = {model.disparity_scale, model.shift_scale, model.first_column, model.last_column, model.near,
                       model.far, model.most_disparity, model.shadow_tolerance, model.least_support,
                       model.least_signal, model.signal_slope, model.kept, model.sigma, model.locking, model.levels};
const StereoPixel pixel = {depth, far_depth, other_depth, column, support, cosine, reflectivity, noise, chance};
Real said;
Whole reason;
stereo.measure(pixel, said, reason);
depth_out.data[place] = said;
if (reasons_out.data) reasons_out.data[place] = (unsigned char)reason;
"""
)
def measure_pixel(
    model: StereoModel,
    depth: float,
    far_depth: float,
    other_depth: float,
    column: float,
    support: float,
    cosine: float,
    reflectivity: float,
    noise: float,
    chance: float,
    place: wp.int64,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


@wp.kernel
def measure_stereo(
    # Cameras:
    camera: PinholeCamera,
    eyes: wp.array[OtherEye],
    window: Window,
    # In:
    model: StereoModel,
    given: StereoViews,
    # Out:
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    """Write what the sensor says of every pixel, and why it says nothing; reasons may be None."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row

    eye = eyes[view]
    depth = given.true_depth[view, y, x]
    other_depth = float(wp.inf)
    if given.other_depth:
        other_depth = given.other_depth[view, y, x]
    cosine, reflectivity = float(1.0), float(1.0)
    if given.normals:
        cosine = measure_cosine(camera, eye.axes, given.normals[view, y, x], y, x)
    if given.segmentation:
        hit = given.segmentation[view, y, x]
        if hit >= 0:
            reflectivity = given.reflectivity[hit]
    number = given.draws[view]
    noise, chance = float(0.0), float(0.0)
    if model.sigma > 0.0:
        noise = draw_noise(model, given, view, y, x)
    if given.normals or model.kept < 1.0:
        chance = to_uniform(random_word(model.seed, CHANCE_STREAM, number[0], number[1], y, x))
    support = measure_support(model, given.true_depth, view, y, x)
    height, width = given.true_depth.shape[1], given.true_depth.shape[2]
    place = (wp.int64(view) * wp.int64(height) + wp.int64(y)) * wp.int64(width) + wp.int64(x)
    far_depth = float(wp.float64(depth) - eye.place[2])
    column = float(x) + 0.5
    measure_pixel(
        model,
        depth,
        far_depth,
        other_depth,
        column,
        support,
        cosine,
        reflectivity,
        noise,
        chance,
        place,
        depth_out,
        reasons_out,
    )
