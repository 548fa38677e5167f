# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which object a person means: obvious scenes, independent computations, frames over time, and calibration."""

import itertools
import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.visibility import Agent, ReferenceModel, State, perspective

AHEAD = wv.look_at((0, 0, 0), (1, 0, 0))
CUP = trimesh.creation.cylinder(radius=0.04, height=0.1)
BOOK = trimesh.creation.box((0.03, 0.15, 0.22))
IDENTITY = (0, 0, 0, 1)


def at(degrees, distance=1.5, height=0.0):
    """Return a place seen from the origin, `degrees` to the right of the x axis."""
    angle = math.radians(degrees)
    return np.array([distance * math.cos(angle), -distance * math.sin(angle), height])


def see(things, eyes=AHEAD, others=(), **options):
    """Return the perspective of a person on objects, ``(name, mesh, place)``."""
    scene = wv.Scene()
    for name, mesh, place in things:
        scene.add(mesh, name=name, label="object", pose=(*place, *IDENTITY))
    return perspective(scene, [*others, Agent.human("human", eyes, **options)])


def chances(found):
    return {item.object: item.probability for item in found}


CUP_AND_BOOK = [("cup", CUP, at(0)), ("book", BOOK, at(24))]


def test_cup_at_the_center_wins_over_a_book_aside():
    found = see(CUP_AND_BOOK).candidates("human")
    assert [item.object for item in found] == ["cup", "book"]
    assert found[0].probability > 0.7 and found[1].probability < 0.25
    assert found[0].gaze_angle == 0


def test_far_wall_behind_the_cup_is_not_meant():
    wall = ("wall", trimesh.creation.box((0.1, 8, 5)), (4, 0, 0))
    found = see([*CUP_AND_BOOK, wall]).candidates("human")
    assert found[0].object == "cup" and found[0].probability > 0.7
    assert found[0].solid_angle < 0.01 < 1 < next(item.solid_angle for item in found if item.object == "wall")


def test_large_object_is_meant_where_the_gaze_hits_it_off_its_center():
    cabinet = ("cabinet", trimesh.creation.box((0.5, 1.2, 2)), at(10, 2.5))
    seen = see([("cup", CUP, at(-24)), cabinet])
    found = seen.candidates("human")
    assert found[0].object == "cabinet" and found[0].probability > 0.7 and found[0].gaze_angle == 0
    assert math.degrees(seen.gaze_angle[0, 0, 1]) == pytest.approx(10, abs=0.01)


def test_cup_hidden_from_the_person_is_no_candidate():
    screen = ("screen", trimesh.creation.box((0.02, 0.3, 0.4)), at(-5, 1.0))
    things = [("hidden cup", CUP, at(-5)), ("cup", CUP, at(8)), screen]
    found = see(things).candidates("human", exclude=["screen"])
    assert chances(found) == {"cup": 1.0}


def test_nearest_visible_direction_leaves_out_what_is_hidden():
    """The gaze hits the hidden half of a board; a screen hides it up to 10 degrees."""
    board = ("board", trimesh.creation.box((0.001, 2.0, 0.5)), (2, 0, 0))
    edge = 1.0 * math.tan(math.radians(10))
    screen = ("screen", trimesh.creation.box((0.001, 2.0, 2.0)), (1.0, 1.0 - edge, 0))
    (found,) = see([board, screen], resolution=1000).candidates("human", exclude=["screen"])
    assert math.degrees(found.gaze_angle) == pytest.approx(10, abs=0.1)


def test_pointing_overrides_gaze():
    hand = at(5, 0.4, -0.3)
    target = at(24)
    seen = see(CUP_AND_BOOK)
    found = seen.candidates("human", pointing=[*hand, *(target - hand)])
    assert found[0].object == "book" and found[0].probability > 0.9
    assert found[0].pointing_angle == 0 and found[1].pointing_angle > math.radians(10)
    assert seen.candidates("human")[0].pointing_angle is None
    two = seen.candidates("human", pointing=[[*hand, *(target - hand)], [*-hand, *(target + hand)]])
    assert two[0].probability > found[0].probability


def test_eyes_override_the_head():
    seen = see(CUP_AND_BOOK)
    assert seen.candidates("human", gaze=5 * at(24))[0].object == "book"
    assert chances(seen.candidates("human", gaze=at(24)))["book"] > 0.9


def test_prior_prefers_what_only_the_person_sees():
    things = [("left", CUP, at(-6)), ("right", CUP, at(6)), ("screen", trimesh.creation.box((0.3, 0.02, 0.4)), at(0))]
    robot = Agent.kinect("robot", wv.look_at((1.5, 1.4, 0), (1.5, 0, 0)))
    seen = see(things, others=[robot])
    options = {"exclude": ["screen"]}
    states = {item.object: item.state for item in seen.candidates("human", "robot", **options)}
    assert set(states.values()) == {State.SECOND, State.BOTH}
    hidden = next(name for name, state in states.items() if state == State.SECOND)
    equal = chances(seen.candidates("human", "robot", **options))[hidden]
    weighted = chances(seen.candidates("human", "robot", model=ReferenceModel(person_only_weight=3), **options))[hidden]
    assert weighted / (1 - weighted) == pytest.approx(3 * equal / (1 - equal))
    assert seen.candidates("human", **options)[0].state is None


