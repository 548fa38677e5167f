# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""SDF files as the parts of a scene."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from warpvis.core.arrays import FARTHEST
from warpvis.core.categories import label_of_category
from warpvis.core.checks import truncate
from warpvis.core.labels import LABEL_COUNT, Label
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.errors import FileFormatError, SceneError
from warpvis.io.sdf._joints import Joints
from warpvis.io.sdf._lights import read_environment, read_light
from warpvis.io.sdf._load import Document, load_document
from warpvis.io.sdf._materials import DEFAULT, Materials
from warpvis.io.sdf._meshes import Piece, Shapes, text_key
from warpvis.io.sdf._scopes import Frame, Matrix, Scope
from warpvis.io.sdf._xml import Node, pose_value, raw_pose
from warpvis.scene import FileParts, Part, move_with_links
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.lights import HEADLIGHT, Light
from warpvis.scene.materials import Appearance, Material, MaterialMap
from warpvis.scene.solids import Solid

_LABEL_PLUGIN = re.compile(r"(gz|ignition)(-sim|-gazebo|::sim::systems|::gazebo::systems).*label", re.IGNORECASE)
_DRIVES = re.compile(r"drive|ackermann|skid|controller|motor|quadruped", re.IGNORECASE)
_PASSIVE_SENSORS = ("contact", "force_torque", "logical_camera")
_NOT_GROUND = re.compile(r"lamp|light", re.IGNORECASE)
_NUMBER = re.compile(r"[_\s-]*\d+$")
_MAX_NAMED = 12


def read_sdf(path: Path, *, search_path: Sequence[Path] = (), strict: bool = False) -> FileParts:
    """Read the visuals and lights of an SDF file, and of everything that it includes; see `warpvis.Scene.load`.

    Raises:
        FileFormatError: If the file is invalid, or something in it cannot be read and `strict` is set.
    """
    try:
        return _Reader(path, search_path, strict).read()
    except RecursionError:
        raise FileFormatError(f"{path}: must not be nested that deeply") from None


@dataclass(eq=False)
class _Link:
    """A link with its visuals."""

    frame: Frame
    pose: Matrix
    """Link to file."""
    is_moving: bool
    model: Scope
    """The outermost model that it belongs to."""
    tag: str = "visual"


