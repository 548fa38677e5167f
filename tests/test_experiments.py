# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's four experiments have the published results."""

import dataclasses

import numpy as np
import pytest
import trimesh
import warp as wp
from PIL import Image

import warpvis as wv
from warpvis import scenes
from warpvis.cli.demo import format_states, run_experiment
from warpvis.scenes import experiments
from warpvis.visibility import State

# Experiment: whether ball and person are visible, and whether the floor plan shows them as visible.
TABLE = {
    1: {"ball": (True, True), "person": (True, True)},
    2: {"ball": (False, False), "person": (True, True)},
    3: {"ball": (True, False), "person": (False, False)},
    4: {"ball": (False, False), "person": (True, False)},
}

# Visibility of the ball: the robot is the first agent, the person the second.
STATES = {1: State.BOTH, 2: State.SECOND, 3: State.FIRST, 4: State.NEITHER}


@pytest.fixture(scope="module", params=sorted(TABLE))
def result(request):
    return run_experiment(request.param)


def number_of(result):
    return int(result.experiment.name[-1])


def test_results_match_the_papers_table(result):
    for sighting in result.sightings:
        assert (sighting.visible, sighting.visible_on_plan) == TABLE[sighting.experiment][sighting.object]
        assert (sighting.pixels_by_sphere > 0) == sighting.visible


@pytest.mark.parametrize("level", [1.0, 4.0])
def test_noisy_kinect_gives_the_same_answers(result, level):
    """Uses the depth image alone: pixels inside the spheres and above the ground."""
    kinect = wv.sensors.kinect_v1(320, 240)
    sensor = dataclasses.replace(kinect, sigma=level * kinect.sigma, subpixel=round(8 / level))
    experiment, poses = result.experiment, result.experiment.poses()
    outputs = ("depth", "true_depth", "reasons")
    renderer = wv.Renderer(result.scene, experiment.camera, sensor=sensor, outputs=outputs)
    for frame in range(5):
        views = renderer.render(poses, frame=frame)
        sphere = wp.empty(views.depth.shape, dtype=wp.int32, device="cpu")
        wv.classify(views.depth, experiment.camera, poses, spheres=experiment.spheres, spheres_out=sphere)
        found = np.unique(sphere.numpy())
        labels = {experiment.spheres[index].label for index in found if index >= 0}
        assert (wv.Label.OBJECT in labels, wv.Label.HUMAN in labels) == experiment.visible
        depth, true_depth = views.depth.numpy(), views.true_depth.numpy()
        seen = np.isfinite(depth)
        assert np.std(depth[seen] - true_depth[seen]) > 2e-3 * level
        assert (views.reasons.numpy() == wv.sensors.Reason.SHADOW).sum() > 100


def test_presets_contain_the_table():
    for number, experiment in enumerate(scenes.EXPERIMENTS, start=1):
        rows = TABLE[number]["ball"], TABLE[number]["person"]
        assert tuple(zip(experiment.visible, experiment.plan_visible, strict=True)) == rows


def test_visible_objects_have_many_pixels(result):
    """Hidden objects have no pixel; visible ones have hundreds."""
    for sighting in result.sightings:
        assert sighting.pixels == 0 or sighting.pixels > 300


def test_visibility_states_of_ball_and_obstacles(result):
    assert result.experiment.states["ball"] == STATES[number_of(result)]
    states = result.seen.states("robot", "human")[0]
    for name, state in result.experiment.states.items():
        assert State(states[result.scene.index(name)]) == state, name


