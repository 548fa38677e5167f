# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Gradients of images with respect to poses and rays, from the images of a finished render."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import warp as wp

from warpvis.cameras import origin_jacobian, ray_jacobian
from warpvis.cameras.base import AnyCamera
from warpvis.core.kernel_cache import launch
from warpvis.core.threads import check_threads, launch_images
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.rendering.casters.base import ImagesByName, as_image, images_struct
from warpvis.rendering.casters.rays import rays_on_device
from warpvis.scene import Scene
from warpvis.scene.worlds import pose_columns

if TYPE_CHECKING:
    from warpvis.kernels.casting.images import Images
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.gradients.depth_gradients import ImageGradients, RayTable

NEEDED_IMAGES = ("depth", "normals", "segmentation")
"""Images of the render that gradients are computed from."""

_STRIP_ROWS = 16
"""Rows of an image that are added by one CPU thread, or by a row of CUDA threads."""

_MAX_SUMS = 2**21
"""Largest number of matrices of strips, 96 bytes each; with more, strips are whole images."""

_MIN_PIXELS = 256
"""Smallest part of a launch for a CPU thread, in columns of strips."""


Zeros = Callable[[tuple[int, ...], Any, wp.Device], wp.array]
"""Allocates an array of a shape and a Warp type on a device, filled with zeros."""


class RayGradients(NamedTuple):
    """Gradients with respect to each pixel's ray, in the camera frame."""

    rays: wp.array
    """With respect to the direction of depth 1, ``(V, H, W)`` vec3."""
    origins: wp.array | None
    """With respect to the origin [1/m], ``(V, H, W)`` vec3; None if the camera has no origins."""


