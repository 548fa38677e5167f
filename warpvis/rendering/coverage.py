# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Areas of objects in images with antialiased boundaries, and their gradients, from the images of a finished render."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.base import AnyCamera
from warpvis.core.checks import as_items
from warpvis.core.kernel_cache import launch
from warpvis.core.threads import check_threads, launch_images
from warpvis.errors import CameraError, SceneError
from warpvis.rendering.casters.base import ImagesByName, as_image, images_struct
from warpvis.rendering.gradients import Zeros, ray_table
from warpvis.scene import Scene
from warpvis.scene.worlds import pose_columns

if TYPE_CHECKING:
    from warpvis.kernels.casting.images import Images
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.gradients.depth_gradients import RayTable
    from warpvis.kernels.gradients.silhouette_edges import Surfaces

COVERAGE_IMAGES = ("segmentation", "faces")
"""Images of the render that areas are computed from."""

_STRIP_ROWS = 16


class Coverage:
    """Compute areas of objects in the images of one camera in one scene of meshes."""

    def __init__(
        self, scene: Scene, camera: AnyCamera, *, threads: int | None = None, zeros: Zeros | None = None
    ) -> None:
        """Set up for a scene and a camera with an image; `threads` and `zeros` as for `DepthGradients`."""
        self._scene, self._camera, self._threads = scene, camera, check_threads(threads)
        self._allocate = wp.zeros if zeros is None else zeros
        self._surfaces: tuple[object, Surfaces, list[int]] | None = None
        self._targets: tuple[object, dict[tuple[str, ...], wp.array]] = None, {}

    def areas(
        self, names: tuple[str, ...], camera_to_world: wp.array, worlds: Worlds, images: ImagesByName, out: wp.array
    ) -> None:
        """Write the areas of objects [px] in each view.

        Args:
            names: The objects, whose areas are added.
            camera_to_world: Poses of the render, ``(V,)`` transform, in the camera's axes.
            worlds: Worlds of the render.
            images: Its images ``segmentation`` and ``faces``.
            out: The areas, ``(V,)`` float32.
        """
        from warpvis.kernels.gradients.coverage import sum_area_strips, sum_coverage

        shown = _images(images)
        strips, span = self._strips(shown)
        of_strips = self._zeros((len(camera_to_world), strips), wp.float64)
        surfaces, _ = self._current_surfaces({})
        scene = [surfaces, worlds, self._flags(names)]
        launch_images(
            sum_coverage,
            (len(camera_to_world), strips, self._camera.width),
            lambda window: [*scene, self._table, camera_to_world, window, shown, _STRIP_ROWS, span, of_strips],
            device=self._scene.device,
            threads=self._threads,
            span=span,
            min_pixels=1,
        )
        launch(sum_area_strips, out.shape, [of_strips, out], self._scene.device)

    def masks(
        self, names: tuple[str, ...], camera_to_world: wp.array, worlds: Worlds, images: ImagesByName, out: wp.array
    ) -> None:
        """Write the share of each pixel that objects cover, ``(V, H, W)`` float32; arguments as for `areas`."""
        from warpvis.kernels.gradients.coverage import write_masks

        surfaces, _ = self._current_surfaces({})
        scene = [surfaces, worlds, self._flags(names)]
        launch_images(
            write_masks,
            out.shape,
            lambda window: [*scene, self._table, camera_to_world, window, _images(images), out],
            device=self._scene.device,
            threads=self._threads,
        )

    def gradients(
        self,
        names: tuple[str, ...],
        camera_to_world: wp.array,
        worlds: Worlds,
        images: ImagesByName,
        weights: wp.array,
        vertices: Mapping[str, wp.array],
    ) -> tuple[wp.array, dict[str, wp.array]]:
        """Return gradients of a weighted sum of masks.

        Args:
            names: As for `areas`.
            camera_to_world: As for `areas`.
            worlds: As for `areas`.
            images: As for `areas`.
            weights: Weights of the pixels, ``(V, H, W)`` float64, or of the views, ``(V, 1, 1)``.
            vertices: Vertices of movable objects in the render [m], ``(n,)`` vec3, by name.

        Returns:
            Gradients with respect to poses, as `DepthGradients.poses` returns them, and with respect to the given
            vertices, ``(n,)`` vec3d by name, in the objects' frames.
        """
        from warpvis.kernels.gradients.coverage import sum_coverage_gradients
        from warpvis.kernels.gradients.depth_gradients import mat34d, sum_pose_strips

        device, shown = self._scene.device, _images(images)
        strips, span = self._strips(shown)
        columns = 1 + len(self._scene.movable)
        sums = self._zeros((len(camera_to_world), strips, columns), mat34d)
        surfaces, first_vertex = self._current_surfaces(vertices)
        of_all = self._zeros((len(surfaces.vertices),), wp.vec3d) if vertices else None
        scene = [surfaces, worlds, self._flags(names)]
        inputs = [shown, weights, _STRIP_ROWS, span, sums, of_all]
        launch_images(
            sum_coverage_gradients,
            (len(camera_to_world), strips, self._camera.width),
            lambda window: [*scene, self._table, camera_to_world, window, *inputs],
            device=device,
            threads=1 if vertices else self._threads,  # several would add to the same vertices at once
            span=span,
            min_pixels=1,
        )
        result = self._zeros((len(camera_to_world), columns), wp.transform)
        launch(sum_pose_strips, result.shape, [worlds, camera_to_world, sums, result], device)
        found = {}
        for name, array in vertices.items():
            first = first_vertex[self._scene.index(name)]
            found[name] = cast("wp.array", of_all)[first : first + len(array)]
        return result, found

    def _strips(self, images: Images) -> tuple[int, int]:
        """Return the number of strips of an image, and the width of the part of a thread."""
        return -(-images.segmentation.shape[1] // _STRIP_ROWS), self._camera.width if self._scene.device.is_cpu else 1

    def _zeros(self, shape: tuple[int, ...], dtype: Any) -> wp.array:
        return self._allocate(shape, dtype, self._scene.device)

    @cached_property
    def _table(self) -> RayTable:
        return ray_table(self._camera, self._scene.device)

    def _flags(self, names: tuple[str, ...]) -> wp.array:
        """Return which objects are chosen, ``(objects,)`` uint8."""
        objects = self._scene.objects
        if self._targets[0] is not objects:
            self._targets = objects, {}
        cached = self._targets[1]
        if names not in cached:
            flags = np.zeros(len(objects), dtype=np.uint8)
            flags[[self._scene.index(name) for name in names]] = 1
            cached[names] = wp.array(flags, dtype=wp.uint8, device=self._scene.device)
        return cached[names]

    def _current_surfaces(self, vertices: Mapping[str, wp.array]) -> tuple[Surfaces, list[int]]:
        """Return the triangles of the scene with the newest vertices of deforming objects, or given ones.

        Tables are made again when objects are added or exchanged.
        """
        objects = self._scene.objects
        if self._surfaces is None or self._surfaces[0] is not objects:
            self._surfaces = objects, *_make_surfaces(self._scene)
        _, surfaces, first_vertex = self._surfaces
        for index in self._scene.movable:
            item = objects[index]
            newest = vertices.get(item.name, item.points)
            if newest is not None:
                wp.copy(surfaces.vertices, newest, dest_offset=first_vertex[index], count=len(newest))
        return surfaces, first_vertex


def target_indices(scene: Scene, camera: AnyCamera, names: str | Sequence[str]) -> tuple[int, ...]:
    """Return the indices of the objects whose areas are added.

    Raises:
        CameraError: If the camera is a list of rays, which has no boundaries.
        SceneError: If there is none, or the scene has no object of a name.
    """
    indices = tuple(scene.index(name) for name in dict.fromkeys(as_items(names, "names", SceneError)))
    if not indices:
        raise SceneError("names must contain at least one object, got none")
    if len(camera.shape) == 1:
        raise CameraError("camera must have pixels with neighbors for areas of objects, got a list of rays")
    return indices


def check_meshes(scene: Scene) -> None:
    """Raise a `SceneError` if a scene contains round solids, which have no edges."""
    for item in scene.objects:
        if item.solid is not None:
            raise SceneError(f"scene must contain only meshes for areas of objects, got the round solid {item.name!r}")


def _images(images: ImagesByName) -> Images:
    return images_struct({name: as_image(images[name]) for name in COVERAGE_IMAGES})


def _make_surfaces(scene: Scene) -> tuple[Surfaces, list[int]]:
    """Return the triangles of all objects, and the first vertex of each object."""
    from warpvis.kernels.gradients.silhouette_edges import Surfaces

    vertices: list[NDArray[np.float32]] = []
    faces: list[NDArray[np.int32]] = []
    neighbors: list[NDArray[np.int32]] = []
    first_vertex, first_face = [0], [0]
    known: dict[int, NDArray[np.int32]] = {}
    check_meshes(scene)
    for item in scene.objects:
        corners = item.frame_vertices
        if id(item.mesh) not in known:
            known[id(item.mesh)] = find_neighbors(corners, item.faces)
        across = known[id(item.mesh)]
        vertices.append(corners)
        faces.append(item.faces + first_vertex[-1])
        neighbors.append(np.where(across < 0, -1, across + first_face[-1]).astype(np.int32))
        first_vertex.append(first_vertex[-1] + len(corners))
        first_face.append(first_face[-1] + len(item.faces))
    surfaces = Surfaces()
    surfaces.vertices = wp.array(np.concatenate(vertices), dtype=wp.vec3, device=scene.device)
    surfaces.faces = wp.array(np.concatenate(faces), dtype=wp.int32, device=scene.device)
    surfaces.neighbors = wp.array(np.concatenate(neighbors), dtype=wp.int32, device=scene.device)
    surfaces.first_face = wp.array(first_face, dtype=wp.int32, device=scene.device)
    surfaces.columns = wp.array(pose_columns(scene), dtype=wp.int32, device=scene.device)
    return surfaces, first_vertex


def find_neighbors(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the triangle at each edge of a triangle, from corner k to the next, shape ``(m, 3)``.

    Vertices at the same place are one. It is -1 where no triangle or several share the edge.
    """
    _, welded = np.unique(np.asarray(vertices), axis=0, return_inverse=True)
    ends = welded.reshape(-1)[faces[:, [[0, 1], [1, 2], [2, 0]]]].reshape(-1, 2).astype(np.int64)
    keys = ends.min(axis=1) * len(vertices) + ends.max(axis=1)
    order = np.argsort(keys, kind="stable")
    _, first, counts = np.unique(keys[order], return_index=True, return_counts=True)
    pairs = first[counts == 2]
    result = np.full(len(keys), -1, dtype=np.int32)
    result[order[pairs]], result[order[pairs + 1]] = order[pairs + 1] // 3, order[pairs] // 3
    return result.reshape(-1, 3)


def other_objects(scene: Scene, names: Sequence[str]) -> list[str]:
    """Return the names of all objects but some."""
    return [item.name for item in scene.objects if item.name not in names]
