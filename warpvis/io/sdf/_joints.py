# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Joints of models that are not static, as a tree from the link "world".

The first link of a movable model has a floating joint, named like the link, whose value is the link's pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from warpvis.core.checks import truncate
from warpvis.core.poses import poses_to_opencv
from warpvis.io.sdf._scopes import Frame, Matrix, Scope, joint_link
from warpvis.io.sdf._xml import Node, parse_numbers
from warpvis.scene.joints import Joint, JointTree, Mimic

WORLD = "world"
"""Name of the link that does not move."""

_UNLIMITED = 1e9
"""Limits from this size on [rad, m] are no limits: the default is 1e16."""
_KINDS: dict[str, Any] = {
    "revolute": "revolute",
    "continuous": "continuous",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "ball": "floating",
    "screw": "revolute",
    "gearbox": "revolute",
}
_TWO_AXES = ("universal", "revolute2")
_AXES_OF_MODEL = (1, 5)
"""First version in which axes are in the frame of the joint, by default, and not of the model."""


@dataclass(eq=False)
class Joints:
    """Collects joints."""

    joints: list[Joint] = field(default_factory=list)
    links: set[str] = field(default_factory=set)
    """Names of links of models with joints."""
    notes: list[str] = field(default_factory=list)
    _parents: dict[str, str] = field(default_factory=dict)
    _names: set[str] = field(default_factory=set)

    def tree(self) -> JointTree:
        """Return the tree of all joints."""
        names = {joint.name for joint in self.joints}
        kept = []
        for joint in self.joints:
            if joint.mimic is not None and joint.mimic.joint not in names:
                self.notes.append(f"joint {truncate(joint.name)!r} follows an unknown joint, and is free")
                joint = replace(joint, mimic=None)
            kept.append(joint)
        return JointTree(kept)

    def add_model(self, models: Sequence[Scope]) -> None:
        """Add the joints of a model and of the models in it, unless it has none or all are static."""
        moving = [model for model in models if model.moves]
        if not any(model.joints for model in moving):
            return
        poses = {WORLD: np.eye(4)}
        for model in moving:
            above = model.world_pose()
            poses |= {f"{model.prefix}{link.name}": above @ model.frame_pose(link) for link in model.links}
        self.links.update(poses)
        for model in moving:
            for joint in model.joints:
                self._add(joint, model, poses)
        for link, pose in poses.items():
            if link != WORLD and link not in self._parents:
                self._parents[link] = WORLD
                self._add_floating(link, pose)

    def add_tree(self, tree: JointTree, prefix: str, pose: Matrix) -> None:
        """Add the joints of an included URDF file, with a prefix for all names, at the pose of its first link."""
        children = {joint.child for joint in tree}
        for joint in tree:
            mimic = joint.mimic and joint.mimic._replace(joint=prefix + joint.mimic.joint)
            names = {key: prefix + getattr(joint, key) for key in ("name", "parent", "child")}
            self.joints.append(replace(joint, mimic=mimic, **names))
        for link in tree.links:
            self.links.add(prefix + link)
            if link not in children:
                self._add_floating(prefix + link, pose)

    def _add_floating(self, link: str, pose: Matrix) -> None:
        taken = {joint.name for joint in self.joints}
        name = link if link not in taken else f"{link}::floating"
        self.joints.append(Joint(name, "floating", WORLD, link, initial=poses_to_opencv(pose)[0]))

    def _add(self, frame: Frame, model: Scope, poses: dict[str, Matrix]) -> None:
        node, name = frame.node, f"{model.prefix}{frame.name}"
        kind = (node.get("type") or "").strip()
        if kind not in _KINDS and kind not in _TWO_AXES:
            known = ", ".join([*_KINDS, *_TWO_AXES])
            node.fail(f"must have a type of {known}, got {truncate(kind)!r}")
        parent, child = (_link_name(model, joint_link(node, tag)) for tag in ("parent", "child"))
        if child == WORLD or parent not in poses or child not in poses:
            self.notes.append(f"joint {truncate(name)!r} is ignored: its links are not movable links of its model")
            return
        if name in self._names:
            self.notes.append(f"joint {truncate(name)!r} is ignored: its name is taken")
            return
        self._names.add(name)
        if child in self._parents or self._is_below(parent, child):
            self.notes.append(f"joint {truncate(name)!r} is ignored: it closes a loop")
            return
        self._parents[child] = parent
        placed = model.world_pose() @ model.frame_pose(frame)
        origin, last = np.linalg.inv(poses[parent]) @ placed, np.linalg.inv(placed) @ poses[child]
        if kind in _TWO_AXES:
            middle = f"{name}::middle"
            first, second = (_Axis(node, model, frame, tag, name) for tag in ("axis", "axis2"))
            self.joints.append(Joint(name, first.kind("revolute"), parent, middle, origin, **first.options()))
            second_options = {**second.options(), "child_origin": last}
            self.joints.append(Joint(f"{name}::2", second.kind("revolute"), middle, child, **second_options))
            return
        if kind in ("ball", "screw", "gearbox"):
            self.notes.append(f"{kind} joint {truncate(name)!r} is {_KINDS[kind]} here")
        options: dict[str, Any] = {"child_origin": last}
        found = _KINDS[kind]
        if found in ("revolute", "continuous", "prismatic"):
            axis = _Axis(node, model, frame, "axis", name)
            found, options = axis.kind(found), {**axis.options(), **options}
        self.joints.append(Joint(name, found, parent, child, origin, **options))

    def _is_below(self, link: str, top: str) -> bool:
        while link in self._parents and link != top:
            link = self._parents[link]
        return link == top


