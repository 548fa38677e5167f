# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the state that the live page shows, without a page: tables, clouds, images, and movable objects."""

import math

import mujoco
import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.maps import label_colors
from warpvis.scenes import EXPERIMENTS
from warpvis.viewer import MujocoStage, ViewerState
from warpvis.viewer._nodes import level_frame
from warpvis.viewer._panel import describe_proposal, map_picture, propose
from warpvis.viewer._pictures import kinect_noise, with_view
from warpvis.visibility import State
from warpvis.viz import STATE_COLORS, depth_colors


def state_of(number, **options):
    experiment = EXPERIMENTS[number - 1]
    return ViewerState(experiment.build(), experiment.agents(), points=4000, **options)


def row_of(snapshot, name):
    return next(row for row in snapshot.rows if row.name == name)


def points_of(state, snapshot, name):
    return state.cloud.objects == state.scene.index(name)


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_table_shows_the_states_of_experiments(number):
    experiment, snapshot = EXPERIMENTS[number - 1], state_of(number).snapshot()
    for name, expected in experiment.states.items():
        assert row_of(snapshot, name).state == expected


def test_visibility_equals_perspective_of_the_original_scene():
    experiment = EXPERIMENTS[2]
    snapshot = state_of(3).snapshot()
    expected = wv.perspective(experiment.build(), experiment.agents(), objects=list(snapshot.seen.objects))
    # The ball's and the bodies' vertices are rounded in local frames.
    np.testing.assert_allclose(snapshot.seen.fraction, expected.fraction, atol=0.01)
    np.testing.assert_array_equal(snapshot.seen.status, expected.status)


def test_moved_ball_is_hidden_by_the_named_object():
    state = state_of(1)
    assert row_of(state.snapshot(), "ball").state == State.BOTH
    pose = state.object_pose("ball")
    pose[:2] = 0.55, 1.0  # behind the high obstacle
    state.move_object("ball", pose)
    row = row_of(state.snapshot(), "ball")
    assert row.cells[0] == "hidden by high obstacle" and row.fractions[0] == 0
    state.reset()
    assert row_of(state.snapshot(), "ball").state == State.BOTH


def test_points_move_with_objects_and_are_colored_by_state():
    state = state_of(3)
    before = state.snapshot()
    ball = points_of(state, before, "ball")
    assert ball.sum() > 5 and set(before.states[ball]) <= {State.NEITHER, State.FIRST}
    assert (before.states[ball] == State.FIRST).any()
    pose = state.object_pose("ball")
    pose[:3] += 0.5, 0.25, 0.125
    state.move_object("ball", pose)
    after = state.snapshot()
    np.testing.assert_allclose(
        (after.points - before.points)[ball], np.tile((0.5, 0.25, 0.125), (ball.sum(), 1)), atol=1e-5
    )
    np.testing.assert_array_equal(after.points[~ball], before.points[~ball])
    colors = np.array([STATE_COLORS[State(s)] for s in after.states])
    np.testing.assert_array_equal(after.point_colors, colors)


def test_point_states_match_point_visibility():
    state = state_of(2)
    snapshot, experiment = state.snapshot(), EXPERIMENTS[1]
    robot, _ = experiment.agents()
    points = state.cloud.positions(snapshot.object_poses)
    seen = wv.point_visibility(experiment.build(), robot.camera, robot.pose, points, exclude=robot.body).numpy()[0]
    expected = (seen == wv.Visibility.VISIBLE) & ~points_of(state, snapshot, "robot")
    differ = expected != (snapshot.states & State.FIRST).astype(bool)
    assert differ.mean() < 1e-3  # points on edges: vertices of movable objects are rounded elsewhere


def test_agents_do_not_see_their_own_body():
    state = state_of(1)
    snapshot = state.snapshot()
    assert not (snapshot.states[points_of(state, snapshot, "robot")] & State.FIRST).any()
    assert not (snapshot.states[points_of(state, snapshot, "person")] & State.SECOND).any()
    assert row_of(snapshot, "robot").cells[0] == "own body" and row_of(snapshot, "person").cells[1] == "own body"


def test_body_stays_on_ground_and_follows_the_yaw():
    state = state_of(1)
    body = state.object_pose("robot")
    # Sideways, a quarter revolution to the left, and 0.4 m higher: the body stays on the ground.
    state.move_agent("robot", wv.look_at((-1.0, 0.5, 1.1), (-1.0, 3.0, 0.2)))
    moved = state.object_pose("robot")
    eyes = EXPERIMENTS[0].agents()[0].poses[0]
    offset = body[:2] - eyes[:2]
    np.testing.assert_allclose(moved[:2], np.array([-1.0, 0.5]) + (-offset[1], offset[0]), atol=1e-6)
    assert moved[2] == body[2]
    np.testing.assert_allclose(moved[3:], [0, 0, math.sqrt(0.5), math.sqrt(0.5)], atol=1e-6)
    state.raise_agent("robot", 0.9)
    assert state.height("robot") == pytest.approx(0.9) and state.object_pose("robot")[2] == body[2]


