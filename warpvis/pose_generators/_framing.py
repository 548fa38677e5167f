# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Where a camera sees all of a scene."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.core.checks import check_angle
from warpvis.core.image_cameras import ImageCamera, require_image_camera
from warpvis.core.poses import check_up, poses_to_matrices
from warpvis.core.ray_camera import LensedCamera
from warpvis.errors import CameraError
from warpvis.pose_generators._generators import poses_along
from warpvis.scene import Scene, require_scene

_MARGIN = 0.03
_MIN_DISTANCE = 1e-3
_ASIDE = "a scene is framed by a camera whose axis is inside of its image, and this one's is not"

# Of the pinhole in a lens's image: how wide it may be, points on each side of its border, and steps of the search.
_WIDEST = math.radians(75)
_BORDER_POINTS, _HALVINGS = 33, 40


def framing(
    scene: Scene, camera: ImageCamera, *, azimuth: float = -1.0, elevation: float = 0.55
) -> NDArray[np.float64]:
    """Place a camera so that the box around a scene just fits into its image.

    Args:
        scene: The scene, whose objects count where they were added.
        camera: The camera, which may be a `warpvis.sensors.LensCamera`. Its axis has to be inside of its image; its
            range does not count.
        azimuth: Direction from the scene to the camera [rad], counterclockwise from the floor's first axis (x where z
            is up, z where y is up).
        elevation: The same above the horizon [rad].

    Returns:
        The pose, row ``x y z qx qy qz qw`` [m] of the OpenCV camera frame, shape ``(7,)``.

    Raises:
        WarpvisError: An argument is not what it has to be, or the scene is empty.
    """
    require_scene(scene)
    require_image_camera(camera)
    pinhole = camera if isinstance(camera, Camera) else _pinhole_inside(camera)
    azimuth = check_angle(azimuth, "azimuth", least=-1e6, most=1e6)
    elevation = check_angle(elevation, "elevation", least=-math.pi / 2, most=math.pi / 2)
    scene.require_objects()
    vertical = check_up(scene.up)
    level = math.cos(elevation)
    direction = [level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)]
    towards = np.roll(direction, vertical + 1)
    boxes = np.array([item.bounds for item in scene.objects], dtype=np.float64)
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    middle = (low + high) / 2
    pose = poses_along(middle[None], -towards[None], vertical)[0]
    pose[:3] = middle + towards * fitting_distance(pinhole, pose, middle, low, high)
    return pose


def _pinhole_inside(camera: LensedCamera) -> Camera:
    """Find a pinhole whose image lies in a lens's: the widest of the image's proportions around the axis.

    Raises:
        CameraError: The camera's axis is not inside of its image.
    """
    along = np.linspace(-1, 1, _BORDER_POINTS)
    ends = np.ones_like(along)
    sides = [(along, ends), (along, -ends), (ends, along), (-ends, along)]
    across, down = np.concatenate(sides, axis=1) * [[1.0], [camera.height / camera.width]]

    def fits(slope: float) -> bool:
        border = np.stack([slope * across, slope * down, np.ones_like(across)], axis=-1)
        at = camera.project(border)
        return bool(((at >= 0) & (at <= (camera.width, camera.height))).all())  # nowhere is NaN

    if not fits(0.0):
        raise CameraError(_ASIDE)
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
    """Compute how far from the middle of a box a camera has to be to have all of it in its image [m].

    A corner at (x, y, z) of the camera's axes from the middle is at ``fx x / (z + d) + cx`` from a distance d, which
    has to be between the image's borders; so must it be down the image.

    Args:
        camera: The camera.
        pose: Its pose, of which the direction counts, row of 7.
        middle: The box's middle, ``(3,)``.
        low: Its least corner.
        high: Its greatest corner.
        margin: What is left free on each side, as a share of the image.

    Raises:
        CameraError: The camera's axis is not inside of its image, so that no distance is enough.
    """
    corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
    x, y, z = ((corners - middle) @ poses_to_matrices(pose)[:3, :3]).T
    found = _MIN_DISTANCE - z
    for along, focal, centre, size in (
        (x, camera.fx, camera.cx, camera.width),
        (y, camera.fy, camera.cy, camera.height),
    ):
        room = (centre - margin * size, size - centre - margin * size)
        if min(room) <= 0:
            raise CameraError(_ASIDE)
        found = np.maximum(found, np.maximum(-focal * along / room[0], focal * along / room[1]) - z)
    return float(found.max())
