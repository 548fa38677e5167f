# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visibility, back-projection and classification through lenses, compared with a float64 reference and OpenCV."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.cameras import LensCamera, lenses
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import CameraError
from warpvis.pose_generators import framing
from warpvis.visibility import BOP_DELTA, object_visibility

import reference
from support.lens_camera import PINHOLE, PLUMB_BOB, SMALL, STRAIGHT, WIDE
from support.object_visibility import COUNTS, cameras, desk

CAMERAS = {
    "z": LensCamera(SMALL, 64, 48, near=0.6, far=3.2),
    "range": LensCamera(SMALL, 64, 48, near=0.6, far=3.2, kind="range"),
    "wide": LensCamera(WIDE, 64, 48, near=0.6, far=3.2),
}
UNBENT = LensCamera(lenses.OpenCVPinhole(52, 50, 32, 24), 64, 48)
V = wv.Visibility


def in_camera(pose, points):
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float32))
    return (points - matrix[:3, 3]) @ matrix[:3, :3]


def judged(camera, at, depth, margin):
    """Return the status of points from image position, depth, and signed distance behind the surface."""
    status = np.where(margin > 0, V.OCCLUDED, V.VISIBLE)
    status = np.where(depth > camera.far, V.TOO_FAR, np.where(depth < camera.near, V.TOO_NEAR, status))
    with np.errstate(invalid="ignore"):
        inside = (at >= 0).all(axis=1) & (at < (camera.width, camera.height)).all(axis=1)
    return np.where(inside, status, V.OUT_OF_VIEW)


def placed(camera, pose, points):
    """Return the image positions of points, their depths, and rays of depth 1 to them."""
    seen = in_camera(pose, points)
    depth = seen[:, 2] if camera.kind == "z" else np.linalg.norm(seen, axis=1)
    return camera.lens.project(seen), depth, seen / depth[:, None]


@pytest.mark.parametrize("kind", CAMERAS)
def test_point_visibility_matches_reference(kind, device):
    scene, poses, camera = desk(device), cameras(), CAMERAS[kind]
    rng = np.random.default_rng(3)
    points = rng.uniform((-2, -2, -0.5), (2.5, 2, 1.5), (400, 3)).astype(np.float32)
    status, occluders = wv.point_visibility(scene, camera, poses, points, occluders=True)
    alone = wv.point_visibility(scene, camera, poses, points)
    np.testing.assert_array_equal(alone.numpy(), status.numpy())
    several = set()
    for view, pose in enumerate(poses):
        at, depth, rays = placed(camera, pose, points.astype(np.float64))
        shown = reference.cast_ray_table(scene, np.where(np.isfinite(at[:, :1]), rays, np.nan)[None], pose)
        margin = (depth - shown.depth[0]) * np.linalg.norm(rays, axis=1) - 1e-4
        expected = judged(camera, at, depth, margin)
        sure = np.abs(margin) > 1e-5
        assert (status.numpy()[view] != expected)[sure].sum() == 0
        hidden = sure & (expected == V.OCCLUDED)
        np.testing.assert_array_equal(occluders.numpy()[view][hidden], shown.objects[0][hidden])
        assert (occluders.numpy()[view][expected != V.OCCLUDED] == -1).all()
        several |= set(expected.tolist())
    assert several == {V.OUT_OF_VIEW, V.TOO_NEAR, V.TOO_FAR, V.OCCLUDED, V.VISIBLE}


@pytest.mark.parametrize("kind", CAMERAS)
def test_point_visibility_from_depth_matches_reference(kind, device):
    scene, poses, camera = desk(device), cameras(), CAMERAS[kind]
    depth = wv.render(scene, camera, poses, outputs="depth").depth.numpy().copy()
    depth[0, ::3] = np.nan
    points = np.random.default_rng(4).uniform((-2, -2, -0.5), (2.5, 2, 1.5), (500, 3)).astype(np.float32)
    status = wv.point_visibility_from_depth(depth, camera, poses, points, tolerance=0.02, device=device).numpy()
    several = set()
    for view, pose in enumerate(poses):
        at, far_away, rays = placed(camera, pose, points.astype(np.float64))
        inside = judged(camera, at, np.full(len(at), 1.0), np.zeros(len(at))) != V.OUT_OF_VIEW
        x, y = np.where(inside[:, None], at, 0).astype(int).T
        surface = depth[view][y, x]
        with np.errstate(invalid="ignore"):
            expected = judged(camera, at, far_away, (far_away - surface) * np.linalg.norm(rays, axis=1) - 0.02)
        in_range = (expected == V.VISIBLE) | (expected == V.OCCLUDED)
        expected = np.where(in_range & np.isnan(surface), V.UNKNOWN, expected)
        np.testing.assert_array_equal(status[view], expected)
        several |= set(expected.tolist())
    assert len(several) == 6


