# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the first view of a page: where points are on canvases of all shapes, projected in double precision."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.viewer._first_view import fit_view, scene_corners, without_outliers

FOV = np.radians(50)
PANEL, SHEET = 336, 56
"""Width of the panel and height of the folded sheet of phones, with their margins [px]."""


def project(points, position, target, up, size):
    """Return the pixels of points in a camera that looks at a target, and their depth."""
    width, height = size
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    offset = points - position
    depth = offset @ forward
    focal = height / 2 / np.tan(FOV / 2)
    pixels = np.stack([offset @ right, offset @ np.cross(forward, right)], axis=1) * focal / depth[:, None]
    return pixels + (width / 2, height / 2), depth


@pytest.mark.parametrize(
    "size", [(390, 844), (360, 640), (768, 1024), (844, 390), (1280, 650), (1920, 970), (3440, 1300)]
)
@pytest.mark.parametrize("vertical", [1, 2])
def test_all_points_are_beside_the_panel(size, vertical):
    rng = np.random.default_rng(0)
    up, (width, height) = np.eye(3)[vertical], size
    for scale in (0.05, 1, 300):
        points = rng.uniform(-1, 1, (50, 3)) * scale * rng.uniform(0.1, 1, 3) + rng.uniform(-5, 5, 3)
        direction = rng.normal(size=3) + up
        position, target = fit_view(points, direction, up, FOV, width / height)
        pixels, depth = project(points, position, target, up, size)
        free = np.array([width, height - SHEET] if width < 576 else [width - PANEL, height])
        assert (depth > 0).all() and (pixels > 0).all() and (pixels < free).all()
        assert ((np.ptp(pixels, axis=0)) / free).max() > 0.6  # and not farther away than necessary
        np.testing.assert_allclose(np.cross(position - target, direction), 0, atol=1e-9 * scale * 1e3)


def test_points_that_coincide_are_in_front_of_the_camera():
    position, target = fit_view(np.ones((4, 3)), np.array([1.0, 0, 1]), np.eye(3)[2], FOV, 1.5)
    _, depth = project(np.ones((4, 3)), position, target, np.eye(3)[2], (1200, 800))
    assert (depth > 0).all() and np.isfinite([position, target]).all()


def test_small_ground_is_shown_whole_and_large_ground_around_the_objects():
    eyes = np.array([[0.0, 0, 1]])
    for side, shown in ((3, 1.5), (1000, None)):
        scene = wv.Scene()
        scene.add(trimesh.creation.box((side, side, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
        assert np.abs(scene_corners(scene, eyes)).max() == side / 2  # without other objects
        scene.add(trimesh.creation.box((1, 2, 1)), name="box", pose=(0, 0, 0.5, 0, 0, 0, 1))
        corners = scene_corners(scene, eyes)
        extent = np.linalg.norm((1, 2, 1.3))  # the box, and 0.3 m around the eyes
        np.testing.assert_allclose(corners[:, 1].max(), shown or 1 + extent / 2, rtol=1e-6)


def test_few_points_far_away_are_outliers():
    points = np.random.default_rng(0).normal(size=(10_000, 3)).astype(np.float32)
    points[:5] = 100
    kept = without_outliers(points)
    assert len(kept) > 9900 and np.abs(kept).max() < 5
    assert without_outliers(points[:0]).shape == (0, 3)
