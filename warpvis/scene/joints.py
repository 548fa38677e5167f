# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Joints between links, and forward kinematics for many worlds at once.

`Scene.joints` has the joints of a loaded robot; `SceneJoints.poses` converts joint values to `object_poses`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, as_point
from warpvis.core.checks import as_items, check_choice, check_flag, check_mapping, truncate
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.core.types import ArrayInput
from warpvis.errors import PoseError, SceneError

JointKind = Literal["fixed", "revolute", "continuous", "prismatic", "planar", "floating"]
"""Motion of a joint: none; rotation about its axis with or without limits [rad]; translation along its axis [m];
translation in the plane perpendicular to its axis and rotation about it; or any."""

JointValues = Mapping[str, ArrayInput]
"""Values by joint name: of one world, or of W worlds. Revolute, continuous and prismatic joints have a number each,
shape ``()`` or ``(W,)``; planar ones x, y [m] and an angle [rad], ``(3,)`` or ``(W, 3)``; floating ones a pose,
``(7,)`` or ``(W, 7)``, or matrices."""

_REST: dict[str, tuple[float, ...]] = {
    "fixed": (),
    "revolute": (0.0,),
    "continuous": (0.0,),
    "prismatic": (0.0,),
    "planar": (0.0, 0.0, 0.0),
    "floating": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
}
"""Values at which the child link is at the joint's origin."""

_LIMIT_TOLERANCE = 1e-6
"""Tolerance of limits [rad, m]: rounding errors of values in single precision."""


