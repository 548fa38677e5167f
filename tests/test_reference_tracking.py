# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which object a person means over time: filtering, dwell, smooth pursuit, and calibration."""

import itertools
import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.visibility import Agent, ReferenceModel, perspective

from support.people import AHEAD, BOOK, CUP, IDENTITY, at, chances, see


def test_frames_agree_with_a_sum_over_all_sequences_of_objects():
    """Forward filtering of the hidden Markov model against the sum over 3^4 sequences."""
    things = [("a", CUP, at(-10)), ("b", CUP, at(0)), ("c", BOOK, at(9))]
    gazes = [at(-3), at(2), at(4), at(8)]
    model = ReferenceModel(switch_rate=0.8)
    seen = see(things)
    names = [name for name, _, _ in things]
    elapsed = 0.5  # longer than a fixation: frames are independent
    stay = math.exp(-0.8 * elapsed)

    first = {item.object: item for item in seen.candidates("human")}
    prior = np.array([first[name].solid_angle ** 0.1 for name in names])
    prior /= prior.sum()
    likelihoods, found = [], None
    for gaze in gazes:
        now = seen.candidates("human", gaze=gaze, model=model)
        likelihoods.append(np.array([chances(now)[name] for name in names]) / prior)
        found = seen.candidates(
            "human", gaze=gaze, model=model, previous=found, elapsed=None if found is None else elapsed
        )
    expected = np.zeros(3)
    for path in itertools.product(range(3), repeat=len(gazes)):
        weight = prior[path[0]] * likelihoods[0][path[0]]
        for frame, (before, after) in enumerate(itertools.pairwise(path), start=1):
            weight *= (stay * (before == after) + (1 - stay) * prior[after]) * likelihoods[frame][after]
        expected[path[-1]] += weight
    assert [chances(found)[name] for name in names] == pytest.approx(expected / expected.sum(), rel=1e-12)


def test_dwell_is_independent_of_the_frame_rate_and_is_forgotten():
    seen = see([("left", CUP, at(-6)), ("right", CUP, at(6))])
    model = ReferenceModel(switch_rate=0.0)

    def watch(gaze, seconds, rate, found=None, model=model):
        for _ in range(round(seconds * rate)):
            last = {} if found is None else {"previous": found, "elapsed": 1 / rate}
            found = seen.candidates("human", gaze=gaze, model=model, **last)
        return found

    start = seen.candidates("human", model=model)
    once, slow, fast = (
        watch(at(3), seconds, rate, start)[0].probability for seconds, rate in ((0.3, 10 / 3), (1.2, 10 / 3), (1.2, 30))
    )
    assert slow == pytest.approx(fast, rel=1e-9)
    assert 0.5 < once < slow < 1
    # The person looks at the other cup for a while: with switches, the belief follows.
    dwelt = watch(at(6), 3, 10)
    assert dwelt[0].object == "right"
    assert watch(at(-6), 2, 10, dwelt)[0].object == "right"
    assert watch(at(-6), 2, 10, dwelt, ReferenceModel())[0].object == "left"


def test_holding_the_head_or_an_arm_still_adds_little_evidence():
    """The eyes deviate from the head by the same angle all the time: 10 s of the same pose are not 30 observations."""
    frames = repeated(100)
    times = np.arange(100) / 10
    for pointing in (None, np.tile([0, 0, -0.3, *at(2)], (100, 1))):
        tracked = frames.track("human", times=times, pointing=pointing)
        first, last = chances(tracked[0]), chances(tracked[-1])
        assert last == pytest.approx(first, abs=0.2)
    looks = np.tile(at(6), (100, 1))
    assert frames.track("human", times=times, gaze=looks)[-1][0].probability > 0.9


def test_objects_that_vanish_leave_their_probability_to_the_prior():
    before = see([("cup", CUP, at(0)), ("left", CUP, at(-9)), ("right", CUP, at(9))]).candidates("human")
    after = see([("left", CUP, at(-9)), ("right", CUP, at(9))]).candidates("human", previous=before, elapsed=0.1)
    assert {item.object: item.probability for item in after} == pytest.approx({"left": 0.5, "right": 0.5}, abs=0.01)
    strangers = see([("other", CUP, at(0))]).candidates("human", previous=before, elapsed=0.0)
    assert chances(strangers) == {"other": 1.0}


