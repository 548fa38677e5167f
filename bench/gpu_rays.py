# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray patterns and lenses on a GPU: packets beside single rays, a bare kernel, and a pinhole of the same size.

All take turns, and what they see is compared first. The bare kernel is one `wp.mesh_query_ray` a thread along
directions that are prepared, on Warp's best tree for it.

  python bench/gpu_rays.py                          a table in Markdown
  python bench/gpu_rays.py --device cpu --views 2   whether all see the same, without a GPU
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
import warp as wp
from gpu_timing import HostTimer, WarpTimer, enough_calls

import warpvis as wv

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

SCENES = ("room", "blobs_77k", "blobs_1m")
_TREES = (("sah", 64), ("sah", 128), ("cubql", 64))
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
    """One thread a ray, one query a thread; `origins` is None where all begin at the camera."""
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


def _scan(rows: int, columns: int) -> wv.sensors.Rays:
    """A lidar's turn of 45 degrees of height, in a camera's axes."""
    azimuth, up = np.meshgrid(
        np.linspace(-np.pi, np.pi, columns, endpoint=False), np.radians(np.linspace(-22.5, 22.5, rows))
    )
    rays = np.stack([np.cos(up) * np.sin(azimuth), np.sin(up), np.cos(up) * np.cos(azimuth)], axis=-1)
    return wv.sensors.Rays(rays)


def _scattered(count: int) -> wv.sensors.Rays:
    """Rays in no order, all around and 59 degrees high, as those of a Mid-360."""
    rng = np.random.default_rng(0)
    azimuth, up = rng.uniform(-np.pi, np.pi, count), np.arcsin(rng.uniform(np.sin(-0.9), np.sin(0.13), count))
    return wv.sensors.Rays(np.stack([np.cos(up) * np.sin(azimuth), np.sin(up), np.cos(up) * np.cos(azimuth)], axis=-1))


def _from_anywhere(count: int) -> wv.sensors.Rays:
    """The same from an origin each."""
    rays = _scattered(count)
    return wv.sensors.Rays(rays.directions, origins=np.random.default_rng(1).uniform(-0.05, 0.05, (count, 3)))


def _lens(model: str, *coefficients: float) -> wv.sensors.LensCamera:
    matrix = [[330.0, 0, 319.5], [0, 330.0, 239.5], [0, 0, 1]]
    return wv.Camera.from_opencv(matrix, coefficients, 640, 480, model=model)


# name: views, the pattern, the pinhole of the same size
CASES: dict[str, tuple[int, Callable[[], wv.sensors.Rays | wv.sensors.LensCamera], wv.Camera | None]] = {
    "1024x128 scan": (64, lambda: _scan(128, 1024), None),
    "20,000 in no order": (512, lambda: _scattered(20_000), None),
    "VLP-16": (256, wv.sensors.lidars.vlp16, None),
    "HDL-64E": (64, wv.sensors.lidars.hdl64e, None),
    "OS1-128": (64, lambda: wv.sensors.lidars.ouster("OS1-128"), None),
    "OS0-128": (64, lambda: wv.sensors.lidars.ouster("OS0-128"), None),
    "20,000 from anywhere within 5 cm": (512, lambda: _from_anywhere(20_000), None),
    "VLP-16 from one point": (
        256,
        lambda: wv.sensors.Rays(wv.sensors.lidars.vlp16().directions, axes="ros_body"),
        None,
    ),
    "OS1-128 from one point": (
        64,
        lambda: wv.sensors.Rays(wv.sensors.lidars.ouster("OS1-128").directions, axes="ros_body"),
        None,
    ),
    "barrel lens 640x480": (
        64,
        lambda: _lens("pinhole", -0.28, 0.06, 0.001, -0.001, 0.0, 0.01, 0.002, 0.0),
        wv.Camera(640, 480, 330, 330, 320, 240),
    ),
    "fisheye 640x480": (64, lambda: _lens("fisheye", 0.01, 0.0, 0.0, 0.0), wv.Camera(640, 480, 330, 330, 320, 240)),
}


def measure(scene_name: str, case: str, device: wp.Device, views: int | None) -> str:
    """Time one case of a scene: a row of the table."""
    preset = wv.scenes.PRESETS[scene_name]
    scene = preset.build(device)
    count, make, pinhole = CASES[case]
    count, camera = views or count, make()
    poses = wp.array(preset.pose_rows(count).astype(np.float32), dtype=wp.transform, device=device)
    axes = {} if isinstance(camera, wv.sensors.LensCamera) else {"convention": camera.axes}
    runs, images = {}, {}
    for name, kind, lens in (("packets", "packets", camera), ("rays", "rays", camera), ("pinhole", "packets", pinhole)):
        if lens is None:
            continue
        renderer = wv.Renderer(scene, lens, outputs=("depth",), caster=kind)
        options = axes if lens is camera else {}
        images[name] = renderer.render(poses, **options)
        runs[name] = lambda r=renderer, o=images[name], a=options: r.render(poses, out=o, **a)
    flat = camera.rays.reshape(-1, 3)
    directions = wp.array(np.nan_to_num(flat).astype(np.float32), dtype=wp.vec3, device=device)
    starts = None
    if camera.origins is not None:
        starts = wp.array(camera.origins.reshape(-1, 3).astype(np.float32), dtype=wp.vec3, device=device)
    depth = wp.empty((count, len(flat)), dtype=float, device=device)
    first = np.cumsum([0] + [len(item.vertices) for item in scene])
    vertices = wp.array(np.concatenate([item.vertices for item in scene]), dtype=wp.vec3, device=device)
    faces = np.concatenate([item.faces + start for item, start in zip(scene, first, strict=False)]).astype(np.int32)
    indices = wp.array(faces.ravel(), dtype=int, device=device)
    for tree, block in _TREES[:1] if device.is_cpu else _TREES:
        mesh = wp.Mesh(vertices, indices, bvh_constructor=tree)
        inputs = [mesh.id, 1e30, poses, directions, starts, depth]
        command = wp.launch(query_ranges, (count, len(flat)), inputs, device=device, block_dim=block, record_cmd=True)
        runs[f"bare {tree} {block}"] = lambda c=command, m=mesh: c.launch()
    for run in runs.values():
        run()
    truth, seen = (images[name].depth.numpy().reshape(-1) for name in ("rays", "packets"))
    plain = depth.numpy().reshape(-1)
    with np.errstate(invalid="ignore"):
        both = [np.mean((np.abs(a - truth) <= _TOLERANCE) | (a == truth)) for a in (seen, plain)]
    timer = HostTimer() if device.is_cpu else WarpTimer(device)
    calls = {name: enough_calls(timer.device_seconds(run, 2)) for name, run in runs.items()}
    rounds = [{name: timer.device_seconds(run, calls[name]) for name, run in runs.items()} for _ in range(5)]
    best = {name: float(np.median([row[name] for row in rounds])) for name in runs}
    bare = min(value for name, value in best.items() if name.startswith("bare"))
    rate, per_pinhole = count / best["packets"], best["packets"] / best["pinhole"] if pinhole else float("nan")
    return (
        f"| {scene_name}, {case} | {rate:,.0f} | {rate * len(flat) / 1e9:.1f} | {best['rays'] / best['packets']:.2f} "
        f"| {bare / best['packets']:.2f} | {per_pinhole:.2f} | {both[0]:.3%}, {both[1]:.3%} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--views", type=int, help="of all cases, instead of their own")
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
