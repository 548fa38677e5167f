# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure depth-camera models on a GPU against the clean depth that they start from: frames per second, and memory.

``python bench/gpu_sensors.py`` prints a table in Markdown; ``--device cpu --views 4`` checks without a GPU that all
models run.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Iterator
from functools import partial

import numpy as np
import warp as wp
from gpu_timing import Run, enough_calls
from gpu_work import subject_of, timer_of
from ratios import Contest, Workload

import warpvis as wv
from warpvis.rendering import DepthSensor

SCENES = ("room", "blobs_77k", "blobs_1m")
CAMERA = wv.Camera.from_fov(320, 240, hfov=math.radians(69.0), near=0.1, far=10.0)
MODELS: dict[str, DepthSensor] = {
    "RealSense D435": wv.sensors.realsense_d435(320, 240),
    "Kinect v1": wv.sensors.kinect_v1(320, 240),
    "Azure Kinect": wv.sensors.azure_kinect(),
    "Nguyen's noise": wv.sensors.NguyenNoise(),
    "Khoshelham's noise": wv.sensors.KhoshelhamNoise(),
    "simkinect": wv.sensors.SimKinect(),
    "Redwood's noise": wv.sensors.RedwoodNoise(np.ones((80, 80, 5))),
    "corruptions": wv.sensors.Corruptions(0.01, 0.01, dropout=0.02, rectangles=(0, 4)),
}
_ROUNDS = 5
_VIEWS = 1024


def renderings(scene_name: str, views: int, device: wp.Device, models: Iterable[str] = MODELS) -> dict[str, Run]:
    """Return calls that render clean depth and the depth of each model, each called once."""
    subject = subject_of(scene_name, str(device))
    poses = subject.poses(views)
    runs = {}
    for name, model in {"clean": None, **{name: MODELS[name] for name in models}}.items():
        renderer = wv.Renderer(subject.scene, CAMERA, outputs="depth", sensor=model)
        runs[name] = partial(renderer.render, poses, out=renderer.render(poses))
    return runs


def workloads(device: wp.Device, views: int | None = None) -> Iterator[Workload]:
    """Yield each model against clean depth."""

    def prepare(scene: str, name: str) -> Contest:
        runs = renderings(scene, views or _VIEWS, device, [name])
        return Contest(runs[name], {"clean": [runs["clean"]]}, timer_of(device))

    for name in MODELS:
        yield Workload(f"sensor room {name}", partial(prepare, "room", name))
    yield Workload("sensor blobs_77k RealSense D435", partial(prepare, "blobs_77k", "RealSense D435"))


def measure(scene_name: str, views: int, device: wp.Device) -> None:
    """Print a scene's rows."""
    timer = timer_of(device)
    times, peak = {}, {}
    for name, run in renderings(scene_name, views, device).items():
        calls = enough_calls(timer.device_seconds(run, 1))
        rounds = []
        for _ in range(_ROUNDS):
            rounds.append(timer.device_seconds(run, calls))
            peak.setdefault(name, []).append(0 if device.is_cpu else wp.get_mempool_used_mem_high(device))
        times[name] = float(np.median(rounds))
    for name, seconds in times.items():
        grown = peak[name][-1] - peak[name][0]
        print(
            f"| {scene_name}, {name} | {views / seconds:,.0f} | {seconds / times['clean']:.2f} | {grown / 2**20:.0f} |",
            flush=True,
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--views", type=int, default=_VIEWS)
    parser.add_argument("--scenes", nargs="+", choices=wv.scenes.PRESETS, default=SCENES)
    arguments = parser.parse_args()
    device = wp.get_device(arguments.device)
    print(f"{CAMERA.width}x{CAMERA.height} pixels, {arguments.views} views a call\n")
    print("| | frames a second | x clean depth's time | memory that repeating took, MiB |")
    print("|---|---:|---:|---:|")
    with wp.ScopedDevice(device):
        for scene in arguments.scenes:
            measure(scene, arguments.views, device)


if __name__ == "__main__":
    main()
