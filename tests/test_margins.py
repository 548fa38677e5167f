# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Margins of visibility: double precision, answers that flip where margins say so, worlds, and invalid input."""

import math

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.errors import WarpvisError
from warpvis.visibility import MarginMeter, point_margins, visibility_margins

import reference
from support.object_visibility import cameras, desk, room

CAMERA = wv.Camera.from_fov(40, 30, hfov=1.0, near=0.6, far=3.2)
WIDE = wv.Camera.from_fov(160, 120, hfov=1.0)
EYE = (0, 0, 0, 0, 0, 0, 1)
FIELDS = "pixels", "degrees", "meters", "blocker"


def values(found):
    return {name: getattr(found, name).numpy() for name in FIELDS}


def agrees(found, expected, tolerance=2e-5):
    """Return whether a margin has the expected distance, and the values of one of the deciding pairs."""
    if not np.isclose(found["pixels"], expected.pixels, rtol=0, atol=tolerance, equal_nan=True):
        return False
    error = tolerance / max(0.1, abs(expected.pixels))
    pairs = np.isclose(found["degrees"], expected.degrees, rtol=error + 2e-5, atol=1e-6, equal_nan=True)
    pairs &= np.isclose(found["meters"], expected.meters, rtol=error + 2e-4, atol=1e-6, equal_nan=True)
    return (pairs & (found["blocker"] == expected.blocker)).any()


def at(found, view, target):
    return {name: array[view, target] for name, array in found.items()}


@pytest.mark.parametrize("seed", range(4))
def test_margins_match_reference(device, seed):
    """Single objects and unions in random scenes, sampled at pixels and more finely."""
    scene, rng = room(30 + seed, 6, device)
    poses = np.stack([wv.look_at(rng.uniform(-1.8, 1.8, 3) + (0, 0, 1.9), rng.uniform(-0.6, 0.6, 3)) for _ in range(3)])
    targets = [[index] for index in range(1, len(scene))] + [[1, 4], [2, 3, 5]]
    least = (16, 200)[seed % 2]
    found = values(visibility_margins(scene, CAMERA, poses, objects=targets, reach=9.5, min_samples=least))
    wrong, signs = [], set()
    for view, pose in enumerate(poses):
        for target, group in enumerate(targets):
            expected = reference.measure_margins(scene, CAMERA, pose, group, reach=9.5, least=least)
            signs.add(np.sign(expected.pixels))
            if not agrees(at(found, view, target), expected):
                wrong.append((view, group, at(found, view, target), expected))
    assert not wrong, wrong[0]
    assert {-1.0, 1.0} <= signs


def test_points_match_reference(device):
    """Points on surfaces, in the air, inside of objects, out of the image and behind the camera."""
    scene, rng = room(50, 6, device)
    pose = wv.look_at((1.8, -0.5, 1.4), (0, 0, 0.3))
    on_surfaces = wv.planning.surface_samples(scene, spacing=0.2).points
    on_surfaces = on_surfaces[rng.choice(len(on_surfaces), 60, replace=False)]
    points = np.concatenate([on_surfaces, rng.uniform(-2.5, 2.5, (60, 3))]).astype(np.float32)
    found = values(point_margins(scene, CAMERA, pose, points, reach=7.0))
    status = wv.point_visibility(scene, CAMERA, pose, points).numpy()[0]
    assert np.array_equal(found["pixels"][0] > 0, status == wv.Visibility.VISIBLE)
    wrong = 0
    for index, point in enumerate(points):
        expected = reference.measure_point_margins(scene, CAMERA, pose, point, reach=7.0, tolerance=1e-4)
        wrong += not agrees(at(found, 0, index), expected, 0.01)
    assert wrong <= 1  # a place is rounded to 1/128 px, which may change the deciding pixel
    assert {*status} >= {wv.Visibility.VISIBLE, wv.Visibility.OCCLUDED, wv.Visibility.OUT_OF_VIEW}
    assert (found["blocker"] >= 0).any() and (abs(found["pixels"]) < 7).sum() > 20


def test_tiles_have_the_range_of_their_pixels(device):
    from warpvis.kernels.visibility.nearest_pixels import TILE_SIDE, bound_depth_tiles

    depth = np.random.default_rng(3).uniform(0.1, 9, (2, 21, 30)).astype(np.float32)
    tiles = wp.empty((2, 3, 4), dtype=wp.vec2, device=device)
    wp.launch(
        bound_depth_tiles, tiles.shape, [wp.array(depth, dtype=wp.float32, device=device)], [tiles], device=device
    )
    assert np.array_equal(tiles.numpy(), [reference.bound_depth_tiles(image, TILE_SIDE) for image in depth])


