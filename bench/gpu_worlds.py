# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Thousands of worlds of a MuJoCo model on a GPU: `warpvis.mujoco.BatchRenderer` against MuJoCo Warp's renderer.

    python bench/gpu_worlds.py [MODEL.xml ...] [--worlds 4096] [--sizes 64 128] [--cameras NAME ...]

Without a model it takes MuJoCo Warp's aloha_pot. Every world has joints of its own. A call moves all objects to where
MuJoCo Warp's data has them and renders one camera in all worlds, depth only: `refit_bvh` and `render` there, and
`BatchRenderer.render` here, each recorded into a CUDA graph. Prints a Markdown table, and how far the images agree.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp
from gpu_timing import WarpTimer
from numpy.typing import NDArray

from warpvis.mujoco import BatchRenderer
from warpvis.mujoco._scene import DEFAULT_TOLERANCE

_ROUNDS = 9
_GROUPS = (0, 1, 2)


def random_joints(model: mujoco.MjModel, worlds: int) -> NDArray[np.float32]:
    """Joint positions, shape ``(worlds, nq)``: hinges and slides anywhere in the middle half of their range."""
    rng = np.random.default_rng(0)
    qpos = np.tile(model.qpos0, (worlds, 1))
    for joint in range(model.njnt):
        if int(model.jnt_type[joint]) not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            continue
        low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-1.0, 1.0)
        middle, reach = (low + high) / 2, (high - low) / 4
        qpos[:, model.jnt_qposadr[joint]] = rng.uniform(middle - reach, middle + reach, worlds)
    return qpos.astype(np.float32)


def place(model: mujoco.MjModel, worlds: int, device: str) -> tuple[Any, Any]:
    """MuJoCo Warp's model and data with all geoms and cameras where random joints put them."""
    import mujoco_warp as mjw

    host = mujoco.MjData(model)
    mujoco.mj_forward(model, host)
    with wp.ScopedDevice(device):
        m, data = mjw.put_model(model), mjw.put_data(model, host, nworld=worlds)
        data.qpos.assign(random_joints(model, worlds))
        mjw.kinematics(m, data)
        mjw.com_pos(m, data)
        mjw.camlight(m, data)
    return m, data


def compare(path: Path, camera: str, worlds: int, size: int, tolerance: float, device: str) -> dict[str, Any]:
    """Seconds a call of each, and how far their depth agrees."""
    import mujoco_warp as mjw

    model = mujoco.MjModel.from_xml_path(str(path))
    m, data = place(model, worlds, device)
    options: dict[str, Any] = {"geom_groups": _GROUPS, "tolerance": tolerance, "device": device}
    batch = BatchRenderer(model, worlds, height=size, width=size, **options)
    views = batch.render(data, cameras=camera)
    eighth = np.arange(0, worlds, 8)
    some = batch.render(data, cameras=camera, worlds=eighth)
    with wp.ScopedDevice(device):
        context = mjw.create_render_context(
            model,
            nworld=worlds,
            cam_res=(size, size),
            render_rgb=False,
            render_depth=True,
            render_seg=False,
            use_textures=False,
            enabled_geom_groups=list(_GROUPS),
            cam_active=[camera],
        )

    def theirs() -> None:
        mjw.refit_bvh(m, data, context)
        mjw.render(m, data, context)

    calls = {
        "warpvis": lambda: batch.render(data, cameras=camera, out=views),
        "warpvis, one world in eight": lambda: batch.render(data, cameras=camera, worlds=eighth, out=some),
        "MuJoCo Warp": theirs,
        "MuJoCo Warp, render alone": lambda: mjw.render(m, data, context),
    }
    seconds = measure(calls, device)
    ours, other = views.depth.numpy(), context.depth_data.numpy().reshape(worlds, size, size)
    both = np.isfinite(ours) & (other > 0)
    seconds["triangles"] = batch.scene.triangle_count
    seconds["hit by both or neither"] = float(np.mean((ours < np.inf) == (other > 0)))  # -inf: hit, but too near
    seconds["median difference"] = float(np.median(np.abs(ours - other)[both]))
    return seconds


def measure(calls: dict[str, Any], device: str) -> dict[str, Any]:
    """Median seconds of each call as a graph, in turns."""
    timer = WarpTimer(wp.get_device(device))
    graphs: dict[str, Any] = {}
    for name, call in calls.items():
        with wp.ScopedDevice(device):
            call()
            call()
        graphs[name] = timer.record(call)
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(_ROUNDS):
        for name, graph in graphs.items():
            times[name].append(timer.device_seconds(graph, 2))
    return {name: float(np.median(found)) for name, found in times.items()}


def default_model() -> Path:
    """MuJoCo Warp's aloha_pot: 204 geoms, 134 meshes, 6 cameras."""
    spec = importlib.util.find_spec("mujoco_warp")
    if spec is None or spec.origin is None:
        raise SystemExit("gpu_worlds.py: mujoco_warp is not installed")
    return Path(spec.origin).parent / "test_data" / "aloha_pot" / "scene.xml"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", type=Path)
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 128])
    parser.add_argument("--cameras", nargs="*", default=[])
    parser.add_argument("--tolerance", type=float, default=DEFAULT_TOLERANCE, help="of round shapes, in metres")
    parser.add_argument("--device", default="cuda:0")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    print("| model, camera, size | warpvis | one world in eight | MuJoCo Warp | render alone | times as fast | agree |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | --- |")
    for path in options.models or [default_model()]:
        names = [camera.name for camera in mujoco.MjSpec.from_file(str(path)).cameras]
        for camera in [name for name in options.cameras if name in names] or names[:1]:
            for size in options.sizes:
                found = compare(path, camera, options.worlds, size, options.tolerance, options.device)
                ours, theirs = found["warpvis"], found["MuJoCo Warp"]
                part, alone = found["warpvis, one world in eight"], found["MuJoCo Warp, render alone"]
                print(
                    f"| {path.parent.name}/{path.name}, {camera}, {size}x{size} | {1e3 * ours:.3f} ms | "
                    f"{1e3 * part:.3f} ms ({part / ours:.2f}) | {1e3 * theirs:.3f} ms | {1e3 * alone:.3f} ms | "
                    f"{theirs / ours:.1f}x | {100 * found['hit by both or neither']:.2f} %, "
                    f"{1e3 * found['median difference']:.3f} mm, {found['triangles']} triangles |",
                    flush=True,
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