def test_states_have_one_order():
    """The robot is first in states, candidates and reports, whatever the order of the agents in the call."""
    screen = ("screen", trimesh.creation.box((0.02, 1, 1)), (2, 0, 0))
    things = [("cup", CUP, at(0)), screen]
    robot = Agent.kinect("robot", wv.look_at((4, 0, 0), (0, 0, 0)))
    for agents in ([robot], []):
        seen = see(things, others=agents)
        if not agents:
            scene = wv.Scene()
            for name, mesh, place in things:
                scene.add(mesh, name=name, label="object", pose=(*place, *IDENTITY))
            seen = perspective(scene, [Agent.human("human", AHEAD), robot])
        (cup,) = seen.candidates("human", "robot", exclude=["screen"])
        assert cup.state == State.SECOND == seen.states("robot", "human")[0, 0]
        assert seen.to_see("robot", "human") == ["cup"]


def independent_probabilities(found, sigma, rays=0, lapse=0.05, exponent=0.1):
    """Compute probabilities in plain floats from angles and solid angles, without logarithms."""
    weights = []
    for item in found:
        area = item.solid_angle
        radius = math.sqrt(area / math.pi)
        integral = area + math.sqrt(math.pi / 2) * sigma * (2 * math.pi * radius) + 2 * math.pi * sigma * sigma
        density = (1 - lapse) * math.exp(-(item.gaze_angle**2) / (2 * sigma**2)) / integral + lapse / (4 * math.pi)
        weights.append(density * area**exponent)
    return [weight / sum(weights) for weight in weights]


def test_probabilities_agree_with_an_independent_computation():
    rng = np.random.default_rng(5)
    for _ in range(3):
        places = [at(angle, rng.uniform(1, 2), rng.uniform(-0.4, 0.4)) for angle in (-40, -22, -8, 6, 21, 37)]
        things = [(f"box {k}", trimesh.creation.box(rng.uniform(0.05, 0.3, 3)), p) for k, p in enumerate(places)]
        seen = see(things)
        for gaze, sigma in ((None, 10), (at(12, 1, 0.1), 9)):
            found = seen.candidates("human", gaze=gaze)
            expected = independent_probabilities(found, math.radians(sigma))
            assert [item.probability for item in found] == pytest.approx(expected, rel=1e-12)
            assert sum(item.probability for item in found) == pytest.approx(1, abs=1e-12)


def test_angles_and_solid_angles_agree_with_pixels():
    """Sum the solid angles of the pixels of a fine image, and find the nearest one; boxes of pixels are full here."""
    things = [
        (f"{angle}", trimesh.creation.box((0.001, 0.9, 0.6)), (2, 2 * math.tan(angle), 0.1)) for angle in (-1, 0.3)
    ]
    camera = wv.Camera.from_fov(1600, 1200, hfov=math.radians(130))
    scene = wv.Scene()
    for name, mesh, place in things:
        scene.add(mesh, name=name, pose=(*place, *IDENTITY))
    image = wv.render(scene, camera, AHEAD, outputs=("segmentation",)).segmentation.numpy()[0]
    lengths = np.linalg.norm(camera.rays, axis=-1)
    gaze = np.array([0.2, -0.3, 1.0])  # in the camera's frame
    angles = np.arccos((camera.rays @ gaze) / lengths / np.linalg.norm(gaze))
    areas = 1 / (camera.fx * camera.fy * lengths**3)
    world = wv.core.poses.poses_to_matrices(AHEAD[None])[0, :3, :3] @ gaze
    model = ReferenceModel(max_eye_angle=math.pi)
    found = {item.object: item for item in see(things, resolution=900).candidates("human", gaze=world, model=model)}
    assert len(found) == 2
    for k, (name, _, _) in enumerate(things):
        assert found[name].solid_angle == pytest.approx(areas[image == k].sum(), rel=0.02)
        assert found[name].gaze_angle == pytest.approx(angles[image == k].min(), abs=0.003)


def test_pointing_angle_agrees_with_points_on_a_moved_box():
    rng = np.random.default_rng(2)
    extents = np.array([0.3, 0.5, 0.2])
    scene = wv.Scene()
    scene.add(trimesh.creation.box(extents), name="box", label="object", movable=True)
    scene.add(BOOK, name="book", label="object", pose=(2, 1, 0, *IDENTITY))
    pose = np.array([2, 0, 0, *(np.array([0.3, -0.2, 0.5, 0.8]) / np.linalg.norm([0.3, -0.2, 0.5, 0.8]))])
    seen = perspective(scene, Agent.human("human", AHEAD), object_poses=pose[None, None])
    points = rng.uniform(-0.5, 0.5, (200_000, 3))
    side = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), side] = np.where(rng.random(len(points)) < 0.5, -0.5, 0.5)
    matrix = wv.core.poses.poses_to_matrices(pose[None])[0]
    points = points * extents @ matrix[:3, :3].T + matrix[:3, 3]
    for _ in range(10):
        hand, direction = rng.uniform(-0.5, 0.5, 3), np.array([1, *rng.uniform(-0.6, 0.6, 2)])
        rays = points - hand
        cosines = rays @ direction / np.linalg.norm(rays, axis=1) / np.linalg.norm(direction)
        expected = math.acos(min(1.0, cosines.max()))
        found = seen.candidates("human", pointing=[*hand, *direction])
        assert next(item.pointing_angle for item in found if item.object == "box") == pytest.approx(expected, abs=0.005)


