# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of several cameras in several worlds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, TypeAlias

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.core.arrays import take_out
from warpvis.core.checks import as_items
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError, CameraError
from warpvis.mujoco._cameras import camera_from_mujoco, camera_with_fovy, viewer_camera, viewer_pose
from warpvis.mujoco._geom_renderer import CoincidingGeoms, GeomRenderer
from warpvis.mujoco._poses import (
    PoseSource,
    camera_transforms,
    movable_ids,
    object_places,
    object_transforms,
    viewer_transforms,
)
from warpvis.mujoco._scene import MujocoScene
from warpvis.rendering import Views
from warpvis.scene import Scene
from warpvis.scene.world_appearances import DeviceAppearances

_MAX_RENDERERS = 64
"""Largest number of cached renderers."""


@dataclass
class BatchViews(Views):
    """Images of C cameras in W worlds, all worlds of the first camera first: ``(C * W, height, width)``."""

    cameras: int = 0
    """Number of cameras."""
    worlds: int = 0
    """Number of worlds."""

    def by_world(self) -> Views:
        """Return views of the same memory, world by world: images of shape ``(W, C, height, width)``, without a copy.

        `numpy()` and DLPack of such an image are strided.
        """

        def by_world(image: wp.array) -> wp.array:
            return image.reshape((self.cameras, self.worlds, *image.shape[1:])).transpose((1, 0, 2, 3))

        return Views(**{name: None if image is None else by_world(image) for name, image in _images(self)})


def batch_views(views: Views, cameras: int, worlds: int) -> BatchViews:
    """Set the numbers of cameras and worlds of views; `BatchViews` are changed in place."""
    if not isinstance(views, Views):
        raise ArrayError(f"out must be warpvis.Views, got {type(views).__name__}")
    if not isinstance(views, BatchViews):
        return BatchViews(**dict(_images(views)), cameras=cameras, worlds=worlds)
    views.cameras, views.worlds = cameras, worlds
    return views


def look_up_objects(views: Views, numbers: NDArray[np.int32], out: wp.array | None) -> wp.array:
    """Return the number of every pixel's object, given for all objects; -1 for empty pixels."""
    from warpvis.kernels.mujoco.arrays import geoms_of_objects

    segmentation = _segmentation(views)
    device = segmentation.device
    out = take_out(out, wp.int32, segmentation.shape, device=device)
    inputs = [segmentation.flatten(), wp.array(numbers, dtype=wp.int32, device=device), out.flatten()]
    launch(geoms_of_objects, out.size, inputs, device)
    return out


def look_up_pairs(views: Views, pairs: NDArray[np.int32], out: wp.array | None) -> wp.array:
    """Return a pair of numbers of every pixel's object, given for all objects; -1 and -1 for empty pixels."""
    from warpvis.kernels.mujoco.arrays import pairs_of_objects

    segmentation = _segmentation(views)
    device = segmentation.device
    out = take_out(out, wp.int32, (*segmentation.shape, 2), device=device)
    inputs = [segmentation.flatten(), wp.array(pairs, dtype=wp.vec2i, device=device), out.reshape((-1, 2))]
    launch(pairs_of_objects, segmentation.size, inputs, device)
    return out


def _segmentation(views: Views) -> wp.array:
    if not isinstance(views, Views) or views.segmentation is None:
        raise ArrayError(
            'views must have segmentation, got none; create the BatchRenderer with outputs=("segmentation", ...)'
        )
    return views.segmentation


def _images(views: Views) -> list[tuple[str, wp.array]]:
    return [(field.name, getattr(views, field.name)) for field in fields(Views)]


CameraChoice: TypeAlias = int | str | mujoco.MjvCamera
"""A camera's name or id, -1 for the default free camera, or a `mujoco.MjvCamera`."""

_FIXED = mujoco.mjtCamera.mjCAMERA_FIXED
_TRACKING = mujoco.mjtCamera.mjCAMERA_TRACKING
NOBODY = -1


