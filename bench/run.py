# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Run all benchmarks, compare them with this machine's last run, and compare warpvis with its peers.

Results are stored in `.benchmarks/<machine>/`, one file per commit. Each part ends with a list of what became slower,
including the ratios of cpu_all.py. Arguments that are not listed here go to compare.py (``--scenes room --views 8``).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from machine import OtherWork, machine_id
from ratios import ROOT, commit_name

# Relative increase that counts as slower. Medians of two runs of the same code differ by several per cent.
TOLERATED = 0.15


def last_run(storage: Path) -> Path | None:
    """Return the newest file of results."""
    # pytest-benchmark has one folder per Python version.
    return max(storage.glob("*/*.json"), key=lambda path: path.stat().st_mtime_ns, default=None)


def run_benchmarks(storage: Path, name: str, last: Path | None) -> int:
    """Run pytest-benchmark and return its exit code."""
    command = [sys.executable, "-m", "pytest", "bench", "-o", "python_files=bench_*.py", "--benchmark-only"]
    command += ["--benchmark-sort=name", "--benchmark-columns=median,iqr,rounds", "-q"]
    command += [f"--benchmark-storage=file://{storage}", f"--benchmark-save={name}"]
    if last:
        command.append(f"--benchmark-compare={last}")
    return subprocess.call(command, cwd=ROOT)


def report(new: Path, last: Path | None) -> list[str]:
    """Print all figures next to those of the last run, and return those that became slower."""
    current, before = _load(new), _load(last) if last else {}
    slower = []
    print(f"\n{'median':>12} {'fps':>10} {'time':>8}  benchmark")
    for name, bench in current.items():
        change = _seconds(bench) / _seconds(before[name]) - 1 if name in before else None
        fps = f"{bench['extra_info']['fps']:,.0f}" if "fps" in bench["extra_info"] else ""
        shown = "new" if change is None else f"{change:+.0%}"
        print(f"{bench['stats']['median'] * 1e3:9.2f} ms {fps:>10} {shown:>8}  {name}")
        if change is not None and change > TOLERATED:
            slower.append(f"{name}: takes {change:.0%} more time")
    if last is None:
        print("\nThis is the first run of this machine.")
    elif slower:
        print(f"\nSLOWER than {last.name} by more than {TOLERATED:.0%}:", *slower, sep="\n  ")
    else:
        print(f"\nNothing is slower than {last.name} by more than {TOLERATED:.0%}.")
    return slower


def _load(path: Path) -> dict[str, Any]:
    return {bench["fullname"]: bench for bench in json.loads(path.read_text(encoding="utf-8"))["benchmarks"]}


def _seconds(bench: dict[str, Any]) -> float:
    """Return the time of one view, which is comparable between numbers of views."""
    return bench["stats"]["median"] / bench["extra_info"].get("views", 1)


def run_ratios() -> int:
    """Run cpu_all.py and return its exit code: 1 if a ratio fell."""
    return subprocess.call([sys.executable, str(ROOT / "bench" / "cpu_all.py"), "--update"], cwd=ROOT)


def run_comparison(arguments: Sequence[str], figures: bool) -> int:
    """Run compare.py and return its exit code."""
    command = [sys.executable, str(ROOT / "bench" / "compare.py"), *arguments]
    return subprocess.call([*command, "--markdown", "docs/figures.md"] if figures else command, cwd=ROOT)


def main() -> int:
    """Run everything; the exit code is 0 unless something fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fail", action="store_true", help="exit with 1 if a benchmark became slower, or a ratio fell")
    parser.add_argument("--figures", action="store_true", help="put the tables of the peers into docs/figures.md")
    options, for_compare = parser.parse_known_args()

    storage, name = ROOT / ".benchmarks" / machine_id(), commit_name()
    last, other_work = last_run(storage), OtherWork()
    code = run_benchmarks(storage, name, last)
    new = last_run(storage)
    if code != 0 or new is None or new == last:
        if new != last:
            new.unlink()  # a failed run must not serve for comparison
        return code or 1
    slower = report(new, last)
    print(other_work.warning(), flush=True)
    for older in set(storage.glob(f"*/*_{name}.json")) - {new}:
        older.unlink()
    fallen = run_ratios() != 0
    code = run_comparison(for_compare, options.figures)
    return 1 if options.fail and (slower or fallen) else code


if __name__ == "__main__":
    sys.exit(main())
