# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Perspective pictures: colors, contents of panels, and layout of texts."""

import itertools
import math

import numpy as np
import pytest
import trimesh
from PIL import Image

import warpvis as wv
from warpvis import scenes
from warpvis.visibility import Agent, FieldOfView, State, perspective
from warpvis.viz import STATE_COLORS, save_perspective, save_point_sightings, save_sightings
from warpvis.viz._drawing import PanelData, agent_view, views_of_faces
from warpvis.viz._overview import OBJECT_COLORS, STATUS_COLORS
from warpvis.viz._perspective import _floor_map, draw_perspective

DEFAULTS = {"view": 0, "title": "A title", "labels": ["object"], "eye": None, "target": None, "proposed": None}
DEFAULTS["object_poses"] = None

# Simulation of color blindness in linear RGB (Machado, Oliveira and Fernandes 2009, severity 1).
COLOR_BLIND = {
    "nobody": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def lab(color, sight):
    """Return CIE L*a*b* of an sRGB color (0 to 255) as seen with a type of color vision."""
    srgb = np.array(color) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(COLOR_BLIND[sight]) @ linear, 0, 1)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = (to_xyz @ seen) / [0.9505, 1.0, 1.089]
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("sight", COLOR_BLIND)
@pytest.mark.parametrize("colors", [STATE_COLORS, STATUS_COLORS])
def test_colors_are_distinct_under_color_blindness(colors, sight):
    """Colors differ from each other and from the grays of pictures; a difference of 2.3 is just noticeable."""
    shades = [lab(color, sight) for color in colors.values()]
    assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(shades, 2)) > 25
    grays = [lab([round(255 * gray)] * 3, sight) for gray in (0.45, 0.7, 0.88)]
    assert min(np.linalg.norm(a - b) for a in shades for b in grays) > 20


@pytest.fixture(scope="module", params=scenes.EXPERIMENTS, ids=lambda experiment: experiment.name)
def case(request):
    scene, agents = request.param.build(), request.param.agents()
    return request.param, scene, agents, perspective(scene, agents)


@pytest.fixture(scope="module")
def drawn(case, tmp_path_factory):
    """Return the figure of a case, and the path that it is saved to."""
    experiment, scene, agents, seen = case
    proposed = wv.look_at((-0.9, -0.9, 0.7), (0.5, 0.6, 0.1))
    title = f"{experiment.title}. The person looks {experiment.gaze}"
    figure = draw_perspective(scene, agents, seen, **{**DEFAULTS, "title": title, "proposed": proposed})
    path = tmp_path_factory.mktemp(experiment.name) / "perspective.png"
    figure.savefig(path)
    return figure, path


def count_pixels(path, color):
    """Return the number of pixels of a color, lit or shaded."""
    pixels = np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3).astype(np.int16)
    pixels = pixels[np.ptp(pixels, axis=1) > 20]
    shade = pixels.sum(axis=1) / sum(color)
    near = np.abs(pixels - shade[:, None] * color).max(axis=1) < 8
    return int((near & (shade > 0.4) & (shade < 1.1)).sum())


def texts_of(figure):
    """Return every drawn text of a figure with its box in pixels."""
    texts = [figure._suptitle]
    for axes in figure.axes:
        texts += [axes.title, *axes.texts, *(axes.get_legend().get_texts() if axes.get_legend() else [])]
        if axes.axison:
            for axis in (axes.xaxis, axes.yaxis):
                low, high = sorted(axis.get_view_interval())
                ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
                texts += [axis.label, *(tick.label1 for tick in ticks)]
    return [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text()]


def assert_tidy(figure):
    """Check that all texts are inside the figure and do not overlap."""
    texts = texts_of(figure)
    assert len(texts) > 40
    for name, box in texts:
        assert box.x0 >= 0 and box.y0 >= 0, name
        assert box.x1 <= figure.bbox.width and box.y1 <= figure.bbox.height, name
    for (a, box_a), (b, box_b) in itertools.combinations(texts, 2):
        assert not box_a.overlaps(box_b), f"{a!r} and {b!r}"


@pytest.mark.slow
def test_texts_do_not_overlap_or_leave_the_figure(drawn):
    assert_tidy(drawn[0])


