# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure ray casting at the pixel positions of a map, against lists of the same positions and whole images.

``python bench/bench_remap.py`` alternates between them on the CPU and prints their times relative to an image. The map
holds the positions, in a second eye 75 mm to the right, of the surface points that the first eye sees.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
import warp as wp

import warpvis as wv
from warpvis.core.poses import poses_to_matrices

VIEWS = 64
BASELINE = 0.075
CAMERA = wv.Camera.from_fov(320, 240, hfov=0.994837, near=0.0, far=100.0)
SCENES = ("room", "blobs_77k", "blobs_1m")


@cache
def build(name: str) -> wv.Scene:
    """Return the scene of a preset."""
    return wv.scenes.PRESETS[name].build()


def calls(name: str, **options: Any) -> dict[str, Callable[[], Any]]:
    """Return the calls to measure, each called once."""
    scene, poses = build(name), np.asarray(wv.scenes.PRESETS[name].poses(VIEWS), dtype=np.float32)
    renderer = wv.Renderer(scene, CAMERA, outputs="depth", **options)
    image, aside = renderer.render(poses), poses.copy()
    aside[:, :3] += poses_to_matrices(poses)[:, :3, 0] * BASELINE
    depth = image.depth.numpy()
    with np.errstate(divide="ignore"):
        shift = np.where(np.isfinite(depth), CAMERA.fx * BASELINE / depth, np.nan)
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width] + 0.5
    places = np.stack([x - shift, np.broadcast_to(y, depth.shape)], axis=-1).astype(np.float32)
    shapes = {"map": places.shape[:3], "list": (VIEWS, depth[0].size)}
    arrays = {way: wp.array(places.reshape(*shape, 2), dtype=wp.vec2, device="cpu") for way, shape in shapes.items()}
    out = {way: renderer.render_at(aside, pixels) for way, pixels in arrays.items()}
    return {
        "image": lambda: renderer.render(poses, out=image),
        "map": lambda: renderer.render_at(aside, arrays["map"], out=out["map"]),
        "list": lambda: renderer.render_at(aside, arrays["list"], out=out["list"]),
    }


@pytest.mark.benchmark(group="remap")
def test_remap(benchmark, threads):
    benchmark.pedantic(calls("blobs_77k", threads=threads)["map"], rounds=7, iterations=3, warmup_rounds=1)
    benchmark.extra_info["views"] = VIEWS


def main() -> None:
    """Print times and ratios."""
    from timing import take_turns

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES)
    arguments = parser.parse_args()
    for name in arguments.scenes:
        measured = calls(name)
        times = [float(np.median(column)) / VIEWS for column in take_turns(list(measured.values()), arguments.rounds)]
        ratios = ", ".join(f"{way} {time / times[0]:.2f}" for way, time in zip(measured, times, strict=True))
        print(f"{name}: image {1e6 * times[0]:.0f} us; times as long: {ratios}")


if __name__ == "__main__":
    main()
