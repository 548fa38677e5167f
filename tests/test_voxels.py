# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the voxel map: against the reference, against geometry, and with several views, threads and worlds."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Label, Visibility
from warpvis.maps import Voxel, VoxelMap, voxel_map, voxel_map_from_scene

import reference
from support.voxels import BOUNDS, BOX_BACK, BOX_FRONT, CAMERA, POSES, assert_matches_twin, at, build, same

CELL = 0.05


def render(scene, poses=POSES):
    return wv.render(scene, CAMERA, poses, outputs=("depth", "labels"))


@pytest.mark.parametrize("count", [1, 3])
def test_maps_match_reference(count, device):
    views = render(build(device), POSES[:count])
    result = voxel_map(views.depth, CAMERA, POSES[:count], bounds=BOUNDS, labels=views.labels)
    assert result.states.shape == result.labels.shape == (57, 48, 25)
    assert result.origin == tuple(BOUNDS[0])
    assert str(result.states.device) == device
    states, labels = assert_matches_twin(result, views.depth.numpy(), views.labels.numpy(), POSES[:count])
    assert set(np.unique(states)) == set(Voxel)
    assert set(np.unique(labels)) == {Label.EMPTY, Label.GROUND, Label.OBSTACLE, Label.OBJECT}
    assert ((labels != Label.EMPTY) == (states == Voxel.SURFACE)).all()


def test_states_match_geometry(device):
    scene = build(device)
    result = voxel_map_from_scene(scene, CAMERA, POSES[0], bounds=BOUNDS)
    assert at(result, (BOX_FRONT, 0.0, 0.2)) == (Voxel.SURFACE, Label.OBSTACLE)
    assert at(result, (BOX_FRONT - 0.1, 0.0, 0.2)) == (Voxel.FREE, Label.EMPTY)
    assert at(result, (BOX_FRONT + 0.1, 0.0, 0.2)) == (Voxel.HIDDEN, Label.EMPTY)  # inside
    assert at(result, (BOX_BACK + 0.1, 0.0, 0.1)) == (Voxel.HIDDEN, Label.EMPTY)  # behind
    assert at(result, (BOX_BACK + 0.1, 0.0, 0.7)) == (Voxel.FREE, Label.EMPTY)  # above it
    assert at(result, (-0.5, 0.0, 0.0)) == (Voxel.SURFACE, Label.GROUND)
    assert at(result, (0.0, 0.0, -0.1)) == (Voxel.HIDDEN, Label.EMPTY)
    assert at(result, (-0.3 - 0.14, 0.4, 0.15)) == (Voxel.SURFACE, Label.OBJECT)
    assert at(result, (-1.5, 0.0, 0.8)) == (Voxel.UNKNOWN, Label.EMPTY)  # behind the camera
    assert at(result, (-1.3, 0.1, 0.77)) == (Voxel.UNKNOWN, Label.EMPTY)  # nearer than near

    # Elsewhere a voxel has the state of its center in the depth image.
    depth = render(scene, POSES[:1]).depth
    status = wv.point_visibility_from_depth(depth, CAMERA, POSES[:1], result.centers().reshape(-1, 3), tolerance=0.0)
    means = {Visibility.VISIBLE: Voxel.FREE, Visibility.OCCLUDED: Voxel.HIDDEN}
    expected = np.array([means.get(value, Voxel.UNKNOWN) for value in Visibility])[status.numpy()[0]]
    states = result.states.numpy().ravel()
    others = states != Voxel.SURFACE
    assert (states[others] != expected[others]).mean() < 1e-4


