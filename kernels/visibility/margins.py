# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Margins of visibility: distances in the image from visible or hidden samples to the nearest pixel that differs."""

import warp as wp

from warpvis.kernels.casting.rays import RayHit, trace_ray
from warpvis.kernels.casting.triangle_scene import TriangleScene, object_of
from warpvis.kernels.casting.worlds import Worlds, is_excluded, world_of
from warpvis.kernels.pinhole import Frame, PinholeCamera, Window, frame_of, locate
from warpvis.kernels.visibility.fractions import (
    HIDDEN,
    VISIBLE,
    Sample,
    Sampling,
    Targets,
    examine,
    find_window,
    is_member,
    meet_target,
    sample_ray,
    unlimited_range,
)
from warpvis.kernels.visibility.nearest_pixels import Nearest, Search, Spot, find_nearest, reach_limit
from warpvis.kernels.visibility.points import locate_point

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

POINT_SCALE = wp.constant(64)
"""Scale of points: their places are rounded to 1/128 px."""
SAMPLE_BITS = wp.constant(wp.int64(28))
LAST_SAMPLE = wp.constant(wp.int64((1 << 28) - 1))
"""A key is a squared distance, above the number of the sample that has it."""
NO_VISIBLE = wp.constant(wp.int64(-1))
NO_HIDDEN = wp.constant(wp.int64((1 << 63) - 1))
"""Keys without a sample."""
PIXELS, DEGREES, METERS = wp.constant(0), wp.constant(1), wp.constant(2)


@wp.func
def place_sample(sample: Sample, target: int, across: int, y: int, x: int) -> Spot:
    spot = Spot()
    spot.x = 2 * x + 1
    spot.y = 2 * y + 1
    spot.scale = across
    spot.depth = sample.depth
    spot.target = target
    spot.owner = -1
    return spot


@wp.func
def view_sample(
    scene: TriangleScene,
    isolated: TriangleScene,
    targets: Targets,
    camera: PinholeCamera,
    cull_backfaces: bool,
    in_world: Frame,
    worlds: Worlds,
    spread_worlds: Worlds,
    search: Search,
    view: int,
    target: int,
    across: int,
    y: int,
    x: int,
    casts_pixels: bool,
) -> Sample:
    """Return what a sample shows of a target, from the images where it is at the center of a pixel.

    If `casts_pixels` is False, only those pixels that show the target are examined.
    """
    sample = Sample()
    sample.occluder = -1
    if across > 1:
        return examine(
            scene,
            isolated,
            targets,
            camera,
            cull_backfaces,
            in_world,
            worlds,
            spread_worlds,
            view,
            target,
            across,
            y,
            x,
        )
    shown, shown_depth = int(-1), float(wp.inf)
    is_in_image = x >= 0 and y >= 0 and x < search.depth.shape[2] and y < search.depth.shape[1]
    if is_in_image:
        shown = search.segmentation[view, y, x]
        shown_depth = search.depth[view, y, x]
    if shown >= 0 and is_member(targets, target, shown):
        sample.state = VISIBLE
        sample.depth = shown_depth
    elif casts_pixels:
        ray = sample_ray(camera, 1, y, x)
        sample.depth = meet_target(
            isolated, targets, camera, cull_backfaces, in_world, spread_worlds, view, target, ray
        )
        if wp.isfinite(sample.depth):
            sample.state = VISIBLE
            if not is_in_image:
                sample.state = HIDDEN
            elif shown_depth < sample.depth:
                sample.state = HIDDEN
                sample.occluder = shown
                sample.occluder_depth = shown_depth
    sample.is_in_image = is_in_image
    return sample


