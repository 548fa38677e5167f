# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Distances from surfaces and standing room, against closed forms and brute force over triangles."""

import numpy as np
import pytest
import trimesh
from pose_samples import unit

import warpvis as wv
from warpvis import scenes
from warpvis.planning import clearance, standing_room, surface_samples

import reference

ROBOT = 0.2  # radius


def at(*places):
    """Return camera poses without rotation."""
    return np.array([[*place, 0, 0, 0, 1] for place in places], dtype=float)


def add_box(scene, low, high, **options):
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    scene.add(trimesh.creation.box(high - low), pose=(*(low + high) / 2, 0, 0, 0, 1), **options)


def soup(rng, count, size):
    middles = rng.uniform([-1, -1, 0], [1, 1, 1.5], (count, 1, 3))
    return (middles + rng.uniform(-size, size, (count, 3, 3))).astype(np.float32)


def furnished(device="cpu", **options):
    """Return a scene with a floor, a table 0.7 m high, a pillar with radius 0.1 m at x = 3, and a low sill."""
    scene = wv.Scene(device=device, **options)
    add_box(scene, (-5, -5, -0.5), (5, 5, 0), name="floor", label="ground")
    add_box(scene, (-0.5, -0.5, 0.7), (0.5, 0.5, 0.75), name="table")
    pillar = trimesh.creation.cylinder(radius=0.1, height=2, sections=256)
    scene.add(pillar, name="pillar", pose=(3, 0, 1, 0, 0, 0, 1))
    add_box(scene, (-5, -3.05, 0), (5, -3, 0.02), name="sill")
    return scene


def test_distances_to_a_box_and_a_ball(device):
    scene = wv.Scene(device=device)
    add_box(scene, (-1, -1, -1), (1, 1, 1), name="box")
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    scene.add(ball, name="ball", pose=(10, 0, 0, 0, 0, 0, 1))
    points = [(0, 0, 0), (0.9, 0, 0), (3, 0, 0), (2, 2, 0), (2, 2, 2), (0, 0, 1), (10, 0, 2)]
    got = clearance(scene, points).numpy()
    expected = [1, 0.1, 2, np.sqrt(2), np.sqrt(3), 0, 1.5]
    np.testing.assert_allclose(got, expected, atol=1e-3)
    np.testing.assert_allclose(got[:6], expected[:6], atol=1e-6)
    assert (clearance(scene, points, max_distance=1.2).numpy() == np.where(got < 1.2, got, np.inf)).all()
    assert clearance(scene, points, objects=["ball"]).numpy()[2] == pytest.approx(6.5, abs=1e-6)
    assert clearance(scene, points, exclude=["box"]).numpy()[2] == pytest.approx(6.5, abs=1e-6)
    assert np.isinf(clearance(scene, points, objects=["box"], exclude=[0]).numpy()).all()
    assert clearance(scene, np.zeros((0, 3))).shape == (0,)


def test_distances_match_brute_force(device):
    rng = np.random.default_rng(1)
    corners = soup(rng, 100, 0.3)
    scene = wv.Scene(device=device)
    scene.add((corners.reshape(-1, 3), np.arange(300).reshape(-1, 3)))
    points = rng.uniform(-2, 3, (2000, 3)).astype(np.float32)
    expected = reference.nearest_surface(corners, points)
    for threads in (1, 2):
        np.testing.assert_allclose(clearance(scene, points, threads=threads).numpy(), expected, atol=1e-6)
    near = clearance(scene, points, max_distance=0.5).numpy()
    sure = np.abs(expected - 0.5) > 1e-5
    np.testing.assert_allclose(near[sure], reference.nearest_surface(corners, points, 0.5)[sure], atol=1e-6)


