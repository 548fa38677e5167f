# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras with lenses: conversion from other systems, and images compared with a float64 reference and closed forms."""

import copy
import math
import pickle
import types
import warnings
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.cameras import LensCamera, as_pinhole, lenses
from warpvis.errors import CameraError, IntrinsicsWarning

import reference
from compare import assert_view_matches, hair
from support.lens_camera import FISHEYE, PINHOLE, PLUMB_BOB, RATIONAL, SMALL, STRAIGHT, WIDE
from support.recorded_warnings import recorded_warnings
from support.solids import build as build_solids
from support.worlds import ALL, random_poses

K = np.array([[52.0, 0, 31.5], [0, 50, 23.5], [0, 0, 1]])
KALIBR = {"camera_model": "pinhole", "intrinsics": [52, 50, 31.5, 23.5], "resolution": [64, 48]}
NERF = {"fl_x": 52.0, "fl_y": 50.0, "cx": 32.0, "cy": 24.0, "w": 64, "h": 48}


def info(model="plumb_bob", d=PLUMB_BOB, **others):
    return types.SimpleNamespace(
        **{"width": 64, "height": 48, "k": K.ravel(), "d": d, "distortion_model": model} | others
    )


SAME_LENS = {
    "opencv": lambda: wv.Camera.from_opencv(K, PLUMB_BOB, 64, 48),
    "opencv, a row": lambda: wv.Camera.from_opencv(K, np.array([PLUMB_BOB]), 64, 48),
    "ros": lambda: wv.Camera.from_raw_camera_info(info()),
    "ros 1": lambda: wv.Camera.from_raw_camera_info(
        types.SimpleNamespace(K=K.ravel(), D=PLUMB_BOB, distortion_model="plumb_bob", width=64, height=48)
    ),
    "colmap": lambda: wv.Camera.from_colmap("FULL_OPENCV", (52, 50, 32, 24, *PLUMB_BOB, 0, 0, 0), 64, 48),
    "nerfstudio": lambda: wv.Camera.from_nerfstudio(
        NERF | {"k1": -0.3, "k2": 0.1, "p1": 0.001, "p2": -0.002, "k3": 0.01}
    ),
}
SAME_FISHEYE = {
    "opencv": lambda: wv.Camera.from_opencv(K, FISHEYE, 64, 48, model="fisheye"),
    "ros": lambda: wv.Camera.from_raw_camera_info(info("equidistant", FISHEYE)),
    "colmap": lambda: wv.Camera.from_colmap("OPENCV_FISHEYE", (52, 50, 32, 24, *FISHEYE), 64, 48),
    "kalibr": lambda: wv.Camera.from_kalibr(KALIBR | {"distortion_model": "equidistant", "distortion_coeffs": FISHEYE}),
    "nerfstudio": lambda: wv.Camera.from_nerfstudio(
        NERF | {"camera_model": "OPENCV_FISHEYE", "k1": 0.01, "k2": 0.002, "k3": -0.003, "k4": 0.0004}
    ),
}


@pytest.mark.parametrize(
    ("makes", "lens"), [(SAME_LENS, SMALL), (SAME_FISHEYE, lenses.KannalaBrandt(52, 50, 32, 24, FISHEYE))]
)
def test_lens_is_the_same_in_all_systems(makes, lens):
    """OpenCV, ROS and Kalibr place pixel centers at integers, COLMAP and nerfstudio at half-integers."""
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 3)) + [0, 0, 1.5]
    for name, make in makes.items():
        camera = make()
        assert isinstance(camera, LensCamera) and (camera.width, camera.height, camera.kind) == (64, 48, "z"), name
        np.testing.assert_allclose(camera.project(points), lens.project(points), atol=1e-12, err_msg=name)


def test_opencv_principal_point_is_shifted_by_half_a_pixel():
    """The image center is cx = (width - 1) / 2 in OpenCV, and width / 2 in warpvis."""
    camera = wv.Camera.from_opencv(K, PLUMB_BOB, 64, 48)
    np.testing.assert_allclose(camera.project([0, 0, 1.0]), [32, 24], atol=1e-12)
    colmap = wv.Camera.from_colmap("OPENCV", (52, 50, 31.5, 23.5, *PLUMB_BOB[:4]), 64, 48)
    np.testing.assert_allclose(colmap.project([0, 0, 1.0]), [31.5, 23.5], atol=1e-12)


