# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes, their transforms, and releases of Webots worlds."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, NamedTuple, NoReturn, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.checks import check_text, pluralize
from warpvis.errors import FileFormatError

_RELEASE = re.compile(r"R(\d{4})([a-z])(?:-rev\d+)?|V(\d{1,3})(?:\.(\d{1,3}))?(?:\.(\d{1,3}))?", re.ASCII)


BUILTIN_NODES = frozenset(
    """
    Accelerometer Altimeter Appearance Background BallJoint BallJointParameters Billboard Box Brake CadShape Camera
    Capsule Charger ColladaShape ColladaShapes Color Compass Cone Connector ContactProperties Coordinate Cubemap
    CustomRobot Cylinder Damping DifferentialWheels DirectionalLight Display DistanceSensor ElevationGrid Emitter
    Extrusion Fluid Focus Fog GPS Group Gyro HMD Hinge2Joint Hinge2JointParameters HingeJoint HingeJointParameters
    ImageTexture ImmersionProperties IndexedFaceSet IndexedLineSet InertialUnit JointLink JointParameters LED Lens
    LensFlare Lidar LightSensor LinearMotor Material Mesh Microphone Muscle Normal PBRAppearance Pen Physics Plane
    PointLight PointSet Pose PositionSensor Propeller Radar Radio RangeFinder Receiver Recognition Robot
    RotationalMotor Servo Shape Skin SliderJoint Slot Solid SolidReference Speaker Sphere SpotLight Supervisor
    TextureCoordinate TextureTransform TouchSensor Track TrackWheel Transform TransmissionJoint VacuumCup
    VacuumGripper Viewpoint VisualShape WorldInfo Zoom
    """.split()
)
"""Node types built into Webots, including obsolete ones; any other type is a PROTO."""


@dataclass(frozen=True, order=True)
class Version:
    """A Webots release, as in a file header: ``R2023b`` is (2023, 2), ``V7.2.5`` is (7, 2, 5)."""

    year: int
    number: int
    patch: int = 0

    @classmethod
    def parse(cls, text: str) -> Version:
        """Parse a version like ``R2023b`` or ``V8.6``.

        Raises:
            FileFormatError: If `text` is not a version.
        """
        match = _RELEASE.fullmatch(check_text(text, "version", FileFormatError))
        if match is None:
            raise FileFormatError(f"expected a Webots version like R2023b or V8.6, got {shown(text)}")
        year, letter, major, minor, patch = match.groups()
        if year:
            return cls(int(year), ord(letter) - ord("a") + 1)
        return cls(int(major), int(minor or 0), int(patch or 0))

    @property
    def z_up(self) -> bool:
        """Whether geometry is upright along z and devices look along x (since R2022a) rather than along y and -z."""
        return self.year >= 2022

    @property
    def axes(self) -> Literal["ros_body", "opengl"]:
        """Axes of devices in this version, as a convention of poses."""
        return "ros_body" if self.z_up else "opengl"

    def __str__(self) -> str:
        if self.year >= 1000:
            return f"R{self.year}{chr(ord('a') + self.number - 1)}"
        return f"V{self.year}.{self.number}" + (f".{self.patch}" if self.patch else "")


_Literal = TypeVar("_Literal")
_Replacement = TypeVar("_Replacement", bound=float | str | NDArray[np.float64])


