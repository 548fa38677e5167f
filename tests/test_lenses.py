# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lens models: round trips, comparison with OpenCV and COLMAP, and limits of invertible mappings."""

import math
import pickle

import numpy as np
import pytest

from warpvis.cameras import lenses
from warpvis.cameras.lenses import COLMAP_NUMBERS, lens_from_colmap, lens_to_colmap
from warpvis.errors import CameraError

from support.lens_models import ARIA, FISHEYE, HEIGHT, INTRINSICS, LENSES, MEI, OPENCV, THIN_PRISM, WIDTH

PIXELS = np.stack(np.meshgrid(np.arange(0, WIDTH, 5) + 0.5, np.arange(0, HEIGHT, 5) + 0.5), axis=-1)
FOLDED = {"opencv folded", "fisheye folded", "cylindrical", "fov", "mei, rim"}


def differences(ours, theirs):
    there = np.isfinite(ours).all(-1)
    assert there.sum() > 100
    return np.abs(ours - theirs)[there].max()


def directions(max_angle, count=2000):
    rng = np.random.default_rng(5)
    angle, azimuth = rng.uniform(0, max_angle, count), rng.uniform(0, 2 * math.pi, count)
    sides = np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth)
    return np.stack([*sides, np.cos(angle)], axis=-1) * rng.uniform(0.1, 10, count)[:, None]


@pytest.mark.smoke(
    "opencv 14",
    "opencv folded",
    "azure kinect",
    "aria",
    "fisheye folded",
    "*sphere*",
    "eucm",
    "*radial*",
    "mei, rim",
    "scaramuzza",
)
@pytest.mark.parametrize("name", LENSES)
def test_projection_round_trips(name):
    lens = LENSES[name]
    rays = lens.unproject(PIXELS)
    there = np.isfinite(rays).all(-1)
    assert there.all() or name in FOLDED
    np.testing.assert_allclose(np.linalg.norm(rays[there], axis=-1), 1, atol=1e-15)
    np.testing.assert_allclose(lens.project(rays)[there], PIXELS[there], atol=1e-9, rtol=0)
    points = directions(0.999 * lens.max_angle)
    back = lens.unproject(lens.project(points))
    close = points[:, 2] > 0.01 * np.linalg.norm(points, axis=1) if name.startswith("opencv") else slice(None)
    np.testing.assert_allclose(back[close], (points / np.linalg.norm(points, axis=1)[:, None])[close], atol=1e-7)
    assert pickle.loads(pickle.dumps(lens)) == lens and hash(lens) == hash(pickle.loads(pickle.dumps(lens)))


@pytest.mark.parametrize("name", LENSES)
def test_axis_maps_to_principal_point_and_rear_to_nan(name):
    lens = LENSES[name]
    middle = lens.project([0.0, 0.0, 2.0])
    np.testing.assert_allclose(lens.unproject(middle), [0, 0, 1], atol=1e-15)
    assert np.isnan(lens.project([[0.0, 0, 0], [np.nan, 0, 1]])).all()
    assert np.isnan(lens.unproject([[np.nan, 1.0], [np.inf, 1.0]])).all()
    if lens.max_angle <= math.pi / 2 and name != "cylindrical":
        assert np.isnan(lens.project([[0.1, 0.2, -1.0], [1.0, 0, 0]])).all()
    assert lens.project(np.zeros((0, 3))).shape == (0, 2) and lens.unproject(np.zeros((2, 0, 2))).shape == (2, 0, 3)


@pytest.mark.smoke("14", "8")
@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_pinhole_projection_matches_opencv(count):
    """OpenCV's pixel centers are at integers, so coordinates differ by half a pixel."""
    cv2 = pytest.importorskip("cv2")
    lens = lenses.OpenCVPinhole(*INTRINSICS, OPENCV[:count])
    fx, fy, cx, cy = INTRINSICS
    k = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    points = directions(math.radians(50))
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), k, np.array(OPENCV[:count]))
    assert differences(lens.project(points), theirs[:, 0] + 0.5) < 1e-9


