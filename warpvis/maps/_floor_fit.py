# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Find the floor in measured points or in a depth image, and how far the result can be trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.depth_images import check_meters
from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.arrays import as_numpy, as_point, check_length, check_shape, freeze
from warpvis.core.checks import check_angle, check_number, check_whole, format_percent
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
from warpvis.maps._floor_candidates import GATE, Cells, Plane, deviations, find_planes, fit_plane, group_points

# Points are taken from a regular grid if there are more.
_MAX_POINTS = 90_000

# Farther points do not help [m].
_MAX_DISTANCE = 12.0

# Fewest points, and the smallest area of a plane [m^2].
_MIN_POINTS, _MIN_AREA = 100, 0.02

# Default angle between the floor's normal and up [rad]: 15 degrees if `up` is given, 75 degrees for the image's axis.
_UP_TOLERANCE, _IMAGE_TOLERANCE = math.radians(15.0), math.radians(75.0)

# Areas of full confidence [m^2]: tables are smaller than the first; a known height of the camera excludes tables.
_FLOOR_AREA, _KNOWN_HEIGHT_AREA = 2.0, 0.3

# Width of a floor of full confidence [m].
_FLOOR_WIDTH = 0.4

# Share of area below the plane at which the confidence is zero.
_MAX_BELOW = 0.25

# Standard deviations of the normal [rad] and of the height [m] at which the confidence is halved.
_TILT_AT_HALF, _HEIGHT_AT_HALF = math.radians(1.0), 0.02

# Fraction of the standard deviation of points that is an error of whole regions, as of a depth camera's calibration.
_SHARED = 0.2

# Heights of steps [m]; lower ones are errors of the camera.
_MIN_STEP, _MAX_STEP = 0.04, 0.4

# Confidence is multiplied by this if the floor is seen only behind a higher level, as beyond a stair or a table.
_BEHIND = 0.5

# Angle of parallel planes, and slope that is reported [rad].
_PARALLEL, _SLOPE = math.radians(10.0), math.radians(2.0)

