# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Urls of files in Webots' own folders, and where on this machine such a file may be."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

_IN_TREE = re.compile(r"(?:webots://|https?://raw\.githubusercontent\.com/[^/]+/[^/]+/[^/]+/)(.+)")


def with_slashes(url: str) -> str:
    """Write a url of Windows as Webots reads it."""
    return url.replace("\\", "/")


def places_in_project(url: str, file: Path, protos: Iterable[Path], world: Path) -> list[Path]:
    """List where a relative url may lead, best first.

    Today's Webots looks beside the file that names it. Up to R2022a it looked in the folders of the PROTOs that it
    comes from, in the ``protos`` of their projects, and in the world's ``worlds``. A value of an instance's field is
    relative to the instance's file, which is the world's or another PROTO's.

    Args:
        url: The url.
        file: The file of the node that has it.
        protos: Files of the PROTOs whose bodies the node comes from, outermost first.
        world: The world's file.
    """
    folders = [file.parent]
    for proto in [*reversed([*protos]), world]:
        folders += [proto.parent, proto.parent.parent / "protos", proto.parent.parent / "worlds"]
    folders.append(world.parent / "protos")
    return [folder / with_slashes(url) for folder in dict.fromkeys(folders)]


def places_in_tree(url: str, search_path: Iterable[Path]) -> list[Path] | None:
    """List where a file of Webots' own folders may be below those of the search path, best first.

    Args:
        url: A url like ``webots://projects/...``, or the same path on GitHub.
        search_path: Folders that may be Webots' own, or its ``projects``.

    Returns:
        Paths, whether there is a file or not; None for a url of another place.
    """
    in_tree = _IN_TREE.fullmatch(with_slashes(url))
    if in_tree is None:
        return None
    tails = (in_tree[1].lstrip("/"), in_tree[1].removeprefix("projects/").lstrip("/"))
    return [root / tail for root in search_path for tail in tails]


def is_file(path: Path) -> bool:
    """Tell whether there is a file of this name."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name that is too long, or holds a zero byte
        return False
