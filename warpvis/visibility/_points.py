# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visibility of points in the world, to a camera in a scene or in a measured depth image."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.depth_images import read_images
from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import as_points, check_length, empty
from warpvis.core.checks import check_flag
from warpvis.core.kernel_cache import launch
from warpvis.core.labels import Visibility
from warpvis.core.poses import Convention, QuaternionOrder, host_poses, parse_poses, poses_to_matrices, to_xyzw
from warpvis.core.threads import check_threads, launch_points
from warpvis.core.types import ArrayInput, DeviceLike, Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError
from warpvis.maps import OccupancyMap
from warpvis.rendering import CasterName, Output, Renderer, choose_caster, render_along
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds, part_of
from warpvis.visibility._measured_space import MeasuredSpace, as_space, judge_points
from warpvis.visibility._point_packets import judge_by_packets

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds

# Maximum number of points per batch: projected points take 200 bytes each.
_MAX_BATCH = 1 << 20

Floats = NDArray[np.float64]


def point_visibility(
    scene: Scene | OccupancyMap,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    points: ArrayInput,
    *,
    tolerance: float = 1e-4,
    occluders: bool = False,
    occupancy: OccupancyMap | MeasuredSpace | None = None,
    unknown: bool = False,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    caster: CasterName = "auto",
    threads: int | None = None,
) -> wp.array | tuple[wp.array, ...]:
    """Return whether points are visible, and if not, why, by casting a ray through each point.

    Args:
        scene: The scene whose surfaces may hide the points; or an `OccupancyMap` instead of it.
        camera: Image size, intrinsics and depth range; or a `warpvis.cameras.LensCamera`, through which points are
            projected on the host.
        camera_to_world: Poses, as for `Renderer.render`.
        points: Points in the world frame [m], shape ``(N, 3)``: any points, such as vertices, face centers or voxels.
        tolerance: Maximum distance of a visible point behind the first surface along its ray [m]. Must be positive for
            points of a surface, which are not exactly at the intersection with their ray.
        occluders: Whether to also return the objects that hide the points.
        occupancy: A map of measured space that may hide the points, too, or a `MeasuredSpace`, on the scene's device.
        unknown: Whether to also return the fraction of each line of sight that was never measured.
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        caster: As for `Renderer`.
        threads: CPU threads to use; all cores of this process by default.

    Returns:
        A `Visibility` for every view and point, shape ``(V, N)`` uint8, on the scene's device. Surfaces nearer than the
        camera's ``near`` occlude too. With `occluders`, also the object that hides each `Visibility.OCCLUDED` point, -1
        for other points and for those that the map hides, shape ``(V, N)`` int32. With `unknown`, also the fractions,
        NaN for points that are not visible without the map, shape ``(V, N)`` float32.
    """
    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    require_image_camera(camera)
    tolerance = check_length(tolerance, "tolerance")
    occluders = check_flag(occluders, "occluders")
    hidden_by: wp.array | None = None
    if isinstance(scene, OccupancyMap):
        if occupancy is not None or occluders or object_poses is not None or exclude is not None:
            raise ArrayError(
                "scene must be a warpvis.Scene for occluders, object_poses, exclude and occupancy, got an OccupancyMap"
            )
        space = as_space(scene, scene.device)
        status = _judge_in_view(camera, camera_to_world, convention, points, scene.device, threads)
    else:
        space = as_space(occupancy, require_scene(scene).device)
        scene.require_objects()
        arrangement = {"object_poses": object_poses, "world_index": world_index, "exclude": exclude}
        inputs = camera_to_world, convention, points, arrangement, tolerance, occluders, caster, threads
        if camera.ray_model == "table":
            status, hidden_by = _judge_by_lens(scene, camera, *inputs)
        else:
            status, hidden_by = _judge_by_pinhole(scene, camera, *inputs)
    share = (
        empty(status.shape, wp.float32, name="unknown", device=status.device)
        if check_flag(unknown, "unknown")
        else None
    )
    if space is not None:
        poses = parse_poses(camera_to_world, convention=convention, device=status.device)
        judge_points(space, poses, as_points(points, "points", "N", status.device), status, share, threads)
    elif share is not None:
        raise ArrayError("unknown must be False without an occupancy map")
    results = [status, *(extra for extra in (hidden_by, share) if extra is not None)]
    return tuple(results) if len(results) > 1 else status


