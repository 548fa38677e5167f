# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Agents: robots and people with a pose, a camera or a wide field of view, and a body; and their situations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera, as_pinhole, require_image_camera
from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import as_warp
from warpvis.core.checks import as_items, degrees_hint, is_number, pluralize
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, poses_to_matrices, quaternion_product, to_xyzw
from warpvis.core.types import ArrayInput, ObjectPoses, PoseLike
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds

# The pixel density of a pinhole image grows off its axis: at 40 degrees, a row has 1.7 times as many pixels per degree.
_MAX_PIXELS = 1 << 19
_WIDEST_FACE = math.radians(80)
_MAX_ELEVATION = math.radians(85)

_HUMAN_HFOV = math.radians(200)
_HUMAN_UP = math.radians(60)
_HUMAN_DOWN = math.radians(75)
_HUMAN_ATTENTION = math.radians(60)
_HUMAN_RESOLUTION = 120.0


@dataclass(frozen=True)
class Face:
    """One pinhole image of a field of view."""

    camera: ImageCamera
    """Intrinsics of the image."""
    rotation: tuple[float, float, float, float]
    """Rotation from the face's camera frame to the agent's, about the camera's y axis, ``x y z w``."""
    canvas: tuple[int, int, int, int]
    """Pixels beyond the left, top, right and bottom border of the image in which silhouettes are counted: the image's
    width or height at the border of the field (BOP's canvas), but at most up to the direction straight behind the
    agent, and 0 at the border to another face, so that no pixel is counted twice."""


@dataclass(frozen=True)
class FieldOfView:
    """A field of view too wide for one pinhole: adjacent images of the same size, rotated about the y axis.

    The images meet at vertical planes through the camera. The field is exactly `hfov` wide. Its upper and lower limits
    are the straight borders of the images: `up` and `down` apply on the center plane of each face, and the field is
    slightly lower between two center planes, by at most 5 degrees for limits of 60 degrees and faces of 67 degrees.
    """

    hfov: float
    """Horizontal angle of the whole field [rad], up to 2 pi."""
    up: float
    """Angle above the axis [rad], measured on the center plane of each face."""
    down: float
    """Angle below the axis [rad], measured on the center plane of each face."""
    near: float = 0.0
    """Minimum depth along a face's axis [m]."""
    far: float = math.inf
    """Maximum depth along a face's axis [m]."""
    resolution: float = _HUMAN_RESOLUTION
    """Pixels per radian at the center of each face; the size of the images is rounded to whole pixels."""

    def __post_init__(self) -> None:
        if not is_number(self.hfov) or not 0 < self.hfov <= 2 * math.pi:
            raise CameraError(
                f"hfov of a field must be above 0 and up to 2 pi radians, got {self.hfov!r}{degrees_hint(self.hfov)}"
            )
        for name in ("up", "down"):
            if not is_number(getattr(self, name)) or not 0 <= getattr(self, name) < _MAX_ELEVATION:
                raise CameraError(
                    f"{name} of a field must be from 0 to below {_MAX_ELEVATION:.3f} radians (85 degrees), "
                    f"got {getattr(self, name)}{degrees_hint(getattr(self, name))}"
                )
        if self.up + self.down <= 0:
            raise CameraError("up and down of a field must not both be 0")
        _check_resolution(self.resolution)
        camera = self._camera(self.hfov / self._count)
        if max(camera.width, camera.height) > _MAX_PIXELS:
            raise CameraError(
                f"resolution must give images of at most {_MAX_PIXELS} px per side, got {self.resolution!r} px/rad, "
                f"which gives {camera.width} x {camera.height} px"
            )

    @property
    def _count(self) -> int:
        return max(1, math.ceil(self.hfov / _WIDEST_FACE - 1e-9))

    def _camera(self, hfov: float) -> Camera:
        """Return a face's camera, with whole numbers of pixels and exact angles: pixels are square up to rounding."""
        wide, high = 2 * math.tan(hfov / 2), math.tan(self.up) + math.tan(self.down)
        width, height = (max(1, round(self.resolution * extent)) for extent in (wide, high))
        fx, fy = width / wide, height / high
        return Camera(width, height, fx, fy, width / 2, fy * math.tan(self.up), self.near, self.far)

    def faces(self) -> tuple[Face, ...]:
        """Return the images, from left to right."""
        count = self._count
        hfov = self.hfov / count
        camera = self._camera(hfov)
        # The canvas ends at the direction straight behind the agent.
        reach = hfov / 2 + (math.pi - self.hfov / 2)
        margin = camera.width
        if reach < math.pi / 2:
            margin = min(margin, max(0, int(camera.fx * math.tan(reach) - camera.width / 2)))
        faces = []
        for k in range(count):
            half_angle = ((k + 0.5) * hfov - self.hfov / 2) / 2
            left = margin if k == 0 else 0
            right = margin if k == count - 1 else 0
            rotation = (0.0, math.sin(half_angle), 0.0, math.cos(half_angle))
            faces.append(Face(camera, rotation, (left, camera.height, right, camera.height)))
        return tuple(faces)


