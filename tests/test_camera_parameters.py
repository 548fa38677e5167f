# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of cameras, and derivatives of rays with respect to them, compared with differences of rays."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import warpvis as wv
from warpvis.cameras import (
    LensCamera,
    OrthographicCamera,
    Rays,
    WideCamera,
    lenses,
    origin_jacobian,
    parameter_names,
    parameter_values,
    ray_jacobian,
    with_parameters,
)
from warpvis.cameras.lenses._parameters import implicit_jacobian
from warpvis.errors import CameraError

from support.lens_models import HEIGHT, LENSES, WIDTH

pytestmark = pytest.mark.filterwarnings("ignore::warpvis.errors.IntrinsicsWarning")

TURNING = {"opencv folded", "fisheye folded", "mei, rim"}
"""Models that turn back within the image: derivatives are infinite at the border of their domain."""
COEFFICIENTS = "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty"
NAMES = {
    "opencv 14": f"fx fy cx cy {COEFFICIENTS}",
    "opencv 5": "fx fy cx cy k1 k2 p1 p2 k3",
    "fisheye": "fx fy cx cy k1 k2 k3 k4",
    "thin prism": "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1",
    "aria": "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3",
    "double sphere": "fx fy cx cy xi alpha",
    "eucm": "fx fy cx cy alpha beta",
    "fov": "fx fy cx cy omega",
    "division": "fx fy cx cy k",
    "ftheta": "cx cy k1 k2 k3",
    "mei": "fx fy cx cy xi k1 k2 p1 p2",
    "scaramuzza": "cx cy a0 a1 a2 a3 a4 affine_0 affine_1 affine_2 affine_3",
    "equirectangular": "width height",
    "cylindrical": "fx fy cx cy",
}


@dataclass(frozen=True)
class Stereographic(lenses.Lens):
    """A lens of another package, without formulas for derivatives."""

    f: float
    cx: float
    cy: float
    squeeze: tuple[float, ...] = (1.0, 1e-3)
    maps: str = "stereographic"
    max_angle = np.pi
    turns_back = False

    def __post_init__(self):
        if self.f <= 0:
            raise CameraError(f"f must be greater than 0 px, got {self.f}")

    def _project(self, points):
        x, y, z = points.T
        scale = 2 * self.f / (np.linalg.norm(points, axis=1) + z)
        return np.stack([scale * x * self.squeeze[0] + self.cx, scale * (y + self.squeeze[1] * x) + self.cy], axis=1)

    def _unproject(self, pixels):
        x, y = (pixels - [self.cx, self.cy]).T / (2 * self.f)
        x = x / self.squeeze[0]
        y = y - self.squeeze[1] * x
        squared = x * x + y * y
        return np.stack([2 * x, 2 * y, 1 - squared], axis=1) / (1 + squared)[:, None]


CAMERAS = {
    "pinhole": wv.Camera(32, 24, 26, 25, 16.5, 11),
    "orthographic": OrthographicCamera(32, 24, 26, 25, 16.5, 11),
    "cylindrical": WideCamera(32, 24, 2.5),
    "spherical": WideCamera(32, 24, 5.5, "spherical"),
    "another lens": LensCamera(Stereographic(9.0, 16, 12), 32, 24),
    "another lens, ahead": LensCamera(Stereographic(40.0, 16, 12), 32, 24),
}


def difference(camera, index, jacobian, table=lambda camera: camera.rays):
    """Return central differences of fourth order of a table, with a step that moves its entries by at most 1e-5."""
    values, unit = parameter_values(camera), np.eye(len(parameter_names(camera)))[index]
    step = 1e-5 / np.abs(jacobian[..., index]).max()

    def change(h):
        above, below = (table(with_parameters(camera, values + side * h * unit)) for side in (1, -1))
        return (above - below) / (2 * h)

    near, far = change(step), change(2 * step)
    return (4 * near - far) / 3


