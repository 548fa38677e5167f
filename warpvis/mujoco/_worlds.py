# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds of a model: poses from joint positions, checks of indices, and that static geoms have not moved."""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import is_whole, pluralize
from warpvis.core.threads import check_threads, run_each
from warpvis.errors import ArrayError
from warpvis.mujoco._geoms import initial_poses
from warpvis.mujoco._poses import INTEGER_FIELDS, PoseSource, WorldPoses, pose_shapes
from warpvis.mujoco._scene import MujocoScene
from warpvis.mujoco._world_models import WorldModels
from warpvis.rendering import Pool

_FULL_PHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
# Static geoms have moved if their poses differ by more than single-precision rounding [m, or unitless].
_MOVED = 1e-4


class Kinematics:
    """Computes poses from joint positions or states with MuJoCo on several threads."""

    def __init__(self, model: mujoco.MjModel, *, threads: int | None = None) -> None:
        """Prepare to compute poses on a number of CPU threads; by default all cores of this process."""
        if not isinstance(model, mujoco.MjModel):
            raise ArrayError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
        self._model = model
        self._threads = check_threads(threads)
        self._free = Pool(1)

    def from_qpos(
        self,
        qpos: ArrayLike,
        *,
        mocap_pos: ArrayLike | None = None,
        mocap_quat: ArrayLike | None = None,
        model: object | None = None,
    ) -> WorldPoses:
        """Compute poses of W worlds.

        Args:
            qpos: Joint positions, shape ``(W, nq)``, or ``(nq,)`` for one world.
            mocap_pos: Positions of mocap bodies [m], shape ``(W, nmocap, 3)``; the model's by default.
            mocap_quat: Their rotations ``w x y z``, shape ``(W, nmocap, 4)``; the model's by default.
            model: Model fields that differ between worlds: a mapping of `body_pos`, `body_quat`, `geom_pos`,
                `geom_quat`, `cam_pos` and `cam_quat` to arrays of shape ``(W, ...)`` or ``(1, ...)``, or an object with
                these attributes.
        """
        array = as_numpy(qpos, name="qpos")
        rows = _check_rows(array[None] if array.ndim == 1 else array, (self._model.nq,), "qpos")
        parts = {"qpos": rows}
        for name, value, size in (("mocap_pos", mocap_pos, 3), ("mocap_quat", mocap_quat, 4)):
            if value is not None:
                parts[name] = _check_rows(value, (self._model.nmocap, size), name)
                if len(parts[name]) != len(rows):
                    raise ArrayError(
                        f"{name} must be of {pluralize(len(rows), 'world')} like qpos, got {len(parts[name])}"
                    )

        def place(data: mujoco.MjData, world: int) -> None:
            for name, values in parts.items():
                getattr(data, name)[:] = values[world]

        changes = {} if model is None else WorldModels(self._model, model, len(rows)).poses()
        return self._run(place, len(rows), changes)

    def from_states(self, states: ArrayLike, spec: int = _FULL_PHYSICS) -> WorldPoses:
        """Compute poses of W worlds.

        Args:
            states: Rows as returned by `mj_getState`, such as those of `mujoco.rollout`, shape ``(W, n)``, or
                ``(rollouts, steps, n)``, in which case the worlds are all steps of the first rollout, then the second.
            spec: Contents of a row, of `mujoco.mjtState`; the default, mjSTATE_FULLPHYSICS, is that of
                `mujoco.rollout`.
        """
        known = isinstance(spec, mujoco.mjtState) or is_whole(spec)
        if not known or not 0 < int(spec) < 1 << int(mujoco.mjtState.mjNSTATE):
            raise ArrayError(f"spec must be of mujoco.mjtState, got {spec!r}")
        size = mujoco.mj_stateSize(self._model, int(spec))
        array = as_numpy(states, name="states")
        if array.ndim == 3:
            array = array.reshape(-1, array.shape[-1])
        rows = _check_rows(array, (size,), "states")
        return self._run(lambda data, world: mujoco.mj_setState(self._model, data, rows[world], spec), len(rows))

    def _run(
        self,
        place: Callable[[mujoco.MjData, int], None],
        count: int,
        changes: Mapping[str, NDArray[np.float64]] = MappingProxyType({}),
    ) -> WorldPoses:
        model = self._model
        shapes = {
            name: shape
            for name, shape in pose_shapes(model).items()
            if shape[0] or not name.startswith(("site", "light"))
        }
        arrays = {
            name: np.empty((count, *shape), dtype=np.int32 if name in INTEGER_FIELDS else np.float32)
            for name, shape in shapes.items()
        }
        parts = [part for part in np.array_split(np.arange(count), self._threads) if len(part)]
        # Every thread has its own copy of a model that changes from world to world.
        models = [_changeable(model, changes) if changes else model for _ in parts]
        data_of_threads = [
            mujoco.MjData(own) if changes else self._free.take(None) or mujoco.MjData(own) for own in models
        ]

        def work(index: int) -> None:
            thread_model, data = models[index], data_of_threads[index]
            mujoco.mj_resetData(thread_model, data)
            fields = [(out, getattr(data, name)) for name, out in arrays.items()]
            changed = [(getattr(thread_model, name), values) for name, values in changes.items()]
            for world in parts[index].tolist():
                place(data, world)
                for field, values in changed:
                    field[:] = values[world % len(values)]
                mujoco.mj_kinematics(thread_model, data)
                mujoco.mj_comPos(thread_model, data)  # cameras may look at a center of mass
                mujoco.mj_camlight(thread_model, data)
                if "flexvert_xpos" in arrays:
                    mujoco.mj_flex(thread_model, data)
                if "wrap_xpos" in arrays:
                    mujoco.mj_tendon(thread_model, data)
                for out, field in fields:
                    out[world] = field

        run_each(work, range(len(parts)), self._threads)
        for data in () if changes else data_of_threads:
            self._free.give_back(None, data)
        return WorldPoses(**arrays)


def _changeable(model: mujoco.MjModel, changes: Collection[str]) -> mujoco.MjModel:
    """Copy a model so that the given fields can be changed."""
    copied = copy.copy(model)
    if "geom_pos" in changes or "geom_quat" in changes:
        # MuJoCo skips the poses of geoms that the compiler marked as having their body's frame.
        copied.geom_sameframe[:] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    return copied


def _check_rows(values: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray[np.float64]:
    rows = as_numpy(values, name=name).astype(np.float64)
    if rows.shape[1:] != shape or rows.ndim != len(shape) + 1:
        expected = ", ".join(map(str, ("W", *shape)))
        raise ArrayError(f"{name} must have shape ({expected}), got {rows.shape}")
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=tuple(range(1, rows.ndim))))
    if len(bad):
        raise ArrayError(
            f"{name} must be finite, got others in {len(bad)} of {pluralize(len(rows), 'world')}, the first {bad[0]}"
        )
    return rows


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
        """Raise an `ArrayError` if one has another pose in host memory; poses on a GPU are not checked."""
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
            f'pass movable=[{name!r}] or movable="all" to the constructor of the renderer or wrapper'
        )


def check_worlds(worlds: ArrayLike | None, count: int) -> NDArray[np.int32]:
    """Return indices of worlds below `count`: the given ones, those selected by a mask, or all."""
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
