# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure image points on a GPU: `render_at` in packets against single rays, and against the image itself.

Points of 320x240 images: pixel centers, their positions in the other eye of a stereo camera (nearly in the image's
order), as many random points, and world points with `point_visibility`. Calls alternate, after a comparison of their
results.

  python bench/gpu_points.py                          a table in Markdown
  python bench/gpu_points.py --device cpu --views 2   whether all results agree, without a GPU
  python bench/gpu_points.py --packets 64 256 1024    by the number of points per packet
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import gpu_kernels
import numpy as np
import warp as wp
from gpu_peers import warp_mesh
from gpu_timing import Run, enough_calls
from gpu_work import recorded, subject_of, timer_of
from ratios import Contest, Workload

import warpvis as wv
from warpvis.rendering.casters import points_cuda

SCENES = ("room", "blobs_77k", "blobs_1m")
_BASELINE = 0.075  # stereo baseline [m]
_TOLERANCE = 1e-3

Make = Callable[[wv.Camera, np.ndarray, np.random.Generator], np.ndarray]


def _centers(camera: wv.Camera, depth: np.ndarray, _: np.random.Generator) -> np.ndarray:
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return np.broadcast_to(np.stack([x, y], axis=-1).reshape(1, -1, 2), (len(depth), camera.height * camera.width, 2))


