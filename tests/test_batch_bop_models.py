# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Models of BOP datasets: normals, diameters and PLY text."""

import json

import numpy as np
import pytest
import trimesh
from batch_jobs import make_frames, run

import warpvis as wv


def test_normals_are_weighted_by_angles(tmp_path):
    """All vertices of a cube are equivalent, regardless of how its sides are triangulated."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((2, 2, 2)), name="box", label="object")
    run(tmp_path / "out", scene=scene, frames=make_frames(1), format="bop")
    lines = (tmp_path / "out" / "models" / "obj_000001.ply").read_text().splitlines()
    rows = np.array([line.split() for line in lines[12:20]], dtype=np.float64)
    assert np.abs(rows[:, :3]).tolist() == [[1000] * 3] * 8
    assert np.abs(rows[:, 3:] - rows[:, :3] / np.sqrt(3) / 1000).max() < 1e-7
    assert lines[:3] == ["ply", "format ascii 1.0", "element vertex 8"] and len(lines) == 12 + 8 + 12


def diameter(points, folder):
    """Return the diameter [m] of a mesh with these vertices, and the largest distance between them."""
    count = len(points)
    faces = [[max(0, k - 2), max(0, k - 1), k] for k in range(count)]
    scene = wv.Scene()
    scene.add((points, faces), name="a", label="object")
    run(folder, scene=scene, frames=make_frames(1), format="bop")
    info = json.loads((folder / "models" / "models_info.json").read_text())["1"]
    points = points.astype(np.float32).astype(np.float64)
    return info["diameter"] / 1000, np.linalg.norm(points[:, None] - points, axis=2).max()


@pytest.mark.smoke("[1237]", "700")
@pytest.mark.filterwarnings("ignore:1 of 1 frame sees nothing")
@pytest.mark.parametrize("count", [1, 2, 3, 700, 1500])
def test_diameter_is_the_largest_distance(count, tmp_path):
    found, expected = diameter(np.random.default_rng(count).normal(size=(count, 3)) * [1, 2, 3], tmp_path / "out")
    assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.filterwarnings("ignore:1 of 1 frame sees nothing")
def test_diameter_of_points_that_are_not_the_outermost(tmp_path):
    """Many points in a corner of the box, and two near other corners that are farther apart."""
    corner = np.random.default_rng(0).uniform(0, 1e-3, (700, 3))
    points = np.concatenate([[[0.05, 1, 0], [2, 0.05, 0], [0, 0, 0]], corner])
    found, expected = diameter(points, tmp_path / "out")
    assert found == pytest.approx(expected, rel=1e-12) and found == pytest.approx(np.hypot(1.95, 0.95), rel=1e-7)
