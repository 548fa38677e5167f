# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure lidars that move within a frame on a GPU: in packets, ray by ray, and at rest.

Poses are on the device. After a comparison of depth, calls are recorded as CUDA graphs, which take turns.
``--objects 20`` adds objects that move; at rest, they and the sensor do not.

  python bench/gpu_motion.py --scenes room blobs_77k --views 1 16 64
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
import trimesh
import warp as wp
from bench_motion import LIDARS, READOUT, drive, objects
from gpu_timing import WarpTimer, enough_calls

import warpvis as wv
from warpvis.rendering import views_for
from warpvis.rendering.casters.base import ViewBatch
from warpvis.scene.worlds import parse_worlds
from warpvis.sensors import Motion


def build(name: str, device: str, count: int) -> wv.Scene:
    """Return a scene with movable objects in it."""
    scene = wv.scenes.PRESETS[name].build(device)
    for index, pose in enumerate(objects(count)[0] if count else ()):
        mesh = trimesh.creation.icosphere(2, 0.1) if index % 2 else trimesh.creation.box((0.2, 0.2, 0.2))
        scene.add(mesh, name=f"thing_{index}", pose=pose, movable=True)
    return scene


def prepare(
    scene: wv.Scene, lidar: wv.cameras.Rays, caster: str, poses: np.ndarray | Motion, things: Motion | None
) -> tuple[Callable[[], None], wp.array]:
    """Return a call that casts depth, which was called once, and its result."""
    renderer = wv.Renderer(scene, lidar, caster=caster)
    if isinstance(poses, Motion):
        made = renderer._moving_caster()
        views = made.parse(poses, things, None, None, None, None)
    else:
        made = renderer._caster
        rows = wp.array(poses.astype(np.float32), dtype=wp.transform, device=scene.device)
        views = ViewBatch(made.parse_poses(rows, lidar.axes), parse_worlds(scene, len(rows), None, None, None))
    depth = views_for(("depth",), (views.count, *lidar.shape), scene.device).depth

    def call() -> None:
        made.cast(views, {"depth": depth})

    call()
    return call, depth


def alike(one: wp.array, other: wp.array) -> float:
    """Return the fraction of rays with the same depth, within 0.01 %."""
    a, b = one.numpy(), other.numpy()
    with np.errstate(invalid="ignore"):
        return float(((a == b) | (np.abs(a - b) <= 1e-4 * np.maximum(np.abs(b), 1))).mean())


def main() -> None:
    """Measure all cases in one run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--scenes", nargs="+", default=["room", "blobs_77k", "terrain_200k"])
    parser.add_argument("--lidars", nargs="+", default=list(LIDARS))
    parser.add_argument("--views", nargs="+", type=int, default=[1, 16, 64])
    parser.add_argument("--speeds", nargs="+", type=float, default=[5.0, 15.0])
    parser.add_argument("--objects", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=7)
    arguments = parser.parse_args()
    device = wp.get_device(arguments.device)
    timer = WarpTimer(device)
    things = Motion(objects(arguments.objects), [0, 10 * READOUT]) if arguments.objects else None
    for name in arguments.scenes:
        scene = build(name, arguments.device, arguments.objects)
        for lidar_name in arguments.lidars:
            lidar = LIDARS[lidar_name]()
            for count in arguments.views:
                poses = wv.scenes.PRESETS[name].poses(count)
                speeds = arguments.speeds
                cases = [("packets", poses, None), ("rays", drive(poses, speeds[0]), things)]
                cases += [("auto", drive(poses, speed), things) for speed in speeds]
                made = [prepare(scene, lidar, *case) for case in cases]
                same = alike(made[2][1], made[1][1])
                if not device.is_cuda:
                    print(f"{name}, {lidar_name}, {count} views: {same:.4%} of rays alike", flush=True)
                    continue
                runs = [timer.record(call) for call, _ in made]
                calls = [enough_calls(timer.device_seconds(run, 1)) for run in runs]
                rounds = [
                    [timer.device_seconds(run, number) for run, number in zip(runs, calls, strict=True)]
                    for _ in range(arguments.rounds)
                ]
                rest, single, *moving = 1e6 / count * np.median(rounds, axis=0)
                times = ", ".join(f"{t:.1f} ({t / rest:.2f}x, {single / t:.2f}x)" for t in moving)
                print(
                    f"{name}, {lidar_name}, {count} views: at rest {rest:.1f} us a view, ray by ray {single:.1f}, at "
                    f"{'/'.join(f'{speed:g}' for speed in speeds)} m/s (over rest, speedup) {times}; {same:.4%} alike",
                    flush=True,
                )


if __name__ == "__main__":
    main()
