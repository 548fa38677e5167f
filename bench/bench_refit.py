# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure `Scene.update_vertices` on a deforming mesh of 1.3 million triangles: refitting the BVH and `wp.Mesh`.

``python bench/bench_refit.py --device cuda:0`` alternates between both and prints the minimum times. On a GPU it
replays CUDA graphs and reads the times from events.
"""

from __future__ import annotations

import argparse

import pytest
import warp as wp
from gpu_timing import enough_calls
from gpu_trees import begin, build, refit_of
from gpu_work import timer_of

import warpvis as wv

DEVICES = ["cpu", *map(str, wp.get_cuda_devices()[:1])]
MAX_TIMES = 2.0
"""Maximum time of the BVH's refit relative to that of `wp.Mesh`."""


@pytest.mark.benchmark(group="refit")
@pytest.mark.parametrize("built", [wv.Scene.bvh, wv.Scene.triangles], ids=["bvh", "triangles"])
@pytest.mark.parametrize("device", DEVICES)
def test_refit(benchmark, device, built):
    scene = build(device)
    refit = refit_of(built, scene)

    def refit_and_wait():
        refit()
        wp.synchronize_device(device)

    benchmark.pedantic(refit_and_wait, rounds=20, warmup_rounds=2)
    benchmark.extra_info["triangles"] = scene.triangle_count


@pytest.mark.benchmark(group="refit")
@pytest.mark.parametrize("device", DEVICES)
def test_update(benchmark, device):
    """Measure a whole call with vertices on the device, for the faster caster."""
    scene = begin(device)
    scene.bvh()
    vertices = wp.clone(scene["ball"].points)

    def update_and_wait():
        scene.update_vertices("ball", vertices)
        wp.synchronize_device(device)

    benchmark.pedantic(update_and_wait, rounds=20, warmup_rounds=2)


def compare(device: str, rounds: int) -> list[float]:
    """Return the minimum times of refitting `Scene.bvh()` and `wp.Mesh` [s], measured in turns."""
    scene = build(device)
    timer = timer_of(scene.device)
    runs = [refit_of(built, scene) for built in (wv.Scene.bvh, wv.Scene.triangles)]
    runs = [timer.record(run) or run for run in runs]
    calls = [enough_calls(timer.device_seconds(run, 2)) for run in runs]
    times = [[timer.device_seconds(run, count) for run, count in zip(runs, calls, strict=True)] for _ in range(rounds)]
    return [min(column) for column in zip(*times, strict=True)]


def main() -> None:
    """Print the times, and whether the BVH reaches its target."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default=DEVICES[-1])
    parser.add_argument("--rounds", type=int, default=9)
    arguments = parser.parse_args()
    clusters, mesh = compare(arguments.device, arguments.rounds)
    print(f"{build(arguments.device).triangle_count:,} triangles, {wp.get_device(arguments.device).name}")
    print(f"Scene.bvh() {1e3 * clusters:.3f} ms, wp.Mesh {1e3 * mesh:.3f} ms: {clusters / mesh:.2f} times as long")
    print(f"at most {MAX_TIMES:g} times: {'reached' if clusters <= MAX_TIMES * mesh else 'MISSED'}")


if __name__ == "__main__":
    main()
