# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the four experiments as Webots worlds: their files, and their controller with stand-ins for Webots."""

import importlib.util
import re
import runpy
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from webots_fields import descend, faults
from webots_library import Simulation, ctypes_library

import warpvis as wv
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.scenes import EXPERIMENTS
from warpvis.visibility import State
from warpvis.webots import load_webots, render_range
from warpvis.webots._grammar import parse_text

ROOT = Path(__file__).parent.parent
PROJECT = ROOT / "examples" / "webots"
NAMES = ["floor", "low obstacle", "high obstacle", "ball", "person", "robot"]
AXES = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])  # forward, left and up in the axes of an OpenCV camera
WORDS = {State.BOTH: "both see", State.FIRST: "the robot sees", State.SECOND: "the person sees"}
WORDS[State.NEITHER] = "neither sees"


@pytest.fixture(scope="module", params=EXPERIMENTS, ids=lambda item: item.name)
def experiment(request):
    return request.param


@pytest.fixture(scope="module")
def world(experiment):
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # no warnings
        return load_webots(PROJECT / "worlds" / f"{experiment.name}.wbt", strict=True)


def parse(path):
    return parse_text(path.read_text(encoding="utf-8"), str(path))


def placed(world, name):
    """Return the pose in the world of the node with a DEF name."""
    return {node.name: chain for node, chain in chains(parse(world.path).nodes, np.eye(4)) if node.name}[name]


def chains(nodes, above):
    for node in nodes:
        matrix = np.eye(4)
        turn = node.vector("rotation", (0.0, 0.0, 1.0, 0.0))
        axis, angle = turn[:3] / np.linalg.norm(turn[:3]), turn[3]
        cross = np.cross(np.eye(3), axis)  # matrix of v -> axis x v
        matrix[:3, :3] = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        matrix[:3, 3] = node.vector("translation", (0.0, 0.0, 0.0))
        yield node, above @ matrix
        if "children" in node.fields:
            yield from chains(node.nodes("children"), above @ matrix)


def test_files_equal_the_script_output(experiment):
    place = ROOT / "scripts" / "write_webots_worlds.py"
    spec = importlib.util.spec_from_file_location("write_webots_worlds", place)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    for name, write in ((f"{experiment.name}.wbt", script.world_of), (f".{experiment.name}.wbproj", script.project_of)):
        written = (PROJECT / "worlds" / name).read_text(encoding="utf-8")
        assert written == write(experiment), "run python scripts/write_webots_worlds.py"


def test_no_other_files_exist():
    names = {path.name for path in (PROJECT / "worlds").iterdir()}
    assert names == {f"{item.name}.wbt" for item in EXPERIMENTS} | {f".{item.name}.wbproj" for item in EXPERIMENTS}


def test_displays_do_not_overlap(world):
    """The world's project names every display once, each at a distinct position, and shows it."""
    text = (world.path.parent / f".{world.path.stem}.wbproj").read_text(encoding="utf-8")
    found = re.findall(r"^renderingDevicePerspectives: robot:(.+);1;1;([\d.]+);([\d.]+)$", text, re.MULTILINE)
    nodes = [node for node in descend(parse(world.path).nodes) if node.type in ("RangeFinder", "Display")]
    assert sorted(name for name, *_ in found) == sorted(node.text("name", "range-finder") for node in nodes)
    assert len({(x, y) for _, x, y in found}) == len(nodes) == 4
    for node in nodes:  # in a 3D view of 1000 x 700 pixels
        x, y = next(
            (1000 * float(x), 700 * float(y)) for name, x, y in found if name == node.text("name", "range-finder")
        )
        assert x + node.integer("width", 64) <= 1000 and y + node.integer("height", 64) <= 700


