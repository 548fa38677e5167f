# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses and sizes of movable objects in every world, and the world of every view."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class Worlds:
    """Arrangements of the movable objects, the world of each view, and the objects that it excludes."""

    object_poses: wp.array2d[wp.transform]
    """(world, movable object): object to world."""
    world: wp.array[wp.int32]
    """(view): index of its world; None if every view shows world 0 or, with several worlds, view i shows world i."""
    object_sizes: wp.array2d[wp.vec4]
    """(world, movable object), with as many worlds as `object_poses`: for a solid, factors along x, y and z [m], and
    half length before scaling; for a mesh, scale factors along its axes. None if all objects have their original size.
    """
    excluded: wp.array2d[wp.uint8]
    """(view or 1, object): nonzero if the object is invisible in the view; None if there are no exclusions."""


@wp.func
def world_of(worlds: Worlds, view: int) -> int:
    """Return the world of a view, or -1 if its index is out of range."""
    world = view
    if worlds.world:
        world = worlds.world[view]
    elif worlds.object_poses.shape[0] == 1:
        world = 0
    if world < 0 or world >= worlds.object_poses.shape[0]:
        return -1
    return world


@wp.func
def row_of(worlds: Worlds, view: int, rows: int) -> int:
    """Return the row of a view in an array with one row for all worlds or one for each, which may have no movables."""
    world = view
    if rows == 1:
        world = 0
    elif worlds.world:
        world = worlds.world[view]
    return wp.clamp(world, 0, rows - 1)


@wp.func
def is_excluded(worlds: Worlds, view: int, index: int) -> bool:
    """Return whether a view excludes an object."""
    if not worlds.excluded:
        return False
    return worlds.excluded[wp.min(view, worlds.excluded.shape[0] - 1), index] != wp.uint8(0)


@wp.kernel
def scale_sizes(
    # In:
    original: wp.array[wp.vec4],
    scales: wp.array2d[wp.vec3],
    # Out:
    sizes_out: wp.array2d[wp.vec4],
):
    """Write `Worlds.object_sizes` from scale factors per world, or for all worlds if one row."""
    world, movable = wp.tid()
    size, scale = original[movable], scales[world % scales.shape[0], movable]
    sizes_out[world, movable] = wp.vec4(size[0] * scale[0], size[1] * scale[1], size[2] * scale[2], size[3])
