# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons, skins and flexes of many worlds.

Tendons are capsules, whose poses and sizes differ between worlds. The vertices of skins and flexes differ, while worlds
share meshes: their worlds are rendered one by one.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from threading import RLock
from typing import Any

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, as_warp, on_gpu, surely_finite
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError, SceneError
from warpvis.mujoco._batch_views import Workplace
from warpvis.mujoco._model_fields import FLEX, SKIN, TENDON, drawn_number, free_name
from warpvis.mujoco._poses import SKIN_FIELDS, TENDON_FIELDS, PoseSource, read_frames, soft_fields, world_count
from warpvis.mujoco._scene import Selection
from warpvis.mujoco._visual_objects import VisualObjects
from warpvis.mujoco._visuals import Paint, VisualKey, Visuals
from warpvis.scene import Scene
from warpvis.scene.solids import capsule

_FLAG = mujoco.mjtVisFlag
_OF_FLEXES = tuple(int(getattr(_FLAG, f"mjVIS_FLEX{name}")) for name in ("VERT", "EDGE", "FACE", "SKIN"))
_OF_SOFT = (int(_FLAG.mjVIS_SKIN), *_OF_FLEXES)
_TENDONS = int(_FLAG.mjVIS_TENDON)
_MAX_CURVE_POINTS = 100  # of `addSpatialTendonGeoms`
_MAX_PIECES = 12
"""Maximum number of capsules of an arc around a wrapped geom."""
_NOWHERE = (0, 0, 0, 0, 0, 0, 1)


def _option(chosen: mujoco.MjvOption | None, flags: tuple[int, ...]) -> mujoco.MjvOption:
    """Copy options, with some of the set flags only."""
    option = mujoco.MjvOption() if chosen is None else copy.copy(chosen)
    kept = [bool(option.flags[flag]) for flag in flags]
    option.flags[:] = 0
    option.frame = mujoco.mjtFrame.mjFRAME_NONE
    for flag, value in zip(flags, kept, strict=True):
        option.flags[flag] = value
    return option


def _computed(model: mujoco.MjModel) -> mujoco.MjData:
    """Return data with the initial places of all elements."""
    data = mujoco.MjData(model)
    for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_flex, mujoco.mj_tendon):
        compute(model, data)
    return data


