# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Surface samples, their coverage by views, and the views with the largest coverage."""

import itertools
import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Label, Visibility, scenes
from warpvis.planning import Samples, clearance, coverage, surface_samples

CAMERA = wv.Camera.from_fov(160, 120, hfov=1.2)
TWO, FIVE = np.zeros((2, 3)), np.zeros((5, 3))


def add_box(scene, low, high, **options):
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    scene.add(trimesh.creation.box(high - low), pose=(*(low + high) / 2, 0, 0, 0, 1), **options)


def sheet(*corners):
    return np.array(corners, dtype=float), np.array([(0, 1, 2), (0, 2, 3)])


def divided_room(device="cpu"):
    """Return a floor of 4 x 2 m, divided into two squares by a high wall at x = 0."""
    scene = wv.Scene(device=device)
    scene.add(sheet((-2, -1, 0), (2, -1, 0), (2, 1, 0), (-2, 1, 0)), name="floor", label="ground")
    scene.add(sheet((0, -1, 0), (0, 1, 0), (0, 1, 9), (0, -1, 9)), name="wall")
    return scene


def looking_down(*places):
    """Return cameras that look straight down, with the image's x axis along the world's."""
    return np.array([[*place, 1, 0, 0, 0] for place in places], dtype=float)


def test_samples_are_even_and_represent_the_area():
    scene = wv.Scene()
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    scene.add(ball, name="ball", pose=(3, 0, 0, 0, 0, 0, 1))
    scene.add(sheet((0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)), name="floor", label="ground")
    add_box(scene, (5, 5, 0), (5.001, 5.001, 0.001), name="crumb")
    samples = surface_samples(scene, spacing=0.05)
    counts = np.bincount(samples.objects)
    assert counts.tolist() == [round(ball.area / 0.05**2), 800, 1]
    for index, area in enumerate((ball.area, 2.0, 6e-6)):
        assert samples.areas[samples.objects == index].sum() == pytest.approx(area, rel=1e-4)
        assert np.ptp(samples.areas[samples.objects == index]) == 0
    on_ball = samples.objects == 0
    outwards = (samples.points[on_ball] - [3, 0, 0]) / 0.5
    assert ((outwards * samples.normals[on_ball]).sum(axis=1) > 0.97).all()
    assert clearance(scene, samples.points, objects=["ball"]).numpy()[on_ball].max() < 1e-6
    floor = samples.points[samples.objects == 1]
    assert (floor[:, 2] == 0).all()
    cells = np.histogram2d(floor[:, 0], floor[:, 1], bins=(8, 4), range=((0, 2), (0, 1)))[0]
    assert cells.sum() == 800
    assert cells.std() < 3  # for random points it is 5


def test_samples_are_reproducible():
    scene = divided_room()
    one, two, other = (surface_samples(scene, seed=seed) for seed in (0, 0, 1))
    assert (one.points == two.points).all()
    assert not (one.points == other.points).all()
    alone = surface_samples(scene, objects=["wall"])
    assert (alone.points == one.points[one.objects == 1]).all()


def test_samples_of_selected_objects():
    scene = divided_room()
    scene.add(trimesh.creation.box(), name="crate", label="object", pose=(9, 0, 0, 0, 0, 0, 1), movable=True)
    assert set(surface_samples(scene).objects.tolist()) == {0, 1, 2}
    assert set(surface_samples(scene, labels="ground").objects.tolist()) == {0}
    assert set(surface_samples(scene, labels=[Label.GROUND, "object"]).objects.tolist()) == {0, 2}
    moved = surface_samples(scene, objects=["crate"], object_poses=[[5, 5, 0, 0, 0, 0, 1]]).points
    np.testing.assert_allclose([moved.min(axis=0), moved.max(axis=0)], [[4.5, 4.5, -0.5], [5.5, 5.5, 0.5]], atol=1e-6)


def test_two_cameras_in_a_divided_room(device):
    """Each camera sees its half of the floor; the third one duplicates the second."""
    scene = divided_room(device)
    samples = surface_samples(scene, spacing=0.02, labels="ground")
    camera = wv.Camera.from_fov(200, 200, hfov=2 * math.atan(0.5))  # covers 2 x 2 m at a distance of 2 m
    found = coverage(scene, camera, looking_down((-1, 0, 2), (1, 0, 2), (1, 0, 2), (1.5, 0, 1)), samples=samples)
    assert found.seen.shape == (4, len(samples))
    np.testing.assert_allclose(found.area_by_view, [4, 4, 4, 1], rtol=0.01)
    np.testing.assert_allclose(found.cumulative, [4, 8, 8, 8], rtol=0.01)
    assert found.total == pytest.approx(8)
    assert found.fraction == pytest.approx(1, abs=0.01)
    left = samples.points[:, 0] < 0
    assert (found.seen[0] == left).mean() > 0.99
    assert found.unseen().mean() < 0.01
    assert sorted(found.order[:2].tolist()) == [0, 1]
    assert found.gain[2:].max() < 0.01
    over = coverage(scene, camera, looking_down((0, 0, 4)), samples=samples)  # above the center: the wall is edge-on
    assert over.fraction == pytest.approx(1, abs=0.01)
    nothing = coverage(scene, camera, looking_down((-1, 0, 2)), samples=samples, exclude=["wall"])
    assert nothing.area_by_view[0] == pytest.approx(4, rel=0.01)