@pytest.mark.slow
def test_long_names_and_titles_fit(tmp_path):
    scene = wv.Scene()
    scene.add(trimesh.creation.box((4, 4, 0.02)), name="floor", label="ground", pose=(0, 0, -0.01, 0, 0, 0, 1))
    for i in range(12):
        place = (0.3 * i - 1.5, 0.5, 0.1, 0, 0, 0, 1)
        scene.add(trimesh.creation.box((0.1, 0.1, 0.2)), name=f"a thing with a long name {i}", label=3, pose=place)
    robot = Agent.kinect("robot of the laboratory", wv.look_at((-1.8, -1.5, 0.7), (0, 0.5, 0.1)))
    agents = (robot, Agent.human("visitor of the robot", wv.look_at((1.5, 1.5, 1.6), (0, 0.5, 0.1))))
    seen = perspective(scene, agents)
    figure = draw_perspective(scene, agents, seen, **{**DEFAULTS, "title": "A long title, longer than " * 6})
    figure.savefig(tmp_path / "long.png")
    assert_tidy(figure)
    texts = [text for text, _ in texts_of(figure)]
    assert "both see: 11 objects" in texts and "only the visitor of the robot sees: ..." in texts


@pytest.mark.smoke("experiment_2", "experiment_3")
def test_legend_names_the_state(case, drawn):
    experiment = case[0]
    texts = [text for text, _ in texts_of(drawn[0])]
    words = {
        State.BOTH: "both see",
        State.FIRST: "only the robot sees",
        State.SECOND: "only the human sees",
        State.NEITHER: "neither sees",
    }
    for state, word in words.items():
        assert f"{word}: {'ball' if state == experiment.states['ball'] else 'nothing'}" in texts
    assert "What the robot sees (57 degrees wide)" in texts
    assert "What the human sees (200 degrees wide)" in texts


@pytest.mark.smoke("experiment_3")
def test_picture_is_small_and_shows_the_state_color(case, drawn):
    """The picture is small enough for a README, and the ball has only the color of its state."""
    experiment, path = case[0], drawn[1]
    assert path.stat().st_size < 400_000
    counts = {state: count_pixels(path, color) for state, color in STATE_COLORS.items()}
    swatch = min(counts.values())
    assert swatch > 100
    for state, count in counts.items():
        assert (count > swatch + 100) == (state == experiment.states["ball"]), counts


def test_maps_show_objects_visible_to_each_agent(case):
    experiment, scene, agents, seen = case
    state = experiment.states["ball"]
    shown = PanelData.from_perspective(scene, agents, seen, 0, ["object"], None)
    sees = {agents[0]: state in (State.FIRST, State.BOTH), agents[1]: state in (State.SECOND, State.BOTH)}
    for agent, its in sees.items():
        floor_map = _floor_map(shown, agent)
        rgb = floor_map.colors
        ball = np.abs(rgb * 255 - STATE_COLORS[state]).max(axis=2) < 0.5
        assert ball.any() == its
        gray = (rgb == rgb[..., :1]).all(axis=2)
        assert (gray | ball).all()
        rows, columns = np.nonzero(ball)
        left, _, bottom, _ = floor_map.bounds
        places = np.stack(
            [left + (columns + 0.5) * floor_map.cell_size, bottom + (rows + 0.5) * floor_map.cell_size], axis=1
        )
        assert (np.abs(places - scene["ball"].bounds[:, :2].mean(axis=0)) < 0.1 + floor_map.cell_size).all()


