# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""World points and labels of measured and rendered depth images, by the paper's cases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from warpvis.cameras.depth_images import read_images
from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.arrays import as_numpy, as_warp, check_length, check_out, on_gpu, take_out
from warpvis.core.checks import check_number
from warpvis.core.labels import Label, LabelNames
from warpvis.core.poses import Convention, QuaternionOrder, check_convention, check_up
from warpvis.core.types import ArrayInput, DeviceLike, PoseLike
from warpvis.errors import ArrayError, SceneError
from warpvis.maps._depth_sigma import Sigma, fit_sigma
from warpvis.maps._floor_check import check_floor
from warpvis.maps._floor_fit import FloorFit
from warpvis.rendering import launch_back_project, launch_classify, launch_label_objects
from warpvis.scene import Scene, require_scene

if TYPE_CHECKING:
    from warpvis.kernels.maps.classify import Ground, Spheres

_LABELS, _UP_AXIS = LabelNames(), 2

_AXES = tuple(wp.vec3d(*row) for row in np.eye(3))


@dataclass(frozen=True)
class Sphere:
    """An object approximated by a sphere, as in the paper: points nearer to its center than its radius belong to it."""

    center: tuple[float, float, float]
    """Center in the world frame [m]."""
    diameter: float
    """Diameter [m]: the paper's size."""
    label: int = Label.OBJECT
    """Label of pixels inside."""

    def __post_init__(self) -> None:
        center = as_numpy(self.center, name="center of a sphere")
        if center.shape != (3,) or not np.isfinite(center).all():
            raise SceneError(f"center of a sphere must be three finite numbers, got {center.tolist()}")
        check_length(self.diameter, "diameter of a sphere", zero=False, error=SceneError)
        object.__setattr__(self, "center", tuple(map(float, center)))
        object.__setattr__(self, "label", _LABELS.number(self.label))


def back_project(
    depth: ArrayInput,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    *,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    device: DeviceLike = None,
    threads: int | None = None,
    out: wp.array | None = None,
) -> wp.array:
    """Compute world points of depth images, by equations (3) to (6).

    Args:
        depth: Depth as defined by the camera (planar for a pinhole) [m], shape ``(V, H, W)`` float32, or ``(H, W)`` for
            one view. Host arrays that apparently contain millimeters raise an error; arrays on a GPU are not checked.
        camera: The camera of the images: a pinhole, or a `warpvis.cameras.LensCamera`.
        camera_to_world: Poses of the camera, shape ``(V, 7)`` or ``(V, 4, 4)``.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        device: Device of the computation; by default that of `depth`.
        threads: Number of CPU threads; all cores by default.
        out: Output array, shape ``(V, H, W)`` `wp.vec3`.

    Returns:
        Points in the world frame [m], shape ``(V, H, W)`` vec3; NaN where depth is not finite, not positive, less than
        the camera's `near` or greater than its `far`, or where a lens has no ray.
    """
    depth, poses = read_images(depth, camera, camera_to_world, convention, quaternion, device)
    points = take_out(out, wp.vec3, depth.shape, device=depth.device)
    launch_back_project(camera, poses, depth, points, threads)
    return points


