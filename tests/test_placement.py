# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Places for cameras: visibility in all worlds, the greedy and the exact choice, and its bounds."""

import itertools
import json
import math
import sys

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Visibility
from warpvis.core.poses import poses_to_matrices
from warpvis.planning import Samples, place_cameras, surface_samples, unknown_targets
from warpvis.planning._choice import choose_exactly, choose_greedily, tally_of
from warpvis.planning._seen_pairs import SeenPairs, find_seen_pairs, full_words
from warpvis.scene import solids

import reference
from support.worlds import MESHES, build, eyes, random_poses

CAMERA = wv.Camera.from_fov(160, 120, hfov=1.2, near=0.1, far=20.0)
STILL = (0, 0, 0, 1)
TOLERANCE = 1e-3


def seen_by_world(scene, camera, poses, points, object_poses, **options):
    """Return visibility by one call of `point_visibility` for each world, shape (V, N, T)."""
    seen = [
        wv.point_visibility(scene, camera, poses, points, tolerance=TOLERANCE, object_poses=row, **options).numpy()
        for row in object_poses
    ]
    return np.stack(seen, axis=2) == Visibility.VISIBLE


def unpack(pairs, cameras, targets):
    seen = np.zeros((cameras, targets, pairs.worlds), dtype=bool)
    for camera in range(cameras):
        found, worlds = pairs.unpack(camera)
        seen[camera, found] = worlds
    return seen


def find(scene, camera, poses, points, object_poses, exclude=None):
    import warp as wp

    poses = wp.array(np.asarray(poses, np.float32), dtype=wp.transform, device=scene.device)
    points = wp.array(np.asarray(points, np.float32), dtype=wp.vec3, device=scene.device)
    options = {"occupancy": None, "object_poses": object_poses, "exclude": exclude, "threads": None}
    return find_seen_pairs(scene, camera, poses, points, tolerance=TOLERANCE, **options)


def packed(seen):
    """Return `SeenPairs` of visibility of shape (V, N, T)."""
    counts = seen.any(axis=2).sum(axis=1)
    targets = np.concatenate([np.flatnonzero(row.any(axis=1)) for row in seen]).astype(np.int32)
    words = np.zeros((len(targets), len(full_words(seen.shape[2]))), dtype="<u8")
    octets = np.packbits(seen[seen.any(axis=2)], axis=1, bitorder="little")
    words.view(np.uint8)[:, : octets.shape[1]] = octets
    return SeenPairs(np.concatenate([[0], np.cumsum(counts)]), targets, words, seen.shape[2])


def value(seen, cameras, weights, at_least):
    """Return the objective by its definition."""
    counts = seen[list(cameras)].sum(axis=0)
    return float((np.minimum(counts, at_least) * weights[:, None]).sum() / at_least / weights.sum() / seen.shape[2])


