# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Minimum visible heights of points: closed forms, unions of intervals, and individual lines of sight."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Visibility, scenes
from warpvis.planning import minimum_height

import reference

WALL_TOP = 1.0


def box(scene, low, high, **options):
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    scene.add(trimesh.creation.box(high - low), pose=(*(low + high) / 2, 0, 0, 0, 1), **options)


def wall_scene(device="cpu"):
    """Return a scene with a floor and a sheet at x = 2 that is 1 m high."""
    scene = wv.Scene(device=device)
    corners = [(2, -3, 0), (2, 3, 0), (2, 3, WALL_TOP), (2, -3, WALL_TOP)]
    scene.add((np.array(corners), np.array([(0, 1, 2), (0, 2, 3)])), name="wall")
    box(scene, (-10, -10, -0.5), (10, 10, 0), name="floor", label="ground")
    return scene


def heights(scene, eyes, targets, **options):
    return minimum_height(scene, np.atleast_2d(eyes), np.atleast_2d(targets), **options).numpy()


def corners_of(scene):
    return np.concatenate([item.vertices[item.faces] for item in scene.objects])


def soup(rng, count, size=0.6):
    """Return `count` random triangles in a box."""
    middles = rng.uniform([0, -1, 0], [4, 1, 3], (count, 1, 3))
    corners = (middles + rng.uniform(-size, size, (count, 3, 3))).astype(np.float32)
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def is_blocked(corners, fixed, raised, share):
    """Return whether the open line of sight intersects a triangle (Möller and Trumbore 1997)."""
    way = raised - fixed
    a, b, c = np.asarray(corners, dtype=np.float64).swapaxes(0, 1)
    p = np.cross(way, c - a)
    determinant = ((b - a) * p).sum(axis=1)
    q = np.cross(fixed - a, b - a)
    u, v = ((fixed - a) * p).sum(axis=1) / determinant, q @ way / determinant
    t = ((c - a) * q).sum(axis=1) / determinant
    return bool(((u > 0) & (v > 0) & (u + v < 1) & (t > share) & (t < 1 - share)).any())


def test_height_over_wall_matches_similar_triangles(device):
    scene = wall_scene(device)
    eyes = [(0, 0, 0.5), (0, 1, 1.5), (0, 0, 3.0)]
    targets = [(4, 0, 0), (8, 1, 0), (8, -1, 0.25), (1, 1, 0), (2, 0, 0.5), (2, 0, 1)]
    got = heights(scene, eyes, targets, max_height=20)
    for row, eye in zip(got, eyes, strict=True):
        for height, (x, _, z) in zip(row, targets, strict=True):
            behind = eye[2] + (WALL_TOP - eye[2]) * x / 2 - z if x > 2 else 0.0  # by similar triangles
            assert height == pytest.approx(max(behind, 0.0), abs=1e-5)
    raised = heights(scene, eyes, targets, max_height=20, raises="eye")
    for row, eye in zip(raised, eyes, strict=True):
        for height, (x, _, z) in zip(row, targets, strict=True):
            behind = (WALL_TOP - z * 2 / x) * x / (x - 2) - eye[2] if x > 2 else 0.0
            assert height == pytest.approx(max(behind, 0.0), abs=1e-5)


def test_height_above_maximum_is_infinite(device):
    scene = wall_scene(device)
    needed = heights(scene, (0, 0, 0.5), (8, 0, 0))[0, 0]
    assert needed == pytest.approx(2.5)
    assert heights(scene, (0, 0, 0.5), (8, 0, 0), max_height=2.4)[0, 0] == np.inf
    assert heights(scene, (0, 0, 0.5), (8, 0, 0), max_height=2.6)[0, 0] == needed
    assert heights(scene, (0, 0, 0.5), [(8, 0, 0), (1, 0, 0)], max_height=0).tolist() == [[np.inf, 0]]


def test_point_below_bridge_is_seen_through_gap(device):
    scene = wv.Scene(device=device)
    box(scene, (2.0, -5, 0.0), (2.1, 5, 0.5))  # a low wall, and a slab over it
    box(scene, (2.0, -5, 1.0), (2.1, 5, 1.5))
    below, above = 0.75 - 0.25 * 4.2 / 2.1, 0.75 + 0.75 * 4.2 / 2.0  # where shadows of wall and slab end, at x = 4.2
    targets = [(4.2, 0, z) for z in (0.0, 0.2, 0.3, 1.2, 1.3, 2.0, 2.4)]
    got = heights(scene, (0, 0, 0.75), targets)[0]
    np.testing.assert_allclose(got, [below, below - 0.2, 0, 0, above - 1.3, above - 2.0, 0], atol=1e-6)