def test_rendered_images_confirm_the_states(result):
    """Counts pixels of images rendered here, for all of the person's faces and the robot's camera."""
    counts = []
    for agent in result.experiment.agents():
        images = [
            wv.render(result.scene, face.camera, agent.face_poses(face), outputs="segmentation", exclude=agent.body)
            for face in agent.faces
        ]
        objects = np.concatenate([image.segmentation.numpy().ravel() for image in images])
        counts.append(np.bincount(objects + 1, minlength=len(result.scene) + 1)[1:])
    for name, state in result.experiment.states.items():
        robot, human = (int(count[result.scene.index(name)]) for count in counts)
        assert (robot > 0) == (state in (State.FIRST, State.BOTH)), name
        assert (human > 0) == (state in (State.SECOND, State.BOTH)), name
        assert min(robot or 1000, human or 1000) > 100  # clearly visible or not at all
    ball = result.scene.index("ball")
    assert counts[0][ball] == result.sightings[0].pixels
    assert counts[1][ball] == result.shared.human_pixels


def test_demo_states_match(result):
    shared = result.shared
    words = {State.BOTH: "both", State.FIRST: "robot only", State.SECOND: "human only", State.NEITHER: "neither"}
    assert shared.state == words[STATES[shared.experiment]]
    assert (shared.robot, shared.human) == ("both" in shared.state or "robot" in shared.state, shared.human_pixels > 0)
    assert shared.robot == result.sightings[0].visible
    line = format_states([shared]).splitlines()[1].split(maxsplit=4)
    yes = {True: "yes", False: "no"}
    assert line == [str(shared.experiment), "ball", yes[shared.robot], yes[shared.human], shared.state]


def test_persons_eyes_are_inside_the_head(result):
    eyes = np.array(result.experiment.human_pose[:3])
    low, high = result.scene["person"].bounds
    np.testing.assert_allclose(eyes[:2], (low + high)[:2] / 2, atol=0.02)
    assert eyes[2] == experiments.EYE_HEIGHT
    assert high[2] - 0.24 < eyes[2] < high[2]
    robot, human = result.experiment.agents()
    np.testing.assert_array_equal(robot.poses.astype(np.float32), result.experiment.poses())
    assert (robot.body, human.body) == (("robot",), ("person",))


def test_camera_height_is_between_the_obstacles(result):
    eye = result.experiment.poses()[0, 2]
    tops = [result.scene[name].bounds[1, 2] for name in ("low obstacle", "high obstacle")]
    assert tops[0] < eye < tops[1]
    floor = result.scene["floor"]
    np.testing.assert_allclose(np.ptp(floor.bounds, axis=0)[:2], 4.0)


def test_tops_of_obstacles(result):
    """The low obstacle's top is visible where it is in view; the high one's is never visible."""
    points, objects = result.views.points.numpy()[0], result.views.segmentation.numpy()[0]

    def pixels_on_top(name):
        item = result.scene[name]
        heights = points[objects == result.scene.index(name)][:, 2]
        return int((heights > item.bounds[1, 2] - 1e-4).sum())

    assert pixels_on_top("high obstacle") == 0
    assert pixels_on_top("low obstacle") > 100
    # On the map too, cells inside the low obstacle's outline are obstacle cells.
    cells = result.floor_map.cells.numpy()[0]
    rows, columns = np.nonzero(cells == wv.Label.OBSTACLE)
    left, _, bottom, _ = result.floor_map.bounds
    x, y = left + (columns + 0.5) * result.floor_map.cell_size, bottom + (rows + 0.5) * result.floor_map.cell_size

    def covered(name):
        low, high = result.scene[name].bounds[:, :2]
        return ((x > low[0] + 0.04) & (x < high[0] - 0.04) & (y > low[1] + 0.04) & (y < high[1] - 0.04)).sum()

    assert covered("high obstacle") == 0
    assert covered("low obstacle") > 50


def test_hidden_objects_are_not_on_the_map(result):
    cells = result.floor_map.cells.numpy()[0]
    ball, person = result.sightings
    assert (cells == wv.Label.OBJECT).any() == ball.visible
    assert (cells == wv.Label.HUMAN).any() == person.visible
    assert (cells == wv.Label.ROBOT).any()


