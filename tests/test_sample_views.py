# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sampled poses of cameras and objects: each meets its constraints, in its region, the same in every run."""

import math

import numpy as np
import pytest
import trimesh
from reference_silhouettes import measure_silhouettes

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.planning import (
    BoxRegion,
    Constraint,
    ShellRegion,
    SupportRegion,
    check_constraints,
    inside_solids,
    sample_objects,
    sample_views,
)
from warpvis.planning._overlap import boxes_meet_boxes, boxes_meet_triangles

CAMERA = wv.Camera.from_fov(40, 30, hfov=1.2, near=0.05)
TABLE = SupportRegion("table", margin=0.05)
SHELL = ShellRegion("cup", (0.4, 1.5), elevation=(0.1, 1.0))
ROBOT = wv.Agent("robot", wv.Camera.from_fov(80, 60, hfov=1.2), wv.look_at((0, 0, 1.2), (2, 0, 0.8)))
PERSON = wv.Agent("person", wv.FieldOfView(2.6, 0.6, 0.9, resolution=60), wv.look_at((4, 0, 1.6), (2, 0, 0.8)))
BOTH = [(PERSON, {"cup": (0.5, 1.0)}), (ROBOT, {"cup": Constraint(status="occluded")})]


def build(device="cpu"):
    scene = wv.Scene(device=device)
    box = trimesh.creation.box
    scene.add(box((1, 1.6, 0.8)), name="table", pose=(2, 0, 0.4, 0, 0, 0, 1))
    scene.add(box((0.05, 0.5, 0.4)), name="screen", pose=(1.9, 0.2, 1.0, 0, 0, 0, 1))
    scene.add(box((0.1, 0.1, 0.14)), name="cup", pose=(2.2, -0.3, 0.87, 0, 0, 0, 1), movable=True)
    scene.add(box((0.3, 0.2, 0.3)), name="jug", pose=(2.2, 0.4, 0.95, 0, 0, 0, 1), movable=True)
    scene.add(box((8, 8, 0.1)), name="floor", label="ground", pose=(2, 0, -0.05, 0, 0, 0, 1))
    return scene


@pytest.fixture(scope="module")
def scene():
    return build()


def adds_up(found, count):
    assert found.tries == found.accepted + sum(found.failures.values())
    assert found.accepted >= count == len(found.poses)
    assert 0 <= found.refined <= found.accepted
    assert found.acceptance == found.accepted / found.tries
    assert found.report()["failures"] == found.failures


@pytest.mark.parametrize("refine", [True, False])
def test_poses_meet_constraints(scene, refine):
    constraints = {"cup": Constraint(fraction=(0.3, 0.7), pixels=(8, None)), "screen": (0.2, 1.0)}
    found = sample_views(scene, CAMERA, constraints, SHELL, 6, 3, refine=refine)
    adds_up(found, 6)
    assert (found.refined > 0) == refine
    seen = wv.object_visibility(scene, CAMERA, found.poses, objects=["cup", "screen"])
    fraction = seen.visible_pixels.numpy() / seen.silhouette_pixels.numpy()
    assert ((fraction[:, 0] >= 0.3) & (fraction[:, 0] <= 0.7) & (fraction[:, 1] >= 0.2)).all()
    assert (seen.visible_pixels.numpy()[:, 0] >= 8).all()
    for pose, expected in zip(found.poses, fraction[:, 0], strict=True):
        masks = measure_silhouettes(scene, CAMERA, pose, 2, canvas=(40, 30, 40, 30), delta=0.0)
        counts = masks["visible"].sum(), masks["canvas"].sum()
        assert abs(counts[0] / counts[1] - expected) < 1.5 / counts[1]


def test_results_depend_on_the_seed_only(scene):
    arguments = (scene, CAMERA, {"cup": (0.3, 0.7)}, SHELL, 5)
    first, again = sample_views(*arguments, 7), sample_views(*arguments, 7, threads=1)
    assert first.poses.tobytes() == again.poses.tobytes()
    assert first.report() == again.report()
    assert first.poses.tobytes() != sample_views(*arguments, 8).poses.tobytes()
    placed = [sample_objects(scene, {"cup": TABLE}, BOTH, 3, 7).object_poses.tobytes() for _ in range(2)]
    assert placed[0] == placed[1]


