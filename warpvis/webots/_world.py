# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Loading of Webots worlds as scenes."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_items, as_path, check_flag, pluralize, truncate
from warpvis.core.labels import LabelInput, LabelRules
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.core.types import DeviceLike
from warpvis.errors import FileFormatError, SceneError
from warpvis.scene import FileParts, Scene, move_with_links
from warpvis.scene.joints import JointValues
from warpvis.visibility import Agent
from warpvis.webots._appearance import AppearanceFiles
from warpvis.webots._detection import Bounds
from warpvis.webots._devices import Device
from warpvis.webots._grammar import parse_world
from warpvis.webots._lidars import Lidar
from warpvis.webots._lights import scene_lights
from warpvis.webots._nodes import Node, Version
from warpvis.webots._parts import Objects, make_objects, names_of
from warpvis.webots._people import find_people
from warpvis.webots._urls import CACHED_SINCE, installed, webots_cache
from warpvis.webots._walk import Reader

_MAX_SENTENCES, _MAX_NAMES = 20, 12  # in a warning


@dataclass(frozen=True, eq=False)
class WebotsWorld:
    """A Webots world, from `load_webots`."""

    scene: Scene
    """Its geometry, with one object per Solid with shapes."""
    path: Path
    """The world file."""
    version: Version
    """Version in the file's header."""
    devices: dict[str, Device]
    """Range finders and cameras by name; duplicate names become ``"name (2)"``, ..."""
    lidars: dict[str, Lidar]
    """Lidars by name; duplicate names become ``"name (2)"``, ..."""
    robots: dict[str, tuple[str, ...]]
    """Names of the objects of each robot, including objects that it carries."""
    people: dict[str, Agent]
    """People by the names of their objects: outermost Solids labeled as human. Their eyes are at a descendant
    ``DEF EYES Pose``, looking along x (before R2022a along -z); otherwise those of a standing adult of the same height,
    looking along the Solid's x axis (before R2022a along z, as pedestrians do)."""
    recognizable: dict[str, tuple[Node, tuple[str, ...]]]
    """Node and object names of each Solid with `recognitionColors`."""
    bounds: Bounds
    """Extents of Solids, for `warpvis.webots.recognize`."""
    skipped: dict[str, int]
    """PROTOs and meshes whose files were not found, with the number of occurrences."""
    stand_ins: dict[str, int]
    """PROTOs without a file that were replaced by boxes, a cylinder or capsules, with the number of occurrences."""
    refused: tuple[str, ...]
    """Errors of nodes that were skipped because they could not be read, with file and line."""
    notes: tuple[str, ...]
    """Corrections of invalid values, the same that Webots makes, with file and line."""
    tree: str
    """The nodes that were read, one per line, indented by depth."""

    def device_poses(
        self, name: str, values: JointValues | None = None, *, check_limits: bool = True
    ) -> NDArray[np.float64]:
        """Return the poses of a device or a lidar for values of joints, as its `pose`; shape ``(W, 7)``.

        Args:
            name: Its name in `devices` or, if there is none, in `lidars`.
            values: Values by joint, as for `scene.joints.poses`; W is their number of worlds.
            check_limits: Whether values must be within the limits of their joints.

        Raises:
            SceneError: If there is no such device.
            PoseError: As for `scene.joints.link_poses`.
        """
        known: dict[str, Device | Lidar] = {**self.lidars, **self.devices}
        if not isinstance(name, str) or name not in known:
            found = ", ".join(map(repr, known)) or "none"
            raise SceneError(f"the world has no device or lidar {name!r}; it has {found}")
        device, joints = known[name], self.scene.joints
        links, rest = joints.link_poses(values, check_limits=check_limits), joints.link_poses()
        worlds = max((len(rows) for rows in links.values()), default=1)
        motion = np.tile(np.eye(4), (worlds, 1, 1))
        if device.link:
            motion = links[device.link] @ np.linalg.inv(rest[device.link])
        return poses_to_opencv(motion @ poses_to_matrices(device.pose))

    def __repr__(self) -> str:
        found = f"devices={list(self.devices)}, lidars={list(self.lidars)}"
        return f"WebotsWorld({str(self.path)!r}, {self.version}, {self.scene!r}, {found})"


