# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the live page's server without a browser: dragged handles, sliders, and the command."""

import socket
import sys
import threading
from unittest import mock

import numpy as np
import pytest
from command_line import run_inside

import warpvis as wv
from warpvis.cli import View
from warpvis.scenes import EXPERIMENTS
from warpvis.viewer import Viewer, ViewerState
from warpvis.visibility import State
from warpvis.viz import STATE_COLORS

PORT = 8391


@pytest.fixture(scope="module")
def viewer():
    experiment = EXPERIMENTS[0]
    state = ViewerState(experiment.build(), experiment.agents(), points=4000)
    with Viewer(state, port=PORT) as found:
        yield found


@pytest.fixture
def page(viewer):
    yield viewer.page
    viewer.state.reset()
    viewer.update()


def drag(page, gizmo, position):
    """Simulate viser's callbacks when a user drags a handle."""
    gizmo.position = position
    for callback in gizmo._impl_aux.update_cb:
        callback(mock.Mock(target=gizmo, client_id=1))
    page.update(wait=True)


def test_page_listens_on_localhost_only(viewer):
    assert viewer.url == f"http://localhost:{viewer.server.get_port()}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # sends nothing: finds the address of this machine's outgoing interface
        here = probe.getsockname()[0]
    with pytest.raises(OSError), socket.create_connection((here, viewer.server.get_port()), timeout=2):
        pass


def test_dragged_ball_updates_table_and_cloud(page):
    assert "hidden by" not in page.panel.table.content
    ball = page.state.cloud.objects == page.state.scene.index("ball")
    before = page.cloud.node.colors[ball].copy()
    assert (before == STATE_COLORS[State.BOTH]).all(axis=1).any()
    drag(page, page.gizmos.objects["ball"], (0.55, 1.0, 0.1))
    assert "hidden by high obstacle" in page.panel.table.content
    after = page.cloud.node.colors[ball]
    assert not (after == STATE_COLORS[State.BOTH]).all(axis=1).any()
    row = page.state.stage.column("ball")
    np.testing.assert_allclose(page.server.scene.get_handle_by_name(f"/moving/{row}").position, (0.55, 1.0, 0.1))


def test_dragged_robot_moves_its_body_and_frustum(page):
    robot = page.gizmos.agents["robot"]
    body = page.state.object_pose("robot")
    before = page.marks["robot"].frame.wxyz.copy()
    place = np.array(robot.position)
    drag(page, robot, place + (0.1, 0.2, 0))
    np.testing.assert_allclose(page.marks["robot"].frame.position, place + (0.1, 0.2, 0), atol=1e-6)
    np.testing.assert_allclose(page.marks["robot"].frame.wxyz, before, atol=1e-6)
    np.testing.assert_allclose(page.state.object_pose("robot")[:3], body[:3] + (0.1, 0.2, 0), atol=1e-6)


def test_reset_moves_the_handles_back(page):
    ball = page.gizmos.objects["ball"]
    place = np.array(ball.position)
    drag(page, ball, (1, 1, 1))
    page.act(page.state.reset)
    np.testing.assert_allclose(ball.position, place, atol=1e-6)


def test_images_and_meshes_follow_drags(page):
    assert page.panel.images["robot"].image.shape == (240, 2 * 320 + 4, 3)  # color beside depth
    page.meshes.kind = "visibility"
    index = page.state.scene.index("ball")
    assert tuple(page.meshes._meshes[index].color) == STATE_COLORS[State.BOTH]
    drag(page, page.gizmos.objects["ball"], (0.55, 1.0, 0.1))
    assert tuple(page.meshes._meshes[index].color) != STATE_COLORS[State.BOTH]
    page.meshes.kind = "materials"


def test_moves_by_the_program_are_shown(viewer):
    viewer.state.move_object("ball", (0.55, 1.0, 0.1, 0, 0, 0, 1))
    viewer.update()
    assert "hidden by high obstacle" in viewer.page.panel.table.content
    np.testing.assert_allclose(viewer.page.gizmos.objects["ball"].position, (0.55, 1.0, 0.1))
    viewer.state.reset()
    viewer.update()


def test_concurrent_updates_are_merged(page):
    shown = page.updates
    gate = threading.Event()
    snapshot = page.state.snapshot

    def slow():
        gate.wait(5)
        return snapshot()

    with mock.patch.object(page.state, "snapshot", slow):
        page.update()
        while page._update_event.is_set():  # the worker has taken the first one
            pass
        for _ in range(50):
            page.update()
        gate.set()
        page.update(wait=True)
    assert page.updates - shown <= 3


def test_errors_are_shown_on_the_page(page):
    with mock.patch.object(page.state, "snapshot", side_effect=wv.WarpvisError("no such thing")):
        page.update(wait=True)
    assert "no such thing" in page.panel.message.content and page.panel.message.visible


def test_command_parses_options(tmp_path):
    scene = EXPERIMENTS[0].build()
    scene.export(tmp_path / "room.glb")
    command = View(
        file=tmp_path / "room.glb",
        robot="-1.77 0 0.7 0 0 0.4",
        human=("1.3 0.35 1.6 0.3 0.1 0.1",),
        robot_body=("robot",),
        human_body=("person",),
        movable=("ball,low*",),
    )
    state = command.load()
    assert list(state.agents) == ["robot", "human"] and state.stage.handles == ("low obstacle", "ball")
    assert state.agents["human"].body == ("person",)
    alone = View(file=tmp_path / "room.glb").load()
    assert list(alone.agents) == ["robot"]
    assert all(row.fractions[0] > 0 for row in alone.snapshot().rows)