class _Reader:
    def __init__(self, path: Path, search_path: Sequence[Path], strict: bool) -> None:
        self.document: Document = load_document(path, search_path)
        self.strict = strict
        self.shapes = Shapes(self.document.finder, strict)
        self.materials = Materials(self.document.finder)
        self.parts: list[Part] = []
        self.joints = Joints()
        self.notes: dict[str, None] = {}
        self.names: Counter[str] = Counter()
        self._taken: set[str] = set()
        self._appearances: dict[Any, LazyAppearance] = {}

    def read(self) -> FileParts:
        """Read all parts, and return them."""
        document = self.document
        lights: list[Light] = []
        background = None
        for scope in document.scopes:
            if scope.node.tag == "world":
                ambient, background = read_environment(scope.node)
                lights.append(ambient)
                self._note_world(scope.node)
            if scope.joints and scope.is_world:  # they connect models
                self.joints.add_model(list(scope.all_models()))
            for top in scope.models if scope.is_world else [scope]:
                self._read_model(top)
            for model in scope.all_models():
                lights += self._lights(model)
                for include, root in model.robots:
                    self._read_robot(include, root, model)
                for actor in model.actors:
                    self._read_actor(actor, model)
        if not document.worlds:
            lights += [light for node in document.lights if (light := read_light(node, node.name, raw_pose(node)))]
            for actor in document.actors:
                self._read_actor(actor, None)
        if all(light.kind == "ambient" for light in lights):
            lights = [HEADLIGHT]
        try:
            tree = self.joints.tree()
        except SceneError as error:
            raise FileFormatError(f"{document.path}: {error}") from None
        self.notes.update(dict.fromkeys(self.joints.notes))
        warnings = self._warnings()
        if self.strict and (self.document.missing or self.shapes.skipped or self.materials.missing):
            raise FileFormatError(warnings[0])
        return FileParts(
            document.path,
            move_with_links(_with_rows(self.parts), tree),
            joints=tree,
            up="z",
            defines_frame=True,
            warnings=tuple(warnings),
            lights=tuple(lights),
            background=background,
        )

    def _warnings(self) -> list[str]:
        path = self.document.path
        skipped = [
            *self.document.missing,
            *self.shapes.skipped,
        ]
        sentences = []
        if skipped:
            more = f"; and {len(skipped) - _MAX_NAMED} others" if len(skipped) > _MAX_NAMED else ""
            sentences.append(f"{path}: skipped {'; '.join(skipped[:_MAX_NAMED])}{more}")
        if self.materials.missing:
            names = list(self.materials.missing)
            more = ", ..." if len(names) > _MAX_NAMED else ""
            sentences.append(f"{path}: materials or images were not found: {', '.join(names[:_MAX_NAMED])}{more}")
        if self.notes:
            sentences.append(f"{path}: {'; '.join(list(self.notes)[:_MAX_NAMED])}")
        return [*sentences, *self.shapes.warnings]

    def _note_world(self, world: Node) -> None:
        for tag in ("road", "population"):
            if world.child(tag) is not None:
                self.notes[f"<{tag}> is not shown"] = None

    def _read_model(self, top: Scope) -> None:
        """Read a model with the models in it."""
        models = list(top.all_models())
        links = [(model, link) for model in models for link in model.links]
        tag = "visual" if any(link.node.child("visual") is not None for _, link in links) else "collision"
        is_robot = _robot_joints(models) and any(map(_is_active, models))
        if top.parent is None or not top.parent.joints:
            self.joints.add_model(models)
        for model, link in links:
            pose = model.world_pose() @ model.frame_pose(link)
            self._read_link(_Link(link, pose, model.moves, top, tag), is_robot=is_robot)

    def _read_link(self, link: _Link, *, is_robot: bool) -> None:
        scope, tag = link.frame.scope, link.tag
        elements = link.frame.node.children(tag)
        described = []
        for element in elements:
            geometry = element.child("geometry")
            if geometry is None:
                self.shapes.skip(f"<{tag}>", element, "has no <geometry>")
                continue
            pieces = self.shapes.pieces(geometry)
            placed = scope.element_pose(element, link.frame)
            described += [
                (element, geometry, piece, number, len(pieces), placed) for number, piece in enumerate(pieces)
            ]
        above, first = scope.world_pose(), ""
        link_name = f"{scope.prefix}{link.frame.name}"
        joined = link_name if link_name in self.joints.links else None
        for element, geometry, piece, number, count, placed in described:
            name = f"{link_name}::{element.get('name', tag).strip() or tag}"
            name += f"::{piece.name or number}" if count > 1 else ""
            mesh: Any = piece.mesh
            if isinstance(mesh, Solid) and (not link.is_moving or (len(described) > 1 and joined is None)):
                mesh = mesh.vertices, mesh.faces
            pose = above @ placed if piece.pose is None else above @ placed @ piece.pose
            part = Part(
                self._unique(name),
                mesh,
                label=self._label(link, element, geometry, is_robot=is_robot),
                pose=_checked(pose, element),
                movable=link.is_moving and not first and joined is None,
                attach_to=first or None,
                link=joined,
                category=_category(link.model),
                aliases=self._aliases(link, element),
                appearance=self._appearance(element, piece) if tag == "visual" else _GRAY,
                extras=_extras(element),
            )
            self.parts.append(part)
            if link.is_moving and joined is None:
                first = first or part.name

    def _aliases(self, link: _Link, element: Node) -> tuple[str, ...]:
        scope = link.frame.scope
        model = scope.prefix.removesuffix("::")
        names = dict.fromkeys((f"{scope.prefix}{link.frame.name}", model, link.model.name, link.frame.name))
        number = _label_number(link, element)
        return (*(name for name in names if name), *([f"label {number}"] if number is not None else []))

    def _label(self, link: _Link, element: Node, geometry: Node, *, is_robot: bool) -> int:
        """Return the label: that of the label plugin if it is no number of `Label`; else by the names."""
        number = _label_number(link, element)
        if number is not None and max(Label) < number < LABEL_COUNT:
            return number
        if geometry.child("plane") is not None or geometry.child("heightmap") is not None:
            return Label.GROUND
        for name in (element.get("name", ""), link.frame.name):
            if label_of_category(name) == Label.GROUND and not _NOT_GROUND.search(name):
                return Label.GROUND
        found = label_of_category(_category(link.model))
        if found in (Label.OBJECT, Label.OBSTACLE) and is_robot:
            return Label.ROBOT
        if found == Label.GROUND and _NOT_GROUND.search(link.model.name):
            return Label.OBSTACLE
        return Label.OBSTACLE if found == Label.OBJECT and not link.is_moving else found

    def _unique(self, name: str) -> str:
        while name in self._taken:
            self.names[name] += 1
            candidate = f"{name}_{self.names[name]}"
            name = candidate if candidate not in self._taken else name
        self._taken.add(name)
        return name

    def _appearance(self, element: Node, piece: Piece) -> LazyAppearance | None:
        node, transparency = element.child("material"), min(max(element.number("transparency", 0.0), 0.0), 1.0)
        key = id(piece), transparency, None if node is None else (element.path.parent, text_key(node))
        if key not in self._appearances:
            material = self.materials.material(element)
            if material is None and transparency == 0 and piece.appearance is not None:
                self._appearances[key] = piece.appearance
            else:
                self._appearances[key] = _shown(piece, material, transparency)
        return self._appearances[key]

    def _read_actor(self, actor: Node, scope: Scope | None) -> None:
        """Read the skin of a person at rest, at its first waypoint."""
        skin = actor.child("skin")
        uri = "" if skin is None else skin.string("filename")
        if skin is None or not uri:
            return
        path = self.document.finder.file(uri, skin)
        if path is None:
            self.shapes.skipped[f"{truncate(uri)} ({skin.path}:{skin.line}), which was not found"] = None
            return
        waypoint = actor.child("script/trajectory/waypoint/pose")
        pose = raw_pose(actor) if waypoint is None else pose_value(waypoint)
        if scope is not None:
            pose = scope.world_pose() @ pose
        scale = skin.positive("scale", 1.0)
        pieces = self.shapes.scaled(path, (scale, scale, scale))
        first = ""
        for number, piece in enumerate(pieces):
            name = self._unique(f"{actor.name}::{piece.name or number}" if len(pieces) > 1 else actor.name)
            placed = pose if piece.pose is None else pose @ piece.pose
            self.parts.append(
                Part(
                    name,
                    piece.mesh,
                    label=Label.HUMAN,
                    pose=_checked(placed, actor),
                    movable=not first,
                    attach_to=first or None,
                    category="person",
                    aliases=(actor.name,),
                    appearance=piece.appearance or LazyAppearance(None, Appearance((DEFAULT,))),
                )
            )
            first = first or name
        self.notes[f"actor {truncate(actor.name)!r} is shown at rest"] = None

    def _read_robot(self, include: Node, root: Node, scope: Scope) -> None:
        """Read a URDF file that is included in a model or world."""
        from warpvis.io.urdf import read_urdf

        found = read_urdf(root.path, search_path=self.document.finder.existing(), strict=self.strict)
        self.shapes.warnings.update(dict.fromkeys(found.warnings))
        name = include.string("name") or root.get("name", "").strip() or root.path.stem
        pose = scope.world_pose() @ scope.element_pose(include, None)
        names = {part.name: self._unique(f"{scope.prefix}{name}::{part.name}") for part in found.parts}
        is_static = include.flag("static", False) or not (scope.is_world or scope.moves)
        if len(found.joints) and not is_static:
            self.joints.add_tree(found.joints, f"{scope.prefix}{name}::", pose)
        for part in found.parts:
            own = np.eye(4) if part.pose is None else _matrix(part.pose)
            self.parts.append(
                replace(
                    part,
                    name=names[part.name],
                    pose=_checked(pose @ own, include),
                    movable=not is_static and not len(found.joints),
                    attach_to=None,
                    link=None if part.link is None or is_static else f"{scope.prefix}{name}::{part.link}",
                    aliases=(*part.aliases, part.name, name),
                    category=part.category or _NUMBER.sub("", name),
                )
            )

    def _lights(self, scope: Scope) -> Iterator[Light]:
        for node in scope.lights:
            name = f"{scope.prefix}{node.get('name', 'light')}"
            light = read_light(node, name, scope.world_pose() @ scope.element_pose(node, None))
            if light is not None:
                yield light
        for link in scope.links:
            for node in link.node.children("light"):
                name = f"{scope.prefix}{link.name}::{node.get('name', 'light')}"
                light = read_light(node, name, scope.world_pose() @ scope.element_pose(node, link))
                if light is not None:
                    yield light