def test_point_visibility_matches_opencv_projection():
    """Points around the camera are visible exactly if cv2.projectPoints places them inside the image."""
    cv2 = pytest.importorskip("cv2")
    scene = wv.Scene()
    scene.add(wv.scene.solids.sphere(0.001), name="speck", pose=(50, 50, 50, 0, 0, 0, 1))
    points = np.random.default_rng(5).normal(size=(2000, 3))
    points = points[points[:, 2] > 0.4 * np.linalg.norm(points, axis=1)].astype(np.float32)
    camera = LensCamera(SMALL, 64, 48)
    status = wv.point_visibility(scene, camera, STRAIGHT, points).numpy()[0]
    matrix = np.array([[52.0, 0, 31.5], [0, 50, 23.5], [0, 0, 1]])
    at = cv2.projectPoints(points.astype(np.float64), np.zeros(3), np.zeros(3), matrix, np.array(PLUMB_BOB))[0][:, 0]
    inside = ((at >= -0.5) & (at < (63.5, 47.5))).all(axis=1)
    assert 100 < inside.sum() < len(points) - 100
    np.testing.assert_array_equal(status == V.VISIBLE, inside)
    pinhole = wv.point_visibility(scene, PINHOLE, STRAIGHT, points).numpy()[0]
    assert (pinhole != status).sum() > 20  # a pinhole would silently be wrong


@pytest.mark.parametrize("kind", CAMERAS)
def test_back_projection_matches_rendered_points(kind, device):
    scene, poses, camera = desk(device), cameras(), CAMERAS[kind]
    views = wv.render(scene, camera, poses, outputs=("depth", "points"))
    points = wv.back_project(views.depth, camera, poses).numpy()
    np.testing.assert_allclose(points, views.points.numpy(), atol=2e-6)
    depth = views.depth.numpy().copy()
    depth[:, 0], depth[:, 1], depth[:, 2], depth[:, 3] = 0.5, 3.5, 0.0, np.nan
    points = wv.back_project(depth, camera, poses, device=device).numpy()
    assert np.isnan(points[:, :4]).all()
    expected = np.array([reference.back_project_rays(camera, *given) for given in zip(poses, depth, strict=True)])
    np.testing.assert_allclose(points, expected, atol=2e-6)


@pytest.mark.parametrize("kind", CAMERAS)
def test_classify_matches_reference(kind, device):
    scene, poses, camera = desk(device), cameras(), CAMERAS[kind]
    depth = wv.render(scene, camera, poses, outputs="depth").depth.numpy()
    spheres = (wv.maps.Sphere((1.6, 0, 0.3), 0.65), wv.maps.Sphere((0.6, -0.4, 0.5), 0.9, wv.Label.HUMAN))
    places = np.empty(depth.shape, dtype=np.int32)
    import warp as wp

    out = wp.array(places, dtype=wp.int32, device=device)
    labels = wv.classify(depth, camera, poses, spheres=spheres, device=device, max_range=3.0, spheres_out=out)
    for view, pose in enumerate(poses):
        expected, sphere, margin = reference.classify_rays(camera, pose, depth[view], spheres, max_range=3.0)
        sure = margin > 1e-5
        np.testing.assert_array_equal(labels.numpy()[view][sure], expected[sure])
        np.testing.assert_array_equal(out.numpy()[view][sure], sphere[sure])
    assert len(np.unique(labels.numpy())) == 5


def test_pixels_without_rays_have_no_points_or_labels(device):
    with pytest.warns(wv.errors.IntrinsicsWarning):
        camera = LensCamera(lenses.OpenCVPinhole(52, 50, 32, 24, (-0.9, 0, 0.001, 0)), 64, 48)
    depth = np.ones((1, 48, 64), dtype=np.float32)
    points = wv.back_project(depth, camera, STRAIGHT, device=device).numpy()[0]
    np.testing.assert_array_equal(np.isnan(points[..., 0]), camera.mask)
    labels = wv.classify(depth, camera, STRAIGHT, device=device).numpy()[0]
    np.testing.assert_array_equal(labels == wv.Label.EMPTY, camera.mask)


