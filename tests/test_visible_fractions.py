# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions by rays through silhouettes: double precision, supersampling, groups, worlds, and invalid input."""

import dataclasses

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import WarpvisError
from warpvis.visibility import FractionMeter

import reference
from support.object_visibility import cameras, desk, room

CAMERA = wv.Camera.from_fov(40, 30, hfov=1.0, near=0.6, far=3.2)
CANVAS = (40, 30, 40, 30)
FIELDS = (
    *("status", "box", "visible_pixels", "silhouette_pixels", "occluders"),
    *("fraction", "error", "image_share", "occluder_shares"),
)


def values(found):
    return {name: getattr(found, name).numpy() for name in FIELDS}


def assert_close(found, expected, samples):
    """Results are equal but for one sample: one is where the cart's side enters the floor, at equal depths."""
    for name in ("status", "box", "silhouette_pixels", "occluders"):
        assert np.array_equal(found[name], expected[name]), name
    one = 1.01 / max(1, 0 if samples is None else samples.silhouette.sum())
    assert abs(int(found["visible_pixels"]) - expected["visible_pixels"]) <= 1
    for name in ("fraction", "occluder_shares", "image_share"):
        assert np.allclose(found[name], expected[name], rtol=0, atol=one), name
    assert np.isclose(found["error"], expected["error"], rtol=0, atol=4 * one)


@pytest.mark.smoke("*-256-packets")
@pytest.mark.parametrize("caster", ["packets", "rays"])
@pytest.mark.parametrize("least", [1, 256])
def test_fractions_match_reference(device, caster, least):
    scene, poses = desk(device), cameras()
    found = values(wv.visible_fractions(scene, CAMERA, poses, min_samples=least, caster=caster))
    states = set()
    for view, pose in enumerate(poses):
        for index in range(len(scene)):
            samples = reference.measure_fractions(scene, CAMERA, pose, [index], canvas=CANVAS, least=least)
            expected = reference.judge_fractions(samples, CAMERA, 3)
            assert_close({name: array[view, index] for name, array in found.items()}, expected, samples)
            states.add(expected["status"])
    assert len(states) >= 3


