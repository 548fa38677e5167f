# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Perspectives of agents: states, reasons, wide fields of view, attention, bodies, worlds, and candidates."""

import json
import math
import sys

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Label, Visibility, cli
from warpvis.scenes.shapes import ball, floor, person, robot, standing_box
from warpvis.viewer import ViewerState
from warpvis.visibility import (
    Agent,
    Candidate,
    FieldOfView,
    State,
    choose_likeliest,
    object_visibility,
    perspective,
)

DEGREE = math.pi / 180
ROBOT_EYES = wv.look_at((-2, 0, 0.5), (0, 0.2, 0.2))
HUMAN_EYES = wv.look_at((2, 0, 1.5), (0, 0.2, 0))


def low_wall_scene(device="cpu"):
    """Return a scene with agents on both sides of a low wall, balls near each, one past the wall and one in a chest."""
    scene = wv.Scene(device=device)
    scene.add(floor(8, 8), name="floor", label="ground")
    scene.add(standing_box((0.1, 1.6, 0.8), 0, 0), name="wall")
    scene.add(standing_box((0.4, 0.4, 0.4), 0.3, 1.3), name="chest")
    scene.add(ball(0.2, -0.5, 0.2), name="near robot", label="object")
    scene.add(ball(0.2, 0.3, 0.2), name="near human", label="object")
    scene.add(ball(0.2, -0.3, 1.1), name="beside", label="object")
    scene.add(ball(0.2, 0.3, 1.3), name="in the chest", label="object")
    scene.add(robot(0.4, -2, 0), name="robot body", label="robot")
    scene.add(person(1.6, 2, 0), name="human body", label="human")
    return scene


def robot_and_human(**options):
    return [
        Agent.kinect("robot", ROBOT_EYES, body="robot body"),
        Agent.human("human", HUMAN_EYES, body="human body", **options),
    ]


@pytest.fixture(scope="module")
def low_wall():
    return perspective(low_wall_scene(), robot_and_human())


def of(seen, agent, name, field="status", view=0):
    return getattr(seen, field)[seen.agents.index(agent), view, seen.objects.index(name)]


def camera_agent(camera, pose, **options):
    return Agent("camera", camera, pose, **options)


def test_states_cover_the_four_cases(device):
    seen = perspective(low_wall_scene(device), robot_and_human())
    states = dict(zip(seen.objects, seen.states("robot", "human")[0], strict=True))
    assert states["near robot"] == State.FIRST
    assert states["near human"] == State.SECOND
    assert states["beside"] == State.BOTH
    assert states["in the chest"] == State.NEITHER
    assert seen.states("robot", "human").dtype == np.uint8
    assert (seen.states("human", "robot") == [[(0, 2, 1, 3)[state] for state in states.values()]]).all()
    assert seen.fraction.dtype == seen.gaze_angle.dtype == np.float32
    assert seen.visible_pixels.dtype == seen.silhouette_pixels.dtype == seen.occluder.dtype == np.int32
    assert seen.visible.shape == seen.attended.shape == (2, 1, 9)
    assert (seen.visible == (seen.visible_pixels > 0)).all()
    assert of(seen, "robot", "near human", "occluder") == seen.scene_objects.index("wall")
    assert of(seen, "human", "in the chest", "occluder") == seen.scene_objects.index("chest")
    assert of(seen, "robot", "near robot", "fraction") == 1


def test_status_covers_every_reason(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.2, 1, 1)), name="wall", pose=(2, 0, 0, 0, 0, 0, 1))
    spots = {"close": (0.2, 0, 0.07), "far": (7, 2, 1), "hidden": (3, 0, 0), "behind": (-1, 0, 0), "seen": (2, 0.7, 0)}
    for name, place in spots.items():
        scene.add(trimesh.creation.icosphere(radius=0.02), name=name, pose=(*place, 0, 0, 0, 1))
    seen = perspective(scene, [Agent.kinect("robot", wv.look_at((0, 0, 0), (1, 0, 0)))], objects=list(spots))
    assert seen.objects == tuple(spots)
    names = [Visibility(value).name for value in seen.status[0, 0]]
    assert names == ["TOO_NEAR", "TOO_FAR", "OCCLUDED", "OUT_OF_VIEW", "VISIBLE"]
    assert seen.occluder[0, 0].tolist() == [-1, -1, 0, -1, -1]
    cells = [line.split("  ")[-1] for line in seen.table().splitlines()[2:]]
    assert cells == ["too near", "too far", "hidden by wall", "out of view", "1.00"]


