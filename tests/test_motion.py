# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Motions: interpolation and screw motion, compared with matrix powers and exponentials, and errors."""

import numpy as np
import pytest
import reference_motion as twins
import warp as wp
from pose_samples import unit

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import ArrayError, PoseError
from warpvis.sensors import Motion

import reference

STRAIGHT = np.array([0, 0, 0, 0, 0, 0, 1.0])


def random_rows(*shape, seed=0, spread=3.0):
    rng = np.random.default_rng(seed)
    return unit(np.concatenate([rng.uniform(-spread, spread, (*shape, 3)), rng.normal(size=(*shape, 4))], axis=-1))


def assert_same_places(rows, matrices, tolerance=1e-12):
    np.testing.assert_allclose(poses_to_matrices(rows), matrices, atol=tolerance)


def test_interpolation_matches_matrix_powers():
    rows, times = random_rows(4, 3), np.array([0.0, 0.3, 0.4, 2.0])
    motion = Motion(rows, times)
    moments = np.array([0.0, 0.1, 0.3, 0.35, 1.9999, 2.0])
    found = motion.at(moments)
    assert found.shape == (6, 3, 7)
    for k, moment in enumerate(moments):
        leg = min(np.searchsorted(times, moment, side="right") - 1, 2)
        share = (moment - times[leg]) / (times[leg + 1] - times[leg])
        for view in range(3):
            assert_same_places(found[k, view], twins.between(rows[leg, view], rows[leg + 1, view], share))
    for instant, moment in enumerate(times):
        assert_same_places(motion.at(moment), poses_to_matrices(rows[instant]))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, np.pi - 1e-6])
def test_rotation_takes_the_shorter_arc(angle):
    """Both quaternions of a rotation yield the same motion."""
    half = angle / 2
    end = np.array([1, 2, 3, np.sin(half), 0, 0, np.cos(half)])
    other = end * [1, 1, 1, -1, -1, -1, -1]
    expected = [0.25, 0.5, 0.75, np.sin(half / 4), 0, 0, np.cos(half / 4)]
    for given in (end, other):
        np.testing.assert_allclose(Motion([STRAIGHT, given], [0, 4.0]).at(1.0), expected, atol=1e-15)


@pytest.mark.parametrize("rate", [0.0, 1e-9, 1e-3, 0.99e-2, 1.01e-2, 1.0, 40.0])
def test_twist_matches_matrix_exponential(rate):
    row, linear = random_rows(seed=1), np.array([2.0, -1.0, 0.5])
    angular = rate * np.array([0.3, -0.5, 0.81])
    motion = Motion.from_twist(row, linear, angular)
    for moment in (-0.5, 0.0, 0.01, 1.0):
        assert_same_places(motion.at(moment), twins.along_screw(row, linear, angular, moment), 1e-11)


def test_twists_of_several_views():
    rows, linear = random_rows(2), np.array([[1.0, 0, 0], [0, 0, 2.0]])
    found = Motion.from_twist(rows, linear, (0, 0, 1.0)).at([0.0, 0.5])
    assert found.shape == (2, 2, 7)
    for view in range(2):
        assert_same_places(found[1, view], twins.along_screw(rows[view], linear[view], np.array([0, 0, 1.0]), 0.5))


def test_starts_select_frames_of_trajectory():
    """Frames are sections of one trajectory, whose clock does not start at zero."""
    rows, times = random_rows(20), 1.7e9 + 0.01 * np.arange(20)
    starts = 1.7e9 + np.array([0.0, 0.105])
    found = Motion(rows, times, starts=starts).at([[0.0], [0.05]])
    assert found.shape == (2, 1, 2, 7)
    on_clock = Motion(rows, times)
    for view, start in enumerate(starts):
        np.testing.assert_array_equal(found[1, 0, view], on_clock.at(start + 0.05))


def test_pose_formats_are_equivalent():
    rows = random_rows(3, 2)
    w_first = rows[..., [0, 1, 2, 6, 3, 4, 5]]
    expected = Motion(rows, [0, 1, 2]).at(0.7)
    for given in (
        Motion(w_first, [0, 1, 2], quaternion="wxyz"),
        Motion(poses_to_matrices(rows), [0, 1, 2]),
        Motion(list(rows), [0, 1, 2]),
    ):
        np.testing.assert_allclose(given.at(0.7), expected, atol=1e-12)
    arrays = [wp.array(row, dtype=wp.transform, device="cpu") for row in rows]
    np.testing.assert_allclose(Motion(arrays, [0, 1, 2]).at(0.7), expected, atol=1e-6)
    twist = Motion.from_twist(w_first[0], (1, 0, 0), (0, 1, 0), quaternion="wxyz")
    np.testing.assert_array_equal(twist.at(0.3), Motion.from_twist(rows[0], (1, 0, 0), (0, 1, 0)).at(0.3))