def walled(shift, device="cpu", target=(0, 0, 3), size=0.2):
    """Return a box with the eye's axis through it, and a wall whose edge is at x = `shift` and z = 2."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((size, size, size)), name="cup", movable=True, pose=(*target, 0, 0, 0, 1))
    wall = trimesh.creation.box((2, 4, 0.002))
    scene.add(wall, name="wall", movable=True, pose=(1 + shift, 0, 2, 0, 0, 0, 1))
    return scene


def is_seen(scene, name, offset):
    """Return whether the cup is visible after an object has moved sideways."""
    poses = np.stack([item.pose for item in scene.objects]).astype(np.float64)
    poses[scene.index(name), 0] += offset
    found = wv.visible_fractions(scene, WIDE, EYE, objects=["cup"], object_poses=poses)
    return found.fraction.numpy()[0, 0] > 0


@pytest.mark.parametrize("shift", [0.05, 0.013, -0.05, -0.081, -0.1, -0.15, -0.21])
def test_answers_flip_where_the_wall_moves_by_the_margin(device, shift):
    scene = walled(shift, device)
    found = at(values(visibility_margins(scene, WIDE, EYE, objects=["cup"])), 0, 0)
    pixel = 2.0 / WIDE.fx  # on the wall
    visible = is_seen(scene, "wall", 0)
    assert found["blocker"] == 1 and (found["pixels"] > 0) == visible
    assert found["degrees"] * found["pixels"] > 0 and found["meters"] * found["pixels"] > 0
    assert abs(found["pixels"]) == pytest.approx(abs(found["meters"]) / pixel, rel=2e-3)
    # The wall moves to hide a visible cup, and away to reveal a hidden one.
    for offset, flips in ((1.05 * pixel, True), (-1.05 * pixel, False)):
        amount = abs(found["meters"]) + offset
        if amount > 0:
            direction = -1 if visible else 1
            assert (is_seen(scene, "wall", direction * amount) != visible) == flips


@pytest.mark.parametrize("x", [-1.5, -1.62, -1.75, -1.9])
def test_answers_flip_where_the_target_leaves_the_image(device, x):
    """The image border is at x = -1.64 m at the target's depth."""
    scene = walled(3.0, device, target=(x, 0, 3))
    found = at(values(visibility_margins(scene, WIDE, EYE, objects=["cup"])), 0, 0)
    visible = is_seen(scene, "cup", 0)
    assert found["blocker"] == -1 and (found["pixels"] > 0) == visible and abs(found["pixels"]) < 32
    pixel, direction = 3.1 / WIDE.fx, -1 if visible else 1
    for offset, flips in ((1.05 * pixel, True), (-1.05 * pixel, False)):
        amount = abs(found["meters"]) + offset
        if amount > 0:
            assert (is_seen(scene, "cup", direction * amount) != visible) == flips


@pytest.mark.parametrize("shift", [0.3, 0.1, 0.02, -0.02, -0.1])
def test_points_flip_where_the_wall_moves_by_the_margin(device, shift):
    scene = walled(shift, device, size=0.01)
    point = [[0.0, 0.004, 2.995]]  # on the cup
    found = at(values(point_margins(scene, WIDE, EYE, point)), 0, 0)
    visible = wv.point_visibility(scene, WIDE, EYE, point).numpy()[0, 0] == wv.Visibility.VISIBLE
    assert visible == (shift > 0) == (found["pixels"] > 0) and found["blocker"] == 1
    poses, pixel = np.stack([item.pose for item in scene.objects]), 2.0 / WIDE.fx
    for offset, flips in ((1.05 * pixel, True), (-1.05 * pixel, False)):
        moved = poses.copy()
        moved[1, 0] -= math.copysign(abs(found["meters"]) + offset, shift)
        status = wv.point_visibility(scene, WIDE, EYE, point, object_poses=moved).numpy()[0, 0]
        assert ((status == wv.Visibility.VISIBLE) != visible) == flips


def test_signs_are_those_of_visible_fractions(device):
    scene, rng = room(60, 12, device)
    poses = np.stack([wv.look_at(rng.uniform(-1.8, 1.8, 3) + (0, 0, 2), rng.uniform(-0.6, 0.6, 3)) for _ in range(12)])
    pixels = visibility_margins(scene, WIDE, poses).pixels.numpy()
    fraction = wv.visible_fractions(scene, WIDE, poses, caster="rays").fraction.numpy()
    assert np.array_equal(pixels > 0, fraction > 0) and (pixels < 0).sum() > 5


