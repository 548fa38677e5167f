# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Habitat's scene datasets: where templates, lights and semantic lexicons are, and how they define meshes.

The meaning of fields is that of Habitat-Sim's documentation (docs/pages/attributesJSON.rst) and code.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.file_content import is_file, read_text
from warpvis.errors import FileFormatError
from warpvis.io._meshes import read_mesh_file
from warpvis.io.datasets._fields import Fields
from warpvis.io.datasets._joined import Shape, join, placed
from warpvis.io.urdf import read_urdf
from warpvis.scene import FileParts

SCENE, DATASET = ".scene_instance.json", ".scene_dataset_config.json"
_SUFFIXES = {
    "stages": (".stage_config.json", ".glb", ".gltf", ".ply", ".obj"),
    "objects": (".object_config.json", ".glb", ".gltf", ".ply", ".obj"),
    "articulated_objects": (".ao_config.json", ".urdf"),
    "light_setups": (".lighting_config.json",),
}
_FOLDERS = {"stages": "stages", "objects": "objects", "articulated_objects": "urdf", "light_setups": "lighting"}
"""Folders that are searched without a configuration of the dataset."""
_PARENTS = 4
"""Number of folders above a scene in which the configuration of its dataset is searched."""
_CATEGORY_COLUMNS = ("main_category", "clean_category", "category", "wnsynsetkey", "super_category", "name")
"""Columns of HSSD's tables of objects that contain a class, the first choice first."""
_MAX_COSINE = 1e-5
"""Tolerance of the dot product of ``up`` and ``front``."""


@dataclass(frozen=True)
class Template:
    """A template: its handle, its fields, and the folder that its files are relative to."""

    handle: str
    fields: Fields
    folder: Path

    @property
    def name(self) -> str:
        """The last part of its handle, without the suffix of a file."""
        last = self.handle.replace("\\", "/").rsplit("/", 1)[-1]
        suffixes = (suffix for each in _SUFFIXES.values() for suffix in each)
        return last.removesuffix(next((suffix for suffix in suffixes if last.endswith(suffix)), ""))

    def file(self, *names: str) -> Path | None:
        """Return the file of the first of these fields that is not empty; None if all are."""
        name = next((name for key in names if (name := self.fields.text(key, ""))), None)
        return None if name is None else self.folder / name

    def frame(self) -> NDArray[np.float64]:
        """Return the rotation from the asset to the object, shape ``(3, 3)``: up becomes y, and front -z."""
        up, front = self.fields.vector("up", (0.0, 1.0, 0.0)), self.fields.vector("front", (0.0, 0.0, -1.0))
        lengths = np.linalg.norm(up), np.linalg.norm(front)
        if not min(lengths) > 0 or abs(up @ front) > _MAX_COSINE * lengths[0] * lengths[1]:
            raise FileFormatError(
                f"{self.fields.location} up and front must be orthogonal, got {up.tolist()} and {front.tolist()}"
            )
        up, front = up / lengths[0], front / lengths[1]
        return np.array([np.cross(front, up), up, -front])