WITHOUT = {
    "opencv": lambda: wv.Camera.from_opencv(K, (0.0,) * 8, 64, 48),
    "opencv, none": lambda: wv.Camera.from_opencv(K, None, 64, 48),
    "ros": lambda: wv.Camera.from_raw_camera_info(info(d=(0.0,) * 5)),
    "ros, none": lambda: wv.Camera.from_raw_camera_info(info("", ())),
    "colmap": lambda: wv.Camera.from_colmap("PINHOLE", (52, 50, 32, 24), 64, 48),
    "colmap, fov": lambda: wv.Camera.from_colmap("FOV", (52, 50, 32, 24, 0.0), 64, 48),
    "kalibr": lambda: wv.Camera.from_kalibr(KALIBR | {"distortion_model": "radtan", "distortion_coeffs": [0.0] * 4}),
    "kalibr, none": lambda: wv.Camera.from_kalibr(KALIBR),
    "nerfstudio": lambda: wv.Camera.from_nerfstudio(NERF),
}


@pytest.mark.parametrize("name", WITHOUT)
def test_zero_distortion_yields_pinhole_camera(name):
    assert WITHOUT[name]() == PINHOLE


def test_kalibr_camera_models():
    ds = wv.Camera.from_kalibr(KALIBR | {"camera_model": "ds", "intrinsics": [-0.2, 0.6, 20, 21, 31.5, 23.5]})
    assert ds.lens == lenses.DoubleSphere(20, 21, 32, 24, -0.2, 0.6)
    eucm = wv.Camera.from_kalibr(KALIBR | {"camera_model": "eucm", "intrinsics": [0.6, 1.1, 20, 21, 31.5, 23.5]})
    assert eucm.lens == lenses.EUCM(20, 21, 32, 24, 0.6, 1.1)
    fov = wv.Camera.from_kalibr(KALIBR | {"distortion_model": "fov", "distortion_coeffs": [0.9]})
    assert fov.lens == lenses.FOV(52, 50, 32, 24, 0.9)
    omni = wv.Camera.from_kalibr(KALIBR | {"camera_model": "omni", "intrinsics": [0.8, 40, 42, 31.5, 23.5]})
    x, y, z = point = np.array([0.3, -0.2, 0.9])
    length = np.linalg.norm(point)  # Mei's model projects onto (x, y) / (z + xi |p|)
    expected = [40 * x / (z + 0.8 * length) + 32, 42 * y / (z + 0.8 * length) + 24]
    np.testing.assert_allclose(omni.project(point), expected, atol=1e-12)


def test_roi_and_binning_of_raw_images():
    """Regions of interest and binning match `Camera.from_camera_info` of a message without distortion."""
    roi = types.SimpleNamespace(x_offset=8, y_offset=4, width=40, height=40, do_rectify=False)
    others = {"binning_x": 2, "binning_y": 2, "roi": roi, "p": np.zeros(12), "r": np.eye(3).ravel()}
    plain = info(d=(), **others)
    assert wv.Camera.from_raw_camera_info(plain) == wv.Camera.from_camera_info(plain, rectified=False)
    bent = wv.Camera.from_raw_camera_info(info(**others))
    expected = wv.Camera.from_camera_info(plain, rectified=False)
    assert (bent.lens.fx, bent.lens.cx, bent.width) == (expected.fx, expected.cx, 20)


def assert_matches_reference(views, scene, poses, camera, **options):
    """Compare with the reference, except where a ray 1e-6 away hits another surface."""
    options |= {"near": camera.near, "far": camera.far}
    for view, pose in enumerate(poses):
        expected = reference.cast_ray_table(scene, camera.rays, pose, **options)

        def depth_beside(x, y, pose=pose):
            return reference.cast_ray_table(scene, camera.rays[y, x] + hair(1e-6, 3), pose, **options).depth

        assert_view_matches(views, view, expected, depth_beside)


@pytest.mark.smoke("*-range", "*-z")
@pytest.mark.parametrize("kind", ["z", "range", "wide"])
def test_room_matches_reference(kind, device):
    scene = wv.scenes.PRESETS["room"].build(device)
    camera = LensCamera(WIDE, 64, 48) if kind == "wide" else LensCamera(SMALL, 64, 48, kind=kind)
    assert camera.kind == ("z" if kind == "z" else "range")
    poses = np.array([wv.look_at(eye, (0.5, 0.4, 0.3)) for eye in ((0.1, 0.2, 0.9), (-0.8, 1.2, 1.5))])
    views = wv.render(scene, camera, poses, outputs=ALL)
    assert np.isfinite(views.depth.numpy()).mean() > 0.1
    assert_matches_reference(views, scene, poses, camera)


