# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Webots worlds as scenes."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from warpvis.core.checks import as_items, as_path, check_flag
from warpvis.core.label_rules import LabelInput, LabelRules
from warpvis.core.types import DeviceLike
from warpvis.errors import FileFormatError, SceneError
from warpvis.scene import FileParts, Scene
from warpvis.webots._devices import Device
from warpvis.webots._extents import Bounds
from warpvis.webots._grammar import parse_world
from warpvis.webots._lidars import Lidar
from warpvis.webots._nodes import Node, Version
from warpvis.webots._parts import Solid, make_parts, names_of, skipped_message, truncate
from warpvis.webots._urls import CACHED_SINCE, installed, webots_cache
from warpvis.webots._walk import Reader


@dataclass(frozen=True, eq=False)
class WebotsWorld:
    """A Webots world as it was read; `load_webots` makes it."""

    scene: Scene
    """Its geometry, one object for every Solid that has any."""
    path: Path
    """The file."""
    version: Version
    """Version of the file's header."""
    devices: dict[str, Device]
    """Range finders and cameras, by name; of equal names, later ones are ``"name (2)"``, ..."""
    lidars: dict[str, Lidar]
    """Lidars, likewise."""
    robots: dict[str, tuple[str, ...]]
    """For every robot, the names of the objects that are its body, what it carries included."""
    recognisable: dict[str, tuple[Node, tuple[str, ...]]]
    """For every Solid with `recognitionColors`, its node and the names of its objects."""
    bounds: Bounds
    """Where Solids are and what bounds them, for `warpvis.webots.recognise`."""
    skipped: dict[str, int]
    """What was not found, and how often it is there: PROTOs without a file, meshes without a file."""
    stand_ins: dict[str, int]
    """PROTOs without a file for which boxes, a cylinder or capsules of their size stand in, and how often."""
    refused: tuple[str, ...]
    """Why nodes were left out that could not be read, with file and line."""
    notes: tuple[str, ...]
    """Values that Webots does not take and what was taken instead, as it does, with file and line."""
    tree: str
    """What was read, a line each, indented by what holds what."""

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
) -> WebotsWorld:
    """Read a Webots world, a ``.wbt`` file of V6.0 to R2025a.

    What a file's header says decides how its nodes are meant: up to R2021b geometry stands along y and cameras look
    along -z, from R2022a on it stands along z and they look along x. `Scene.up` is the axis that
    ``WorldInfo.coordinateSystem``, or in old worlds ``gravity``, says.

    Every Solid that has shapes of its own becomes an object; devices and robots are Solids. An instance of a PROTO is
    one object, with the Solids that its file puts into it (a table's legs), but for robots and what has
    `recognitionColors`. An object is called what its `name` field says, else by its DEF name, else by Webots' default
    ("solid", "robot", ...), with " (2)", " (3)", ... where that is taken. Shapes outside of any Solid are objects too,
    by DEF name, or "shape". Bounding objects, lights and backgrounds are not drawn, as in Webots' range images, which
    show transparent things as if they were not.

    Labels: `Label.HUMAN` for pedestrians and what is called ``*human*``, ``*person*`` or ``*pedestrian*``;
    `Label.ROBOT` for robots and all they carry; `Label.GROUND` for what is called ``*floor*`` or ``*ground*`` (but no
    light), for the floors of arenas, and for level surfaces within 0.1 m of height 0; `Label.OBJECT` for Solids with
    `recognitionColors`; else `Label.OBSTACLE`.

    Args:
        path: The file.
        device: Where the scene is rendered.
        labels: Labels by name that come before the rules; a name may be a pattern (``"wall_*"``), and the last one
            that fits counts. Or a file of them, as for `Scene.load`.
        label_names: Names of classes of your own, as for `Scene`.
        search_path: Folders to look for PROTO files in, first of all; ``projects`` below the environment's
            ``WEBOTS_HOME`` is looked in after them, and at last the cache in which Webots keeps what it has downloaded.
        strict: Whether what cannot be read, and what Webots does not take, is an error. By default the first is left
            out and the second is reset as Webots resets it, and one warning each names them with file and line.

    Raises:
        FileFormatError: The file is missing or does not parse, or something cannot be read and `strict` is set.
        SceneError: The world has no geometry, or a label's pattern fits nothing.
    """
    path = as_path(path)
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file")
    folders = (
        [search_path] if isinstance(search_path, os.PathLike) else as_items(search_path, "search_path", SceneError)
    )
    check_flag(strict, "strict")
    rules = LabelRules.of(labels, label_names)
    reader, names, found = _read(path, [as_path(folder, "search_path") for folder in folders], strict)
    scene = Scene(device=device, up=reader.up)
    scene.add_parts(found, rules)
    for message in found.warnings:
        warnings.warn(message, stacklevel=2)
    return WebotsWorld(
        scene,
        path,
        reader.version,
        reader.devices,
        reader.lidars,
        {name: names_of(names, solids) for name, solids in reader.robots.items()},
        {name: (node, names_of(names, solids)) for name, (node, solids) in reader.recognisable.items()},
        Bounds(reader.bounds, reader.extents, reader.find_mesh),
        dict(reader.skipped),
        dict(reader.stand_ins),
        tuple(dict.fromkeys(reader.refused)),
        reader.corrections(),
        reader.describe(names),
    )


def read_world(path: Path, *, search_path: Sequence[Path], strict: bool) -> FileParts:
    """Read the objects of a world alone; see `load_webots`."""
    return _read(path, search_path, strict)[2]


def _read(path: Path, search_path: Sequence[Path], strict: bool) -> tuple[Reader, dict[Solid, list[str]], FileParts]:
    """Walk through a world; return what that found, the names of the objects that it becomes, and the objects."""
    reader = Reader(parse_world(path), [*search_path, *installed()], strict, webots_cache())
    reader.walk()
    missed = reader.skipped, reader.below, reader.stand_ins, reader.reasons, reader.refused
    message = skipped_message(path, *missed, search_path, downloads=reader.version >= CACHED_SINCE)
    notes = reader.corrections()
    listed = "; ".join(truncate(notes))
    if strict and message:
        raise FileFormatError(message)
    if strict and notes:
        raise FileFormatError(f"{path}: expected values that Webots takes, got others: {listed}")
    if not any(solid.parts for solid in reader.solids):
        raise SceneError(f"{message}; nothing is left" if message else f"{path}: holds no triangles")
    parts, names = make_parts(reader.solids, reader.find_mesh)
    sentences = tuple(filter(None, (message, f"{path}: {listed}" if notes else "")))
    lights, background = tuple(reader.lights), reader.background
    found = FileParts(path, parts, up=reader.up, settled=True, warnings=sentences, lights=lights, background=background)
    return reader, names, found