def ball_scene(rng):
    """Return the directions and angular radii of balls that do not overlap, as seen from the origin; and the scene."""
    directions, radii = [], []
    while len(directions) < 7:
        direction = np.array([1, rng.uniform(-0.5, 0.5), rng.uniform(-0.4, 0.4)])
        direction, radius = direction / np.linalg.norm(direction), math.radians(rng.uniform(0.8, 5))
        gaps = [math.acos(direction @ other) - radius - size for other, size in zip(directions, radii, strict=True)]
        if min(gaps, default=1) > math.radians(0.5):
            directions.append(direction)
            radii.append(radius)
    things = [
        (str(k), trimesh.creation.icosphere(subdivisions=3, radius=2 * math.sin(radius)), 2 * direction)
        for k, (direction, radius) in enumerate(zip(directions, radii, strict=True))
    ]
    return np.array(directions), np.array(radii), see(things)


def draw_direction(rng, center, radius, sigma):
    """Draw a direction: uniform on the sphere in 5 % of cases, otherwise near a disk's center."""
    if rng.random() < 0.05:
        direction = rng.normal(size=3)
        return direction / np.linalg.norm(direction)
    for spread in (radius / 2, sigma):  # rotations about axes perpendicular to the direction
        axis = np.cross(center, rng.normal(size=3))
        angle = spread * math.sqrt(-2 * math.log(1 - rng.random()))
        center = math.cos(angle) * center + math.sin(angle) * axis / np.linalg.norm(axis)
    return center


def test_probabilities_are_calibrated():
    """Of the objects with a probability of about p, a share of about p is meant, in scenes drawn from the model."""
    rng = np.random.default_rng(11)
    sigma = math.radians(6)
    model = ReferenceModel(gaze_sigma=sigma, max_eye_angle=math.pi)
    predicted, meant = [], []
    for _ in range(8):
        directions, radii, seen = ball_scene(rng)
        prior = (2 * math.pi * (1 - np.cos(radii))) ** 0.1
        for target in rng.choice(len(radii), size=90, p=prior / prior.sum()):
            gaze = draw_direction(rng, directions[target], radii[target], sigma)
            for item in seen.candidates("human", gaze=gaze, model=model):
                predicted.append(item.probability)
                meant.append(item.object == str(target))
    predicted, meant = np.array(predicted), np.array(meant)
    assert len(predicted) == 8 * 90 * 7
    bins = np.digitize(predicted, [0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8])
    for number in range(9):
        inside = bins == number
        assert inside.sum() > 30
        expected = predicted[inside].mean()
        spread = math.sqrt(expected * (1 - expected) / inside.sum())
        assert abs(meant[inside].mean() - expected) < 4 * spread + 0.01, (number, expected, meant[inside].mean())


def test_track_equals_a_loop_over_frames_with_head_or_eyes():
    frames = repeated(12)
    times = np.cumsum([0, 0.03, 0.1, 0.5, 0, 0.2, 0.3, 0.05, 0.05, 1, 0.1, 0.1])
    gaze = np.array([at(4 * math.sin(time)) for time in times])
    rays = np.array([[[0, 0, -0.3, *at(7)]] if time > 0.7 else np.full((1, 6), np.nan) for time in times])
    gaze[5] = np.nan
    for options in ({}, {"gaze": gaze}, {"gaze": gaze, "pointing": rays}, {"pointing": rays[:, 0]}):
        model = ReferenceModel(pursuit_sigma=math.pi / 2)  # objects stand still: the factor is the same for all
        tracked = frames.track("human", times=times, model=model, **options)
        found = None
        for view, time in enumerate(times):
            last = {} if found is None else {"previous": found, "elapsed": time - times[view - 1]}
            if "gaze" in options and view != 5:
                last["gaze"] = gaze[view]
            if "pointing" in options and time > 0.7:
                last["pointing"] = rays[view]
            found = frames.candidates("human", view=view, model=model, **last)
            assert [item.object for item in tracked[view]] == [item.object for item in found]
            assert chances(tracked[view]) == pytest.approx(chances(found), rel=1e-9)


