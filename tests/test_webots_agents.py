# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of agents of Webots worlds: the robot with its range finder, people, and the commands that use them."""

import json
import math
import warnings
from pathlib import Path

import numpy as np
import pytest

import warpvis as wv
from warpvis.cli._perspective import View
from warpvis.errors import IntrinsicsWarning
from warpvis.scenes import EXPERIMENTS
from warpvis.webots import load_webots, render_range, robot_agent

from support.cli import run_here

WORLDS = Path(__file__).parent.parent / "examples" / "webots" / "worlds"
HEADER = "#VRML_SIM R2023b utf8\n"
EYE = 'name "eye" fieldOfView 1.5 width 80 height 60 minRange 0.1 maxRange 5'
CUP = 'Solid { name "cup" translation %s recognitionColors [1 0 0] children Shape { geometry Box { size .2 .2 .2 } } }'
BOX = "Shape { geometry Box { size %s } }"


def solid(name, place, size, more=""):
    return f'Solid {{ name "{name}" translation {place} children [ {BOX % size} {more} ] }}'


def robot(parts, eye=EYE, name="car"):
    """Return a robot at the origin whose range finder is 1 m above it and looks along x."""
    return f'Robot {{ name "{name}" children [ RangeFinder {{ translation 0 0 1 {eye} }} {parts} ] }}'


def load(tmp_path, *nodes, **options):
    path = tmp_path / "world.wbt"
    path.write_text(HEADER + "\n".join(nodes))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return load_webots(path, **options)


def pose_matrix(agent):
    return wv.core.poses.poses_to_matrices(agent.poses)[0]


# --------------------------------------------------------------------------------------------------------- the robot


def test_robot_has_the_camera_and_the_place_of_the_range_finder(tmp_path):
    car = 'Robot { name "car" translation 1 2 0 rotation 0 0 1 1.5707963267948966 children [ %s ] }'
    world = load(tmp_path, car % f"RangeFinder {{ translation 0.5 0 1 {EYE} }}", CUP % "1 4 1")
    agent = robot_agent(world)
    assert agent.camera == wv.Camera.from_fov(80, 60, hfov=1.5, near=0.1, far=5)
    expected = np.eye(4)
    expected[:3] = np.array([[1, 0, 0, 1], [0, 0, 1, 2.5], [0, -1, 0, 1]])  # right, down and forward, place
    np.testing.assert_allclose(pose_matrix(agent), expected, atol=1e-7)
    assert (agent.name, agent.body, agent.head) == ("robot", (), ())


def test_robot_sees_its_parts_that_webots_draws(tmp_path):
    """A housing around the sensor is invisible, since its back faces are; an arm in front of the sensor is not."""
    parts = (
        solid("housing", "0 0 1", "0.3 0.3 0.3")
        + solid("arm", "1 0 1", "0.2 0.2 0.2")
        + solid("plate", "1 0.3 0.4", "0.5 0.1 0.1")
    )
    world = load(tmp_path, robot(parts), CUP % "3 0 1", CUP % "3 1.5 1")
    agent = robot_agent(world, name="rover")
    assert agent.name == "rover"
    assert agent.body == ("housing", "arm", "plate") and agent.head == ("housing",)
    seen = wv.perspective(world.scene, [agent])
    shown = dict(zip(seen.objects, seen.visible[0, 0].tolist(), strict=True))
    assert shown == {"housing": False, "arm": True, "plate": True, "cup": False, "cup (2)": True}
    assert seen.cell(0, 0, seen.objects.index("cup")) == "hidden by arm"
    views = wv.render(world.scene, agent.camera, agent.poses, exclude=agent.excluded)
    np.testing.assert_array_equal(views.depth.numpy()[0], render_range(world, "eye"))


def test_parts_nearer_than_the_near_plane_are_invisible(tmp_path):
    world = load(tmp_path, robot(solid("glass", "0.06 0 1", "0.02 2 2"), f"{EYE} near 0.08"), CUP % "3 0 1")
    assert robot_agent(world).head == ("glass",)
    world = load(tmp_path, robot(solid("glass", "0.06 0 1", "0.02 2 2"), f"{EYE} near 0.01"), CUP % "3 0 1")
    assert robot_agent(world).head == ()


