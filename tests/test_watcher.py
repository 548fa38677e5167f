# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `DepthWatcher`: sights compared with the geometry of a rendered room, in double precision."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.visibility import map_points
from warpvis.visibility.watching import FloorSearch
from warpvis.visibility.watching._sights import Target

from support.watching import BALL, BOX, CAMERA, FLOOR, depths, person, raised, room, trajectory

PLACES = {"ball": raised(BALL), "box": raised(BOX)}
BOARD = (np.array([2.57, 0.0, FLOOR]), np.array([2.63, 1.2, FLOOR + 0.9]))


def watch(people=(), *, poses=None, scene=None, move=None, times=None, **options):
    """Return a watcher and its results for a trajectory; `move` is a 4x4 matrix that is applied to all poses."""
    poses = trajectory() if poses is None else poses
    images = depths(poses, scene)
    places = {name: np.array(place) for name, place in PLACES.items()}
    if move is not None:
        poses = [move @ matrix_of(pose) for pose in poses]
        people = [wv.Agent.human(one.name, move @ matrix_of(one.poses[0])) for one in people]
        places = {name: np.append(move[:3, :3] @ place[:3] + move[:3, 3], place[3]) for name, place in places.items()}
    given = {"places": places, "sigma": 0.0, "cell_size": 0.04} | options
    watcher = wv.visibility.DepthWatcher(CAMERA, **given)
    times = [None] * len(poses) if times is None else times
    pairs = zip(images, poses, times, strict=True)
    return watcher, [watcher.update(image, pose, people, time=time) for image, pose, time in pairs]


def matrix_of(row):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(row[3:]).as_matrix()
    matrix[:3, 3] = row[:3]
    return matrix


def blocked_by_board(eye, point):
    """Return whether the board is between an eye and a point, by the slab test in double precision."""
    low, high = BOARD
    with np.errstate(divide="ignore"):
        first, second = (low - eye) / (point - eye), (high - eye) / (point - eye)
    enter, leave = np.minimum(first, second).max(), np.maximum(first, second).min()
    return enter < leave and 0 < enter < 1


def measured(points, poses, images):
    """Return which points an image shows to be free: in view, nearer than the depth of their pixel."""
    free = np.zeros(len(points), dtype=bool)
    for pose, image in zip(poses, images, strict=True):
        matrix = np.linalg.inv(matrix_of(pose))
        x, y, z = (points @ matrix[:3, :3].T + matrix[:3, 3]).T
        column, row = CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy
        inside = (z > 0.1) & (z < 5) & (column >= 0) & (column < CAMERA.width) & (row >= 0) & (row < CAMERA.height)
        free[inside] |= z[inside] < image[row[inside].astype(int), column[inside].astype(int)]
    return free


def test_person_sees_one_ball_and_the_board_hides_the_other():
    anna = person()
    _, results = watch([anna], floor=FLOOR)
    seen = results[-1].sights
    assert blocked_by_board(anna.poses[0, :3], np.array(raised(BALL)[:3]))
    assert not blocked_by_board(anna.poses[0, :3], np.array(raised(BOX)[:3]))
    assert seen["anna"]["ball"].status == wv.Visibility.OCCLUDED and seen["anna"]["ball"].hidden == 1
    assert seen["anna"]["box"].status == wv.Visibility.VISIBLE and seen["anna"]["box"].visible > 0.8
    for place in ("ball", "box"):
        assert seen["robot"][place].visible == 1
        assert sum(getattr(seen["anna"][place], name) for name in ("visible", "hidden", "unknown", "out_of_view")) == 1
    x, y, z = seen["anna"]["ball"].stop  # in the floor's world: on the board's surface or edge
    low, high = (corner - (0, 0, FLOOR) for corner in BOARD)
    assert np.all((x, y, z) > low - 0.08) and np.all((x, y, z) < high + 0.08)