class Tendons:
    """The tendons of a scene: a movable capsule for each segment that a tendon may have."""

    def __init__(
        self, model: mujoco.MjModel, selection: Selection, option: mujoco.MjvOption | None, scene: Scene
    ) -> None:
        """Add the tendons that MuJoCo draws with some options to a scene, after its other objects."""
        self._scene, self._nwrap, self._count = scene, int(model.nwrap), int(model.ntendon)
        self.first, self.numbers = len(scene), list[int]()
        """The index of the first capsule, and the number of each capsule's tendon in `object_names`."""
        self._column = len(scene.movable)
        self._arrays: tuple[wp.array, ...] | None = None
        names = set(selection.names) | {item.name for item in scene.objects}
        self._segments, self._arcs = list[tuple[int, int]](), list[tuple[int, int, int]]()
        self._slices = float(max(int(model.vis.quality.numslices), 1))
        self._is_cylinder = np.asarray(model.geom_type == int(mujoco.mjtGeom.mjGEOM_CYLINDER), dtype=np.int32)
        self._sizes = np.zeros((self._count, 2), dtype=np.float32)
        self._up = _upward(model)
        self._curve_points = int(np.clip(model.vis.quality.numslices + 1, 3, _MAX_CURVE_POINTS))
        arcs: list[tuple[tuple[int, int, int], int, Paint]] = []
        for tendon, paint in _painted_tendons(model, selection, option).items():
            radius = float(model.tendon_width[tendon])
            number = drawn_number(model, TENDON, tendon)
            if number is None or number in selection.left_out or radius <= 0:
                continue
            slack, (count, wraps) = _slack_length(model, tendon), _path_size(model, tendon)
            self._sizes[tendon] = radius, slack
            for segment in range(count if slack == 0 else self._curve_points - 1):
                self._segments.append((tendon, segment))
                self._add(selection, number, paint, radius, names)
            pieces = [(tendon, arc, piece) for arc in range(wraps) for piece in range(_MAX_PIECES)]
            arcs += [(piece, number, paint) for piece in pieces]
        for piece, number, paint in arcs:  # after all segments
            self._arcs.append(piece)
            self._add(selection, number, paint, float(self._sizes[piece[0], 0]), names)

    def _add(self, selection: Selection, number: int, paint: Paint, radius: float, names: set[str]) -> None:
        """Add a capsule of the tendon with a number in `object_names` to the scene."""
        own = selection.names[number]
        name = own if number not in self.numbers else free_name(f"{own}_{self.numbers.count(number)}", names)
        names.add(name)
        shape = capsule(radius, radius, mesh_tolerance=selection.mesh_tolerance)
        appearance = paint.filled_up(1)._replace(normals=None, uv=None).appearance(len(shape.faces))
        label = selection.labels[number]
        self._scene.add(shape, name=name, label=label, pose=_NOWHERE, movable=True, appearance=appearance)
        self.numbers.append(number)

    def __len__(self) -> int:
        return len(self.numbers)

    def place(self, poses: PoseSource, place: Workplace) -> None:
        """Write poses, sizes and visibility of the capsules in the worlds of a call."""
        from warpvis.kernels.mujoco.tendons import Paths, tendon_arcs, tendon_capsules

        device, scene = self._scene.device, self._scene
        shapes: dict[str, tuple[Any, int]] = {"wrap_xpos": (wp.spatial_vector, self._nwrap)}
        shapes["wrap_obj"] = wp.vec2i, self._nwrap
        shapes |= dict.fromkeys(("ten_wrapadr", "ten_wrapnum"), (wp.int32, self._count))
        paths = Paths()
        for name in TENDON_FIELDS:
            dtype, count = shapes[name]
            value = _field(poses, name, "tendons")
            array = as_warp(value, dtype, ("W", count), name=name, device=device)
            setattr(paths, name, array)
            if len(array) != world_count(poses):
                raise ArrayError(f"{name} must be of {world_count(poses)} worlds like geom_xpos, got {len(array)}")
            if name == "wrap_xpos" and not on_gpu(value) and not surely_finite(np.asarray(value)):
                _check_finite(np.asarray(value), name)
            if name == "ten_wrapnum" and not on_gpu(value):
                worlds, drawn = place.worlds.numpy(), np.unique([tendon for tendon, _ in self._segments])
                _check_computed(np.asarray(value)[worlds][:, drawn], name, worlds)
        if self._arrays is None:
            tables = (self._segments, wp.vec2i), (self._arcs, wp.vec3i), (self._is_cylinder, wp.int32)
            arrays = [wp.array(np.array(rows, dtype=np.int32), dtype=dtype, device=device) for rows, dtype in tables]
            self._arrays = (*arrays, wp.array(self._sizes, dtype=wp.vec2, device=device))
        if place.sizes is None:
            if place.own_sizes is None:
                rows = scene.movable_sizes().numpy()
                rows = np.ascontiguousarray(np.broadcast_to(rows, (len(place.worlds), *rows.shape)))
                place.own_sizes = wp.array(rows, dtype=wp.vec4, device=device)
            place.sizes = place.own_sizes
        if place.hidden is None:
            if place.own_hidden is None or place.own_hidden.shape[1] != len(scene):
                place.own_hidden = wp.zeros((place.eyes.size, len(scene)), dtype=wp.uint8, device=device)
            place.hidden = place.own_hidden

        sizes_of_worlds: Any = place.sizes
        hidden: Any = place.hidden

        def outputs(begin: int, count: int) -> list[wp.array]:
            columns, objects = (slice(first + begin, first + begin + count) for first in (self._column, self.first))
            return [place.objects[:, columns], sizes_of_worlds[:, columns], hidden[:, objects]]

        segments, arcs, is_cylinder, sizes = self._arrays
        count, rows = len(self._segments), len(place.worlds)
        inputs = [paths, place.worlds, segments, sizes, wp.vec3(*self._up), self._curve_points]
        launch(tendon_capsules, (rows, count), [*inputs, *outputs(0, count)], device)
        if self._arcs:
            frames = read_frames(poses, "geom", len(self._is_cylinder), device)
            inputs = [paths, *frames, is_cylinder, place.worlds, arcs, sizes, self._slices, _MAX_PIECES]
            launch(tendon_arcs, (rows, len(self._arcs)), [*inputs, *outputs(count, len(self._arcs))], device)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_arrays": None}


