# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of geoms, sites and cameras in one world or many, from MuJoCo's data or arrays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol, cast

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, as_warp, on_gpu, surely_finite
from warpvis.core.checks import as_items, is_whole
from warpvis.core.kernel_cache import launch
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.mujoco._scene import JOINT_WRAP, MujocoScene


class PoseSource(Protocol):
    """A source of poses with `geom_xpos` and `geom_xmat`: a `mujoco.MjData`, or arrays of worlds like `WorldPoses`."""

    @property
    def geom_xpos(self) -> ArrayInput: ...

    @property
    def geom_xmat(self) -> ArrayInput: ...


@dataclass
class WorldPoses:
    """Poses of all geoms and cameras of a model in W worlds, in world frames; arrays on the host or on a GPU."""

    geom_xpos: ArrayInput
    """Positions of the geoms [m], shape ``(W, ngeom, 3)``."""
    geom_xmat: ArrayInput
    """Their rotations, geom to world, shape ``(W, ngeom, 3, 3)`` or ``(W, ngeom, 9)``."""
    cam_xpos: ArrayInput | None = None
    """Positions of the cameras [m], shape ``(W, ncam, 3)``."""
    cam_xmat: ArrayInput | None = None
    """Their rotations, shape ``(W, ncam, 3, 3)`` or ``(W, ncam, 9)``: cameras look along -z with y up."""
    subtree_com: ArrayInput | None = None
    """Centers of mass of bodies with their subtrees [m], shape ``(W, nbody, 3)``, which cameras may track."""
    site_xpos: ArrayInput | None = None
    """Positions of the sites [m], shape ``(W, nsite, 3)``, which scenes may show."""
    site_xmat: ArrayInput | None = None
    """Their rotations, shape ``(W, nsite, 3, 3)`` or ``(W, nsite, 9)``."""
    light_xpos: ArrayInput | None = None
    """Positions of the lights [m], shape ``(W, nlight, 3)``, for colors."""
    light_xdir: ArrayInput | None = None
    """Their directions, shape ``(W, nlight, 3)``."""
    wrap_xpos: ArrayInput | None = None
    """Points of the paths of tendons [m], two in each row, shape ``(W, nwrap, 6)``."""
    wrap_obj: ArrayInput | None = None
    """The geoms that these points wrap, -1 for sites, -2 for pulleys, shape ``(W, nwrap, 2)`` int32."""
    ten_wrapadr: ArrayInput | None = None
    """First points of the tendons' paths, shape ``(W, ntendon)`` int32."""
    ten_wrapnum: ArrayInput | None = None
    """Their numbers of points, shape ``(W, ntendon)`` int32."""
    xpos: ArrayInput | None = None
    """Positions of the bodies [m], shape ``(W, nbody, 3)``, for skins."""
    xquat: ArrayInput | None = None
    """Their rotations ``w x y z``, shape ``(W, nbody, 4)``."""
    flexvert_xpos: ArrayInput | None = None
    """Positions of the vertices of flexes [m], shape ``(W, nflexvert, 3)``."""

    @classmethod
    def of(cls, worlds: Sequence[mujoco.MjData]) -> WorldPoses:
        """Copy the current poses of several `mujoco.MjData` of one model."""
        worlds = as_items(worlds, "worlds")
        if not worlds or not all(isinstance(data, mujoco.MjData) for data in worlds):
            raise ArrayError(f"worlds must be one or more of mujoco.MjData, got {worlds!r}")
        names = [field.name for field in fields(cls)]
        if len({tuple(len(getattr(data, name)) for name in names) for data in worlds}) > 1:
            raise ArrayError(
                "worlds must be mujoco.MjData of one model, got several numbers of geoms, cameras, bodies or sites"
            )
        found = cls(*(np.stack([getattr(data, name) for data in worlds]) for name in names))
        check_computed(found, ("geom",))
        return found


TENDON_FIELDS = ("wrap_xpos", "wrap_obj", "ten_wrapadr", "ten_wrapnum")
SKIN_FIELDS = ("xpos", "xquat")
INTEGER_FIELDS = TENDON_FIELDS[1:]