def test_movable_objects_use_their_world_poses(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1, 1, 1)), name="crate", pose=(5, 0, 0.5, 0, 0, 0, 1), movable=True)
    turned = [[2, 0, 0.5, 0, 0, np.sin(np.pi / 8), np.cos(np.pi / 8)]]  # rotated by 45 degrees: a corner is nearest
    assert clearance(scene, [(0, 0, 0.5)]).numpy()[0] == pytest.approx(4.5)
    assert clearance(scene, [(0, 0, 0.5)], object_poses=turned).numpy()[0] == pytest.approx(2 - np.sqrt(0.5), abs=1e-6)
    for distance, room in ((0.01, True), (-0.01, False)):
        camera = at((2 - np.sqrt(0.5) - ROBOT - distance, 0, 0.4))
        assert standing_room(scene, camera, radius=ROBOT, object_poses=turned).tolist() == [room]
        assert standing_room(scene, camera, radius=ROBOT).tolist() == [True]
    inside = at((5, 0, 0.5))
    assert standing_room(scene, inside, radius=ROBOT).tolist() == [False]
    assert standing_room(scene, inside, radius=ROBOT, exclude=["crate"]).tolist() == [True]


@pytest.mark.parametrize("up", ["z", "y"])
def test_standing_room_near_and_under_furniture(up, device):
    scene = furnished(device)
    cameras = at(
        (0.5 + ROBOT + 0.001, 0, 1.0),  # next to the table
        (0.5 + ROBOT - 0.001, 0, 1.0),
        (0, 0, 0.69),  # under it
        (0, 0, 0.71),
        (0, 0, 0.8),  # intersects it
        (3, 0.1 + ROBOT + 0.001, 0.5),  # next to the pillar
        (3, 0.1 + ROBOT - 0.001, 0.5),
        (3, 0, 0.5),  # inside it
        (0, -3, 0.5),  # on the sill
        (4, 4, 3.0),
        (0, 0, 0.005),  # no higher than a step
        (4, 4, -0.2),
    )
    if up == "y":
        axes = [1, 2, 0]
        turned = wv.Scene(device=device, up="y")
        for item in scene.objects:
            turned.add((item.vertices[:, axes], item.faces), name=item.name, label=item.label)
        scene, cameras[:, :3] = turned, cameras[:, axes]
    expected = [True, False, True, False, False, True, False, False, False, True, False, False]
    assert standing_room(scene, cameras, radius=ROBOT).tolist() == expected
    expected[8] = True
    assert standing_room(scene, cameras, radius=ROBOT, step=0.02).tolist() == expected
    excluding = standing_room(scene, cameras, radius=ROBOT, exclude=["table", "pillar", "sill"])
    assert excluding.tolist() == [True] * 10 + [False] * 2
    assert standing_room(scene, cameras, radius=ROBOT, floor=0.76)[[3, 4]].tolist() == [False, True]  # on the table


def test_standing_room_inside_closed_objects(device):
    cameras = at((0, 0, 0.5), (9, 0, 0.5))
    solid = trimesh.creation.box((4, 4, 4))
    # A solid, a room seen from inside, and a solid with a hole
    for faces, room in ((solid.faces, False), (solid.faces[:, ::-1], True), (solid.faces[1:], True)):
        scene = wv.Scene(device=device)
        scene.add((solid.vertices, faces))
        assert standing_room(scene, cameras, radius=ROBOT).tolist() == [room, True]
        assert standing_room(scene, at((0, 0, 2), (9, 0, 2)), radius=ROBOT).tolist() == [room, True]
    scene = wv.Scene(device=device)
    scene.add(solid, label="ground")
    assert standing_room(scene, cameras, radius=ROBOT).tolist() == [True, True]
    assert standing_room(scene, np.zeros((0, 7)), radius=ROBOT).shape == (0,)
    hollow = wv.Scene(device=device)  # walls of 1 m around a room, and a statue in a part of it
    outer, inner = trimesh.creation.box((6, 6, 6)), trimesh.creation.box((4, 4, 4))
    inner.invert()
    hollow.add(trimesh.util.concatenate([outer, inner]), name="building")
    add_box(hollow, (0.9, 0.9, -1), (1.9, 1.9, 1.9), name="statue")
    places = at((0, 0, 0.5), (2.5, 0, 0.5), (1.4, 1.4, 0.5))
    assert standing_room(hollow, places, radius=0.1).tolist() == [True, False, False]


