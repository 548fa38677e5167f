# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of sight from many cameras that moving objects interrupt, in every world.

A tree of the boxes of all moving objects in all worlds finds the few objects that may be on a line; the ``rays`` caster
then casts the line at each of them.
"""

import warp as wp

from warpvis.kernels.casting.rays import RayRange, measure, meet_object, no_hit
from warpvis.kernels.casting.triangle_scene import TriangleScene, seen_from
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.pinhole import Frame, Window, frame_of, pose_origin
from warpvis.kernels.visibility.heights import tree_direction
from warpvis.kernels.visibility.points import locate_point

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

WORLDS_PER_WORD = 32


@wp.struct
class MovingOccluders:
    """Moving objects, and a tree of their boxes: those of world 0, then those of world 1, and so on."""

    tree: wp.uint64
    movable: wp.array[wp.int32]  # index of each among the movable objects


@wp.func
def line_range() -> RayRange:
    """Return the range of unit rays without limits."""
    measured = RayRange()
    measured.far = wp.inf
    return measured


@wp.func
def hides(
    scene: TriangleScene, worlds: Worlds, world: int, movable: int, line: Frame, ray: wp.vec3d, length: wp.float64
) -> bool:
    """Return whether a movable object is on a line from its origin, along a unit vector, up to a length [m]."""
    frame = seen_from(line, frame_of(worlds.object_poses[world, movable]))
    hit = no_hit()
    hit.depth = 1.001 * float(length)
    hit = meet_object(scene, worlds, world, 0, movable, frame, ray, 0.0, False, hit)
    if hit.face < 0:
        return False
    hit = measure(scene, worlds, world, frame, line_range(), ray, hit)
    return wp.float64(hit.depth) < length


@wp.kernel
def clear_hidden_worlds(
    # Scene:
    scene: TriangleScene,
    worlds: Worlds,
    occluders: MovingOccluders,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    points: wp.array[wp.vec3],
    pairs: wp.array2d[wp.int32],
    tolerance: float,
    # Out:
    seen_out: wp.array2d[wp.uint32],
):
    """Clear the bits of the worlds in which a moving object hides a point from a camera.

    `pairs` are indices of a camera and a point, shape ``(pairs, 2)``; bit b of word w of a pair is world 32 w + b. An
    object hides a point if it is nearer by more than `tolerance` [m].
    """
    view, row, column = wp.tid()
    view, pair = locate_point(window, view, row, column)
    if pair >= pairs.shape[0]:
        return

    line = Frame()
    line.origin = pose_origin(camera_to_world[pairs[pair, 0]])
    line.rotation = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    path = wp.vec3d(points[pairs[pair, 1]]) - line.origin
    distance = wp.length(path)
    length = distance - wp.float64(tolerance)
    if not length > wp.float64(0.0):
        return
    query = wp.bvh_query_ray(occluders.tree, wp.vec3(line.origin), tree_direction(path))
    count = occluders.movable.shape[0]
    box = int(0)
    while wp.bvh_query_next(query, box, 1.001):
        world = box // count
        word, bit = world // WORLDS_PER_WORD, wp.uint32(1) << wp.uint32(world % WORLDS_PER_WORD)
        if (seen_out[pair, word] & bit) != wp.uint32(0):
            if hides(scene, worlds, world, occluders.movable[box - world * count], line, path / distance, length):
                seen_out[pair, word] = seen_out[pair, word] & ~bit