@pytest.mark.slow
def test_counts_of_random_scenes_match_reference():
    """200 scenes: the same counts of samples, but for one at most, where surfaces enter each other."""
    counted = 0
    for seed in range(200):
        scene, rng = room(1000 + seed, 5)
        pose = wv.look_at(rng.uniform(-1.5, 1.5, 3) + (0, 0, 2.0), rng.uniform(-0.5, 0.5, 3))
        members = sorted(rng.choice(np.arange(1, len(scene)), 2, replace=False).tolist())
        targets = [[members[0]], members]
        found = values(wv.visible_fractions(scene, CAMERA, pose, objects=targets, min_samples=100))
        for target, group in enumerate(targets):
            samples = reference.measure_fractions(scene, CAMERA, pose, group, canvas=CANVAS, least=100)
            expected = reference.judge_fractions(samples, CAMERA, 3)
            assert_close({name: array[0, target] for name, array in found.items()}, expected, samples)
            counted += 0 if samples is None else int(samples.silhouette.sum())
    assert counted > 50_000


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_unions_of_objects_match_reference(device, caster):
    scene, poses = desk(device), cameras()
    groups = {"cart and mast": ["cart", "mast"], "round": ["ball", "arm", "ring"]}
    meter = FractionMeter(scene, CAMERA, objects=groups, min_samples=400, caster=caster)
    found = values(meter.measure(poses))
    assert meter.names == tuple(groups)
    for view, pose in enumerate(poses):
        for target, names in enumerate(groups.values()):
            members = [scene.index(name) for name in names]
            samples = reference.measure_fractions(scene, CAMERA, pose, members, canvas=CANVAS, least=400)
            expected = reference.judge_fractions(samples, CAMERA, 3)
            assert_close({name: array[view, target] for name, array in found.items()}, expected, samples)


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_pixel_counts_are_those_of_object_visibility(device, caster):
    scene, poses = desk(device), cameras()
    expected = wv.object_visibility(scene, CAMERA, poses, caster=caster)
    found = wv.visible_fractions(scene, CAMERA, poses, min_samples=1, caster=caster)
    for name, other in {"visible_pixels": "", "silhouette_pixels": "", "fraction": "", "box": "visible_box"}.items():
        assert np.array_equal(getattr(found, name).numpy(), getattr(expected, other or name).numpy()), name
    assert np.array_equal(found.occluders.numpy()[..., 0], expected.occluder.numpy())


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_near_planes_clip_silhouettes_and_occluders(device, caster):
    """A camera looks through a card, and part of a ball, that are nearer than the near plane."""
    scene = room(3)[0].to(device)
    scene.add(trimesh.creation.box((0.6, 0.5, 0.02)), name="card", pose=(0, -2.6, 0.9, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(2, 0.4), name="ball", pose=(0.5, -2.0, 0.8, 0, 0, 0, 1))
    camera = dataclasses.replace(CAMERA, near=0.9)
    pose = wv.look_at((0.2, -2.9, 1.1), (0.2, 0, 0.4))
    meters = [
        FractionMeter(scene, camera, min_samples=300, near_plane=plane, caster=caster) for plane in ("clip", "occlude")
    ]
    clipped, others = (values(meter.measure(pose)) for meter in meters)
    for index in range(len(scene)):
        samples = reference.measure_fractions(scene, camera, pose, [index], canvas=CANVAS, least=300, near_plane="clip")
        expected = reference.judge_fractions(samples, camera, 3)
        assert_close({name: array[0, index] for name, array in clipped.items()}, expected, samples)
    ball = scene.index("ball")
    assert 0 < clipped["silhouette_pixels"][0, ball] < others["silhouette_pixels"][0, ball]
    assert clipped["fraction"].sum() > others["fraction"].sum() + 0.5


def sized(device, scales):
    """Return a scene with a scaled box, cylinder, sphere, and a handle that is attached to the box."""
    scene, (box, can, ball) = wv.Scene(device=device), scales
    scene.add(trimesh.creation.box((3, 3, 0.02)), name="floor")
    parts = {"box": trimesh.creation.box((0.3, 0.2, 0.2)), "handle": trimesh.creation.box((0.4, 0.05, 0.05))}
    for part in parts.values():
        part.vertices *= box
    parts["handle"].vertices += np.array([0.2, 0, 0.1]) * box
    scene.add(parts["box"], name="box", movable=True, pose=(0, 0, 0, 0, 0, 0, 1))
    scene.add(parts["handle"], name="handle", attach_to="box")
    can_mesh = trimesh.creation.cylinder(0.1, 0.3, sections=24)
    can_mesh.vertices *= can
    scene.add(can_mesh, name="can", movable=True)
    scene.add(wv.scene.solids.ellipsoid(0.15 * np.array(ball)), name="ball", movable=True)
    return scene


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_scaled_objects_are_measured_as_if_built_larger(device, caster):
    rng, ones = np.random.default_rng(5), np.ones((3, 3))
    places = [(0.0, 0.1, 0.2, 0, 0, 0.6, 0.8), (0.4, 0.0, 0.2, 0, 0, 0, 1), (0.1, -0.5, 0.3, 0, 0.6, 0, 0.8)]
    camera = wv.Camera.from_fov(80, 60, hfov=1.0)
    eyes = np.array([wv.look_at((0.3 * k, -1.6, 0.7), (0.1, 0, 0.2)) for k in (-2, 0, 2)])
    meter = FractionMeter(sized(device, ones), camera, caster=caster)
    scales = rng.uniform(0.6, 1.5, (2, 3, 3)).astype(np.float32)
    objects = np.stack([places, places])
    found = values(meter.measure(np.stack([eyes, eyes]), object_poses=objects, object_scales=scales))
    for world, factors in enumerate(scales):
        built = sized(device, factors)
        expected = values(FractionMeter(built, camera, caster=caster).measure(eyes, object_poses=np.array(places)))
        for name in ("status", "box", "occluders"):
            assert np.array_equal(found[name][world], expected[name]), name
        for name in ("fraction", "occluder_shares"):
            assert np.allclose(found[name][world], expected[name], atol=5e-3), name
        assert np.abs(found["silhouette_pixels"][world] - expected["silhouette_pixels"]).max() <= 1
    assert not np.allclose(found["fraction"][0], found["fraction"][1], atol=0.02)


def test_cameras_in_worlds_are_views_of_their_world(device):
    scene = desk(device)
    rng, meter = np.random.default_rng(0), FractionMeter(scene, CAMERA)
    objects = np.stack([np.stack([scene.objects[index].pose for index in scene.movable])] * 3)
    objects[:, :, :2] += rng.uniform(-0.5, 0.5, (3, 2, 2))
    eyes = np.stack([cameras()[:2]] * 3) + rng.uniform(0, 0.1, (3, 2, 1)) * (1, 1, 1, 0, 0, 0, 0)
    by_view = {"object_poses": objects, "world_index": np.repeat(np.arange(3), 2)}
    expected = values(meter.measure(eyes.reshape(-1, 7), **by_view))
    matrices = poses_to_matrices(eyes.reshape(-1, 7)).reshape(3, 2, 4, 4)
    rows = wp.array(eyes.astype(np.float32), dtype=wp.transform, device=device)
    assert rows.shape == (3, 2)
    for given in (eyes, eyes.tolist(), matrices, rows):
        found = meter.measure(given, object_poses=objects)
        assert found.fraction.shape == (3, 2, len(scene)) and found.occluders.shape == (3, 2, len(scene), 3)
        for name, array in values(found).items():
            assert np.allclose(array.reshape(expected[name].shape), expected[name], atol=1e-6), name
    reordered = wv.visible_fractions(
        scene,
        CAMERA,
        eyes[..., [0, 1, 2, 6, 3, 4, 5]],
        object_poses=objects[..., [0, 1, 2, 6, 3, 4, 5]],
        quaternion="wxyz",
    )
    assert np.array_equal(values(reordered)["fraction"].reshape(6, -1), expected["fraction"])
    # One arrangement of the objects for all rows of cameras.
    same = meter.measure(eyes, object_poses=objects[0]).fraction.numpy()
    assert np.array_equal(same[2], meter.measure(eyes[2], object_poses=objects[0]).fraction.numpy())
    flags = rng.random((3, 2, len(scene))) < 0.3
    excluded = values(meter.measure(eyes, object_poses=objects, exclude=flags))["fraction"].reshape(6, -1)
    by_row = meter.measure(eyes.reshape(-1, 7), exclude=flags.reshape(6, -1), **by_view)
    assert np.array_equal(excluded, by_row.fraction.numpy()) and not np.array_equal(excluded, expected["fraction"])
    with pytest.raises(WarpvisError, match=r"flags of shape \(6, \d\) or \(1, \d\), got shape \(2, 3, \d\)"):
        meter.measure(eyes, object_poses=objects, exclude=flags.reshape(2, 3, -1))
    with pytest.raises(WarpvisError, match="world_index must be None if camera_to_world has poses for each world"):
        meter.measure(eyes, **by_view)
    with pytest.raises(WarpvisError, match=r"poses for each of the 3 worlds of object_poses, .* got those of 2"):
        meter.measure(eyes[:2], object_poses=objects)


def test_results_are_written_to_out(device):
    meter = FractionMeter(desk(device), CAMERA, objects=["ball"])
    first = meter.measure(cameras())
    expected = values(meter.measure(cameras()[::-1].copy()))
    again = meter.measure(cameras()[::-1].copy(), out=first)
    assert again.fraction.ptr == first.fraction.ptr
    for name, array in values(again).items():
        assert np.array_equal(array, expected[name]), name
    with pytest.raises(WarpvisError, match=r"out\.fraction must have shape \(2, 1\)"):
        meter.measure(cameras()[:2], out=first)
    with pytest.raises(WarpvisError, match="out must be an ObjectFractions, got int"):
        meter.measure(cameras(), out=3)


def finer(camera, factor):
    values = {name: getattr(camera, name) * factor for name in ("width", "height", "fx", "fy", "cx", "cy")}
    return dataclasses.replace(camera, **values)


@pytest.mark.parametrize("seed", range(4))
def test_errors_bound_the_difference_from_supersampling(seed):
    """Against 64 samples a pixel; the bound includes that of the supersampled fraction."""
    scene, rng = room(seed)
    camera = wv.Camera.from_fov(64, 48, hfov=1.0, near=0.05, far=10.0)
    eyes = rng.uniform(-1, 1, (8, 3)) + np.array([3.0, 0.0, 1.5])
    poses = np.stack([wv.look_at(eye, rng.uniform(-0.5, 0.5, 3)) for eye in eyes])
    coarse = values(wv.visible_fractions(scene, camera, poses, min_samples=1))
    fine = values(wv.visible_fractions(scene, finer(camera, 8), poses, min_samples=1))
    difference = np.abs(coarse["fraction"] - fine["fraction"])
    assert (difference <= coarse["error"] + fine["error"]).all()
    sampled = values(wv.visible_fractions(scene, camera, poses, min_samples=1024))
    assert (np.abs(sampled["fraction"] - fine["fraction"]) <= sampled["error"] + fine["error"]).all()
    small = (fine["silhouette_pixels"] > 0) & (coarse["silhouette_pixels"] < 256)
    assert small.any() and sampled["error"][small].mean() < 0.5 * coarse["error"][small].mean()


def test_objects_smaller_than_a_pixel_have_a_fraction(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.04, 0.04, 0.04)), name="bead", pose=(0.001, 0.001, 3, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 0.1, 0.01)), name="card", pose=(0.051, 0, 2, 0, 0, 0, 1))
    found = values(wv.visible_fractions(scene, CAMERA, (0, 0, 0, 0, 0, 0, 1), objects=["bead"], min_samples=1024))
    assert found["visible_pixels"][0, 0] == 0 and found["status"][0, 0] == wv.Visibility.VISIBLE
    edge = 2.98 * 0.001 / 1.995  # of the card's shadow on the front of the bead [m]
    assert abs(found["fraction"][0, 0] - (edge + 0.019) / 0.04) < 0.02 < found["error"][0, 0] < 0.2


