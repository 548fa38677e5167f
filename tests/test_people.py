# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""People: sizes against tables, postures on the floor within limits, hands and gazes at their targets, agents."""

import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.errors import PoseError, SceneError
from warpvis.situations import (
    JOINT_LIMITS,
    Body,
    Colors,
    Person,
    crouching,
    looking_at,
    pointing,
    posed,
    reaching,
    sitting,
    standing,
    stature,
    walking,
)
from warpvis.situations.people._solids import make_pieces, reach_of

from support.bodies import placed, self_penetrations

# ANSUR II: 5th, 50th and 95th percentile [m], of stature - sittingheight + eyeheightsitting, and others.
EYE_HEIGHTS = {"male": (1.536, 1.640, 1.753), "female": (1.421, 1.517, 1.626)}
SITTING_EYE_HEIGHTS = {"male": (0.750, 0.804, 0.860), "female": (0.698, 0.748, 0.799)}
INTERPUPILLARY = {"male": (0.0585, 0.0640, 0.0700), "female": (0.0555, 0.0620, 0.0675)}

POSTURES = {
    "standing": standing(),
    "sitting": sitting(),
    "sitting low": sitting(0.3),
    "sitting high": sitting(0.65),
    "sitting back": sitting(0.42, recline=0.4),
    "sitting at a table": sitting(0.45, table_height=0.74),
    "crouching": crouching(0.8),
    "crouching deep": crouching(1.0),
    "heel strike": walking(0.0),
    "mid stance": walking(0.25),
    "swing": walking(0.7),
    "reaching": reaching((0.5, -0.2, 1.2)),
    "reaching across": reaching((0.35, 0.25, 1.1)),
    "reaching low": reaching((0.6, 0.0, 0.45)),
    "reaching to the floor": reaching((0.5, 0.0, 0.15), crouching(0.9)),
    "pointing": pointing((4.0, -1.0, 1.5)),
    "looking": looking_at((1.0, 1.5, 0.2)),
}
BODIES = {
    "man": {"height": 1.76, "sex": "male"},
    "woman": {"height": 1.63, "sex": "female"},
    "stout": {"height": 1.7, "build": 1.3},
    "slender": {"height": 1.9, "build": 0.8},
}
posture_cases = pytest.mark.parametrize("posture", POSTURES.values(), ids=POSTURES)
body_cases = pytest.mark.parametrize("size", BODIES.values(), ids=BODIES)


def lowest(person, name=""):
    """Return the lowest coordinate of the pieces whose name begins with `name` [m]."""
    found = [at[2, 3] - reach_of(p.solid, at[2, :3]) for p, at in placed(person) if p.name.startswith(name)]
    return min(found)


@body_cases
def test_segments_add_up_to_the_height(size):
    body = Body(**size)
    joints, h = body.joints, body.height
    legs = joints["thigh_left"][2]
    lengths = [joints[f"{a}_left"][2] - joints[f"{b}_left"][2] for a, b in (("thigh", "shank"), ("shank", "foot"))]
    assert sum(lengths) + joints["foot_left"][2] == pytest.approx(legs)
    center, half = body.head
    assert center[2] + half[2] == pytest.approx(h)
    assert joints["upper_arm_left"][2] - joints["forearm_left"][2] == pytest.approx(0.186 * h)
    assert joints["forearm_left"][2] - joints["hand_left"][2] == pytest.approx(0.146 * h)
    person = Person(posture=posed({f"{name}_{side}": 0.0 for side in ("left", "right") for name in (
        "hip_abduction", "shoulder_abduction")}), **size)  # fmt: skip
    tops = [at[2, 3] + reach_of(piece.solid, at[2, :3]) for piece, at in placed(person) if piece.name != "hair"]
    assert max(tops) - lowest(person) == pytest.approx(h, abs=2e-3)