def test_devices_agree(device):
    found = sample_views(build(device), CAMERA, {"cup": (0.3, 0.7)}, SHELL, 5, 7)
    np.testing.assert_array_equal(found.poses, sample_views(build(), CAMERA, {"cup": (0.3, 0.7)}, SHELL, 5, 7).poses)


def test_objects_that_one_agent_sees_and_another_does_not(scene):
    found = sample_objects(scene, {"cup": TABLE}, BOTH, 8, 0)
    assert found.poses.shape == (8, 0)
    assert found.tries == found.accepted + sum(found.failures.values())
    worlds = found.object_poses
    np.testing.assert_array_equal(worlds[:, 1], np.tile(np.float32([2.2, 0.4, 0.95, 0, 0, 0, 1]), (8, 1)))
    seen = wv.perspective(scene, [PERSON, ROBOT], objects=["cup"], object_poses=worlds)
    assert (seen.fraction[0] >= 0.5).all()
    assert (seen.status[1] == wv.Visibility.OCCLUDED).all()


def test_objects_stand_on_their_support_and_touch_nothing(scene):
    """Corners of each moved box are on the table, and points of its surface are in no other box."""
    move = {"cup": TABLE, "jug": SupportRegion("table", yaw=(0.0, 0.4))}
    found = sample_objects(scene, move, [(ROBOT, {"cup": (0.0, 1.0)})], 60, 5)
    assert any("placement" in name for name in found.failures)
    assert found.hardest.startswith("placement")
    matrices = poses_to_matrices(found.object_poses)
    inner = np.stack(np.meshgrid(*[np.linspace(-0.49, 0.49, 9)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    sizes = [(0.1, 0.1, 0.14), (0.3, 0.2, 0.3)]
    points = [
        inner * size @ matrices[:, i, :3, :3].swapaxes(1, 2) + matrices[:, i, None, :3, 3]
        for i, size in enumerate(sizes)
    ]
    assert points[0].reshape(-1, 3).min(axis=0)[0] >= 1.5 + 0.05
    for index, size in enumerate(sizes):
        outline = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3) * size
        corners = outline @ matrices[:, index, :3, :3].swapaxes(1, 2) + matrices[:, index, None, :3, 3]
        assert np.abs(corners[..., 2].min(axis=1) - 0.8).max() < 1e-6
        assert (corners[..., 0] >= 1.5 - 1e-6).all()
        assert (corners[..., 0] <= 2.5 + 1e-6).all()
        assert (np.abs(corners[..., 1]) <= 0.8 + 1e-6).all()
    assert not inside_solids(scene, np.concatenate(points).reshape(-1, 3), exclude=["cup", "jug"]).any()
    for world in range(60):
        local = (points[0][world] - matrices[world, 1, :3, 3]) @ matrices[world, 1, :3, :3]
        assert not (np.abs(local) < np.array(sizes[1]) / 2).all(axis=1).any()
    yaw = 2 * np.arctan2(found.object_poses[:, 1, 5], found.object_poses[:, 1, 6])
    assert ((yaw >= 0) & (yaw <= 0.4)).all()
    assert yaw.std() > 0.05


def test_cameras_and_objects_together(scene):
    found = sample_views(
        scene, CAMERA, {"cup": Constraint(fraction=(0.8, 1.0), distance=(0.5, 1.0))}, SHELL, 5, 2,
        move={"cup": TABLE}, agents=[(ROBOT, {"cup": (0.0, 0.0)})],
    )  # fmt: skip
    adds_up(found, 5)
    seen = wv.object_visibility(scene, CAMERA, found.poses, objects=["cup"], object_poses=found.object_poses)
    assert (seen.fraction.numpy() >= 0.8 - 1e-6).all()
    hidden = wv.object_visibility(scene, ROBOT.camera, np.repeat(ROBOT.poses, 5, 0), object_poses=found.object_poses)
    assert not hidden.visible_pixels.numpy()[:, 2].any()
    distance = np.linalg.norm(found.poses[:, :3] - found.object_poses[:, 0, :3], axis=1)
    assert ((distance >= 0.5 - 1e-6) & (distance <= 1 + 1e-6)).all()


def looks_at(poses, point):
    """Return the angles between viewing directions and a point [rad]."""
    matrices = poses_to_matrices(poses)
    to_point = np.array(point) - matrices[:, :3, 3]
    cosine = (to_point * matrices[:, :3, 2]).sum(axis=1) / np.linalg.norm(to_point, axis=1)
    return np.arccos(np.clip(cosine, -1, 1))


def test_shell(scene):
    ranges = {"azimuth": (0.5, 1.5), "elevation": (0.2, 0.9), "roll": (0.3, 0.3)}
    poses = sample_views(scene, CAMERA, {"cup": (0, 1)}, ShellRegion("cup", (1, 2), **ranges), 200, 0).poses
    offsets = poses[:, :3] - (2.2, -0.3, 0.87)
    distance = np.linalg.norm(offsets, axis=1)
    for values, (low, high) in [
        (distance, (1, 2)),
        (np.arctan2(offsets[:, 1], offsets[:, 0]), (0.5, 1.5)),
        (np.arcsin(offsets[:, 2] / distance), (0.2, 0.9)),
    ]:
        assert ((values >= low - 1e-6) & (values <= high + 1e-6)).all()
        assert np.ptp(values) > 0.8 * (high - low)
    assert looks_at(poses, (2.2, -0.3, 0.87)).max() < 1e-6
    right = poses_to_matrices(poses)[:, :3, 0]
    np.testing.assert_allclose(
        np.abs(right[:, 2]), np.abs(np.sin(0.3) * np.cos(np.arcsin(offsets[:, 2] / distance))), atol=1e-6
    )


def test_shell_with_heights_and_jitter(scene):
    region = ShellRegion((2, 0, 1), (0.5, 0.8), height=(0.3, 0.4), jitter=0.05)
    poses = sample_views(scene, CAMERA, {"cup": (0, 1)}, region, 100, 0).poses
    across = np.hypot(poses[:, 0] - 2, poses[:, 1])
    assert ((across >= 0.5 - 1e-9) & (across <= 0.8 + 1e-9)).all()
    assert ((poses[:, 2] >= 1.3 - 1e-9) & (poses[:, 2] <= 1.4 + 1e-9)).all()
    angles = looks_at(poses, (2, 0, 1))
    assert 0.01 < angles.max() < math.atan2(0.05 * math.sqrt(3), 0.5)


def test_box_rejects_positions_inside_solids(scene):
    region = BoxRegion([[1.6, -0.7, 0.2], [2.4, 0.7, 1.2]], look_at="cup")
    found = sample_views(scene, CAMERA, {"cup": (0.0, 0.0)}, region, 50, 0)
    assert found.failures["position of the camera"] > 20
    assert (found.poses[:, 2] > 0.8).all()
    flat = BoxRegion([[0, 0, 1.5], [1, 0, 1.5]], look_at=(2, 0, 0.8))
    assert (sample_views(scene, CAMERA, {"cup": (0, 1)}, flat, 3, 0).poses[:, 1:3] == (0, 1.5)).all()


def test_region_straight_below_a_camera(scene):
    above = BoxRegion([[2.2, -0.3, 2.0], [2.2, -0.3, 2.0]], look_at="cup")
    poses = sample_views(scene, CAMERA, {"cup": (0.9, 1)}, above, 2, 0).poses
    assert looks_at(poses, (2.2, -0.3, 0.87)).max() < 1e-5


def test_region_of_a_function(scene):
    def region(generator, size):
        return np.stack([wv.look_at((1.2, y, 1.1), (2.2, -0.3, 0.87)) for y in generator.uniform(-1, 1, size)])

    found = sample_views(scene, CAMERA, {"cup": (0.2, 0.8)}, region, 4, 1)
    adds_up(found, 4)
    assert check_constraints(scene, CAMERA, found.poses, {"cup": (0.2, 0.8)}).accepted.all()
    np.testing.assert_allclose(found.poses[:, 0], 1.2)


def test_small_budget(scene):
    impossible = {"cup": (0.9, 1.0), "screen": Constraint(distance=(7.0, 8.0))}
    message = r"only 0 of 3 samples met all .* in 100 tries, .* by the distance of 'screen' \(100 of 100\); relax"
    with pytest.raises(wv.WarpvisError, match=message):
        sample_views(scene, CAMERA, impossible, SHELL, 3, 0, max_tries=100)
    found = sample_views(scene, CAMERA, impossible, SHELL, 3, 0, max_tries=100, partial=True)
    assert found.poses.shape == (0, 7)
    assert found.hardest == "distance of 'screen'"
    assert found.failures == {"distance of 'screen'": 100}
    some = sample_views(scene, CAMERA, {"cup": (0.3, 0.7)}, SHELL, 500, 0, max_tries=333, partial=True)
    assert some.tries == 333 == some.accepted + sum(some.failures.values())
    assert 0 < len(some.poses) == some.accepted < 500


def test_excluded_objects_are_neither_seen_nor_obstacles(scene):
    region = BoxRegion([[1.6, -0.7, 0.2], [2.4, 0.7, 0.7]], look_at="cup")
    found = sample_views(scene, CAMERA, {"cup": (0.9, 1.0)}, region, 5, 0, exclude=["table"])
    assert (found.poses[:, 2] < 0.8).all()


def test_overlap_of_boxes_against_points():
    """Random boxes overlap if they contain a common point of a fine grid, up to its spacing."""
    generator = np.random.default_rng(0)
    rows = np.concatenate([generator.uniform(-0.6, 0.6, (300, 3)), generator.normal(size=(300, 4))], axis=1)
    axes, centers, half, other = (
        poses_to_matrices(rows)[:, :3, :3],
        rows[:, :3],
        np.array([0.3, 0.2, 0.1]),
        np.array([0.25, 0.3, 0.2]),
    )
    zero, eye = np.zeros((300, 3)), np.tile(np.eye(3), (300, 1, 1))
    got = boxes_meet_boxes(centers, axes, half, zero, eye, other)
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 31)] * 3), axis=-1).reshape(-1, 3)
    points = grid * half @ axes.swapaxes(1, 2) + centers[:, None]
    depth = (other - np.abs(points)).min(axis=2).max(axis=1)
    assert got[depth >= 0].all()
    assert not got[depth < -0.02].any()
    assert 50 < got.sum() < 250
    mesh = trimesh.creation.box(2 * other)
    surface = boxes_meet_triangles(centers, axes, half, mesh.triangles.astype(np.float32))
    inside = (np.abs(centers) < other).all(axis=1)
    assert not surface[~got].any()
    assert (surface | inside)[got].all()


