# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which object a person means: obvious scenes, other people, and independent computations."""

import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.visibility import Agent, ReferenceModel, State, perspective

from support.people import AHEAD, BOOK, CUP, CUP_AND_BOOK, IDENTITY, at, chances, see


def test_cup_at_the_center_wins_over_a_book_aside():
    found = see(CUP_AND_BOOK).candidates("human")
    assert [item.object for item in found] == ["cup", "book"]
    assert found[0].probability > 0.7 and found[1].probability < 0.25
    assert found[0].gaze_angle == 0


def test_far_wall_behind_the_cup_is_not_meant():
    wall = ("wall", trimesh.creation.box((0.1, 8, 5)), (4, 0, 0))
    found = see([*CUP_AND_BOOK, wall]).candidates("human")
    assert found[0].object == "cup" and found[0].probability > 0.6  # the eyes may be anywhere within 20 degrees
    tracked = see([*CUP_AND_BOOK, wall]).candidates(
        "human", gaze=at(0), model=ReferenceModel(gaze_sigma=math.radians(2))
    )
    assert tracked[0].object == "cup" and tracked[0].probability > 0.95
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
    seen = see(things)
    for evidence in ({}, {"gaze": at(-5)}, {"pointing": [0, 0, -0.3, *at(-5, height=0.3)]}):
        assert chances(seen.candidates("human", exclude=["screen"], **evidence)) == {"cup": 1.0}


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


def independent_probabilities(things, gaze, sigma, lapse=0.05, exponent=0.1):
    """Compute probabilities of boxes in plain NumPy, from directions evenly spread over their bounding rectangles."""
    weights = {}
    for name, mesh, place in things:
        x, y, z = (mesh.bounds[[0, 0, 0, 0, 1, 1, 1, 1], [0] * 8], *mesh.bounds[[0, 0, 1, 1] * 2, [[1] * 8, [2] * 8]])
        z = mesh.bounds[[0, 1] * 4, 2]
        across, up = (y + place[1]) / (x + place[0]), (z + place[2]) / (x + place[0])
        steps = (np.arange(60) + 0.5) / 60
        grid = np.stack(np.meshgrid(np.ptp(across) * steps + across.min(), np.ptp(up) * steps + up.min()), axis=-1)
        rays = np.insert(grid.reshape(-1, 2), 0, 1.0, axis=1)
        lengths = np.linalg.norm(rays, axis=1)
        area = (1 / lengths**3).mean() * np.ptp(across) * np.ptp(up)
        ends = np.array([[1, a, b] for a in (across.min(), across.max()) for b in (up.min(), up.max())])
        center = (ends / np.linalg.norm(ends, axis=1, keepdims=True)).sum(axis=0)
        center /= np.linalg.norm(center)
        right = np.array([-center[1], center[0], 0]) / math.hypot(center[0], center[1])
        above = np.cross(center, right)

        def on_map(directions, center=center, right=right, above=above):
            """Azimuthal equidistant projection about the center."""
            azimuths = np.arctan2(directions @ above, directions @ right)
            angles = np.arccos(np.clip(directions @ center, -1, 1))
            return np.stack([angles * np.cos(azimuths), angles * np.sin(azimuths)], axis=-1)

        points = on_map(rays / lengths[:, None])
        covariance = 0.75 * points.T @ points / len(points) + sigma**2 * np.eye(2)
        offset = on_map(gaze / np.linalg.norm(gaze))
        density = math.exp(-0.5 * offset @ np.linalg.inv(covariance) @ offset)
        density /= 2 * math.pi * math.sqrt(np.linalg.det(covariance))
        weights[name] = ((1 - lapse) * density + lapse / (4 * math.pi)) * area**exponent
    return {name: weight / sum(weights.values()) for name, weight in weights.items()}


def test_probabilities_agree_with_an_independent_computation():
    rng = np.random.default_rng(5)
    for _ in range(3):
        places = [at(angle, rng.uniform(1, 2), rng.uniform(-0.4, 0.4)) for angle in (-24, -14, -4, 5, 16, 25)]
        extents = [[1e-3, *rng.uniform(0.05, 0.2, 2)] for _ in places]
        things = [
            (f"{k}", trimesh.creation.box(size), p) for k, (size, p) in enumerate(zip(extents, places, strict=True))
        ]
        seen = see(things, resolution=900)
        for gaze, sigma in ((None, 10), (at(12, 1, 0.1), 9), (at(-5, 1, 0.2), 3)):
            model = ReferenceModel(gaze_sigma=math.radians(sigma))
            found = seen.candidates("human", gaze=gaze, model=model)
            expected = independent_probabilities(things, at(0) if gaze is None else gaze, math.radians(sigma))
            assert chances(found) == pytest.approx(expected, abs=0.01)
            assert sum(item.probability for item in found) == pytest.approx(1, abs=1e-12)


