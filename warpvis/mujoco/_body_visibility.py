# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions of bodies in the views of a batch, and what hides the rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import as_items, check_flag, check_whole, is_whole
from warpvis.core.kernel_cache import launch
from warpvis.errors import CameraError, SceneError
from warpvis.mujoco._batch_views import Workplace, rows_of, select_rows
from warpvis.rendering import Pool, Renderer
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds, part_of, pose_columns
from warpvis.visibility import FractionMeter, ObjectFractions

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds

_MAX_METERS = 64


@dataclass(frozen=True)
class BodyVisibility(ObjectFractions):
    """Visible fractions of K bodies in C cameras of W worlds, indexed ``[world, camera, body]``.

    A body is the union of its geoms: where several of them overlap, a pixel counts once.
    """

    bodies: tuple[int, ...] = ()
    """Ids of the bodies."""
    shaped: wp.array | None = None
    """A value with a slope where the fraction is 0 or 1, ``(W, C, K)`` float32; None if not requested. With the image's
    diagonal d [px], it is 1 + m / d if the fraction is 1 and m is the distance from the silhouette's box to the image
    border [px]; the fraction if it is between 0 and 1; -r / (2 d) if the body is OCCLUDED and r is the smallest
    distance [px] from one of its pixels to one that shows nothing nearer, at most d; else -1/2 - a / (2 pi), where a is
    the angle [rad] between the center of the body's geoms and the image."""


def choose_bodies(model: mujoco.MjModel, bodies: Sequence[str | int]) -> list[int]:
    """Return the ids of distinct bodies given by name or id."""
    chosen = []
    for item in as_items(bodies, "bodies", SceneError):
        if isinstance(item, str):
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, item)
            if body < 0:
                names = [name for k in range(model.nbody) if (name := model.body(k).name)]
                known = ", ".join(map(repr, names[:10]))
                raise SceneError(f"bodies must be names or ids of the model's bodies, such as {known}, got {item!r}")
            chosen.append(int(body))
        elif is_whole(item) and 0 <= item < model.nbody:
            chosen.append(int(item))
        else:
            raise SceneError(f"bodies must be names, or ids from 0 to {model.nbody - 1}, got {item!r}")
    if not chosen or len(set(chosen)) < len(chosen):
        raise SceneError(f"bodies must be one or more distinct bodies of the model, got {list(bodies)}")
    return chosen


def members_of_bodies(
    model: mujoco.MjModel, chosen: Sequence[int], of_objects: NDArray[np.int32], *, subtree: bool
) -> NDArray[np.bool_]:
    """Return whether the scene's objects are part of each body, or of its descendants, ``(K, objects)`` bool."""
    part_of = np.eye(model.nbody, dtype=bool)
    if subtree:
        for body in range(1, model.nbody):  # parents come first
            part_of[:, body] |= part_of[:, model.body_parentid[body]]
    part_of = np.append(part_of, np.zeros((model.nbody, 1), dtype=bool), axis=1)  # for objects without a body, -1
    members: NDArray[np.bool_] = part_of[chosen][:, of_objects]
    for body, mine in zip(chosen, members, strict=True):
        if not mine.any():
            hint = "" if subtree else "; subtree=True includes those of its descendants"
            raise SceneError(f"bodies must have rendered geoms, got {model.body(body).name!r} without any{hint}")
    return members


