# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Voxel maps and plan visibility through lenses, compared with a reference, a pinhole camera, and geometry."""

import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Label
from warpvis.cameras import LensCamera, lenses
from warpvis.errors import PoseError
from warpvis.maps import Voxel, _voxel_views, plan_visibility, voxel_map, voxel_map_from_scene

from support.voxels import BOUNDS, BOX_BACK, BOX_FRONT, POSES, assert_matches_twin, at, build, same

BARREL = lenses.OpenCVPinhole(132, 130, 81, 58, (-0.25, 0.05, 0.003, -0.002))
FISHEYE = lenses.KannalaBrandt(50, 50, 80, 60, (0.02, 0, 0, 0))
TURNS = lenses.OpenCVPinhole(80, 80, 80, 60, (-0.35, 0, 0, 0))


def of_corners_without_rays():
    with pytest.warns(wv.errors.IntrinsicsWarning, match="have no ray"):
        return LensCamera(TURNS, 160, 120, near=0.3, far=3.5)


CAMERAS = {
    "z": lambda: LensCamera(BARREL, 160, 120, near=0.3, far=3.5),
    "range": lambda: LensCamera(BARREL, 160, 120, near=0.3, far=3.5, kind="range"),
    "more than a hemisphere": lambda: LensCamera(FISHEYE, 160, 120, near=0.3, far=3.5),
    "corners without rays": of_corners_without_rays,
}


@pytest.mark.smoke("*-z")
@pytest.mark.parametrize("name", CAMERAS)
def test_voxel_maps_match_reference(name, device):
    scene, camera = build(device), CAMERAS[name]()
    views = wv.render(scene, camera, POSES, outputs=("depth", "labels"))
    result = voxel_map(views.depth, camera, POSES, bounds=BOUNDS, labels=views.labels)
    states, labels = assert_matches_twin(result, views.depth.numpy(), views.labels.numpy(), POSES, camera)
    seen_by_all = {Voxel.UNKNOWN} if name == "more than a hemisphere" else set()
    assert set(np.unique(states)) == set(Voxel) - seen_by_all
    assert set(np.unique(labels)) == {Label.EMPTY, Label.GROUND, Label.OBSTACLE, Label.OBJECT}
    assert same(voxel_map_from_scene(scene, camera, POSES, bounds=BOUNDS), result)


def test_depth_images_with_holes_match_reference(device):
    rng, camera = np.random.default_rng(0), CAMERAS["range"]()
    depth = wv.render(build(device), camera, POSES, outputs="depth").depth.numpy()
    for value in (np.nan, 0.0, -1.0, 0.1, 9.0, -np.inf):
        depth[rng.random(depth.shape) < 0.08] = value
    result = voxel_map(depth, camera, POSES, bounds=BOUNDS, device=device)
    states, _ = assert_matches_twin(result, depth, None, POSES, camera)
    assert set(np.unique(states)) == set(Voxel)


@pytest.mark.parametrize("name", ["z", "range", "more than a hemisphere"])
def test_voxel_states_match_geometry(name, device):
    result = voxel_map_from_scene(build(device), CAMERAS[name](), POSES[0], bounds=BOUNDS)
    assert at(result, (BOX_FRONT, 0.0, 0.2)) == (Voxel.SURFACE, Label.OBSTACLE)
    assert at(result, (BOX_FRONT - 0.1, 0.0, 0.2)) == (Voxel.FREE, Label.EMPTY)
    assert at(result, (BOX_FRONT + 0.1, 0.0, 0.2)) == (Voxel.HIDDEN, Label.EMPTY)  # inside
    assert at(result, (BOX_BACK + 0.1, 0.0, 0.1)) == (Voxel.HIDDEN, Label.EMPTY)  # behind
    assert at(result, (BOX_BACK + 0.1, 0.0, 0.7)) == (Voxel.FREE, Label.EMPTY)  # above it
    assert at(result, (-0.3 - 0.14, 0.4, 0.15)) == (Voxel.SURFACE, Label.OBJECT)
    assert at(result, (-1.5, 0.0, 0.8)) == (Voxel.UNKNOWN, Label.EMPTY)  # nearer than `near`, or behind


def test_undistorted_lens_matches_pinhole(device):
    scene, lens = build(device), LensCamera(lenses.OpenCVPinhole(130, 128, 80, 60), 160, 120, near=0.3, far=3.5)
    pinhole = wv.Camera(160, 120, 130, 128, 80, 60, 0.3, 3.5)
    views = wv.render(scene, pinhole, POSES, outputs=("depth", "labels"))
    first, second = (
        voxel_map(views.depth, camera, POSES, bounds=BOUNDS, labels=views.labels) for camera in (pinhole, lens)
    )
    for name in ("states", "labels"):
        # Voxel centers on pixel borders, and points on voxel borders, may differ.
        assert (getattr(first, name).numpy() != getattr(second, name).numpy()).sum() <= 5


