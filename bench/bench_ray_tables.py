# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure ray bundles: a lidar scan against Open3D, a lens against a pinhole, distinct origins against one origin.

``python bench/bench_ray_tables.py`` alternates between them on the CPU, with the same rays, and prints the median times
of a view and their ratios. The scan has 1024 x 128 rays. Open3D's rays are made in advance, in the world frame, and its
results are compared first.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.core.threads import core_count

VIEWS = 8
MIN_TIMES = {"room": 12.0, "blobs_77k": 8.0, "blobs_1m": 4.0}
"""Minimum speed of a scan relative to Open3D."""
MAX_OF_ONE_ORIGIN = 2.0
"""Maximum time of an Ouster's revolution, whose origins differ, relative to one with a single origin."""
MAX_OF_PINHOLE = 1.3
"""Maximum time of a lens relative to a pinhole of the same size."""
TOLERANCE = 1e-3

_K = [[480.0, 0, 319.5], [0, 480.0, 239.5], [0, 0, 1]]
_COEFFICIENTS = [-0.28, 0.09, 0.001, -0.0005, 0.01, 0.02, 0.003, 0.001]


@cache
def cameras() -> dict[str, Any]:
    """Return a scan, a lens of eight coefficients and one of none, and an Ouster with and without offsets."""
    ouster = wv.sensors.lidars.ouster("OS1-128", near=0.3)
    return {
        "ouster": ouster,
        "one place": wv.cameras.Rays(ouster.directions, near=0.3, far=ouster.far),
        "scan": wv.cameras.WideCamera(1024, 128, 2 * math.pi),
        "lens": wv.Camera.from_opencv(_K, _COEFFICIENTS, 640, 480),
        "pinhole": wv.Camera.from_opencv(_K, None, 640, 480),
    }


@cache
def build(name: str) -> wv.Scene:
    """Return the scene of a preset."""
    return wv.scenes.PRESETS[name].build()


def render(name: str, camera: str, **options: Any) -> Callable[[], wv.Views]:
    """Return the call to measure, depth of all views; it was called once."""
    renderer = wv.Renderer(build(name), cameras()[camera], outputs="depth", **options)
    poses = wv.scenes.PRESETS[name].poses(VIEWS)
    views = renderer.render(poses)
    return lambda: renderer.render(poses, out=views)


@pytest.mark.benchmark(group="ray tables")
@pytest.mark.parametrize("camera", ["scan", "lens"])
def test_ray_tables(benchmark, camera, threads):
    benchmark.pedantic(render("blobs_77k", camera, threads=threads), rounds=7, iterations=5, warmup_rounds=1)
    benchmark.extra_info["views"] = VIEWS


def render_once(name: str) -> Callable[[], wv.Views]:
    """Return the same scan by a function that receives the pattern at every call."""
    scene, poses = build(name), wv.scenes.PRESETS[name].poses(VIEWS)
    return lambda: wv.rendering.render_wide(scene, 1024, 128, 2 * math.pi, poses)


def open3d(name: str) -> tuple[Callable[[], Any], Callable[[Any], NDArray]]:
    """Return a scan by Open3D's Embree on all cores, and a function that makes images of its ranges."""
    import open3d as o3d

    caster = o3d.t.geometry.RaycastingScene(nthreads=core_count())
    for item in build(name):
        caster.add_triangles(item.vertices, item.faces.astype(np.uint32))
    poses, rays = wv.scenes.PRESETS[name].poses(VIEWS), cameras()["scan"].rays
    directions = rays.reshape(1, -1, 3) @ poses_to_matrices(poses)[:, :3, :3].transpose(0, 2, 1)
    origins = np.broadcast_to(poses[:, None, :3], directions.shape)
    tensor = o3d.core.Tensor(np.concatenate([origins, directions], axis=-1).astype(np.float32))
    return lambda: caster.cast_rays(tensor), lambda result: result["t_hit"].numpy().reshape(-1, *rays.shape[:2])


def compare(name: str, rounds: int) -> None:
    """Print the time of a view, and the ratios of the others to it."""
    from timing import take_turns

    names = ("scan", "lens", "pinhole", "ouster", "one place")
    calls = [*(render(name, camera) for camera in names), render(name, "ouster", caster="rays"), render_once(name)]
    calls[-1]()
    peer, images = open3d(name)
    depth, peer_depth = calls[0]().depth.numpy(), images(peer())
    with np.errstate(invalid="ignore"):
        same = (depth == peer_depth) | (np.abs(depth - peer_depth) <= TOLERANCE * np.maximum(1, peer_depth))
    times = [1e3 / VIEWS * float(np.median(column)) for column in take_turns([*calls, peer], rounds)]
    scan, lens, pinhole, ouster, one_place, single, wide, theirs = times
    print(
        f"{name}: scan {scan:.3f} ms, Open3D {theirs:.3f} ms ({same.mean():.4%} of rays alike): {theirs / scan:.1f} "
        f"times as fast, {_reached(theirs / scan >= MIN_TIMES[name])} ({MIN_TIMES[name]:g})"
    )
    print(f"{name}: scan by render_wide {wide:.3f} ms: {theirs / wide:.1f} times as fast as Open3D")
    print(
        f"{name}: lens {lens:.3f} ms, pinhole {pinhole:.3f} ms: {lens / pinhole:.2f} of its time, "
        f"{_reached(lens / pinhole <= MAX_OF_PINHOLE)} ({MAX_OF_PINHOLE:g})"
    )
    print(
        f"{name}: Ouster {ouster:.3f} ms, from one place {one_place:.3f} ms: {ouster / one_place:.2f} of its time, "
        f"{_reached(ouster / one_place <= MAX_OF_ONE_ORIGIN)} ({MAX_OF_ONE_ORIGIN:g}); {single / ouster:.1f} times as "
        "fast as ray by ray"
    )


def _reached(reached: bool) -> str:
    return "reached" if reached else "MISSED"


def main() -> None:
    """Print times and ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--scenes", nargs="+", default=list(MIN_TIMES), choices=list(MIN_TIMES))
    arguments = parser.parse_args()
    try:
        import open3d as _  # noqa: F401
    except ImportError:
        print("open3d is not installed: nothing to compare with")
        return
    for name in arguments.scenes:
        compare(name, arguments.rounds)


if __name__ == "__main__":
    main()