@pytest.mark.parametrize(
    ("projection", "fov"), [("cylindrical", 2.5), ("cylindrical", 2 * math.pi), ("spherical", 3.0)]
)
def test_wide_range_finders_keep_their_rays_and_ranges(tmp_path, projection, fov):
    eye = f'name "eye" projection "{projection}" fieldOfView {fov} width 64 height 32 minRange 0.5 maxRange 4'
    walls = [
        solid(f"w{k}", place, "0.5 0.5 0.5") for k, place in enumerate(("3 0 1", "0.4 1 1", "-2 0.3 1", "0 -3 1.4"))
    ]
    world = load(tmp_path, robot("", eye), *walls)
    agent = robot_agent(world)
    depth = wv.render(world.scene, agent.camera, agent.poses, cull_backfaces=True).depth.numpy()[0]
    expected = render_range(world, "eye")
    np.testing.assert_array_equal(np.isfinite(depth), np.isfinite(expected))
    assert np.isfinite(depth).sum() > 20
    np.testing.assert_allclose(depth, expected, rtol=1e-6)
    pixels = np.array([[3.5, 4.5], [60.2, 20.0], [32.0, 16.0]])
    np.testing.assert_allclose(agent.camera.project(agent.camera.unproject(pixels)), pixels, atol=1e-9)
    behind = wv.perspective(world.scene, [agent]).status[0, 0, 2] == wv.Visibility.VISIBLE
    assert behind == (fov > 6)


def test_range_finder_is_chosen_by_name(tmp_path):
    other = robot("", EYE.replace("eye", "second"), "truck")
    camera = 'Robot { name "spy" children Camera { name "lens" width 32 height 32 } }'
    world = load(tmp_path, robot(""), other, camera, CUP % "3 0 1")
    assert robot_agent(world, "second").camera == robot_agent(world, "eye").camera
    assert robot_agent(world, "lens").camera.far == math.inf
    several = "device_name must be one of the world's range finders, 'eye' of 'car', 'second' of 'truck', got none"
    with pytest.raises(wv.errors.SceneError, match=several):
        robot_agent(world)
    with pytest.raises(wv.errors.SceneError, match="no device 'third'; it has 'eye', 'second', 'lens'"):
        robot_agent(world, "third")
    with pytest.raises(wv.errors.SceneError, match="without a range finder; its cameras are: 'lens'"):
        robot_agent(load(tmp_path, camera, CUP % "3 0 1"))


def test_lens_is_ignored_with_a_warning(tmp_path):
    world = load(tmp_path, robot("", f"{EYE} lens Lens {{ radialCoefficients [0.1 0] }}"), CUP % "3 0 1")
    with pytest.warns(IntrinsicsWarning, match="'eye' has a Lens"):
        assert robot_agent(world).camera.hfov == pytest.approx(1.5)


# ------------------------------------------------------------------------------------------------------------ people


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda item: item.name)
def test_agents_of_the_example_worlds_are_those_of_the_experiments(experiment):
    """The node EYES defines where the person looks."""
    world = load_webots(WORLDS / f"{experiment.name}.wbt")
    found = robot_agent(world), world.people["person"]
    for agent, expected in zip(found, experiment.agents(), strict=True):
        np.testing.assert_allclose(pose_matrix(agent), pose_matrix(expected), atol=1e-6)
        assert agent.camera == expected.camera and agent.body == expected.body


