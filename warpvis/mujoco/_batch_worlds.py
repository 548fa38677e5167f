# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses, sizes and visibility of the worlds of a call of `BatchRenderer`."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import NamedTuple, cast

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.core.arrays import as_numpy
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.mujoco._batch_elements import SoftElements, Tendons
from warpvis.mujoco._batch_views import BatchCamera, Workplace, views_by_intrinsics
from warpvis.mujoco._poses import PoseSource, check_computed, read_source, world_count
from warpvis.mujoco._scene import MujocoScene
from warpvis.mujoco._world_appearances import ModelAppearances
from warpvis.mujoco._world_models import ResizableGeoms, WorldModels
from warpvis.mujoco._worlds import FixedGeoms, Kinematics, check_worlds
from warpvis.rendering import Pool

_MAX_PLACES = 16
"""Largest number of cached choices of cameras and worlds."""


class PreparedWorlds(NamedTuple):
    """The worlds of a call."""

    source: PoseSource
    indices: NDArray[np.int32]
    models: WorldModels | None
    rows: NDArray[np.int32]
    """Rows of the worlds in `models`."""
    key: Hashable
    """The key of the workplace."""
    place: Workplace
    groups: dict[PlanarCamera, NDArray[np.int64]]
    """Views by their intrinsics."""


class BatchWorlds:
    """Reads worlds, and writes them into workplaces, which are cached by cameras and worlds."""

    def __init__(
        self,
        model: mujoco.MjModel,
        mujoco_scene: MujocoScene,
        kinematics: Kinematics,
        *,
        nworld: int | None,
        resizable: ResizableGeoms,
        tendons: Tendons,
        soft: SoftElements,
        appearance: ModelAppearances | None,
    ) -> None:
        self._model, self._mujoco_scene, self._kinematics = model, mujoco_scene, kinematics
        self._nworld, self._tendons, self._soft = nworld, tendons, soft
        self._resizable, self._appearance = resizable, appearance
        self._fixed = [FixedGeoms(model, mujoco_scene, sites=sites) for sites in (False, True)]
        self._free_workplaces = Pool(_MAX_PLACES)

    def prepare(
        self,
        poses: PoseSource | Sequence[mujoco.MjData] | ArrayInput,
        chosen: list[BatchCamera],
        worlds: ArrayLike | None,
        model: object | None,
    ) -> PreparedWorlds:
        """Read the poses of a call, and write those of objects and cameras into a workplace."""
        kinds = ["geom"] + ["site"] * bool(len(self._mujoco_scene.movable_sites))
        kinds += ["cam"] * any(camera.camera_id >= 0 for camera in chosen)
        source, indices, models, rows = self._read_worlds(poses, worlds, model, kinds)
        for fixed in self._fixed:
            fixed.check(source, indices)
        device = self._mujoco_scene.scene.device
        # Work on another stream may still use the memory.
        stream = None if device.is_cpu else device.stream.cuda_stream
        key = (tuple(chosen), indices.tobytes(), len(self._mujoco_scene.scene.movable), stream)
        place = self._free_workplaces.take(key) or Workplace.of(self._mujoco_scene, chosen, indices)
        if models is None and self._appearance is not None and self._appearance.colors_changed:
            models = WorldModels(self._model, {}, int(rows.max()) + 1)
        fovy = self._place(place, source, models, rows)
        groups = views_by_intrinsics(self._model, chosen, fovy, rows)
        return PreparedWorlds(source, indices, models, rows, key, place, groups)

    def give_back(self, prepared: PreparedWorlds) -> None:
        """Return the workplace of a call to the cache."""
        self._free_workplaces.give_back(prepared.key, prepared.place)

    def for_each_group(self, prepared: PreparedWorlds, work: Callable[[PlanarCamera, NDArray[np.int64]], None]) -> None:
        """Do some work for the views of each camera; world by world if skins or flexes have other vertices in each."""
        if not len(self._soft):
            for camera, views in prepared.groups.items():
                work(camera, views)
            return
        count = len(prepared.indices)
        with self._soft.reading(prepared.source) as soft:
            for row, world in enumerate(prepared.indices.tolist()):
                soft.show(world)
                for camera, members in prepared.groups.items():
                    views = members[members % count == row]
                    if len(views):
                        work(camera, views)

    def _place(
        self, place: Workplace, poses: PoseSource, models: WorldModels | None, rows: NDArray[np.int32]
    ) -> NDArray[np.float64] | None:
        """Write poses of objects and cameras, and visibility; return the fields of view if they are given."""
        place.write_poses(poses, self._mujoco_scene, self._model)
        place.hidden = place.sizes = None
        if models is not None:
            place.sizes = self._resizable.sizes(models, rows)
            changed = self._appearance is not None and self._appearance.colors_changed
            place.hidden = models.hidden_objects(self._mujoco_scene, rows, place.eyes.size, changed=changed)
        if len(self._tendons):
            self._tendons.place(poses, place)
        return None if models is None else models.fovy()

    def _read_worlds(
        self,
        poses: PoseSource | Sequence[mujoco.MjData] | ArrayInput,
        worlds: ArrayLike | None,
        model: object | None,
        kinds: Iterable[str],
    ) -> tuple[PoseSource, NDArray[np.int32], WorldModels | None, NDArray[np.int32]]:
        """Return a source of poses, the worlds to render in it, differences between models, and the rows of these."""
        source = read_source(poses)
        if source is not None:
            count = world_count(source)
            chosen = self._chosen_worlds(worlds, count)
            check_computed(source, kinds, chosen)
            return source, chosen, None if model is None else WorldModels(self._model, model, count), chosen
        joints = np.atleast_2d(as_numpy(cast("ArrayInput", poses), name="poses"))
        chosen = self._chosen_worlds(worlds, len(joints))
        models = None if model is None else WorldModels(self._model, model, len(joints))
        changes = {} if models is None else models.poses()
        changes = {name: rows if len(rows) == 1 else rows[chosen] for name, rows in changes.items()}
        source = self._kinematics.from_qpos(joints if worlds is None else joints[chosen], model=changes or None)
        return source, np.arange(len(chosen), dtype=np.int32), models, chosen

    def _chosen_worlds(self, worlds: ArrayLike | None, count: int) -> NDArray[np.int32]:
        """Check `worlds` and return the indices of the worlds to render, out of `count`."""
        if self._nworld not in (None, count):
            raise ArrayError(f"poses must be of nworld worlds, {self._nworld}, got {count}")
        return check_worlds(worlds, count)