def test_min_fraction_and_min_pixels():
    seen = perspective(low_wall_scene(), robot_and_human(), min_fraction=0.9)
    partly = (seen.fraction > 0) & (seen.fraction < 0.9)
    assert partly.any()
    assert not seen.visible[partly].any()
    assert of(seen, "robot", "near robot") == Visibility.VISIBLE
    few = perspective(low_wall_scene(), robot_and_human(), min_pixels=5000)
    assert of(few, "robot", "near robot") == Visibility.TOO_FAR  # fully visible, but with too few pixels
    assert of(few, "robot", "floor") == Visibility.VISIBLE


@pytest.mark.parametrize("camera", [wv.Camera.kinect(), wv.Camera.from_fov(100, 140, hfov=1.6)])
def test_camera_agent_matches_object_visibility(camera, device):
    scene = low_wall_scene(device)
    poses = np.stack([ROBOT_EYES, HUMAN_EYES, wv.look_at((0, -3, 2), (0, 0, 0))])
    agent = camera_agent(camera, poses, body=("robot body",))
    options = {"min_pixels": 20, "delta": 0.01}
    seen = perspective(scene, [agent], **options)
    expected = object_visibility(scene, camera, poses, exclude=["robot body"], **options)
    for name in ("fraction", "status", "visible_pixels", "silhouette_pixels", "occluder"):
        assert (getattr(seen, name)[0] == getattr(expected, name).numpy()).all(), name


def test_faces_of_field_of_view_count_pixels_once():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((4, 6, 3)), name="room")
    human = Agent.human("human", wv.look_at((1, 1, 0.2), (0, 0, 0)))
    seen = perspective(scene, human)
    camera = human.faces[0].camera
    assert seen.visible_pixels.item() == 3 * camera.width * camera.height
    assert seen.silhouette_pixels.item() == 5 * camera.width * 3 * camera.height


def test_object_across_face_border_is_counted_once():
    field = FieldOfView(140 * DEGREE, 0.2, 0.2, resolution=800)
    camera = wv.Camera.from_fov(4400, 320, hfov=140 * DEGREE)
    assert len(field.faces()) == 2
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    for occluded in (False, True):
        scene = wv.Scene()
        scene.add(trimesh.creation.icosphere(subdivisions=3, radius=0.15), name="ball", pose=(2, 0, 0, 0, 0, 0, 1))
        if occluded:
            scene.add(trimesh.creation.box((0.1, 0.15, 0.5)), name="box", pose=(1, -0.06, 0, 0, 0, 0, 1))
        wide, one = (perspective(scene, camera_agent(lens, pose), objects=["ball"]) for lens in (field, camera))
        if occluded:
            assert 0.2 < one.fraction.item() < 0.8
            assert wide.fraction.item() == pytest.approx(one.fraction.item(), rel=0.03)
            assert wide.occluder.item() == 1
        else:
            assert wide.fraction.item() == one.fraction.item() == 1
    faces = [
        object_visibility(scene, face.camera, camera_agent(field, pose).face_poses(face), canvas=face.canvas)
        for face in field.faces()
    ]
    assert all((face.image_pixels.numpy()[0, 0] > 0) for face in faces)  # both faces contribute
    assert wide.visible_pixels.item() == sum(face.visible_pixels.numpy()[0, 0] for face in faces)


def around(degrees, radius=3.0, height=0.0):
    """Return a pose on a circle, `degrees` to the right of the x axis."""
    return (radius * math.cos(degrees * DEGREE), -radius * math.sin(degrees * DEGREE), height, 0, 0, 0, 1)


