# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure worlds of many moving boxes, spheres, capsules, cylinders and ellipsoids against MuJoCo Warp's renderer.

    python bench/gpu_geoms.py [--cases GEOMS,WORLDS,SIZE ...]

Every body floats freely above a floor, at other positions in each world. A call moves all of them and renders depth of
one camera in all worlds, as in gpu_worlds.py. Prints a Markdown table with the agreement of the images.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import warp as wp
from gpu_worlds import Pair, Placed, measure
from numpy.typing import NDArray
from ratios import Contest, Workload

_CASES = (
    "10,4096,64",
    "10,256,512",
    "100,64,64",
    "100,2048,64",
    "100,128,512",
    "400,512,64",
    "1000,64,64",
    "1000,256,64",
)
_KINDS = ("box", "sphere", "capsule", "cylinder", "ellipsoid")
_SIZES = {"box": 3, "sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3}
_ROOM = 1.5  # half of its width [m]
_CAMERA = "overview"


def free_bodies(count: int) -> mujoco.MjModel:
    """Make a model of a floor, a camera above all of it, and bodies that cover about the same part of the image."""
    rng = np.random.default_rng(count)
    spec = mujoco.MjSpec()
    world = spec.worldbody
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2 * _ROOM, 2 * _ROOM, 0.1])
    world.add_camera(name=_CAMERA, pos=[0, -2.6 * _ROOM, 2.0 * _ROOM], xyaxes=[1, 0, 0, 0, 0.55, 0.83], fovy=50)
    reach = 0.6 * _ROOM / np.sqrt(count)
    for k in range(count):
        kind = _KINDS[k % len(_KINDS)]
        body = world.add_body()
        body.add_freejoint()
        size = np.zeros(3)
        size[: _SIZES[kind]] = reach * rng.uniform(0.3, 1.0, _SIZES[kind])
        body.add_geom(type=getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}"), size=size, contype=0, conaffinity=0)
    return spec.compile()


def scattered(model: mujoco.MjModel, worlds: int) -> NDArray[np.float32]:
    """Return joint positions, shape ``(worlds, nq)``: random positions in the room and random orientations."""
    rng = np.random.default_rng(1)
    rows = np.empty((worlds, model.nq // 7, 7), dtype=np.float32)
    rows[..., :2] = rng.uniform(-_ROOM, _ROOM, (*rows.shape[:2], 2))
    rows[..., 2] = rng.uniform(0.1, _ROOM, rows.shape[:2])
    rows[..., 3:] = rng.normal(size=(*rows.shape[:2], 4))
    rows[..., 3:] /= np.linalg.norm(rows[..., 3:], axis=-1, keepdims=True)
    return rows.reshape(worlds, -1)


def pair(geoms: int, worlds: int, size: int, device: str) -> Pair:
    """Set up both renderers of a model with this number of bodies."""
    model = free_bodies(geoms)
    return Pair(Placed.of(model, scattered(model, worlds), wp.get_device(device)), _CAMERA, size)


def compare(geoms: int, worlds: int, size: int, device: str) -> dict[str, Any]:
    """Return the time per call of each [s], and the agreement of their depth."""
    both = pair(geoms, worlds, size, device)
    seconds = measure({"warpvis": both.ours, "MuJoCo Warp": both.theirs}, device)
    seconds["hit by both or neither"], seconds["median difference"] = both.agreement()
    return seconds


def workloads(device: wp.Device, worlds: int | None = None) -> Iterator[Workload]:
    """Yield several of the cases."""
    for geoms, count, size in ((10, 4096, 64), (100, 2048, 64), (100, 128, 512), (1000, 64, 64)):

        def prepare(geoms: int = geoms, count: int = worlds or count, size: int = size) -> Contest:
            return pair(geoms, count, size, str(device)).contest()

        yield Workload(f"geoms {geoms} in {worlds or count} worlds {size}x{size}", prepare)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="+", default=_CASES, metavar="GEOMS,WORLDS,SIZE")
    parser.add_argument("--device", default="cuda:0")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    print("| geoms, worlds, image | warpvis | MuJoCo Warp | times as fast | agree |")
    print("| --- | ---: | ---: | ---: | --- |")
    for case in options.cases:
        geoms, worlds, size = (int(number) for number in case.split(","))
        found = compare(geoms, worlds, size, options.device)
        ours, theirs = found["warpvis"], found["MuJoCo Warp"]
        print(
            f"| {geoms}, {worlds}, {size}x{size} | {1e3 * ours:.3f} ms, {worlds / ours:,.0f} fps | "
            f"{1e3 * theirs:.3f} ms, {worlds / theirs:,.0f} fps | {theirs / ours:.2f}x | "
            f"{100 * found['hit by both or neither']:.2f} %, {1e3 * found['median difference']:.3f} mm |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
