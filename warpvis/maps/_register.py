# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Registration of camera poses and object poses to measured depth by Gauss-Newton steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.depth_images import check_meters, refuse_color
from warpvis.cameras.rays import Rays
from warpvis.core.arrays import as_numpy, as_warp, check_length, count_axes, on_gpu, take_rows
from warpvis.core.checks import check_number, check_whole, is_number
from warpvis.core.kernel_cache import launch
from warpvis.core.pose_order import warn_of_order
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw, vectors_in_axes
from warpvis.core.threads import check_threads, launch_images
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.maps._depth_sigma import KNOT_STEP, KNOTS, Sigma, tabulate_sigma
from warpvis.rendering import Output, Renderer, Views, as_views, views_for
from warpvis.scene import Scene, require_scene
from warpvis.scene.joints import JointValues
from warpvis.scene.worlds import parse_worlds, part_of, pose_columns

# Pixels that one thread of a CPU or one warp of 32 threads adds up.
_CPU_STRIP, _GPU_STRIP, _WARP = 2048, 512, 32

# Size of the rendered images of one block of views [bytes].
_CPU_BLOCK, _GPU_BLOCK = 1 << 26, 1 << 30

# Number of sums of a strip, and largest step [rad, m].
_NUM_SUMS, _MAX_ROTATION, _MAX_TRANSLATION = 45, 0.35, 0.5

_MAX_ITERATIONS = 1000


@dataclass(frozen=True, eq=False)
class Registration:
    """Registered poses of V views or hypotheses: `wp.array`s on the scene's device.

    Twists are (rotation [rad], translation [m]) in the world frame: a small twist ``(r, t)`` moves the camera or the
    object by the rotation r about its own origin and the translation t, both along the axes of the world.
    """

    poses: wp.array
    """Poses of the camera in the given convention, or of the moved object, to world, shape ``(V,)`` transform."""
    covariance: wp.array
    """Covariance of the twist, the inverse of `H`, ``(V, 6, 6)`` float64; +inf if depth does not determine the pose."""
    H: wp.array
    """Information matrix of the twist, ``(V, 6, 6)`` float64."""
    b: wp.array
    """Gradient of `e`, ``(V, 6)`` float64."""
    e: wp.array
    """Robust cost: half the sum of squared residuals, linear above `huber` and constant above `max_distance`,
    ``(V,)`` float64."""
    num_inliers: wp.array
    """Number of pixels that determine the pose, ``(V,)`` int32."""
    num_measured: wp.array
    """Number of pixels with measured depth, ``(V,)`` int32."""
    converged: wp.array
    """Whether the last step was not significant, ``(V,)`` uint8. Views without surfaces to compare keep their poses,
    and are not converged."""
    iterations: wp.array
    """Number of steps, ``(V,)`` int32."""
    object_poses: wp.array | None = None
    """If an object was moved: poses of all movable objects, ``(V, M)`` transform."""

    @cached_property
    def inlier_ratio(self) -> NDArray[np.float64]:
        """Fraction of the measured pixels that are inliers, shape ``(V,)``; waits for a GPU."""
        return self.num_inliers.numpy() / np.maximum(self.num_measured.numpy(), 1)

    def best(self) -> int:
        """Return the index of the view with the lowest cost per measured pixel; -1 if none has inliers.

        It waits for a GPU.
        """
        error = self.e.numpy() / np.maximum(self.num_measured.numpy(), 1)
        error = np.where(self.num_inliers.numpy() > 0, error, np.inf)
        return int(error.argmin()) if np.isfinite(error).any() else -1