def _check_finite(rows: NDArray[Any], name: str, first: int = 0) -> None:
    bad = np.argwhere(~np.isfinite(rows))
    if len(bad):
        world, index = bad[0, :2].tolist()
        raise ArrayError(f"{name} must be finite, got {rows[world, index]} at index {index} in world {first + world}")


def _check_computed(rows: NDArray[Any], name: str, worlds: NDArray[np.integer]) -> None:
    """Raise an `ArrayError` if a field of some worlds contains zeros."""
    bad = np.argwhere(rows == 0)
    if len(bad):
        raise ArrayError(
            f"poses must be computed, got {name} of zeros in world {worlds[bad[0, 0]]}; call "
            "mujoco.mj_forward(model, data) first"
        )


def _painted_tendons(model: mujoco.MjModel, selection: Selection, option: mujoco.MjvOption | None) -> dict[int, Paint]:
    """Return the appearances of the tendons that MuJoCo draws with some options, by id."""
    if "wrap_xpos" not in soft_fields(model):
        return {}
    visuals = Visuals(model, mesh_tolerance=selection.mesh_tolerance)
    visuals.read(_computed(model), mujoco.MjvCamera(), _option(option, (_TENDONS,)), None)
    return {key.which: paint for key, paint in visuals.paints().items() if key.kind == TENDON}


def _upward(model: mujoco.MjModel) -> tuple[float, float, float]:
    """Return the direction against gravity; z without gravity."""
    length = float(np.linalg.norm(model.opt.gravity))
    x, y, z = (-model.opt.gravity / length).tolist() if length else (0.0, 0.0, 1.0)
    return x, y, z


def _path_size(model: mujoco.MjModel, tendon: int) -> tuple[int, int]:
    """Return the largest numbers of segments and arcs of a tendon: a wrapped geom has two points, others have one."""
    first = int(model.tendon_adr[tendon])
    kinds = model.wrap_type[first : first + int(model.tendon_num[tendon])]
    wraps = int(np.isin(kinds, (int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER))).sum())
    return len(kinds) + wraps - 1, wraps


def _slack_length(model: mujoco.MjModel, tendon: int) -> float:
    """Return the length below which a tendon hangs [m]; 0 if it is always straight.

    By `mjv_isCatenary` of src/engine/engine_vis_visualize.c.
    """
    stiff, damped = (
        bool(getattr(model, f"tendon_{name}")[tendon])
        or bool(np.any(getattr(model, f"tendon_{name}poly", np.zeros((model.ntendon, 1)))[tendon]))
        for name in ("stiffness", "damping")
    )
    low, high = (model.tendon_lengthspring if stiff else model.tendon_range)[tendon].tolist()
    has_gravity = not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    has_gravity &= np.linalg.norm(model.opt.gravity) > mujoco.mjMINVAL
    is_pulled = (model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON)) & (model.actuator_trnid[:, 0] == tendon)
    hangs = low == 0 and high > 0 and (stiff or bool(model.tendon_limited[tendon]))
    hangs &= bool(has_gravity) and int(model.tendon_num[tendon]) == 2 and not damped
    return high if hangs and model.tendon_frictionloss[tendon] == 0 and not is_pulled.any() else 0.0