class _Axis:
    """The axis of a joint: its direction in the joint's frame, and its limits."""

    def __init__(self, joint: Node, model: Scope, frame: Frame, tag: str, name: str) -> None:
        axis = joint.child(tag)
        self._mimic: Mimic | None = None
        self._limits = (-np.inf, np.inf)
        self._direction = np.array([0.0, 0.0, 1.0])
        if axis is None:
            return
        xyz = axis.child("xyz")
        self._direction = np.array(axis.numbers("xyz", (0.0, 0.0, 1.0)))
        if not self._direction.any():
            axis.nearest("xyz").fail("must be an axis other than 0")
        base = "" if xyz is None else xyz.get("expressed_in", "").strip()
        own = model.frame_pose(frame)[:3, :3]
        if base:
            self._direction = own.T @ model.resolve(base, axis.nearest("xyz"))[:3, :3] @ self._direction
        elif axis.flag("use_parent_model_frame", model.version < _AXES_OF_MODEL):
            self._direction = own.T @ self._direction
        lower, upper = _limit(axis, "limit/lower", -np.inf), _limit(axis, "limit/upper", np.inf)
        self._limits = (lower, upper) if lower <= upper else (-np.inf, np.inf)
        mimic = axis.child("mimic")
        if mimic is not None:
            multiplier = mimic.number("multiplier", 1.0)
            offset = mimic.number("offset", 0.0) - multiplier * mimic.number("reference", 0.0)
            self._mimic = Mimic(f"{model.prefix}{mimic.get('joint', '').strip()}", multiplier, offset)

    def kind(self, kind: str) -> Any:
        """Return the kind of a joint: continuous for a revolute one without limits."""
        return "continuous" if kind == "revolute" and not self._is_limited else kind

    @property
    def _is_limited(self) -> bool:
        return max(map(abs, self._limits)) < _UNLIMITED

    def options(self) -> dict[str, Any]:
        """Return arguments of `Joint`."""
        limits = self._limits if self._is_limited else None
        return {"axis": self._direction, "limits": limits, "mimic": self._mimic}


def _limit(axis: Node, path: str, default: float) -> float:
    found = axis.child(path)
    return default if found is None else parse_numbers(found, found.string(), 1, finite=False)[0]


def _link_name(model: Scope, name: str) -> str:
    """Return the full name of the link of a joint; empty if there is none."""
    if name == WORLD:
        return WORLD
    found, seen = model.find(name), 0
    while isinstance(found, Frame) and found.node.tag != "link" and seen < 100:
        base = (
            found.node.get("attached_to", "").strip() if found.node.tag == "frame" else joint_link(found.node, "child")
        )
        found, seen = (found.scope.find(base) if base else found.scope), seen + 1
    if isinstance(found, Scope):
        canonical = found.find(found.node.get("canonical_link", "").strip() or "\0")
        found = canonical if isinstance(canonical, Frame) else next(_first_links(found), None)
    return f"{found.scope.prefix}{found.name}" if isinstance(found, Frame) else ""


def _first_links(model: Scope) -> Any:
    for scope in model.all_models():
        yield from scope.links
