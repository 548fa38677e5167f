# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measured against expected depth: labels of pixels, rates of false alarms, and objects that changed."""

import dataclasses
import math
import re

import numpy as np
import pytest
import reference_comparison
import trimesh
import warp as wp
from reference_comparison import Agreement

import warpvis as wv
from warpvis import sensors
from warpvis.core.poses import quaternion_product

CAMERA = wv.Camera(320, 240, 285.0, 285.0, 160, 120, near=0.3, far=8.0)
POSES = np.array([wv.look_at(eye, (2.2, 0, 0.9)) for eye in ((0, 0.1, 1.5), (0.2, 1.0, 1.4), (0.1, -0.8, 1.6))])
MODELS = {
    "kinect": sensors.kinect_v1(width=320, height=240),
    "d435": sensors.realsense_d435(width=320, height=240),
    "khoshelham": sensors.KhoshelhamNoise(),
}
pytestmark = pytest.mark.filterwarnings("ignore:fx of the camera")

SIZES = {"box": (0.2, 0.25, 0.3), "ball": None, "book": (0.25, 0.3, 0.12)}
PLACES = {"box": (2.2, 0.45, 0.95), "ball": (2.0, -0.05, 0.9), "book": (2.3, -0.5, 0.86)}


def place(name, offset=(0, 0, 0)):
    return (*(np.array(PLACES[name]) + offset), 0, 0, 0, 1)


def mesh(name):
    return trimesh.creation.icosphere(radius=0.1) if name == "ball" else trimesh.creation.box(SIZES[name])


def room(device="cpu", *, moved=None, left_out=(), added=()):
    """Return a room with a table and three things on it; `moved` has offsets of some of them [m]."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((9, 9, 0.1)), name="floor", label="ground", pose=(1, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 9, 6)), name="wall", pose=(4, 0, 2, 0, 0, 0, 1))
    for y in (-3, 3):
        scene.add(trimesh.creation.box((9, 0.1, 6)), name=f"side {y}", pose=(1, y, 2, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((1.0, 1.6, 0.1)), name="table", pose=(2.2, 0, 0.75, 0, 0, 0, 1))
    for name in PLACES:
        if name not in left_out:
            offset = (moved or {}).get(name, (0, 0, 0))
            scene.add(mesh(name), name=name, label="object", pose=place(name, offset))
    for size, center in added:
        scene.add(trimesh.creation.box(size), pose=(*center, 0, 0, 0, 1))
    return scene


def measure(scene, sensor=None, poses=POSES, frame=0, camera=CAMERA):
    views = wv.render(scene, camera, poses, sensor=sensor, outputs=("depth",), frame=None if sensor is None else frame)
    return views.depth.numpy()


def quadratic(depth):
    return 0.001 + 0.0015 * depth**2


@pytest.mark.parametrize("edge", [0, 1, 3])
@pytest.mark.parametrize("complete", [False, True])
def test_twin_in_double_precision(device, edge, complete):
    """Holes in the scene, all kinds of missing depth, and errors of several standard deviations."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.1, 3, 1.5)), name="wall", pose=(3, 0, 1.2, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.3), name="ball", pose=(1.5, 0.2, 1.2, 0, 0, 0, 1))
    random = np.random.default_rng(5)
    expected = measure(scene)
    depth = np.where(np.isfinite(expected), expected, 2.5)
    depth += random.normal(0, 3, depth.shape) * quadratic(depth)
    depth = np.where(
        random.uniform(size=depth.shape) < 0.1,
        random.choice([np.nan, 0, -1, np.inf, -np.inf, 0.2, 9, 65.535], depth.shape),
        depth,
    )
    depth = depth.astype(np.float32)
    options = {"threshold": 3.0, "tolerance": 0.004, "edge": edge}
    found = wv.compare_depth(scene, CAMERA, POSES, depth, sigma=quadratic, complete=complete, **options)
    labels, residual = found.labels.numpy(), found.residual.numpy()
    empty = Agreement.NEARER if complete else Agreement.NO_SURFACE
    for view in range(len(POSES)):
        wanted = reference_comparison.compare_depth(
            CAMERA, expected[view], depth[view], quadratic, empty=empty, **options
        )
        certain = ~(wanted[2] <= 1e-5)
        assert certain.mean() > 0.8
        np.testing.assert_array_equal(labels[view][certain], wanted[0][certain])
        np.testing.assert_allclose(residual[view], wanted[1], rtol=1e-3, atol=2e-3)
        assert len(np.unique(labels[view])) == (4 if complete else 5)
    shares = [[(labels[view] == state).mean() for state in Agreement] for view in range(len(POSES))]
    np.testing.assert_allclose(found.fractions, shares)
    np.testing.assert_array_equal(found.expected.numpy(), expected)


