# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Inside a Webots controller: what its range finder measures, labelled and mapped."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, Literal, Protocol, TypedDict, Unpack

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, check_metres
from warpvis.core.camera import Camera
from warpvis.core.poses import QuaternionOrder, poses_to_matrices, poses_to_opencv, to_xyzw
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, PoseError
from warpvis.maps import FloorMap, Sphere, back_project, classify, floor_map
from warpvis.webots._nodes import Version
from warpvis.webots._ranges import UNBIASED, as_version
from warpvis.webots._transforms import rotation_matrix

_NO_IMAGE = "the range finder has no image: enable() it and step the simulation first"


class RangeFinder(Protocol):
    """What is asked of a range finder of Webots' package `controller`."""

    def getWidth(self) -> int:
        """Return the image's width [px]."""

    def getHeight(self) -> int:
        """Return the image's height [px]."""

    def getFov(self) -> float:
        """Return the horizontal field of view [rad]."""

    def getMinRange(self) -> float:
        """Return the least range that is measured [m]."""

    def getMaxRange(self) -> float:
        """Return the greatest range that is measured [m]."""

    def getRangeImage(
        self, data_type: str = "list"
    ) -> Sequence[float] | bytes | bytearray | memoryview | ctypes._Pointer[ctypes.c_float] | None:
        """Return the newest image, row by row; None before there is one. Older releases know no `data_type`."""


class SupervisorNode(Protocol):
    """What is asked of a node of Webots' package `controller`."""

    def getPosition(self) -> Sequence[float]:
        """Return the node's origin in the world [m], 3 numbers."""

    def getOrientation(self) -> Sequence[float]:
        """Return the rotation node to world, a 3x3 matrix row by row, 9 numbers."""


class SupervisorRobot(Protocol):
    """What is asked of a `Supervisor` of Webots' package `controller`."""

    def getFromDevice(self, device: Any, /) -> SupervisorNode | None:
        """Return a device's node: of the device itself up to R2022b, of its tag from R2023a on."""


class ClassifyOptions(TypedDict, total=False):
    """Options of `warpvis.classify`, but for the camera's axes and the world's."""

    spheres: Sequence[Sphere] | ArrayLike
    ground_tolerance: float
    ground_height: float
    max_range: float | None
    device: DeviceLike
    threads: int | None
    out: wp.array | None
    spheres_out: wp.array | None


