# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Results of file readers, and their conversion to objects of a scene."""

from __future__ import annotations

import fnmatch
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_items, truncate
from warpvis.core.labels import Label, LabelNames, LabelPatterns, LabelRules
from warpvis.core.poses import check_up, poses_to_matrices, poses_to_opencv
from warpvis.errors import SceneError
from warpvis.scene._mesh import placed_at
from warpvis.scene._object import check_scale
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.joints import JointTree
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance
from warpvis.scene.solids import Solid

_LONGEST_LIST = 500
"""Maximum length of the list of skipped items in a message [characters]."""

Axis = Literal["z", "y"]
"""A vertical axis."""

_Shape = tuple[NDArray[np.float64], NDArray[np.integer]] | Solid

# Rotates y-up geometry upright in a z-up world: (x, y, z) to (x, -z, y).
Y_UP_TO_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True, eq=False)
class Part:
    """One object of a file: the arguments of `Scene.add`."""

    name: str
    """Unique name in the file."""
    mesh: _Shape
    """Vertices, shape ``(n, 3)``, and corner indices, shape ``(m, 3)``; or a round solid."""
    label: int | str = Label.OBSTACLE
    """Default label of its pixels: a number, or a name that the scene must know."""
    pose: NDArray[np.float64] | None = None
    """Part to file, a row ``x y z qx qy qz qw`` or a 4x4 matrix; None for the identity."""
    movable: bool = False
    """Whether the file defines it as movable."""
    attach_to: str | None = None
    """Name of an earlier part that it is attached to; None if it moves independently or is static."""
    link: str | None = None
    """Name of the link of `FileParts.joints` that it moves with; None for other parts."""
    has_frame: bool = True
    """Whether its pose is the initial pose if it is movable. If false, the pose only lets static parts share a mesh; a
    movable part then has its vertices in the file's frame, and no pose."""
    category: str = ""
    """Its class in the words of the file (``"mug"``), which patterns match, too; empty if not given."""
    aliases: tuple[str, ...] = ()
    """Other names that patterns match: that of its body."""
    appearance: Appearance | LazyAppearance | None = None
    """Its appearance, if defined in the file."""
    extras: dict[str, Any] = field(default_factory=dict)
    """Its metadata in the file."""

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `Scene.add` that add it."""
        names = ("mesh", "name", "label", "pose", "movable", "attach_to", "appearance", "category")
        return {name: getattr(self, name) for name in names}

    def matches(self, pattern: str) -> bool:
        """Return whether a pattern (``"wall_*"``) matches this part."""
        return any(fnmatch.fnmatchcase(name, pattern) for name in (self.name, *self.other_names))

    @property
    def other_names(self) -> tuple[str, ...]:
        """Names besides its own that patterns match: its aliases and its category."""
        return (*self.aliases, self.category) if self.category else self.aliases


@dataclass(frozen=True, eq=False)
class FileParts:
    """The result of a reader: a file's parts, and how to interpret them."""

    path: Path
    """The file."""
    parts: Sequence[Part]
    """Its parts, in the order of the scene's objects."""
    up: Axis | None = None
    """The vertical axis of its geometry, if defined by the file or its format; else None."""
    defines_frame: bool = False
    """Whether the format defines the unit (m) and the vertical axis, so that arguments cannot override them."""

    warnings: tuple[str, ...] = ()
    """Sentences about parts that were skipped or corrected."""
    classes: LabelRules = field(default_factory=LabelRules)
    """User-defined classes in the file: their names, and which are ground."""
    lights: tuple[Light, ...] = ()
    """Its lights, in the file's frame and unit."""
    background: Background | None = None
    """Its background, in the file's frame."""
    sky: Callable[[], Background | None] | None = None
    """Reads a background that is shown on request only, in the file's frame."""
    joints: JointTree = field(default_factory=JointTree)
    """Its joints, in the file's frame and in meters, if the format defines the unit."""
    moving_parts: Sequence[Part] | None = None
    """Its parts if all that the file defines as movable are, where joints split objects; None for `parts`."""

    def scene_up(self, up: Axis | None) -> Axis:
        """Return the vertical axis of a scene of these parts: `up` if given."""
        return up or (self.up if self.defines_frame and self.up else "z")

    def objects(
        self,
        scene_up: Axis,
        *,
        file_up: Axis | None = None,
        scale: float = 1.0,
        labels: LabelPatterns,
        movable: bool | Sequence[str] = False,
    ) -> list[Part]:
        """Return the parts as a scene has them, up to `scale`: labeled, rotated upright, and movable as specified.

        Arguments as for `Scene.load`.
        """
        if not self.parts:
            left_out = truncate(next(iter(self.warnings), ""), _LONGEST_LIST)
            raise SceneError(f"{left_out}; nothing is left" if left_out else f"{self.path}: holds no triangles")
        if self.defines_frame and (scale != 1 or file_up is not None):
            raise SceneError(
                f"{self.path}: the format defines the unit (m) and the vertical axis; leave out scale and file_up"
            )
        factors = check_scale(scale, str(self.path))
        upright = self._upright(scene_up, file_up)
        factor = factors.flat[0]
        uniform = bool((factors == factor).all())
        parts = [_with_uniform_pose(part, uniform) for part in _with_movable(self, movable)]
        poses = _rotated_poses(parts, upright, factor)
        objects = []
        for part, pose in zip(parts, poses, strict=True):
            label = labels.label(part.name, part.label, part.other_names)
            if pose is None:
                part = _rotated(part, upright)
            objects.append(replace(part, pose=pose, label=label))
        labels.require_used((part.name for part in self.parts), self.path)
        return objects

    def environment(
        self, scene_up: Axis, file_up: Axis | None = None, scale: float = 1.0
    ) -> tuple[tuple[Light, ...], Background | None]:
        """Return the lights and the background in the scene's frame; arguments as for `objects`."""
        if not self.lights and self.background is None:
            return (), None
        upright = self._upright(scene_up, file_up)
        rotation = np.eye(3) if upright is None else upright[:3, :3]
        factor = float(np.max(check_scale(scale, str(self.path))))
        lights = tuple(light.moved(rotation, factor) for light in self.lights)
        return lights, None if self.background is None else self.background.rotated(rotation, factor)

    def scene_joints(self, scene_up: Axis, file_up: Axis | None = None, scale: float = 1.0) -> JointTree:
        """Return the joints in the scene's frame; arguments as for `objects`."""
        upright = self._upright(scene_up, file_up)
        factor = float(np.max(check_scale(scale, str(self.path))))
        joints = self.joints if factor == 1 else self.joints.scaled(factor)
        return joints if upright is None else joints.placed(upright)

    def _upright(self, scene_up: Axis, file_up: Axis | None) -> NDArray[np.float64] | None:
        """Return the rotation from the file's vertical axis to the scene's; None for the identity."""
        axis = file_up if file_up is not None else self.up or scene_up
        check_up(axis)
        return None if axis == scene_up else (Y_UP_TO_Z_UP if axis == "y" else Y_UP_TO_Z_UP.T)


