# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""XML elements with their file and line, and the values in them: numbers, flags, colors and poses."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.core.file_content import require_content
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import FileFormatError

_MAX_DEPTH = 200
"""Maximum depth of nested elements, which limits the recursion of readers."""
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_DECLARATION = re.compile(rb"<\?xml[^>]*\?>")
_BARE_AMPERSAND = re.compile(rb"&(?!#?\w{1,10};)")
_TEMPLATES = (
    (b"<%", "an ERB template", "erb {0} > model.sdf"),
    (b"{%", "a Jinja template", "jinja2 {0} > model.sdf"),
    (b"{{", "a Jinja template", "jinja2 {0} > model.sdf"),
    (b"<xacro:", "a xacro file", "xacro {0} > model.sdf"),
)
"""Marks in templates, their kind, and the command that converts them."""
_FLAGS = {"true": True, "1": True, "false": False, "0": False}


class Node(ElementTree.Element):
    """An XML element that knows its place."""

    path: Path = Path()
    """The file."""
    line: int = 0
    """Line of its start tag."""

    def fail(self, message: str) -> NoReturn:
        """Raise a `FileFormatError` about this element."""
        name = self.get("name")
        subject = f"<{self.tag}>" if name is None else f"<{self.tag} name={truncate(name)!r}>"
        raise FileFormatError(f"{self.path}:{self.line}: {subject} {message}")

    @property
    def name(self) -> str:
        """Its attribute `name`, stripped; raise an error without one."""
        name = (self.get("name") or "").strip()
        return name or self.fail("must have a name")

    def child(self, path: str) -> Node | None:
        """Return the first element at a path; None if there is none."""
        found = self.find(path)
        return found if isinstance(found, Node) else None

    def nearest(self, path: str) -> Node:
        """Return the first element at a path, else this one; for messages."""
        found = self.child(path)
        return self if found is None else found

    def children(self, *tags: str) -> list[Node]:
        """Return the child elements with one of the tags, in order; all of them without tags."""
        return [child for child in self if isinstance(child, Node) and (not tags or child.tag in tags)]

    def string(self, path: str = "", default: str = "") -> str:
        """Return the stripped text of the element at a path."""
        found = self.child(path) if path else self
        return default if found is None or not (found.text or "").strip() else str(found.text).strip()

    def flag(self, path: str, default: bool) -> bool:
        """Return a truth value: ``true``, ``1``, ``false`` or ``0``."""
        found = self.child(path)
        if found is None or not found.string():
            return default
        value = _FLAGS.get(found.string().lower())
        return found.fail(f"must be true or false, got {truncate(found.string())!r}") if value is None else value

    def numbers(self, path: str, default: Sequence[float], *, minimum: float = -math.inf) -> tuple[float, ...]:
        """Return the finite numbers at a path, as many as the default has."""
        found = self.child(path) if path else self
        return tuple(default) if found is None else parse_numbers(found, found.string(), len(default), minimum)

    def number(self, path: str, default: float, *, minimum: float = -math.inf) -> float:
        """Return the finite number at a path."""
        return self.numbers(path, (default,), minimum=minimum)[0]

    def positive(self, path: str, default: float) -> float:
        """Return the number greater than 0 at a path."""
        return self.positives(path, (default,))[0]

    def positives(self, path: str, default: Sequence[float]) -> tuple[float, ...]:
        """Return the numbers greater than 0 at a path."""
        values = self.numbers(path, default)
        if min(values) <= 0:
            self.nearest(path).fail(f"must be greater than 0, got {min(values):g}")
        return values

    def color(self, path: str) -> tuple[float, float, float, float] | None:
        """Return red, green, blue and opacity from 0 to 1; None without such an element. Three numbers are opaque."""
        found = self.child(path)
        if found is None:
            return None
        words = found.string().split()
        values = parse_numbers(found, found.string(), 3 if len(words) == 3 else 4)
        r, g, b, a = (min(max(value, 0.0), 1.0) for value in (*values, 1.0)[:4])
        return r, g, b, a


def parse_numbers(
    node: Node, text: str, count: int, minimum: float = -math.inf, *, finite: bool = True
) -> tuple[float, ...]:
    """Parse the numbers of a text."""
    try:
        values = tuple(map(float, text.split()))
    except ValueError:
        values = ()
    is_valid = all(math.isfinite(value) or (not finite and not math.isnan(value)) for value in values)
    if len(values) != count or not is_valid:
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        node.fail(f"must be {expected}, got {truncate(text)!r}")
    if min(values, default=minimum) < minimum:
        node.fail(f"must be at least {minimum:g}, got {min(values):g}")
    return values