@pytest.mark.parametrize("sex", EYE_HEIGHTS)
def test_eyes_are_where_tables_have_them(sex):
    for percentile, standing_eyes, sitting_eyes, distance in zip(
        (5, 50, 95), EYE_HEIGHTS[sex], SITTING_EYE_HEIGHTS[sex], INTERPUPILLARY[sex], strict=True
    ):
        height = stature(percentile, sex)
        upright, seated = (Person(height=height, sex=sex, posture=posture) for posture in (standing(), sitting(0.45)))
        assert upright.eye_pose[2] == pytest.approx(standing_eyes, abs=0.012)
        assert seated.eye_pose[2] - 0.45 == pytest.approx(sitting_eyes, abs=0.015)
        assert upright.body.interpupillary_distance == pytest.approx(distance, abs=0.007)


def test_eyes_are_at_the_front_of_the_head():
    person = Person(height=1.7, pose=(1.0, 2.0, math.pi / 2))
    head = next(at for piece, at in placed(person) if piece.name == "head")
    eye = person.eye_pose[:3] - head[:3, 3]
    assert eye[1] > 0.08 and abs(eye[0]) < 1e-12
    forward = wv.core.poses.poses_to_matrices(person.eye_pose)[:3, 2]
    np.testing.assert_allclose(forward, [0, 1, 0], atol=1e-9)


@body_cases
@posture_cases
def test_feet_stand_on_the_floor(posture, size):
    person = Person(posture=posture, **size)
    assert lowest(person, "foot") == pytest.approx(0.0, abs=0.004)
    assert lowest(person) > -0.005


@pytest.mark.parametrize("size", [BODIES["woman"], BODIES["stout"]], ids=["woman", "stout"])
@posture_cases
def test_solids_intersect_at_joints_only(posture, size):
    person = Person(posture=posture, **size)
    for pair, (steps, depth) in self_penetrations(person).items():
        if steps == 2:  # abdomen and thighs, at the hips
            assert depth < 0.06 * person.height, pair
        if steps > 2:
            assert depth < 0.02 * person.height, pair


@posture_cases
def test_angles_are_within_limits(posture):
    for name, value in Person(height=1.75, posture=posture).joint_angles().items():
        low, high = JOINT_LIMITS[name]
        assert low - 1e-6 <= value[0] <= high + 1e-6, name


def test_hands_reach_points():
    rng = np.random.default_rng(1)
    points = rng.uniform((0.25, -0.5, 0.8), (0.6, 0.2, 1.7), (500, 3))
    for hand in ("right", "nearest"):
        person = Person(height=1.75, posture=reaching(points, hand=hand), pose=(0, 0, 0))
        right, left = person.hand_positions("right"), person.hand_positions("left")
        error = np.linalg.norm(right - points, axis=1)
        if hand == "nearest":
            error = np.where(points[:, 1] > 0, np.linalg.norm(left - points, axis=1), error)
        assert error.max() < 1e-6
        for name, value in person.joint_angles().items():
            low, high = JOINT_LIMITS[name]
            assert ((value >= low - 1e-6) & (value <= high + 1e-6)).all(), name


def test_reaching_is_the_same_at_every_place():
    rng = np.random.default_rng(2)
    places = rng.uniform((-5, -5, -3), (5, 5, 3), (50, 3))
    turn = np.stack([np.cos(places[:, 2]), np.sin(places[:, 2])], axis=1)
    ahead = places[:, :2] + 0.45 * turn
    person = Person(height=1.6, posture=reaching(np.column_stack([ahead, np.full(50, 1.0)])), pose=places, floor=0.1)
    np.testing.assert_allclose(person.hand_positions()[:, :2], ahead, atol=1e-9)
    flexion = person.joint_angles()["elbow_flexion_right"]
    np.testing.assert_allclose(flexion, flexion[0], atol=1e-9)


