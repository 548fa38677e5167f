# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Joints of UsdPhysics as a tree; rigid bodies that no joint holds have a floating joint."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from warpvis.core.checks import describe_exception, truncate
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.scene.joints import Joint, JointKind, JointTree, Mimic

WORLD = "world"
"""The link that static bodies are fixed to."""

_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
_KINDS: dict[str, JointKind] = {
    "PhysicsFixedJoint": "fixed",
    "PhysicsRevoluteJoint": "revolute",
    "PhysicsPrismaticJoint": "prismatic",
}
_FREEDOMS = ("transX", "transY", "transZ", "rotX", "rotY", "rotZ")


@dataclass(eq=False)
class _Found:
    """A joint of a stage."""

    name: str
    kind: JointKind
    bodies: tuple[str, str]
    frames: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Joint frames on both bodies to the stage, shape ``(4, 4)``."""
    axis: tuple[float, ...]
    limits: tuple[float, float] | None
    mimic: Mimic | None


def read_joints(
    prims: Sequence[Any], bodies: Mapping[str, NDArray[np.float64]], meters: float
) -> tuple[JointTree, list[str]]:
    """Read the joints of a stage.

    Args:
        prims: Their prims.
        bodies: Placements of the rigid bodies, body to stage in meters, by name.
        meters: The stage's unit [m].

    Returns:
        The tree, whose links are the bodies and `WORLD`, and what is not read.
    """
    counts = Counter(str(prim.GetName()) for prim in prims)
    names = {}
    for prim in prims:
        name, path = str(prim.GetName()), str(prim.GetPath())
        names[path] = name if counts[name] == 1 else path
    notes: list[str] = []
    found = []
    for prim in prims:
        try:
            joint = _read(prim, names, bodies, meters)
            if joint is not None:
                found.append(joint)
        except Exception as error:  # damaged files may raise any exception
            notes.append(f"joint <{prim.GetPath()}> ({truncate(describe_exception(error))})")
    poses = {name: _rigid(matrix) for name, matrix in bodies.items()} | {WORLD: np.eye(4)}
    joints, held = list[Joint](), _Forest()
    for item in sorted(found, key=lambda joint: WORLD not in joint.bodies):
        parent, child = held.orient(*item.bodies)
        if not parent:
            notes.append(f"joint {item.name!r}, which closes a loop")
            continue
        joints.append(_joint(item, parent, child, poses))
    known = {joint.name for joint in joints}
    joints = [item for item in joints if item.mimic is None or item.mimic.joint in known]
    for body in bodies:
        if not held.has_parent(body):
            row = poses_to_opencv(poses[body])[0]
            joints.append(Joint(body, "floating", WORLD, body, initial=row))
    return JointTree(joints, {WORLD: np.eye(4)}), notes


class _Forest:
    """The links that joints connect, each with at most one parent, and without loops."""

    def __init__(self) -> None:
        self._parents: dict[str, str] = {}

    def has_parent(self, link: str) -> bool:
        return link in self._parents

    def orient(self, first: str, second: str) -> tuple[str, str]:
        """Return parent and child of a new joint; empty names if it would close a loop."""
        if self._root(first) != self._root(second):
            for parent, child in ((first, second), (second, first)):
                if child != WORLD and child not in self._parents:
                    self._parents[child] = parent
                    return parent, child
        return "", ""

    def _root(self, link: str) -> str:
        while link in self._parents:
            link = self._parents[link]
        return link


def _joint(found: _Found, parent: str, child: str, poses: Mapping[str, NDArray[np.float64]]) -> Joint:
    """Return a joint whose initial value gives the child's pose in the stage."""
    (frame, other), axis = found.frames, np.array(found.axis)
    if parent != found.bodies[0]:  # the child is the first body, which moves the other way
        frame, other, axis = other, frame, -axis
    motion = np.linalg.inv(frame) @ other
    initial: list[float] = []
    if found.kind in ("revolute", "continuous"):
        initial = [_angle(motion[:3, :3], axis)]
    elif found.kind == "prismatic":
        initial = [float(motion[:3, 3] @ axis)]
    origin = np.linalg.inv(poses[parent]) @ frame
    value = np.array(initial) if initial else None
    kind = found.kind
    plain = Joint(found.name, kind, parent, child, origin, axis, initial=value)
    moved = plain.child_poses(np.array(plain.initial)[None])[0]
    rest = np.linalg.inv(poses[parent]) @ poses[child]
    child_origin = np.linalg.inv(moved) @ rest
    return Joint(found.name, kind, parent, child, origin, axis, found.limits, found.mimic, value, child_origin)


