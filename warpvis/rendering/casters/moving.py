# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors and objects that move within a frame: single rays are cast from the sensor's pose at each ray's time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from warpvis.cameras.base import AnyCamera
from warpvis.core.kernel_cache import launch
from warpvis.core.motion import Motion, check_times, instants_of, stacked
from warpvis.core.poses import Convention, check_convention, parse_poses, vectors_in_axes
from warpvis.core.threads import launch_images
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, ObjectScales, PoseLike
from warpvis.errors import ArrayError, CameraError, PoseError
from warpvis.rendering.casters.base import CastOptions, ImagesByName, ViewBatch, images_struct
from warpvis.rendering.casters.moving_packets_cpu import MovingPackets
from warpvis.rendering.casters.moving_packets_cuda import CudaMovingPackets
from warpvis.rendering.casters.rays import RaysCaster, rays_on_device
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_moving_poses, parse_worlds

if TYPE_CHECKING:
    from warpvis.kernels.casting.motions import Motion as MotionStruct, TimedRays
    from warpvis.kernels.casting.worlds import Worlds


@dataclass(frozen=True)
class MovingPoses:
    """Motions of views and of objects, on a device."""

    sensor: MotionStruct
    objects: MotionStruct | None
    views: int
    own_worlds: bool
    """Whether each view has a separate world, without `world_index`."""

    @classmethod
    def at_rest(cls, poses: wp.array) -> MovingPoses:
        """Return the motion of views that do not move, transforms of shape ``(V,)``."""
        return cls(_struct_of(poses.reshape((1, poses.shape[0], 1))), None, poses.shape[0], False)

    def with_objects_at_rest(self, worlds: Worlds) -> MovingPoses:
        """Return the same motion of the sensor, with the objects of worlds as objects that do not move."""
        poses = worlds.object_poses
        objects = _struct_of(poses.reshape((1, *poses.shape)))
        return replace(self, objects=objects, own_worlds=worlds.world is None and poses.shape[0] > 1)

    def __len__(self) -> int:
        """Return the number of views."""
        return self.views

    def __getitem__(self, part: slice) -> MovingPoses:
        """Return the motions of a slice of the views."""
        views = len(range(*part.indices(self.views)))
        objects = _sliced(self.objects, part) if self.objects is not None and self.own_worlds else self.objects
        return replace(self, sensor=_sliced(self.sensor, part), objects=objects, views=views)


