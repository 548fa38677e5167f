# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the floor map: against the reference, and the meaning of its cells."""

import subprocess
import sys

import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpvis as wv
from warpvis import Label, scenes
from warpvis.maps import MAP_LEGEND, FloorMap
from warpvis.scenes.experiments import ROBOT_AT, ROBOT_RADIUS
from warpvis.viz import save_map

import reference

ROBOT = [(*ROBOT_AT, ROBOT_RADIUS)]


@pytest.mark.smoke("*-1")
@pytest.mark.parametrize("number", [1, 3])
def test_maps_match_reference(number, device):
    experiment = scenes.EXPERIMENTS[number - 1]
    scene = experiment.build(device)
    camera = wv.Camera.from_fov(96, 72, hfov=0.994837, near=0.3, far=4.5)
    views = wv.render(scene, camera, experiment.poses())
    # Box faces lie on round numbers: with these bounds no point lies on the border of two cells.
    low = np.array([-2.013, -1.987])
    floor_map = wv.floor_map(views.points, views.labels, bounds=(low, (2, 2)), cell_size=0.05, robots=ROBOT)
    marks = reference.mark_cells(
        views.points.numpy()[0], views.labels.numpy()[0], low, 0.05, floor_map.cells.shape[1:], 0.01
    )
    expected = reference.finish_map(marks, low, 0.05, np.array(ROBOT))
    # Cells whose center lies on a quadrilateral's edge may differ in single precision.
    assert (floor_map.cells.numpy()[0] != expected).mean() < 2e-3
    assert set(np.unique(expected)) > {Label.EMPTY, Label.GROUND, Label.OBSTACLE, Label.ROBOT}


def test_every_visible_point_marks_its_cell(device):
    """Each cell has at least the label of every point in it."""
    experiment = scenes.EXPERIMENTS[0]
    scene = experiment.build(device)
    views = wv.render(scene, experiment.camera, experiment.poses())
    floor_map = wv.floor_map(views.points, views.labels, bounds=((-2, -2), (2, 2)), cell_size=0.02)
    assert floor_map.cells.shape == (1, 200, 200)
    cells = floor_map.cells.numpy()[0]
    labels, points = views.labels.numpy()[0], views.points.numpy()[0]
    seen = labels != Label.EMPTY
    column, row = np.floor((points[seen][:, :2] + 2) / 0.02).astype(int).T
    inside = (column >= 0) & (column < 200) & (row >= 0) & (row < 200)
    assert (cells[row[inside], column[inside]] >= labels[seen][inside]).all()


def test_visible_ground_has_no_gaps_between_pixels(device):
    """A camera above an empty floor yields one connected patch, though distant pixels lie many cells apart."""
    scene = wv.Scene(device=device)
    import trimesh

    scene.add(trimesh.creation.box((8, 8, 0.02)), name="floor", label="ground", pose=(0, 0, -0.01, 0, 0, 0, 1))
    pose = wv.look_at((-3.5, 0, 1), (0, 0, 0))
    camera = wv.Camera.from_fov(40, 30, hfov=0.9, far=6)
    views = wv.render(scene, camera, pose)
    cells = wv.floor_map(views.points, views.labels, bounds=scene.bounds, cell_size=0.02).cells.numpy()[0]
    assert (cells == Label.GROUND).mean() > 0.2
    for row in cells == Label.GROUND:
        steps = np.diff(np.flatnonzero(row))
        assert (steps[1:-1] == 1).all()  # at the ends, a pixel's own cell may stick out


def test_higher_label_wins_and_robot_covers_all(device):
    points = np.zeros((1, 1, 3, 3), dtype=np.float32)
    labels = np.array([[[Label.HUMAN, Label.OBSTACLE, Label.OBJECT]]], dtype=np.uint8)
    bounds = ((-1, -1), (1, 1))
    cells = wv.floor_map(points, labels, bounds=bounds, cell_size=1.0).cells.numpy()[0]
    assert cells.tolist() == [[0, 0], [0, Label.HUMAN]]
    cells = wv.floor_map(points, labels, bounds=bounds, cell_size=1.0, robots=[(0.5, 0.5, 0.1)]).cells.numpy()[0]
    assert cells.tolist() == [[0, 0], [0, Label.ROBOT]]