def _other_eye(camera: wv.Camera, depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    points = _centers(camera, depth, rng).copy()
    near = np.where(np.isfinite(depth), depth, np.inf).reshape(len(depth), -1)
    points[..., 0] -= camera.fx * _BASELINE / np.maximum(near, camera.near)
    return points


def _in_no_order(count: int) -> Make:
    return lambda camera, depth, rng: rng.uniform(0, (camera.width, camera.height), (len(depth), count, 2))


# name: views, their points
CASES: dict[str, tuple[int, Make]] = {
    "pixels' centers": (512, _centers),
    "the other eye": (512, _other_eye),
    "76,800 in no order": (64, _in_no_order(76_800)),
    "10,000 in no order": (64, _in_no_order(10_000)),
    "1 M in no order": (4, _in_no_order(1_000_000)),
    "1,000 in no order": (4, _in_no_order(1000)),
}
WORLD_POINTS = (1000, 10_000, 100_000, 1_000_000)


def _compare(runs: dict[str, Callable[[], object]], device: wp.Device) -> dict[str, float]:
    """Return the times of alternating calls [s]."""
    timer = timer_of(device)
    calls = {name: enough_calls(timer.device_seconds(run, 2)) for name, run in runs.items()}
    rounds = [{name: timer.device_seconds(run, calls[name]) for name, run in runs.items()} for _ in range(5)]
    return {name: float(np.median([row[name] for row in rounds])) for name in runs}


def _same(one: wp.array, other: wp.array) -> float:
    a, b = one.numpy().ravel(), other.numpy().ravel()
    with np.errstate(invalid="ignore"):
        return float(np.mean((np.abs(a - b) <= _TOLERANCE * np.maximum(1, b)) | (a == b)))


CAMERA = wv.Camera.from_fov(320, 240, hfov=0.994837, near=0.05, far=100.0)


class Setup:
    """Views of a scene as images, and points of these images."""

    def __init__(self, scene_name: str, case: str, device: wp.Device, views: int | None) -> None:
        """Render the images, and choose the points."""
        count, make = CASES[case]
        self.subject, self.count = subject_of(scene_name, str(device)), views or count
        self.poses = self.subject.poses(self.count)
        image = wv.Renderer(self.subject.scene, CAMERA, outputs=("depth",))
        self.reference = image.render(self.poses)
        self.image = lambda: image.render(self.poses, out=self.reference)
        self.positions = make(CAMERA, self.reference.depth.numpy(), np.random.default_rng(0)).astype(np.float32)
        self.pixels = wp.array(self.positions, dtype=wp.vec2, device=device)

    def points(self, caster: Any) -> tuple[wv.Views, Run]:
        """Return the images at the points, and the call that makes them."""
        renderer = wv.Renderer(self.subject.scene, CAMERA, outputs=("depth",), caster=caster)
        seen = renderer.render_at(self.poses, self.pixels)
        return seen, lambda: renderer.render_at(self.poses, self.pixels, out=seen)


def world_points(scene_name: str, count: int, device: wp.Device) -> dict[str, Run]:
    """Return `point_visibility` of four views by both casters and by default, and the bare kernel's rays."""
    subject = subject_of(scene_name, str(device))
    poses = subject.poses(4)
    low, high = subject.vertices.min(axis=0), subject.vertices.max(axis=0)
    positions = np.random.default_rng(0).uniform(low, high, (count, 3)).astype(np.float32)
    points = wp.array(positions, dtype=wp.vec3, device=device)
    hidden = wp.empty((4, count), dtype=bool, device=device)
    inputs = [warp_mesh(subject, "sah").id, poses, points, hidden]
    runs: dict[str, Run] = {
        kind: partial(wv.point_visibility, subject.scene, CAMERA, poses, points, caster=kind)
        for kind in ("auto", "packets", "rays")
    }
    return runs | {"bare": recorded(gpu_kernels.query_occlusion, (4, count), inputs, device, 64)}


def workloads(device: wp.Device, views: int | None = None) -> Iterator[Workload]:
    """Yield image points against the image, and world points against the bare kernel."""

    def in_images(scene: str, case: str) -> Contest:
        setup = Setup(scene, case, device, views)
        return Contest(setup.points("auto")[1], {"image": [setup.image]}, timer_of(device))

    def in_the_world(scene: str, count: int) -> Contest:
        runs = world_points(scene, count, device)
        return Contest(runs["auto"], {"bare": [runs["bare"]]}, timer_of(device))

    for scene in ("room", "blobs_77k"):
        for case in ("pixels' centers", "the other eye", "76,800 in no order"):
            yield Workload(f"points {scene} {case}", partial(in_images, scene, case))
        for count in (1000, 1_000_000):
            yield Workload(f"point_visibility {scene} {count:,}", partial(in_the_world, scene, count))


def measure(scene_name: str, case: str, device: wp.Device, views: int | None) -> str:
    """Return a row of the table, for one case of a scene."""
    setup = Setup(scene_name, case, device, views)
    calls = {kind: setup.points(kind) for kind in ("packets", "rays")}
    seen = {kind: views for kind, (views, _) in calls.items()}
    runs = {"image": setup.image, **{kind: run for kind, (_, run) in calls.items()}}
    same, best = _same(seen["packets"].depth, seen["rays"].depth), _compare(runs, device)
    points, pixel = (
        best[name] / size
        for name, size in (("packets", setup.positions.size / 2), ("image", setup.reference.depth.size))
    )
    return (
        f"| {scene_name}, {case} | {setup.count / best['packets']:,.0f} | {1e-9 / points:.2f} "
        f"| {best['rays'] / best['packets']:.2f} | {points / pixel:.2f} | {same:.3%} |"
    )


def measure_world_points(scene_name: str, count: int, device: wp.Device) -> str:
    """Time `point_visibility` of this number of points from four views."""
    runs = {kind: run for kind, run in world_points(scene_name, count, device).items() if kind in ("packets", "rays")}
    status = [runs[kind]().numpy() for kind in runs]
    best = _compare(runs, device)
    return (
        f"| {scene_name}, point_visibility of {count:,} | {1e3 * best['packets']:.3f} ms | "
        f"{4e-9 * count / best['packets']:.2f} | {best['rays'] / best['packets']:.2f} | "
        f"| {np.mean(status[0] == status[1]):.3%} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--views", type=int, help="number of views of all cases")
    parser.add_argument("--cases", nargs="*", choices=CASES, default=list(CASES))
    parser.add_argument("--scenes", nargs="+", choices=wv.scenes.PRESETS, default=SCENES)
    parser.add_argument("--world-points", type=int, nargs="*", default=WORLD_POINTS)
    parser.add_argument("--packets", type=int, nargs="+", choices=(64, 256, 1024), help="points of a packet")
    arguments = parser.parse_args()
    device = wp.get_device(arguments.device)
    with wp.ScopedDevice(device):
        for size in arguments.packets or [0]:
            if size:
                points_cuda._PACKETS, points_cuda._MIN_POINTS = ((size, 0),), 0
                print(f"\nPackets of {size} points, however few there are\n")
            print("| | views a second | Gpoints/s | x `rays` | time by the image's, a point | same as `rays` |")
            print("|---|---:|---:|---:|---:|---:|")
            for scene in arguments.scenes:
                for case in arguments.cases:
                    print(measure(scene, case, device, arguments.views), flush=True)
                for count in arguments.world_points:
                    print(measure_world_points(scene, count, device), flush=True)


if __name__ == "__main__":
    main()
