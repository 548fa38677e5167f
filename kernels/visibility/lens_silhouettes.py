# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fraction of each object through a lens: `warpvis.kernels.visibility.silhouettes` for ray bundles."""

import warp as wp

from warpvis.kernels.casting.triangle_scene import TriangleScene, seen_from, shows_solid
from warpvis.kernels.casting.worlds import Worlds, is_excluded, world_of
from warpvis.kernels.constants import VISIBLE_PIXELS
from warpvis.kernels.pinhole import Window, frame_of, locate
from warpvis.kernels.visibility.silhouettes import (
    Canvas,
    Chosen,
    Comparison,
    Found,
    Target,
    add_found,
    count_pixel,
    count_silhouette,
    is_met_from_outside,
    is_outside_box,
    meet_isolated,
)

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class CanvasRays:
    """The image size [px], the depth range [m] along its rays, and the rays of its pixels and a border around them."""

    width: int
    height: int
    near: float
    far: float
    is_planar: bool
    left: int  # columns of `rays` to the left of the image
    top: int  # rows of `rays` above the image
    rays: wp.array2d[wp.vec3d]  # (y, x) from the canvas's first pixel, of depth 1; NaN for pixels without a ray


@wp.func
def may_meet(origin: wp.vec3d, direction: wp.vec3d, low: wp.vec3, high: wp.vec3) -> bool:
    """Return whether a ray may hit the contents of a box: whether it hits the box's bounding sphere."""
    half, zero = wp.float64(0.5), wp.float64(0.0)
    sight = half * (wp.vec3d(low) + wp.vec3d(high)) - origin
    radius = half * wp.length(wp.vec3d(high) - wp.vec3d(low)) * wp.float64(1.0001)
    beyond = wp.dot(sight, sight) - radius * radius
    if beyond <= zero:
        return True
    along = wp.dot(direction, sight)
    return along > zero and along * along >= beyond * wp.dot(direction, direction)


@wp.kernel
def measure_silhouettes_rays(
    # Scene:
    scene: TriangleScene,
    chosen: Chosen,
    # Cameras:
    camera: CanvasRays,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    canvas: Canvas,
    worlds: Worlds,
    comparison: Comparison,
    threads: int,
    # Out:
    counts_out: wp.array3d[wp.int32],
    hidden_by_out: wp.array3d[wp.int32],
    masks_out: wp.array4d[wp.uint8],
):
    """Count pixels as in `kernels.visibility.silhouettes.measure_silhouettes`; pixels without a ray are skipped."""
    view, slot, first = wp.tid()
    view, slot = locate(window, view, slot)

    index = chosen.index[slot]
    world = world_of(worlds, view)
    if world < 0 or is_excluded(worlds, view, index):
        return
    if canvas.beyond_only != 0 and canvas.seen_only != 0 and counts_out[VISIBLE_PIXELS, view, slot] == 0:
        return
    frame = seen_from(frame_of(camera_to_world[view]), frame_of(worlds.object_poses[world, index]))
    is_round = shows_solid(scene.movable_solid[index], scene.movable_size[index], frame.origin)
    low, high = chosen.boxes[index, 0], chosen.boxes[index, 1]
    is_outside = is_outside_box(frame.origin, low, high)
    target = Target()
    target.view = view
    target.slot = slot
    target.index = index
    target.near = camera.near
    target.far = camera.far
    found = Found()
    width = canvas.x1 - canvas.x0
    for pixel in range(first, width * (canvas.y1 - canvas.y0), threads):
        x, y = canvas.x0 + pixel % width, canvas.y0 + pixel // width
        ray = camera.rays[y + camera.top, x + camera.left]
        if not ray[2] == ray[2]:
            continue
        is_in_image = x >= 0 and y >= 0 and x < camera.width and y < camera.height
        if is_in_image and canvas.beyond_only != 0:
            continue
        if not may_meet(frame.origin, wp.quat_rotate(frame.rotation, ray), low, high):
            continue
        if is_outside and not is_in_image:
            if is_met_from_outside(scene, index, frame, is_round, ray):
                found = count_silhouette(found, x, y)
            continue
        depth = meet_isolated(scene, worlds, view, index, frame, is_round, ray, camera.is_planar)
        if not wp.isfinite(depth):
            continue
        found = count_silhouette(found, x, y)
        if is_in_image:
            length = float(wp.length(ray))
            found = count_pixel(found, target, comparison, y, x, depth, length, hidden_by_out, masks_out)
    add_found(counts_out, view, slot, found)
