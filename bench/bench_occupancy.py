# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure the integration of depth images into maps: `OccupancyMap`, Open3D's VoxelBlockGrid and OctoMap, in turns.

``python bench/bench_occupancy.py`` renders a robot's trajectory through a room with a Kinect's noise;
``python bench/bench_occupancy.py --recording FOLDER`` uses a recording. Every method builds a map of the same images
from the beginning, with the same voxels and the same maximum depth. A round measures all methods, and the table has
medians of milliseconds per image. They do not compute the same: VoxelBlockGrid averages signed distances near surfaces
and does not map free space, OctoMap inserts the point of every pixel and updates every voxel on its ray.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import warp as wp
from machine import OtherWork, describe
from numpy.typing import NDArray
from timing import take_turns

import warpvis as wv

MAX_OCTOMAP_IMAGES = 2
"""OctoMap needs seconds for an image."""


@dataclass(frozen=True)
class Frames:
    """Images for every method."""

    title: str
    depth: NDArray[np.float32]
    """Depth [m], ``(V, H, W)``; NaN without a measurement."""
    camera: wv.Camera
    matrices: NDArray[np.float64]
    """Camera to world, ``(V, 4, 4)``."""
    sigma: wv.rendering.DepthSensor

    def halved(self) -> Frames:
        """Return images of half the width and height: every second pixel."""
        camera = self.camera
        numbers = (0.5 * number for number in (camera.fx, camera.fy, camera.cx, camera.cy))
        size = camera.width // 2, camera.height // 2
        depth = np.ascontiguousarray(self.depth[:, ::2, ::2])
        return replace(self, depth=depth, camera=wv.Camera(*size, *numbers, camera.near, camera.far))

    def first(self, count: int) -> Frames:
        """Return the first images."""
        return replace(self, depth=self.depth[:count], matrices=self.matrices[:count])


def room_frames(count: int) -> Frames:
    """Render 640x480 images of a room."""
    import occupancy_accuracy as accuracy

    model = wv.sensors.kinect_v1(640, 480)
    assert model.native_camera is not None
    poses, people = accuracy.trajectory(count)
    views = wv.render(
        accuracy.build(), model.native_camera, poses, object_poses=people, outputs="depth", sensor=model, seed=0
    )
    matrices = accuracy.disturb(poses, 0.005, 0.3, 0)
    return Frames("room", views.depth.numpy(), model.native_camera, matrices, model)


def recorded_frames(path: str, count: int) -> Frames:
    """Read the first images of a recording that have a pose."""
    recording = wv.open_recording(path)
    frames = [frame for frame, _ in zip(recording.posed(), range(count), strict=False)]
    poses = np.stack([np.asarray(frame.camera_to_world) for frame in frames]).astype(np.float64)
    matrices = poses if poses.shape[-1] == 4 else wv.core.poses.poses_to_matrices(poses)
    depth = np.stack([np.asarray(frame.depth, dtype=np.float32) for frame in frames])
    return Frames(os.path.basename(path.rstrip("/")), depth, recording.camera, matrices, wv.sensors.KhoshelhamNoise())


def map_by_warpvis(frames: Frames, cell: float, max_range: float) -> wv.OccupancyMap:
    """Return a map; images come one at a time, as from a camera."""
    occupancy = wv.OccupancyMap(cell)
    for depth, matrix in zip(frames.depth, frames.matrices, strict=True):
        occupancy.integrate(depth, frames.camera, matrix, sigma=frames.sigma, max_range=max_range)
    return occupancy


def open3d(frames: Frames, cell: float, max_range: float) -> Callable[[], Any]:
    """Return a call that makes a `VoxelBlockGrid` of signed distances, with images and matrices made in advance."""
    import open3d as o3d

    camera, tensor = frames.camera, o3d.core.Tensor
    intrinsics = tensor(np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]]))
    images = [o3d.t.geometry.Image(tensor(np.nan_to_num(depth, posinf=0, neginf=0))) for depth in frames.depth]
    extrinsics = [tensor(np.linalg.inv(matrix)) for matrix in frames.matrices]

    def call() -> Any:
        grid = o3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight"), (o3d.core.float32, o3d.core.float32), ((1,), (1,)), cell, 8, 100_000
        )
        for image, extrinsic in zip(images, extrinsics, strict=True):
            blocks = grid.compute_unique_block_coordinates(image, intrinsics, extrinsic, 1.0, max_range)
            grid.integrate(blocks, image, intrinsics, extrinsic, 1.0, max_range)
        return grid

    return call


