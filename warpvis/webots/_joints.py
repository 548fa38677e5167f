# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Joints of Webots worlds, and the links that they move."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import FARTHEST
from warpvis.core.poses import poses_to_opencv
from warpvis.errors import FileFormatError, SceneError, WarpvisError
from warpvis.scene.joints import Joint, JointTree
from warpvis.webots._nodes import Names, Node, Transform, replaced, rigid_matrix

WORLD = "world"
"""Name of the link that does not move."""
MOVING = {"HingeJoint": 1, "SliderJoint": 1, "Hinge2Joint": 2, "BallJoint": 3}
"""Types of joints, with their number of axes."""
MAX_JOINTS = 10_000
"""Maximum number of joint nodes and robots of a world whose links can move."""

_SUFFIXES = ("", "2", "3")
_MOTORS = {"RotationalMotor": "rotational motor", "LinearMotor": "linear motor"}
_SENSORS = {"PositionSensor": "position sensor"}
_X, _Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)

Expand = Callable[[Node], Node | None]
"""Returns the built-in node of a PROTO instance; None without its file."""
_Limits = tuple[float, float] | None


class _Axis(NamedTuple):
    direction: NDArray[np.float64]  # in the frame of the joint's parent node, normalized
    position: float  # saved in the file [rad or m]
    limits: _Limits
    device: str  # name of its motor or position sensor; empty without any


@dataclass(eq=False)
class Link:
    """What moves with the end point of a joint, or with a robot that has joints."""

    parent: Link | None
    """The link that carries it; None for the world."""
    node: Node
    """Its joint or robot."""
    transform: Transform
    """Transform of the joint's parent node, or of the robot."""
    axes: Sequence[_Axis] = ()
    """Axes of its joint; none for a robot."""
    anchor: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    """Center of the axes in the frame of the joint's parent node [m], shape ``(3,)``."""
    name: str = ""
    """Name of its first Solid."""
    frame: NDArray[np.float64] | None = None
    """Pose of its first Solid in the world, as saved, shape ``(4, 4)``."""

    def enter(self, name: str, frame: NDArray[np.float64]) -> None:
        """Store the name and the pose of the link's first Solid."""
        if self.frame is None:
            self.name, self.frame = name, frame

    def joint_frame(self) -> NDArray[np.float64]:
        """Return the frame of the axes in the world, shape ``(4, 4)``."""
        return rigid_matrix(self.transform.rotation, self.transform.offset + self.transform.linear @ self.anchor)


class Links(list[Link]):
    """The links of a world, in the order of the file: carriers precede what they carry."""

    def begin_robot(self, node: Node, transform: Transform, name: str) -> Link | None:
        """Begin and return the link of a robot that no other link carries."""
        if len(self) >= MAX_JOINTS:
            return None
        self.append(Link(None, node, transform, name=name, frame=transform.rigid()))
        return self[-1]

    def begin(
        self, node: Node, transform: Transform, parent: Link | None, expand: Expand, notes: list[str]
    ) -> Link | None:
        """Begin and return the link of a joint's end point; return `parent` if the node moves nothing.

        Args:
            node: A node of a type in `PARTS`.
            transform: The transform of the node that contains it.
            parent: The link that carries it.
            expand: Expands devices.
            notes: Receives corrections of invalid values.
        """
        closes_loop = all(end.type == "SolidReference" for end in node.nodes("endPoint"))  # or there is no end point
        if node.type not in MOVING or closes_loop:
            return parent
        if len(self) >= MAX_JOINTS:
            raise FileFormatError(f"{node.file}: expected at most {MAX_JOINTS} joints, got more; they are fixed")
        self.append(_read_link(node, transform, parent, expand, notes))
        return self[-1]