def test_what_nobody_measured_is_unknown_over_its_length():
    bob = person("bob", eyes=(0.5, 3.0, 1.4))
    poses = trajectory()
    watcher, results = watch([bob], floor=FLOOR)
    sight = results[-1].sights["bob"]["ball"]
    assert sight.status == wv.Visibility.UNKNOWN and sight.unknown == 1 and sight.hidden == 0
    eye, center = bob.poses[0, :3], np.array(raised(BALL)[:3])
    length = np.linalg.norm(center - eye)
    begin = wv.visibility.MeasuredSpace(watcher.occupancy).eye_clearance
    distances = np.arange(begin, length - BALL[3] / 2 - 0.08, 0.001)  # up to two voxels before the ball
    free = measured(eye + distances[:, None] * (center - eye) / length, poses, depths(poses))
    assert 0.5 < 1e-3 * (~free).sum() < length
    assert sight.unknown_length == pytest.approx(1e-3 * (~free).sum(), abs=0.08)
    first = eye + distances[np.argmin(free)] * (center - eye) / length
    np.testing.assert_allclose(sight.stop, first - (0, 0, FLOOR), atol=0.06)


def test_floor_is_found_in_a_world_of_any_orientation():
    move = np.eye(4)
    move[:3, :3] = Rotation.from_euler("xyz", (1.9, -0.3, 2.2)).as_matrix()
    move[:3, 3] = (3, -2, 5)
    anna = person()
    watcher, results = watch([anna], move=move)
    expected = watch([anna], floor=FLOOR)[1][-1]
    assert results[-1] is not None and watcher.problem == ""
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(-1, 4, (20, 2)), np.full(20, FLOOR)]) @ move[:3, :3].T + move[:3, 3]
    heights = (floor @ matrix_of(watcher.world_from_input)[:3, :3].T + watcher.world_from_input[:3])[:, 2]
    np.testing.assert_allclose(heights, 0, atol=0.01)
    for agent in ("robot", "anna"):
        for place in PLACES:
            assert results[-1].sights[agent][place].status == expected.sights[agent][place].status
    np.testing.assert_allclose(results[-1].robot.poses[0, 2], expected.robot.poses[0, 2], atol=0.01)


def test_no_floor_is_reported_with_a_remedy():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((0.1, 8, 6)), name="wall", pose=(3, 0, 0, 0, 0, 0, 1))
    poses = [wv.look_at((0, side, 1), (3, side, 1)) for side in (0, 0.1)]
    watcher, results = watch(poses=poses, scene=scene)
    assert results == [None, None] and watcher.occupancy is None
    assert "no floor was found in 2 images" in watcher.problem and "pass the height of the camera" in watcher.problem
    with pytest.raises(wv.WarpvisError, match="the map must not be empty"):
        watcher.voxel_map()


def test_empty_images_are_the_reason_why_there_is_no_floor():
    search = FloorSearch(CAMERA)
    assert "there is no image" in search.explain()
    search.add(np.full((CAMERA.height, CAMERA.width), np.nan, dtype=np.float32), wv.look_at((0, 0, 1), (3, 0, 1)))
    assert "no floor was found in 1 images: measured must have 100 points within 12 m" in search.explain()


def test_people_are_labeled_and_leave_no_trace_in_the_map():
    scene = room()
    scene.add(trimesh.creation.cylinder(0.2, 1.7), name="body", pose=(3.2, -0.4, FLOOR + 0.85, 0, 0, 0, 1))
    anna = person(eyes=(3.2, -0.4, 1.6))
    inside = np.array([(3.0 + 0.02 * k, -0.4, 1.2) for k in range(5)])
    for people in ([anna], []):
        watcher, results = watch(people, scene=scene, floor=FLOOR)
        found = results[-1].labels[np.abs(results[-1].points - (3.0, -0.4, 1.2)).max(axis=-1) < 0.15]
        states = watcher.occupancy.states(inside).numpy()
        assert len(found) > 10 and (found == (wv.Label.HUMAN if people else wv.Label.OBSTACLE)).all()
        assert (states == 3).any() == (not people)


def test_labels_and_floor_map():
    _, results = watch(floor=FLOOR)
    watched = results[0]
    points = watched.points
    known = np.isfinite(points).all(axis=-1)
    for name, (x, y, z, diameter) in watched.places.items():
        near = known & (np.linalg.norm(points - (x, y, z), axis=-1) < diameter / 2 - 1e-3)
        assert (watched.labels[near] == wv.Label.OBJECT).all(), name
    assert (watched.labels[~known] == wv.Label.EMPTY).all()
    assert (watched.labels[known & (points[..., 2] < 0.03)] == wv.Label.GROUND).all()
    found = watched.floor_map(cell_size=0.05, max_range=4.0)
    assert found.area("object")[0] == pytest.approx(2 * np.pi * 0.1**2, rel=0.6)
    assert found.area("ground")[0] > 5


