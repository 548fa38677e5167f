# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Articulated objects of Habitat's scenes: a URDF file at a place, with a scale and the values of its joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.errors import FileFormatError, WarpvisError
from warpvis.io.datasets._fields import Fields
from warpvis.scene import FileParts, Part
from warpvis.scene.joints import Joint, JointTree
from warpvis.scene.solids import Solid


class ScaledMeshes:
    """Meshes by their scale: the same arrays for the same mesh and factor."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, float], tuple[Any, Any]] = {}

    def get(self, mesh: Any, factor: float) -> Any:
        """Return a mesh multiplied by a factor."""
        if factor == 1:
            return mesh
        key = id(mesh), factor
        if key not in self._known:
            # The source is stored, too, so that its id stays unique.
            scaled = mesh.scaled(factor) if isinstance(mesh, Solid) else (np.asarray(mesh[0]) * factor, mesh[1])
            self._known[key] = mesh, scaled
        return self._known[key][1]


def place_robot(
    found: FileParts, prefix: str, base: NDArray[np.float64], factor: float, item: Fields, meshes: ScaledMeshes
) -> tuple[list[Part], JointTree]:
    """Return the parts and joints of a URDF file at a place; all names begin with the prefix.

    Args:
        found: The contents of the file.
        prefix: Name of the instance.
        base: Matrix from the root link to the scene.
        factor: Scale of the meshes and of the lengths between joints.
        item: The instance, whose ``initial_joint_pose`` has the values of joints.
        meshes: The meshes of all instances.
    """
    values = _initial(found.joints, item)
    try:
        rest, posed = found.joints.link_poses(), found.joints.link_poses(values, check_limits=False)
    except WarpvisError as error:
        raise FileFormatError(f"{item.named('initial_joint_pose')} does not fit the joints: {error}") from None
    parts = []
    for part in found.parts:
        local = np.eye(4) if part.pose is None else _matrix(part.pose)
        if part.link in posed:
            local = posed[part.link][0] @ np.linalg.inv(rest[part.link][0]) @ local
        local[:3, 3] *= factor
        parts.append(
            replace(
                part,
                name=f"{prefix}/{part.name}",
                mesh=meshes.get(part.mesh, factor),
                pose=poses_to_opencv(base @ local)[0],
                attach_to=None if part.attach_to is None else f"{prefix}/{part.attach_to}",
                link=None if part.link is None else f"{prefix}/{part.link}",
            )
        )
    return parts, _renamed(found.joints.scaled(factor), prefix, base, values, factor)


def _initial(joints: JointTree, item: Fields) -> dict[str, Any]:
    """Return the values of joints by name: those of an object, or of a list in the order of the joints."""
    given = item.values.get("initial_joint_pose")
    if not given:
        return {}
    if isinstance(given, Mapping):
        fields = item.child("initial_joint_pose")
        return {name: fields.number(name, 0.0) for name in fields.values}
    names = [name for name in joints.names if joints[name].width == 1]
    values = item.vector("initial_joint_pose", (0.0,) * len(names))
    return dict(zip(names, values.tolist(), strict=True))


def _renamed(
    joints: JointTree, prefix: str, base: NDArray[np.float64], values: Mapping[str, Any], factor: float
) -> JointTree:
    """Return scaled joints with the prefix, at a place, and with initial values."""
    renamed: list[Joint] = []
    for joint in joints:
        initial: Any = joint.initial
        if joint.name in values:
            initial = values[joint.name] * (factor if joint.kind == "prismatic" else 1.0)
        mimic = joint.mimic
        renamed.append(
            replace(
                joint,
                name=f"{prefix}/{joint.name}",
                parent=f"{prefix}/{joint.parent}",
                child=f"{prefix}/{joint.child}",
                mimic=None if mimic is None else mimic._replace(joint=f"{prefix}/{mimic.joint}"),
                initial=initial,
            )
        )
    return JointTree(renamed).placed(base) if renamed else JointTree()


def _matrix(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    return pose.copy() if pose.shape == (4, 4) else poses_to_matrices(pose)
