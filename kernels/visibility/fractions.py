# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions of targets by rays: only through the pixels that a target may cover, or more finely if it is small.

A target is one or several objects. Each pixel has an odd number of samples along its side, so that one is at its
center. The same is done by packets on CPU cores, see ``native/cpu/fractions.h``.
"""

import warp as wp

from warpvis.kernels.casting.rays import FARTHEST, RayRange, measure, meet_object, no_hit, object_frame, trace_ray
from warpvis.kernels.casting.triangle_scene import TriangleScene, factors_of, object_of, seen_from
from warpvis.kernels.casting.worlds import Worlds, is_excluded, world_of
from warpvis.kernels.constants import (
    FRACTION_BOX,
    IMAGE_SAMPLES,
    MAX_SAMPLES_ACROSS,
    SAMPLES_ACROSS,
    SILHOUETTE_CENTERS,
    SILHOUETTE_EDGES,
    SILHOUETTE_SAMPLES,
    STATE_EDGES,
    TOO_FAR_SAMPLES,
    TOO_NEAR_SAMPLES,
    VISIBLE_CENTERS,
    VISIBLE_SAMPLES,
)
from warpvis.kernels.pinhole import Frame, PinholeCamera, Window, clip_depth, frame_of, locate
from warpvis.kernels.visibility.silhouettes import Canvas, high_code, low_code

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

HIDDEN, VISIBLE = wp.constant(1), wp.constant(2)


@wp.struct
class Targets:
    """Sets of objects whose fractions are measured, and the boxes of all objects in their own frames."""

    first: wp.array[wp.int32]
    """(target + 1): the target's first object in `members`."""
    members: wp.array[wp.int32]
    boxes: wp.array2d[wp.vec3]
    """(object, 2): lower and upper corner [m]."""


@wp.struct
class Sampling:
    """How densely targets are sampled, and the number of threads that share a target in a view."""

    canvas: Canvas
    min_samples: int
    """Minimum number of samples of the rectangle that a target may cover."""
    cull_backfaces: int
    threads: int


@wp.struct
class SampleWindow:
    """The rectangle of a canvas that a target may cover, in samples from the image's first one; ends are exclusive."""

    across: int
    """Number of samples along the side of a pixel; 0 if the rectangle is empty."""
    x0: int
    y0: int
    x1: int
    y1: int


@wp.struct
class Sample:
    """What a sample of a target shows."""

    state: int
    """0 where the target is not, HIDDEN or VISIBLE."""
    is_in_image: bool
    depth: float
    """Depth of the target [m]."""
    occluder: int
    """The object that hides it; -1 if none does."""
    occluder_depth: float
    """Depth of that object [m]."""


@wp.func
def find_window(
    isolated: TriangleScene,
    camera: PinholeCamera,
    in_world: Frame,
    targets: Targets,
    worlds: Worlds,
    sampling: Sampling,
    view: int,
    world: int,
    target: int,
) -> SampleWindow:
    """Return the window of a target: all of the canvas, sampled at pixels, if a box is partly behind the camera."""
    canvas = sampling.canvas
    x0, y0 = wp.float64(1.0e30), wp.float64(1.0e30)
    x1, y1 = wp.float64(-1.0e30), wp.float64(-1.0e30)
    crosses = bool(False)
    for i in range(targets.first[target], targets.first[target + 1]):
        index = targets.members[i]
        if is_excluded(worlds, view, index):
            continue
        frame = seen_from(in_world, frame_of(worlds.object_poses[world, index]))
        factors = factors_of(isolated, worlds, world, index)
        low, high = targets.boxes[index, 0], targets.boxes[index, 1]
        behind = int(0)
        for k in range(8):
            place = wp.vec3d(low)
            for axis in range(3):
                if (k >> axis) & 1 != 0:
                    place[axis] = wp.float64(high[axis])
            p = wp.quat_rotate_inv(frame.rotation, wp.cw_mul(factors, place) - frame.origin)
            if p[2] <= wp.float64(0.0):
                behind += 1
            else:
                x, y = camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy
                x0, y0 = wp.min(x0, x), wp.min(y0, y)
                x1, y1 = wp.max(x1, x), wp.max(y1, y)
        if behind > 0 and behind < 8:
            crosses = True
    window = SampleWindow()
    if crosses:
        window.across = 1
        window.x0 = canvas.x0
        window.y0 = canvas.y0
        window.x1 = canvas.x1
        window.y1 = canvas.y1
        return window
    x0, y0 = wp.max(x0, wp.float64(canvas.x0)), wp.max(y0, wp.float64(canvas.y0))
    x1, y1 = wp.min(x1, wp.float64(canvas.x1)), wp.min(y1, wp.float64(canvas.y1))
    if x0 > x1 or y0 > y1:
        return window
    across, one = int(1), wp.float64(1.0)
    while across < MAX_SAMPLES_ACROSS:
        columns, rows = (x1 - x0) * wp.float64(across) + one, (y1 - y0) * wp.float64(across) + one
        if columns * rows >= wp.float64(sampling.min_samples):
            break
        across += 2
    scale = wp.float64(across)
    window.across = across
    window.x0 = wp.max(int(wp.floor(x0 * scale)) - 1, canvas.x0 * across)
    window.y0 = wp.max(int(wp.floor(y0 * scale)) - 1, canvas.y0 * across)
    window.x1 = wp.min(int(wp.ceil(x1 * scale)) + 1, canvas.x1 * across)
    window.y1 = wp.min(int(wp.ceil(y1 * scale)) + 1, canvas.y1 * across)
    return window


