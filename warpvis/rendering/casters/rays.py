# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Casters that cast ray by ray: the reference on both devices."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.rays import RayCamera
from warpvis.core.arrays import on_gpu
from warpvis.core.kernel_cache import launch
from warpvis.core.poses import Convention, check_convention, host_poses, parse_poses
from warpvis.core.threads import launch_images
from warpvis.core.types import KernelArguments, PoseLike
from warpvis.rendering.casters.base import CastOptions, ImagesByName, ViewBatch, images_struct
from warpvis.rendering.casters.single_rays_cuda import MIN_RAYS, PackedRays, sorted_rays, takes_sorted_rays
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.casting.sorted_rays import SortedRays
    from warpvis.kernels.casting.worlds import Worlds

MAX_ORIGIN_EXTENT = 0.1
"""Maximum extent of the origins along each axis for which packets are used [m]."""


class RaysCaster:
    """Cast with one thread per pixel and one query of Warp's mesh per thread."""

    def __init__(self, scene: Scene, camera: AnyCamera, options: CastOptions) -> None:
        """Set up the caster."""
        self._scene = scene
        self._camera = camera
        self._options = options

    def parse_poses(self, poses: PoseLike, convention: Convention) -> wp.array | np.ndarray:
        """Check poses and return them in the frame of the camera's axes: as rows if they go to a GPU."""
        device, axes = self._scene.device, self._camera.axes
        # Fast path for poses that a loop on a GPU passes.
        if type(poses) is wp.array and poses.dtype is wp.transform and poses.device is device:
            if poses.ndim == 1 and poses.is_contiguous and check_convention(convention) == axes:
                return poses
        if device.is_cpu or on_gpu(poses):
            return parse_poses(poses, convention=convention, axes=axes, device=device)
        return host_poses(poses, convention=convention, axes=axes)

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write images of all views."""
        from warpvis.kernels.casting.point_order import clear_unused
        from warpvis.kernels.casting.rays import cast_rays

        if views.used is not None and views.pixels is not None:
            points = views.pixels.reshape((views.count, -1))
            launch(clear_unused, points.shape, [views.used, points], self._scene.device)
        self._launch(cast_rays, [views.pixels], views, images)

    def _launch(
        self,
        kernel: wp.Kernel,
        inputs: KernelArguments,
        views: ViewBatch,
        images: ImagesByName,
        size: tuple[int, ...] | None = None,
    ) -> None:
        """Launch a kernel over rows and columns of all views: those of the camera, or of the image points."""
        if size is None:
            size = (self._camera.height, self._camera.width) if views.pixels is None else views.pixels.shape[1:]
        triangles, outputs = self._scene.triangles(faces="faces" in images), images_struct(images)
        camera, cull = self._camera.device_struct(clip_near=self._options.clip_near), self._options.cull_backfaces
        poses = views.poses_on(self._scene.device)
        launch_images(
            kernel,
            (views.count, size[0], size[1]),
            lambda window: [triangles.struct, camera, poses, window, views.worlds, *inputs, cull, outputs],
            device=self._scene.device,
            threads=self._options.threads,
        )


class OrthographicCaster(RaysCaster):
    """Cast the parallel rays of an `OrthographicCamera`, one thread per pixel."""

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write images of all views."""
        from warpvis.kernels.casting.orthographic import cast_parallel_rays

        self._launch(cast_parallel_rays, [views.pixels], views, images)


