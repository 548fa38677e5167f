# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define workloads that build acceleration structures on a GPU and refit them, against `wp.Mesh`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np
import trimesh
import warp as wp
from gpu_timing import LatencyTimer
from gpu_work import timer_of
from ratios import Contest, Workload

import warpvis as wv
from warpvis.scene.acceleration.bvh_cuda import build_device_bvh
from warpvis.scenes import terrain

Mesh = tuple[np.ndarray, np.ndarray]

SUBDIVISIONS = 8
_SIDE = 2237  # vertices along a side of the ground: 10 M triangles


@cache
def ball() -> Mesh:
    """Return vertices and faces of 1.3 million triangles."""
    mesh = trimesh.creation.icosphere(subdivisions=SUBDIVISIONS)
    return np.float32(mesh.vertices), np.int32(mesh.faces)


def begin(device: str) -> wv.Scene:
    """A ball that has begun to deform, without acceleration structures yet."""
    scene = wv.Scene(device=device)
    scene.add(ball(), name="ball", movable=True)
    scene.update_vertices("ball", ball()[0])
    return scene


build = cache(begin)


def refit_of(built: Callable[[wv.Scene], Any], scene: wv.Scene) -> Callable[[], None]:
    """Return the refit of one caster's acceleration structure."""
    return built(scene).refits[0].refit


def builders_of_a_gpu(mesh: Mesh, device: wp.Device) -> dict[str, Callable[[], object]]:
    """Return builders for a mesh on a GPU by name."""
    vertices = wp.array(mesh[0], dtype=wp.vec3, device=device)
    faces = wp.array(mesh[1], dtype=wp.int32, device=device)
    owner, closed = wp.zeros(len(faces), dtype=wp.int32, device=device), wp.ones(1, dtype=wp.uint8, device=device)
    indices = faces.flatten()

    def build() -> None:
        build_device_bvh(vertices, faces, owner, closed, device, max_levels=8)
        wp.synchronize_device(device)

    def build_warp(constructor: str) -> None:
        wp.Mesh(vertices, indices, bvh_constructor=constructor)
        wp.synchronize_device(device)

    names = ("cubql", "lbvh")
    return {"warpvis": build, **{f"`wp.Mesh`, {name}": lambda name=name: build_warp(name) for name in names}}


def workloads(device: wp.Device) -> Iterator[Workload]:
    """Yield builds and a refit against `wp.Mesh`."""

    def prepare_build(mesh: Callable[[], Mesh]) -> Contest:
        builders = builders_of_a_gpu(mesh(), device)
        for build in builders.values():
            build()
        ours, *peers = builders.values()
        return Contest(ours, {"wp.Mesh": peers}, LatencyTimer(timer_of(device)))

    def prepare_refit() -> Contest:
        bvh, mesh = (refit_of(built, build(str(device))) for built in (wv.Scene.bvh, wv.Scene.triangles))
        return Contest(bvh, {"wp.Mesh": [mesh]}, timer_of(device), with_graphs=True)

    yield Workload("tree of a ball refitted", prepare_refit)
    yield Workload("tree of a ball built", partial(prepare_build, ball))
    yield Workload("tree of the ground built", partial(prepare_build, partial(terrain.ground, _SIDE)))
