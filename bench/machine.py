# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Describe the machine: its name, and the versions of the relevant packages."""

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
    """Return the processor's name."""
    info = Path("/proc/cpuinfo")
    found = re.search(r"^model name\s*:\s*(.+)$", info.read_text(), re.MULTILINE) if info.is_file() else None
    return found[1].strip() if found else platform.processor() or platform.machine()


def machine_id() -> str:
    """Return a folder name for this machine: its processor, its cores, and a hash of its identity."""
    slug = re.sub(r"[^a-z0-9]+", "-", cpu_model().lower()).strip("-")
    host = hashlib.sha256(platform.node().encode()).hexdigest()[:6]
    return f"{slug}-{core_count()}c-{host}"


def describe(packages: Iterable[str]) -> str:
    """Return one line: processor, cores, and the versions of Python and of installed packages."""
    versions = [f"Python {platform.python_version()}"]
    for package in packages:
        try:
            versions.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            continue
    cores = core_count()
    return f"{cpu_model()}, {cores} core{'s' if cores > 1 else ''}; {', '.join(versions)}"


class OtherWork:
    """Measures the CPU time of other processes, which lowers figures on all cores."""

    def __init__(self) -> None:
        """Start the measurement."""
        self._busy, self._all = _processor_time()
        self._own_start = _own_time()

    def share(self) -> float:
        """Return the fraction of all cores' time that other processes used since then; 0 if Linux has no counters."""
        busy, everything = _processor_time()
        elapsed = everything - self._all
        return max(0.0, (busy - self._busy - (_own_time() - self._own_start)) / elapsed) if elapsed else 0.0

    def warning(self) -> str:
        """Return a sentence about it, or an empty string if it is negligible."""
        share = self.share()
        return (
            f"Other processes took {share:.0%} of this machine's cores during the measurement." if share > 0.05 else ""
        )


def _processor_time() -> tuple[float, float]:
    """Return busy and total seconds of all cores together."""
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
