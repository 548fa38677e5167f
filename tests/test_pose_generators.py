# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Generated poses: positions and orientations, vertical views, and clearance of random poses."""

import math

import numpy as np
import pytest
import trimesh
from pose_samples import unit

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.planning import inside_solids, pose_grid
from warpvis.pose_generators import _generators as module, along, frames_from_spec, grid, orbit, random_poses, sphere

import reference

TARGET = np.array([0.3, -0.2, 0.5])


def axes_of(poses):
    """Return positions, image x axes, image y axes, and view directions, each of shape (n, 3)."""
    assert poses.dtype == np.float64 and poses.shape[1:] == (7,)
    np.testing.assert_allclose(np.linalg.norm(poses[:, 3:], axis=1), 1, atol=1e-14)
    matrices = poses_to_matrices(poses)
    return matrices[:, :3, 3], matrices[:, :3, 0], matrices[:, :3, 1], matrices[:, :3, 2]


def assert_upright(poses, vertical=2):
    """Check that the image's x axis is level and its y axis points down."""
    _, right, down, _ = axes_of(poses)
    np.testing.assert_allclose(right[:, vertical], 0, atol=1e-12)
    assert (down[:, vertical] < 0).all()


def assert_looks_at(poses, target):
    places, _, _, forward = axes_of(poses)
    way = target - places
    np.testing.assert_allclose(forward, way / np.linalg.norm(way, axis=1, keepdims=True), atol=1e-12)


def add_box(scene, low, high, **options):
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    scene.add(trimesh.creation.box(high - low), pose=(*(low + high) / 2, 0, 0, 0, 1), **options)


def crates(device="cpu", *, movable=True, up="z"):
    """Return a scene with a floor, a solid block of 2 m, and a crate in the corner."""
    scene = wv.Scene(device=device, up=up)
    add_box(scene, (-4, -4, -0.5), (4, 4, 0), name="floor", label="ground")
    add_box(scene, (-1, -1, 0), (1, 1, 2), name="block")
    add_box(scene, (2, 2, 0.0), (3, 3, 1.0), name="crate", movable=movable)
    return scene


# Poses around a point.


@pytest.mark.parametrize("up", ["z", "y"])
def test_orbit_positions_and_directions(up):
    vertical = "xyz".index(up)
    first, second = (vertical + 1) % 3, (vertical + 2) % 3
    poses = orbit(TARGET, radius=2, height=1.25, count=8, up=up, start=0.1)
    places, *_ = axes_of(poses)
    angles = 0.1 + np.arange(8) * math.pi / 4
    np.testing.assert_allclose(places[:, first], TARGET[first] + 2 * np.cos(angles), atol=1e-12)
    np.testing.assert_allclose(places[:, second], TARGET[second] + 2 * np.sin(angles), atol=1e-12)
    assert (places[:, vertical] == 1.25).all()
    assert_looks_at(poses, TARGET)
    assert_upright(poses, vertical)
    for pose in poses:
        np.testing.assert_allclose(
            poses_to_matrices(pose), poses_to_matrices(wv.look_at(pose[:3], TARGET, up=up)), atol=1e-12
        )


@pytest.mark.parametrize("up", ["z", "y"])
def test_sphere_is_covered_evenly(up):
    vertical = "xyz".index(up)
    poses = sphere(TARGET, radius=1.5, count=1000, up=up)
    places, *_ = axes_of(poses)
    directions = (places - TARGET) / 1.5
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(directions.mean(axis=0), 0, atol=2e-3)
    assert (np.diff(directions[:, vertical]) > 0).all()
    # Nearest neighbors of evenly distributed points are about as far apart as on a hexagonal lattice.
    distance = np.linalg.norm(directions[:, None] - directions, axis=2) + 9 * np.eye(1000)
    lattice = math.sqrt(8 * math.pi / math.sqrt(3) / 1000)
    assert distance.min() > 0.7 * lattice and distance.min(axis=1).max() < 1.05 * lattice
    assert_looks_at(poses, TARGET)
    assert_upright(poses, vertical)