def test_gaze_meets_the_point():
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-1, 3, 400), rng.uniform(-3, 3, 400), rng.uniform(0.0, 2.5, 400)])
    angle = np.abs(np.arctan2(points[:, 1], points[:, 0]))
    away = np.linalg.norm(points - [0.1, 0, 1.6], axis=1)
    low = np.arctan2(1.6 - points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    points = points[(angle < 2.2) & (away > 0.7) & (low < 1.2)]
    assert len(points) > 150
    person = Person(height=1.75, posture=looking_at(points))
    at = wv.core.poses.poses_to_matrices(person.eye_poses)
    line = points - at[:, :3, 3]
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    np.testing.assert_allclose(at[:, :3, 2], line, atol=1e-6)


def test_small_gazes_move_eyes_and_head():
    angles = Person(posture=looking_at((3.0, 1.0, 1.6))).joint_angles()
    yaw = math.degrees(angles["eye_yaw"][0])
    assert 2 < yaw < 8
    assert math.degrees(angles["neck_twist"][0]) == pytest.approx(18.4 - yaw, abs=2)
    assert "spine_twist" not in angles


def test_pointing_is_straight():
    target = np.array([3.0, -2.0, 0.5])
    person = Person(posture=pointing(target))
    shoulder, elbow = (person.joint_positions()[f"{part}_right"][0] for part in ("upper_arm", "forearm"))
    wrist, grip = person.joint_positions()["hand_right"][0], person.hand_positions()[0]
    line = (target - shoulder) / np.linalg.norm(target - shoulder)
    for point in (elbow, wrist, grip):
        np.testing.assert_allclose(np.cross(point - shoulder, line), 0, atol=1e-9)
        assert (point - shoulder) @ line > 0
    level = Person(posture=pointing(direction=(0, 1, 0), hand="left"), pose=(0, 0, 0))
    line = level.hand_positions("left")[0] - level.joint_positions()["upper_arm_left"][0]
    np.testing.assert_allclose(line / np.linalg.norm(line), [0, 1, 0], atol=1e-9)


def test_walking_repeats_and_alternates():
    first, last = (Person(posture=walking(phase)).object_poses() for phase in (0.0, 1.0))
    np.testing.assert_allclose(first, last, atol=1e-9)
    now, then = (Person(posture=walking(phase)).joint_angles() for phase in (0.2, 0.7))
    for name in ("hip_flexion", "knee_flexion", "ankle_flexion", "shoulder_flexion"):
        np.testing.assert_allclose(now[f"{name}_left"], then[f"{name}_right"], atol=1e-9)
    # Perry and Burnfield: about 60 degrees of knee flexion in initial swing, 20 degrees of hip extension at most.
    cycle = Person(posture=walking(np.linspace(0, 1, 101))).joint_angles()
    assert np.degrees(cycle["knee_flexion_left"]).max() == pytest.approx(61, abs=3)
    assert np.degrees(cycle["hip_flexion_left"]).min() == pytest.approx(-20, abs=2)


def test_worlds_are_those_of_single_people():
    seats = np.array([0.40, 0.45, 0.50])
    places = np.array([[0, 0, 0], [1, 0, 1], [2, 1, -1.0]])
    together = Person(posture=sitting(seats), pose=places).object_poses()
    assert together.shape == (3, len(make_pieces(Body())), 7)
    for row, seat, place in zip(together, seats, places, strict=True):
        np.testing.assert_allclose(Person(posture=sitting(seat), pose=place).object_poses()[0], row, atol=1e-12)


def test_people_are_the_same_in_worlds_with_y_up():
    point = np.array([0.4, -0.1, 1.2])
    turned = np.array([point[1], point[2], point[0]])
    high, wide = (
        Person(posture=looking_at(point, reaching(point))),
        Person(posture=looking_at(turned, reaching(turned)), up="y"),
    )
    np.testing.assert_allclose(wide.hand_positions()[0], turned, atol=1e-9)
    np.testing.assert_allclose(wide.object_poses()[..., [2, 0, 1]], high.object_poses()[..., :3], atol=1e-9)
    scene = wv.Scene(up="y")
    wide.add_to(scene, "anna")
    assert scene.bounds[0, 1] == pytest.approx(0, abs=0.01)
    with pytest.raises(SceneError, match='up of the person must be that of the scene, "y", got "z"'):
        high.add_to(scene, "ben")


def test_an_agent_sees_what_is_in_front_of_its_face():
    scene = wv.Scene()
    person = Person(height=1.7, pose=(0, 0, math.pi / 2))
    agent = person.add_to(scene, "anna")
    for name, place in (("front", (0, 2, 1.5)), ("behind", (0, -2, 1.5))):
        scene.add(trimesh.creation.icosphere(radius=0.1), name=name, label="object", pose=(*place, 0, 0, 0, 1))
    seen = wv.perspective(scene, [agent])
    states = {name: wv.Visibility(state) for name, state in zip(seen.objects, seen.status[0, 0], strict=True)}
    assert states["front"] == wv.Visibility.VISIBLE and states["behind"] == wv.Visibility.OUT_OF_VIEW
    item = scene["anna/head"]
    assert (item.label, item.category) == (wv.Label.HUMAN, "person")
    assert agent.body == tuple(item.name for item in scene.objects if item.name.startswith("anna/"))


def test_arms_hide_things_from_their_owner_but_the_head_does_not():
    scene = wv.Scene()
    ball = (0.6, 0.0, 1.2)
    person = Person(height=1.7, posture=looking_at(ball, reaching((0.35, 0.0, 1.37))))
    agent = person.add_to(scene, "anna")
    scene.add(trimesh.creation.icosphere(radius=0.02), name="ball", label="object", pose=(*ball, 0, 0, 0, 1))
    with_arm = wv.object_visibility(
        scene, wv.Camera.kinect(), agent.poses, objects=["ball"], exclude=list(agent.excluded)
    )
    without = wv.object_visibility(scene, wv.Camera.kinect(), agent.poses, objects=["ball"], exclude=list(agent.body))
    assert float(with_arm.fraction.numpy()[0, 0]) < float(without.fraction.numpy()[0, 0])


BAD = {
    "height in cm": (lambda: Person(height=175), "pass 1.75 for 175 cm"),
    "height in mm": (lambda: Person(height=1750.0), "pass 1.75 for 1750 mm"),
    "no height": (lambda: Person(height=math.nan), "height must be from 1.2 to 2.3 m, got nan"),
    "a fraction": (lambda: stature(0.5), "pass 50 for the fraction 0.5"),
    "sex": (lambda: Person(sex="m"), 'sex must be "average", "male" or "female"'),
    "build in percent": (lambda: Person(build=110), "pass 1.1 for 110 %"),
    "posture": (lambda: Person(posture="sitting"), "posture must be one of"),
    "pose of 7": (lambda: Person(pose=(0, 0, 0, 0, 0, 0, 1)), "a person has no other rotation"),
    "NaN": (lambda: Person(pose=(0, math.nan, 0)), "must be finite x, y and heading"),
    "degrees": (lambda: Person(pose=(0, 0, 90)), "math.radians"),
    "worlds": (lambda: Person(pose=np.zeros((2, 3)), posture=walking([0, 0.1, 0.2])), "got 2 and 3"),
    "seat in cm": (lambda: sitting(45), "pass 0.45 for centimeters"),
    "high seat": (lambda: Person(posture=sitting(1.2)).eye_pose, "seat_height must be from"),
    "phase in percent": (lambda: walking(50), "pass 0.5 for percent"),
    "too far": (lambda: Person(posture=reaching((3, 0, 1))).eye_pose, "must be within reach of the right hand"),
    "point": (lambda: reaching((1, 2)), "point must be three finite numbers"),
    "behind": (lambda: Person(posture=looking_at((-3, 0.1, 1.6))).eye_pose, "turn the person"),
    "wrong arm": (lambda: Person(posture=pointing((-1, 4, 1))).eye_pose, "use the other hand, or turn the person"),
    "nothing": (pointing, "either a point or a direction"),
    "joint": (lambda: posed({"elbow": 1}), "angles must be of the joints"),
    "limit": (lambda: posed({"elbow_flexion_left": 3}), "0 to 150 degrees"),
    "degrees of a joint": (lambda: posed({"elbow_flexion_left": 90}), "math.radians"),
    "hand": (lambda: reaching((1, 0, 1), hand="both"), 'hand must be "right", "left" or "nearest"'),
    "color": (lambda: Colors(skin="red"), "skin of a person"),
}  # fmt: skip


@pytest.mark.parametrize(("call", "message"), BAD.values(), ids=BAD)
def test_wrong_input_is_one_sentence(call, message):
    with pytest.raises((PoseError, SceneError)) as caught:
        call()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
