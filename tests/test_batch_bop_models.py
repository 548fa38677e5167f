# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Models of BOP datasets: normals, diameters and PLY text."""

import numpy as np
import pytest
import trimesh

from warpvis.batch.formats._bop_models import diameter, ply_text, vertex_normals


def test_normals_are_weighted_by_angles():
    """All vertices of a cube are equivalent, regardless of how its sides are triangulated."""
    box = trimesh.creation.box((2, 2, 2))
    assert np.abs(vertex_normals(box.vertices, box.faces) - box.vertices / np.sqrt(3)).max() < 1e-12
    lines = ply_text(box.vertices, box.faces).splitlines()
    assert lines[:3] == ["ply", "format ascii 1.0", "element vertex 8"] and len(lines) == 12 + 8 + 12


@pytest.mark.parametrize("count", [1, 2, 3, 700, 1500])
def test_diameter_is_the_largest_distance(count):
    points = np.random.default_rng(count).normal(size=(count, 3)) * [1, 2, 3]
    assert diameter(points) == pytest.approx(np.linalg.norm(points[:, None] - points, axis=2).max(), rel=1e-12)


def test_diameter_of_points_that_are_not_the_outermost():
    """Many points in a corner of the box, and two near other corners that are farther apart."""
    corner = np.random.default_rng(0).uniform(0, 1e-3, (700, 3))
    points = np.concatenate([[[0.05, 1, 0], [2, 0.05, 0], [0, 0, 0]], corner])
    assert diameter(points) == pytest.approx(np.hypot(1.95, 0.95), rel=1e-12)