def load_webots(
    path: str | os.PathLike[str],
    *,
    device: DeviceLike = "cpu",
    labels: LabelInput | None = None,
    label_names: Mapping[int, str] | None = None,
    search_path: Sequence[str | os.PathLike[str]] = (),
    strict: bool = False,
    movable: bool | Sequence[str] = False,
) -> WebotsWorld:
    """Read a Webots world, a ``.wbt`` file of V6.0 to R2025a.

    The version in the file's header determines the axes of nodes: up to R2021b, geometry is upright along y and cameras
    look along -z; from R2022a on, geometry is upright along z and cameras look along x. `Scene.up` is the axis of
    ``WorldInfo.coordinateSystem`` or, in old worlds, of ``gravity``.

    Every Solid with shapes becomes an object; devices and robots are Solids. A PROTO instance is one object, including
    the Solids in its file (such as a table's legs), except for robots and Solids with `recognitionColors`. The name of
    an object is its field `name`, else its DEF name, else Webots' default ("solid", "robot", ...), with " (2)", " (3)",
    ... appended to duplicates. Shapes outside of any Solid are objects too, named by their DEF name, or "shape".
    Bounding objects, lights and backgrounds are not drawn, and transparent objects are opaque, as in Webots' range
    images.

    Labels: `Label.HUMAN` for pedestrians and names like ``*human*``, ``*person*`` or ``*pedestrian*``; `Label.ROBOT`
    for robots and objects that they carry; `Label.GROUND` for names like ``*floor*`` or ``*ground*`` (without "light"
    or "lamp"), floors of arenas, and level surfaces within 0.1 m of height 0; `Label.OBJECT` for Solids with
    `recognitionColors`; otherwise `Label.OBSTACLE`.

    Args:
        path: The world file.
        device: Device on which the scene is rendered.
        labels: Labels by name, which override these rules. A name may be a pattern (``"wall_*"``); the last match
            applies. Or a file of labels, as for `Scene.load`.
        label_names: Names of user-defined classes, as for `Scene`.
        search_path: Folders that are searched for PROTO files first, before ``projects`` below the environment
            variable ``WEBOTS_HOME`` and Webots' download cache.
        strict: Whether unreadable nodes and values that are invalid in Webots raise an error. By default, nodes are
            skipped and values are corrected as by Webots, and one warning each lists them with file and line.
        movable: Whether links of joints are movable objects, as `Scene.joints` moves them; or names of movable objects,
            as for `Scene.load`. If true, PROTO instances are split into an object for each link, named like the link.

    Raises:
        FileFormatError: If the file is missing or does not parse, or, with `strict`, something cannot be read.
        SceneError: If the world has no geometry, or a pattern of `labels` matches no object.
    """
    path = as_path(path)
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file")
    folders = (
        [search_path] if isinstance(search_path, os.PathLike) else as_items(search_path, "search_path", SceneError)
    )
    check_flag(strict, "strict")
    rules = LabelRules.of(labels, label_names)
    reader, objects, found = _read(path, [as_path(folder, "search_path") for folder in folders], strict)
    names = objects[movable is True].names
    scene = Scene(device=device, up=reader.up)
    scene.add_parts(found, rules, movable=movable)
    for message in found.warnings:
        warnings.warn(message, stacklevel=2)
    return WebotsWorld(
        scene,
        path,
        reader.version,
        reader.devices,
        reader.lidars,
        {name: names_of(names, solids) for name, solids in reader.robots.items()},
        find_people(reader.solids, names, scene),
        {name: (node, names_of(names, solids)) for name, (node, solids) in reader.recognizable.items()},
        Bounds(reader.bounds, reader.extents, reader.find_mesh),
        dict(reader.skipped),
        dict(reader.stand_ins),
        tuple(dict.fromkeys(reader.refused)),
        reader.corrections(),
        reader.describe(names),
    )