def assert_equals_differences(camera, border=0):
    """Compare where rays are at least `border` pixels from pixels without a ray."""
    jacobian = ray_jacobian(camera)
    assert jacobian.dtype == np.float64 and np.isfinite(jacobian).all()
    without_ray = ~np.isfinite(camera.rays).all(axis=-1)
    assert (jacobian[without_ray] == 0).all()
    compared = ~without_ray
    for _ in range(border):
        inner = np.pad(compared, 1, constant_values=True)
        compared = inner[1:-1, 1:-1] & inner[:-2, 1:-1] & inner[2:, 1:-1] & inner[1:-1, :-2] & inner[1:-1, 2:]
    assert compared.sum() > 0.1 * compared.size
    for index, name in enumerate(parameter_names(camera)):
        column = jacobian[compared][..., index]
        expected = difference(camera, index, jacobian)[compared]
        known = np.isfinite(expected).all(axis=-1)
        assert known.mean() > 0.99
        assert np.abs(column - expected)[known].max() <= 1e-6 * np.abs(column).max(), name


def small(name, kind=None):
    """Return a camera of a lens model with a quarter of the resolution, or the middle if lengths are coefficients."""
    lens = LENSES[name]
    numbers = {key: getattr(lens, key) for key in ("fx", "fy", "cx", "cy", "width", "height") if hasattr(lens, key)}
    if "fx" in numbers or "width" in numbers:
        changes = {key: value / 4 for key, value in numbers.items()}
    else:
        changes = {"cx": lens.cx - 120, "cy": lens.cy - 90}
    return LensCamera(replace(lens, **changes), WIDTH // 4, HEIGHT // 4, kind=kind)


@pytest.mark.smoke("opencv 5", "fisheye", "double sphere", "scaramuzza", "ftheta", "cylindrical")
@pytest.mark.parametrize("name", LENSES)
def test_rays_of_lenses(name):
    lens = LENSES[name]
    camera = small(name, "range")
    if not (camera.directions[..., 2] < 0.1).any():  # close to 90 degrees, rays with z = 1 are long
        camera = small(name, "z")
    assert_equals_differences(camera, border=4 * (name in TURNING))
    names = parameter_names(LensCamera(lens, WIDTH, HEIGHT))
    assert " ".join(names) == NAMES.get(name, " ".join(names))


@pytest.mark.smoke("eucm", "thin prism", "mei, parabolic")
@pytest.mark.parametrize("name", [name for name in LENSES if name not in {"opencv radial", "thin prism, radial"}])
def test_rays_of_whole_images(name):
    """Compare with the implicit derivatives, which depend on `project` only, up to the corners."""
    lens = LENSES[name]
    camera = LensCamera(lens, WIDTH, HEIGHT, kind="range")
    rows = np.s_[3::17, 5::17]
    directions = camera.directions[rows].reshape(-1, 3)
    expected = implicit_jacobian(lens, directions)
    jacobian = ray_jacobian(camera)[rows].reshape(expected.shape)
    known = np.isfinite(expected).all(axis=(1, 2)) & (np.abs(jacobian).max(axis=(1, 2)) > 0)
    assert known.sum() > 0.9 * np.isfinite(directions[:, 0]).sum()
    steep = 1e-4 if name in TURNING else 2e-8
    error = np.abs(jacobian - expected).max(axis=1) / np.abs(jacobian).max(axis=1).max(axis=0)
    assert np.quantile(error[known], 0.95) < 2e-8
    assert error[known].max() < steep


@pytest.mark.parametrize("name", [name for name in CAMERAS if name != "orthographic"])
def test_rays_of_cameras(name):
    assert_equals_differences(CAMERAS[name])


@pytest.mark.parametrize("name", CAMERAS)
def test_origins_of_cameras(name):
    camera = CAMERAS[name]
    jacobian = origin_jacobian(camera)
    if name != "orthographic":
        assert jacobian is None
        return
    assert jacobian.shape == (24, 32, 3, 4)
    for index in range(4):
        expected = difference(camera, index, jacobian, lambda camera: camera.origins)
        assert np.abs(jacobian[..., index] - expected).max() < 1e-8
    assert not ray_jacobian(camera).any()


def test_rays_stay_of_depth_one():
    """The derivative of z, or of the length, is 0."""
    planar, ranged = small("opencv 5", "z"), LensCamera(LENSES["fisheye"], WIDTH, HEIGHT)
    assert ranged.kind == "range" and (ranged.rays[..., 2] < 0).any()
    assert not ray_jacobian(planar)[..., 2, :].any()
    along = np.einsum("...c,...cp->...p", ranged.rays, ray_jacobian(ranged))
    assert np.abs(along).max() < 1e-15 * np.abs(ray_jacobian(ranged)).max()


def test_a_lens_without_distortion_is_a_pinhole():
    camera = CAMERAS["pinhole"]
    lens = LensCamera(lenses.OpenCVPinhole(26, 25, 16.5, 11), 32, 24)
    np.testing.assert_allclose(ray_jacobian(lens)[..., :4], ray_jacobian(camera), atol=1e-16)


def test_the_center_of_the_image():
    """On the axis, where the azimuth is not defined, rays turn by 1 / f for each pixel."""
    for lens in (lenses.KannalaBrandt(10, 20, 4.5, 4.5), lenses.DoubleSphere(10, 20, 4.5, 4.5, 0.0, 0.0)):
        center = ray_jacobian(LensCamera(lens, 9, 9, kind="range"))[4, 4]
        expected = np.zeros_like(center)
        expected[0, 2], expected[1, 3] = -1 / 10, -1 / 20
        np.testing.assert_allclose(center, expected, atol=1e-15)


@pytest.mark.parametrize("omega", [0.0, 1e-6, -5e-5, 2e-4])
def test_fov_close_to_a_pinhole(omega):
    """The formula cancels for small omega, where a series replaces it."""
    camera = LensCamera(lenses.FOV(30, 30, 16, 12, omega), 32, 24)
    r = np.linalg.norm(camera.rays[..., :2], axis=-1)
    change = np.linalg.norm(ray_jacobian(camera)[..., 4], axis=-1)
    np.testing.assert_allclose(change, np.abs(2 * omega * (r / 12 - r**3 / 3)), rtol=1e-5, atol=1e-10)


@pytest.mark.parametrize("name", [*LENSES, *CAMERAS])
def test_round_trip(name):
    camera = CAMERAS[name] if name in CAMERAS else replace(small(name), near=0.5, far=9.0)
    names, values = parameter_names(camera), parameter_values(camera)
    assert values.shape == (len(names),) and values.dtype == np.float64 and len(set(names)) == len(names)
    assert with_parameters(camera, values) == camera
    changed = with_parameters(camera, values * (1 + 1e-6))
    assert changed != camera and type(changed) is type(camera)
    np.testing.assert_array_equal(parameter_values(changed), values * (1 + 1e-6))
    assert (changed.shape, changed.near, changed.far, changed.kind) == (
        camera.shape,
        camera.near,
        camera.far,
        camera.kind,
    )


def test_settings_are_not_parameters():
    lens = replace(LENSES["ftheta"], max_view_angle=1.5)
    camera = LensCamera(lens, WIDTH, HEIGHT)
    assert "max_view_angle" not in parameter_names(camera)
    assert with_parameters(camera, parameter_values(camera) * 1.001).lens.max_view_angle == 1.5
    assert parameter_names(CAMERAS["another lens"]) == ("f", "cx", "cy", "squeeze_0", "squeeze_1")


def test_rays_without_parameters():
    rays = Rays(np.eye(3))
    assert parameter_names(rays) == () and parameter_values(rays).shape == (0,)
    assert ray_jacobian(rays).shape == (3, 3, 0) and origin_jacobian(rays) is None
    assert with_parameters(rays, []) is rays
    with pytest.raises(CameraError, match=r"values must have shape \(0,\), got \(1,\)"):
        with_parameters(rays, [1.0])


def test_bad_values():
    pinhole, lens = CAMERAS["pinhole"], LensCamera(lenses.DoubleSphere(100, 100, 160, 120, -0.2, 0.6), 320, 240)
    with pytest.raises(CameraError, match=r"values must have shape \(4,\) \(fx fy cx cy\), got \(3,\)"):
        with_parameters(pinhole, [1, 2, 3])
    with pytest.raises(CameraError, match="values must be finite numbers, got nan"):
        with_parameters(pinhole, [26, np.nan, 16, 12])
    with pytest.raises(CameraError, match="focal lengths must be positive"):
        with_parameters(pinhole, [-26, 25, 16, 12])
    with pytest.raises(CameraError, match=r"alpha of a lens must be from 0 to 1, got 1\.2"):
        with_parameters(lens, [100, 100, 160, 120, -0.2, 1.2])
    with pytest.raises(CameraError, match="values must"):
        with_parameters(pinhole, "four")


@pytest.mark.parametrize("function", [parameter_names, parameter_values, ray_jacobian, origin_jacobian])
def test_bad_cameras(function):
    with pytest.raises(CameraError, match="camera must be a camera, got int"):
        function(3)
    with pytest.raises(CameraError, match="camera must be a camera, got KannalaBrandt"):
        function(LENSES["fisheye"])
