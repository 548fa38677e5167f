# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of picked points and turned eyes while a depth camera is watched: the watcher, and its page."""

import math
from unittest import mock

import numpy as np
import pytest

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.viewer import WatchPage
from warpvis.viewer._watch_answers import nearest_along

from support.watching import BALL, BOX, CAMERA, EYES, FLOOR, depths, person, raised, trajectory

PORT = 8661
BOARD = 2.63
"""Where the board's side towards anna is."""


def watching(model=None, people=None, count=8, time=None):
    """Return a watcher of the room, and its last results."""
    places = {"ball": raised(BALL), "box": raised(BOX)}
    watcher = wv.visibility.DepthWatcher(CAMERA, places=places, floor=FLOOR, cell_size=0.04, model=model)
    poses = trajectory()[:count]
    for index, (depth, pose) in enumerate(zip(depths(poses), poses, strict=True)):
        now = None if time is None else index * time
        watched = watcher.update(depth, pose, [person()] if people is None else people, time=now)
    return watcher, watched


def angles_to(place, eyes=EYES, target=BALL):
    """Return the angles to the right and up [rad] from a head that looks at `target`."""
    frame = poses_to_matrices(wv.look_at(eyes, target[:3])[None])[0]
    x, y, z = (np.array(place[:3]) - eyes) @ frame[:3, :3]
    return math.atan2(x, z), math.atan2(-y, math.hypot(x, z))


def test_lines_of_sight_tell_why_and_where():
    watcher, watched = watching()
    lines = watcher.lines_of_sight(BALL[:3])
    assert list(lines) == ["robot", "anna"]
    assert lines["robot"].status == wv.Visibility.OCCLUDED  # the center is inside of the ball
    front = np.array(BALL[:3]) - (0.1, 0, 0)
    assert watcher.lines_of_sight(front)["robot"].reason == "visible"
    stop = EYES + (np.array(BALL[:3]) - EYES) * (EYES[0] - BOARD) / (EYES[0] - BALL[0])
    np.testing.assert_allclose(lines["anna"].stop, stop, atol=0.1)
    assert lines["anna"].reason.startswith("hidden by a measured surface at ")
    behind = watcher.lines_of_sight((5.0, 0.6, 1.4))["anna"]
    assert behind.side == "behind" and behind.eye == pytest.approx(EYES)
    # The wall behind anna is not mapped where nothing was seen.
    high = watcher.lines_of_sight((2.0, 2.5, 2.9))["anna"]
    assert high.status == wv.Visibility.UNKNOWN and 0 < high.unknown_length < high.distance
    assert watched.sights["anna"]["ball"].status == wv.Visibility.OCCLUDED


def test_turned_eyes_have_the_probabilities_of_a_turned_head():
    bob = person("bob", eyes=(0.2, 0.2, 1.5), target=(2.0, -0.2, 0.6))
    watcher, before = watching(people=[bob])
    assert set(before.candidates["bob"]) == {"ball", "box"}
    right, up = angles_to(BOX, (0.2, 0.2, 1.5), (2.0, -0.2, 0.6))
    turned = watcher.turn_eyes("bob", (right, up))
    assert turned.candidates["bob"]["box"] > 0.85 > before.candidates["bob"]["box"]
    np.testing.assert_allclose(turned.robot.poses, before.robot.poses)
    head = wv.Agent.human("bob", wv.look_at(raised((0.2, 0.2, 1.5)), raised(BOX)[:3]))
    model = wv.visibility.ReferenceModel()
    _, expected = watching(wv.visibility.ReferenceModel(head_sigma=model.gaze_sigma), [head])
    assert turned.candidates["bob"] == pytest.approx(expected.candidates["bob"], abs=1e-4)
    axis = poses_to_matrices(turned.people[0].poses)[0, :3, 2]
    assert axis @ (np.array(BOX[:3]) - (0.2, 0.2, 1.5)) > 0.99999 * math.dist(BOX[:3], (0.2, 0.2, 1.5))
    assert watcher.turn_eyes("bob", None).candidates["bob"] == pytest.approx(before.candidates["bob"])


def test_turned_eyes_stay_turned_and_are_not_counted_twice():
    bob = person("bob", eyes=(0.2, 0.2, 1.5), target=(2.0, -0.2, 0.6))
    watcher, _ = watching(people=[bob], count=3, time=0.5)
    angles = angles_to(BOX, (0.2, 0.2, 1.5), (2.0, -0.2, 0.6))
    first = watcher.turn_eyes("bob", angles)
    assert watcher.turn_eyes("bob", angles).candidates["bob"] == pytest.approx(first.candidates["bob"])
    pose = trajectory()[3]
    (depth,) = depths(pose[None])
    later = watcher.update(depth, pose, [bob], time=1.5)
    assert later.candidates["bob"]["box"] > first.candidates["bob"]["box"]
    np.testing.assert_allclose(later.people[0].poses, first.people[0].poses)