class BatchCamera(NamedTuple):
    """One camera of a call: one of the model's cameras, or the pose of a viewer's camera."""

    camera_id: int
    """Id of the model's camera; -1 for a viewer's camera."""
    body: int
    """The body that a viewer's camera tracks; -1 if it tracks no body."""
    pose: tuple[float, ...]
    """``x y z qx qy qz qw`` of a viewer's camera (OpenCV axes), relative to the tracked center of mass."""
    intrinsics: PlanarCamera


def choose_cameras(
    model: mujoco.MjModel, cameras: CameraChoice | Sequence[CameraChoice] | None, width: int, height: int
) -> list[BatchCamera]:
    """Return the requested cameras: all of the model's by default."""
    if cameras is None:
        cameras = range(model.ncam)
    elif isinstance(cameras, str | int | np.integer | mujoco.MjvCamera):
        cameras = [cameras]
    chosen = [_choose(model, camera, width, height) for camera in as_items(cameras, "cameras", CameraError)]
    if not chosen:
        raise CameraError("cameras must contain at least one camera, got none in the model or the list")
    return chosen


def _choose(model: mujoco.MjModel, camera: CameraChoice, width: int, height: int) -> BatchCamera:
    viewer = viewer_camera(model, camera)
    intrinsics = camera_from_mujoco(model, viewer, width, height)
    if viewer.type == _FIXED:
        return BatchCamera(int(viewer.fixedcamid), NOBODY, (0.0,) * 7, intrinsics)
    # Data in which all centers of mass are at the origin.
    pose = viewer_pose(mujoco.MjData(model), viewer)
    body = int(viewer.trackbodyid) if viewer.type == _TRACKING else NOBODY
    return BatchCamera(-1, body, tuple(pose.tolist()), intrinsics)


def views_by_intrinsics(
    model: mujoco.MjModel, cameras: Sequence[BatchCamera], fovy: NDArray[np.float64] | None, worlds: NDArray[np.int32]
) -> dict[PlanarCamera, NDArray[np.int64]]:
    """Group the views of a call by their intrinsics, each group in ascending order.

    Vertical fields of view [degrees] are of shape ``(1 or W, ncam)``; None means the model's. The first camera's views
    of all worlds come first, then the second camera's.
    """
    count, groups = len(worlds), dict[PlanarCamera, list[NDArray[np.int64]]]()
    for number, camera in enumerate(cameras):
        views = np.arange(number * count, (number + 1) * count)
        if fovy is None or camera.camera_id < 0 or model.cam_sensorsize[camera.camera_id].all():
            groups.setdefault(camera.intrinsics, []).append(views)
            continue
        angles, which = np.unique(fovy[worlds % len(fovy), camera.camera_id], return_inverse=True)
        for k, angle in enumerate(angles.tolist()):
            seen = camera_with_fovy(model, camera.camera_id, angle, camera.intrinsics)
            groups.setdefault(seen, []).append(views[which == k])
    return {intrinsics: np.concatenate(parts) for intrinsics, parts in groups.items()}