def test_weights_and_plain_points(device):
    scene = divided_room(device)
    points = [(-1, 0, 0), (-1.5, 0.5, 0), (1, 0, 0), (1, 0.5, 0.5), (1.5, -0.5, 0.2)]
    camera = wv.Camera.from_fov(200, 200, hfov=2 * math.atan(0.5))
    poses = looking_down((-1, 0, 2), (1, 0, 2))
    plain = coverage(scene, camera, poses, samples=points)
    assert plain.area_by_view.tolist() == [2, 3]
    assert plain.order.tolist() == [1, 0]
    weighted = coverage(scene, camera, poses, samples=points, weights=[1, 4, 1, 1, 0])
    assert weighted.area_by_view.tolist() == [5, 2]
    assert weighted.order.tolist() == [0, 1]
    assert weighted.gain.tolist() == [5, 2]
    assert weighted.curve.tolist() == [5, 7]
    assert (weighted.total, weighted.fraction) == (7, 1)


def test_coverage_matches_point_visibility(device):
    preset = scenes.PRESETS["room"]
    scene, poses = preset.build(device), preset.poses(6)
    found = coverage(scene, CAMERA, poses, tolerance=2e-3)
    default = surface_samples(scene)
    assert (found.samples.points == default.points).all()
    status = wv.point_visibility(scene, CAMERA, poses, default.points, tolerance=2e-3).numpy()
    assert (found.seen == (status == Visibility.VISIBLE)).all()
    assert (found.unseen() == ~found.seen.any(axis=0)).all()
    for view in range(len(poses)):
        assert found.area_by_view[view] == pytest.approx(default.areas[found.seen[view]].sum())
        assert found.cumulative[view] == pytest.approx(default.areas[found.seen[: view + 1].any(axis=0)].sum())
    assert (np.diff(found.cumulative) >= 0).all()
    assert found.fraction == pytest.approx(found.cumulative[-1] / default.areas.sum())


def test_greedy_views_against_brute_force(device):
    preset = scenes.PRESETS["room"]
    scene, poses = preset.build(device), preset.poses(9)
    found = coverage(scene, CAMERA, poses, samples=surface_samples(scene, spacing=0.1))
    areas = found.weights

    def covered(views):
        return areas[found.seen[list(views)].any(axis=0)].sum()

    assert (np.diff(found.gain) <= 0).all()
    assert sorted(found.order.tolist()) == list(range(9))
    assert found.curve[-1] == pytest.approx(found.cumulative[-1])
    for k in (1, 2, 3):
        optimum = max(covered(views) for views in itertools.combinations(range(9), k))
        assert found.curve[k - 1] == pytest.approx(covered(found.best(k)))
        assert found.curve[k - 1] >= (1 if k == 1 else 1 - 1 / math.e) * optimum - 1e-9
    left = np.ones(len(areas), dtype=bool)
    for view in found.order:  # greedy choice by definition
        gains = [areas[row & left].sum() for row in found.seen]
        assert gains[view] == pytest.approx(max(gains))
        left &= ~found.seen[view]
    some = coverage(scene, CAMERA, poses, samples=found.samples, count=4)
    assert some.order.tolist() == found.order[:4].tolist()


def test_ties_go_to_the_lower_index(device):
    scene = divided_room(device)
    points = [(-1, 0, 0), (1, 0, 0), (-1, 0.3, 0), (1, 0.3, 0)]
    poses = looking_down((1, 0, 2), (-1, 0, 2), (1, 0, 2), (-1, 0, 2))
    assert coverage(scene, CAMERA, poses, samples=points).order.tolist() == [0, 1, 2, 3]