def test_eyes_turn_the_field_of_view():
    watcher, _ = watching()
    right, _ = angles_to((EYES[0], EYES[1] + 2.0, EYES[2]))  # to the right of anna
    assert math.degrees(right) == pytest.approx(90, abs=6)
    place = (EYES[0], EYES[1] + 2.0, EYES[2])
    assert watcher.lines_of_sight(place)["anna"].status != wv.Visibility.OUT_OF_VIEW
    watcher.turn_eyes("anna", (math.radians(-40), 0.0))
    line = watcher.lines_of_sight(place)["anna"]
    assert math.degrees(line.outside) == pytest.approx(math.degrees(right) + 40 - 100, abs=3)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda w: w.turn_eyes("anna", (0.9, 0.9)), "by at most 55 degrees, got 67 degrees"),
        (lambda w: w.turn_eyes("anna", 0.3), "angles must be a list"),
        (lambda w: w.turn_eyes("anna", (0.1,)), "angles must be two numbers"),
        (lambda w: w.turn_eyes(3, None), "name must be"),
        (lambda w: w.lines_of_sight((1, 2)), "point must be three finite numbers"),
        (lambda w: w.lines_of_sight(EYES), "point must not be at the eyes of 'anna'"),
    ],
)
def test_invalid_arguments_raise(call, words):
    watcher, _ = watching(count=1)
    with pytest.raises(wv.WarpvisError, match=words):
        call(watcher)


def test_watcher_without_images_has_no_lines():
    watcher = wv.visibility.DepthWatcher(CAMERA, floor=FLOOR)
    with pytest.raises(wv.WarpvisError, match="the map must not be empty"):
        watcher.lines_of_sight((1, 0, 0))
    assert watcher.turn_eyes("anna", (0.1, 0.0)) is None


def test_first_point_close_to_a_ray_is_picked():
    points = np.array([[3, 0.01, 0], [2, 0.02, 0], [1, 0.5, 0], [-1, 0, 0]], dtype=np.float32)
    found = nearest_along(points, np.zeros(3), np.array([2.0, 0, 0]), 0.024)
    np.testing.assert_allclose(found, (2, 0.02, 0), atol=1e-6)
    np.testing.assert_allclose(
        nearest_along(points, np.zeros(3), np.array([1.0, 0, 0]), 0.001), (3, 0.01, 0), atol=1e-6
    )
    assert nearest_along(points, np.zeros(3), np.array([0, 1.0, 0]), 0.02) is None
    assert nearest_along(points[:0], np.zeros(3), np.array([1.0, 0, 0]), 0.02) is None


def test_page_answers_clicks_and_sliders():
    watcher, watched = watching()
    with WatchPage(watcher, port=PORT, speed=0) as page:
        page.show(watched, "here")
        answers = page.answers
        assert "Click a surface" in answers.answers.text.content
        assert answers.gaze.agent.options == ("anna",) and "box" in answers.answers.meant.content

        def click(origin, target):
            event = mock.Mock(ray_origin=tuple(origin), ray_direction=tuple(np.subtract(target, origin)))
            for entry in page.server.scene._scene_pointer_cb:
                entry.callback(event)

        click((0, 0.5, 1.6), BALL[:3])
        center = np.array(BALL[:3])
        assert np.linalg.norm(np.array(answers.picked.point) - center) == pytest.approx(0.1, abs=0.05)
        text = answers.answers.text.content
        assert "<b>robot</b>: visible" in text and "<b>anna</b>: hidden by a measured surface at" in text
        (stop,) = (node for node in answers.answers.marks._nodes if "stop" in node.name)
        assert stop.position[0] == pytest.approx(BOARD, abs=0.1)
        before = watched.candidates["anna"]
        answers.gaze.right.value = 40
        for callback in answers.gaze.right._impl.update_cb:
            callback(mock.Mock(client_id=1))
        assert answers._watched.candidates["anna"].keys() == before.keys()
        np.testing.assert_allclose(page._marks["anna"].frame.position, EYES)
        axis = poses_to_matrices(answers._watched.people[0].poses)[0, :3, 2]
        old = poses_to_matrices(watched.people[0].poses)[0, :3, 2]
        assert math.degrees(math.acos(axis @ old)) == pytest.approx(40)
        click((0, 0.5, 1.6), (0, 0.5, 5))
        assert answers.picked is None and "Nothing is there" in answers.answers.text.content
        answers._pick(EYES)
        answers._attempt(lambda: None)
        assert "point must not be at the eyes" in page._message.content
        page.show(watched, "later")
