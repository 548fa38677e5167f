# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering of geoms as in MuJoCo: where surfaces coincide, the later geom is shown."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.core.poses import Convention, poses_to_matrices
from warpvis.core.threads import launch_images
from warpvis.core.types import PoseLike
from warpvis.kernels.constants import SOLID_WORDS
from warpvis.mujoco._coinciding import Pairs, find_pairs
from warpvis.mujoco._model_fields import shape_bodies
from warpvis.rendering import Renderer, Views
from warpvis.rendering.casters import Caster, CastOptions, ImagesByName, Scratch, ViewBatch
from warpvis.rendering.casters.packed_rows import PackedRows
from warpvis.scene import Scene, SceneObject
from warpvis.scene.mirror_planes import Mirror
from warpvis.scene.world_appearances import DeviceAppearances
from warpvis.scene.worlds import parse_worlds, pose_columns

if TYPE_CHECKING:
    from warpvis.kernels.mujoco.coinciding import Coinciding

_OF_OBJECTS = {"labels", "segmentation", "faces"}
_UPWARDS = 0.999  # cosine of the angle between the normal of the upper side of a box and its z axis
_BOX_MARGIN = 2e-5  # relative: boxes are computed from poses and corners in single precision


class CoincidingGeoms:
    """Geoms of a scene that coincide with earlier ones; the search runs on the first request after a scene change."""

    def __init__(
        self, model: mujoco.MjModel, scene: Scene, geoms: ArrayLike = (), *, resizable: ArrayLike = ()
    ) -> None:
        """Store the geoms and sites of the scene's first objects, and the objects whose sizes may differ."""
        self._model, self._scene = model, scene
        self._resizable = np.array(resizable, dtype=np.int64)
        self._geoms = np.array(geoms, dtype=np.int64)
        self._objects: tuple[SceneObject, ...] = ()
        self._found: tuple[Coinciding | None, Sequence[wp.Mesh]] = (None, ())

    def follow(self, geoms: ArrayLike) -> None:
        """Set the geoms of the scene's first objects, or note that their shapes have changed."""
        self._geoms, self._objects = np.array(geoms, dtype=np.int64), ()

    def find(self) -> Coinciding | None:
        """Return the coinciding geoms as a kernel struct; None if nothing coincides."""
        objects = self._scene.objects
        if len(objects) != len(self._objects) or not all(map(operator.is_, objects, self._objects)):
            pieces = np.asarray(self._model.body_weldid)[shape_bodies(self._model)[self._geoms]]
            pairs = find_pairs(objects[: len(self._geoms)], pieces, resizable=self._resizable)
            self._found = _on_device(objects, pairs, self._scene) if len(pairs.later) else (None, ())
            self._objects = objects
        return self._found[0]

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_objects": (), "_found": (None, ())}


def _on_device(objects: tuple[SceneObject, ...], pairs: Pairs, scene: Scene) -> tuple[Coinciding, Sequence[wp.Mesh]]:
    """Return pairs of objects as a kernel struct, and the meshes that it refers to."""
    from warpvis.kernels.mujoco.coinciding import Coinciding

    device, columns, boxes = scene.device, pose_columns(scene), _boxes_in_frames(objects, pairs)
    meshes = {index: _mesh(objects[index], faces, device) for index, faces in pairs.faces.items()}
    surfaces = np.array([meshes[index].id if index in meshes else 0 for index in range(len(objects))], dtype=np.uint64)
    kinds, sizes = np.zeros(len(objects), dtype=np.int32), np.ones((len(objects), SOLID_WORDS), dtype=np.float32)
    for index, item in enumerate(objects):
        if item.solid is not None:
            kinds[index], sizes[index] = item.solid.kind, [*item.solid.radii, item.solid.half]
    numbers = [pairs.faces[index] for index in sorted(pairs.faces)]
    counts = np.array([len(pairs.faces.get(index, ())) for index in range(len(objects))], dtype=np.int64)
    arrays = {
        "first_pair": (np.searchsorted(pairs.earlier, np.arange(len(objects) + 1)), wp.int32),
        "later": (pairs.later, wp.int32),
        "mode": (_ways(objects, pairs, columns), wp.int32),
        "low": (boxes[:, 0].copy(), wp.vec3),
        "high": (boxes[:, 1].copy(), wp.vec3),
        "surface": (surfaces, wp.uint64),
        "first_face": (np.cumsum(counts) - counts, wp.int32),
        "face": (np.concatenate([np.zeros(0, dtype=np.int64), *numbers]), wp.int32),
        "column": (columns, wp.int32),
        "solid": (kinds, wp.int32),
        "size": (sizes, wp.vec4),
    }
    struct = Coinciding()
    for name, (values, dtype) in arrays.items():
        setattr(struct, name, wp.array(values, dtype=dtype, device=device))
    struct.label = scene.object_labels()
    return struct, list(meshes.values())


