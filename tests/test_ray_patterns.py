# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of ray patterns: closed forms, the float64 reference, MuJoCo's rays, axes, and errors."""

import pickle

import mujoco
import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.cameras import LensCamera, Rays, lenses
from warpvis.errors import CameraError

from support.ray_patterns import assert_matches_reference, few_origins, sphere_of_rays
from support.solids import build as build_solids
from support.worlds import ALL, assert_bits_equal, build, random_poses

STRAIGHT = np.array([0, 0, 0, 0, 0, 0, 1.0])
FROM_BODY = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0.0]])  # OpenCV's axes from x forward, y left, z up


def test_box_from_inside_matches_closed_form(device):
    """With an origin per ray, far from the world's origin."""
    scene, away = wv.Scene(device=device), np.array([500.0, -300.0, 20.0])
    scene.add(trimesh.creation.box((4, 6, 8)), name="box", pose=(*away, 0, 0, 0, 1))
    directions, origins = sphere_of_rays(2000), np.random.default_rng(2).uniform(-0.5, 0.5, (2000, 3))
    views = wv.render(scene, Rays(directions, origins), [*away, 0, 0, 0, 1], outputs=ALL)
    expected = np.where(directions > 0, [2, 3, 4] - origins, [-2, -3, -4] - origins) / directions
    assert views.depth.shape == (1, 2000)
    np.testing.assert_allclose(views.depth.numpy()[0], expected.min(axis=-1), atol=1e-5)
    points = origins + expected.min(axis=-1)[:, None] * directions
    np.testing.assert_allclose(views.points.numpy()[0] - away, points, atol=5e-5)  # 500 m in single precision


def test_sphere_from_inside_matches_closed_form(device):
    """Triangles of a finely tessellated ball are within its sagitta of the sphere."""
    scene = wv.Scene(device=device)
    ball = trimesh.creation.icosphere(subdivisions=5, radius=3.0)
    scene.add(ball, name="ball")
    directions, start = sphere_of_rays(500), np.array([0.4, -0.3, 0.2])
    depth = wv.render(scene, Rays(directions, np.tile(start, (500, 1))), STRAIGHT).depth.numpy()[0]
    along = directions @ start
    expected = -along + np.sqrt(along**2 - start @ start + 9)
    sagitta = 3 - np.linalg.norm(ball.triangles_center, axis=-1).min()
    assert (depth <= expected + 1e-6).all() and (depth >= expected - 1.1 * sagitta).all()


@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_distinct_origins_match_reference(cull_backfaces, device):
    rng = np.random.default_rng(0)
    meshes = [trimesh.creation.box((0.5, 0.3, 0.7)), trimesh.creation.icosphere(subdivisions=1, radius=0.3)]
    scene = build_solids(device, random_poses(rng, 10, spread=2.0), extra=meshes)
    poses = random_poses(rng, 2, spread=0.3)
    shape = (24, 40, 3)
    pattern = Rays(
        sphere_of_rays(960).reshape(shape), few_origins(960, 0.2).reshape(shape), near=0.4, far=2.0, axes="ros_body"
    )
    views = wv.render(scene, pattern, poses, outputs=ALL, cull_backfaces=cull_backfaces)
    assert views.depth.shape == (2, 24, 40) and np.isneginf(views.depth.numpy()).any()
    assert_matches_reference(views, scene, poses, pattern, cull_backfaces=cull_backfaces)


@pytest.mark.parametrize("caster", ["auto", "rays"])
def test_common_origin_matches_reference(caster, device):
    scene = wv.scenes.PRESETS["room"].build(device)
    poses = np.array([wv.look_at(eye, (0.5, 0.4, 0.3)) for eye in ((0.1, 0.2, 0.9), (-0.8, 1.2, 1.5))])
    pattern = Rays(sphere_of_rays(1200).reshape(30, 40, 3), near=0.8, far=2.0, axes="ros_body")
    views = wv.render(scene, pattern, poses, caster=caster, outputs=ALL)
    assert np.isneginf(views.depth.numpy()).any() and np.isposinf(views.depth.numpy()).any()
    assert_matches_reference(views, scene, poses, pattern)


def test_flat_pattern_equals_one_row_image(device):
    scene = wv.scenes.PRESETS["room"].build(device)
    poses = [wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3)), wv.look_at((-0.8, 1.2, 1.5), (0.5, 0.4, 0.3))]
    directions = sphere_of_rays(300)
    flat = wv.render(scene, Rays(directions, far=1.5), poses, outputs=ALL, fill=0.0)
    row = wv.render(scene, Rays(directions[None], far=1.5), poses, outputs=ALL, fill=0.0)
    assert (flat.depth.numpy() == 0).any()
    for name in ALL:
        np.testing.assert_array_equal(getattr(flat, name).numpy(), getattr(row, name).numpy()[:, 0])
    renderer = wv.Renderer(scene, Rays(directions, far=1.5), outputs=ALL, fill=0.0)
    assert renderer.render(poses, out=flat) is flat
    assert_bits_equal(flat, renderer.render(poses, out=flat))


