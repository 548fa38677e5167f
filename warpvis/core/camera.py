# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Describe pinhole cameras: intrinsics, image size and depth range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal

from warpvis.core.camera_makers import CameraMakers
from warpvis.core.checks import check_choice, degrees_hint, is_number
from warpvis.core.ray_camera import RayCamera
from warpvis.core.user_warnings import warn_user
from warpvis.errors import ArrayError, CameraError, IntrinsicsWarning

if TYPE_CHECKING:
    import mujoco
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from warpvis.core.messages import Message, MessageTypes, Stamp
    from warpvis.kernels.pinhole import PinholeCamera


_FIRST_PIXELS = 1.5
"""A normalized principal point, and half a pixel where another convention of pixels' centres was read [px]."""

_MOST_TANGENT = 20
"""Tangent of the angle that an image sees to one side of its axis: 87 degrees."""

_SAME_PIXELS = 0.01
"""Intrinsics of one camera differ by less where they were rounded on their way [px]."""


@dataclass(frozen=True)
class Camera(CameraMakers):
    """An ideal pinhole camera with OpenCV axes: x right, y down, z forward.

    Pixel ``(x, y)`` covers the square from ``(x, y)`` to ``(x + 1, y + 1)``; its ray goes through the centre at +0.5.
    Depth is planar: the z coordinate in the camera frame, in metres.
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
    """Least depth the camera measures [m]; what is nearer reads -inf and still occludes."""
    far: float = math.inf
    """Greatest depth the camera measures [m]; what is farther reads +inf."""

    def __post_init__(self) -> None:
        check_numbers(self, "focal lengths must be positive")
        check_pixel_units(self.width, self.height, self)
        _warn_of(self.width, self.height, self.fx, self.fy, self.cx, self.cy)

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
        """Make a camera with its principal point in the image's centre.

        Args:
            width: Image width [px].
            height: Image height [px].
            hfov: Horizontal field of view [rad]. Give this or `vfov`.
            vfov: Vertical field of view [rad].
            near: Least depth [m].
            far: Greatest depth [m].
            vertical: ``"square"`` pixels have one focal length, ``tan(ay/2) = tan(ax/2) Iv/Iu``; ``"linear"`` takes
                the paper's ``ay = ax Iv/Iu`` in equation (4), and needs `hfov`.

        Raises:
            CameraError: The field of view is missing, given twice, or outside (0, pi).
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
    def from_mujoco(
        cls, model: mujoco.MjModel, camera: int | str = -1, width: int | None = None, height: int | None = None
    ) -> Camera:
        """Make a camera of a MuJoCo model's; see `warpvis.mujoco.camera_from_mujoco`.

        Args:
            model: A `mujoco.MjModel`.
            camera: Name or id; -1 for the free camera.
            width: Image width [px]; the camera's own resolution by default.
            height: Image height [px]; likewise.

        Raises:
            CameraError: The model has no such camera, or it is no pinhole.
        """
        from warpvis.mujoco import camera_from_mujoco

        made = camera_from_mujoco(model, camera, width, height)
        if not isinstance(made, cls):
            name = "the free camera" if camera == -1 else f"camera {camera!r}"
            raise CameraError(
                f"{name} is orthographic: warpvis.mujoco.camera_from_mujoco makes an OrthographicCamera of it"
            )
        return made

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
        """Make a camera from an intrinsic matrix.

        Args:
            K: Intrinsics ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`` [px], shape ``(3, 3)``.
            width: Image width [px].
            height: Image height [px].
            pixel_center: Coordinate of a pixel's centre in the convention `K` comes from: 0.5 where ``cx = width / 2``
                is the middle (MuJoCo, COLMAP, nerfstudio, Open3D), 0.0 for OpenCV, ROS and BOP.
            near: Least depth [m].
            far: Greatest depth [m].

        Raises:
            CameraError: `K` has another shape, skew, a last row other than 0 0 1, or is divided by the image's size.
        """
        return cls(width, height, *check_matrix(K, pixel_center), near, far)

    @classmethod
    def from_camera_info(
        cls, message: Message, *, rectified: bool = True, near: float = 0.0, far: float = math.inf
    ) -> Camera:
        """Make a camera of a ``sensor_msgs/CameraInfo``, of ROS 2, rosbags or ROS 1.

        Binning and region of interest change size and intrinsics as `image_geometry` has it. The message's pixels have
        their centres at whole numbers. Where a second stereo camera stands beside its frame, a warning says so.

        Args:
            message: The message, or any object with its fields.
            rectified: Whether the images are rectified, which `P` is for. The raw ones, which `K` is for, are a
                pinhole's only where the distortion is zero.
            near: Least depth [m], which the message does not have.
            far: Greatest depth [m]; likewise.

        Raises:
            CameraError: The camera is not calibrated (its `K` is zero), has distortion, or the message's numbers make
                no pinhole.
            MessageError: It is no CameraInfo.
        """
        from warpvis.core.messages import read_camera_info

        info = read_camera_info(message, rectified=rectified)
        return cls.from_K(info.K, info.width, info.height, pixel_center=0.0, near=near, far=far)

    @classmethod
    def kinect(cls, *, vertical: Literal["square", "linear"] = "square") -> Camera:
        """Make the paper's camera: a Kinect, 320x240, ``ax`` = 0.994837 rad (57 degrees), 0.3 to 4.5 m."""
        return cls.from_fov(320, 240, hfov=0.994837, near=0.3, far=4.5, vertical=vertical)

    def to_K(self, *, pixel_center: float = 0.5) -> NDArray[np.float64]:  # noqa: N802
        """Return the intrinsic matrix [px], shape ``(3, 3)``; `pixel_center` is 0.0 for OpenCV, ROS and BOP."""
        import numpy as np

        shift = _check_pixel_center(pixel_center) - 0.5
        return np.array([[self.fx, 0, self.cx + shift], [0, self.fy, self.cy + shift], [0, 0, 1]])

    def to_camera_info(self, *, frame_id: str, stamp: Stamp = 0.0, types: MessageTypes | None = None) -> Message:
        """Return the camera as a ``sensor_msgs/CameraInfo`` of ROS 2, rectified, with pixel centres at whole numbers.

        Args:
            frame_id: The camera's optical frame, which has OpenCV's axes.
            stamp: When the image was taken [s], or a Time message.
            types: A type store of rosbags; by default ROS's own classes, which must be there then.

        Raises:
            MessageError: An argument is not what it has to be, or ROS is not there.
        """
        from warpvis.core.messages import MessageMaker

        maker = MessageMaker(types)
        size, k = (self.width, self.height), self.to_K(pixel_center=0.0)
        return maker.camera_info(size, k, maker.header(frame_id, stamp))

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
        import numpy as np

        points = _as_floats(points, "points")
        if points.shape[-1:] != (3,):
            raise CameraError(f"points must have shape (..., 3), got {points.shape}")
        z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        return np.stack([self.fx * points[..., 0] / z + self.cx, self.fy * points[..., 1] / z + self.cy], axis=-1)

    def back_project(self, pixels: ArrayLike, depth: ArrayLike) -> NDArray[np.float64]:
        """Turn image coordinates and their depth into camera-frame points, equations (3) to (5).

        Args:
            pixels: Coordinates ``(x, y)`` [px], shape ``(..., 2)``; a pixel's centre is its index + 0.5.
            depth: Planar depth [m], shape ``(...)``.

        Returns:
            Points [m], shape ``(..., 3)``.
        """
        import numpy as np

        pixels, z = _as_floats(pixels, "pixels"), _as_floats(depth, "depth")
        if pixels.shape[-1:] != (2,):
            raise CameraError(f"pixels must have shape (..., 2), got {pixels.shape}")
        try:
            np.broadcast_shapes(pixels.shape[:-1], z.shape)
        except ValueError:
            raise CameraError(f"depth must be of shape {pixels.shape[:-1]} as pixels are, got {z.shape}") from None
        x = z * (pixels[..., 0] - self.cx) / self.fx
        y = z * (pixels[..., 1] - self.cy) / self.fy
        return np.stack(np.broadcast_arrays(x, y, z), axis=-1)

    def _near_reach(self) -> float:
        """Compute how far the corners of the image on the near plane are, and a little more [m]."""
        x = max(abs(self.cx), abs(self.width - self.cx)) / self.fx
        y = max(abs(self.cy), abs(self.height - self.cy)) / self.fy
        return 1.0001 * self.near * math.sqrt(1 + x * x + y * y)

    def device_struct(self, *, clip_near: bool = False) -> PinholeCamera:
        """Return the camera as kernels take it, a `warpvis.kernels.pinhole.PinholeCamera`.

        Args:
            clip_near: Whether what is nearer than `near` is not there, instead of hiding what is behind it.
        """
        from warpvis.kernels.pinhole import PinholeCamera

        camera = PinholeCamera()
        clips = clip_near and self.near > 0
        camera.most_inv_z = most_inv_z(self.near) if clips else math.inf
        camera.clip_reach = self._near_reach() if clips else 0.0
        camera.width, camera.height = self.width, self.height
        camera.fx, camera.fy, camera.cx, camera.cy = self.fx, self.fy, self.cx, self.cy
        camera.near, camera.far = self.near, self.far
        return camera


