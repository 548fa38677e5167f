# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Local paths of the URLs in worlds and PROTO files."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urljoin

from warpvis.core.file_content import is_file
from warpvis.webots._nodes import Version

_ON_GITHUB = re.compile(r"(https?://raw\.githubusercontent\.com/[^/]+/[^/]+/[^/]+/)(.+)")
_RELEASE = "https://raw.githubusercontent.com/cyberbotics/webots/{}/"
_WITH_CACHE = ("R2025a", "R2023b", "R2023a", "R2022b")
CACHED_SINCE = Version(2022, 2)
"""The first release whose worlds refer to PROTOs by URLs, and whose downloads are cached by URL."""


@dataclass(frozen=True)
class Found:
    """A file on this machine."""

    path: Path
    name: str  # name in messages and base of relative URLs: its path, or the URL of a copy in Webots' cache


@dataclass(frozen=True)
class Places:
    """The folders that are searched for the files of a world and its PROTOs.

    Current releases of Webots resolve a URL relative to the file that contains it. Up to R2022a, Webots searched the
    folders of the PROTOs that the node comes from, the ``protos`` of their projects, and the world's ``worlds``. A
    value of an instance's field is relative to the instance's file, a world or another PROTO. ``webots://`` URLs and
    the same files on GitHub are searched for below the folders of the search path, and finally in Webots' download
    cache, whose files are named by the SHA-1 of their URL (``WbNetwork.cpp``).
    """

    world: Path
    version: Version  # the world's version, which determines the release from which ``webots://`` files were downloaded
    search_path: list[Path]  # folders of PROTO files, possibly Webots' installation folder or its ``projects``
    cache: Path | None = None  # folder of Webots' cache

    def find(self, url: str, file: str, protos: Iterable[str] = ()) -> Found | None:
        """Find the local file of a URL in `file`, in the bodies of `protos`, outermost first, or return None."""
        url = with_slashes(url)
        if not is_web(url) and not is_web(file):
            folders = [Path(file).parent]
            for proto in [*(Path(proto) for proto in reversed([*protos]) if not is_web(proto)), self.world]:
                folders += [proto.parent, proto.parent.parent / "protos", proto.parent.parent / "worlds"]
            folders.append(self.world.parent / "protos")
            found = first_file(folder / url for folder in dict.fromkeys(folders))
            if found is not None:
                return found
        return self.find_in_tree(url, file) or self.find_in_cache(url, file)

    def find_in_tree(self, url: str, file: str) -> Found | None:
        """Find a file of Webots' source tree below the folders of the search path."""
        url = _absolute(url, file)
        on_github = _ON_GITHUB.fullmatch(url)
        tail = url.removeprefix("webots://") if url.startswith("webots://") else on_github[2] if on_github else None
        if tail is None:
            return None
        tails = (tail.lstrip("/"), tail.removeprefix("projects/").lstrip("/"))
        return first_file(root / part for root in self.search_path for part in tails)

    def find_in_cache(self, url: str, file: str) -> Found | None:
        """Find a file that Webots downloaded from a URL, or from the address of a ``webots://`` URL in a release."""
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


def installed() -> list[Path]:
    """Return Webots' ``projects`` folder below the environment variable WEBOTS_HOME, if it exists."""
    home = os.environ.get("WEBOTS_HOME")
    projects = Path(home, "projects") if home else None
    return [projects] if projects is not None and projects.is_dir() else []


def webots_cache() -> Path | None:
    """Return the folder of Webots' download cache (user guide, "Installation Procedure"), or None."""
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
    except (OSError, RuntimeError):  # no home directory
        return None


def first_file(paths: Iterable[Path]) -> Found | None:
    """Return the first existing file, or None."""
    path = next(filter(is_file, paths), None)
    return None if path is None else Found(path, str(path))


def with_slashes(url: str) -> str:
    """Replace backslashes by slashes, as Webots does."""
    return url.replace("\\", "/")


def is_web(url: str) -> bool:
    """Return whether a URL is absolute: ``webots://`` or a web address."""
    return "://" in url


def _absolute(url: str, file: str) -> str:
    url = with_slashes(url)
    return urljoin(file, url) if is_web(file) and not is_web(url) else url