def test_sphere_elevation_limits():
    half = axes_of(sphere(TARGET, radius=2, count=500, min_elevation=0))[0][:, 2] - TARGET[2]
    assert (half > 0).all()
    np.testing.assert_allclose(np.sort(half), 2 * (np.arange(500) + 0.5) / 500, atol=1e-12)  # equal areas
    ring = axes_of(sphere(TARGET, radius=2, count=9, min_elevation=0.3, max_elevation=0.3))[0][:, 2]
    np.testing.assert_allclose(ring, TARGET[2] + 2 * math.sin(0.3), atol=1e-12)
    assert len(sphere(TARGET, radius=2, count=1)) == 1


@pytest.mark.parametrize("up", ["z", "y"])
def test_vertical_views_have_first_axis_at_top(up):
    vertical = "xyz".index(up)
    first = np.eye(3)[(vertical + 1) % 3]
    for elevation, way in ((math.pi / 2, -1), (-math.pi / 2, 1)):
        poses = sphere(TARGET, radius=2, count=3, min_elevation=elevation, max_elevation=elevation, up=up)
        _, _, down, forward = axes_of(poses)
        np.testing.assert_allclose(forward, np.tile(way * np.eye(3)[vertical], (3, 1)), atol=1e-15)
        np.testing.assert_allclose(down, np.tile(-first, (3, 1)), atol=1e-15)
    pole = np.eye(3)[vertical]
    _, _, down, forward = axes_of(along([-pole, 0 * pole, 2 * pole], count=5, up=up))
    np.testing.assert_allclose(forward, np.tile(pole, (5, 1)), atol=1e-15)
    np.testing.assert_allclose(down, np.tile(-first, (5, 1)), atol=1e-15)
    poses = grid([-pole, pole], step=1, look_at=0 * pole, up=up)
    assert_looks_at(poses, 0 * pole)
    assert len(poses) == 2  # no pose at the target


# Poses in a volume.


@pytest.mark.parametrize("up", ["z", "y"])
def test_grid_positions_and_headings(up):
    poses = grid([(0, 1, 2), (0.5, 1.9, 2)], step=0.3, headings=3, pitch=-0.4, up=up)
    expected = [(x, y, 2) for x in (0, 0.3) for y in (1, 1.3, 1.6, 1.9)]
    np.testing.assert_allclose(poses[::3, :3], expected, atol=1e-12)
    np.testing.assert_array_equal(poses[:, :3], np.repeat(poses[::3, :3], 3, axis=0))
    directions = pose_grid((0, 0, 0), radius=0, step=1, height=0, headings=3, pitch=-0.4, up=up)[:, 3:]
    np.testing.assert_array_equal(poses[:, 3:], np.tile(directions, (8, 1)))
    assert_upright(poses, "xyz".index(up))


def test_grid_with_target():
    poses = grid([(-1, -1, -1), (1, 1, 1)], step=0.5, look_at=(0, 0, 0))
    assert len(poses) == 5**3 - 1
    assert_looks_at(poses, (0, 0, 0))
    above = (poses[:, :2] == 0).all(axis=1)
    assert above.sum() == 4
    assert_upright(poses[~above])


# Poses along a path.


def test_poses_along_a_path():
    path = [(0, 0, 1), (3, 0, 1), (3, 0, 1), (3, 4, 1), (3, 4, 1)]
    poses = along(path, count=15)
    places, _, _, forward = axes_of(poses)
    ways = np.arange(15) * 0.5
    expected = np.stack([np.minimum(ways, 3), np.maximum(ways - 3, 0), np.ones(15)], axis=1)
    np.testing.assert_allclose(places, expected, atol=1e-12)
    first = np.arange(15) < 6  # a corner belongs to the segment that begins there
    np.testing.assert_allclose(forward, np.where(first[:, None], (1, 0, 0), (0, 1, 0)), atol=1e-12)
    assert_upright(poses)
    np.testing.assert_allclose(along(path, count=1)[:, :3], path[:1])
    assert_looks_at(along(path, count=7, look=TARGET), TARGET)
    helix = np.linspace(0, 20, 4000)[:, None] * [0, 0, 0.1] + np.stack(
        [np.cos(np.linspace(0, 20, 4000)), np.sin(np.linspace(0, 20, 4000)), np.zeros(4000)], axis=1
    )
    places, *_ = axes_of(along(helix, count=100))
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    chord = math.hypot(2 * math.sin(10 / 99), 2 / 99)
    np.testing.assert_allclose(steps, chord, rtol=1e-4)