@pytest.mark.parametrize("side", [1, -1])
def test_human_field_of_view_and_attention(side, device):
    scene, angles = wv.Scene(device=device), (0, 25, 35, 95, 110, 180)
    for degrees in angles:
        scene.add(trimesh.creation.icosphere(radius=0.1), name=str(degrees), pose=around(side * degrees))
    scene.add(trimesh.creation.icosphere(radius=0.1), name="up", pose=(0.5, 0, 1.2, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.1), name="down", pose=(0.5, 0, -1.2, 0, 0, 0, 1))
    seen = perspective(scene, Agent.human("human", wv.look_at((0, 0, 0), (1, 0, 0))))
    assert seen.visible[0, 0].tolist() == [True, True, True, True, False, False, False, True]
    assert seen.attended[0, 0].tolist() == [True, True, False, False, False, False, False, False]
    assert np.degrees(seen.gaze_angle[0, 0, :6]) == pytest.approx(angles, abs=1e-3)
    assert (seen.fraction[0, 0, :4] == 1).all()
    assert of(seen, "human", "110") == Visibility.OUT_OF_VIEW


def test_attention_defaults_to_visibility(low_wall):
    assert (low_wall.attended[0] == low_wall.visible[0]).all()
    assert (low_wall.attended <= low_wall.visible).all()


def test_body_is_visible_only_to_other_agents(device):
    scene = low_wall_scene(device)
    with_bodies = perspective(scene, robot_and_human())
    assert of(with_bodies, "human", "robot body") == Visibility.VISIBLE
    assert of(with_bodies, "robot", "human body") == Visibility.VISIBLE
    for agent, body in (("robot", "robot body"), ("human", "human body")):
        assert of(with_bodies, agent, body) == Visibility.OUT_OF_VIEW
        assert of(with_bodies, agent, body, "silhouette_pixels") == 0
        assert with_bodies.body[with_bodies.agents.index(agent), with_bodies.objects.index(body)]
    assert with_bodies.body.sum() == 2
    # The person's eyes are inside the head.
    blind = perspective(scene, Agent.human("human", HUMAN_EYES))
    assert not of(blind, "human", "near human", "visible")
    assert of(blind, "human", "near human", "occluder") == blind.scene_objects.index("human body")


def test_batched_views_match_single_calls():
    scene = low_wall_scene()
    path = np.stack([wv.look_at((-2 + 0.8 * k, -1.2, 0.5), (0, 0.2, 0.2)) for k in range(4)])
    still, moving = robot_and_human()[1], Agent.kinect("robot", path, body="robot body")
    together = perspective(scene, [moving, still])
    assert together.status.shape == (2, 4, 9)
    for view, pose in enumerate(path):
        alone = perspective(scene, [Agent.kinect("robot", pose, body="robot body"), still])
        for name in ("fraction", "status", "visible_pixels", "silhouette_pixels", "occluder", "attended", "gaze_angle"):
            assert np.array_equal(getattr(together, name)[:, view], getattr(alone, name)[:, 0]), name
        assert together.report(view) == {**alone.report(), "view": view}
    assert len({tuple(states) for states in together.states("robot", "human").tolist()}) > 1


def moving_scene(device="cpu"):
    scene = wv.Scene(device=device)
    scene.add(standing_box((0.1, 1.0, 0.8), 0, 0), name="wall")
    scene.add(ball(0.2, 0, 0), name="ball", label="object", pose=(-0.5, 0, 0, 0, 0, 0, 1), movable=True)
    scene.add(ball(0.2, -0.5, 0.4), name="rider", label="object", attach_to="ball")
    return scene


def test_worlds_select_object_poses(device):
    scene = moving_scene(device)
    agents = [
        Agent.kinect("robot", wv.look_at((-2, 0, 0.3), (0, 0, 0.3))),
        Agent.human("human", wv.look_at((2, 0, 0.3), (0, 0, 0.3))),
    ]
    turned = (0, 0, math.sin(math.pi / 4), math.cos(math.pi / 4))
    places = np.array([[[-0.5, 0, 0, 0, 0, 0, 1]], [[0.5, 0, 0, *turned]]], dtype=np.float32)
    seen = perspective(scene, agents, object_poses=places, objects=["ball", "rider"])
    assert seen.states("robot", "human").tolist() == [[State.FIRST] * 2, [State.SECOND] * 2]
    middles = np.array([[(-0.5, 0, 0.1), (-0.5, 0.4, 0.1)], [(0.5, 0, 0.1), (0.1, 0, 0.1)]])
    expected = np.stack([agent.angles_to(middles) for agent in agents])
    assert seen.gaze_angle == pytest.approx(expected, abs=1e-5)
    named = perspective(scene, agents, object_poses=places, world_index=[1, 0, 1], objects=["ball", "rider"])
    assert (named.status == seen.status[:, [1, 0, 1]]).all()
    assert (named.gaze_angle == seen.gaze_angle[:, [1, 0, 1]]).all()
    moved = Agent.kinect("robot", np.tile(agents[1].poses, (3, 1)))
    assert perspective(scene, moved, object_poses=places, world_index=[1, 0, 1]).visible[0, :, 1].tolist() == [1, 0, 1]
    default = perspective(scene, agents, objects=["ball", "rider"])
    assert (default.status[:, 0] == seen.status[:, 0]).all()
    assert (default.gaze_angle[:, 0] == seen.gaze_angle[:, 0]).all()