@pytest.mark.parametrize("threshold", [1.0, 2.0, 3.0])
def test_rate_of_false_alarms_is_the_tail_of_the_normal_distribution(threshold):
    """Noise of disparity is independent per pixel; depth differs from a normal distribution by its skewness."""
    scene, sensor = room(), sensors.KhoshelhamNoise(step=1e-3, rounds=False)
    depth = measure(scene, sensor)
    found = wv.compare_depth(scene, CAMERA, POSES, depth, sigma=sensor, threshold=threshold, edge=0)
    rates = found.fractions[:, [Agreement.NEARER, Agreement.FARTHER]] / found.fractions[:, 1:].sum(axis=1)[:, None]
    expected = math.erfc(threshold / math.sqrt(2)) / 2
    error = 4 * math.sqrt(expected / CAMERA.width / CAMERA.height)
    np.testing.assert_allclose(rates, expected, rtol=0.06, atol=error)
    residual = found.residual.numpy()
    assert np.nanstd(residual) == pytest.approx(1.0, abs=0.02) and abs(np.nanmean(residual)) < 0.02


@pytest.mark.parametrize("name", MODELS)
def test_nothing_is_reported_in_an_unchanged_scene(name):
    scene = room()
    for frame in range(4):
        depth = measure(scene, MODELS[name], frame=frame)
        found = wv.compare_depth(scene, CAMERA, POSES, depth, sigma=MODELS[name])
        assert found.fractions[:, Agreement.NEARER :].max() < 2e-3
        changes = found.changes()
        assert [(change.kind, change.name) for change in changes] == [("present", name) for name in PLACES]
        assert all(change.displacement is None for change in changes)


@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("thing", PLACES)
def test_removed_object(thing, name, views):
    depth = measure(room(left_out=[thing]), MODELS[name])[:views]
    changes = wv.compare_depth(room(), CAMERA, POSES[:views], depth, sigma=MODELS[name]).changes()
    assert [(change.name, change.kind) for change in changes] == [
        (name, "vanished" if name == thing else "present") for name in PLACES
    ]


@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("name", MODELS)
def test_added_object(name, views):
    size, center = (0.15, 0.15, 0.2), (1.9, 0.2, 0.9)
    depth = measure(room(added=[(size, center)]), MODELS[name])[:views]
    changes = wv.compare_depth(room(), CAMERA, POSES[:views], depth, sigma=MODELS[name]).changes()
    assert [change.kind for change in changes] == ["present"] * 3 + ["appeared"]
    new = changes[-1]
    assert new.object == -1 and new.name == "" and new.displacement is None
    # Only the front, the top and parts of the sides are visible.
    assert (np.abs(np.subtract(new.position, center)) < np.array(size) / 2 + 0.02).all()
    np.testing.assert_allclose(new.extent[1:], size[1:], atol=0.06)
    assert new.extent[0] < size[0] + 0.06


@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("thing", PLACES)
@pytest.mark.parametrize("offset", [(0, 0.05, 0), (0, -0.2, 0), (0.12, 0.16, 0), (-0.2, 0, 0)])
def test_moved_object(thing, offset, name, views):
    sensor = MODELS[name]
    if name == "d435" and offset[1] == 0:  # nearer surfaces that spread hide what a movement along the view uncovers
        sensor = dataclasses.replace(sensor, fattening=1)
    depth = measure(room(moved={thing: offset}), sensor)[:views]
    changes = wv.compare_depth(room(), CAMERA, POSES[:views], depth, sigma=sensor).changes()
    assert [(change.name, change.kind) for change in changes] == [
        (name, "moved" if name == thing else "present") for name in PLACES
    ]
    (moved,) = (change for change in changes if change.kind == "moved")
    np.testing.assert_allclose(moved.displacement, offset, atol=0.03 if views == 1 else 0.015)
    assert re.fullmatch(rf"moved '{thing}' at \(.*\) m by \(.*\) m \(\d+ px\)", str(moved))


def test_two_objects_change_places():
    difference = np.subtract(PLACES["book"], PLACES["box"]) + (0.02, 0, 0)
    depth = measure(room(moved={"box": difference, "book": -difference}), MODELS["khoshelham"])
    changes = wv.compare_depth(room(), CAMERA, POSES, depth, sigma=MODELS["khoshelham"]).changes(max_displacement=0.4)
    kinds = {change.name: change.kind for change in changes if change.name}
    assert kinds["ball"] == "present" and kinds["box"] != "present" and kinds["book"] != "present"


