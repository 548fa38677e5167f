# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Registration of camera poses, object poses and joint positions to measured depth by Gauss-Newton steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.depth_images import check_meters, refuse_color
from warpvis.core.arrays import as_numpy, as_warp, check_length, count_axes, on_gpu, take_rows
from warpvis.core.checks import check_number, check_whole, is_number, truncate
from warpvis.core.pose_order import warn_of_order
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.threads import check_threads
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.maps._depth_sigma import KNOT_STEP, KNOTS, Sigma, tabulate_sigma
from warpvis.maps._register_groups import GroupSolver, parse_groups
from warpvis.maps._register_joints import JointSolver
from warpvis.maps._register_poses import PoseSolver
from warpvis.maps._register_sums import DepthSums
from warpvis.maps._registration import Registration
from warpvis.scene import Scene, require_scene
from warpvis.scene.joints import JointValues
from warpvis.scene.moving_joints import MovingJoints
from warpvis.scene.worlds import parse_worlds, pose_columns

_MAX_ITERATIONS = 1000


def register(
    scene: Scene,
    camera: AnyCamera,
    depth: ArrayInput,
    camera_to_world: PoseLike,
    *,
    sigma: Sigma,
    moving: str | Sequence[str] = "camera",
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    joint_positions: JointValues | None = None,
    groups: ArrayInput | None = None,
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
    """Refine poses of cameras or an object, or positions of joints, until rendered depth agrees with measured depth.

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
        moving: ``"camera"``, or the name of a movable object, whose poses are refined instead of the camera's;
            or names of joints of the scene, whose positions are refined within their limits. With joints, cameras stay
            where they are, so that none may be mounted on a link that moves, and steps are computed on the host: the
            call waits for the device once per iteration.
        object_poses: As for `Renderer.render`. With the name of an object in `moving`, these are the
            initial poses. Not with joints in `moving`.
        world_index: As for `Renderer.render`.
        joint_positions: Values of the scene's joints, which replace `object_poses`: as for `JointTree.link_poses`. With
            joints in `moving`, these are the initial positions.
        groups: Group of each view, ``(V,)`` integers from 0, which are read on the host; by default each view is its
            own. Views of a group move together: by one motion in the frame of the camera, or of the object, or by one
            offset of each joint, which limits do not stop. Thus one pose or mounting is found from several images.
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
        SceneError: If `moving` is not a movable object, or has joints that are not revolute, continuous or prismatic,
            or that move no object.
    """
    require_scene(scene).require_objects()
    if not isinstance(camera, AnyCamera):
        raise CameraError(f"camera must be a warpvis.Camera or another camera, got {type(camera).__name__}")
    axes = camera.axes if convention is None else convention
    names = _joint_names(moving)
    column = _column(scene, moving) if isinstance(moving, str) else -1
    if joint_positions is not None and object_poses is not None:
        raise ArrayError("joint_positions must be None if object_poses are given")
    joints = MovingJoints(scene.joints, names, joint_positions) if names else None
    if joints is not None and object_poses is not None:
        raise ArrayError("object_poses must be None if joints move; give joint_positions")
    rows = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    if joints is not None:
        object_poses = joints.poses
    elif joint_positions is not None:
        object_poses = scene.joints.poses(joint_positions)
    else:
        object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    device, threads = scene.device, check_threads(threads)
    poses = parse_poses(rows, convention=axes, device=device)
    images = _read_depth(depth, camera, device)
    count = max(len(poses), len(images), _count_worlds(object_poses, world_index))
    group = None if groups is None else parse_groups(groups, count)
    count = count if group is None else len(group)
    weighting = _weighting(camera, huber, max_distance, min_cosine, max_jump)
    tolerance = check_length(tolerance, "tolerance", zero=False)
    iterations = check_whole(iterations, "iterations")
    if iterations > _MAX_ITERATIONS:
        raise ArrayError(f"iterations must be from 1 to {_MAX_ITERATIONS}, got {iterations}")
    sigmas = wp.array(_sigmas(sigma, camera), dtype=wp.float32, device=device)
    if len(images) not in (1, count) or len(poses) not in (1, count):
        expected = "of one view" if count == 1 else f"of one view or of {count} views"
        raise ArrayError(f"depth and camera_to_world must be {expected}, got {len(images)} and {len(poses)}")
    given = len(object_poses) if names or joint_positions is not None else 1
    if world_index is None and given not in (1, count):
        raise ArrayError(f"joint_positions must be of one view or of {count} views, got {given}; or give world_index=")
    if len(poses) != count:
        poses = take_rows(poses, np.zeros(count, dtype=np.int32))
    worlds = parse_worlds(scene, count, object_poses, world_index, exclude)
    if device.is_cpu and quaternion == "xyzw":
        warn_of_order(camera_to_world, axes)

    columns = pose_columns(scene)
    if joints is not None:
        bodies = joints.bodies()
        columns = np.where(columns < 0, -1, bodies[columns])
        sums = DepthSums(scene, camera, images, sigmas, weighting, threads, columns, sorted({*bodies.tolist()} - {-1}))
        return JointSolver(sums, joints, poses, worlds, tolerance, iterations, group).run(axes)
    sums = DepthSums(scene, camera, images, sigmas, weighting, threads, columns, [column])
    solver = (
        PoseSolver(sums, tolerance, iterations) if group is None else GroupSolver(sums, tolerance, iterations, group)
    )
    return solver.run(poses, worlds, axes)


def _joint_names(moving: object) -> tuple[str, ...]:
    """Return names of joints, none if `moving` is a string."""
    if isinstance(moving, str):
        return ()
    names = tuple(moving) if isinstance(moving, list | tuple) else ()
    if not names or not all(isinstance(name, str) for name in names):
        raise SceneError(
            'moving must be "camera", the name of a movable object or a list of names of joints, '
            f"got {truncate(repr(moving))}"
        )
    return names


def _column(scene: Scene, moving: str) -> int:
    """Return the column of a movable object in object poses, -1 for the camera."""
    if moving == "camera":
        return -1
    if moving in scene.joints and moving not in (item.name for item in scene):
        raise SceneError(f"moving must be a list to move joints, [{moving!r}], got {moving!r}")
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


def _weighting(camera: AnyCamera, huber: object, max_distance: object, min_cosine: object, max_jump: object) -> Any:
    """Return checked options as a struct for kernels."""
    from warpvis.kernels.gradients.normal_equations import Weighting
    from warpvis.kernels.maps.compare_depth import Criteria

    if not is_number(huber) or not huber > 0:
        raise ArrayError(f"huber must be a positive number of standard deviations, got {huber!r}")
    criteria = Criteria()
    criteria.near, criteria.far = camera.near, camera.far
    criteria.first_bits, criteria.step_bits = int(KNOTS[:1].astype(np.float32).view(np.int32)[0]), KNOT_STEP
    weighting = Weighting()
    weighting.criteria = criteria
    weighting.huber = min(float(huber), 1e100)
    weighting.max_distance = check_length(max_distance, "max_distance", zero=False)
    weighting.min_cosine = check_number(min_cosine, "min_cosine", minimum=0.0, maximum=1.0)
    weighting.max_jump = math.inf if max_jump is None else check_length(max_jump, "max_jump", zero=False)
    return weighting
