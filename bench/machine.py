# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What figures were measured on: this machine's name and the versions of what runs on it."""

from __future__ import annotations

import hashlib
import os
import platform
import re
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

from warpvis.core.threads import core_count


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


class OtherWork:
    """Watches how much of the processor everyone else takes: figures on all cores are as low as that is high."""

    def __init__(self) -> None:
        """Begin to watch."""
        self._busy, self._all = _processor_time()
        self._own = _own_time()

    def share(self) -> float:
        """Share of all cores' time that other processes took since then; 0 where Linux does not tell."""
        busy, everything = _processor_time()
        elapsed = everything - self._all
        return max(0.0, (busy - self._busy - (_own_time() - self._own)) / elapsed) if elapsed else 0.0

    def warning(self) -> str:
        """A sentence about it, or nothing if it is too little to matter."""
        share = self.share()
        return f"Other processes took {share:.0%} of this machine's cores meanwhile." if share > 0.05 else ""


def _processor_time() -> tuple[float, float]:
    """Seconds that all cores together were busy, and that they were there."""
    path = Path("/proc/stat")
    if not path.is_file():
        return 0.0, 0.0
    user, nice, system, idle, waiting, *interrupts_and_stolen = map(int, path.read_text().split(maxsplit=9)[1:9])
    busy = user + nice + system + sum(interrupts_and_stolen)
    ticks = os.sysconf("SC_CLK_TCK")
    return busy / ticks, (busy + idle + waiting) / ticks


def _own_time() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
