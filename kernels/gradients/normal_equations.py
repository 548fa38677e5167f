# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Normal equations of poses from the difference of measured and rendered depth, pixel by pixel.

A twist is (rotation, translation) in the world frame, as in small_gicp, and moves points p to
``c + exp(rotation) (p - c) + translation``, where c is the origin of the moved frame: of the camera or of the object.
"""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds, row_of
from warpvis.kernels.maps.classify import has_depth
from warpvis.kernels.maps.compare_depth import Criteria, sigma_at
from warpvis.kernels.pinhole import Window, locate, pose_origin, pose_rotation

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

HALF = wp.constant(wp.float64(0.5))
ONE = wp.constant(wp.float64(1.0))


@wp.struct
class Weighting:
    """Which pixels are used, and with which weight: `warpvis.register`."""

    criteria: Criteria  # range of depth [m], and distances of tabulated standard deviations
    huber: wp.float64  # standard deviations above which the cost is linear
    max_distance: wp.float64  # distance from the rendered surface of inliers [m]
    min_cosine: wp.float64  # of the angle between ray and normal
    max_jump: float  # depth discontinuity of the rendered image at which pixels are ignored [m]
    column: int  # column of the object's poses, -1 if the camera moves


@wp.struct
class Strips:
    """How pixels of a view are distributed to strips, each of which one CPU thread or one warp adds up."""

    width: int  # image width [px]
    pixels: int  # pixels of a view
    size: int  # largest number of pixels of a strip
    lanes: int  # threads of a strip: 32 on CUDA, a warp; 1 on a CPU


@wp.struct
class Rendered:
    """Rendered images of some views, (slot, pixel)."""

    views: wp.array[int]
    """View of each slot."""
    depth: wp.array2d[float]
    normals: wp.array2d[wp.vec3]
    objects: wp.array2d[int]
    """Indices of objects; None if the camera moves."""


@wp.struct
class Term:
    """What a pixel adds to the sums."""

    moment: wp.vec3d  # derivative of the residual with respect to rotation
    normal: wp.vec3d  # and translation
    residual: wp.float64  # measured minus rendered depth, in standard deviations
    weight: wp.float64  # of the square of the residual; 0 for pixels that are no inliers
    cost: wp.float64


@wp.func
def robust_cost(residual: wp.float64, huber: wp.float64) -> wp.float64:
    """Return Huber's cost: half the square of the residual up to `huber`, and linear above."""
    size = wp.abs(residual)
    if size <= huber:
        return HALF * size * size
    return huber * (size - HALF * huber)


@wp.func
def is_jump(rendered: Rendered, slot: int, pixel: int, step: int, max_jump: float) -> bool:
    """Return whether depth is discontinuous between the neighbors of a pixel: inverse depth is linear on a plane."""
    depth = rendered.depth[slot, pixel]
    inverse = 1.0 / rendered.depth[slot, pixel - step] + 1.0 / rendered.depth[slot, pixel + step]
    return wp.abs(depth * (depth * inverse - 2.0)) > max_jump


@wp.func
def at_edge(strips: Strips, rendered: Rendered, slot: int, pixel: int, max_jump: float) -> bool:
    """Return whether a pixel is at a depth discontinuity of the rendered image."""
    x = pixel % strips.width
    if x > 0 and x < strips.width - 1:
        if is_jump(rendered, slot, pixel, 1, max_jump):
            return True
    if pixel >= strips.width and pixel < strips.pixels - strips.width:
        return is_jump(rendered, slot, pixel, strips.width, max_jump)
    return False


@wp.func
def term_of(
    weighting: Weighting,
    sigmas: wp.array[float],
    measured: float,
    rendered: float,
    normal: wp.vec3d,
    ray: wp.vec3d,
    offset: wp.vec3d,
) -> Term:
    """Return the term of a pixel with two depths; ray and offset are in the world frame.

    The ray begins at `offset` from the center of the twist. The residual is the distance of the measured point p from
    the rendered plane, divided by the standard deviation of that distance: q (z_m - z_r) / (|q| sigma), with the
    component q of the ray along the normal n. Its derivative with respect to a twist of the camera is
    ``((p - c) x n, n) / (q sigma)``.
    """
    term = Term()
    sigma = wp.float64(sigma_at(weighting.criteria, sigmas, rendered))
    difference = wp.float64(measured) - wp.float64(rendered)
    residual = difference / sigma
    limit = weighting.max_distance / sigma
    term.cost = robust_cost(wp.min(wp.abs(residual), limit), weighting.huber)
    along = wp.dot(normal, ray)
    smallest = weighting.min_cosine * weighting.min_cosine * wp.dot(ray, ray)
    if wp.abs(along * difference) > weighting.max_distance or not along * along > smallest:
        return term
    scaled = normal / (along * sigma)
    if weighting.column >= 0:
        scaled = -scaled
    term.moment = wp.cross(offset + wp.float64(measured) * ray, scaled)
    term.normal = scaled
    term.residual = residual
    term.weight = wp.min(ONE, weighting.huber / wp.max(wp.abs(residual), weighting.huber))
    return term


@wp.func_native("""
#if defined(__CUDA_ARCH__)
for (int other = 16; other; other >>= 1) value += __shfl_xor_sync(0xffffffffu, value, other);
#endif
return value;
""")
def add_lanes(value: wp.float64) -> wp.float64:
    """Return the sum of the numbers of a warp, the same bits in all of its threads; on a CPU, the number."""
    ...


