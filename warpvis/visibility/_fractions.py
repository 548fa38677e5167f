# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions of many objects in many views: only the pixels that an object may cover are cast."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import warp as wp

from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import aligned_zeros, check_out, empty, take_rows
from warpvis.core.checks import as_items, check_choice, check_flag, check_whole
from warpvis.core.kernel_cache import launch
from warpvis.core.pose_order import warn_of_order
from warpvis.core.poses import Convention, QuaternionOrder
from warpvis.core.threads import check_threads, launch_images, launch_shared, pack_launch, write_fields
from warpvis.core.types import ArrayInput, Excluded, KernelArguments, ObjectPoses, ObjectScales, PoseLike
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.kernels.constants import CUDA_LANES, FRACTION_COUNTERS, JOB_COUNTERS
from warpvis.rendering import CasterName, NearPlane, choose_caster
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import part_of
from warpvis.visibility._objects import check_canvas, choose_objects, warn_of_unseen
from warpvis.visibility._silhouettes import ObjectFrames
from warpvis.visibility._world_views import parse_world_views

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.pinhole import Window

Targets = Sequence[str | int | Sequence[str | int]] | Mapping[str, str | int | Sequence[str | int]]
"""Objects by name or index; a list of objects is measured as one; a dict names the targets."""

# Maximum size of the counters of a batch of views [bytes].
_CPU_BYTES, _CUDA_BYTES = 1 << 26, 1 << 30
_MAX_SAMPLES, _MAX_OCCLUDERS = 1 << 14, 64
# Fewer targets than this in a call are measured by the calling thread: waking another one takes longer.
_FEW_TARGETS = 8
# Threads of a GPU that share a target in a view, by rays; and by packets, the number of warps that fill it, and limits
# of the warps that share a target.
_CUDA_THREADS = 32
_CUDA_WARPS, _MIN_PARTS, _MAX_PARTS = 1 << 17, 4, 256
# Maximum number of objects with separate frames for packets on a GPU, which test all of them.
_MAX_OBJECTS = 1024
_RESULTS = {
    "fraction": wp.float32,
    "error": wp.float32,
    "image_share": wp.float32,
    "status": wp.uint8,
    "box": wp.vec4i,
    "visible_pixels": wp.int32,
    "silhouette_pixels": wp.int32,
}


@dataclass(frozen=True)
class ObjectFractions:
    """Visible fractions of K targets in V views: `wp.array`s on the scene's device, indexed ``[view, target]``.

    With poses of shape ``(W, M, ...)``, arrays are indexed ``[world, camera, target]``: V is then W, M.
    """

    names: tuple[str, ...]
    """Names of the targets."""
    fraction: wp.array
    """Visible share of the silhouette, ``(V, K)`` float32; 0 without a silhouette."""
    error: wp.array
    """Bound of the error of `fraction` that sampling causes, ``(V, K)`` float32; see `visible_fractions`."""
    image_share: wp.array
    """Share of the image that shows the target, ``(V, K)`` float32."""
    status: wp.array
    """`Visibility.VISIBLE` if any sample is visible, or the reason that applies to most samples in the image: OCCLUDED,
    TOO_NEAR, TOO_FAR, or OUT_OF_VIEW if there are none, ``(V, K)`` uint8."""
    box: wp.array
    """Bounding box of the visible pixels: x, y, width and height [px], all -1 if there are none, ``(V, K)`` vec4i."""
    visible_pixels: wp.array
    """Pixels whose centers show the target, ``(V, K)`` int32."""
    silhouette_pixels: wp.array
    """Pixels of the canvas whose centers show the target without other objects, ``(V, K)`` int32."""
    occluders: wp.array
    """Indices of the objects that hide most of the target, in descending order, -1 for none, ``(V, K, T)`` int32."""
    occluder_shares: wp.array
    """Share of the silhouette that each of them hides, ``(V, K, T)`` float32."""


