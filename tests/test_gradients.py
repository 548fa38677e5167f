# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Gradients of depth, points and normals: against twins, and against central differences in float64."""

from functools import cache

import numpy as np
import pytest
import reference_gradients as twin
import warp as wp

import warpvis as wv
from warpvis.cameras import origin_jacobian, ray_jacobian
from warpvis.core.poses import parse_poses
from warpvis.rendering.gradients import DepthGradients
from warpvis.scene.worlds import parse_worlds, pose_columns

from support.gradients import CAMERAS, OBJECT_ROWS, ROW, STEP, Loss, build_scene, changes_of, flat_rays

IMAGES = ("depth", "points", "normals", "segmentation")


def run(device, camera, gradients, rows=ROW[None], object_rows=OBJECT_ROWS[None], threads=None):
    """Return the images of a render, and the gradients with respect to poses and rays."""
    scene = build_scene(device)
    views = wv.render(scene, camera, rows, object_poses=object_rows, outputs=IMAGES)
    poses = parse_poses(rows, convention=camera.axes, axes=camera.axes, device=scene.device)
    worlds = parse_worlds(scene, len(rows), object_rows, None, None)
    images = {name: getattr(views, name) for name in IMAGES}
    given = {name: wp.array(value, dtype=_type(value), device=scene.device) for name, value in gradients.items()}
    depth = DepthGradients(scene, camera, threads=threads)
    of_rays = depth.rays(poses, images, given)
    return images, depth.poses(poses, worlds, images, given).numpy(), of_rays


def _type(gradient):
    return wp.vec3 if gradient.shape[-1] == 3 else wp.float32


def assert_close(got, expected, tolerance):
    np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@pytest.mark.parametrize("name", CAMERAS)
def test_sums_match_twin(name, device):
    camera, rng = CAMERAS[name], np.random.default_rng(1)
    shape = camera.shape
    gradients = {
        "depth": rng.normal(size=(1, *shape)).astype(np.float32),
        "points": rng.normal(size=(1, *shape, 3)).astype(np.float32),
        "normals": rng.normal(size=(1, *shape, 3)).astype(np.float32),
    }
    images, of_poses, of_rays = run(device, camera, gradients)
    image = shape if len(shape) == 2 else (1, *shape)
    seen = {
        key: value.numpy()[0].reshape(*image, *value.numpy().shape[1 + len(shape) :]) for key, value in images.items()
    }
    seen = {key: value.astype(np.float64) if value.dtype.kind == "f" else value for key, value in seen.items()}
    given = {key: value[0].reshape(*image, *value.shape[1 + len(shape) :]) for key, value in gradients.items()}
    sums = twin.sum_moments(camera, ROW, seen, given, pose_columns(build_scene()), OBJECT_ROWS)
    expected = twin.sum_pose_strips(sums, np.concatenate([ROW[None], OBJECT_ROWS]))
    for got, row in zip(of_poses[0], expected, strict=True):
        assert_close(got, row, 1e-5)
    rays, origins = twin.write_ray_gradients(camera, ROW, seen, given)
    assert_close(of_rays.rays.numpy()[0], rays, 1e-5)
    if camera.origins is not None:
        assert_close(of_rays.origins.numpy()[0], origins, 1e-5)


@cache
def pose_loss(name):
    changes = changes_of("row", ROW) + changes_of("object_rows", OBJECT_ROWS)
    return Loss(build_scene(), CAMERAS[name], changes)


@pytest.mark.parametrize("names", [("depth",), ("points",), ("normals",), ("depth", "points", "normals")], ids="-".join)
@pytest.mark.parametrize("name", CAMERAS)
def test_gradients_match_central_differences(name, names, device):
    loss = pose_loss(name)
    _, got, _ = run(device, CAMERAS[name], loss.image_gradients(names))
    expected = loss.differences(names).sum(axis=1)
    assert_close(got[0, 1:].reshape(-1), expected[7:], 1e-4)
    if names == ("normals",):  # which do not depend on the camera
        assert not got[0, 0].any()
    else:
        assert_close(got[0, 0], expected[:7], 1e-4)