def test_hidden_objects_are_unknown():
    """A board in front of everything on the table, and a camera that looks elsewhere."""
    board = (0.02, 1.3, 0.9), (1.3, 0, 1.2)
    depth = measure(room(added=[board]), MODELS["d435"])[:1]
    changes = wv.compare_depth(room(), CAMERA, POSES[:1], depth, sigma=MODELS["d435"]).changes()
    assert [change.kind for change in changes] == ["unknown"] * 3 + ["appeared"]
    np.testing.assert_allclose(changes[-1].extent[1:], board[0][1:], atol=0.06)
    away = wv.look_at((0, 0, 1.5), (0, 2, 1.5))
    changes = wv.compare_depth(room(), CAMERA, away, measure(room(), poses=away), sigma=0.01).changes()
    assert [(change.kind, change.position, change.pixels) for change in changes] == [("unknown", None, 0)] * 3


def test_vanished_part_of_the_room():
    """Obstacles are no candidates by default."""
    post = [((0.1, 0.1, 2.0), (2.9, 0.9, 1.0))]
    found = wv.compare_depth(room(added=post), CAMERA, POSES, measure(room(), MODELS["kinect"]), sigma=MODELS["kinect"])
    vanished = found.changes()[-1]
    assert (vanished.kind, vanished.name, vanished.object) == ("vanished", "", -1)
    np.testing.assert_allclose(vanished.position[:2], post[0][1][:2], atol=0.06)
    (change,) = found.changes(objects=[len(room())])
    assert change.kind == "vanished" and change.object == len(room())


def test_space_without_a_surface():
    """A ball in front of nothing, removed, moved and new."""
    scene, empty = wv.Scene(device="cpu"), wv.Scene(device="cpu")
    for made, position in ((scene, (2, 0, 1)), (empty, (2, 0.4, 1))):
        made.add(trimesh.creation.icosphere(radius=0.15), name="ball", label="object", pose=(*position, 0, 0, 0, 1))
    pose = wv.look_at((0, 0, 1), (1, 0, 1))
    depth = measure(empty, poses=pose)
    found = wv.compare_depth(scene, CAMERA, pose, depth, sigma=0.01)
    assert set(np.unique(found.labels.numpy())) == {Agreement.NO_MEASUREMENT, Agreement.NO_SURFACE}
    assert [change.kind for change in found.changes()] == ["unknown"]
    found = wv.compare_depth(scene, CAMERA, pose, depth, sigma=0.01, complete=True)
    assert [change.kind for change in found.changes()] == ["unknown", "appeared"]
    wall = np.where(np.isfinite(depth), depth, 5.0).astype(np.float32)
    (change,) = wv.compare_depth(scene, CAMERA, pose, wall, sigma=0.01).changes()
    assert change.kind == "vanished"
    (change,) = wv.compare_depth(scene, CAMERA, pose, measure(scene, poses=pose), sigma=0.01).changes()
    assert change.kind == "present"


def test_edge_covers_errors_of_the_pose():
    """A rotation of 0.1 degrees moves the image by half a pixel."""
    scene, angle = room(), math.radians(0.05)
    turned = POSES.copy()
    turned[:, 3:] = quaternion_product(np.array([math.sin(angle), 0, 0, math.cos(angle)]), POSES[:, 3:])
    depth = measure(scene, poses=turned)
    fractions = [
        wv.compare_depth(scene, CAMERA, POSES, depth, sigma=0.01, edge=edge).fractions[:, Agreement.NEARER :].sum()
        for edge in (0, 1)
    ]
    assert fractions[0] > 0.003 and fractions[1] < 1e-4


def test_lens_and_worlds():
    """A fisheye camera with depth along the ray; the expected place of a movable object is that of the call."""
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((0.1, 6, 4)), name="wall", pose=(3, 0, 1, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.3, 0.3, 0.3)), name="cart", pose=(2, 0, 1, 0, 0, 0, 1), movable=True)
    camera = wv.Camera.from_opencv(
        [[60, 0, 80], [0, 60, 60], [0, 0, 1]], [0.01, 0, 0, 0], 160, 120, model="fisheye", kind="range", far=9
    )
    pose, there = wv.look_at((0, 0, 1), (1, 0, 1)), [[2, 0.4, 1, 0, 0, 0, 1]]
    depth = wv.render(scene, camera, pose, object_poses=there).depth
    (change,) = wv.compare_depth(scene, camera, pose, depth, sigma=0.005).changes(objects=["cart"])
    assert change.kind == "moved"
    np.testing.assert_allclose(change.displacement, (0, 0.4, 0), atol=0.03)
    (change,) = wv.compare_depth(scene, camera, pose, depth, sigma=0.005, object_poses=there).changes(objects=["cart"])
    assert change.kind == "present"
    without = wv.compare_depth(scene, camera, pose, depth, sigma=0.005, exclude=["cart"])
    (new,) = without.changes()
    assert new.kind == "appeared" and without.segmentation.numpy().max() == 0
    np.testing.assert_allclose(new.position[1:], (0.4, 1), atol=0.05)


