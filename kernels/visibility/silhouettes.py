# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fraction of each object: its unoccluded silhouette compared with the rendered image.

Silhouettes are counted on a canvas larger than the image, so that parts cut off at the image's border count as not
visible, as in BOP's toolkit (``bop_toolkit_lib/visibility.py``, ``scripts/calc_gt_info.py``). Several threads share the
pixels of the canvas that an object's box may cover in a view.
"""

import warp as wp

from warpvis.kernels.casting.triangle_scene import (
    TriangleScene,
    corner,
    first_hit,
    plane_depth,
    seen_from,
    shows_solid,
    solid_hit,
)
from warpvis.kernels.casting.worlds import Worlds, is_excluded, world_of
from warpvis.kernels.constants import (
    BOX_MIDDLE,
    IMAGE_PIXELS,
    MASK_HIDDEN,
    MASK_VISIBLE,
    SILHOUETTE_BOX,
    SILHOUETTE_PIXELS,
    TOO_FAR_PIXELS,
    TOO_NEAR_PIXELS,
    VISIBLE_BOX,
    VISIBLE_PIXELS,
)
from warpvis.kernels.pinhole import Frame, PinholeCamera, Window, forward_axis, frame_of, locate, pixel_ray
from warpvis.kernels.visibility.points import OCCLUDED, OUT_OF_VIEW, TOO_FAR, TOO_NEAR, VISIBLE

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class Canvas:
    """The rectangle in which silhouettes are counted, in pixels from the image's first one; ends are exclusive."""

    x0: int
    y0: int
    x1: int
    y1: int
    seen_only: int
    """Whether pixels outside the image are counted only for objects that are visible in it."""
    beyond_only: int
    """Whether to count only pixels outside the image, because those inside have been counted."""


@wp.struct
class Chosen:
    """Objects whose silhouettes are counted, and the boxes of all objects in their own frames."""

    index: wp.array[wp.int32]
    boxes: wp.array2d[wp.vec3]
    """(object, 2): lower and upper corner [m]."""


@wp.struct
class Comparison:
    """Images of the complete scene that silhouettes are compared with, rendered with a depth range from 0 to inf."""

    segmentation: wp.array3d[wp.int32]
    """(view, y, x): the visible object, or -1."""
    depth: wp.array3d[float]
    """(view, y, x) [m]; None where `delta` is 0."""
    delta: float
    """Tolerance: an object's surface counts as visible up to this far behind the visible one along its ray [m]."""


@wp.func
def meet_isolated(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    index: int,
    frame: Frame,
    is_round: bool,
    ray: wp.vec3d,
    is_planar: bool,
) -> float:
    """Return the depth at which a ray hits an object, ignoring all others; +inf for a miss.

    Depth is planar if `is_planar`; otherwise it is the distance along the ray.
    """
    if is_round:
        solid_met = solid_hit(scene.movable_solid[index], scene.movable_size[index], frame, ray)
        if solid_met.w > wp.float64(0.0):
            return float(wp.float64(1.0) / solid_met.w)
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


@wp.func
def is_met_from_outside(scene: TriangleScene, index: int, frame: Frame, is_round: bool, ray: wp.vec3d) -> bool:
    """Return whether a ray hits an object whose box does not contain the camera: faster than finding the depth."""
    if is_round:
        solid_met = solid_hit(scene.movable_solid[index], scene.movable_size[index], frame, ray)
        return solid_met.w > wp.float64(0.0)
    direction = wp.vec3(wp.quat_rotate(frame.rotation, ray))
    return wp.mesh_query_ray_anyhit(scene.movable_mesh[index], wp.vec3(frame.origin), direction, 3.0e38)


@wp.func
def is_outside_box(point: wp.vec3d, low: wp.vec3, high: wp.vec3) -> bool:
    """Return whether a point is outside a box."""
    for axis in range(3):
        if point[axis] < wp.float64(low[axis]) or point[axis] > wp.float64(high[axis]):
            return True
    return False


