# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What figures were measured on: this machine's name and the versions of what runs on it."""

from __future__ import annotations

import hashlib
import platform
import re
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

from warpvis.threads import core_count


def cpu_model() -> str:
    """The processor as it names itself."""
    info = Path("/proc/cpuinfo")
    found = re.search(r"^model name\s*:\s*(.+)$", info.read_text(), re.MULTILINE) if info.is_file() else None
    return found[1].strip() if found else platform.processor() or platform.machine()


def machine_id() -> str:
    """A folder name for this machine: its processor, its cores, and what tells it from others of the same kind."""
    slug = re.sub(r"[^a-z0-9]+", "-", cpu_model().lower()).strip("-")
    host = hashlib.sha256(platform.node().encode()).hexdigest()[:6]
    return f"{slug}-{core_count()}c-{host}"


def describe(packages: Iterable[str]) -> str:
    """One line: processor, cores, and the versions of Python and of those of the packages that are installed."""
    versions = [f"Python {platform.python_version()}"]
    for package in packages:
        try:
            versions.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            continue
    cores = core_count()
    return f"{cpu_model()}, {cores} core{'s' if cores > 1 else ''}; {', '.join(versions)}"
