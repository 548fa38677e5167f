# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of picked points, turned eyes and meant objects in the viewer, without a browser."""

import math
from unittest import mock

import numpy as np
import pytest

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.viewer import Viewer, ViewerState

from support.picking import BOARD, BOOK, CUP, EYES, HEAD, agents, table

PORT = 8631


def state():
    return ViewerState(table(), agents(), points=1000)


def axis(agent):
    return poses_to_matrices(agent.poses)[0, :3, 2]


def test_picked_point_tells_who_sees_it():
    found = state()
    # From above onto the side of the cup that faces anna: (1.65, 0.32, 0.87).
    origin, target = np.array([2.65, 0.32, 1.87]), np.array([1.65, 0.32, 0.87])
    assert found.pick_along(origin, target - origin)
    picked = found.snapshot().picked
    np.testing.assert_allclose(picked.point, target, atol=1e-5)
    assert picked.object == "cup" and picked.title == "point on cup at (1.65, 0.32, 0.87)"
    assert picked.reasons["anna"] == "visible"
    stop = EYES + (target - EYES) * BOARD / target[0]
    reached, whole = math.dist(EYES, stop), math.dist(EYES, target)
    assert picked.reasons["robot"] == f"hidden by board at {reached:.2f} m, {whole - reached:.2f} m before the point"
    np.testing.assert_allclose(picked.lines[0].stop, stop, atol=1e-5)


def test_picked_point_moves_with_its_object():
    found = state()
    found.pick_along((1.62, 0.3, 3), (0, 0, -1))
    np.testing.assert_allclose(found.snapshot().picked.point, (1.62, 0.3, 0.9), atol=1e-5)
    s = math.sin(math.pi / 4)
    found.move_object("cup", (1.0, -0.5, 0.85, 0, 0, s, s))  # a quarter turn: x becomes y
    picked = found.snapshot().picked
    np.testing.assert_allclose(picked.point, (1.0, -0.48, 0.9), atol=1e-5)
    assert picked.reasons["robot"].startswith("out of view: ") or picked.reasons["robot"] == "visible"
    found.pick((1.6, 0.0, 2.0))
    found.move_object("cup", (*CUP, 0, 0, 0, 1))
    assert found.snapshot().picked.point == (1.6, 0.0, 2.0)
    found.pick(None)
    assert found.snapshot().picked is None


def test_own_body_and_eyes_have_no_line_of_sight():
    found = state()
    assert found.pick_along((0, 0, 0.9), (1, 0, 0.02))
    picked = found.snapshot().picked
    assert picked.object == "anna's body" and picked.reasons["anna"] == "own body, which it does not see"
    assert [line.agent for line in picked.lines] == ["robot"]
    found.pick(HEAD)
    picked = found.snapshot().picked
    assert picked.reasons["anna"] == "its eyes are there" and [line.agent for line in picked.lines] == ["robot"]
    assert not found.pick_along((0, 0, 3), (0, 0, 1)) and found.snapshot().picked is not None


def test_turned_eyes_look_where_the_angles_say():
    found = state()
    head = agents()[1]
    right, up = 0.4, -0.3
    found.turn_eyes("anna", right, up)
    local = (math.sin(right) * math.cos(up), -math.sin(up), math.cos(right) * math.cos(up))
    expected = poses_to_matrices(head.poses)[0, :3, :3] @ local
    np.testing.assert_allclose(axis(found.snapshot().agents[1]), expected, atol=1e-9)
    np.testing.assert_allclose(axis(found.agents["anna"]), axis(head), atol=1e-9)  # the head stays
    found.release_eyes("anna")
    np.testing.assert_allclose(axis(found.snapshot().agents[1]), axis(head), atol=1e-9)


def angles_to(point):
    """Return the angles to the right and up from anna's head to a point."""
    x, y, z = (np.asarray(point) - HEAD) @ poses_to_matrices(agents()[1].poses)[0, :3, :3]
    return math.atan2(x, z), math.atan2(-y, math.hypot(x, z))


