# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Constraints on what a camera sees: each kind, against `object_visibility` and a double-precision reference."""

import math

import numpy as np
import pytest
import trimesh
from reference_silhouettes import measure_silhouettes

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.planning import Constraint, check_constraints
from warpvis.planning._check_constraints import parse_agents

CAMERA = wv.Camera.from_fov(40, 30, hfov=1.2, near=0.3, far=4.0)
POSES = np.stack(
    [
        wv.look_at((-1, 0, 0.5), (1, 0, 0.5)),  # the screen hides half of the mug
        wv.look_at((-1, 1.5, 0.5), (1, 0, 0.5)),  # nothing hides it
        wv.look_at((1, -2.3, 0.5), (1, 0, 0.4)),
        wv.look_at((-1, 0, 0.5), (-3, 0, 0.5)),  # out of view
        wv.look_at((0.7, 0, 0.55), (1, 0, 0.5)),  # too near
        wv.look_at((1, -6, 0.5), (1, 0, 0.5)),  # too far
        wv.look_at((-1, 0, 0.5), (1, 1.3, 0.5)),  # at the border of the image
    ]
)


@pytest.fixture(scope="module")
def scene():
    made = wv.Scene(device="cpu")
    made.add(trimesh.creation.box((0.3, 0.3, 0.4)), name="mug", pose=(1, 0, 0.5, 0, 0, 0, 1))
    made.add(trimesh.creation.box((0.05, 0.4, 0.6)), name="screen", pose=(0, 0.2, 0.5, 0, 0, 0, 1), movable=True)
    made.add(trimesh.creation.box((6, 6, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
    return made


def check(scene, constraint, poses=POSES, **options):
    return check_constraints(scene, CAMERA, poses, {"mug": constraint}, **options)


def test_values_are_those_of_object_visibility(scene):
    ranges = {"fraction": (0, 1), "pixels": (0, None), "image_fraction": (0, 1)}
    found = check(scene, Constraint(**ranges, margin=0, status="visible"))
    seen = wv.object_visibility(scene, CAMERA, POSES, objects=["mug"])
    pixels, silhouette = seen.visible_pixels.numpy()[:, 0], seen.silhouette_pixels.numpy()[:, 0]
    values = {term.quantity: column for term, column in zip(found.terms, found.values.T, strict=True)}
    np.testing.assert_array_equal(values["pixels"], pixels)
    np.testing.assert_array_equal(values["image_fraction"], pixels / (40 * 30))
    np.testing.assert_array_equal(values["fraction"], pixels / np.maximum(silhouette, 1))
    np.testing.assert_array_equal(values["status"], seen.status.numpy()[:, 0])
    assert {0, 1, 2, 4} <= set(values["status"])
    x, y, width, height = seen.visible_box.numpy()[:, 0].T
    gaps = np.min([x, y, 40 - x - width, 30 - y - height], axis=0)
    np.testing.assert_array_equal(values["margin"], np.where(pixels > 0, gaps, -math.inf))


def test_fractions_against_double_precision(scene):
    found = check(scene, (0.4, 0.7))
    canvas = (40, 30, 40, 30)
    expected = []
    for pose in POSES:
        masks = measure_silhouettes(scene, CAMERA, pose, 0, canvas=canvas, delta=0.0)
        expected.append(masks["visible"].sum() / max(1, masks["canvas"].sum()))
    np.testing.assert_allclose(found.values[:, 0], expected, atol=0.02)
    np.testing.assert_array_equal(found.accepted, [0.4 <= value <= 0.7 for value in expected])
    assert found.accepted.any()
    assert not found.accepted.all()


@pytest.mark.parametrize(
    ("constraint", "accepted"),
    [
        (Constraint(fraction=(0.95, None)), [1, 2]),
        (Constraint(fraction=(None, 0.0)), [3, 4, 5]),
        (Constraint(pixels=(1, 15)), [0, 6]),
        (Constraint(image_fraction=(0.016, 1.0)), [2]),
        (Constraint(distance=(1.9, 2.4)), [0, 2, 3, 6]),
        (Constraint(angle=(0.0, 0.5), direction=(-2, 0, 0)), [0, 3, 4, 6]),
        (Constraint(angle=(1.4, None), direction=(-1, 0, 0)), [2, 5]),
        (Constraint(margin=1), [0, 1, 2]),
        (Constraint(status="out_of_view"), [3]),
        (Constraint(status=("too_near", wv.Visibility.TOO_FAR)), [4, 5]),
        ([(0.3, 1.0), Constraint(pixels=(None, 15))], [0]),
        (Constraint(fraction=(0.3, 1.0), pixels=(None, 15)), [0]),
    ],
    ids=str,
)
def test_each_kind(scene, constraint, accepted):
    found = check(scene, constraint)
    assert np.flatnonzero(found.accepted).tolist() == accepted, found.values
    np.testing.assert_array_equal(found.satisfied, found.slack >= 0)


def test_hidden_differs_from_out_of_view(scene):
    wall = [[0, 0, 0.5, 0, 0, 0, 1]]  # the screen hides all of the mug
    hidden = {"object_poses": wall, "poses": POSES[[0, 3]]}
    assert check(scene, (0.0, 0.0), **hidden).accepted.tolist() == [True, True]
    assert check(scene, Constraint(status="occluded"), **hidden).accepted.tolist() == [True, False]
    assert check(scene, Constraint(status="occluded"), **hidden).slack.tolist() == [[1], [-1]]


def test_slack_is_the_distance_to_the_nearer_limit(scene):
    found = check(scene, [Constraint(distance=(2.5, 5.0)), Constraint(distance=(None, 3.0))], poses=POSES[[0, 5]])
    distances = found.values[:, 0]
    np.testing.assert_allclose(distances, [2, 6], atol=1e-6)
    np.testing.assert_allclose(found.slack, [[-0.5, 1.0], [-1.0, -3.0]], atol=1e-6)


def test_limits_are_included(scene):
    value = float(check(scene, (0, 1)).values[0, 0])
    assert 0 < value < 1
    assert check(scene, (value, value)).accepted[0]
    assert not check(scene, (np.nextafter(value, 1), 1)).accepted[0]


def test_angles_are_in_the_frame_of_movable_objects(scene):
    turned = [0, 0.2, 0.5, 0, 0, math.sin(math.pi / 4), math.cos(math.pi / 4)]  # x becomes y
    facing = {"screen": Constraint(angle=(0, 1), direction=(1, 0, 0))}
    pose = wv.look_at((0, 2.2, 0.5), (0, 0.2, 0.5))
    found = check_constraints(scene, CAMERA, [pose, pose], facing, object_poses=[[turned], [[0, 0.2, 0.5, 0, 0, 0, 1]]])
    np.testing.assert_allclose(found.values[:, 0], [0, math.pi / 2], atol=1e-6)


def test_unions_are_constrained_as_one_object(scene):
    """A tuple of names has the values of `visible_fractions`, between those of single objects."""
    both, everything = ("mug", "screen"), Constraint(fraction=(0, 1), pixels=(0, None), margin=0, status="visible")
    found = check_constraints(scene, CAMERA, POSES, {"mug": (0, 1), both: everything, "screen": (0, 1)})
    assert [str(term) for term in found.terms][:2] == ["fraction of 'mug'", "fraction of 'mug+screen'"]
    single = [check_constraints(scene, CAMERA, POSES, {name: (0, 1)}).values[:, 0] for name in both]
    assert np.array_equal(found.values[:, [0, -1]].T, single)
    seen = wv.visible_fractions(scene, CAMERA, POSES, objects=[list(both)], min_samples=1)
    fraction, pixels, margin, status = found.values[:, 1:5].T
    np.testing.assert_allclose(fraction, seen.fraction.numpy()[:, 0], atol=1e-6)
    np.testing.assert_array_equal(pixels, seen.visible_pixels.numpy()[:, 0])
    np.testing.assert_array_equal(status, seen.status.numpy()[:, 0])
    x, y, width, height = seen.box.numpy()[:, 0].T
    gaps = np.min([x, y, 40 - x - width, 30 - y - height], axis=0)
    np.testing.assert_array_equal(margin, np.where(pixels > 0, gaps, -math.inf))
    assert 0 < fraction[0] != found.values[0, 0]


def test_boxes_of_unions(scene):
    """Distances are to the center of the joint box: in the world, or in the frame of all members."""
    moved = np.array([[[0.5, 1.0, 0.2, 0, 0, 0.6, 0.8]]] * len(POSES))
    found = check_constraints(
        scene, CAMERA, POSES, {("mug", "screen"): Constraint(distance=(0, None))}, object_poses=moved
    )
    item = scene.objects[1]
    matrix = poses_to_matrices(moved[0])[0]
    corners = np.concatenate([scene.objects[0].vertices, item.frame_vertices @ matrix[:3, :3].T + matrix[:3, 3]])
    center = (corners.min(axis=0) + corners.max(axis=0)) / 2
    np.testing.assert_allclose(found.values[:, 0], np.linalg.norm(POSES[:, :3] - center, axis=1), rtol=1e-6)

    cart = wv.Scene()
    cart.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="cart", movable=True, pose=(0, 0, 0, 0, 0, 0, 1))
    cart.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="load", attach_to="cart", pose=(0.4, 0, 0, 0, 0, 0, 1))
    facing = Constraint(angle=(0, math.pi), direction=(1, 0, 0), distance=(0, None))
    turned = np.array([[[0, 0, 0, 0, 0, math.sqrt(0.5), math.sqrt(0.5)]]])  # x is y of the world
    angle, distance = sorted(
        check_constraints(cart, CAMERA, [0, 2, 0, 0, 0, 0, 1], {("cart", "load"): facing}, object_poses=turned).values[
            0
        ]
    )
    assert abs(angle) < 1e-3 and abs(distance - 1.8) < 1e-3


def test_unions_of_agents_with_several_faces(scene):
    """A person with a wide field of view sees the union of a mug and a floor, which a screen hides in part."""
    eye = wv.look_at((-1, -0.3, 0.5), (1, 0, 0.5))
    person = wv.Agent("person", wv.FieldOfView(2.4, 0.6, 0.6, resolution=40), eye)
    rows = np.stack([scene.objects[1].pose])[None]
    (observer,) = parse_agents(scene, [(person, {("mug", "floor"): (0, 1), "mug": Constraint(pixels=(0, None))})])
    union, pixels = observer.check(scene, rows.astype(np.float32)).values[0]
    (single,) = parse_agents(scene, [(person, {"mug": (0, 1), "floor": (0, 1)})])
    mug, floor = single.check(scene, rows.astype(np.float32)).values[0]
    assert len(observer.faces) > 1 and pixels > 0
    assert min(mug, floor) < union < max(mug, floor)


def test_unions_need_a_pinhole(scene):
    lens = wv.cameras.LensCamera(wv.cameras.lenses.KannalaBrandt(20, 20, 20, 15), 40, 30)
    with pytest.raises(wv.errors.CameraError, match="got LensCamera"):
        check_constraints(scene, lens, POSES, {("mug", "screen"): (0, 1)})


def test_worlds_and_exclusions(scene):
    aside = [[0, 3, 0.5, 0, 0, 0, 1]]
    worlds = [aside, [[0, 0.2, 0.5, 0, 0, 0, 1]]]
    found = check(scene, (0.9, 1.0), poses=POSES[[0, 0]], object_poses=worlds, world_index=[1, 0])
    assert found.accepted.tolist() == [False, True]
    assert check(scene, (0.9, 1.0), poses=POSES[:1], exclude=["screen"]).accepted.tolist() == [True]
    matrices = {"poses": POSES[:1, [0, 1, 2, 6, 3, 4, 5]], "quaternion": "wxyz"}
    assert check(scene, (0.4, 0.6), **matrices).accepted.tolist() == [True]


def test_no_views(scene):
    found = check(scene, (0, 1), poses=np.zeros((0, 7)))
    assert found.slack.shape == (0, 1)
    assert found.accepted.shape == (0,)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (Constraint, "at least one condition"),
        (lambda: Constraint(fraction=(0.8, 0.2)), r"fraction must have its minimum first, got \(0.8, 0.2\)"),
        (lambda: Constraint(fraction=(0, 60)), r"fraction must be from 0 to 1, got 60; for percent, pass 0.6"),
        (lambda: Constraint(fraction=(math.nan, 1)), "fraction must be a range, a minimum and a maximum or None"),
        (lambda: Constraint(fraction=0.5), "fraction must be a range"),
        (lambda: Constraint(pixels=(-1, None)), r"pixels must be from 0 up \[px\], got -1"),
        (lambda: Constraint(distance=("near", 1)), r"distance must be a range \[m\]"),
        (lambda: Constraint(angle=(0, 45), direction=(0, 0, 1)), r"got 45; .* math.radians\(45\)"),
        (lambda: Constraint(angle=(0, 1)), "angle and direction of a constraint must be given together"),
        (lambda: Constraint(direction=(0, 0, 1)), "angle and direction of a constraint must be given together"),
        (lambda: Constraint(angle=(0, 1), direction=(0, 0, 0)), "direction must not be zero"),
        (lambda: Constraint(margin=-1), "margin must be a whole number from 0 up, got -1"),
        (lambda: Constraint(status="hidden"), "status must be one or more of 'out_of_view', .*, got 'hidden'"),
        (lambda: Constraint(status=()), "status must be one or more Visibility, got none"),
    ],
)
def test_wrong_constraints(make, message):
    with pytest.raises(wv.WarpvisError, match=message):
        make()


