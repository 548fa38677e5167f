# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Counting of the pixels of each object's isolated silhouette, by single rays, or by packets on CPU cores."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
import warp as wp

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.lens_camera import LensCamera
from warpvis.core.arrays import aligned_zeros
from warpvis.core.kernel_cache import launch
from warpvis.core.threads import launch_images, launch_shared, pack_launch, write_fields
from warpvis.core.types import KernelArguments
from warpvis.kernels.constants import JOB_COUNTERS
from warpvis.rendering import Views
from warpvis.scene import Scene
from warpvis.scene.worlds import pose_columns

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.pinhole import Window
    from warpvis.kernels.visibility.lens_silhouettes import CanvasRays
    from warpvis.kernels.visibility.silhouettes import Comparison


# On a GPU: number of threads that fill it, and limits of the threads per silhouette, whose maximum suits a large one.
_CUDA_THREADS = 1 << 20
_MIN_THREADS, _MAX_THREADS = 32, 4096


class SilhouetteCounter:
    """Counts pixels of chosen objects of a scene, for repeated calls."""

    def __init__(
        self,
        scene: Scene,
        camera: ImageCamera,
        chosen: Sequence[int],
        *,
        canvas: tuple[int, int, int, int],
        delta: float,
        skip_unseen: bool,
        caster: Literal["packets", "rays"],
        threads: int,
    ) -> None:
        """Set up the counter; arguments as for `warpvis.object_visibility`.

        Single rays are always used on CUDA and through a lens.
        """
        from warpvis.kernels.visibility.silhouettes import Canvas, Chosen

        device = scene.device
        self._device, self._camera, self._threads, self._delta = device, camera, threads, delta
        self._lens = _canvas_rays(camera, canvas, device) if camera.ray_model == "table" else None
        self._packets = caster == "packets" and device.is_cpu and self._lens is None
        self._isolated = scene.isolated()
        clusters = self._isolated.bvh()
        self._frames = ObjectFrames(scene, self._isolated)
        self._chosen = Chosen()
        self._chosen.index = wp.array(np.array(chosen, dtype=np.int32), dtype=wp.int32, device=device)
        self._chosen.boxes = clusters.struct.movable_boxes.reshape((-1, 3)).view(wp.vec3).reshape((-1, 2))
        left, top, right, bottom = canvas
        self._image, self._canvas = Canvas(), Canvas()
        self._image.x1, self._image.y1 = camera.width, camera.height
        self._canvas.x0, self._canvas.y0 = -left, -top
        self._canvas.x1, self._canvas.y1 = camera.width + right, camera.height + bottom
        self._canvas.seen_only = int(skip_unseen and any(canvas))

    def count(
        self,
        poses: wp.array,
        worlds: Worlds,
        seen: Views,
        counts: wp.array,
        hidden_by: wp.array,
        masks: wp.array | None,
    ) -> None:
        """Add the pixels of views to the counters; see `warpvis.kernels.visibility.silhouettes.measure_silhouettes`."""
        from warpvis.kernels.visibility.silhouettes import Comparison

        compared = Comparison()
        compared.segmentation, compared.depth, compared.delta = seen.segmentation, seen.depth, self._delta
        worlds = self._frames.spread(worlds)
        outputs = [counts, hidden_by, masks]
        if self._packets:
            self._count_by_packets(poses, worlds, compared, outputs)
        else:
            self._count_by_rays(poses, worlds, compared, outputs)

    def _count_by_rays(
        self, poses: wp.array, worlds: Worlds, compared: Comparison, outputs: list[wp.array | None]
    ) -> None:
        from warpvis.kernels.visibility.lens_silhouettes import measure_silhouettes_rays
        from warpvis.kernels.visibility.silhouettes import measure_silhouettes

        triangles = self._isolated.triangles()
        kernel = measure_silhouettes if self._lens is None else measure_silhouettes_rays
        camera = self._camera.device_struct() if self._lens is None else self._lens
        pairs = len(poses) * len(self._chosen.index)
        threads = 1
        if not self._device.is_cpu:
            threads = _MIN_THREADS
            while threads < _MAX_THREADS and pairs * threads < _CUDA_THREADS:
                threads *= 2
        parts = [self._canvas]
        if self._canvas.seen_only:  # count the image first, and the rest of the canvas only for visible objects
            self._canvas.beyond_only = 1
            parts = [self._image, self._canvas]
        for part in parts:
            inputs = [part, worlds, compared, threads, *outputs]

            def arguments(window: Window, inputs: KernelArguments = inputs) -> KernelArguments:
                return [triangles.struct, self._chosen, camera, poses, window, *inputs]

            shape = (len(poses), len(self._chosen.index), threads)
            launch_images(kernel, shape, arguments, device=self._device, threads=self._threads)

    def _count_by_packets(
        self, poses: wp.array, worlds: Worlds, compared: Comparison, outputs: list[wp.array | None]
    ) -> None:
        from warpvis.kernels.casting.packets import WorkerMemory
        from warpvis.kernels.visibility.silhouette_packets import SilhouetteCall, measure_silhouettes_packets

        workers = min(self._threads, len(poses) * len(self._chosen.index))
        counter = np.zeros(JOB_COUNTERS, dtype=np.int32)
        call, shared, camera = SilhouetteCall(), WorkerMemory(), self._camera.device_struct()
        shared.counter = wp.array(counter, dtype=wp.int32, device="cpu", copy=False)
        shared.scratch_bytes = wp.zeros(1, dtype=wp.int64, device="cpu")
        write_fields(call, scene=self._isolated.bvh().struct, chosen=self._chosen, camera=camera, poses=poses)
        write_fields(call, workers=shared, canvas=self._canvas, worlds=worlds, comparison=compared)
        launch = pack_launch(measure_silhouettes_packets, [call, *outputs])
        launch.launch()  # without scratch memory, it only writes the size that it needs to `scratch_bytes`
        shared.scratch = aligned_zeros((workers, int(shared.scratch_bytes.numpy()[0])), wp.uint8)
        write_fields(call, workers=shared)
        launch_shared(launch, counter, workers)