def test_each_view_has_a_separate_map(device):
    experiment = scenes.EXPERIMENTS[2]
    scene = experiment.build(device)
    poses = np.concatenate([experiment.poses(), wv.look_at((1.9, 0, 0.7), (0, 0, 0.3))[None]]).astype(np.float32)
    both = wv.render(scene, experiment.camera, poses)
    maps = wv.floor_map(both.points, both.labels, bounds=scene.bounds, threads=2).cells.numpy()
    for view in range(2):
        one = wv.render(scene, experiment.camera, poses[view])
        alone = wv.floor_map(one.points, one.labels, bounds=scene.bounds).cells.numpy()[0]
        np.testing.assert_array_equal(maps[view], alone)
    assert (maps[0] != maps[1]).any()


def test_legend_colors_and_areas():
    points = np.zeros((1, 1, 1, 3), dtype=np.float32)
    floor_map = wv.floor_map(points, np.array([[[1]]], dtype=np.uint8), bounds=((0, 0), (1, 2)), cell_size=0.5)
    assert floor_map.bounds == (0, 1, 0, 2)
    assert floor_map.area("ground").tolist() == [0.25]
    assert floor_map.rgb().shape == (1, 4, 2, 3)
    colors = {label: color for label, (_, color) in floor_map.legend.items()}
    assert tuple(floor_map.rgb()[0, 0, 0]) == colors[Label.GROUND]
    assert tuple(floor_map.rgb()[0, 3, 1]) == colors[Label.EMPTY] == (0, 0, 0)
    assert list(floor_map.legend) == [Label.EMPTY, Label.GROUND]  # only values that occur


def test_map_of_world_with_y_up():
    """The map's axes are z and x, so it is a view from above."""
    points = np.array([[[[3.0, 0.0, 1.0]]]], dtype=np.float32)
    floor_map = wv.floor_map(points, np.array([[[1]]]), bounds=((0, 0, 0), (4, 1, 2)), cell_size=1.0, up="y")
    assert floor_map.axes == ("z", "x")
    assert floor_map.cells.shape == (1, 4, 2)
    assert floor_map.cells.numpy()[0, 3, 1] == Label.GROUND


def test_saved_map_has_the_colors_of_its_legend(tmp_path):
    """Row 0 is at the bottom of the image, and every cell has its label's color."""
    cells = np.array([[[0, 4], [3, 3], [4, 0]]], dtype=np.uint8)
    save_map(FloorMap(wp.array(cells, device="cpu"), (0, 2, 0, 3), 1.0, "y"), tmp_path / "map.png")
    empty, red, human = (MAP_LEGEND[Label(value)][1] for value in (0, 3, 4))
    pixels = np.asarray(Image.open(tmp_path / "map.png").convert("RGB"))
    in_middle = (pixels == red).all(axis=2)
    rows = np.flatnonzero(in_middle.sum(axis=1) > 100)  # the middle row of cells, without its patch in the legend
    columns = np.flatnonzero(in_middle[rows[0]])
    side = len(rows)
    assert side == pytest.approx(len(columns) / 2, abs=2) and side > 50
    left, right = columns[0] + side // 2, columns[-1] - side // 2
    above, below = rows[0] - side // 2, rows[-1] + side // 2
    colors = [tuple(pixels[row, column].tolist()) for row in (above, below) for column in (left, right)]
    assert colors == [human, empty, empty, human]


@pytest.mark.slow
def test_saving_a_map_imports_no_planning_or_visibility(tmp_path):
    code = f"""
import sys
import numpy as np, warpvis as wv
points = np.array([[[(0.1, 0.1, 0)]]], dtype=np.float32)
floor = wv.floor_map(points, np.ones((1, 1, 1), np.uint8), bounds=[[0, 0], [1, 1]])
wv.viz.save_map(floor, {str(tmp_path / "map.png")!r})
above = ("warpvis.planning", "warpvis.visibility")
found = [name for name in sys.modules if name.startswith(above)]
assert not found, found
"""
    subprocess.run([sys.executable, "-c", code], check=True)
    assert (tmp_path / "map.png").is_file()