def _judge_in_view(
    camera: ImageCamera,
    camera_to_world: PoseLike,
    convention: Convention,
    points: ArrayInput,
    device: wp.Device,
    threads: int | None,
) -> wp.array:
    """Return the status of points in empty space: VISIBLE, OUT_OF_VIEW, TOO_NEAR or TOO_FAR."""
    from warpvis.kernels.visibility.points import judge_points

    poses = parse_poses(camera_to_world, convention=convention, device=device)
    if camera.ray_model == "table":
        places = as_points(points, "points", "N", device).numpy().astype(np.float64)
        projected = project_points(camera, poses.numpy(), places)
        return wp.array(projected.judge(camera, np.array(np.inf), 0.0), dtype=wp.uint8, device=device)
    pixels, depth = _project(camera, poses, points, threads)
    surface = wp.full(depth.shape, np.inf, dtype=wp.float32, device=device)
    status, _ = _empty_judgment(depth.shape, False, device)
    lens, inputs = camera.device_struct(), [pixels, depth, surface, None, 0.0, status, None]
    launch_points(judge_points, depth.shape, lambda window: [lens, window, *inputs], device=device, threads=threads)
    return status


def _judge_by_lens(
    scene: Scene,
    camera: LensCamera,
    camera_to_world: PoseLike,
    convention: Convention,
    points: ArrayInput,
    arrangement: dict[str, Any],
    tolerance: float,
    occluders: bool,
    caster: CasterName,
    threads: int | None,
) -> tuple[wp.array, wp.array | None]:
    """Return the status of points in a scene, and their occluders if requested."""
    rows = parse_poses(camera_to_world, convention=convention, device=scene.device).numpy()
    places = as_points(points, "points", "N", scene.device).numpy()
    worlds = parse_worlds(scene, len(rows), **arrangement)
    judged, hiding = judge_in_scene(
        scene, camera, rows, worlds, places, tolerance, occluders=occluders, caster=caster, threads=threads
    )
    status = wp.array(judged, dtype=wp.uint8, device=scene.device)
    return status, None if hiding is None else wp.array(hiding, dtype=wp.int32, device=scene.device)


def _judge_by_pinhole(
    scene: Scene,
    camera: Camera,
    camera_to_world: PoseLike,
    convention: Convention,
    points: ArrayInput,
    arrangement: dict[str, Any],
    tolerance: float,
    occluders: bool,
    caster: CasterName,
    threads: int | None,
) -> tuple[wp.array, wp.array | None]:
    """Return the status of points in a scene, and their occluders if requested."""
    if scene.device.is_cpu and choose_caster(caster, camera) == "packets":
        rows = host_poses(camera_to_world, convention=convention)
        places = as_points(points, "points", "N", scene.device)
        status, hidden_by = _empty_judgment((len(rows), len(places)), occluders, scene.device)
        worlds = parse_worlds(scene, len(rows), **arrangement)
        judge_by_packets(scene, camera, rows, worlds, places, tolerance, status, hidden_by, check_threads(threads))
    else:
        from warpvis.kernels.visibility.points import judge_points

        poses = parse_poses(camera_to_world, convention=convention, device=scene.device)
        pixels, depth = _project(camera, poses, points, threads)
        status, hidden_by = _empty_judgment(depth.shape, occluders, scene.device)
        # With near = 0, surfaces that are too near have a finite depth and an object.
        eye = dataclasses.replace(camera, near=0.0)
        outputs: list[Output] = ["depth", "segmentation"] if occluders else ["depth"]
        renderer = Renderer(scene, eye, outputs=outputs, caster=caster, threads=threads)
        if depth.size:
            seen = renderer.render_at(poses, pixels, **arrangement)
            inputs = [pixels, depth, seen.depth, seen.segmentation, tolerance, status, hidden_by]
            lens, device = camera.device_struct(), scene.device
            launch_points(
                judge_points, depth.shape, lambda window: [lens, window, *inputs], device=device, threads=threads
            )
    return status, hidden_by