def test_command_serves_the_page(tmp_path):
    def stop(viewer):
        assert viewer.page.snapshot is not None
        assert viewer.state.stage.handles == ("ball",)

    with mock.patch.object(Viewer, "wait", stop):
        result = run_inside("view", "experiment_3", "--port", PORT + 10, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("http://localhost:")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["experiment_3", "--robot", "0 0 1 1 0 1"], "it takes no --robot"),
        (["experiment_3", "--port", "0"], "port must be"),
        (["experiment_3", "--movable", "cup"], "'cup' in movable matches no object"),
        (["experiment_3", "--host", "300.0.0.1"], "cannot listen on host '300.0.0.1'"),
        (["room.glb", "--robot-body", "robot"], "--robot-body has no effect without --robot"),
        (["room.glb", "--human-body", "robot"], "--human-body has no effect without --human"),
        (["nothing.glb"], "nothing.glb"),
    ],
)
def test_command_rejects_invalid_options(options, words, tmp_path):
    EXPERIMENTS[0].build().export(tmp_path / "room.glb")
    with mock.patch.object(Viewer, "wait", lambda viewer: None):
        result = run_inside("view", *options, cwd=tmp_path)
    assert result.returncode == 2 and words in result.stderr, result.stderr
    assert result.stderr.count("\n") == 1


def test_missing_viser_error_names_the_extra():
    experiment = EXPERIMENTS[0]
    with (
        mock.patch.dict(sys.modules, {"viser": None}),
        pytest.raises(wv.WarpvisError, match=r"pip install 'warpvis\[view\]'"),
    ):
        wv.view(experiment.build(), experiment.agents())


def test_camera_with_agents_raises():
    experiment = EXPERIMENTS[0]
    with pytest.raises(wv.WarpvisError, match="camera must be None if agents are given"):
        wv.view(experiment.build(), experiment.agents(), wv.Camera.kinect())


def test_proposed_view_can_be_applied():
    experiment = EXPERIMENTS[1]
    with Viewer(ViewerState(experiment.build(), experiment.agents(), points=1000), port=PORT) as viewer:
        page = viewer.page
        text, found = page.propose()
        assert found and "it would see: ball" in text
        proposed = page.proposal.node.position.copy()
        page.go_there()
        page.update(wait=True)
        assert page.proposal.node is None
        np.testing.assert_allclose(page.gizmos.agents["robot"].position, proposed, atol=1e-6)
        assert next(row for row in page.snapshot.rows if row.name == "ball").state == State.BOTH
        assert page.propose() == ("robot sees every object that human sees.", False)


def test_lines_of_sight_are_toggled(page):
    assert page.server.scene.get_handle_by_name("/sight") is None
    drag(page, page.gizmos.objects["ball"], (0.55, 1.0, 0.1))
    assert page.server.scene.get_handle_by_name("/sight") is not None
    page.sight.visible = False
    page.update(wait=True)
    assert page.server.scene.get_handle_by_name("/sight") is None
    page.sight.visible = True


MODEL = """<mujoco><worldbody><geom name="floor" type="plane" size="2 2 .1"/>
<body name="arm" pos="0 0 .4"><joint name="turn" axis="0 0 1"/><geom type="box" size=".15 .02 .02" pos=".15 0 .1"/>
</body>
<camera name="head" pos="-2 0 1" xyaxes="0 -1 0 .3 0 1"/><camera name="side" pos="0 -2 1" xyaxes="1 0 0 0 .3 1"/>
</worldbody></mujoco>"""


def test_model_provides_cameras_and_joints(tmp_path):
    (tmp_path / "arm.xml").write_text(MODEL)
    state = View(file=tmp_path / "arm.xml", robot="head", human=("side",)).load()
    assert [tuple(agent.poses[0, :3]) for agent in state.agents.values()] == [(-2, 0, 1), (0, -2, 1)]
    with Viewer(state, port=PORT) as viewer:
        before = viewer.page.snapshot.object_poses[0].copy()
        viewer.page.act(lambda: state.set_joint("turn", 0.5))
        viewer.update()
        assert not np.allclose(viewer.page.snapshot.object_poses[0], before)
        assert "joint turn" in viewer.page.panel.sliders
    human = View(file=tmp_path / "arm.xml", robot="head", human=("0 -2 1 0 0 0.4",)).load().agents["human"]
    assert human.camera == wv.Agent.human("human", human.pose).camera and tuple(human.poses[0, :3]) == (0, -2, 1)
    labeled = View(file=tmp_path / "arm.xml", labels=("arm=object",)).load()
    assert labeled.scene["arm"].label == wv.Label.OBJECT and list(labeled.agents) == ["robot"]
    (tmp_path / "bad.xml").write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    with pytest.raises(wv.WarpvisError, match=r"bad\.xml"):
        View(file=tmp_path / "bad.xml").load()


def test_command_writes_one_html_file(tmp_path):
    result = run_inside("view", "experiment_3", "--html", "three.html", "--port", PORT + 20, cwd=tmp_path)
    assert result.returncode == 0 and result.stdout == "three.html\n"
    text = (tmp_path / "three.html").read_text()
    assert "<title>experiment_3</title>" in text and "hidden by high obstacle" in text
    assert "http-equiv" not in text and 300_000 < len(text) < 3_000_000
    result = run_inside("view", "experiment_3", "--html", "no/three.html", cwd=tmp_path)
    assert result.returncode == 2 and "cannot be written" in result.stderr