@wp.kernel
def measure_margins(
    # Scene:
    scene: TriangleScene,
    isolated: TriangleScene,
    targets: Targets,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    sampling: Sampling,
    worlds: Worlds,
    spread_worlds: Worlds,
    search: Search,
    # Out:
    visible_out: wp.array2d[wp.int64],
    hidden_out: wp.array2d[wp.int64],
):
    """Raise or lower the keys of targets, (view, target): of the visible sample farthest from blocked pixels, and of
    the hidden sample nearest to a free pixel.

    Keys start at `NO_VISIBLE` and `NO_HIDDEN`. Samples out of the depth range are hidden, and beyond the limit. The
    order of samples is scattered, so that most searches end early, at the distance of an earlier sample.
    """
    view, target, first = wp.tid()
    view, target = locate(window, view, target)
    world = world_of(spread_worlds, view)
    if world < 0:
        return
    in_world = frame_of(camera_to_world[view])
    part = find_window(isolated, camera, in_world, targets, spread_worlds, sampling, view, world, target)
    casts_pixels = search.hidden_only != 0
    if part.across == 0 or (casts_pixels and (part.across > 1 or visible_out[view, target] != NO_VISIBLE)):
        return
    width, height, scale = part.x1 - part.x0, part.y1 - part.y0, part.across
    limit = reach_limit(search.reach, scale)
    samples, rounded = width * height, int(1)
    while rounded < samples:
        rounded *= 2
    for k in range(first, rounded, sampling.threads):
        # A permutation of the numbers below a power of two.
        index = int((wp.int64(k) * wp.int64(2654435769)) & wp.int64(rounded - 1))
        if index < samples:
            y, x = part.y0 + index // width, part.x0 + index % width
            sample = view_sample(
                scene,
                isolated,
                targets,
                camera,
                sampling.cull_backfaces != 0,
                in_world,
                worlds,
                spread_worlds,
                search,
                view,
                target,
                scale,
                y,
                x,
                casts_pixels,
            )
            spot = place_sample(sample, target, scale, y, x)
            number = wp.int64(index)
            if sample.state != 0 and (sample.depth < camera.near or sample.depth > camera.far):
                wp.atomic_min(hidden_out, view, target, ((limit + wp.int64(1)) << SAMPLE_BITS) | number)
            elif sample.state == VISIBLE:
                best = visible_out[view, target] >> SAMPLE_BITS
                if best <= limit:  # else no pixel within reach is blocked for another sample
                    nearest = find_nearest(search, targets, spot, view, True, limit, best)
                    if nearest.squared >= best:
                        key = (nearest.squared << SAMPLE_BITS) | (LAST_SAMPLE - number)
                        wp.atomic_max(visible_out, view, target, key)
            elif sample.state == HIDDEN:
                best = wp.min(hidden_out[view, target] >> SAMPLE_BITS, limit)
                nearest = find_nearest(search, targets, spot, view, False, best, wp.int64(0))
                key = (wp.min(nearest.squared, limit + wp.int64(1)) << SAMPLE_BITS) | number
                wp.atomic_min(hidden_out, view, target, key)


@wp.func
def border_place(found: int, spot: int, size: int, scale: int) -> int:
    """Return the coordinate of the nearest place beyond the border: the spot's own along the border."""
    if found < 0:
        return -scale
    if found >= size:
        return (2 * size + 1) * scale
    return spot


@wp.func
def place_ray(camera: PinholeCamera, y: int, x: int, scale: int) -> wp.vec3d:
    """Return the camera-frame direction through a place with z = 1."""
    unit = wp.float64(2 * scale)
    return wp.vec3d(
        (wp.float64(x) / unit - camera.cx) / camera.fx, (wp.float64(y) / unit - camera.cy) / camera.fy, wp.float64(1.0)
    )


@wp.func
def write_margin(
    results: wp.array3d[float],
    blockers: wp.array2d[wp.int32],
    camera: PinholeCamera,
    search: Search,
    spot: Spot,
    nearest: Nearest,
    sample: Sample,
    view: int,
    index: int,
):
    """Write the margin of a spot, given the nearest pixel that differs; none within reach if `nearest` is beyond it."""
    sign = float(1.0)
    if sample.state != VISIBLE:
        sign = -1.0
    blockers[view, index] = -1
    if nearest.squared > reach_limit(search.reach, wp.max(spot.scale, 1)):
        results[PIXELS, view, index] = sign * search.reach
        results[DEGREES, view, index] = sign * wp.inf
        results[METERS, view, index] = sign * wp.inf
        return
    scale = spot.scale
    x, y = (2 * nearest.x + 1) * scale, (2 * nearest.y + 1) * scale
    depth = spot.depth  # of what has to move: the point itself, if the border of the image decides
    if nearest.is_border:
        x = border_place(nearest.x, spot.x, search.depth.shape[2], scale)
        y = border_place(nearest.y, spot.y, search.depth.shape[1], scale)
    elif sample.state == VISIBLE:
        blockers[view, index] = search.segmentation[view, nearest.y, nearest.x]
        depth = search.depth[view, nearest.y, nearest.x]
    elif sample.is_in_image:
        blockers[view, index] = sample.occluder
        depth = sample.occluder_depth
    p, q = place_ray(camera, spot.y, spot.x, scale), place_ray(camera, y, x, scale)
    distance = wp.sqrt(wp.float64(nearest.squared)) / wp.float64(2 * scale)
    angle = wp.atan2(wp.length(wp.cross(p, q)), wp.dot(p, q)) * wp.float64(57.29577951308232)
    results[PIXELS, view, index] = sign * float(distance)
    results[DEGREES, view, index] = sign * float(angle)
    results[METERS, view, index] = sign * float(wp.float64(depth) * wp.length(p - q))


@wp.func
def write_nothing(results: wp.array3d[float], blockers: wp.array2d[wp.int32], view: int, index: int):
    for row in range(3):
        results[row, view, index] = wp.nan
    blockers[view, index] = -1


