# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Find the floor in measured points or in a depth image, and how far the result can be trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.depth_images import check_meters, refuse_color
from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.arrays import as_numpy, as_point, check_length, check_shape, freeze
from warpvis.core.checks import check_angle, check_number, check_whole
from warpvis.core.poses import (
    Convention,
    QuaternionOrder,
    check_convention,
    poses_to_matrices,
    poses_to_opencv,
    quaternion_product,
    to_xyzw,
)
from warpvis.core.types import ArrayInput, PoseLike
from warpvis.errors import ArrayError, PoseError
from warpvis.maps._floor_candidates import deviations, find_planes, group_points
from warpvis.maps._floor_choice import Judgment, Prior, choose_floor
from warpvis.maps._floor_surface import Surface, fit_surface

# Points are taken from a regular grid if there are more.
_MAX_POINTS = 90_000

# Farther points do not help [m].
_MAX_DISTANCE = 12.0

# Fewest points, and the smallest area of a plane [m^2].
_MIN_POINTS, _MIN_AREA = 100, 0.02

# Default angle between the floor's normal and up [rad]: 15 degrees if `up` is given, 75 degrees for the image's axis.
_UP_TOLERANCE, _IMAGE_TOLERANCE = math.radians(15.0), math.radians(75.0)


@dataclass(frozen=True, eq=False)
class FloorFit:
    """A floor: its plane, the transform that moves it to z = 0, and a confidence.

    Arrays are float64 and read-only.
    """

    plane: NDArray[np.float64]
    """Plane ``nx ny nz d`` in the frame of the input, shape ``(4,)``: ``n . p + d`` is the height of a point `p` above
    the floor [m]. The unit normal `n` points towards the camera."""
    world_from_input: NDArray[np.float64]
    """Transform from the frame of the input to a world whose floor is z = 0 with z up: row ``x y z qx qy qz qw``, shape
    ``(7,)``. It is the smallest rotation that makes the normal vertical, which keeps the yaw, and a vertical shift."""
    camera_to_world: NDArray[np.float64]
    """Pose of the camera in that world, with OpenCV axes: row ``x y z qx qy qz qw``, shape ``(7,)``."""
    in_camera_frame: bool
    """Whether no pose was given, so that the frame of the input is that of the camera."""
    camera_height: float
    """Height of the camera above the floor [m]."""
    inlier_fraction: float
    """Fraction of the measured points that are on the floor, from 0 to 1."""
    inliers: NDArray[np.bool_]
    """Which pixels or points are on the plane: the shape of the depth image, or of the points without their last axis;
    also those of furniture that touches the plane."""
    area: float
    """Visible area of the floor [m^2], counted by cells of 8 % of their distance; less where noise is large."""
    sigma: float
    """Robust standard deviation of the points of the floor across the plane [m]."""
    tilt_sigma: float
    """Standard deviation of the direction of the normal [rad]. It combines random errors, a fifth of which is assumed
    to be common to all points of a region, with the differences between the halves of the floor, near and far, left and
    right: uncalibrated cameras measure curved depth, which tilts the plane by 1 to 2 degrees."""
    height_sigma: float
    """Standard deviation of `camera_height` [m], from the same errors; it grows with the distance of the floor."""
    confidence: float
    """Confidence from 0 to 1; do not use a floor below 0.5 without a look at `problems`.

    The product of these factors, each from 0 to 1:

    - size: `area` divided by 2 m^2 (0.3 m^2 if `camera_height` is given), and width divided by 0.4 m;
    - bottom, unless `camera_height` is given: ``1 - below / 0.25``, where `below` is the fraction of the area that is
      below the plane;
    - direction, unless `up` or `camera_height` is given: 1 up to 45 degrees between the normal and the image's axis,
      then decreasing to 0 at 65 degrees, because a wall may look the same;
    - order, unless `camera_height` is given: 0.5 if the floor is visible only behind a higher level;
    - distinction: ``2 (1 - s)``, where `s` is the ratio of the scores of the second best plane and of this one; a score
      is the product of area, bottom and direction;
    - precision: ``1 / (1 + (tilt_sigma / 1 degree)^2 + (height_sigma / 2 cm)^2)``.
    """
    problems: tuple[str, ...]
    """What may be wrong, in words; empty if nothing was found."""

    def heights(self, points: ArrayInput) -> NDArray[np.float64]:
        """Return the heights of points above the floor [m].

        Args:
            points: Points in the frame of the input [m], shape ``(..., 3)``.

        Returns:
            Heights, shape ``(...)``; NaN for points that are not finite.
        """
        rows = as_numpy(points, name="points")
        if rows.ndim < 1 or rows.shape[-1] != 3:
            raise ArrayError(f"points must have shape (..., 3), got {rows.shape}")
        return rows.astype(np.float64) @ self.plane[:3] + self.plane[3]


