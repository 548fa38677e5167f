# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Casters of `Renderer` that cast ray by ray; separate modules contain the packet casters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
import warp as wp

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.rays import RayCamera
from warpvis.core.arrays import on_gpu
from warpvis.core.poses import Convention, check_convention, host_poses, parse_poses
from warpvis.core.threads import launch_images
from warpvis.core.types import KernelArguments, PoseLike
from warpvis.kernels.constants import POSE_WORDS
from warpvis.rendering._prepared import FreeList
from warpvis.rendering._views import wants_faces
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.casting.images import Images
    from warpvis.kernels.casting.worlds import Worlds


CastPoses: TypeAlias = wp.array | np.ndarray
"""Poses on the scene's device, or rows in host memory to be copied there."""

# Maximum number of kinds of calls (number of views and stream) with cached memory for poses on a GPU.
_MAX_STAGED = 4


class _Staging:
    """Buffers to copy poses from host rows to a GPU; cached, since allocating arrays takes longer than the copy."""

    def __init__(self, kind: tuple[int, wp.Stream]) -> None:
        views, stream = self.kind = kind
        self._rows = np.empty((views, POSE_WORDS), dtype=np.float32)
        self._source = wp.array(self._rows, dtype=wp.transform, device="cpu", copy=False)
        self._target = wp.empty(views, dtype=wp.transform, device=stream.device)

    def fill(self, poses: np.ndarray) -> wp.array:
        """Queue the copy. CUDA has read all of the source when this returns, because the memory is not pinned."""
        self._rows[:] = poses
        wp.copy(self._target, self._source)
        return self._target


