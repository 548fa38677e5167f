# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The two casters behind `Renderer`: what each needs of a scene, and how its work is split over threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import aligned_zeros
from warpvis.core.camera import Camera
from warpvis.core.poses import Convention, host_poses, parse_poses
from warpvis.core.threads import launch_images, pack_launch, run_together
from warpvis.core.types import KernelArguments, PoseLike
from warpvis.kernels.constants import COUNTER_FINISHED, JOB_COUNTERS, POSE_WORDS, TILE_SIDE
from warpvis.rendering._orthographic import AnyCamera
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.images import Images
    from warpvis.kernels.packets import BvhScene, PacketJob
    from warpvis.kernels.worlds import Worlds

# A strip is a thread's part of the rows that are left, divided by this.
_SHARES_PER_THREAD = 2
TILE = TILE_SIDE
# Of `warpvis.kernels.packets.cast_packets`.
_ARGUMENTS = ("scene", "job", "poses", "worlds", "images")


class RaysCaster:
    """One thread a pixel, one query of Warp's mesh a thread."""

    def __init__(
        self,
        scene: Scene,
        camera: AnyCamera,
        *,
        cull_backfaces: bool,
        clip_near: bool,
        threads: int,
    ) -> None:
        """Prepare to cast."""
        self._scene = scene
        self._camera = camera
        self._cull_backfaces = cull_backfaces
        self._clip_near = clip_near
        self._threads = threads

    def parse_poses(self, poses: PoseLike, convention: Convention) -> wp.array:
        """Check poses, and return them as this caster takes them."""
        return parse_poses(poses, convention=convention, device=self._scene.device)

    def cast(self, poses: wp.array, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels and segmentation of all poses; None is not made."""
        from warpvis.kernels.rays import cast_rays

        self._launch(cast_rays, (len(poses), self._camera.height, self._camera.width), poses, [worlds], images)

    def cast_at(self, poses: wp.array, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast through image points, shape ``(V, 1, N)`` vec2, as are the images'."""
        from warpvis.kernels.rays import cast_rays_at

        self._launch(cast_rays_at, pixels.shape, poses, [worlds, pixels], images)

    def _launch(
        self,
        kernel: wp.Kernel,
        shape: tuple[int, int, int],
        poses: wp.array,
        others: KernelArguments,
        images: list[wp.array | None],
    ) -> None:
        triangles, outputs = self._scene.triangles(), images_struct(images)
        camera = self._camera.device_struct(clip_near=self._clip_near)
        launch_images(
            kernel,
            shape,
            lambda window: [triangles.struct, camera, poses, window, *others, self._cull_backfaces, outputs],
            device=self._scene.device,
            threads=self._threads,
        )


class OrthographicCaster(RaysCaster):
    """The same with rays that are parallel, of an `OrthographicCamera`."""

    def cast(self, poses: wp.array, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels and segmentation of all poses; None is not made."""
        from warpvis.kernels.orthographic import cast_parallel_rays

        shape = (len(poses), self._camera.height, self._camera.width)
        self._launch(cast_parallel_rays, shape, poses, [worlds, None], images)

    def cast_at(self, poses: wp.array, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast through image points, shape ``(V, 1, N)`` vec2, as are the images'."""
        from warpvis.kernels.orthographic import cast_parallel_rays

        self._launch(cast_parallel_rays, pixels.shape, poses, [worlds, pixels], images)


@dataclass
class _Workspace:
    """What one call at a time works with: the job as kernels take it, the memory it refers to, and a packed launch.

    To pack a launch takes longer than many a strip: what stays the same from call to call stays packed. The job and the
    images are packed by reference: a launch reads what they hold then.
    """

    key: tuple[int, ...]
    job: PacketJob
    counter: np.ndarray
    poses: wp.array
    pose_rows: np.ndarray
    images: Images
    launch: wp.Launch
    packed: dict[str, object]
    """The arguments that may change, by name, as they are packed now."""

    def pack(self, **arguments: object) -> None:
        """Put arguments into the launch."""
        for name, value in arguments.items():
            if value is not self.packed[name]:
                self.launch.set_param_at_index(_ARGUMENTS.index(name), value)
                self.packed[name] = value


class PacketsCaster:
    """All pixels of a view, or of a strip of it, walk a BVH together; on CPU cores."""

    def __init__(self, scene: Scene, camera: Camera, *, cull_backfaces: bool, clip_near: bool, threads: int) -> None:
        """Prepare to cast."""
        self._scene = scene
        self._camera = camera
        self._cull_backfaces = cull_backfaces
        self._clip_near = clip_near
        self._threads = threads
        self._idle: list[_Workspace] = []

    def parse_poses(self, poses: PoseLike, convention: Convention) -> np.ndarray:
        """Check poses, and return them as this caster takes them."""
        return host_poses(poses, convention=convention)

    def cast(self, poses: np.ndarray, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels and segmentation of all poses; None is not made."""
        self._run(poses, worlds, None, images)

    def cast_at(self, poses: np.ndarray, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast through image points, shape ``(V, 1, N)`` vec2, as are the images'."""
        if pixels.size:
            self._run(poses, worlds, pixels, images)

    def _run(self, poses: np.ndarray, worlds: Worlds, pixels: wp.array | None, images: list[wp.array | None]) -> None:
        from warpvis.kernels import packets
        from warpvis.kernels.images import NAMES

        views = len(poses)
        if views == 0:
            return
        clusters = self._scene.bvh()
        points = 0 if pixels is None else pixels.shape[2]
        space = self._take(clusters.struct, views, points)
        workers = min(self._threads, views * space.job.strips)
        space.counter[:] = 0
        space.pose_rows[:] = poses
        if pixels is not None:
            space.job.at = pixels.flatten().view(wp.float32).flatten()
        space.pack(scene=clusters.struct, worlds=worlds)
        asked = [(name, image) for name, image in zip(NAMES, images, strict=True) if image is not None]
        for name, image in asked:
            setattr(space.images, name, image)
        run_together(space.launch.launch, workers, lambda: bool(space.counter[COUNTER_FINISHED] == workers))
        # What the caller drops must not live on here.
        for name, _ in asked:
            setattr(space.images, name, None)
        if pixels is not None:
            space.job.at = None
        if worlds.object_poses is not None:  # what nothing moves in and nothing is said of holds no arrays
            space.pack(worlds=packets.NO_WORLDS)
        self._idle.append(space)

    def _take(self, scene: BvhScene, views: int, points: int) -> _Workspace:
        """Return a workspace that nobody uses, for a scene and numbers of views and of points.

        Callers on several threads each have their own.
        """
        from warpvis.kernels import packets

        key = (scene.levels, scene.movable_count, views, points)
        while self._idle:
            try:
                space = self._idle.pop()
            except IndexError:  # another thread was quicker
                break
            if space.key == key:
                return space
        job, counter = self._make_job(views, points)
        rows = np.empty((views, POSE_WORDS), dtype=np.float32)
        poses = wp.array(rows, dtype=wp.transform, device="cpu", copy=False)
        images = packets.Images()
        changing = {"scene": scene, "worlds": packets.NO_WORLDS}
        launch = pack_launch(packets.cast_packets, [scene, job, poses, packets.NO_WORLDS, images])
        launch.launch()  # without memory, it says how much it needs
        job.scratch = aligned_zeros((self._threads, int(job.scratch_bytes.numpy()[0])), wp.uint8)
        return _Workspace(key, job, counter, poses, rows, images, launch, changing)

    def _make_job(self, views: int, points: int) -> tuple[PacketJob, np.ndarray]:
        from warpvis.kernels.packets import PacketJob

        camera, job = self._camera, PacketJob()
        job.views, job.height, job.width = views, camera.height, camera.width
        # Every strip looks at all points of its view: no more of them than threads have to share.
        strip_rows = split_rows(views, camera.height, self._threads, equal=bool(points))
        job.strips, job.most_rows = len(strip_rows) - 1, int(np.diff(strip_rows).max())
        job.strip_rows = wp.array(strip_rows, dtype=wp.int32, device="cpu")
        job.focal_x, job.focal_y = camera.fx, camera.fy
        job.center_x, job.center_y = camera.cx, camera.cy
        lens = camera.device_struct(clip_near=self._clip_near)
        job.near, job.far, job.most_inv_z, job.clip_reach = lens.near, lens.far, lens.most_inv_z, lens.clip_reach
        job.cull_backfaces = int(self._cull_backfaces)
        counter = np.zeros(JOB_COUNTERS, dtype=np.int32)
        job.counter = wp.array(counter, dtype=wp.int32, device="cpu", copy=False)
        job.points = points
        job.scratch_bytes = wp.zeros(1, dtype=wp.int64, device="cpu")
        return job, counter


MakeCaster: TypeAlias = Callable[..., RaysCaster | PacketsCaster]


def images_struct(images: Sequence[wp.array | None]) -> Images:
    """Make `warpvis.kernels.images.Images` of depth, points, normals, labels and segmentation; None is not made."""
    from warpvis.kernels.images import NAMES, Images

    struct = Images()
    for name, image in zip(NAMES, images, strict=True):
        if image is not None:
            setattr(struct, name, image)
    return struct


def split_rows(views: int, height: int, threads: int, *, equal: bool = False) -> NDArray[np.int32]:
    """Say where the strips of a view begin, multiples of 16, and where the last one ends.

    With views for all threads, a view is one strip. Else each strip is a share of the rows that are left, so that the
    last ones are small and threads end at about the same time (guided self-scheduling: Polychronopoulos and Kuck 1987);
    or `equal`: one for each thread that a view has.
    """
    if equal:
        tiles = -(-height // TILE)
        step = TILE * -(-tiles // -(-threads // views))
        return np.array([*range(0, height, step), height], dtype=np.int32)
    shares = 1 if threads == 1 or views >= 4 * threads else -(-_SHARES_PER_THREAD * threads // views)
    rows, starts = 0, [0]
    while rows < height:
        tiles = -(-(height - rows) // TILE)
        rows = min(rows + -(-tiles // shares) * TILE, height)
        starts.append(rows)
    return np.array(starts, dtype=np.int32)