@pytest.mark.parametrize("name", CAMERAS)
def test_vertex_sums_match_twin(name, device):
    camera, rng = CAMERAS[name], np.random.default_rng(2)
    scene, rows, image = build_scene(device), ROW[None], camera.shape if len(camera.shape) == 2 else (1, *camera.shape)
    outputs = (*IMAGES, "faces")
    views = wv.render(scene, camera, rows, object_poses=OBJECT_ROWS[None], outputs=outputs)
    gradients = {key: np.float32(rng.normal(size=getattr(views, key).numpy().shape)) for key in IMAGES[:3]}
    images = {key: getattr(views, key) for key in outputs}
    vertices = np.asarray(scene.objects[2].mesh_vertices)
    got = DepthGradients(scene, camera).vertices(
        "stone",
        wp.array(vertices, dtype=wp.vec3, device=scene.device),
        parse_poses(rows, convention=camera.axes, axes=camera.axes, device=scene.device),
        parse_worlds(scene, 1, OBJECT_ROWS[None], None, None),
        images,
        {key: wp.array(value, dtype=_type(value), device=scene.device) for key, value in gradients.items()},
    )
    shaped = lambda array: np.asarray(array)[0].reshape(*image, *np.shape(array)[1 + len(camera.shape) :])  # noqa: E731
    expected = twin.sum_vertex_gradients(
        camera,
        ROW,
        {key: shaped(value.numpy()) for key, value in images.items()},
        {key: shaped(value) for key, value in gradients.items()},
        2,
        OBJECT_ROWS[0],
        vertices.astype(np.float64),
        scene.objects[2].faces,
    )
    assert_close(got.numpy(), expected, 1e-5)


@pytest.mark.parametrize("name", ["pinhole", "distorted", "panorama", "orthographic"])
def test_parameter_sums_match_twin(name, device):
    camera, rng = CAMERAS[name], np.random.default_rng(3)
    rows = np.repeat(ROW[None], 2, axis=0)
    scene = build_scene(device)
    views = wv.render(scene, camera, rows, object_poses=OBJECT_ROWS[None], outputs=IMAGES)
    images = {key: getattr(views, key) for key in IMAGES}
    depth = wp.array(rng.normal(size=(2, *camera.shape)), dtype=wp.float32, device=scene.device)
    poses = parse_poses(rows, convention=camera.axes, axes=camera.axes, device=scene.device)
    gradients = DepthGradients(scene, camera)
    rays, origins = gradients.rays(poses, images, {"depth": depth})
    of_rays, of_origins = (
        None if jacobian is None else np.moveaxis(jacobian, -1, 0)
        for jacobian in (ray_jacobian(camera), origin_jacobian(camera))
    )
    origins = None if origins is None else origins.numpy()
    expected = twin.sum_rows(twin.sum_parameter_gradients(rays.numpy(), origins, of_rays, of_origins))
    got = gradients.parameters(poses, images, {"depth": depth}).numpy()
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-12)


def test_missing_images_are_an_error():
    scene, camera = build_scene(), CAMERAS["pinhole"]
    depth = wv.render(scene, camera, ROW, outputs="depth").depth
    poses = parse_poses(ROW[None], convention="opencv", axes="opencv", device=scene.device)
    with pytest.raises(wv.WarpvisError, match="images must have depth, normals, segmentation, got none of normals"):
        DepthGradients(scene, camera).poses(poses, parse_worlds(scene, 1, None, None, None), {"depth": depth}, {})


@pytest.mark.parametrize("name", CAMERAS)
def test_ray_gradients_match_central_differences(name, device):
    """Rays are independent of each other, so one step changes all of them."""
    camera = CAMERAS[name]
    rays, origins, _ = flat_rays(camera)
    base = {"rays": rays} if origins is None else {"rays": rays, "origins": origins}
    steps = [(key, sign * STEP * np.eye(3)[k]) for key in base for k in range(3) for sign in (1, -1)]
    loss = Loss(build_scene(), camera, [{key: base[key] + step} for key, step in steps])
    _, _, got = run(device, camera, loss.image_gradients(("depth", "points")))
    expected = loss.differences(("depth", "points"))
    assert_close(got.rays.numpy().reshape(-1, 3), expected[:3].T, 1e-4)
    if origins is not None:
        assert_close(got.origins.numpy().reshape(-1, 3), expected[3:].T, 1e-4)


def test_pixels_without_hit_have_no_gradient(device):
    camera = wv.Camera.from_fov(16, 12, hfov=0.5, near=0.1, far=1.0)
    gradients = {"depth": np.ones((1, 12, 16), np.float32), "points": np.ones((1, 12, 16, 3), np.float32)}
    images, of_poses, of_rays = run(device, camera, gradients)
    assert not np.isfinite(images["depth"].numpy()).any()
    assert not of_poses.any()
    assert not of_rays.rays.numpy().any()


def test_gradients_do_not_depend_on_threads_or_batch(device):
    camera, rng = CAMERAS["pinhole"], np.random.default_rng(5)
    rows = np.repeat(ROW[None], 5, axis=0)
    rows[:, :3] += rng.normal(scale=0.1, size=(5, 3))
    objects = np.repeat(OBJECT_ROWS[None], 5, axis=0)
    gradients = {"depth": rng.normal(size=(5, *camera.shape)).astype(np.float32)}
    _, together, _ = run(device, camera, gradients, rows, objects, threads=2)
    _, alone, _ = run(device, camera, gradients, rows, objects, threads=1)
    np.testing.assert_array_equal(together, alone)
    part = {"depth": gradients["depth"][2:3]}
    np.testing.assert_array_equal(together[2:3], run(device, camera, part, rows[2:3], objects[2:3])[1])