def fit_floor(
    measured: ArrayInput,
    camera: ImageCamera | None = None,
    camera_to_world: PoseLike | None = None,
    *,
    up: ArrayLike | None = None,
    up_tolerance: float | None = None,
    camera_height: float | None = None,
    height_tolerance: float = 0.15,
    noise: float | None = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    seed: int = 0,
) -> FloorFit:
    """Find the floor in a depth image or in points.

    The largest plane of a room may be a table. The floor is the plane that faces up, with a large area, and with almost
    no points below it; points that are seen through the plane are reflections, and ignored. Results are the same in
    every run.

    Args:
        measured: With `camera`, a depth image as defined by the camera [m], shape ``(H, W)`` or ``(1, H, W)``; pixels
            that are not finite, not positive, or out of the camera's range are ignored. Without `camera`, points [m],
            shape ``(..., 3)``; points that are not finite are ignored.
        camera: The camera of the depth image: a pinhole, or a `warpvis.cameras.LensCamera`.
        camera_to_world: Pose of the camera in the frame of the input: a row ``x y z qx qy qz qw`` or a 4x4 matrix. By
            default, that frame is the camera's, with OpenCV axes. Pass the pose, or any pose above the floor, with
            points in a world frame.
        up: Approximate direction up in the frame of the input, from an accelerometer for instance, shape ``(3,)``. By
            default, the direction up in the image: then a wall can pass as the floor if the camera is tilted up by more
            than 45 degrees.
        up_tolerance: Largest angle between `up` and the normal of the floor [rad]; by default 15 degrees if `up` is
            given, and otherwise 75 degrees, for cameras that are tilted and rolled.
        camera_height: Approximate height of the camera above the floor [m], if known. It excludes tables and steps.
        height_tolerance: Largest difference from `camera_height` [m].
        noise: Standard deviation of depth at a distance of 1 m [m]; it grows with the square of the distance. By
            default, it is estimated from flat surfaces, between 0.001 and 0.006 m.
        convention: Axes of the camera frame of the pose.
        quaternion: Order of the quaternion of the pose, ``"xyzw"`` or ``"wxyz"``.
        seed: Seed of the random choice of hypotheses, an integer from 0 up.

    Returns:
        The floor. Check `FloorFit.confidence` and `FloorFit.problems` before use.

    Raises:
        ArrayError: If an argument is invalid, or if no plane can be the floor.
    """
    pose = _read_pose(camera_to_world, convention, quaternion)
    matrix = poses_to_matrices(pose)
    points = _read_points(measured, camera, matrix)
    rows = _choose_rows(points)
    vertical, tolerance = _read_up(up, up_tolerance, matrix)
    expected = None if camera_height is None else check_length(camera_height, "camera_height", zero=False)
    height_tolerance = check_length(height_tolerance, "height_tolerance", zero=False)
    prior = Prior(vertical, tolerance, up is not None, expected, height_tolerance)
    noise = None if noise is None else check_number(noise, "noise", minimum=1e-6, maximum=0.1)
    seed = check_whole(seed, "seed", minimum=0)

    cells = group_points(rows, noise)
    planes = find_planes(cells, prior.up, prior.tolerance, _MIN_AREA, seed)
    if not planes:
        raise ArrayError(
            f"measured must show a floor: no plane of {_MIN_AREA} m^2 is within {math.degrees(prior.tolerance):.0f} "
            "degrees of up; check the units, the camera and up, and pass depth, not disparity"
        )
    choice = choose_floor(planes, prior)
    surface = fit_surface(cells, choice.floor)
    judgment = Judgment(cells, choice, surface, prior)
    return FloorFit(
        **_transforms(pose, matrix, surface.normal, surface.height),
        in_camera_frame=camera_to_world is None,
        camera_height=surface.height,
        inlier_fraction=surface.inlier_fraction,
        inliers=_find_inliers(points, surface, cells.noise),
        area=choice.floor.area,
        sigma=surface.sigma,
        tilt_sigma=surface.tilt_sigma,
        height_sigma=surface.height_sigma,
        confidence=judgment.confidence,
        problems=judgment.problems,
    )


def _read_pose(pose: PoseLike | None, convention: Convention, quaternion: QuaternionOrder) -> NDArray[np.float64]:
    """Return the camera's pose with OpenCV axes as a row, the identity by default."""
    check_convention(convention)
    pose = to_xyzw(pose, quaternion, "camera_to_world")
    if pose is None:
        return np.array([0.0, 0, 0, 0, 0, 0, 1])
    rows = poses_to_opencv(as_numpy(pose, name="camera_to_world"), convention, name="camera_to_world")
    if len(rows) != 1:
        raise PoseError(f"camera_to_world must be one pose, got {len(rows)}")
    return rows[0]