def soft_fields(model: mujoco.MjModel) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the fields of `WorldPoses` for a model's spatial tendons, skins and flexes."""
    shapes: dict[str, tuple[int, ...]] = {}
    if model.ntendon and (model.wrap_type[model.tendon_adr] != JOINT_WRAP).any():
        shapes |= {"wrap_xpos": (model.nwrap, 6), "wrap_obj": (model.nwrap, 2)}
        shapes |= {"ten_wrapadr": (model.ntendon,), "ten_wrapnum": (model.ntendon,)}
    if model.nskin:
        shapes |= {"xpos": (model.nbody, 3), "xquat": (model.nbody, 4)}
    if model.nflex:
        shapes["flexvert_xpos"] = (model.nflexvert, 3)
    return shapes


def pose_shapes(model: mujoco.MjModel) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the fields of `WorldPoses` in one world."""
    shapes: dict[str, tuple[int, ...]] = {"geom_xpos": (model.ngeom, 3), "geom_xmat": (model.ngeom, 9)}
    shapes |= {"cam_xpos": (model.ncam, 3), "cam_xmat": (model.ncam, 9), "subtree_com": (model.nbody, 3)}
    shapes |= {"light_xpos": (model.nlight, 3), "light_xdir": (model.nlight, 3)}
    return shapes | {"site_xpos": (model.nsite, 3), "site_xmat": (model.nsite, 9)} | soft_fields(model)


def read_source(poses: PoseSource | Sequence[mujoco.MjData] | ArrayInput) -> PoseSource | None:
    """Return the poses of geoms that a caller gave; None if it gave joint positions."""
    if isinstance(poses, list | tuple) and len(poses) and all(isinstance(data, mujoco.MjData) for data in poses):
        return WorldPoses.of(poses)
    return cast("PoseSource", poses) if hasattr(poses, "geom_xpos") else None


def geom_poses(source: PoseSource, scene: MujocoScene) -> NDArray[np.float32]:
    """Return the poses of a scene's movable objects, in the form of the `object_poses` of `Renderer.render`.

    Movable objects that were added to the scene come last, at the poses that they were added with.

    Args:
        source: A `mujoco.MjData` after `mj_forward` or `mj_kinematics`; or anything with the arrays `geom_xpos` and
            `geom_xmat` of W worlds (`WorldPoses`, `mujoco.batch.Batch`, the data of MJX and of MuJoCo Warp). If the
            scene shows sites, `site_xpos` and `site_xmat` too.
        scene: The result of `scene_from_mujoco`.

    Returns:
        Rows ``x y z qx qy qz qw``, geom to world, shape ``(M, 7)`` for a `mujoco.MjData`, else ``(W, M, 7)``.

    Raises:
        ArrayError: If the arrays are not those of the scene's model, or poses of a world were never computed (arrays on
            a GPU are not checked for that).
    """
    if not hasattr(scene, "movable_geoms"):
        raise ArrayError(f"scene must be a MujocoScene from scene_from_mujoco, got {type(scene).__name__}")
    rows = object_transforms(source, scene).numpy()
    check_computed(source, ("geom", "site") if len(scene.movable_sites) else ("geom",))
    return rows[0] if isinstance(source, mujoco.MjData) else rows


def camera_poses(source: PoseSource, model: mujoco.MjModel, cameras: Sequence[int]) -> NDArray[np.float32]:
    """Return the poses of the given cameras of a model, in the form that `Renderer.render` accepts.

    Args:
        source: As for `geom_poses`, with `cam_xpos` and `cam_xmat`: a `mujoco.MjData` after `mj_forward` or
            `mj_camlight`.
        model: The `mujoco.MjModel`.
        cameras: Ids of the cameras.

    Returns:
        Rows ``x y z qx qy qz qw`` of OpenCV cameras, camera to world, shape ``(cameras, 7)`` for a `mujoco.MjData`,
        else ``(cameras, W, 7)``.

    Raises:
        ArrayError: If the arrays are not those of the model, or poses of a world were never computed (arrays on a GPU
            are not checked for that).
    """
    if not isinstance(model, mujoco.MjModel):
        raise ArrayError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
    ids = as_items(cameras, "cameras")
    if not all(is_whole(number) and 0 <= number < model.ncam for number in ids):
        raise ArrayError(f"cameras must be ids from 0 to {model.ncam - 1}, got {cameras!r}")
    rows = camera_transforms(source, model, ids, device=wp.get_device("cpu")).numpy()
    check_computed(source, ("cam",))
    return rows[:, 0] if isinstance(source, mujoco.MjData) else rows


def object_transforms(
    source: PoseSource,
    scene: MujocoScene,
    worlds: wp.array | None = None,
    *,
    geoms: tuple[wp.array, wp.array] | None = None,
    out: wp.array | None = None,
) -> wp.array:
    """Compute the poses of `geom_poses` in the given worlds or all, ``(W, M)`` `wp.transform` on the scene's device.

    Callers may cache the results of `movable_ids` and `object_places`, and pass them as `geoms` and `out`.
    """
    from warpvis.kernels.mujoco import arrays as kernels

    device = scene.scene.device
    geoms, sites = movable_ids(scene) if geoms is None else geoms
    kinds, done = [("geom", scene.geom_count, geoms)], 0
    if len(sites):
        kinds.append(("site", scene.site_count, sites))
    for kind, count, ids in kinds:
        position, rotation = read_frames(source, kind, count, device)
        worlds = _all_of(position.shape[0], device) if worlds is None else worlds
        out = object_places(scene, len(worlds)) if out is None else out
        places = out[:, done:] if done else out
        inputs = [position, rotation, worlds, ids, places]
        launch(kernels.geom_transforms, (len(worlds), len(ids)), inputs, device)
        done += len(ids)
    assert out is not None
    return out


def movable_ids(scene: MujocoScene) -> tuple[wp.array, wp.array]:
    """Return the movable geoms and sites of a scene on its device."""
    ids = scene.movable_geoms, scene.movable_sites
    geoms, sites = (wp.array(part, dtype=wp.int32, device=scene.scene.device) for part in ids)
    return geoms, sites


def object_places(scene: MujocoScene, worlds: int) -> wp.array:
    """Allocate poses of all movable objects in the given worlds, shape ``(worlds, M)`` `wp.transform` on the device.

    The poses are those that objects were added with: only the geoms' columns, the first ones, have to be written.
    """
    objects = scene.scene.objects
    rows = np.array([objects[index].pose for index in scene.scene.movable], dtype=np.float32).reshape(-1, 7)
    places = np.ascontiguousarray(np.broadcast_to(rows, (worlds, *rows.shape)))
    return wp.array(places, dtype=wp.transform, shape=places.shape[:2], device=scene.scene.device)


def camera_transforms(
    source: PoseSource,
    model: mujoco.MjModel,
    cameras: Sequence[int] | wp.array,
    worlds: wp.array | None = None,
    *,
    device: wp.Device,
    out: wp.array | None = None,
) -> wp.array:
    """Compute the poses of `camera_poses` for the given worlds or all, ``(cameras, W)`` `wp.transform` on `device`."""
    from warpvis.kernels.mujoco import arrays as kernels

    position, rotation = read_frames(source, "cam", model.ncam, device)
    worlds = _all_of(position.shape[0], device) if worlds is None else worlds
    if not isinstance(cameras, wp.array):
        cameras = wp.array(list(cameras), dtype=wp.int32, device=device)
    out = wp.empty((len(cameras), len(worlds)), dtype=wp.transform, device=device) if out is None else out
    inputs = [position, rotation, cameras, worlds, out]
    launch(kernels.camera_transforms, out.shape, inputs, device)
    return out


def _all_of(count: int, device: wp.Device) -> wp.array:
    return wp.array(np.arange(count, dtype=np.int32), dtype=wp.int32, device=device)


def world_count(source: PoseSource) -> int:
    """Count the worlds of a source of poses."""
    return 1 if isinstance(source, mujoco.MjData) else int(_get(source, "geom_xpos").shape[0])


def viewer_transforms(
    source: PoseSource,
    model: mujoco.MjModel,
    cameras: tuple[wp.array, wp.array, wp.array],
    worlds: wp.array,
    *,
    tracking: bool,
    out: wp.array,
) -> None:
    """Write poses of a viewer's cameras, whose ids are -1, into their rows of `out`, ``(cameras, W)`` `wp.transform`.

    The cameras are those of a `Workplace`; `tracking` states whether one of them tracks a body.
    """
    from warpvis.kernels.mujoco import arrays as kernels

    device = out.device
    com = _read(source, "subtree_com", model.nbody, device) if tracking else None
    launch(kernels.viewer_transforms, out.shape, [com, *cameras, worlds, out], device)


def check_computed(source: PoseSource, kinds: Iterable[str], worlds: NDArray[np.int32] | None = None) -> None:
    """Check that poses were computed and are finite: MuJoCo's data is zero initially and after a reset.

    Kinds are of "geom", "site" and "cam". Arrays on a GPU are not read.
    """
    for name in (f"{kind}_{part}" for kind in kinds for part in ("xmat", "xpos")):
        value: Any = getattr(source, name, None)
        if isinstance(source, mujoco.MjData):
            # Test the common case first: this is called for every image. Squares rarely overflow.
            flat = value.ravel()
            if not len(flat) or (math.isfinite(flat @ flat) and (flat[0] or flat.any())):
                continue
            _check_rows_of(source, name, value[None], np.zeros(1, dtype=np.int64))
        elif value is not None and not on_gpu(value):
            rows = as_numpy(value, name=name)
            if rows.ndim > 2 and rows.size and rows.dtype.kind in "fiu":  # other arrays are rejected by their readers
                _check_rows_of(
                    source, name, rows, np.arange(len(rows)) if worlds is None else worlds[worlds < len(rows)]
                )


def _check_rows_of(source: PoseSource, name: str, rows: NDArray[Any], worlds: NDArray[np.integer]) -> None:
    """Raise an `ArrayError` if rotations of the given worlds are zero, or their numbers are not finite."""
    if name.endswith("xmat"):
        zeros = worlds[~rows[worlds, 0].reshape(len(worlds), -1).any(axis=1)]
        if len(zeros):
            raise ArrayError(
                f"poses must be computed, got {name} of zeros{_in_world(source, zeros[0])}; call "
                "mujoco.mj_forward(model, data) first"
            )
    bad = np.zeros((0, 2)) if surely_finite(rows) else np.argwhere(~np.isfinite(rows[worlds]))
    if len(bad):
        world, index = worlds[bad[0][0]], int(bad[0][1])
        got = rows[world, index].ravel().tolist()
        raise ArrayError(f"{name} must be finite, got {got} at index {index}{_in_world(source, world)}")


def _in_world(source: PoseSource, world: int) -> str:
    return "" if isinstance(source, mujoco.MjData) else f" in world {world}"


def read_frames(source: PoseSource, kind: str, count: int, device: wp.Device) -> tuple[wp.array, wp.array]:
    """Read positions and rotations of all geoms ("geom"), sites ("site") or cameras ("cam"), shape ``(W, count)``."""
    names = f"{kind}_xpos", f"{kind}_xmat"
    position, rotation = (_read(source, name, count, device) for name in names)
    if position.shape != rotation.shape:
        raise ArrayError(
            f"{names[0]} and {names[1]} must be of the same worlds, got {len(position)} and {len(rotation)}"
        )
    return position, rotation


def _get(source: PoseSource, name: str) -> ArrayInput:
    value = getattr(source, name, None)
    if value is None:
        raise ArrayError(
            f"poses must be a mujoco.MjData, a WorldPoses, or an object with {name}, got {type(source).__name__}"
        )
    return value


def _read(source: PoseSource, name: str, count: int, device: wp.Device) -> wp.array:
    """Read a field of all worlds on a device, shape ``(W, count)``, without a copy if memory can be shared."""
    value, dtype = _get(source, name), wp.mat33 if name.endswith("xmat") else wp.vec3
    if not isinstance(value, wp.array):
        if isinstance(source, mujoco.MjData):
            value = value[None]
        if dtype is wp.mat33 and getattr(value, "ndim", 0) == 3 and value.shape[2] == 9:
            value = value.reshape((value.shape[0], value.shape[1], 3, 3))
    return as_warp(value, dtype, ("W", count), name=name, device=device)