def test_maps_have_no_gap_between_faces():
    """Neighboring faces are mapped separately; the floor between their adjacent columns is visible too."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((6, 6, 0.02)), name="floor", label="ground", pose=(0, 0, -0.01, 0, 0, 0, 1))
    human = Agent.human("human", wv.look_at((0, 0, 1.6), (2, 0, 1.0)), resolution=60)
    robot = Agent.kinect("robot", wv.look_at((2, 0, 0.7), (0, 0, 0)))
    shown = PanelData.from_perspective(scene, (robot, human), perspective(scene, (robot, human)), 0, None, None)
    floor_map = _floor_map(shown, human)
    radii, angles = np.meshgrid(np.linspace(0.8, 2.5, 60), np.radians(np.linspace(-60, 60, 400)))
    columns = ((radii * np.cos(angles) - floor_map.bounds[0]) / floor_map.cell_size).astype(int)
    rows = ((radii * np.sin(angles) - floor_map.bounds[2]) / floor_map.cell_size).astype(int)
    assert (floor_map.colors[rows, columns] > 0.5).all()


def test_map_faces_match_agent_faces():
    """Faces get one additional column where they meet; the other columns are equal."""
    experiment = scenes.EXPERIMENTS[0]
    scene, human = experiment.build(), experiment.agents()[1]
    for k, (face, views) in enumerate(zip(human.faces, views_of_faces(scene, human), strict=True)):
        alone = wv.render(scene, face.camera, human.face_poses(face), outputs="segmentation", exclude=human.body)
        left, right = int(k > 0), int(k < 2)
        image = views.segmentation.numpy()[0]
        assert image.shape[1] == face.camera.width + left + right
        np.testing.assert_array_equal(image[:, left : image.shape[1] - right], alone.segmentation.numpy()[0])


def balls_around(angles, distance=2.0):
    """Return small balls on a circle at eye height, at angles to the right of +x [rad]."""
    scene = wv.Scene()
    for i, angle in enumerate(angles):
        place = (distance * math.cos(angle), -distance * math.sin(angle), 1.0, 0, 0, 0, 1)
        scene.add(trimesh.creation.icosphere(3, radius=0.1), name=f"ball {i}", label="object", pose=place)
    return scene


@pytest.mark.parametrize("hfov", [200, 300, 360])
def test_wide_field_of_view_is_drawn_by_angle(hfov):
    angles = np.radians([-170, -120, -95, -33, 0, 10, 66, 95, 120, 170])
    scene = balls_around(angles)
    field = FieldOfView(math.radians(hfov), math.radians(50), math.radians(60))
    seen = agent_view(scene, Agent("all round", field, wv.look_at((0, 0, 1), (1, 0, 1))))
    left, right, bottom, top = seen.extent
    assert (left, right, bottom, top) == pytest.approx((-hfov / 2, hfov / 2, -60, 50))
    height, width = seen.objects.shape
    for i, angle in enumerate(np.degrees(angles)):
        rows, columns = np.nonzero(seen.objects == i)
        if abs(angle) > hfov / 2 + 3:
            assert len(rows) == 0
            continue
        assert len(rows) > 100
        assert left + (columns + 0.5).mean() / width * (right - left) == pytest.approx(angle, abs=0.2)
        assert top - (rows + 0.5).mean() / height * (top - bottom) == pytest.approx(0, abs=0.2)
        assert seen.distance[rows, columns].min() == pytest.approx(1.9, abs=0.01)
    assert (np.isfinite(seen.distance) == (seen.objects >= 0)).all()
    assert len(seen.attention) == 0


def test_attention_border_is_drawn_at_its_angles():
    scene = balls_around([0.0])
    human = Agent.human("human", wv.look_at((0, 0, 1), (1, 0, 1)))
    border = agent_view(scene, human).attention
    assert np.abs(border[:, 0]).max() == pytest.approx(30, abs=1e-6)
    assert np.abs(border[:, 1]).max() == pytest.approx(30, abs=0.1)
    camera = wv.Camera.kinect()
    narrow = wv.Camera.from_fov(10, 10, hfov=0.2)
    border = agent_view(scene, Agent("robot", camera, human.pose, attention=narrow)).attention
    half = camera.fx * math.tan(0.1)
    np.testing.assert_allclose(border.min(axis=0), [160 - half, 120 - half])
    np.testing.assert_allclose(border.max(axis=0), [160 + half, 120 + half])


def test_camera_view_matches_rendered_image():
    experiment = scenes.EXPERIMENTS[2]
    scene, robot = experiment.build(), experiment.agents()[0]
    seen = agent_view(scene, robot)
    views = wv.render(scene, experiment.camera, experiment.poses(), exclude=["robot"])
    np.testing.assert_array_equal(seen.distance, views.depth.numpy()[0])
    np.testing.assert_array_equal(seen.objects, views.segmentation.numpy()[0])
    assert seen.extent == (0, 320, 240, 0)


@pytest.mark.slow
def test_pictures_of_views_with_movable_objects():
    """The picture of the second view shows the ball at its pose in that view."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((4, 4, 0.02)), name="floor", label="ground", pose=(0, 0, -0.01, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 1, 1)), name="wall", pose=(0, 0, 0.5, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(3, radius=0.1), name="ball", label="object", movable=True)
    worlds = np.array([[[-0.8, 0, 0.1, 0, 0, 0, 1]], [[0.8, 0, 0.1, 0, 0, 0, 1]]])
    robot = Agent.kinect("robot", wv.look_at((-1.8, 0, 0.7), (0, 0, 0.3)))
    human = Agent.human("human", np.tile(wv.look_at((1.8, 0, 1.2), (0, 0, 0.3)), (2, 1)))
    seen = perspective(scene, (robot, human), object_poses=worlds)
    assert seen.states("robot", "human")[:, 2].tolist() == [State.FIRST, State.SECOND]
    for view, state in enumerate((State.FIRST, State.SECOND)):
        shown = PanelData.from_perspective(scene, (robot, human), seen, view, ["object"], worlds[view])
        assert shown.states == {2: state}
        for agent, its in zip((robot, human), (view == 0, view == 1), strict=True):
            rgb = _floor_map(shown, agent).colors
            assert (np.abs(rgb * 255 - STATE_COLORS[state]).max(axis=2) < 0.5).any() == its
        ball = agent_view(scene, (robot, human)[view], view, object_poses=worlds[view]).objects == 2
        assert ball.sum() > 100
    draw_perspective(scene, (robot, human), seen, **{**DEFAULTS, "view": 1, "object_poses": worlds[1]})