def repeated(count):
    """Return a perspective of a situation that is repeated."""
    scene = wv.Scene()
    for name, mesh, place in [("left", CUP, at(-8)), ("right", CUP, at(7)), ("book", BOOK, at(25))]:
        scene.add(mesh, name=name, label="object", pose=(*place, *IDENTITY))
    return perspective(scene, Agent.human("human", np.tile(AHEAD, (count, 1))))


def crossing_balls(rate=30, seconds=2.0):
    """Return a person's perspective on two balls that move past each other and one that stands between, and places."""
    scene = wv.Scene()
    for name in ("up", "down", "still"):
        scene.add(trimesh.creation.icosphere(radius=0.03), name=name, label="object", movable=True)
    times = np.arange(0, seconds, 1 / rate)
    heights = 0.25 * np.sin(2 * math.pi * times / seconds)
    places = np.zeros((len(times), 3, 3))
    places[..., 0] = 1.5
    places[:, :, 1] = (0.1, -0.1, 0.0)
    places[:, 0, 2], places[:, 1, 2] = heights, -heights
    poses = np.concatenate([places, np.tile(IDENTITY, (len(times), 3, 1))], axis=2)
    seen = perspective(scene, Agent.human("human", np.tile(AHEAD, (len(times), 1))), object_poses=poses)
    return seen, times, places


@pytest.mark.parametrize("followed", [0, 1, 2])
def test_following_a_ball_with_the_eyes_identifies_it_in_spite_of_a_constant_error(followed):
    seen, times, places = crossing_balls()
    error = np.array([0, 0.2, 0.1])  # 8 degrees: nearer to another ball
    rng = np.random.default_rng(3)
    gaze = places[:, followed] + error + rng.normal(scale=0.01, size=(len(times), 3))
    name = ("up", "down", "still")[followed]
    with_motion = chances(seen.track("human", times=times, gaze=gaze)[-1])
    without = chances(seen.track("human", times=times, gaze=gaze, model=ReferenceModel(pursuit_sigma=math.pi / 2))[-1])
    assert with_motion[name] > 0.9
    assert with_motion[name] > without[name] + (0.05 if name == "up" else 0.2)  # the error is upwards and to its side
    # The result does not depend on the frame rate.
    slow, slow_times, slow_places = crossing_balls(rate=10)
    other = chances(slow.track("human", times=slow_times, gaze=slow_places[:, followed] + error)[-1])
    assert other[name] == pytest.approx(with_motion[name], abs=0.1)


def test_people_tracked_together_share_attention():
    seen, times, places = crossing_balls()
    watched = seen.track("human", times=times, gaze=places[:, 0], model=ReferenceModel(gaze_sigma=math.radians(1)))
    alone = seen.track("human", times=times)
    together = seen.track("human", times=times, others=[watched])
    assert sum(chances(item)["up"] for item in together) > sum(chances(item)["up"] for item in alone) + 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"times": [0, 1, 2]}, "times must be 2 finite numbers of seconds that do not decrease, got [0.0, 1.0, 2.0]"),
        ({"times": [1, 0]}, "times must be 2 finite numbers of seconds that do not decrease, got [1.0, 0.0]"),
        ({"gaze": [1, 0, 0]}, "gaze must be a direction for each situation, shape (2, 3), got (3,)"),
        (
            {"gaze": [[1, 0, 0], [-1, 0, 0]]},
            "gaze must be within 55 degrees of the axis of the person's pose, got ",
        ),
        (
            {"pointing": np.zeros((2, 1, 5))},
            "pointing must be rays x y z dx dy dz for each situation, shape (2, 6) ",
        ),
        ({"others": [[]]}, "others must be results of track for 2 situations, got 0"),
    ],
)
def test_invalid_sequences_are_rejected(change, said):
    frames = repeated(2)
    with pytest.raises(wv.WarpvisError) as error:
        frames.track("human", **{"times": [0, 1], **change})
    assert str(error.value).startswith(said)
    assert ("this is situation 1" in str(error.value)) == ("55 degrees" in said)
