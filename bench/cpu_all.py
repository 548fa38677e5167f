# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare workloads on one CPU core with a peer or a simple baseline, and the ratios with those of the last run.

The process is bound to one core and measures CPU time, so that other processes change the ratios little. `make bench`
runs this; the table is `.benchmarks/<machine>/ratios.json`.

  python bench/cpu_all.py                        compares with the table
  python bench/cpu_all.py --update               writes it
  python bench/cpu_all.py --only worlds lidar    workloads whose names contain one of these
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import bench_occupancy
import gpu_all
import lidar_worlds
import mujoco
import numpy as np
import peers
import warp as wp
from gpu_images import Images
from gpu_timing import CoreTimer
from machine import OtherWork, machine_id
from numpy.typing import NDArray
from ratios import ROOT, Contest, Workload, add_options, run_guard

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.mujoco import Kinematics
from warpvis.scenes.robots import moving_robots_xml, robot_joints

TOLERATED = 0.15
"""Accepted decrease of a ratio: two runs of the same code differ by several per cent."""

_LIMIT = 300

_SHARED = (
    *("room-320", "77k-320", "small-room-1", "small-1m-1", "77k-320 rays", "77k-320 four outputs", "77k-320 normals"),
    *("worlds overhead_cam 64x64 of 4", "worlds teleoperator_pov 64x64 of 4", "geoms 100 in 4 worlds 64x64"),
    *("rays room 1024x128 scan", "rays room VLP-16", "rays room OS1-128", "rays room fisheye 640x480"),
    *("rays blobs_77k 20,000 in no order", "sensor room RealSense D435", "sensor room Kinect v1"),
    *("sensor room Azure Kinect", "sensor room Nguyen's noise", "sensor room simkinect", "sensor room corruptions"),
    *("points room the other eye", "point_visibility room 1,000,000", "images room color", "images room albedo"),
    *("images room back_project", "images room floor_map", "images room voxel_map", "images room object_visibility"),
    "images room occupancy_map",
)
"""Workloads shared with gpu_all.py."""

_VIEWS = 4
_ROUNDS = 25


def classify_by_numpy(depth: NDArray, camera: wv.Camera, poses: NDArray, spheres: Sequence[Any]) -> NDArray[np.uint8]:
    """Label pixels like `wv.classify`, for views in which no pixel is out of the camera's range."""
    y, x = np.indices(depth.shape[1:], dtype=np.float32) + np.float32(0.5)
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    labels = np.empty(depth.shape, dtype=np.uint8)
    for image, matrix, out in zip(depth, poses_to_matrices(poses).astype(np.float32), labels, strict=True):
        points = (rays * np.where(np.isfinite(image), image, np.nan)[..., None]) @ matrix[:3, :3].T + matrix[:3, 3]
        out[...] = wv.Label.OBSTACLE
        for sphere in spheres:
            inside = np.sum((points - np.float32(sphere.center)) ** 2, axis=-1) < (sphere.diameter / 2) ** 2
            out[inside] = sphere.label
        out[points[..., 2] < 0.01] = wv.Label.GROUND
        out[~np.isfinite(image)] = wv.Label.EMPTY
    return labels


def _classify() -> Contest:
    images = Images("experiment_3", _VIEWS, wp.get_device("cpu"))
    spheres = wv.scenes.PRESETS["experiment_3"].spheres
    inputs = (images.views.depth.numpy(), images.camera, images.poses.numpy(), spheres)
    labels = wv.classify(images.views.depth, images.camera, images.poses, spheres=spheres).numpy()
    same = float(np.mean(classify_by_numpy(*inputs) == labels))
    return Contest(images.classify(), {"NumPy": [partial(classify_by_numpy, *inputs)]}, CoreTimer(), same)


def label_floor_by_numpy(depth: NDArray, camera: wv.Camera, poses: NDArray) -> NDArray[np.uint8]:
    """Label pixels like `wv.classify` without spheres, by heights only, with few passes over memory."""
    u = ((np.arange(camera.width) + 0.5 - camera.cx) / camera.fx).astype(np.float32)
    v = ((np.arange(camera.height) + 0.5 - camera.cy) / camera.fy).astype(np.float32)
    labels, heights = np.empty(depth.shape, dtype=np.uint8), np.empty(depth.shape[1:], dtype=np.float32)
    for image, matrix, out in zip(depth, poses_to_matrices(poses).astype(np.float32), labels, strict=True):
        np.add(u * matrix[2, 0], (v * matrix[2, 1] + matrix[2, 2])[:, None], out=heights)
        heights *= image
        np.subtract(np.uint8(wv.Label.OBSTACLE), heights < 0.01 - matrix[2, 3], out=out)
        out *= (image >= camera.near) & (image <= camera.far)
    return labels


