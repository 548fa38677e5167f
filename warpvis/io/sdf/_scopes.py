# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Frames of models and worlds, by the pose semantics of SDF 1.7 and later.

A pose is relative to the frame that its attribute `relative_to` names, or to a default: links, nested models and frames
to the model, frames with `attached_to` to that frame, joints to their child link, elements of links to the link. Names
are those of the enclosing model; ``a::b`` is the name b in the nested model a. The pose of a model with a
`placement_frame` is that of the frame that this attribute names.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.io.sdf._xml import Node, pose_value, raw_pose

Matrix = NDArray[np.float64]

_SEPARATOR = "::"
_MODEL, _WORLD = "__model__", "world"
_FRAME_SEMANTICS = (1, 7)
"""First version whose poses have `relative_to`. Before, the attribute `frame` had this meaning, or none."""


@dataclass(eq=False)
class Frame:
    """A link, a joint or a frame of a model or world."""

    node: Node
    scope: Scope
    fixed: Matrix | None = None
    """Its pose in the frame of the scope; None until it is resolved."""

    @property
    def name(self) -> str:
        """Name in the scope."""
        return self.node.name


@dataclass(eq=False)
class Scope:
    """A model or a world: the frames in it, and its own pose."""

    node: Node
    name: str
    version: tuple[int, int]
    parent: Scope | None = None
    is_static: bool = False
    placer: Node | None = None
    """The element whose pose replaces that of the model: an include."""
    placement: str = ""
    """Name of the placement frame in the model."""
    is_merged: bool = False
    """Whether its frames belong to the parent, as those of an include with ``merge="true"``."""
    links: list[Frame] = field(default_factory=list)
    joints: list[Frame] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)
    models: list[Scope] = field(default_factory=list)
    actors: list[Node] = field(default_factory=list)
    """Actors of a world."""
    lights: list[Node] = field(default_factory=list)
    """Lights of a world."""
    robots: list[tuple[Node, Node]] = field(default_factory=list)
    """Includes of URDF files, and the root elements of these."""
    plugins: list[Node] = field(default_factory=list)
    """Plugins of the model, and of the element that includes it."""
    fixed: Matrix | None = None
    """Its pose in the frame of the parent; None until it is resolved."""
    _world: Matrix | None = None
    _pending: list[str] = field(default_factory=list)
    _found: dict[str, Frame | Scope] | None = None

    @property
    def is_world(self) -> bool:
        """Whether it is a world, or the root of a file, and not a model."""
        return self.node.tag in ("world", "sdf", "gazebo")

    @property
    def prefix(self) -> str:
        """Prefix of the names in it, such as ``"robot::arm::"``; empty for worlds."""
        above = self.parent.prefix if self.parent is not None else ""
        return above if self.is_world or self.is_merged else f"{above}{self.name}{_SEPARATOR}"

    @property
    def moves(self) -> bool:
        """Whether neither it nor a model around it is static."""
        return not self.is_static and (self.parent is None or self.parent.is_world or self.parent.moves)

    def all_models(self) -> Iterator[Scope]:
        """Yield the scope and all models in it, depth first."""
        yield self
        for model in self.models:
            yield from model.all_models()

    def world_pose(self) -> Matrix:
        """Return its pose in the frame of the file."""
        if self._world is None:
            pose = self.pose()
            self._world = pose if self.parent is None else self.parent.world_pose() @ pose
        return self._world

    def pose(self) -> Matrix:
        """Return its pose in the frame of the parent; that of a merged model is the pose of the proxy frame."""
        if self.fixed is None:
            element = self.placer or self.node
            with _Pending(self, _MODEL):
                placed = raw_pose(element) if self.parent is None else self.parent.element_pose(element, None)
                anchor = self.resolve(self.placement, element) if self.placement else None
            self.fixed = placed if anchor is None else placed @ np.linalg.inv(anchor)
        return self.fixed

    def frame_pose(self, frame: Frame) -> Matrix:
        """Return the pose of a link, joint or frame in the scope's frame."""
        if frame.fixed is None:
            with _Pending(self, frame.name):
                frame.fixed = self.element_pose(frame.node, None)
        return frame.fixed

    def element_pose(self, node: Node, owner: Frame | None) -> Matrix:
        """Return the pose of an element in the scope's frame; by default relative to its owner, a link."""
        pose = node.child("pose")
        base = "" if pose is None else self._base_of(pose)
        if base:
            assert pose is not None
            return self.resolve(base, pose) @ raw_pose(node)
        return self._default(node, owner) @ raw_pose(node)

    def _base_of(self, pose: Node) -> str:
        """Return the name of the frame that a pose is relative to; empty for the default."""
        base = pose.get("relative_to", "").strip()
        if self.version >= _FRAME_SEMANTICS:
            return base
        old = base or pose.get("frame", "").strip()
        return old if self.find(old) is not None else ""

    def _default(self, node: Node, owner: Frame | None) -> Matrix:
        if owner is not None:
            return self.frame_pose(owner)
        if node.tag == "frame" and node.get("attached_to", "").strip():
            return self.resolve(node.get("attached_to", "").strip(), node)
        if node.tag == "joint":
            child = joint_link(node, "child")
            # Before version 1.7, joints of invalid links were no error.
            if child != _WORLD and (self.version >= _FRAME_SEMANTICS or self.find(child) is not None):
                return self.resolve(child, node)
        return np.eye(4)

    def resolve(self, name: str, node: Node) -> Matrix:
        """Return the pose of a named frame in the scope's frame; raise an error about `node` if there is none."""
        found = self.find(name)
        if found is None:
            kind = "world" if self.is_world else "model"
            node.fail(f"must refer to a frame of the {kind} {truncate(self.name)!r}, got {truncate(name)!r}")
        return self.pose_in(found)

    def pose_in(self, found: Frame | Scope) -> Matrix:
        """Return the pose, in the scope's frame, of what `find` returned."""
        if found is self:
            return np.eye(4)
        if isinstance(found, Frame) and found.scope is self:
            return self.frame_pose(found)
        inner = found.scope if isinstance(found, Frame) else found
        pose = inner.frame_pose(found) if isinstance(found, Frame) else np.eye(4)
        scope: Scope | None = inner
        while scope is not None and scope is not self:
            pose = scope.pose() @ pose
            scope = scope.parent
        return pose

    def find(self, name: str) -> Frame | Scope | None:
        """Return the frame or model of a name; None if there is none."""
        if name == (_WORLD if self.is_world else _MODEL):
            return self
        if self._found is None:
            self._found = {}
            for frame in (*self.links, *self.joints, *self.frames):
                self._found.setdefault(frame.name, frame)
            for model in self.models:
                if not model.is_merged:
                    self._found.setdefault(model.name, model)
        found = self._found.get(name)
        if found is not None:
            return found
        merged = (model.find(name) for model in self.models if model.is_merged and name != _MODEL)
        found = next((item for item in merged if item is not None), None)
        if found is not None:
            return found
        head, separator, tail = name.partition(_SEPARATOR)
        while separator:
            inner = self.find(head) if head else None
            if isinstance(inner, Scope) and inner is not self:
                return inner.find(tail)
            more, separator, tail = tail.partition(_SEPARATOR)
            head = f"{head}{_SEPARATOR}{more}"
        return None

    def apply_state(self, state: Node) -> None:
        """Set the poses that Gazebo Classic saved in the ``<state>`` of a world, in the frame of the world."""
        models = {model.name: model for model in self.models}
        for saved in state.children("model"):
            model = models.get(saved.get("name", ""))
            if model is not None:
                model.apply_model_state(saved)

    def apply_model_state(self, saved: Node) -> None:
        """Set the poses of a model and its links, which are saved in the frame of the world."""
        above = np.eye(4) if self.parent is None else self.parent.world_pose()
        if (pose := saved.child("pose")) is not None:
            self.fixed, self._world = np.linalg.inv(above) @ pose_value(pose), None
        placed = np.linalg.inv(self.world_pose())
        links = {link.name: link for link in self.links}
        for item in saved.children("link"):
            link, pose = links.get(item.get("name", "")), item.child("pose")
            if link is not None and pose is not None:
                link.fixed = placed @ pose_value(pose)
        models = {model.name: model for model in self.models}
        for item in saved.children("model"):
            model = models.get(item.get("name", ""))
            if model is not None:
                model.apply_model_state(item)


class _Pending:
    """Detects frames that depend on themselves."""

    def __init__(self, scope: Scope, name: str) -> None:
        self._scope, self._name = scope, name

    def __enter__(self) -> None:
        pending = self._scope._pending
        if self._name in pending:
            chain = " -> ".join(truncate(item) for item in [*pending, self._name][:8])
            self._scope.node.fail(f"must not have frames that depend on themselves, got {chain}")
        pending.append(self._name)

    def __exit__(self, *error: object) -> None:
        self._scope._pending.pop()


def joint_link(joint: Node, tag: str) -> str:
    """Return the name of the parent or child of a joint."""
    found = joint.child(tag)
    if found is None:
        joint.fail(f"must have a <{tag}>")
    # Version 1.0 has an attribute.
    return found.string() or found.get("link", "").strip() or found.fail("must be the name of a link, got nothing")
