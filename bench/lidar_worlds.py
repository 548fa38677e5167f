# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure a Livox Mid-360 in thousands of worlds of moving robots against mujoco-lidar's Warp backend, in rays/s.

    python bench/lidar_worlds.py [--device cuda:0] [--worlds 4096] [--rays 20000] [--mid360 FILE]

Both libraries use the same MuJoCo model, `warpvis.scenes.robots`, from the first robot's mast, with the same rays and
with poses of geoms that are on the device. A call moves all robots and casts all rays: mujoco-lidar refits its BVH of
the worlds' boxes and writes distances and points; warpvis writes depth, and in a second row points too. Ranges are
compared first. mujoco-lidar is timed without the copies from and to the host in its own call.

Prints a Markdown table. On a CPU, use few worlds.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import mujoco
import numpy as np
import warp as wp
from gpu_rays import scattered
from gpu_work import timer_of
from numpy.typing import NDArray
from ratios import Contest, Workload

import warpvis as wv
from warpvis.mujoco import Kinematics, WorldPoses, geom_poses, scene_from_mujoco
from warpvis.scenes.robots import moving_robots_xml, robot_joints

ROUNDS = 7
FAR = 100.0
TOLERANCE = 2e-3


def site_poses(poses: WorldPoses) -> NDArray[np.float32]:
    """Return poses of the lidar, x forward, y left, z up, rows ``x y z qx qy qz qw``, shape ``(W, 7)``."""
    matrices = np.tile(np.eye(4), (len(poses.site_xpos), 1, 1))
    matrices[:, :3, :3] = np.asarray(poses.site_xmat)[:, 0].reshape(-1, 3, 3)
    matrices[:, :3, 3] = np.asarray(poses.site_xpos)[:, 0]
    turned = wv.core.poses.convert_axes(matrices, "ros_body", "ros_body")
    return turned.astype(np.float32)


def ours(
    model: mujoco.MjModel,
    poses: WorldPoses,
    rays: wv.cameras.Rays,
    device: str,
    outputs: tuple[str, ...],
    **options: Any,
) -> tuple[Callable[[], Any], Callable[[], NDArray]]:
    """Return the call to measure, and a function that reads its ranges."""
    built = scene_from_mujoco(model, device=device)
    worlds = len(poses.site_xpos)
    renderer = wv.Renderer(built.scene, rays, outputs=outputs, device_bytes=2**36, **options)
    places = wp.array(site_poses(poses), dtype=wp.transform, device=device)
    moved = wp.array(geom_poses(poses, built), dtype=wp.transform, device=device)
    index = wp.array(np.arange(worlds, dtype=np.int32), dtype=wp.int32, device=device)
    views = renderer.render(places, object_poses=moved, world_index=index)
    call = partial(renderer.render, places, object_poses=moved, world_index=index, out=views)
    return call, views.depth.numpy


def theirs(
    model: mujoco.MjModel, poses: WorldPoses, rays: wv.cameras.Rays, device: str
) -> tuple[Callable[[], Any], Callable[[], NDArray]]:
    """Return the same for mujoco-lidar: the launches of its `trace_rays_batch`, with all data on the device."""
    from mujoco_lidar.core_warp.kernels import trace_rays_batch_bvh_kernel
    from mujoco_lidar.core_warp.mjlidar_warp import MjLidarWarp

    caster = MjLidarWarp(model, cutoff_dist=FAR, device=device)
    worlds, count = len(poses.site_xpos), len(rays)
    directions = rays.directions.reshape(-1, 3)
    array = partial(wp.array, device=device)
    xpos = array(np.asarray(poses.geom_xpos, dtype=np.float32), dtype=wp.vec3)
    xmat = array(np.asarray(poses.geom_xmat, dtype=np.float32), dtype=wp.float32)
    place = array(np.asarray(poses.site_xpos)[:, 0], dtype=wp.vec3)
    rotation = array(np.asarray(poses.site_xmat)[:, 0].reshape(-1, 3, 3), dtype=wp.float32)
    theta = array(np.arctan2(directions[:, 1], directions[:, 0]).astype(np.float32), dtype=wp.float32)
    phi = array(np.arcsin(np.clip(directions[:, 2], -1, 1)).astype(np.float32), dtype=wp.float32)
    distances = wp.zeros((worlds, count), dtype=wp.float32, device=device)
    points = wp.zeros((worlds, count), dtype=wp.vec3, device=device)

    def call() -> None:
        caster._update_batch_bvh(worlds, xpos, xmat)
        inputs = [caster._batch_bvh.id, caster.geom_types, caster.geom_sizes, caster.geom_mesh_ids, caster.mesh_ids]
        inputs += [xpos, xmat, place, rotation, theta, phi, FAR, distances, points]
        wp.launch(trace_rays_batch_bvh_kernel, dim=(worlds, count), inputs=inputs, device=device)

    call()
    return call, distances.numpy