def _label_floor() -> Contest:
    """Set up 30 VGA images of a room, with holes as a measuring camera has them."""
    room, camera = wv.scenes.PRESETS["room"], wv.Camera(640, 480, 525, 525, 320, 240, near=0.3, far=8.0)
    poses = np.asarray(room.poses(30))
    depth = wv.render(room.build(), camera, poses, caster="packets").depth.numpy().copy()
    depth[np.random.default_rng(0).random(depth.shape) < 0.2] = 0.0
    same = float(np.mean(label_floor_by_numpy(depth, camera, poses) == wv.classify(depth, camera, poses).numpy()))
    ours, peer = (partial(function, depth, camera, poses) for function in (wv.classify, label_floor_by_numpy))
    return Contest(ours, {"NumPy": [peer]}, CoreTimer(), same)


def _lidar() -> Contest:
    """Set up a scan of a world of moving robots, and `mj_multiRay` on one core as its peer."""
    model = mujoco.MjModel.from_xml_string(moving_robots_xml())
    rays = wv.cameras.Rays(wv.sensors.lidars.vlp16().directions, axes="ros_body", far=lidar_worlds.FAR)
    poses = Kinematics(model).from_qpos(robot_joints(_VIEWS))
    call, read = lidar_worlds.ours(model, poses, rays, "cpu", ("depth",))
    other, read_other = lidar_worlds.mujoco_itself(model, rays, _VIEWS)
    other()
    found, length = read().reshape(_VIEWS, -1), read_other()
    expected = np.where((length < 0) | (length > lidar_worlds.FAR), np.inf, length)
    same = float(np.mean(np.isclose(found, expected, atol=lidar_worlds.TOLERANCE)))
    return Contest(call, {"mj_multiRay": [other]}, CoreTimer(), same)


def _integrate(title: str, prepare: Callable[..., Callable[[], Any]], images: int) -> Contest:
    """Set up a map of noisy images of a room, and another library's map of the same images as its peer."""
    frames, cell, reach = bench_occupancy.room_frames(images).halved(), 0.02, 3.5
    ours, peer = partial(bench_occupancy.map_by_warpvis, frames, cell, reach), prepare(frames, cell, reach)
    return Contest(ours, {title: [peer]}, CoreTimer())


def _peer(title: str, prepare: Callable[[peers.Work], peers.Prepared], size: tuple[int, int], views: int) -> Contest:
    """Set up depth of the room, and another library as its peer."""
    preset = wv.scenes.PRESETS["room"]
    camera = wv.Camera.from_fov(*size, hfov=preset.camera.hfov, near=preset.camera.near, far=preset.camera.far)
    work = peers.Work(preset.build(), camera, preset.poses(views))
    (ours, depth), (other, other_depth) = peers.warpvis(work), prepare(work)
    found, expected = depth(ours()), other_depth(other())
    same = float(np.mean(np.isclose(found, expected, atol=1e-3) | (expected < camera.near) | (expected > camera.far)))
    return Contest(ours, {title: [other]}, CoreTimer(), same)


def workloads() -> Iterator[Workload]:
    """Yield all workloads, timed by their CPU time on one core."""
    for workload in _workloads():
        yield replace(workload, prepare=partial(_timed, workload.prepare))


def _timed(prepare: Callable[[], Contest]) -> Contest:
    return replace(prepare(), timer=CoreTimer())


def _workloads() -> Iterator[Workload]:
    device = wp.get_device("cpu")
    shared = {workload.name: workload for workload in gpu_all.workloads(device, _VIEWS)}
    shared |= {
        workload.name: workload for workload in gpu_all.workloads(device, 1) if workload.name.startswith("small")
    }
    for name in _SHARED:
        yield shared[name]
    yield Workload("classify NumPy", _classify)
    yield Workload("labels of 30 VGA images NumPy", _label_floor)
    yield Workload("lidar mj_multiRay", _lidar)
    yield Workload("occupancy map Open3D", partial(_integrate, "Open3D", bench_occupancy.open3d, 16))
    yield Workload("occupancy map OctoMap", partial(_integrate, "OctoMap", bench_occupancy.octomap, 2))
    for title, prepare in (("Open3D", peers.open3d), ("embreex", peers.embreex), ("Mitsuba", peers.mitsuba)):
        yield Workload(f"room-320 {title}", partial(_peer, title, prepare, (320, 240), _VIEWS))
        yield Workload(f"small-room-1 {title}", partial(_peer, title, prepare, (64, 64), 1))


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print and compare; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, _LIMIT, TOLERATED, _ROUNDS)
    options = parser.parse_args(arguments)
    wp.config.log_level = wp.LOG_WARNING
    machine, other_work = machine_id(), OtherWork()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    status = run_guard(options, machine, ROOT / ".benchmarks" / machine / "ratios.json", workloads())
    print(other_work.warning(), flush=True)
    return status


if __name__ == "__main__":
    sys.exit(main())