@pytest.mark.parametrize(("version", "system", "up"), [("R2023b", '"ENU"', 2), ("R2021b", '"NUE"', 1)])
def test_pedestrians_look_ahead_from_the_height_of_their_eyes(tmp_path, version, system, up):
    """The eyes of the stand-in are in its head, 1.27 + 0.45 m above the ground, and it looks along x, once along z."""
    place, axis = ("2 3 1.27", "0 0 1") if up == 2 else ("2 1.27 3", "0 1 0")
    (tmp_path / "world.wbt").write_text(
        f"#VRML_SIM {version} utf8\nWorldInfo {{ coordinateSystem {system} }}\n"
        f"Pedestrian {{ translation {place} rotation {axis} 0.5 }}"
    )
    with pytest.warns(UserWarning, match="stand-ins for Pedestrian"):
        world = load_webots(tmp_path / "world.wbt")
    person = world.people["pedestrian"]
    assert person.body == ("pedestrian",) and person.name == "pedestrian"
    matrix = pose_matrix(person)
    ahead = (math.cos(0.5), math.sin(0.5), 0) if up == 2 else (math.sin(0.5), 0, math.cos(0.5))
    np.testing.assert_allclose(matrix[:3, 2], ahead, atol=1e-6)
    np.testing.assert_allclose(matrix[:3, 1], -np.eye(3)[up], atol=1e-6)
    head = np.array([2, 3, 1.27] if up == 2 else [2, 1.27, 3]) + 0.04 * np.array(ahead) + 0.45 * np.eye(3)[up]
    np.testing.assert_allclose(matrix[:3, 3], head, atol=0.02)


def test_people_are_outermost_solids_of_the_class_human(tmp_path):
    bag = solid("bag", "0.3 0 0", "0.2 0.2 0.2")
    nodes = [
        solid("person", "2 0 0.9", "0.3 0.3 1.8", bag),
        solid("visitor", "4 0 0.8", "0.3 0.3 1.6"),
        f'Solid {{ name "human asleep" translation 0 3 0.2 rotation 0 1 0 1.5708 children {BOX % "0.3 0.3 1.7"} }}',
    ]
    world = load(tmp_path, *nodes)
    assert {name: agent.body for name, agent in world.people.items()} == {"person": ("person", "bag")}
    np.testing.assert_allclose(world.people["person"].poses[0, :3], [2, 0, 0.936 * 1.8], atol=1e-5)
    world = load(tmp_path, *nodes, labels={"visitor": "human", "person": "obstacle"})
    assert list(world.people) == ["bag", "visitor"]


# ------------------------------------------------------------------------------------------------------ command line


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    return lambda *arguments: run_here(monkeypatch, capsys, tmp_path, *arguments)


def test_perspective_of_a_world_needs_no_option(run, tmp_path):
    """The report is that of the experiment from which the world was made, with the world's name of the person."""
    code, out, error = run("perspective", WORLDS / "experiment_2.wbt", "--out", "who")
    assert code == 0 and error == "" and "the person may mean" in out
    report = json.loads((tmp_path / "who" / "perspective.json").read_text())
    assert report["agents"] == ["robot", "person"] and report["to_see"] == ["ball"]
    experiment = EXPERIMENTS[1]
    expected = wv.perspective(experiment.build(), experiment.agents())
    for item in report["objects"]:
        k = expected.objects.index(item["name"])
        for agent, values in enumerate(item["agents"].values()):
            assert values["fraction"] == pytest.approx(float(expected.fraction[agent, 0, k]), abs=0.01)
    assert (tmp_path / "who" / "perspective.png").stat().st_size > 20_000


EYES = ["--human", "0 0 1 1 0 1"]
PERSON, OTHER = solid("person", "2 0 1", "1 1 2"), solid("person", "4 0 1", "1 1 2")


@pytest.mark.parametrize(
    ("nodes", "options", "words"),
    [
        ([robot("")], [], "--human must be given as eye and target, 'x y z tx ty tz'. The world has no person"),
        ([], EYES, "--robot must be given as eye and target, 'x y z tx ty tz'. The world has no range finder"),
        (
            [robot(""), PERSON],
            ["--human", "bob"],
            "--human must be a pose or a person of the world, 'person', got 'bob'",
        ),
        ([robot(""), PERSON, OTHER], ["--human-body", "cup"], "names of people, 'person', 'person (2)', got 'cup'"),
        ([robot(""), robot("", EYE, "truck")], EYES, "--device-name must be one of the world's range finders, "),
        ([robot("")], [*EYES, "--camera", "kinect"], "without --robot, give no --camera"),
        ([robot("")], [*EYES, "--up", "y"], "--up must be z, as in the world"),
        ([robot("")], [*EYES, "--scale", "2"], "it takes no --scale"),
        ([robot("")], [*EYES, "--robot", "0 0 1 1 0 1", "--device-name", "eye"], "it takes no --device-name"),
    ],
)
def test_perspective_of_a_world_rejects_invalid_options(run, tmp_path, nodes, options, words):
    load(tmp_path, CUP % "3 0 1", *nodes)
    code, out, error = run("perspective", "world.wbt", *options)
    assert code == 2 and words in error and error.count("\n") == 1 and out == "", error


