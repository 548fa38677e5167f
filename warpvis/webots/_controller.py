# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Range finders inside a running Webots controller: depth, poses, points, labels and floor maps."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, Literal, Protocol, TypedDict, Unpack

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import as_numpy, check_length
from warpvis.core.poses import QuaternionOrder, poses_to_matrices, poses_to_opencv, to_xyzw
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, PoseError
from warpvis.maps import FloorMap, Sphere, back_project, classify, floor_map
from warpvis.webots._nodes import Version, rigid_matrix, rotation_matrix
from warpvis.webots._ranges import UNBIASED, as_version

_NO_IMAGE = "the range finder has no image: enable() it and step the simulation first"


class RangeFinder(Protocol):
    """The methods of `controller.RangeFinder`, of Webots' Python package, that are called."""

    def getWidth(self) -> int:
        """Return the image's width [px]."""

    def getHeight(self) -> int:
        """Return the image's height [px]."""

    def getFov(self) -> float:
        """Return the horizontal field of view [rad]."""

    def getMinRange(self) -> float:
        """Return the minimum range [m]."""

    def getMaxRange(self) -> float:
        """Return the maximum range [m]."""

    def getRangeImage(
        self, data_type: str = "list"
    ) -> Sequence[float] | bytes | bytearray | memoryview | ctypes._Pointer[ctypes.c_float] | None:
        """Return the latest image in row-major order, or None before the first one. Older releases lack `data_type`."""


class SupervisorNode(Protocol):
    """The methods of `controller.Node`, of Webots' Python package, that are called."""

    def getPosition(self) -> Sequence[float]:
        """Return the node's origin in the world [m], 3 values."""

    def getOrientation(self) -> Sequence[float]:
        """Return the node-to-world rotation, a 3x3 matrix in row-major order, 9 values."""


class SupervisorRobot(Protocol):
    """The method of `controller.Supervisor`, of Webots' Python package, that is called."""

    def getFromDevice(self, device: Any, /) -> SupervisorNode | None:
        """Return the node of a device, passed as the device up to R2022b and as its tag from R2023a on."""


class ClassifyOptions(TypedDict, total=False):
    """Options of `warpvis.classify`, except the axes of the camera and the world."""

    spheres: Sequence[Sphere] | ArrayLike
    ground_tolerance: float
    ground_height: float
    max_range: float | None
    device: DeviceLike
    threads: int | None
    out: wp.array | None
    spheres_out: wp.array | None