def point_visibility_from_depth(
    depth: ArrayInput,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    points: ArrayInput,
    *,
    tolerance: float = 0.01,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    device: DeviceLike = None,
    threads: int | None = None,
) -> wp.array:
    """Return whether points are visible in measured depth images, and if not, why, from the pixel of each point.

    Args:
        depth: Depth of the camera's kind [m], planar for a pinhole, shape ``(V, H, W)`` float32, or ``(H, W)`` for one
            view. +inf, or a finite depth beyond the camera's `far`, means that there is no surface up to `far`; -inf,
            or a depth between 0 and `near`, a surface nearer than `near`, which hides all points behind it (REP 117).
            0, negative values and NaN are not measured. Host arrays that clearly contain millimeters are rejected;
            arrays on a GPU are not checked.
        camera: The camera of the images: a pinhole, or a `warpvis.cameras.LensCamera`.
        camera_to_world: Poses of the camera, as for `Renderer.render`.
        points: Points in the world frame [m], shape ``(N, 3)``.
        tolerance: Maximum distance of a visible point behind the measured surface along its ray [m], to allow for the
            sensor's noise.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        device: Device of the computation; by default the device of the images.
        threads: CPU threads to use; all cores of this process by default.

    Returns:
        A `Visibility` for every view and point, shape ``(V, N)`` uint8; UNKNOWN where nothing was measured.
    """
    from warpvis.kernels.visibility.points import judge_points_measured

    tolerance = check_length(tolerance, "tolerance")
    images, poses = read_images(depth, camera, camera_to_world, convention, quaternion, device)
    device = images.device
    if camera.ray_model == "table":
        places = as_points(points, "points", "N", device).numpy()
        judged = judge_in_images(images.numpy(), camera, poses.numpy(), places, tolerance)
        return wp.array(judged, dtype=wp.uint8, device=device)
    pixels, distance = _project(camera, poses, points, threads)
    status = empty(distance.shape, wp.uint8, name="status", device=device)
    lens, inputs = camera.device_struct(), [pixels, distance, images, tolerance, status]
    launch_points(
        judge_points_measured, distance.shape, lambda window: [lens, window, *inputs], device=device, threads=threads
    )
    return status


def _project(camera: Camera, poses: wp.array, points: ArrayInput, threads: int | None) -> tuple[wp.array, wp.array]:
    """Project points; return their image positions, vec2 of shape ``(V, N)``, and depths, shape ``(V, N)``."""
    from warpvis.kernels.visibility.points import camera_frames, project_points

    device = poses.device
    places = as_points(points, "points", "N", device)
    frames = [wp.empty(len(poses), dtype=dtype, device=device) for dtype in (wp.vec3d, wp.mat33d)]
    launch(camera_frames, len(poses), [poses, *frames], device)
    shape = (len(poses), len(places))
    pixels, depth = (empty(shape, dtype, name="points", device=device) for dtype in (wp.vec2, wp.float32))
    lens = camera.device_struct()
    launch_points(
        project_points,
        shape,
        lambda window: [lens, *frames, window, places, pixels, depth],
        device=device,
        threads=threads,
    )
    return pixels, depth


def _empty_judgment(shape: tuple[int, ...], occluders: bool, device: wp.Device) -> tuple[wp.array, wp.array | None]:
    status = empty(shape, wp.uint8, name="status", device=device)
    return status, empty(shape, wp.int32, name="occluders", device=device) if occluders else None