def test_all_people_of_a_world_are_agents(run, tmp_path):
    """By default all of them; or those that are named, also under other names, and at poses."""
    near, far = solid("person", "2 1.5 0.9", "0.3 0.3 1.8"), solid("visitor", "4 -1 0.8", "0.3 0.3 1.6")
    load(tmp_path, robot(""), CUP % "3 0 1", near, far)
    labels = ("--labels", "visitor=human")
    code, out, error = run("perspective", "world.wbt", *labels, "--out", "who")
    assert code == 0 and error == "", error
    report = json.loads((tmp_path / "who" / "perspective.json").read_text())
    assert report["agents"] == ["robot", "person", "visitor"]
    people = ("--human", "Bo=visitor", "--human", "person", "--human", "Cy=0 3 1.6 3 0 1", "--human", "5 2 1.5 3 0 1")
    code, out, error = run("perspective", "world.wbt", *labels, *people)
    assert code == 0 and error == "", error
    assert out.splitlines()[0].split()[2:7] == ["robot", "Bo", "person", "Cy", "human"]
    assert "Cy may mean" in out and "the human 4 may mean" in out and "Bo sees no objects" in out


def test_info_lists_people(run, tmp_path):
    load(tmp_path, PERSON)
    code, out, _ = run("info", "world.wbt")
    assert code == 0 and "person  'person': eyes at 2 0 1.872 0.5 -0.5 0.5 -0.5" in out


def test_device_name_of_other_files_is_rejected(run, tmp_path):
    EXPERIMENTS[0].build().export(tmp_path / "room.glb")
    code, _, error = run("view", "room.glb", "--device-name", "eye")
    assert code == 2 and error == "warpvis: room.glb is not a Webots world, so it takes no --device-name\n"


def test_view_of_a_world_has_its_robot_and_person(tmp_path):
    pytest.importorskip("viser")
    load(
        tmp_path, robot(solid("arm", "1 0 1", "0.2 0.2 0.2")), CUP % "3 0 1", solid("person", "4 2 0.9", "0.3 0.3 1.8")
    )
    state = View(file=tmp_path / "world.wbt").load()
    assert list(state.agents) == ["robot", "person"]
    assert state.agents["robot"].camera.far == 5 and state.agents["robot"].head == ()
    cup = next(row for row in state.snapshot().rows if row.name == "cup")
    assert cup.cells[0] == "hidden by arm"
    state.move_agent("robot", wv.look_at((0, 1, 1), (1, 1, 1)))  # its arm moves with it
    cup = next(row for row in state.snapshot().rows if row.name == "cup")
    assert cup.fractions[0] > 0.9
    given = View(file=tmp_path / "world.wbt", robot="-1 0 1 3 0 1", human=("person",)).load()
    assert given.agents["robot"].camera == wv.Camera.kinect() and given.agents["person"].body == ("person",)


def test_view_of_a_world_without_range_finder_sees_all_of_it(tmp_path):
    pytest.importorskip("viser")
    load(tmp_path, CUP % "3 0 1", 'Robot { children Camera { name "lens" } }')
    with pytest.warns(UserWarning, match=r"no range finder; to use one of its cameras, 'lens', give --device-name"):
        state = View(file=tmp_path / "world.wbt").load()
    assert list(state.agents) == ["robot"] and state.snapshot().rows[0].fractions[0] > 0.99
    assert View(file=tmp_path / "world.wbt", device_name="lens").load().agents["robot"].camera.width == 64