@dataclass(frozen=True, eq=False)
class Agent:
    """A robot or a person: the pose of its eyes or sensor, its camera, and the objects that are its body.

    Example:
        >>> robot = Agent.kinect("robot", look_at((0, 0, 1.2), (2, 0, 0)), body=("robot_body",))
        >>> human = Agent.human("human", look_at((4, 0, 1.6), (2, 0, 0)))
    """

    name: str
    """Name in reports."""
    camera: ImageCamera | FieldOfView
    """Camera or field of view of the agent."""
    pose: PoseLike = field(repr=False)
    """Camera to world: one pose, or one for each of V situations, shape ``(V, 7)`` or ``(V, 4, 4)``."""
    body: tuple[str, ...] = ()
    """Names of the objects that are the agent's own body: it does not see them, and they occlude nothing for it, except
    with a `head`. Other agents see them like any object."""
    attention: ImageCamera | None = None
    """A narrower field of view along the same axis: visible objects that also appear in it are attended to. If None,
    all visible objects are."""
    convention: Convention = "opencv"
    """Axes of the camera frame of `pose`. The agent looks along the camera's axis, +z of the OpenCV frame."""
    quaternion: QuaternionOrder = "xyzw"
    """Order of the quaternions in `pose`, ``"xyzw"`` or ``"wxyz"``."""
    head: tuple[str, ...] | None = None
    """Names of the objects of `body` around or at the eyes. If given, only they are invisible to the agent; it sees the
    rest of its body, for example its arms, which hides things from it. By default, the whole body is invisible."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise SceneError(f"name of an agent must be a non-empty string, got {self.name!r}")
        if not isinstance(self.camera, FieldOfView):
            require_image_camera(self.camera, f"camera of {self.name!r}", "a FieldOfView")
        if self.attention is not None:
            require_image_camera(self.attention, f"attention of {self.name!r}", "None")
        body = _as_tuple(self.body)
        if not all(isinstance(name, str) for name in body):
            raise SceneError(f"body of {self.name!r} must be names of objects, got {body!r}")
        object.__setattr__(self, "body", body)
        if self.head is not None:
            object.__setattr__(self, "head", _as_tuple(self.head))
        wrong = [name for name in self.excluded if not isinstance(name, str) or name not in body]
        if wrong:
            raise SceneError(f"head of {self.name!r} must be names of objects of its body, {body!r}, got {wrong[0]!r}")
        _ = self.poses  # raises if the pose is invalid

    @classmethod
    def kinect(
        cls,
        name: str,
        pose: PoseLike,
        *,
        body: Sequence[str] | str = (),
        head: Sequence[str] | str | None = None,
        convention: Convention = "opencv",
        quaternion: QuaternionOrder = "xyzw",
    ) -> Agent:
        """Create a robot with the paper's camera, `Camera.kinect`: 57 degrees wide, 0.3 to 4.5 m."""
        options: dict[str, Any] = {"convention": convention, "quaternion": quaternion, "head": head}
        return cls(name, Camera.kinect(), pose, body=_as_tuple(body), **options)

    @classmethod
    def human(
        cls,
        name: str,
        pose: PoseLike,
        *,
        body: Sequence[str] | str = (),
        head: Sequence[str] | str | None = None,
        near: float = 0.0,
        far: float = math.inf,
        resolution: float = _HUMAN_RESOLUTION,
        convention: Convention = "opencv",
        quaternion: QuaternionOrder = "xyzw",
    ) -> Agent:
        """Create a person looking along the camera's axis, with head and eyes still.

        The field of view is that of both eyes: 200 degrees wide, 60 degrees up and 75 down. Perimetry gives 102 to 110
        degrees outwards for one eye (Lestak et al., Clinical Ophthalmology 15, 2021, 3241, doi:10.2147/OPTH.S321110),
        60 up and 75 down (Piltz-Seymour, Tai, Smith and Drance, Visual Fields in Glaucoma). The field of attention is a
        square 60 degrees wide, the central field of perimetry, within 30 degrees of fixation. The distinction between
        seeing and attending follows Marin-Urias et al., Towards Shared Attention through Geometric Reasoning for Human
        Robot Interaction, Humanoids 2009, doi:10.1109/ICHR.2009.5379555.

        Args:
            name: Name in reports.
            pose: Pose of the eyes, camera to world, one or ``(V, 7)`` or ``(V, 4, 4)``; see `warpvis.look_at`.
            body: Names of the objects that are the person's body.
            head: Names of the objects of `body` around the eyes; see `Agent.head`.
            near: Minimum depth [m].
            far: Maximum depth [m].
            resolution: Pixels per radian, far fewer than those of an eye: defines which objects are too small to see.
            convention: Axes of the camera frame of `pose`.
            quaternion: Order of the quaternions in `pose`, ``"xyzw"`` or ``"wxyz"``.
        """
        _check_resolution(resolution)
        view = FieldOfView(_HUMAN_HFOV, _HUMAN_UP, _HUMAN_DOWN, near=near, far=far, resolution=resolution)
        size = max(1, round(2 * resolution * math.tan(_HUMAN_ATTENTION / 2)))
        attention = Camera.from_fov(size, size, hfov=_HUMAN_ATTENTION, near=near, far=far)
        options: dict[str, Any] = {"convention": convention, "quaternion": quaternion, "head": head}
        return cls(name, view, pose, body=_as_tuple(body), attention=attention, **options)

    @cached_property
    def poses(self) -> NDArray[np.float64]:
        """Poses as rows ``x y z qx qy qz qw`` of the OpenCV camera frame, shape ``(V, 7)``."""
        pose = to_xyzw(self.pose, self.quaternion, f"pose of {self.name!r}")
        rows = parse_poses(pose, convention=self.convention, name=f"pose of {self.name!r}").numpy()
        return rows.astype(np.float64).reshape(-1, 7)

    @property
    def excluded(self) -> tuple[str, ...]:
        """Names of the objects that are invisible to the agent: its head, or its whole body."""
        return self.body if self.head is None else self.head

    @property
    def pinhole(self) -> Camera | None:
        """The camera as a pinhole; None for a field of view, and for a lens with distortion."""
        return None if isinstance(self.camera, FieldOfView) else as_pinhole(self.camera)

    @property
    def faces(self) -> tuple[Face, ...]:
        """Faces of the field of view, or one face for a camera."""
        if isinstance(self.camera, FieldOfView):
            return self.camera.faces()
        width, height = self.camera.width, self.camera.height
        return (Face(self.camera, (0.0, 0.0, 0.0, 1.0), (width, height, width, height)),)

    def face_poses(self, face: Face) -> NDArray[np.float64]:
        """Return the poses of a face's camera, camera to world, rows ``x y z qx qy qz qw``, shape ``(V, 7)``."""
        rotations = quaternion_product(self.poses[:, 3:], np.array(face.rotation))
        return np.concatenate([self.poses[:, :3], rotations], axis=1)

    def angles_to(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angles between the agent's axis and points in the world [rad].

        Args:
            points: K points for each of V poses, or for all poses, shape ``(V or 1, K, 3)``.

        Returns:
            Angles from 0 to pi, shape ``(V, K)``; 0 for a point at the agent's eyes.
        """
        matrices = poses_to_matrices(self.poses)
        x, y, z = np.moveaxis((points - matrices[:, None, :3, 3]) @ matrices[:, :3, :3], -1, 0)
        return np.arctan2(np.hypot(x, y), z)


def _as_tuple(names: Sequence[str] | str) -> tuple[str, ...]:
    """Return names as a tuple; a single name may be given as a string."""
    return tuple(as_items(names, "names", SceneError))


def _check_resolution(resolution: object) -> None:
    if not is_number(resolution) or not 0 < resolution < math.inf:
        raise CameraError(f"resolution must be a positive number of pixels per radian, got {resolution!r}")


def equirectangular(
    field: FieldOfView, scale: float
) -> tuple[tuple[int, int], list[tuple[NDArray[np.bool_], NDArray[np.float64]]]]:
    """Divide an equirectangular image with `scale` pixels per degree among the faces of a field of view.

    Returns:
        Height and width of the image; and for each face its columns, ``(w,)``, and the rays of their pixels in the
        frame of the face's camera, ``(h, n, 3)``, with z = 1.
    """
    sides, up, down = (math.degrees(angle) for angle in (field.hfov / 2, field.up, field.down))
    width, height = math.ceil(2 * sides * scale), math.ceil((up + down) * scale)
    azimuths = np.radians((np.arange(width) + 0.5) / width * 2 * sides - sides)
    elevations = np.radians(up - (np.arange(height) + 0.5) / height * (up + down))[:, None]
    count = len(field.faces())
    face_of = np.minimum((azimuths + field.hfov / 2) * count // field.hfov, count - 1).astype(int)
    parts = []
    for k in range(count):
        columns = face_of == k
        offset = azimuths[columns] - ((k + 0.5) * field.hfov / count - field.hfov / 2)
        rays = np.stack(np.broadcast_arrays(np.tan(offset), -np.tan(elevations) / np.cos(offset), 1.0), axis=-1)
        parts.append((columns, rays))
    return (height, width), parts


@dataclass(frozen=True)
class Situations:
    """Poses of the movable objects in each of `count` situations."""

    count: int
    """Number of situations."""
    object_poses: wp.array | None
    """Poses of the movable objects in the worlds, ``(W, M)`` transforms; None if nothing is movable."""
    world_index: NDArray[np.int32] | None
    """World of each situation, ``(count,)``; None if there is only one world."""

    @classmethod
    def parse(
        cls, scene: Scene, agents: Sequence[Agent], object_poses: ObjectPoses, world_index: ArrayInput | None
    ) -> Situations:
        """Combine agents' poses and worlds to situations: each has one for all situations, or one for each."""
        counts = {f"{agent.name!r} has {pluralize(len(agent.poses), 'pose')}": len(agent.poses) for agent in agents}
        if world_index is None:
            # Parse for a single view, since the number of situations is not yet known.
            poses = parse_worlds(scene, 1, object_poses, [0], None).object_poses
            worlds = np.arange(len(poses), dtype=np.int32)
        else:
            worlds = as_warp(world_index, wp.int32, ("V",), name="world_index", device=scene.device).numpy()
            poses = parse_worlds(scene, len(worlds), object_poses, worlds, None).object_poses
        if world_index is not None or len(worlds) > 1:
            counts[
                f"{'object_poses' if world_index is None else 'world_index'} has {pluralize(len(worlds), 'world')}"
            ] = len(worlds)
        count = max(counts.values())
        if any(number not in (1, count) for number in counts.values()):
            raise ArrayError(f"agents and worlds must have one situation or the same number: {', '.join(counts)}")
        several = len(poses) > 1
        return cls(
            count=count,
            object_poses=poses if scene.movable else None,
            world_index=np.ascontiguousarray(np.broadcast_to(worlds, count)) if several else None,
        )

    def rows(self) -> NDArray[np.float32] | None:
        """Return the poses of movable objects, ``(count, M, 7)`` or ``(1, M, 7)``; None if nothing is movable."""
        if self.object_poses is None:
            return None
        rows = np.array(self.object_poses.numpy(), dtype=np.float32)
        return rows if self.world_index is None else rows[self.world_index]