def test_order_of_objects_does_not_matter():
    things = [(f"cup {k}", CUP, at(angle, 1 + 0.1 * k)) for k, angle in enumerate((-30, -12, 3, 17, 44))]
    expected = chances(see(things).candidates("human"))
    for order in ([4, 3, 2, 1, 0], [2, 0, 4, 1, 3]):
        found = see([things[k] for k in order]).candidates("human")
        assert list(chances(found)) == list(expected)
        assert [item.probability for item in found] == pytest.approx(list(expected.values()), rel=1e-12)


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
    """Draw a direction: uniform on the sphere in 5 % of cases, otherwise Gaussian around a disk, by rejection."""
    while True:
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        if rng.random() < 0.05:
            return direction
        while True:
            spread = rng.normal(size=3)
            spread /= np.linalg.norm(spread)
            angle = max(0.0, math.acos(np.clip(spread @ center, -1, 1)) - radius)
            if rng.random() < math.exp(-(angle**2) / (2 * sigma**2)):
                return spread


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


def test_camera_with_distortion_uses_boxes():
    lens = wv.cameras.LensCamera(wv.cameras.lenses.OpenCVPinhole(300, 300, 200, 150, (0.1, 0, 0, 0)), 400, 300)
    scene = wv.Scene()
    for name, mesh, place in CUP_AND_BOOK:
        scene.add(mesh, name=name, label="object", pose=(*place, *IDENTITY))
    flat = wv.Camera(400, 300, 300, 300, 200, 150)
    bent, straight = (perspective(scene, Agent("a", camera, AHEAD)).candidates("a") for camera in (lens, flat))
    assert [item.object for item in bent] == [item.object for item in straight] == ["cup", "book"]
    for one, other in zip(bent, straight, strict=True):
        assert one.probability == pytest.approx(other.probability, abs=0.02)
        assert one.solid_angle == pytest.approx(other.solid_angle, rel=0.25)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"gaze": at(80)}, "gaze must be within 55 degrees of the axis of the person's pose, got 80 degrees; "),
        ({"gaze": (0, 0, 0)}, "gaze must be a direction in the world, three numbers that are not all 0"),
        ({"gaze": (1, 0)}, "gaze must be three finite numbers, got [1.0, 0.0]"),
        ({"pointing": (1, 0, 0)}, "pointing must be rays x y z dx dy dz in the world, shape (6,) or (R, 6), got shape"),
        ({"pointing": (1, 0, 0, 0, 0, 0)}, "pointing must be rays x y z dx dy dz in the world, shape (6,) or (R, 6), "),
        (
            {"previous": ["cup"], "elapsed": 1},
            "previous must be Candidate objects from Perspective.candidates, got str",
        ),
        ({"previous": []}, "elapsed must be the seconds since previous, a number from 0 up, got None"),
        ({"elapsed": 1}, "elapsed must be given with previous"),
        ({"exclude": ["plate"]}, "exclude must be names of objects of the scene, got 'plate'"),
        ({"model": 3}, "model must be a warpvis.visibility.ReferenceModel, got int"),
    ],
)
def test_invalid_evidence_is_rejected(change, said):
    seen = see(CUP_AND_BOOK)
    with pytest.raises(wv.WarpvisError) as error:
        seen.candidates("human", **change)
    assert str(error.value).startswith(said)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"head_sigma": 10}, "head_sigma must be from 0.00174533 to 1.5708 radians, got 10; angles are in radians"),
        ({"gaze_sigma": 0}, "gaze_sigma must be from 0.00174533 to 1.5708 radians, got 0"),
        ({"lapse": 2}, "lapse must be a number from 0 to 1, got 2"),
        ({"person_only_weight": 0}, "person_only_weight must be a number from 1e-06 to 1e+06, got 0"),
        ({"switch_rate": -1}, "switch_rate must be a finite number from 0 up, got -1"),
    ],
)
def test_invalid_parameters_are_rejected(change, said):
    with pytest.raises(wv.WarpvisError) as error:
        ReferenceModel(**change)
    assert str(error.value).startswith(said)


def test_extreme_parameters_keep_probabilities_finite():
    seen = see([*CUP_AND_BOOK, ("aside", CUP, at(80))])
    for lapse in (0.0, 1.0):
        model = ReferenceModel(lapse=lapse, head_sigma=math.radians(0.1))
        found = seen.candidates("human", model=model)
        assert len(found) == 3 and sum(item.probability for item in found) == pytest.approx(1)
        assert (found[0].probability > 0.999) == (lapse == 0.0)
