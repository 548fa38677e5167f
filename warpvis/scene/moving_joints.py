# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of movable objects and their geometric Jacobians as functions of some joints of a scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import truncate
from warpvis.errors import SceneError
from warpvis.scene.joints import Joint, JointValues, SceneJoints

_KINDS = ("revolute", "continuous", "prismatic")


class MovingJoints:
    """Some joints of a scene that move while the others keep their values."""

    def __init__(self, joints: SceneJoints, names: Sequence[str], values: JointValues | None) -> None:
        """Initialize with names of J joints, and with values as for `SceneJoints.poses`, of W worlds.

        Raises:
            SceneError: If a name is not that of a revolute, continuous or prismatic joint that moves movable objects.
        """
        self.names = tuple(names)
        self._joints, self.poses = joints, joints.poses(values)
        """Initial poses of the movable objects, ``(W, M, 7)`` float32, xyzw."""
        chosen = [_check_joint(joints, name) for name in self.names]
        twice = next((name for name in self.names if self.names.count(name) > 1), None)
        if twice is not None or not chosen:
            found = "none" if twice is None else f"{twice!r} twice"
            raise SceneError(f"moving must be one or more different joints, got {found}")
        given = {} if values is None else dict(values)
        self._values = {
            name: as_numpy(given.get(name, joints[name].initial), name=f"values of {name!r}").astype(np.float64)
            for name in dict.fromkeys([*given, *self.names])
        }
        columns = [self._values.pop(name).reshape(-1) for name in self.names]
        self.positions = np.stack([np.broadcast_to(column, len(self.poses)) for column in columns], axis=-1)
        """Initial positions of the joints, ``(W, J)``."""
        limits = [joint.limits if joint.limits is not None and joint.kind != "continuous" else None for joint in chosen]
        self.limits = np.array([(-np.inf, np.inf) if pair is None else pair for pair in limits])
        """Smallest and largest positions, ``(J, 2)``."""
        self.is_rotation = np.array([joint.unit == "rad" for joint in chosen])
        """Whether positions are angles, ``(J,)``."""
        above = {joint.child: joint for joint in joints}
        self._paths = [self._path(link, above) for link in joints.column_links]
        for name in self.names:
            if not any(name == leader for path in self._paths for _, leader, _ in path):
                raise SceneError(
                    f"moving must be joints that move movable objects, got {name!r}, whose links are static or have no "
                    "geometry; load the scene with movable=True"
                )

    def bodies(self) -> NDArray[np.int32]:
        """Return the first column of the rigid body of each column of the object poses, ``(M,)``; -1 if it is static.

        Objects that the same joints move are one rigid body.
        """
        first: dict[tuple[str, ...], int] = {(): -1}
        keys = [tuple(joint.name for joint, _, _ in path) for path in self._paths]
        return np.array([first.setdefault(key, column) for column, key in enumerate(keys)], dtype=np.int32)

    def evaluate(
        self, positions: NDArray[np.float64], worlds: NDArray[np.integer]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return poses of the movable objects and their geometric Jacobians.

        Args:
            positions: Positions of the joints in V views, ``(V, J)``.
            worlds: World of each view, ``(V,)``, for the values of the other joints.

        Returns:
            Poses, ``(V, M, 7)`` float32, and Jacobians, ``(V, M, 6, J)``: the derivatives of the twist (rotation,
            translation) of each object about its origin, along the axes of the world. A revolute joint with the axis a
            through the point o moves the origin p by ``a x (p - o)``; a joint that follows another one adds its columns
            times the multiplier.
        """
        count = len(positions)
        values = {name: self._of_views(name, value, worlds) for name, value in self._values.items()}
        values |= {name: positions[:, k] for k, name in enumerate(self.names)}
        links = self._joints.link_poses(values, check_limits=False)
        poses = self._joints.poses(values, check_limits=False)
        origins = poses[..., :3].astype(np.float64)
        jacobians = np.zeros((count, len(self._paths), 6, len(self.names)))
        for column, path in enumerate(self._paths):
            for joint, leader, factor in path:
                k = self.names.index(leader)
                frames = links[joint.parent] @ joint.origin
                axes = factor * frames[:, :3, :3] @ joint.axis
                if joint.kind == "prismatic":
                    jacobians[:, column, 3:, k] += axes
                else:
                    jacobians[:, column, :3, k] += axes
                    jacobians[:, column, 3:, k] += np.cross(axes, origins[:, column] - frames[:, :3, 3])
        return poses, jacobians

    def _of_views(self, name: str, value: NDArray[np.float64], worlds: NDArray[np.integer]) -> NDArray[np.float64]:
        """Return the value of a joint in each view."""
        joint = self._joints[name]
        axes = {1: 0, 3: 1}.get(joint.width, 2 if value.shape[-2:] == (4, 4) else 1)
        if value.ndim == axes:
            value = value[None]
        return value[worlds] if len(value) > 1 else np.repeat(value, len(worlds), axis=0)

    def _path(self, link: str, above: dict[str, Joint]) -> list[tuple[Joint, str, float]]:
        """Return the joints that move a link: with the joint of `names` that each of them follows, and its factor."""
        path = []
        while link in above:
            joint = above[link]
            leader, factor = joint, 1.0
            while leader.mimic is not None:
                factor *= leader.mimic.multiplier
                leader = self._joints[leader.mimic.joint]
            if leader.name in self.names:
                path.append((joint, leader.name, factor))
            link = joint.parent
        return path


def _check_joint(joints: SceneJoints, name: str) -> Joint:
    """Return a joint that can be moved by one number."""
    if not len(joints):
        raise SceneError(
            f"moving must be joints of the scene, got {name!r} for a scene without joints; they come from URDF, xacro, "
            "SDF, USD and Webots files"
        )
    if name not in joints:
        listed = truncate(", ".join(map(repr, joints.names)), 300)
        raise SceneError(f"moving must be joints of the scene, got {name!r}; the joints are {listed}")
    joint = joints[name]
    if joint.mimic is not None:
        raise SceneError(
            f"moving must be joints that follow no other joint, got {name!r}, which follows {joint.mimic.joint!r}"
        )
    if joint.kind not in _KINDS:
        raise SceneError(
            f"moving must be revolute, continuous or prismatic joints, got {name!r}, which is {joint.kind}"
        )
    return joint