class ObjectFrames:
    """The frame of every object of a scene, as in `Scene.isolated`."""

    def __init__(self, scene: Scene, isolated: Scene) -> None:
        """Read which objects move together."""
        self._scene, self._isolated, device = scene, isolated, scene.device
        self._columns = wp.array(pose_columns(scene), dtype=wp.int32, device=device)
        is_attached = np.isin(np.arange(len(scene)), list(scene.attached())).astype(np.uint8)
        self._is_attached = wp.array(is_attached, dtype=wp.uint8, device=device)

    def spread(self, worlds: Worlds) -> Worlds:
        """Return worlds of the scene with a pose, and a size if they have sizes, for every object."""
        from warpvis.kernels.casting.worlds import Worlds
        from warpvis.kernels.visibility.object_frames import spread_poses, spread_sizes

        poses, columns = worlds.object_poses, self._columns
        spread, initial = Worlds(), self._isolated.movable_poses()
        spread.world, spread.excluded = worlds.world, worlds.excluded
        if poses is None or not poses.size or poses is self._scene.movable_poses():
            spread.object_poses, shape = initial, initial.shape
        else:
            shape = poses.shape[0], len(columns)
            spread.object_poses = wp.empty(shape, dtype=wp.transform, device=columns.device)
            launch(spread_poses, shape, [poses, columns, initial, spread.object_poses], columns.device)
        if worlds.object_sizes is not None and worlds.object_sizes.size:
            spread.object_sizes = wp.empty(shape, dtype=wp.vec4, device=columns.device)
            sizes = [worlds.object_sizes, self._scene.movable_sizes(), self._isolated.movable_sizes()]
            launch(spread_sizes, shape, [*sizes, columns, self._is_attached, spread.object_sizes], columns.device)
        return spread


def _canvas_rays(camera: LensCamera, canvas: tuple[int, int, int, int], device: wp.Device) -> CanvasRays:
    """Return the rays of a lens through all pixels of a canvas, on a device."""
    from warpvis.kernels.visibility.lens_silhouettes import CanvasRays

    struct = CanvasRays()
    struct.width, struct.height, struct.near, struct.far = camera.width, camera.height, camera.near, camera.far
    struct.is_planar, (struct.left, struct.top, _, _) = camera.kind == "z", canvas
    struct.rays = wp.array(camera.canvas_rays(canvas), dtype=wp.vec3d, device=device)
    return struct
