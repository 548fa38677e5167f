# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Margins of visibility: how far targets and points are from being hidden, or from being seen."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, get_args

import warp as wp

from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import as_points, check_length, empty
from warpvis.core.checks import check_choice, check_number
from warpvis.core.kernel_cache import launch
from warpvis.core.pose_order import warn_of_order
from warpvis.core.poses import Convention, QuaternionOrder
from warpvis.core.threads import check_threads, launch_images, launch_points
from warpvis.core.types import ArrayInput, Excluded, KernelArguments, ObjectPoses, ObjectScales, PoseLike
from warpvis.errors import CameraError
from warpvis.rendering import CasterName, NearPlane, Renderer
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import part_of
from warpvis.visibility._fractions import FractionMeter, Targets
from warpvis.visibility._world_views import parse_world_views

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.pinhole import Window
    from warpvis.kernels.visibility.nearest_pixels import Search

_MAX_REACH = 1024
# Keys number the samples of a canvas with 28 bits.
_MAX_CANVAS = 1 << 28
# Maximum size of the images of a batch of views [bytes].
_CPU_BYTES, _CUDA_BYTES = 1 << 26, 1 << 30
# Threads of a GPU that share a target in a view.
_CUDA_THREADS = 64


@dataclass(frozen=True)
class VisibilityMargins:
    """Distances of K targets or points in V views from the nearest change of their visibility.

    `wp.array`s on the scene's device, indexed ``[view, target]``. Values are positive for what is visible, negative for
    what is hidden, and NaN without an answer; see `visibility_margins`. With poses of shape ``(W, M, ...)``, V is
    then W, M.
    """

    names: tuple[str, ...]
    """Names of the targets; empty for points."""
    pixels: wp.array
    """Distance in the image [px], from ``-reach`` to ``reach``, ``(V, K)`` float32."""
    degrees: wp.array
    """The same distance as an angle between two rays of the camera, in degrees; +inf or -inf where no pixel within
    reach decides, ``(V, K)`` float32."""
    meters: wp.array
    """The least distance by which the blocker has to move sideways at its depth [m], or, if it is the image border, the
    target at its own depth. A blocker mostly has to move farther to hide a target, because it uncovers a part.
    +inf or -inf where no pixel within reach decides, ``(V, K)`` float32."""
    blocker: wp.array
    """Index of the object that hides the target, or that is the nearest to doing so; -1 for the image border and where
    no pixel within reach decides, ``(V, K)`` int32."""


class MarginMeter:
    """Measures margins of the same targets in repeated calls; one thread may use it at a time."""

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        *,
        objects: Targets | None = None,
        reach: float = 32.0,
        min_samples: int = 256,
        near_plane: NearPlane = "occlude",
        cull_backfaces: bool = False,
        caster: CasterName = "auto",
        threads: int | None = None,
    ) -> None:
        """Set up the meter; arguments as for `visibility_margins`."""
        rays: dict[str, Any] = {"near_plane": near_plane, "cull_backfaces": cull_backfaces}
        rays |= {"caster": caster, "threads": threads}
        self._images = _Images(scene, camera, reach, **rays)
        sides = (math.ceil(self._images.reach),) * 4
        self._fractions = FractionMeter(
            scene, camera, objects=objects, canvas=sides, min_samples=min_samples, occluders=0, **rays
        )
        self.names = self._fractions.names

    def measure(
        self,
        camera_to_world: PoseLike,
        *,
        object_poses: ObjectPoses = None,
        world_index: ArrayInput | None = None,
        exclude: Excluded = None,
        object_scales: ObjectScales = None,
        convention: Convention = "opencv",
        quaternion: QuaternionOrder = "xyzw",
    ) -> VisibilityMargins:
        """Measure the targets in views; arguments as for `visibility_margins`."""
        moved = object_poses, world_index, exclude, object_scales
        views = parse_world_views(self._images.scene, camera_to_world, *moved, convention, quaternion)
        return self.measure_parsed(views.poses, views.worlds, views.shape)

    def measure_parsed(self, poses: wp.array, worlds: Worlds, shape: tuple[int, ...] = ()) -> VisibilityMargins:
        """Measure the targets at parsed poses in parsed worlds; results have a leading shape, by default ``(V,)``."""
        from warpvis.kernels.visibility.margins import NO_HIDDEN, NO_VISIBLE, judge_margins, measure_margins

        images, fractions = self._images, self._fractions
        device = images.scene.device
        fractions.follow_scene()
        scenes = [images.scene.triangles().struct, fractions._isolated.triangles().struct]
        geometry = [*scenes, fractions._targets, fractions._device_camera]
        sampling = fractions._sampling
        sampling.threads = 1 if device.is_cpu else _CUDA_THREADS
        spread = fractions._frames.spread(worlds)
        results, blockers = _allocate(len(poses), len(self.names), device)
        for part, search in images.render(poses, worlds):
            size = (part.stop - part.start, len(self.names))
            inputs = [sampling, part_of(worlds, part), part_of(spread, part), search]
            keys = wp.empty((2, *size), dtype=wp.int64, device=device)
            keys[0].fill_(NO_VISIBLE)
            keys[1].fill_(NO_HIDDEN)
            eyes, outs = poses[part], (results[:, part], blockers[part])
            for hidden_only in (0, 1):
                search.hidden_only = hidden_only

                def arguments(window: Window) -> KernelArguments:
                    return [*geometry, eyes, window, *inputs, keys[0], keys[1]]  # noqa: B023 - called at once

                dim = (*size, sampling.threads)
                launch_images(measure_margins, dim, arguments, device=device, threads=images.threads, min_pixels=1)
            launch(judge_margins, size, [*geometry, eyes, *inputs, keys, *outs], device)
        return _as_margins(self.names, results, blockers, shape or (len(poses),))