def wall_between():
    """Return a floor, two cameras above it that look down at x = -1 and x = 1, and a person to move."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((4, 2, 0.02)), name="floor", label="ground")
    scene.add(trimesh.creation.box((0.4, 0.4, 0.8)), name="person", pose=(9, 9, 0.5, *STILL), movable=True)
    return scene, np.array([(-1, 0, 2, 1, 0, 0, 0), (1, 0, 2, 1, 0, 0, 0), (1, 0.1, 2, 1, 0, 0, 0)], dtype=float)


@pytest.mark.parametrize("worlds", [1, 3, 70])
def test_visibility_in_worlds_matches_point_visibility(device, worlds):
    rng = np.random.default_rng(worlds)
    rows = random_poses(rng, worlds, len(MESHES))
    scene = build(device, rows[0], movable=True)
    points = rng.uniform((-2, -2, 0), (2, 2, 1.5), (150, 3)).astype(np.float32)
    expected = seen_by_world(scene, CAMERA, eyes(5), points, rows)
    assert (unpack(find(scene, CAMERA, eyes(5), points, rows), 5, 150) == expected).all()
    assert 0.1 < expected.mean() < 0.9
    if worlds > 1:
        assert (expected.any(axis=2) & ~expected.all(axis=2)).mean() > 0.1


def test_cameras_at_one_place_share_their_lines_of_sight(device):
    rng = np.random.default_rng(9)
    rows = random_poses(rng, 40, len(MESHES))
    scene = build(device, rows[0], movable=True)
    places = eyes(3)[[0, 1, 0, 2, 1, 0], :3]
    poses = np.array([wv.look_at(place, rng.normal(0, 0.7, 3)) for place in places])
    points = rng.uniform((-2, -2, 0), (2, 2, 1.5), (150, 3)).astype(np.float32)
    expected = seen_by_world(scene, CAMERA, poses, points, rows)
    assert (unpack(find(scene, CAMERA, poses, points, rows), 6, 150) == expected).all()
    assert (expected[0] & expected[2]).any()


def test_objects_that_do_not_move_and_excluded_ones(device):
    rng = np.random.default_rng(4)
    rows = random_poses(rng, 6, len(MESHES))
    rows[:, [0, 3]] = rows[0, [0, 3]]
    scene = build(device, rows[0], movable=True)
    points = rng.uniform((-2, -2, 0), (2, 2, 1.5), (150, 3)).astype(np.float32)
    for exclude in (None, ["moved_1"], ["moved_3", "floor"]):
        expected = seen_by_world(scene, CAMERA, eyes(4), points, rows, exclude=exclude)
        assert (unpack(find(scene, CAMERA, eyes(4), points, rows, exclude), 4, 150) == expected).all()


def test_solids_and_lenses(device):
    """Round solids have their true surface, and a lens bends no line of sight."""
    rng = np.random.default_rng(5)
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((6, 6, 0.02)), name="floor", label="ground")
    for number in range(3):
        scene.add(solids.capsule(0.25, 0.4), name=f"person_{number}", pose=(0, 0, 0, *STILL), movable=True)
    rows = random_poses(rng, 5, 3)
    points = rng.uniform((-2, -2, 0), (2, 2, 1.5), (150, 3)).astype(np.float32)
    lens = wv.cameras.LensCamera(wv.cameras.lenses.OpenCVPinhole(90, 90, 80, 60, (-0.1, 0, 0, 0)), 160, 120)
    for camera in (CAMERA, lens):
        expected = seen_by_world(scene, camera, eyes(4), points, rows)
        assert (unpack(find(scene, camera, eyes(4), points, rows), 4, 150) == expected).all()
        assert (expected.any(axis=2) & ~expected.all(axis=2)).sum() > 20


def test_hidden_worlds_match_the_reference(device):
    rng = np.random.default_rng(6)
    rows = random_poses(rng, 4, len(MESHES))
    scene = build(device, rows[0], movable=True, static=False)
    points = rng.uniform((-2, -2, 0), (2, 2, 1.5), (60, 3)).astype(np.float32)
    cameras = eyes(3)
    in_view = build(device, rows[0] + [50, 0, 0, 0, 0, 0, 0], movable=True, static=False)
    far = np.asarray(in_view.movable)
    away = np.tile(np.array([0, 0, -1e4, *STILL]), (1, len(far), 1))
    pairs = np.argwhere(seen_by_world(in_view, CAMERA, cameras, points, away)[..., 0])
    corners = []
    for world in rows:
        matrices = poses_to_matrices(world)
        parts = [item.mesh_vertices @ m[:3, :3].T + m[:3, 3] for item, m in zip(scene.objects, matrices, strict=True)]
        corners.append(np.concatenate([part[item.faces] for part, item in zip(parts, scene.objects, strict=True)]))
    seen, margin = reference.clear_hidden_worlds(corners, cameras[:, :3], points, pairs, TOLERANCE)
    found = unpack(find(scene, CAMERA, cameras, points, rows), 3, 60)[tuple(pairs.T)]
    assert ((found == seen) | (margin < 1e-5)).all()
    assert 0.2 < seen.mean() < 0.9


def test_greedy_and_exact_choice_against_all_choices():
    """The bounds hold for every choice, and the exact one is the best."""
    rng = np.random.default_rng(7)
    ratios, tight = [], []
    for trial in range(60):
        cameras, targets, worlds, fixed = 8, int(rng.integers(1, 12)), int(rng.integers(1, 5)), int(trial % 3)
        k, at_least = int(rng.integers(1, 5)), int(rng.integers(1, 4))
        seen = rng.random((cameras + fixed, targets, worlds)) < rng.choice([0.1, 0.3, 0.6])
        weights = rng.integers(1, 5, targets).astype(float)
        pairs, existing = packed(seen), list(range(cameras, cameras + fixed))
        shares = weights / weights.sum() / worlds
        best = max(value(seen, (*some, *existing), weights, at_least) for some in itertools.combinations(range(8), k))
        start = tally_of(pairs, existing, targets, at_least)
        base = value(seen, existing, weights, at_least) if fixed else 0.0
        assert start.value(shares) == pytest.approx(base)
        exact = choose_exactly(pairs, start, range(cameras), shares, k, 60.0)
        greedy = choose_greedily(pairs, start, range(cameras), shares, k)
        for choice in (exact, greedy):
            assert len(set(choice.order)) == k
            assert max(choice.order) < cameras
            reached = value(seen, (*choice.order, *existing), weights, at_least)
            assert base + sum(choice.gains) == pytest.approx(reached)
            assert (np.diff(choice.gains) <= 1e-12).all()
            assert choice.bound >= best - 1e-9
        assert exact.bound == pytest.approx(best)
        assert base + sum(exact.gains) == pytest.approx(best)
        assert sum(greedy.gains) >= (1 - 1 / math.e) * (best - base) - 1e-9
        tight.append(greedy.bound - best < 1e-9)
        ratios.append(sum(greedy.gains) / max(best - base, 1e-9))
    assert min(ratios) < 0.999
    assert np.mean(tight) > 0.3


def test_greedy_choice_by_definition():
    rng = np.random.default_rng(8)
    seen = rng.random((30, 40, 5)) < 0.1
    weights = rng.uniform(0.5, 2, 40)
    shares = weights / weights.sum() / 5
    found = choose_greedily(packed(seen), tally_of(packed(seen), [], 40, 2), range(30), shares, 6)
    chosen = []
    for camera, gain in zip(found.order, found.gains, strict=True):
        values = [value(seen, [*chosen, other], weights, 2) for other in range(30)]
        before = value(seen, chosen, weights, 2) if chosen else 0.0
        left = [values[other] if other not in chosen else -1.0 for other in range(30)]
        assert left[camera] == pytest.approx(max(left))
        assert gain == pytest.approx(left[camera] - before)
        chosen.append(camera)


@pytest.mark.parametrize("method", ["greedy", "exact"])
def test_a_person_who_walks(method):
    """The person hides the left targets in the first of three worlds."""
    scene, poses = wall_between()
    walk = np.tile(np.array([9, 9, 0.5, *STILL]), (3, 1, 1))
    walk[0, 0, :2] = -1, 0
    points = [(-1, 0, 0.02), (-1.1, 0, 0.02), (1, 0, 0.02)]
    found = place_cameras(scene, CAMERA, poses, points, 2, object_poses=walk, method=method)
    assert sorted(found.order.tolist()) == [0, 1]
    assert found.counts.tolist() == [[0, 0, 1], [1, 1, 1], [1, 1, 1]]
    assert found.gains.tolist() == pytest.approx([4 / 9, 3 / 9])
    assert found.fraction == pytest.approx(7 / 9)
    assert found.bound == found.reachable == pytest.approx(7 / 9)
    assert found.covered_fraction == pytest.approx(7 / 9)
    assert found.blind_spots().tolist() == [[0, 0], [0, 1]]
    assert found.share_by_target().tolist() == pytest.approx([2 / 3, 2 / 3, 1])
    assert found.share_by_world().tolist() == pytest.approx([1 / 3, 1, 1])
    assert (found.poses == poses[found.order]).all()
    assert json.loads(json.dumps(found.report()))["worst_world"] == 0


def test_two_views_of_each_target_fixed_cameras_and_weights():
    scene, poses = wall_between()
    points = [(-1, 0, 0.02), (1, 0, 0.02)]
    twice = place_cameras(scene, CAMERA, poses, points, 2, at_least=2)
    assert sorted(twice.order.tolist()) == [0, 1]  # 0 and 1 tie with 1 and 2; the lower index is chosen
    assert twice.gains.tolist() == [0.25, 0.25]
    assert twice.blind_spots().tolist() == [[0, 0], [0, 1]]
    assert twice.blind_spots(1).tolist() == []
    heavy = place_cameras(scene, CAMERA, poses, points, 2, at_least=2, weights=[1, 3])
    assert heavy.order.tolist() == [1, 2]
    assert heavy.fraction == pytest.approx(0.75)
    beside = place_cameras(scene, CAMERA, poses, points, 1, at_least=1, fixed=poses[1])
    assert beside.order.tolist() == [0]
    assert (beside.fixed_share, beside.fraction) == (0.5, 1)
    assert beside.bound == pytest.approx(1)
    samples = Samples(np.array(points, dtype=np.float32), None, np.array([3.0, 1.0]), None)
    assert place_cameras(scene, CAMERA, poses, samples, 1).fraction == pytest.approx(0.75)
    ground = place_cameras(scene, CAMERA, poses, surface_samples(scene, labels="ground", spacing=0.2), 3)
    assert 0.2 < ground.fraction < 0.6  # the floor's lower side is not visible
    assert ground.report()["never_seen"]


def test_next_views_of_a_map():
    """The second camera sees the space behind the box that hides it from the first one."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((0.4, 1.5, 1.0)), name="box", pose=(0, 0, 0.5, *STILL))
    scene.add(trimesh.creation.box((6, 6, 0.02)), name="floor", label="ground")
    first = wv.look_at((-2.5, 0, 0.6), (0, 0, 0.5))
    occupancy = wv.OccupancyMap(cell_size=0.1)
    for _ in range(2):
        occupancy.integrate(wv.render(scene, CAMERA, first).depth, CAMERA, first)
    bounds = [(-2, -2, 0.1), (2, 2, 1.0)]
    targets = unknown_targets(occupancy, bounds)
    states = occupancy.states(targets)
    states = states.numpy() if hasattr(states, "numpy") else states
    assert set(states.tolist()) <= {wv.maps.Voxel.UNKNOWN, wv.maps.Voxel.HIDDEN}
    steps = 0.1 * np.concatenate([np.eye(3), -np.eye(3)])
    beside = np.stack([np.asarray(occupancy.states(targets + step).numpy()) for step in steps])
    assert (beside == wv.maps.Voxel.FREE).any(axis=0).all()
    others = [wv.look_at((-2.4, 0, 0.6), (0, 0, 0.5)), wv.look_at((-1.5, 1.8, 1.5), (0.5, 0, 0.3))]
    found = place_cameras(occupancy, CAMERA, [first, *others], targets, 1)
    assert len(targets) > 50
    assert found.fraction > 0
    with pytest.raises(wv.WarpvisError, match=r"^occupancy must be a warpvis\.OccupancyMap, got Scene$"):
        unknown_targets(scene)


