# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the worlds of a batch: their indices, and that static geoms have not moved."""

from __future__ import annotations

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.errors import ArrayError
from warpvis.mujoco._geoms import initial_poses
from warpvis.mujoco._poses import PoseSource
from warpvis.mujoco._scene import MujocoScene

# Static geoms have moved if their poses differ by more than single-precision rounding [m, or unitless].
_MOVED = 1e-4


class FixedGeoms:
    """Static geoms, or sites, of a scene and their poses."""

    def __init__(self, model: mujoco.MjModel, mujoco_scene: MujocoScene, *, sites: bool = False) -> None:
        """Collect them from a scene that was just made of the model."""
        first = int(model.ngeom) if sites else 0
        self._kind, self._count = ("site", int(model.nsite)) if sites else ("geom", int(model.ngeom))
        shown = zip(mujoco_scene.shapes().tolist(), mujoco_scene.scene.objects, strict=False)
        of_kind = range(first, first + self._count)
        fixed = [(shape, item.name) for shape, item in shown if shape in of_kind and not item.movable]
        numbers = np.array([shape for shape, _ in fixed], dtype=np.int64)
        self._geoms, self._names = numbers - first, [name for _, name in fixed]
        poses = initial_poses(model)[numbers]
        self._position, self._rotation = poses[:, :3, 3].copy(), poses[:, :3, :3].reshape(-1, 9)

    def check(self, source: PoseSource, worlds: NDArray[np.int32]) -> None:
        """Compare them with poses in host memory; poses on a GPU are not checked.

        Raises:
            ArrayError: If one is elsewhere.
        """
        if not len(self._geoms):
            return
        position, rotation = (getattr(source, f"{self._kind}_{name}", None) for name in ("xpos", "xmat"))
        if not isinstance(position, np.ndarray) or not isinstance(rotation, np.ndarray):
            return
        if isinstance(source, mujoco.MjData):
            position, rotation = position[None], rotation[None]
        if position.shape[1:] != (self._count, 3) or position.shape[:2] != rotation.shape[:2]:
            return  # the code that reads the arrays raises an error
        if not np.array_equal(worlds, np.arange(len(position))):
            position, rotation = position[worlds], rotation[worlds]
        # Test the common case first: this is called for every image.
        moved = np.abs(position.take(self._geoms, axis=1) - self._position)
        turned = np.abs(rotation.take(self._geoms, axis=1).reshape(*moved.shape[:2], 9) - self._rotation)
        if moved.max(initial=0) <= _MOVED and turned.max(initial=0) <= _MOVED:
            return
        bad = np.argwhere(~(moved <= _MOVED).all(axis=2) | ~(turned <= _MOVED).all(axis=2))
        row, column = bad[0].tolist()
        name = self._names[column]
        raise ArrayError(
            f"{self._kind} {name!r} is static and must have the model's pose, got another in world {worlds[row]}; "
            f'create the BatchRenderer with movable=[{name!r}] or movable="all"'
        )


def check_worlds(worlds: ArrayLike | None, count: int) -> NDArray[np.int32]:
    """Return indices of worlds below `count`: the given ones, those selected by a mask, or all.

    Raises:
        ArrayError: If no world is selected, or an index is out of range.
    """
    if worlds is None:
        return np.arange(count, dtype=np.int32)
    chosen = as_numpy(worlds, name="worlds")
    if chosen.dtype == bool:
        if chosen.shape != (count,) or not chosen.any():
            raise ArrayError(
                f"worlds must be a mask of {count} with a True, got {chosen.sum()} in shape {chosen.shape}"
            )
        return np.flatnonzero(chosen).astype(np.int32)
    if chosen.ndim != 1 or chosen.dtype.kind not in "iu" or not len(chosen):
        raise ArrayError(f"worlds must be one or more indices, got {chosen.dtype} of shape {chosen.shape}")
    bad = np.flatnonzero((chosen < 0) | (chosen >= count))
    if len(bad):
        raise ArrayError(f"worlds must be from 0 to {count - 1}, got {chosen[bad[0]]} at index {bad[0]}")
    return chosen.astype(np.int32)