def test_narrower_view_excludes_objects():
    state = state_of(3)
    assert row_of(state.snapshot(), "ball").fractions[0] > 0.9
    camera = state.agents["robot"].camera
    narrow = with_view(camera, hfov=math.radians(10), far=9.0)
    assert narrow.hfov == pytest.approx(math.radians(10)) and narrow.far == 9.0
    assert narrow.fy / narrow.fx == pytest.approx(camera.fy / camera.fx)
    state.set_camera("robot", narrow)
    assert row_of(state.snapshot(), "ball").cells[0] == "out of view"
    state.reset()
    assert row_of(state.snapshot(), "ball").fractions[0] > 0.9


def test_pictures_match_the_renderer():
    state, experiment = state_of(3), EXPERIMENTS[2]
    robot, _ = experiment.agents()
    state.picture_kind = "depth"
    pictures = state.snapshot().pictures
    depth = wv.render(experiment.build(), robot.camera, robot.pose, exclude=robot.body).depth.numpy()[0]
    expected = depth_colors(depth, (robot.camera.near, robot.camera.far)).astype(int)
    assert (np.abs(pictures[0].astype(int) - expected).max(axis=-1) > 12).mean() < 2e-3
    assert pictures[1].shape[1] == 320 and pictures[1].std() > 10  # 200 degrees wide
    state.picture_kind = "objects"
    by_object = state.snapshot().pictures[0]
    assert {tuple(color) for color in by_object.reshape(-1, 3)} >= {STATE_COLORS[State.FIRST], STATE_COLORS[State.BOTH]}


def test_depth_cloud_has_the_colors_of_labels():
    state = state_of(3)
    state.cloud_kind = "labels"
    snapshot = state.snapshot()
    robot, _ = EXPERIMENTS[2].agents()
    views = wv.render(EXPERIMENTS[2].build(), robot.camera, robot.pose, exclude=robot.body)
    measured = np.isfinite(views.depth.numpy()[0])
    assert abs(len(snapshot.points) - measured.sum()) < 20 and not len(snapshot.states)
    found = {tuple(color) for color in np.unique(snapshot.point_colors, axis=0)}
    assert found == {tuple(label_colors()[label]) for label in np.unique(views.labels.numpy()[0][measured])}
    state.cloud_kind = "none"
    assert len(state.snapshot().points) == 0


def test_given_scene_is_not_modified():
    experiment = EXPERIMENTS[0]
    scene = experiment.build()
    before = scene["ball"].vertices.copy()
    state = ViewerState(scene, experiment.agents(), points=1000)
    state.move_object("ball", (1, 1, 1, 0, 0, 0, 1))
    state.snapshot()
    np.testing.assert_array_equal(scene["ball"].vertices, before)
    assert scene.movable == ()


def test_one_agent_without_body():
    scene = wv.Scene(up="y")
    scene.add(trimesh.creation.box((4, 0.02, 4)), name="floor", label="ground")
    scene.add(trimesh.creation.box((0.3, 0.3, 0.3)), name="box", label="object", pose=(0, 0.15, 0, 0, 0, 0, 1))
    robot = wv.Agent.kinect("robot", wv.look_at((0, 1, 2), (0, 0.1, 0), up="y"))
    state = ViewerState(scene, [robot], points=1000)
    snapshot = state.snapshot()
    assert [row.name for row in snapshot.rows] == ["box"] and snapshot.rows[0].state == State.FIRST
    assert set(snapshot.states) == {State.NEITHER, State.FIRST}
    assert state.stage.handles == ("box",)


def test_instances_keep_sharing_their_mesh():
    scene = wv.Scene()
    poses = [(x, 0, 0, 0, 0, 0, 1) for x in range(60)]
    scene.add_instances(trimesh.creation.box((0.3, 0.3, 0.3)), poses, names="box", movable=False)
    scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", label="object", pose=(2, 1, 0, 0, 0, 0, 1))
    state = ViewerState(scene, [wv.Agent.kinect("robot", wv.look_at((2, 3, 1), (2, 0, 0)))], points=1000)
    assert len({id(state.scene.objects[k].shared_mesh) for k in range(60)}) == 1
    assert state.table_objects == ["ball"]  # 61 objects are too many for a table
    assert state.snapshot().rows[0].state == State.FIRST