def test_y_up_map_matches_z_up():
    """A scene rotated to y-up has the same map, with axes z and x."""
    experiment = scenes.EXPERIMENTS[1]
    scene, agents = experiment.build(), experiment.agents()
    turned = wv.Scene(up="y")
    for item in scene:
        turned.add((item.vertices[:, [1, 2, 0]], item.faces), name=item.name, label=item.label)
    matrix = np.eye(4)[[1, 2, 0, 3]]
    matrices = [matrix @ wv.core.poses.poses_to_matrices(agent.poses) for agent in agents]
    others = tuple(
        Agent(a.name, a.camera, m, body=a.body, attention=a.attention) for a, m in zip(agents, matrices, strict=True)
    )
    seen, other = perspective(scene, agents), perspective(turned, others)
    for agent, its_other in zip(agents, others, strict=True):
        floor_map = _floor_map(PanelData.from_perspective(scene, agents, seen, 0, ["object"], None), agent)
        other_map = _floor_map(PanelData.from_perspective(turned, others, other, 0, ["object"], None), its_other)
        assert other_map.axes == ("z", "x")
        np.testing.assert_allclose(other_map.bounds, floor_map.bounds, atol=1e-6)
        assert (np.abs(floor_map.colors - other_map.colors).max(axis=2) < 1e-6).mean() > 0.998
    names = [text.get_text() for text in draw_perspective(turned, others, other, **DEFAULTS).axes[0].texts]
    assert {"robot", "human"} <= set(names)