class MovingCaster(RaysCaster):
    """Cast with one thread per ray and one query of Warp's mesh per thread, from the pose at the time of the ray."""

    def __init__(self, scene: Scene, camera: AnyCamera, options: CastOptions, *, single_rays: bool = False) -> None:
        """Set up the caster; with `single_rays`, it never uses packets.

        Raises:
            CameraError: If the camera is orthographic.
        """
        if camera.ray_model == "parallel":
            raise CameraError(f"camera must be a pinhole, a lens or Rays for a Motion, got {type(camera).__name__}")
        super().__init__(scene, camera, options)
        make = MovingPackets if scene.device.is_cpu else CudaMovingPackets
        self._packets = None if single_rays else make(scene, camera, options)

    def __getstate__(self) -> dict[str, object]:
        """Return the state without device arrays."""
        return {name: value for name, value in self.__dict__.items() if name != "_rays"}

    def parse(
        self,
        camera_to_world: PoseLike | Motion,
        object_poses: ObjectPoses | Motion,
        convention: Convention | None,
        world_index: ArrayInput | None,
        exclude: Excluded,
        object_scales: ObjectScales,
    ) -> ViewBatch:
        """Check the arguments of a call of `Renderer.render` with at least one `Motion`.

        Raises:
            WarpvisError: If an argument is invalid.
        """
        sensor, views = parse_sensor(self._camera, camera_to_world, convention, self._scene.device)
        if not isinstance(object_poses, Motion):
            worlds = parse_worlds(self._scene, views, object_poses, world_index, exclude, object_scales)
            return ViewBatch(MovingPoses(sensor, None, views, False), worlds)
        instants = instants_of(object_poses)
        worlds = parse_worlds(self._scene, views, instants[0], world_index, exclude, object_scales)
        starts = camera_to_world.starts if isinstance(camera_to_world, Motion) else None
        objects = self._parse_objects(object_poses, starts)
        own_worlds = world_index is None and objects.legs.shape[1] > 1
        return ViewBatch(MovingPoses(sensor, objects, views, own_worlds), worlds)

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write images of all views, whose poses are `MovingPoses`."""
        if not views.count or self._packets is None or not self._packets.takes(views):
            self._cast_single_rays(views, images)
            return
        poses, scene = views.poses, self._scene
        if poses.objects is None and scene.bvh().has_solids:  # packets of rays with distinct origins cannot show them
            views = ViewBatch(poses.with_objects_at_rest(views.worlds), views.worlds)
        objects = views.poses.objects
        if objects is not None and "depth" not in images:
            shape = (views.count, *self._camera.shape)
            images = {**images, "depth": wp.empty(shape, dtype=wp.float32, device=scene.device)}
        if isinstance(self._packets, CudaMovingPackets):
            touched, remaining = self._packets.cast_motion(self._rays, views, images), []
        else:
            left, bits = self._packets.cast_motion(poses.sensor, objects, views, images)
            remaining = np.flatnonzero(left).tolist()
            touched = None
            if bits is not None:
                touched = wp.array(bits.reshape(views.count, *self._image), dtype=wp.int32, device="cpu", copy=False)
        if touched is not None:
            self._cast_touched_rays(views, touched, images)
        for view in remaining:
            part = slice(view, view + 1)
            self._cast_single_rays(views.part(part), {name: image[part] for name, image in images.items()})

    def _cast_touched_rays(self, views: ViewBatch, touched: wp.array, images: ImagesByName) -> None:
        """Add movable objects to images of static geometry where rays may hit one."""
        from warpvis.kernels.casting.moving_objects import cast_touched_rays

        self._launch_rays(cast_touched_rays, views, [views.poses.objects], [touched], images)

    def _cast_single_rays(self, views: ViewBatch, images: ImagesByName) -> None:
        from warpvis.kernels.casting.moving_objects import cast_at_moving_objects
        from warpvis.kernels.casting.moving_rays import cast_moving_rays

        if views.poses.objects is None:
            self._launch_rays(cast_moving_rays, views, [], [], images)
        else:
            self._launch_rays(cast_at_moving_objects, views, [views.poses.objects], [], images)

    def _launch_rays(
        self,
        kernel: wp.Kernel,
        views: ViewBatch,
        objects: list[MotionStruct],
        bits: list[wp.array],
        images: ImagesByName,
    ) -> None:
        triangles = self._scene.triangles(faces="faces" in images).struct
        camera = self._camera.ray_range(clip_near=self._options.clip_near)
        rays = [self._rays, *bits, self._options.cull_backfaces, images_struct(images)]
        launch_images(
            kernel,
            (views.count, *self._image),
            lambda window: [triangles, camera, views.poses.sensor, window, views.worlds, *objects, *rays],
            device=self._scene.device,
            threads=self._options.threads,
        )

    def measure_incidence(self, views: ViewBatch, normals: wp.array, out: wp.array) -> None:
        """Write the cosine of incidence of every ray, times the length of the camera's ray."""
        from warpvis.kernels.casting.moving_rays import measure_moving_incidence

        self._launch_motion(measure_moving_incidence, views, [self._rays.directions, self._rays.times, normals, out])

    def back_project(self, views: ViewBatch, depth: wp.array, points: wp.array) -> None:
        """Write the world points of depths along rays, each at its time."""
        from warpvis.kernels.casting.moving_rays import back_project_moving

        self._launch_motion(back_project_moving, views, [self._rays, depth, points])

    def _launch_motion(self, kernel: wp.Kernel, views: ViewBatch, inputs: list[Any]) -> None:
        sensor, shape = views.poses.sensor, (views.count, *self._image)
        launch_images(
            kernel,
            shape,
            lambda window: [sensor, window, *inputs],
            device=self._scene.device,
            threads=self._options.threads,
        )

    def _parse_objects(self, motion: Motion, starts: np.ndarray | None) -> MotionStruct:
        if motion.starts is not None:
            raise ArrayError("starts must be given to the motion of camera_to_world, not to that of object_poses")
        if motion.of_rays:
            raise PoseError("object_poses must be a motion in time, got poses of rays")
        _check_rays_times(self._camera, motion, starts)
        return _struct_of(parse_moving_poses(self._scene, motion), motion)

    @cached_property
    def _rays(self) -> TimedRays:
        from warpvis.kernels.casting.motions import TimedRays

        camera, device, rays = self._camera, self._scene.device, TimedRays()
        rays.directions = rays_on_device(camera, device)
        if camera.origins is not None:
            rays.origins = rays_on_device(camera, device, "origins")
        if camera.times is not None:
            rays.times = wp.array(camera.times.reshape(self._image), dtype=wp.float64, device=device)
        return rays

    @property
    def _image(self) -> tuple[int, int]:
        return self._camera.height, self._camera.width


