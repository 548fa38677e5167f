# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds: poses and sizes of movable objects, and excluded objects, for each view."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, as_warp, on_gpu, share, take_rows
from warpvis.core.checks import is_whole, pluralize
from warpvis.core.kernel_cache import launch
from warpvis.core.motion import Motion, instants_of, stacked
from warpvis.core.poses import are_valid_rows, find_invalid_rows
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, ObjectScales, PoseLike
from warpvis.errors import ArrayError, PoseError

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.scene._scene import Scene


def parse_worlds(
    scene: Scene,
    views: int,
    object_poses: ObjectPoses,
    world_index: ArrayInput | None,
    exclude: Excluded,
    object_scales: ObjectScales = None,
    *,
    least: int = 1,
) -> Worlds:
    """Convert arguments of `Renderer.render` to a `warpvis.kernels.casting.worlds.Worlds`.

    The result has no arrays if no object is movable and no argument is given.

    Data on a GPU stays there and is not read back: only shapes, dtypes and devices are checked.

    Args:
        scene: The scene.
        views: Number of views.
        object_poses: As for `Renderer.render`, and so are the others.
        world_index: The world of each view.
        exclude: Excluded objects.
        object_scales: Scales of the movable objects.
        least: Number of worlds that appearances have, or 1: poses and scales of one world are repeated.
    """
    nothing_said = object_poses is None and world_index is None and exclude is None and object_scales is None
    if nothing_said and not scene.movable and least in (1, views):
        return _still_world()
    from warpvis.kernels.casting.worlds import Worlds

    worlds = Worlds()
    scales = None if object_scales is None else _parse_object_scales(scene, object_scales)
    # If only sizes differ, poses are equal in all worlds.
    repeated = 1 if scales is None or object_poses is not None else scales.shape[0]
    worlds.object_poses = _repeated(_parse_object_poses(scene, object_poses, repeated), least)
    count = worlds.object_poses.shape[0]
    if scales is not None:
        worlds.object_sizes = _sizes(scene, scales, count)
    if world_index is not None:
        worlds.world = _parse_world(world_index, views, count, scene.device)
    elif count not in (1, views):
        source = "appearances" if least > 1 else "object_scales" if repeated > 1 else "object_poses"
        raise ArrayError(
            f"{source} have {pluralize(count, 'world')} for {pluralize(views, 'view')}; give world_index= for each view"
        )
    exclude = (exclude,) if isinstance(exclude, str) else exclude
    if exclude is not None and not _is_empty(exclude):
        worlds.excluded = _parse_exclude(scene, views, exclude)
    return worlds


def _repeated(poses: wp.array, worlds: int) -> wp.array:
    """Return poses of one world for several worlds; raise an `ArrayError` if they are of another number of worlds."""
    if worlds == 1 or len(poses) == worlds:
        return poses
    if len(poses) != 1:
        raise ArrayError(
            f"appearances must be of 1 world or of {len(poses)}, like object_poses, got {worlds}; one row for all "
            "worlds is enough for what does not differ"
        )
    if not poses.size:
        return wp.empty((worlds, 0), dtype=wp.transform, device=poses.device)
    return take_rows(poses, np.zeros(worlds, dtype=np.int32))


def _is_empty(exclude: object) -> bool:
    try:
        return len(exclude) == 0  # type: ignore[arg-type]
    except TypeError:  # no length, or an array without axes
        return False


@cache
def _still_world() -> Worlds:
    """Return worlds without movable and excluded objects."""
    from warpvis.kernels.casting.worlds import Worlds

    return Worlds()


