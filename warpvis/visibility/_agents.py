# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Agents: robots and people with a place, a camera or a wide field of view, and a body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.core.checks import as_items, degrees_hint, is_number
from warpvis.core.image_cameras import ImageCamera
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, poses_to_matrices, quaternion_product, to_xyzw
from warpvis.core.ray_camera import LensedCamera
from warpvis.core.types import PoseLike
from warpvis.errors import CameraError, SceneError

# A pinhole spends ever more pixels on ever less: at 40 degrees from its axis, a row has 1.7 times as many a degree.
_MAX_PIXELS = 1 << 19
_WIDEST_FACE = math.radians(80)
_HIGHEST = math.radians(85)

_HUMAN_HFOV = math.radians(200)
_HUMAN_UP = math.radians(60)
_HUMAN_DOWN = math.radians(75)
_HUMAN_ATTENTION = math.radians(60)
_HUMAN_RESOLUTION = 120.0


@dataclass(frozen=True)
class Face:
    """One pinhole image of a field of view."""

    camera: ImageCamera
    """Its intrinsics."""
    rotation: tuple[float, float, float, float]
    """Its camera frame to the agent's, ``x y z w``: a turn about the camera's y axis."""
    canvas: tuple[int, int, int, int]
    """Pixels beyond the image, left, top, right, bottom, in which silhouettes still count: the image's width or height
    where the field ends (BOP's canvas), but no farther than straight behind, and 0 where the next face takes over, so
    that nothing counts twice."""


@dataclass(frozen=True)
class FieldOfView:
    """A field of view too wide for one pinhole: images of the same size side by side, turned about the y axis.

    They meet at vertical planes through the camera. The field ends at exactly `hfov` to both sides. Its upper and lower
    limits are the straight borders of the images, so `up` and `down` hold on each face's centre plane, and the field is
    a little lower between two of them: by 5 degrees at most for limits of 60 degrees and faces of 67.
    """

    hfov: float
    """Horizontal angle of the whole field [rad], up to 2 pi."""
    up: float
    """Angle above the axis [rad], measured on the centre plane of each face."""
    down: float
    """Angle below the axis [rad], likewise."""
    near: float = 0.0
    """Least depth along a face's axis [m]."""
    far: float = math.inf
    """Greatest depth along a face's axis [m]."""
    resolution: float = _HUMAN_RESOLUTION
    """Pixels per radian in the middle of each face; rounded to whole images."""

    def __post_init__(self) -> None:
        if not is_number(self.hfov) or not 0 < self.hfov <= 2 * math.pi:
            raise CameraError(
                f"hfov of a field must be above 0 and up to 2 pi radians, got {self.hfov!r}{degrees_hint(self.hfov)}"
            )
        for name in ("up", "down"):
            if not is_number(getattr(self, name)) or not 0 <= getattr(self, name) < _HIGHEST:
                raise CameraError(
                    f"{name} of a field must be from 0 to below {_HIGHEST:.3f} radians (85 degrees), "
                    f"got {getattr(self, name)}{degrees_hint(getattr(self, name))}"
                )
        if self.up + self.down <= 0:
            raise CameraError("up and down of a field must not both be 0")
        _check_resolution(self.resolution)
        camera = self._camera(self.hfov / self._count)
        if max(camera.width, camera.height) > _MAX_PIXELS:
            raise CameraError(
                f"resolution {self.resolution!r} makes images of {camera.width} x {camera.height} pixels; "
                f"{_MAX_PIXELS} a side are the most"
            )

    @property
    def _count(self) -> int:
        return max(1, math.ceil(self.hfov / _WIDEST_FACE - 1e-9))

    def _camera(self, hfov: float) -> Camera:
        """Make a face's camera: whole numbers of pixels and exact angles, so its pixels are square up to rounding."""
        wide, high = 2 * math.tan(hfov / 2), math.tan(self.up) + math.tan(self.down)
        width, height = (max(1, round(self.resolution * extent)) for extent in (wide, high))
        fx, fy = width / wide, height / high
        return Camera(width, height, fx, fy, width / 2, fy * math.tan(self.up), self.near, self.far)

    def faces(self) -> tuple[Face, ...]:
        """Return the images, from left to right."""
        count = self._count
        hfov = self.hfov / count
        camera = self._camera(hfov)
        # Silhouettes end, at the latest, straight behind.
        reach = hfov / 2 + (math.pi - self.hfov / 2)
        beyond = camera.width
        if reach < math.pi / 2:
            beyond = min(beyond, max(0, int(camera.fx * math.tan(reach) - camera.width / 2)))
        faces = []
        for k in range(count):
            half = ((k + 0.5) * hfov - self.hfov / 2) / 2
            left = beyond if k == 0 else 0
            right = beyond if k == count - 1 else 0
            rotation = (0.0, math.sin(half), 0.0, math.cos(half))
            faces.append(Face(camera, rotation, (left, camera.height, right, camera.height)))
        return tuple(faces)