def test_clipping_near_plane_matches_reference(device):
    scene, pose = wv.scenes.PRESETS["room"].build(device), wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))[None]
    for kind in ("z", "range"):
        camera = LensCamera(SMALL, 64, 48, near=0.8, far=3.0, kind=kind)
        assert np.isneginf(wv.render(scene, camera, pose).depth.numpy()).any()
        views = wv.render(scene, camera, pose, outputs=ALL, near_plane="clip")
        assert_matches_reference(views, scene, pose, camera, near_plane="clip")


@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_solids_and_moved_meshes_match_reference(cull_backfaces, device):
    rng = np.random.default_rng(0)
    meshes = [trimesh.creation.box((0.5, 0.3, 0.7)), trimesh.creation.icosphere(subdivisions=1, radius=0.3)]
    scene = build_solids(device, random_poses(rng, 10, spread=2.0), extra=meshes)
    poses = random_poses(rng, 2, spread=0.3)
    camera = LensCamera(WIDE, 64, 48, near=0.4, far=2.0)
    views = wv.render(scene, camera, poses, outputs=ALL, cull_backfaces=cull_backfaces)
    assert len(np.unique(views.segmentation.numpy())) >= 6
    assert np.isneginf(views.depth.numpy()).any()
    assert_matches_reference(views, scene, poses, camera, cull_backfaces=cull_backfaces)


def test_zero_coefficients_render_pinhole_image(device):
    scene = wv.scenes.PRESETS["room"].build(device)
    pose = wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))
    camera = LensCamera(lenses.OpenCVPinhole(52, 50, 32, 24, (0.0,) * 8), 64, 48)
    for caster, rtol in (("rays", 2e-7), ("auto", 1e-6)):
        pinhole = wv.render(scene, PINHOLE, pose, outputs=ALL, caster=caster)
        lens = wv.render(scene, camera, pose, outputs=ALL, caster=caster)
        np.testing.assert_allclose(lens.depth.numpy(), pinhole.depth.numpy(), rtol=rtol)
        np.testing.assert_array_equal(lens.segmentation.numpy(), pinhole.segmentation.numpy())
        np.testing.assert_array_equal(lens.labels.numpy(), pinhole.labels.numpy())


def test_ranges_in_sphere_and_box(device):
    """Ranges from the center of a ball equal its radius; in a box, the distance to the nearest wall along the ray."""
    camera = LensCamera(WIDE, 64, 48)
    assert camera.lens.max_angle > math.radians(100) and (camera.directions[..., 2] < 0).any()
    ball = wv.Scene(device=device)
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=3.0)
    ball.add(sphere, name="ball")
    # Relative depth of the flat faces.
    inner = 1 - np.einsum("fi,fi->f", sphere.face_normals, sphere.triangles[:, 0]).min() / 3.0
    lengths = wv.render(ball, camera, STRAIGHT).depth.numpy()
    assert inner < 1e-3 and (lengths <= 3.0 * (1 + 1e-6)).all() and (lengths >= 3.0 * (1 - inner - 1e-6)).all()
    box = wv.Scene(device=device)
    half = np.array([2.0, 1.5, 2.5])
    box.add(trimesh.creation.box(2 * half), name="box")
    views = wv.render(box, camera, STRAIGHT, outputs=("depth", "points", "normals"))
    with np.errstate(divide="ignore"):
        expected = (half / np.abs(camera.directions)).min(axis=-1)
    np.testing.assert_allclose(views.depth.numpy()[0], expected, rtol=1e-5)
    np.testing.assert_allclose(views.points.numpy()[0], expected[..., None] * camera.directions, atol=3e-5)
    planar = LensCamera(SMALL, 64, 48)
    depth = wv.render(box, planar, STRAIGHT).depth.numpy()[0]
    np.testing.assert_allclose(
        depth, (half / np.abs(planar.directions)).min(axis=-1) * planar.directions[..., 2], rtol=1e-5
    )


def test_pixels_without_a_ray_are_empty_and_warn(device):
    lens = lenses.OpenCVPinhole(52, 50, 32, 24, (-0.9, 0, 0.001, 0))
    with pytest.warns(
        IntrinsicsWarning, match=r"\d+ of 3072 pixels have no ray because the lens turns back 31\.\d+ degrees"
    ):
        camera = LensCamera(lens, 64, 48)
    assert 0.1 < camera.mask.mean() < 0.9 and not camera.mask[24, 32] and camera.mask[0, 0]
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((4, 4, 4)), name="box")
    views = wv.render(scene, camera, STRAIGHT, outputs=ALL)
    np.testing.assert_array_equal(np.isposinf(views.depth.numpy()[0]), camera.mask)
    np.testing.assert_array_equal(views.segmentation.numpy()[0] == -1, camera.mask)
    assert np.isnan(views.points.numpy()[0][camera.mask]).all() and (views.labels.numpy()[0][camera.mask] == 0).all()