def test_candidates_list_visible_objects(low_wall):
    found = low_wall.candidates("human", "robot")
    assert {item.object for item in found} == {"near human", "beside"}
    states = {item.object: (item.state, item.robot_fraction > 0) for item in found}
    assert states == {"near human": (State.SECOND, False), "beside": (State.BOTH, True)}
    assert sum(item.probability for item in found) == pytest.approx(1, abs=1e-12)
    for item in found:
        assert item.fraction == of(low_wall, "human", item.object, "fraction")
        assert item.gaze_angle <= of(low_wall, "human", item.object, "gaze_angle")
    assert low_wall.to_see("robot", "human") == ["near human"]
    assert low_wall.to_see("human", "robot") == ["near robot"]
    assert all(item.state is None and item.robot_fraction is None for item in low_wall.candidates("human"))
    everything = {item.object for item in low_wall.candidates("human", labels=None)}
    assert everything == {"floor", "wall", "chest", "near human", "beside", "robot body"}
    bodies = low_wall.candidates("human", "robot", labels=[Label.ROBOT, "ground"])
    assert {item.object for item in bodies} == {"robot body", "floor"}
    assert "robot body" not in low_wall.to_see("robot", "human", labels=None)


def test_candidates_are_sorted_by_probability():
    scene = wv.Scene()
    for name, degrees in (("aside", 60), ("left", -10), ("right", 10), ("ahead", 0), ("edge", 28), ("half", 20)):
        scene.add(trimesh.creation.icosphere(radius=0.1), name=name, label="object", pose=around(degrees))
    # A box between the eyes and one ball hides its lower half.
    scene.add(trimesh.creation.box((0.1, 0.3, 0.2)), name="box", pose=around(20, 2, -0.1))
    seen = perspective(scene, Agent.human("human", wv.look_at((0, 0, 0), (1, 0, 0))))
    found = seen.candidates("human")
    assert [item.object for item in found if item.object not in ("left", "right")] == ["ahead", "half", "edge", "aside"]
    assert [item.attended for item in found] == [True] * 5 + [False]
    chances = [item.probability for item in found]
    assert chances == sorted(chances, reverse=True)
    assert sum(chances) == pytest.approx(1, abs=1e-12)
    assert found[0].gaze_angle == 0


def test_report_is_json_serializable(low_wall):
    report = json.loads(json.dumps(low_wall.report(), allow_nan=False))
    assert report == low_wall.report()
    assert report["agents"] == ["robot", "human"]
    entries = {entry["name"]: entry for entry in report["objects"]}
    assert list(entries) == list(low_wall.objects)
    hidden = entries["near human"]
    assert hidden["label"] == "OBJECT"
    assert hidden["states"] == [{"first": "robot", "second": "human", "state": "SECOND"}]
    said = hidden["agents"]["robot"]
    assert (said["visible"], said["status"], said["occluder"]) == (False, "OCCLUDED", "wall")
    assert entries["robot body"]["agents"]["robot"]["own_body"]


