# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure sensors and objects that move within a frame against static ones.

``python bench/bench_motion.py`` alternates between shutters that move or not, all cast by single rays, and prints the
median times of a view and their ratios. Then it does so for revolutions of lidars with the default caster, and for
Open3D's ``cast_rays`` of the same rays, made in advance in the world frame. ``--device cuda:0`` measures on a GPU.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.core.threads import core_count
from warpvis.sensors import Motion, RollingShutter

VIEWS = 8
READOUT = 0.03
SPEEDS = (1, 5, 15, 30)
"""Speeds of lidars [m/s]."""
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


LIDARS = {
    "OS1-128": lambda: wv.sensors.lidars.ouster("OS1-128"),
    "HDL-64E": wv.sensors.lidars.hdl64e,
    "VLP-16": wv.sensors.lidars.vlp16,
}


def drive(poses: np.ndarray, speed: float) -> Motion:
    """Return the motion of a car in a curve."""
    return Motion.from_twist(poses, (speed, 0, 0), (0, 0, 0.5))


def open3d(scene: wv.Scene, lidar: wv.cameras.Rays, motion: Motion) -> Callable[[], np.ndarray]:
    """Return a call of Open3D's Embree on all cores that returns ranges."""
    import open3d as o3d

    caster = o3d.t.geometry.RaycastingScene(nthreads=core_count())
    for item in scene:
        caster.add_triangles(item.vertices, item.faces.astype(np.uint32))
    rows = np.moveaxis(motion.at(lidar.times), -2, 0)
    matrices = poses_to_matrices(rows.reshape(-1, 7)).reshape(*rows.shape[:-1], 4, 4)
    origins = 0.0 if lidar.origins is None else lidar.origins
    starts = matrices[..., :3, 3] + np.squeeze(matrices[..., :3, :3] @ np.expand_dims(origins + 0 * lidar.rays, -1), -1)
    along = np.squeeze(matrices[..., :3, :3] @ lidar.rays[..., None], -1)
    tensor = o3d.core.Tensor(np.concatenate([starts, along], axis=-1).astype(np.float32))
    return lambda: np.asarray(caster.cast_rays(tensor)["t_hit"].numpy())


def compare_lidars(device: str, scenes: list[str], rounds: int) -> None:
    """Print the times of revolutions at rest and in motion, by packets and ray by ray, and those of Open3D."""
    from timing import take_turns

    for name in scenes:
        preset = wv.scenes.PRESETS[name]
        scene, poses = preset.build(device), preset.poses(2)
        for lidar_name, make in LIDARS.items():
            lidar = make()
            packets, single = wv.Renderer(scene, lidar), wv.Renderer(scene, lidar, caster="rays")
            cases = [(packets, poses), *((packets, drive(poses, speed)) for speed in SPEEDS), (single, drive(poses, 5))]
            images = [renderer.render(motion) for renderer, motion in cases]
            calls = [call_of(renderer, motion, views) for (renderer, motion), views in zip(cases, images, strict=True)]
            peer = open3d(scene, lidar, drive(poses, 5))
            mine, theirs = images[2].depth.numpy(), peer().reshape(images[2].depth.shape)
            with np.errstate(invalid="ignore"):
                same = ~np.isfinite(mine) | (np.abs(mine - theirs) <= 1e-3 * np.maximum(1, theirs))
            times = [1e3 / 2 * float(np.median(column)) for column in take_turns([*calls, peer], rounds)]
            rest, *moving, by_rays, of_open3d = times
            speeds = ", ".join(f"{t:.2f} ({t / rest:.1f}x)" for t in moving)
            print(
                f"{name}, {lidar_name}: at rest {rest:.2f} ms, at {'/'.join(map(str, SPEEDS))} m/s {speeds}; "
                f"ray by ray {by_rays:.2f}; Open3D {of_open3d:.2f}, {of_open3d / moving[1]:.1f} times as long; "
                f"{same.mean():.4%} of rays alike",
                flush=True,
            )


def call_of(renderer: wv.Renderer, motion: Motion | np.ndarray, views: wv.Views) -> Callable[[], None]:
    """Return the call to measure."""

    def call() -> None:
        renderer.render(motion, out=views)
        wp.synchronize_device(renderer.scene.device)

    return call


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
    parser.add_argument("--scenes", nargs="+", default=["room", "blobs_77k", "terrain_200k"], help="of the lidars")
    arguments = parser.parse_args()
    times = take_turns([render(arguments.device, case) for case in CASES], arguments.rounds)
    medians = [1e3 / VIEWS * float(np.median(column)) for column in times]
    for case, median in zip(CASES, medians, strict=True):
        still = medians[0 if case.startswith("room") else 3]
        print(f"{case:22} {median:8.4f} ms a view, {median / still:5.2f} x what stands still")
    compare_lidars(arguments.device, arguments.scenes, arguments.rounds)


if __name__ == "__main__":
    main()
