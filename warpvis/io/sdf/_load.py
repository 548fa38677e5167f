# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Models and worlds with everything that they include."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from warpvis.core.checks import truncate
from warpvis.errors import FileFormatError
from warpvis.io._readers import MODEL_CONFIG
from warpvis.io.sdf._files import Finder, model_file
from warpvis.io.sdf._scopes import Frame, Scope
from warpvis.io.sdf._xml import Node, parse_file, require_sdf

_MAX_MODELS = 20_000
_MAX_INCLUDES = 50
"""Maximum depth of nested includes."""
_CONTENT = ("world", "model", "actor", "light")


@dataclass(eq=False)
class Document:
    """A file with everything that it includes."""

    path: Path
    """The SDF file: for a model.config, the file that it names."""
    finder: Finder
    worlds: list[Scope] = field(default_factory=list)
    models: list[Scope] = field(default_factory=list)
    """Models outside of worlds."""
    actors: list[Node] = field(default_factory=list)
    lights: list[Node] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    """URIs of includes that were not found, with file and line."""
    _parsed: dict[Path, Node] = field(default_factory=dict)
    _stack: list[Path] = field(default_factory=list)
    _count: int = 0

    @property
    def scopes(self) -> list[Scope]:
        """The first world, as in Gazebo; or the models outside of worlds."""
        return self.worlds[:1] or self.models

    def parse(self, path: Path) -> tuple[Node, tuple[int, int]]:
        """Return the root of an SDF file, and its version."""
        root = self._root(path)
        return root, require_sdf(root)

    def _root(self, path: Path) -> Node:
        """Return the root of an XML file, which is parsed once; raise an error unless it is SDF or URDF."""
        key = path.resolve()
        if key not in self._parsed:
            self._parsed[key] = parse_file(path)
        if self._parsed[key].tag != "robot":
            require_sdf(self._parsed[key])
        return self._parsed[key]

    def read_world(self, node: Node, version: tuple[int, int]) -> Scope:
        """Read a world with its includes."""
        world = Scope(node, node.get("name", "").strip() or "world", version)
        self._read_children(world)
        for state in node.children("state"):
            world.apply_state(state)
        return world

    def read_model(self, node: Node, parent: Scope | None, version: tuple[int, int]) -> Scope:
        """Read a model with its includes; its frames are not resolved."""
        self._count += 1
        if self._count > _MAX_MODELS:
            node.fail(f"is one of more than {_MAX_MODELS} models, which are too many")
        model = Scope(node, node.name, version, parent, node.flag("static", False))
        model.placement = node.get("placement_frame", "").strip()
        model.plugins = node.children("plugin")
        self._read_children(model)
        return model

    def _read_children(self, scope: Scope) -> None:
        for child in scope.node.children():
            match child.tag:
                case "link":
                    scope.links.append(Frame(child, scope))
                case "joint":
                    scope.joints.append(Frame(child, scope))
                case "frame":
                    scope.frames.append(Frame(child, scope))
                case "model":
                    scope.models.append(self.read_model(child, scope, scope.version))
                case "actor":
                    scope.actors.append(child)
                case "light":
                    scope.lights.append(child)
                case "include":
                    self.include(child, scope)
        for item in (*scope.links, *scope.joints, *scope.frames):
            _ = item.name  # raises an error without one
        _number_names(scope.models)

    def include(self, node: Node, scope: Scope) -> None:
        """Add what an element includes to a scope."""
        uri = node.string("uri")
        if not uri:
            node.fail("must have a <uri>")
        place = f"{truncate(uri)} ({node.path}:{node.line})"
        try:
            path = self.finder.model(uri, node)
            if path is not None:
                self._root(path)
        except FileFormatError as error:
            self.missing.append(f"{place}: {error}")
            return
        is_itself = path is not None and path.resolve() in self._stack
        if path is None or (is_itself and uri.startswith("http")):  # a folder with the name of a model of Fuel
            self.missing.append(f"{place}, which was not found; search_path adds folders to search")
            return
        key = path.resolve()
        if key in self._stack or len(self._stack) >= _MAX_INCLUDES:
            node.fail(f"must not include itself, got {truncate(uri)!r}")
        self._stack.append(key)
        try:
            self._add_included(node, scope, path)
        finally:
            self._stack.pop()

    def _add_included(self, node: Node, scope: Scope, path: Path) -> None:
        root = self._root(path)
        if root.tag == "robot":
            scope.robots.append((node, root))
            return
        version = require_sdf(root)
        merged = (node.get("merge", "false").strip().lower()) in ("true", "1")
        content = root.children(*_CONTENT)
        if not content:
            self.missing.append(f"{path}, which has no model, actor, light or world")
            return
        first = content[0]
        if first.tag == "actor":
            scope.actors.append(_placed_copy(first, node))
        elif first.tag == "light":
            scope.lights.append(_placed_copy(first, node))
        elif first.tag == "world":
            if not (scope.is_world and merged):
                node.fail(f"must have merge true to include the world {path}")
            world = Scope(first, first.get("name", "world"), version, scope, is_merged=True)
            self._read_children(world)
            scope.models.append(world)
        else:
            scope.models.append(self._included_model(first, node, scope, version, merged))

    def _included_model(self, model: Node, node: Node, scope: Scope, version: tuple[int, int], merged: bool) -> Scope:
        """Read an included model, with the name, pose and other properties of the include."""
        found = self.read_model(model, scope, version)
        found.is_merged = merged
        found.name = node.string("name") or found.name
        found.is_static = node.flag("static", found.is_static)
        found.plugins = [*found.plugins, *node.children("plugin")]
        if node.child("pose") is not None or node.child("placement_frame") is not None:
            found.placer = node
            found.placement = node.string("placement_frame") or found.placement
        return found


def _number_names(models: Sequence[Scope]) -> None:
    """Append numbers to names that repeat, as those of includes may: ``box``, ``box_1``, ..."""
    taken = {model.name for model in models}
    seen: set[str] = set()
    for model in models:
        name = model.name
        if name in seen:
            numbered = (f"{name}_{number}" for number in itertools.count(1))
            model.name = next(candidate for candidate in numbered if candidate not in taken)
        taken.add(model.name)
        seen.add(model.name)


def _placed_copy(node: Node, include: Node) -> Node:
    """Return a light or an actor with the name and the pose of the element that includes it."""
    copy = Node(node.tag, dict(node.attrib))
    copy.path, copy.line = node.path, node.line
    name, pose = include.string("name"), include.child("pose")
    if name:
        copy.set("name", name)
    copy.extend(child for child in node if pose is None or child.tag != "pose")
    if pose is not None:
        copy.append(pose)
    return copy


def load_document(path: Path, search_path: Sequence[Path]) -> Document:
    """Read an SDF file, or that of a model.config, with everything that it includes."""
    if path.name == MODEL_CONFIG:
        path = model_file(path.parent) or path
    found = Document(path, Finder(path, search_path))
    root, version = found.parse(path)
    found._stack.append(path.resolve())
    top = Scope(root, "", version)  # an include outside of worlds
    for child in root.children(*_CONTENT, "include"):
        match child.tag:
            case "include":
                found.include(child, top)
            case "world":
                found.worlds.append(found.read_world(child, version))
            case "model":
                found.models.append(found.read_model(child, None, version))
            case "actor":
                found.actors.append(child)
            case "light":
                found.lights.append(child)
    if top.models or top.robots or found.missing:
        found.models.append(top)
    if not (found.worlds or found.models or found.actors or found.lights):
        raise FileFormatError(f"{path}:{root.line}: must have a <world>, a <model>, an <actor> or a <light>")
    return found