@pytest.mark.parametrize("vertical", [1, 2])
def test_handles_are_level(vertical):
    up = np.eye(3)[vertical]
    for ahead in ([1.0, 0, 0], [0.3, 0.5, -0.7], -2 * up, up):
        pose = wv.look_at((1, 2, 3), np.array([1, 2, 3]) + ahead, up=np.array([1.0, 0.1, 0.2]))
        frame = level_frame(poses_to_matrices(pose[None])[0], vertical)
        np.testing.assert_allclose(frame[:3, :3].T @ frame[:3, :3], np.eye(3), atol=1e-9)
        assert np.linalg.det(frame[:3, :3]) == pytest.approx(1)
        np.testing.assert_allclose(frame[:3, 2], up, atol=1e-9)
        assert frame[:3, 0] @ np.asarray(ahead) >= -1e-9


def test_invalid_input_raises():
    experiment = EXPERIMENTS[0]
    scene, (robot, human) = experiment.build(), experiment.agents()
    many = wv.Agent.kinect("robot", np.tile(robot.pose, (2, 1)))
    cases = [
        (lambda: ViewerState(scene, []), "agents must be one or more of warpvis.Agent, got none"),
        (lambda: ViewerState(scene, [robot, 3]), "agents must be one or more of warpvis.Agent, got int"),
        (lambda: ViewerState(scene, [many]), "'robot' must have one pose to begin with, got 2"),
        (lambda: ViewerState(scene, [robot, robot]), "agents must have different names, got 'robot' more than once"),
        (lambda: ViewerState(scene, [robot], movable=["cup*"]), "'cup\\*' in movable matches no object"),
        (lambda: ViewerState(scene, [robot], objects=["cup"]), "no object 'cup'"),
        (
            lambda: ViewerState(scene, [robot]).move_object("low obstacle", (0,) * 6 + (1,)),
            "is not movable. Add it to movable",
        ),
        (lambda: ViewerState(scene, [robot]).move_agent("cat", robot.pose), "there is no agent 'cat'"),
        (lambda: ViewerState(scene, [robot]).move_agent("robot", (0, 0, 0)), "pose of 'robot'"),
        (lambda: ViewerState(scene, [human]).set_camera("human", None), "camera of 'human' must be"),
        (lambda: ViewerState(wv.Scene(), [robot]), "objects"),
    ]
    for call, words in cases:
        with pytest.raises(wv.WarpvisError, match=words):
            call()


def test_line_of_sight_stops_at_the_occluder():
    snapshot = state_of(3).snapshot()
    line = next(line for line in snapshot.lines if line.object == "person")
    assert (line.agent, line.occluder) == ("robot", "high obstacle")
    # The near face of the high obstacle, which is 0.2 m thick around x = -0.1.
    assert line.stop[0] == pytest.approx(-0.2, abs=1e-4)
    np.testing.assert_allclose(np.cross(line.stop - line.eye, line.target - line.eye), 0, atol=1e-5)
    box = EXPERIMENTS[2].build()["person"].bounds
    np.testing.assert_allclose(line.target, box.mean(axis=0), atol=1e-5)
    assert not [line for line in snapshot.lines if line.object == "ball"]  # visible or out of view


def test_proposed_pose_reveals_the_object():
    state = state_of(2)
    snapshot = state.snapshot()
    found = propose(state, snapshot, max_distance=2.0, radius=0.2)
    assert found.fractions["ball"] > 0.5 and "ball" in describe_proposal(found)
    state.move_agent("robot", found.pose)
    after = state.snapshot()
    assert row_of(after, "ball").fractions[0] == pytest.approx(found.fractions["ball"], abs=0.02)
    assert propose(state, after, max_distance=2.0, radius=0.2) == "robot sees every object that human sees."
    nowhere = propose(state_of(2), snapshot, max_distance=0.05, radius=0.2)
    assert nowhere == "No free place within 0.05 m shows robot any of these objects."
    assert propose(state_of(4), state_of(4).snapshot(), max_distance=2.0, radius=0.2) == "human sees no object."


def test_map_shows_labels_of_the_robots_image():
    state = state_of(1)
    picture = map_picture(state, state.snapshot().views[0])
    assert picture.shape == (320, 320, 3)
    colors = {tuple(color) for color in np.unique(picture.reshape(-1, 3), axis=0)}
    assert {tuple(label_colors()[label]) for label in (wv.Label.GROUND, wv.Label.OBJECT)} <= colors


def test_noise_applies_to_the_depth_image():
    state = state_of(3)
    exact = state.snapshot().views[0].depth
    state.set_sensor(kinect_noise(1.0))
    noisy = state.snapshot().views[0].depth
    both = np.isfinite(exact) & np.isfinite(noisy)
    assert np.isfinite(exact).sum() > both.sum() > 0.5 * exact.size * 0.5
    assert 0.0005 < np.abs(exact[both] - noisy[both]).mean() < 0.05
    assert kinect_noise(0) is None
    state.set_sensor(None)
    np.testing.assert_array_equal(state.snapshot().views[0].depth, exact)