@dataclass(frozen=True, eq=False)
class Agent:
    """A robot or a person: where its eyes are, how they see, and what of the scene is its own body.

    Example:
        >>> robot = Agent.kinect("robot", look_at((0, 0, 1.2), (2, 0, 0)), body=("robot_body",))
        >>> human = Agent.human("human", look_at((4, 0, 1.6), (2, 0, 0)))
    """

    name: str
    """What reports call it."""
    camera: ImageCamera | FieldOfView
    """How it sees."""
    pose: PoseLike = field(repr=False)
    """Its eyes, camera to world: one pose, or one for each of V situations, shape ``(V, 7)`` or ``(V, 4, 4)``."""
    body: tuple[str, ...] = ()
    """Names of the objects that are the agent itself: it neither sees them nor do they hide anything from it. Others
    see them as any object."""
    attention: ImageCamera | None = None
    """A narrower field along the same axis: of what the agent sees, it attends to what shows there too. Without one
    it attends to all that it sees."""
    convention: Convention = "opencv"
    """Axes of the camera frame that `pose` is for. The agent looks along the camera's axis, +z of OpenCV's frame."""
    quaternion: QuaternionOrder = "xyzw"
    """Order of the quaternions in `pose`, ``"xyzw"`` or ``"wxyz"``."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise SceneError(f"an agent's name must be a word or more, got {self.name!r}")
        if not isinstance(self.camera, Camera | LensedCamera | FieldOfView):
            kinds = "a warpvis.Camera, a warpvis.sensors.LensCamera or a FieldOfView"
            raise CameraError(f"camera of {self.name!r} must be {kinds}, got {type(self.camera).__name__}")
        if not isinstance(self.attention, Camera | LensedCamera | None):
            raise CameraError(
                f"attention of {self.name!r} must be a warpvis.Camera, a LensCamera or None, got "
                f"{type(self.attention).__name__}"
            )
        body = _tuple_of(self.body)
        if not all(isinstance(name, str) for name in body):
            raise SceneError(f"body of {self.name!r} must be names of objects, got {body!r}")
        object.__setattr__(self, "body", body)
        _ = self.poses  # a pose that is none is refused here

    @classmethod
    def kinect(
        cls,
        name: str,
        pose: PoseLike,
        *,
        body: Sequence[str] | str = (),
        convention: Convention = "opencv",
        quaternion: QuaternionOrder = "xyzw",
    ) -> Agent:
        """Make a robot with the paper's camera, `Camera.kinect`: 57 degrees wide, 0.3 to 4.5 m."""
        return cls(name, Camera.kinect(), pose, body=_tuple_of(body), convention=convention, quaternion=quaternion)

    @classmethod
    def human(
        cls,
        name: str,
        pose: PoseLike,
        *,
        body: Sequence[str] | str = (),
        near: float = 0.0,
        far: float = math.inf,
        resolution: float = _HUMAN_RESOLUTION,
        convention: Convention = "opencv",
        quaternion: QuaternionOrder = "xyzw",
    ) -> Agent:
        """Make a person who looks along the camera's axis, head and eyes still.

        The field of view is that of both eyes together: 200 degrees wide, 60 degrees up and 75 down. Perimetry gives
        one eye 102 to 110 degrees outwards (Lestak et al., Clinical Ophthalmology 15, 2021, 3241) and, as lids and brow
        allow, 50 to 70 up and 70 to 80 down (the largest in Traquair, Clinical Perimetry, 1938); the CIE's vocabulary
        (e-ILV, "field of vision") says nearly 190 degrees for both eyes. The field of attention is a square 60 degrees
        wide, the 30 degrees around fixation that perimetry calls the central field; that robots should tell what a
        person attends to from what they see is LAAS's (Marin-Urias et al., Towards Shared Attention through Geometric
        Reasoning for Human Robot Interaction, Humanoids 2009).

        Args:
            name: What reports call the person.
            pose: Their eyes, camera to world, one or ``(V, 7)`` or ``(V, 4, 4)``; see `warpvis.look_at`.
            body: Names of the objects that are the person.
            near: Least depth that they see [m].
            far: Greatest depth that they see [m].
            resolution: Pixels per radian. The eye has far more: this decides what is too small to count.
            convention: Axes of the camera frame that `pose` is for.
            quaternion: Order of the quaternions in `pose`, ``"xyzw"`` or ``"wxyz"``.
        """
        _check_resolution(resolution)
        view = FieldOfView(_HUMAN_HFOV, _HUMAN_UP, _HUMAN_DOWN, near=near, far=far, resolution=resolution)
        size = max(1, round(2 * resolution * math.tan(_HUMAN_ATTENTION / 2)))
        attention = Camera.from_fov(size, size, hfov=_HUMAN_ATTENTION, near=near, far=far)
        return cls(
            name, view, pose, body=_tuple_of(body), attention=attention, convention=convention, quaternion=quaternion
        )

    @cached_property
    def poses(self) -> NDArray[np.float64]:
        """Its poses as rows ``x y z qx qy qz qw`` of the OpenCV frame, shape ``(V, 7)``."""
        given = self.pose.numpy() if isinstance(self.pose, wp.array) else self.pose
        given = to_xyzw(given, self.quaternion, f"pose of {self.name!r}")
        rows = parse_poses(given, convention=self.convention, name=f"pose of {self.name!r}").numpy()
        return rows.astype(np.float64).reshape(-1, 7)

    @property
    def faces(self) -> tuple[Face, ...]:
        """Its images: those of its field, or its camera's one."""
        if isinstance(self.camera, FieldOfView):
            return self.camera.faces()
        width, height = self.camera.width, self.camera.height
        return (Face(self.camera, (0.0, 0.0, 0.0, 1.0), (width, height, width, height)),)

    def face_poses(self, face: Face) -> NDArray[np.float64]:
        """Say where a face's camera is, camera to world, rows ``x y z qx qy qz qw``, shape ``(V, 7)``."""
        turned = quaternion_product(self.poses[:, 3:], np.array(face.rotation))
        return np.concatenate([self.poses[:, :3], turned], axis=1)

    def angles_to(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute angles between its axis and points of the world [rad].

        Args:
            points: K points for each of its V poses, or for all, shape ``(V or 1, K, 3)``.

        Returns:
            Angles from 0 to pi, shape ``(V, K)``; 0 for a point at its eyes.
        """
        matrices = poses_to_matrices(self.poses)
        x, y, z = np.moveaxis((points - matrices[:, None, :3, 3]) @ matrices[:, :3, :3], -1, 0)
        return np.arctan2(np.hypot(x, y), z)


def _tuple_of(names: Sequence[str] | str) -> tuple[str, ...]:
    """Return names, of which a single one may stand alone."""
    return tuple(as_items(names, "names", SceneError))


def _check_resolution(resolution: object) -> None:
    if not is_number(resolution) or not 0 < resolution < math.inf:
        raise CameraError(f"resolution must be a positive number of pixels per radian, got {resolution!r}")