@dataclass(eq=False)
class Node:
    """A node with the fields that its file specifies; callers provide the defaults of the others.

    Attributes:
        type: Name of a built-in node type or of a PROTO.
        fields: Values by field: a node, None for NULL, or a list of literals or nodes; a single literal is a list of
            length 1.
        name: DEF name.
        file: File that contains it.
        line: Line number in that file.
        version: Version in that file's header.
        protos: Files of the PROTOs whose bodies it comes from, outermost first.
        size: Number of nodes in its subtree, including itself, where every USE counts as a copy.
        height: Number of nodes on the longest path down, including itself.
    """

    type: str
    fields: dict[str, Value]
    name: str | None
    file: str
    line: int
    version: Version
    protos: tuple[str, ...] = ()
    size: int = 1
    height: int = 1

    def __repr__(self) -> str:
        return f"<{self.type} at {self.place}>"

    @property
    def place(self) -> str:
        """File and line, for messages."""
        return f"{self.file}:{self.line}"

    def number(self, field: str, default: float) -> float:
        """Read a number."""
        values = _literals(self, field, float, "a number", single=True)
        return values[0] if values else default

    def integer(self, field: str, default: int) -> int:
        """Read a whole number."""
        value = self.number(field, default)
        if value != int(value):
            self.refuse(field, "a whole number", f"{value:g}")
        return int(value)

    def flag(self, field: str, default: bool) -> bool:
        """Read a TRUE or FALSE."""
        values = _literals(self, field, bool, "TRUE or FALSE", single=True)
        return values[0] if values else default

    def text(self, field: str, default: str) -> str:
        """Read a string."""
        values = _literals(self, field, str, "a string", single=True)
        return values[0] if values else default

    def numbers(self, field: str) -> NDArray[np.float64]:
        """Read all numbers of a field, shape ``(n,)``; empty for a missing field."""
        return np.array(_literals(self, field, float, "numbers"), dtype=np.float64)

    def texts(self, field: str) -> list[str]:
        """Read all strings of a field; empty for a missing field."""
        return _literals(self, field, str, "strings")

    def vector(self, field: str, default: tuple[float, ...]) -> NDArray[np.float64]:
        """Read a vector, rotation or color, of the length of `default`."""
        if field not in self.fields:
            return np.array(default, dtype=np.float64)
        values = self.numbers(field)
        if len(values) != len(default):
            self.refuse(field, f"{len(default)} numbers", str(len(values)))
        return values

    def node(self, field: str) -> Node | None:
        """Read a node; None for NULL or a missing field."""
        nodes = self.nodes(field)
        if len(nodes) > 1:
            self.refuse(field, "one node", str(len(nodes)))
        return nodes[0] if nodes else None

    def nodes(self, field: str) -> list[Node]:
        """Read all nodes of a field, without NULL; empty for a missing field."""
        value = self.fields.get(field)
        if value is None:
            return []
        values = [value] if isinstance(value, Node) else value
        nodes = [item for item in values if isinstance(item, Node)]
        if len(nodes) < len(values):
            self.refuse(field, "nodes", described(next(item for item in values if not isinstance(item, Node))))
        return nodes

    def refuse(self, field: str, expected: str, got: str) -> NoReturn:
        """Raise a FileFormatError with the expected and the actual value of a field."""
        fail(self, f"{expected} in {field!r} of {self.type}", got)


Value: TypeAlias = Node | list[float | str | bool | Node] | None


def nodes_in(value: Value) -> list[Node]:
    """List the nodes of a value, without those below them."""
    return [item for item in (value if isinstance(value, list) else [value]) if isinstance(item, Node)]


def fail(node: Node, expected: str, got: object) -> NoReturn:
    """Raise a FileFormatError that names the file and line of a node."""
    raise FileFormatError(f"{node.place}: expected {expected}, got {got}")


def new_node(like: Node, kind: str, fields: dict[str, Value], name: str | None = None) -> Node:
    """Create a node with fields and a DEF name that replaces another one or is part of it, and has its version."""
    parts = [item for value in fields.values() for item in nodes_in(value)]
    size, height = 1 + sum(part.size for part in parts), 1 + max((part.height for part in parts), default=0)
    return Node(kind, fields, name, like.file, like.line, like.version, like.protos, size, height)