@pytest.mark.parametrize(("name", "center"), [("cup", CUP), ("book", BOOK)])
def test_gaze_changes_what_is_meant(name, center):
    found = state()
    before = {item.object: item.probability for item in found.snapshot().meant["anna"]}
    assert set(before) == {"cup", "book"} and 0.3 < before["cup"] < 0.7
    found.turn_eyes("anna", *angles_to(center))
    meant = found.snapshot().meant["anna"]
    assert meant[0].object == name and meant[0].probability > 0.75 and meant[0].gaze_angle == 0
    # The same gaze without turning the field of view, in which both objects are either way.
    seen = wv.perspective(table(), agents(), objects=["cup", "book"])
    (expected, *_) = seen.candidates("anna", "robot", gaze=np.subtract(center, HEAD))
    assert expected.object == name and meant[0].probability == pytest.approx(expected.probability, abs=0.02)
    found.reset()
    after = {item.object: item.probability for item in found.snapshot().meant["anna"]}
    assert after == pytest.approx(before)


def test_eyes_turn_the_field_of_view():
    found = state()
    found.pick((3.0, 2.0, 1.2))  # 90 degrees to the right of anna, in her field of 200 degrees
    assert found.snapshot().picked.reasons["anna"] == "visible"
    found.turn_eyes("anna", math.radians(-30), 0)
    line = found.snapshot().picked.lines[1]
    x, _, z = (np.array([3.0, 2.0, 1.2]) - HEAD) @ poses_to_matrices(agents()[1].poses)[0, :3, :3]
    assert math.degrees(line.outside) == pytest.approx(math.degrees(math.atan2(x, z)) + 30 - 100, abs=0.5)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda s: s.turn_eyes("anna", 0.9, 0.9), "by at most 55 degrees, got 67 degrees"),
        (lambda s: s.turn_eyes("anna", 30, 0), "right must be in radians|by at most 55 degrees"),
        (lambda s: s.turn_eyes("anna", "left", 0), "right must be a finite number of radians"),
        (lambda s: s.turn_eyes("bob", 0, 0), "no agent 'bob'"),
        (lambda s: s.release_eyes("bob"), "no agent 'bob'"),
        (lambda s: s.pick((1, 2)), "point must be three finite numbers"),
        (lambda s: s.pick_along((0, 0, 0), (0, 0, 0)), "direction must not be 0"),
        (lambda s: s.pick_along((0, 0, math.nan), (0, 0, 1)), "origin must be three finite numbers"),
    ],
)
def test_invalid_arguments_raise(call, words):
    with pytest.raises(wv.WarpvisError, match=words):
        call(state())


@pytest.fixture(scope="module")
def viewer():
    with Viewer(state(), port=PORT) as found:
        yield found


@pytest.fixture
def page(viewer):
    yield viewer.page
    viewer.state.reset()
    viewer.state.pick(None)
    viewer.page.gaze.reset()
    viewer.update()


def click(page, origin, target):
    """Simulate viser's callback when a user clicks what is seen from `origin` at `target`."""
    direction = np.subtract(target, origin)
    event = mock.Mock(ray_origin=tuple(origin), ray_direction=tuple(direction / np.linalg.norm(direction)))
    for entry in page.server.scene._scene_pointer_cb:
        entry.callback(event)
    page.update(wait=True)


def slide(page, slider, value):
    """Simulate viser's callbacks when a user moves a slider."""
    slider.value = value
    for callback in slider._impl.update_cb:
        callback(mock.Mock(target=slider, client_id=1))
    page.update(wait=True)


def nodes(page):
    return {node.name: node for node in page.answers.marks._nodes}


def test_click_shows_answers_lines_and_marks(page):
    assert "Click a surface" in page.answers.text.content and not page.answers._clear.visible
    click(page, (2.65, 0.32, 1.87), (1.65, 0.32, 0.87))
    text = page.answers.text.content
    assert "point on cup" in text and "hidden by board at 1.20 m" in text and "visible" in text
    assert page.answers.marks.handle.visible and page.answers._clear.visible
    np.testing.assert_allclose(page.answers.marks.handle.position, (1.65, 0.32, 0.87), atol=1e-5)
    shown = nodes(page)
    np.testing.assert_allclose(shown["/picked/stop 0"].position, page.snapshot.picked.lines[0].stop)
    lines = shown["/picked/lines"]
    assert lines.points.shape == (3, 2, 3)  # the robot's line in two parts, and anna's
    assert [tuple(color) for color in lines.colors[:, 0]] == [(0, 158, 115), (213, 94, 0), (0, 158, 115)]
    page.answers._pick(None)
    page.update(wait=True)
    assert nodes(page) == {} and not page.answers.marks.handle.visible