@pytest.mark.slow
def test_standing_room_matches_brute_force(device):
    rng = np.random.default_rng(2)
    corners = soup(rng, 25, 0.25)
    shapes = [trimesh.creation.icosphere(subdivisions=1, radius=0.4), trimesh.creation.box((0.6, 0.7, 0.8))]
    scene = wv.Scene(device=device)
    scene.add((corners.reshape(-1, 3), np.arange(75).reshape(-1, 3)))
    for i, shape in enumerate(shapes):
        scene.add(shape, pose=unit((2.0 + i, 0.2, 0.6, *rng.normal(size=4))))
    cameras = rng.uniform([-1.5, -1.5, -0.1], [3.8, 1.5, 1.4], (120, 3)).astype(np.float32)
    triangles = np.concatenate([item.vertices[item.faces] for item in scene.objects])
    closed = np.arange(len(triangles)) >= len(corners)
    for low, radius in ((0.01, 0.15), (0.4, 0.02)):
        options = {"radius": radius, "floor": 0.0, "step": low}
        one, two = (standing_room(scene, at(*cameras), threads=threads, **options) for threads in (1, 2))
        expected, margin = reference.find_free_poses(triangles, closed, 2, cameras, low, radius)
        assert (one == two).all()
        assert (one == expected)[margin > 1e-6].all()
        assert 0.1 < one.mean() < 0.9


def test_standing_room_matches_sampled_surfaces(device):
    preset = scenes.PRESETS["room"]
    scene, rng = preset.build(device), np.random.default_rng(3)
    cameras = at(*rng.uniform([-2, -2, 0.3], [2, 2, 1.2], (500, 3)))
    room = standing_room(scene, cameras, radius=ROBOT)
    names = [item.name for item in scene if item.name != "floor"]
    points = surface_samples(scene, spacing=0.01, objects=names).points.astype(np.float64)
    for (x, y, top), free in zip(cameras[:, :3], room, strict=True):
        beside = points[(points[:, 2] > 0.01) & (points[:, 2] < top)]
        distance = np.linalg.norm(beside[:, :2] - [x, y], axis=1).min()
        assert distance > ROBOT - 1e-6 if free else distance < ROBOT + 0.02
    assert 0.3 < room.mean() < 0.95


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scene": 3}, "scene must be a warpvis.Scene, got int"),
        ({"scene": wv.Scene()}, "the scene has no objects; add() one first"),
        ({"points": np.zeros(3)}, "points must have shape (N, 3), got (3,)"),
        ({"points": [(0, 0, np.nan)]}, "points must be finite: 1 are not, the first at 0"),
        ({"max_distance": -0.1}, "max_distance must be a number of meters from 0 up, got -0.1"),
        ({"max_distance": np.nan}, "max_distance must be a number of meters from 0 up, got nan"),
        ({"objects": ["ball"]}, "the scene has no object 'ball'; it has 'floor', 'table', 'pillar', 'sill'"),
        ({"objects": []}, "objects must be one or more distinct objects of the scene, got []"),
        ({"exclude": [7]}, "exclude must be indices of objects from 0 to 3, got 7"),
    ],
)
def test_invalid_clearance_arguments_raise(change, said):
    given = {"scene": furnished(), "points": np.zeros((2, 3)), **change}
    with pytest.raises(wv.WarpvisError) as error:
        clearance(given.pop("scene"), given.pop("points"), **given)
    assert str(error.value) == said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scene": None}, "scene must be a warpvis.Scene, got NoneType"),
        ({"radius": 0}, "radius must be a positive number of meters, got 0"),
        ({"radius": np.inf}, "radius must be a positive number of meters, got inf"),
        ({"radius": True}, "radius must be a positive number of meters, got True"),
        ({"floor": np.nan}, "floor must be a finite number of meters, got nan"),
        ({"step": -1}, "step must be a number of meters from 0 up, got -1"),
        (
            {"camera_to_world": at((0, np.nan, 0))},
            "camera_to_world must be finite: wrong in 1 of 1, at index 0; leave out views without a pose, as "
            "Recording.posed does",
        ),
        ({"exclude": ["me"]}, "the scene has no object 'me'; it has 'floor', 'table', 'pillar', 'sill'"),
    ],
)
def test_invalid_standing_room_arguments_raise(change, said):
    given = {"scene": furnished(), "camera_to_world": at((0, 0, 1)), "radius": 0.2, **change}
    with pytest.raises(wv.WarpvisError) as error:
        standing_room(given.pop("scene"), given.pop("camera_to_world"), **given)
    assert str(error.value) == said
