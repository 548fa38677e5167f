# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Points of the world: seen, hidden and by what, out of view, out of range; in a scene and in a measured image."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis import Visibility, scenes, solids

import reference

CAMERA = wv.Camera.from_fov(320, 240, hfov=1.0, near=0.6, far=4.0)
ROOMY = wv.Camera.from_fov(320, 240, hfov=1.0, near=1.5, far=4.0)


def points_around(scene, rng, count):
    low, high = scene.bounds
    return rng.uniform(low - 0.2, high + 0.2, (count, 3)).astype(np.float32)


def points_on(scene, rng, count):
    """Points of the triangles, in single precision."""
    corners = np.concatenate([item.vertices[item.faces] for item in scene.objects]).astype(np.float64)
    chosen = corners[rng.integers(0, len(corners), count)]
    shares = rng.dirichlet((1, 1, 1), count)
    return np.einsum("nc,ncx->nx", shares, chosen).astype(np.float32)


def assert_matches(scene, camera, poses, points, *, tolerance, caster, most_wrong=0):
    status, occluders = wv.check_points(
        scene, camera, poses, points, tolerance=tolerance, occluders=True, caster=caster
    )
    assert status.shape == occluders.shape == (len(poses), len(points))
    found = set()
    for view, pose in enumerate(poses):
        expected, hidden_by, margin = reference.judge_points(scene, camera, pose, points, tolerance)
        differs = status.numpy()[view] != expected
        # A ray that passes by an edge within a micrometre may miss or meet it; so may one whose point is at the limit.
        assert (differs & (margin > 2e-5)).sum() <= most_wrong
        same = ~differs & (expected == Visibility.OCCLUDED)
        assert (occluders.numpy()[view][same] == hidden_by[same]).mean() > 0.999 if same.any() else True
        others = ~differs & (expected != Visibility.OCCLUDED)
        assert (occluders.numpy()[view][others] == -1).all()
        found |= set(expected.tolist())
    return found


@pytest.mark.parametrize("name", ["room", "experiment_1"])
def test_points_anywhere_and_on_surfaces(name, device, caster):
    preset = scenes.PRESETS[name]
    scene, rng = preset.build(device), np.random.default_rng(0)
    poses = preset.poses(2)
    anywhere, on = points_around(scene, rng, 3000), points_on(scene, rng, 1000)
    found = assert_matches(scene, ROOMY, poses, anywhere, tolerance=0.0, caster=caster)
    assert found == {0, 1, 2, 3, 4}
    assert_matches(scene, ROOMY, poses, on, tolerance=1e-4, caster=caster)


def test_every_reason(device, caster):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.2, 1, 1)), name="wall", pose=(2, 0, 0, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.02, 0.1, 0.1)), name="lens cap", pose=(0.3, 0.3, 0, 0, 0, 0, 1))
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    points = [(1, 0, 0), (1.9, 0, 0), (2.5, 0, 0), (-1, 0, 0), (1, 5, 0), (0.4, 0, 0), (9, 1.5, 0), (2, 2, 0)]
    status, occluders = wv.check_points(scene, CAMERA, pose, points, occluders=True, caster=caster)
    names = [Visibility(value).name for value in status.numpy()[0]]
    out = "OUT_OF_VIEW"
    assert names == ["VISIBLE", "VISIBLE", "OCCLUDED", out, out, "TOO_NEAR", "TOO_FAR", out]
    assert occluders.numpy()[0].tolist() == [-1, -1, 0, -1, -1, -1, -1, -1]
    wide = wv.Camera.from_fov(320, 240, hfov=2.0, near=0.6, far=4.0)
    status, occluders = wv.check_points(scene, wide, pose, [(0.9, 0.9, 0)], occluders=True, caster=caster)
    assert status.numpy()[0, 0] == Visibility.OCCLUDED  # by something that is too near to be measured
    assert occluders.numpy()[0, 0] == 1