def register(
    scene: Scene,
    camera: AnyCamera,
    depth: ArrayInput,
    camera_to_world: PoseLike,
    *,
    sigma: Sigma,
    moving: str = "camera",
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    joint_positions: JointValues | None = None,
    exclude: Excluded = None,
    huber: float = 1.345,
    max_distance: float = 0.5,
    min_cosine: float = 0.1,
    max_jump: float | None = None,
    iterations: int = 30,
    tolerance: float = 1e-5,
    convention: Convention | None = None,
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> Registration:
    """Refine poses of cameras or of an object so that rendered depth agrees with measured depth.

    Each iteration renders the scene, and moves the pose by a Levenberg-Marquardt step that minimizes the distances of
    measured points from the planes of the surfaces in the same pixels (projective point-to-plane ICP). All views are
    processed in parallel and independently. On CUDA, work is queued, and the call does not wait for it.

    Args:
        scene: The scene.
        camera: Any camera, lens or ray pattern.
        depth: Measured depth as defined by the camera [m], float32, shape ``(V, *camera.shape)``, or one image of shape
            ``camera.shape`` for all poses. Pixels that are not finite, not positive or out of the camera's range have
            no measurement.
        camera_to_world: Initial poses of the camera, ``(V, 7)`` or ``(V, 4, 4)``, or one pose for all views.
        sigma: Standard deviation of measured depth: as for `compare_depth`.
        moving: ``"camera"``, or the name of a movable object, whose poses are refined instead of the camera's.
        object_poses: As for `Renderer.render`. With `moving`, these are the initial poses.
        world_index: As for `Renderer.render`.
        joint_positions: Values of the scene's joints, which replace `object_poses`: as for `JointTree.link_poses`.
        exclude: As for `Renderer.render`.
        huber: Number of standard deviations above which residuals have less weight; ``math.inf`` for least squares.
        max_distance: Distance between measured point and rendered surface up to which a pixel is used [m]. It should be
            larger than the displacement of surfaces by errors of the initial poses.
        min_cosine: Smallest cosine of the angle between ray and normal of pixels that are used.
        max_jump: Discontinuity of rendered depth above which a pixel is at an edge and ignored [m]; None to use pixels
            at edges.
        iterations: Maximum number of steps.
        tolerance: Step at which iterations end [rad] and [m]. They also end if a step is below 0.1 standard
            deviations, or below one and not shorter than the step before.
        convention: Axes of the camera frame of the poses; by default those of the camera.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``. Results are xyzw.
        threads: Number of CPU threads; all cores by default. Results do not depend on it.

    Returns:
        The refined poses with their covariances.

    Raises:
        ArrayError: If `depth` or an option is invalid.
        PoseError: If poses are invalid.
        SceneError: If `moving` is not a movable object.
    """
    require_scene(scene).require_objects()
    if not isinstance(camera, AnyCamera):
        raise CameraError(f"camera must be a warpvis.Camera or another camera, got {type(camera).__name__}")
    axes = camera.axes if convention is None else convention
    column = _column(scene, moving)
    if joint_positions is not None:
        if object_poses is not None:
            raise ArrayError("joint_positions must be None if object_poses are given")
        object_poses = scene.joints.poses(joint_positions)
    rows = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    device, threads = scene.device, check_threads(threads)
    poses = parse_poses(rows, convention=axes, device=device)
    images = _read_depth(depth, camera, device)
    count = max(len(poses), len(images), _count_worlds(object_poses, world_index))
    weighting = _weighting(camera, column, huber, max_distance, min_cosine, max_jump)
    limits = _limits(tolerance)
    iterations = check_whole(iterations, "iterations")
    if iterations > _MAX_ITERATIONS:
        raise ArrayError(f"iterations must be from 1 to {_MAX_ITERATIONS}, got {iterations}")
    sigmas = wp.array(_sigmas(sigma, camera), dtype=wp.float32, device=device)
    if len(images) not in (1, count) or len(poses) not in (1, count) or 0 in (len(images), len(poses)):
        raise ArrayError(
            f"depth and camera_to_world must be of one view or of {count} views, got {len(images)} and {len(poses)}"
        )
    if len(poses) != count:
        poses = take_rows(poses, np.zeros(count, dtype=np.int32))
    worlds = parse_worlds(scene, count, object_poses, world_index, exclude)
    if device.is_cpu and quaternion == "xyzw":
        warn_of_order(camera_to_world, axes)

    solver = _Solver(scene, camera, images, sigmas, weighting, limits, iterations, threads)
    moved, state = solver.run(poses, worlds)
    return _results(moved, state, column, axes, device)


class _Solver:
    """Registration of views, block by block."""

    def __init__(
        self,
        scene: Scene,
        camera: AnyCamera,
        depth: wp.array,
        sigmas: wp.array,
        weighting: Any,
        limits: Any,
        iterations: int,
        threads: int,
    ) -> None:
        self.device, self.threads = scene.device, threads
        self.weighting, self.limits, self.iterations = weighting, limits, iterations
        self.depth, self.sigmas = depth, sigmas
        outputs: list[Output] = ["depth", "normals"]
        if weighting.column >= 0:
            outputs.append("segmentation")
        self.renderer = Renderer(scene, _without_range(camera), outputs=outputs, threads=threads)
        self.shape = camera.shape
        self.columns = wp.array(pose_columns(scene), dtype=wp.int32, device=self.device)
        self.rays = _table(camera.rays, camera, self.device)
        self.origins = None if camera.origins is None else _table(camera.origins, camera, self.device)
        self.strips = _strips(camera, self.device)
        self.num_strips = -(-self.strips.pixels // self.strips.size)
        self.pixel_bytes = 16 if weighting.column < 0 else 20

    def run(self, poses: wp.array, worlds: Any) -> tuple[wp.array, Any]:
        """Return the moved poses, ``(V, 1)`` or ``(V, M)``, and the state of the solver."""
        from warpvis.kernels.gradients.normal_equations import spread_object_poses
        from warpvis.kernels.gradients.pose_steps import SolverState

        count = len(poses)
        if self.weighting.column < 0:
            moved = wp.clone(poses).reshape((count, 1))
        else:
            moved = wp.empty((count, worlds.object_poses.shape[1]), dtype=wp.transform, device=self.device)
            launch(spread_object_poses, moved.shape, [worlds, moved], self.device)
        state = SolverState()
        state.status = wp.zeros(count, dtype=wp.int32, device=self.device)
        state.iterations = wp.zeros(count, dtype=wp.int32, device=self.device)
        state.damping = wp.zeros(count, dtype=wp.float64, device=self.device)
        state.lengths = wp.zeros(count, dtype=wp.float64, device=self.device)
        state.best = wp.empty(count, dtype=wp.transform, device=self.device)
        state.sums = wp.zeros((count, _NUM_SUMS), dtype=wp.float64, device=self.device)
        limit = _CPU_BLOCK if self.device.is_cpu else _GPU_BLOCK
        size = min(count, max(1, limit // (self.pixel_bytes * self.strips.pixels)))
        views = views_for(self.renderer.outputs, (size, *self.shape), self.device)
        memory = wp.empty((size, self.num_strips, _NUM_SUMS), dtype=wp.float64, device=self.device)
        sums = wp.zeros((count, _NUM_SUMS), dtype=wp.float64, device=self.device)
        for first in range(0, count, size):
            self._run_block(slice(first, min(first + size, count)), poses, moved, worlds, state, sums, views, memory)
        return moved, state

    def _run_block(
        self,
        block: slice,
        poses: wp.array,
        moved: wp.array,
        worlds: Any,
        state: Any,
        sums: wp.array,
        views: Views,
        memory: wp.array,
    ) -> None:
        """Register some views: all of them in each iteration on CUDA, those that are not finished on a CPU."""
        from warpvis.kernels.gradients.pose_steps import SolverState, step_poses

        part = SolverState()
        for name in ("status", "iterations", "damping", "lengths", "best", "sums"):
            setattr(part, name, getattr(state, name)[block])
        numbers = np.arange(block.start, block.stop, dtype=np.int32)
        chosen: slice | NDArray[np.integer] = block
        for iteration in range(self.iterations + 1):
            if self.device.is_cpu:
                running = numbers[part.status.numpy() == 0]
                chosen = block if len(running) == len(numbers) else running
                if not len(running):
                    break
            self._sum(chosen, poses, moved, worlds, sums, views, memory)
            is_last = iteration == self.iterations
            inputs = [self.limits, max(self.weighting.column, 0), is_last, sums[block], part, moved[block]]
            launch(step_poses, len(numbers), inputs, self.device)

    def _sum(
        self,
        chosen: slice | NDArray[np.integer],
        poses: wp.array,
        moved: wp.array,
        worlds: Any,
        sums: wp.array,
        views: Views,
        memory: wp.array,
    ) -> None:
        """Render some views at their current poses, and write their sums."""
        from warpvis.kernels.casting.worlds import Worlds
        from warpvis.kernels.gradients.normal_equations import Rendered, add_strips, sum_terms
        from warpvis.kernels.gradients.normal_rows import sum_terms_rows

        if self.weighting.column < 0:
            poses = moved.reshape((len(poses),))
        else:
            excluded, worlds = worlds.excluded, Worlds()
            worlds.object_poses, worlds.excluded = moved, excluded
        numbers = np.arange(chosen.start, chosen.stop) if isinstance(chosen, slice) else chosen
        count = len(numbers)
        cameras, shown = take_rows(poses, chosen), part_of(worlds, chosen)
        images = {name: getattr(views, name)[:count] for name in self.renderer.outputs}
        self.renderer.render_parsed(cameras, shown, out=as_views(images))
        flat = {name: image.reshape((count, self.strips.pixels)) for name, image in images.items()}
        rendered = Rendered()
        rendered.views = wp.array(numbers, dtype=wp.int32, device=self.device)
        rendered.depth, rendered.normals = flat["depth"], flat["normals"]
        if "segmentation" in flat:
            rendered.objects = flat["segmentation"]
        strips = memory[:count]
        scene = [self.columns, cameras, self.rays, self.origins]
        inputs = [self.weighting, self.strips, self.sigmas, shown.object_poses, rendered, self.depth, strips]
        launch_images(
            sum_terms_rows if self.device.is_cpu else sum_terms,
            (count, self.num_strips, self.strips.lanes),
            lambda window: [*scene, window, *inputs],
            device=self.device,
            threads=self.threads,
            min_pixels=1,
        )
        lanes = self.strips.lanes
        launch(add_strips, (count, _NUM_SUMS, lanes), [rendered.views, lanes, strips, sums], self.device)


def _results(moved: wp.array, state: Any, column: int, axes: Convention, device: wp.Device) -> Registration:
    """Return the results of the accepted poses."""
    from warpvis.kernels.gradients.pose_steps import write_results

    count = len(moved)
    arrays: dict[str, wp.array] = {}
    for name, shape, dtype in (
        ("H", (6, 6), wp.float64),
        ("b", (6,), wp.float64),
        ("e", (), wp.float64),
        ("covariance", (6, 6), wp.float64),
        ("num_inliers", (), wp.int32),
        ("num_measured", (), wp.int32),
        ("converged", (), wp.uint8),
    ):
        arrays[name] = wp.empty((count, *shape), dtype=dtype, device=device)
    launch(write_results, count, [state, *arrays.values()], device)
    poses = state.best
    if column < 0 and axes != "opencv":
        poses = parse_poses(poses, convention="opencv", axes=axes, device=device)
    return Registration(poses, iterations=state.iterations, object_poses=None if column < 0 else moved, **arrays)


def _column(scene: Scene, moving: object) -> int:
    """Return the column of a movable object in object poses, -1 for the camera."""
    if not isinstance(moving, str):
        raise SceneError(f'moving must be "camera" or the name of a movable object, got {moving!r}')
    if moving == "camera":
        return -1
    column = int(pose_columns(scene)[scene.index(moving)])
    if column < 0:
        raise SceneError(f'moving must be "camera" or a movable object, got {moving!r}, which is static')
    return column


def _count_worlds(object_poses: ObjectPoses, world_index: ArrayInput | None) -> int:
    """Return the number of views that object poses and worlds imply; 1 if they are valid for any number."""
    if world_index is not None:
        return max(len(world_index), 1) if hasattr(world_index, "__len__") else 1
    if object_poses is None:
        return 1
    shape = getattr(object_poses, "shape", None)
    shape = np.shape(object_poses) if shape is None else shape
    is_transforms = isinstance(object_poses, wp.array) and object_poses.dtype is wp.transform
    return max(int(shape[0]), 1) if len(shape) == (2 if is_transforms else 3) else 1


def _read_depth(depth: ArrayInput, camera: AnyCamera, device: wp.Device) -> wp.array:
    """Return depth of all pixels, shape ``(V, pixels)``; host arrays must be in meters."""
    if not on_gpu(depth):
        host = as_numpy(depth, name="depth")
        refuse_color(host.shape, camera, "depth")  # type: ignore[arg-type]  # it reads width and height
        check_meters(host, "depth", camera.near, camera.far)
        depth = depth if isinstance(depth, wp.array) else host
    axes = len(camera.shape)
    if count_axes(depth, wp.float32) == axes:
        depth = depth.reshape((1, *depth.shape))
    images = as_warp(depth, wp.float32, ("V", *camera.shape), name="depth", device=device)
    return images.reshape((len(images), math.prod(camera.shape)))


def _sigmas(sigma: Sigma, camera: AnyCamera) -> NDArray[np.float32]:
    """Return standard deviations as for `sigma_at`: two are enough if they are constant."""
    table = tabulate_sigma(sigma, camera)  # type: ignore[arg-type]
    return table[:2] if (table == table[0]).all() else table


def _without_range(camera: AnyCamera) -> AnyCamera:
    """Return a camera whose depth is finite at any distance of the surface."""
    if isinstance(camera, Rays):
        return camera.with_range(0.0, math.inf)
    return replace(camera, near=0.0, far=math.inf)  # type: ignore[type-var]  # all other cameras are dataclasses


def _table(vectors: NDArray[np.float64], camera: AnyCamera, device: wp.Device) -> wp.array:
    """Return vectors of all pixels in the OpenCV frame, shape ``(3, pixels)`` float64."""
    rows = vectors_in_axes(vectors.reshape(-1, 3), camera.axes, "opencv")
    return wp.array(np.ascontiguousarray(rows.T), dtype=wp.float64, device=device)


def _strips(camera: AnyCamera, device: wp.Device) -> Any:
    """Return how pixels are distributed, by the number of pixels only: sums do not depend on the number of threads."""
    from warpvis.kernels.gradients.normal_equations import Strips

    strips = Strips()
    strips.width, strips.pixels = camera.width, math.prod(camera.shape)
    strips.size, strips.lanes = (_CPU_STRIP, 1) if device.is_cpu else (_GPU_STRIP, _WARP)
    return strips


def _weighting(
    camera: AnyCamera, column: int, huber: object, max_distance: object, min_cosine: object, max_jump: object
) -> Any:
    """Return checked options as a struct for kernels."""
    from warpvis.kernels.gradients.normal_equations import Weighting
    from warpvis.kernels.maps.compare_depth import Criteria

    if not is_number(huber) or not huber > 0:
        raise ArrayError(f"huber must be a positive number of standard deviations, got {huber!r}")
    criteria = Criteria()
    criteria.near, criteria.far = camera.near, camera.far
    criteria.first_bits, criteria.step_bits = int(KNOTS[:1].astype(np.float32).view(np.int32)[0]), KNOT_STEP
    weighting = Weighting()
    weighting.criteria, weighting.column = criteria, column
    weighting.huber = min(float(huber), 1e100)
    weighting.max_distance = check_length(max_distance, "max_distance", zero=False)
    weighting.min_cosine = check_number(min_cosine, "min_cosine", minimum=0.0, maximum=1.0)
    weighting.max_jump = math.inf if max_jump is None else check_length(max_jump, "max_jump", zero=False)
    return weighting


def _limits(tolerance: object) -> Any:
    """Return limits of steps as a struct for kernels."""
    from warpvis.kernels.gradients.pose_steps import StepLimits

    limits = StepLimits()
    limits.max_rotation, limits.max_translation = _MAX_ROTATION, _MAX_TRANSLATION
    limits.tolerance = check_length(tolerance, "tolerance", zero=False)
    return limits