def test_attached_objects_name_what_moves_them():
    scene = build()
    scene.add(trimesh.creation.box((0.05, 0.05, 0.05)), name="handle", attach_to="cup")
    with pytest.raises(wv.errors.SceneError, match="'handle' is attached to 'cup' and moves with it; move 'cup'"):
        sample_objects(scene, {"handle": TABLE}, [(PERSON, {"cup": (0, 1)})], 1, 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 0}, "count must be a whole number from 1 up, got 0"),
        ({"seed": -1}, "seed must be a whole number from 0 up"),
        ({"max_tries": 0}, "max_tries must be a whole number from 1 up"),
        ({"constraints": {"mug": (0, 1)}}, "the scene has no object 'mug'"),
        ({"region": [[0, 0, 0], [1, 1, 1]]}, "region must be a BoxRegion, a ShellRegion or a function"),
        ({"region": ShellRegion("mug", (1, 2))}, "the scene has no object 'mug'"),
        ({"region": lambda generator, size: np.zeros((2, 7))}, "poses of the region must have quaternions"),
        ({"region": lambda generator, size: [wv.look_at((0, 0, 0), (1, 0, 0))]}, "region must return 32 poses, got 1"),
        ({"region": len}, "region must return 32 poses, but it raised"),
        ({"move": {"table": TABLE}}, "move must have movable objects, but 'table' is static"),
        ({"move": {"cup": "table"}}, "move must have a SupportRegion for 'cup', got 'table'"),
        ({"move": {"cup": SupportRegion("jug"), "jug": TABLE}}, "the support of 'cup' must not be moved itself"),
        ({"agents": [ROBOT]}, "agents must be pairs of a warpvis.Agent and its constraints"),
        ({"agents": [(ROBOT, {"cup": (0, 1)})] * 2}, "agents must have distinct names, got 'robot' twice"),
        ({"agents": [(PERSON, {"cup": Constraint(margin=1)})]}, "margin requires a camera with one image"),
    ],
)
def test_wrong_arguments(scene, change, message):
    arguments = {"constraints": {"cup": (0, 1)}, "region": SHELL, "count": 1, "seed": 0} | change
    with pytest.raises(wv.WarpvisError, match=message):
        sample_views(scene, CAMERA, **arguments)