class _Images:
    """Renders the images in which margins are measured."""

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        reach: float,
        caster: CasterName,
        threads: int | None,
        near_plane: NearPlane = "occlude",
        cull_backfaces: bool = False,
    ) -> None:
        require_scene(scene).require_objects()
        if not isinstance(camera, Camera):
            raise CameraError(f"camera must be a warpvis.Camera, got {type(camera).__name__}")
        self.scene, self.camera, self.threads = scene, camera, check_threads(threads)
        self.reach = check_number(reach, "reach", minimum=1, maximum=_MAX_REACH)
        border = 2 * math.ceil(self.reach)
        if (camera.width + border) * (camera.height + border) > _MAX_CANVAS:
            raise CameraError(
                f"camera must have at most {_MAX_CANVAS} pixels with `reach` on all sides, got {camera.width} x "
                f"{camera.height} and {reach:g}"
            )
        # Surfaces outside the depth range occlude too, but for those that the near plane cuts away.
        clips = check_choice(near_plane, "near_plane", get_args(NearPlane)) == "clip"
        eye = replace(camera, near=camera.near if clips else 0.0, far=math.inf)
        self._renderer = Renderer(
            scene,
            eye,
            outputs=("depth", "segmentation"),
            near_plane=near_plane,
            cull_backfaces=cull_backfaces,
            caster=caster,
            threads=threads,
        )

    def render(self, poses: wp.array, worlds: Worlds) -> Iterator[tuple[slice, Search]]:
        """Yield the views in batches, with the images of each; the next batch overwrites them."""
        from warpvis.kernels.visibility.nearest_pixels import TILE_SIDE, Search, bound_depth_tiles

        height, width, device = self.camera.height, self.camera.width, self.scene.device
        step = max(1, (_CPU_BYTES if device.is_cpu else _CUDA_BYTES) // (8 * height * width))
        search = Search()
        search.reach = self.reach
        for start in range(0, len(poses), step):
            part = slice(start, min(start + step, len(poses)))
            seen = self._renderer.render_parsed(poses[part], part_of(worlds, part))
            shape = (part.stop - start, -(-height // TILE_SIDE), -(-width // TILE_SIDE))
            search.depth, search.segmentation = seen.depth, seen.segmentation
            search.tiles = wp.empty(shape, dtype=wp.vec2, device=device)
            launch(bound_depth_tiles, shape, [seen.depth, search.tiles], device)
            yield part, search


def _allocate(views: int, count: int, device: wp.Device) -> tuple[wp.array, wp.array]:
    """Allocate results, ``(3, views or 1, count or 1)``, and blockers; Warp cannot slice an empty array."""
    results = empty((3, max(1, views), max(1, count)), wp.float32, name="results", device=device)
    return results, empty((views, count), wp.int32, name="blocker", device=device)


def _as_margins(
    names: tuple[str, ...], results: wp.array, blockers: wp.array, shape: tuple[int, ...]
) -> VisibilityMargins:
    if blockers.size:
        rows = [results[row] for row in range(3)]
    else:
        rows = [wp.empty(blockers.shape, dtype=wp.float32, device=results.device)] * 3
    arrays = [array.reshape((*shape, blockers.shape[1])) for array in (*rows, blockers)]
    pixels, degrees, meters, blocker = arrays
    return VisibilityMargins(names, pixels, degrees, meters, blocker)


def visibility_margins(
    scene: Scene,
    camera: Camera,
    camera_to_world: PoseLike,
    *,
    objects: Targets | None = None,
    reach: float = 32.0,
    min_samples: int = 256,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Excluded = None,
    object_scales: ObjectScales = None,
    near_plane: NearPlane = "occlude",
    cull_backfaces: bool = False,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    caster: CasterName = "auto",
    threads: int | None = None,
) -> VisibilityMargins:
    """Measure how far each object is from being hidden, or from being seen, in pixels, degrees and meters.

    A visible object is hidden when its last visible sample is: its margin is the largest distance of a visible sample
    from the nearest blocked pixel, which is outside the image, or shows another object nearer than the sample. A hidden
    object is seen when its first sample is: its margin is minus the smallest distance of a hidden sample from the
    nearest free pixel, which is in the image and shows nothing nearer than the sample. Samples are those of
    `visible_fractions` with the same `min_samples`, and distances are between centers of pixels: surfaces end up to one
    pixel before or after.

    Everything nearer than the object counts, as a table in front of a cup does, which would hide the cup if it were
    higher. Surfaces beyond the depth range hide nothing and reveal nothing. An object without samples in the depth
    range on a canvas of `reach` pixels around the image has the margin ``-reach``. It is NaN if the view excludes the
    object, or if no sample meets it although its box is in the image.

    For repeated calls, use a `MarginMeter`. Nothing is copied to the host.

    Args:
        scene: The scene.
        camera: Image size, intrinsics and depth range of all views.
        camera_to_world: Poses, as for `visible_fractions`; those of cameras in worlds, too.
        objects: The targets, as for `visible_fractions`; a list of objects is measured as one. All objects by default.
        reach: Maximum distance of the search, from 1 to 1024 px.
        min_samples: As for `visible_fractions`.
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: As for `visible_fractions`.
        object_scales: As for `Renderer.render`.
        near_plane: As for `visible_fractions`.
        cull_backfaces: As for `Renderer`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        caster: As for `Renderer`, for the images; other rays are cast one by one.
        threads: CPU threads to use; all cores of this process by default.
    """
    meter = MarginMeter(
        scene,
        camera,
        objects=objects,
        reach=reach,
        min_samples=min_samples,
        near_plane=near_plane,
        cull_backfaces=cull_backfaces,
        caster=caster,
        threads=threads,
    )
    moved = object_poses, world_index, exclude, object_scales
    views = parse_world_views(scene, camera_to_world, *moved, convention, quaternion)
    if scene.device.is_cpu and quaternion == "xyzw" and len(views.poses):
        warn_of_order(views.given, convention)
    return meter.measure_parsed(views.poses, views.worlds, views.shape)


def point_margins(
    scene: Scene,
    camera: Camera,
    camera_to_world: PoseLike,
    points: ArrayInput,
    *,
    reach: float = 32.0,
    tolerance: float = 1e-4,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Excluded = None,
    object_scales: ObjectScales = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    caster: CasterName = "auto",
    threads: int | None = None,
) -> VisibilityMargins:
    """Measure how far the answers of `point_visibility` are from another answer, in pixels, degrees and meters.

    As `visibility_margins`, for points ``[view, point]``. Pixels that show the object whose surface the point is on,
    within `tolerance`, do not block the point. Points that are out of the depth range, or more than `reach` pixels from
    the image, have the margin ``-reach``.

    Args:
        scene: The scene.
        camera: Image size, intrinsics and depth range of all views.
        camera_to_world: Poses, as for `visible_fractions`; those of cameras in worlds, too.
        points: Points in the world frame [m], shape ``(N, 3)``.
        reach: Maximum distance of the search, from 1 to 1024 px.
        tolerance: As for `point_visibility` [m].
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: As for `visible_fractions`.
        object_scales: As for `Renderer.render`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        caster: As for `Renderer`, for the images; other rays are cast one by one.
        threads: CPU threads to use; all cores of this process by default.
    """
    from warpvis.kernels.visibility.fractions import Targets as DeviceTargets
    from warpvis.kernels.visibility.margins import measure_point_margins

    images = _Images(scene, camera, reach, caster, threads)
    tolerance, device = check_length(tolerance, "tolerance"), scene.device
    moved = object_poses, world_index, exclude, object_scales
    views = parse_world_views(scene, camera_to_world, *moved, convention, quaternion)
    poses, worlds = views.poses, views.worlds
    places = as_points(points, "points", "N", device)
    results, blockers = _allocate(len(poses), len(places), device)
    geometry = [scene.triangles().struct, DeviceTargets(), camera.device_struct()]
    for part, search in images.render(poses, worlds) if len(places) else ():
        inputs = [part_of(worlds, part), places, tolerance, search, results[:, part], blockers[part]]

        def arguments(window: Window) -> KernelArguments:
            return [*geometry, poses[part], window, *inputs]  # noqa: B023 - called at once

        shape = (part.stop - part.start, len(places))
        launch_points(measure_point_margins, shape, arguments, device=device, threads=threads)
    return _as_margins((), results, blockers, views.shape)