@pytest.mark.slow
def test_chunks_and_threads_do_not_change_maps(monkeypatch, device):
    scene, camera = build(device), CAMERAS["range"]()
    views = wv.render(scene, camera, POSES, outputs=("depth", "labels"))
    arguments = (views.depth, camera, POSES)
    options = {"bounds": BOUNDS, "labels": views.labels}
    whole = voxel_map(*arguments, **options, threads=1)
    assert same(voxel_map(*arguments, **options, threads=3), whole)
    for at_once in (48 * 25 * 10, 1):  # ten layers of 57, or one
        monkeypatch.setattr(_voxel_views, "_AT_ONCE", at_once)
        assert same(voxel_map(*arguments, **options), whole)
    added = voxel_map(views.depth.numpy()[:1], camera, POSES[:1], bounds=BOUNDS, labels=views.labels.numpy()[:1])
    if device == "cpu":
        rest = views.depth.numpy()[1:], camera, POSES[1:]
        assert same(voxel_map(*rest, bounds=BOUNDS, labels=views.labels.numpy()[1:], out=added), whole)


def test_pixels_without_rays_do_not_free_voxels(device):
    """In an empty image, voxels are free except where the pixel has no ray."""
    camera = of_corners_without_rays()
    depth = np.full((120, 160), np.inf, dtype=np.float32)
    pose = [0, 0, 0, 0, 0, 0, 1]
    result = voxel_map(depth, camera, pose, bounds=((-2, -2, 0.8), (2, 2, 1.2)), cell_size=0.02, device=device)
    states = result.states.numpy().ravel()
    pixels = camera.project(result.centers().reshape(-1, 3))
    with np.errstate(invalid="ignore"):
        inside = ((pixels >= 0) & (pixels < (160, 120))).all(axis=1)
    shown = inside.copy()
    shown[inside] = ~camera.mask[tuple(pixels[inside].astype(int).T[::-1])]
    assert (inside & ~shown).sum() > 10
    np.testing.assert_array_equal(states == Voxel.FREE, shown)


def posts(*places):
    scene = wv.Scene()
    for number, (x, y) in enumerate(places):
        scene.add(trimesh.creation.cylinder(radius=0.2, height=1), name=f"post {number}", pose=(x, y, 0.5, 0, 0, 0, 1))
    return scene


def test_plan_visibility_of_undistorted_lens_matches_pinhole():
    scene = posts((2, 0), (3, 0.5), (2.5, -1), (0, 2), (-2, 0))
    poses = [wv.look_at((0, 0, height), (3, 0.2, 0.5)) for height in (0.5, 1.5)]
    pinhole = wv.Camera(160, 120, 130, 128, 70, 60, far=2.9)
    lens = LensCamera(lenses.OpenCVPinhole(130, 128, 70, 60), 160, 120, far=2.9)
    expected, found = (plan_visibility(scene, camera, poses) for camera in (pinhole, lens))
    np.testing.assert_array_equal(found.unoccluded, expected.unoccluded)
    np.testing.assert_array_equal(found.first, expected.first)
    assert expected.visible[0].tolist() == [True, True, True, False, False]


def test_plan_visibility_of_fisheye():
    """The lens covers 87 degrees to either side; ranges are measured along the lines."""
    scene = posts((2, 0), (0, 2), (0.6, -4), (-2, 0), (4, 0))
    pose = wv.look_at((0, 0, 0.5), (1, 0, 0.5))
    seen = plan_visibility(scene, LensCamera(FISHEYE, 160, 120, far=3.0), pose)
    assert seen.visible[0].tolist() == [True, True, False, False, False]  # the third is too far, the last one occluded
    seen = plan_visibility(scene, LensCamera(FISHEYE, 160, 120, far=4.5), pose)
    assert seen.visible[0].tolist() == [True, True, True, False, False] and seen.unoccluded[0, 4] > 0
    # A column's line is the ray of its pixel: a post of half-angle a spans 2 fx theta(a) columns of an ideal fisheye.
    ideal = LensCamera(lenses.KannalaBrandt(50, 50, 80, 60, (0, 0, 0, 0)), 160, 120, far=3.0)
    half = 50 * math.asin(0.2 / 2)
    expected = [2 * half, half + 80 - 50 * math.pi / 2]  # the image ends within the second post
    np.testing.assert_allclose(plan_visibility(scene, ideal, pose).unoccluded[0, :2], expected, atol=1.1)
    with pytest.raises(PoseError, match="must not look straight up or down"):
        plan_visibility(scene, ideal, [0, 0, 1, 0, 0, 0, 1])


def test_columns_without_rays_have_no_line():
    with pytest.warns(wv.errors.IntrinsicsWarning, match="have no ray"):
        camera = LensCamera(TURNS, 600, 120)
    around = posts(*[(2 * math.cos(a), 2 * math.sin(a)) for a in np.linspace(-1.5, 1.5, 60)])
    seen = plan_visibility(around, camera, wv.look_at((0, 0, 0.5), (1, 0, 0.5)))
    with_ray = np.isfinite(camera.unproject(np.stack([np.arange(600) + 0.5, np.full(600, 60.0)], axis=1))).all(axis=1)
    assert 0 < seen.first.sum() <= with_ray.sum() < 600