def most_inv_z(near: float) -> float:
    """Find the greatest 1 / z, in single precision, of which 1 / (1 / z) is still `near` or more."""
    import numpy as np

    least, one = np.float32(near), np.float32(1)
    most = one / least
    while one / most < least:
        most = np.nextafter(most, np.float32(0))
    return float(most)


def check_numbers(camera: Any, positive: str) -> None:
    """Check the fields of a camera, and make whole numbers and floats of them, whichever types they were given as.

    Args:
        camera: A frozen dataclass with `width`, `height`, `fx`, `fy`, `cx`, `cy`, `near` and `far`.
        positive: What a message says of `fx` and `fy`, which have to be more than 0.

    Raises:
        CameraError: One is not what it has to be.
    """
    for name in ("width", "height"):
        object.__setattr__(camera, name, check_size(getattr(camera, name), name))
    _make_floats(camera, ("fx", "fy", "cx", "cy"))
    if camera.fx <= 0 or camera.fy <= 0:
        raise CameraError(f"{positive}, got fx={camera.fx}, fy={camera.fy}")
    check_range(camera)


def check_pixel_units(width: int, height: int, intrinsics: Any) -> None:
    """Check that intrinsics are in pixels, and not divided by the image's size.

    A normalized principal point is in the first pixel, and normalized focal lengths are about 1. In pixels, focal
    lengths of less than a 20th of the image's size would see 87 degrees to one side of such a point.

    Raises:
        CameraError: `fx`, `fy`, `cx` and `cy` of `intrinsics` are normalized, or those of an identity matrix.
    """
    fx, fy, cx, cy = (getattr(intrinsics, name) for name in ("fx", "fy", "cx", "cy"))
    in_corner = max(abs(cx), abs(cy)) <= _FIRST_PIXELS
    if in_corner and fx * _MOST_TANGENT < width and fy * _MOST_TANGENT < height:
        raise CameraError(
            f"intrinsics must be in pixels of an image of {width} x {height}, got fx={fx:g}, fy={fy:g} and a principal "
            f"point in the first pixel: if they are normalized, multiply fx and cx by {width}, fy and cy by {height}"
        )


