# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure depth-camera models against rendering the exact images that they start from.

``python bench/bench_depth_sensors.py`` alternates between them on the CPU and prints the ratio of each model's time to
that of exact depth: the complete model, without the second eye, without edges, and without any effect. With
``--models``, it compares all models with exact depth on one thread, by the minimum of its CPU time.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import time
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

import warpvis as wv

VIEWS = 64
SCENES = ("room", "blobs_77k")
SENSOR = wv.sensors.realsense_d435(320, 240)
CAMERA = dataclasses.replace(SENSOR.camera(), near=0.1, far=10.0)
PARTS = {
    "all": SENSOR,
    "without the other eye": dataclasses.replace(SENSOR, shadow=False),
    "without edges": dataclasses.replace(SENSOR, shadow=False, edge_window=1, min_support=0.0),
    "noise alone": wv.sensors.StereoDepth(0.05, shadow=False, sigma=0.08, noise_spacing=4),
    "nothing": wv.sensors.StereoDepth(0.05, shadow=False),
    "shadows alone": wv.sensors.StereoDepth(0.05, max_disparity=126.0),
}
MODELS = {
    "RealSense D435": SENSOR,
    "Azure Kinect": dataclasses.replace(wv.sensors.azure_kinect(), native_camera=None),
    "SimKinect": wv.sensors.SimKinect(),
    "NguyenNoise": wv.sensors.NguyenNoise(),
    "KhoshelhamNoise": wv.sensors.KhoshelhamNoise(),
    "Corruptions": wv.sensors.Corruptions(),
}
MODEL_VIEWS = 8


@cache
def build(name: str) -> wv.Scene:
    """Return the scene of a preset."""
    return wv.scenes.PRESETS[name].build()


def calls(name: str, **options: Any) -> dict[str, Callable[[], Any]]:
    """Return the calls to measure, each called once."""
    scene, poses = build(name), np.asarray(wv.scenes.PRESETS[name].poses(VIEWS), dtype=np.float32)
    endless = dataclasses.replace(CAMERA, near=0.0, far=math.inf)
    renderers = {"exact": wv.Renderer(scene, endless, outputs="depth", **options)}
    renderers["exact, with normals"] = wv.Renderer(scene, endless, outputs=("depth", "normals"), **options)
    for part, sensor in PARTS.items():
        renderers[part] = wv.Renderer(scene, CAMERA, outputs="depth", sensor=sensor, **options)
    views = {part: renderer.render(poses) for part, renderer in renderers.items()}
    return {part: lambda part=part: renderers[part].render(poses, out=views[part]) for part in renderers}


def compare_models(name: str, rounds: int) -> None:
    """Print the CPU time of one thread for exact depth and for each model."""
    scene, poses = build(name), np.asarray(wv.scenes.PRESETS[name].poses(MODEL_VIEWS), dtype=np.float32)
    endless = dataclasses.replace(CAMERA, near=0.0, far=math.inf)
    renderers = {"exact depth": wv.Renderer(scene, endless, outputs="depth", threads=1)}
    for model, sensor in MODELS.items():
        renderers[model] = wv.Renderer(scene, CAMERA, outputs="depth", sensor=sensor, threads=1)
    views = {model: renderer.render(poses) for model, renderer in renderers.items()}
    times = dict.fromkeys(renderers, math.inf)
    for _ in range(rounds):
        for model, renderer in renderers.items():
            start = time.thread_time()
            renderer.render(poses, out=views[model])
            times[model] = min(times[model], time.thread_time() - start)
    print(f"{name}: {CAMERA.width}x{CAMERA.height} pixels, CPU time of one thread, {MODEL_VIEWS} views per call")
    for model, seconds in times.items():
        print(f"  {model}: {1e3 * seconds / MODEL_VIEWS:.2f} ms a view, {seconds / times['exact depth']:.1f} times")


@pytest.mark.benchmark(group="depth sensors")
@pytest.mark.parametrize("part", PARTS)
def test_stereo(benchmark, part, threads):
    benchmark.pedantic(calls("room", threads=threads)[part], rounds=7, iterations=1, warmup_rounds=1)
    benchmark.extra_info["views"] = VIEWS


def main() -> None:
    """Print times and ratios."""
    from timing import take_turns

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES)
    parser.add_argument("--models", action="store_true", help="compare all models instead of parts of one")
    arguments = parser.parse_args()
    for name in arguments.scenes:
        if arguments.models:
            compare_models(name, arguments.rounds)
            continue
        measured = calls(name)
        times = [float(np.median(column)) / VIEWS for column in take_turns(list(measured.values()), arguments.rounds)]
        print(f"{name}: {CAMERA.width}x{CAMERA.height} pixels, exact depth {1e6 * times[0]:.0f} us a view; as long:")
        for part, seconds in zip(measured, times, strict=True):
            print(f"  {part}: {seconds / times[0]:.2f} times, {1e6 * seconds:.0f} us")


if __name__ == "__main__":
    main()