# Random poses.


def test_random_positions_are_uniform():
    poses = random_poses([(-1, 2, 0), (3, 4, 0)], count=4000, seed=3)
    places, _, _, forward = axes_of(poses)
    assert (places >= (-1, 2, 0)).all() and (places <= (3, 4, 0)).all()
    np.testing.assert_allclose(places.mean(axis=0), (1, 3, 0), atol=0.1)
    assert np.histogram(places[:, 0], 8, (-1, 3))[0].min() > 420
    np.testing.assert_allclose(forward[:, 2], 0, atol=1e-12)
    assert np.histogram(np.arctan2(forward[:, 1], forward[:, 0]), 8, (-math.pi, math.pi))[0].min() > 420
    assert_upright(poses)


def test_random_directions_are_uniform():
    box = [(-1, -1, -1), (1, 1, 1)]
    poses = random_poses(box, count=4000, seed=3, look="any", up="y")
    forward = axes_of(poses)[3]
    for axis in range(3):  # Archimedes: each coordinate of a random direction is uniform
        assert np.histogram(forward[:, axis], 8, (-1, 1))[0].min() > 420
    assert_upright(poses, 1)
    looking = random_poses(box, count=100, seed=3, look=TARGET)
    assert_looks_at(looking, TARGET)
    np.testing.assert_array_equal(looking[:, :3], poses[:100, :3])  # positions do not depend on `look`


@pytest.mark.parametrize("up", ["z", "y"])
def test_random_positions_keep_clearance(device, up):
    scene = crates(device, up=up)
    poses = random_poses(scene, count=3000, seed=1, clearance=0.3)
    places = poses[:, :3]
    low, high = scene.bounds
    assert (places >= low).all() and (places <= high).all()
    corners = np.concatenate([item.vertices[item.faces] for item in scene])
    assert reference.nearest_surface(corners, places).min() >= 0.3 - 1e-6
    for name in ("block", "crate", "floor"):  # not even far from their surfaces
        box = scene[name].bounds
        assert not ((places > box[0]) & (places < box[1])).all(axis=1).any()
    without = random_poses(scene, count=3000, seed=1, clearance=0.3, exclude=["block"])
    assert ((without[:, :3] > -0.6) & (without[:, :3] < (0.6, 0.6, 1.6))).all(axis=1).sum() > 10
    assert_upright(poses, "xyz".index(up))


def test_clearance_uses_initial_poses_of_movable_objects():
    for clearance in (0.1, 0.4):
        one, two = (
            random_poses(crates(movable=movable), count=2000, seed=5, clearance=clearance) for movable in (False, True)
        )
        np.testing.assert_array_equal(one, two)


def test_random_poses_depend_only_on_seed(monkeypatch, device):
    scene = crates(device)
    options = {"seed": 2, "clearance": 0.35, "look": "any"}
    poses = random_poses(scene, count=500, threads=1, **options)
    np.testing.assert_array_equal(random_poses(scene, count=500, threads=3, **options), poses)
    np.testing.assert_array_equal(random_poses(crates("cpu"), count=500, **options), poses)
    np.testing.assert_array_equal(random_poses(scene, count=20, **options), poses[:20])
    monkeypatch.setattr(module, "_FEWEST_CANDIDATES", 16)
    monkeypatch.setattr(module, "_MAX_CANDIDATES", 48)
    np.testing.assert_array_equal(random_poses(scene, count=500, **options), poses)
    assert not np.array_equal(random_poses(scene, count=500, **{**options, "seed": 3}), poses)
    # The order of NumPy's generator: three coordinates first, of five numbers per pose.
    numbers = np.random.default_rng(2).random((3, 5))[:, :3]
    box = np.array([(0, 0, 0), (1, 2, 4)])
    np.testing.assert_array_equal(random_poses(box, count=3, seed=2)[:, :3], numbers * box[1])