def parse_sensor(
    camera: AnyCamera, poses: PoseLike | Motion, convention: Convention | None, device: wp.Device
) -> tuple[MotionStruct, int]:
    """Return the motion of a sensor in the format of kernels, and the number of views.

    Raises:
        PoseError: If the poses are malformed.
        ArrayError: If the motion does not cover the times of all rays, or `starts` does not match the number of views.
        CameraError: If the sensor moves and the camera's rays have no times.
    """
    axes = camera.axes
    pose_axes = axes if convention is None else check_convention(convention)

    def parse(rows: PoseLike) -> wp.array:
        return parse_poses(rows, convention=pose_axes, axes=axes, device=device)

    if not isinstance(poses, Motion):
        constant_poses = parse(poses)
        return MovingPoses.at_rest(constant_poses).sensor, constant_poses.shape[0]
    if poses.of_rays:
        return _parse_poses_of_rays(camera.shape, poses, parse)
    instants = instants_of(poses)
    if isinstance(instants, np.ndarray):
        if instants.ndim not in (2, 3):
            raise PoseError(
                "camera_to_world must be a motion of views, with poses of shape (T, 7) or (T, V, 7), got "
                f"{instants.shape}"
            )
        parsed = parse(instants.reshape(-1, 7)).reshape((len(instants), -1))
    else:
        parsed = stacked([parse(part) for part in instants])
    _check_rays_times(camera, poses, poses.starts)
    views = parsed.shape[1]
    struct = _struct_of(
        parsed.reshape((*parsed.shape, 1)), poses, lambda vectors: vectors_in_axes(vectors, pose_axes, axes)
    )
    if poses.starts is not None:
        if views not in (1, len(poses.starts)):
            raise ArrayError(f"starts must have one value for each of {views} views, got {len(poses.starts)}")
        views = len(poses.starts)
        struct.starts = wp.array(poses.starts, dtype=wp.float64, device=device)
    return struct, views


def _parse_poses_of_rays(
    shape: tuple[int, ...], motion: Motion, parse: Callable[[PoseLike], wp.array]
) -> tuple[MotionStruct, int]:
    from warpvis.kernels.casting.motions import Motion as MotionStruct

    rows = instants_of(motion)
    assert isinstance(rows, np.ndarray)
    axes = rows.shape[1:-1]
    leading = axes if len(axes) == len(shape) + 1 else (1, *axes)
    if len(leading) != len(shape) + 1 or any(a not in (1, b) for a, b in zip(leading[1:], shape, strict=True)):
        raise PoseError(
            f"poses of rays must have shape (V, {', '.join(map(str, shape))}, 7), where an axis of rays may be 1, "
            f"got {(*axes, 7)}"
        )
    struct = MotionStruct()
    struct.poses = parse(rows.reshape(-1, 7)).reshape(leading if len(leading) == 3 else (leading[0], 1, leading[1]))
    return struct, leading[0]


def _check_rays_times(camera: AnyCamera, motion: Motion, starts: np.ndarray | None) -> None:
    times = camera.times
    if times is None:
        raise CameraError(
            "camera must have times of rays for a Motion. Set times of Rays, or use a warpvis.sensors.RollingShutter "
            "of the camera"
        )
    check_times(motion, times, np.zeros(1) if starts is None else starts)


def _struct_of(
    poses: wp.array, motion: Motion | None = None, rotate: Callable[[np.ndarray], np.ndarray] = np.asarray
) -> MotionStruct:
    """Return the kernels' struct of poses on a device, shape ``(T, rows, columns)``, and their motion.

    Args:
        poses: The poses.
        motion: Motion with the times or the twist of the poses; None if they are constant.
        rotate: Function that rotates velocities into the frame of the poses.
    """
    from warpvis.kernels.casting.motions import Leg, Motion as MotionStruct, begin_legs

    struct, device = MotionStruct(), poses.device
    twist = None if motion is None else motion.twist
    velocities: list[wp.array | None] = [None, None]
    if twist is not None:
        shape = (*poses.shape[1:], 3)
        velocities = [wp.array(rotate(part).reshape(shape), dtype=wp.vec3d, device=device) for part in twist]
    struct.is_screw = twist is not None
    struct.legs = wp.empty(poses.shape, dtype=Leg, device=device)
    launch(begin_legs, poses.shape, [poses, *velocities, struct.legs], device)
    if motion is not None and motion.times is not None:
        struct.times = wp.array(motion.times, dtype=wp.float64, device=device)
    return struct


def _sliced(struct: MotionStruct, part: slice) -> MotionStruct:
    """Return the motion of a slice of the views, or of their worlds; values shared by all views are kept."""
    from warpvis.kernels.casting.motions import Motion as MotionStruct

    sliced = MotionStruct()
    sliced.is_screw = struct.is_screw
    for name in ("legs", "times", "starts", "poses"):
        values = getattr(struct, name)
        if values is None or not values.size:
            continue
        if name == "legs" and values.shape[1] > 1:
            values = values[:, part]
        elif name == "starts" or (name == "poses" and values.shape[0] > 1):
            values = values[part]
        setattr(sliced, name, values)
    return sliced