def test_kinds_of_sigma_are_alike():
    sensor = sensors.KhoshelhamNoise()
    depth = measure(room(), sensor)
    results = [
        wv.compare_depth(room(), CAMERA, POSES, depth, sigma=sigma, threshold=2).labels.numpy()
        for sigma in (sensor, lambda z: sensor.depth_sigma(z, CAMERA))
    ]
    np.testing.assert_array_equal(*results)
    constant = wv.compare_depth(room(), CAMERA, POSES, depth, sigma=0.01, threshold=2).residual.numpy()
    expected = measure(room()).astype(np.float64)
    np.testing.assert_allclose(constant, (depth - expected) / 0.01, atol=1e-4)


WRONG = {
    "millimeters": ({"depth": 1000 * measure(room())}, r"depth must be in meters, .* pass depth / 1000"),
    "integers": ({"depth": np.full((3, 240, 320), 1500)}, "depth must be in meters, a float array, got int64; divide"),
    "sigma in millimeters": ({"sigma": 3.0}, "sigma must be .* below 1 m, got 3; divide millimeters by 1000"),
    "sigma 0": ({"sigma": 0}, "sigma must be a positive number of meters, got 0"),
    "sigma text": ({"sigma": "kinect"}, "sigma must be a number of meters, a model of warpvis.sensors or a function"),
    "sigma by constant": ({"sigma": lambda z: 0.01}, r"sigma must return .* each of 3457 depths, got shape \(\)"),
    "negative sigma": ({"sigma": lambda z: -z}, "sigma must return standard deviations from 0 m up"),
    "poses": ({"camera_to_world": POSES[:2]}, "camera_to_world must have one pose for each view of depth, 3, got 2"),
    "edge": ({"edge": 40}, "edge must be from 0 to 32 px, got 40"),
    "threshold": ({"threshold": -1}, "threshold must be a finite number from 0 up, got -1"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_arguments_raise(name):
    options, message = WRONG[name]
    given = {"camera_to_world": POSES, "depth": measure(room()), "sigma": 0.01} | options
    with pytest.raises(wv.errors.WarpvisError, match=message):
        wv.compare_depth(room(), CAMERA, **given)


def test_wrong_objects_raise():
    found = wv.compare_depth(room(), CAMERA, POSES, measure(room()), sigma=0.01)
    with pytest.raises(wv.errors.SceneError, match="objects must be names, or indices from 0 to 7, got 8"):
        found.changes(objects=[8])
    with pytest.raises(wv.errors.ArrayError, match="min_pixels must be a whole number from 1 up"):
        found.changes(min_pixels=0)


def test_map_instead_of_a_scene(device):
    """A map of exact depth, and a box that appears in free space; depth behind unknown space is not expected."""
    space = wv.OccupancyMap(0.03, device=device)
    space.integrate(wp.array(measure(room()), dtype=wp.float32, device=device), CAMERA, POSES, sigma=0)
    size, center = (0.2, 0.2, 0.4), (1.9, 0.15, 1.0)
    depth = measure(room(added=[(size, center)]), MODELS["khoshelham"])
    given = {"sigma": MODELS["khoshelham"], "edge": 2}
    found = wv.compare_depth(space, CAMERA, POSES, depth, **given)
    assert found.fractions[:, Agreement.AGREES].min() > 0.6
    appeared = [change for change in found.changes(min_pixels=150) if change.kind == "appeared"]
    assert (np.abs(np.subtract(appeared[0].position, center)) < np.array(size) / 2 + 0.04).all()
    before = wv.compare_depth(space, CAMERA, POSES, measure(room(), MODELS["khoshelham"], frame=1), **given)
    assert before.changes(min_pixels=150) == []
    away = wv.look_at((0, 0, 1.5), (0, 2, 1.5))
    unknown = wv.compare_depth(space, CAMERA, away, measure(room(), poses=away), sigma=0.01)
    assert unknown.fractions[0, Agreement.NO_SURFACE] > 0.9
    with pytest.raises(wv.errors.ArrayError, match="object_poses, world_index and exclude must be None for a map"):
        wv.compare_depth(space, CAMERA, POSES, depth, exclude=["table"], **given)