def test_click_on_nothing_forgets_the_point(page):
    click(page, (0, 0, 3), (1.6, 0.3, 0.9))
    assert page.snapshot.picked is not None
    click(page, (0, 0, 3), (0, 0, 4))
    assert page.snapshot.picked is None and "Nothing is there" in page.answers.text.content


def test_click_on_a_handle_picks_its_object(page):
    gizmo = page.gizmos.objects["cup"]
    client = mock.Mock(camera=mock.Mock(position=np.array([3.6, 0.3, 1.85])))

    def gesture(*phases):
        for phase in phases:
            for callback in gizmo._impl_aux.update_cb:
                callback(mock.Mock(phase=phase, target=gizmo, client=client, client_id=1))
        page.update(wait=True)

    gesture("start", "update", "end")
    assert page.snapshot.picked is None  # the handle was dragged
    gesture("start", "end")
    picked = page.snapshot.picked
    assert picked.object == "cup"
    np.testing.assert_allclose(picked.point, (1.65, 0.3, 0.875), atol=1e-5)  # on the way to the center


def test_dragged_point_is_judged_in_free_space(page):
    click(page, (2.65, 0.32, 1.87), (1.65, 0.32, 0.87))
    handle = page.answers.marks.handle
    handle.position = (1.0, 0.3, 0.85)
    for callback in handle._impl_aux.update_cb:
        callback(mock.Mock(target=handle, client_id=1))
    page.update(wait=True)
    picked = page.snapshot.picked
    assert picked.object is None and picked.reasons["robot"] == "visible"
    assert picked.reasons["anna"].startswith("hidden by board at")
    np.testing.assert_allclose(handle.position, (1.0, 0.3, 0.85))


def test_gaze_sliders_change_answers_and_probabilities(page):
    click(page, (2.65, 0.32, 1.87), (1.65, 0.32, 0.87))
    before = page.answers.meant.content
    right, up = (math.degrees(angle) for angle in angles_to(CUP))
    slide(page, page.gaze.right, round(right))
    slide(page, page.gaze.up, round(up))
    assert page.state.snapshot().meant["anna"][0].object == "cup"
    after = page.answers.meant.content
    assert after != before and after.index("cup") < after.index("book")
    assert f"{page.snapshot.meant['anna'][0].probability:.2f}</td>" in after
    slide(page, page.gaze.right, 55)
    slide(page, page.gaze.up, 40)
    assert "by at most 55 degrees" in page.panel.message.content
    # The sliders of another agent are at 0, and turn its camera.
    page.gaze.agent.value = "robot"
    assert page.gaze.right.value == 0 and page.gaze.up.value == 0
    slide(page, page.gaze.right, -50)
    assert "out of view" in page.snapshot.picked.reasons["robot"]
    page.gaze.agent.value = "anna"
    assert page.gaze.right.value == 55
    page.gaze._release()
    page.update(wait=True)
    assert page.gaze.right.value == 0 and list(page.gaze.angles) == ["robot"]
    assert page.answers.meant.content == before


def test_exported_file_has_the_answers(page, tmp_path):
    click(page, (2.65, 0.32, 1.87), (1.65, 0.32, 0.87))
    path = tmp_path / "table.html"
    with mock.patch.object(page.server.scene, "as_html", wraps=page.server.scene.as_html) as export:
        export.side_effect = lambda **_: (
            "<head></head><body></body>" if not page.answers.marks.handle.visible else "the handle is shown"
        )
        from warpvis.viewer._view import write_page

        write_page(page, path, "Table")
    text = path.read_text()
    assert "hidden by board at 1.20 m" in text and "warpvis-meant" in text and page.answers.marks.handle.visible