class DepthEye:
    """A range finder of a running Webots simulation, and where it is.

    Example:
        >>> robot = Supervisor()  # of Webots' package `controller`
        >>> range_finder = robot.getDevice("range-finder")
        >>> range_finder.enable(32)
        >>> eye = DepthEye(range_finder, robot=robot)
        >>> while robot.step(32) != -1:
        ...     floor = eye.floor_map(bounds=((-2, -2), (2, 2)))
    """

    def __init__(
        self,
        range_finder: RangeFinder,
        *,
        robot: SupervisorRobot | None = None,
        node: SupervisorNode | None = None,
        translation: ArrayLike = (0.0, 0.0, 0.0),
        rotation: ArrayLike = (0.0, 0.0, 1.0, 0.0),
        version: str | Version = "R2023b",
        near: float = 0.01,
    ) -> None:
        """Take a device and what knows where it is; it needs no more of Webots than the methods named here.

        Args:
            range_finder: What `Robot.getDevice` gives: `getWidth`, `getHeight`, `getFov`, `getMinRange`,
                `getMaxRange`, `getRangeImage`. Its projection must be planar.
            robot: The controller's `Supervisor`, which is asked for the range finder's own node; the robot's field
                `supervisor` must be TRUE.
            node: In its place, the node whose pose is asked for: `getPosition` and `getOrientation` of what, for
                example, `Supervisor.getSelf` gives. Without either, poses are given to each call.
            translation: The range finder's place in the frame of `node` [m], as its field says, shape ``(3,)``.
            rotation: Its rotation there, axis and angle [rad], shape ``(4,)``.
            version: Version of Webots. Up to R2021b cameras look along -z and depth is biased, which is undone; from
                R2022a on they look along x.
            near: The device's field `near` [m], which the bias depends on.

        Raises:
            WarpvisError: An argument is not what it has to be, or `robot` finds no node of the range finder.
        """
        self._version = as_version(version)
        place, turn = as_numpy(translation, name="translation"), as_numpy(rotation, name="rotation")
        if place.shape != (3,) or turn.shape != (4,) or not (np.isfinite(place).all() and np.isfinite(turn).all()):
            raise PoseError("translation and rotation must be three and four finite numbers, as in the device's fields")
        self._mount = np.eye(4)
        self._mount[:3, :3], self._mount[:3, 3] = rotation_matrix(turn.astype(np.float64)), place
        self._near = check_metres(near, "near")
        asked = ("getWidth", "getHeight", "getFov", "getMinRange", "getMaxRange", "getRangeImage")
        missing = [name for name in asked if not callable(getattr(range_finder, name, None))]
        if missing:
            raise ArrayError(f"range_finder must be a device of Webots, with {missing[0]}(), got {range_finder!r}")
        if robot is not None:
            if node is not None:
                raise PoseError("give robot or node, not both: robot finds the range finder's own node")
            node = _node_of(robot, range_finder)
        self._device, self._node = range_finder, node
        self.camera: Camera = Camera.from_fov(
            range_finder.getWidth(),
            range_finder.getHeight(),
            hfov=range_finder.getFov(),
            near=range_finder.getMinRange(),
            far=range_finder.getMaxRange(),
        )
        """The device as a camera."""

    def depth(self) -> NDArray[np.float32]:
        """Read the device's image as planar depth [m], shape ``(H, W)``; NaN where it has no image yet, which is 0.

        +inf is nothing in its range or, since Webots does not tell them apart, something nearer than its least range.

        Raises:
            ArrayError: There is no image yet, or it is of another size than the device.
        """
        values = self._values()
        far, size = self.camera.far, (self.camera.height, self.camera.width)
        if values.size != size[0] * size[1]:
            raise ArrayError(f"the range image must have {size[1]} x {size[0]} values, got {values.size}")
        with np.errstate(invalid="ignore"):
            missing, beyond = ~(values > 0), values >= far
            if self._version < UNBIASED:  # z' = f (z - n) / (f - n)
                values = (self._near + values * ((far - self._near) / far)).astype(np.float32)
        values = np.where(beyond, np.float32(np.inf), values)
        return np.where(missing, np.float32(np.nan), values).reshape(size)

    def pose(self, node_pose: ArrayLike | None = None, *, quaternion: QuaternionOrder = "xyzw") -> NDArray[np.float64]:
        """Compute where the camera is: OpenCV camera to world, ``x y z qx qy qz qw`` [m], shape ``(7,)``.

        Args:
            node_pose: Pose of the node in the world, ``x y z qx qy qz qw`` or a 4x4 matrix; by default the node is
                asked.
            quaternion: Order of the quaternion in a `node_pose` of 7 numbers, ``"xyzw"`` or ``"wxyz"``.

        Raises:
            PoseError: The pose is none, or there is no node to ask.
        """
        node_pose = to_xyzw(node_pose, quaternion, "node_pose")
        if node_pose is None:
            matrix = self._ask_node()
        else:
            rows = poses_to_opencv(node_pose, name="node_pose")
            if len(rows) != 1:
                raise PoseError(f"node_pose must be one pose, got {len(rows)}")
            matrix = poses_to_matrices(rows[0])
        return poses_to_opencv(matrix @ self._mount, "ros_body" if self._version.z_up else "opengl", name="the pose")[0]

    def points(self, node_pose: ArrayLike | None = None, *, quaternion: QuaternionOrder = "xyzw") -> wp.array:
        """Compute the measured points in the world [m], shape ``(1, H, W)`` vec3; NaN where nothing was measured."""
        return back_project(self.depth(), self.camera, self.pose(node_pose, quaternion=quaternion))

    def classify(
        self,
        node_pose: ArrayLike | None = None,
        *,
        up: Literal["z", "y"] = "z",
        quaternion: QuaternionOrder = "xyzw",
        **options: Unpack[ClassifyOptions],
    ) -> wp.array:
        """Label the pixels by the paper's cases.

        Args:
            node_pose: As for `pose`.
            up: The world's vertical axis.
            quaternion: As for `pose`.
            **options: Of `warpvis.classify`: `spheres`, `ground_tolerance`, `ground_height`, ...

        Returns:
            `Label` values, shape ``(1, H, W)`` uint8.

        Raises:
            WarpvisError: An argument is not what it has to be.
        """
        return classify(self.depth(), self.camera, self.pose(node_pose, quaternion=quaternion), up=up, **options)

    def floor_map(
        self,
        node_pose: ArrayLike | None = None,
        *,
        bounds: ArrayLike,
        cell_size: float = 0.02,
        up: Literal["z", "y"] = "z",
        quaternion: QuaternionOrder = "xyzw",
        **options: Unpack[ClassifyOptions],
    ) -> FloorMap:
        """Project what is seen to the floor.

        Args:
            node_pose: As for `pose`.
            bounds: As for `warpvis.floor_map`.
            cell_size: Likewise.
            up: The world's vertical axis.
            quaternion: As for `pose`.
            **options: Of `warpvis.classify`: `spheres`, `ground_tolerance`, `ground_height`, ...

        Raises:
            WarpvisError: An argument is not what it has to be.
        """
        depth, pose = self.depth(), self.pose(node_pose, quaternion=quaternion)  # once: the simulation goes on
        labels = classify(depth, self.camera, pose, up=up, **options)
        points = back_project(depth, self.camera, pose)
        return floor_map(
            points,
            labels,
            bounds=bounds,
            cell_size=cell_size,
            up=up,
            level_tolerance=options.get("ground_tolerance", 0.01),
        )

    def _values(self) -> NDArray[np.float32]:
        """Read the device's flat image: a list, a buffer of single precision, or a pointer to one."""
        period = getattr(self._device, "getSamplingPeriod", None)
        if callable(period) and not period():  # up to R2022b the buffer is then memory that nothing was written to
            raise ArrayError(_NO_IMAGE)
        try:
            image = self._device.getRangeImage(data_type="buffer")
        except TypeError:  # older releases know no kinds
            image = self._device.getRangeImage()
        if image is None or (isinstance(image, ctypes._Pointer) and not image):
            raise ArrayError(_NO_IMAGE)
        if isinstance(image, ctypes._Pointer):
            return np.ctypeslib.as_array(image, shape=(self.camera.height * self.camera.width,)).copy()
        if isinstance(image, bytes | bytearray | memoryview):
            if len(memoryview(image).cast("B")) % 4:
                raise ArrayError(f"the range image must be single precision numbers, got {len(image)} bytes")
            return np.frombuffer(image, dtype=np.float32)
        return as_numpy(image, name="the range image").astype(np.float32).ravel()

    def _ask_node(self) -> NDArray[np.float64]:
        if self._node is None:
            raise PoseError("give node_pose, or the eye a node to ask: DepthEye(range_finder, node=...)")
        matrix = np.eye(4)
        matrix[:3, 3] = np.asarray(self._node.getPosition(), dtype=np.float64)
        matrix[:3, :3] = np.asarray(self._node.getOrientation(), dtype=np.float64).reshape(3, 3)
        return matrix


def _node_of(robot: SupervisorRobot, device: RangeFinder) -> SupervisorNode:
    """Find a device's node.

    Up to R2022b `Supervisor.getFromDevice` takes the device and no tag. From R2023a on, where the library calls C
    through ctypes, it takes the tag and no device; only devices of that library have one.
    """
    find = getattr(robot, "getFromDevice", None)
    if not callable(find):
        raise PoseError(f"robot must be a Supervisor of Webots, with getFromDevice(), got {robot!r}")
    found: SupervisorNode | None = find(getattr(device, "_tag", device))
    if found is None:
        raise PoseError("robot finds no node of the range finder: its field supervisor must be TRUE")
    return found
