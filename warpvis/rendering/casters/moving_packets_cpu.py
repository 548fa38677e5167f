# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of rays from sensors that move within a frame, on CPU cores."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.base import AnyCamera
from warpvis.kernels.constants import CPU_LANES
from warpvis.rendering.casters.base import ImagesByName, ViewBatch
from warpvis.rendering.casters.packets_cpu import CpuCaster, Workspace
from warpvis.rendering.casters.sorted_rays_cpu import PreparedRays, component, prepare_rays
from warpvis.scene.worlds import without_movables

if TYPE_CHECKING:
    from warpvis.kernels.casting.motions import Motion as MotionStruct
    from warpvis.kernels.casting.moving_ray_packets import MovingRays
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.kernels.casting.ray_bundle_packets import TableJob

_GROUP_RAYS = CPU_LANES**3


@dataclass(frozen=True)
class MovingSensor:
    """The motion of a sensor and of movable objects, and results of a cast.

    These are the views that packets could not cast, shape (V), and the objects that each ray may hit, shape (V, rays).
    """

    motion: MotionStruct
    left: NDArray[np.int32]
    objects: MotionStruct | None = None
    touched: NDArray[np.int32] | None = None

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.left)


@dataclass(frozen=True)
class PreparedMovingRays:
    """Rays of a sensor with times, prepared for packets."""

    rays: PreparedRays
    struct: MovingRays


class MovingPackets(CpuCaster):
    """Casts rays in packets whose rays start at about the same time, and are thus close to each other."""

    _camera: AnyCamera

    def __getstate__(self) -> dict[str, object]:
        """Return the state without the prepared rays, which copies prepare again or take from the camera's cache."""
        return {name: value for name, value in self.__dict__.items() if name != "_rays"}

    def takes(self, views: ViewBatch) -> bool:
        """Return whether packets can cast the rays of these views.

        As for other rays with distinct origins, they cannot if worlds scale objects, or near surfaces are cut away.
        """
        clips = self._options.clip_near and self._camera.near > 0
        return not (clips or views.worlds.object_sizes)

    def cast_motion(
        self, motion: MotionStruct, objects: MotionStruct | None, views: ViewBatch, images: ImagesByName
    ) -> tuple[NDArray[np.bool_], NDArray[np.int32] | None]:
        """Write images of views whose sensor moves, without movable objects if a motion of objects is given.

        Returns:
            Which views remain, because they move too far, and the bits of the objects that each ray may hit, by the
            object's index modulo 32.
        """
        size, worlds, touched = self._camera.width * self._camera.height, views.worlds, None
        left = np.zeros(views.count, dtype=np.int32)
        if objects is not None:
            worlds = without_movables(self._scene, worlds)
            touched = np.zeros((views.count, size), dtype=np.int32)
        bundles = len(self._rays.rays.longest)
        if bundles:  # else no pixel has a ray
            make = partial(self._make_workspace, views.count)
            batch = ViewBatch(MovingSensor(motion, left, objects, touched), worlds)
            self._run("moving", batch, images, views.count * size, views.count * bundles, make)
        return (left != 0 if bundles else np.ones(views.count, dtype=np.bool_)), touched

    @cached_property
    def _rays(self) -> PreparedMovingRays:
        return self._camera.prepared("moving packets", lambda: prepare_moving_rays(self._camera))

    def _make_workspace(self, views: int, scene: BvhScene, workers: int) -> Workspace:
        from warpvis.kernels.casting.moving_ray_packets import MovingCall, cast_moving_ray_packets

        call = MovingCall()
        call.rays, call.moving, call.job = self._rays.rays.struct, self._rays.struct, self._make_job()
        call.moving.left = wp.zeros(views, dtype=wp.int32, device="cpu")
        return MovingWorkspace(scene, cast_moving_ray_packets, (call, MovingCall), views, workers)

    def _make_job(self) -> TableJob:
        from warpvis.kernels.casting.ray_bundle_packets import TableJob
        from warpvis.kernels.pinhole import PinholeCamera

        camera, job, table = self._camera, TableJob(), PinholeCamera()
        table.height, table.width, table.near, table.far = camera.height, camera.width, camera.near, camera.far
        table.clip_inv_z = math.inf
        job.camera = table
        job.cull_backfaces = int(self._options.cull_backfaces)
        return job


class MovingWorkspace(Workspace):
    """A packed launch for sensors that move."""

    def _write_poses(self, poses: MovingSensor) -> None:
        motion: Any = poses.motion
        objects: Any = poses.objects
        self._memory.sensor = motion.__ctype__()
        self._memory.moving.left.data = poses.left.ctypes.data
        if objects is None or poses.touched is None:
            self._memory.objects.legs.data = 0
        else:
            self._memory.objects = objects.__ctype__()
            self._memory.moving.touched.data = poses.touched.ctypes.data


def prepare_moving_rays(camera: AnyCamera) -> PreparedMovingRays:
    """Prepare the rays of a camera, which are all cast at 0 s if they have no times."""
    from warpvis.kernels.casting.moving_ray_packets import MovingRays

    shape, origins = (camera.height, camera.width), camera.origins
    times = np.zeros(shape) if camera.times is None else camera.times.reshape(shape)
    prepared, struct = prepare_rays(camera.rays.reshape(*shape, 3), times), MovingRays()
    place, bundles = prepared.struct.place.numpy(), prepared.struct.bundle.numpy()
    directions, moments, spans = np.zeros((3, len(place))), np.zeros(len(place)), np.zeros((len(bundles), 2))
    for number, (group, num_groups, *axes) in enumerate(bundles[:, :5].tolist()):
        slots = slice(group * _GROUP_RAYS, (group + num_groups) * _GROUP_RAYS)
        pixel = place[slots]
        of_rays = times.ravel()[pixel[pixel >= 0]]
        spans[number] = of_rays.min(), of_rays.max()
        moments[slots] = np.where(pixel >= 0, times.ravel()[pixel], spans[number].mean())
        # Lanes without a ray point forward, so that no number is infinite.
        forward = [component(np.eye(3), axes[2])] * len(pixel)
        directions[:, slots] = np.where(pixel >= 0, camera.rays.reshape(-1, 3)[pixel].T, np.transpose(forward))
    for name, array in (("directions", directions), ("times", moments), ("spans", spans)):
        setattr(struct, name, wp.array(array, dtype=wp.float64, device="cpu"))
    if origins is not None:
        struct.origins = wp.array(
            np.where(place >= 0, origins.reshape(-1, 3)[place].T, 0.0), dtype=wp.float32, device="cpu"
        )
    return PreparedMovingRays(prepared, struct)