def test_camera_rays_as_pattern_match_camera(device):
    """Depths of both kinds are equal up to the rounding of normalized directions."""
    scene, pose = wv.scenes.PRESETS["room"].build(device), wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))
    lens = lenses.OpenCVPinhole(52, 50, 32, 24, (-0.1, 0.02, 0, 0))
    for kind in ("z", "range"):
        camera = LensCamera(lens, 64, 48, kind=kind, near=0.2, far=4.0)
        pattern = Rays(camera.directions, kind=kind, near=0.2, far=4.0)
        first, second = (wv.render(scene, given, pose, outputs=ALL) for given in (camera, pattern))
        np.testing.assert_allclose(first.depth.numpy(), second.depth.numpy(), rtol=2e-7)
        np.testing.assert_array_equal(first.segmentation.numpy(), second.segmentation.numpy())


def test_poses_are_of_the_pattern_frame(device):
    """By default, whatever its axes; `convention` names the axes of poses of another frame."""
    scene = wv.scenes.PRESETS["room"].build(device)
    body = np.array([0.1, 0.2, 0.9, 0.1, -0.2, 0.3, 0.9])
    body[3:] /= np.linalg.norm(body[3:])
    directions, origins = sphere_of_rays(400), few_origins(400)
    lidar = Rays(directions, origins, axes="ros_body")
    seen = wv.render(scene, lidar, body, outputs=ALL)
    assert_bits_equal(seen, wv.render(scene, Rays(directions, origins), body, outputs=ALL))
    assert_bits_equal(seen, wv.render(scene, lidar, body, convention="ros_body", outputs=ALL))
    optical = wv.core.poses.poses_to_opencv(body, "ros_body")
    of_optical = Rays(directions @ FROM_BODY.T, origins @ FROM_BODY.T)
    for pattern, poses, convention in (
        (lidar, optical, "opencv"),
        (of_optical, optical, None),
        (of_optical, body, "ros_body"),
    ):
        other = wv.render(scene, pattern, poses, convention=convention, outputs=ALL)
        np.testing.assert_allclose(other.depth.numpy(), seen.depth.numpy(), atol=2e-5)
        np.testing.assert_allclose(other.points.numpy(), seen.points.numpy(), atol=2e-5)
    on_device = wv.core.poses.parse_poses(optical, device=device)
    there = wv.render(scene, lidar, on_device, convention="opencv", outputs=ALL)
    np.testing.assert_allclose(there.depth.numpy(), seen.depth.numpy(), atol=2e-5)


def test_object_poses_and_exclude(device):
    rows = np.stack([random_poses(np.random.default_rng(seed), 5, spread=1.5) for seed in (0, 1)])
    scene = build(device, rows[0], movable=True)
    pattern, poses = Rays(sphere_of_rays(600), few_origins(600)), random_poses(np.random.default_rng(3), 2, spread=0.3)
    both = wv.render(scene, pattern, poses, object_poses=rows, world_index=[1, 0], outputs=ALL)
    for view, world in enumerate((1, 0)):
        alone = wv.render(scene, pattern, poses[view], object_poses=rows[world], outputs=ALL)
        for name in ALL:
            np.testing.assert_array_equal(getattr(alone, name).numpy()[0], getattr(both, name).numpy()[view])
    names = [scene.objects[index].name for index in np.unique(both.segmentation.numpy()) if index >= 0]
    hidden = wv.render(scene, pattern, poses, object_poses=rows, world_index=[1, 0], exclude=names[:1], outputs=ALL)
    index = [item.name for item in scene.objects].index(names[0])
    assert (both.segmentation.numpy() == index).any()
    assert not (hidden.segmentation.numpy() == index).any()


