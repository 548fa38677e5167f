# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure ray patterns and lenses on a GPU: packets against single rays, a bare kernel, and a pinhole of the same size.

Calls alternate, after a comparison of their results. The bare kernel runs one `wp.mesh_query_ray` per thread along
prepared directions, with Warp's fastest BVH.

  python bench/gpu_rays.py                          a table in Markdown
  python bench/gpu_rays.py --device cpu --views 2   whether all results agree, without a GPU
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator

import numpy as np
import warp as wp
from gpu_peers import TREES, warp_mesh
from gpu_timing import Run, enough_calls
from gpu_work import recorded, subject_of, timer_of
from ratios import Contest, Workload

import warpvis as wv

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

SCENES = ("room", "blobs_77k", "blobs_1m")
_TOLERANCE = 1e-3


@wp.kernel
def query_ranges(
    # Scene:
    mesh: wp.uint64,
    # Cameras:
    far: float,
    camera_to_world: wp.array[wp.transform],
    # In:
    directions: wp.array[wp.vec3],
    origins: wp.array[wp.vec3],
    # Out:
    depth_out: wp.array2d[float],
):
    """Cast one ray per thread with one query; `origins` is None if all rays start at the camera."""
    view, ray = wp.tid()
    pose = camera_to_world[view]
    direction = wp.transform_vector(pose, directions[ray])
    start = wp.transform_get_translation(pose)
    if origins:
        start = wp.transform_point(pose, origins[ray])
    hit = wp.mesh_query_ray(mesh, start, direction, far)
    depth = float(wp.inf)
    if hit.result:
        depth = hit.t
    depth_out[view, ray] = depth


def _scan(rows: int, columns: int) -> wv.cameras.Rays:
    """Return the directions of a lidar's revolution with 45 degrees of elevation, in camera axes."""
    azimuth, up = np.meshgrid(
        np.linspace(-np.pi, np.pi, columns, endpoint=False), np.radians(np.linspace(-22.5, 22.5, rows))
    )
    rays = np.stack([np.cos(up) * np.sin(azimuth), np.sin(up), np.cos(up) * np.cos(azimuth)], axis=-1)
    return wv.cameras.Rays(rays)


def scattered(count: int) -> wv.cameras.Rays:
    """Return unordered directions all around, over 59 degrees of elevation, like those of a Mid-360."""
    rng = np.random.default_rng(0)
    azimuth, up = rng.uniform(-np.pi, np.pi, count), np.arcsin(rng.uniform(np.sin(-0.9), np.sin(0.13), count))
    return wv.cameras.Rays(np.stack([np.cos(up) * np.sin(azimuth), np.sin(up), np.cos(up) * np.cos(azimuth)], axis=-1))


def _from_anywhere(count: int) -> wv.cameras.Rays:
    """Return the same directions, each with an origin."""
    rays = scattered(count)
    return wv.cameras.Rays(rays.directions, origins=np.random.default_rng(1).uniform(-0.05, 0.05, (count, 3)))


def _lens(model: str, *coefficients: float) -> wv.cameras.LensCamera:
    matrix = [[330.0, 0, 319.5], [0, 330.0, 239.5], [0, 0, 1]]
    return wv.Camera.from_opencv(matrix, coefficients, 640, 480, model=model)


# name: views, the pattern, a pinhole of the same size
CASES: dict[str, tuple[int, Callable[[], wv.cameras.Rays | wv.cameras.LensCamera], wv.Camera | None]] = {
    "1024x128 scan": (64, lambda: _scan(128, 1024), None),
    "20,000 in no order": (512, lambda: scattered(20_000), None),
    "VLP-16": (256, wv.sensors.lidars.vlp16, None),
    "HDL-64E": (64, wv.sensors.lidars.hdl64e, None),
    "OS1-128": (64, lambda: wv.sensors.lidars.ouster("OS1-128"), None),
    "OS0-128": (64, lambda: wv.sensors.lidars.ouster("OS0-128"), None),
    "20,000 from anywhere within 5 cm": (512, lambda: _from_anywhere(20_000), None),
    "VLP-16 from one point": (
        256,
        lambda: wv.cameras.Rays(wv.sensors.lidars.vlp16().directions, axes="ros_body"),
        None,
    ),
    "OS1-128 from one point": (
        64,
        lambda: wv.cameras.Rays(wv.sensors.lidars.ouster("OS1-128").directions, axes="ros_body"),
        None,
    ),
    "barrel lens 640x480": (
        64,
        lambda: _lens("pinhole", -0.28, 0.06, 0.001, -0.001, 0.0, 0.01, 0.002, 0.0),
        wv.Camera(640, 480, 330, 330, 320, 240),
    ),
    "fisheye 640x480": (64, lambda: _lens("fisheye", 0.01, 0.0, 0.0, 0.0), wv.Camera(640, 480, 330, 330, 320, 240)),
}

# Cases that gpu_all.py measures in all scenes; the others are measured in one.
_EVERYWHERE = ("1024x128 scan", "20,000 in no order", "VLP-16", "OS1-128", "barrel lens 640x480", "fisheye 640x480")


