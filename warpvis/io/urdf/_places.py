# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Search for ROS packages and for the files that a robot refers to."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from warpvis.core.file_content import is_file

_SCHEME = re.compile(r"(package|model|file)://(.*)", re.DOTALL)
_FIND = re.compile(r"(?:file://)?\$\(find\s+([^)\s]+)\s*\)(.*)", re.DOTALL)
_PACKAGE_NAME = re.compile(rb"<name>\s*([^<\s]+)\s*</name>")
_MAX_DEPTH = 4
"""Number of folders above the robot whose subfolders are searched for packages."""


class Places:
    """Folders in which files of a robot are searched."""

    def __init__(self, path: Path, search_path: Sequence[Path]) -> None:
        """Store the robot's file, and the folders of the search path."""
        self.folder = path.absolute().parent
        self.search_path = [folder.absolute() for folder in search_path]
        self._parents = list(dict.fromkeys([*self.folder.resolve().parents, *self.folder.parents]))
        self._packages: dict[str, list[Path]] = {}

    def packages(self, name: str) -> list[Path]:
        """Return folders that are a ROS package: on the search path, or at or above the robot's folder.

        The folder has the package's name, or a ``package.xml`` with it.
        """
        if name not in self._packages:
            candidates = [place for root in self.search_path for place in (root / name, root)]
            candidates += [place for root in (self.folder, *self._parents) for place in (root / name, root)]
            named = [place for place in candidates if place.name == name and place.is_dir()]
            near = [*self.search_path, self.folder, *self._parents[:_MAX_DEPTH]]
            listed = [root for root in [*self.search_path, self.folder, *self._parents] if _package_name(root) == name]
            if not named and not listed:
                listed = [place for root in near for place in _children(root) if _package_name(place) == name]
            self._packages[name] = list(dict.fromkeys([*named, *listed]))
        return self._packages[name]

    def find(self, url: str) -> Path | None:
        """Return the file of a URL or a path; None if there is none."""
        return next((place.resolve() for place in self._places(url.replace("\\", "/")) if url and is_file(place)), None)

    def _places(self, url: str) -> Iterator[Path]:
        found, scheme = _FIND.fullmatch(url), _SCHEME.fullmatch(url)
        if found is not None:
            kind, relative = "package", f"{found[1]}/{found[2].lstrip('/')}"
        else:
            kind, relative = (scheme[1], scheme[2]) if scheme else ("", url)
        if kind in ("package", "model"):
            relative = relative.lstrip("/")
            package, _, tail = relative.partition("/")
            yield from (folder / tail for folder in self.packages(package))
            yield from (root / relative for root in (*self.search_path, self.folder))
            if not self.packages(package):  # the package's folder was renamed
                yield from (root / tail for root in (*self.search_path, self.folder, *self._parents))
            return
        yield from (root / relative for root in (self.folder, *self.search_path, *self._parents[1:_MAX_DEPTH]))


def _package_name(folder: Path) -> str:
    """Return the name in a folder's ``package.xml``; empty if there is none."""
    try:
        found = _PACKAGE_NAME.search((folder / "package.xml").read_bytes())
    except OSError:
        return ""
    return "" if found is None else found[1].decode(errors="replace")


def _children(folder: Path) -> list[Path]:
    try:
        return sorted(place for place in folder.iterdir() if place.is_dir())
    except OSError:
        return []