@pytest.mark.parametrize("twist", [False, True])
def test_segments_match_reference(twist, device):
    from warpvis.kernels.casting.motions import Leg, begin_legs

    rows = np.float32(random_rows(4, 3, 2))
    rows[1, 0] = rows[2, 0]  # a segment without motion
    velocities = np.random.default_rng(3).normal(size=(2, 3, 2, 3)) if twist else None
    rows = rows[:1] if twist else rows
    legs = wp.empty(rows.shape[:-1], dtype=Leg, device=device)
    given = [None, None] if velocities is None else [wp.array(v, dtype=wp.vec3d, device=device) for v in velocities]
    poses = wp.array(rows, dtype=wp.transform, device=device)
    wp.launch(begin_legs, dim=legs.shape, inputs=[poses, *given, legs], device=device)
    found = legs.numpy()
    origin, rotation, path, turn = reference.begin_legs(rows, *([] if velocities is None else velocities))
    np.testing.assert_allclose(found["origin"], origin, atol=1e-12)
    np.testing.assert_allclose(found["path"], path, atol=1e-12)
    np.testing.assert_allclose(found["rotation_vector"], turn, atol=1e-7)  # axes from eigenvectors have half the digits
    places = np.concatenate([found["origin"], found["rotation"]], axis=-1)
    np.testing.assert_allclose(poses_to_matrices(places)[..., :3, :3], rotation, atol=1e-12)
    if not twist:
        assert (
            not found["path"][1, 0].any()
            and not found["rotation_vector"][1, 0].any()
            and not found["rotation_vector"][-1].any()
        )


TWO = np.tile(STRAIGHT, (2, 1))
REFUSED = {
    "one instant": (
        lambda: Motion(TWO[:1], [0.0]),
        "times must be one for each instant of poses, at least two, got 1 for 1",
    ),
    "other times": (lambda: Motion(TWO, [0, 1, 2]), "times must be one for each instant of poses, .* got 3 for 2"),
    "falling": (lambda: Motion(TWO, [1, 0]), "times must increase strictly"),
    "times": (lambda: Motion(TWO, [0, np.nan]), "times must be finite, and 1 are not"),
    "no list": (lambda: Motion(TWO, 0.1), r"times must be a list of numbers of seconds, got shape \(\)"),
    "words": (lambda: Motion(TWO, ["a", "b"]), "times must be an array of numbers"),
    "nan": (lambda: Motion(TWO * np.nan, [0, 1]), "poses must be finite: wrong in 2 of 2"),
    "shape": (lambda: Motion(np.zeros((2, 6)), [0, 1]), r"poses must have shape \(T, ..., 7\), rows .* got \(2, 6\)"),
    "length": (lambda: Motion(2 * TWO, [0, 1]), "poses must have quaternions of length 1, got 2"),
    "nothing": (lambda: Motion(np.zeros((2, 0, 7)), [0, 1]), r"poses must not be empty, got shape \(2, 0, 7\)"),
    "starts": (
        lambda: Motion(np.tile(TWO, (2, 1, 1)), [0, 1], starts=[0.0, 1, 2]),
        "starts must be one for each of the 2 views, got 3",
    ),
    "twist": (lambda: Motion.from_twist(STRAIGHT, (1, 0), (0, 0, 1)), r"linear must be three finite numbers, .* got"),
    "turning": (
        lambda: Motion.from_twist(TWO, (1, 0, 0), np.zeros((3, 3))),
        r"angular must be .* of shape \(2, 3\), got \(3, 3\)",
    ),
    "before": (
        lambda: Motion(TWO, [0, 1]).at(-0.1),
        "times must be within those of the motion, 0 to 1 s, got -0.1 to -0.1 s",
    ),
    "behind": (
        lambda: Motion(TWO, [5.0, 6.0], starts=[5.0, 5.5]).at([0, 0.6]),
        "times must be within those of the motion, 5 to 6 s, got 5 to 6.1 s",
    ),
    "of rays": (lambda: Motion.per_ray(TWO).at(0.0), "motion must have poses at times, got poses of rays"),
    "quaternion": (lambda: Motion(TWO, [0, 1], quaternion="wzyx"), "quaternion must be"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_invalid_motions_are_rejected(name):
    make, message = REFUSED[name]
    with pytest.raises((ArrayError, PoseError), match=message):
        make()


def test_rounded_times_are_accepted():
    """Rounded clocks and single-precision times are accepted; times outside by more are rejected."""
    motion = Motion(TWO, [1.7e9, 1.7e9 + 0.1], starts=[1.7e9])
    motion.at(0.1)
    moving = Motion([STRAIGHT, STRAIGHT + [1, 0, 0, 0, 0, 0, 0]], [0, 0.1])
    points = wv.sensors.deskew(np.zeros((1, 3)), moving, times=np.float32([0.1]))
    np.testing.assert_allclose(points, [[1, 0, 0]], atol=1e-7)
    with pytest.raises(ArrayError, match="times must be within those of the motion"):
        moving.at(0.1 + 1e-6)


def test_repr_and_read_only_times():
    assert "2 times, shape=()" in repr(Motion(TWO, [0, 1]))
    assert "from_twist, shape=(2,), 2 starts" in repr(Motion.from_twist(TWO, (0, 0, 0), (0, 0, 0), starts=[0, 1]))
    assert "per_ray" in repr(Motion.per_ray(TWO))
    with pytest.raises(ValueError, match="read-only"):
        Motion(TWO, [0, 1]).times[0] = 1
