# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure how long a scene's acceleration structure takes to build, which its first view waits for.

``python bench/bench_bvh.py`` alternates between building BVHs of fine ground with warpvis and with Embree, through
Open3D and Mitsuba. It prints wall time and the CPU time of all cores, which depends less on other processes. With
``--device cuda:0`` it builds them on a GPU and compares with `wp.Mesh`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import pytest
import warp as wp
from gpu_trees import Mesh, ball, builders_of_a_gpu

import warpvis as wv
from warpvis.scene.acceleration.bvh import build_bvh
from warpvis.scenes import terrain

NAMES = ["experiment_3", "room", "blobs_77k", "blobs_1m"]


def rounds(scene):
    return 5 if scene.triangle_count > 500_000 else 50


@pytest.mark.benchmark(group="tree")
@pytest.mark.parametrize("build", [wv.Scene.bvh, wv.Scene.triangles], ids=["bvh", "triangles"])
@pytest.mark.parametrize("name", NAMES)
def test_build(benchmark, scene_of, name, build):
    scene = scene_of(name)

    def without_tree():
        return (scene.to(scene.device),), {}

    benchmark.pedantic(build, setup=without_tree, rounds=rounds(scene), warmup_rounds=1)
    benchmark.extra_info["triangles"] = scene.triangle_count


@pytest.mark.benchmark(group="tree")
@pytest.mark.parametrize("lanes", [16, 32])
@pytest.mark.parametrize("name", NAMES)
def test_lanes(benchmark, scene_of, name, lanes):
    """Build the BVH alone, with the width that the casters on the CPU and on CUDA use."""
    scene = scene_of(name)
    first = np.cumsum([0] + [len(item.vertices) for item in scene.objects])
    vertices = np.concatenate([item.vertices for item in scene.objects])
    faces = np.concatenate([item.faces + start for item, start in zip(scene.objects, first, strict=False)])
    owner = np.repeat(np.arange(len(scene)), [len(item.faces) for item in scene.objects])
    arguments = (vertices, faces, owner, np.ones(len(scene), dtype=bool))
    benchmark.pedantic(build_bvh, arguments, {"lanes": lanes}, rounds=rounds(scene), warmup_rounds=1)
    benchmark.extra_info["triangles"] = scene.triangle_count


def builders_of_the_host(mesh: Mesh) -> dict[str, Callable[[], object]]:
    """Return builders of a mesh's BVH by name. Peers cast a first ray, because they build at the first cast."""
    import drjit as dr
    import mitsuba as mi
    import open3d as o3d

    vertices, faces = mesh
    scene = wv.Scene()
    scene.add(mesh)
    owner, closed = np.zeros(len(faces), dtype=np.int32), np.array([False])
    corners, indices = o3d.core.Tensor(vertices), o3d.core.Tensor(faces.astype(np.uint32))
    ray = o3d.core.Tensor(np.float32([[0, 0, 100, 0, 0, -1]]))
    mi.set_variant("llvm_ad_rgb")
    shape = mi.Mesh("ground", len(vertices), len(faces))
    parameters = mi.traverse(shape)
    parameters["vertex_positions"], parameters["faces"] = vertices.ravel(), faces.ravel().astype(np.uint32)
    parameters.update()

    def open3d() -> None:
        peer = o3d.t.geometry.RaycastingScene()
        peer.add_triangles(corners, indices)
        peer.cast_rays(ray)

    def mitsuba() -> None:
        peer = mi.load_dict({"type": "scene", "mesh": shape})
        dr.eval(peer.ray_intersect_preliminary(mi.Ray3f(mi.Point3f(0, 0, 100), mi.Vector3f(0, 0, -1))).t)
        dr.sync_thread()

    return {
        "warpvis, the tree": lambda: build_bvh(vertices, faces, owner, closed),
        "warpvis, `Scene.bvh()`": lambda: scene.to("cpu").bvh(),
        "Open3D": open3d,
        "Mitsuba": mitsuba,
    }


def main() -> None:
    """Print the minimum and the median time of each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--side", type=int, default=2237, help="corners along a side of the ground: 10 M triangles")
    arguments = parser.parse_args()
    device = wp.get_device(arguments.device)
    meshes = {"ground": terrain.ground(arguments.side)}
    if not device.is_cpu:
        meshes["ball"] = ball()
    for title, mesh in meshes.items():
        builders = builders_of_the_host(mesh) if device.is_cpu else builders_of_a_gpu(mesh, device)
        times: dict[str, list[tuple[float, float]]] = {name: [] for name in builders}
        for build in builders.values():
            build()
        for _ in range(arguments.rounds):
            for name, build in builders.items():
                start = time.perf_counter(), time.process_time()
                build()
                times[name].append((time.perf_counter() - start[0], time.process_time() - start[1]))
        print(f"{title}: {len(mesh[1]):,} triangles, {device.name}")
        for name, rows in times.items():
            fastest, median = np.min(rows, axis=0), np.median(rows, axis=0)
            print(
                f"{name:24s} {1e3 * fastest[0]:8.1f} ms at the least, {1e3 * median[0]:8.1f} the median; "
                f"of all cores together {1e3 * fastest[1]:8.1f} and {1e3 * median[1]:8.1f}"
            )


if __name__ == "__main__":
    main()