class DepthGradients:
    """Compute gradients of depth, points and normals of one camera in one scene.

    Silhouettes do not contribute: gradients are those of the seen surfaces. Nothing is cast again.
    """

    def __init__(
        self, scene: Scene, camera: AnyCamera, *, threads: int | None = None, zeros: Zeros | None = None
    ) -> None:
        """Set up for a scene and a camera.

        Args:
            scene: The scene.
            camera: The camera.
            threads: As for `Renderer`.
            zeros: Allocates arrays of a shape and a Warp type, filled with zeros, on a device. By default, Warp does.
        """
        self._scene, self._camera = scene, camera
        self._allocate = wp.zeros if zeros is None else zeros
        self._threads = check_threads(threads)
        self._cached: dict[str | None, tuple[object, wp.array]] = {}

    def poses(
        self, camera_to_world: wp.array, worlds: Worlds, images: ImagesByName, gradients: ImagesByName
    ) -> wp.array:
        """Return gradients with respect to the rows ``x y z qx qy qz qw`` of poses.

        Args:
            camera_to_world: Poses of the render, ``(V,)`` transform, in the camera's axes.
            worlds: Worlds of the render.
            images: Its images: ``depth``, ``normals`` and, if objects are movable, ``segmentation``.
            gradients: Gradients of a loss with respect to ``depth``, ``points`` and ``normals``; others are zero.

        Returns:
            Gradients, ``(V, 1 + M)`` transform: of the camera's pose, and of the poses of the M movable objects in the
            world of the view. Views of one world need to be added.
        """
        from warpvis.kernels.gradients.depth_gradients import mat34d, sum_moments, sum_pose_strips

        self.check_normals(gradients)
        self._check_images(images)
        views, height, width = as_image(images["depth"]).shape
        columns = 1 + len(self._scene.movable)
        strip_rows = _STRIP_ROWS
        if views * -(-height // strip_rows) * columns > _MAX_SUMS:
            strip_rows = height
        strips, span = -(-height // strip_rows), width if self._scene.device.is_cpu else 1
        sums = self._zeros((views, strips, columns), mat34d)
        inputs = [_images(images), _gradients(gradients), strip_rows, span, sums]
        launch_images(
            sum_moments,
            (views, strips, width),
            lambda window: [worlds, self._columns, self._table, camera_to_world, window, *inputs],
            device=self._scene.device,
            threads=self._threads,
            span=span,
            min_pixels=_MIN_PIXELS,
        )
        result = self._zeros((views, columns), wp.transform)
        launch(sum_pose_strips, result.shape, [worlds, camera_to_world, sums, result], self._scene.device)
        return result

    def rays(self, camera_to_world: wp.array, images: ImagesByName, gradients: ImagesByName) -> RayGradients:
        """Return gradients with respect to the rays of pixels; arguments as for `poses`."""
        from warpvis.kernels.gradients.depth_gradients import write_ray_gradients

        self.check_normals(gradients)
        self._check_images(images, ("depth", "normals"))
        shape = as_image(images["depth"]).shape
        result = RayGradients(
            self._zeros(shape, wp.vec3),
            None if self._table.origins is None else self._zeros(shape, wp.vec3),
        )
        inputs = [_images(images), _gradients(gradients), *result]
        launch_images(
            write_ray_gradients,
            shape,
            lambda window: [self._table, camera_to_world, window, *inputs],
            device=self._scene.device,
            threads=self._threads,
        )
        return result

    def parameters(self, camera_to_world: wp.array, images: ImagesByName, gradients: ImagesByName) -> wp.array:
        """Return gradients with respect to `warpvis.cameras.parameter_values`, ``(P,)`` float64.

        The arguments are those of `poses`.
        """
        from warpvis.kernels.gradients.parameter_gradients import sum_parameter_gradients, sum_rows

        rays, origins = self.rays(camera_to_world, images, gradients)
        of_rays, of_origins = self._jacobians
        rows = self._zeros(of_rays.shape[:2], wp.float64)
        launch(sum_parameter_gradients, rows.shape, [rays, origins, of_rays, of_origins, rows], self._scene.device)
        result = self._zeros((len(of_rays),), wp.float64)
        launch(sum_rows, result.shape, [rows, result], self._scene.device)
        return result

    @cached_property
    def _jacobians(self) -> tuple[wp.array, wp.array | None]:
        """Return the derivatives of rays and origins on the scene's device, ``[parameter, y, x]``."""
        shape, arrays = (self._camera.height, self._camera.width), []
        for jacobian in (ray_jacobian(self._camera), origin_jacobian(self._camera)):
            rows = None if jacobian is None else np.moveaxis(jacobian.reshape(*shape, 3, -1), -1, 0)
            arrays.append(None if rows is None else wp.array(rows, dtype=wp.vec3d, device=self._scene.device))
        return arrays[0], arrays[1]

    def vertices(
        self,
        name: str,
        vertices: wp.array,
        camera_to_world: wp.array,
        worlds: Worlds,
        images: ImagesByName,
        gradients: ImagesByName,
    ) -> wp.array:
        """Return gradients with respect to the vertices of a movable object, ``(n,)`` vec3d, in the object's frame.

        Args:
            name: The object.
            vertices: Its vertices in the render [m], ``(n,)`` vec3.
            camera_to_world: As for `poses`.
            worlds: As for `poses`.
            images: As for `poses`, and ``faces``.
            gradients: As for `poses`.
        """
        from warpvis.kernels.gradients.vertex_gradients import DeformingObject, sum_vertex_gradients

        self.check_normals(gradients)
        self._check_images(images, (*NEEDED_IMAGES, "faces"))
        index, device = self._scene.index(name), self._scene.device
        deforming = DeformingObject()
        deforming.index, deforming.column = index, self._scene.movable.index(index)
        deforming.vertices = vertices
        faces = self._scene.objects[index].faces
        deforming.faces = self._on_device(name, faces, lambda: wp.array(faces, dtype=wp.int32, device=device))
        result = self._zeros((len(vertices),), wp.vec3d)
        inputs = [_images(images), _gradients(gradients), result]
        launch_images(
            sum_vertex_gradients,
            as_image(images["depth"]).shape,
            lambda window: [worlds, deforming, self._table, camera_to_world, window, *inputs],
            device=device,
            threads=1,  # several would add to the same vertices at once
        )
        return result

    def _zeros(self, shape: tuple[int, ...], dtype: Any) -> wp.array:
        return self._allocate(shape, dtype, self._scene.device)

    def check_normals(self, names: Iterable[str]) -> None:
        """Check that normals have no gradients if those of a movable object depend on the seen point.

        Args:
            names: Images with gradients.

        Raises:
            SceneError: If normals are among them, and a movable object is a round solid.
        """
        if "normals" not in names:
            return
        for index in self._scene.movable:
            item = self._scene.objects[index]
            if item.solid is not None:
                raise SceneError(
                    f"normals must be left out of the loss (in JAX: of outputs) if a movable object is a round solid, "
                    f"got {item.name!r}. Meshes have gradients of normals"
                )

    def silhouettes(self, camera_to_world: wp.array, images: ImagesByName) -> wp.array:
        """Return the mask of pixels next to silhouettes, ``(V, H, W)`` uint8.

        Args:
            camera_to_world: As for `poses`.
            images: Images of the render: ``depth``, ``normals`` and ``segmentation``.
        """
        from warpvis.kernels.gradients.silhouette_masks import mark_silhouettes

        self._check_images(images, NEEDED_IMAGES)
        if len(self._camera.shape) == 1:
            raise CameraError("camera must have pixels with neighbors for a mask of silhouettes, got a list of rays")
        mask = self._zeros(as_image(images["depth"]).shape, wp.uint8)
        launch_images(
            mark_silhouettes,
            mask.shape,
            lambda window: [self._table, camera_to_world, window, _images(images), mask],
            device=self._scene.device,
            threads=self._threads,
        )
        return mask

    def _check_images(self, images: ImagesByName, needed: Sequence[str] | None = None) -> None:
        """Raise an `ArrayError` if an image is missing."""
        if needed is None:
            needed = NEEDED_IMAGES if self._scene.movable else NEEDED_IMAGES[:2]
        missing = [name for name in needed if name not in images]
        if missing:
            raise ArrayError(f"images must have {', '.join(needed)}, got none of {', '.join(missing)}")

    @cached_property
    def _table(self) -> RayTable:
        return ray_table(self._camera, self._scene.device)

    @property
    def _columns(self) -> wp.array | None:
        """Return each object's column in the object poses, -1 for static objects; None if none is movable."""
        scene = self._scene
        if not scene.movable:
            return None
        return self._on_device(
            None, scene.objects, lambda: wp.array(pose_columns(scene), dtype=wp.int32, device=scene.device)
        )

    def _on_device(self, name: str | None, source: object, make: Callable[[], wp.array]) -> wp.array:
        """Return an array that is made from `source`, and again when `source` is replaced by another object.

        It is not made while a CUDA graph is captured, if the same call ran before.
        """
        if name not in self._cached or self._cached[name][0] is not source:
            self._cached[name] = source, make()
        return self._cached[name][1]


def ray_table(camera: AnyCamera, device: wp.Device) -> RayTable:
    """Return the rays of a camera on a device."""
    from warpvis.kernels.gradients.depth_gradients import RayTable

    table = RayTable()
    table.rays = rays_on_device(camera, device)
    if camera.origins is not None:
        table.origins = rays_on_device(camera, device, "origins")
    return table


def _images(images: ImagesByName) -> Images:
    return images_struct({name: as_image(images[name]) for name in (*NEEDED_IMAGES, "faces") if name in images})


def _gradients(gradients: ImagesByName) -> ImageGradients:
    from warpvis.kernels.gradients.depth_gradients import ImageGradients

    struct = ImageGradients()
    for name, gradient in gradients.items():
        setattr(struct, name, as_image(gradient))
    return struct