class RayBundleCaster(RaysCaster):
    """Cast the rays of a `RayCamera`, from an array on the device, one thread per ray; on a GPU, sorted if possible."""

    _camera: RayCamera

    def __getstate__(self) -> dict[str, object]:
        """Return the state without device arrays, which copies create themselves."""
        return {name: value for name, value in self.__dict__.items() if name not in ("_rays", "_origins")}

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write images of all views; image points are unprojected on the host."""
        if views.pixels is None:
            if self._scene.device.is_cuda and self._sorts(views):
                self._cast_sorted(sorted_rays(self._camera, self._scene.device), "sorted rays", views, images)
            else:
                self._cast_along(views, self._rays, self._origins, images)
            return
        self.cast_along(views, rays_through(self._camera, views.pixels, self._scene.device), images)

    def _sorts(self, views: ViewBatch) -> bool:
        rays, triangles = self._camera.width * self._camera.height, self._scene.triangles().struct
        still = triangles.movable_count == 0 and triangles.instance_count == 0
        return still and views.count * rays >= MIN_RAYS and takes_sorted_rays(self._options, views, rays)

    def _cast_sorted(self, rays: SortedRays, name: str, views: ViewBatch, images: ImagesByName) -> None:
        """Cast sorted rays, which have a name among those of the camera."""
        device, poses = self._scene.device, views.poses_on(self._scene.device)
        triangles = self._scene.triangles(faces="faces" in images).struct
        if device.is_capturing:  # a captured graph must not share its memory
            PackedRays(rays, self._camera, views.count, device).run(triangles, poses, views.worlds, images)
            return
        self._options.pool.use(
            (self, name, views.count, device.stream),
            lambda: PackedRays(rays, self._camera, views.count, device),
            lambda packed: packed.run(triangles, poses, views.worlds, images),
        )

    def cast_along(self, views: ViewBatch, rays: wp.array, images: ImagesByName) -> None:
        """Cast along rays of the camera frame, of depth 1, shape ``(V, Y, X)`` vec3d; ``(1, Y, X)`` for all views."""
        self._cast_along(views, rays, None, images)

    def _cast_along(self, views: ViewBatch, rays: wp.array, origins: wp.array | None, images: ImagesByName) -> None:
        from warpvis.kernels.casting.ray_bundles import cast_ray_table

        self._launch(cast_ray_table, [rays, origins], views, images, rays.shape[1:])

    @cached_property
    def _rays(self) -> wp.array:
        return rays_through(self._camera, None, self._scene.device)

    @cached_property
    def _origins(self) -> wp.array | None:
        return None if self._camera.origins is None else rays_on_device(self._camera, self._scene.device, "origins")


def takes_packets(scene: Scene, camera: RayCamera, worlds: Worlds, clip_near: bool, max_extent: float) -> bool:
    """Return whether packets can cast rays with a camera's ray origins.

    They cannot if the origins are further apart than `max_extent` along an axis [m], the scene has movable analytic
    solids, worlds scale objects, or near surfaces are cut away.
    """
    if clip_near or worlds.object_sizes or scene.bvh().has_solids:
        return False
    return origin_extent(camera) <= max_extent


def origin_extent(camera: RayCamera) -> float:
    """Return the maximum extent of the origins of a camera's rays along an axis [m]."""
    origins = camera.origins
    assert origins is not None  # cameras without origins use another caster
    return camera.prepared("extent of origins", lambda: extent_of(camera.rays, origins))


def extent_of(rays: NDArray[np.float64], origins: NDArray[np.float64]) -> float:
    """Return the maximum extent of the origins of rays along an axis [m]; 0 without rays."""
    has_ray = np.isfinite(rays).all(axis=-1)
    return float(np.ptp(origins[has_ray], axis=0).max()) if has_ray.any() else 0.0


def rays_through(camera: RayCamera, pixels: wp.array | None, device: wp.Device) -> wp.array:
    """Return rays of depth 1 on a device, vec3d: of all pixels, ``(1, Y, X)``, or through image points, ``(V, Y, X)``.

    Image points are unprojected on the host.
    """
    if pixels is not None:
        return wp.array(camera.rays_at(pixels.numpy()), dtype=wp.vec3d, device=device)
    rays = rays_on_device(camera, device)
    return rays.reshape((1, *rays.shape))


def rays_on_device(camera: AnyCamera, device: wp.Device, name: Literal["rays", "origins"] = "rays") -> wp.array:
    """Return a camera's rays or their origins on a device, vec3d of shape ``(height, width)``; copied there once."""
    rows = camera.prepared(
        (name, device.alias), lambda: wp.array(getattr(camera, name).reshape(-1, 3), dtype=wp.vec3d, device=device)
    )
    return rows.reshape((camera.height, camera.width))