def test_the_tolerance_is_along_the_ray(device, caster):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.2, 9, 9)), name="wall", pose=(2.1, 0, 0, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(320, 240, hfov=2.2)
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    ray = np.array([1.0, 1.5, 0.5])
    points = [ray * 2 * (1 + behind / (2 * np.linalg.norm(ray))) for behind in (0.009, 0.011)]
    status = wv.check_points(scene, camera, pose, points, tolerance=0.01, caster=caster).numpy()[0]
    assert status.tolist() == [Visibility.VISIBLE, Visibility.OCCLUDED]


def test_worlds_solids_and_exclusion(device, caster):
    scene = wv.Scene(device=device)
    scene.add(solids.sphere(0.3), name="ball", pose=(2, 0, 0, 0, 0, 0, 1), movable=True)
    poses = np.tile(wv.look_at((0, 0, 0), (1, 0, 0)), (3, 1))
    worlds = np.array([[[2, 0, 0, 0, 0, 0, 1]], [[2, 0.5, 0, 0, 0, 0, 1]]], dtype=np.float32)
    points = [(3, 0, 0), (1.7, 0, 0), (3, 0.75, 0)]
    hidden = np.array([[0], [0], [1]], dtype=np.uint8)
    options = {"object_poses": worlds, "world": np.array([0, 1, 0]), "exclude": hidden, "caster": caster}
    status = wv.check_points(scene, CAMERA, poses, points, **options).numpy()
    seen, behind = int(Visibility.VISIBLE), int(Visibility.OCCLUDED)
    assert status.tolist() == [[behind, seen, seen], [seen, seen, behind], [seen, seen, seen]]


def test_threads_and_devices_arrays_change_nothing(device):
    preset = scenes.PRESETS["room"]
    scene, rng = preset.build(device), np.random.default_rng(1)
    points = points_around(scene, rng, 5000)
    one, two = (wv.check_points(scene, CAMERA, preset.poses(2), points, threads=threads).numpy() for threads in (1, 2))
    assert (one == two).all()
    on_device = wp.array(points, dtype=wp.vec3, device=device)
    assert (wv.check_points(scene, CAMERA, preset.poses(2), on_device).numpy() == one).all()
    assert wv.check_points(scene, CAMERA, preset.poses(2), np.zeros((0, 3))).shape == (2, 0)


def test_measured_images(device):
    rng = np.random.default_rng(2)
    preset = scenes.PRESETS["room"]
    scene, poses = preset.build(device), preset.poses(3)
    depth = wv.render(scene, ROOMY, poses, outputs="depth").depth.numpy()
    depth[rng.random(depth.shape) < 0.1] = np.nan
    depth[rng.random(depth.shape) < 0.1] = 0.0
    points = points_around(scene, rng, 4000)
    status = wv.check_points_measured(depth, ROOMY, poses, points, tolerance=0.02, device=device).numpy()
    found = set()
    for view, pose in enumerate(poses):
        expected = reference.judge_points_measured(ROOMY, pose, depth[view], points, 0.02)
        assert (status[view] != expected).mean() <= 5e-4  # rounding decides which pixel a point at its border is in
        found |= set(expected.tolist())
    assert found == {0, 1, 2, 3, 4, 5}
    one = wv.check_points_measured(depth[0], ROOMY, poses[0], points, tolerance=0.02, device=device).numpy()
    assert (one == status[:1]).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scene": 3}, "scene must be a warpvis.Scene, got int; see check_points_measured"),
        ({"scene": wv.Scene()}, "the scene has no objects; add() one first"),
        ({"camera": None}, "camera must be a warpvis.Camera, got NoneType"),
        ({"tolerance": -1}, "tolerance must be a number of metres from 0 up, got -1"),
        ({"tolerance": np.nan}, "tolerance must be a number of metres from 0 up, got nan"),
        ({"points": [(0, 0, np.nan), (0, 0, 0)]}, "points must be finite: 1 are not, the first at 0"),
        ({"points": np.zeros((4, 2))}, "points must have shape (N, 3), got (4, 2)"),
    ],
)
def test_bad_input(change, said):
    scene = wv.Scene()
    scene.add(trimesh.creation.box((1, 1, 1)))
    given = {"scene": scene, "camera": CAMERA, "camera_to_world": np.eye(4), "points": np.zeros((2, 3)), **change}
    with pytest.raises(wv.WarpvisError) as error:
        wv.check_points(**given)
    assert str(error.value) == said


@pytest.mark.parametrize(
    ("depth", "said"),
    [
        (np.zeros((2, 240, 320)), "depth must be of as many views as there are poses, got 2 for 1"),
        (np.zeros((1, 24, 32)), "depth must have shape (V, 240, 320), got (1, 24, 32)"),
    ],
)
def test_bad_images(depth, said):
    with pytest.raises(wv.WarpvisError) as error:
        wv.check_points_measured(depth.astype(np.float32), CAMERA, np.eye(4), np.zeros((2, 3)))
    assert str(error.value) == said
