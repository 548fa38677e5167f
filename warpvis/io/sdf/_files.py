# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Search for the files that SDF references: models, meshes and images, by relative paths and by URIs."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from warpvis.core.checks import truncate
from warpvis.core.file_content import is_file
from warpvis.errors import FileFormatError
from warpvis.io._readers import MODEL_CONFIG
from warpvis.io.sdf._xml import Node, parse_file

# Names of folders in Gazebo: of gz-sim (SDF_PATH, GZ_FILE_PATH, ...), of its earlier versions, and of Gazebo Classic.
_VARIABLES = (
    *("SDF_PATH", "GZ_SIM_RESOURCE_PATH", "GZ_FILE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "IGN_FILE_PATH"),
    *("GAZEBO_MODEL_PATH", "GAZEBO_RESOURCE_PATH"),
)
_HOMES = ("~/.gazebo/models", "~/.gazebo")
# Caches of gz-fuel-tools, by its environment variable and its defaults.
_CACHE_VARIABLES = ("GZ_FUEL_CACHE_PATH", "IGN_FUEL_CACHE_PATH")
_CACHES = ("~/.gz/fuel", "~/.ignition/fuel")
_FUEL_HOSTS = ("fuel.gazebosim.org", "fuel.ignitionrobotics.org", "api.ignitionfuel.org", "staging-fuel.gazebosim.org")
# https://HOST/1.0/OWNER/models/NAME[/VERSION][/files/REST]
_FUEL = re.compile(
    r"https?://([^/]+)/(?:\d+\.\d+/)?([^/]+)/(models|worlds)/([^/]+)(?:/(\d+|tip))?(?:/files(?:/(.*))?)?/?$"
)
_SCHEME = re.compile(r"(\w+)://(.*)", re.DOTALL)
_MAX_NAME = 255


class Finder:
    """Finds files like Gazebo: on the search path, by environment variables, and in folders above the file."""

    def __init__(self, path: Path, search_path: Sequence[Path]) -> None:
        """Collect the folders to search for the file `path`."""
        self.folders = list(dict.fromkeys(self._roots(path, search_path)))
        self._caches = list(dict.fromkeys(_cache_folders()))

    @staticmethod
    def _roots(path: Path, search_path: Sequence[Path]) -> Iterator[Path]:
        for folder in search_path:
            yield from (folder, folder / "models")
        for variable in _VARIABLES:
            yield from (Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder)
        for parent in path.absolute().parents:
            yield from (parent, parent / "models")
        yield from (Path(os.path.expanduser(folder)) for folder in _HOMES)

    def file(self, uri: str, node: Node) -> Path | None:
        """Return the file of a URI in an element; None if it is not found."""
        return next((place for place in self.places(uri, node) if is_file(place)), None)

    def model(self, uri: str, node: Node) -> Path | None:
        """Return the SDF file of a model, by the URI of its folder or of the file; None if it is not found."""
        for place in self.places(uri, node):
            if is_file(place):
                return model_file(place.parent) if place.name == MODEL_CONFIG else place
            found = model_file(place)
            if found is not None:
                return found
        return None

    def existing(self) -> list[Path]:
        """Return the folders to search that exist."""
        return [folder for folder in self.folders if folder.is_dir()]

    def places(self, uri: str, node: Node) -> Iterator[Path]:
        """Yield possible places of a file or folder, in the order in which they are searched."""
        if not uri or "\0" in uri or any(len(part) > _MAX_NAME for part in uri.split("/")):
            return
        scheme = _SCHEME.fullmatch(uri)
        kind, rest = (scheme[1].lower(), scheme[2]) if scheme else ("", uri)
        if kind in ("http", "https"):
            yield from self._fuel_places(uri)
            return
        folder = node.path.absolute().parent
        if kind in ("", "file"):
            yield folder / rest
            yield folder.parent / rest  # of a model whose SDF file is in a separate folder
        rest = rest.lstrip("/")
        name, _, tail = rest.partition("/")
        for root in self.folders:
            yield root / rest
            if kind in ("model", "package") and root.name == name:
                yield root / tail

    def _fuel_places(self, uri: str) -> Iterator[Path]:
        """Yield places of a model or a file of Gazebo Fuel: in local caches, and in folders with its name."""
        match = _FUEL.match(uri.strip())
        if match is None:
            return
        host, owner, kind, name, version, rest = match.groups()
        name, rest = name.replace("%20", " "), (rest or "").replace("%20", " ")
        hosts = dict.fromkeys((host, *_FUEL_HOSTS))
        for cache in self._caches:
            for server in hosts:
                folder = cache / server / owner.lower() / kind / name.lower()
                yield from (found / rest for found in _versions(folder, version or "tip"))
        for root in self.folders:
            for folder in (
                root / owner.lower() / kind / name.lower(),
                root / name,
                root / name.replace(" ", "_").lower(),
            ):
                yield from (found / rest for found in (*_versions(folder, version or "tip"), folder))


def _cache_folders() -> Iterator[Path]:
    for variable in _CACHE_VARIABLES:
        if os.environ.get(variable):
            yield Path(os.environ[variable])
    yield from (Path(os.path.expanduser(folder)) for folder in _CACHES)


def _versions(folder: Path, version: str) -> list[Path]:
    """Return the folders of a version in a Fuel cache, the newest first."""
    try:
        names = [item.name for item in folder.iterdir() if item.name.isascii() and item.name.isdigit()]
    except (OSError, ValueError):
        return []
    chosen = [name for name in names if version in ("tip", name)]
    return [folder / name for name in sorted(chosen, key=int, reverse=True)]


def model_file(folder: Path) -> Path | None:
    """Return the SDF file of a model's folder: the newest in its model.config, else model.sdf; None without one."""
    config = folder / MODEL_CONFIG
    if not is_file(config):
        return next((folder / name for name in ("model.sdf", "world.sdf") if is_file(folder / name)), None)
    root = parse_file(config)
    if root.tag != "model":
        raise FileFormatError(f"{config}:{root.line}: must begin with <model>, got XML of <{truncate(root.tag)}>")
    listed = [(_version_key(item.get("version", "")), item) for item in root.children("sdf")]
    for _, item in sorted(listed, key=lambda pair: pair[0], reverse=True):
        found = folder / item.string()
        if item.string() and is_file(found):
            return found
    names = ", ".join(truncate(item.string()) for _, item in listed)
    raise FileFormatError(f"{config}: must name an SDF file in its folder, got {names or 'none'}")


def _version_key(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(".") if part.isascii() and part.isdigit() and len(part) < 9)
