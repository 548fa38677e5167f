# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Traversal of a Webots world's node tree, which collects triangles, names, labels and devices."""

from __future__ import annotations

import contextlib
import dataclasses
import re
import threading
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from warpvis.core.arrays import FARTHEST
from warpvis.core.checks import pluralize
from warpvis.core.poses import poses_to_opencv
from warpvis.errors import FileFormatError
from warpvis.scene import keep_winding
from warpvis.scene.joints import JointTree
from warpvis.scene.lights import Background, Light
from warpvis.webots._appearance import APPEARANCES, Surface, shape_appearance
from warpvis.webots._detection import Extent, ball_about, bounding_geometry
from warpvis.webots._devices import Device, read_device
from warpvis.webots._grammar import World
from warpvis.webots._joints import Link, Links, make_joints
from warpvis.webots._lidars import Lidar, read_lidar
from warpvis.webots._lights import (
    LIGHTS,
    Irradiance,
    expand_background,
    find_irradiance,
    read_background,
    read_lights,
    stand_in_sky,
)
from warpvis.webots._nodes import BUILTIN_NODES, Names, Node, Transform, nodes_in
from warpvis.webots._parts import (
    JOINTS,
    LINES,
    PARTS,
    ROBOTS,
    SOLIDS,
    TRANSFORMS,
    UNSEEN,
    Solid,
    Step,
    corrected_scale,
    expand_joint,
    is_human,
    is_level,
    missing_parts,
    parts_of,
    vertical_axis,
)
from warpvis.webots.protos._builtin import BUILTIN, expand
from warpvis.webots.protos._expansion import Protos
from warpvis.webots.protos._lamps import expand_lamp
from warpvis.webots.protos._roads import ROADS, expand_road
from warpvis.webots.protos._standins import DEPTH_CAMERAS, KNOWN, expand_depth_camera, stand_in, stand_in_geometry
from warpvis.webots.shapes._geometry import GEOMETRIES, MissingMeshError, reset_fields, tessellate
from warpvis.webots.shapes._polygons import Triangles

EYES = "EYES"
"""DEF name, in any case, of the Pose of a person's eyes, which looks in the direction of cameras."""
MAX_VISITED = 1_000_000
"""Maximum number of visited nodes of a world, each USE counted as a copy."""
MAX_TRIANGLES = 50_000_000
"""Maximum number of triangles of a world."""

_ARENAS = {"RectangleArena", "CircleArena"}
_GROUNDS = {"Floor", "UnevenTerrain", *ROADS}
_NAMES = {"RangeFinder": "range-finder", **dict.fromkeys(ROBOTS, "robot")}


class _TooMuchError(FileFormatError):
    """A world exceeds a limit; skipping a single node does not help."""