class RaysCaster:
    """Cast with one thread per pixel and one query of Warp's mesh per thread."""

    def __init__(
        self,
        scene: Scene,
        camera: AnyCamera,
        *,
        cull_backfaces: bool,
        clip_near: bool,
        threads: int,
    ) -> None:
        """Set up the caster."""
        self._scene = scene
        self._camera = camera
        self._cull_backfaces = cull_backfaces
        self._clip_near = clip_near
        self._threads = threads
        self._staging = FreeList[_Staging](_MAX_STAGED)

    def parse_poses(self, poses: PoseLike, convention: Convention) -> CastPoses:
        """Check poses and return them in this caster's format: host poses as rows if they go to a GPU."""
        return self._parse_poses(poses, convention, "opencv")

    def _parse_poses(self, poses: PoseLike, convention: Convention, axes: Convention) -> CastPoses:
        device = self._scene.device
        # Fast path for poses that a loop on a GPU passes.
        if type(poses) is wp.array and poses.dtype is wp.transform and poses.device is device:
            if poses.ndim == 1 and poses.is_contiguous and check_convention(convention) == axes:
                return poses
        if device.is_cpu or on_gpu(poses):
            return parse_poses(poses, convention=convention, axes=axes, device=device)
        return host_poses(poses, convention=convention, axes=axes)

    def cast(self, poses: CastPoses, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels, segmentation and faces of all poses; skip images that are None."""
        from warpvis.kernels.casting.rays import cast_rays

        self._launch(cast_rays, (len(poses), self._camera.height, self._camera.width), poses, [worlds], images)

    def cast_at(self, poses: CastPoses, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast through image points, vec2 of shape ``(V, 1, N)``, which is also the images' shape."""
        from warpvis.kernels.casting.rays import cast_rays_at

        self._launch(cast_rays_at, pixels.shape, poses, [worlds, pixels], images)

    def _launch(
        self,
        kernel: wp.Kernel,
        shape: tuple[int, int, int],
        poses: CastPoses,
        inputs: KernelArguments,
        images: list[wp.array | None],
    ) -> None:
        triangles, outputs = self._scene.triangles(faces=wants_faces(images)), images_struct(images)
        camera = self._camera.device_struct(clip_near=self._clip_near)
        device_poses, staging = self._upload(poses)
        launch_images(
            kernel,
            shape,
            lambda window: [triangles.struct, camera, device_poses, window, *inputs, self._cull_backfaces, outputs],
            device=self._scene.device,
            threads=self._threads,
        )
        self._give_back(staging)

    def _upload(self, poses: CastPoses) -> tuple[wp.array, _Staging | None]:
        """Return poses on the scene's device and their staging buffers, to be given back after the launch."""
        if isinstance(poses, wp.array):
            return poses, None
        device = self._scene.device
        if device.is_cpu or device.is_capturing:  # a graph must not share its poses
            return wp.array(poses, dtype=wp.transform, device=device), None
        kind = (len(poses), device.stream)
        staging = self._staging.take(kind) or _Staging(kind)
        return staging.fill(poses), staging

    def _give_back(self, staging: _Staging | None) -> None:
        """Cache the buffers for later work on the same stream, which may overwrite them."""
        if staging is not None:
            self._staging.give_back(staging.kind, staging)


class OrthographicCaster(RaysCaster):
    """Cast the parallel rays of an `OrthographicCamera`, one thread per pixel."""

    def cast(self, poses: CastPoses, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels, segmentation and faces of all poses; skip images that are None."""
        from warpvis.kernels.casting.orthographic import cast_parallel_rays

        shape = (len(poses), self._camera.height, self._camera.width)
        self._launch(cast_parallel_rays, shape, poses, [worlds, None], images)

    def cast_at(self, poses: CastPoses, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast through image points, vec2 of shape ``(V, 1, N)``, which is also the images' shape."""
        from warpvis.kernels.casting.orthographic import cast_parallel_rays

        self._launch(cast_parallel_rays, pixels.shape, poses, [worlds, pixels], images)


class RayTableCaster(RaysCaster):
    """Cast the rays of a `RayCamera`, a ray table on the device, one thread per ray."""

    _camera: RayCamera

    def __getstate__(self) -> dict[str, object]:
        """Return the state without device arrays, which copies create themselves."""
        return {name: value for name, value in self.__dict__.items() if name not in ("_table", "_origins")}

    def parse_poses(self, poses: PoseLike, convention: Convention) -> CastPoses:
        """Check poses and return them as poses of the frame in which the rays are given."""
        return self._parse_poses(poses, convention, self._camera.axes)

    def cast(self, poses: CastPoses, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels, segmentation and faces of all poses; skip images that are None."""
        self._cast(poses, worlds, self._table, self._origins, as_images(images))

    def cast_at(self, poses: CastPoses, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast through image points, vec2 of the images' shape ``(V, 1, N)``, which are unprojected on the host."""
        rays = self._camera.rays_at(pixels.numpy())
        self.cast_along(poses, worlds, wp.array(rays, dtype=wp.vec3d, device=self._scene.device), images)

    def cast_along(self, poses: CastPoses, worlds: Worlds, rays: wp.array, images: list[wp.array | None]) -> None:
        """Cast along rays of the camera frame, of depth 1, shape ``(V, Y, X)`` vec3d; ``(1, Y, X)`` for all views."""
        self._cast(poses, worlds, rays, None, images)

    def _cast(
        self,
        poses: CastPoses,
        worlds: Worlds,
        rays: wp.array,
        origins: wp.array | None,
        images: list[wp.array | None],
    ) -> None:
        from warpvis.kernels.casting.ray_bundles import cast_ray_table

        shape = (len(poses), *rays.shape[1:])
        self._launch(cast_ray_table, shape, poses, [worlds, rays, origins], images)

    @cached_property
    def _table(self) -> wp.array:
        table = ray_table(self._camera, self._scene.device)
        return table.reshape((1, *table.shape))

    @cached_property
    def _origins(self) -> wp.array | None:
        return None if self._camera.origins is None else ray_table(self._camera, self._scene.device, "origins")


def ray_table(camera: AnyCamera, device: wp.Device, name: Literal["rays", "origins"] = "rays") -> wp.array:
    """Return a camera's rays or their origins on a device, vec3d of shape ``(height, width)``; cached."""
    rows = vectors_on_device(camera, name, lambda: getattr(camera, name), device)
    return rows.reshape((camera.height, camera.width))


def vectors_on_device(camera: AnyCamera, name: str, read: Callable[[], np.ndarray], device: wp.Device) -> wp.array:
    """Return a vector for each ray of a camera on a device, shape ``(rays,)`` vec3d; copied there once."""
    return camera.prepared((name, device.alias), lambda: wp.array(read().reshape(-1, 3), dtype=wp.vec3d, device=device))


def as_rows(array: wp.array) -> wp.array:
    """View ``(V, N)`` as ``(V, 1, N)``: an image of one row, in the same memory."""
    return array.reshape((array.shape[0], 1, array.shape[1]))


def as_images(images: Sequence[wp.array | None]) -> list[wp.array | None]:
    """View results of ray lists, ``(V, N)``, as images of one row; None stays None."""
    return [image if image is None or image.ndim == 3 else as_rows(image) for image in images]


def images_struct(images: Sequence[wp.array | None]) -> Images:
    """Make a `warpvis.kernels.casting.images.Images` from images in the order of its names; None is left out."""
    from warpvis.kernels.casting.images import NAMES, Images

    struct = Images()
    for name, image in zip(NAMES, images, strict=False):  # the struct has no field for colors
        if image is not None:
            setattr(struct, name, image)
    return struct