def classify(
    depth: ArrayInput,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    *,
    spheres: Sequence[Sphere] | ArrayLike = (),
    ground_tolerance: float = 0.01,
    ground_height: float = 0.0,
    up: Literal["z", "y"] = "z",
    floor: FloorFit | ArrayLike | None = None,
    sigma: Sigma | None = None,
    threshold: float = 3.0,
    below_label: Label | int | str = Label.GROUND,
    max_range: float | None = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    device: DeviceLike = None,
    threads: int | None = None,
    out: wp.array | None = None,
    spheres_out: wp.array | None = None,
) -> wp.array:
    """Label every pixel of depth images, measured or rendered, by the paper's cases.

    The first of these conditions determines the label: `Label.EMPTY` for a pixel without a point (its depth is NaN,
    infinite, not positive, less than the camera's `near`, or greater than `max_range`); `Label.GROUND` if its world
    point is less than the tolerance above the floor, or `below_label` if it is more than the tolerance below; the label
    of a sphere with ``||C_obj - P|| < diameter/2``
    (the deepest one, if there are several); otherwise `Label.OBSTACLE`. Images rendered by warpvis have exact objects:
    use `classify_rendered` for them.

    Args:
        depth: As for `back_project`.
        camera: The camera of the images: a pinhole, or a `warpvis.cameras.LensCamera`.
        camera_to_world: Poses of the camera, shape ``(V, 7)`` or ``(V, 4, 4)``.
        spheres: Objects: `Sphere`s, or rows ``x y z diameter`` [m] of shape ``(S, 4)``, labeled `Label.OBJECT`.
        ground_tolerance: Height above the floor below which a point is ground [m], to allow for sensor noise.
        ground_height: Height of the floor [m].
        up: The world's vertical axis.
        floor: The plane of the floor, instead of the plane perpendicular to `up` at `ground_height`: the result of
            `fit_floor`, or ``a b c d`` with ``a x + b y + c z + d = 0`` on the floor and greater than 0 above it, in
            the world frame of the poses. Without a pose of the camera, `fit_floor` returns a plane in the camera's
            frame: then pass `FloorFit.camera_to_world` as the pose and no `floor`.
        sigma: Standard deviation of depth, by which the tolerance grows, as for `compare_depth`: a model of
            `warpvis.sensors`, a number [m], or a function of depth; a quadratic polynomial is fitted to it. The
            tolerance of a point of depth z is ``ground_tolerance + threshold sigma(z) |dh/dz|``, where dh/dz is the
            change of its height with depth along its ray.
        threshold: Number of standard deviations.
        below_label: Label of points below the floor by more than the tolerance, such as those of a stair down.
        max_range: Maximum depth [m]; the camera's `far` by default.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        device: Device of the computation; by default that of `depth`.
        threads: Number of CPU threads; all cores by default.
        out: Output array for the labels, shape ``(V, H, W)`` uint8.
        spheres_out: Output array for the index of each pixel's sphere, -1 for none, shape ``(V, H, W)`` int32.

    Returns:
        `Label` values, shape ``(V, H, W)`` uint8.
    """
    from warpvis.kernels.maps import classify as kernels

    reach = None if max_range is None else check_length(max_range, "max_range", infinite=True)
    depth, poses = read_images(depth, camera, camera_to_world, convention, quaternion, device, reach)
    reach = camera.far if reach is None else reach
    ground = kernels.Ground()
    ground.tolerance = check_length(ground_tolerance, "ground_tolerance", infinite=True)
    threshold = check_number(threshold, "threshold", minimum=0.0)
    if sigma is not None:
        ground.growth = wp.vec3(*(threshold * value for value in fit_sigma(sigma, camera, reach)))
    ground.below_label = _LABELS.number(below_label)
    ground.height = check_length(ground_height, "ground_height", signed=True)
    _set_plane(ground, check_up(up), floor)
    if isinstance(floor, FloorFit) and floor.in_camera_frame:
        _require_identity(poses)
    if depth.device.is_cpu and floor is None and ground.below_label == Label.GROUND:
        plane = np.append(np.array(ground.normal), float(ground.offset) - ground.height)
        check_floor(depth.numpy(), camera, poses.numpy().reshape(-1, 7), plane, reach, check_convention(convention))
    balls, sphere_count = _device_spheres(spheres, depth.device)
    labels = take_out(out, wp.uint8, depth.shape, device=depth.device)
    if spheres_out is not None:
        check_out(spheres_out, wp.int32, depth.shape, name="spheres_out", device=depth.device)
    launch_classify(
        camera,
        poses,
        depth,
        [reach, ground, balls, labels, spheres_out],
        threads,
        sphere_count,
    )
    return labels


def _require_identity(poses: wp.array) -> None:
    """Check that poses in host memory are those of cameras in their own frames."""
    if poses.device.is_cpu and np.abs(np.abs(poses.numpy()) - [0, 0, 0, 0, 0, 0, 1]).max(initial=0.0) > 1e-6:
        raise ArrayError(
            "floor must be in the world frame, got the result of fit_floor without camera_to_world, which is in the "
            "camera's frame; pass FloorFit.camera_to_world as the pose and no floor"
        )