def test_nodes_and_fields_are_valid_in_webots(world):
    parsed = parse(world.path)
    assert str(parsed.version) == "R2023b" and not parsed.externprotos
    assert [fault for node in parsed.nodes for fault in faults(node)] == []
    assert [node.type for node in parsed.nodes[:4]] == ["WorldInfo", "Viewpoint", "Background", "DirectionalLight"]
    for node in descend(parsed.nodes):  # Webots warns of axes that are not of length 1
        for field in {"rotation", "orientation"} & set(node.fields):
            assert np.linalg.norm(node.numbers(field)[:3]) == pytest.approx(1, abs=1e-8)
    text = world.path.read_text()
    defined = re.findall(r"DEF (\w+)", text)
    assert len(defined) == len(set(defined)) and set(re.findall(r"USE (\w+)", text)) <= set(defined)
    assert max(map(len, text.splitlines())) < 200


def test_check_of_fields_finds_faults(tmp_path):
    faulty = "Solid { scale 1 1 1 name 3 children [ Box { size 1 2 } Sphere { subdivision 1.5 } Wall { } ] }"
    (tmp_path / "a.wbt").write_text(f"#VRML_SIM R2023b utf8\n{faulty}\n")
    found = [fault for node in parse(tmp_path / "a.wbt").nodes for fault in faults(node)]
    words = (
        "field scale",
        "name is no",
        "size has 2",
        "Box in children",
        "no whole",
        "Sphere in",
        "no node",
        "Wall in",
    )
    for part in words:
        assert any(part in fault for fault in found), part


def test_controller_is_at_the_expected_path(world):
    """A project has folders worlds/ and controllers/NAME/NAME.py."""
    (robot,) = (node for node in parse(world.path).nodes if node.type == "Robot")
    name = robot.text("controller", "")
    assert (world.path.parent.parent / "controllers" / name / f"{name}.py").is_file()
    assert robot.flag("supervisor", False)


def test_viewpoint_shows_all_objects(world, experiment):
    (node,) = (node for node in parse(world.path).nodes if node.type == "Viewpoint")
    fields = {"translation": node.fields["position"], "rotation": node.fields["orientation"]}
    node.fields = fields
    ((_, matrix),) = chains([node], np.eye(4))
    camera = wv.Camera.from_fov(320, 240, hfov=0.785398)
    seen = wv.render(world.scene, camera, poses_to_opencv(matrix, "ros_body"), outputs="segmentation").segmentation
    assert set(np.unique(seen.numpy()[0])) == {-1, *range(6)}


def test_range_finder_equals_the_preset_camera(world, experiment):
    device, camera = world.devices["range-finder"], experiment.camera
    assert (device.camera.width, device.camera.height) == (camera.width, camera.height)
    np.testing.assert_allclose(
        [device.camera.fx, device.camera.fy, device.camera.near, device.camera.far],
        [camera.fx, camera.fy, camera.near, camera.far],
        rtol=1e-7,
    )
    wanted = poses_to_matrices(experiment.pose_rows(1)[0])
    np.testing.assert_allclose(poses_to_matrices(device.pose), wanted, atol=1e-8)


def test_images_equal_the_preset(world, experiment):
    """Depth to 1e-5 m, and equal labels and objects, for robot and person."""
    scene, preset = world.scene, experiment.build()
    assert [item.name for item in scene] == [item.name for item in preset] == NAMES
    assert [item.label for item in scene] == [item.label for item in preset]
    device = world.devices["range-finder"]
    eyes = poses_to_opencv(placed(world, "EYES"), "ros_body")[0]
    np.testing.assert_allclose(poses_to_matrices(eyes), poses_to_matrices(np.array(experiment.human_pose)), atol=1e-8)
    ours = wv.Agent("robot", device.camera, device.pose, body="robot"), wv.Agent.human("person", eyes, body="person")
    finite = 0
    for mine, theirs in zip(ours, experiment.agents(), strict=True):
        for face, other in zip(mine.faces, theirs.faces, strict=True):
            made = wv.render(scene, face.camera, mine.face_poses(face), exclude=mine.body)
            wanted = wv.render(preset, other.camera, theirs.face_poses(other), exclude=theirs.body)
            np.testing.assert_array_equal(made.segmentation.numpy(), wanted.segmentation.numpy())
            np.testing.assert_array_equal(made.labels.numpy(), wanted.labels.numpy())
            np.testing.assert_allclose(made.depth.numpy(), wanted.depth.numpy(), atol=1e-5)
            finite += np.isfinite(made.depth.numpy()).sum()
    assert finite > 50_000
    counts = [wv.perspective(item, ours).visible_pixels for item in (scene, preset)]
    np.testing.assert_array_equal(*counts)
    np.testing.assert_array_equal(
        render_range(world, "range-finder"), wv.render(scene, device.camera, device.pose).depth.numpy()[0]
    )


