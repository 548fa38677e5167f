# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The line of sight from an agent to a point: whether the point is visible, and if not, why and where it is blocked."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera, as_pinhole
from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import as_numpy, as_point
from warpvis.core.checks import format_percent
from warpvis.core.labels import Visibility
from warpvis.core.poses import QuaternionOrder, look_at, poses_to_matrices, to_xyzw
from warpvis.core.types import ArrayInput, ObjectPoses
from warpvis.errors import ArrayError, SceneError
from warpvis.maps import OccupancyMap
from warpvis.rendering import Renderer
from warpvis.scene import Scene
from warpvis.visibility._agents import Agent, Face
from warpvis.visibility._measured_space import MeasuredSpace, find_stop
from warpvis.visibility._points import point_visibility, point_visibility_from_depth

Floats = NDArray[np.float64]

# A camera with one pixel, whose ray is the camera's axis.
_PIXEL = Camera(1, 1, 1000.0, 1000.0, 0.5, 0.5)

# Points on each side of the image of a camera with distortion, whose sides are not straight.
_SIDE_POINTS = 32

# Shortest line of sight [m].
_MIN_DISTANCE = 1e-6


@dataclass(frozen=True)
class LineOfSight:
    """The straight line from an agent's eyes to a point in the world; `reason` describes it in words."""

    agent: str
    """Name of the agent."""
    status: Visibility
    """Whether the point is visible, and if not, why."""
    eye: tuple[float, float, float]
    """Position of the eyes [m]."""
    point: tuple[float, float, float]
    """The point [m]."""
    outside: float
    """Angle between the point and the nearest border of the field of view [rad]; 0 in the field of view."""
    side: str
    """Where the point is outside the field of view, as the agent sees it: ``"left"``, ``"right"``, ``"above"``,
    ``"below"``, or ``"behind"`` if it is more than 90 degrees from the axis; empty in the field of view."""
    depth: float
    """Depth of the point as the agent's camera defines it [m]; NaN outside the field of view."""
    limits: tuple[float, float]
    """Minimum and maximum depth of the camera [m]."""
    occluder: str | None = None
    """Name of the object that hides the point; None if none does, or if measured depth does."""
    stop: tuple[float, float, float] | None = None
    """Where the line is blocked, or enters unmeasured space if the status is UNKNOWN [m]; None for other states."""
    unknown_fraction: float = math.nan
    """Fraction of the line that was never measured, as in `point_visibility`; NaN without a map, and for points that
    are not visible without it."""
    unknown_length: float = math.nan
    """Length of this part [m]."""

    @property
    def distance(self) -> float:
        """Distance of the point from the eyes [m]."""
        return math.dist(self.eye, self.point)

    @property
    def reason(self) -> str:
        """The status in words, such as ``hidden by board at 1.20 m, 0.80 m before the point``."""
        if self.status == Visibility.VISIBLE:
            return "visible" + (f", across {self._unmeasured}" if self.unknown_length > 0 else "")
        if self.status == Visibility.OUT_OF_VIEW:
            angle = math.degrees(self.outside)
            text = f"{angle:.0f}" if angle >= 10 else f"{angle:.1f}"
            where = {"left": "to the left", "right": "to the right"}.get(self.side, self.side)
            return f"out of view: {text} degrees outside the field of view, {where}"
        if self.status == Visibility.TOO_NEAR:
            return f"too near: its depth is {self.depth:.2f} m, and the camera sees from {self.limits[0]:g} m"
        if self.status == Visibility.TOO_FAR:
            return f"too far: its depth is {self.depth:.2f} m, and the camera sees up to {self.limits[1]:g} m"
        reached = self.distance if self.stop is None else math.dist(self.eye, self.stop)
        if self.status == Visibility.OCCLUDED:
            what = "a measured surface" if self.occluder is None else self.occluder
            return f"hidden by {what} at {reached:.2f} m, {self.distance - reached:.2f} m before the point"
        if math.isnan(self.unknown_length):
            return "unknown: the depth image has no measurement there"
        return f"unknown: {self._unmeasured}, from {reached:.2f} m on"

    @property
    def _unmeasured(self) -> str:
        return f"{self.unknown_length:.2f} m ({format_percent(self.unknown_fraction)}) that was never measured"