def _ways(objects: Sequence[SceneObject], pairs: Pairs, columns: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return how a kernel tests for the later object of each pair."""
    from warpvis.kernels.mujoco.coinciding import ALWAYS, ON_MESH, ON_SOLID, WHERE_TOGETHER

    is_solid = np.array([objects[index].solid is not None for index in pairs.later], dtype=bool)
    ways = np.where(is_solid, int(ON_SOLID), int(ON_MESH))
    together = columns[pairs.earlier] == columns[pairs.later]
    return np.where(pairs.same, np.where(together, int(ALWAYS), int(WHERE_TOGETHER)), ways).astype(np.int32)


def _boxes_in_frames(objects: Sequence[SceneObject], pairs: Pairs) -> NDArray[np.float32]:
    """Return boxes of coinciding regions in the frames of the later objects: corners ``(pairs, 2, 3)``."""
    boxes = np.empty((len(pairs.later), 2, 3), dtype=np.float32)
    for row, index, box in zip(boxes, pairs.later.tolist(), pairs.boxes, strict=True):
        if np.isinf(box).any():
            row[:] = box
            continue
        item = objects[index]
        pose = item.pose if item.parent is None else objects[item.parent].pose
        corners = np.array(list(product(*box.T)))
        margin = _BOX_MARGIN * np.abs(corners).max()
        if pose is not None:
            frame = poses_to_matrices(pose)
            corners = (corners - frame[:3, 3]) @ frame[:3, :3]
        row[:] = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    return boxes


def _mesh(item: SceneObject, faces: NDArray[np.int64], device: wp.Device) -> wp.Mesh:
    """Make a mesh of some of an object's triangles, in its frame."""
    indices = item.faces[faces].astype(np.int32).ravel()
    return wp.Mesh(
        points=wp.array(np.ascontiguousarray(item.frame_vertices), dtype=wp.vec3, device=device),
        indices=wp.array(indices, dtype=wp.int32, device=device),
    )


class GeomRenderer(Renderer):
    """A `warpvis.Renderer` of a model's scene that shows the later geom where surfaces coincide.

    Segmentation, labels, faces and colors are those of the later geom; depth, points and normals do not change.
    """

    def render_sizes(
        self,
        camera_to_world: wp.array,
        *,
        object_poses: wp.array | None = None,
        object_sizes: wp.array | None = None,
        world_index: wp.array | None = None,
        exclude: wp.array | None = None,
        frame: np.ndarray | None = None,
        view_index: np.ndarray | None = None,
        looks: DeviceAppearances | None = None,
        out: Views | None = None,
    ) -> Views:
        """Render as `render` does, with sizes as in `warpvis.kernels.casting.worlds.Worlds`, and parsed appearances."""
        poses = self._caster.parse_poses(camera_to_world, "opencv")
        least = 1 if looks is None else looks.worlds
        worlds = parse_worlds(self.scene, len(poses), object_poses, world_index, exclude, least=least)
        if object_sizes is not None:
            worlds.object_sizes = object_sizes
        views = ViewBatch(poses, worlds, appearances=looks)
        self._number(views, frame, view_index)
        return self._render(views, out)

    def __init__(self, scene: Scene, camera: PlanarCamera, coinciding: CoincidingGeoms, **options: Any) -> None:
        self._coinciding = coinciding
        super().__init__(scene, camera, **options)

    def _choose_mirrors(self, planes: Sequence[Mirror]) -> Sequence[Mirror]:
        """Return the first plane, or the first upper side of a box, as MuJoCo does (`mjr_render` in render_gl3.c)."""
        for plane in planes:
            item = self.scene.objects[plane.owner]
            up = np.array([0.0, 0.0, 1.0]) if item.origin is None else poses_to_matrices(item.origin)[:3, 2]
            if item.parent is not None:
                frame = self.scene.objects[item.parent].pose
                assert frame is not None  # it is movable
                up = up @ poses_to_matrices(frame)[:3, :3]
            if np.dot(plane.normal, up) > _UPWARDS:
                return [plane]
        return []

    def _make_caster(self, camera: AnyCamera) -> Caster:
        return _LaterWins(super()._make_caster(camera), self.scene, camera, self._coinciding, self._options)


class _LaterWins:
    """A caster, followed by a correction pass for pixels where surfaces coincide."""

    def __init__(
        self, caster: Caster, scene: Scene, camera: AnyCamera, coinciding: CoincidingGeoms, options: CastOptions
    ) -> None:
        self._caster, self._scene, self._camera, self._coinciding = caster, scene, camera, coinciding
        self._options = options

    def parse_poses(self, poses: PoseLike, convention: Convention) -> Any:
        """Check poses and return them in the caster's format."""
        return self._caster.parse_poses(poses, convention)

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write images of all views; coinciding objects are not corrected at image points, which sensors read."""
        needs_objects = views.pixels is None and not _OF_OBJECTS.isdisjoint(images)
        coinciding = self._coinciding.find() if needs_objects else None
        if coinciding is None:
            self._caster.cast(views, images)
            return
        device, shape = self._scene.device, next(iter(images.values())).shape

        def cast(scratch: Scratch) -> None:
            lacking = {"depth": wp.float32, "segmentation": wp.int32}.items()
            needed = {name: scratch.array(name, shape, dtype) for name, dtype in lacking if name not in images}
            self._caster.cast(views, {**images, **needed})
            self._correct(coinciding, views, {**images, **needed}, scratch)

        if device.is_cuda and device.is_capturing:  # a captured graph must not share its memory
            cast(Scratch(device))
        else:
            self._options.pool.use((self, shape, device.is_cuda and device.stream), lambda: Scratch(device), cast)

    def _correct(self, coinciding: Coinciding, views: ViewBatch, images: ImagesByName, scratch: Scratch) -> None:
        poses, camera = views.poses_on(self._scene.device), scratch.item("camera", self._camera.device_struct)
        shape, worlds, depth = images["depth"].shape, views.worlds, images["depth"]
        cull, written = self._options.cull_backfaces, [images.get(name) for name in ("segmentation", "labels", "faces")]
        if self._camera.ray_model == "parallel":
            from warpvis.kernels.casting.orthographic import show_later_from_plane

            # On the CPU a thread processes a row, because starting a thread takes longer than most pixels.
            span = shape[2] if self._scene.device.is_cpu else 1
            launch_images(
                show_later_from_plane,
                shape,
                lambda window: [coinciding, camera, poses, window, worlds, depth, cull, span, *written],
                device=self._scene.device,
                threads=self._options.threads,
                span=span,
            )
        elif self._scene.device.is_cpu:
            from warpvis.kernels.mujoco.coinciding_rows import LaterCall, LaterImages, show_later_rows

            packed = scratch.item(
                "later rows", lambda: PackedRows(show_later_rows, LaterCall, LaterImages, self._options.threads)
            )
            packed.run(
                shape,
                dict(zip(("segmentation", "labels", "faces"), written, strict=True)),
                coinciding=coinciding,
                camera=camera,
                camera_to_world=poses,
                worlds=worlds,
                depth=depth,
                cull_backfaces=int(cull),
            )
        else:
            from warpvis.kernels.mujoco.coinciding import show_later

            launch_images(
                show_later,
                shape,
                lambda _: [coinciding, camera, poses, worlds, depth, cull, *written],
                device=self._scene.device,
            )