def test_fisheye_projection_matches_opencv():
    cv2 = pytest.importorskip("cv2")
    fx, fy, cx, cy = INTRINSICS
    k = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    points = directions(math.radians(88))
    theirs, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), k, np.array(FISHEYE))
    assert differences(lenses.KannalaBrandt(*INTRINSICS, FISHEYE).project(points), theirs[:, 0] + 0.5) < 1e-9


def test_mei_projection_matches_opencv():
    """Results of cv2.omnidir.projectPoints of opencv-contrib 4.14, whose pixel centers are at integers."""
    k = np.array([[300.0, 0, 160.5], [0, 310, 118.5], [0, 0, 1]])
    points = np.array([[0.3, -0.2, 1.0], [1.0, 0.5, -0.2], [-0.7, 0.9, 0.4]])
    known = [[195.73773359, 94.22303693], [345.98957001, 214.70647631], [67.63504461, 241.74098558]]
    np.testing.assert_allclose(LENSES["mei, fisheye"].project(points), np.array(known) + 0.5, atol=1e-8)
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "omnidir"):
        pytest.skip("OpenCV has no omnidir, which is in its contrib modules")
    points = directions(math.radians(95))
    for name in ("mei", "mei, fisheye"):
        lens, zero = LENSES[name], np.zeros(3)
        theirs, _ = cv2.omnidir.projectPoints(points[:, None], zero, zero, k, lens.xi, np.array([MEI]))
        assert differences(lens.project(points), theirs[:, 0] + 0.5) < 1e-9


@pytest.mark.parametrize("xi", [0.0, 0.6, 1.0, 1.7])
def test_mei_without_distortion_is_the_unified_model(xi):
    mei, unified = (
        lenses.Mei(300, 310, 161, 119, xi),
        lenses.EUCM(300 / (1 + xi), 310 / (1 + xi), 161, 119, xi / (1 + xi)),
    )
    assert mei.is_pinhole == unified.is_pinhole == (xi == 0)
    points = directions(0.95 * mei.max_angle)
    np.testing.assert_allclose(mei.project(points), unified.project(points), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(mei.unproject(PIXELS), unified.unproject(PIXELS), atol=1e-12)
    assert mei.max_angle == pytest.approx(unified.max_angle, abs=1e-7) and mei.turns_back == (xi > 1)


def test_scaramuzza_directions_match_the_polynomial():
    """As ``cam2world`` of OCamCalib: the direction of the pixel is ``(x, y, -f(r))``."""
    lens = LENSES["scaramuzza"]
    a, b, c, d = lens.affine
    for x, y in ((30.0, -20.0), (-90.0, 70.0), (0.0, 0.0)):
        pixel = (lens.cx + a * x + b * y, lens.cy + c * x + d * y)
        radius = math.hypot(x, y)
        ray = np.array([x, y, -sum(term * radius**power for power, term in enumerate(lens.coefficients))])
        np.testing.assert_allclose(lens.unproject(pixel), ray / np.linalg.norm(ray), atol=1e-14)
    assert lenses.Scaramuzza(160, 120, (-100,)).project([0.3, 0.2, 1.0]) == pytest.approx((190, 140), abs=1e-9)


def test_mapping_ends_at_zero_slope():
    """With k1 only, the radius r + k1 r^3 is maximal at r = 1 / sqrt(-3 k1)."""
    lens = lenses.OpenCVPinhole(*INTRINSICS, (-0.5, 0, 0, 0))
    end = 1 / math.sqrt(1.5)
    assert lens.turns_back and lens.max_angle == pytest.approx(math.atan(end), abs=1e-9)
    most = INTRINSICS[0] * (end - 0.5 * end**3)
    x, y = INTRINSICS[2:]
    rays = lens.unproject([[x + most - 1e-6, y], [x + most + 1e-6, y]])
    assert np.isfinite(rays[0]).all() and np.isnan(rays[1]).all()
    ahead = lens.project([[end - 1e-4, 0, 1], [end + 1e-4, 0, 1]])
    assert np.isfinite(ahead[0]).all() and np.isnan(ahead[1]).all()
    assert not lenses.OpenCVPinhole(*INTRINSICS).turns_back


def test_double_sphere_range_matches_paper():
    """Usenko 2018: for alpha above 1/2, the image ends at r^2 = 1 / (2 alpha - 1), where xi d1 + Z = -w1 d2."""
    lens = LENSES["double sphere"]
    xi, alpha = lens.xi, lens.alpha
    second = math.cos(lens.max_angle) + xi
    w1 = (1 - alpha) / alpha
    assert second / math.hypot(math.sin(lens.max_angle), second) == pytest.approx(-w1, abs=1e-7)
    most = lens.fx / math.sqrt(2 * alpha - 1)
    rays = lens.unproject([[lens.cx + most * (1 - 1e-9), lens.cy], [lens.cx + most * (1 + 1e-9), lens.cy]])
    assert np.isfinite(rays[0]).all() and np.isnan(rays[1]).all()


@pytest.mark.slow
def test_pixels_have_rays_where_directions_map_to_them():
    """A pixel has a ray if directions map to its whole neighborhood, and only if one maps into the neighborhood."""
    lens = LENSES["opencv folded"]
    assert lens.turns_back
    angle, azimuth = np.meshgrid(np.linspace(0, math.radians(40), 400), np.linspace(0, 2 * math.pi, 1200))
    points = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], axis=-1)
    image = lens.project(points).reshape(-1, 2)
    columns, rows = np.floor(image[np.isfinite(image).all(-1)]).astype(int).T
    inside = (columns >= 0) & (columns < WIDTH) & (rows >= 0) & (rows < HEIGHT)
    hit = np.zeros((HEIGHT + 2, WIDTH + 2), dtype=bool)
    hit[rows[inside] + 1, columns[inside] + 1] = True
    shown = np.stack([hit[1 + y : HEIGHT + 1 + y, 1 + x : WIDTH + 1 + x] for x in (-1, 0, 1) for y in (-1, 0, 1)])
    every = np.stack(np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5), axis=-1)
    there = np.isfinite(lens.unproject(every)).all(-1)
    assert there[1:-1, 1:-1][shown.all(0)[1:-1, 1:-1]].all() and hit[1:-1, 1:-1][there].all()
    assert 0.2 < there.mean() < 0.9


