# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define pinhole cameras: intrinsics, image size and depth range."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.base import planar_struct
from warpvis.cameras.checks import (
    as_floats,
    as_rows,
    check_matrix,
    check_numbers,
    check_pixel_center,
    check_pixel_units,
    check_size,
    warn_of_improbable,
)
from warpvis.cameras.lenses import OpenCVPinhole
from warpvis.cameras.makers import CameraMakers
from warpvis.core.checks import check_choice, degrees_hint, is_number
from warpvis.core.messages import Message, read_camera_info
from warpvis.errors import CameraError

if TYPE_CHECKING:
    from warpvis.core.types import Json
    from warpvis.kernels.pinhole import PinholeCamera


@dataclass(frozen=True)
class Camera(CameraMakers):
    """An ideal pinhole camera with OpenCV axes: x right, y down, z forward.

    Pixel ``(x, y)`` covers the square from ``(x, y)`` to ``(x + 1, y + 1)``; its ray passes through the center at +0.5.
    Depth is planar: the z coordinate in the camera frame, in meters.
    """

    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    fx: float
    """Horizontal focal length [px]."""
    fy: float
    """Vertical focal length [px]."""
    cx: float
    """Principal point from the image's left edge [px]."""
    cy: float
    """Principal point from the image's top edge [px]."""
    near: float = 0.0
    """Minimum depth [m]; nearer surfaces read -inf and still occlude."""
    far: float = math.inf
    """Maximum depth [m]; farther surfaces read +inf."""

    kind = "z"
    ray_model: ClassVar[Literal["pinhole"]] = "pinhole"

    def __post_init__(self) -> None:
        check_numbers(self, "focal lengths must be positive")
        check_pixel_units(self.width, self.height, self)
        warn_of_improbable(self.width, self.height, self.fx, self.fy, self.cx, self.cy)

    @classmethod
    def from_fov(
        cls,
        width: int,
        height: int,
        *,
        hfov: float | None = None,
        vfov: float | None = None,
        near: float = 0.0,
        far: float = math.inf,
        vertical: Literal["square", "linear"] = "square",
    ) -> Camera:
        """Create a camera whose principal point is the image center.

        Args:
            width: Image width [px].
            height: Image height [px].
            hfov: Horizontal field of view [rad]. Give this or `vfov`.
            vfov: Vertical field of view [rad].
            near: Minimum depth [m].
            far: Maximum depth [m].
            vertical: ``"square"`` pixels have a single focal length, ``tan(ay/2) = tan(ax/2) Iv/Iu``; ``"linear"`` uses
                ``ay = ax Iv/Iu``, equation (4) of the paper, and requires `hfov`.

        Raises:
            CameraError: If the field of view is missing, given twice, or outside (0, pi).
        """
        if (hfov is None) == (vfov is None):
            raise CameraError("give either hfov or vfov, in radians")
        check_choice(vertical, "vertical", ("square", "linear"), CameraError)
        width, height = check_size(width, "width"), check_size(height, "height")
        if hfov is not None:
            fx = fy = _focal_length(width, hfov, "hfov")
            if vertical == "linear":
                fy = _focal_length(height, float(hfov) * height / width, "vfov")
        else:
            if vertical == "linear":
                raise CameraError('vertical="linear" derives the vertical field of view, so give hfov')
            assert vfov is not None  # for type checkers: one of the two is given
            fx = fy = _focal_length(height, vfov, "vfov")
        return cls(width, height, fx, fy, width / 2, height / 2, near, far)

    @classmethod
    def from_K(  # noqa: N802 - K is the field's name for the matrix
        cls,
        K: ArrayLike,  # noqa: N803
        width: int,
        height: int,
        *,
        pixel_center: float = 0.5,
        near: float = 0.0,
        far: float = math.inf,
    ) -> Camera:
        """Create a camera from an intrinsic matrix.

        Args:
            K: Intrinsics ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`` [px], shape ``(3, 3)``.
            width: Image width [px].
            height: Image height [px].
            pixel_center: Coordinate of a pixel's center in the convention of `K`: 0.5 if ``cx = width / 2`` is the
                middle (MuJoCo, COLMAP, nerfstudio, Open3D), 0.0 for OpenCV, ROS and BOP.
            near: Minimum depth [m].
            far: Maximum depth [m].

        Raises:
            CameraError: If `K` has another shape, skew, a last row other than 0 0 1, or is divided by the image size.
        """
        return cls(width, height, *check_matrix(K, pixel_center), near, far)

    @classmethod
    def from_camera_info(
        cls, message: Message, *, rectified: bool = True, near: float = 0.0, far: float = math.inf
    ) -> Camera:
        """Create a camera from a ``sensor_msgs/CameraInfo`` of ROS 2, rosbags or ROS 1.

        Binning and region of interest change size and intrinsics as in `image_geometry`. The message's pixel centers
        are at integer coordinates. A warning is issued if the camera is the second of a stereo pair, offset from its
        frame.

        Args:
            message: The message, or any object with its fields.
            rectified: Whether the images are rectified (intrinsics from `P`). Raw images (intrinsics from `K`) match a
                pinhole only if the distortion is zero; `from_raw_camera_info` supports distortion.
            near: Minimum depth [m], which the message does not contain.
            far: Maximum depth [m], which the message does not contain.

        Raises:
            CameraError: If the camera is not calibrated (its `K` is zero), has distortion, or its numbers do not define
                a pinhole.
            MessageError: If `message` is not a CameraInfo.
        """
        info = read_camera_info(message, rectified=rectified)
        return cls.from_K(info.K, info.width, info.height, pixel_center=0.0, near=near, far=far)

    @classmethod
    def kinect(cls, *, vertical: Literal["square", "linear"] = "square") -> Camera:
        """Create the paper's camera: a Kinect, 320x240, ``ax`` = 0.994837 rad (57 degrees), 0.3 to 4.5 m."""
        return cls.from_fov(320, 240, hfov=0.994837, near=0.3, far=4.5, vertical=vertical)

    def to_K(self, *, pixel_center: float = 0.5) -> NDArray[np.float64]:  # noqa: N802
        """Return the intrinsic matrix [px], shape ``(3, 3)``; `pixel_center` is 0.0 for OpenCV, ROS and BOP."""
        shift = check_pixel_center(pixel_center) - 0.5
        return np.array([[self.fx, 0, self.cx + shift], [0, self.fy, self.cy + shift], [0, 0, 1]])

    @property
    def hfov(self) -> float:
        """Horizontal field of view [rad]."""
        return math.atan2(self.cx, self.fx) + math.atan2(self.width - self.cx, self.fx)

    @property
    def vfov(self) -> float:
        """Vertical field of view [rad]."""
        return math.atan2(self.cy, self.fy) + math.atan2(self.height - self.cy, self.fy)

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project camera-frame points to image coordinates.

        Args:
            points: Points in the camera frame [m], shape ``(..., 3)``.

        Returns:
            Coordinates ``(x, y)`` [px] from the image's top left corner, shape ``(..., 2)``; NaN where z <= 0.
        """
        points = as_rows(points, 3, "points")
        z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        return np.stack([self.fx * points[..., 0] / z + self.cx, self.fy * points[..., 1] / z + self.cy], axis=-1)

    def back_project(self, pixels: ArrayLike, depth: ArrayLike) -> NDArray[np.float64]:
        """Convert image coordinates with depth to camera-frame points, equations (3) to (5).

        Args:
            pixels: Coordinates ``(x, y)`` [px], shape ``(..., 2)``; a pixel's center is its index + 0.5.
            depth: Planar depth [m], shape ``(...)``.

        Returns:
            Points [m], shape ``(..., 3)``.
        """
        pixels, z = as_rows(pixels, 2, "pixels"), as_floats(depth, "depth")
        try:
            np.broadcast_shapes(pixels.shape[:-1], z.shape)
        except ValueError:
            raise CameraError(f"depth must be of shape {pixels.shape[:-1]} as pixels are, got {z.shape}") from None
        x = z * (pixels[..., 0] - self.cx) / self.fx
        y = z * (pixels[..., 1] - self.cy) / self.fy
        return np.stack(np.broadcast_arrays(x, y, z), axis=-1)

    @property
    def rays(self) -> NDArray[np.float64]:
        """Rays of depth 1 through the pixel centers, shape ``(height, width, 3)``."""
        y, x = np.mgrid[: self.height, : self.width] + 0.5
        return self.back_project(np.stack([x, y], axis=-1), np.ones_like(x))

    def depth_rays(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays with z = 1 through points [px] in the image or beyond, shape ``(..., 2)``."""
        return self.back_project(pixels, 1.0)

    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return the viewing directions of image coordinates.

        Args:
            pixels: Coordinates ``(x, y)`` [px], shape ``(..., 2)``; a pixel's center is its index + 0.5.

        Returns:
            Unit vectors in the camera frame, shape ``(..., 3)``.
        """
        rays = self.depth_rays(pixels)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Mask of pixels that have no ray, shape ``(height, width)``: all False."""
        return np.zeros((self.height, self.width), dtype=bool)

    @property
    def lens(self) -> OpenCVPinhole:  # type: ignore[override]
        """The intrinsics as a lens without distortion."""
        return OpenCVPinhole(self.fx, self.fy, self.cx, self.cy, (0.0,) * 5)

    def pixel_size(self) -> tuple[float, float]:
        """Return the width and the height of a pixel at depth 1."""
        return 1 / self.fx, 1 / self.fy

    def describe(self) -> str:
        """Describe the image size and the intrinsics in a few words."""
        intrinsics = f"fx={self.fx:.6g} fy={self.fy:.6g} cx={self.cx:.6g} cy={self.cy:.6g}"
        return f"{self.width}x{self.height} pixels, {intrinsics}"

    def to_dict(self) -> dict[str, Json]:
        """Return the fields as a JSON object, for `camera_from_dict`; an infinite `far` becomes None."""
        return {**asdict(self), "far": None if math.isinf(self.far) else self.far}

    def _near_reach(self) -> float:
        """Return the distance to the farthest image corner on the near plane, plus a small margin [m]."""
        x = max(abs(self.cx), abs(self.width - self.cx)) / self.fx
        y = max(abs(self.cy), abs(self.height - self.cy)) / self.fy
        return 1.0001 * self.near * math.sqrt(1 + x * x + y * y)

    def device_struct(self, *, clip_near: bool = False) -> PinholeCamera:
        """Return the camera as the struct that kernels use; `clip_near` as for `ray_range`."""
        clips = clip_near and self.near > 0
        clip = (clip_inv_z(self.near), self._near_reach()) if clips else (math.inf, 0.0)
        return planar_struct(self, *clip)


def clip_inv_z(near: float) -> float:
    """Return the greatest 1 / z, in single precision, for which 1 / (1 / z) is at least `near`."""
    min_z, one = np.float32(near), np.float32(1)
    max_inv_z = one / min_z
    while one / max_inv_z < min_z:
        max_inv_z = np.nextafter(max_inv_z, np.float32(0))
    return float(max_inv_z)


def require_camera(camera: object, name: str = "camera") -> Camera:
    """Return `camera`, or raise `CameraError` if it is not a pinhole camera."""
    if not isinstance(camera, Camera):
        hint = getattr(camera, "usage_hint", "")
        if hint:
            raise CameraError(f"{name} must be a pinhole here, a warpvis.Camera, got a {type(camera).__name__}: {hint}")
        raise CameraError(f"{name} must be a warpvis.Camera, got {type(camera).__name__}")
    return camera


def _focal_length(size: int, fov: float, name: str) -> float:
    if not is_number(fov) or not 0 < fov < math.pi:
        raise CameraError(f"{name} must be between 0 and pi radians, got {fov!r}{degrees_hint(fov)}")
    return size / 2 / math.tan(fov / 2)
