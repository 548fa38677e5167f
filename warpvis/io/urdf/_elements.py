# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The elements of URDF that define its picture: links, visual and collision elements, materials, and joints.

Inertia, transmissions, sensors, and elements of simulators are not read. Specification: http://wiki.ros.org/urdf/XML
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, get_args
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.errors import FileFormatError, WarpvisError
from warpvis.scene.joints import Joint, JointKind, JointTree, Mimic

_XACRO_SPACE = re.compile(r"\{http://(www\.)?(ros\.org/wiki|wiki\.ros\.org)/xacro/?#?\w*\}")
_UNBOUND = re.compile(r"[<\s/]([A-Za-z_][\w.-]*):[A-Za-z_]")
_OPTENV = re.compile(r"\$\(optenv\s+\S+\s*([^)]*)\)")
"""A number from an environment variable, with a default value, that xacro was not applied to."""
_SIZES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}
"""Attributes of round shapes. Capsules are an extension of Bullet, Drake, MoveIt and others."""


class UrdfMaterial(NamedTuple):
    """A material: its color, red, green, blue and opacity, and the URL of its texture."""

    color: tuple[float, float, float, float] | None
    texture: str | None


class Visual(NamedTuple):
    """A visual or collision element of a link."""

    name: str
    link: str
    origin: NDArray[np.float64]
    """Element to link, shape ``(4, 4)``."""
    shape: str
    """``"box"``, ``"sphere"``, ``"cylinder"``, ``"capsule"`` or ``"mesh"``."""
    sizes: tuple[float, ...]
    """Sizes of a box along its axes [m], radius and length of a round shape [m], or scale factors of a mesh."""
    url: str
    """File of a mesh, as written."""
    material: UrdfMaterial | None


@dataclass
class Robot:
    """The contents of a URDF file."""

    path: Path
    root: ElementTree.Element
    materials: dict[str, UrdfMaterial] = field(default_factory=dict)
    joints: JointTree = field(default_factory=JointTree)
    skipped: list[str] = field(default_factory=list)
    """Descriptions of elements that cannot be shown, as parts of a sentence."""
    corrected: list[str] = field(default_factory=list)
    """Sentences about values that were corrected or ignored, and that do not hide a surface."""

    def note(self, sentence: str) -> None:
        """Add a sentence about a corrected value once."""
        if sentence not in self.corrected:
            self.corrected.append(sentence)


def parse_xml(path: Path, text: bytes) -> ElementTree.Element:
    """Parse an XML file; undeclared prefixes, such as those of simulators' elements, are allowed."""
    text = text.removeprefix(b"\xef\xbb\xbf").strip(b"\0 \t\r\n")
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        first, line = error, error.position[0]
    if "unbound prefix" in str(first):
        found = dict.fromkeys(_UNBOUND.findall(text.decode(errors="replace")))
        declared = "".join(f' xmlns:{name}="{name}"' for name in found if not name.startswith("xml"))
        try:
            return ElementTree.fromstring(re.sub(rb"<robot\b", b"<robot" + declared.encode(), text, count=1))
        except ElementTree.ParseError:
            pass
    raise FileFormatError(f"{path}:{line}: cannot be read as XML: {first}")


def is_xacro(root: ElementTree.Element) -> bool:
    """Return whether a file has elements of xacro."""
    return any(
        _XACRO_SPACE.match(str(element.tag)) or str(element.tag).startswith("{xacro}") for element in root.iter()
    )


def parse_robot(path: Path, root: ElementTree.Element) -> Robot:
    """Parse the materials and joints of a robot.

    Raises:
        FileFormatError: If a joint has invalid numbers, or if the joints are no tree.
    """
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    robot = Robot(path, root)
    robot.materials = _named_materials(robot)
    joints = list(_parse_joints(robot))
    try:
        robot.joints = JointTree(joints)
    except WarpvisError as error:
        raise FileFormatError(f"{path}: {error}") from None
    return robot


def parse_visuals(robot: Robot, tag: str) -> list[Visual]:
    """Parse the elements of links that have a surface; `tag` is ``"visual"`` or ``"collision"``.

    Raises:
        FileFormatError: If an element has invalid numbers.
    """
    found = []
    for link in robot.root.findall("link"):
        visuals = [_parse_visual(robot, link.get("name", ""), element) for element in link.findall(tag)]
        found += [visual for visual in visuals if visual is not None]
    return found


