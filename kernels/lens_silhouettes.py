# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""How much of each object is seen through a lens: `warpvis.kernels.silhouettes` by rays from a table."""

import warp as wp

from warpvis.kernels.constants import MASK_HIDDEN, MASK_VISIBLE, VISIBLE_PIXELS
from warpvis.kernels.pinhole import Window, forward_axis
from warpvis.kernels.silhouettes import (
    Canvas,
    Chosen,
    Comparison,
    Found,
    add_found,
    grown,
    is_beside,
    is_met_from_outside,
)
from warpvis.kernels.triangle_scene import (
    CameraFrame,
    TriangleScene,
    camera_frame,
    corner,
    first_hit,
    plane_depth,
    seen_from,
    shows_solid,
    solid_hit,
)
from warpvis.kernels.worlds import Worlds, is_excluded, world_of

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class CanvasRays:
    """An image's size [px], what depth along its rays means, and the rays of its pixels and those around it."""

    width: int
    height: int
    near: float
    far: float
    is_planar: bool
    left: int  # pixels of the table that are beside the image
    top: int
    rays: wp.array2d[wp.vec3d]  # (y, x) from the canvas' first pixel, of depth 1; NaN where there is none


@wp.func
def may_meet(origin: wp.vec3d, direction: wp.vec3d, low: wp.vec3, high: wp.vec3) -> bool:
    """Whether a ray may meet what is in a box: whether it meets the ball around it."""
    half, none = wp.float64(0.5), wp.float64(0.0)
    sight = half * (wp.vec3d(low) + wp.vec3d(high)) - origin
    radius = half * wp.length(wp.vec3d(high) - wp.vec3d(low)) * wp.float64(1.0001)
    beyond = wp.dot(sight, sight) - radius * radius
    if beyond <= none:
        return True
    along = wp.dot(direction, sight)
    return along > none and along * along >= beyond * wp.dot(direction, direction)


@wp.func
def depth_alone(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    index: int,
    frame: CameraFrame,
    is_round: bool,
    ray: wp.vec3d,
    is_planar: bool,
) -> float:
    """Depth at which a ray meets an object, whatever else there is; +inf if it does not."""
    if is_round:
        met = solid_hit(scene.movable_solid[index], scene.movable_size[index], frame, ray)
        if met.w > wp.float64(0.0):
            return float(wp.float64(1.0) / met.w)
        return wp.inf
    direction = wp.quat_rotate(frame.rotation, ray)
    hit = first_hit(scene, worlds, view, index, wp.vec3(frame.origin), wp.vec3(direction), 0.0, 3.0e38, False)
    if not hit.result:
        return wp.inf
    mesh = scene.movable_mesh[index]
    a = corner(mesh, hit.face, 0) - frame.origin
    b = corner(mesh, hit.face, 1) - frame.origin
    c = corner(mesh, hit.face, 2) - frame.origin
    forward = wp.where(is_planar, forward_axis(frame.rotation), direction)
    return float(plane_depth(a, b, c, direction, forward))


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
    seen: Comparison,
    threads: int,
    # Out:
    counts_out: wp.array3d[wp.int32],
    hidden_by_out: wp.array3d[wp.int32],
    masks_out: wp.array4d[wp.uint8],
):
    """Count pixels as `warpvis.kernels.silhouettes.measure_silhouettes` does; those without a ray are of no object."""
    view, place, first = wp.tid()
    view += window.first_view
    place += window.first_row

    index = chosen.index[place]
    world = world_of(worlds, view)
    if world < 0 or is_excluded(worlds, view, index):
        return
    if canvas.beyond_only != 0 and canvas.seen_only != 0 and counts_out[VISIBLE_PIXELS, view, place] == 0:
        return
    frame = seen_from(camera_frame(camera_to_world[view]), worlds.object_poses[world, index])
    is_round = shows_solid(scene.movable_solid[index], scene.movable_size[index], frame.origin)
    low, high = chosen.boxes[index, 0], chosen.boxes[index, 1]
    beside = is_beside(frame.origin, low, high)
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
        if beside and not is_in_image:
            if is_met_from_outside(scene, index, frame, is_round, ray):
                found.silhouette += 1
                found.silhouette_box = grown(found.silhouette_box, x, y)
            continue
        depth = depth_alone(scene, worlds, view, index, frame, is_round, ray, camera.is_planar)
        if not wp.isfinite(depth):
            continue
        found.silhouette += 1
        found.silhouette_box = grown(found.silhouette_box, x, y)
        if not is_in_image:
            continue
        found.image += 1
        shown = seen.segmentation[view, y, x]
        is_visible = shown == index
        if not is_visible and seen.depth:
            behind = (depth - seen.depth[view, y, x]) * float(wp.length(ray))
            is_visible = behind <= seen.delta
        if depth < camera.near:
            found.too_near += 1
            is_visible = False
        elif depth > camera.far:
            found.too_far += 1
            is_visible = False
        elif is_visible:
            found.visible += 1
            found.visible_box = grown(found.visible_box, x, y)
        elif shown >= 0:
            wp.atomic_add(hidden_by_out, view, place, shown, 1)
        if masks_out:
            mask = wp.uint8(MASK_HIDDEN)
            if is_visible:
                mask = wp.uint8(MASK_VISIBLE)
            masks_out[view, place, y, x] = mask
    add_found(counts_out, view, place, found)
