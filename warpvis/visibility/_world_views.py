# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parsing of views that are given one by one, or as cameras in worlds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warpvis.core.arrays import as_numpy, on_gpu
from warpvis.core.device_poses import from_foreign
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, ObjectScales, PoseLike
from warpvis.errors import ArrayError
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds


@dataclass(frozen=True)
class WorldViews:
    """Parsed views of a scene."""

    given: PoseLike
    """The poses as given, of shape ``(V, ...)``, with quaternions in the order x y z w."""
    poses: wp.array
    """Camera to world, ``(V,)`` transform."""
    worlds: Worlds
    shape: tuple[int, ...]
    """Shape of the views: (V,), or (W, M) for M cameras in each of W worlds."""


def parse_world_views(
    scene: Scene,
    camera_to_world: PoseLike,
    object_poses: ObjectPoses,
    world_index: ArrayInput | None,
    exclude: Excluded,
    object_scales: ObjectScales,
    convention: Convention,
    quaternion: QuaternionOrder,
) -> WorldViews:
    """Parse arguments as for `Renderer.render`, where poses may have the leading shape (W, M) instead of (V,).

    With such poses, so may flags of excluded objects.

    Raises:
        ArrayError: If poses are for each world, and `world_index` is given, or objects have other numbers of worlds.
    """
    given = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    shape = _by_world(given)
    if shape is not None:
        if world_index is not None:
            raise ArrayError("world_index must be None if camera_to_world has poses for each world, (W, M, ...)")
        given, world_index = _flatten(given, "camera_to_world"), _index(shape, object_poses, object_scales)
        if _shape(exclude)[:-1] == shape:
            exclude = _flatten(exclude, "exclude")
    poses = parse_poses(given, convention=convention, device=scene.device)
    worlds = parse_worlds(scene, len(poses), object_poses, world_index, exclude, object_scales)
    return WorldViews(given, poses, worlds, shape or (len(poses),))


def _by_world(poses: PoseLike) -> tuple[int, int] | None:
    """Return the first two axes of poses that have one more than those of single views; None for the others."""
    shape = _shape(poses)
    if isinstance(poses, wp.array) and any(wp.types.types_equal(poses.dtype, t) for t in (wp.transform, wp.mat44)):
        elements = 0
    else:
        elements = 2 if shape[-2:] == (4, 4) else 1 if shape[-1:] == (7,) else len(shape)
    return (shape[0], shape[1]) if len(shape) - elements == 2 else None


def _shape(rows: ArrayInput) -> tuple[int, ...]:
    """Return the shape of an array; empty for ragged lists, which parsers reject."""
    if hasattr(rows, "shape"):
        return tuple(rows.shape)
    try:
        return np.shape(rows)
    except ValueError:
        return ()


def _flatten(rows: ArrayInput, name: str) -> ArrayInput:
    """Merge the first two axes."""
    if on_gpu(rows) and not isinstance(rows, wp.array):
        rows = from_foreign(rows, name)
    array = rows.contiguous() if isinstance(rows, wp.array) else as_numpy(rows, name=name)
    return array.reshape((array.shape[0] * array.shape[1], *array.shape[2:]))


def _index(shape: tuple[int, int], object_poses: ObjectPoses, object_scales: ObjectScales) -> np.ndarray | None:
    """Return the world of each view; None if all views show the only one."""
    for name, rows in (("object_poses", object_poses), ("object_scales", object_scales)):
        worlds = 1 if rows is None else _worlds_of(rows)
        if worlds not in (1, shape[0]):
            raise ArrayError(
                f"camera_to_world must have poses for each of the {worlds} worlds of {name}, (W, M, ...), got those of "
                f"{shape[0]}"
            )
        if worlds > 1:
            return np.repeat(np.arange(shape[0], dtype=np.int32), shape[1])
    return None


def _worlds_of(rows: ArrayInput) -> int:
    """Return the number of worlds of object poses or scales."""
    shape = _shape(rows)
    is_scalar = not isinstance(rows, wp.array) or rows.dtype == wp.float32
    return shape[0] if len(shape) == 2 + is_scalar else 1