def test_worlds_and_exclusions(device):
    """A card moves out of the way, or is excluded."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(2, 0.1), name="ball", movable=True, pose=(0, 0, 2, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.5, 0.5, 0.01)), name="card", movable=True, pose=(0, 0, 1, 0, 0, 0, 1))
    poses, eye = np.stack([item.pose for item in scene.objects]), np.array([0, 0, 0, 0, 0, 0, 1.0])
    moved = poses.copy()
    moved[1, 0] = 1.0
    meter = FractionMeter(scene, wv.Camera.from_fov(64, 48, hfov=1.0), objects=["ball"])
    found = meter.measure([eye] * 3, object_poses=np.stack([poses, moved]), world_index=[0, 1, 0])
    assert np.array_equal(found.fraction.numpy().ravel(), [0, 1, 0])
    assert np.array_equal(found.occluders.numpy()[:, 0, 0], [1, -1, 1])
    assert np.allclose(found.occluder_shares.numpy()[:, 0, 0], [1, 0, 1])
    assert meter.measure(eye, exclude=["card"]).fraction.numpy()[0, 0] == 1
    excluded = meter.measure(eye, exclude=["ball"])
    assert excluded.fraction.numpy()[0, 0] == 0 and excluded.status.numpy()[0, 0] == wv.Visibility.OUT_OF_VIEW


def test_results_do_not_depend_on_threads_and_batches(monkeypatch):
    scene, rng = room(7, 16)
    camera = wv.Camera.from_fov(160, 120, hfov=1.0)
    poses = np.stack([wv.look_at(rng.uniform(-3, 3, 3), rng.uniform(-0.5, 0.5, 3)) for _ in range(12)])
    expected = values(wv.visible_fractions(scene, camera, poses, threads=1))
    several = values(wv.visible_fractions(scene, camera, poses, threads=3))
    from warpvis.visibility import _fractions

    monkeypatch.setattr(_fractions, "_CPU_BYTES", 20000)
    batches = values(wv.visible_fractions(scene, camera, poses, threads=2))
    without = wv.visible_fractions(scene, camera, poses, occluders=0)
    assert np.array_equal(without.fraction.numpy(), expected["fraction"])
    for name, array in expected.items():
        assert np.array_equal(array, several[name]) and np.array_equal(array, batches[name]), name


def test_meters_follow_changes_of_the_scene(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(2, 0.1), name="ball", pose=(0, 0, 2, 0, 0, 0, 1))
    meter = FractionMeter(scene, wv.Camera.from_fov(64, 48, hfov=1.0), objects=["ball"])
    eye = (0, 0, 0, 0, 0, 0, 1)
    assert meter.measure(eye).fraction.numpy()[0, 0] == 1
    scene.add(trimesh.creation.box((0.5, 0.5, 0.01)), name="card", pose=(0, 0, 1, 0, 0, 0, 1))
    found = meter.measure(eye)
    assert found.fraction.numpy()[0, 0] == 0 and found.occluders.numpy()[0, 0, 0] == 1


def test_no_views_and_no_occluders(device):
    scene = desk(device)
    none = wv.visible_fractions(scene, CAMERA, np.empty((0, 7)), occluders=0)
    assert none.fraction.shape == (0, len(scene)) and none.occluders.shape == (0, len(scene), 0)
    found = wv.visible_fractions(scene, CAMERA, cameras(), occluders=0)
    assert found.occluder_shares.shape == (4, len(scene), 0)


def test_cuda_graphs_replay_with_new_poses(cuda):
    scene = desk(cuda)
    meter = FractionMeter(scene, CAMERA, objects=["ball", "cart"])
    poses = wp.array(cameras(), dtype=wp.transform, device=cuda)
    meter.measure(poses)
    with wp.ScopedCapture(cuda) as capture:
        found = meter.measure(poses)
    others = cameras()[::-1].copy()
    poses.assign(others)
    wp.capture_launch(capture.graph)
    assert np.array_equal(found.fraction.numpy(), meter.measure(others).fraction.numpy())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"objects": []}, "objects must be one or more objects of the scene, got none"),
        ({"objects": {}}, "objects must be one or more objects of the scene, got none"),
        ({"objects": ["bal"]}, "bal"),
        ({"objects": [["ball", "ball"]]}, "objects must be one or more distinct objects of the scene"),
        ({"min_samples": 0}, "min_samples must be"),
        ({"min_samples": 10**6}, "min_samples must be at most 16384, got 1000000"),
        ({"occluders": -1}, "occluders must be"),
        ({"occluders": 65}, "occluders must be at most 64, got 65"),
        ({"canvas": (1, 2)}, "canvas must be four whole numbers of pixels"),
    ],
)
def test_invalid_input_is_one_sentence(options, message):
    with pytest.raises(WarpvisError, match=message):
        wv.visible_fractions(desk(), CAMERA, cameras(), **options)


def test_scenes_in_millimeters_warn():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((800, 800, 800)), name="box", pose=(3000, 0, 0, 0, 0, 0, 1))
    with pytest.warns(UserWarning, match="millimeters"):
        wv.visible_fractions(scene, CAMERA, wv.look_at((0, 0, 0), (1, 0, 0)))


def test_lenses_are_refused():
    lens = wv.cameras.LensCamera(wv.cameras.lenses.KannalaBrandt(20, 20, 20, 15), 40, 30)
    with pytest.raises(WarpvisError, match=r"camera must be a warpvis\.Camera, got LensCamera; object_visibility"):
        wv.visible_fractions(desk(), lens, cameras())