ARM = """<mujoco><worldbody>
<geom name="floor" type="plane" size="2 2 .1"/>
<body name="table" pos="0 0 .2"><geom type="box" size=".5 .5 .2"/></body>
<body name="arm" pos="-.4 0 .4"><joint name="turn" type="hinge" axis="0 0 1" range="-90 90" limited="true"/>
  <geom type="box" size=".15 .02 .02" pos=".15 0 .1"/><geom type="box" size=".02 .02 .05" pos="0 0 .05"/></body>
<body name="pot" pos=".2 0 .5"><freejoint/><geom type="box" size=".1 .1 .1"/>
  <body name="lid" pos="0 0 .12"><joint name="lift" type="slide" axis="0 0 1"/>
    <geom type="box" size=".1 .1 .01"/></body></body>
<camera name="head" pos="-2 0 1" xyaxes="0 -1 0 .3 0 1"/>
</worldbody></mujoco>"""


def arm():
    stage = MujocoStage(mujoco.MjModel.from_xml_string(ARM))
    return stage, ViewerState(stage, [stage.agent("robot", "head")], points=2000)


def test_model_bodies_are_labeled_objects():
    stage, state = arm()
    found = {item.name: wv.Label(item.label) for item in state.scene.objects}
    label = wv.Label
    assert found == {
        "floor": label.GROUND,
        "table": label.OBSTACLE,
        "arm": label.ROBOT,
        "pot": label.OBJECT,
        "lid": label.OBJECT,
    }
    assert state.stage.handles == ("pot",) and [joint.name for joint in stage.joints] == ["turn", "lift"]
    assert (stage.joints[0].low, stage.joints[0].high) == pytest.approx((-math.pi / 2, math.pi / 2))
    assert state.scene["arm"].triangle_count == 24  # both boxes
    said = MujocoStage(stage.model, labels={"arm": "obstacle"})
    assert said.stage.scene["arm"].label == label.OBSTACLE


def test_joints_move_their_descendants():
    stage, state = arm()
    data = mujoco.MjData(stage.model)
    state.set_joint("turn", 0.7)
    state.set_joint("lift", 0.2)
    # A free object carries its child bodies.
    pot = state.object_pose("pot")
    pot[:3] += 0.1, 0.2, 0
    state.move_object("pot", pot)
    data.qpos[:] = stage.data.qpos
    np.testing.assert_allclose(data.qpos[[0, 1, 2, 3, 8]], [0.7, 0.3, 0.2, 0.5, 0.2], atol=1e-6)
    mujoco.mj_forward(stage.model, data)
    snapshot = state.snapshot()
    for body in ("arm", "pot", "lid"):
        vertices, _ = state.stage.mesh(body)
        frame = poses_to_matrices(snapshot.object_poses[state.stage.column(body)][None])[0]
        moved = vertices @ frame[:3, :3].T + frame[:3, 3]
        expected = _corners(stage.model, data, body)
        np.testing.assert_allclose((moved.min(axis=0), moved.max(axis=0)), expected, atol=1e-5)
    state.reset()
    assert stage.value("turn") == 0 and stage.value("lift") == 0


def _corners(model, data, body):
    """Return the bounds of a body's boxes as placed by MuJoCo."""
    found = []
    for geom in np.flatnonzero(model.geom_bodyid == model.body(body).id):
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        found.append(data.geom_xpos[geom] + (signs * model.geom_size[geom]) @ data.geom_xmat[geom].reshape(3, 3).T)
    corners = np.concatenate(found)
    return corners.min(axis=0), corners.max(axis=0)


def test_invalid_input_for_a_model_raises():
    stage, state = arm()
    plain = state_of(1)
    cases = [
        (lambda: state.set_joint("knee", 0.0), "no hinge or slide joint 'knee'"),
        (lambda: state.set_joint("turn", math.nan), "value of 'turn' must be a number"),
        (lambda: plain.set_joint("turn", 0.0), "the scene must be a MuJoCo model to have joints"),
        (lambda: state.move_object("arm", (0,) * 6 + (1,)), "'arm' has no free joint"),
        (lambda: stage.agent("robot", "tail"), "no camera 'tail'; it has head"),
        (
            lambda: ViewerState(stage, [stage.agent("robot", "head")], movable=["arm"]),
            "movable must be None for a MuJoCo model",
        ),
    ]
    for call, words in cases:
        with pytest.raises(wv.WarpvisError, match=words):
            call()