def test_table_lists_fractions_and_reasons():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((0.1, 4, 4)), name="wall", pose=(0, 0, 0, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", label="object", pose=(-1, 0, 0, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.1), name="me", label="robot", pose=(-2, 0, 0, 0, 0, 0, 1))
    robot = Agent.kinect("robot", wv.look_at((-2, 0, 0), (0, 0, 0)), body=("me",))
    human = Agent.human("human", wv.look_at((3, 0, 0), (0, 0, 0)))
    seen = perspective(scene, [robot, human], objects=["ball", "me"])
    assert seen.table().splitlines() == [
        "object  label   robot     human           robot / human",
        "------  ------  --------  --------------  -------------",
        "ball    object  1.00      hidden by wall  robot only",
        "me      robot   own body  hidden by wall  neither",
    ]
    assert perspective(scene, robot, objects="ball").table().splitlines()[2] == "ball    object  1.00"


def test_thread_count_does_not_change_results():
    one, two = (perspective(low_wall_scene(), robot_and_human(), threads=threads) for threads in (1, 2))
    assert one.report() == two.report()
    assert (one.occluder == two.occluder).all()


FOUR = np.tile(ROBOT_EYES, (4, 1))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scene": 3}, "scene must be a warpvis.Scene, got int"),
        ({"scene": wv.Scene()}, "the scene has no objects; add() one first"),
        ({"agents": []}, "agents must be one or more of warpvis.Agent, got none"),
        ({"agents": [wv.Camera.kinect()]}, "agents must be one or more of warpvis.Agent, got Camera"),
        ({"agents": 3}, "agents must be one or more of warpvis.Agent, got int"),
        (
            {"agents": [Agent.kinect("me", ROBOT_EYES), Agent.human("me", HUMAN_EYES)]},
            "agents must have different names, got 'me' more than once",
        ),
        ({"agents": Agent.kinect("me", ROBOT_EYES, body="shell")}, "the scene has no object 'shell'; it has 'wall', "),
        ({"objects": ["cup"]}, "the scene has no object 'cup'; it has 'wall', 'ball', 'rider'"),
        ({"objects": []}, "objects must be one or more"),
        ({"min_fraction": 1.5}, "min_fraction must be from 0 to 1, got 1.5"),
        ({"min_pixels": 0}, "min_pixels must be a whole number from 1 up, got 0"),
        ({"delta": -1}, "delta must be a number of meters from 0 up, got -1"),
        (
            {"agents": [Agent.kinect("a", FOUR), Agent.kinect("b", FOUR[:3])]},
            "agents and worlds must have one situation or the same number: 'a' has 4 poses, 'b' has 3 poses",
        ),
        (
            {"agents": Agent.kinect("a", FOUR), "object_poses": np.tile([0, 0, 0, 0, 0, 0, 1], (3, 1, 1))},
            "agents and worlds must have one situation or the same number: 'a' has 4 poses, object_poses has 3 worlds",
        ),
        (
            {"agents": Agent.kinect("a", FOUR), "world_index": [0, 0]},
            "agents and worlds must have one situation or the same number: 'a' has 4 poses, world_index has 2 worlds",
        ),
        ({"world_index": [0, 1]}, "world_index must be from 0 to 0, the worlds of object_poses, got 1 for view 1"),
        ({"object_poses": np.zeros((1, 2, 7))}, "object_poses must have shape (W, 1, 7)"),
    ],
)
def test_invalid_arguments_are_rejected(change, said):
    given = {"scene": moving_scene(), "agents": Agent.kinect("me", ROBOT_EYES), **change}
    with pytest.raises(wv.WarpvisError) as error:
        perspective(given.pop("scene"), given.pop("agents"), **given)
    assert str(error.value).startswith(said)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda seen: seen.states("robot", "cat"), "there is no agent 'cat'; there are 'robot', 'human'"),
        (lambda seen: seen.candidates("cat"), "there is no agent 'cat'; there are 'robot', 'human'"),
        (lambda seen: seen.report(1), "view must be a whole number from 0 to 0, got 1"),
        (lambda seen: seen.table(-1), "view must be a whole number from 0 to 0, got -1"),
        (lambda seen: seen.candidates("human", view=0.5), "view must be a whole number from 0 to 0, got 0.5"),
        (lambda seen: seen.candidates("human", labels=["cup"]), "label must be one of "),
    ],
)
def test_invalid_queries_are_rejected(low_wall, call, said):
    with pytest.raises(wv.WarpvisError) as error:
        call(low_wall)
    assert str(error.value).startswith(said)