@wp.kernel
def judge_margins(
    # Scene:
    scene: TriangleScene,
    isolated: TriangleScene,
    targets: Targets,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    # In:
    sampling: Sampling,
    worlds: Worlds,
    spread_worlds: Worlds,
    search: Search,
    keys: wp.array3d[wp.int64],
    # Out:
    results_out: wp.array3d[float],
    blockers_out: wp.array2d[wp.int32],
):
    """Write the margins of targets, (quantity, view, target), from the keys of their deciding samples."""
    view, target = wp.tid()
    write_nothing(results_out, blockers_out, view, target)
    world = world_of(spread_worlds, view)
    if world < 0:
        return
    is_present = bool(False)
    for i in range(targets.first[target], targets.first[target + 1]):
        if not is_excluded(worlds, view, targets.members[i]):
            is_present = True
    if not is_present:
        return
    in_world = frame_of(camera_to_world[view])
    part = find_window(isolated, camera, in_world, targets, spread_worlds, sampling, view, world, target)
    visible, hidden, scale = keys[0, view, target], keys[1, view, target], part.across
    sample, spot, nearest = Sample(), Spot(), Nearest()
    limit = reach_limit(search.reach, wp.max(scale, 1))
    nearest.squared = limit + wp.int64(1)
    if visible != NO_VISIBLE or hidden != NO_HIDDEN:
        index = int(hidden & LAST_SAMPLE)
        if visible != NO_VISIBLE:
            index = int(LAST_SAMPLE - (visible & LAST_SAMPLE))
        y, x = part.y0 + index // (part.x1 - part.x0), part.x0 + index % (part.x1 - part.x0)
        sample = view_sample(
            scene,
            isolated,
            targets,
            camera,
            sampling.cull_backfaces != 0,
            in_world,
            worlds,
            spread_worlds,
            search,
            view,
            target,
            scale,
            y,
            x,
            True,
        )
        spot = place_sample(sample, target, scale, y, x)
        if sample.depth < camera.near or sample.depth > camera.far:
            sample.state = HIDDEN
        else:
            nearest = find_nearest(search, targets, spot, view, sample.state == VISIBLE, limit, wp.int64(0))
    elif scale > 0:
        # No sample meets the target, although its box is in the image: it may be thinner than their distance.
        canvas = sampling.canvas
        is_whole = part.x0 == canvas.x0 and part.y0 == canvas.y0 and part.x1 == canvas.x1 and part.y1 == canvas.y1
        width, height = search.depth.shape[2] * scale, search.depth.shape[1] * scale
        if not is_whole and part.x1 > 0 and part.y1 > 0 and part.x0 < width and part.y0 < height:
            return
    write_margin(results_out, blockers_out, camera, search, spot, nearest, sample, view, target)


@wp.func
def shown_object(scene: TriangleScene, hit: RayHit) -> int:
    """Return the object that a ray hit."""
    if hit.round:
        return scene.movable_object[hit.movable]
    return object_of(scene, hit.movable, hit.face)


@wp.kernel
def measure_point_margins(
    # Scene:
    scene: TriangleScene,
    targets: Targets,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    points: wp.array[wp.vec3],
    tolerance: float,
    search: Search,
    # Out:
    results_out: wp.array3d[float],
    blockers_out: wp.array2d[wp.int32],
):
    """Write the margins of points, (quantity, view, point). `targets` may be empty.

    A point is visible up to `tolerance` behind the first surface along its ray [m], see `points.judge`. Pixels that
    show the object whose surface is that close to the point never block it.
    """
    view, row, column = wp.tid()
    view, index = locate_point(window, view, row, column)
    if index >= points.shape[0]:
        return

    in_world = frame_of(camera_to_world[view])
    p = wp.quat_rotate_inv(in_world.rotation, wp.vec3d(points[index]) - in_world.origin)
    sample, spot, nearest = Sample(), Spot(), Nearest()
    sample.occluder = -1
    spot.scale = POINT_SCALE
    spot.target = -1
    spot.owner = -1
    limit = reach_limit(search.reach, POINT_SCALE)
    nearest.squared = limit + wp.int64(1)
    depth = float(p[2])
    width, height, border = wp.float64(camera.width), wp.float64(camera.height), wp.float64(search.reach + 1.0)
    x, y = camera.fx * p[0] + camera.cx * p[2], camera.fy * p[1] + camera.cy * p[2]
    is_near = x > -border * p[2] and x < (width + border) * p[2] and y > -border * p[2] and y < (height + border) * p[2]
    if p[2] > wp.float64(0.0) and is_near and depth >= camera.near and depth <= camera.far:
        unit, half, zero = wp.float64(2 * POINT_SCALE), wp.float64(0.5), wp.float64(0.0)
        spot.x = int(wp.floor(x / p[2] * unit + half))
        spot.y = int(wp.floor(y / p[2] * unit + half))
        sample.is_in_image = x >= zero and y >= zero and x < width * p[2] and y < height * p[2]
        ray = p / p[2]
        allowed = tolerance / float(wp.length(ray))
        spot.depth = depth - allowed
        sample.depth = depth
        if sample.is_in_image:
            hit = trace_ray(scene, unlimited_range(camera), in_world, worlds, worlds, view, ray, False)
            sample.state = VISIBLE
            if hit.face >= 0:
                if hit.depth < spot.depth:
                    sample.state = HIDDEN
                    sample.occluder = shown_object(scene, hit)
                    sample.occluder_depth = hit.depth
                elif hit.depth <= depth + allowed:
                    spot.owner = shown_object(scene, hit)
        nearest = find_nearest(search, targets, spot, view, sample.state == VISIBLE, limit, wp.int64(0))
    write_margin(results_out, blockers_out, camera, search, spot, nearest, sample, view, index)