def test_pictures(tmp_path):
    """The map has the share of worlds of its targets, weighted, and NaN without targets."""
    from warpvis.viz._placement import _map_shares

    scene, poses = wall_between()
    walk = np.tile(np.array([9, 9, 0.5, *STILL]), (4, 1, 1))
    walk[0, 0, :2] = -1, 0
    points = [(-1, 0.02, 0.02), (1, 0.02, 0.02), (1, 0.03, 5.0)]  # the third one is above the cameras
    found = place_cameras(scene, CAMERA, poses, points, 2, object_poses=walk, weights=[1, 3, 1], fixed=poses[2])
    shares, bounds = _map_shares(found, [0, 1], 0.5)
    assert bounds == (-1.0, 1.5, 0.0, 0.5)
    np.testing.assert_allclose(shares, [[0.75, np.nan, np.nan, np.nan, 0.75]])
    wv.viz.save_placement(scene, found, tmp_path / "placed.png", cell_size=0.1)
    assert (tmp_path / "placed.png").stat().st_size > 10_000
    with pytest.raises(wv.WarpvisError, match=r"^placement must be a result of planning\.place_cameras, got int$"):
        wv.viz.save_placement(scene, 3, tmp_path / "placed.png")
    with pytest.raises(wv.WarpvisError, match=r"^cell_size must give at most 1e\+07 cells, got .*; use larger cells$"):
        wv.viz.save_placement(scene, found, tmp_path / "placed.png", cell_size=1e-7)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scene": 3}, "scene must be a warpvis.Scene, got int"),
        ({"camera": None}, "camera must be a warpvis.Camera or a warpvis.cameras.LensCamera, got NoneType"),
        ({"candidates": np.zeros((0, 7))}, "candidates must be one or more poses, got none"),
        ({"fixed": np.zeros((0, 7))}, "fixed must be one or more poses, got none"),
        ({"k": 4}, "k must be a whole number from 1 to the 3 candidates, got 4"),
        ({"k": 0}, "k must be a whole number from 1 to the 3 candidates, got 0"),
        ({"k": 1.5}, "k must be a whole number from 1 to the 3 candidates, got 1.5"),
        ({"at_least": 0}, "at_least must be a whole number from 1 up, got 0"),
        ({"at_least": 3}, "at_least must be at most 2, the number of cameras, got 3"),
        ({"targets": np.zeros((0, 3))}, "targets must be at least one, got 0"),
        ({"targets": np.zeros((2, 2))}, "targets must have shape (N, 3), got (2, 2)"),
        ({"targets": [(0, 0, np.nan)]}, "targets must be finite: 1 are not, the first at 0"),
        ({"weights": [1]}, "weights must have shape (2,), one for every target, got (1,)"),
        ({"weights": [1, -1]}, "weights must be finite and not negative: 1 are not, the first at 1"),
        ({"weights": [0, 0]}, "weights and areas of targets must be finite, not negative, and not all zero"),
        ({"method": "best"}, 'method must be "greedy" or "exact", got \'best\''),
        ({"tolerance": -1}, "tolerance must be a number of meters from 0 up, got -1"),
        ({"exclude": ["cat"]}, "the scene has no object 'cat'; it has 'floor', 'person'"),
        (
            {"object_poses": np.zeros((4, 2, 7))},
            "object_poses must have shape (W, 1, 7), rows x y z qx qy qz qw of the movable objects in W worlds, got "
            "(4, 2, 7)",
        ),
        (
            {"scene": wv.OccupancyMap(cell_size=0.1), "object_poses": np.zeros((4, 1, 7))},
            "scene must be a warpvis.Scene for object_poses and exclude, got an OccupancyMap",
        ),
    ],
)
def test_invalid_arguments_raise(change, said):
    scene, poses = wall_between()
    given = {"scene": scene, "camera": CAMERA, "candidates": poses, "targets": [(-1, 0, 0), (1, 0, 0)], "k": 2}
    with pytest.raises(wv.WarpvisError) as error:
        place_cameras(**(given | change))
    assert str(error.value) == said


def test_exact_choice_needs_scipy_and_a_small_problem(monkeypatch):
    scene, poses = wall_between()
    arguments = scene, CAMERA, poses, [(-1, 0, 0.02), (1, 0, 0.02)], 2
    monkeypatch.setattr("warpvis.planning._choice.MAX_EXACT", 5)
    with pytest.raises(wv.WarpvisError, match=r'^method="exact" takes at most 5 candidates .*, got 6; use method="gr'):
        place_cameras(*arguments, method="exact")
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    with pytest.raises(wv.WarpvisError, match=r"SciPy, which is missing: pip install 'warpvis\[planning\]'$"):
        place_cameras(*arguments, method="exact")
    assert place_cameras(*arguments).fraction == 1