def _read_link(node: Node, transform: Transform, parent: Link | None, expand: Expand, notes: list[str]) -> Link:
    count = MOVING[node.type]
    parameters = [node.node(f"jointParameters{suffix}") for suffix in _SUFFIXES[:count]]
    axes = [
        _read_axis(node, number, found, direction, expand)
        for number, (found, direction) in enumerate(zip(parameters, _directions(node, parameters, notes), strict=True))
    ]
    first = parameters[0]
    is_slider = node.type == "SliderJoint"
    anchor = np.zeros(3) if first is None or is_slider else first.vector("anchor", (0.0, 0.0, 0.0))
    return Link(parent, node, transform, axes, anchor)


def _directions(node: Node, parameters: Sequence[Node | None], notes: list[str]) -> list[NDArray[np.float64]]:
    """Return the axes of a joint; those of a BallJoint are perpendicular."""
    if node.type == "SliderJoint":
        return [_direction(parameters[0], _Z, _Z, notes)]
    if node.type != "BallJoint":
        seconds = [_direction(found, _Z, _Z, notes) for found in parameters[1:]]
        return [_direction(parameters[0], _X, _X, notes), *seconds]
    _, second, third = parameters
    first, last = _direction(second, _X, _Z, notes), _direction(third, _Z, _Z, notes)
    if second is None and third is not None:
        first = _perpendicular(last, _Z, _X)
    elif second is not None and third is None:
        last = _perpendicular(first, _X, _Z)
    middle = np.cross(last, first)
    length = float(np.linalg.norm(middle))
    if length < 1e-12:
        node.refuse("jointParameters3", "an axis that differs from that of 'jointParameters2'", str(last.tolist()))
    return [first, middle / length, last]


def _direction(
    parameters: Node | None, missing: tuple[float, ...], default: tuple[float, ...], notes: list[str]
) -> NDArray[np.float64]:
    """Return the normalized axis: `missing` without parameters, `default` without the field."""
    if parameters is None:
        return np.array(missing)
    axis = parameters.vector("axis", default)
    if not axis.any():
        axis = replaced(parameters, "axis", axis, np.array(_Z), notes)
    axis = axis / np.abs(axis).max()  # squares of large and small numbers are out of range
    if not np.isfinite(axis).all():
        parameters.refuse("axis", "finite numbers", str(parameters.numbers("axis").tolist()))
    return axis / np.linalg.norm(axis)


def _perpendicular(axis: NDArray[np.float64], first: Sequence[float], second: Sequence[float]) -> NDArray[np.float64]:
    """Return the normalized cross product of an axis and the first direction that is not parallel to it."""
    crosses = (np.cross(axis, other) for other in (first, second))
    found = next(cross for cross in crosses if cross.any())
    return found / np.linalg.norm(found)


def _read_axis(
    node: Node, number: int, parameters: Node | None, direction: NDArray[np.float64], expand: Expand
) -> _Axis:
    position = 0.0 if parameters is None else parameters.number("position", 0.0)
    devices = [(device, expand(device) or device) for device in node.nodes(f"device{_SUFFIXES[number]}")]
    motor = next((pair for pair in devices if pair[1].type in _MOTORS), None)
    limits = None if parameters is None else _limits(parameters, "minStop", "maxStop")
    if limits is None and motor is not None:
        limits = _limits(motor[1], "minPosition", "maxPosition")
        if node.type == "BallJoint" and number == 1:  # as in Webots
            lower, upper = limits or (-math.inf, math.inf)
            limits = max(lower, -math.pi / 2), min(upper, math.pi / 2)
    named = motor or next((pair for pair in devices if pair[1].type in _SENSORS), None)
    return _Axis(direction, position, limits, "" if named is None else _device_name(*named))


def _limits(node: Node, lower: str, upper: str) -> _Limits:
    """Return two fields as limits; None if they are equal, which Webots ignores, or in the wrong order."""
    found = node.number(lower, 0.0), node.number(upper, 0.0)
    return found if found[0] < found[1] else None


