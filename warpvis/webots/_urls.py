# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Urls of files in Webots' own folders, and where on this machine such a file may be."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

_IN_TREE = re.compile(r"(?:webots://|https?://raw\.githubusercontent\.com/[^/]+/[^/]+/[^/]+/)(.+)")


def places_in_tree(url: str, search_path: Iterable[Path]) -> list[Path] | None:
    """List where a file of Webots' own folders may be below those of the search path, best first.

    Args:
        url: A url like ``webots://projects/...``, or the same path on GitHub.
        search_path: Folders that may be Webots' own, or its ``projects``.

    Returns:
        Paths, whether there is a file or not; None for a url of another place.
    """
    in_tree = _IN_TREE.fullmatch(url)
    if in_tree is None:
        return None
    tails = (in_tree[1].lstrip("/"), in_tree[1].removeprefix("projects/").lstrip("/"))
    return [root / tail for root in search_path for tail in tails]
