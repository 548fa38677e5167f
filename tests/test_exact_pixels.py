# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets against all triangles in double precision: rays through vertices and edges, past slivers, along planes.

`bench/exact_pixels.py` does the same with as many pixels as time allows.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from corner_walls import wall

import warpvis as wv
from warpvis.core.poses import poses_to_matrices

sys.path.append(str(Path(__file__).resolve().parent.parent / "bench"))

from exact_pixels import EDGE, Check
from exact_scenes import FAMILIES


@pytest.mark.smoke("*-random", "*-closed", "*-corners")
@pytest.mark.parametrize("family", FAMILIES)
def test_every_pixel_shows_the_nearest_triangle(family, device):
    check = Check(str(device), "packets", 1 << 15)
    for seed in range(4):
        check.run(family, seed)
    assert check.pixels[family] > 1e5
    assert not check.more[family]
    assert [wrong for wrong in check.wrong[family] if wrong.edge > EDGE] == []
    assert [wrong for wrong in check.wrong[family] if wrong.kind == "hole"] == []


def test_wrong_pixels_are_detected(device):
    """Checks the benchmark: a slightly displaced image is recognized as wrong."""
    check = Check(str(device), "packets", 1 << 12)
    case = FAMILIES["closed"](np.random.default_rng(0), 40, 30, 2)
    depth = wv.render(case.scene(str(device)), case.camera, case.poses, outputs=("depth",)).depth
    assert len(check._compare(case, poses_to_matrices(case.poses), depth)) == 0
    case.poses[:, :3] += 1e-3
    assert len(check._compare(case, poses_to_matrices(case.poses), depth)) > 100


@pytest.mark.smoke("*-movable")
@pytest.mark.parametrize("movable", [False, True], ids=["still", "movable"])
def test_no_ray_passes_through_a_vertex(movable, device):
    holes = 0
    for seed in range(30):
        camera, pose, vertices, faces = wall(seed)
        scene = wv.Scene(device=device)
        scene.add((vertices, faces), movable=movable)
        depth = wv.render(scene, camera, pose, outputs=("depth",), caster="packets").depth.numpy()
        holes += np.count_nonzero(~np.isfinite(depth))
    assert holes == 0


def test_no_ray_to_a_point_passes_through_a_vertex():
    """Image points, and world points behind the wall, which a GPU tests by single rays."""
    seen_through = visible = 0
    for seed in range(30):
        camera, pose, vertices, faces = wall(seed)
        scene = wv.Scene()
        scene.add((vertices, faces))
        matrix = poses_to_matrices(pose)
        local = (vertices.astype(np.float64) - matrix[:3, 3]) @ matrix[:3, :3]
        inside = (np.abs(local[:, :2]) < 0.19 * local[:, 2:]).all(axis=1)
        pixels = (camera.project(local[inside])).astype(np.float32)
        depth = wv.Renderer(scene, camera, outputs=("depth",), caster="packets").render_at(pose, pixels[None]).depth
        seen_through += np.count_nonzero(~np.isfinite(depth.numpy()))
        behind = (matrix[:3, 3] + (local[inside] * 1.5) @ matrix[:3, :3].T).astype(np.float32)
        status = wv.point_visibility(scene, camera, pose, behind).numpy()
        visible += np.count_nonzero(status != wv.Visibility.OCCLUDED)
    assert (seen_through, visible) == (0, 0)