def test_lack_of_free_space_is_reported(monkeypatch):
    monkeypatch.setattr(module, "_MIN_TRIED", 20_000)
    scene = wv.Scene()
    add_box(scene, (-2, -2, -2), (2, 2, 2), name="solid")
    with pytest.raises(wv.errors.PoseError) as error:
        random_poses(scene, count=3, seed=0, clearance=0.1)
    assert str(error.value).startswith("bounds -2 -2 -2 to 2 2 2 must have room for 3 cameras: only 0 of ")
    assert str(error.value).endswith(" random positions are 0.1 m from all surfaces and not inside closed objects")
    with pytest.raises(wv.errors.PoseError, match="differ from the point to look at"):
        random_poses([TARGET, TARGET], count=3, seed=0, look=TARGET)
    inwards = trimesh.creation.box((4, 4, 4))
    inwards.invert()
    room = wv.Scene()
    room.add(inwards)
    assert len(random_poses(room, count=3, seed=0, clearance=0.1)) == 3
    assert len(random_poses(wv.Scene(), bounds=[(0, 0, 0), (1, 1, 1)], count=3, seed=0)) == 3


# Points inside closed objects.


def test_inside_matches_solid_angles(device):
    rng = np.random.default_rng(0)
    scene = wv.Scene(device=device)
    shapes = [trimesh.creation.icosphere(subdivisions=1, radius=0.5), trimesh.creation.box((0.6, 0.7, 0.8))]
    shapes.append(trimesh.creation.torus(0.5, 0.2, major_sections=12, minor_sections=8))
    for i, shape in enumerate(shapes):
        scene.add(shape, pose=unit((0.3 * i, 0.1, 0.2 * i, *rng.normal(size=4))), movable=i == 1)
    points = rng.uniform(-0.6, 1.1, (400, 3)).astype(np.float32)
    corners = np.concatenate([item.vertices[item.faces] for item in scene])
    expected = reference.find_inside(corners, points)
    for threads in (1, 2):
        np.testing.assert_array_equal(inside_solids(scene, points, threads=threads), expected)
    assert 20 < expected.sum() < 300
    moved = inside_solids(scene, points, object_poses=[[50.0, 0, 0, 0, 0, 0, 1]], exclude=[0, 2])
    assert not moved.any()
    assert inside_solids(scene, np.zeros((0, 3))).shape == (0,)


def test_open_and_inverted_objects_contain_no_points(device):
    box = trimesh.creation.box((2, 2, 2))
    for faces, held in ((box.faces, True), (box.faces[:, ::-1], False), (box.faces[1:], False)):
        scene = wv.Scene(device=device)
        scene.add((box.vertices, faces))
        assert inside_solids(scene, [(0.1, 0.2, 0.3), (5, 0, 0)]).tolist() == [held, False]


def test_spec_uses_up_axis_of_scene():
    scene = crates(up="y")
    text = "orbit target=0,0,0 radius=1 height=1 count=3"
    np.testing.assert_array_equal(
        frames_from_spec(text, scene).camera_to_world, orbit((0, 0, 0), radius=1, height=1, count=3, up="y")
    )
    assert frames_from_spec(text, scene, up="z").source["up"] == "z"
    assert frames_from_spec("random count=3 bounds=0,0,0,1,1,1").source["up"] == "z"
    excluded = frames_from_spec("random count=3 clearance=0.1 exclude=block,crate", scene)
    assert excluded.source["exclude"] == ["block", "crate"]


