# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Many worlds of one MuJoCo model, seen through the model's cameras."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, cast

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, check_out, empty
from warpvis.core.camera import Camera
from warpvis.core.checks import as_items, check_whole
from warpvis.core.labels import Label
from warpvis.core.types import ArrayInput, DeviceLike
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.mujoco._cameras import camera_from_mujoco, camera_id
from warpvis.mujoco._geoms import DEFAULT_GROUPS, DEFAULT_TOLERANCE, check_groups
from warpvis.mujoco._poses import (
    Kinematics,
    PoseSource,
    WorldPoses,
    camera_transforms,
    object_places,
    object_transforms,
    world_count,
)
from warpvis.mujoco._scene import scene_from_mujoco
from warpvis.rendering import Output, Renderer as SceneRenderer, Views, check_outputs, views_for
from warpvis.scene import Scene

# Cameras, worlds, how many objects move, and the stream that work is queued on.
_Key = tuple[tuple[int, ...], bytes, int, int | None]

# So many choices of cameras and worlds are remembered.
_MOST_PLACES = 16


@dataclass
class _Workplace:
    """Memory for one choice of cameras and worlds: with it, a call on a GPU allocates and copies nothing."""

    cameras: wp.array
    worlds: wp.array
    world_of_view: wp.array
    geoms: wp.array
    objects: wp.array
    eyes: wp.array