class Dataset:
    """The templates of a scene dataset, read when they are used."""

    def __init__(self, scene: Path, search_path: Sequence[Path]) -> None:
        """Find the configuration of the scene's dataset, next to the scene or above it."""
        self.config = _find_config(scene)
        root = scene.parent if self.config is None else self.config.parent
        self.folders = [root, *search_path]
        self._fields = Fields({}, f"{scene}:") if self.config is None else Fields.read(self.config)
        if self.config is None:
            self.folders[1:1] = [scene.parents[1]] if len(scene.parents) > 1 else []
        self._indices: dict[str, dict[str, list[Path]]] = {}
        self._templates: dict[tuple[str, str], Template | None] = {}
        self._shapes: dict[tuple[Path, bytes], Shape] = {}
        self._files: dict[Path, list[tuple[str, Shape]]] = {}
        self._robots: dict[Path, FileParts] = {}
        self.warnings: list[str] = []

    def template(self, kind: str, handle: str) -> Template | None:
        """Return a template of a kind (``"objects"``) by its handle; None if there is none."""
        key = kind, handle
        if key not in self._templates:
            found = self._configured(kind, handle, str.__eq__) or self._from_file(kind, handle)
            self._templates[key] = found or self._configured(kind, handle, str.__contains__)
        return self._templates[key]

    def _configured(self, kind: str, handle: str, fits: Callable[[str, str], bool]) -> Template | None:
        """Return a template that the configuration of the dataset defines, by its handle or a part of it."""
        section = self._fields.child(kind)
        for item in section.children("configs"):
            if not fits(item.text("template_handle", ""), handle):
                continue
            original, changes = item.text("original_file", ""), item.child("attributes")
            base = self._from_file(kind, original) if original else None
            if original and base is None:
                raise FileFormatError(f"{item.named('original_file')} must be a file of the dataset, got {original!r}")
            values = section.child("default_attributes").values if base is None else base.fields.values
            folder = self.folders[0] if base is None else base.folder
            return Template(handle, Fields({**values, **changes.values}, changes.location), folder)
        return None

    def _from_file(self, kind: str, handle: str) -> Template | None:
        defaults = self._fields.child(kind).child("default_attributes").values
        path = self._find(kind, handle)
        if path is None:
            return None
        if path.suffix == ".json":
            fields = Fields.read(path)
            return Template(handle, Fields({**defaults, **fields.values}, fields.location), path.parent)
        key = "urdf_filepath" if path.suffix == ".urdf" else "render_asset"
        return Template(handle, Fields({**defaults, key: path.name}, f"{path}:"), path.parent)

    def _find(self, kind: str, handle: str) -> Path | None:
        """Return the file of a template: that with the handle's last name, else the first that contains the handle."""
        index = self._indices.get(kind)
        if index is None:
            index = self._indices[kind] = {}
            for path in self._list(kind):
                index.setdefault(_stem(path, kind), []).append(path)
        wanted = handle.replace("\\", "/")
        name = _stem(Path(wanted), kind)
        exact = index.get(name, [])
        inside = [path for path in exact if wanted in path.as_posix()]
        if inside or exact:
            return (inside or exact)[0]
        return next((path for paths in index.values() for path in paths if wanted in path.as_posix()), None)

    def _list(self, kind: str) -> Iterator[Path]:
        """Yield the files of templates of a kind; configurations before bare assets."""
        paths = self._fields.child(kind).child("paths")
        patterns = [
            (folder, text) for folder in self.folders for key in paths.values for text in _texts(paths, key)
        ] or [(folder, f"{_FOLDERS[kind]}/**") for folder in self.folders]
        for suffix in _SUFFIXES[kind]:
            for folder, pattern in patterns:
                for place in sorted(_glob(folder, pattern)):
                    if place.is_dir():
                        yield from sorted(file for file in place.iterdir() if file.name.endswith(suffix))
                    elif place.name.endswith(suffix):
                        yield place

    def lexicon(self, scene: Fields) -> Mapping[int, str]:
        """Return the class of each semantic id that a scene's semantic lexicon defines."""
        maps = self._fields.child("semantic_scene_descriptor_instances")
        handle = scene.text("semantic_scene_instance", "")
        named = maps.values.get(handle)
        places = [self.folders[0] / named] if isinstance(named, str) else []
        for folder in self.folders:
            places += sorted({*folder.glob("*lexicon*.json"), *folder.glob("*/*lexicon*.json")})
        path = next(filter(is_file, places), None)
        if path is None or path.suffix != ".json":
            return {}
        return {item.whole("id"): item.text("name") for item in Fields.read(path).children("classes")}

    def categories(self) -> Mapping[str, str]:
        """Return the class of each template that a table of the dataset defines (HSSD's ``semantics/objects.csv``)."""
        found: dict[str, str] = {}
        names = ("semantics/objects.csv", "metadata/objects.csv", "objects.csv", "metadata/object_categories*.csv")
        for path in [place for folder in self.folders for name in names for place in sorted(folder.glob(name))]:
            table = csv.DictReader(read_text(path, "a table").splitlines())
            columns = [name for name in _CATEGORY_COLUMNS if name in (table.fieldnames or ())]
            if "id" not in (table.fieldnames or ()) or not columns:
                raise FileFormatError(f"{path}: must have the columns 'id' and one of {', '.join(_CATEGORY_COLUMNS)}")
            for row in table:
                word = next((row[column] for column in columns if row[column]), "")
                found.setdefault(row["id"], word.split(".")[0])
        return found

    def robot(self, path: Path) -> FileParts:
        """Read a URDF file; once for all of its instances."""
        if path not in self._robots:
            self._robots[path] = read_urdf(path)
            self.warnings += self._robots[path].warnings
        return self._robots[path]

    def shapes(self, path: Path, linear: NDArray[np.float64], *, joined: bool) -> list[tuple[str, Shape]]:
        """Return the meshes of a file under a linear map, each with its name; the same arrays for the same map."""
        key = path.resolve() / ("joined" if joined else "parts")
        if key not in self._files:
            found = read_mesh_file(path, search_path=(), strict=False)
            self.warnings += [message for message in found.warnings if message not in self.warnings]
            named = [(part.name, placed(part, path)) for part in found.parts]
            self._files[key] = [("", join(found.parts, path))] if joined and named else named
        result = []
        for number, (name, shape) in enumerate(self._files[key]):
            place = key / str(number), linear.tobytes()
            if place not in self._shapes:
                self._shapes[place] = shape.transformed(linear)
            result.append((name, self._shapes[place]))
        return result


def _find_config(scene: Path) -> Path | None:
    """Return the configuration of a scene's dataset: the nearest one that lists its folder, else the nearest."""
    nearest = None
    for folder in [scene.parent, *scene.parent.parents][: _PARENTS + 1]:
        configs = sorted(folder.glob(f"*{DATASET}"))
        for config in configs:
            if _lists(config, scene):
                return config
        nearest = nearest or next(iter(configs), None)
    return nearest


def _lists(config: Path, scene: Path) -> bool:
    """Return whether the configuration of a dataset lists a scene."""
    paths = Fields.read(config).child("scene_instances").child("paths")
    places = [place for key in paths.values for text in _texts(paths, key) for place in _glob(config.parent, text)]
    return any(place.resolve() in (scene.resolve(), scene.parent.resolve()) for place in places)


def _texts(fields: Fields, name: str) -> list[str]:
    value = fields.values[name]
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise FileFormatError(f"{fields.named(name)} must be a list of paths")
    return value


def _glob(folder: Path, pattern: str) -> list[Path]:
    """Return what a pattern matches; parts before the first wildcard may leave the folder (``../``)."""
    parts = [part for part in pattern.replace("\\", "/").split("/") if part not in ("", ".")]
    while parts and not any(mark in parts[0] for mark in "*?["):
        folder = folder / parts.pop(0)
    if not parts:
        return [folder] if folder.exists() else []
    return list(folder.glob("/".join(parts))) if folder.is_dir() else []


def _stem(path: Path, kind: str) -> str:
    """Return the name of a template's file without the suffix of its kind."""
    suffix = next((suffix for suffix in _SUFFIXES[kind] if path.name.endswith(suffix)), "")
    return path.name.removesuffix(suffix)