def test_object_that_does_not_fit(scene):
    with pytest.raises(wv.WarpvisError, match=r"most failed by the placement of 'jug' \(50 of 50\)"):
        sample_objects(scene, {"jug": SupportRegion("cup")}, BOTH, 1, 0, max_tries=50)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ShellRegion("cup", (2, 1)), r"distance must have its minimum first, got \(2, 1\)"),
        (lambda: ShellRegion("cup", (-1, 1)), "distance must be from 0 up meters, got -1"),
        (lambda: ShellRegion("cup", (0, 0)), "distance must reach above 0 m"),
        (lambda: ShellRegion("cup", (1, math.nan)), "distance must be a minimum and a maximum in meters"),
        (lambda: ShellRegion("cup", (1, 2), azimuth=(0, 90)), r"azimuth must .* got 90; .* math.radians\(90\)"),
        (lambda: ShellRegion("cup", (1, 2), elevation=(0, 60)), r"elevation must .* got 60; .* math.radians\(60\)"),
        (lambda: ShellRegion("cup", 2), "distance must be a minimum and a maximum in meters, got 2"),
        (lambda: BoxRegion([[0, 0, 0], [1, -1, 1]], "cup"), "bounds must be the lower and upper corner of a box"),
        (lambda: BoxRegion([[0, 0, 0], [1, 1, math.nan]], "cup"), "bounds must be the lower and upper corner of a box"),
        (lambda: BoxRegion([[0, 0, 0], [1, 1, 1]], (0, 1)), "look_at must be three finite numbers"),
        (lambda: BoxRegion([[0, 0, 0], [1, 1, 1]], "cup", jitter=-1), "jitter must be a number of meters from 0 up"),
        (lambda: SupportRegion("table", margin=math.nan), "margin must be a number of meters from 0 up"),
        (lambda: SupportRegion("table", yaw=(0, 360)), r"yaw must .* got 360; .* math.radians\(360\)"),
        (lambda: SupportRegion([[0, 0], [1, 1]]), "support must be the lower and upper corner of a box"),
    ],
)
def test_wrong_regions(make, message):
    with pytest.raises(wv.WarpvisError, match=message):
        make()