@dataclass(frozen=True)
class ProjectedPoints:
    """Projections of N points into V views."""

    pixels: Floats
    """Image positions [px], ``(V, N, 2)``; NaN where a point is not in the image."""
    depth: Floats
    """Depth of the camera's kind [m], ``(V, N)``."""
    rays: Floats
    """Rays of depth 1 from the camera to the points, ``(V, N, 3)``; NaN where a point is not in the image."""

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether points are in the image, ``(V, N)``."""
        return np.isfinite(self.pixels[..., 0])

    def judge(self, camera: LensCamera, surface: NDArray[np.floating], tolerance: float) -> NDArray[np.uint8]:
        """Return the `Visibility` of points given surface depths, as `warpvis.kernels.visibility.points.judge` does."""
        with np.errstate(invalid="ignore"):
            behind = (self.depth - surface) * np.linalg.norm(self.rays, axis=-1) > tolerance
        status = np.where(behind, Visibility.OCCLUDED, Visibility.VISIBLE)
        status = np.where(self.depth > camera.far, Visibility.TOO_FAR, status)
        status = np.where(self.depth < camera.near, Visibility.TOO_NEAR, status)
        return np.where(self.inside, status, Visibility.OUT_OF_VIEW).astype(np.uint8)


def project_points(camera: LensCamera, poses: NDArray[np.float32], points: Floats) -> ProjectedPoints:
    """Project points in the world [m], ``(N, 3)``, into views at `poses`, rows ``(V, 7)`` of `host_poses`."""
    matrices = poses_to_matrices(poses.astype(np.float64))
    local_points = np.einsum("vij,vni->vnj", matrices[:, :3, :3], points - matrices[:, None, :3, 3])
    depth = local_points[..., 2] if camera.kind == "z" else np.linalg.norm(local_points, axis=-1)
    pixels = camera.project(local_points)
    inside = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=-1) & (depth > 0)
    with np.errstate(all="ignore"):
        rays = np.where(inside[..., None], local_points / depth[..., None], np.nan)
    return ProjectedPoints(np.where(inside[..., None], pixels, np.nan), depth, rays)


def judge_in_scene(
    scene: Scene,
    camera: LensCamera,
    poses: NDArray[np.float32],
    worlds: Worlds,
    points: NDArray[np.float32],
    tolerance: float,
    *,
    occluders: bool,
    caster: CasterName,
    threads: int | None,
) -> tuple[NDArray[np.uint8], NDArray[np.int32] | None]:
    """Compute the visibility of points in a scene, and their occluders; see `warpvis.point_visibility`."""
    # With near = 0, surfaces that are too near have a finite depth and an object.
    outputs: list[Output] = ["depth", "segmentation"] if occluders else ["depth"]
    eye = replace(camera, near=0.0)
    choose_caster(caster, eye)
    threads = check_threads(threads)
    shape = (len(poses), len(points))
    status = np.empty(shape, dtype=np.uint8)
    hidden_by = np.full(shape, -1, dtype=np.int32) if occluders else None
    for views, batch in _batches(*shape):
        projected = project_points(camera, poses[views], points[batch].astype(np.float64))
        rows = wp.array(np.ascontiguousarray(poses[views]), dtype=wp.transform, device=scene.device)
        rays = wp.array(projected.rays, dtype=wp.vec3d, device=scene.device)
        seen = render_along(scene, eye, rows, part_of(worlds, views), rays, outputs=outputs, threads=threads)
        judged = projected.judge(camera, seen.depth.numpy(), tolerance)
        status[views, batch] = judged
        if hidden_by is not None:
            hidden_by[views, batch] = np.where(judged == Visibility.OCCLUDED, seen.segmentation.numpy(), -1)
    return status, hidden_by


def judge_in_images(
    depth: NDArray[np.float32],
    camera: LensCamera,
    poses: NDArray[np.float32],
    points: NDArray[np.float32],
    tolerance: float,
) -> NDArray[np.uint8]:
    """Compute the visibility of points in depth images; see `warpvis.point_visibility_from_depth`."""
    status = np.empty((len(poses), len(points)), dtype=np.uint8)
    for views, batch in _batches(*status.shape):
        projected = project_points(camera, poses[views], points[batch].astype(np.float64))
        columns, rows = np.moveaxis(np.where(projected.inside[..., None], projected.pixels, 0).astype(np.int64), -1, 0)
        surface = depth_in_range(camera, depth[np.arange(len(depth))[views, None], rows, columns])
        judged = projected.judge(camera, surface, tolerance)
        in_range = (judged == Visibility.VISIBLE) | (judged == Visibility.OCCLUDED)
        status[views, batch] = np.where(in_range & np.isnan(surface), Visibility.UNKNOWN, judged)
    return status


def depth_in_range(camera: LensCamera, depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return depth as in REP 117: -inf nearer than near, +inf beyond far, and NaN where nothing was measured."""
    near, far, infinity = np.float32(camera.near), np.float32(camera.far), np.float32(np.inf)
    with np.errstate(invalid="ignore"):
        clamped = np.where(depth < near, -infinity, np.where(depth > far, infinity, depth))
        return np.where((depth > 0) | (depth == -infinity), clamped, np.float32(np.nan))


def _batches(views: int, points: int) -> Iterator[tuple[slice, slice]]:
    """Yield slices of views and points, at most `_AT_ONCE` pairs each."""
    max_points = max(1, min(points, _MAX_BATCH))
    step = max(1, _MAX_BATCH // max_points)
    for first in range(0, views, step):
        for start in range(0, points, max_points):
            yield slice(first, min(first + step, views)), slice(start, min(start + max_points, points))