def simulated(world, steps):
    """Return a simulation of a world: its range finder's image, nodes and displays."""
    device = world.devices["range-finder"]
    matrix = poses_to_matrices(device.pose)
    image = render_range(world, "range-finder", webots_version="header")
    simulation = Simulation(device, image, matrix[:3, 3], matrix[:3, :3] @ AXES, steps=steps)
    parsed = parse(world.path).nodes
    simulation.nodes = {node.name: chain for node, chain in chains(parsed, np.eye(4)) if node.name}
    simulation.displays = {
        node.text("name", "display"): (node.integer("width", 64), node.integer("height", 64))
        for node in descend(parsed)
        if node.type == "Display"
    }
    simulation.world_path = str(world.path)
    return simulation


def run(simulation, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "controller", ctypes_library(simulation))
    runpy.run_path(str(PROJECT / "controllers" / "visibility" / "visibility.py"), run_name="__main__")
    return capsys.readouterr().out.splitlines()


@pytest.mark.smoke("experiment_2")
def test_controller_output_matches_warpvis(world, experiment, monkeypatch, capsys):
    simulation = simulated(world, steps=3)
    (line,) = run(simulation, monkeypatch, capsys)  # nothing changes after the first of two images
    for name, state in experiment.states.items():
        assert f"; {WORDS[state]} the {name}" in line
    shown = line.split(";")[0]
    assert ("the ball" in shown, "the person" in shown) == experiment.visible
    device = world.devices["range-finder"]
    depth = render_range(world, "range-finder")
    labels = wv.classify(depth, device.camera, device.pose, spheres=experiment.spheres)
    palette = np.array([wv.maps.MAP_LEGEND[label][1] for label in wv.Label])
    assert set(simulation.shown) == set(simulation.displays) == {"labels", "floor map", "person's view"}
    for name, (width, height) in simulation.displays.items():
        assert len(simulation.shown[name]) == 2
        for image, place, blend in simulation.shown[name]:
            assert image.shape == (height, width, 3) and place == (0, 0) and not blend
    picture = simulation.shown["labels"][0][0]
    assert (picture == palette[labels.numpy()[0]]).all(axis=2).mean() > 0.9999
    floor = wv.floor_map(wv.back_project(depth, device.camera, device.pose), labels, bounds=((-2, -2), (2, 2)))
    picture = simulation.shown["floor map"][0][0]
    assert (picture == floor.rgb()[0, ::-1]).all(axis=2).mean() > 0.999
    look = wv.Camera.from_fov(200, 200, hfov=np.radians(60))
    view = wv.render(experiment.build(), look, experiment.human_pose, outputs="labels", exclude="person")
    picture = simulation.shown["person's view"][0][0]
    assert (picture == palette[view.labels.numpy()[0]]).all(axis=2).mean() > 0.9999


def test_controller_follows_moved_objects(monkeypatch, capsys):
    """The ball and an obstacle of the first experiment move to their poses in the second."""
    first, second = (load_webots(PROJECT / "worlds" / f"experiment_{k}.wbt") for k in (1, 2))
    simulation, goal = simulated(first, steps=4), simulated(second, steps=1)

    def move():
        if simulation.steps == 1:
            simulation.nodes.update({name: goal.nodes[name] for name in goal.nodes})
            simulation.image[:] = goal.image

    simulation.on_step = move
    lines = run(simulation, monkeypatch, capsys)
    assert len(lines) == 2
    assert "both see the ball" in lines[0] and lines[0].startswith("depth image: the ball and the person;")
    assert "the person sees the ball" in lines[1] and lines[1].startswith("depth image: the person;")
    assert not (simulation.shown["person's view"][0][0] == simulation.shown["person's view"][-1][0]).all()