def parse_moving_poses(scene: Scene, motion: Motion) -> wp.array:
    """Return the poses of movable objects at each instant of a motion, shape ``(T, W, M)`` transform."""
    parts = instants_of(motion)
    if isinstance(parts, np.ndarray):
        instants = len(parts)
        poses = _parse_object_poses(scene, parts.reshape(-1, *parts.shape[-2:]))
        return poses.reshape((instants, poses.shape[0] // instants, poses.shape[1]))
    return stacked([_parse_object_poses(scene, part) for part in parts])


def without_movables(scene: Scene, worlds: Worlds) -> Worlds:
    """Return worlds that exclude all movable objects, too."""
    from warpvis.kernels.casting.worlds import Worlds

    static = Worlds()
    static.object_poses, static.world, static.object_sizes = worlds.object_poses, worlds.world, worlds.object_sizes
    excluded = (pose_columns(scene) >= 0)[None]
    if worlds.excluded is not None:
        excluded = excluded | worlds.excluded.numpy().astype(np.bool_)
    static.excluded = wp.array(excluded.astype(np.uint8), dtype=wp.uint8, device=scene.device)
    return static


def part_of(worlds: Worlds, views: slice | NDArray[np.integer]) -> Worlds:
    """Return the worlds of a subset of the views."""
    from warpvis.kernels.casting.worlds import Worlds

    part = Worlds()
    part.object_poses, part.world, part.excluded = worlds.object_poses, worlds.world, worlds.excluded
    part.object_sizes = worlds.object_sizes
    if worlds.world is not None and worlds.world.size:
        part.world = take_rows(worlds.world, views)
    elif worlds.object_poses is not None and worlds.object_poses.shape[0] > 1:
        part.object_poses = take_rows(worlds.object_poses, views)
        if worlds.object_sizes is not None:
            part.object_sizes = take_rows(worlds.object_sizes, views)
    if worlds.excluded is not None and worlds.excluded.shape[0] > 1:
        part.excluded = take_rows(worlds.excluded, views)
    return part


def pose_columns(scene: Scene) -> NDArray[np.int32]:
    """Return every object's column in the object poses: its own or its parent's, -1 for static objects."""
    columns = np.full(len(scene), -1, dtype=np.int32)
    columns[list(scene.movable)] = np.arange(len(scene.movable))
    for index, parent in scene.attached().items():
        columns[index] = columns[parent]
    return columns


def _parse_object_scales(scene: Scene, scales: ArrayInput) -> wp.array:
    """Return scale factors on the scene's device, shape ``(1 or W, M)`` vec3; host arrays are checked."""
    movable = scene.movable
    if not movable:
        raise ArrayError("object_scales were given, but no object of the scene is movable; add one with movable=True")
    if not on_gpu(scales):
        rows = as_numpy(scales, name="object_scales")
        rows = rows[None] if rows.ndim == 2 else rows
        if rows.ndim != 3 or rows.shape[1:] != (len(movable), 3) or not len(rows) or rows.dtype.kind not in "fiu":
            raise ArrayError(
                f"object_scales must be numbers of shape (W, {len(movable)}, 3), factors along x, y and z of the "
                f"movable objects in W worlds, got {rows.dtype} of shape {rows.shape}"
            )
        with np.errstate(over="ignore"):
            rows = rows.astype(np.float32)
        bad = np.argwhere(~((rows > 0) & np.isfinite(rows)).all(axis=2))
        if len(bad):
            raise ArrayError(f"object_scales must be positive and finite: {_describe_wrong(scene, bad)}")
        scales = rows
    elif isinstance(scales, wp.array) and scales.ndim == 1 and wp.types.types_equal(scales.dtype, wp.vec3):
        scales = scales.reshape((1, scales.shape[0]))
    return as_warp(scales, wp.vec3, ("W", len(movable)), name="object_scales", device=scene.device)


def _sizes(scene: Scene, scales: wp.array, worlds: int) -> wp.array:
    """Return `Worlds.object_sizes` from scale factors of one or all worlds."""
    from warpvis.kernels.casting.worlds import scale_sizes

    if scales.shape[0] not in (1, worlds):
        raise ArrayError(f"object_scales have {scales.shape[0]} worlds, but object_poses have {worlds}")
    sizes = wp.empty((worlds, scales.shape[1]), dtype=wp.vec4, device=scene.device)
    launch(scale_sizes, sizes.shape, [scene.movable_sizes(), scales, sizes], scene.device)
    return sizes


def _parse_object_poses(scene: Scene, poses: PoseLike, repeated: int = 1) -> wp.array:
    movable = scene.movable
    if poses is None:
        return scene.movable_poses(repeated)
    if not movable:
        raise PoseError("object_poses were given, but no object of the scene is movable; add one with movable=True")
    if isinstance(poses, wp.array) and poses.dtype == wp.transform and poses.ndim == 1:
        poses = poses.reshape((1, poses.shape[0]))
    if on_gpu(poses):
        return _check_device_poses(poses, len(movable), scene.device)
    rows = as_numpy(poses, name="object_poses")
    rows = rows[None] if rows.ndim == 2 else rows
    if rows.ndim != 3 or rows.shape[1:] != (len(movable), 7) or len(rows) == 0:
        raise PoseError(
            f"object_poses must have shape (W, {len(movable)}, 7), rows x y z qx qy qz qw of the movable objects in "
            f"W worlds, got {rows.shape}"
        )
    checked, device = _checked_rows(rows, scene), scene.device
    if device.is_cpu:
        return share(checked, checked.shape[:2], wp.transform)
    return wp.array(checked, dtype=wp.transform, shape=checked.shape[:2], device=device)


def _checked_rows(rows: np.ndarray, scene: Scene) -> NDArray[np.float32]:
    """Return the rows in single precision; kernels normalize them."""
    with np.errstate(over="ignore"):
        rows = np.ascontiguousarray(rows, dtype=np.float32)
    if are_valid_rows(rows.reshape(-1, 7)):
        return rows
    problem, bad = find_invalid_rows(rows)
    if problem:
        raise PoseError(f"object_poses {problem}: {_describe_wrong(scene, np.argwhere(bad))}")
    return rows


def _describe_wrong(scene: Scene, indices: NDArray[np.intp]) -> str:
    """Return the number of invalid objects in worlds, shape ``(n, 2)``, and the names of the first ones."""
    names = [f"{scene.objects[scene.movable[column]].name!r} in world {world}" for world, column in indices[:3]]
    return f"wrong in {len(indices)}, of {', '.join(names)}"


def _check_device_poses(poses: PoseLike, count: int, device: wp.Device) -> wp.array:
    if not isinstance(poses, wp.array):
        poses = wp.from_dlpack(poses)
    if wp.types.types_equal(poses.dtype, wp.float32) and poses.ndim in (2, 3) and poses.shape[-1] == 7:
        worlds = poses.shape[0] if poses.ndim == 3 else 1
        poses = poses.contiguous().view(wp.transform).reshape((worlds, poses.shape[-2]))
    try:
        return as_warp(poses, wp.transform, ("W", count), name="object_poses", device=device)
    except ArrayError as error:
        raise PoseError(str(error)) from None


def _parse_world(world_index: ArrayInput | None, views: int, count: int, device: wp.Device) -> wp.array:
    result = as_warp(world_index, wp.int32, (views,), name="world_index", device=device)
    if on_gpu(world_index):
        return result
    host = as_numpy(world_index, name="world_index")
    bad = np.flatnonzero((host < 0) | (host >= count))
    if len(bad):
        raise ArrayError(
            f"world_index must be from 0 to {count - 1}, the worlds of object_poses, got {host[bad[0]]} for view "
            f"{bad[0]}"
        )
    return result


def _parse_exclude(scene: Scene, views: int, exclude: Excluded) -> wp.array:
    """Return flags ``(views or 1, objects)`` from an array of flags, or from names and indices for all views."""
    count = len(scene)
    if isinstance(exclude, Sequence) and all(isinstance(item, str) or is_whole(item) for item in exclude):
        flags = np.zeros((1, count), dtype=np.uint8)
        flags[0, [_index(scene, item) for item in exclude]] = 1
        return wp.array(flags, dtype=wp.uint8, device=scene.device)
    if on_gpu(exclude):
        flags = as_warp(exclude, wp.uint8, ("V", count), name="exclude", device=scene.device)
    else:
        flags = as_numpy(exclude, name="exclude")
    if flags.shape not in ((views, count), (1, count)):
        raise ArrayError(
            f"exclude must be names or indices of objects, or flags of shape ({views}, {count}) or (1, {count}), "
            f"got shape {flags.shape}"
        )
    if isinstance(flags, wp.array):
        return flags
    return wp.array((flags != 0).astype(np.uint8), dtype=wp.uint8, device=scene.device)


def _index(scene: Scene, item: str | int) -> int:
    if isinstance(item, str):
        return scene.index(item)
    if not 0 <= item < len(scene):
        raise ArrayError(f"exclude must be indices of objects from 0 to {len(scene) - 1}, got {item}")
    return int(item)
