# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Where movable objects are, and how large, for every view."""

import warp as wp


@wp.struct
class Worlds:
    """Arrangements of the movable objects, which of them each view is of, and what it must not see."""

    object_poses: wp.array2d[wp.transform]
    """(world, movable object): object to world."""
    world: wp.array[wp.int32]
    """(view): its world; None for world 0, or if there are several, for each view its own."""
    object_sizes: wp.array2d[wp.vec4]
    """(world, movable object), as many as poses: of a solid, factors along x, y and z [m], and half length before them;
    of a mesh, factors by which it is stretched along them. None where all are as they were made."""
    excluded: wp.array2d[wp.uint8]
    """(view or 1, object): not 0 for objects that the view does not see; None for none."""


@wp.func
def world_of(worlds: Worlds, view: int) -> int:
    """The world of a view, -1 if there is none of that number."""
    world = view
    if worlds.world:
        world = worlds.world[view]
    elif worlds.object_poses.shape[0] == 1:
        world = 0
    if world < 0 or world >= worlds.object_poses.shape[0]:
        return -1
    return world


@wp.func
def is_excluded(worlds: Worlds, view: int, index: int) -> bool:
    """Whether a view must not see an object."""
    if not worlds.excluded:
        return False
    return worlds.excluded[wp.min(view, worlds.excluded.shape[0] - 1), index] != wp.uint8(0)
