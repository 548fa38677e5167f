# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Camera poses that show a whole scene."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera, as_pinhole, require_image_camera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import check_angle
from warpvis.core.poses import check_up, poses_to_matrices
from warpvis.errors import CameraError
from warpvis.pose_generators._generators import poses_along
from warpvis.scene import Scene, require_scene

_MARGIN = 0.03
_MIN_DISTANCE = 1e-3
# Ground is clipped if its diagonal is this many times that of the other objects; reach of clipped ground around them,
# relative to their diagonal.
_LARGE_GROUND, _GROUND_REACH = 10.0, 0.5
_OFF_AXIS = "camera must have its optical axis inside the image, to frame a scene"

# Search for a pinhole within a lens's image: maximum half angle, points on each side of the border, and bisection
# steps.
_WIDEST = math.radians(75)
_BORDER_POINTS, _HALVINGS = 33, 40


def framing(
    scene: Scene, camera: ImageCamera, *, azimuth: float = -1.0, elevation: float = 0.55
) -> NDArray[np.float64]:
    """Place a camera so that the bounding box of a scene just fits into its image.

    Ground that is more than ten times as large as all other objects together, such as an infinite plane of MuJoCo, is
    clipped to their surroundings.

    Args:
        scene: The scene, with its objects at their initial poses.
        camera: The camera, which may be a `warpvis.cameras.LensCamera`. Its optical axis must be inside the image; its
            depth range is ignored.
        azimuth: Azimuth of the camera as seen from the scene [rad], counterclockwise from the floor's first axis (x
            where z is up, z where y is up).
        elevation: Elevation of the camera as seen from the scene [rad].

    Returns:
        The pose, ``x y z qx qy qz qw`` [m], OpenCV camera to world, shape ``(7,)``.
    """
    require_scene(scene)
    require_image_camera(camera)
    pinhole = as_pinhole(camera) or _pinhole_inside(camera)
    azimuth = check_angle(azimuth, "azimuth", minimum=-1e6, maximum=1e6)
    elevation = check_angle(elevation, "elevation", minimum=-math.pi / 2, maximum=math.pi / 2)
    scene.require_objects()
    vertical = check_up(scene.up)
    level = math.cos(elevation)
    direction = [level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)]
    toward = np.roll(direction, vertical + 1)
    low, high = _shown_box(scene)
    middle = (low + high) / 2
    pose = poses_along(middle[None], -toward[None], vertical)[0]
    pose[:3] = middle + toward * fitting_distance(pinhole, pose, middle, low, high)
    return pose


def _shown_box(scene: Scene) -> NDArray[np.float64]:
    """Return the lower and upper corner of the box of all objects, with large ground clipped, ``(2, 3)``."""
    boxes = np.array([item.bounds for item in scene.objects], dtype=np.float64)
    is_ground = np.array([item.label in scene.ground_labels for item in scene.objects])
    if is_ground.any() and not is_ground.all():
        low, high = boxes[~is_ground, 0].min(axis=0), boxes[~is_ground, 1].max(axis=0)
        size = np.linalg.norm(high - low)
        is_large = is_ground & (np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1) > _LARGE_GROUND * size)
        boxes[is_large] = np.clip(boxes[is_large], low - _GROUND_REACH * size, high + _GROUND_REACH * size)
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def _pinhole_inside(camera: ImageCamera) -> Camera:
    """Find the widest centered pinhole, of the image's aspect ratio, whose rays are all within a lens's image."""
    along = np.linspace(-1, 1, _BORDER_POINTS)
    ends = np.ones_like(along)
    sides = [(along, ends), (along, -ends), (ends, along), (-ends, along)]
    across, down = np.concatenate(sides, axis=1) * [[1.0], [camera.height / camera.width]]

    def fits(slope: float) -> bool:
        border = np.stack([slope * across, slope * down, np.ones_like(across)], axis=-1)
        pixels = camera.project(border)
        return bool(((pixels >= 0) & (pixels <= (camera.width, camera.height))).all())  # NaN fails

    if not fits(0.0):
        raise CameraError(_OFF_AXIS)
    narrow, wide = 0.0, math.tan(_WIDEST)
    for _ in range(_HALVINGS):
        middle = (narrow + wide) / 2
        narrow, wide = (middle, wide) if fits(middle) else (narrow, middle)
    focal = camera.width / 2 / narrow
    return Camera(camera.width, camera.height, focal, focal, camera.width / 2, camera.height / 2)


def fitting_distance(
    camera: Camera,
    pose: NDArray[np.float64],
    middle: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    *,
    margin: float = _MARGIN,
) -> float:
    """Compute the distance from the center of a box at which the whole box is in a camera's image [m].

    A corner at (x, y, z) from the center, in the camera's axes, projects to ``fx x / (z + d) + cx`` from distance d. It
    must be inside the image, with a margin as a fraction of the image; the same holds for y.
    """
    corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
    x, y, z = ((corners - middle) @ poses_to_matrices(pose)[:3, :3]).T
    found = _MIN_DISTANCE - z
    for along, focal, center, size in (
        (x, camera.fx, camera.cx, camera.width),
        (y, camera.fy, camera.cy, camera.height),
    ):
        extents = (center - margin * size, size - center - margin * size)
        if min(extents) <= 0:
            raise CameraError(_OFF_AXIS)
        found = np.maximum(found, np.maximum(-focal * along / extents[0], focal * along / extents[1]) - z)
    return float(found.max())