def check_range(camera: Any) -> None:
    """Check `near` and `far` of a camera, a frozen dataclass, and make floats of them.

    Raises:
        CameraError: One is not what it has to be.
    """
    _make_floats(camera, ("near", "far"))
    if camera.near < 0 or camera.far <= camera.near:
        raise CameraError(f"the depth range needs 0 <= near < far, got near={camera.near}, far={camera.far}")


def _make_floats(camera: Any, names: Sequence[str]) -> None:
    for name in names:
        value = getattr(camera, name)
        if not is_number(value) or math.isnan(value) or (math.isinf(value) and name != "far"):
            raise CameraError(f"{name} must be a finite number, got {value!r}")
        object.__setattr__(camera, name, float(value))


def check_matrix(k: ArrayLike, pixel_center: float) -> tuple[float, float, float, float]:
    """Read ``fx fy cx cy`` [px], for pixel centres at +0.5, of an intrinsic matrix whose own are at `pixel_center`.

    Raises:
        CameraError: It has another shape, skew, or a last row other than 0 0 1.
    """
    import numpy as np

    matrix = _as_floats(k, "K")
    if matrix.shape != (3, 3):
        raise CameraError(f"K must have shape (3, 3), got {matrix.shape}")
    if np.any(matrix[[0, 1, 2, 2], [1, 0, 0, 1]] != 0) or matrix[2, 2] != 1:
        raise CameraError(
            f"K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] without skew, got {matrix.tolist()}; "
            "undistort and rectify the image first"
        )
    shift = 0.5 - _check_pixel_center(pixel_center)
    fx, fy, cx, cy = matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    return fx, fy, cx + shift, cy + shift