@wp.func
def covered_canvas(camera: PinholeCamera, frame: Frame, canvas: Canvas, low: wp.vec3, high: wp.vec3) -> Canvas:
    """Return the part of the canvas that a box may cover: all of it if the box extends behind the camera."""
    zero = wp.float64(0.0)
    x0, y0 = wp.float64(canvas.x1), wp.float64(canvas.y1)
    x1, y1 = wp.float64(canvas.x0), wp.float64(canvas.y0)
    behind = int(0)
    for k in range(8):
        corner_point = wp.vec3d(low)
        if k & 1 != 0:
            corner_point[0] = wp.float64(high[0])
        if k & 2 != 0:
            corner_point[1] = wp.float64(high[1])
        if k & 4 != 0:
            corner_point[2] = wp.float64(high[2])
        p = wp.quat_rotate_inv(frame.rotation, corner_point - frame.origin)
        if p[2] <= zero:
            behind += 1
        else:
            x, y = camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy
            x0, y0 = wp.min(x0, x), wp.min(y0, y)
            x1, y1 = wp.max(x1, x), wp.max(y1, y)
    part = canvas
    if behind == 8:
        part.x1 = part.x0
    elif behind == 0:
        one = wp.float64(1.0)
        part.x0 = int(wp.clamp(wp.floor(x0 - one), wp.float64(canvas.x0), wp.float64(canvas.x1)))
        part.y0 = int(wp.clamp(wp.floor(y0 - one), wp.float64(canvas.y0), wp.float64(canvas.y1)))
        part.x1 = int(wp.clamp(wp.ceil(x1 + one), wp.float64(part.x0), wp.float64(canvas.x1)))
        part.y1 = int(wp.clamp(wp.ceil(y1 + one), wp.float64(part.y0), wp.float64(canvas.y1)))
    return part


@wp.func
def low_code(coordinate: int) -> int:
    return BOX_MIDDLE - coordinate


@wp.func
def high_code(coordinate: int) -> int:
    return BOX_MIDDLE + coordinate


@wp.struct
class Found:
    """Counts of one thread for an object in a view."""

    visible: int
    image: int
    silhouette: int
    too_near: int
    too_far: int
    visible_box: wp.vec4i
    silhouette_box: wp.vec4i


@wp.func
def grown(box: wp.vec4i, x: int, y: int) -> wp.vec4i:
    return wp.max(box, wp.vec4i(low_code(x), low_code(y), high_code(x), high_code(y)))


@wp.func
def count_silhouette(found: Found, x: int, y: int) -> Found:
    """Count a pixel of an object's silhouette, inside or outside the image."""
    more = found
    more.silhouette += 1
    more.silhouette_box = grown(found.silhouette_box, x, y)
    return more


@wp.struct
class Target:
    """An object in a view, and the depth range in which it can be visible [m]."""

    view: int
    slot: int
    """Index among the chosen objects."""
    index: int
    """Index among the scene's objects."""
    near: float
    far: float


@wp.func
def count_pixel(
    found: Found,
    target: Target,
    comparison: Comparison,
    y: int,
    x: int,
    depth: float,
    length: float,
    hidden_by: wp.array3d[wp.int32],
    masks: wp.array4d[wp.uint8],
) -> Found:
    """Count a silhouette pixel inside the image: as visible, out of range, or hidden by another object.

    `depth` is the depth of the object [m], and `length` the length of the pixel's ray of depth 1.
    """
    more = found
    more.image += 1
    shown = comparison.segmentation[target.view, y, x]
    is_visible = shown == target.index
    if not is_visible and comparison.depth:
        behind = (depth - comparison.depth[target.view, y, x]) * length
        is_visible = behind <= comparison.delta
    if depth < target.near:
        more.too_near += 1
        is_visible = False
    elif depth > target.far:
        more.too_far += 1
        is_visible = False
    elif is_visible:
        more.visible += 1
        more.visible_box = grown(found.visible_box, x, y)
    elif shown >= 0:
        wp.atomic_add(hidden_by, target.view, target.slot, shown, 1)
    if masks:
        mask = wp.uint8(MASK_HIDDEN)
        if is_visible:
            mask = wp.uint8(MASK_VISIBLE)
        masks[target.view, target.slot, y, x] = mask
    return more


@wp.func
def add_box(counts: wp.array3d[wp.int32], view: int, slot: int, first: int, box: wp.vec4i):
    for k in range(4):
        if box[k] > counts[first + k, view, slot]:
            wp.atomic_max(counts, first + k, view, slot, box[k])


@wp.func
def add_found(counts: wp.array3d[wp.int32], view: int, slot: int, found: Found):
    if found.silhouette == 0:
        return
    wp.atomic_add(counts, SILHOUETTE_PIXELS, view, slot, found.silhouette)
    add_box(counts, view, slot, SILHOUETTE_BOX, found.silhouette_box)
    if found.image == 0:
        return
    wp.atomic_add(counts, IMAGE_PIXELS, view, slot, found.image)
    wp.atomic_add(counts, TOO_NEAR_PIXELS, view, slot, found.too_near)
    wp.atomic_add(counts, TOO_FAR_PIXELS, view, slot, found.too_far)
    if found.visible > 0:
        wp.atomic_add(counts, VISIBLE_PIXELS, view, slot, found.visible)
        add_box(counts, view, slot, VISIBLE_BOX, found.visible_box)