class BodyMeter:
    """Measures bodies in views of a scene, and computes their shaped values."""

    def __init__(self, scene: Scene, options: Mapping[str, Any]) -> None:
        """Use a scene with the options of a `BatchRenderer`."""
        self._scene = scene
        self._options = {name: options[name] for name in ("near_plane", "cull_backfaces", "threads")}
        self._meters = Pool(_MAX_METERS)
        self._renderers: dict[Camera, Renderer] = {}
        self._centers: tuple[wp.array, wp.array] | None = None

    def measure(
        self,
        camera: Camera,
        place: Workplace,
        views: NDArray[np.int64],
        groups: Sequence[Sequence[int]],
        found: dict[str, wp.array],
        *,
        canvas: tuple[int, int, int, int] | None = None,
        min_samples: int = 256,
        occluders: int = 0,
        shaped: bool = False,
    ) -> None:
        """Measure bodies in views through cameras with equal intrinsics.

        Args:
            camera: The intrinsics.
            place: Poses of cameras and objects.
            views: The views to measure.
            groups: The scene's objects of each body.
            found: Results of all views by name, ``(V, K, ...)``, of which rows are written; missing ones are allocated.
            canvas: As for a `FractionMeter`.
            min_samples: Likewise.
            occluders: Likewise.
            shaped: Whether to compute shaped values.
        """
        device, total = self._scene.device, place.eyes.size
        rows = rows_of(views, device)
        eyes, world_of_view = select_rows(place.eyes.flatten(), rows), select_rows(place.world_of_view, rows)
        hidden = None if place.hidden is None else select_rows(place.hidden, rows)
        if place.objects.size:
            worlds = parse_worlds(self._scene, len(eyes), place.objects, world_of_view, hidden)
            worlds.object_sizes = place.sizes
        else:
            worlds = parse_worlds(self._scene, len(eyes), None, None, hidden)
        min_samples, occluders = check_whole(min_samples, "min_samples"), check_whole(occluders, "occluders", minimum=0)
        key = camera, tuple(map(tuple, groups)), canvas, min_samples, occluders
        meter = self._meters.take(key)  # only one thread may use it at a time
        if meter is None:
            options: dict[str, Any] = {"min_samples": min_samples, "occluders": occluders, **self._options}
            meter = FractionMeter(self._scene, camera, objects=groups, canvas=canvas, **options)
        measured = meter.measure_parsed(eyes, worlds)
        self._meters.give_back(key, meter)
        results = {item.name: getattr(measured, item.name) for item in fields(measured) if item.name != "names"}
        if check_flag(shaped, "shaped"):
            results["shaped"] = self._shape(camera, place, eyes, worlds, groups, measured)
        for name, array in results.items():
            if len(views) == total:  # the usual case
                found[name] = array
                continue
            if name not in found:
                found[name] = wp.empty((total, *array.shape[1:]), dtype=array.dtype, device=device)
            if array.size:
                wp.copy(found[name][rows], array)

    def _shape(
        self,
        camera: Camera,
        place: Workplace,
        eyes: wp.array,
        worlds: Worlds,
        groups: Sequence[Sequence[int]],
        measured: ObjectFractions,
    ) -> wp.array:
        """Return the shaped values of bodies in views, ``(V, K)``."""
        from warpvis.kernels.mujoco import body_visibility as kernels

        device, (size, count), objects = self._scene.device, measured.fraction.shape, len(self._scene)
        flags = np.zeros((count, objects), dtype=np.uint8)
        for mine, group in zip(flags, groups, strict=True):
            mine[list(group)] = 1
        members = wp.array(flags, dtype=wp.uint8, device=device)
        near = camera.near if self._options["near_plane"] == "clip" else 0.0
        renderer = self._renderer(replace(camera, near=near, far=np.inf))
        seen, isolated = renderer.render_parsed(eyes, worlds), None
        squared = wp.full((size, count), camera.width**2 + camera.height**2, dtype=wp.int32, device=device)
        hidden = worlds.excluded
        alone = part_of(worlds, slice(0, size))
        alone.excluded = wp.empty((size, objects), dtype=wp.uint8, device=device)
        for slot in range(count):
            launch(kernels.exclude_others, (size, objects), [members[slot], hidden, alone.excluded], device)
            isolated = renderer.render_parsed(eyes, alone, out=isolated)
            inputs = [seen.depth, isolated.depth, slot, squared]
            launch(kernels.distance_to_free, (size, camera.height), inputs, device)
        centers = wp.empty((size, count), dtype=wp.vec3, device=device)
        world_of_view = worlds.world if worlds.world is not None else wp.zeros(size, dtype=wp.int32, device=device)
        inputs = [*self._object_centers(), place.objects, world_of_view, members, centers]
        launch(kernels.body_centers, (size, count), inputs, device)
        shaped = wp.empty((size, count), dtype=wp.float32, device=device)
        judged = [measured.fraction, measured.status, measured.box, squared, shaped]
        launch(kernels.shape_values, (size, count), [camera.device_struct(), eyes, centers, *judged], device)
        return shaped

    def _renderer(self, camera: Camera) -> Renderer:
        if camera not in self._renderers:
            while len(self._renderers) >= _MAX_METERS:
                self._renderers.pop(next(iter(self._renderers)), None)
            self._renderers[camera] = Renderer(self._scene, camera, outputs=("depth",), fill="inf", **self._options)
        return self._renderers[camera]

    def _object_centers(self) -> tuple[wp.array, wp.array]:
        """Return the center of every object's box, and the column of the pose that it is relative to, -1 for none."""
        if self._centers is None or len(self._centers[0]) != len(self._scene):
            corners = [item.frame_vertices for item in self._scene.objects]
            centers = np.array([(part.min(axis=0) + part.max(axis=0)) / 2 for part in corners], dtype=np.float32)
            device, columns = self._scene.device, pose_columns(self._scene)
            self._centers = (
                wp.array(centers, dtype=wp.vec3, device=device),
                wp.array(columns, dtype=wp.int32, device=device),
            )
        return self._centers

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderers": {}, "_centers": None}


def require_perspective(camera: PlanarCamera) -> Camera:
    """Return the camera, or raise a `CameraError` if it is orthographic."""
    if not isinstance(camera, Camera):
        raise CameraError("cameras must be perspective for visibility, got an orthographic one")
    return camera


def by_world(found: Mapping[str, wp.array], cameras: int, worlds: int) -> dict[str, wp.array]:
    """Return results ``(C * W, K, ...)`` as ``(W, C, K, ...)``."""
    return {
        name: array.reshape((cameras, worlds, *array.shape[1:]))
        .transpose((1, 0, *range(2, array.ndim + 1)))
        .contiguous()
        for name, array in found.items()
    }
