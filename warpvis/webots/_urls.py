# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Urls of the files that worlds and PROTO files name, and where on this machine such a file may be."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urljoin

from warpvis.core.file_content import is_file
from warpvis.webots._nodes import Version

_ON_GITHUB = re.compile(r"(https?://raw\.githubusercontent\.com/[^/]+/[^/]+/[^/]+/)(.+)")
_RELEASE = "https://raw.githubusercontent.com/cyberbotics/webots/{}/"
_WITH_CACHE = ("R2025a", "R2023b", "R2023a", "R2022b")
CACHED_SINCE = Version(2022, 2)
"""The first release whose worlds name their PROTOs by urls, and whose downloads are kept under their urls' names."""


@dataclass(frozen=True)
class Found:
    """A file on this machine."""

    path: Path
    """Where it is."""
    name: str
    """What messages call it and urls in it are relative to: its path; of a copy in Webots' cache, its url."""


@dataclass(frozen=True)
class Places:
    """Where the files that a world and its PROTOs name may be.

    Today's Webots looks beside the file that names a url. Up to R2022a it looked in the folders of the PROTOs that it
    comes from, in the ``protos`` of their projects, and in the world's ``worlds``. A value of an instance's field is
    relative to the instance's file, which is the world's or another PROTO's. ``webots://`` and the same files on GitHub
    are looked for below the folders of the search path, and at last in the cache in which Webots keeps what it has
    downloaded: a file there is named after the SHA-1 of its url (``WbNetwork.cpp``).
    """

    world: Path
    """The world's file."""
    version: Version
    """The world's version, which says of which release ``webots://`` files were downloaded."""
    search_path: list[Path] = field(default_factory=list)
    """Folders that may be Webots' own, or its ``projects``."""
    cache: Path | None = None
    """Folder of Webots' cache."""

    def find(self, url: str, file: str, protos: Iterable[str] = ()) -> Found | None:
        """Find the file of a url; None if it is not on this machine.

        Args:
            url: The url.
            file: Name of the file of the node that has it: `Found.name`.
            protos: Such names of the PROTOs whose bodies the node comes from, outermost first.
        """
        url = with_slashes(url)
        if not is_web(url) and not is_web(file):
            places = self._in_project(url, Path(file), [Path(proto) for proto in protos if not is_web(proto)])
            path = next(filter(is_file, places), None)
            if path is not None:
                return Found(path, str(path))
        return self.find_in_tree(url, file) or self.find_in_cache(url, file)

    def find_in_tree(self, url: str, file: str) -> Found | None:
        """Find a file of Webots' own folders below those of the search path."""
        url = _absolute(url, file)
        on_github = _ON_GITHUB.fullmatch(url)
        tail = url.removeprefix("webots://") if url.startswith("webots://") else on_github[2] if on_github else None
        if tail is None:
            return None
        tails = (tail.lstrip("/"), tail.removeprefix("projects/").lstrip("/"))
        path = next(filter(is_file, (root / part for root in self.search_path for part in tails)), None)
        return None if path is None else Found(path, str(path))

    def find_in_cache(self, url: str, file: str) -> Found | None:
        """Find what Webots has downloaded from a url, or from where a ``webots://`` url leads in a release."""
        if self.cache is None:
            return None
        url = _absolute(url, file)
        urls = [url]
        if url.startswith("webots://"):
            named = _ON_GITHUB.fullmatch(file)
            releases = dict.fromkeys([str(self.version), *_WITH_CACHE])
            prefixes = [named[1]] if named else [_RELEASE.format(release) for release in releases]
            urls = [prefix + url.removeprefix("webots://") for prefix in prefixes]
        for name in urls:
            path = self.cache / hashlib.sha1(name.encode(), usedforsecurity=False).hexdigest()
            if name.startswith("http") and is_file(path):
                return Found(path, name)
        return None

    def _in_project(self, url: str, file: Path, protos: list[Path]) -> Iterator[Path]:
        """List where a relative url may lead, best first."""
        folders = [file.parent]
        for proto in [*reversed(protos), self.world]:
            folders += [proto.parent, proto.parent.parent / "protos", proto.parent.parent / "worlds"]
        folders.append(self.world.parent / "protos")
        yield from (folder / url for folder in dict.fromkeys(folders))


def installed() -> list[Path]:
    """Find Webots' own files: ``projects`` in the folder that the environment's WEBOTS_HOME names."""
    home = os.environ.get("WEBOTS_HOME")
    projects = Path(home, "projects") if home else None
    return [projects] if projects is not None and projects.is_dir() else []


def webots_cache() -> Path | None:
    """Find the folder in which Webots from R2022b on keeps what it has downloaded; None if there is none.

    Webots' user guide, chapter "Installation Procedure", says where that is on each system.
    """
    if sys.platform == "darwin":
        base = Path("~/Library/Caches")
    elif os.name == "nt":
        base = Path(os.environ.get("LOCALAPPDATA") or "~/AppData/Local")
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    inside = "Cyberbotics/Webots/cache/assets" if os.name == "nt" else "Cyberbotics/Webots/assets"
    try:
        folder = base.expanduser() / inside
        return folder if folder.is_dir() else None
    except (OSError, RuntimeError):  # no such home
        return None


def with_slashes(url: str) -> str:
    """Write a url of Windows as Webots reads it."""
    return url.replace("\\", "/")


def is_web(url: str) -> bool:
    """Tell whether a url names its place by itself: ``webots://``, or of the web."""
    return "://" in url


def _absolute(url: str, file: str) -> str:
    url = with_slashes(url)
    return urljoin(file, url) if is_web(file) and not is_web(url) else url
