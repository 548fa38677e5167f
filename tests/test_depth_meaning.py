# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""All functions interpret depth values alike: docs/conventions.md, "Depth"."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Label, Visibility
from warpvis.maps import Voxel

# One pixel with a field of view of 53 degrees; the camera looks along x from (0, 0, 1), z up.
NEAR, FAR = 0.5, 4.0
MEANINGS = {
    "measured": [NEAR, 2.0, FAR],
    "too near": [-np.inf, 1e-6, np.nextafter(np.float32(NEAR), np.float32(0))],
    "too far": [np.inf, np.nextafter(np.float32(FAR), np.float32(9)), 1e30],
    "not measured": [np.nan, 0.0, -0.0, -1.0],
}
CASES = [(meaning, depth) for meaning, depths in MEANINGS.items() for depth in depths]
CAMERA = wv.Camera(1, 1, 1, 1, 0.5, 0.5, near=NEAR, far=FAR)
POSE = wv.look_at((0, 0, 1), (1, 0, 1))


def image(depth):
    return np.full((1, 1, 1), depth, dtype=np.float32)


@pytest.mark.parametrize(("meaning", "depth"), CASES)
def test_points_and_labels(meaning, depth, device):
    """Only measured depth has a point and a label."""
    point = wv.back_project(image(depth), CAMERA, POSE, device=device).numpy()[0, 0, 0]
    label = wv.classify(image(depth), CAMERA, POSE, device=device).numpy().item()
    if meaning == "measured":
        np.testing.assert_allclose(point, (depth, 0, 1), atol=1e-6)
        assert label == Label.OBSTACLE
    else:
        assert np.isnan(point).all()
        assert label == Label.EMPTY
    # `max_range` overrides the camera's far, but not its near.
    near_too = wv.classify(image(depth), CAMERA, POSE, max_range=100.0, device=device).numpy().item()
    assert near_too == (Label.OBSTACLE if meaning == "measured" or FAR < depth < 100 else Label.EMPTY)


@pytest.mark.parametrize(("meaning", "depth"), CASES)
def test_occlusion_by_meaning(meaning, depth, device):
    """Points and voxels in front of and behind 2 m: depth too near hides both, depth too far hides neither."""
    points = np.array([(1.25, 0, 1), (3.25, 0, 1)], dtype=np.float32)
    status = wv.point_visibility_from_depth(image(depth), CAMERA, POSE, points, device=device).numpy()[0]
    space = wv.voxel_map(
        image(depth), CAMERA, POSE, bounds=[[0, -0.25, 0.75], [4.5, 0.25, 1.25]], device=device, cell_size=0.5
    )
    states = space.states.numpy()[[2, 6], 0, 0]
    hidden, seen = (Visibility.OCCLUDED, Voxel.HIDDEN), (Visibility.VISIBLE, Voxel.FREE)
    expected = {
        "measured": [seen if depth > 1.25 else hidden, seen if depth > 3.25 else hidden],
        "too near": [hidden, hidden],
        "too far": [seen, seen],
        "not measured": [(Visibility.UNKNOWN, Voxel.UNKNOWN)] * 2,
    }[meaning]
    assert list(zip(status.tolist(), states.tolist(), strict=True)) == expected
    assert (space.states.numpy() == Voxel.SURFACE).any() == (meaning == "measured")


def test_too_near_depth_hides_points_within_the_tolerance(device):
    """Sensor noise applies to measured depth only, and depth that is too near is not measured."""
    points = np.array([(NEAR + 0.001, 0, 1)], dtype=np.float32)
    for depth in (-np.inf, NEAR - 0.001):
        options = {"tolerance": 0.01, "device": device}
        status = wv.point_visibility_from_depth(image(depth), CAMERA, POSE, points, **options).numpy()
        assert status.item() == Visibility.OCCLUDED


def test_rendered_images_have_the_same_meaning(device):
    """A wall that is too near has no point and no label, and hides the scene in a voxel map."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.1, 3, 3)), name="wall", pose=(0.3, 0, 1, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 3, 3)), name="behind", pose=(3, 0, 1, 0, 0, 0, 1))
    views = wv.render(scene, CAMERA, POSE)
    assert np.isneginf(views.depth.numpy()).all()
    assert np.isnan(views.points.numpy()).all() and not views.labels.numpy().any()
    assert not wv.maps.classify_rendered(views.depth, views.segmentation, scene).numpy().any()
    space = wv.voxel_map_from_scene(scene, CAMERA, POSE, bounds=[[0, -0.25, 0.75], [4.5, 0.25, 1.25]], cell_size=0.5)
    assert space.states.numpy()[:, 0, 0].tolist() == [Voxel.UNKNOWN, *[Voxel.HIDDEN] * 7, Voxel.UNKNOWN]