class Setup:
    """A case of a scene, with the buffers of warpvis and of the bare kernel."""

    def __init__(self, scene_name: str, case: str, device: wp.Device, views: int | None) -> None:
        """Prepare all calls, and run each once."""
        subject = subject_of(scene_name, str(device))
        count, make, pinhole = CASES[case]
        self.count, self.camera, self.device = views or count, make(), device
        axes = {} if isinstance(self.camera, wv.cameras.LensCamera) else {"convention": self.camera.axes}
        poses = subject.poses(self.count)
        self.runs: dict[str, Run] = {}
        self.images: dict[str, wv.Views] = {}
        kinds = [("packets", "packets", self.camera), ("rays", "rays", self.camera), ("pinhole", "packets", pinhole)]
        for name, kind, lens in kinds:
            if lens is None:
                continue
            renderer = wv.Renderer(subject.scene, lens, outputs=("depth",), caster=kind)
            options = axes if lens is self.camera else {}
            self.images[name] = renderer.render(poses, **options)
            self.runs[name] = lambda r=renderer, o=self.images[name], a=options: r.render(poses, out=o, **a)
        flat = self.camera.rays.reshape(-1, 3)
        directions = wp.array(np.nan_to_num(flat).astype(np.float32), dtype=wp.vec3, device=device)
        starts = None
        if self.camera.origins is not None:
            starts = wp.array(self.camera.origins.reshape(-1, 3).astype(np.float32), dtype=wp.vec3, device=device)
        self.depth = wp.empty((self.count, len(flat)), dtype=float, device=device)
        self.bare: dict[str, Run] = {}
        for tree, block in TREES[:1] if device.is_cpu else TREES:
            inputs = [warp_mesh(subject, tree).id, 1e30, poses, directions, starts, self.depth]
            dim = (self.count, len(flat))
            self.bare[f"bare {tree} {block}"] = recorded(query_ranges, dim, inputs, device, block)
        for run in (*self.runs.values(), *self.bare.values()):
            run()

    def same(self, depth: wp.array, truth: wp.array) -> float:
        """Return the fraction of ranges that agree."""
        found, expected = depth.numpy().reshape(-1), truth.numpy().reshape(-1)
        with np.errstate(invalid="ignore"):
            return float(np.mean((np.abs(found - expected) <= _TOLERANCE) | (found == expected)))

    def contest(self) -> Contest:
        """Measure packets, the bare kernel, and a pinhole in turns."""
        peers = {"bare": list(self.bare.values())} | {
            name: [run] for name, run in self.runs.items() if name in ("rays", "pinhole")
        }
        same = self.same(self.depth, self.images["packets"].depth)
        return Contest(self.runs["packets"], peers, timer_of(self.device), same)


def workloads(device: wp.Device, views: int | None = None) -> Iterator[Workload]:
    """Yield patterns and lenses of a coarse and a fine scene, and all patterns of a scene in between."""
    for scene in SCENES:
        for case in CASES if scene == "blobs_77k" else _EVERYWHERE:

            def prepare(scene: str = scene, case: str = case) -> Contest:
                return Setup(scene, case, device, views).contest()

            yield Workload(f"rays {scene} {case}", prepare)


def measure(scene_name: str, case: str, device: wp.Device, views: int | None) -> str:
    """Return a row of the table, for one case of a scene."""
    setup = Setup(scene_name, case, device, views)
    truth = setup.images["rays"].depth
    both = [setup.same(depth, truth) for depth in (setup.images["packets"].depth, setup.depth)]
    timer, runs = timer_of(device), setup.runs | setup.bare
    calls = {name: enough_calls(timer.device_seconds(run, 2)) for name, run in runs.items()}
    rounds = [{name: timer.device_seconds(run, calls[name]) for name, run in runs.items()} for _ in range(5)]
    best = {name: float(np.median([row[name] for row in rounds])) for name in runs}
    bare = min(best[name] for name in setup.bare)
    rate = setup.count / best["packets"]
    per_pinhole = best["packets"] / best["pinhole"] if "pinhole" in best else float("nan")
    return (
        f"| {scene_name}, {case} | {rate:,.0f} | {rate * setup.depth.shape[1] / 1e9:.1f} "
        f"| {best['rays'] / best['packets']:.2f} "
        f"| {bare / best['packets']:.2f} | {per_pinhole:.2f} | {both[0]:.3%}, {both[1]:.3%} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--views", type=int, help="number of views of all cases")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--scenes", nargs="+", choices=wv.scenes.PRESETS, default=SCENES)
    arguments = parser.parse_args()
    device = wp.get_device(arguments.device)
    print("| | images a second | Grays/s | x `rays` | x bare | time by pinhole's | same as `rays`: packets, bare |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    with wp.ScopedDevice(device):
        for case in arguments.cases:
            for scene in arguments.scenes:
                print(measure(scene, case, device, arguments.views), flush=True)


if __name__ == "__main__":
    main()
