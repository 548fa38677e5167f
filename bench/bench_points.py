# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visibility of a million points: `check_points` beside Open3D's `RaycastingScene.test_occlusions`, and right or wrong.

``python bench/bench_points.py`` lets both take turns on the CPU and says the median times, and then counts the points
that embreex judges otherwise, on five scenes: all of them, and those where that is not a matter of a micrometre.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import warpvis as wv
from warpvis.threads import core_count

CAMERA = wv.Camera.from_fov(640, 480, hfov=1.0)
SCENE = "blobs_77k"
POINTS = 1_000_000
LEAST_TIMES = 5.0
"""`check_points` is at least this many times as fast as Open3D where all points are in view."""

SCENES = ("room", "experiment_1", "experiment_3", "blobs_77k", "blobs_1m")
VIEWS = 2
MARGIN = 1e-6
"""Rays that pass by an edge this near, and points that are this near to being hidden, or seen [m]."""

_DIRECTIONS = 8


@cache
def build(name: str) -> wv.Scene:
    """A preset's scene."""
    return wv.scenes.PRESETS[name].build()


def pose_of(name: str, view: int = 0, views: int = 1) -> NDArray[np.float32]:
    """One of a preset's camera poses, one row."""
    return wv.scenes.PRESETS[name].poses(views)[view : view + 1].astype(np.float32)


def random_points(scene: wv.Scene, count: int) -> NDArray[np.float32]:
    """Points in the scene's bounds."""
    return np.random.default_rng(0).uniform(*scene.bounds, (count, 3)).astype(np.float32)


def surface_points(scene: wv.Scene, count: int) -> NDArray[np.float32]:
    """Points of triangles."""
    rng, corners = np.random.default_rng(1), triangles(scene)
    chosen = corners[rng.integers(0, len(corners), count)]
    return np.einsum("nc,ncx->nx", rng.dirichlet((1, 1, 1), count), chosen).astype(np.float32)


def triangles(scene: wv.Scene) -> NDArray[np.float64]:
    """Corners of all triangles, shape ``(T, 3, 3)``."""
    return np.concatenate([item.vertices[item.faces] for item in scene.objects]).astype(np.float64)