def _named_materials(robot: Robot) -> dict[str, UrdfMaterial]:
    """Return the first definition of each named material, at the top of the file or in a link."""
    found: dict[str, UrdfMaterial] = {}
    for element in [*robot.root.findall("material"), *robot.root.iterfind("link/visual/material")]:
        material = _parse_material(element, robot)
        if material is not None and element.get("name"):
            found.setdefault(element.get("name", ""), material)
    return found


def _parse_material(element: ElementTree.Element, robot: Robot) -> UrdfMaterial | None:
    """Return a material; None if the element only refers to one by its name."""
    color, texture = element.find("color"), element.find("texture")
    rgba = None
    if color is not None and color.get("rgba"):
        try:
            numbers = [float(word) for word in color.get("rgba", "").replace(",", " ").split()]
        except ValueError:
            numbers = []
        if len(numbers) in (3, 4) and np.isfinite(numbers).all():
            red, green, blue, *opacity = np.clip(numbers, 0, 1).tolist()
            rgba = (red, green, blue, opacity[0] if opacity else 1.0)
        else:
            where = f"material {element.get('name', '')!r}"
            robot.note(f"{where}: rgba must be four numbers, got {truncate(color.get('rgba', ''))!r}")
    url = None if texture is None else texture.get("filename") or None
    return UrdfMaterial(rgba, url) if rgba is not None or url else None


def _parse_visual(robot: Robot, link: str, element: ElementTree.Element) -> Visual | None:
    """Parse a visual or collision element; None if it has no surface."""
    where = f"a {element.tag} of link {link!r}"
    shape = next(iter(element.findall("geometry/*")), None)
    if shape is None:
        return None
    kind, url, sizes = shape.tag, "", tuple[float, ...]()
    if kind == "mesh":
        url = shape.get("filename") or shape.get("uri") or shape.get("url") or ""
        sizes = tuple(_numbers(robot, shape.get("scale"), f"{where}: scale", (1, 3), (1.0, 1.0, 1.0)))
        sizes = sizes * 3 if len(sizes) == 1 else sizes
    elif kind == "box":
        sizes = tuple(_numbers(robot, shape.get("size"), f"{where}: size of its box", (3,)))
    elif kind in _SIZES:
        sizes = tuple(_numbers(robot, shape.get(key), f"{where}: {key} of its {kind}", (1,))[0] for key in _SIZES[kind])
    else:
        robot.skipped.append(f"a {truncate(kind)} of link {link!r}, which is no shape of URDF")
        return None
    if kind not in ("mesh", "box") and min(sizes) < 0:
        robot.skipped.append(f"a {kind} of link {link!r}, whose size is negative")
    if (kind == "mesh" and 0 in sizes) or (kind == "box" and np.count_nonzero(sizes) < 2):
        return None
    if kind in _SIZES and min(sizes) <= 0:
        return None
    material = next(iter(element.findall("material")), None)
    chosen = (
        None if material is None else _parse_material(material, robot) or robot.materials.get(material.get("name", ""))
    )
    return Visual(element.get("name", ""), link, _origin(robot, element, where), kind, sizes, url, chosen)


def _parse_joints(robot: Robot) -> Iterator[Joint]:
    """Yield the joints with a parent and a child; those of unknown types are fixed."""
    elements = [item for item in robot.root.findall("joint") if _link_of(item, "parent") and _link_of(item, "child")]
    kinds, names, children = get_args(JointKind), set[str](), set[str]()
    one_value = {
        item.get("name", "") for item in elements if item.get("type") in ("revolute", "continuous", "prismatic")
    }
    for element in elements:
        given, kind, child = element.get("name", ""), element.get("type", ""), _link_of(element, "child")
        where = f"joint {given!r}"
        if child in children:
            robot.note(f"{where}: its child {child!r} has a joint already; this one is ignored")
            continue
        children.add(child)
        name = given
        while name in names:
            name = f"{name}_1"
        names.add(name)
        if kind not in kinds:
            robot.note(f"{where}: the type {kind!r} is not supported; it is fixed")
            kind = "fixed"
        axis = np.array(_numbers(robot, _child_value(element, "axis", "xyz"), f"axis of {where}", (3,), (1, 0, 0)))
        if kind not in ("fixed", "floating") and not axis.any():
            robot.note(f"{where}: its axis is zero; it is fixed")
            kind, axis = "fixed", np.array([1.0, 0, 0])
        limits = _parse_limits(robot, element, where) if kind in ("revolute", "prismatic") else None
        mimic = _parse_mimic(robot, element, where) if kind in ("revolute", "continuous", "prismatic") else None
        if mimic is not None and mimic.joint not in one_value:
            robot.note(f"{where}: it follows {mimic.joint!r}, which is no joint with a value")
            mimic = None
        origin = _origin(robot, element, where)
        yield Joint(name, kind, _link_of(element, "parent"), child, origin, axis, limits, mimic)  # type: ignore[arg-type]