def _with_movable(file: FileParts, movable: bool | Sequence[str]) -> list[Part]:
    """Return the parts, with `movable` set as the argument specifies."""
    if isinstance(movable, str):
        movable = [movable]
    if movable is True:
        parts = file.parts if file.moving_parts is None else file.moving_parts
        if not any(part.movable for part in parts):
            raise SceneError(f"{file.path}: it defines no moving objects; name those that are movable")
        return list(parts)
    patterns = [] if movable is False or movable is None else as_items(movable, "movable", SceneError)
    if not all(isinstance(pattern, str) for pattern in patterns):
        raise SceneError(f"movable must be true, false, or names of objects, got {movable!r}")
    unused = [pattern for pattern in patterns if not any(part.matches(pattern) for part in file.parts)]
    if unused:
        names = ", ".join(repr(part.name) for part in file.parts[:10])
        raise SceneError(f"movable {unused[0]!r} matches no object of {file.path}, which has {names}")
    return [replace(part, movable=any(map(part.matches, patterns)), attach_to=None) for part in file.parts]


def _with_uniform_pose(part: Part, uniform: bool) -> Part:
    """Return the part; without a pose, in the frame of the file, if its scale is not uniform or it has no frame."""
    keeps_pose = uniform and (part.has_frame or not part.movable)
    return part if keeps_pose else in_file_frame(part)