class DepthEye:
    """A range finder of a running Webots simulation, and its pose.

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
        """Connect to a range finder and, optionally, to a node that provides its pose.

        Only the methods named here are called, so stand-ins for Webots' classes work as well.

        Args:
            range_finder: A device from `Robot.getDevice`, with `getWidth`, `getHeight`, `getFov`, `getMinRange`,
                `getMaxRange` and `getRangeImage`. Its projection must be planar.
            robot: The controller's `Supervisor`, which finds the node of the range finder. The robot's field
                `supervisor` must be TRUE.
            node: Alternatively, a node with `getPosition` and `getOrientation`, for example from
                `Supervisor.getSelf`. Without `robot` and `node`, each call needs `node_pose`.
            translation: Position of the range finder in the frame of `node` [m], its field `translation`, shape
                ``(3,)``.
            rotation: Its rotation in that frame, axis and angle [rad], its field `rotation`, shape ``(4,)``.
            version: Webots release. Up to R2021b, cameras look along -z and their depth is biased; the bias is
                removed. From R2022a on, cameras look along x.
            near: The device's field `near` [m], which determines the bias.

        Raises:
            PoseError: If `robot` finds no node of the range finder.
        """
        self._version = as_version(version)
        offset, axis_angle = as_numpy(translation, name="translation"), as_numpy(rotation, name="rotation")
        is_finite = np.isfinite(offset).all() and np.isfinite(axis_angle).all()
        if offset.shape != (3,) or axis_angle.shape != (4,) or not is_finite:
            raise PoseError("translation and rotation must be three and four finite numbers, as in the device's fields")
        self._mount = rigid_matrix(rotation_matrix(axis_angle.astype(np.float64)), offset)
        self._near = check_length(near, "near")
        asked = ("getWidth", "getHeight", "getFov", "getMinRange", "getMaxRange", "getRangeImage")
        missing = [name for name in asked if not callable(getattr(range_finder, name, None))]
        if missing:
            raise ArrayError(f"range_finder must be a Webots device with {missing[0]}(), got {range_finder!r}")
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
        """The device as a pinhole camera."""

    def depth(self) -> NDArray[np.float32]:
        """Read the device's image as planar depth [m], shape ``(H, W)``.

        Pixels that Webots has not rendered yet, whose range is 0, are NaN. +inf means that nothing is in range or that
        something is nearer than the minimum range: Webots does not distinguish them.

        Raises:
            ArrayError: If there is no image yet, or its size differs from the device's.
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
        """Compute the camera's pose: OpenCV camera to world, ``x y z qx qy qz qw`` [m], shape ``(7,)``.

        Args:
            node_pose: Pose of the node in the world, ``x y z qx qy qz qw`` or a 4x4 matrix. By default it is read
                from the node.
            quaternion: Order of the quaternion in a `node_pose` of 7 numbers, ``"xyzw"`` or ``"wxyz"``.
        """
        node_pose = to_xyzw(node_pose, quaternion, "node_pose")
        if node_pose is None:
            if self._node is None:
                needed = "the DepthEye needs a node: DepthEye(range_finder, node=...)"
                raise PoseError(f"node_pose must be given, or {needed}")
            matrix = rigid_matrix(self._node.getOrientation(), self._node.getPosition())
        else:
            rows = poses_to_opencv(node_pose, name="node_pose")
            if len(rows) != 1:
                raise PoseError(f"node_pose must be one pose, got {len(rows)}")
            matrix = poses_to_matrices(rows[0])
        return poses_to_opencv(matrix @ self._mount, self._version.axes, name="the pose")[0]

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
        """Label the pixels as `warpvis.classify` does, whose options it takes: `Label` values ``(1, H, W)`` uint8.

        `up` is the world's vertical axis; `node_pose` and `quaternion` are as for `pose`.
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
        """Project the points labeled by `classify`, whose arguments it takes, to a floor map.

        `bounds` and `cell_size` [m] are as for `warpvis.floor_map`.
        """
        depth, pose = self.depth(), self.pose(node_pose, quaternion=quaternion)  # read once: the simulation advances
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
        """Read the device's flat image, which is a list, a float32 buffer, or a pointer to one."""
        period = getattr(self._device, "getSamplingPeriod", None)
        if callable(period) and not period():  # up to R2022b, the buffer of a disabled device is uninitialized
            raise ArrayError(_NO_IMAGE)
        try:
            image = self._device.getRangeImage(data_type="buffer")
        except TypeError:  # older releases lack data_type
            image = self._device.getRangeImage()
        if image is None or (isinstance(image, ctypes._Pointer) and not image):
            raise ArrayError(_NO_IMAGE)
        if isinstance(image, ctypes._Pointer):
            return np.ctypeslib.as_array(image, shape=(self.camera.height * self.camera.width,)).copy()
        if isinstance(image, bytes | bytearray | memoryview):
            if len(memoryview(image).cast("B")) % 4:
                raise ArrayError(f"the range image must be float32 values of 4 bytes, got {len(image)} bytes")
            return np.frombuffer(image, dtype=np.float32)
        return as_numpy(image, name="the range image").astype(np.float32).ravel()


def _node_of(robot: SupervisorRobot, device: RangeFinder) -> SupervisorNode:
    """Find the node of a device.

    Up to R2022b, `Supervisor.getFromDevice` accepts only the device. From R2023a on, where the library calls C through
    ctypes, it accepts only the tag; only devices of that library have one.
    """
    find = getattr(robot, "getFromDevice", None)
    if not callable(find):
        raise PoseError(f"robot must be a Webots Supervisor with getFromDevice(), got {robot!r}")
    found: SupervisorNode | None = find(getattr(device, "_tag", device))
    if found is None:
        raise PoseError("robot finds no node of the range finder: its field supervisor must be TRUE")
    return found
