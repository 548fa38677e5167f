# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read MJCF files as the parts of a scene."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco  # noqa: TID253 - the whole package is about it

from warpvis.core.checks import as_items, as_path, check_flag, describe_exception
from warpvis.core.file_content import is_file, require_content
from warpvis.errors import FileFormatError
from warpvis.mujoco._geoms import DEFAULT_GROUPS, default_label, geom_parts, movable_bodies, shown_geoms
from warpvis.mujoco._lights import model_background, model_lights
from warpvis.mujoco._model_fields import object_names
from warpvis.scene import FileParts, Part

_INCLUDES = ("include", "model")
_FOLDERS = ("assetdir", "meshdir", "texturedir")


def read_model(
    path: str | os.PathLike[str], *, search_path: Sequence[str | os.PathLike[str]] = (), strict: bool = False
) -> FileParts:
    """Read the geoms of an MJCF file at the model's initial state. `Scene.load` reads URDF without MuJoCo.

    Geoms of groups 0 to 2 are shown, as in MuJoCo's viewer. Names and labels are those of `scene_from_mujoco`. Patterns
    may also match a geom by its body's name. Parts of bodies that are not welded to the world are movable; those of one
    body move together.

    Args:
        path: The file, whose root element is ``<mujoco>``.
        search_path: Folders to search for files that are not where the model refers to them: includes, meshes, height
            fields and textures.
        strict: Whether content that cannot be shown is an error: flexes and skins.

    Raises:
        FileFormatError: If the file is not MJCF, MuJoCo cannot compile it, or something cannot be shown and `strict` is
            set.
    """
    path, strict = as_path(path), check_flag(strict, "strict", FileFormatError)
    folders = [as_path(folder, "search_path") for folder in as_items(search_path, "search_path", FileFormatError)]
    root = _parse_model(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # MuJoCo's warnings concern dynamics
            model = _compile(path, root, folders)
    except ValueError as error:
        if isinstance(error, FileFormatError):
            raise
        _require_assets(path, root, folders)
        raise FileFormatError(f"{path}: MuJoCo cannot compile it: {describe_exception(error)}") from None
    soft = [f"{count} {noun}" for count, noun in ((model.nflex, "flexes"), (model.nskin, "skins")) if count]
    message = f"{path}: skipped {' and '.join(soft)}, which have no fixed shape" if soft else ""
    if strict and message:
        raise FileFormatError(message)
    lights, background, sentences = model_lights(model), model_background(model), (message,) if message else ()
    return FileParts(
        path,
        _parts(model),
        up="z",
        defines_frame=True,
        warnings=sentences,
        lights=lights,
        background=background,
    )


def _parts(model: mujoco.MjModel) -> list[Part]:
    names = object_names(model)
    labels = [default_label(model, geom, name) for geom, name in enumerate(names)]
    moves = movable_bodies(model)[model.geom_bodyid]
    parts = geom_parts(model, shown_geoms(model, DEFAULT_GROUPS), names, labels)
    # Static round shapes are triangles here; the scene of a MujocoScene makes them movable so that they are exact.
    return [replace(part, movable=bool(moves[geom])) for geom, part in parts]


def _parse(path: Path) -> ElementTree.Element:
    try:
        return ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise FileFormatError(f"{path}:{error.position[0]}: cannot be read as XML: {error}") from None
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None


def _parse_model(path: Path) -> ElementTree.Element:
    """Parse the root of an MJCF file."""
    root = _parse(path)
    if root.tag == "mujocoinclude":
        raise FileFormatError(f"{path}: is a part that MJCF files include; load the file that includes it")
    if root.tag == "robot":
        raise FileFormatError(f"{path}: is URDF; read it with warpvis.Scene.load, which needs no MuJoCo")
    if root.tag != "mujoco":
        raise FileFormatError(
            f"{path}: must be MJCF, which begins with <mujoco>, or URDF, with <robot>, got XML of <{root.tag}>"
        )
    return root


def _compile(path: Path, root: ElementTree.Element, search_path: Sequence[Path]) -> mujoco.MjModel:
    """Compile the model."""
    include: dict[str, bytes] = {}
    found = _assets(path, root, search_path, include) if search_path else ()
    assets = {name: place.read_bytes() for _, name, place in found if place is not None}
    return mujoco.MjSpec.from_file(str(path), include=include or None, assets=assets or None).compile()


def _assets(
    path: Path, root: ElementTree.Element, search_path: Sequence[Path], include: dict[str, bytes]
) -> Iterator[tuple[str, str, Path | None]]:
    """Yield tag, name and file, if on the search path, of a model's assets; add included files found there."""
    pending, seen, folders = [root], set(), _folders(root)
    while pending:
        for element in pending.pop().iter():
            if element.tag not in _INCLUDES:
                for name in [name for key, name in element.items() if key.startswith("file")]:
                    yield element.tag, name, _find(path, name, search_path, folders)
                continue
            name = element.get("file", "")
            if name and name not in seen:
                seen.add(name)
                found = _find(path, name, search_path)
                if found is not None:
                    include[name] = found.read_bytes()
                sibling = path.parent / name
                if found is not None or is_file(sibling):
                    pending.append(_parse(found or sibling))


def _require_assets(path: Path, root: ElementTree.Element, search_path: Sequence[Path]) -> None:
    """Raise a `FileFormatError` if an asset file of a model is not a mesh, a height field or an image."""
    for tag, name, found in _assets(path, root, search_path, {}):
        is_image, places = tag in ("texture", "hfield"), [path.parent / folder / name for folder in _folders(root)]
        for place in [found] if found is not None else filter(is_file, places):
            require_content(place, "an image" if is_image else "a mesh", images=not is_image)


def _folders(root: ElementTree.Element) -> list[str]:
    """Return the asset folders that the model specifies."""
    return ["", *(item.get(name, "") for item in root.iter("compiler") for name in _FOLDERS if item.get(name))]


def _find(path: Path, name: str, search_path: Sequence[Path], folders: Sequence[str] = ("",)) -> Path | None:
    """Find a file on the search path; None if it is where the model refers to it, or not found."""
    if any(is_file(path.parent / folder / name) for folder in folders):
        return None
    tails = [*(Path(folder) / name for folder in folders), Path(Path(name).name)]
    inner = [part for part in Path(name).parts if part != ".."]  # houses refer to ../../objects/...
    tails += [Path(*inner)] if inner and not Path(name).is_absolute() else []
    places = [root / tail for root in search_path for tail in tails]
    return next(filter(is_file, places), None)