BENT = (-0.9, 0, 0.001, 0)
WARNS = {
    "LensCamera": lambda: LensCamera(lenses.OpenCVPinhole(52, 50, 32, 24, BENT), 64, 48),
    "opencv": lambda: wv.Camera.from_opencv(K, BENT, 64, 48),
    "ros": lambda: wv.Camera.from_raw_camera_info(info(d=(*BENT, 0.0))),
    "colmap": lambda: wv.Camera.from_colmap("OPENCV", (52, 50, 32, 24, *BENT), 64, 48),
    "pinhole": lambda: wv.Camera(64, 48, 52, 50, 65.25, 24),
    "pinhole of K": lambda: wv.Camera.from_K([[52, 0, 65.5], [0, 50, 24], [0, 0, 1]], 64, 48),
}


@pytest.mark.smoke("ros", "LensCamera")
@pytest.mark.parametrize("name", WARNS)
def test_warnings_name_the_callers_line(name):
    """The reported line is the caller's at any depth of calls."""
    with recorded_warnings(category=IntrinsicsWarning) as caught:
        WARNS[name]()
    assert [warning.filename for warning in caught] == [__file__]


def test_render_at_worlds_exclude_and_out(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.4, 0.4, 0.4)), name="cart", movable=True)
    scene.add(trimesh.creation.box((9, 9, 0.1)), name="wall", pose=(0, 0, 4, 0, 0, 0, 1))
    camera = LensCamera(SMALL, 64, 48)
    renderer = wv.Renderer(scene, camera, outputs=ALL)
    worlds = {"object_poses": [[[0, 0, 2, 0, 0, 0, 1]], [[0.5, 0, 3, 0, 0, 0, 1]]]}
    views = renderer.render(np.stack([STRAIGHT] * 2), **worlds)
    pixels = np.stack(np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5), axis=-1).reshape(1, -1, 2)
    at = renderer.render_at(np.stack([STRAIGHT] * 2), np.repeat(pixels, 2, axis=0).astype(np.float32), **worlds)
    for name in ALL:
        image, points = getattr(views, name).numpy(), getattr(at, name).numpy()
        np.testing.assert_allclose(points.reshape(image.shape), image, rtol=1e-6, atol=1e-6, err_msg=name)
    assert (views.segmentation.numpy()[0] != views.segmentation.numpy()[1]).any()
    outside = renderer.render_at(
        STRAIGHT, [[[-1.0, 5], [64, 5], [np.nan, 5], [32, 24]]], object_poses=worlds["object_poses"][0]
    )
    np.testing.assert_array_equal(np.isfinite(outside.depth.numpy()[0]), [False, False, False, True])
    alone = wv.render(scene, camera, STRAIGHT, exclude=["cart"], outputs=ALL)
    assert set(np.unique(alone.segmentation.numpy())) == {1}
    again = renderer.render(np.stack([STRAIGHT] * 2), out=views, **worlds)
    assert again is views


def test_rays_behind_the_camera_have_no_planar_depth():
    """Beyond the image of a camera with depth along the axis, a fisheye sees behind it: those rays are NaN."""
    camera = LensCamera(lenses.KannalaBrandt(30, 30, 32, 24), 64, 48)
    assert camera.kind == "z"
    behind = camera.lens.project([[1.0, 0.0, -0.2]])
    assert np.isfinite(behind).all() and np.isnan(camera.depth_rays(behind)).all()
    rays = camera.canvas_rays((64, 48, 64, 48))
    ahead = camera.lens.directions(192, 144, (-64, -48))[..., 2] > 0
    np.testing.assert_array_equal(np.isfinite(rays).all(axis=-1), ahead)
    np.testing.assert_array_equal(rays[48:96, 64:128], camera.rays)


def test_cameras_without_distortion_are_pinholes():
    straight = LensCamera(lenses.OpenCVPinhole(52, 50, 32, 24), 64, 48, near=0.5)
    assert as_pinhole(straight) == wv.Camera(64, 48, 52, 50, 32, 24, near=0.5)
    assert as_pinhole(PINHOLE) == PINHOLE and PINHOLE.has_pixels_of(straight) and straight.has_pixels_of(PINHOLE)
    for other in (LensCamera(SMALL, 64, 48), replace(straight, kind="range"), wv.cameras.WideCamera(64, 48, 2.0)):
        assert as_pinhole(other) is None and not PINHOLE.has_pixels_of(other)