@pytest.mark.parametrize(
    ("constraints", "message"),
    [
        ({}, "constraints must have one or more objects, got none"),
        ([(0, 1)], "constraints must be a mapping"),
        ({"cup": (0, 1)}, "the scene has no object 'cup'; it has 'mug', 'screen', 'floor'"),
        ({0: (0, 1)}, "constraints must have names of objects, or tuples of names, as keys, got 0"),
        ({(): (0, 1)}, r"constraints must have names of objects, or tuples of names, as keys, got \(\)"),
        ({("mug", 1): (0, 1)}, "or tuples of names, as keys, got"),
        ({("mug", "mug"): (0, 1)}, "objects must be one or more distinct objects of the scene"),
        ({"mug": 0.5}, "constraints of 'mug' must be a list, got 0.5"),
        ({"mug": []}, "constraints of 'mug' must be a range such as"),
        ({"mug": (60, 100)}, "constraint of 'mug': fraction must be from 0 to 1, got 60; for percent, pass 0.6"),
        ({"mug": (1.0, 0.5)}, "constraint of 'mug': fraction must have its minimum first"),
    ],
)
def test_wrong_arguments(scene, constraints, message):
    with pytest.raises(wv.WarpvisError, match=message):
        check_constraints(scene, CAMERA, POSES, constraints)


def test_exclude_for_single_views_raises(scene):
    flags = np.zeros((len(POSES), len(scene)))
    for given, message in ((flags, "the same for all views"), ([True] * len(scene), "or flags of shape")):
        with pytest.raises(wv.errors.ArrayError, match=rf"exclude must be names or indices of objects, {message}"):
            check_constraints(scene, CAMERA, POSES, {"mug": (0, 1)}, exclude=given)
