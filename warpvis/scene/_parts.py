# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What readers of files find, and how it becomes objects of a scene."""

from __future__ import annotations

import fnmatch
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_items, truncate
from warpvis.core.label_rules import LabelPatterns, LabelRules
from warpvis.core.labels import Label
from warpvis.core.poses import check_up, poses_to_matrices, poses_to_opencv
from warpvis.core.types import MeshLike, PoseLike
from warpvis.errors import SceneError
from warpvis.scene._object import check_scale
from warpvis.scene._shared_mesh import placed_at
from warpvis.scene.lights import Background, Light
from warpvis.scene.looks import Look
from warpvis.scene.materials import Appearance
from warpvis.scene.solids import Solid

_LONGEST_LIST = 500
"""Of what is left out, in a message [characters]."""

Axis = Literal["z", "y"]
"""A vertical axis."""

# Turns geometry whose vertical axis is y upright in a world whose vertical axis is z: (x, y, z) to (x, -z, y).
Y_UP_TO_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True, eq=False)
class Part:
    """One object of a file: what `Scene.add` takes."""

    name: str
    """A name that no other part of the file has."""
    mesh: tuple[NDArray[np.float64], NDArray[np.integer]] | Solid
    """Vertices, shape ``(n, 3)``, and corner indices, shape ``(m, 3)``; or a round solid."""
    label: int | str = Label.OBSTACLE
    """What its pixels are labelled unless the user says otherwise: a number, or a name that the scene has to know."""
    pose: NDArray[np.float64] | None = None
    """Part to file, a row ``x y z qx qy qz qw`` or a 4x4 matrix; None for the identity."""
    movable: bool = False
    """Whether the file says that it moves."""
    attach_to: str | None = None
    """Name of an earlier part that it moves with; None if it moves by itself, or stays."""
    has_frame: bool = True
    """Whether its pose is where it begins if it is movable; else the pose is there for what stays to share a mesh, and
    what is movable has its vertices where the file has them, and no pose."""
    aliases: tuple[str, ...] = ()
    """Other names that patterns may mean it by: its body's."""
    appearance: Appearance | Look | None = None
    """What it looks like, if the file says it."""

    def arguments(self) -> dict[str, Any]:
        """Name the arguments of `Scene.add` that add it."""
        names = ("mesh", "name", "label", "pose", "movable", "attach_to", "appearance")
        return {name: getattr(self, name) for name in names}

    def fits(self, pattern: str) -> bool:
        """Tell whether a pattern (``"wall_*"``) means this part."""
        return any(fnmatch.fnmatchcase(name, pattern) for name in (self.name, *self.aliases))


@dataclass(frozen=True, eq=False)
class FileParts:
    """What a reader gives: a file's parts, and how they are meant."""

    path: Path
    """The file."""
    parts: Sequence[Part]
    """Its parts, in the order of the scene's objects."""
    up: Axis | None = None
    """The vertical axis of its geometry, as the file or its format says; None if neither does."""
    settled: bool = False
    """Whether the format is in metres and says which axis is up, so that a user has no say in either."""

    warnings: tuple[str, ...] = ()
    """Sentences about what is left out, or was corrected."""
    classes: LabelRules = field(default_factory=LabelRules)
    """What the file says of classes of its own: their names, and which are ground."""
    lights: tuple[Light, ...] = ()
    """Its lights, in its own frame and unit."""
    background: Background | None = None
    """What it says is seen where nothing is, in its own frame."""

    def scene_up(self, up: Axis | None) -> Axis:
        """Return the vertical axis of a scene of these parts, of which the user asked for `up` or for none."""
        return up or (self.up if self.settled and self.up else "z")

    def objects(
        self,
        scene_up: Axis,
        *,
        file_up: Axis | None = None,
        scale: float = 1.0,
        labels: LabelPatterns,
        movable: bool | Sequence[str] = False,
    ) -> list[dict[str, Any]]:
        """Make arguments for `Scene.add`, for each part.

        Args:
            scene_up: The scene's vertical axis, to which geometry is turned.
            file_up: The file's vertical axis; what the file says by default, else the scene's.
            scale: Factor from the file's unit to metres.
            labels: What the user says of labels.
            movable: Whether what the file says moves is movable; or names and patterns of what is, each by itself.

        Raises:
            SceneError: There are no parts, a pattern fits none of them, or an argument has no meaning for the file.
        """
        if not self.parts:
            left_out = truncate(next(iter(self.warnings), ""), _LONGEST_LIST)
            raise SceneError(f"{left_out}; nothing is left" if left_out else f"{self.path}: holds no triangles")
        if self.settled and (scale != 1 or file_up is not None):
            raise SceneError(
                f"{self.path}: such a file is in metres and says which axis is up: leave out scale and file_up"
            )
        factors = check_scale(scale, str(self.path))
        upright = self._upright(scene_up, file_up)
        factor = factors.flat[0]
        uniform = bool((factors == factor).all())
        parts = [part if _is_apart(part, uniform) else _without_pose(part) for part in _moving(self, movable)]
        poses = _turned_poses(parts, upright, factor)
        objects = []
        for part, pose in zip(parts, poses, strict=True):
            label = labels.label(part.name, part.label, part.aliases)
            mesh = part.mesh if pose is not None else _turned(part, upright)
            objects.append({**part.arguments(), "mesh": mesh, "pose": pose, "label": label, "scale": scale})
        labels.require_used((part.name for part in self.parts), self.path)
        return objects

    def environment(
        self, scene_up: Axis, file_up: Axis | None = None, scale: float = 1.0
    ) -> tuple[tuple[Light, ...], Background | None]:
        """Return the lights and the background in the scene's frame; arguments as for `objects`."""
        if not self.lights and self.background is None:
            return (), None
        upright = self._upright(scene_up, file_up)
        turn = np.eye(3) if upright is None else upright[:3, :3]
        factor = float(np.max(check_scale(scale, str(self.path))))
        lights = tuple(light.moved(turn, factor) for light in self.lights)
        return lights, None if self.background is None else self.background.turned(turn)

    def _upright(self, scene_up: Axis, file_up: Axis | None) -> NDArray[np.float64] | None:
        """Return what turns the file's geometry upright in a scene; None if it is so."""
        axis = file_up if file_up is not None else self.up or scene_up
        check_up(axis)
        return None if axis == scene_up else (Y_UP_TO_Z_UP if axis == "y" else Y_UP_TO_Z_UP.T)