class SoftElements:
    """The skins and flexes of a scene, whose meshes have the vertices of one world at a time."""

    def __init__(
        self,
        model: mujoco.MjModel,
        selection: Selection,
        option: mujoco.MjvOption | None,
        scene: Scene,
        *,
        colored: bool,
    ) -> None:
        """Add the skins and flexes that MuJoCo draws with some options to a scene, after its other objects."""
        self._model, self._selection, self._scene, self._colored = model, selection, scene, colored
        self._option = None if option is None else copy.copy(option)
        self.first = len(scene)
        """The index of the first of their objects."""
        self._fields = [name for name in soft_fields(model) if name not in TENDON_FIELDS]
        self._objects = VisualObjects(model, selection, scene)
        self._get_ready()
        if self._fields:
            self._draw(_computed(model))

    def _get_ready(self) -> None:
        self._lock, self._data = RLock(), mujoco.MjData(self._model)
        self._visuals = Visuals(self._model, mesh_tolerance=self._selection.mesh_tolerance)
        self._chosen = _option(self._option, _OF_SOFT)

    def __len__(self) -> int:
        return len(self._objects)

    def numbers(self) -> list[int]:
        """List the number of each object's element in `object_names`."""
        found = [drawn_number(self._model, kind, which) for which, kind in self._objects.meanings()]
        return [-1 if number is None else number for number in found]

    @contextmanager
    def reading(self, poses: PoseSource) -> Iterator[_Worlds]:
        """Read the places of skins and flexes in all worlds, and reserve the scene's meshes for the calling thread."""
        device = self._scene.device
        if device.is_cuda and device.is_capturing:
            raise SceneError(
                "skins and flexes must not be rendered into a CUDA graph, since their vertices are computed on the "
                f"host; create the BatchRenderer with exclude={self._names()!r}"
            )
        counts = {"xpos": (self._model.nbody, 3), "xquat": (self._model.nbody, 4)}
        counts["flexvert_xpos"] = (self._model.nflexvert, 3)
        fields = {}
        for name in self._fields:
            rows = as_numpy(_field(poses, name, "skins" if name in SKIN_FIELDS else "flexes"), name=name)
            if rows.ndim != 3 or rows.shape[1:] != counts[name] or rows.dtype.kind != "f":
                expected = ", ".join(map(str, ("W", *counts[name])))
                raise ArrayError(f"{name} must be floats of shape ({expected}), got {rows.dtype} of shape {rows.shape}")
            fields[name] = rows
        with self._lock:
            yield _Worlds(self, fields)

    def show(self, fields: Mapping[str, np.ndarray], world: int) -> None:
        """Give the meshes the vertices of a world."""
        for name, rows in fields.items():
            if world >= len(rows):
                raise ArrayError(f"{name} must be of as many worlds as geom_xpos, got {len(rows)}")
            _check_finite(rows[world : world + 1], name, world)
            if name == "xquat":
                _check_computed(np.abs(rows[world : world + 1]).max(axis=2), name, np.array([world]))
            getattr(self._data, name)[:] = rows[world]
        self._draw(self._data)

    def _draw(self, data: mujoco.MjData) -> None:
        drawn = self._visuals.read(data, mujoco.MjvCamera(), self._chosen, None)
        drawn = {key: blocks for key, blocks in drawn.items() if key.kind in (SKIN, FLEX)}
        paints: dict[VisualKey, Paint] | None = None
        if self._colored:
            paints = {key: paint for key, paint in self._visuals.paints().items() if key in drawn}
        self._objects.update(drawn, self.first, paints)

    def _names(self) -> list[str]:
        return sorted({self._selection.names[number] for number in self.numbers()})

    def __getstate__(self) -> dict[str, Any]:
        left_out = ("_lock", "_data", "_visuals", "_chosen", "_option")
        return {name: value for name, value in self.__dict__.items() if name not in left_out} | {
            "_flags": None if self._option is None else _packed(self._option)
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the options, which MuJoCo does not pickle."""
        packed = state.pop("_flags")
        self.__dict__.update(state)
        self._option = None if packed is None else _unpacked(packed)
        self._get_ready()


class _Worlds:
    """The places of skins and flexes in all worlds of a call."""

    def __init__(self, elements: SoftElements, fields: Mapping[str, np.ndarray]) -> None:
        self._elements, self._fields = elements, fields

    def show(self, world: int) -> None:
        """Give the scene's meshes the vertices of a world."""
        self._elements.show(self._fields, world)


_OPTION_ARRAYS = ("flags", "skingroup", "flexgroup")


def _packed(option: mujoco.MjvOption) -> dict[str, Any]:
    arrays: dict[str, NDArray[Any]] = {name: np.array(getattr(option, name)) for name in _OPTION_ARRAYS}
    return {**arrays, "flex_layer": option.flex_layer}


def _unpacked(packed: Mapping[str, Any]) -> mujoco.MjvOption:
    option = mujoco.MjvOption()
    for name in _OPTION_ARRAYS:
        getattr(option, name)[:] = packed[name]
    option.flex_layer = packed["flex_layer"]
    return option


def _field(source: PoseSource, name: str, elements: str) -> Any:
    """Return a field of all worlds, which elements of the model need."""
    value = getattr(source, name, None)
    if value is None:
        # MJX keeps fields that are not part of its interface apart.
        value = getattr(getattr(source, "_impl", None), name, None)
    if value is None:
        raise ArrayError(
            f"poses must have {name} for the model's {elements}, got {type(source).__name__}; pass a mujoco.MjData or "
            "joint positions, or leave them out by exclude= or scene_option= of BatchRenderer"
        )
    return np.asarray(value)[None] if isinstance(source, mujoco.MjData) else value
