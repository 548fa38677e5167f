# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""USD stages (``.usd``, ``.usda``, ``.usdc``, ``.usdz``), by usd-core. Modules that need it are imported when used."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from warpvis.core.file_content import require_package
from warpvis.scene import FileParts


def read_usd(path: Path, *, search_path: Sequence[Path] = (), strict: bool = False) -> FileParts:
    """Read the parts of a stage; see `warpvis.Scene.load`."""
    require_package("pxr", f"{path}: reading USD needs usd-core", "usd")
    from warpvis.io.usd._reader import read_stage

    return read_stage(path, search_path=search_path, strict=strict)