class BatchRenderer:
    """Renders any of a model's cameras in any of many worlds.

    Worlds share the model's shapes and differ in where things are. All views of a call have one size; what a pixel is
    is as in `warpvis.Views`.

    Example:
        >>> batch = BatchRenderer(model, nworld=1024, height=64, width=64)
        >>> views = batch.render(data, cameras=["wrist", "head"])  # MuJoCo Warp's data, on its GPU
        >>> wrist, head = views.depth.numpy().reshape(2, 1024, 64, 64)
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        nworld: int | None = None,
        *,
        height: int = 240,
        width: int = 320,
        outputs: Sequence[Output] = ("depth",),
        geom_groups: Iterable[int] = DEFAULT_GROUPS,
        tolerance: float = DEFAULT_TOLERANCE,
        labels: Mapping[str, Label | int | str] | None = None,
        exclude: Iterable[str] = (),
        cull_backfaces: bool = True,
        device: DeviceLike = "cpu",
        threads: int | None = None,
    ) -> None:
        """Prepare to render.

        Args:
            model: A `mujoco.MjModel`.
            nworld: How many worlds the poses of every call are of; any number by default.
            height: Image height [px].
            width: Image width [px].
            outputs: The images to make, as for `warpvis.Renderer`; `geom_ids` needs ``"segmentation"``.
            geom_groups: Groups of geoms to show; see `scene_from_mujoco`.
            tolerance: Most distance between round shapes and their triangles [m]; see `scene_from_mujoco`.
            labels: Labels by name or pattern; see `scene_from_mujoco`.
            exclude: Names or patterns of geoms or bodies not to render.
            cull_backfaces: See through surfaces from behind, as MuJoCo does.
            device: Where to render; poses that are on a GPU must be on this one.
            threads: CPU threads to use; all cores of this process by default.

        Raises:
            WarpvisError: An argument is not what it has to be.
        """
        nworld = None if nworld is None else check_whole(nworld, "nworld")
        Camera(width, height, 1, 1, 0, 0)  # checks the size
        options: dict[str, Any] = {"tolerance": tolerance, "labels": labels, "exclude": exclude, "device": device}
        self.model = model
        groups = check_groups(geom_groups)
        self.mujoco_scene = scene_from_mujoco(model, geom_groups=groups, **options)
        if not len(self.scene):
            raise SceneError(f"the model has no geoms to render in groups {groups}; see geom_groups=")
        self.nworld, self.height, self.width = nworld, height, width
        self.kinematics = Kinematics(model, threads=threads)
        self._outputs = check_outputs(outputs)
        self._render_options: dict[str, Any] = {"outputs": self._outputs, "cull_backfaces": cull_backfaces}
        self._render_options["threads"] = threads
        self._renderers: dict[Camera, SceneRenderer] = {}
        self._idle: dict[_Key, _Workplace] = {}

    @property
    def scene(self) -> Scene:
        """What is rendered: the geoms, and objects that are added to them, which stay where they were added."""
        return self.mujoco_scene.scene

    def render(
        self,
        poses: PoseSource | Sequence[mujoco.MjData] | ArrayInput,
        *,
        cameras: int | str | Sequence[int | str] | None = None,
        worlds: ArrayLike | None = None,
        out: Views | None = None,
    ) -> Views:
        """Render some cameras in some worlds.

        On CUDA the work is queued on the device's current stream and not waited for; arrays that are on the GPU are not
        copied to the host. With `out`, a call like an earlier one allocates nothing and records into a CUDA graph.

        Args:
            poses: Where everything is: anything with the arrays `geom_xpos`, `geom_xmat`, `cam_xpos` and `cam_xmat` of
                W worlds (MuJoCo Warp's data, MJX's, `mujoco.batch.Batch`, `WorldPoses`); a `mujoco.MjData`, or several;
                or joint positions, shape ``(W, nq)``. `kinematics.from_states` makes poses of states.
            cameras: Names or ids of the model's cameras; all by default.
            worlds: Indices of the worlds to render; all by default. Others cost nothing.
            out: Images of an earlier call to write into, of the same number of views.

        Returns:
            Images of C cameras in W worlds, all worlds of the first camera first: ``(C * W, height, width)``.

        Raises:
            CameraError: There is no such camera.
            ArrayError: Poses, worlds or `out` do not fit.
        """
        chosen = self._camera_ids(cameras)
        poses, indices = self._read_worlds(poses, worlds)
        device, count = self.scene.device, len(indices)
        # Work on another stream may not be done with the memory.
        stream = None if device.is_cpu else device.stream.cuda_stream
        key = (tuple(chosen), indices.tobytes(), len(self.scene.movable), stream)
        place = self._take(key, chosen, indices)
        views = self._render_from(poses, chosen, place, (len(chosen) * count, self.height, self.width), out)
        self._give_back(key, place)
        return views

    def _render_from(
        self,
        poses: PoseSource,
        chosen: Sequence[int],
        place: _Workplace,
        shape: tuple[int, int, int],
        out: Views | None,
    ) -> Views:
        device, count = self.scene.device, len(place.worlds)
        if place.objects.size:
            object_transforms(poses, self.mujoco_scene, place.worlds, geoms=place.geoms, out=place.objects)
        camera_transforms(poses, self.model, place.cameras, place.worlds, device=device, out=place.eyes)
        runs = [(camera, len(list(run))) for camera, run in groupby(chosen, key=self._camera)]
        if len(runs) == 1:
            return self._cast(runs[0][0], place, slice(0, shape[0]), out)
        views = views_for(self._outputs, shape, device, out)
        first = 0
        for camera, cameras in runs:
            images = slice(first * count, (first + cameras) * count)
            part = Views(**{name: getattr(views, name)[images] for name in self._outputs})
            self._cast(camera, place, images, part)
            first += cameras
        return views

    def geom_ids(self, views: Views, *, out: wp.array | None = None) -> wp.array:
        """Say which geom every pixel shows; -1 for none, and for objects that were added to the scene.

        Args:
            views: What `render` returned, with `objects`.
            out: An array to write into, of the same shape.

        Returns:
            Ids of the model's geoms, shape ``(views, height, width)`` int32.

        Raises:
            ArrayError: The views have no objects, or `out` does not fit.
        """
        from warpvis.kernels.mujoco import geoms_of_objects

        if not isinstance(views, Views) or views.segmentation is None:
            raise ArrayError('views must have segmentation; make the BatchRenderer with outputs=("segmentation", ...)')
        shape, device = views.segmentation.shape, views.segmentation.device
        out = empty(shape, wp.int32, name="geoms", device=device) if out is None else out
        check_out(out, wp.int32, shape, name="out", device=device)
        ids = wp.array(self.mujoco_scene.geoms_of_objects(), dtype=wp.int32, device=device)
        inputs = [views.segmentation.flatten(), ids, out.flatten()]
        wp.launch(geoms_of_objects, dim=out.size, inputs=inputs, device=device)
        return out

    def camera(self, camera: int | str) -> Camera:
        """Return intrinsics of one of the model's cameras in this renderer's image size."""
        return self._camera(camera_id(self.model, camera))

    def _camera(self, index: int) -> Camera:
        return camera_from_mujoco(self.model, index, self.width, self.height)

    def _cast(self, camera: Camera, place: _Workplace, views: slice, out: Views | None) -> Views:
        """Render views through cameras of the same intrinsics."""
        if camera not in self._renderers:
            self._renderers[camera] = SceneRenderer(self.scene, camera, **self._render_options)
        worlds = (
            {"object_poses": place.objects, "world_index": place.world_of_view[views]} if place.objects.size else {}
        )
        return self._renderers[camera].render(place.eyes.flatten()[views], **worlds, out=out)

    def _take(self, key: _Key, cameras: Sequence[int], worlds: NDArray[np.int32]) -> _Workplace:
        """Return memory that nobody uses, of an earlier call for the same cameras and worlds, or new."""
        try:
            return self._idle.pop(key)
        except KeyError:
            return self._make_workplace(cameras, worlds)

    def _give_back(self, key: _Key, place: _Workplace) -> None:
        self._idle[key] = place  # the last is the newest
        while len(self._idle) > _MOST_PLACES:
            self._idle.pop(next(iter(self._idle)), None)

    def _make_workplace(self, cameras: Sequence[int], worlds: NDArray[np.int32]) -> _Workplace:
        device, count = self.scene.device, len(worlds)
        world_of_view = np.tile(np.arange(count, dtype=np.int32), len(cameras))
        return _Workplace(
            cameras=wp.array(list(cameras), dtype=wp.int32, device=device),
            worlds=wp.array(worlds, dtype=wp.int32, device=device),
            world_of_view=wp.array(world_of_view, dtype=wp.int32, device=device),
            geoms=wp.array(self.mujoco_scene.movable_geoms, dtype=wp.int32, device=device),
            objects=object_places(self.mujoco_scene, count),
            eyes=wp.empty((len(cameras), count), dtype=wp.transform, device=device),
        )

    def _camera_ids(self, cameras: int | str | Sequence[int | str] | None) -> list[int]:
        if cameras is None:
            cameras = range(self.model.ncam)
        elif isinstance(cameras, str | int | np.integer):
            cameras = [cameras]
        ids = [camera_id(self.model, camera) for camera in as_items(cameras, "cameras", CameraError)]
        if not ids:
            raise CameraError("there must be a camera to render; the model or the list of cameras has none")
        return ids

    def _read_worlds(
        self, poses: PoseSource | Sequence[mujoco.MjData] | ArrayInput, worlds: ArrayLike | None
    ) -> tuple[PoseSource, NDArray[np.int32]]:
        """Read a source of poses, and which of its worlds to render."""
        if isinstance(poses, list | tuple) and len(poses) and all(isinstance(data, mujoco.MjData) for data in poses):
            poses = WorldPoses.of(poses)
        if hasattr(poses, "geom_xpos"):
            source = cast(PoseSource, poses)
            return source, self._chosen_worlds(worlds, world_count(source))
        joints = as_numpy(cast("ArrayInput", poses), name="poses")
        chosen = self._chosen_worlds(worlds, len(np.atleast_1d(joints)))
        source = self.kinematics.from_qpos(joints if worlds is None else joints[chosen])
        return source, np.arange(len(chosen), dtype=np.int32)

    def _chosen_worlds(self, worlds: ArrayLike | None, count: int) -> NDArray[np.int32]:
        """Check which of so many worlds are to be rendered."""
        if self.nworld not in (None, count):
            raise ArrayError(f"poses must be of nworld = {self.nworld} worlds, got {count}")
        return _check_worlds(worlds, count)


def _check_worlds(worlds: ArrayLike | None, count: int) -> NDArray[np.int32]:
    if worlds is None:
        return np.arange(count, dtype=np.int32)
    chosen = as_numpy(worlds, name="worlds")
    if chosen.ndim != 1 or chosen.dtype.kind not in "iu" or not len(chosen):
        raise ArrayError(f"worlds must be one or more indices, got {chosen.dtype} of shape {chosen.shape}")
    bad = np.flatnonzero((chosen < 0) | (chosen >= count))
    if len(bad):
        raise ArrayError(f"worlds must be from 0 to {count - 1}, got {chosen[bad[0]]} at index {bad[0]}")
    return chosen.astype(np.int32)