def line_of_sight(
    scene: Scene | OccupancyMap,
    agent: Agent,
    point: ArrayInput,
    *,
    tolerance: float = 1e-3,
    occupancy: OccupancyMap | MeasuredSpace | None = None,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
) -> LineOfSight:
    """Return whether an agent sees a point, and if not, why and where the line of sight is blocked.

    The agent does not see `Agent.excluded`, which hide nothing from it.

    Args:
        scene: The scene whose surfaces may hide the point; or an `OccupancyMap` instead of it.
        agent: The agent, with one pose.
        point: Point in the world frame [m], ``(3,)``.
        tolerance: As for `point_visibility` [m].
        occupancy: As for `point_visibility`.
        object_poses: Poses of the movable objects, as for `Renderer.render`.
        quaternion: Order of the quaternions, ``"xyzw"`` or ``"wxyz"``.
    """
    place, eye = _check(agent, point), agent.poses[0, :3]
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    options: dict[str, Any]
    if isinstance(scene, OccupancyMap):
        space, options = _as_space(scene), {"occupancy": occupancy, "object_poses": object_poses}
    else:
        space, options = _as_space(occupancy), {"object_poses": object_poses, "exclude": agent.excluded or None}
        options |= {"occupancy": space, "occluders": True, "tolerance": tolerance}
    status, hiding, share, visible_face = Visibility.OUT_OF_VIEW, -1, math.nan, None
    for face in agent.faces:
        pose, unknown = agent.face_poses(face), space is not None
        found = point_visibility(scene, face.camera, pose, place[None], unknown=unknown, **options)
        values = [item.numpy()[0, 0] for item in (found if isinstance(found, tuple) else (found,))]
        if values[0] != Visibility.OUT_OF_VIEW:  # the images of a field of view do not overlap
            status, visible_face = Visibility(int(values[0])), face
            hiding = -1 if isinstance(scene, OccupancyMap) else int(values[1])
            share = math.nan if space is None else float(values[-1])
    length = math.nan
    if space is not None:
        length = share * max(math.dist(eye, place) - space.eye_clearance - (space.margin or 0.0), 0.0)
    line = replace(_make_line(agent, place, status, visible_face), unknown_fraction=share, unknown_length=length)
    if isinstance(scene, Scene) and hiding >= 0:
        hit = cast_ray(scene, eye, place - eye, object_poses=object_poses, exclude=agent.excluded)
        stop = None if hit is None else _as_tuple(hit[0])
        return replace(line, occluder=scene.objects[hiding].name, stop=stop)
    stopped = None if space is None else find_stop(space, eye, place, status)
    return line if stopped is None else replace(line, stop=_as_tuple(stopped))


def line_of_sight_in_depth(agent: Agent, depth: ArrayInput, point: ArrayInput, tolerance: float) -> LineOfSight:
    """Return whether an agent's depth image shows a point; see `point_visibility_from_depth`.

    Args:
        agent: An agent whose camera made the image.
        depth: The image [m], ``(H, W)``.
        point: Point in the world frame [m], ``(3,)``.
        tolerance: As for `point_visibility_from_depth` [m].
    """
    place, (face,) = _check(agent, point), agent.faces
    found = point_visibility_from_depth(depth, face.camera, agent.poses, place[None], tolerance=tolerance)
    line = _make_line(agent, place, Visibility(int(found.numpy()[0, 0])), face)
    if line.status != Visibility.OCCLUDED:
        return line
    pixel = face.camera.project(_local(agent.poses, place)).astype(int)
    column, row = np.minimum(pixel, (face.camera.width - 1, face.camera.height - 1))
    surface = max(float(as_numpy(depth, name="depth")[row, column]), 0.0)  # -inf is nearer than near
    eye = agent.poses[0, :3]
    return replace(line, stop=_as_tuple(eye + (place - eye) * (surface / line.depth)))


def cast_ray(
    scene: Scene, origin: Floats, direction: Floats, *, object_poses: ObjectPoses = None, exclude: Sequence[str] = ()
) -> tuple[Floats, int] | None:
    """Return the first point of a surface along a ray [m], ``(3,)``, and the index of its object; None without one."""
    up = np.eye(3)[np.abs(direction).argmin()]  # any that is not along the ray
    pose = look_at(origin, origin + direction / np.linalg.norm(direction), up=up)
    renderer = Renderer(scene, _PIXEL, outputs=("depth", "segmentation"))
    views = renderer.render(pose, object_poses=object_poses, exclude=exclude or None)
    depth, index = float(views.depth.numpy()[0, 0, 0]), int(views.segmentation.numpy()[0, 0, 0])
    return None if index < 0 else (origin + poses_to_matrices(pose[None])[0, :3, 2] * depth, index)


