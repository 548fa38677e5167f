# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small files of every supported format and their readers, for `fuzz_files`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import fuzz_data_seeds
import fuzz_dataset_seeds
import fuzz_scene_seeds


@dataclass(frozen=True)
class Seed:
    """A file, the files that it needs, and its reader."""

    format: str
    """Format under which it is counted."""
    folder: Path
    """Folder of the file and its companion files."""
    changed: tuple[str, ...]
    """Paths of the files to change, relative to the folder."""
    read: Callable[[Path], None]
    """Reads the file from a copy of the folder."""


def make_seeds(root: Path) -> list[Seed]:
    """Write the files to subfolders of `root` and return their seeds."""
    makers = (*fuzz_scene_seeds.MAKERS, *fuzz_dataset_seeds.MAKERS, *fuzz_data_seeds.MAKERS)
    seeds = []
    for maker in makers:
        for number, (kind, files, changed, read) in enumerate(maker(root)):
            folder = root / f"{maker.__name__}_{number}"
            for name, content in files.items():
                place = folder / name
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(content.encode() if isinstance(content, str) else content)
            chosen = changed or tuple(sorted(files))
            for name in set(chosen) - set(files):
                assert (folder / name).is_file(), name
            seeds.append(Seed(kind, folder, tuple(chosen), read))
    return seeds