def test_depth_matches_mj_ray(device):
    """`mj_ray` casts in double precision."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
          <geom type="plane" size="5 5 .1"/><geom type="box" size=".3 .2 .4" pos="1 .2 .4" euler="10 20 30"/>
          <geom type="box" size=".1 2 .5" pos="-1.5 0 .5" euler="0 0 15"/>
          <geom type="box" size="2 .1 .5" pos="0 -2 .4"/>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = wv.mujoco.scene_from_mujoco(model, device=device).scene
    directions, origins, place = sphere_of_rays(800), few_origins(800), np.array([0.1, 0.3, 0.7])
    depth = wv.render(scene, Rays(directions, origins, axes="ros_body"), [*place, 0, 0, 0, 1]).depth.numpy()[0]
    geom = np.zeros(1, dtype=np.int32)
    expected = np.array(
        [mujoco.mj_ray(model, data, place + o, d, None, 1, -1, geom) for o, d in zip(origins, directions, strict=True)]
    )
    hit = expected >= 0
    assert 0.5 < hit.mean() < 1
    wrong = np.where(hit, np.abs(depth - expected) > 1e-5 * np.maximum(1, expected), ~np.isposinf(depth))
    assert wrong.mean() <= 0.005  # at edges


def test_attributes_are_stored_read_only():
    given = sphere_of_rays(6).reshape(2, 3, 3)
    times, rings = np.arange(6).reshape(2, 3) * 1e-3, [[0, 1, 2], [3, 4, 5]]
    pattern = Rays(given, 0 * given, times, rings, near=0.5, far=9, axes="ros_optical")
    assert pattern.shape == (2, 3) and len(pattern) == 6 and pattern.axes == "opencv" and pattern.far == 9.0
    np.testing.assert_array_equal(pattern.directions, given)
    np.testing.assert_array_equal(pattern.times, times)
    np.testing.assert_array_equal(pattern.rings, rings)
    assert pattern.rings.dtype == np.int32
    given[:] = 0
    assert np.allclose(np.linalg.norm(pattern.directions, axis=-1), 1)
    with pytest.raises(ValueError, match="read-only"):
        pattern.directions[0] = 0
    again = pickle.loads(pickle.dumps(pattern))
    np.testing.assert_array_equal(again.rays, pattern.rays)
    assert "(2, 3) with origins, times, rings" in repr(pattern)
    single = Rays(pattern.directions.astype(np.float32))
    np.testing.assert_allclose(np.linalg.norm(single.rays, axis=-1), 1, atol=1e-15)


ONE = np.array([[0, 0, 1.0], [0, 0.6, 0.8]])
REFUSED = {
    "length": (
        lambda: Rays(1.001 * ONE),
        r"directions must have length 1 .* 2 of 2 that have not, the first at \[0\] .*1.001",
    ),
    "nan": (
        lambda: Rays([[np.nan, 0, 1], [0, 0, 1]]),
        r"directions must be finite, got 1 of 2 that are not, the first at \[0\]",
    ),
    "shape": (lambda: Rays([0, 0, 1.0]), r"directions must have shape \(H, W, 3\) or \(N, 3\), got \(3,\)"),
    "none": (lambda: Rays(np.zeros((0, 3))), r"directions must have shape"),
    "origins": (lambda: Rays(ONE, ONE[:1]), r"origins must be one for each ray, shape \(2,\), got \(1, 3\)"),
    "origins of images": (lambda: Rays(ONE, ONE[None]), r"origins must be one for each ray, shape \(2,\)"),
    "times": (lambda: Rays(ONE, times=[0.0]), r"times must be one for each ray, shape \(2,\), got \(1,\)"),
    "times that are none": (lambda: Rays(ONE, times=[0, np.inf]), "times must be finite, and 1 are not"),
    "rings": (lambda: Rays(ONE, rings=[0, 1.5]), "rings must be whole numbers from 0 up, got 1.5"),
    "range": (lambda: Rays(ONE, near=2, far=1), "0 <= near < far"),
    "kind": (
        lambda: Rays(-ONE, kind="z"),
        'kind must be "range" for rays 90 degrees or more from z, got "z" for 2 such rays of 2',
    ),
    "kind of axes": (lambda: Rays(ONE, kind="z", axes="ros_body"), r'axes must be "opencv" \(z forward\) for kind="z"'),
    "axes": (lambda: Rays(ONE, axes="body"), "axes must be one of 'opencv', 'opengl', 'ros_body'"),
    "points": (
        lambda: wv.Renderer(wv.scenes.PRESETS["room"].build("cpu"), Rays(ONE)).render_at(STRAIGHT, [[[0.5, 0.5]]]),
        "camera must have a continuous image for render_at, got Rays",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_invalid_patterns_raise(name):
    make, message = REFUSED[name]
    with pytest.raises(CameraError, match=message):
        make()


def test_wide_camera_error_names_render():
    camera = wv.cameras.WideCamera(8, 4, 6.0)
    with pytest.raises(CameraError, match=r"got WideCamera: wv\.render accepts it"):
        wv.object_visibility(wv.scenes.PRESETS["room"].build(), camera, STRAIGHT)


def test_pattern_error_names_render():
    scene, pattern = wv.scenes.PRESETS["room"].build(), Rays(sphere_of_rays(10))
    depth = wv.render(scene, pattern, STRAIGHT).depth
    for call in (
        lambda: wv.object_visibility(scene, pattern, STRAIGHT),
        lambda: wv.point_visibility(scene, pattern, STRAIGHT, [[0, 0, 0]]),
        lambda: wv.back_project(depth, pattern, STRAIGHT),
        lambda: wv.maps.plan_visibility(scene, pattern, STRAIGHT),
        lambda: wv.batch.FrameRenderer(scene, pattern),
    ):
        with pytest.raises(CameraError, match=r"got (a )?Rays: its rays have no image\. wv\.render accepts it"):
            call()