def _moving(file: FileParts, movable: bool | Sequence[str]) -> list[Part]:
    """Return the parts, of which those are movable that shall be."""
    if isinstance(movable, str):
        movable = [movable]
    if movable is True:
        if not any(part.movable for part in file.parts):
            raise SceneError(f"{file.path}: nothing in it is said to move: name what is movable")
        return list(file.parts)
    wanted = [] if movable is False or movable is None else as_items(movable, "movable", SceneError)
    if not all(isinstance(pattern, str) for pattern in wanted):
        raise SceneError(f"movable must be true, false, or names of objects, got {movable!r}")
    unused = [pattern for pattern in wanted if not any(part.fits(pattern) for part in file.parts)]
    if unused:
        some = ", ".join(repr(part.name) for part in file.parts[:10])
        raise SceneError(f"movable {unused[0]!r} fits no object of {file.path}, which has {some}")
    return [replace(part, movable=any(map(part.fits, wanted)), attach_to=None) for part in file.parts]


def _is_apart(part: Part, uniform: bool) -> bool:
    """Tell whether a part keeps the pose that it has: it cannot where the file is stretched along one axis."""
    return part.pose is None or (uniform and (part.has_frame or not part.movable))


def _without_pose(part: Part) -> Part:
    """Return the same part with its vertices where the file has them."""
    if part.pose is None or isinstance(part.mesh, Solid):
        return part
    vertices, faces = part.mesh
    return replace(part, mesh=(placed_at(vertices, part.pose), faces), pose=None)


def _turned(part: Part, upright: NDArray[np.float64] | None) -> MeshLike:
    """Return the mesh of a part that has no pose, turned upright."""
    if upright is None or isinstance(part.mesh, Solid):
        return part.mesh
    vertices, faces = part.mesh
    return np.asarray(vertices) @ upright[:3, :3].T, faces


def _turned_poses(parts: Sequence[Part], upright: NDArray[np.float64] | None, factor: float) -> list[PoseLike | None]:
    """Return the parts' poses in metres, turned upright; None of meshes that have none."""
    if upright is None and factor == 1:
        return [part.pose for part in parts]
    posed = [part.pose is not None or isinstance(part.mesh, Solid) for part in parts]
    given = dict(enumerate(part.pose for part, own in zip(parts, posed, strict=True) if own))
    matrices = np.tile(np.eye(4), (len(given), 1, 1))
    for shape in ((7,), (4, 4)):
        alike = {number: pose for number, pose in given.items() if pose is not None and pose.shape == shape}
        if alike:
            matrices[list(alike)] = poses_to_matrices(poses_to_opencv(np.stack(list(alike.values()))))
    matrices[:, :3, 3] *= factor
    turned = iter(poses_to_opencv(matrices if upright is None else upright @ matrices))  # all at once: it takes long
    return [next(turned) if own else None for own in posed]


def joined(objects: Iterable[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Join arguments of `Scene.add` in a row that differ in name and pose alone to one of `Scene.add_instances`."""
    for _, run in itertools.groupby(objects, key=_what_instances_share):
        first, *others = run
        if others:
            names, poses = ([item[key] for item in (first, *others)] for key in ("name", "pose"))
            same = {name: first[name] for name in ("mesh", "label", "scale", "movable", "appearance")}
            yield {**same, "names": names, "poses": np.stack(poses)}
        else:
            yield first


def _what_instances_share(item: dict[str, Any]) -> object:
    """Return what is the same of arguments of `Scene.add` that can be joined."""
    mesh = item["mesh"]
    if isinstance(mesh, Solid) or item["pose"] is None or item["attach_to"] is not None:
        return id(item)
    return id(mesh[0]), id(mesh[1]), np.shape(item["pose"]), item["label"], item["movable"], id(item["appearance"])