@dataclass
class Workplace:
    """Memory for one choice of cameras and worlds: with it, a call on a GPU allocates and copies nothing."""

    chosen: Sequence[BatchCamera]
    cameras: tuple[wp.array, wp.array, wp.array]
    """Ids, tracked bodies and poses."""
    worlds: wp.array
    world_of_view: wp.array
    geoms: tuple[wp.array, wp.array]
    """Ids of the movable geoms and sites."""
    objects: wp.array
    eyes: wp.array
    hidden: wp.array | None = None
    """Objects that are hidden in each view, ``(views, objects)`` uint8, if that differs between worlds."""
    sizes: wp.array | None = None
    """Sizes of all movable objects in every world, ``(worlds, M)`` vec4, if they differ from the scene."""
    looks: DeviceAppearances | None = None
    """Appearances of the worlds, if they differ from the scene."""
    own_sizes: wp.array | None = None
    own_hidden: wp.array | None = None
    """Memory for `sizes` and `hidden` if only tendons change them."""

    @classmethod
    def of(cls, mujoco_scene: MujocoScene, cameras: Sequence[BatchCamera], worlds: NDArray[np.int32]) -> Workplace:
        """Allocate it on the scene's device."""
        device, count = mujoco_scene.scene.device, len(worlds)

        def numbers(values: ArrayLike) -> wp.array:
            return wp.array(values, dtype=wp.int32, device=device)

        poses = np.array([camera.pose for camera in cameras], dtype=np.float32)
        eyes = wp.array(poses, dtype=wp.transform, shape=(len(cameras),), device=device)
        return cls(
            cameras,
            (numbers([camera.camera_id for camera in cameras]), numbers([camera.body for camera in cameras]), eyes),
            numbers(worlds),
            numbers(np.tile(np.arange(count, dtype=np.int32), len(cameras))),
            movable_ids(mujoco_scene),
            object_places(mujoco_scene, count),
            wp.empty((len(cameras), count), dtype=wp.transform, device=device),
        )

    def write_poses(self, poses: PoseSource, mujoco_scene: MujocoScene, model: mujoco.MjModel) -> None:
        """Write the poses of movable objects and cameras."""
        worlds, eyes = self.worlds, self.eyes
        if self.objects.size:
            object_transforms(poses, mujoco_scene, worlds, geoms=self.geoms, out=self.objects)
        if any(camera.camera_id >= 0 for camera in self.chosen):
            camera_transforms(poses, model, self.cameras[0], worlds, device=eyes.device, out=eyes)
        if any(camera.camera_id < 0 for camera in self.chosen):
            tracking = any(camera.body != NOBODY for camera in self.chosen)
            viewer_transforms(poses, model, self.cameras, worlds, tracking=tracking, out=eyes)


def rows_of(views: NDArray[np.int64], device: wp.Device) -> slice | wp.array:
    """Return ascending views as a slice if they are consecutive, else as indices on a device."""
    if len(views) > views[-1] - views[0]:
        return slice(int(views[0]), int(views[-1]) + 1)
    return wp.array(views, dtype=wp.int32, device=device)


def select_rows(array: wp.array, rows: slice | wp.array) -> wp.array:
    """Return rows of an array: a view for a slice, a copy for indices."""
    return array[rows] if isinstance(rows, slice) else array[rows].contiguous()


class ViewCaster:
    """Renders views of a workplace; renderers are cached by the intrinsics of their camera."""

    def __init__(self, scene: Scene, coinciding: CoincidingGeoms, options: Mapping[str, Any]) -> None:
        self._scene, self._coinciding, self._options = scene, coinciding, options
        self._renderers: dict[PlanarCamera, GeomRenderer] = {}

    def cast(
        self,
        camera: PlanarCamera,
        place: Workplace,
        views: NDArray[np.int64],
        drawn: NDArray[np.int64] | None,
        out: Views,
    ) -> None:
        """Render views through cameras with equal intrinsics."""
        if camera not in self._renderers:
            while len(self._renderers) >= _MAX_RENDERERS:
                self._renderers.pop(next(iter(self._renderers)), None)
            self._renderers[camera] = GeomRenderer(self._scene, camera, self._coinciding, **self._options)
        renderer, eyes = self._renderers[camera], place.eyes.flatten()
        rows, options = rows_of(views, self._scene.device), dict[str, Any]()
        if drawn is not None:
            options["view_index"], options["frame"] = drawn[views].T
        if place.looks is not None:
            options |= {"looks": place.looks, "world_index": select_rows(place.world_of_view, rows)}
        if place.objects.size:
            options |= {"object_poses": place.objects, "world_index": select_rows(place.world_of_view, rows)}
            options["object_sizes"] = place.sizes
        if place.hidden is not None:
            options["exclude"] = select_rows(place.hidden, rows)
        images = {name: getattr(out, name) for name in self._options["outputs"]}
        if isinstance(rows, slice):
            part = Views(**{name: image[rows] for name, image in images.items()})
            renderer.render_sizes(eyes[rows], **options, out=part)
            return
        part = renderer.render_sizes(select_rows(eyes, rows), **options)
        for name, image in images.items():
            wp.copy(image[rows], getattr(part, name))

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderers": {}}