def _device_name(device: Node, body: Node) -> str:
    """Return the name of a device, given its PROTO instance and its built-in node."""
    default = {**_MOTORS, **_SENSORS}[body.type]
    return device.text("name", "") or body.text("name", "") or default


def make_joints(links: Iterable[Link]) -> tuple[JointTree, dict[Link, str], list[str]]:
    """Return the joints of links, the names of the links that can move, and errors of joints that are left out.

    Robots without joints are left out. Joints are named after the motor, else the position sensor, else the end point;
    the second and third axis without a device have ``::2`` and ``::3`` in addition.
    """
    links = list(links)
    carriers = {link.parent for link in links if link.axes}
    names: dict[Link, str] = {}
    frames: dict[Link | None, NDArray[np.float64]] = {None: np.eye(4)}
    taken, joint_names = Names(), Names()
    taken.take(WORLD)
    joints: list[Joint] = []
    errors: list[str] = []
    for link in links:  # parents first
        if not link.axes and link not in carriers:
            continue
        parent = link.parent
        while parent is not None and parent not in names:
            parent = parent.parent
        frame = link.joint_frame() if link.frame is None else link.frame
        base = link.name or link.node.name or link.node.type
        try:
            made = _joints(link, frames[parent], frame)
        except WarpvisError as error:
            errors.append(f"{link.node.place}: {link.node.type} is fixed: {error}")
            if parent is not None:
                names[link], frames[link] = names[parent], frames[parent]
            continue
        names[link], frames[link] = taken.take(base), frame
        above = WORLD if parent is None else names[parent]
        for number, options in enumerate(made):
            device = link.axes[number].device if link.axes else ""
            is_last = number == len(made) - 1
            child = names[link] if is_last else taken.take(f"{names[link]}::{number + 1}")
            name = joint_names.take(device or (f"{base}::{number + 1}" if number else base))
            joints.append(Joint(name, parent=above, child=child, **options))
            above = child
    return JointTree(joints), names, errors


def _joints(link: Link, parent: NDArray[np.float64], frame: NDArray[np.float64]) -> list[dict[str, Any]]:
    """Return the arguments of the joints between a link and its parent, whose poses are as saved."""
    if not link.axes:
        rows: list[dict[str, Any]] = [
            {"kind": "floating", "initial": poses_to_opencv(np.linalg.inv(parent) @ frame)[0]}
        ]
    else:
        place, motion, rows = link.joint_frame(), np.eye(4), []
        if not (np.abs(place[:3, 3]) <= FARTHEST).all():
            raise SceneError(f"its anchor must be within {FARTHEST:g} m of the origin")
        for axis in link.axes:
            row = _revolute(axis) if link.node.type != "SliderJoint" else _prismatic(axis, link.transform)
            motion = motion @ Joint("", parent="", child="", **row).child_poses(np.array([[row["initial"]]]))[0]
            rows.append(row)
        rows[0]["origin"] = np.linalg.inv(parent) @ place
        rows[-1]["child_origin"] = np.linalg.inv(motion) @ np.linalg.inv(place) @ frame
    for row in rows:
        Joint("", parent="", child="", **row)  # raises for poses that are out of range
    return rows


def _revolute(axis: _Axis) -> dict[str, Any]:
    kind = "continuous" if axis.limits is None else "revolute"
    return {"kind": kind, "axis": axis.direction, "limits": axis.limits, "initial": axis.position}


def _prismatic(axis: _Axis, transform: Transform) -> dict[str, Any]:
    """Return a sliding joint; a scale of the nodes above it multiplies its values, which are meters of the world."""
    direction = transform.rotation.T @ (transform.linear @ axis.direction)
    scale = float(np.linalg.norm(direction))
    limits = None if axis.limits is None else (scale * axis.limits[0], scale * axis.limits[1])
    return {"kind": "prismatic", "axis": direction, "limits": limits, "initial": scale * axis.position}
