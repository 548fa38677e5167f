# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure the visibility of a million points by `point_visibility` and by Open3D's `test_occlusions`.

``python bench/bench_points.py`` alternates between both on the CPU and prints the median times. Then it counts, on five
scenes, the points whose result differs from embreex and from double precision, and those among them that are more than
a micrometer from the limit.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from exact_points import MARGIN, hidden_points, is_sure
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.threads import core_count

CAMERA = wv.Camera.from_fov(640, 480, hfov=1.0)
SCENE = "blobs_77k"
POINTS = 1_000_000
MIN_TIMES = 5.0
"""Minimum speed of `point_visibility` relative to Open3D if all points are in view."""

SCENES = ("room", "experiment_1", "experiment_3", "experiment_4", "blobs_77k")
TOO_MANY = "blobs_1m"
"""Testing every triangle of this scene takes a quarter of an hour: it is compared with embreex only."""
VIEWS = 2


@cache
def build(name: str) -> wv.Scene:
    """Return the scene of a preset."""
    return wv.scenes.PRESETS[name].build()


def pose_of(name: str, view: int = 0, views: int = 1) -> NDArray[np.float32]:
    """Return one camera pose of a preset, as one row."""
    return wv.scenes.PRESETS[name].poses(views)[view : view + 1].astype(np.float32)


def random_points(scene: wv.Scene, count: int) -> NDArray[np.float32]:
    """Return random points within the bounds of the scene."""
    return np.random.default_rng(0).uniform(*scene.bounds, (count, 3)).astype(np.float32)


def surface_points(scene: wv.Scene, count: int) -> NDArray[np.float32]:
    """Return random points on triangles."""
    rng, corners = np.random.default_rng(1), triangles(scene)
    chosen = corners[rng.integers(0, len(corners), count)]
    return np.einsum("nc,ncx->nx", rng.dirichlet((1, 1, 1), count), chosen).astype(np.float32)


def triangles(scene: wv.Scene) -> NDArray[np.float64]:
    """Return the corners of all triangles, shape ``(T, 3, 3)``."""
    return np.concatenate([item.vertices[item.faces] for item in scene.objects]).astype(np.float64)


