# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The two casters behind `Renderer`: what each needs of a scene, and how its work is split over threads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpvis.camera import Camera
from warpvis.scene import Scene
from warpvis.threads import launch_images, load_module, run_together

# Strips a thread gets when there are few views: enough that one with much to draw does not keep the others waiting.
_STRIPS_PER_THREAD = 4
_TILE = 16
_VISIT_WORDS = 6


class RaysCaster:
    """One thread a pixel, one query of Warp's mesh a thread."""

    def __init__(self, scene: Scene, camera: Camera, *, cull_backfaces: bool, threads: int) -> None:
        """Prepare to cast."""
        self._scene = scene
        self._camera = camera
        self._cull_backfaces = cull_backfaces
        self._threads = threads

    def cast(self, poses: wp.array, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels and objects of all poses; None is not made."""
        from warpvis.kernels.rays import cast_rays

        self._launch(cast_rays, (len(poses), self._camera.height, self._camera.width), poses, [], images)

    def cast_at(self, poses: wp.array, pixels: wp.array, images: list[wp.array | None]) -> None:
        """The same through image points, shape ``(V, 1, N)`` vec2, as are the images'."""
        from warpvis.kernels.rays import cast_rays_at

        self._launch(cast_rays_at, pixels.shape, poses, [pixels], images)

    def _launch(
        self,
        kernel: Any,
        shape: tuple[int, int, int],
        poses: wp.array,
        pixels: list[wp.array],
        images: list[wp.array | None],
    ) -> None:
        triangles, camera = self._scene.triangles(), self._camera.device_struct()
        launch_images(
            kernel,
            shape,
            lambda window: [triangles.struct, camera, poses, window, *pixels, self._cull_backfaces, *images],
            device=self._scene.device,
            threads=self._threads,
        )


@dataclass
class _Workplace:
    """What one call at a time works with: the job as kernels take it, and the memory it refers to."""

    key: tuple[int, ...]
    job: Any
    counter: np.ndarray


class PacketsCaster:
    """All pixels of a view, or of a strip of it, walk a cluster tree together; on CPU cores."""

    def __init__(self, scene: Scene, camera: Camera, *, cull_backfaces: bool, threads: int) -> None:
        """Prepare to cast."""
        self._scene = scene
        self._camera = camera
        self._cull_backfaces = cull_backfaces
        self._threads = threads
        self._idle: list[_Workplace] = []

    def cast(self, poses: wp.array, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels and objects of all poses; None is not made."""
        self._run(poses, None, images)

    def cast_at(self, poses: wp.array, pixels: wp.array, images: list[wp.array | None]) -> None:
        """The same through image points, shape ``(V, 1, N)`` vec2, as are the images'."""
        if pixels.size:
            self._run(poses, pixels, images)

    def _run(self, poses: wp.array, pixels: wp.array | None, images: list[wp.array | None]) -> None:
        from warpvis.kernels import packets

        views = len(poses)
        if views == 0:
            return
        points = 0 if pixels is None else pixels.shape[2]
        load_module(packets.cast_packets)
        clusters = self._scene.clusters()
        strips, strip_height = split_rows(views, self._camera.height, self._threads)
        workers = min(self._threads, views * strips)
        place = self._take(views, strips, strip_height, workers, clusters.depth, points)
        place.counter[:] = 0
        place.job.at = pixels if pixels is None else pixels.flatten().view(wp.float32).flatten()
        inputs = [clusters.struct, place.job, poses, *images]
        # Recorded once: packing the arguments takes longer than many a strip.
        launch = wp.launch(packets.cast_packets, dim=1, inputs=inputs, device="cpu", record_cmd=True)
        run_together(launch.launch, workers)
        self._idle.append(place)

    def _take(self, views: int, strips: int, strip_height: int, workers: int, depth: int, points: int) -> _Workplace:
        """A workplace that nobody uses: callers on several threads each have their own."""
        key = (views, strips, workers, depth, points)
        while self._idle:
            try:
                place = self._idle.pop()
            except IndexError:  # another thread was quicker
                break
            if place.key == key:
                return place
        return _Workplace(key, *self._make_job(views, strips, strip_height, workers, depth, points))

    def _make_job(
        self, views: int, strips: int, strip_height: int, workers: int, depth: int, points: int
    ) -> tuple[Any, np.ndarray]:
        from warpvis.kernels.packets import PacketJob

        camera, job = self._camera, PacketJob()
        job.views, job.height, job.width = views, camera.height, camera.width
        job.strips, job.strip_height = strips, strip_height
        job.focal_x, job.focal_y = camera.fx, camera.fy
        job.center_x, job.center_y = camera.cx, camera.cy
        job.near, job.far = camera.near, camera.far
        job.cull_backfaces = int(self._cull_backfaces)
        counter = np.zeros(2, dtype=np.int32)
        job.counter = wp.array(counter, dtype=wp.int32, device="cpu", copy=False)
        tiles_x, tiles_y = -(-camera.width // _TILE), -(-strip_height // _TILE)
        # As `Scratch` in kernels/native/packets.h carves it: w and id of every pixel, what is known of blocks and
        # tiles, four rows of each, and a stack with room for all children of a node on every level.
        words = tiles_x * tiles_y * (2 * 256 + 16 + 1 + 4 + 1) + tiles_x * 128 + (depth + 1) * 16 * _VISIT_WORDS + 64
        if points:  # their cells and packets, as `Scratch` carves them
            cells = tiles_x * tiles_y * 16
            words += cells + 32 + 5 * (points + 15 * min(cells, points) + 16)
        job.points = points
        job.scratch = wp.zeros((workers, words), dtype=wp.float32, device="cpu")
        return job, counter


def split_rows(views: int, height: int, threads: int) -> tuple[int, int]:
    """Strips of a view and their height, a multiple of 16: one, unless there are too few views for all threads."""
    if threads == 1 or views >= threads * _STRIPS_PER_THREAD:
        wanted = 1
    else:
        wanted = -(-threads * _STRIPS_PER_THREAD // views)
    tiles = -(-height // _TILE)
    strip_height = -(-tiles // min(wanted, tiles)) * _TILE
    return -(-height // strip_height), strip_height