@wp.kernel
def measure_silhouettes(
    # Scene:
    scene: TriangleScene,
    chosen: Chosen,
    # Cameras:
    camera: PinholeCamera,
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
    """Count the pixels of chosen objects in every view, ``(counter, view, chosen)``; counters start at 0.

    All objects of the scene must be movable and detached. `threads` threads share an object in a view. `masks_out`, if
    not None, is set to `MASK_HIDDEN` or `MASK_VISIBLE` where the silhouette is in the image.
    """
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
    part = covered_canvas(camera, frame, canvas, low, high)
    is_outside = is_outside_box(frame.origin, low, high)
    width = part.x1 - part.x0
    target = Target()
    target.view = view
    target.slot = slot
    target.index = index
    target.near = camera.near
    target.far = camera.far
    found = Found()
    for pixel in range(first, width * (part.y1 - part.y0), threads):
        x, y = part.x0 + pixel % width, part.y0 + pixel // width
        ray = pixel_ray(camera, y, x)
        is_in_image = x >= 0 and y >= 0 and x < int(camera.width) and y < int(camera.height)
        if is_in_image and canvas.beyond_only != 0:
            continue
        if is_outside and not is_in_image:
            if is_met_from_outside(scene, index, frame, is_round, ray):
                found = count_silhouette(found, x, y)
            continue
        z = meet_isolated(scene, worlds, view, index, frame, is_round, ray, True)
        if not wp.isfinite(z):
            continue
        found = count_silhouette(found, x, y)
        if is_in_image:
            length = float(wp.length(ray))
            found = count_pixel(found, target, comparison, y, x, z, length, hidden_by_out, masks_out)
    add_found(counts_out, view, slot, found)


@wp.func
def box_of(counts: wp.array3d[wp.int32], view: int, slot: int, first: int) -> wp.vec4i:
    """Return x, y, width and height of a box, or -1 for each if it is empty."""
    if counts[first, view, slot] == 0:
        return wp.vec4i(-1, -1, -1, -1)
    x, y = BOX_MIDDLE - counts[first, view, slot], BOX_MIDDLE - counts[first + 1, view, slot]
    last_x, last_y = counts[first + 2, view, slot] - BOX_MIDDLE, counts[first + 3, view, slot] - BOX_MIDDLE
    return wp.vec4i(x, y, last_x - x + 1, last_y - y + 1)


@wp.func
def reason(visible: int, hidden: int, near: int, far: int, outside: int, min_pixels: int) -> wp.uint8:
    """Return an object's visibility status: the most frequent reason why its pixels in the image are not visible."""
    if visible >= min_pixels and visible > 0:
        return VISIBLE
    max_count = wp.max(hidden, wp.max(near, far))
    if max_count > 0:
        if hidden == max_count:
            return OCCLUDED
        if near == max_count:
            return TOO_NEAR
        return TOO_FAR
    if visible > 0 and outside == 0:
        return TOO_FAR  # completely visible, but in fewer than `min_pixels` pixels
    return OUT_OF_VIEW


@wp.kernel
def judge_silhouettes(
    # In:
    counts: wp.array3d[wp.int32],
    hidden_by: wp.array3d[wp.int32],
    min_pixels: int,
    # Out:
    fraction_out: wp.array2d[float],
    status_out: wp.array2d[wp.uint8],
    occluder_out: wp.array2d[wp.int32],
    visible_box_out: wp.array2d[wp.vec4i],
    silhouette_box_out: wp.array2d[wp.vec4i],
):
    """Derive visible fraction, status, main occluder and boxes from the counters of an object in a view."""
    view, slot = wp.tid()
    visible, inside = counts[VISIBLE_PIXELS, view, slot], counts[IMAGE_PIXELS, view, slot]
    total = counts[SILHOUETTE_PIXELS, view, slot]
    near, far = counts[TOO_NEAR_PIXELS, view, slot], counts[TOO_FAR_PIXELS, view, slot]
    fraction = float(0.0)
    if total > 0:
        fraction = float(wp.float64(visible) / wp.float64(total))
    fraction_out[view, slot] = fraction
    status_out[view, slot] = reason(visible, inside - visible - near - far, near, far, total - inside, min_pixels)
    occluder, max_count = int(-1), int(0)
    for index in range(hidden_by.shape[2]):
        pixels = hidden_by[view, slot, index]
        if pixels > max_count:
            occluder = index
            max_count = pixels
    occluder_out[view, slot] = occluder
    visible_box_out[view, slot] = box_of(counts, view, slot, VISIBLE_BOX)
    silhouette_box_out[view, slot] = box_of(counts, view, slot, SILHOUETTE_BOX)
