# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure every GPU workload of this folder against its peer, and compare the ratios with a committed table.

The table of a card is `bench/gpu_all/<card>.json`. Prints one line per workload, then the ratios that are lower than in
the table by more than 5 %, with the commit of the table. Exits with 1 if there are any. A workload whose peer is not
installed gets a line with the reason.

  python bench/gpu_all.py                                  all, within 8 minutes on an H100
  python bench/gpu_all.py --only worlds room-320           workloads whose names contain one of these
  python bench/gpu_all.py --out new.json                   writes the new figures there as they come ($OUT/gpu_all.json)
  python bench/gpu_all.py --update                         writes the table
  python bench/gpu_all.py --figures new.json --update      writes the table from such a file, on any machine
  python bench/gpu_all.py --device cpu --views 2 --only rays/room   whether workloads run, without a GPU
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import gpu_cases
import gpu_geoms
import gpu_images
import gpu_points
import gpu_rays
import gpu_sensors
import gpu_trees
import gpu_worlds
import lidar_worlds
import warp as wp
from ratios import ROOT, Workload, add_options, run_guard

TABLES = ROOT / "bench" / "gpu_all"

# Seconds after which no further workload begins.
_LIMIT = 450


def workloads(device: wp.Device, views: int | None = None) -> Iterator[Workload]:
    """Yield all workloads, the most basic ones first."""
    yield from gpu_cases.workloads(device, views)
    yield from gpu_worlds.workloads(device, views)
    yield from gpu_geoms.workloads(device, views)
    yield from gpu_rays.workloads(device, views)
    yield from gpu_sensors.workloads(device, views)
    yield from gpu_points.workloads(device, views)
    yield from gpu_images.workloads(device, views)
    yield from lidar_worlds.workloads(device, views)
    yield from gpu_trees.workloads(device)
    yield from gpu_cases.fine_workloads(device, views)
    yield from gpu_cases.peer_workloads(device, views)
    yield from gpu_worlds.color_workloads(device, views)  # last, as Newton needs more than a minute to build its worlds


def table_path(card: str) -> Path:
    """Return the file of a card's table."""
    return TABLES / f"{re.sub(r'[^A-Za-z0-9]+', '_', card).strip('_')}.json"


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, _LIMIT)
    if "OUT" in os.environ:
        parser.set_defaults(out=Path(os.environ["OUT"]) / "gpu_all.json")
    parser.add_argument("--device", help="cuda:0 if there is one; cpu shows that workloads run")
    parser.add_argument("--views", type=int, help="views or worlds a call, instead of each workload's own number")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print and compare; return the exit status."""
    options = _parse(arguments)
    wp.config.log_level = wp.LOG_WARNING
    if options.figures:
        try:
            card = json.loads(options.figures.read_text(encoding="utf-8"))["machine"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            print(f"gpu_all.py: --figures must be a file of --out, got {options.figures} ({error})", file=sys.stderr)
            return 2
        return run_guard(options, card, table_path(card), ())
    try:
        device = wp.get_device(options.device or "cuda:0")
    except (RuntimeError, ValueError) as error:
        print(
            f"gpu_all.py: --device must be a device of this machine, got {options.device or 'cuda:0'} ({error})",
            file=sys.stderr,
        )
        return 2
    with wp.ScopedDevice(device):
        return run_guard(options, device.name, table_path(device.name), workloads(device, options.views))


if __name__ == "__main__":
    sys.exit(main())
