# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of moving sensors on CUDA: rays that packets do not cast, and rays that may hit objects that move.

Tables of packets are those of `kernels.casting.moving_tables`.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.motions import Motion, TimedRays, frame_at, leg_at
from warpvis.kernels.casting.moving_objects import cast_ray_at_objects
from warpvis.kernels.casting.moving_rays import cast_moving_ray
from warpvis.kernels.casting.moving_tables import MovingTerms, vector_in
from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.packets_cuda import RayPackets
from warpvis.kernels.casting.rays import CUDA_REGISTERS, RayRange
from warpvis.kernels.casting.triangle_scene import TriangleScene
from warpvis.kernels.casting.worlds import Worlds, world_of
from warpvis.kernels.constants import BOX_WORDS

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

LONGEST = wp.constant(24)
"""Word of a `TableFrame` that is 0 if a packet's rays are cast one by one."""

SPHERE_MARGIN = wp.constant(1.0e-4)
"""Margin of spheres for single precision, as a fraction of the radius and the distance."""


@wp.func
def number_remaining(terms: MovingTerms, rows: int) -> int:
    """Return the number of packets that are cast ray by ray: all of some rows if they are not listed."""
    if not terms.remaining:
        return rows
    return terms.count[0]


@wp.func
def ray_remaining(terms: MovingTerms, place: wp.array2d[wp.int32], rays: TimedRays, number: int, slot: int) -> wp.vec3i:
    """Return the view, y and x of the ray in a slot of one of these packets; y is -1 without a ray."""
    row, columns = number, rays.directions.shape[1]
    if terms.remaining:
        row = terms.remaining[number]
    view, pixel = row // place.shape[0], place[row % place.shape[0], slot]
    if pixel < 0:
        return wp.vec3i(view, -1, -1)
    return wp.vec3i(view, pixel // columns, pixel % columns)


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_remaining_rays(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: RayRange,
    sensor: Motion,
    # In:
    worlds: Worlds,
    rays: TimedRays,
    place_in: wp.array2d[wp.int32],
    terms: MovingTerms,
    rows: wp.vec2i,
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Write the images of rays whose packets were not cast, as `cast_moving_rays` does.

    `place_in` are the pixels of packets, and `rows` are the number of views times that of packets, and that of blocks
    of threads, each of which casts a packet at a time.
    """
    first, slot = wp.tid()
    for number in range(first, number_remaining(terms, rows[0]), rows[1]):
        at = ray_remaining(terms, place_in, rays, number, slot)
        if at[1] >= 0:
            cast_moving_ray(scene, camera, sensor, rays, worlds, at[0], at[1], at[2], cull_backfaces, images_out)


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_remaining_at_objects(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: RayRange,
    sensor: Motion,
    # In:
    worlds: Worlds,
    objects: Motion,
    rays: TimedRays,
    place_in: wp.array2d[wp.int32],
    terms: MovingTerms,
    rows: wp.vec2i,
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Write the images of rays whose packets were not cast, for moving objects."""
    first, slot = wp.tid()
    for number in range(first, number_remaining(terms, rows[0]), rows[1]):
        at = ray_remaining(terms, place_in, rays, number, slot)
        if at[1] >= 0:
            cast_ray_at_objects(
                scene, camera, sensor, rays, worlds, objects, at[0], at[1], at[2], cull_backfaces, images_out
            )


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return (int)__ballot_sync(0xffffffffu, value);
#else
    return value;
#endif
""")
def lanes_where(value: bool) -> int: ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int k = 0; k < 4; ++k) value[k] = __shfl_sync(0xffffffffu, value[k], lane);
#endif
    return value;
""")
def of_lane(value: wp.vec4, lane: int) -> wp.vec4: ...


@wp.func
def travel(
    motion: Motion, row: int, column: int, begin: wp.float64, end: wp.float64, distance: wp.float64
) -> wp.float64:
    """Return a bound of the way between two times of a point at a distance from a body's origin."""
    way = wp.float64(0.0)
    first, last = int(0), int(0)
    if motion.times:
        first, last = leg_at(motion.times, begin), leg_at(motion.times, end)
    for instant in range(first, last + 1):
        leg, share = motion.legs[instant, row, column], wp.float64(0.0)
        if motion.is_screw:
            share = end - begin
        elif motion.times and instant + 1 < motion.times.shape[0]:
            since, until = motion.times[instant], motion.times[instant + 1]
            share = (wp.min(end, until) - wp.max(begin, since)) / (until - since)
        way += wp.max(share, wp.float64(0.0)) * (wp.length(leg.path) + distance * wp.length(leg.rotation_vector))
    return way


@wp.func
def sphere_of_path(
    scene: BvhScene, objects: Motion, world: int, movable: int, begin: wp.float64, end: wp.float64, eye: wp.vec3d
) -> wp.vec4:
    """Return a sphere around a movable object on its path between two times: its center from `eye`, and its radius."""
    half, first = wp.float64(0.5), BOX_WORDS * movable
    middle, extent = wp.vec3d(), wp.vec3d()
    for k in range(3):
        low, high = wp.float64(scene.movable_boxes[first + k]), wp.float64(scene.movable_boxes[first + 3 + k])
        middle[k] = half * (low + high)
        extent[k] = half * (high - low)
    between, distance = half * (begin + end), wp.length(middle)
    frame = frame_at(objects, world, movable, between)
    center = wp.vec3(frame.origin + wp.quat_rotate(frame.rotation, middle) - eye)
    before = travel(objects, world, movable, begin, between, distance)
    after = travel(objects, world, movable, between, end, distance)
    radius = float(wp.length(extent) + wp.max(before, after))
    return wp.vec4(center[0], center[1], center[2], radius + SPHERE_MARGIN * (radius + wp.length(center)))


@wp.struct
class RayBox:
    """Bounds of the rays of a packet in its image, and the axes of the image, in single precision."""

    right: wp.vec3
    down: wp.vec3
    forward: wp.vec3
    first: wp.vec2
    last: wp.vec2
    aside: wp.vec2


@wp.func
def is_beyond(sphere: wp.vec4, normal: wp.vec3, limit: float) -> bool:
    """Return whether a sphere is entirely beyond a plane."""
    return wp.dot(normal, wp.vec3(sphere[0], sphere[1], sphere[2])) - sphere[3] * wp.length(normal) > limit


@wp.func
def meets_packet(box: RayBox, sphere: wp.vec4) -> bool:
    """Return whether a sphere may meet rays of a packet: no ray is beyond the planes through the sides of its image."""
    if is_beyond(sphere, -box.forward, 0.0):
        return False
    return not (
        is_beyond(sphere, box.right - box.last[0] * box.forward, box.aside[0])
        or is_beyond(sphere, box.first[0] * box.forward - box.right, box.aside[0])
        or is_beyond(sphere, box.down - box.last[1] * box.forward, box.aside[1])
        or is_beyond(sphere, box.first[1] * box.forward - box.down, box.aside[1])
    )


@wp.kernel
def mark_touched_rays(
    # Scene:
    scene: BvhScene,
    # Cameras:
    sensor: Motion,
    # In:
    worlds: Worlds,
    objects: Motion,
    packets: RayPackets,
    spans_in: wp.array2d[wp.float64],
    columns: int,
    lanes: int,
    # Out:
    touched_out: wp.array3d[wp.int32],
):
    """Set the bits of the movable objects that each ray of a packet may hit, by their index modulo 32.

    Bits must be 0 before. `spans_in` are the first and the last time of each packet, after the start of the frame [s].
    A packet is processed by a warp on CUDA, and by one thread on the CPU: `lanes` is the number of threads.
    """
    view, packet, lane = wp.tid()
    world, row = world_of(worlds, view), view * packets.per_view + packet
    if world < 0 or not packets.frame[row, LONGEST] > wp.float64(0.0):
        return
    start = wp.float64(0.0)
    if sensor.starts:
        start = sensor.starts[view]
    begin, end = start + spans_in[packet, 0], start + spans_in[packet, 1]

    frame, side = packets.frame, wp.sqrt(float(packets.place.shape[1]))
    eye, box = vector_in(packets.eyes, row, 0), RayBox()
    box.right = wp.vec3(vector_in(frame, row, 0))
    box.down = wp.vec3(vector_in(frame, row, 3))
    box.forward = wp.vec3(vector_in(frame, row, 6))
    corner = wp.vec2(float(frame[row, 18]), float(frame[row, 19]))
    spread = wp.vec2(float(frame[row, 20]), float(frame[row, 21]))
    box.first = corner - spread
    box.last = corner + spread + wp.vec2(side, side)
    box.aside = wp.vec2(float(packets.eyes[row, 3]), float(packets.eyes[row, 4]))
    right, down = wp.vec3(vector_in(frame, row, 9)), wp.vec3(vector_in(frame, row, 12))
    forward = wp.vec3(vector_in(frame, row, 15))

    for first in range(0, scene.movable_count, lanes):
        movable = wp.min(first + lane, scene.movable_count - 1)
        own = sphere_of_path(scene, objects, world, movable, begin, end, eye)
        near = lanes_where(first + lane < scene.movable_count and meets_packet(box, own))
        for other in range(lanes):
            if (near >> other) & 1 != 0:
                sphere = of_lane(own, other)
                center, square = wp.vec3(sphere[0], sphere[1], sphere[2]), sphere[3] * sphere[3]
                bit = 1 << ((first + other) % 32)
                for slot in range(lane, packets.place.shape[1], lanes):
                    p, aside = packets.points[row, slot], packets.asides[row, slot]
                    along = p[0] * right + p[1] * down + forward
                    across = wp.cross(aside[0] * right + aside[1] * down - center, along)
                    if wp.dot(across, across) <= square * wp.dot(along, along) and packets.scale[row, slot] > 0.0:
                        pixel = packets.place[packet, slot]
                        touched_out[view, pixel // columns, pixel % columns] |= bit