# Boards seen by a camera at the origin: name, size and center [m].
SLIVERS = {
    "hidden": ((0.01, 2, 2), (4, 2, 0)),  # except for a few pixels next to two walls
    "wall": ((0.01, 1.0, 1.2), (2, 1.02, 0)),
    "low wall": ((0.01, 0.2, 1.1), (2, 0.5, -0.1)),
    "shown": ((0.01, 2, 2), (4, -2, 0)),  # except for a few pixels behind a post
    "post": ((0.01, 0.02, 0.02), (2, -1, 0)),
}


def slivers():
    scene = wv.Scene()
    for name, (size, center) in SLIVERS.items():
        scene.add(trimesh.creation.box(size), name=name, pose=(*center, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(320, 240, hfov=1.8)
    return scene, camera, wv.look_at((0, 0, 0), (1, 0, 0))


def test_extreme_fractions_are_not_rounded_to_zero_or_one(tmp_path, monkeypatch, capsys):
    scene, camera, pose = slivers()
    agent, objects = camera_agent(camera, pose), ["hidden", "shown"]
    seen = perspective(scene, [agent], objects=objects)
    few, most = seen.fraction[0, 0]
    assert 0 < few < 0.005 and 0.995 < most < 1
    pixels = int(seen.visible_pixels[0, 0, 0])
    lines = seen.table().splitlines()
    assert lines[2].endswith(f"  <0.01 ({pixels} px)") and lines[3].endswith("  >0.99")
    rows = ViewerState(scene, [agent], objects=objects).snapshot().rows
    assert [row.cells[0] for row in rows] == [
        f"<1 % ({pixels} px)",
        ">99 %",
    ]

    file = trimesh.Scene()
    for name, (size, center) in SLIVERS.items():
        place = trimesh.transformations.translation_matrix(center)
        file.add_geometry(trimesh.creation.box(size), node_name=name, geom_name=name, transform=place)
    file.export(tmp_path / "boards.glb")
    np.save(tmp_path / "poses.npy", np.asarray(pose).reshape(1, -1))
    camera_file = {"width": 320, "height": 240, "hfov": 1.8}
    (tmp_path / "camera.json").write_text(json.dumps(camera_file))
    given = [
        "--file-up",
        "z",
        "--objects",
        "hidden,shown",
        "--poses",
        str(tmp_path / "poses.npy"),
        "--camera",
        str(tmp_path / "camera.json"),
    ]
    monkeypatch.setattr(sys, "argv", ["warpvis", "check", str(tmp_path / "boards.glb"), *given])
    cli.main()
    printed = capsys.readouterr().out
    assert "<0.01" in printed and ">0.99" in printed and "0.00" not in printed and "1.00" not in printed


@pytest.mark.parametrize(
    ("fraction", "text", "percent"),
    [
        (0.0, "0.00", "0 %"), (1e-9, "<0.01", "<1 %"), (0.004, "<0.01", "<1 %"), (0.006, "0.01", "1 %"),
        (0.25, "0.25", "25 %"), (0.994, "0.99", "99 %"), (0.996, ">0.99", ">99 %"), (1.0, "1.00", "100 %"),
    ],
)  # fmt: skip
def test_fraction_format_reserves_zero_and_one_for_exact_values(fraction, text, percent):
    from warpvis.core.checks import format_fraction, format_percent

    assert format_fraction(fraction) == text
    if fraction != 0.006:
        assert format_percent(fraction) == percent
    assert format_percent(0.00004, digits=2) == "<0.01 %" and format_percent(0.9999, digits=1) == ">99.9 %"


def test_likeliest_candidates_of_several_people():
    def candidate(name, probability):
        return Candidate(name, probability, 0.5, 0.1, None, 0.01, True, State.SECOND, 0.0)

    ada = [candidate("cup", 0.7), candidate("vase", 0.2), candidate("box", 0.1)]
    bo = [candidate("vase", 0.6), candidate("cup", 0.3), candidate("bowl", 0.1)]
    found = choose_likeliest(item for person in (ada, bo) for item in person)
    assert [id(item) for item in found] == [id(item) for item in (ada[0], bo[0], ada[2], bo[2])]
    assert choose_likeliest([]) == []