class Reader:
    """Traverses a world and collects its content."""

    def __init__(self, world: World, search_path: list[Path], strict: bool, cache: Path | None = None) -> None:
        self.version = world.version
        self.solids: list[Solid] = []
        self.devices: dict[str, Device] = {}
        self.lidars: dict[str, Lidar] = {}
        self.robots: dict[str, list[Solid]] = {}
        self.recognizable: dict[str, tuple[Node, list[Solid]]] = {}
        self.extents: list[Extent] = []  # all Solids
        self.bounds: dict[str, Extent] = {}  # Solids with recognitionColors
        self.links = Links()
        self.lights: list[Light] = []
        self.background: Background | None = None
        self.irradiance: Irradiance = ()
        self.materials: Counter[str] = Counter()
        """Number of shapes with an Appearance, and with a PBRAppearance or a PROTO of one."""
        self.skipped: Counter[str] = Counter()
        self.below: Counter[str] = Counter()  # number of nodes in the fields of skipped nodes
        self.stand_ins: Counter[str] = Counter()
        self.reasons: dict[str, str] = {}
        self.refused: list[str] = []
        self.notes: list[str] = []
        self.up: Literal["z", "y"] = "z" if world.version.z_up else "y"
        self._world, self._strict = world, strict
        self._protos = Protos(world, search_path, cache)
        self._lines: list[tuple[int, str, Solid | None]] = []
        self._meshes: dict[int, tuple[Node, Triangles | None]] = {}  # by id of the node, with the node to keep it alive
        self._mounts: dict[tuple[str, bool], Link | None] = {}  # links of devices and lidars by name
        self._triangles = 0
        self._lock = threading.Lock()
        self._taken = {kind: Names() for kind in ("recognized", "devices", "lidars", "robots")}
        with self._leaving_out():
            self.up = vertical_axis(world, self.notes)

    def walk(self) -> None:
        """Visit all nodes, in the order of the file."""
        try:
            self._walk()
        finally:
            self._protos.close()

    def _walk(self) -> None:
        start = Transform(np.eye(3), np.eye(3), np.zeros(3))
        steps = [Step(node, start) for node in reversed(self._world.nodes)]
        visited = 0
        while steps:
            visited += 1
            if visited > MAX_VISITED:
                raise _TooMuchError(f"{self._world.path}: expected at most {MAX_VISITED} nodes, got more")
            step = steps.pop()
            with self._leaving_out():
                steps += reversed(list(self._visit(step)))

    @contextlib.contextmanager
    def _leaving_out(self) -> Iterator[None]:
        """Skip the node that is being read if it cannot be read; with `strict`, raise the error."""
        try:
            yield
        except FileFormatError as error:
            if self._strict or isinstance(error, _TooMuchError | MissingMeshError):
                raise
            self.refused.append(str(error))

    def _visit(self, step: Step) -> Iterable[Step]:
        """Collect a node; return steps for its parts."""
        node = step.node
        if node.type in UNSEEN:
            lit = expand_background(node, self.up)
            if lit.type in LIGHTS:
                self.lights += [] if step.origin else read_lights(lit, step.transform)
            if lit.type == "Background" and self.background is None:
                self.background = read_background(lit, self.up, self.find_mesh)
                self.irradiance = find_irradiance(lit, self.find_mesh)
                if lit is not node and self.background and not self.background.sky and not self.irradiance:
                    self.background, self.irradiance = stand_in_sky(node, self.background, self.up)
            return ()
        if node.type in ("Shape", "CadShape"):
            self._add_shape(step)
            return ()
        if node.type in SOLIDS:
            step = self._enter_solid(step)
        elif node.type in TRANSFORMS:
            transform = step.transform.within(node, corrected_scale(node, self.notes))
            step = step._replace(transform=transform, called=node.name or step.called)
            if node.name is not None and node.name.upper() == EYES and step.owner is not None:
                step.owner.eyes = poses_to_opencv(transform.rigid(), node.version.axes)[0]
        elif node.type in PARTS:
            step = step._replace(called=node.name or step.called, link=self._begin_link(step))
        else:
            return self._expand(step)
        if node.type == "Track" and node.nodes("animatedGeometry"):
            self.skipped["Track.animatedGeometry"] += 1
        return [step._replace(node=part, instances=()) for part in parts_of(node)]

    def _expand(self, step: Step) -> Iterable[Step]:
        """Expand a PROTO instance; return steps for its body, or for the built-in nodes in its fields."""
        node = step.node
        body = self._expand_file(node)
        if body is not None and self._is_better_known(node, body):
            body = None
        body = body or expand_joint(node) or expand(node) or expand_depth_camera(node)
        human = step.human or node.type == "Pedestrian"
        if body is not None:
            within, instances = (*step.within, node.type), (*step.instances, node)
            return [step._replace(node=body, human=human, within=within, instances=instances)]
        substitute = None if self._strict else expand_lamp(node) or expand_road(node) or stand_in(node)
        if substitute is None:
            shown = step
            self.skipped[node.type] += 1
            self.below[node.type] += node.size - 1
        else:
            shown = step._replace(node=substitute, instances=(*step.instances, node))
            self.stand_ins[node.type] += 1
        self._lines.append((step.depth, f"{node.type}: {'skipped' if substitute is None else 'a stand-in'}", None))
        robots = step.robots
        if "controller" in node.fields or (node.type in KNOWN and KNOWN[node.type].robot):
            robots = (*robots, self._add_robot(self._solid_name(shown)))
        bodies = [] if substitute is None else [shown._replace(robots=robots, human=human)]
        # Devices in its fields are read, although the poses of its slots are unknown.
        place, depth = step.transform.within(node, np.ones(3)), step.depth + 1
        step = step._replace(transform=place, robots=robots, origin=node.type, owner=None, instances=(), depth=depth)
        parts = [item for value in node.fields.values() for item in nodes_in(value)]
        known = {*DEPTH_CAMERAS, *TRANSFORMS, *PARTS, *JOINTS}
        return bodies + [step._replace(node=part) for part in parts if part.type in known]

    def _expand_file(self, node: Node) -> Node | None:
        """Expand an instance from its PROTO file; return None if the file is missing or unreadable."""
        try:
            return self._protos.expand(node)
        except FileFormatError as error:
            if self._strict:
                raise
            self.reasons.setdefault(node.type, str(error))
            return None

    def _is_better_known(self, node: Node, body: Node) -> bool:
        """Return whether a built-in replacement is more complete than the file, whose meshes or PROTOs are missing.

        Only the file has the cameras and range finders of an instance, except for `DEPTH_CAMERAS`.
        """
        known = node.type == "Pedestrian" or node.type in {*BUILTIN, *DEPTH_CAMERAS, *KNOWN}
        try:
            if self._strict or not (known or stand_in(node)):
                return False
            missing, shapes, eyes = missing_parts(
                body, lambda part: self._expand_file(part) or expand_joint(part), self.find_mesh
            )
        except FileFormatError:  # reported when the node is visited
            return False
        if not missing or (shapes and not known) or (eyes and node.type not in DEPTH_CAMERAS):
            return False
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        self.reasons.setdefault(node.type, f"{body.file}: its {missing[0]}{more} not found")
        return True

    def _expand_geometry(self, node: Node) -> Node | None:
        """Expand a PROTO of a geometry node; return None for lines and points, and without a file or stand-in."""
        if node.type in LINES:
            return None
        body = self._expand_file(node)
        if body is not None and body.type in GEOMETRIES:
            return body
        substitute = None if self._strict else stand_in_geometry(node)
        (self.skipped if substitute is None else self.stand_ins)[node.type] += 1
        return substitute

    def _enter_solid(self, step: Step) -> Step:
        """Collect a Solid, and return the step that its parts continue from."""
        node, name = step.node, self._solid_name(step)
        is_part = step.is_part
        transform = step.transform.within(node, corrected_scale(node, self.notes))
        if step.link is not None:
            step.link.enter(name, transform.rigid())
        if not is_part:
            step = self._begin_solid(step, name, transform)
        step = self._begin_extent(step, transform)
        found: Device | Lidar | None = None
        with self._leaving_out():
            place = transform.rigid()
            found = read_device(node, place, step.robot, step.within) or read_lidar(node, place, step.robot)
        line = f"{step.instances[0].type if step.instances else node.type} {name!r}"
        line += f" (DEF {node.name})" if node.name else ""
        if found is not None:
            if step.origin:
                note = f"{found.name!r} is assumed to be at the origin of {step.origin}, "
                note += "whose slots are unknown without its file"
                found = dataclasses.replace(found, notes=(*found.notes, note))
            if isinstance(found, Lidar):
                called = self._taken["lidars"].take(found.name)
                self.lidars[called] = found
            else:
                called = self._taken["devices"].take(found.name)
                self.devices[called] = found
            self._mounts[called, isinstance(found, Lidar)] = step.link
            line += f": {found.describe()}"
        if found is not None or not is_part:
            self._lines.append((step.depth, line, None if is_part else step.owner))
        depth = step.depth + (not is_part)
        return step._replace(transform=transform, called=node.name or step.called, depth=depth)

    def _begin_solid(self, step: Step, name: str, transform: Transform) -> Step:
        """Begin an object, and register it with its robots and recognizable Solid."""
        node = step.node
        human = step.human or is_human(name)
        robots, recognized = step.robots, step.recognized
        if node.type in ROBOTS:
            robots = (*robots, self._add_robot(name))
        if len(node.numbers("recognitionColors")):
            known = self._taken["recognized"].take(name)
            self.recognizable[known] = (node, [])
            recognized = (known,)
        types = {instance.type for instance in step.instances}
        solid = Solid(name, robots, human, bool(types & _GROUNDS), bool(recognized), bool(types & _ARENAS))
        link = step.link
        if node.type in ROBOTS and link is None:
            link = self.links.begin_robot(node, transform, name)
        solid.parent, solid.frame, solid.link = step.owner, transform.rigid(), link
        solid.axes = (2, 0) if node.version.z_up else (1, 2)
        self.solids.append(solid)
        for robot in robots:
            self.robots[robot].append(solid)
        for known in recognized:
            self.recognizable[known][1].append(solid)
        return step._replace(owner=solid, robots=robots, recognized=recognized, human=human, link=link)

    def _begin_link(self, step: Step) -> Link | None:
        """Begin the link of a joint; return the link of its end point."""
        if not step.origin:
            with self._leaving_out():
                return self.links.begin(step.node, step.transform, step.link, self._expand_device, self.notes)
        return step.link

    def _expand_device(self, node: Node) -> Node | None:
        return None if node.type in BUILTIN_NODES else self._expand_file(node)

    def joints(self) -> tuple[JointTree, dict[Link, str]]:
        """Return the joints, and the names of the links that can move."""
        joints, names, errors = make_joints(self.links)
        if errors and self._strict:
            raise FileFormatError(errors[0])
        self.refused += errors
        for (name, is_lidar), link in self._mounts.items():
            if link in names:
                found: dict[str, Any] = self.lidars if is_lidar else self.devices
                found[name] = dataclasses.replace(found[name], link=names[link])
        return joints, names

    def _begin_extent(self, step: Step, transform: Transform) -> Step:
        """Collect the extent of a Solid, which recognition and its occlusion tests use."""
        node, outer = step.node, step.extent
        if step.origin:
            return step
        inner = outer is not None and outer.robot == step.robot and node.type not in ROBOTS
        extent = Extent(transform.offset, step.robot, outer.level + 1 if inner and outer is not None else 0)
        with self._leaving_out():
            for item in node.nodes("boundingObject"):
                extent.bounding += bounding_geometry(item, transform)
        self.extents.append(extent)
        if outer is not None:
            outer.parts.append(extent)
        if step.recognized and len(node.numbers("recognitionColors")):
            self.bounds[step.recognized[0]] = extent
        return step._replace(extent=extent)

    def _add_shape(self, step: Step) -> None:
        node = step.node
        geometry = node if node.type == "CadShape" else node.node("geometry")
        if geometry is not None and geometry.type not in GEOMETRIES:
            geometry = self._expand_geometry(geometry)
        if geometry is None or step.origin:
            return
        mesh = self._tessellate(geometry)
        if mesh is None:
            return
        owner = step.owner
        if owner is None:
            owner = Solid(node.name or step.called or "shape", human=step.human)
            self.solids.append(owner)
            self._lines.append((step.depth, f"{node.type} {owner.preferred_name!r}", owner))
        vertices, faces = mesh
        self._triangles += len(faces)
        if self._triangles > MAX_TRIANGLES:
            raise _TooMuchError(f"{node.place}: expected at most {MAX_TRIANGLES} triangles, got more")
        placed = vertices @ step.transform.linear.T + step.transform.offset
        if not (np.abs(placed) <= FARTHEST).all():
            raise FileFormatError(f"{node.place}: expected {node.type} within {FARTHEST:g} m of the origin")
        faces = keep_winding(faces, step.transform.linear)
        level = is_level(placed, faces, "xyz".index(self.up))
        appearance = shape_appearance(node)
        if appearance is not None:
            self.materials["Appearance" if appearance.type == "Appearance" else "PBRAppearance"] += 1
        owner.links.append(step.link)
        owner.parts.append(Surface(appearance, geometry, mesh, (placed, faces), level, step.transform.linear))
        if step.recognized and step.extent is not None:
            step.extent.parts.append(ball_about(placed))

    def _tessellate(self, geometry: Node) -> Triangles | None:
        """Tessellate a geometry node, cached because USE may repeat it; return None if it has no triangles."""
        known = self._meshes.get(id(geometry))
        if known is None:
            mesh = None
            try:
                with self._leaving_out():
                    fixed, notes = reset_fields(geometry)
                    mesh = tessellate(fixed, resolve=self.find_mesh)
                    self.notes += notes
            except MissingMeshError:
                self.skipped[f"{geometry.type} {' '.join(geometry.texts('url'))}".strip()] += 1
            known = self._meshes[id(geometry)] = (geometry, mesh)
        return known[1]

    def expand_appearance(self, node: Node) -> Node | None:
        """Expand an appearance PROTO from its file; return None without a readable file. Any thread may call it."""
        if node.type in APPEARANCES:
            return node
        with self._lock:
            try:
                body = self._protos.expand(node)
            except FileFormatError:  # does not affect depth
                body = None
            finally:
                self._protos.close()
        return body if body is not None and body.type in APPEARANCES else None

    def find_mesh(self, url: str, node: Node) -> Path | None:
        """Find the file of a URL in the project, in Webots' folders on the search path, or in Webots' cache."""
        found = self._protos.places.find(url, node.file, node.protos)
        return None if found is None else found.path

    def _solid_name(self, step: Step) -> str:
        """Return a Solid's name: of its instance, else its DEF name, else the default of the PROTO or of Webots."""
        node = step.node
        nodes = [*step.instances, node]
        default = _NAMES.get(node.type) or re.sub(r"(?<=[a-z])(?=[A-Z])", " ", node.type).lower()
        if node.type not in SOLIDS:
            default = node.type
        names = [item.text("name", "") for item in nodes]
        return names[0] or nodes[0].name or next(filter(None, names), default)

    def _add_robot(self, name: str) -> str:
        name = self._taken["robots"].take(name)
        self.robots[name] = []
        return name

    def corrections(self) -> tuple[str, ...]:
        """List the corrections of invalid fields, the same that Webots makes."""
        found: list[Device | Lidar] = [*self.devices.values(), *self.lidars.values()]
        return tuple(dict.fromkeys([note for item in found for note in item.notes] + self.notes))

    def describe(self, names: Mapping[Solid, list[str]]) -> str:
        """Format the tree of collected nodes, one per line, indented by depth."""
        lines = []
        for depth, text, solid in self._lines:
            if solid is not None and solid.parts:
                count = sum(len(part.placed[1]) for part in solid.parts)
                text += f": object {', '.join(map(repr, names[solid]))}, {pluralize(count, 'triangle')}"
            lines.append("  " * depth + text)
        return "\n".join(lines)
