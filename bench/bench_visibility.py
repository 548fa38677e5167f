# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure `object_visibility` and `best_views` against rendering, and compare visible fractions with BOP's definition.

``python bench/bench_visibility.py`` alternates between `object_visibility` of 20 objects in 100 views of 640x480 and
rendering those views. It compares counts with BOP's definition in NumPy, which renders every object alone on a canvas
of 3 W x 3 H.
``python bench/bench_visibility.py --device cuda:0`` times `best_views` over 100,000 poses at 160x120.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import warp as wp

import warpvis as wv
from warpvis.scenes import PRESETS

OBJECTS, VIEWS, CHECKED_VIEWS = 20, 100, 5
CAMERA = wv.Camera.from_fov(640, 480, hfov=0.994837)
MAX_TIMES = 4.0
"""Maximum time of `object_visibility` relative to rendering the views."""
CANDIDATES, MAX_SECONDS = 100_000, 2.0


def medians(runs: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return median times of alternating calls [s], after one call of each."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for round_ in range(rounds + 1):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            wp.synchronize()
            if round_ > 0:
                times[name].append(time.perf_counter() - start)
    return {name: float(np.median(seconds)) for name, seconds in times.items()}


def things(scene: wv.Scene) -> list[int]:
    """Return the first objects that are not ground."""
    return [index for index, item in enumerate(scene.objects) if item.label != wv.Label.GROUND][:OBJECTS]


def compare_with_rendering(name: str, rounds: int, threads: int | None) -> None:
    """Print both times, and their ratio."""
    scene, poses = PRESETS[name].build(), PRESETS[name].poses(VIEWS)
    chosen = things(scene)
    runs: dict[str, Callable[[], object]] = {}
    for label, outputs in (("depth", ("depth",)), ("all four images", ("depth", "points", "labels", "segmentation"))):
        renderer = wv.Renderer(scene, CAMERA, outputs=outputs, threads=threads)
        views = renderer.render(poses)
        runs[f"render: {label}"] = lambda renderer=renderer, views=views: renderer.render(poses, out=views)
    for delta in (0.0, wv.visibility.BOP_DELTA):
        runs[f"object_visibility, delta {delta:g} m"] = lambda delta=delta: wv.object_visibility(
            scene, CAMERA, poses, objects=chosen, delta=delta, threads=threads
        )
    found = medians(runs, rounds)
    print(f"{name}: {len(chosen)} objects, {VIEWS} views of {CAMERA.width}x{CAMERA.height}")
    base, full = found["render: depth"], found["render: all four images"]
    for label, seconds in found.items():
        print(f"  {label:34} {1e3 * seconds:7.1f} ms  {seconds / base:5.2f} x depth  {seconds / full:5.2f} x all four")


def check_fractions(name: str, delta: float) -> int:
    """Return the largest difference of any count from BOP's definition [px], computed in NumPy."""
    scene, poses = PRESETS[name].build(), PRESETS[name].poses(CHECKED_VIEWS)
    chosen = things(scene)
    got = wv.object_visibility(scene, CAMERA, poses, objects=chosen, delta=delta)
    width, height = CAMERA.width, CAMERA.height
    wide = replace(CAMERA, width=3 * width, height=3 * height, cx=CAMERA.cx + width, cy=CAMERA.cy + height)
    y, x = np.mgrid[:height, :width] + 0.5
    length = np.sqrt(((x - CAMERA.cx) / CAMERA.fx) ** 2 + ((y - CAMERA.cy) / CAMERA.fy) ** 2 + 1)
    everything = wv.render(scene, CAMERA, poses, outputs=("depth", "segmentation"))
    distance = everything.depth.numpy() * length
    worst = 0
    for k, index in enumerate(chosen):
        item, isolated = scene.objects[index], wv.Scene()
        isolated.add((item.vertices, item.faces), name=item.name)
        depth = wv.render(isolated, wide, poses, outputs=("depth",)).depth.numpy()
        model = depth[:, height : 2 * height, width : 2 * width] * length
        with np.errstate(invalid="ignore"):
            shown = model - distance <= delta if delta > 0 else everything.segmentation.numpy() == index
        visible = np.isfinite(model) & shown
        for counted, expected in (
            (got.silhouette_pixels, np.isfinite(depth).sum(axis=(1, 2))),
            (got.image_pixels, np.isfinite(model).sum(axis=(1, 2))),
            (got.visible_pixels, visible.sum(axis=(1, 2))),
        ):
            worst = max(worst, int(np.abs(counted.numpy()[:, k] - expected).max()))
    return worst


def time_best_views(name: str, objects: list[str], device: str, rounds: int) -> float:
    """Return the median time of `best_views` over all candidates [s], from poses on the host to their order."""
    scene = PRESETS[name].build(device)
    camera = wv.Camera.from_fov(160, 120, hfov=0.994837, near=0.3, far=4.5)
    radius, headings = 2.5, 8
    step = radius * math.sqrt(math.pi / (1.02 * CANDIDATES / headings))
    poses = wv.planning.pose_grid((0, 0, 0), radius=radius, step=step, height=0.9, headings=headings, pitch=-0.2)[
        :CANDIDATES
    ]
    assert len(poses) == CANDIDATES
    runs = {"best_views": lambda: wv.planning.best_views(scene, camera, poses, objects=objects)}
    return medians(runs, rounds)["best_views"]


def main() -> None:
    """Print the figures, and whether they reach their targets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--threads", type=int)
    arguments = parser.parse_args()
    if arguments.device != "cpu":
        print(f"best_views over {CANDIDATES:,} poses at 160x120, {wp.get_device(arguments.device).name}")
        blobs = [f"blob_{k}" for k in range(10)]
        for name, objects in (("room", ["ball"]), ("room", ["ball", "person", "low obstacle"]), ("blobs_77k", blobs)):
            seconds = time_best_views(name, objects, arguments.device, arguments.rounds)
            reached = "reached" if seconds < MAX_SECONDS else "MISSED"
            print(f"  {name}, {len(objects)} objects: {seconds:.3f} s, below {MAX_SECONDS:g} s: {reached}")
        return
    for name in ("room", "blobs_77k"):
        compare_with_rendering(name, arguments.rounds, arguments.threads)
        worst = max(check_fractions(name, delta) for delta in (0.0, wv.visibility.BOP_DELTA))
        print(f"  counts differ from BOP's by at most {worst} pixels an object, in {CHECKED_VIEWS} views")


if __name__ == "__main__":
    main()