class FractionMeter:
    """Measures visible fractions of the same targets in repeated calls; one thread may use it at a time."""

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        *,
        objects: Targets | None = None,
        canvas: tuple[int, int, int, int] | None = None,
        min_samples: int = 256,
        occluders: int = 3,
        near_plane: NearPlane = "occlude",
        cull_backfaces: bool = False,
        caster: CasterName = "auto",
        threads: int | None = None,
    ) -> None:
        """Set up the meter; arguments as for `visible_fractions`."""
        from warpvis.kernels.visibility.fraction_results import FractionResults
        from warpvis.kernels.visibility.fractions import Sampling, Targets as DeviceTargets

        require_scene(scene).require_objects()
        if not isinstance(camera, Camera):
            raise CameraError(
                f"camera must be a warpvis.Camera, got {type(camera).__name__}; object_visibility takes lenses"
            )
        self._scene, self._camera, self._device = scene, camera, scene.device
        self.names, groups = _parse_targets(scene, objects)
        min_samples = check_whole(min_samples, "min_samples")
        if min_samples > _MAX_SAMPLES:
            raise ArrayError(f"min_samples must be at most {_MAX_SAMPLES}, got {min_samples}")
        self._occluders = check_whole(occluders, "occluders", minimum=0)
        if self._occluders > _MAX_OCCLUDERS:
            raise ArrayError(f"occluders must be at most {_MAX_OCCLUDERS}, got {occluders}")
        self._threads = check_threads(threads)
        self._caster = choose_caster(caster, camera)
        self._targets = DeviceTargets()
        self._targets.first = wp.array(np.cumsum([0, *map(len, groups)]), dtype=wp.int32, device=self._device)
        self._members = members = [index for group in groups for index in group]
        self._targets.members = wp.array(members, dtype=wp.int32, device=self._device)
        self._read_scene()
        self._sampling, self._results = Sampling(), FractionResults()
        self._recorded: wp.Launch | None = None
        canvas_struct, (left, top, right, bottom) = self._sampling.canvas, check_canvas(canvas, camera)
        canvas_struct.x0, canvas_struct.y0 = -left, -top
        canvas_struct.x1, canvas_struct.y1 = camera.width + right, camera.height + bottom
        self._sampling.min_samples = min_samples
        self._sampling.cull_backfaces = check_flag(cull_backfaces, "cull_backfaces")
        clips = check_choice(near_plane, "near_plane", get_args(NearPlane)) == "clip"
        self._device_camera = camera.device_struct(clip_near=clips)
        size = {"width": camera.width + left + right, "height": camera.height + top + bottom}
        on_canvas = replace(camera, cx=camera.cx + left, cy=camera.cy + top, **size).device_struct(clip_near=clips)
        self._device_camera.clip_reach = on_canvas.clip_reach
        self._clips = self._device_camera.clip_reach > 0

    def _read_scene(self) -> None:
        """Prepare for the current objects, each of which has a frame in `isolated`."""
        self._objects, self._isolated = self._scene.objects, self._scene.isolated()
        isolated, objects = self._isolated, self._objects
        # Only the shapes of targets are read from `isolated`.
        self._deforms = any(objects[index].points is not None for index in self._members)
        self._frames = ObjectFrames(self._scene, isolated)
        boxes = isolated.bvh().struct.movable_boxes
        self._targets.boxes = boxes.reshape((-1, 3)).view(wp.vec3).reshape((-1, 2))
        self._workspaces: dict[int, _Workspace] = {}

    def follow_scene(self) -> None:
        """Prepare again if the scene has changed."""
        if self._deforms or self._scene.objects is not self._objects:
            self._read_scene()

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
        out: ObjectFractions | None = None,
    ) -> ObjectFractions:
        """Measure the targets in views; arguments as for `visible_fractions`.

        Args:
            camera_to_world: Poses, as for `visible_fractions`, and so are the others.
            object_poses: Poses of movable objects.
            world_index: The world of each view.
            exclude: Excluded objects.
            object_scales: Scales of movable objects.
            convention: Axes of the camera frame.
            quaternion: Order of the quaternions.
            out: The result of an earlier call with as many views, to write into.
        """
        moved = object_poses, world_index, exclude, object_scales
        views = parse_world_views(self._scene, camera_to_world, *moved, convention, quaternion)
        return self.measure_parsed(views.poses, views.worlds, views.shape, out)

    def measure_parsed(
        self, poses: wp.array, worlds: Worlds, shape: tuple[int, ...] = (), out: ObjectFractions | None = None
    ) -> ObjectFractions:
        """Measure the targets at parsed poses in parsed worlds; results have a leading shape, by default ``(V,)``."""
        views, count, device = len(poses), len(self.names), self._device
        self.follow_scene()
        result = self._allocate(shape or (views,)) if out is None else self._checked(out, shape or (views,))
        arrays = {name: getattr(result, name) for name in self._layout(())}
        if len(shape) > 1:
            arrays = {name: array.reshape((views, *array.shape[len(shape) :])) for name, array in arrays.items()}
        spread = self._frames.spread(worlds)
        max_bytes = _CPU_BYTES if device.is_cpu else _CUDA_BYTES
        step = max(1, max_bytes // (4 * count * (FRACTION_COUNTERS + len(self._scene))))
        for start in range(0, views, step):
            part = slice(start, min(start + step, views))
            size = part.stop - part.start
            whole = size == views
            counts = wp.zeros((FRACTION_COUNTERS, size, count), dtype=wp.int32, device=device)
            hidden_by = wp.zeros((size, count, len(self._scene)), dtype=wp.int32, device=device)
            part_worlds, part_spread = (worlds, spread) if whole else (part_of(worlds, part), part_of(spread, part))
            self._count(poses if whole else poses[part], part_worlds, part_spread, counts, hidden_by)
            rows = arrays if whole else {name: take_rows(array, part) for name, array in arrays.items()}
            self._judge(counts, hidden_by, rows)
        return result

    def _judge(self, counts: wp.array, hidden_by: wp.array, results: dict[str, wp.array]) -> None:
        """Write results, the fields of `FractionResults`, from the counters of views."""
        from warpvis.kernels.visibility.fraction_results import judge_fractions

        write_fields(self._results, **results)
        inputs = [counts, hidden_by, self._camera.width * self._camera.height, self._results]
        if not self._device.is_cpu:
            launch(judge_fractions, counts.shape[1:], inputs, self._device)
            return
        if self._recorded is None:
            self._recorded = pack_launch(judge_fractions, inputs)
        self._recorded.set_dim(counts.shape[1:])
        self._recorded.set_param_at_index(0, counts)
        self._recorded.set_param_at_index(1, hidden_by)
        self._recorded.launch()

    def _layout(self, shape: tuple[int, ...]) -> dict[str, tuple[tuple[int, ...], type]]:
        """Return the shape and the dtype of each result of views of a shape."""
        of_targets = (*shape, len(self.names))
        of_occluders = (*of_targets, self._occluders)
        return {name: (of_targets, dtype) for name, dtype in _RESULTS.items()} | {
            "occluders": (of_occluders, wp.int32),
            "occluder_shares": (of_occluders, wp.float32),
        }

    def _allocate(self, shape: tuple[int, ...]) -> ObjectFractions:
        layout = self._layout(shape).items()
        arrays = {name: empty(size, dtype, name=name, device=self._device) for name, (size, dtype) in layout}
        return ObjectFractions(self.names, **arrays)

    def _checked(self, out: ObjectFractions, shape: tuple[int, ...]) -> ObjectFractions:
        if not isinstance(out, ObjectFractions):
            raise ArrayError(f"out must be an ObjectFractions, got {type(out).__name__}")
        for name, (size, dtype) in self._layout(shape).items():
            check_out(getattr(out, name), dtype, size, name=f"out.{name}", device=self._device)
        return out

    def _count(self, poses: wp.array, worlds: Worlds, spread: Worlds, counts: wp.array, hidden_by: wp.array) -> None:
        """Add the samples of views to the counters; see `warpvis.kernels.visibility.fractions.measure_fractions`."""
        if self._caster == "packets" and self._device.is_cpu:
            units = len(poses) * len(self.names)
            workers = 1 if units < _FEW_TARGETS else min(self._threads, units)
            workspace = self._workspaces.get(workers) or self._workspaces.setdefault(workers, _Workspace(self, workers))
            workspace.run(poses, worlds, spread, counts, hidden_by)
            return
        if self._caster == "packets" and self._scene.bvh().struct.drawn_count <= _MAX_OBJECTS:
            self._count_by_warps(poses, worlds, spread, counts, hidden_by)
            return
        from warpvis.kernels.visibility.fractions import measure_fractions

        scene, isolated = self._scene.triangles().struct, self._isolated.triangles().struct
        self._sampling.threads = 1 if self._device.is_cpu else _CUDA_THREADS

        def arguments(window: Window) -> KernelArguments:
            inputs = [self._sampling, worlds, spread, counts, hidden_by]
            return [scene, isolated, self._targets, self._device_camera, poses, window, *inputs]

        shape = (len(poses), len(self.names), self._sampling.threads)
        launch_images(measure_fractions, shape, arguments, device=self._device, threads=self._threads)

    def _count_by_warps(
        self, poses: wp.array, worlds: Worlds, spread: Worlds, counts: wp.array, hidden_by: wp.array
    ) -> None:
        from warpvis.kernels.casting.packets_cuda import FoundObjects

        pairs = len(poses) * len(self.names)
        self._sampling.threads = min(max(_MIN_PARTS, _CUDA_WARPS // max(pairs, 1)), _MAX_PARTS)
        scenes = [self._scene.bvh().struct, self._isolated.bvh().struct]
        inputs = [*scenes, self._targets, self._device_camera, poses, self._sampling, worlds, spread]
        size = (self._sampling.threads, len(poses), len(self.names), CUDA_LANES)
        inputs += [FoundObjects(), counts, hidden_by]
        resized = worlds.object_sizes is not None and worlds.object_sizes.size > 0
        launch(_cuda_kernel(self._clips, resized), size, inputs, self._device, block_dim=CUDA_LANES)


@cache
def _cuda_kernel(clip: bool, resized: bool) -> wp.Kernel:
    from warpvis.kernels.visibility.fraction_packets_cuda import make_fraction_kernel

    return make_fraction_kernel(clip, resized)


class _Workspace:
    """A packed launch of packets and the memory of its workers."""

    def __init__(self, meter: FractionMeter, workers: int) -> None:
        from warpvis.kernels.casting.packets import WorkerMemory
        from warpvis.kernels.visibility.fraction_packets import FractionCall, measure_fractions_packets

        self._meter, self._workers = meter, workers
        self._counter = np.zeros(JOB_COUNTERS, dtype=np.int32)
        self._call = FractionCall()
        self._shared = shared = WorkerMemory()  # whose arrays the call points to
        shared.counter = wp.array(self._counter, dtype=wp.int32, device="cpu", copy=False)
        shared.scratch_bytes = wp.zeros(1, dtype=wp.int64, device="cpu")
        sampling: Any = meter._sampling
        write_fields(self._call, targets=meter._targets, camera=meter._device_camera, workers=shared)
        write_fields(self._call, canvas=sampling.canvas, min_samples=sampling.min_samples)
        write_fields(self._call, cull_backfaces=sampling.cull_backfaces)
        write_fields(self._call, scene=meter._scene.bvh().struct, isolated=meter._isolated.bvh().struct)
        empty_counts = wp.zeros((1, 1, 1), dtype=wp.int32, device="cpu")
        self._launch = pack_launch(measure_fractions_packets, [self._call, empty_counts, empty_counts])
        self._launch.launch()  # without scratch memory, it only writes the size that it needs to `scratch_bytes`
        shared.scratch = aligned_zeros((workers, int(shared.scratch_bytes.numpy()[0])), wp.uint8)
        write_fields(self._call, workers=shared)

    def run(self, poses: wp.array, worlds: Worlds, spread: Worlds, counts: wp.array, hidden_by: wp.array) -> None:
        """Count the samples of all targets in all views."""
        meter = self._meter
        write_fields(self._call, scene=meter._scene.bvh().struct, poses=poses, worlds=worlds, spread_worlds=spread)
        self._launch.set_param_at_index(1, counts)
        self._launch.set_param_at_index(2, hidden_by)
        launch_shared(self._launch, self._counter, self._workers)


def visible_fractions(
    scene: Scene,
    camera: Camera,
    camera_to_world: PoseLike,
    *,
    objects: Targets | None = None,
    canvas: tuple[int, int, int, int] | None = None,
    min_samples: int = 256,
    occluders: int = 3,
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
) -> ObjectFractions:
    """Measure how much of each object is visible in many views and worlds, and what hides the rest.

    An object's visible fraction is its visible area in the image divided by the area of its silhouette, which it covers
    without other objects on a canvas larger than the image. Rays are cast only where the object may be. They pass
    through pixel centers; objects whose bounding box covers few pixels are sampled more finely, by an odd number of
    rays along the side of a pixel.

    `ObjectFractions.error` bounds the difference from the exact areas if no surface or gap is thinner than the distance
    of adjacent rays: between adjacent rays that differ (outside, hidden, visible), half of a ray's area is uncertain.
    Typical errors are much smaller.

    Surfaces that coincide with the object do not hide it where their computed depths are equal; where rounding
    separates them, either may be in front. For repeated calls, use a `FractionMeter`. Nothing is copied to the host.
    `object_visibility` has the quantities of BOP's toolkit, masks, tolerances for measured depth, and lenses.

    Args:
        scene: The scene.
        camera: Image size, intrinsics and depth range of all views.
        camera_to_world: Poses, as for `Renderer.render`; or those of M cameras in each of W worlds, ``(W, M, 7)``,
            ``(W, M, 4, 4)`` or ``(W, M)`` transform, where W is also the number of worlds of `object_poses` unless
            that is 1.
        objects: The targets: names or indices of objects; a list among them is measured as one object, the union of its
            members. A dict gives names to targets: ``{"mug": ["mug_body", "mug_handle"]}``. All objects by default.
        canvas: Extension of the canvas beyond the image's left, top, right and bottom border [px]; by default the
            image's width and height on each side, as in BOP.
        min_samples: Minimum number of rays through the rectangle that an object may cover, up to 63 x 63 rays a pixel;
            1 for pixel centers only.
        occluders: Number T of occluders to return for each target.
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: As for `Renderer.render`; flags of views ``(W, M)`` may also be ``(W, M, objects)``. An object has no
            samples in views that exclude it.
        object_scales: As for `Renderer.render`.
        near_plane: As for `Renderer`. With ``"clip"``, surfaces nearer than the camera's `near` are not part of
            silhouettes, either.
        cull_backfaces: As for `Renderer`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        caster: As for `Renderer`.
        threads: CPU threads to use; all cores of this process by default.
    """
    meter = FractionMeter(
        scene,
        camera,
        objects=objects,
        canvas=canvas,
        min_samples=min_samples,
        occluders=occluders,
        near_plane=near_plane,
        cull_backfaces=cull_backfaces,
        caster=caster,
        threads=threads,
    )
    moved = object_poses, world_index, exclude, object_scales
    views = parse_world_views(scene, camera_to_world, *moved, convention, quaternion)
    poses, worlds = views.poses, views.worlds
    found = meter.measure_parsed(poses, worlds, views.shape)
    if scene.device.is_cpu and len(poses):
        if quaternion == "xyzw":
            warn_of_order(views.given, convention)
        status = found.status.reshape((len(poses), len(found.names)))
        warn_of_unseen(scene, camera, poses, worlds, status, moves=object_poses is not None)
    return found


def _parse_targets(scene: Scene, objects: Targets | None) -> tuple[tuple[str, ...], list[list[int]]]:
    """Return the names of targets and the indices of their objects."""
    if objects is None:
        return tuple(item.name for item in scene.objects), [[index] for index in range(len(scene))]
    items = list(objects.values()) if isinstance(objects, Mapping) else as_items(objects, "objects", SceneError)
    if not items:
        raise SceneError("objects must be one or more objects of the scene, got none")
    groups = [_members(scene, item) for item in items]
    if isinstance(objects, Mapping):
        return tuple(map(str, objects)), groups
    return tuple("+".join(scene.objects[index].name for index in group) for group in groups), groups


def _members(scene: Scene, item: str | int | Sequence[str | int]) -> list[int]:
    return sorted(choose_objects(scene, [item] if isinstance(item, str | int | np.integer) else item))