def test_gaze_decides_what_is_meant_and_time_smooths_it():
    gaze = {place: person("anna", (0.2, -0.2, 1.3), target) for place, target in (("ball", BALL), ("box", BOX))}
    for place, one in gaze.items():
        found = watch([one], floor=FLOOR)[1][-1].candidates["anna"]
        assert sum(found.values()) == pytest.approx(1) and max(found, key=found.get) == place and found[place] > 0.8
    poses = trajectory(3)
    images = depths(poses)
    watcher = wv.visibility.DepthWatcher(CAMERA, places=PLACES, floor=FLOOR, sigma=0.0)
    history = [
        watcher.update(image, pose, [gaze[place]], time=time).candidates["anna"]["box"]
        for image, pose, place, time in zip(images, poses, ("ball", "box", "box"), (0.0, 0.1, 4.0), strict=True)
    ]
    assert history[0] < history[1] < 0.5 < history[2]


def test_aims_are_on_the_near_side_of_a_sphere():
    target, eye = Target("ball", np.array([2.0, 1.0, 0.5]), 0.4), np.array([-1.0, 0.3, 1.5])
    aims = target.aims(eye)
    np.testing.assert_allclose(np.linalg.norm(aims - target.center, axis=1), 0.2, atol=1e-12)
    assert ((aims - target.center) @ (eye - target.center) > 0).all()
    np.testing.assert_allclose(np.cross(aims[0] - eye, target.center - eye), 0, atol=1e-12)
    assert len(np.unique(aims.round(6), axis=0)) == 24


def test_border_of_unknown_space():
    watcher, _ = watch(floor=FLOOR)
    voxels = watcher.voxel_map()
    assert voxels.states.shape[2] * 0.04 < 3.7
    states, centers = voxels.states.numpy(), voxels.centers()
    levels = (centers[0, 0, :, 2] >= -0.04) & (centers[0, 0, :, 2] < 1.0)
    part = np.pad(states[:, :, levels], 1)
    shifts = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    near = np.any([np.roll(part == 2, shift, axis=(0, 1, 2)) for shift in shifts], axis=0) & (part < 2)
    expected = centers[:, :, levels][near[1:-1, 1:-1, 1:-1]]
    found = map_points(voxels, max_height=1.0, max_points=10**6)
    np.testing.assert_allclose(found.unknown, expected, atol=1e-5)
    surface = centers[(states == 3) & (centers[..., 2] < 1.0)]
    np.testing.assert_allclose(found.surface, surface, atol=1e-5)
    assert len(map_points(voxels, max_height=1.0, max_points=50).surface) == 50


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"places": {"mug": (1, 2)}}, r"place 'mug' must be a point x y z or a sphere x y z diameter \[m\], got"),
        ({"floor": "0"}, r"floor must be the result of fit_floor or the height of the floor \[m\], got '0'"),
        ({"cell_size": 0}, r"cell_size must be .* got 0"),
        ({"model": "salience"}, r"model must be a warpvis.visibility.ReferenceModel, got str"),
    ],
)
def test_bad_options_are_refused(arguments, message):
    with pytest.raises(wv.WarpvisError, match=message):
        wv.visibility.DepthWatcher(CAMERA, **arguments)


@pytest.mark.parametrize(
    ("people", "message"),
    [
        ([person(), person()], "different names, got 'anna' more than once"),
        ([person("robot")], "different names, got 'robot' more than once"),
        ([(0, 0, 0)], "people must be warpvis.Agent, such as Agent.human, got tuple"),
        ([wv.Agent.human("anna", trajectory(2))], "'anna' must have one pose, got 2"),
    ],
)
def test_bad_people_are_refused(people, message):
    watcher = wv.visibility.DepthWatcher(CAMERA, floor=0.0)
    with pytest.raises(wv.WarpvisError, match=message):
        watcher.update(np.ones((120, 160)), trajectory()[0], people)