# Angle between the normal and the image's direction up from which the confidence decreases, and at which it is zero
# [rad]: a floor seen by a camera tilted down by 60 degrees looks like a wall seen by one tilted up by 30 degrees.
_SURE_ANGLE, _NO_ANGLE = math.radians(45.0), math.radians(65.0)


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
    camera_height: float
    """Height of the camera above the floor [m]."""
    inlier_fraction: float
    """Fraction of the measured points that are on the floor, from 0 to 1."""
    area: float
    """Visible area of the floor [m^2], counted by cells of 8 % of their distance; less where noise is large."""
    sigma: float
    """Robust standard deviation of the points of the floor across the plane [m]."""
    tilt_sigma: float
    """Standard deviation of the direction of the normal [rad], from `sigma`, a fifth of which is assumed to be common
    to all points of a region, and the width of the floor."""
    height_sigma: float
    """Standard deviation of `camera_height` [m]; it grows with the distance of the visible floor."""
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
    vertical, tolerance = _read_up(up, up_tolerance, matrix)
    expected = None if camera_height is None else check_length(camera_height, "camera_height", zero=False)
    height_tolerance = check_length(height_tolerance, "height_tolerance", zero=False)
    noise = None if noise is None else check_number(noise, "noise", minimum=1e-6, maximum=0.1)
    seed = check_whole(seed, "seed", minimum=0)

    cells = group_points(points, noise)
    planes = find_planes(cells, vertical, tolerance, _MIN_AREA, seed)
    if not planes:
        raise ArrayError(
            f"measured must show a floor: no plane of {_MIN_AREA} m^2 is within {math.degrees(tolerance):.0f} degrees "
            "of up; check the units, the camera and up"
        )
    allowed = [plane for plane in planes if expected is None or abs(plane.height - expected) <= height_tolerance]
    if not allowed:
        heights = ", ".join(f"{plane.height:.2f}" for plane in planes)
        raise ArrayError(
            f"camera_height must be within {height_tolerance:g} m of the height above a plane, got {expected:g}; "
            f"planes are {heights} m below the camera"
        )
    known, given = expected is not None, up is not None
    scores = [_score(plane, vertical, known=known, given=given) for plane in allowed]
    score = max(scores)
    floor = allowed[scores.index(score)]
    rivals = [(s, plane) for s, plane in zip(scores, allowed, strict=True) if not _is_same(plane, floor)]
    second, rival = max(rivals, key=lambda pair: pair[0], default=(0.0, floor))
    normal, height, sigma, inliers = _refine(cells, floor)
    width, tilt_sigma, height_sigma = _measure(cells, floor, sigma)
    levels = [plane for plane in planes if plane is not floor and plane.normal @ normal > math.cos(_PARALLEL)]
    behind = [] if known else [level for level in levels if _is_behind(cells, floor, level)]
    share = second / max(score, 1e-12)
    angle = math.acos(min(1.0, float(normal @ vertical)))
    size = min(1.0, floor.area / (_KNOWN_HEIGHT_AREA if known else _FLOOR_AREA)) * min(1.0, width / _FLOOR_WIDTH)
    confidence = (
        size
        * _trust(floor, vertical, known=known, given=given)
        * (_BEHIND if behind else 1.0)
        * min(1.0, 2 * max(0.0, 1 - share))
        / (1 + (tilt_sigma / _TILT_AT_HALF) ** 2 + (height_sigma / _HEIGHT_AT_HALF) ** 2)
    )
    problems = _describe_levels(floor, levels, behind, sigma)
    if share > 0.5:
        problems.append(
            f"another plane may be the floor: {rival.height:.2f} m from the camera instead of {height:.2f} m, "
            f"turned by {math.degrees(math.acos(min(1.0, float(rival.normal @ normal)))):.0f} degrees"
        )
    if given and angle > _SLOPE:
        problems.append(f"the floor slopes by {math.degrees(angle):.1f} degrees against up")
    if not known and not given and angle > _SURE_ANGLE:
        problems.append(
            f"the normal is {math.degrees(angle):.0f} degrees from up in the image: it may be a wall; pass up"
        )
    if not known and floor.below > 0.02:
        problems.append(f"{format_percent(floor.below)} of the area is below the plane, as for a table")
    if size < 0.75:
        problems.append(f"only {floor.area:.2f} m^2 are visible, {width:.2f} m wide, as of a table; pass camera_height")
    if tilt_sigma > _TILT_AT_HALF / 2 or height_sigma > _HEIGHT_AT_HALF / 2:
        problems.append(
            f"the standard deviation is {math.degrees(tilt_sigma):.1f} degrees and {100 * height_sigma:.1f} cm at the "
            "camera"
        )
    return FloorFit(
        **_transforms(pose, matrix, normal, height),
        camera_height=height,
        inlier_fraction=inliers,
        area=floor.area,
        sigma=sigma,
        tilt_sigma=tilt_sigma,
        height_sigma=height_sigma,
        confidence=float(confidence),
        problems=tuple(problems),
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
    """Return at most `_MAX_POINTS` points relative to the camera, in the axes of the input, shape ``(N, 3)``."""
    values = as_numpy(measured, name="measured")
    if camera is None:
        if values.ndim < 2 or values.shape[-1] != 3:
            raise ArrayError(
                f"measured must be points of shape (..., 3), or a depth image and a camera, got {values.shape}"
            )
        rows = values.reshape(-1, 3)
        rows = rows[:: max(1, math.ceil(len(rows) / _MAX_POINTS))].astype(np.float64) - matrix[:3, 3]
    else:
        require_image_camera(camera)
        check_meters(values, "measured", camera.near, camera.far)
        values = values[0] if values.ndim == 3 and len(values) == 1 else values
        check_shape(values.shape, (camera.height, camera.width), name="measured")
        step = max(1, math.ceil(math.sqrt(values.size / _MAX_POINTS)))
        y, x = np.mgrid[step // 2 : camera.height : step, step // 2 : camera.width : step]
        depth = values[y, x].astype(np.float64)
        valid = (depth > 0) & (depth >= camera.near) & (depth <= min(camera.far, 1e6))
        pixels = np.stack([x[valid] + 0.5, y[valid] + 0.5], axis=-1)
        rows = (camera.depth_rays(pixels) * depth[valid][:, None]) @ matrix[:3, :3].T
    with np.errstate(invalid="ignore", over="ignore"):
        squared = np.einsum("ij,ij->i", rows, rows)
    rows = rows[squared < _MAX_DISTANCE**2]
    if len(rows) < _MIN_POINTS:
        raise ArrayError(
            f"measured must have {_MIN_POINTS} points within {_MAX_DISTANCE:g} m of the camera, got {len(rows)}"
        )
    return rows


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


def _score(plane: Plane, vertical: NDArray[np.float64], *, known: bool, given: bool) -> float:
    """Return the score of a plane as the floor: its area, less if points are below it, or if it may be a wall."""
    return plane.area * _trust(plane, vertical, known=known, given=given)


def _is_same(plane: Plane, floor: Plane) -> bool:
    """Return whether a plane is a part of the floor that errors of the camera separate from it."""
    return plane is floor or (
        abs(plane.height - floor.height) < _MIN_STEP and float(plane.normal @ floor.normal) > math.cos(_PARALLEL / 2)
    )


def _trust(plane: Plane, vertical: NDArray[np.float64], *, known: bool, given: bool) -> float:
    """Return the factor of a plane's confidence for what is below it, and for its direction."""
    bottom = 1.0 if known else max(0.0, 1 - plane.below / _MAX_BELOW)
    if known or given:
        return bottom
    angle = math.acos(min(1.0, float(plane.normal @ vertical)))
    return bottom * min(1.0, max(0.0, (_NO_ANGLE - angle) / (_NO_ANGLE - _SURE_ANGLE)))


def _refine(cells: Cells, floor: Plane) -> tuple[NDArray[np.float64], float, float, float]:
    """Fit the plane to points; return its normal, height, standard deviation [m], and the fraction of points on it."""
    normal, height, scale = floor.normal, floor.height, 1.0
    # Cells of walls and furniture are excluded: their lowest points would lift the plane.
    chosen = floor.members[cells.cell_of_point] & (cells.cell_of_point >= 0)
    points, distances = cells.points[chosen], cells.distances[chosen]
    for _ in range(4):
        residuals = points @ normal + height
        limits = deviations(cells.noise, distances, height)
        relative = np.abs(residuals) / limits
        near = relative < GATE
        scale = float(np.clip(1.4826 * np.median(relative[near]), 0.3, 1.0)) if near.any() else 1.0
        near = relative < GATE * scale
        if near.sum() < _MIN_POINTS // 2:
            break
        turned, offset, _ = fit_plane(points[near], limits[near] ** -2)
        normal, height = turned, offset
    sigma = 1.4826 * float(np.median(np.abs(points[near] @ normal + height)))
    return normal, height, sigma, float(near.sum() / len(cells.points))


def _measure(cells: Cells, floor: Plane, sigma: float) -> tuple[float, float, float]:
    """Return the smaller width of the floor [m], and the standard deviations of its normal [rad] and height [m]."""
    centers = cells.centers[floor.members]
    _, _, variances = fit_plane(centers, cells.areas[floor.members])
    error = sigma * math.sqrt(1 / len(centers) + _SHARED**2)
    tilt_sigma = error / math.sqrt(max(variances[1], 1e-12))
    mean = centers.mean(axis=0)
    return math.sqrt(12 * variances[1]), tilt_sigma, math.hypot(error, tilt_sigma * _along(mean, floor.normal))


def _along(points: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of points from the vertical through the camera [m]."""
    return np.linalg.norm(points - (points @ normal)[..., None] * normal, axis=-1)


def _is_behind(cells: Cells, floor: Plane, level: Plane) -> bool:
    """Return whether a large level is above the floor, and all that is visible of the floor is farther away."""
    if level.height > floor.height - _MIN_STEP or level.area < min(0.1 * floor.area, 0.3):
        return False
    nearest, farthest = (_along(cells.centers[plane.members], floor.normal) for plane in (floor, level))
    return bool(np.quantile(nearest, 0.02) > np.quantile(farthest, 0.8))


def _describe_levels(floor: Plane, levels: list[Plane], behind: list[Plane], sigma: float) -> list[str]:
    """Describe steps, and levels that may be the floor."""
    problems = []
    for level in levels:
        rise = floor.height - level.height
        text = f"{abs(rise):.2f} m {'above' if rise > 0 else 'below'} it, {level.height:.2f} m below the camera"
        if any(level is other for other in behind):
            problems.append(
                f"the floor is visible only behind a level of {level.area:.2f} m^2, {text}, which may be a table, or "
                "the floor in front of a stair; pass camera_height"
            )
        elif max(_MIN_STEP, 4 * sigma) < abs(rise) < _MAX_STEP and level.area > 0.03 * floor.area:
            problems.append(f"there are steps or furniture: a level of {level.area:.2f} m^2 is {text}")
    return problems


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