_GRAY = LazyAppearance(None, Appearance((DEFAULT,)))


def _matrix(pose: np.ndarray) -> Matrix:
    return poses_to_matrices(pose) if pose.shape[-1] == 7 else pose


def _checked(pose: Matrix, node: Node) -> Matrix:
    if not np.abs(pose[:3, 3]).max() < FARTHEST:
        node.fail("must be within 1e18 m of the origin")
    return pose


def _with_rows(parts: Sequence[Part]) -> list[Part]:
    """Return the parts with rows of 7 numbers instead of matrices, converted in one call."""
    if not parts:
        return []
    rows = poses_to_opencv(np.stack([part.pose for part in parts if part.pose is not None]))
    return [replace(part, pose=row) for part, row in zip(parts, rows, strict=True)]


def _category(model: Scope) -> str:
    """Return the name of a model without its number."""
    return _NUMBER.sub("", model.name) or model.name


def _label_number(link: _Link, element: Node) -> int | None:
    """Return the number of the label plugin of a visual, or of the innermost model that has one."""
    plugins = element.children("plugin")
    scope: Scope | None = link.frame.scope
    while scope is not None:
        plugins = [*plugins, *scope.plugins]
        scope = scope.parent
    for plugin in plugins:
        if _LABEL_PLUGIN.search(plugin.get("filename", "")) or _LABEL_PLUGIN.search(plugin.get("name", "")):
            return int(plugin.number("label", 0.0, minimum=0.0))
    return None