def parse_file(path: Path) -> Node:
    """Parse an XML file whose root is ``<sdf>`` or another element; see `require_sdf`."""
    require_content(path, "an SDF file")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    _refuse_templates(path, content)
    try:
        return _parse(path, content)
    except expat.ExpatError as error:
        plain = _as_gazebo_reads(content)
        if plain != content:
            with contextlib.suppress(expat.ExpatError):
                return _parse(path, plain)
        reason = expat.ErrorString(error.code)
        raise FileFormatError(f"{path}:{error.lineno}: cannot be read as XML: {reason}") from None


def _as_gazebo_reads(content: bytes) -> bytes:
    """Return XML without what only Gazebo's parser accepts: late declarations, ``--`` in comments, a bare ``&``."""
    plain = _COMMENT.sub(lambda comment: b"\n" * comment[0].count(b"\n"), content)
    return _BARE_AMPERSAND.sub(b"&amp;", _DECLARATION.sub(b"", plain))


def _parse(path: Path, content: bytes) -> Node:
    builder = ElementTree.TreeBuilder(element_factory=Node)
    parser = expat.ParserCreate()
    depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        line = parser.CurrentLineNumber
        if depth > _MAX_DEPTH:
            raise FileFormatError(f"{path}:{line}: elements must be nested at most {_MAX_DEPTH} deep")
        node = builder.start(tag, attributes)
        assert isinstance(node, Node)
        node.path, node.line = path, line

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(content, True)
        root = builder.close()
    except (AssertionError, ValueError, LookupError) as error:
        raise FileFormatError(f"{path}: cannot be read as XML: {error}") from None
    assert isinstance(root, Node)
    return root


def _refuse_templates(path: Path, content: bytes) -> None:
    code = _COMMENT.sub(b"", content)
    for mark, kind, command in _TEMPLATES:
        if mark in code:
            raise FileFormatError(f"{path}: is {kind}; convert it to SDF first: {command.format(path.name)}")


def require_sdf(root: Node) -> tuple[int, int]:
    """Return the version of an ``<sdf>`` element, such as (1, 9); raise an error for other elements."""
    if root.tag == "gazebo":  # before version 1.3
        return 1, 0
    if root.tag != "sdf":
        raise FileFormatError(f"{root.path}:{root.line}: must be SDF, which begins with <sdf>, got XML of <{root.tag}>")
    text = root.get("version", "1.6")
    parts = text.split(".")
    if len(parts) < 2 or not all(part.isascii() and part.isdigit() and len(part) < 9 for part in parts[:2]):
        root.fail(f"must have a version such as 1.9, got {truncate(text)!r}")
    version = int(parts[0]), int(parts[1])
    if version[0] != 1:
        root.fail(f"must have a version from 1.0 to 1.12, got {truncate(text)!r}")
    return version


def raw_pose(node: Node) -> NDArray[np.float64]:
    """Return the matrix, ``(4, 4)``, of the ``<pose>`` of an element; the identity without one.

    A pose is ``x y z roll pitch yaw``, with angles in radians or, by its attribute, in degrees; or, with the rotation
    format ``quat_xyzw``, a position and a quaternion.
    """
    pose = node.child("pose")
    if pose is None:
        origin = node.child("origin")  # version 1.0
        text = None if origin is None else origin.get("pose")
        return np.eye(4) if origin is None or text is None else _euler_matrix(parse_numbers(origin, text, 6))
    return pose_value(pose)


def pose_value(pose: Node) -> NDArray[np.float64]:
    """Return the matrix, ``(4, 4)``, of a ``<pose>``."""
    if not pose.string():
        return np.eye(4)
    kind = pose.get("rotation_format", "euler_rpy")
    degrees = _FLAGS.get(pose.get("degrees", "false").strip().lower())
    if degrees is None:
        pose.fail(f"must have degrees true or false, got {truncate(pose.get('degrees', ''))!r}")
    if kind == "quat_xyzw":
        row = np.array(parse_numbers(pose, pose.string(), 7))
        length = np.linalg.norm(row[3:])
        if degrees or not length > 1e-9:
            pose.fail("must have a quaternion other than 0" if not degrees else "must have no degrees in a quaternion")
        row[3:] /= length
        return poses_to_matrices(row)
    if kind != "euler_rpy":
        pose.fail(f"must have the rotation_format euler_rpy or quat_xyzw, got {truncate(kind)!r}")
    x, y, z, *angles = parse_numbers(pose, pose.string(), 6)
    roll, pitch, yaw = np.radians(angles) if degrees else angles
    return _euler_matrix((x, y, z, roll, pitch, yaw))


def _euler_matrix(values: Sequence[float]) -> NDArray[np.float64]:
    """Return the matrix of ``x y z roll pitch yaw``: rotations about the fixed axes x, y, z, in this order."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in values[3:])
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    matrix[:3, 3] = values[:3]
    return matrix