def test_devices_agree_cuda(cuda):
    results = []
    for device in ("cpu", cuda):
        scene, rng = room(61, 12, device)
        poses = [wv.look_at(rng.uniform(-1.8, 1.8, 3) + (0, 0, 2), rng.uniform(-0.6, 0.6, 3)) for _ in range(8)]
        points = rng.uniform(-1, 1, (100, 3))
        found = visibility_margins(scene, WIDE, np.stack(poses)), point_margins(scene, WIDE, np.stack(poses), points)
        results.append([values(one) for one in found])
    for first, second in zip(*results, strict=True):
        differing = ~np.isclose(first["pixels"], second["pixels"], atol=1e-4)
        assert differing.mean() < 0.005  # where surfaces meet
        for name in ("degrees", "meters"):
            assert np.isclose(first[name], second[name], rtol=1e-3).mean() > 0.99
        assert (first["blocker"] == second["blocker"]).mean() > 0.99


def test_worlds_and_exclusions(device):
    scene = walled(-0.15, device)
    poses = np.stack([item.pose for item in scene.objects])
    moved = poses.copy()
    moved[1, 0] += 0.2
    meter = MarginMeter(scene, WIDE, objects={"mug": "cup"})
    assert meter.names == ("mug",)
    hidden, seen = (values(meter.measure(EYE, object_poses=one))["pixels"][0, 0] for one in (poses, moved))
    assert hidden < 0 < seen < 32
    found = values(meter.measure([EYE] * 3, object_poses=np.stack([poses, moved]), world_index=[1, 0, 1]))
    assert np.array_equal(found["pixels"].ravel(), [seen, hidden, seen])
    free = values(meter.measure(EYE, exclude=["wall"]))
    assert free["pixels"] == 32 and free["meters"] == free["degrees"] == np.inf and free["blocker"] == -1
    none = values(meter.measure(EYE, exclude=["cup"]))
    assert all(np.isnan(none[name]).all() for name in FIELDS[:3]) and none["blocker"] == -1
    parts = visibility_margins(scene, WIDE, EYE, objects=[["cup", "wall"]], exclude=["cup"])
    assert parts.pixels.numpy()[0, 0] > 0


def test_cameras_in_worlds_and_scales(device):
    scene = walled(-0.15, device)
    poses = np.stack([item.pose for item in scene.objects])
    moved = poses.copy()
    moved[1, 0] += 0.2
    worlds, eyes = np.stack([poses, moved, poses]), np.tile(EYE, (3, 2, 1)).astype(float)
    eyes[:, 1, 0] = 0.3
    scales = np.ones((3, 2, 3))
    scales[2, 1, 0] = 0.5  # a narrower wall
    options = {"objects": ["cup"], "object_poses": worlds, "object_scales": scales}
    found = values(visibility_margins(scene, WIDE, eyes, **options))
    fraction = wv.visible_fractions(scene, WIDE, eyes, **options).fraction.numpy()
    assert found["pixels"].shape == (3, 2, 1) and np.array_equal(found["pixels"] > 0, fraction > 0)
    assert found["pixels"][0, 0, 0] < 0 < found["pixels"][2, 0, 0]
    one = visibility_margins(scene, WIDE, eyes[2, 1], objects=["cup"], object_poses=poses, object_scales=scales[2])
    assert one.pixels.numpy()[0, 0] == found["pixels"][2, 1, 0]
    points = point_margins(scene, WIDE, eyes, [[0, 0, 2.9]], object_poses=worlds, object_scales=scales).pixels.numpy()
    assert np.array_equal(points[..., 0] > 0, [[False, False], [True, False], [True, True]])