BOX = [(0, 0, 0), (1, 1, 1)]
RANDOM = {"count": 3, "seed": 0}
BAD = {
    "target": (orbit, (0, 0), {"radius": 1, "height": 1, "count": 3}, "target must be three finite numbers, got [0.0,"),
    "NaN target": (sphere, (0, 0, np.nan), {"radius": 1, "count": 3}, "target must be three finite numbers, got [0.0,"),
    "radius": (
        orbit,
        TARGET,
        {"radius": 0, "height": 1, "count": 3},
        "radius must be a positive number of meters, got",
    ),
    "height": (
        orbit,
        TARGET,
        {"radius": 1, "height": np.inf, "count": 3},
        "height must be a finite number of meters, g",
    ),
    "start": (
        orbit,
        TARGET,
        {"radius": 1, "height": 1, "count": 3, "start": "x"},
        "start must be a finite number of ra",
    ),
    "true": (
        orbit,
        TARGET,
        {"radius": 1, "height": 1, "count": True},
        "count must be a whole number from 1 up, got Tr",
    ),
    "too many": (sphere, TARGET, {"radius": 1, "count": 10**12}, "count must be at most 268435456, got 1000000000000"),
    "up": (orbit, TARGET, {"radius": 1, "height": 1, "count": 3, "up": "x"}, 'up must be "z" or "y", got \'x\''),
    "elevation": (
        sphere,
        TARGET,
        {"radius": 1, "count": 3, "max_elevation": 2},
        "elevations must satisfy -pi/2 <= min",
    ),
    "turned": (
        sphere,
        TARGET,
        {"radius": 1, "count": 3, "min_elevation": 1, "max_elevation": 0},
        "elevations must satisfy -pi/2 <= min_elevation <= max_elevation <= pi/2 radians, got 1 and 0",
    ),
    "bounds": (grid, BOX[0], {"step": 1}, "bounds must be the lower and upper corner of a box, shape (2, 3), got [0.0"),
    "turned box": (grid, BOX[::-1], {"step": 1}, "bounds must be the lower and upper corner of a box, shape (2, 3), g"),
    "step": (grid, BOX, {"step": 0}, "step must be a positive number of meters, got 0"),
    "tiny step": (
        grid,
        BOX,
        {"step": 1e-6},
        "a grid must have at most 268435456 poses, got 8e+18; use a step greater than 1e-06",
    ),
    "no step": (
        grid,
        BOX,
        {"step": 1e-320},
        "a grid must have at most 268435456 poses, got inf; use a step greater than 1e-320",
    ),
    "headings": (grid, BOX, {"step": 1, "headings": 0}, "headings must be a whole number from 1 up, got 0"),
    "straight down": (grid, BOX, {"step": 1, "pitch": -math.pi / 2}, "pitch must be between -pi/2 and pi/2 radians, g"),
    "look_at": (grid, BOX, {"step": 1, "look_at": "x"}, "look_at must be an array of numbers, got dtype <U1"),
    "no path": (
        along,
        BOX[:1],
        {"count": 3},
        "path must be two or more finite points of shape (n, 3), got shape (1, 3",
    ),
    "no length": (along, [BOX[0]] * 3, {"count": 3}, "path must have a positive length, got 3 equal points"),
    "NaN path": (
        along,
        [(0, 0, 0), (np.nan, 0, 0)],
        {"count": 3},
        "path must be two or more finite points of shape (n",
    ),
    "backward": (along, BOX, {"count": 3, "look": "backward"}, 'look must be "forward" or a point of shape (3,), got'),
    "at it": (
        along,
        BOX,
        {"count": 3, "look": (1, 1, 1)},
        "cameras must not be at the point that they look at, [1.0, 1.0, ",
    ),
    "two boxes": (
        random_poses,
        BOX,
        {**RANDOM, "bounds": BOX},
        "bounds= must be given with a scene; pass the bounds as",
    ),
    "no bounds": (random_poses, None, RANDOM, "bounds must be an array of numbers, got dtype object"),
    "no scene": (
        random_poses,
        BOX,
        {**RANDOM, "clearance": 0.1},
        "clearance= requires a scene, since it is a distance",
    ),
    "clearance": (
        random_poses,
        BOX,
        {**RANDOM, "clearance": -1},
        "clearance must be a number of meters from 0 up, got",
    ),
    "seed": (random_poses, BOX, {**RANDOM, "seed": -1}, "seed must be a whole number from 0 up, got -1"),
    "look": (random_poses, BOX, {**RANDOM, "look": "up"}, 'look must be "level", "any" or a point of shape (3,), got'),
    "exclude": (
        random_poses,
        BOX,
        {**RANDOM, "exclude": ["a"]},
        "exclude= requires clearance=, from which it excludes",
    ),
    "nothing": (random_poses, wv.Scene(), RANDOM, "the scene has no objects; add() one first"),
    "no object": (
        random_poses,
        crates(),
        {**RANDOM, "clearance": 0.1, "exclude": ["cat"]},
        "the scene has no object 'cat'; it has 'floor', 'block', 'crate'",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_arguments_are_rejected(case):
    function, given, options, said = BAD[case]
    with pytest.raises(wv.WarpvisError) as error:
        function(given, **options)
    assert str(error.value).startswith(said)
    assert "\n" not in str(error.value)
