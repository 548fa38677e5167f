# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Interfaces of cameras: of all, and of those with a lens, whose image is defined between the pixel centers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.lenses import Lens, lens_to_ros
from warpvis.core.messages import Message, MessageMaker, MessageTypes, Stamp

if TYPE_CHECKING:
    from warpvis.core.poses import Convention
    from warpvis.core.types import Json
    from warpvis.kernels.casting.rays import RayRange
    from warpvis.kernels.pinhole import PinholeCamera

DepthKind = Literal["z", "range"]
"""Definition of depth: along the axis of the camera, or along the ray."""

RayModel = Literal["pinhole", "parallel", "table"]
"""Definition of the rays of pixels: through an image plane with ``fx fy cx cy``, from the camera's center or parallel
to its axis, or by a table, `rays`."""

Value = TypeVar("Value")
"""Type of a cached value."""

_SAME_PIXELS = 0.01
"""Intrinsics that differ by less belong to the same camera: the difference is rounding [px]."""


class AnyCamera(ABC):
    """A camera: the ray of each pixel, and a range of depth.

    By default, the camera frame has OpenCV axes, rays have a common origin and no times, and the image has `height`
    rows and `width` columns.
    """

    width: int
    height: int
    near: float
    far: float
    kind: DepthKind | None
    ray_model: ClassVar[RayModel]
    axes: Convention = "opencv"
    usage_hint = ""
    """Text for error messages: functions that accept the camera."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the image of one view: height and width, or the number of rays of a list."""
        return self.height, self.width

    @property
    @abstractmethod
    def rays(self) -> NDArray[np.float64]:
        """Rays of depth 1 for all pixels, shape ``(*shape, 3)``; NaN where a pixel has no ray."""

    @property
    def origins(self) -> NDArray[np.float64] | None:
        """Ray origins in the camera frame [m], with the shape of the rays; None if all are zero."""
        return None

    @property
    def times(self) -> NDArray[np.float64] | None:
        """Time of each ray, after the start of the frame [s], shape ``shape``; None if not given."""
        return None

    def prepared(self, name: Hashable, make: Callable[[], Value]) -> Value:
        """Return data of a caster for the rays, such as a copy on a device; cached by cameras with a table of rays."""
        return make()

    def _contains(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return whether image points [px], shape ``(..., 2)``, are in the image, shape ``(..., 1)``."""
        inside = (points >= 0) & (points < (self.width, self.height))
        return inside[..., :1] & inside[..., 1:]

    def ray_range(self, *, clip_near: bool = False) -> RayRange:
        """Return the range of depth as the struct of kernels that read rays from arrays.

        Args:
            clip_near: Whether surfaces nearer than `near` are transparent, instead of occluding what is behind them.
        """
        from warpvis.kernels.casting.rays import RayRange

        struct = RayRange()
        struct.near, struct.far, struct.is_planar = self.near, self.far, self.kind == "z"
        struct.clip = self.near if clip_near else 0.0
        return struct

    @abstractmethod
    def pixel_size(self) -> tuple[float, float]:
        """Return the typical width and height of a pixel: at depth 1, in meters or in radians, by `ray_model`."""

    @abstractmethod
    def device_struct(self, *, clip_near: bool = False) -> Any:
        """Return the camera as the struct that its kernels use; `clip_near` as for `ray_range`."""


class ProjectingCamera(AnyCamera):
    """A camera that projects points to its image by a lens: a pinhole, or a `LensCamera`."""

    lens: Lens
    """Mapping of directions to image points; equal lenses have equal images."""

    @property
    @abstractmethod
    def mask(self) -> NDArray[np.bool_]:
        """Mask of pixels without a ray, shape ``(height, width)``: the lens maps no direction to them."""

    @abstractmethod
    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project camera-frame points [m], shape ``(..., 3)``, to image points ``(x, y)`` [px]; NaN if impossible."""

    @abstractmethod
    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return the unit vectors of image points ``(x, y)`` [px]; NaN where no direction maps to the point."""

    @abstractmethod
    def depth_rays(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays of depth 1 through points [px] in the image or beyond, shape ``(..., 2)``; NaN without a ray."""

    def rays_at(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays of depth 1 through image points [px], shape ``(..., 2)``; NaN outside of the image."""
        rays = self.depth_rays(pixels)
        return np.where(self._contains(np.asarray(pixels)), rays, np.nan)

    def has_pixels_of(self, other: object) -> bool:
        """Return whether another camera has the same size, lens and kind of depth; depth ranges may differ."""
        mine = (self.width, self.height, self.kind)
        if not isinstance(other, ProjectingCamera) or mine != (other.width, other.height, other.kind):
            return False
        if not (self.lens.is_pinhole and other.lens.is_pinhole):
            return self.lens == other.lens
        return all(
            abs(a - b) < _SAME_PIXELS for a, b in zip(intrinsics(self.lens), intrinsics(other.lens), strict=True)
        )

    @abstractmethod
    def describe(self) -> str:
        """Describe the image size and the lens in a few words."""

    @abstractmethod
    def to_dict(self) -> dict[str, Json]:
        """Return the fields as a JSON object, for `camera_from_dict`; an infinite `far` becomes None."""

    def to_camera_info(self, *, frame_id: str, stamp: Stamp = 0.0, types: MessageTypes | None = None) -> Message:
        """Convert to a ``sensor_msgs/CameraInfo`` of ROS 2, whose pixel centers are at integer coordinates.

        Images of a pinhole are rectified. With distortion, the message is for the raw image, with `K`, `D` and the
        distortion model, and `P` has the intrinsics of `K`; `Camera.from_raw_camera_info` is the inverse.

        Args:
            frame_id: The optical frame of the camera, with OpenCV axes.
            stamp: Acquisition time of the image [s], or a Time message.
            types: A type store of rosbags; by default ROS's own classes, which must be installed then.

        Raises:
            CameraError: If the lens is not one of ROS's models: ``plumb_bob``, ``rational_polynomial``,
                ``equidistant``.
            MessageError: If an argument is invalid, or if ROS is not installed.
        """
        k, d, model = lens_to_ros(self.lens)
        maker = MessageMaker(types)
        return maker.camera_info((self.width, self.height), k, maker.header(frame_id, stamp), d, model)


def intrinsics(lens: Any) -> tuple[float, float, float, float]:
    """Return ``fx fy cx cy`` [px] of a lens that has them, with pixel centers at +0.5."""
    return lens.fx, lens.fy, lens.cx, lens.cy


def planar_struct(camera: Any, clip_inv_z: float, clip_reach: float) -> PinholeCamera:
    """Return a pinhole or orthographic camera as the struct that kernels use."""
    from warpvis.kernels.pinhole import PinholeCamera

    struct = PinholeCamera()
    for name in ("width", "height", "fx", "fy", "cx", "cy", "near", "far"):
        setattr(struct, name, getattr(camera, name))
    struct.clip_inv_z, struct.clip_reach = clip_inv_z, clip_reach
    return struct
