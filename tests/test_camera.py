# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Intrinsics: conventions of fields of view and pixel centers, and projection against back-projection."""

import dataclasses
import math
import warnings

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import warpvis as wv
from warpvis import Camera, FieldOfView

from support.recorded_warnings import recorded_warnings

fields = st.floats(0.05, 3.0)
sizes = st.integers(1, 4000)


def test_kinect_preset_matches_the_paper():
    camera = Camera.kinect()
    assert (camera.width, camera.height, camera.near, camera.far) == (320, 240, 0.3, 4.5)
    assert camera.hfov == pytest.approx(0.994837, abs=1e-12)
    assert (camera.cx, camera.cy) == (160, 120)
    assert camera.fx == camera.fy == pytest.approx(160 / math.tan(0.994837 / 2))


def test_linear_vertical_field_of_view_of_the_paper():
    """For the paper's camera, ay = ax Iv/Iu stretches the image vertically by 4 % relative to square pixels."""
    square, linear = Camera.kinect(), Camera.kinect(vertical="linear")
    assert linear.fx == square.fx
    assert linear.vfov == pytest.approx(0.994837 * 240 / 320, abs=1e-12)
    assert linear.fy == pytest.approx(120 / math.tan(0.994837 * 0.75 / 2))
    assert linear.fy / square.fy == pytest.approx(1.04, abs=0.005)


def test_back_projection_matches_the_papers_equations():
    """(3) xc = 2 d (u - cu) tan(ax/2) / Iu, (4) yc = 2 d (v - cv) tan(ay/2) / Iv, (5) zc = d."""
    camera, u, v, d = Camera.kinect(vertical="linear"), 40.5, 200.5, 2.5
    ax, ay = 0.994837, 0.994837 * 240 / 320
    expected = (2 * d * (u - 160) * math.tan(ax / 2) / 320, 2 * d * (v - 120) * math.tan(ay / 2) / 240, d)
    np.testing.assert_allclose(camera.back_project((u, v), d), expected, rtol=1e-14)


@given(sizes, sizes, fields)
def test_fields_of_view_round_trip(width, height, fov):
    assert Camera.from_fov(width, height, hfov=fov).hfov == pytest.approx(fov)
    assert Camera.from_fov(width, height, vfov=fov).vfov == pytest.approx(fov)


@pytest.mark.filterwarnings("ignore::warpvis.errors.IntrinsicsWarning")
@given(
    st.sampled_from([0.0, 0.5]), st.floats(1, 5000), st.floats(1, 5000), st.floats(-100, 4000), st.floats(-100, 4000)
)
def test_intrinsic_matrices_round_trip(pixel_center, fx, fy, cx, cy):
    assume(max(abs(cx), abs(cy)) > 2 or fx > 32)  # smaller values count as normalized intrinsics
    matrix = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
    camera = Camera.from_K(matrix, 640, 480, pixel_center=pixel_center)
    np.testing.assert_allclose(camera.to_K(pixel_center=pixel_center), matrix, rtol=0, atol=1e-9)


def test_pixel_center_conventions():
    """OpenCV's center of 640 pixels is 319.5, which equals 320 with pixel centers at +0.5."""
    camera = Camera.from_K([[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], 640, 480, pixel_center=0.0)
    assert (camera.cx, camera.cy) == (320, 240)
    assert camera.to_K(pixel_center=0.0)[0, 2] == 319.5
    assert camera.to_K()[0, 2] == 320


@given(fields, st.floats(0.01, 100), st.floats(-1000, 1000), st.floats(-1000, 1000))
def test_projection_inverts_back_projection(fov, depth, x, y):
    camera = Camera.from_fov(640, 480, hfov=fov)
    point = camera.back_project((x, y), depth)
    assert point[2] == depth
    np.testing.assert_allclose(camera.project(point), (x, y), atol=1e-8)


def test_points_behind_the_camera_project_to_nan():
    assert np.isnan(Camera.kinect().project([[0, 0, -1.0], [0.1, 0.2, 0]])).all()


@pytest.mark.parametrize(
    ("intrinsics", "said"),
    [
        ((0.9, 1.2, 320, 240), "fx=0.9, fy=1.2, less than a pixel"),
        ((525, 525, 640.5, 240), r"the principal point \(640.5, 240\) is outside of the image of 640 x 480 pixels"),
        ((525, 525, 320, -0.25), r"the principal point \(320, -0.25\)"),
    ],
)
def test_suspicious_intrinsics_warn_once(intrinsics, said):
    with recorded_warnings(said, wv.errors.IntrinsicsWarning) as caught:
        camera = Camera(640, 480, *intrinsics)
    assert len(caught) == 1 and caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dataclasses.replace(camera, near=0.1)


NORMALIZED = ("normalized", [[0.8, 0, 0.5], [0, 1.1, 0.5], [0, 0, 1]]), ("identity", np.eye(3))


@pytest.mark.parametrize("k", [k for _, k in NORMALIZED], ids=[name for name, _ in NORMALIZED])
@pytest.mark.parametrize(
    "make",
    [
        lambda k: Camera.from_K(k, 640, 480),
        lambda k: Camera.from_K(k, 640, 480, pixel_center=0.0),
        lambda k: Camera.from_opencv(k, None, 640, 480),
        lambda k: Camera.from_opencv(k, [0.1, 0, 0, 0], 640, 480),
        lambda k: Camera.from_opencv(k, [0.1, 0, 0, 0], 640, 480, model="fisheye"),
    ],
)
def test_normalized_intrinsics_raise(make, k):
    with pytest.raises(wv.errors.CameraError, match="multiply fx and cx by 640, fy and cy by 480"):
        make(k)


def test_intrinsics_of_small_and_cropped_images_are_accepted():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Camera(2, 2, 1.0, 1.0, 1.0, 1.0)  # 90 degrees
        Camera.from_K([[600, 0, 0], [0, 600, 0], [0, 0, 1]], 640, 480)  # the quarter of a larger image
        Camera.from_K([[40, 0, 0.5], [0, 40, 0.5], [0, 0, 1]], 640, 480)


@pytest.mark.parametrize("fov", [0.3, math.pi / 2, 2.9, 3.0])
def test_images_of_few_pixels_are_accepted(fov):
    """Their middle is in the first pixels, and their focal lengths are below a pixel."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for size in range(1, 9):
            camera = Camera.from_fov(size, size, hfov=fov)
            assert camera.hfov == pytest.approx(fov) and camera.cx == camera.cy == size / 2
            lens = wv.cameras.lenses.OpenCVPinhole(camera.fx, camera.fy, camera.cx, camera.cy, (0.0,) * 4)
            wv.cameras.LensCamera(lens, size, size)
    for size in ((1, 3), (3, 2), (2, 3), (3, 1)):
        assert Camera.from_fov(*size, hfov=3.1).hfov == pytest.approx(3.1)


def test_usual_intrinsics_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Camera(641, 481, 1.0, 1.0, 0.0, 481.0)
        Camera.kinect()
        FieldOfView(3.0, 1.0, 1.2).faces()