def _check(agent: Agent, point: ArrayInput) -> Floats:
    if not isinstance(agent, Agent):
        raise SceneError(f"agent must be a warpvis.Agent, got {type(agent).__name__}")
    if len(agent.poses) != 1:
        raise SceneError(f"{agent.name!r} must have one pose, got {len(agent.poses)}")
    place = as_point(as_numpy(point, name="point"), "point")
    if math.dist(place, agent.poses[0, :3]) < _MIN_DISTANCE:
        raise ArrayError(f"point must not be at the eyes of {agent.name!r}, got {place.tolist()}")
    return place


def _as_space(occupancy: OccupancyMap | MeasuredSpace | None) -> MeasuredSpace | None:
    return MeasuredSpace(occupancy) if isinstance(occupancy, OccupancyMap) else occupancy


def _as_tuple(point: Floats) -> tuple[float, float, float]:
    x, y, z = point.tolist()
    return x, y, z


def _local(poses: Floats, point: Floats) -> Floats:
    """Return a point in the frame of a camera with one pose, ``(3,)``."""
    matrix = poses_to_matrices(poses)[0]
    return (point - matrix[:3, 3]) @ matrix[:3, :3]


def _make_line(agent: Agent, point: Floats, status: Visibility, face: Face | None) -> LineOfSight:
    """Create a line; `face` is the image that the point is in. Compute what follows from the agent's camera."""
    outside, side, depth = 0.0, "", math.nan
    if status != Visibility.OUT_OF_VIEW:
        assert face is not None  # in view
        local = _local(agent.face_poses(face), point)
        depth = float(local[2] if face.camera.kind == "z" else np.linalg.norm(local))
    else:
        outside = math.inf
        for face in agent.faces:
            local = _local(agent.face_poses(face), point)
            direction = local / np.linalg.norm(local)
            angle, nearest = _nearest_on_outline(direction, _outline(face.camera))
            if angle < outside:
                outside, side = angle, _side(direction - nearest)
        if agent.angles_to(point[None, None])[0, 0] > math.pi / 2:
            side = "behind"
    eye, limits = _as_tuple(agent.poses[0, :3]), (agent.camera.near, agent.camera.far)
    return LineOfSight(agent.name, status, eye, _as_tuple(point), outside, side, depth, limits)


def _side(offset: Floats) -> str:
    """Return on which side of the image an offset in a camera's frame is."""
    if abs(offset[0]) > abs(offset[1]):
        return "right" if offset[0] > 0 else "left"
    return "below" if offset[1] > 0 else "above"


def _outline(camera: ImageCamera) -> Floats:
    """Return unit vectors to points of the image's border, in order; the corners of a pinhole, ``(N, 3)``."""
    corners = np.array([(0, 0), (camera.width, 0), (camera.width, camera.height), (0, camera.height)], dtype=np.float64)
    if as_pinhole(camera) is None:
        along = np.arange(_SIDE_POINTS)[:, None] / _SIDE_POINTS
        corners = np.concatenate([a + along * (b - a) for a, b in itertools.pairwise([*corners, corners[0]])])
    rays = camera.unproject(corners)
    return rays[np.isfinite(rays).all(axis=1)]  # a lens may end before the border of the image


def _nearest_on_outline(direction: Floats, outline: Floats) -> tuple[float, Floats]:
    """Return the nearest point of a closed line of great circles to a unit vector, and the angle to it [rad]."""
    ends = np.roll(outline, -1, axis=0)
    normals = np.cross(outline, ends)
    feet = direction - (normals @ direction / np.maximum((normals**2).sum(axis=1), 1e-30))[:, None] * normals
    between = (np.cross(normals, outline) * feet).sum(axis=1) >= 0
    between &= (np.cross(ends, normals) * feet).sum(axis=1) >= 0
    lengths = np.linalg.norm(feet, axis=1)
    between &= lengths > 0
    points = np.concatenate([outline, feet[between] / lengths[between, None]])
    angles = np.arctan2(np.linalg.norm(np.cross(points, direction), axis=1), points @ direction)
    return float(angles.min()), points[angles.argmin()]