def test_cameras_compare_hash_and_copy_by_value():
    camera = LensCamera(SMALL, 64, 48, near=0.1, far=9.0)
    for other in (copy.deepcopy(camera), pickle.loads(pickle.dumps(camera))):
        assert other == camera and hash(other) == hash(camera)
    assert len(pickle.dumps(camera)) < 2000
    nearer = replace(camera, far=5.0)
    assert nearer != camera and nearer.directions is camera.directions
    assert (PINHOLE.kind, PINHOLE.mask.any()) == ("z", False)
    pixels = np.array([[1.0, 2.0], [32.0, 24.0]])
    np.testing.assert_allclose(PINHOLE.project(PINHOLE.unproject(pixels)), pixels, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(PINHOLE.unproject(pixels), axis=-1), 1)


BAD = {
    "count": (
        lambda: wv.Camera.from_opencv(K, (0.1,) * 6, 64, 48),
        "D of OpenCV's pinhole must be 4, 5, 8, 12 or 14 numbers, got 6",
    ),
    "fisheye": (
        lambda: wv.Camera.from_opencv(K, (0.1,) * 5, 64, 48, model="fisheye"),
        "D of OpenCV's fisheye must be 4 numbers, got 5",
    ),
    "nan": (lambda: wv.Camera.from_opencv(K, (math.nan, 0, 0, 0), 64, 48), "D must be finite numbers, got nan"),
    "K": (lambda: wv.Camera.from_opencv(np.eye(4), None, 64, 48), r"K must have shape \(3, 3\)"),
    "model": (lambda: wv.Camera.from_opencv(K, None, 64, 48, model="omni"), 'model must be "pinhole" or "fisheye"'),
    "ros model": (
        lambda: wv.Camera.from_raw_camera_info(info("thin")),
        "distortion_model must be one of plumb_bob, .*, got 'thin'",
    ),
    "ros count": (
        lambda: wv.Camera.from_raw_camera_info(info(d=RATIONAL)),
        "D of plumb_bob must be 4 or 5 numbers, got 8",
    ),
    "colmap": (
        lambda: wv.Camera.from_colmap("OPENCV", (1, 2), 64, 48),
        "parameters of OPENCV must be 8 numbers, got 2",
    ),
    "kalibr": (
        lambda: wv.Camera.from_kalibr(KALIBR | {"camera_model": "x"}),
        "camera_model must be one of pinhole, omni",
    ),
    "kalibr omni": (
        lambda: wv.Camera.from_kalibr(
            KALIBR
            | {"camera_model": "omni", "intrinsics": [1, 2, 3, 4, 5]}
            | {"distortion_model": "equidistant", "distortion_coeffs": [0.1, 0, 0, 0]}
        ),
        "distortion_model of camera_model omni must be none or radtan, got equidistant with non-zero coefficients",
    ),
    "nerfstudio": (
        lambda: wv.Camera.from_nerfstudio({"fl_x": 1}),
        "fields must contain fl_x, .*, missing fl_y",
    ),
    "k4": (lambda: wv.Camera.from_nerfstudio(NERF | {"k4": 0.1}), "k4 of camera_model OPENCV"),
    "z": (
        lambda: LensCamera(WIDE, 64, 48, kind="z"),
        r'kind must be "range" for rays 90 degrees or more from the axis, got "z" with \d+ such',
    ),
    "kind": (lambda: LensCamera(SMALL, 64, 48, kind="ray"), 'kind must be "z" or "range", got \'ray\''),
    "lens": (lambda: LensCamera("wide", 64, 48), "lens must be one of warpvis.cameras.lenses, got str"),
    "range": (lambda: LensCamera(SMALL, 64, 48, near=2.0, far=1.0), "0 <= near < far"),
    "pixels": (
        lambda: LensCamera(SMALL, 10**5, 10**4),
        "width x height must be at most 67108864 rays",
    ),
    "size": (lambda: LensCamera(SMALL, 64.5, 48), "width must be a whole number of pixels"),
    "none": (
        lambda: LensCamera(lenses.OpenCVPinhole(1, 1, -900, 0, (-0.9, 0, 0, 0)), 64, 48),
        "no pixel of the image has a ray",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_cameras_are_rejected(name):
    make, message = BAD[name]
    with pytest.raises(CameraError, match=message), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        make()


def test_lens_cameras_use_packets(device):
    scene = wv.scenes.PRESETS["room"].build(device)
    assert wv.Renderer(scene, LensCamera(SMALL, 64, 48)).caster == "packets"
