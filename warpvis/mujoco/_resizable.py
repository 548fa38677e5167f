# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Geoms whose sizes differ between worlds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, as_warp, on_gpu
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError, SceneError
from warpvis.mujoco._scene import MujocoScene, Selection, check_patterns, fitting
from warpvis.mujoco._world_models import WorldModels

Resizable = Literal["all"] | Iterable[str]

_GEOM = mujoco.mjtGeom
# Number of elements of geom_size that define the size of a geom.
_NUMBERS = {_GEOM.mjGEOM_SPHERE: 1, _GEOM.mjGEOM_CAPSULE: 2, _GEOM.mjGEOM_CYLINDER: 2}
_NUMBERS |= {_GEOM.mjGEOM_ELLIPSOID: 3, _GEOM.mjGEOM_BOX: 3}


def resizable_geoms(model: mujoco.MjModel, selection: Selection, resizable: Resizable) -> tuple[int, ...]:
    """List the geoms selected by name or pattern, or all resizable geoms with ``"all"``, in ascending order.

    Raises:
        SceneError: If the argument is invalid, or a pattern matches no resizable geom.
    """
    numbers = {int(kind): count for kind, count in _NUMBERS.items()}
    primitive = {geom for geom in range(model.ngeom) if int(model.geom_type[geom]) in numbers}
    if isinstance(resizable, str):
        if resizable != "all":
            raise SceneError(f'resizable must be "all", or a list of names or patterns of names, got {resizable!r}')
        return tuple(sorted(primitive))
    chosen: set[int] = set()
    for pattern in check_patterns(resizable, "resizable"):
        found = primitive.intersection(fitting(model, selection.names, pattern, "resizable"))
        if not found:
            raise SceneError(
                f"{pattern!r} in resizable must match a geom that is a box, sphere, capsule, cylinder or ellipsoid; "
                "other geoms cannot be resized"
            )
        chosen |= found
    return tuple(sorted(chosen))


class ResizableGeoms:
    """The resizable geoms of a scene, and the sizes of all geoms in the scene."""

    def __init__(self, model: mujoco.MjModel, mujoco_scene: MujocoScene, geoms: Iterable[int]) -> None:
        """Initialize with the sizes of a newly built scene."""
        self._scene = mujoco_scene
        self._geoms = np.array(sorted(set(geoms) & set(mujoco_scene.geom_ids.tolist())), dtype=np.int64)
        self._kinds = np.array(model.geom_type, dtype=np.int32)
        self._model_size = model.geom_size.astype(np.float32)
        self._arrays: list[wp.array] | None = None

    @property
    def objects(self) -> NDArray[np.int64]:
        """Indices of their objects."""
        return np.flatnonzero(np.isin(self._scene.geom_ids, self._geoms))

    def sizes(self, models: WorldModels, rows: NDArray[np.int32]) -> wp.array | None:
        """Return the sizes of all movable objects in some worlds, for `warpvis.kernels.worlds.Worlds`.

        Args:
            models: The arrays that differ between worlds.
            rows: The worlds, as rows of its arrays.

        Returns:
            Sizes, shape ``(worlds, M)`` vec4 on the scene's device; None if all equal the scene's.

        Raises:
            ArrayError: If a size is invalid, or differs for a geom that is not resizable.
        """
        from warpvis.kernels.mujoco import geom_sizes

        field = models.field("geom_size")
        if field is None or not self._checked(field):
            return None
        device, movable = self._scene.scene.device, len(self._scene.scene.movable)
        sizes = wp.empty((len(rows), movable), dtype=wp.vec4, device=device)
        geom_size = as_warp(field, wp.vec3, ("W", len(self._kinds)), name="geom_size", device=device)
        worlds = wp.array(rows, dtype=wp.int32, device=device)
        inputs = [geom_size, worlds, *self._on_device(movable), self._scene.scene.movable_sizes(), sizes]
        launch(geom_sizes, sizes.shape, inputs, device)
        return sizes

    def _on_device(self, movable: int) -> list[wp.array]:
        """Return the resizable geom of each movable object, -1 for none, and types and model sizes of all geoms."""
        if self._arrays is None or len(self._arrays[0]) != movable:
            device, columns = self._scene.scene.device, np.full(movable, -1, dtype=np.int32)
            moving = self._scene.movable_geoms
            columns[: len(moving)] = np.where(np.isin(moving, self._geoms), moving, -1)
            self._arrays = [wp.array(part, dtype=wp.int32, device=device) for part in (columns, self._kinds)]
            self._arrays.append(wp.array(self._model_size, dtype=wp.vec3, device=device))
        return self._arrays

    def _checked(self, sizes: Any) -> bool:
        """Check sizes, except on a GPU; return whether there are resizable geoms."""
        if on_gpu(sizes):
            if not len(self._geoms) and sizes.shape[0] > 1:
                raise ArrayError(
                    "geom_size must be of 1 world if no geom is resizable; create the BatchRenderer with "
                    'resizable=["box*", ...] or resizable="all"'
                )
            return len(self._geoms) > 0
        rows = as_numpy(sizes.numpy() if isinstance(sizes, wp.array) else sizes, name="geom_size")
        if rows.ndim != 3 or rows.shape[1:] != self._model_size.shape or not len(rows) or rows.dtype.kind not in "fiu":
            raise ArrayError(
                f"geom_size must be numbers of shape (W, {len(self._model_size)}, 3), got {rows.dtype} of shape "
                f"{rows.shape}"
            )
        with np.errstate(over="ignore"):
            rows = rows.astype(np.float32)
        self._check_constant(rows)
        self._check_positive(rows)
        return len(self._geoms) > 0

    def _check_constant(self, rows: NDArray[np.float32]) -> None:
        """Raise an `ArrayError` if a geom that is not resizable differs from the model."""
        constant = np.setdiff1d(self._scene.geom_ids, self._geoms)
        other = np.argwhere((rows[:, constant] != self._model_size[constant]).any(axis=2))
        if not len(other):
            return
        world, place = other[0].tolist()
        name = self._name(int(constant[place]))
        message = f"geom_size of {name!r} must equal the model's, got another in world {world}"
        if int(self._kinds[constant[place]]) not in map(int, _NUMBERS):
            raise ArrayError(f"{message}; planes, height fields and meshes cannot be resized")
        raise ArrayError(f'{message}; create the BatchRenderer with resizable=[{name!r}] or resizable="all"')

    def _check_positive(self, rows: NDArray[np.float32]) -> None:
        for kind, count in _NUMBERS.items():
            geoms = self._geoms[self._kinds[self._geoms] == int(kind)]
            numbers = rows[:, geoms, :count]
            bad = np.argwhere(~((numbers > 0) & np.isfinite(numbers)).all(axis=2))
            if len(bad):
                world, place = bad[0].tolist()
                got = rows[world, geoms[place], :count].tolist()
                raise ArrayError(
                    f"geom_size of {self._name(int(geoms[place]))!r} must be positive lengths [m] in every world, "
                    f"got {got} in world {world}"
                )

    def _name(self, geom: int) -> str:
        place = int(np.flatnonzero(self._scene.geom_ids == geom)[0])
        return self._scene.scene.objects[place].name

    def __getstate__(self) -> dict[str, Any]:
        """Return the picklable state, without device arrays."""
        return self.__dict__ | {"_arrays": None}