def read_world(path: Path, *, search_path: Sequence[Path], strict: bool) -> FileParts:
    """Read the objects of a world; see `load_webots`."""
    return _read(path, search_path, strict)[2]


def _read(path: Path, search_path: Sequence[Path], strict: bool) -> tuple[Reader, tuple[Objects, Objects], FileParts]:
    """Traverse a world; return the reader with its content, the objects as for `make_objects`, and the result."""
    reader = Reader(parse_world(path), [*search_path, *installed()], strict, webots_cache())
    reader.walk()
    joints, links = reader.joints()
    message = _missing(reader, path, search_path)
    notes = reader.corrections()
    listed = "; ".join(_truncated(notes))
    if strict and message:
        raise FileFormatError(message)
    if strict and notes:
        raise FileFormatError(f"{path}: expected values that are valid in Webots, got others: {listed}")
    if not any(solid.parts for solid in reader.solids):
        raise SceneError(f"{message}; no triangles remain" if message else f"{path}: holds no triangles")
    files = AppearanceFiles(path, reader.find_mesh, reader.expand_appearance)
    whole, split = make_objects(reader.solids, files, links)
    sentences = tuple(filter(None, (message, f"{path}: {listed}" if notes else "")))
    background, count = reader.background, reader.materials
    is_pbr = count["PBRAppearance"] > count["Appearance"]
    lights = scene_lights(reader.lights, background, reader.irradiance, is_pbr=is_pbr)
    found = FileParts(
        path,
        move_with_links(whole.parts, joints),
        up=reader.up,
        defines_frame=True,
        warnings=sentences,
        lights=lights,
        background=background,
        joints=joints,
        moving_parts=move_with_links(split.parts, joints),
    )
    return reader, (whole, split), found


def _missing(reader: Reader, path: Path, search_path: Iterable[Path]) -> str:
    """Describe what was skipped or replaced by stand-ins, and why; return an empty text if everything was read."""
    parts = []
    if reader.skipped:
        searched = ", ".join(map(str, search_path)) or "none"
        parts.append(
            f"skipped {_counted(reader.skipped, reader.below)}, whose files were not found or not readable in the "
            f"world's project and the search path ({searched}): add the folders that contain them"
            + (", or open the world once in Webots, which downloads them" * (reader.version >= CACHED_SINCE))
        )
    if reader.stand_ins:
        parts.append(
            f"used stand-ins for {_counted(reader.stand_ins)}, whose files were not found or not readable: "
            "boxes, cylinders, and capsules for people"
        )
    parts += [f"ignored the file of {name}: {reason}" for name, reason in reader.reasons.items()]
    parts += [f"skipped an unreadable node: {reason}" for reason in _truncated(reader.refused)]
    return f"{path}: {'; '.join(parts)}" if parts else ""


def _counted(counts: Mapping[str, int], below: Mapping[str, int] | None = None) -> str:
    """List names with counts and numbers of contained nodes, truncated to `_MAX_NAMES`."""
    inside = {name: f" with {pluralize(count, 'node')} in it" for name, count in (below or {}).items() if count}
    listed = [f"{truncate(name)} ({count}{inside.get(name, '')})" for name, count in counts.items()]
    more = len(listed) - _MAX_NAMES
    return ", ".join(listed if more <= 1 else [*listed[:_MAX_NAMES], f"and {more} others"])


def _truncated(sentences: Iterable[str]) -> list[str]:
    """Remove duplicates, which repeated PROTOs cause, and truncate to `_MAX_SENTENCES`."""
    unique = list(dict.fromkeys(sentences))
    more = len(unique) - _MAX_SENTENCES
    return unique if more <= 0 else [*unique[:_MAX_SENTENCES], f"and {more} more"]