def _parse_limits(robot: Robot, element: ElementTree.Element, where: str) -> tuple[float, float] | None:
    """Return the limits of a joint; None without a valid range."""
    found = element.find("limit")
    if found is None or (found.get("lower") is None and found.get("upper") is None):
        return None
    lower, upper = (_optional(robot, found, key, f"{key} limit of {where}", 0.0) for key in ("lower", "upper"))
    if lower is None or upper is None or lower > upper:
        robot.note(f"{where}: its limits {found.get('lower')!r} and {found.get('upper')!r} are ignored")
        return None
    return None if lower == upper == 0 else (lower, upper)


def _parse_mimic(robot: Robot, element: ElementTree.Element, where: str) -> Mimic | None:
    found = element.find("mimic")
    if found is None:
        return None
    factor, offset = _optional(robot, found, "multiplier", where, 1.0), _optional(robot, found, "offset", where, 0.0)
    if factor is None or offset is None:
        robot.note(f"{where}: its mimic is ignored, since its numbers are invalid")
        return None
    return Mimic(found.get("joint", ""), factor, offset)


def _optional(robot: Robot, element: ElementTree.Element, key: str, what: str, otherwise: float) -> float | None:
    """Return a number of an element; None if it is invalid."""
    try:
        return _numbers(robot, element.get(key), what, (1,), (otherwise,))[0]
    except FileFormatError:
        return None


def _link_of(element: ElementTree.Element, tag: str) -> str:
    return _child_value(element, tag, "link") or ""


def _child_value(element: ElementTree.Element, tag: str, key: str) -> str | None:
    found = element.find(tag)
    return None if found is None else found.get(key)


def _origin(robot: Robot, element: ElementTree.Element, where: str) -> NDArray[np.float64]:
    """Return the matrix of an ``origin``: translation, and rotations about the fixed axes x, y and z."""
    zero, matrix = (0.0, 0.0, 0.0), np.eye(4)
    found = element.find("origin")
    if found is not None:
        matrix[:3, 3] = _numbers(robot, found.get("xyz"), f"{where}: xyz of its origin", (3,), zero)
        a, b, c = _numbers(robot, found.get("rpy"), f"{where}: rpy of its origin", (3,), zero)
        (sa, sb, sc), (ca, cb, cc) = np.sin([a, b, c]), np.cos([a, b, c])
        matrix[:3, :3] = [
            (cb * cc, sa * sb * cc - ca * sc, ca * sb * cc + sa * sc),
            (cb * sc, sa * sb * sc + ca * cc, ca * sb * sc - sa * cc),
            (-sb, sa * cb, ca * cb),
        ]
    return matrix


def _numbers(
    robot: Robot, text: str | None, what: str, counts: Sequence[int], otherwise: Sequence[float] | None = None
) -> list[float]:
    """Parse numbers separated by spaces or commas; `otherwise` if there is no text. Further numbers are ignored."""
    if otherwise is not None and (text is None or not text.strip()):
        return [float(value) for value in otherwise]
    most = max(counts)
    try:
        found = [float(word) for word in _OPTENV.sub(r"\1", text or "").replace(",", " ").split()]
    except ValueError:
        found = []
    if len(found) > most:
        robot.note(f"{what} must be {_expected(most)}, got {truncate(text or '')!r}, of which further ones are ignored")
        found = found[:most]
    if len(found) not in counts or not np.isfinite(found).all():
        hint = "; convert xacro first" if "${" in (text or "") else ""
        raise FileFormatError(f"{robot.path}: {what} must be {_expected(most)}, got {truncate(text or '')!r}{hint}")
    return found


def _expected(count: int) -> str:
    return "a number" if count == 1 else "three numbers"