def in_view(status: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return the points within the camera's range and image, whose visibility needs a ray."""
    return (status == wv.Visibility.OCCLUDED) | (status == wv.Visibility.VISIBLE)


@cache
def points_of(kind: str) -> NDArray[np.float32]:
    """Return a million points within the bounds of the scene, or only those of them in view."""
    scene, everywhere = build(SCENE), random_points(build(SCENE), POINTS)
    if kind == "everywhere":
        return everywhere
    seen = everywhere[in_view(wv.point_visibility(scene, CAMERA, pose_of(SCENE), everywhere).numpy()[0])]
    return np.resize(seen, (POINTS, 3))


def check(kind: str, **options: Any) -> Callable[[], Any]:
    """Return the call to measure."""
    scene, pose, points = build(SCENE), pose_of(SCENE), points_of(kind)
    return lambda: wv.point_visibility(scene, CAMERA, pose, points, **options)


@pytest.mark.benchmark(group="points")
@pytest.mark.parametrize("kind", ["everywhere", "in view"])
@pytest.mark.parametrize("occluders", [False, True], ids=["status", "occluders"])
def test_points(benchmark, kind, threads, occluders):
    benchmark.pedantic(check(kind, threads=threads, occluders=occluders), rounds=20, warmup_rounds=2)
    benchmark.extra_info["points"] = POINTS


@pytest.mark.benchmark(group="points")
def test_many_views(benchmark, threads):
    """Measure a hundred points in each of a thousand views."""
    poses, points = wv.scenes.PRESETS[SCENE].poses(1000), points_of("everywhere")[:100]
    run = (build(SCENE), CAMERA, poses, points)
    benchmark.pedantic(wv.point_visibility, run, {"threads": threads}, rounds=5, warmup_rounds=1)
    benchmark.extra_info["views"] = len(poses)


def open3d(points: NDArray[np.float32]) -> Callable[[], Any]:
    """Return Open3D's occlusion test of the same points on all cores, with rays made in advance."""
    import open3d as o3d

    caster = o3d.t.geometry.RaycastingScene(nthreads=core_count())
    for item in build(SCENE):
        caster.add_triangles(item.vertices, item.faces.astype(np.uint32))
    eye = pose_of(SCENE)[:, :3]
    rays = o3d.core.Tensor(np.concatenate([np.broadcast_to(eye, points.shape), points - eye], axis=1))
    return lambda: caster.test_occlusions(rays, tnear=0.0, tfar=1.0)


def compare(rounds: int) -> None:
    """Print both times, and the speed of `point_visibility` relative to Open3D."""
    from timing import take_turns

    try:
        import open3d as _  # noqa: F401
    except ImportError:
        print("open3d is not installed: nothing to compare with")
        return
    everywhere, seen = points_of("everywhere"), points_of("in view")
    share = in_view(check("everywhere")().numpy()[0])
    rows = (
        ("a million points in the scene's bounds", check("everywhere"), open3d(everywhere)),
        (f"Open3D only those in view, {share.sum():,}", check("everywhere"), open3d(everywhere[share])),
        ("a million points in view", check("in view"), open3d(seen)),
    )
    for title, warpvis_call, open3d_call in rows:
        warpvis_call(), open3d_call()
        times = [np.median(column) for column in take_turns([warpvis_call, open3d_call], rounds)]
        print(
            f"{title}: {1e3 * times[0]:.1f} ms, Open3D {1e3 * times[1]:.1f} ms: {times[1] / times[0]:.1f} times as fast"
        )
    reached = times[1] >= MIN_TIMES * times[0]
    print(f"at least {MIN_TIMES:g} times where all are in view: {'reached' if reached else 'MISSED'}")


def judged_by_embree(name: str) -> Callable[..., NDArray[np.bool_]]:
    """Return embreex's occlusion of points: whether a triangle is between the eye and the point, less a tolerance."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    embree = EmbreeScene(robust=True)
    TriangleMesh(embree, triangles(build(name)).astype(np.float32))

    def judge(pose: NDArray[np.float32], points: NDArray[np.float32], tolerance: NDArray[np.float64]) -> Any:
        way = np.linalg.norm(points - pose[:3], axis=1)
        rays = (np.tile(pose[:3], (len(points), 1)), (points - pose[:3]) / way[:, None])
        return np.asarray(embree.run(*rays, dists=(way - tolerance).astype(np.float32), query="OCCLUDED")) != -1

    return judge


def judged_exactly(name: str) -> Callable[..., NDArray[np.bool_]]:
    """Return occlusion in double precision, by every triangle that may be in the way."""
    corners = triangles(build(name))
    return lambda pose, points, tolerance: hidden_points(corners, CAMERA, pose, points, tolerance)


def disagreements(name: str, judge: Callable[..., NDArray[np.bool_]]) -> tuple[int, int, int]:
    """Count points in view of all cameras, those with another result, and those of them that are clearly wrong."""
    scene = build(name)
    corners = triangles(scene)
    random, surface = random_points(scene, 200_000), surface_points(scene, 20_000)
    counts = np.zeros(3, dtype=int)
    for view in range(VIEWS):
        pose = pose_of(name, view, VIEWS)
        for points, allowed in ((random, 0.0), (surface, 1e-4)):
            status = wv.point_visibility(scene, CAMERA, pose, points, tolerance=allowed).numpy()[0]
            chosen, hidden_here = points[in_view(status)], status[in_view(status)] == wv.Visibility.OCCLUDED
            other = np.flatnonzero(hidden_here != judge(pose[0], chosen, np.full(len(chosen), allowed)))
            eye = pose[0, :3].astype(np.float64)
            exact = [is_sure(corners, eye, chosen[i].astype(np.float64), allowed) for i in other]
            wrong = [sure and hidden != hidden_here[i] for i, (hidden, sure) in zip(other, exact, strict=True)]
            counts += [len(chosen), len(other), sum(wrong)]
    return int(counts[0]), int(counts[1]), int(counts[2])


def main() -> None:
    """Print times and differences."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    compare(arguments.rounds)
    for name in (*SCENES, TOO_MANY):
        judges = {"embreex": judged_by_embree(name), "double precision": judged_exactly(name)}
        for judge_name, judge in list(judges.items())[: 1 if name == TOO_MANY else None]:
            count, other, wrong = disagreements(name, judge)
            print(
                f"{name}: of 200,000 random points and 20,000 of surfaces, {count:,} in view of {VIEWS} cameras, "
                f"{other} judged otherwise by {judge_name}; wrong here by more than {MARGIN:g} m: {wrong}"
            )


if __name__ == "__main__":
    main()