def test_people_look_at_the_center_of_large_objects():
    """The same cabinet is likelier if the gaze hits its center than if it hits its edge."""
    cabinet = ("cabinet", trimesh.creation.box((0.5, 1.2, 2)), at(0, 2.5))
    seen = see([cabinet, ("cup", CUP, at(32))])
    center, edge = (seen.candidates("human", gaze=at(angle)) for angle in (0, 12))
    assert center[0].object == edge[0].object == "cabinet"
    assert next(item for item in edge if item.object == "cabinet").gaze_angle == 0
    assert center[0].probability > 0.9 > edge[0].probability + 0.05
    # Half of the cabinet is hidden: people look at the center of the visible half.
    board = ("board", trimesh.creation.box((0.01, 2, 2)), (1, -1, 0))
    half = see([cabinet, board]).candidates("human", exclude=["board"], gaze=at(-8), model=ReferenceModel(lapse=0))
    assert half[0].gaze_angle == 0 and half[0].object == "cabinet"


def test_given_the_gaze_the_head_does_not_matter():
    """Objects move from image to image of the field of view, and across the borders between images."""
    things = [*CUP_AND_BOOK, ("cabinet", trimesh.creation.box((0.3, 0.8, 0.6)), at(-20, 1.5))]
    expected = None
    for degrees in (0, 12, 24, 33, 45, -40):
        eyes = wv.look_at((0, 0, 0), at(degrees))
        found = chances(see(things, eyes, resolution=400).candidates("human", gaze=at(5)))
        assert found == pytest.approx(expected or found, abs=0.015)
        expected = expected or found


def test_two_identical_cups_are_equally_likely():
    found = see([("left", CUP, at(-7)), ("right", CUP, at(7))]).candidates("human")
    assert [item.probability for item in found] == pytest.approx([0.5, 0.5], abs=0.01)


def test_margins_are_printed_with_names():
    found = see(CUP_AND_BOOK).candidates("human")
    text = ", ".join(map(str, found))
    assert text == f"cup {found[0].probability:.2f}, book {found[1].probability:.2f}"


def test_pointing_past_a_near_object_at_a_far_one():
    """The ray from the hand crosses the near cup; the eyes are above it and look at the far cup."""
    hand, far = np.array([0.4, -0.2, -0.5]), at(10, 3)
    near = hand + 0.25 * (far - hand)
    seen = see([("near", CUP, near), ("far", CUP, far), ("book", BOOK, at(-20))])
    ray = [*hand, *(far - hand)]
    both = seen.candidates("human", pointing=ray)
    assert [item.pointing_angle for item in both if item.object != "book"] == [0, 0]
    assert chances(both)["book"] < 0.02
    found = seen.candidates("human", pointing=ray, gaze=far)
    assert found[0].object == "far" and found[0].probability > 0.8
    assert seen.candidates("human", pointing=ray, gaze=near)[0].object == "near"


def test_joint_attention_raises_what_another_person_looks_at():
    things = [("left", CUP, at(-6)), ("right", CUP, at(6)), ("aside", CUP, at(30))]
    other = Agent.human("other", wv.look_at((3, 1, 0), at(-6)))
    seen = see(things, others=[other])
    watched = seen.candidates("other", model=ReferenceModel(head_sigma=math.radians(1), lapse=0))
    assert watched[0].object == "left" and watched[0].probability > 0.999
    alone, together = seen.candidates("human"), seen.candidates("human", others=[watched])
    # Bayes: only the prior of the left cup changes, from s to (1 - w) s + w.
    likelihood = {item.object: item.probability / item.solid_angle**0.1 for item in alone}
    total = sum(item.solid_angle**0.1 for item in alone)
    prior = {item.object: 0.73 * item.solid_angle**0.1 / total + 0.27 * chances(watched)[item.object] for item in alone}
    expected = {name: likelihood[name] * prior[name] for name in prior}
    assert chances(together) == pytest.approx({k: v / sum(expected.values()) for k, v in expected.items()}, rel=1e-9)
    assert chances(together)["left"] > chances(alone)["left"] + 0.1
    ignored = seen.candidates("human", others=[watched], model=ReferenceModel(joint_attention=0.0))
    assert chances(ignored) == pytest.approx(chances(alone), rel=1e-12)
    # What the person does not see takes no part: its share follows the salience.
    assert chances(seen.candidates("human", exclude=["left"], others=[watched])) == pytest.approx(
        chances(seen.candidates("human", exclude=["left"])), rel=1e-2
    )


def test_objects_to_see_are_sorted_by_evidence():
    wall = ("wall", trimesh.creation.box((0.02, 2, 2)), (2.2, 0, 0))
    robot = Agent.kinect("robot", wv.look_at((4, 0, 0), (0, 0, 0)))
    seen = see([("left", CUP, at(-12)), ("right", CUP, at(10)), wall], others=[robot])
    options = {"model": ReferenceModel(gaze_sigma=math.radians(2))}
    assert seen.to_see("robot", "human", gaze=at(-11), **options)[0] == "left"
    assert seen.to_see("robot", "human", gaze=at(10), **options)[0] == "right"
    assert seen.to_see("robot", "human", pointing=[0, 0, 0, *at(-12)])[0] == "left"


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
        (
            {"others": ["cup"]},
            "others must be a list of Candidate objects for each person from Perspective.candidates, ",
        ),
        ({"others": [["cup"]]}, "others must be a list of Candidate objects for each person from Perspective"),
        ({"others": 3}, "others must be"),
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