@pytest.mark.smoke("*-0.015-wide", "*-0.0-z")
@pytest.mark.parametrize("kind", ["z", "wide"])
@pytest.mark.parametrize("delta", [0.0, BOP_DELTA])
def test_object_visibility_matches_bop_reference(kind, delta, device):
    """Each object alone is rendered on a canvas of the same lens; counts agree within one pixel per object."""
    scene, poses, camera = desk(device), cameras()[1:3], CAMERAS[kind]
    lens = replace(camera.lens, fx=camera.lens.fx / 2, fy=camera.lens.fy / 2, cx=14, cy=11)
    camera, canvas = replace(camera, lens=lens, width=28, height=22), (28, 22, 28, 22)
    result = object_visibility(scene, camera, poses, delta=delta, masks=True)
    unseen = object_visibility(scene, camera, poses, delta=delta, skip_unseen=True)
    several = set()
    for view, pose in enumerate(poses):
        for index in range(len(scene)):
            masks = reference.measure_silhouettes_rays(scene, camera, pose, index, canvas=canvas, delta=delta)
            expected = reference.judge_silhouettes(masks, canvas, 1)
            for name in COUNTS:
                assert abs(int(getattr(result, name).numpy()[view, index]) - expected[name]) <= 1, (name, view, index)
            assert result.status.numpy()[view, index] == expected["status"], (view, scene.objects[index].name)
            assert result.occluder.numpy()[view, index] == expected["occluder"]
            for name in ("visible_box", "silhouette_box"):
                assert np.abs(getattr(result, name).numpy()[view, index] - expected[name]).max() <= 1
            mask = masks["silhouette"] + masks["visible"].astype(np.uint8)
            assert (result.masks.numpy()[view, index] != mask).sum() <= 1
            several.add(expected["status"])
    assert len(several) >= 2
    np.testing.assert_array_equal(unseen.fraction.numpy(), result.fraction.numpy())


def test_zero_distortion_matches_pinhole(device):
    scene, poses = desk(device), cameras()
    found, expected = (object_visibility(scene, eye, poses, caster="rays") for eye in (UNBENT, PINHOLE))
    for name in (*COUNTS, "status", "occluder", "silhouette_box"):
        np.testing.assert_array_equal(getattr(found, name).numpy(), getattr(expected, name).numpy())
    agents = {
        eye: [
            wv.Agent("robot", eye, poses[0], attention=eye),
            wv.Agent.human("human", wv.look_at((3, 0, 1.6), (1, 0, 0.3)), resolution=30),
        ]
        for eye in (UNBENT, PINHOLE)
    }
    tables = [str(wv.perspective(scene, agents[eye]).table()) for eye in (UNBENT, PINHOLE)]
    assert tables[0] == tables[1]


def test_worlds_and_excluded_objects(device):
    scene = wv.Scene(device=device)
    scene.add(wv.scene.solids.sphere(0.2), name="ball", movable=True)
    scene.add(trimesh.creation.box((1, 1, 0.1)), name="screen", pose=(0, 0, 1, 0, 0, 0, 1))
    camera = LensCamera(SMALL, 64, 48)
    worlds = {"object_poses": [[[0, 0, 2, 0, 0, 0, 1]], [[0, 0, 0.6, 0, 0, 0, 1]]]}
    poses = np.stack([STRAIGHT] * 2)
    seen = object_visibility(scene, camera, poses, objects=["ball"], **worlds)
    np.testing.assert_array_equal(seen.status.numpy()[:, 0], [V.OCCLUDED, V.VISIBLE])
    alone = object_visibility(scene, camera, poses, objects=["ball"], exclude=["screen"], **worlds)
    np.testing.assert_allclose(alone.fraction.numpy(), 1)
    points = [[0.0, 0, 1.8], [0, 0, 0.4]]
    status = wv.point_visibility(scene, camera, poses, points, tolerance=1e-3, **worlds).numpy()
    np.testing.assert_array_equal(status, [[V.OCCLUDED, V.VISIBLE], [V.OCCLUDED, V.VISIBLE]])
    status = wv.point_visibility(scene, camera, poses, points, tolerance=1e-3, exclude=["screen"], **worlds).numpy()
    np.testing.assert_array_equal(status, [[V.VISIBLE, V.VISIBLE], [V.OCCLUDED, V.VISIBLE]])