@wp.func
def is_member(targets: Targets, target: int, index: int) -> bool:
    for i in range(targets.first[target], targets.first[target + 1]):
        if targets.members[i] == index:
            return True
    return False


@wp.func
def sample_ray(camera: PinholeCamera, across: int, y: int, x: int) -> wp.vec3d:
    """Return the camera-frame direction through a sample with z = 1."""
    half, scale = wp.float64(0.5), wp.float64(across)
    return wp.vec3d(
        ((wp.float64(x) + half) / scale - camera.cx) / camera.fx,
        ((wp.float64(y) + half) / scale - camera.cy) / camera.fy,
        wp.float64(1.0),
    )


@wp.func
def unlimited_range(camera: PinholeCamera) -> RayRange:
    """Return the range of rays that meet all surfaces, but for those that the near plane cuts away."""
    range_of_rays = RayRange()
    range_of_rays.far = wp.inf
    range_of_rays.clip = clip_depth(camera)
    range_of_rays.is_planar = True
    return range_of_rays


@wp.func
def meet_target(
    isolated: TriangleScene,
    targets: Targets,
    camera: PinholeCamera,
    cull_backfaces: bool,
    in_world: Frame,
    spread_worlds: Worlds,
    view: int,
    target: int,
    ray: wp.vec3d,
) -> float:
    """Return the depth of a target's nearest surface along a ray, ignoring other objects; +inf for a miss."""
    world = world_of(spread_worlds, view)
    range_of_rays = unlimited_range(camera)
    own = no_hit()
    own.depth = float(FARTHEST)
    for i in range(targets.first[target], targets.first[target + 1]):
        index = targets.members[i]
        frame = seen_from(in_world, object_frame(isolated, spread_worlds, world, index))
        own = meet_object(
            isolated, spread_worlds, world, view, index, frame, ray, range_of_rays.clip, cull_backfaces, own
        )
    if own.face < 0:
        return wp.inf
    frame = seen_from(in_world, object_frame(isolated, spread_worlds, world, own.movable))
    return measure(isolated, spread_worlds, world, frame, range_of_rays, ray, own).depth


@wp.func
def examine(
    scene: TriangleScene,
    isolated: TriangleScene,
    targets: Targets,
    camera: PinholeCamera,
    cull_backfaces: bool,
    in_world: Frame,
    worlds: Worlds,
    spread_worlds: Worlds,
    view: int,
    target: int,
    across: int,
    y: int,
    x: int,
) -> Sample:
    """Return what a sample shows of a target: its nearest surface, and whether another object is in front of it."""
    ray = sample_ray(camera, across, y, x)
    sample = Sample()
    sample.occluder = -1
    depth = meet_target(isolated, targets, camera, cull_backfaces, in_world, spread_worlds, view, target, ray)
    if not wp.isfinite(depth):
        return sample
    sample.state = HIDDEN
    sample.depth = depth
    sample.is_in_image = x >= 0 and y >= 0 and x < int(camera.width) * across and y < int(camera.height) * across
    if not sample.is_in_image or depth < camera.near or depth > camera.far:
        return sample
    hit = trace_ray(scene, unlimited_range(camera), in_world, worlds, worlds, view, ray, cull_backfaces)
    if hit.face >= 0:
        shown = object_of(scene, hit.movable, hit.face)
        if hit.round:
            shown = scene.movable_object[hit.movable]
        if hit.depth < depth and not is_member(targets, target, shown):
            sample.occluder = shown
            sample.occluder_depth = hit.depth
            return sample
    sample.state = VISIBLE
    return sample