def in_view(status: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Points whose rays say whether they are seen."""
    return (status == wv.Visibility.OCCLUDED) | (status == wv.Visibility.VISIBLE)


@cache
def points_of(kind: str) -> NDArray[np.float32]:
    """A million points in the scene's bounds, or as many of those that are in view."""
    scene, everywhere = build(SCENE), random_points(build(SCENE), POINTS)
    if kind == "everywhere":
        return everywhere
    seen = everywhere[in_view(wv.check_points(scene, CAMERA, pose_of(SCENE), everywhere).numpy()[0])]
    return np.resize(seen, (POINTS, 3))


def check(kind: str, **options: Any) -> Callable[[], Any]:
    """The call to measure."""
    scene, pose, points = build(SCENE), pose_of(SCENE), points_of(kind)
    return lambda: wv.check_points(scene, CAMERA, pose, points, **options)


@pytest.mark.benchmark(group="points")
@pytest.mark.parametrize("kind", ["everywhere", "in view"])
@pytest.mark.parametrize("occluders", [False, True], ids=["status", "occluders"])
def test_points(benchmark, kind, threads, occluders):
    benchmark.pedantic(check(kind, threads=threads, occluders=occluders), rounds=20, warmup_rounds=2)
    benchmark.extra_info["points"] = POINTS


@pytest.mark.benchmark(group="points")
def test_many_views(benchmark, threads):
    """A hundred points in each of a thousand views."""
    poses, points = wv.scenes.PRESETS[SCENE].poses(1000), points_of("everywhere")[:100]
    run = (build(SCENE), CAMERA, poses, points)
    benchmark.pedantic(wv.check_points, run, {"threads": threads}, rounds=5, warmup_rounds=1)
    benchmark.extra_info["views"] = len(poses)


def open3d(points: NDArray[np.float32]) -> Callable[[], Any]:
    """Open3D's Embree on all cores: whether anything is between the camera and each point. Making rays is not timed."""
    import open3d as o3d

    caster = o3d.t.geometry.RaycastingScene(nthreads=core_count())
    for item in build(SCENE):
        caster.add_triangles(item.vertices, item.faces.astype(np.uint32))
    eye = pose_of(SCENE)[:, :3]
    rays = o3d.core.Tensor(np.concatenate([np.broadcast_to(eye, points.shape), points - eye], axis=1))
    return lambda: caster.test_occlusions(rays, tnear=0.0, tfar=1.0)


def compare(rounds: int) -> None:
    """Print how long both take, and how many times as fast `check_points` is."""
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
    for title, own, other in rows:
        own(), other()
        times = [np.median(column) for column in take_turns([own, other], rounds)]
        print(
            f"{title}: {1e3 * times[0]:.1f} ms, Open3D {1e3 * times[1]:.1f} ms: {times[1] / times[0]:.1f} times as fast"
        )
    reached = times[1] >= LEAST_TIMES * times[0]
    print(f"at least {LEAST_TIMES:g} times where all are in view: {'reached' if reached else 'MISSED'}")


def hides(corners: NDArray, eye: NDArray, end: NDArray) -> bool:
    """Whether a triangle is between two places, in double precision, by looking at every one of them."""
    a, b, c = (corners - eye).swapaxes(0, 1)
    ray, normal = end - eye, np.cross(b - a, c - a)
    sides = np.stack([np.cross(p, q) @ ray for p, q in ((a, b), (b, c), (c, a))])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (normal * a).sum(axis=1) / (normal @ ray)
    return bool(((sides >= 0).all(axis=0) | (sides <= 0).all(axis=0))[(at > 0) & (at < 1)].any())


def is_sure(corners: NDArray, eye: NDArray, point: NDArray, tolerance: float) -> tuple[bool, bool]:
    """Whether a point is hidden, and whether it would be as well from a margin beside the ray, or so much along it."""
    along = (point - eye) / np.linalg.norm(point - eye)
    right = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    right /= np.linalg.norm(right)
    down, end = np.cross(along, right), point - tolerance * along
    turns = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    beside = MARGIN * (np.outer(np.cos(turns), right) + np.outer(np.sin(turns), down))
    hidden = hides(corners, eye, end)
    others = [hides(corners, eye + step, end + step) for step in beside]
    others += [hides(corners, eye, end + step * along) for step in (-MARGIN, MARGIN)]
    return hidden, all(other == hidden for other in others)


def disagreements(name: str, points: NDArray[np.float32], tolerance: float) -> tuple[int, int, int, int]:
    """Points in view, those that embreex judges otherwise, those of them that are sure, and those wrong here."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = build(name)
    corners, embree = triangles(scene), EmbreeScene(robust=True)
    TriangleMesh(embree, corners.astype(np.float32))
    counts = np.zeros(4, dtype=int)
    for view in range(VIEWS):
        pose = pose_of(name, view, VIEWS)
        status = wv.check_points(scene, CAMERA, pose, points, tolerance=tolerance).numpy()[0]
        chosen = points[in_view(status)]
        eye, own = pose[0, :3], status[in_view(status)] == wv.Visibility.OCCLUDED
        way = np.linalg.norm(chosen - eye, axis=1)
        rays = (np.tile(eye, (len(chosen), 1)), (chosen - eye) / way[:, None])
        found = np.asarray(embree.run(*rays, dists=(way - tolerance).astype(np.float32), query="OCCLUDED")) != -1
        other = np.flatnonzero(own != found)
        exact = [is_sure(corners, eye.astype(np.float64), chosen[i].astype(np.float64), tolerance) for i in other]
        sure = np.array([certain for _, certain in exact], dtype=bool)
        wrong = np.array([hidden for hidden, _ in exact], dtype=bool) != own[other]
        counts += [len(chosen), len(other), sure.sum(), (sure & wrong).sum()]
    return tuple(counts.tolist())


def main() -> None:
    """Print times and disagreements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    compare(arguments.rounds)
    for name in SCENES:
        scene = build(name)
        kinds = (("random", random_points(scene, 200_000), 0.0), ("surface", surface_points(scene, 20_000), 1e-4))
        for kind, points, tolerance in kinds:
            count, other, sure, wrong = disagreements(name, points, tolerance)
            print(
                f"{name}, {kind} points: {count:,} in view of {VIEWS} cameras, {other} judged otherwise by embreex, "
                f"{sure} of them by more than {MARGIN:g} m, {wrong} of these wrong here"
            )


if __name__ == "__main__":
    main()