def _literals(node: Node, field: str, kind: type[_Literal], expected: str, *, single: bool = False) -> list[_Literal]:
    if field not in node.fields:
        return []
    value = node.fields[field]
    if not isinstance(value, list):
        node.refuse(field, expected, described(value))
    found: list[_Literal] = [item for item in value if isinstance(item, kind)]
    if len(found) < len(value):
        node.refuse(field, expected, described(next(item for item in value if not isinstance(item, kind))))
    if single and len(found) != 1:
        node.refuse(field, expected, pluralize(len(found), "value"))
    return found


def shown(text: str) -> str:
    """Quote a text for messages, truncated if it is long."""
    return repr(text if len(text) <= 40 else text[:37] + "...")


def described(value: Value | float | str | bool) -> str:
    """Format a value for messages."""
    if value is None:
        return "NULL"
    if isinstance(value, Node):
        return value.type
    if isinstance(value, bool):
        return "TRUE" if value else "FALSE"
    return "a list" if isinstance(value, list) else shown(value) if isinstance(value, str) else f"{value:g}"


def correction(node: Node, field: str, original: ArrayLike, replacement: ArrayLike) -> str:
    """Return the note that a field's value was replaced, as in Webots."""
    values = (np.ravel(value).tolist() for value in (original, replacement))
    before, after = (" ".join(f"{item:g}" if isinstance(item, float | int) else item for item in row) for row in values)
    return f"{node.place}: {field} {before} of {node.type} is replaced by {after}"


def replaced(node: Node, field: str, original: ArrayLike, replacement: _Replacement, notes: list[str]) -> _Replacement:
    """Note that a field's value was replaced, and return the replacement."""
    notes.append(correction(node, field, original, replacement))
    return replacement


class Names:
    """A set of unique names."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}

    def take(self, name: str) -> str:
        """Reserve and return `name`, or the first of ``"name (2)"``, ``"name (3)"``, ... that is not taken."""
        result, number = name, self._numbers.get(name, 1)
        while result in self._numbers:
            number += 1
            result = f"{name} ({number})"
        self._numbers[name] = number
        self._numbers[result] = 1
        return result


class Transform(NamedTuple):
    """An affine transform to the world: ``p_world = offset + linear p``."""

    linear: NDArray[np.float64]  # product of rotations and scales, shape ``(3, 3)``
    rotation: NDArray[np.float64]  # product of rotations, without scales, shape ``(3, 3)``
    offset: NDArray[np.float64]  # origin in the world [m], shape ``(3,)``

    def rigid(self) -> NDArray[np.float64]:
        """Return the rotation and the origin as a matrix, shape ``(4, 4)``."""
        return rigid_matrix(self.rotation, self.offset)

    def within(self, node: Node, scale: NDArray[np.float64]) -> Transform:
        """Compute the transform of a child node: ``p_parent = T + R (S p_child)``."""
        rotation = rotation_matrix(node.vector("rotation", (0.0, 0.0, 1.0, 0.0)))
        offset = self.offset + self.linear @ node.vector("translation", (0.0, 0.0, 0.0))
        return Transform(self.linear @ (rotation * scale), self.rotation @ rotation, offset)


def rigid_matrix(rotation: ArrayLike, offset: ArrayLike) -> NDArray[np.float64]:
    """Join a rotation, 9 numbers, and an offset [m] to a matrix, shape ``(4, 4)``."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.asarray(rotation, dtype=np.float64).reshape(3, 3), offset
    return matrix


def rotation_matrix(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert one SFRotation to a matrix; see `rotation_matrices`."""
    return rotation_matrices(rotation[None])[0]


def rotation_matrices(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert SFRotations, axis and angle [rad], to matrices ``(n, 3, 3)``; axes of any length, 0 0 0 is identity."""
    axes, angles = rotations[:, :3], rotations[:, 3, None, None]
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    x, y, z = np.divide(axes, lengths, out=np.zeros_like(axes), where=lengths > 0).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    return np.eye(3) + np.sin(angles) * cross + (1 - np.cos(angles)) * (cross @ cross)