def test_derivatives_match_finite_differences():
    x, y = np.random.default_rng(2).uniform(-0.4, 0.4, (2, 200))
    for name in ("opencv 14", "thin prism", "aria", "mei"):
        bend, h = LENSES[name]._bend, 1e-6
        right, left, down, up = bend(x + h, y), bend(x - h, y), bend(x, y + h), bend(x, y - h)
        bent = bend(x, y)
        np.testing.assert_allclose(bent.xx, (right.x - left.x) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(bent.yx, (right.y - left.y) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(bent.xy, (down.x - up.x) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(bent.yy, (down.y - up.y) / (2 * h), atol=1e-8)


def test_equirectangular_and_cylindrical_projections():
    whole = LENSES["equirectangular"]
    np.testing.assert_allclose(whole.project([[0, 0, 1], [1, 0, 0], [0, -1, 0.0]])[:, 0], [160, 240, 160])
    np.testing.assert_allclose(whole.project([[0, 0, 1], [1, 0, 0], [0, -1, 0.0]])[:, 1], [120, 120, 0])
    around = LENSES["cylindrical"]
    np.testing.assert_allclose(
        around.unproject([160 + 50 * math.pi / 2, 170]), [math.sqrt(0.5), math.sqrt(0.5), 0], atol=1e-15
    )


BAD = {
    "count": (
        lambda: lenses.OpenCVPinhole(*INTRINSICS, (0.1,) * 6),
        "coefficients of OpenCVPinhole must be 4, 5, 8, 12 or 14 numbers, got 6",
    ),
    "fisheye's count": (
        lambda: lenses.KannalaBrandt(*INTRINSICS, (0.1,)),
        "coefficients of KannalaBrandt must be 4 numbers, got 1",
    ),
    "nan": (lambda: lenses.OpenCVPinhole(*INTRINSICS, (math.nan, 0, 0, 0)), "must be finite numbers, got nan"),
    "words": (lambda: lenses.KannalaBrandt(*INTRINSICS, ("a", 0, 0, 0)), "must be finite numbers, got 'a'"),
    "focal": (lambda: lenses.FOV(0, 1, 2, 3, 0.9), "fx of a lens must be a number of pixels above 0, got 0"),
    "omega": (lambda: lenses.FOV(1, 1, 2, 3, 4), "omega of a lens must be between -pi and pi radians"),
    "alpha": (lambda: lenses.EUCM(1, 1, 2, 3, 1.5), "alpha of a lens must be from 0 to 1"),
    "xi": (lambda: lenses.DoubleSphere(1, 1, 2, 3, -2, 0.5), "xi of a double sphere must be above -1"),
    "mei's xi": (lambda: lenses.Mei(1, 1, 2, 3, -0.1), "xi of a lens must be at least 0, got -0.1"),
    "mei's count": (lambda: lenses.Mei(1, 1, 2, 3, 1, (0, 0)), "coefficients of Mei must be 4 numbers, got 2"),
    "scaramuzza's sign": (
        lambda: lenses.Scaramuzza(1, 2, (250, 0)),
        "the first coefficient of Scaramuzza must be below 0, got 250.0",
    ),
    "scaramuzza's count": (
        lambda: lenses.Scaramuzza(1, 2, ()),
        "coefficients of Scaramuzza must be 1, 2, .* or 12 numbers, got 0",
    ),
    "affine": (lambda: lenses.Scaramuzza(1, 2, (-9,), (1, 0, 0, -1)), "affine of Scaramuzza must be a matrix with"),
    "affine's count": (lambda: lenses.Scaramuzza(1, 2, (-9,), (1,)), "affine of Scaramuzza must be 4 numbers, got 1"),
    "center": (lambda: lenses.Scaramuzza("a", 2, (-9,)), "cx of a lens must be a finite number, got 'a'"),
    "constant term": (
        lambda: lenses.FTheta(1, 1, (0.0, 0.01)),
        r"must be above 0, got 0\.0\. Leave out the constant term, k0\.",
    ),
    "slope": (lambda: lenses.FTheta(1, 1, (-1.0,)), "the first coefficient of FTheta must be above 0"),
    "angle": (
        lambda: lenses.FTheta(1, 1, (1.0,), max_view_angle=7),
        "max_view_angle must be above 0 and at most pi radians",
    ),
    "way": (lambda: lenses.FTheta(1, 1, (1.0,), "both"), "maps must be"),
    "points": (lambda: LENSES["fov"].project([1.0, 2.0]), r"points must have shape \(\.\.\., 3\), got \(2,\)"),
    "pixels": (lambda: LENSES["fov"].unproject("here"), "pixels"),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_lenses_are_rejected(name):
    make, message = BAD[name]
    with pytest.raises(CameraError, match=message):
        make()


F = (100.0, 110.0, 160.0, 120.0)
COLMAP = {
    "SIMPLE_PINHOLE": (100, 160, 120),
    "PINHOLE": F,
    "SIMPLE_RADIAL": (100, 160, 120, 0.05),
    "RADIAL": (100, 160, 120, 0.05, -0.01),
    "OPENCV": (*F, 0.05, -0.01, 0.002, -0.003),
    "OPENCV_FISHEYE": (*F, *FISHEYE),
    "FULL_OPENCV": (*F, *OPENCV[:8]),
    "FOV": (*F, 0.9),
    "SIMPLE_RADIAL_FISHEYE": (100, 160, 120, 0.01),
    "RADIAL_FISHEYE": (100, 160, 120, 0.01, -0.002),
    "THIN_PRISM_FISHEYE": (*F, *THIN_PRISM),
    "RAD_TAN_THIN_PRISM_FISHEYE": (*F, *ARIA),
    "SIMPLE_DIVISION": (100, 160, 120, -0.2),
    "DIVISION": (*F, 0.1),
    "SIMPLE_FISHEYE": (100, 160, 120),
    "FISHEYE": F,
    "EUCM": (*F, 0.6, 1.1),
    "EQUIRECTANGULAR": (WIDTH, HEIGHT),
}


@pytest.mark.smoke("RAD_TAN*", "FULL_OPENCV", "*FISHEYE", "DIVISION", "FOV", "EUCM", "SIMPLE_RADIAL")
@pytest.mark.parametrize("model", COLMAP)
def test_projection_matches_pycolmap(model):
    pycolmap = pytest.importorskip("pycolmap")
    lens = lens_from_colmap(model, COLMAP[model])
    theirs = pycolmap.Camera(camera_id=1, model=model, width=WIDTH, height=HEIGHT, params=COLMAP[model])
    points = directions(math.pi if model == "EQUIRECTANGULAR" else math.radians(85))
    if model == "FOV":  # COLMAP uses a series near the axis, accurate to 1e-8
        points = points[np.hypot(points[:, 0], points[:, 1]) > 0.02 * points[:, 2]]
    projected = lens.project(points)
    assert differences(projected, theirs.img_from_cam(points)) < 1e-9
    assert differences(projected, lens.project(lens.unproject(projected))) < 1e-9


def test_colmap_model_numbers_are_complete():
    pycolmap = pytest.importorskip("pycolmap")
    theirs = {member.value: name for name, member in pycolmap.CameraModelId.__members__.items() if name != "INVALID"}
    assert theirs == {number: name for number, name in COLMAP_NUMBERS.items() if number in theirs}
    assert set(COLMAP) == set(COLMAP_NUMBERS.values())


@pytest.mark.smoke("RAD_TAN_THIN_PRISM_FISHEYE", "RADIAL", "EUCM")
@pytest.mark.parametrize("model", COLMAP)
def test_colmap_models_round_trip(model):
    lens = lens_from_colmap(model, COLMAP[model])
    again = lens_from_colmap(*lens_to_colmap(lens))
    points = directions(math.radians(40), 100)
    np.testing.assert_array_equal(again.project(points), lens.project(points))


def test_unsupported_colmap_models_are_rejected():
    with pytest.raises(CameraError, match="COLMAP has no camera model PANINI; its models are SIMPLE_PINHOLE, "):
        lens_from_colmap("PANINI", F)
    with pytest.raises(CameraError, match="parameters of EUCM must be 6 numbers, got 4"):
        lens_from_colmap("EUCM", F)
    for name in ("opencv 12", "double sphere", "ftheta", "cylindrical"):
        with pytest.raises(CameraError, match="COLMAP has no camera model for"):
            lens_to_colmap(LENSES[name])


def test_coefficients_that_overflow_leave_no_ray():
    lens = lenses.OpenCVPinhole(*F, (-0.2, 0.05, 0.001, -1e308))
    assert np.isnan(lens.unproject(PIXELS)).any(-1).mean() > 0.9


def test_directions_are_cached_and_read_only():
    lens = lenses.FOV(*F, 0.5)
    table = lens.directions(8, 6)
    assert table is lens.directions(8, 6) and not table.flags.writeable and table.shape == (6, 8, 3)
    np.testing.assert_array_equal(table[2, 3], lens.unproject([3.5, 2.5]))


@pytest.mark.parametrize(
    "lens",
    [
        lenses.DoubleSphere(300, 300, 320, 240, -0.2, 0.6),
        lenses.Division(300, 300, 320, 240, -0.1),
        lenses.OpenCVPinhole(480, 480, 320, 240, (-0.28, 0.09, 0.001, -0.0005)),
    ],
    ids=lambda lens: type(lens).__name__,
)
def test_unprojection_converges_in_few_iterations(monkeypatch, lens):
    """A few points whose last digit keeps changing must not exhaust the maximum number of iterations."""
    pixels, calls, function = (
        np.random.default_rng(0).uniform((0, 0), (640, 480), (1000, 2)),
        [],
        lens._rising._function,
    )
    monkeypatch.setattr(lens._rising, "_function", lambda angle: calls.append(len(angle)) or function(angle))
    monkeypatch.setattr(type(lens), "_follow", lambda *given: pytest.fail("no point has failed"), raising=False)
    shown = lens.unproject(pixels)
    assert len(calls) < 20 and sum(calls) < 10 * len(pixels)
    np.testing.assert_allclose(lens.project(shown), pixels, atol=1e-9)