@wp.func
def is_center(sample: int, across: int) -> bool:
    rest = sample % across
    if rest < 0:
        rest += across
    return rest == across // 2


@wp.func
def count_edges(counts: wp.array3d[wp.int32], view: int, target: int, state: int, adjacent: int):
    """Count a pair of adjacent samples whose states differ."""
    if state != adjacent:
        wp.atomic_add(counts, STATE_EDGES, view, target, 1)
    if (state > 0) != (adjacent > 0):
        wp.atomic_add(counts, SILHOUETTE_EDGES, view, target, 1)


@wp.func
def count_sample(
    counts: wp.array3d[wp.int32],
    hidden_by: wp.array3d[wp.int32],
    camera: PinholeCamera,
    sample: Sample,
    view: int,
    target: int,
    across: int,
    y: int,
    x: int,
):
    """Count a sample that the target covers."""
    at_center = is_center(x, across) and is_center(y, across)
    wp.atomic_add(counts, SILHOUETTE_SAMPLES, view, target, 1)
    if at_center:
        wp.atomic_add(counts, SILHOUETTE_CENTERS, view, target, 1)
    if not sample.is_in_image:
        return
    wp.atomic_add(counts, IMAGE_SAMPLES, view, target, 1)
    if sample.depth < camera.near:
        wp.atomic_add(counts, TOO_NEAR_SAMPLES, view, target, 1)
    elif sample.depth > camera.far:
        wp.atomic_add(counts, TOO_FAR_SAMPLES, view, target, 1)
    elif sample.state == VISIBLE:
        wp.atomic_add(counts, VISIBLE_SAMPLES, view, target, 1)
        if at_center:
            wp.atomic_add(counts, VISIBLE_CENTERS, view, target, 1)
        wp.atomic_max(counts, FRACTION_BOX, view, target, low_code(x // across))
        wp.atomic_max(counts, FRACTION_BOX + 1, view, target, low_code(y // across))
        wp.atomic_max(counts, FRACTION_BOX + 2, view, target, high_code(x // across))
        wp.atomic_max(counts, FRACTION_BOX + 3, view, target, high_code(y // across))
    else:
        wp.atomic_add(hidden_by, view, target, sample.occluder, 1)


@wp.kernel
def measure_fractions(
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
    # Out:
    counts_out: wp.array3d[wp.int32],
    hidden_by_out: wp.array3d[wp.int32],
):
    """Count the samples of targets in every view, (counter, view, target); counters start at 0.

    `isolated` has a frame for each object, whose poses are those of `spread_worlds`. Threads share the rows of a
    target; each examines the row above, too, to count edges.
    """
    view, target, first = wp.tid()
    view, target = locate(window, view, target)
    world = world_of(spread_worlds, view)
    if world < 0:
        return
    in_world = frame_of(camera_to_world[view])
    part = find_window(isolated, camera, in_world, targets, spread_worlds, sampling, view, world, target)
    if first == 0:
        counts_out[SAMPLES_ACROSS, view, target] = part.across
    if part.across == 0:
        return
    for y in range(part.y0 + first, part.y1 + 1, sampling.threads):
        left = int(0)
        for x in range(part.x0, part.x1 + 1):
            sample, above = Sample(), Sample()
            if x < part.x1 and y < part.y1:
                sample = examine(
                    scene,
                    isolated,
                    targets,
                    camera,
                    sampling.cull_backfaces != 0,
                    in_world,
                    worlds,
                    spread_worlds,
                    view,
                    target,
                    part.across,
                    y,
                    x,
                )
            if x < part.x1 and y > part.y0:
                above = examine(
                    scene,
                    isolated,
                    targets,
                    camera,
                    sampling.cull_backfaces != 0,
                    in_world,
                    worlds,
                    spread_worlds,
                    view,
                    target,
                    part.across,
                    y - 1,
                    x,
                )
            count_edges(counts_out, view, target, sample.state, left)
            count_edges(counts_out, view, target, sample.state, above.state)
            if sample.state > 0:
                count_sample(counts_out, hidden_by_out, camera, sample, view, target, part.across, y, x)
            left = sample.state