def test_surfaces_have_no_holes_between_pixels(device):
    """Every voxel of a visible wall is SURFACE, though pixels lie three voxels apart."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.2, 9, 9)), name="wall", pose=(2.113, 0, 0, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(30, 30, hfov=1.2)
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    result = voxel_map_from_scene(scene, camera, pose, bounds=((1, -0.6, -0.6), (3, 0.6, 0.6)), cell_size=0.03)
    states = result.states.numpy()
    wall = int((2.013 - 1) / 0.03)
    assert (states[wall] == Voxel.SURFACE).all()
    assert (states[:wall] == Voxel.FREE).all()
    assert (states[wall + 1 :] == Voxel.HIDDEN).all()


def test_several_views_give_the_maximum_of_single_views(device):
    views = render(build(device))
    depth, labels = views.depth.numpy(), views.labels.numpy()
    options = {"bounds": BOUNDS, "device": device}
    together = voxel_map(depth, CAMERA, POSES, labels=labels, **options)
    alone = [voxel_map(depth[v], CAMERA, POSES[v], labels=labels[v], **options) for v in range(3)]
    np.testing.assert_array_equal(together.states.numpy(), np.max([m.states.numpy() for m in alone], axis=0))
    np.testing.assert_array_equal(together.labels.numpy(), np.max([m.labels.numpy() for m in alone], axis=0))
    for one in alone:  # other views see what is hidden from this one
        assert ((one.states.numpy() == Voxel.HIDDEN) & (together.states.numpy() > Voxel.HIDDEN)).sum() > 100

    merged = alone[0].merge(alone[1]).merge(alone[2])
    assert same(merged, together)
    assert not same(alone[0], together)  # merging modified neither
    states, highest = reference.merge_voxels(*((one.states.numpy(), one.labels.numpy()) for one in alone[:2]))
    assert (alone[0].merge(alone[1]).states.numpy() == states).all()
    assert (alone[0].merge(alone[1]).labels.numpy() == highest).all()
    added = voxel_map(depth[1:], CAMERA, POSES[1:], labels=labels[1:], out=alone[0], bounds=BOUNDS)
    assert added is alone[0]
    assert same(added, together)


def test_different_cameras_add_to_one_map(device):
    scene, wide = build(device), wv.Camera.from_fov(60, 90, hfov=1.8, far=2.0)
    first = voxel_map_from_scene(scene, CAMERA, POSES[0], bounds=BOUNDS)
    second = voxel_map_from_scene(scene, wide, POSES[1], bounds=BOUNDS)
    expected = first.merge(second)
    assert same(voxel_map_from_scene(scene, wide, POSES[1], out=first), expected)


@pytest.mark.parametrize("min_x", [BOUNDS[0, 0], 1.28])
def test_maps_are_independent_of_threads(min_x, device):
    """A box that threads share by layers across x, and one so thin that they share its layers."""
    views, bounds = render(build(device)), [(min_x, *BOUNDS[0, 1:]), BOUNDS[1]]
    cell = 0.031 if min_x < 0 else 0.011
    maps = [
        voxel_map(views.depth, CAMERA, POSES, bounds=bounds, cell_size=cell, labels=views.labels, threads=threads)
        for threads in (1, 2, 3, 1)
    ]
    assert all(same(maps[0], other) for other in maps[1:])
    assert set(np.unique(maps[0].states.numpy())) == set(Voxel)


def neighborhood(cells):
    """Return the highest label of every cell and its eight neighbors."""
    rows, columns = cells.shape
    padded = np.pad(cells, 1)
    return np.max([padded[r : r + rows, c : c + columns] for r in range(3) for c in range(3)], axis=0)


def test_voxel_floor_map_matches_floor_map(device):
    """Every cell below a pixel's point has its label; rays through voxels reach at most one cell farther.

    A ray through a voxel's center meets the surface at the depth of its pixel, so within half a pixel of the pixel's
    point: less than a cell here, where pixels are smaller than cells.
    """
    assert CAMERA.far / CAMERA.fx < CELL
    scene, robots = build(device), [(-1.2, 0.1, 0.1)]
    views = wv.render(scene, CAMERA, POSES[0])
    result = voxel_map(views.depth, CAMERA, POSES[0], bounds=BOUNDS, labels=views.labels)
    floor_map = result.floor_map()
    # One row of pixels: points only, without the surface between adjacent pixels.
    points, labels = views.points.numpy().reshape(1, 1, -1, 3), views.labels.numpy().reshape(1, 1, -1)
    of_points = wv.floor_map(points, labels, bounds=BOUNDS, cell_size=CELL)
    assert floor_map.bounds == pytest.approx(of_points.bounds)
    assert (floor_map.cell_size, floor_map.up) == (CELL, "z")
    assert str(floor_map.cells.device) == device

    cells, least = floor_map.cells.numpy()[0], of_points.cells.numpy()[0]
    most = neighborhood(least)
    assert (least <= cells).all()
    assert (cells <= most).all()
    certain = (least == most) & (least != Label.EMPTY)
    assert certain.mean() > 0.3  # where both bounds agree, the maps are equal
    assert set(np.unique(cells)) == {Label.EMPTY, Label.GROUND, Label.OBSTACLE, Label.OBJECT}
    np.testing.assert_array_equal(cells, reference.highest_labels(result.labels.numpy(), 2))

    drawn = result.floor_map(robots=robots).cells.numpy()[0]
    expected = wv.floor_map(points, labels, bounds=BOUNDS, cell_size=CELL, robots=robots).cells.numpy()[0]
    assert ((drawn == Label.ROBOT) == (expected == Label.ROBOT)).all()
    assert (drawn[drawn != Label.ROBOT] == cells[drawn != Label.ROBOT]).all()


def test_map_of_world_with_y_up(device):
    """The same world with renamed axes: x, y, z become z, x, y."""
    upright = build(device)
    turned = wv.Scene(device=device, up="y")
    for item in upright.objects:
        turned.add((item.vertices[:, [1, 2, 0]], item.faces), name=item.name, label=item.label)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3] = reference.poses_to_matrices(POSES)[:, [1, 2, 0]]
    expected = voxel_map_from_scene(upright, CAMERA, POSES, bounds=BOUNDS)
    result = voxel_map_from_scene(turned, CAMERA, poses, bounds=BOUNDS[:, [1, 2, 0]])
    assert result.up == "y"
    for name in ("states", "labels"):
        got, wanted = (getattr(m, name).numpy() for m in (result, expected))
        assert got.shape == wanted.transpose(1, 2, 0).shape
        assert (got != wanted.transpose(1, 2, 0)).mean() < 1e-3  # poses and vertices are rounded differently
    floor_map = result.floor_map()
    assert floor_map.axes == ("z", "x")
    assert floor_map.bounds == pytest.approx(expected.floor_map().bounds)
    assert (floor_map.cells.numpy() != expected.floor_map().cells.numpy()).mean() < 1e-2
    np.testing.assert_array_equal(floor_map.cells.numpy()[0], reference.highest_labels(result.labels.numpy(), 1))


def test_measured_images_with_holes(device):
    rng = np.random.default_rng(0)
    depth = render(build(device)).depth.numpy()
    for value in (np.nan, 0.0, -1.0, 0.1, 9.0):
        depth[rng.random(depth.shape) < 0.1] = value
    assert np.isneginf(depth).sum() == 0
    depth[rng.random(depth.shape) < 0.05] = -np.inf
    result = voxel_map(depth, CAMERA, POSES, bounds=BOUNDS, device=device)
    states, labels = assert_matches_twin(result, depth, None, POSES)
    assert set(np.unique(states)) == set(Voxel)
    assert set(np.unique(labels)) == {Label.EMPTY, Label.OBSTACLE}  # without labels, every surface is an obstacle


@pytest.mark.parametrize(
    ("value", "state", "reach"),
    [
        (np.nan, Voxel.UNKNOWN, None),
        (0.0, Voxel.UNKNOWN, None),
        (-1.0, Voxel.UNKNOWN, None),
        (np.inf, Voxel.FREE, (1.0, 2.0)),
        (2.5, Voxel.FREE, (1.0, 2.0)),  # beyond the camera's range
        (-np.inf, Voxel.HIDDEN, (1.0, 2.0)),
        (0.5, Voxel.HIDDEN, (1.0, 2.0)),  # nearer than the camera's range
    ],
)
def test_image_of_one_value_gives_one_state(value, state, reach, device):
    """For a camera that looks along x, all voxels between near and far have one state, others are OUTSIDE."""
    camera = wv.Camera.from_fov(8, 8, hfov=2.0, near=1.0, far=2.0)
    depth = np.full((8, 8), value, dtype=np.float32)
    bounds = ((0.5, -0.3, -0.3), (2.5, 0.3, 0.3))
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    result = voxel_map(depth, camera, pose, bounds=bounds, cell_size=0.1, device=device)
    x = result.centers()[..., 0]
    expected = np.full(x.shape, Voxel.UNKNOWN)
    if reach:
        expected[(x > reach[0]) & (x < reach[1])] = state
    np.testing.assert_array_equal(result.states.numpy(), expected)
    assert not result.labels.numpy().any()


def test_excluded_body_around_a_camera_hides_nothing(device):
    scene = build(device)
    scene.add(trimesh.creation.box((0.3, 0.3, 0.3)), name="robot", label="robot", pose=(-1.4, 0.1, 0.8, 0, 0, 0, 1))
    alone = voxel_map_from_scene(build(device), CAMERA, POSES[0], bounds=BOUNDS)
    inside = voxel_map_from_scene(scene, CAMERA, POSES[0], bounds=BOUNDS)
    assert inside.counts()[Voxel.FREE] == inside.counts()[Voxel.SURFACE] == 0
    assert inside.counts()[Voxel.HIDDEN] > 0
    assert same(voxel_map_from_scene(scene, CAMERA, POSES[0], bounds=BOUNDS, exclude=["robot"]), alone)


def test_views_in_parts_of_moving_worlds(device, monkeypatch):
    """Three views in two worlds, each with separate exclusions, rendered one at a time."""
    scene = build(device)
    scene.add(
        trimesh.creation.box((0.3, 0.3, 1)), name="person", label="human", pose=(0, 0, 9, 0, 0, 0, 1), movable=True
    )
    arguments = {
        "object_poses": np.array([[[-0.4, -0.3, 0.5, 0, 0, 0, 1]], [[0, -0.6, 0.5, 0, 0, 0, 1]]], dtype=np.float32),
        "world_index": np.array([1, 0, 1]),
        "exclude": np.array([[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0]], dtype=np.uint8),
    }
    views = wv.render(scene, CAMERA, POSES, outputs=("depth", "labels"), **arguments)
    expected = voxel_map(views.depth, CAMERA, POSES, bounds=BOUNDS, labels=views.labels)
    assert same(voxel_map_from_scene(scene, CAMERA, POSES, bounds=BOUNDS, **arguments), expected)
    monkeypatch.setattr("warpvis.maps._voxel_views._PIXELS_AT_A_TIME", 1)
    assert same(voxel_map_from_scene(scene, CAMERA, POSES, bounds=BOUNDS, **arguments), expected)
    assert Label.HUMAN in expected.labels.numpy()

    each = np.concatenate([arguments["object_poses"][[1, 0, 1]]])  # one world per view
    exclude = arguments["exclude"]
    assert same(voxel_map_from_scene(scene, CAMERA, POSES, bounds=BOUNDS, object_poses=each, exclude=exclude), expected)
    nothing = voxel_map_from_scene(scene, CAMERA, np.zeros((0, 7)), bounds=BOUNDS)
    assert nothing.counts() == {Voxel.UNKNOWN: 57 * 48 * 25, Voxel.HIDDEN: 0, Voxel.FREE: 0, Voxel.SURFACE: 0}


def test_default_bounds_are_those_of_the_scene(device):
    """A flat floor bounds the scene and lies in one layer of voxels."""
    scene = wv.Scene(device=device)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    scene.add((corners, np.array([[0, 1, 2], [0, 2, 3]])), name="floor", label="ground")
    scene.add(trimesh.creation.box((0.2, 0.2, 0.4)), name="box", pose=(0.3, 0, 0.2, 0, 0, 0, 1))
    result = voxel_map_from_scene(scene, CAMERA, POSES[0], cell_size=0.1)
    np.testing.assert_allclose(result.bounds, [[-1.15, -1.15, -0.15], [1.15, 1.15, 0.55]], atol=1e-6)
    states = result.states.numpy()
    assert not (states[:, :, 0] == Voxel.SURFACE).any()
    assert (states[:, :, 1] == Voxel.SURFACE).sum() > 150
    assert same(voxel_map_from_scene(scene, CAMERA, POSES[0], cell_size=0.1, out=result), result)


def test_centers_counts_volumes_and_files(tmp_path, device):
    views = render(build(device))
    result = voxel_map(views.depth, CAMERA, POSES, bounds=((0, 0, 0), (1, 0.8, 0.6)), cell_size=0.1, up="y")
    centers = result.centers()
    assert centers.shape == (10, 8, 6, 3)
    assert centers.dtype == np.float32
    np.testing.assert_allclose(centers[2, 0, 5], [0.25, 0.05, 0.55], atol=1e-6)
    states, counts = result.states.numpy(), result.counts()
    assert list(counts) == list(Voxel)
    assert all(counts[state] == (states == state).sum() for state in Voxel)
    assert result.volume("surface") == pytest.approx(counts[Voxel.SURFACE] * 1e-3)
    assert sum(map(result.volume, Voxel)) == pytest.approx(0.48)
    result.save(tmp_path / "map")
    with np.load(tmp_path / "map") as saved:
        classes = {"label_numbers", "label_names", "ground_labels"}
        assert set(saved) == {"states", "labels", "origin", "cell_size", "up", *classes}
        assert dict(zip(saved["label_numbers"], saved["label_names"], strict=True)) == dict(result.label_names)
        assert saved["ground_labels"].tolist() == [Label.GROUND]
        np.testing.assert_array_equal(saved["states"], states)
        np.testing.assert_array_equal(saved["labels"], result.labels.numpy())
        assert (tuple(saved["origin"]), saved["cell_size"], saved["up"]) == ((0, 0, 0), 0.1, "y")


DEPTH = np.ones((1, 120, 160), dtype=np.float32)
UNIT = ((0, 0, 0), (1, 1, 1))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"bounds": ((0, 0), (1, 1))}, "a box, shape (2, 3), got [[0.0, 0.0], [1.0, 1.0]]"),
        ({"bounds": ((0, 0, 0), (1, 0, 1))}, "bounds must be the lower and upper corner of a box"),
        ({"bounds": ((0, 0, 0), (1, np.nan, 1))}, "bounds must be the lower and upper corner of a box"),
        ({"bounds": "room"}, "bounds must be an array of numbers"),
        ({"cell_size": 0}, "cell_size must be a positive number of meters, got 0"),
        ({"cell_size": np.nan}, "cell_size must be a positive number of meters, got nan"),
        ({"cell_size": "5 cm"}, "cell_size must be a positive number of meters, got '5 cm'"),
        (
            {"cell_size": 1e-4},
            "a grid must have at most 2147483647 voxels, got 10000 x 10000 x 10000; use a cell_size greater",
        ),
        ({"depth": DEPTH[:, 1:]}, "depth must have shape (V, 120, 160), got (1, 119, 160)"),
        ({"depth": (DEPTH * 1000).astype(np.uint16)}, "depth must be in meters, a float array, got uint16"),
        (
            {"camera_to_world": np.tile(POSES[0], (2, 1))},
            "camera_to_world must have one pose for each view of depth, 1, got 2",
        ),
        ({"camera": 3}, "camera must be a warpvis.Camera or a warpvis.cameras.LensCamera, got int"),
        ({"labels": np.ones((1, 12, 16), dtype=np.uint8)}, "labels must have shape (1, 120, 160), got (1, 12, 16)"),
        ({"labels": np.ones((120, 160))}, "labels must be uint8, got float64"),
        ({"labels": np.full((1, 120, 160), 300)}, "labels must fit uint8"),
        ({"ground_labels": ["road"]}, "label must be one of empty (0), "),
        ({"label_names": {40: "ground"}}, "label_names must be different names, got 'ground' for 1 and for 40"),
        ({"up": "x"}, 'up must be "z" or "y"'),
        ({"convention": "blender"}, "convention must be one of"),
        ({"device": "cuda:99"}, "device 'cuda:99' is not on this machine"),
        ({"threads": 0}, "threads must be a whole number from 1 up, got 0"),
        ({"out": np.zeros((10, 10, 10))}, "out must be a warpvis.VoxelMap, got ndarray"),
    ],
)
def test_invalid_input_raises(change, said):
    given = {"depth": DEPTH, "camera": CAMERA, "camera_to_world": POSES[0], "bounds": UNIT, "cell_size": 0.1, **change}
    with pytest.raises(wv.WarpvisError) as error:
        voxel_map(**given)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("change", "got"),
    [
        ({"cell_size": 0.2}, "5 x 5 x 5 voxels of 0.2 m from (0.0, 0.0, 0.0), z up"),
        ({"bounds": ((0, 0, 0.05), (1, 1, 1.05))}, "10 x 10 x 10 voxels of 0.1 m from (0.0, 0.0, 0.05), z up"),
        ({"bounds": ((0, 0, 0), (1, 2, 1))}, "10 x 20 x 10 voxels of 0.1 m from (0.0, 0.0, 0.0), z up"),
        ({"up": "y"}, "10 x 10 x 10 voxels of 0.1 m from (0.0, 0.0, 0.0), y up"),
    ],
)
def test_maps_of_other_grids_do_not_merge(change, got):
    given = {"depth": DEPTH, "camera": CAMERA, "camera_to_world": POSES[0], "bounds": UNIT, "cell_size": 0.1}
    first, other = voxel_map(**given), voxel_map(**{**given, **change})
    wanted = "10 x 10 x 10 voxels of 0.1 m from (0.0, 0.0, 0.0), z up"
    before = first.states.numpy().copy()
    with pytest.raises(wv.errors.ArrayError) as error:
        first.merge(other)
    assert str(error.value) == f"the other map must be of {wanted}, got {got}"
    with pytest.raises(wv.errors.ArrayError) as error:
        voxel_map(**{**given, **change}, out=first)
    assert str(error.value) == f"out must be of {got}, got {wanted}"
    assert (first.states.numpy() == before).all()


def test_invalid_calls_raise(tmp_path):
    scene, result = build(), voxel_map(DEPTH, CAMERA, POSES[0], bounds=UNIT, cell_size=0.1)
    calls = {
        "scene must be a warpvis.Scene, got int": lambda: voxel_map_from_scene(3, CAMERA, POSES),
        "the scene has no objects": lambda: voxel_map_from_scene(wv.Scene(), CAMERA, POSES),
        "cell_size must be a positive number of meters, got -1": lambda: voxel_map_from_scene(
            scene, CAMERA, POSES, cell_size=-1
        ),
        "out must be a warpvis.VoxelMap, got int": lambda: voxel_map_from_scene(scene, CAMERA, POSES, out=3),
        "out must be of 20 x 20 x 20 voxels of 0.05 m": lambda: voxel_map_from_scene(scene, CAMERA, POSES, out=result),
        "the scene has no object 'robot'": lambda: voxel_map_from_scene(scene, CAMERA, POSES, exclude=["robot"]),
        "object_poses were given, but no object": lambda: voxel_map_from_scene(
            scene, CAMERA, POSES, object_poses=POSES
        ),
        "the other map must be a warpvis.VoxelMap, got NoneType": lambda: result.merge(None),
        "state of a voxel must be one of UNKNOWN (0), HIDDEN (1), FREE (2), SURFACE (3), got 'empty'": (
            lambda: result.volume("empty")
        ),
        "robots must be finite rows of center and radius": lambda: result.floor_map(robots=[(0, 0)]),
        "cannot be written: No such file or directory": lambda: result.save(tmp_path / "nowhere" / "map.npz"),
    }
    for said, call in calls.items():
        with pytest.raises(wv.WarpvisError) as error:
            call()
        assert said in str(error.value)


def test_maps_on_different_devices_do_not_merge(cuda):
    here, there = (voxel_map(DEPTH, CAMERA, POSES[0], bounds=UNIT, device=device) for device in ("cpu", cuda))
    assert isinstance(there, VoxelMap)
    with pytest.raises(wv.errors.ArrayError, match="the other map must be on device cpu, got cuda:0"):
        here.merge(there)
    assert str(voxel_map(DEPTH, CAMERA, POSES[0], bounds=UNIT, out=there).states.device) == cuda