def test_chunked_points_match_single_pass(monkeypatch):
    from warpvis.visibility import _points

    scene, poses, camera = desk(), cameras(), CAMERAS["z"]
    points = np.random.default_rng(6).uniform(-1, 2, (70, 3))
    whole = wv.point_visibility(scene, camera, poses, points).numpy()
    for most in (33, 150):
        monkeypatch.setattr(_points, "_MAX_BATCH", most)
        np.testing.assert_array_equal(wv.point_visibility(scene, camera, poses, points).numpy(), whole)
    assert wv.point_visibility(scene, camera, poses, np.empty((0, 3))).shape == (4, 0)


@pytest.mark.parametrize("kind", CAMERAS)
def test_framing_contains_scene_bounds(kind):
    scene, camera = desk(), CAMERAS[kind]
    pose = framing(scene, camera)
    low, high = scene.bounds.astype(np.float64)
    corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
    at = camera.project(in_camera(pose, corners))
    assert ((at >= 0) & (at <= (64, 48))).all()
    near = np.array(pose)
    near[:3] += 0.5 * (scene.bounds.mean(axis=0) - near[:3])
    assert not ((camera.project(in_camera(near, corners)) >= 0).all() and kind == "z")
    aside = LensCamera(lenses.OpenCVPinhole(52, 50, -10, 24, PLUMB_BOB), 64, 48)
    with pytest.raises(CameraError, match="camera must have its optical axis inside the image, to frame a scene"):
        framing(scene, aside)


def test_planning_supports_lens_cameras():
    scene = desk()
    candidates = np.concatenate([cameras(), [wv.look_at((5, 5, 1), (9, 9, 1))]])
    best = wv.planning.best_views(scene, CAMERAS["z"], candidates, objects=["ball"])
    seen = object_visibility(scene, CAMERAS["z"], candidates, objects=["ball"]).fraction.numpy()[:, 0]
    assert best.order[0] == seen.argmax() and seen.max() > 0
    samples = wv.planning.surface_samples(scene, spacing=0.3)
    found = wv.planning.coverage(scene, CAMERAS["wide"], candidates, samples=samples, tolerance=1e-3).seen
    expected = wv.point_visibility(scene, CAMERAS["wide"], candidates, samples.points, tolerance=1e-3).numpy()
    np.testing.assert_array_equal(found, expected == V.VISIBLE)
    assert 0 < found.mean() < 1


def test_pinhole_only_functions_reject_lens_cameras():
    depth, objects = np.ones((48, 64)), np.zeros((48, 64), dtype=int)
    with pytest.raises(CameraError, match=r"must be a pinhole here, a warpvis\.Camera, got a LensCamera: rendering"):
        wv.viz.view_from_outside(desk(), wv.Camera.kinect(), STRAIGHT, CAMERAS["z"], STRAIGHT, depth, objects)


def test_invalid_cameras_and_casters_are_rejected():
    scene = desk()
    for call in (wv.point_visibility, lambda *given: wv.object_visibility(*given[:3])):
        with pytest.raises(CameraError, match=r"camera must be a warpvis\.Camera or a .*LensCamera, got str"):
            call(scene, "kinect", STRAIGHT, [[0.0, 0, 1]])
    for caster in ("packets", "rays"):
        wv.point_visibility(scene, CAMERAS["z"], STRAIGHT, [[0.0, 0, 1]], caster=caster)
    with pytest.raises(wv.errors.ArrayError, match='caster must be "auto", "packets" or "rays", got \'fast\''):
        wv.point_visibility(scene, CAMERAS["z"], STRAIGHT, [[0.0, 0, 1]], caster="fast")


def test_point_beyond_90_degrees_is_visible():
    """A fisheye sees a point 100 degrees from the axis, at its range."""
    scene, camera = desk(), LensCamera(WIDE, 64, 48)
    angle = math.radians(100)
    point = 0.4 * np.array([math.sin(angle), 0, math.cos(angle)])
    assert camera.kind == "range"
    eye = (*wv.look_at((-2, 0, 1.0), (1, 0, 0.3))[:3], 0, 0, 0, 1)
    status = wv.point_visibility(scene, camera, eye, [point + eye[:3]]).numpy()[0, 0]
    assert status == (V.VISIBLE if (camera.project(point) < (64, 48)).all() else V.OUT_OF_VIEW)
