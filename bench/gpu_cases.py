# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define the cases of gpu.py, and their workloads against the bare kernel, plain depth, and Newton."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import gpu_peers
import warp as wp
from gpu_timing import LatencyTimer, Timer
from gpu_work import Case, Prepared, agreement, subject_of
from ratios import Contest, Workload

# name: title, preset, width, height, views
CASES = {
    "room-320": ("room 320x240", "room", 320, 240, 512),
    "room-64": ("room 64x64", "room", 64, 64, 8192),
    "77k-320": ("77 k 320x240", "blobs_77k", 320, 240, 512),
    "77k-64": ("77 k 64x64", "blobs_77k", 64, 64, 8192),
    "1m-320": ("1.2 M 320x240", "blobs_1m", 320, 240, 512),
    "1m-64": ("1.2 M 64x64", "blobs_1m", 64, 64, 8192),
}

# Triangles smaller than pixels; only on request.
FINE_CASES = {
    "terrain-200k-320": ("terrain 0.2 M 320x240", "terrain_200k", 320, 240, 64),
    "terrain-200k-64": ("terrain 0.2 M 64x64", "terrain_200k", 64, 64, 1024),
    "terrain-2m-320": ("terrain 2 M 320x240", "terrain_2m", 320, 240, 64),
    "terrain-2m-64": ("terrain 2 M 64x64", "terrain_2m", 64, 64, 1024),
    "terrain-10m-320": ("terrain 10 M 320x240", "terrain_10m", 320, 240, 64),
    "terrain-10m-64": ("terrain 10 M 64x64", "terrain_10m", 64, 64, 1024),
    "terrain-50m-320": ("terrain 50 M 320x240", "terrain_50m", 320, 240, 64),
    "terrain-50m-64": ("terrain 50 M 64x64", "terrain_50m", 64, 64, 1024),
}
# Thousands of objects, movable or static; only on request.
CROWD_CASES = {
    "crowd-1k-320": ("1 k balls 320x240", "crowd_1k", 320, 240, 64),
    "crowd-1k-static-320": ("1 k that stay 320x240", "crowd_1k_static", 320, 240, 64),
    "crowd-10k-320": ("10 k balls 320x240", "crowd_10k", 320, 240, 64),
    "crowd-10k-static-320": ("10 k that stay 320x240", "crowd_10k_static", 320, 240, 64),
    "crowd-100k-320": ("100 k balls 320x240", "crowd_100k", 320, 240, 64),
    "crowd-100k-static-320": ("100 k that stay 320x240", "crowd_100k_static", 320, 240, 64),
}
# Little work, where the latency of a call counts; only on request.
SMALL_CASES = {
    "small-room-1": ("room, 1 of 64x64", "room", 64, 64, 1),
    "small-room-16": ("room, 16 of 84x84", "room", 84, 84, 16),
    "small-room-128": ("room, 128 of 64x64", "room", 64, 64, 128),
    "small-1m-1": ("1.2 M, 1 of 64x64", "blobs_1m", 64, 64, 1),
    "small-1m-16": ("1.2 M, 16 of 84x84", "blobs_1m", 84, 84, 16),
    "small-1m-128": ("1.2 M, 128 of 64x64", "blobs_1m", 64, 64, 128),
}
ALL_CASES = CASES | FINE_CASES | CROWD_CASES | SMALL_CASES

_FINE = (
    *("terrain-200k-320", "terrain-200k-64", "crowd-1k-320", "crowd-1k-static-320", "crowd-10k-320"),
    *("terrain-2m-320", "terrain-10m-320", "terrain-10m-64"),
)
VARIANTS: dict[str, Callable[[Case], Prepared]] = {
    "rays": partial(gpu_peers.warpvis, caster="rays"),
    "poses of the host": partial(gpu_peers.warpvis, host=True),
    "four outputs": lambda case: gpu_peers.warpvis(case, "depth", "points", "labels", "segmentation"),
    "normals": lambda case: gpu_peers.warpvis(case, "normals"),
    "culled": partial(gpu_peers.warpvis, cull_backfaces=True),
}
_NEWTON = ("PIXEL_PRIORITY, sah tree", "TILED, sah tree")


def case_of(name: str, device: wp.Device, views: int | None = None) -> Case:
    """Return a case by its name, with its default number of views or another."""
    _, preset, width, height, count = ALL_CASES[name]
    return Case.of(subject_of(preset, str(device)), width, height, views or count)


def _bare(
    name: str, device: wp.Device, views: int | None, *, latency: bool = False, with_graphs: bool = False
) -> Contest:
    """Set up a case against the bare kernel."""
    case = case_of(name, device, views)
    trees = gpu_peers.TREES[:1] if device.is_cpu else gpu_peers.TREES
    peers = [gpu_peers.bare(case, constructor, block) for constructor, block in trees]
    timer = LatencyTimer(case.timer) if latency else case.timer
    return _contest(case, {"bare": peers}, timer, with_graphs)


def _newton(name: str, device: wp.Device, views: int | None) -> Contest:
    """Set up a case against two-sided ways to use Newton."""
    case = case_of(name, device, views)
    methods = [method for method in gpu_peers.methods() if method.group == "newton" and not method.culls]
    return _contest(case, {"Newton": [method.prepare(case) for method in methods if method.variant in _NEWTON]})


def _contest(
    case: Case, peers: dict[str, list[Prepared]], timer: Timer | None = None, with_graphs: bool = False
) -> Contest:
    """Compare depth with that of the first peer, and return alternating calls."""
    ours, first = gpu_peers.warpvis(case), next(iter(peers.values()))[0]
    first.run()
    same = agreement(first.depth(case.checked), ours.depth(case.checked), case.camera).same
    runs = {peer: [way.run for way in ways] for peer, ways in peers.items()}
    return Contest(ours.run, runs, timer or case.timer, same, with_graphs)


def _variant(name: str, device: wp.Device, views: int | None, prepare: Callable[[Case], Prepared]) -> Contest:
    """Set up another way to render a case against plain depth."""
    case = case_of(name, device, views)
    return Contest(prepare(case).run, {"depth": [gpu_peers.warpvis(case).run]}, case.timer)


def workloads(device: wp.Device, views: int | None = None) -> Iterator[Workload]:
    """Yield the main cases and the small ones against the bare kernel, and other outputs against depth."""
    for name in CASES:
        yield Workload(name, partial(_bare, name, device, views))
    for name in SMALL_CASES:
        yield Workload(name, partial(_bare, name, device, views))
    yield Workload("small-room-1 waited for", partial(_bare, "small-room-1", device, views, latency=True))
    yield Workload("small-room-1 as a graph", partial(_bare, "small-room-1", device, views, with_graphs=True))
    for title, prepare in VARIANTS.items():
        yield Workload(f"77k-320 {title}", partial(_variant, "77k-320", device, views, prepare))


def fine_workloads(device: wp.Device, views: int | None = None) -> Iterator[Workload]:
    """Yield fine triangles and many objects against the bare kernel."""
    for name in _FINE:
        yield Workload(name, partial(_bare, name, device, views))


def peer_workloads(device: wp.Device, views: int | None = None) -> Iterator[Workload]:
    """Yield cases against Newton, if it is installed."""
    for name in ("room-320", "77k-64"):
        yield Workload(f"{name} Newton", partial(_newton, name, device, views))