def _set_plane(ground: Ground, axis: int, floor: FloorFit | ArrayLike | None) -> None:
    """Set the plane of the floor: perpendicular to a world axis, or `floor`."""
    if floor is None:
        ground.axis = axis
        ground.normal = _AXES[axis]
        return
    if axis != _UP_AXIS or ground.height != 0.0:
        raise ArrayError('up and ground_height must be "z" and 0 if floor is given, because it replaces them')
    plane = as_numpy(floor.plane if isinstance(floor, FloorFit) else floor, name="floor").astype(np.float64)
    if plane.shape != (4,) or not np.isfinite(plane).all():
        raise ArrayError(f"floor must be a FloorFit or four finite numbers a b c d, got {plane.tolist()}")
    length = float(np.linalg.norm(plane[:3]))
    if not 1e-9 < length < 1e9:
        raise ArrayError(f"floor must have a normal a b c that is not zero, got {plane[:3].tolist()}")
    plane /= length
    ground.axis = -1
    ground.normal, ground.offset = wp.vec3d(*plane[:3]), float(plane[3])


def classify_rendered(
    depth: ArrayInput,
    objects: ArrayInput,
    scene: Scene,
    *,
    max_range: float = math.inf,
    threads: int | None = None,
    out: wp.array | None = None,
) -> wp.array:
    """Label every pixel of rendered images by its object.

    Args:
        depth: Planar depth [m], shape ``(V, H, W)`` float32.
        objects: Indices into the scene's objects, shape ``(V, H, W)`` int32, -1 for none.
        scene: The rendered scene.
        max_range: Depth beyond which a pixel is empty [m].
        threads: Number of CPU threads; all cores by default.
        out: Output array, shape ``(V, H, W)`` uint8.

    Returns:
        `Label` values on the scene's device, shape ``(V, H, W)`` uint8.
    """
    require_scene(scene)
    depth = as_warp(depth, wp.float32, ("V", "H", "W"), name="depth", device=scene.device)
    on_host = not on_gpu(objects)
    objects = as_warp(objects, wp.int32, depth.shape, name="objects", device=scene.device)
    if on_host:
        low, high = (int(limit(objects.numpy(), initial=-1)) for limit in (np.min, np.max))
        if low < -1 or high >= len(scene):
            raise ArrayError(
                f"objects must be from -1 to {len(scene) - 1}, indices of the scene's objects, got {low} to {high}"
            )
    reach = check_length(max_range, "max_range", infinite=True)
    labels = take_out(out, wp.uint8, depth.shape, device=depth.device)
    launch_label_objects(scene.object_labels(), depth, objects, reach, labels, threads)
    return labels


def _device_spheres(spheres: Sequence[Sphere] | ArrayLike, device: wp.Device) -> tuple[Spheres, int]:
    """Return spheres as a kernel argument, and their number."""
    from warpvis.kernels.maps.classify import Spheres

    if isinstance(spheres, Sequence) and all(isinstance(item, Sphere) for item in spheres):
        balls = [ball for ball in spheres if isinstance(ball, Sphere)]
    else:
        rows = as_numpy(spheres, name="spheres")
        if rows.ndim != 2 or rows.shape[1] != 4:
            raise ArrayError(
                f"spheres must be warpvis.maps.Sphere objects or have shape (S, 4), x y z diameter, got {rows.shape}"
            )
        balls = [Sphere(tuple(row[:3]), float(row[3])) for row in rows]
    struct = Spheres()
    if not balls:
        return struct, 0
    struct.center = wp.array([ball.center for ball in balls], dtype=wp.vec3, device=device)
    struct.size = wp.array([ball.diameter for ball in balls], dtype=wp.float32, device=device)
    struct.label = wp.array([int(ball.label) for ball in balls], dtype=wp.uint8, device=device)
    return struct, len(balls)