def test_labels_none_selects_all_but_ground(case):
    _, scene, agents, seen = case
    shown = PanelData.from_perspective(scene, agents, seen, 0, None, None)
    assert [scene.objects[index].name for index in shown.states] == ["low obstacle", "high obstacle", "ball"]
    assert {scene.objects[index].name for index in shown.bodies} == {"robot", "person"}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"agents": 1}, "agents must be two or more different agents of seen, got 'robot'"),
        ({"agents": "cat"}, "agents must be two or more different agents of seen, got 'robot', 'cat'"),
        ({"view": 1}, "view must be an index from 0 into 1 situation, got 1"),
        ({"labels": ["cup"]}, "label must be one of "),
        ({"eye": (0, 0)}, "eye must be three finite numbers"),
        ({"path": "picture.xyz"}, "picture.xyz: Format 'xyz' is not supported"),
    ],
)
def test_invalid_arguments_are_rejected(tmp_path, monkeypatch, change, said):
    monkeypatch.chdir(tmp_path)
    experiment = scenes.EXPERIMENTS[0]
    scene, (robot, human) = experiment.build(), experiment.agents()
    seen = perspective(scene, (robot, human))
    agents = {None: (robot, human), 1: (robot,), "cat": (robot, Agent.human("cat", human.pose))}[
        change.pop("agents", None)
    ]
    with pytest.raises(wv.WarpvisError) as error:
        save_perspective(scene, agents, seen, change.pop("path", "picture.png"), **change)
    assert str(error.value).startswith(said)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_sightings_color_visible_parts(tmp_path):
    """Visible parts of the ball have its color; if it is occluded, only the legend and a tint have."""
    counts = {}
    for number in (1, 2, 3):
        experiment = scenes.EXPERIMENTS[number - 1]
        path = tmp_path / f"{number}.png"
        save_sightings(experiment.build(), experiment.camera, experiment.poses(), path, objects=["ball"])
        counts[number] = count_pixels(path, OBJECT_COLORS[0])
        assert path.stat().st_size < 400_000
    swatch = counts[2]
    assert counts[1] > swatch + 1000 and counts[3] > swatch + 500
    assert (counts[1] - swatch) / (counts[3] - swatch) == pytest.approx(599 / 330, rel=0.1)


@pytest.mark.slow
def test_sightings_of_all_objects_have_distinct_colors(tmp_path):
    experiment = scenes.EXPERIMENTS[0]
    path = tmp_path / "all.png"
    save_sightings(experiment.build(), experiment.camera, experiment.poses(), path)
    found = [count_pixels(path, color) > 200 for color in OBJECT_COLORS[:6]]
    assert sum(found) >= 4


def test_long_names_in_legend_are_shortened_in_the_middle(tmp_path, monkeypatch):
    scene, figures = wv.Scene(), []
    for k in range(17):
        box = trimesh.creation.box((0.1, 0.1, 0.1), transform=trimesh.transformations.translation_matrix([k / 4, 3, 0]))
        scene.add(box, name=f"a rather long name of a box of the warehouse {k:02d}")
    monkeypatch.setattr("warpvis.viz._overview.save_figure", lambda figure, path: figures.append(figure))
    eye = wv.look_at((2, -2, 0), (2, 3, 0))
    save_sightings(scene, wv.Camera.from_fov(320, 240, hfov=1.2, far=20), eye, tmp_path / "boxes.png")
    (figure,) = figures
    said = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(set(said)) == 15 and all(text.startswith("a rather...house ") for text in said), said
    assert all(text.endswith(": seen 1.00") for text in said), said
    assert figure.axes[0].get_xlabel() == "x [px]\n17 objects, of which 15 are named"


@pytest.mark.slow
def test_points_are_colored_by_status(tmp_path):
    experiment = scenes.EXPERIMENTS[1]
    scene, pose = experiment.build(), experiment.poses()
    points = np.random.default_rng(0).uniform((-2, -2, 0), (2, 2, 1), (400, 3))
    save_point_sightings(scene, experiment.camera, pose, points, tmp_path / "points.png")
    status = wv.point_visibility(scene, experiment.camera, pose, points).numpy()[0]
    for kind in (wv.Visibility.VISIBLE, wv.Visibility.OCCLUDED):
        assert (status == kind).sum() > 20
        assert count_pixels(tmp_path / "points.png", STATUS_COLORS[kind]) > 20 * 20
    save_point_sightings(
        scene, experiment.camera, pose, points[status != wv.Visibility.VISIBLE], tmp_path / "hidden.png"
    )
    green = [
        count_pixels(tmp_path / name, STATUS_COLORS[wv.Visibility.VISIBLE]) for name in ("hidden.png", "points.png")
    ]
    assert green[0] < green[1] / 3


def test_sightings_require_one_view(tmp_path):
    experiment = scenes.EXPERIMENTS[0]
    with pytest.raises(wv.errors.ArrayError, match="camera_to_world must be one pose for one picture, got 2"):
        save_sightings(experiment.build(), experiment.camera, experiment.poses(2), tmp_path / "two.png")
    assert list(tmp_path.iterdir()) == []