class Mimic(NamedTuple):
    """Relation to the joint that another one follows: ``multiplier * value + offset``."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two links."""

    name: str
    kind: JointKind
    parent: str
    """Name of the parent link."""
    child: str
    """Name of the child link."""
    origin: NDArray[np.float64] = field(default_factory=lambda: np.eye(4), repr=False)
    """Joint to parent link at rest, shape ``(4, 4)``."""
    axis: NDArray[np.float64] = field(default_factory=lambda: np.array([1.0, 0, 0]), repr=False)
    """Axis in the joint's frame, shape ``(3,)``, normalized."""
    limits: tuple[float, float] | None = None
    """Minimum and maximum of the value of a revolute or prismatic joint; None if unlimited."""
    mimic: Mimic | None = None
    """The joint that it follows; None if it has its own value."""
    initial: NDArray[np.float64] | None = field(default=None, repr=False)
    """Value in the initial pose; None for the rest position: zero, or the identity."""
    child_origin: NDArray[np.float64] = field(default_factory=lambda: np.eye(4), repr=False)
    """Child link to joint, shape ``(4, 4)``: the identity in URDF."""

    def __post_init__(self) -> None:
        check_choice(self.kind, f"kind of joint {self.name!r}", get_args(JointKind), SceneError)
        for key in ("origin", "child_origin"):
            row = poses_to_opencv(getattr(self, key), name=f"{key} of joint {self.name!r}")
            if len(row) != 1:
                raise PoseError(f"{key} of joint {self.name!r} must be one pose, got {len(row)}")
            object.__setattr__(self, key, poses_to_matrices(row[0]))
        axis = as_point(self.axis, f"axis of joint {self.name!r}", SceneError)
        length = float(np.linalg.norm(axis))
        if self.kind not in ("fixed", "floating") and length == 0:
            raise SceneError(f"axis of joint {self.name!r} must not be zero")
        object.__setattr__(self, "axis", axis / (length or 1.0))
        if self.limits is not None:
            lower, upper = as_point([*self.limits, 0], f"limits of joint {self.name!r}", SceneError)[:2].tolist()
            if lower > upper:
                raise SceneError(f"limits of joint {self.name!r} must be in ascending order, got {lower:g}, {upper:g}")
            object.__setattr__(self, "limits", (lower, upper))
        if self.mimic is not None and self.width != 1:
            raise SceneError(f"joint {self.name!r} is {self.kind} and must not follow another joint")
        initial = _REST[self.kind] if self.initial is None else self.initial
        row = _parse(self, initial, f"initial of joint {self.name!r}")
        if len(row) != 1:
            raise PoseError(f"initial of joint {self.name!r} must be one value, got {len(row)}")
        object.__setattr__(self, "initial", row[0])

    @property
    def width(self) -> int:
        """Number of its values: 0 for fixed, 1, 3 for planar, or 7 for floating joints."""
        return len(_REST[self.kind])

    @property
    def unit(self) -> str:
        """Unit of its value, ``"rad"`` or ``"m"``."""
        return "rad" if self.kind in ("revolute", "continuous") else "m"

    def child_poses(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return poses of the child link in the parent's frame, ``(W, 4, 4)``, for values of shape ``(W, width)``."""
        if self.kind == "fixed":
            motion = np.eye(4)[None]
        elif self.kind == "floating":
            motion = poses_to_matrices(values)
        elif self.kind == "planar":
            frame = np.eye(4)
            frame[:3, :3] = _rotation_to(self.axis)
            motion = _rotations(np.array([0.0, 0, 1]), values[:, 2])
            motion[:, :2, 3] = values[:, :2]
            motion = frame @ motion @ frame.T
        elif self.kind == "prismatic":
            motion = np.tile(np.eye(4), (len(values), 1, 1))
            motion[:, :3, 3] = values * self.axis
        else:
            motion = _rotations(self.axis, values[:, 0])
        return self.origin @ motion @ self.child_origin


class JointTree:
    """Joints that connect links to trees, and their forward kinematics in double precision.

    Every link is the child of at most one joint. Iterate over it for its joints; ``tree["elbow"]`` is one of them.

    Example:
        >>> tree = JointTree([Joint("turn", "revolute", "base", "arm", axis=(0, 0, 1))])
        >>> tree.link_poses({"turn": np.linspace(0, 1, 5)})["arm"].shape
        (5, 4, 4)
    """

    def __init__(self, joints: Iterable[Joint] = (), root_poses: Mapping[str, ArrayLike] | None = None) -> None:
        """Create a tree.

        Args:
            joints: The joints, in any order.
            root_poses: Poses of root links, by name: rows of 7 numbers or 4x4 matrices; the identity by default.

        Raises:
            SceneError: If names repeat, a link has two parents or is below itself, or a joint follows one that does not
                exist or that follows itself.
        """
        items = as_items(joints, "joints", SceneError)
        if not all(isinstance(item, Joint) for item in items):
            raise SceneError(f"joints must be Joints, got {truncate(repr(items))}")
        self._joints: dict[str, Joint] = {}
        parents: dict[str, Joint] = {}
        for joint in items:
            if self._joints.setdefault(joint.name, joint) is not joint:
                raise SceneError(f"names of joints must be different, got {joint.name!r} twice")
            above = parents.setdefault(joint.child, joint)
            if above is not joint:
                raise SceneError(f"link {joint.child!r} is the child of two joints, {above.name!r} and {joint.name!r}")
        self._root_poses = {
            name: poses_to_matrices(poses_to_opencv(pose, name=f"pose of link {name!r}")[0])
            for name, pose in check_mapping(root_poses or {}, "root_poses", SceneError).items()
        }
        moved = next((name for name in self._root_poses if name in parents), None)
        if moved is not None:
            raise SceneError(f"link {moved!r} has a pose, but is moved by the joint {parents[moved].name!r}")
        self._links, self._ordered = _order(self._joints.values(), parents, self._root_poses)
        self._check_mimics()

    @property
    def joints(self) -> tuple[Joint, ...]:
        """All joints, in the given order."""
        return tuple(self._joints.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints with independent values: not fixed, and following no other joint."""
        return tuple(joint.name for joint in self if joint.width and joint.mimic is None)

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, parents first."""
        return self._links

    def __iter__(self) -> Iterator[Joint]:
        return iter(self._joints.values())

    def __len__(self) -> int:
        return len(self._joints)

    def __getitem__(self, name: str) -> Joint:
        if name not in self._joints:
            raise SceneError(f"no joint is named {name!r}; {_listed(self._joints)}")
        return self._joints[name]

    def __contains__(self, name: object) -> bool:
        return name in self._joints

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self.names)})"

    def link_poses(
        self, values: JointValues | None = None, *, check_limits: bool = True
    ) -> dict[str, NDArray[np.float64]]:
        """Return the poses of all links, link to world, by name; shape ``(W, 4, 4)``.

        Args:
            values: Values by joint; all others are at their initial values. W is 1 if all are of one world.
            check_limits: Whether values must be within the limits of their joints.

        Raises:
            PoseError: If a joint is unknown, fixed or follows another, or a value has the wrong shape, is not finite,
                or is not within the limits.
        """
        numbers = self._parse(values, check_flag(check_limits, "check_limits", PoseError))
        poses = {link: self._root_poses.get(link, np.eye(4))[None] for link in self._links}
        for joint in self._ordered:
            poses[joint.child] = poses[joint.parent] @ joint.child_poses(numbers[joint.name])
        worlds = next((len(rows) for rows in numbers.values() if len(rows) != 1), 1)
        return {link: np.broadcast_to(rows, (worlds, 4, 4)).copy() for link, rows in poses.items()}

    def pieces(self) -> dict[str, str | None]:
        """Return the links that move together: for each link, the topmost one welded to it; None if it cannot move."""
        found: dict[str, str | None] = dict.fromkeys(self._links)
        for joint in self._ordered:
            found[joint.child] = found[joint.parent] if joint.kind == "fixed" else joint.child
        return found

    def joined(self, other: JointTree) -> JointTree:
        """Return one tree of the joints of both."""
        return JointTree([*self, *other], {**self._root_poses, **other._root_poses})

    def placed(self, frame: NDArray[np.float64]) -> JointTree:
        """Return the tree with all root links moved by a 4x4 matrix."""
        roots = [link for link in self._links if all(joint.child != link for joint in self)]
        return JointTree(self, {link: frame @ self._root_poses.get(link, np.eye(4)) for link in roots})

    def scaled(self, factor: float) -> JointTree:
        """Return the tree with all lengths multiplied by a factor."""
        poses = {link: _scaled_pose(pose, factor) for link, pose in self._root_poses.items()}
        return JointTree([_scaled_joint(joint, factor) for joint in self], poses)

    def _parse(self, values: JointValues | None, check_limits: bool) -> dict[str, NDArray[np.float64]]:
        """Return the values of all joints, shape ``(W, width)`` or ``(1, width)``."""
        given = {} if values is None else check_mapping(values, "values", PoseError)
        found = {joint.name: np.array(joint.initial)[None] for joint in self}
        for name, value in given.items():
            if name not in self._joints:
                raise PoseError(f"values of {name!r} fit no joint; {_listed(self.names)}")
            joint = self._joints[name]
            if joint.mimic is not None:
                raise PoseError(f"joint {name!r} follows {joint.mimic.joint!r}; give the values of that one")
            if joint.width == 0:
                raise PoseError(f"joint {name!r} is fixed and has no value; {_listed(self.names)}")
            found[name] = _parse(joint, value, f"values of {name!r}")
            if check_limits:
                _check_limits(joint, found[name][:, 0])
        counts = {name: len(found[name]) for name in given if len(found[name]) != 1}
        first = next(iter(counts), "")
        other = next((name for name in counts if counts[name] != counts[first]), None)
        if other is not None:
            both = f"{counts[first]} for {first!r} and {counts[other]} for {other!r}"
            raise PoseError(f"values must be of the same number of worlds, got {both}")
        for joint in self:
            found[joint.name] = self._followed(joint, found)
        return found

    def _followed(self, joint: Joint, values: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
        if joint.mimic is None:
            return values[joint.name]
        leader, multiplier, offset = joint.mimic
        return multiplier * self._followed(self._joints[leader], values) + offset

    def _check_mimics(self) -> None:
        for joint in self:
            seen = [joint]
            while (mimic := seen[-1].mimic) is not None:
                leader = self._joints.get(mimic.joint)
                if leader is None or leader.width != 1:
                    raise SceneError(f"joint {seen[-1].name!r} follows {mimic.joint!r}, which is no joint with a value")
                if leader in seen:
                    raise SceneError(f"joint {leader.name!r} follows itself")
                seen.append(leader)


class SceneJoints(JointTree):
    """The joints of a scene, from its file, and the poses of its movable objects; from `Scene.joints`."""

    def __init__(self, tree: JointTree, links: Sequence[str | None], initial: NDArray[np.float32]) -> None:
        """Initialize with the tree in the world's frame, and the links and initial poses of the movable objects."""
        super().__init__(tree, tree._root_poses)
        self._columns, self._initial = [link or "" for link in links], poses_to_matrices(initial)

    @property
    def column_links(self) -> tuple[str, ...]:
        """Names of the links of the movable objects, the columns of `poses`; "" for objects without a link."""
        return tuple(self._columns)

    def poses(self, values: JointValues | None = None, *, check_limits: bool = True) -> NDArray[np.float32]:
        """Return the poses of the movable objects, which `Renderer.render` accepts as ``object_poses``.

        Objects that are not on a moving link are at their initial poses.

        Args:
            values: Values by joint, as for `JointTree.link_poses`.
            check_limits: Whether values must be within the limits of their joints.

        Returns:
            Object to world, rows ``x y z qx qy qz qw``, shape ``(W, M, 7)`` for the M objects of `Scene.movable`.

        Raises:
            PoseError: As for `JointTree.link_poses`.
        """
        links, rest = self.link_poses(values, check_limits=check_limits), self.link_poses()
        worlds = len(next(iter(links.values()))) if links else 1
        matrices = np.tile(self._initial, (worlds, 1, 1, 1))
        for column, link in enumerate(self._columns):
            if link in links:
                matrices[:, column] = links[link] @ np.linalg.inv(rest[link][0]) @ self._initial[column]
        rows = poses_to_opencv(matrices.reshape(-1, 4, 4), name="poses of links")
        return rows.reshape(worlds, len(self._columns), 7).astype(np.float32)


def _scaled_pose(pose: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    scaled = pose.copy()
    scaled[:3, 3] *= factor
    return scaled


def _scaled_joint(joint: Joint, factor: float) -> Joint:
    """Return a joint with all lengths multiplied by a factor."""
    initial = np.array(joint.initial)
    lengths = {"prismatic": 1, "planar": 2, "floating": 3}.get(joint.kind, 0)
    initial[:lengths] *= factor
    changes: dict[str, Any] = {"initial": initial}
    if joint.kind == "prismatic" and joint.limits is not None:
        changes["limits"] = (factor * joint.limits[0], factor * joint.limits[1])
    changes |= {name: _scaled_pose(getattr(joint, name), factor) for name in ("origin", "child_origin")}
    return replace(joint, **changes)


def _order(
    joints: Iterable[Joint], parents: Mapping[str, Joint], roots: Iterable[str]
) -> tuple[tuple[str, ...], list[Joint]]:
    """Return all links and joints, parents first; raise a `SceneError` if a link is below itself."""
    below: dict[str, list[Joint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    links = list(dict.fromkeys([*roots, *(link for link in below if link not in parents)]))
    ordered = []
    for link in links:  # grows
        ordered += below.get(link, [])
        links += [joint.child for joint in below.get(link, ())]
    reached = set(ordered)
    circular = next((joint for joint in joints if joint not in reached), None)
    if circular is not None:
        raise SceneError(f"joint {circular.name!r} is in a circle of joints: link {circular.child!r} is below itself")
    return tuple(links), ordered


def _parse(joint: Joint, value: ArrayInput, name: str) -> NDArray[np.float64]:
    """Return values of a joint, shape ``(W, width)``."""
    array = as_numpy(value, name=name).astype(np.float64)
    if joint.width == 7:
        return poses_to_opencv(array, name=name)
    rows = array[..., None] if joint.width == 1 else array
    if rows.ndim not in (1, 2) or rows.shape[-1] != joint.width:
        shapes = "() or (W,)" if joint.width == 1 else f"({joint.width},) or (W, {joint.width})"
        raise PoseError(f"{name} must have shape {shapes}, got {array.shape}")
    if not np.isfinite(rows).all():
        raise PoseError(f"{name} must be finite")
    return rows if rows.ndim == 2 else rows[None]


def _check_limits(joint: Joint, values: NDArray[np.float64]) -> None:
    if joint.limits is None or joint.kind not in ("revolute", "prismatic"):
        return
    lower, upper = joint.limits
    outside = np.flatnonzero((values < lower - _LIMIT_TOLERANCE) | (values > upper + _LIMIT_TOLERANCE))
    if len(outside):
        first = int(outside[0])
        raise PoseError(
            f"values of {joint.name!r} must be from {lower:g} to {upper:g} {joint.unit}, got {values[first]:g} at "
            f"index {first}; check_limits=False allows it"
        )


def _listed(names: Iterable[str]) -> str:
    found = ", ".join(map(repr, names))
    return f"the joints are {truncate(found, 300)}" if found else "there are no joints"


def _rotations(axis: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotations about a unit axis, shape ``(W, 4, 4)`` (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrices = np.tile(np.eye(4), (len(angles), 1, 1))
    matrices[:, :3, :3] += np.sin(angles)[:, None, None] * cross
    matrices[:, :3, :3] += 2 * np.sin(angles / 2)[:, None, None] ** 2 * (cross @ cross)
    return matrices


def _rotation_to(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest rotation from z to a unit axis, shape ``(3, 3)``."""
    x, y, z = axis
    length = float(np.hypot(x, y))
    if length == 0:
        return np.eye(3) if z > 0 else np.diag([1.0, -1, -1])
    return _rotations(np.array([-y, x, 0]) / length, np.array([np.arctan2(length, z)]))[0, :3, :3]