def test_objects_do_not_overlap():
    for experiment in scenes.EXPERIMENTS:
        boxes = {item.name: item.bounds for item in experiment.build() if item.name != "floor"}
        for name, (low, high) in boxes.items():
            assert low[2] >= 0
            assert (np.abs([low[:2], high[:2]]) <= experiments.FLOOR_SIZE / 2).all()
            for other, (low_other, high_other) in boxes.items():
                assert name == other or (low > high_other).any() or (high < low_other).any()


def test_wall_occludes_on_the_plan():
    """A scene in which the plan is right: a wall, an object in front of it, one behind it, and one next to it."""
    scene = wv.Scene()
    for name, place in {"before": (1, 0), "behind": (3, 0), "beside": (3, 1.2)}.items():
        scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name=name, pose=(*place, 0.1, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 1, 0.01)), name="wall", pose=(2, 0, 0, 0, 0, 0, 1))
    plan = wv.maps.plan_visibility(scene, wv.Camera.kinect(), wv.look_at((0, 0, 1), (3, 0, 0.5)))
    visible = dict(zip((item.name for item in scene), plan.visible[0].tolist(), strict=True))
    assert visible == {"before": True, "behind": False, "beside": True, "wall": True}
    assert (plan.first <= plan.unoccluded).all()
    without = wv.maps.plan_visibility(
        scene, wv.Camera.kinect(), wv.look_at((0, 0, 1), (3, 0, 0.5)), exclude=("wall", "before")
    )
    assert without.visible[0].tolist() == [False, True, True, False]


def test_plan_uses_the_cameras_range():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="far", pose=(4.7, 0, 0.1, 0, 0, 0, 1))
    pose = wv.look_at((0, 0, 1), (3, 0, 1))
    assert not wv.maps.plan_visibility(scene, wv.Camera.kinect(), pose).visible[0, 0]
    assert wv.maps.plan_visibility(scene, wv.Camera.from_fov(320, 240, hfov=0.99, far=5), pose).visible[0, 0]


def test_colors_of_the_experiments(result):
    """Sides of the obstacles toward the robot, by Lambert's law in double precision, in the light or in a shadow."""
    color, objects = result.views.color.numpy()[0], result.views.segmentation.numpy()[0]
    assert (color[objects < 0] == np.rint(255 * np.array([0.88, 0.90, 0.93]))).all() and (objects < 0).any()
    to_light = -np.array([0.5, 0.45, -1]) / np.linalg.norm([0.5, 0.45, -1])
    experiment = result.experiment
    normals = wv.render(result.scene, experiment.camera, experiment.poses(), outputs="normals").normals.numpy()[0]
    for name, base in (("low obstacle", (0.72, 0.50, 0.28)), ("high obstacle", (0.45, 0.66, 0.66))):
        front = (objects == result.scene.index(name)) & (normals[..., 0] < -0.99)
        lit, dark = (255 * np.array(base) * (0.45 + light) for light in (-0.65 * to_light[0], 0.0))
        error = np.minimum(*(np.abs(color[front] - expected).max(axis=-1) for expected in (lit, dark)))
        assert front.sum() > 1000 and error.max() <= 1, name
    ball = color[objects == result.scene.index("ball")].astype(float)
    assert (ball[:, 0] > 2 * ball[:, 1:].max(axis=1)).all()


def test_overview_shows_color_beside_depth(result, tmp_path):
    views = result.views
    pose, pictures = result.experiment.poses()[0], {}
    for name, shown in (("color", views), ("plain", dataclasses.replace(views, color=None))):
        wv.viz.save_overview(
            result.scene,
            result.experiment.camera,
            pose,
            shown,
            result.floor_map,
            tmp_path / f"{name}.png",
            title=name,
            eye=(-4, -4, 3),
            target=(0, 0, 0),
        )
        pictures[name] = np.asarray(Image.open(tmp_path / f"{name}.png").convert("RGB"))
    assert pictures["color"].shape[1] == pytest.approx(pictures["plain"].shape[1] * 4 / 3, abs=2)
    counts = [(picture == (224, 230, 237)).all(axis=-1).sum() for picture in pictures.values()]
    assert counts[0] > 5000 and counts[1] == 0  # the background of the color image
