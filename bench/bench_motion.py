# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure sensors and objects that move within a frame against static ones, all cast by single rays.

``python bench/bench_motion.py`` alternates between them and prints the median times of a view and their ratios;
``--device cuda:0`` measures on a GPU.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.sensors import Motion, RollingShutter

VIEWS = 8
READOUT = 0.03
CAMERA = wv.Camera.from_fov(320, 240, hfov=1.0, near=0.05, far=20.0)


def objects(count: int = 20) -> np.ndarray:
    """Return poses at the start and the end of the frame: a few centimeters apart, and a third of a turn."""
    rng = np.random.default_rng(0)
    rows = np.zeros((2, count, 7))
    rows[:, :, :3] = rng.uniform(-1, 1, (count, 3))
    rows[1, :, :3] += rng.normal(scale=0.03, size=(count, 3))
    rows[0, :, 6] = 1
    axes = rng.normal(size=(count, 3))
    rows[1, :, 3:6] = np.sin(1.0) * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    rows[1, :, 6] = np.cos(1.0)
    return rows


def build(device: str, *, movable: bool) -> wv.Scene:
    """Return the room with moving objects in it."""
    scene = wv.scenes.PRESETS["room"].build(device)
    for index, pose in enumerate(objects()[0] if movable else ()):
        mesh = trimesh.creation.icosphere(2, 0.1) if index % 2 else trimesh.creation.box((0.2, 0.2, 0.2))
        scene.add(mesh, name=f"thing_{index}", pose=pose, movable=True)
    return scene


def render(device: str, case: str, threads: int | None = None) -> Callable[[], object]:
    """Return the call to measure, depth of all views; it was called once."""
    among, moves = case.partition(", ")[0], case.partition(", ")[2]
    scene = build(device, movable=among == "20 objects")
    renderer = wv.Renderer(scene, RollingShutter(CAMERA, READOUT), outputs="depth", caster="rays", threads=threads)
    poses = wv.scenes.PRESETS["room"].poses(VIEWS)
    sensor = {
        "sensor": Motion([poses, poses + [0.05, 0, 0.02, 0, 0, 0, 0]], [0, READOUT]),
        "twist": Motion.from_twist(poses, (1.0, 0, 0), (0, 1.0, 0)),
    }.get(moves, poses)
    rows = objects()
    object_poses = {"objects": Motion(rows, [0, READOUT])}.get(moves, rows[0] if among == "20 objects" else None)
    views = renderer.render(sensor, object_poses=object_poses)

    def call() -> None:
        renderer.render(sensor, object_poses=object_poses, out=views)
        wp.synchronize_device(device)

    return call


CASES = (
    "room, nothing",
    "room, sensor",
    "room, twist",
    "20 objects, nothing",
    "20 objects, sensor",
    "20 objects, objects",
)


@pytest.mark.benchmark(group="motion")
@pytest.mark.parametrize("case", ["room, sensor", "20 objects, objects"])
def test_motion(benchmark, case, threads):
    benchmark.pedantic(render("cpu", case, threads), rounds=7, iterations=3, warmup_rounds=1)
    benchmark.extra_info["views"] = VIEWS


def main() -> None:
    """Compare all cases in one run."""
    from timing import take_turns

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    times = take_turns([render(arguments.device, case) for case in CASES], arguments.rounds)
    medians = [1e3 / VIEWS * float(np.median(column)) for column in times]
    for case, median in zip(CASES, medians, strict=True):
        still = medians[0 if case.startswith("room") else 3]
        print(f"{case:22} {median:8.4f} ms a view, {median / still:5.2f} x what stands still")


if __name__ == "__main__":
    main()