def mujoco_itself(
    model: mujoco.MjModel, rays: wv.cameras.Rays, worlds: int
) -> tuple[Callable[[], Any], Callable[[], NDArray]]:
    """Return the same for `mj_multiRay`, which mujoco-lidar's CPU backend calls world by world; without kinematics."""
    joints, states = robot_joints(worlds), []
    for row in joints:
        data = mujoco.MjData(model)
        data.qpos[:] = row
        mujoco.mj_forward(model, data)
        states.append(data)
    count = len(rays)
    directions = [(rays.directions.reshape(-1, 3) @ data.site_xmat[0].reshape(3, 3).T).ravel() for data in states]
    found, hit = np.zeros((worlds, count)), np.zeros(count, dtype=np.int32)

    def call() -> None:
        for data, along, out in zip(states, directions, found, strict=True):
            mujoco.mj_multiRay(model, data, data.site_xpos[0], along, None, 1, -1, hit, out, None, count, FAR)

    call()
    return call, lambda: found


def compare(mine: NDArray, other: NDArray) -> str:
    """Describe how many ranges differ, among those that both hit."""
    both = np.isfinite(mine) & (other > 0) & (other < FAR)
    differs = np.abs(mine[both] - other[both]) > TOLERANCE
    unmatched = int((np.isfinite(mine) != ((other > 0) & (other < FAR))).sum())
    return (
        f"of {mine.size} ranges, {int(both.sum())} hit in both and {unmatched} in one; "
        f"{int(differs.sum())} are 2 mm apart"
    )


def seconds_of(call: Callable[[], Any], device: str) -> float:
    """Return the median time of a call [s], until its work is complete."""
    taken = []
    for _ in range(ROUNDS):
        wp.synchronize_device(device)
        start = time.perf_counter()
        call()
        wp.synchronize_device(device)
        taken.append(time.perf_counter() - start)
    return statistics.median(taken)


def workloads(device: wp.Device, worlds: int | None = None) -> Iterator[Workload]:
    """Yield scattered rays in moving worlds against single rays, and against mujoco-lidar."""
    rays = wv.cameras.Rays(scattered(20_000).directions, axes="ros_body")

    def prepare(count: int, beside_rays: bool) -> Contest:
        model = mujoco.MjModel.from_xml_string(moving_robots_xml())
        poses = Kinematics(model).from_qpos(robot_joints(worlds or count))
        mine, read = ours(model, poses, rays, str(device), ("depth",))
        if beside_rays:
            call, other = ours(model, poses, rays, str(device), ("depth",), caster="rays")
            same = float(np.mean(np.isclose(read(), other(), atol=TOLERANCE)))
            return Contest(mine, {"rays": [call]}, timer_of(device), same)
        return Contest(mine, {"mujoco-lidar": [theirs(model, poses, rays, str(device))[0]]}, timer_of(device))

    yield Workload("lidar in 256 worlds", partial(prepare, 256, True))
    yield Workload("lidar in 4096 worlds mujoco-lidar", partial(prepare, 4096, False))


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--worlds", type=int, default=8)
    parser.add_argument("--rays", type=int, default=20_000)
    parser.add_argument(
        "--mid360", help="samples of the Mid-360, .csv or .npy; those of mujoco-lidar's wheel if missing"
    )
    chosen = parser.parse_args()
    model = mujoco.MjModel.from_xml_string(moving_robots_xml())
    poses = Kinematics(model).from_qpos(robot_joints(chosen.worlds))
    pattern = wv.sensors.lidars.livox("mid360", chosen.mid360)
    rays = pattern.frame(0, samples=chosen.rays, far=FAR)
    calls = {
        "warpvis, depth": ours(model, poses, rays, chosen.device, ("depth",)),
        "warpvis, depth and points": ours(model, poses, rays, chosen.device, ("depth", "points")),
    }
    try:
        calls["mujoco-lidar, Warp: distances and points"] = theirs(model, poses, rays, chosen.device)
    except ImportError as error:
        print(f"mujoco-lidar is not here: {error}")
    if wp.get_device(chosen.device).is_cpu:
        calls["mj_multiRay, one core"] = mujoco_itself(model, rays, chosen.worlds)
    mine = calls["warpvis, depth"][1]()
    for name, (_, read) in list(calls.items())[2:]:
        print(f"{name}: {compare(mine, read())}")
    print(
        f"\n{chosen.worlds} worlds of {chosen.rays} rays, {model.ngeom} geoms, on {wp.get_device(chosen.device).name}\n"
    )
    print("| | ms | G rays/s |\n|---|---:|---:|")
    for name, (call, _) in calls.items():
        taken = seconds_of(call, chosen.device)
        print(f"| {name} | {1e3 * taken:.3f} | {chosen.worlds * chosen.rays / taken / 1e9:.4g} |")


if __name__ == "__main__":
    main()