def test_vertical_lines_of_sight(device):
    scene = wv.Scene(device=device)
    box(scene, (-1, -1, 0.70), (1, 1, 0.75), name="table")
    above, below = (0.1, 0.2, 2.0), (0.1, 0.2, 0.0)
    assert heights(scene, above, below)[0, 0] == pytest.approx(0.75, abs=2e-4)
    assert heights(scene, above, below, raises="eye")[0, 0] == np.inf
    assert heights(scene, below, above)[0, 0] == np.inf
    assert heights(scene, below, above, raises="eye")[0, 0] == pytest.approx(0.75, abs=2e-4)
    assert heights(scene, above, below, exclude=["table"])[0, 0] == 0
    assert heights(scene, above, (0.1, 0.2, 0.8))[0, 0] == 0
    assert heights(scene, above, above)[0, 0] == 0


def test_edge_on_triangle_does_not_block(device):
    scene = wv.Scene(device=device)
    scene.add((np.array([(1, 0, 0), (2, 0, 0), (2, 0, 1.0)]), np.array([(0, 1, 2)])))
    assert heights(scene, (0, 0, 0.1), (3, 0, 0.1))[0, 0] == 0
    assert heights(scene, (0, 1, 0.1), (3, -1, 0.1))[0, 0] > 0


@pytest.mark.parametrize("up", ["z", "y"])
@pytest.mark.parametrize("raises", ["target", "eye"])
def test_random_triangles_match_union_of_shadow_intervals(up, raises, device):
    rng = np.random.default_rng(3)
    vertices, faces = soup(rng, 80)
    eyes, targets = rng.uniform([-2, -1, 0], [0, 1, 2], (4, 3)), rng.uniform([3, -1, 0], [6, 1, 2], (50, 3))
    targets[0] = [*eyes[0, :2], eyes[0, 2] - 0.5]
    axes = [0, 1, 2] if up == "z" else [1, 2, 0]  # y-up: z becomes y
    vertices, eyes, targets = (rows[:, axes].astype(np.float32) for rows in (vertices, eyes, targets))
    scene = wv.Scene(device=device, up=up)
    scene.add((vertices, faces))
    got = minimum_height(scene, eyes, targets, raises=raises, max_height=3.0).numpy()
    options = {"up": "xyz".index(up), "raise_eyes": raises == "eye", "max_height": 3.0, "end_tolerance": 1e-4}
    expected = reference.climb(corners_of(scene), eyes, targets, **options)
    assert (np.isinf(got) == np.isinf(expected)).all()
    np.testing.assert_allclose(got, expected, atol=2e-6)
    assert np.isinf(got).any() and (got == 0).any() and ((got > 0) & np.isfinite(got)).mean() > 0.3


def test_height_is_minimum_of_unblocked_lines():
    rng = np.random.default_rng(4)
    vertices, faces = soup(rng, 80)
    scene = wv.Scene()
    scene.add((vertices, faces))
    eye = np.array([-1.0, 0, 1])
    targets = rng.uniform([3, -1, 0], [6, 1, 2], (60, 3)).astype(np.float32).astype(np.float64)
    got = heights(scene, eye, targets, max_height=50)[0]
    for target, height in zip(targets, got, strict=True):
        share = 1e-4 / np.linalg.norm(target - eye)
        assert not is_blocked(vertices[faces], eye, target + [0, 0, height + 1e-5], share)
        tried = np.linspace(0, height - 1e-5, 40) if height > 0 else []
        assert all(is_blocked(vertices[faces], eye, target + [0, 0, h], share) for h in tried)
    assert (got > 0).sum() > 20


def test_adjacent_triangles_are_watertight(device):
    """Lines of sight lie in planes along edges and through vertices of finely divided walls."""
    wall = trimesh.creation.box((0.125, 4, 1))
    for _ in range(3):
        wall = wall.subdivide()
    scene = wv.Scene(device=device)
    scene.add(wall, pose=(2, 0, 0.5, 0, 0, 0, 1))
    sides = np.arange(-6, 7) / 8
    eyes = np.array([(0, y, 0.5) for y in sides])
    targets = np.array([(4, y, 0) for y in sides])
    got = heights(scene, eyes, targets)
    expected = 0.5 + 0.5 * 4 / (2 - 0.0625)
    np.testing.assert_allclose(got, expected, atol=1e-6)