def _read(
    prim: Any, names: Mapping[str, str], bodies: Mapping[str, NDArray[np.float64]], meters: float
) -> _Found | None:
    """Read a joint; None if it is disabled or holds no rigid body. Raise a `ValueError` if it is not supported."""
    if prim.GetAttribute("physics:jointEnabled").Get() is False:
        return None
    if prim.GetAttribute("physics:excludeFromArticulation").Get() is True:
        return None
    sides = [_side(prim, number, bodies, meters) for number in (0, 1)]
    (first, frame), (second, other) = sides
    if first == second:
        return None
    type_name = str(prim.GetTypeName())
    axis: tuple[float, ...] = _AXES[str(prim.GetAttribute("physics:axis").Get() or "X")]
    kind, limits = _KINDS.get(type_name), None
    if kind in ("revolute", "prismatic"):
        unit = math.pi / 180 if kind == "revolute" else meters
        lower, upper = (prim.GetAttribute(f"physics:{side}Limit").Get() for side in ("lower", "upper"))
        limits = _limits(lower, upper, unit)
    elif type_name == "PhysicsJoint":
        kind, axis, limits = _generic(prim, meters)
    if kind is None:
        raise ValueError(f"a {type_name.removeprefix('Physics')} is not supported")
    if kind == "revolute" and limits is None:
        kind = "continuous"
    name = names[str(prim.GetPath())]
    return _Found(name, kind, (first, second), (frame, other), axis, limits, _mimic(prim, names))


def _side(
    prim: Any, number: int, bodies: Mapping[str, NDArray[np.float64]], meters: float
) -> tuple[str, NDArray[np.float64]]:
    """Return the rigid body at a side of a joint, and the joint's frame there."""
    targets = prim.GetRelationship(f"physics:body{number}").GetForwardedTargets()
    target = prim.GetStage().GetPrimAtPath(targets[0]) if targets else None
    position = np.array(prim.GetAttribute(f"physics:localPos{number}").Get() or (0, 0, 0), dtype=np.float64)
    rotation = prim.GetAttribute(f"physics:localRot{number}").Get()
    quaternion = (0.0, 0.0, 0.0, 1.0) if rotation is None else (*rotation.GetImaginary(), rotation.GetReal())
    if not np.linalg.norm(quaternion) > 0:
        raise ValueError(f"localRot{number} has length 0")
    local = poses_to_matrices(np.array([0.0, 0, 0, *quaternion]) / np.r_[1, 1, 1, [np.linalg.norm(quaternion)] * 4])
    body, place = WORLD, np.diag([meters, meters, meters, 1.0])
    if target:
        path = str(target.GetPath())
        while path and path not in bodies:
            path = path.rpartition("/")[0]
        body = path or WORLD
        time = Usd.TimeCode.EarliestTime()
        place = place @ np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(target), dtype=np.float64).T
    frame = _rigid(place) @ local
    frame[:3, 3] = place[:3, :3] @ position + place[:3, 3]
    return body, frame


def _rigid(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation nearest to a matrix, and its translation."""
    left, _, right = np.linalg.svd(matrix[:3, :3])
    found = np.eye(4)
    found[:3, :3] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    found[:3, 3] = matrix[:3, 3]
    return found


def _limits(lower: Any, upper: Any, unit: float) -> tuple[float, float] | None:
    """Return the limits of a joint; None if it has none."""
    low, high = (-math.inf if lower is None else float(lower)), (math.inf if upper is None else float(upper))
    if not (math.isfinite(low) and math.isfinite(high)) or low > high:
        return None
    return low * unit, high * unit


def _generic(prim: Any, meters: float) -> tuple[JointKind, tuple[float, ...], tuple[float, float] | None]:
    """Return kind, axis and limits of a joint that is defined by the limits of its six degrees of freedom."""
    free = []
    for name in _FREEDOMS:
        low, high = (prim.GetAttribute(f"limit:{name}:physics:{side}").Get() for side in ("low", "high"))
        if low is None or high is None or low <= high:
            free.append((name, low, high))
    if not free:
        return "fixed", _AXES["X"], None
    if len(free) > 1:
        raise ValueError(f"it has {len(free)} degrees of freedom, and joints of at most one are supported")
    name, low, high = free[0]
    is_turn = name.startswith("rot")
    limits = _limits(low, high, math.pi / 180 if is_turn else meters)
    return ("revolute" if is_turn else "prismatic"), _AXES[name[-1]], limits


def _mimic(prim: Any, names: Mapping[str, str]) -> Mimic | None:
    """Return the joint that another one follows (NewtonMimicAPI)."""
    targets = prim.GetRelationship("newton:mimicJoint").GetForwardedTargets()
    if not targets or str(targets[0]) not in names:
        return None
    offset, factor = (prim.GetAttribute(f"newton:mimicCoef{number}").Get() for number in (0, 1))
    return Mimic(names[str(targets[0])], float(1.0 if factor is None else factor), float(offset or 0.0))


def _angle(rotation: NDArray[np.float64], axis: NDArray[np.float64]) -> float:
    """Return the angle of a rotation about an axis [rad]."""
    sine = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return float(np.arctan2(sine @ axis / 2, (np.trace(rotation) - 1) / 2))
