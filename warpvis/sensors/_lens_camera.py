# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras with lenses: what their pixels show, as depth along the axis or along the ray."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.camera import Camera, check_pixel_units, check_range, check_size
from warpvis.core.checks import as_items, check_choice, check_whole
from warpvis.core.ray_camera import MAX_RAYS, DepthKind, Kept, LensedCamera, RayCamera
from warpvis.core.user_warnings import warn_user
from warpvis.errors import CameraError, IntrinsicsWarning
from warpvis.sensors.lenses import Lens, lens_to_ros

if TYPE_CHECKING:
    from warpvis.core.messages import Message, MessageTypes, Stamp


@dataclass(frozen=True)
class LensCamera(LensedCamera):
    """A camera with a lens, and OpenCV axes: x right, y down, z forward.

    Pixel ``(x, y)`` covers the square from ``(x, y)`` to ``(x + 1, y + 1)``; its ray goes through the centre at +0.5.
    `Renderer` and `render` take it. Rays come from the lens in double precision, once; nothing is interpolated.
    """

    lens: Lens
    """What maps directions to points of the image: one of `warpvis.sensors.lenses`."""
    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    near: float = 0.0
    """Least depth the camera measures [m]; what is nearer reads -inf and still occludes."""
    far: float = math.inf
    """Greatest depth the camera measures [m]; what is farther reads +inf."""
    kind: DepthKind | None = None
    """What depth is, of which `near` and `far` are too: ``"z"``, along the axis, or ``"range"``, along the ray. By
    default z where all rays are less than 90 degrees from the axis, else range, which wider lenses need."""

    def __post_init__(self) -> None:
        if not isinstance(self.lens, Lens):
            raise CameraError(f"lens must be one of warpvis.sensors.lenses, got {type(self.lens).__name__}")
        for name in ("width", "height"):
            object.__setattr__(self, name, check_size(getattr(self, name), name))
        _check_pixels(self.width, self.height)
        check_range(self)
        if all(hasattr(self.lens, name) for name in ("fx", "fy", "cx", "cy")):
            check_pixel_units(self.width, self.height, self.lens)
        shown = ~self.mask
        if not shown.any():
            raise CameraError("no pixel of the image has a ray: intrinsics are in pixels, of an image of this size")
        ahead = bool((self.directions[shown][:, 2] > 0).all())
        if self.kind is None:
            object.__setattr__(self, "kind", "z" if ahead else "range")
        check_choice(self.kind, "kind", ("z", "range"), CameraError)
        if self.kind == "z" and not ahead:
            count = int((self.directions[shown][:, 2] <= 0).sum())
            raise CameraError(
                f'kind="z" is for what is ahead, and {count} pixels look 90 degrees or more away: "range"'
            )
        self._warn_of_mask()

    def _warn_of_mask(self) -> None:
        count = int(self.mask.sum())
        if count:
            degrees = math.degrees(self.lens.max_angle)
            why = "turns back" if self.lens.turns_back else "ends"
            warn_user(
                f"{count} of {self.mask.size} pixels have no ray, since the lens {why} {degrees:.4g} degrees from its "
                "axis: they stay empty, and the camera's mask shows them",
                IntrinsicsWarning,
            )

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vectors through all pixels' centres, shape ``(height, width, 3)``, read-only; NaN if there is none."""
        return self.lens.directions(self.width, self.height)

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """Which pixels have no ray, shape ``(height, width)``: the lens maps no direction to them."""
        found = np.isnan(self.directions[..., 0])
        found.flags.writeable = False
        return found

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project camera-frame points [m], shape ``(..., 3)``; see `warpvis.sensors.lenses.Lens.project`."""
        return self.lens.project(points)

    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Find the unit vectors that image points show; see `warpvis.sensors.lenses.Lens.unproject`."""
        return self.lens.unproject(pixels)

    @cached_property
    def rays(self) -> NDArray[np.float64]:
        """Rays through all pixels' centres, of depth 1, shape ``(height, width, 3)``; NaN where a pixel has none."""
        return self._of_depth_one(self.directions)

    def canvas_rays(self, canvas: tuple[int, int, int, int]) -> NDArray[np.float64]:
        """Return rays as `rays` has them, through so many pixels more at the left, top, right and bottom.

        Raises:
            CameraError: These are not four whole numbers from 0 up, or too many pixels.
        """
        sides = as_items(canvas, "canvas", CameraError)
        if len(sides) != 4:
            raise CameraError(f"canvas must be four numbers of pixels: left, top, right, bottom, got {len(sides)}")
        left, top, right, bottom = (check_whole(side, "canvas", least=0, error=CameraError) for side in sides)
        if not any(sides):
            return self.rays
        _check_pixels(self.width + left + right, self.height + top + bottom)
        rays = self._of_depth_one(
            self.lens.directions(self.width + left + right, self.height + top + bottom, (-left, -top))
        )
        return np.where(rays[..., 2:] > 0, rays, np.nan) if self.kind == "z" else rays

    def rays_at(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays of depth 1 through points of the image [px], shape ``(..., 2)``; NaN outside of it."""
        rays = self._of_depth_one(self.unproject(pixels))
        at = np.asarray(pixels)
        inside = ((at >= 0) & (at < (self.width, self.height))).all(axis=-1, keepdims=True)
        return np.where(inside & (rays[..., 2:] > 0 if self.kind == "z" else True), rays, np.nan)

    def _of_depth_one(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.kind == "range":
            return directions
        with np.errstate(all="ignore"):  # between pixels' centres a lens may look aside
            return directions / directions[..., 2:]

    def _kept(self) -> Kept:
        """Share it with cameras of the same image, as `dataclasses.replace` makes them, while one of them lives."""
        if "_prepared" not in self.__dict__:
            of_images = self.lens.__dict__.setdefault("_prepared", WeakValueDictionary())
            shared = of_images.setdefault((self.width, self.height, self.kind), Kept())
            return self.__dict__.setdefault("_prepared", shared)
        return self.__dict__["_prepared"]

    def to_camera_info(self, *, frame_id: str, stamp: Stamp = 0.0, types: MessageTypes | None = None) -> Message:
        """Return the camera as a ``sensor_msgs/CameraInfo`` of ROS 2, of its raw image: `K`, `D` and the model.

        `P` says that the rectified image has the same intrinsics. `Camera.from_ros` makes this camera of it again.

        Args:
            frame_id: The camera's optical frame, which has OpenCV's axes.
            stamp: When the image was taken [s], or a Time message.
            types: A type store of rosbags; by default ROS's own classes, which must be there then.

        Raises:
            CameraError: ROS has no model for the lens: it has ``plumb_bob``, ``rational_polynomial``, ``equidistant``.
            MessageError: An argument is not what it has to be, or ROS is not there.
        """
        from warpvis.core.messages import MessageMaker

        k, d, model = lens_to_ros(self.lens)
        maker = MessageMaker(types)
        return maker.camera_info((self.width, self.height), k, maker.header(frame_id, stamp), d=d, model=model)

    def __getstate__(self) -> dict[str, Any]:
        """Return what the camera is, without what has been computed of it."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


CalibratedCamera: TypeAlias = Camera | LensCamera
"""What a calibration makes: without distortion a pinhole."""


def _check_pixels(width: int, height: int) -> None:
    if width * height > MAX_RAYS:
        raise CameraError(
            f"a LensCamera has a ray for each pixel, of which there may be {MAX_RAYS}, got {width} x {height}"
        )


def require_calibrated(camera: object) -> CalibratedCamera:
    """Return `camera` itself; raise `CameraError` if it is neither a `Camera` nor a `LensCamera`."""
    if not isinstance(camera, Camera | LensCamera):
        kinds = "a warpvis.Camera or a warpvis.sensors.LensCamera"
        why = f": {camera.taken_by}" if isinstance(camera, RayCamera) else ""
        raise CameraError(f"camera must be {kinds}, got {type(camera).__name__}{why}")
    return camera


def camera_of(
    lens: Lens,
    width: int,
    height: int,
    *,
    near: float = 0.0,
    far: float = math.inf,
    kind: DepthKind | None = None,
) -> CalibratedCamera:
    """Make a `Camera` of a lens without distortion, whose depth is along the axis, or else a `LensCamera`.

    Raises:
        CameraError: The numbers make no camera.
    """
    if kind is not None:
        check_choice(kind, "kind", ("z", "range"), CameraError)
    if lens.is_pinhole and kind != "range":
        fx, fy, cx, cy = (getattr(lens, name) for name in ("fx", "fy", "cx", "cy"))
        return Camera(width, height, fx, fy, cx, cy, near, far)
    return LensCamera(lens, width, height, near, far, kind)