def test_zero_heights_match_point_visibility(device):
    preset = scenes.PRESETS["room"]
    scene, rng = preset.build(device), np.random.default_rng(5)
    camera = wv.Camera.from_fov(320, 240, hfov=1.2)
    pose = preset.poses(1)[0]
    corners = corners_of(scene)
    surface = np.einsum("nc,ncx->nx", rng.dirichlet((1, 1, 1), 1000), corners[rng.integers(0, len(corners), 1000)])
    points = np.concatenate([surface, rng.uniform([-2, -2, 0], [2, 2, 1], (1000, 3))]).astype(np.float32)
    status = wv.point_visibility(scene, camera, pose, points, tolerance=1e-3).numpy()[0]
    free = heights(scene, pose[:3], points, end_tolerance=1e-3)[0] == 0
    in_view = status != Visibility.OUT_OF_VIEW
    assert in_view.sum() > 1000
    assert (free[in_view] == (status[in_view] == Visibility.VISIBLE)).mean() > 0.995
    assert 0.2 < free[in_view].mean() < 0.8


def test_object_poses_and_exclusion_change_heights(device):
    scene = wv.Scene(device=device)
    sheet, faces = np.array([(0, -3, 0), (0, 3, 0), (0, 3, 1.0), (0, -3, 1.0)]), np.array([(0, 1, 2), (0, 2, 3)])
    scene.add((sheet, faces), name="door", pose=(2, 0, 0, 0, 0, 0, 1), movable=True)
    scene.add((sheet + [0, 0, 1], faces), name="sign", pose=(2, 0, 0, 0, 0, 0, 1), attach_to="door")
    eye, target = (0, 0, 0.5), (8, 0, 0)
    top = 0.5 + 1.5 * 8 / 2
    assert heights(scene, eye, target)[0, 0] == pytest.approx(top, abs=1e-5)
    moved = [[4, 0, 0.25, 0, 0, 0, 1]]
    assert heights(scene, eye, target, object_poses=moved)[0, 0] == pytest.approx(0.5 + 1.75 * 8 / 4, abs=1e-5)
    aside = [[2, 10, 0, 0, 0, 0, 1]]
    assert heights(scene, eye, target, object_poses=aside)[0, 0] == 0
    assert heights(scene, eye, target, exclude=["sign"])[0, 0] == pytest.approx(2.5, abs=1e-5)
    assert heights(scene, eye, target, exclude=["sign", "door"])[0, 0] == 0


def test_thread_count_does_not_change_heights(device):
    scene = scenes.PRESETS["room"].build(device)
    targets = np.random.default_rng(6).uniform([-2, -2, 0], [2, 2, 1], (10000, 3))
    one, two = (heights(scene, (-3, 0, 1), targets, threads=threads) for threads in (1, 2))
    assert (one == two).all()
    assert minimum_height(scene, np.zeros((0, 3)), targets).shape == (0, 10000)
    assert minimum_height(scene, targets, np.zeros((0, 3))).shape == (10000, 0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scene": 3}, "scene must be a warpvis.Scene, got int"),
        ({"scene": wv.Scene()}, "the scene has no objects; add() one first"),
        ({"raises": "both"}, 'raises must be "target" or "eye", got \'both\''),
        ({"max_height": -1}, "max_height must be a number of meters from 0 up, got -1"),
        ({"max_height": np.inf}, "max_height must be a number of meters from 0 up, got inf"),
        ({"end_tolerance": 0}, "end_tolerance must be a positive number of meters, got 0"),
        ({"end_tolerance": "1"}, "end_tolerance must be a positive number of meters, got '1'"),
        ({"eyes": np.zeros(3)}, "eyes must have shape (E, 3), got (3,)"),
        ({"eyes": [(np.nan, 0, 0)]}, "eyes must be finite: 1 are not, the first at 0"),
        ({"targets": [(0, 0, 0), (0, np.inf, 0)]}, "targets must be finite: 1 are not, the first at 1"),
        ({"targets": np.zeros((4, 2))}, "targets must have shape (N, 3), got (4, 2)"),
        ({"exclude": ["ball"]}, "the scene has no object 'ball'; it has 'wall', 'floor'"),
        ({"threads": 0}, "threads must be a whole number from 1 up, got 0"),
    ],
)
def test_invalid_arguments_are_rejected(change, said):
    given = {"scene": wall_scene(), "eyes": np.zeros((1, 3)), "targets": np.ones((2, 3)), **change}
    with pytest.raises(wv.WarpvisError) as error:
        minimum_height(given.pop("scene"), given.pop("eyes"), given.pop("targets"), **given)
    assert str(error.value) == said


def test_several_worlds_are_rejected():
    scene = wv.Scene()
    scene.add(trimesh.creation.box(), name="door", movable=True)
    poses = np.tile([0, 0, 0, 0, 0, 0, 1.0], (3, 1, 1))
    with pytest.raises(wv.errors.PoseError, match=r"^object_poses must be of one world, got 3$"):
        minimum_height(scene, np.zeros((1, 3)), np.ones((2, 3)), object_poses=poses)