def _robot_joints(models: Sequence[Scope]) -> bool:
    return any(joint.node.get("type") != "fixed" for model in models if model.moves for joint in model.joints)


def _is_active(model: Scope) -> bool:
    """Return whether a model has a sensor that sees or measures motion, or a plugin that drives it."""
    sensors = [sensor for link in model.links for sensor in link.node.children("sensor")]
    if any(sensor.get("type") not in _PASSIVE_SENSORS for sensor in sensors):
        return True
    return any(_DRIVES.search(f"{item.get('name', '')} {item.get('filename', '')}") for item in model.plugins)


def _extras(element: Node) -> dict[str, Any]:
    """Return the properties of a visual that do not change pictures here."""
    found: dict[str, Any] = {}
    if element.child("cast_shadows") is not None:
        found["cast_shadows"] = element.flag("cast_shadows", True)
    if element.string("visibility_flags"):
        found["visibility_flags"] = element.string("visibility_flags")
    if element.child("laser_retro") is not None:
        found["laser_retro"] = element.number("laser_retro", 0.0)
    return found


def _shown(piece: Piece, material: Material | None, transparency: float) -> LazyAppearance:
    """Return the appearance of a piece with another material, and transparency."""

    def make() -> Appearance:
        own = piece.appearance.get() if piece.appearance is not None else None
        if material is not None:
            if own is not None:
                found = Appearance((material,), uv=own.uv, normals=own.normals)
            elif piece.uv is None and material.texture is not None:
                found = Appearance((_without_maps(material),))
            else:
                found = Appearance((material,), uv=piece.uv)
        else:
            found = own or Appearance((DEFAULT,), uv=piece.uv)
        if transparency > 0:
            found = replace(found, materials=tuple(_transparent(item, transparency) for item in found.materials))
        return found

    return LazyAppearance(make)


def _transparent(material: Material, transparency: float) -> Material:
    r, g, b, alpha = material.base_color
    return replace(material, base_color=(r, g, b, alpha * (1 - transparency)), alpha_mode="blend")


def _without_maps(material: Material) -> Material:
    """Return a material for a round solid, which has no texture coordinates."""
    maps: dict[str, Any] = dict.fromkeys(("texture", *get_args(MaterialMap)))
    return replace(material, **maps)