def same_pinhole(camera: Camera, other: Camera) -> bool:
    """Tell whether two pinholes have the same pixels, whatever their ranges are."""
    numbers = ((camera.fx, other.fx), (camera.fy, other.fy), (camera.cx, other.cx), (camera.cy, other.cy))
    same_size = (camera.width, camera.height) == (other.width, other.height)
    return same_size and all(abs(a - b) < _SAME_PIXELS for a, b in numbers)


def describe_pinhole(camera: Camera) -> str:
    """Say in a few words which pixels a pinhole has."""
    intrinsics = f"fx={camera.fx:.6g} fy={camera.fy:.6g} cx={camera.cx:.6g} cy={camera.cy:.6g}"
    return f"{camera.width}x{camera.height} pixels, {intrinsics}"


def require_camera(camera: object) -> Camera:
    """Return `camera` itself; raise `CameraError` if it is no pinhole."""
    if not isinstance(camera, Camera):
        if isinstance(camera, RayCamera):
            raise CameraError(
                f"camera must be a pinhole here, a warpvis.Camera, got a {type(camera).__name__}: {camera.taken_by}"
            )
        raise CameraError(f"camera must be a warpvis.Camera, got {type(camera).__name__}")
    return camera


@lru_cache(maxsize=1024)  # once for each: cameras are made anew where only their range differs
def _warn_of(width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> None:
    """Warn of intrinsics that are rarely meant: of another image size, or divided by the image's."""
    problem = ""
    if min(fx, fy) < 1:
        problem = f"focal lengths are fx={fx:g}, fy={fy:g}, less than a pixel: intrinsics are in pixels"
    elif not (0 <= cx <= width and 0 <= cy <= height):
        problem = f"the principal point ({cx:g}, {cy:g}) is outside of the image of {width} x {height} pixels"
    if problem:
        warn_user(f"{problem}; are the intrinsics of an image of this size?", IntrinsicsWarning)


def _as_floats(value: object, name: str) -> NDArray[np.float64]:
    from warpvis.core.arrays import as_numpy

    try:
        return as_numpy(value, name=name).astype("float64")
    except ArrayError as error:
        raise CameraError(str(error)) from None


def check_size(value: object, name: str) -> int:
    """Return a side of an image: a whole number, of whichever type, that 32 bits hold.

    Raises:
        CameraError: It is none.
    """
    if not is_number(value) or not 1 <= value < 2**31 or int(value) != value:
        raise CameraError(f"{name} must be a whole number of pixels from 1 up, got {value!r}")
    return int(value)


def _focal_length(size: int, fov: float, name: str) -> float:
    if not is_number(fov) or not 0 < fov < math.pi:
        raise CameraError(f"{name} must be between 0 and pi radians, got {fov!r}{degrees_hint(fov)}")
    return size / 2 / math.tan(fov / 2)


def _check_pixel_center(pixel_center: float) -> float:
    if not is_number(pixel_center) or pixel_center not in (0.0, 0.5):
        raise CameraError(f"pixel_center must be 0.5 or 0.0, got {pixel_center!r}")
    return pixel_center