def octomap(frames: Frames, cell: float, max_range: float) -> Callable[[], Any]:
    """Return a call that makes an `OcTree`, with points in the world made in advance."""
    import octomap

    depth = np.where(np.isfinite(frames.depth), frames.depth, np.nan)
    points = wv.back_project(depth, frames.camera, frames.matrices).numpy().reshape(len(depth), -1, 3)
    clouds = [cloud[np.isfinite(cloud).all(axis=1)].astype(np.float64) for cloud in points]

    def call() -> Any:
        tree = octomap.OcTree(cell)
        for cloud, matrix in zip(clouds, frames.matrices, strict=True):
            tree.insertPointCloud(cloud, matrix[:3, 3].copy(), max_range)
        return tree

    return call


def rows(frames: Frames, cell: float, max_range: float, rounds: int) -> Iterator[str]:
    """Yield the median times of an image by each method, and those relative to `OccupancyMap`."""
    calls: dict[str, tuple[int, Callable[[], Any]]] = {}
    calls["OccupancyMap"] = len(frames.depth), partial(map_by_warpvis, frames, cell, max_range)
    for name, prepare, count in (
        ("VoxelBlockGrid", open3d, len(frames.depth)),
        ("OctoMap", octomap, MAX_OCTOMAP_IMAGES),
    ):
        try:
            calls[name] = count, prepare(frames.first(count), cell, max_range)
        except ImportError as error:
            yield f"{name}: {error}"
    for _, call in calls.values():
        call()
    slow = calls.pop("OctoMap", None)
    times = take_turns([call for _, call in calls.values()], rounds)
    per_image = {
        name: np.median(column) / count for (name, (count, _)), column in zip(calls.items(), times, strict=True)
    }
    if slow:
        few = partial(map_by_warpvis, frames.first(slow[0]), cell, max_range)
        ours, theirs = take_turns([few, slow[1]], 1)
        per_image[f"OctoMap, {slow[0]} images"] = per_image["OccupancyMap"] * theirs[0] / ours[0]
    ours_ms = 1e3 * per_image["OccupancyMap"]
    size = f"{frames.camera.width}x{frames.camera.height}"
    start = f"| {frames.title} {size}, {max_range:g} m, {100 * cell:g} cm"
    rest = " | ".join(
        f"{1e3 * s:.1f} ms, {1e3 * s / ours_ms:.2f} x" for name, s in per_image.items() if s and name != "OccupancyMap"
    )
    yield f"{start} | {ours_ms:.1f} ms, {1e3 / ours_ms:.0f} images/s | {rest} |"


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recording", help="folder or bag for `warpvis.open_recording`, with poses")
    parser.add_argument("--images", type=int, default=30)
    parser.add_argument("--cells", type=float, nargs="+", default=[0.01, 0.02, 0.05], help="sides of voxels [m]")
    parser.add_argument("--ranges", type=float, nargs="+", default=[3.5, 5.0], help="maximum depths [m]")
    parser.add_argument("--threads", type=int, default=0, help="cores of this process; all by default")
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    if arguments.threads:
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: arguments.threads])
    other_work = OtherWork()
    print(describe(("warp-lang", "open3d", "octomap-python")))
    frames = (
        recorded_frames(arguments.recording, arguments.images) if arguments.recording else room_frames(arguments.images)
    )
    print("| images | OccupancyMap | VoxelBlockGrid | OctoMap |\n|---|---:|---:|---:|")
    for images, reach, cell in product((frames.halved(), frames), arguments.ranges, arguments.cells):
        for row in rows(images, cell, reach, arguments.rounds):
            print(row, flush=True)
    print(other_work.warning())


if __name__ == "__main__":
    main()