def test_near_plane_and_back_faces(device):
    """A near plane cuts a card away, and its back hides nothing where back faces are culled."""
    scene = walled(3.0, device)
    card = trimesh.Trimesh([[-1, -1, 0], [1, -1, 0], [0, 2, 0]], [[0, 1, 2]])  # its front points along +z
    scene.add(card, name="card", pose=(0, 0, 0.3, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(160, 120, hfov=1.0, near=0.5, far=10)

    def pixels(**options):
        return visibility_margins(scene, camera, EYE, objects=["cup"], **options).pixels.numpy()[0, 0]

    assert pixels() < 0 and pixels(near_plane="clip") == 32 and pixels(cull_backfaces=True) == 32


@pytest.mark.parametrize(
    "place", [(0, 0, -2), (30, 0, 3), (0, 0, 20), (0, 0, 0.15)], ids=["behind", "aside", "too far", "too near"]
)
def test_targets_out_of_reach_are_hidden(device, place):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(2, 0.04), name="ball", pose=(*place, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(40, 30, hfov=1.0, near=0.5, far=10)
    for found in (visibility_margins(scene, camera, EYE, reach=8), point_margins(scene, camera, EYE, [place], reach=8)):
        found = at(values(found), 0, 0)
        assert found == {"pixels": -8, "degrees": -np.inf, "meters": -np.inf, "blocker": -1}


def test_targets_between_samples_have_no_margin(device):
    scene = wv.Scene(device=device)
    wire = trimesh.creation.box((1, 0.0001, 0.0001))
    wire.apply_transform(trimesh.transformations.rotation_matrix(math.radians(17), (0, 0, 1)))
    scene.add(wire, name="wire", pose=(0, 0, 3, 0, 0, 0, 1))
    found = values(visibility_margins(scene, CAMERA, EYE, min_samples=1))
    assert np.isnan(found["pixels"]).all() and found["blocker"] == -1


def test_results_do_not_depend_on_threads_batches_and_casters(monkeypatch):
    scene, rng = room(7, 12)
    poses = np.stack([wv.look_at(rng.uniform(-3, 3, 3), rng.uniform(-0.5, 0.5, 3)) for _ in range(6)])
    expected = values(visibility_margins(scene, WIDE, poses, threads=1))
    several = values(visibility_margins(scene, WIDE, poses, threads=3))
    points = rng.uniform(-1, 1, (50, 3))
    expected_points = values(point_margins(scene, WIDE, poses, points, threads=1))
    from warpvis.visibility import _margins

    monkeypatch.setattr(_margins, "_CPU_BYTES", 2 * 8 * WIDE.width * WIDE.height)
    batches = values(visibility_margins(scene, WIDE, poses, threads=2))
    points = values(point_margins(scene, WIDE, poses, points, threads=3))
    for name, array in expected.items():
        assert np.array_equal(array, several[name], equal_nan=True), name
        assert np.array_equal(array, batches[name], equal_nan=True), name
        assert np.array_equal(expected_points[name], points[name], equal_nan=True), name
    rays = values(visibility_margins(scene, WIDE, poses, caster="rays"))
    assert np.isclose(rays["pixels"], expected["pixels"], equal_nan=True).mean() > 0.98


def test_meters_follow_changes_of_the_scene(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(2, 0.1), name="ball", pose=(0, 0, 2, 0, 0, 0, 1))
    meter = MarginMeter(scene, WIDE, objects=["ball"])
    assert meter.measure(EYE).pixels.numpy()[0, 0] == 32
    scene.add(trimesh.creation.box((0.5, 0.5, 0.01)), name="card", pose=(0, 0, 1, 0, 0, 0, 1))
    assert meter.measure(EYE).pixels.numpy()[0, 0] < 0


def test_no_views_and_no_points(device):
    scene = desk(device)
    assert visibility_margins(scene, CAMERA, np.empty((0, 7))).pixels.shape == (0, len(scene))
    nowhere, in_worlds = np.empty((0, 3), dtype=np.float32), cameras().reshape(2, 2, 7)
    assert point_margins(scene, CAMERA, cameras(), nowhere).meters.numpy().shape == (4, 0)
    assert point_margins(scene, CAMERA, in_worlds, nowhere).blocker.numpy().shape == (2, 2, 0)
    assert visibility_margins(scene, CAMERA, np.empty((0, 2, 7))).degrees.numpy().shape == (0, 2, len(scene))


def test_cuda_graphs_replay_with_new_poses(cuda):
    scene = desk(cuda)
    meter = MarginMeter(scene, CAMERA, objects=["ball", "cart"])
    poses = wp.array(cameras(), dtype=wp.transform, device=cuda)
    meter.measure(poses)
    with wp.ScopedCapture(cuda) as capture:
        found = meter.measure(poses)
    others = cameras()[::-1].copy()
    poses.assign(others)
    wp.capture_launch(capture.graph)
    assert np.array_equal(found.pixels.numpy(), meter.measure(others).pixels.numpy())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"objects": []}, "objects must be one or more objects of the scene, got none"),
        ({"reach": 0}, "reach must be a number from 1 to 1024, got 0"),
        ({"reach": 5000}, "reach must be a number from 1 to 1024, got 5000"),
        ({"min_samples": 0}, "min_samples must be"),
        ({"threads": 0}, "threads must be"),
        ({"near_plane": "cut"}, "near_plane must be"),
        ({"exclude": ["bal"]}, "bal"),
    ],
)
def test_invalid_input_is_one_sentence(options, message):
    with pytest.raises(WarpvisError, match=message):
        visibility_margins(desk(), CAMERA, cameras(), **options)


def test_invalid_cameras_and_points_are_refused():
    lens = wv.cameras.LensCamera(wv.cameras.lenses.KannalaBrandt(20, 20, 20, 15), 40, 30)
    calls = (
        lambda camera: visibility_margins(desk(), camera, EYE),
        lambda camera: point_margins(desk(), camera, EYE, [[0, 0, 1]]),
    )
    for call in calls:
        with pytest.raises(WarpvisError, match=r"camera must be a warpvis\.Camera, got LensCamera"):
            call(lens)
        with pytest.raises(WarpvisError, match="camera must have at most 268435456 pixels with `reach` on all sides"):
            call(wv.Camera(16384, 16384, 9000, 9000, 8192, 8192))
    with pytest.raises(WarpvisError, match="points must be finite"):
        point_margins(desk(), CAMERA, EYE, [[0, 0, math.nan]])