@wp.func
def write_sum(value: wp.float64, lane: int, slot: int, strip: int, column: int, strips_out: wp.array3d[wp.float64]):
    """Write a sum from the first thread of a strip."""
    if lane == 0:
        strips_out[slot, strip, column] = value


@wp.func
def column_of(table: wp.array2d[wp.float64], pixel: int) -> wp.vec3d:
    return wp.vec3d(table[0, pixel], table[1, pixel], table[2, pixel])


@wp.kernel
def sum_terms(
    # Scene:
    object_columns: wp.array[int],
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    rays_in: wp.array2d[wp.float64],
    origins_in: wp.array2d[wp.float64],
    # In:
    window: Window,
    weighting: Weighting,
    strips: Strips,
    sigmas: wp.array[float],
    object_poses: wp.array2d[wp.transform],
    rendered: Rendered,
    measured_in: wp.array2d[float],
    # Out:
    strips_out: wp.array3d[wp.float64],
):
    """Add the terms of the pixels of every strip of every slot: (slot, strip, sum).

    The sums are the rows of H (36), b (6), the cost e, and the numbers of inliers and of measured pixels. Inliers are
    pixels of the moving object, or of all surfaces if the camera moves. The cost is of all measured pixels, and
    saturates at `max_distance`, so that costs of different poses are comparable.
    """
    slot, strip, lane = wp.tid()
    slot, strip = locate(window, slot, strip)

    pose = camera_to_world[slot]
    rotation = wp.quat_to_matrix(pose_rotation(pose))
    base = wp.vec3d()
    if weighting.column >= 0:
        base = pose_origin(pose) - pose_origin(object_poses[slot, weighting.column])
    image = wp.min(rendered.views[slot], measured_in.shape[0] - 1)

    rotations, mixed, translations = wp.mat33d(), wp.mat33d(), wp.mat33d()
    b_rotation, b_translation = wp.vec3d(), wp.vec3d()
    cost = wp.float64(0.0)
    inliers = int(0)
    measurements = int(0)
    first = strip * strips.size
    for pixel in range(first + lane, wp.min(first + strips.size, strips.pixels), strips.lanes):
        measured = measured_in[image, pixel]
        if not has_depth(measured, weighting.criteria.near, weighting.criteria.far):
            continue
        ray = column_of(rays_in, pixel)
        if not ray[0] == ray[0]:
            continue
        measurements += 1
        depth = rendered.depth[slot, pixel]
        if not wp.isfinite(depth):
            limit = weighting.max_distance / wp.float64(sigma_at(weighting.criteria, sigmas, measured))
            cost += robust_cost(limit, weighting.huber)
            continue
        ray = rotation * ray
        offset = base
        if origins_in:
            offset += rotation * column_of(origins_in, pixel)
        term = term_of(weighting, sigmas, measured, depth, wp.vec3d(rendered.normals[slot, pixel]), ray, offset)
        cost += term.cost
        if term.weight == wp.float64(0.0):
            continue
        if weighting.column >= 0:
            if object_columns[rendered.objects[slot, pixel]] != weighting.column:
                continue
        if weighting.max_jump < wp.inf:
            if at_edge(strips, rendered, slot, pixel, weighting.max_jump):
                continue
        inliers += 1
        moment, normal = term.weight * term.moment, term.weight * term.normal
        rotations += wp.outer(moment, term.moment)
        mixed += wp.outer(moment, term.normal)
        translations += wp.outer(normal, term.normal)
        b_rotation += term.residual * moment
        b_translation += term.residual * normal

    for i in range(3):
        for k in range(3):
            write_sum(add_lanes(rotations[i, k]), lane, slot, strip, 6 * i + k, strips_out)
            write_sum(add_lanes(mixed[i, k]), lane, slot, strip, 6 * i + 3 + k, strips_out)
            write_sum(add_lanes(mixed[k, i]), lane, slot, strip, 18 + 6 * i + k, strips_out)
            write_sum(add_lanes(translations[i, k]), lane, slot, strip, 21 + 6 * i + k, strips_out)
        write_sum(add_lanes(b_rotation[i]), lane, slot, strip, 36 + i, strips_out)
        write_sum(add_lanes(b_translation[i]), lane, slot, strip, 39 + i, strips_out)
    write_sum(add_lanes(cost), lane, slot, strip, 42, strips_out)
    write_sum(add_lanes(wp.float64(inliers)), lane, slot, strip, 43, strips_out)
    write_sum(add_lanes(wp.float64(measurements)), lane, slot, strip, 44, strips_out)


@wp.kernel
def add_strips(
    # In:
    views: wp.array[int],
    lanes: int,
    strips_in: wp.array3d[wp.float64],
    # Out:
    sums_out: wp.array2d[wp.float64],
):
    """Add the sums of the strips of each slot in a fixed order, and write them to the row of the slot's view.

    `lanes` threads add a sum: (slot, sum, lane).
    """
    slot, k, lane = wp.tid()
    total = wp.float64(0.0)
    for strip in range(lane, strips_in.shape[1], lanes):
        total += strips_in[slot, strip, k]
    total = add_lanes(total)
    if lane == 0:
        sums_out[views[slot], k] = total


@wp.kernel
def spread_object_poses(
    # In:
    worlds: Worlds,
    # Out:
    poses_out: wp.array2d[wp.transform],
):
    """Write the object poses of every view, (view, movable object)."""
    view, movable = wp.tid()
    poses_out[view, movable] = worlds.object_poses[row_of(worlds, view, worlds.object_poses.shape[0]), movable]