def _read_points(measured: ArrayInput, camera: ImageCamera | None, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points relative to the camera, in the axes of the input; NaN where nothing was measured."""
    values = as_numpy(measured, name="measured")
    if camera is None:
        if values.ndim < 2 or values.shape[-1] != 3:
            raise ArrayError(
                f"measured must be points of shape (..., 3), or a depth image and a camera, got {values.shape}"
            )
        return values - matrix[:3, 3]
    require_image_camera(camera)
    refuse_color(values.shape, camera, "measured")
    check_meters(values, "measured", camera.near, camera.far)
    image = values[0] if values.ndim == 3 and len(values) == 1 else values
    check_shape(image.shape, (camera.height, camera.width), name="measured")
    depth = image.astype(np.float64)
    valid = (depth > 0) & (depth >= camera.near) & (depth <= min(camera.far, 1e6))
    rays = _pixel_rays(camera) @ matrix[:3, :3].T
    return (rays * np.where(valid, depth, np.nan)[..., None]).reshape(*values.shape, 3)


@lru_cache(maxsize=2)
def _pixel_rays(camera: ImageCamera) -> NDArray[np.float64]:
    """Return the rays of depth 1 of all pixels, shape ``(H, W, 3)``."""
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return camera.depth_rays(np.stack([x, y], axis=-1))


def _choose_rows(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return at most `_MAX_POINTS` points within `_MAX_DISTANCE`, shape ``(N, 3)``: of images, those of a grid."""
    if points.ndim > 2:
        step = max(1, math.ceil(math.sqrt(points.size / 3 / _MAX_POINTS)))
        rows = points[..., step // 2 :: step, step // 2 :: step, :].reshape(-1, 3)
    else:
        rows = points[:: max(1, math.ceil(len(points) / _MAX_POINTS))]
    with np.errstate(invalid="ignore", over="ignore"):
        squared = np.einsum("ij,ij->i", rows, rows)
    rows = rows[squared < _MAX_DISTANCE**2]
    if len(rows) < _MIN_POINTS:
        raise ArrayError(
            f"measured must have {_MIN_POINTS} points within {_MAX_DISTANCE:g} m of the camera, got {len(rows)}; "
            "check the units and the range of the camera"
        )
    return rows


def _find_inliers(points: NDArray[np.float64], surface: Surface, noise: float) -> NDArray[np.bool_]:
    """Return which points are on the plane."""
    with np.errstate(invalid="ignore", over="ignore"):
        distances = np.sqrt(np.einsum("...i,...i->...", points, points))
        limits = surface.gate * deviations(noise, distances, surface.height)
        near = (np.abs(points @ surface.normal + surface.height) < limits) & (distances < _MAX_DISTANCE)
    near.flags.writeable = False
    return near


def _read_up(
    up: ArrayLike | None, tolerance: float | None, matrix: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return the direction up in the frame of the input, and the tolerance [rad]."""
    if tolerance is None:
        tolerance = _IMAGE_TOLERANCE if up is None else _UP_TOLERANCE
    tolerance = check_angle(tolerance, "up_tolerance", minimum=0.0, maximum=math.pi / 2)
    if up is None:
        return -matrix[:3, 1], tolerance
    vertical = as_point(up, "up")
    length = float(np.linalg.norm(vertical))
    if not 1e-9 < length < np.inf:
        raise ArrayError(f"up must be a direction, not zero, got {vertical.tolist()}")
    return vertical / length, tolerance


def _transforms(
    pose: NDArray[np.float64], matrix: NDArray[np.float64], normal: NDArray[np.float64], height: float
) -> dict[str, NDArray[np.float64]]:
    """Return the plane and the transforms of a `FloorFit` in the frame of the input."""
    offset = height - float(normal @ matrix[:3, 3])
    # The smallest rotation from the normal to z; it is not unique if they are opposite.
    rotation = np.array([normal[1], -normal[0], 0.0, 1 + normal[2]])
    length = float(np.linalg.norm(rotation))
    rotation = rotation / length if length > 1e-9 else np.array([1.0, 0, 0, 0])
    world_from_input = np.concatenate([[0.0, 0.0, offset], rotation])
    turn = poses_to_matrices(world_from_input)
    position = turn[:3, :3] @ matrix[:3, 3] + turn[:3, 3]
    return {
        "plane": freeze(np.append(normal, offset)),
        "world_from_input": freeze(world_from_input),
        "camera_to_world": freeze(np.concatenate([position, quaternion_product(rotation, pose[3:])])),
    }