def test_failures_of_conditions_with_the_same_name_add_up(scene):
    twice = {"cup": [Constraint(distance=(0.5, None)), Constraint(distance=(None, 0.6))]}
    found = sample_views(scene, CAMERA, twice, SHELL, 20, 0, agents=[(wv.Agent("camera", CAMERA, ROBOT.poses), twice)],
                         max_tries=200, partial=True)  # fmt: skip
    assert sum(found.failures.values()) == found.tries - found.accepted == 200


def test_scene_with_y_up():
    made = wv.Scene(device="cpu", up="y")
    made.add(trimesh.creation.box((1, 0.8, 1.6)), name="table", pose=(2, 0.4, 0, 0, 0, 0, 1))
    made.add(trimesh.creation.box((0.1, 0.14, 0.1)), name="cup", pose=(0, 3, 0, 0, 0, 0, 1), movable=True)
    shell = ShellRegion("cup", (0.5, 1.0), azimuth=(0.0, 0.1), elevation=(0.3, 0.4))
    found = sample_views(made, CAMERA, {"cup": (0.9, 1)}, shell, 20, 5, move={"cup": SupportRegion("table")})
    offsets = found.poses[:, :3] - found.object_poses[:, 0, :3]
    np.testing.assert_allclose(found.object_poses[:, 0, 1], 0.87, atol=1e-6)
    assert (offsets[:, 1] > 0).all()
    assert (offsets[:, 2] > np.abs(offsets[:, 0])).all()  # the floor's first axis is z
    assert (poses_to_matrices(found.poses)[:, 1, 1] < 0).all()


def test_lens_camera(scene):
    lens = wv.cameras.LensCamera(wv.cameras.lenses.OpenCVPinhole(35, 35, 20, 15, (0.01, 0, 0, 0)), 40, 30)
    found = sample_views(scene, lens, {"cup": (0.3, 0.7)}, SHELL, 3, 0)
    fraction = wv.object_visibility(scene, lens, found.poses, objects=["cup"]).fraction.numpy()
    assert ((fraction >= 0.3 - 1e-6) & (fraction <= 0.7 + 1e-6)).all()