def test_worlds_exclusion_and_batches(device, monkeypatch):
    """Results do not depend on the batch size."""
    scene = divided_room(device)
    scene.add(trimesh.creation.box((2, 2, 0.1)), name="lid", pose=(-1, 0, 1, 0, 0, 0, 1), movable=True)
    samples = surface_samples(scene, objects=["floor"], spacing=0.1)
    poses = looking_down((-1, 0, 2), (1, 0, 2), (-1, 0, 2))
    whole = coverage(scene, CAMERA, poses, samples=samples)
    assert whole.area_by_view[0] == whole.area_by_view[2] == 0
    hidden = np.zeros((3, 3), dtype=np.uint8)
    hidden[2, 2] = 1
    aside = [[0, 9, 0, 0, 0, 0, 1]]
    choices = ({"exclude": hidden}, {"object_poses": aside})
    expected = [coverage(scene, CAMERA, poses, samples=samples, **options).seen for options in choices]
    assert expected[0].any(axis=1).tolist() == [False, True, True]
    assert expected[1].any(axis=1).all()
    monkeypatch.setattr("warpvis.planning._coverage._PAIRS", 1)
    assert (coverage(scene, CAMERA, poses, samples=samples, exclude=hidden).seen == expected[0]).all()
    assert (coverage(scene, CAMERA, poses, samples=samples, object_poses=aside, threads=1).seen == expected[1]).all()
    assert set(coverage(scene, CAMERA, poses, exclude=["lid"]).samples.objects.tolist()) == {0, 1}
    assert set(coverage(scene, CAMERA, poses, exclude=hidden).samples.objects.tolist()) == {0, 1, 2}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scene": 3}, "scene must be a warpvis.Scene, got int"),
        ({"spacing": 0}, "spacing must be a positive number of meters, got 0"),
        ({"spacing": 1e-9}, "spacing must give at most 1e+08 samples, got 8e+18 with 1e-09 m; use a greater spacing"),
        ({"seed": -1}, "seed must be a whole number from 0 up, got -1"),
        ({"objects": ["ball"]}, "the scene has no object 'ball'; it has 'floor', 'wall'"),
        ({"objects": [2]}, "objects must be names, or indices from 0 to 1, got 2"),
        ({"labels": "human"}, "the scene has no object labeled HUMAN"),
        ({"labels": []}, "the scene has no object labeled no label"),
        ({"objects": [0], "labels": "ground"}, "objects and labels must not both be given"),
    ],
)
def test_invalid_surface_samples_arguments_raise(change, said):
    given = {"scene": divided_room(), **change}
    if "spacing" in change:
        given["objects"] = ["floor"]
    with pytest.raises(wv.WarpvisError) as error:
        surface_samples(given.pop("scene"), **given)
    assert str(error.value) == said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scene": None}, "scene must be a warpvis.Scene, got NoneType"),
        ({"camera": None}, "camera must be a warpvis.Camera or a warpvis.cameras.LensCamera, got NoneType"),
        ({"camera_to_world": np.zeros((0, 7))}, "camera_to_world must have at least one pose, got 0"),
        ({"count": 0}, "count must be a whole number from 1 to the 2 views, got 0"),
        ({"count": 3}, "count must be a whole number from 1 to the 2 views, got 3"),
        ({"count": 1.5}, "count must be a whole number from 1 to the 2 views, got 1.5"),
        ({"samples": np.zeros((0, 3))}, "samples must be at least one, got 0"),
        ({"samples": np.zeros((5, 2))}, "samples must have shape (N, 3), got (5, 2)"),
        ({"samples": [(0, 0, np.nan)]}, "samples must be finite: 1 are not, the first at 0"),
        (
            {"samples": Samples(TWO, None, np.ones(3), None)},
            "areas of samples must have shape (2,), got (3,)",
        ),
        (
            {"samples": FIVE, "weights": [1, 2]},
            "weights must have shape (5,), one for every sample, got (2,)",
        ),
        (
            {"samples": TWO, "weights": [1, -2]},
            "weights must be finite and not negative: 1 are not, the first at 1",
        ),
        ({"samples": TWO, "weights": [0, 0]}, "weights and areas of samples must not all be zero"),
        ({"exclude": ["floor", "wall"]}, "exclude must not contain all objects if no samples are given"),
        ({"tolerance": -1}, "tolerance must be a number of meters from 0 up, got -1"),
    ],
)
def test_invalid_coverage_arguments_raise(change, said):
    poses = looking_down((-1, 0, 2), (1, 0, 2))
    given = {"scene": divided_room(), "camera": CAMERA, "camera_to_world": poses, **change}
    with pytest.raises(wv.WarpvisError) as error:
        coverage(given.pop("scene"), given.pop("camera"), given.pop("camera_to_world"), **given)
    assert str(error.value) == said


def test_best_raises_beyond_the_number_of_views():
    found = coverage(divided_room(), CAMERA, looking_down((-1, 0, 2), (1, 0, 2)), samples=[(0.5, 0, 0)], count=1)
    assert found.best(1).tolist() == [1]
    with pytest.raises(
        wv.errors.ArrayError, match=r"^count must be a whole number from 1 to the 1 views of order, got 2$"
    ):
        found.best(2)