def in_file_frame(part: Part) -> Part:
    """Return a part with its vertices in the frame of the file, without a pose; solids become triangles."""
    if part.pose is None:
        return part
    vertices, faces = _triangles(part.mesh)
    appearance = _transformed(part.appearance, poses_to_matrices(part.pose)[:3, :3])
    return replace(part, mesh=(placed_at(vertices, part.pose), faces), pose=None, appearance=appearance)


def _triangles(mesh: _Shape) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    return (mesh.vertices, mesh.faces) if isinstance(mesh, Solid) else mesh


def _rotated(part: Part, upright: NDArray[np.float64] | None) -> Part:
    """Return a part without a pose, rotated upright."""
    if upright is None or isinstance(part.mesh, Solid):
        return part
    vertices, faces = part.mesh
    rotation = upright[:3, :3]
    appearance = _transformed(part.appearance, rotation)
    return replace(part, mesh=(np.asarray(vertices) @ rotation.T, faces), appearance=appearance)


def _transformed(appearance: Appearance | LazyAppearance | None, linear: NDArray[np.float64]) -> LazyAppearance | None:
    """Return the appearance of a transformed mesh."""
    if isinstance(appearance, Appearance):
        appearance = LazyAppearance(None, appearance)
    return None if appearance is None else appearance.transformed(linear)


def _rotated_poses(
    parts: Sequence[Part], upright: NDArray[np.float64] | None, factor: float
) -> list[NDArray[np.float64] | None]:
    """Return the parts' poses in meters, rotated upright; None for meshes without a pose."""
    if upright is None and factor == 1:
        return [part.pose for part in parts]
    posed = [part.pose is not None or isinstance(part.mesh, Solid) for part in parts]
    poses = dict(enumerate(part.pose for part, has_pose in zip(parts, posed, strict=True) if has_pose))
    matrices = np.tile(np.eye(4), (len(poses), 1, 1))
    for shape in ((7,), (4, 4)):
        alike = {number: pose for number, pose in poses.items() if pose is not None and pose.shape == shape}
        if alike:
            matrices[list(alike)] = poses_to_matrices(poses_to_opencv(np.stack(list(alike.values()))))
    matrices[:, :3, 3] *= factor
    # One batch, since the conversion takes long.
    rotated = iter(poses_to_opencv(matrices if upright is None else upright @ matrices))
    return [next(rotated) if has_pose else None for has_pose in posed]


def move_with_links(parts: Iterable[Part], joints: JointTree) -> list[Part]:
    """Return parts that move with their links: those of links that are welded together are attached to the first one.

    Round solids are movable separately, since nothing can be attached to them.
    """
    pieces, first_of, moved = joints.pieces(), dict[str, str](), []
    for part in parts:
        piece = pieces.get(part.link) if part.link is not None else None
        if piece is None:
            moved.append(part)
            continue
        first = part.name if isinstance(part.mesh, Solid) else first_of.setdefault(piece, part.name)
        moved.append(replace(part, movable=True, attach_to=None if first == part.name else first))
    return moved


def instance_runs(parts: Iterable[Part]) -> Iterator[list[Part]]:
    """Group consecutive parts that differ only in name and pose."""
    return (list(run) for _, run in itertools.groupby(parts, key=_instance_key))


def _instance_key(part: Part) -> object:
    """Return a key that is equal for parts that can be instances of one mesh."""
    if part.pose is None or part.attach_to is not None:
        return id(part)
    arrays = (part.mesh,) if isinstance(part.mesh, Solid) else part.mesh
    shared = *map(id, arrays), id(part.appearance)
    return *shared, np.shape(part.pose), part.label, part.movable, part.category


def label_metadata(
    names: LabelNames, label: int, category: str = "", *, is_ground: bool
) -> dict[str, int | str | bool]:
    """Return the metadata from which readers restore the label of a mesh, with ``ground`` if not the default."""
    number, word = names.number(label), names.word(label)
    flags: dict[str, int | str | bool] = {} if is_ground == (number == Label.GROUND) else {"ground": is_ground}
    flags |= {"category": category} if category else {}
    if isinstance(number, Label) and word == number.name:
        return {"label": word, **flags}
    return {"label": int(number), **({"label_name": word} if number in names else {}), **flags}
