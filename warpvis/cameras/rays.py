# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras that define the ray of each pixel explicitly: lists and images of rays, and wide-angle projections."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from threading import RLock
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.base import AnyCamera, DepthKind, Value
from warpvis.cameras.checks import MAX_RAYS, as_floats, as_rows, check_image_size, check_range
from warpvis.cameras.lenses import directions_on_sphere, jacobian_on_sphere
from warpvis.core.arrays import freeze
from warpvis.core.checks import check_choice, degrees_hint, is_number
from warpvis.core.poses import Convention, check_convention
from warpvis.errors import CameraError, PoseError

if TYPE_CHECKING:
    from warpvis.kernels.casting.rays import RayRange

_LENGTH_TOLERANCE = 1e-6

Projection = Literal["cylindrical", "spherical"]

# Two pi, rounded to four decimals as in files.
_MAX_HFOV = 6.2832


class OnceCache:
    """A thread-safe cache: each value is created once; concurrent requests for it wait."""

    def __init__(self) -> None:
        """Create an empty cache."""
        self._values: dict[Hashable, Any] = {}
        # Reentrant, because creating a value may request other values.
        self._lock = RLock()

    def get(self, name: Hashable, make: Callable[[], Value]) -> Value:
        """Return the cached value of this name; create it if it is missing."""
        if name not in self._values:
            with self._lock:
                if name not in self._values:
                    self._values[name] = make()
        return self._values[name]


class RayCamera(AnyCamera):
    """A camera with an array of rays, one per pixel.

    Subclasses have `width`, `height` [px], `near`, `far` [m] and `kind`, the definition of depth.
    """

    ray_model: ClassVar[Literal["table"]] = "table"
    usage_hint = "its rays have no image. wv.render accepts it, and its views have points and labels."

    def rays_at(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays of depth 1 through image points [px], shape ``(..., 2)``; NaN outside of the image."""
        raise CameraError(
            f"camera must have a continuous image for render_at, got {type(self).__name__}. Render other Rays instead."
        )

    def prepared(self, name: Hashable, make: Callable[[], Value]) -> Value:
        """Return acceleration data of a caster for the rays; it is created once and cached as long as the camera lives.

        Args:
            name: Key of the data, such as a name and the alias of a device.
            make: Function that creates the data. It must depend only on `rays` and `origins`, because cameras with
                different ranges may share the data.
        """
        return self._cache().get(name, make)

    def pixel_size(self) -> tuple[float, float]:
        """Return the median angle between neighboring rays [rad], in both directions; 0 for a list of rays."""
        angle = self.prepared("pixel angle", lambda: _median_angle(self))
        return angle, angle

    def prepare_in(self, cache: OnceCache) -> None:
        """Share a cache of prepared data between cameras with the same rays."""
        self.__dict__["_prepared"] = cache

    def _cache(self) -> OnceCache:
        return self.__dict__.setdefault("_prepared", OnceCache())  # atomic: concurrent callers get the same cache

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without prepared data, which copies prepare again."""
        return {name: value for name, value in self.__dict__.items() if name != "_prepared"}

    def device_struct(self, *, clip_near: bool = False) -> RayRange:
        """Return the range of the camera as a struct for `warpvis.kernels.casting.ray_bundles`; see `ray_range`."""
        return self.ray_range(clip_near=clip_near)


class Rays(RayCamera):
    """A ray pattern: a lidar, a scanner, or any other sensor that is a list or an image of rays.

    `Renderer` and `render` accept it like a camera. An image of rays, ``(H, W, 3)``, gives results of shape
    ``(V, H, W)``; a list, ``(N, 3)``, gives results of shape ``(V, N)``.

    Poses refer to the frame of the directions: a lidar whose directions have x forward is rendered from poses with x
    forward. `axes` specifies these axes, for conversion from poses with another `convention`.
    """

    def __init__(
        self,
        directions: ArrayLike,
        origins: ArrayLike | None = None,
        times: ArrayLike | None = None,
        rings: ArrayLike | None = None,
        *,
        near: float = 0.0,
        far: float = math.inf,
        kind: DepthKind = "range",
        axes: Convention = "opencv",
    ) -> None:
        """Create a ray pattern.

        Args:
            directions: Unit vectors in the sensor frame, shape ``(H, W, 3)`` or ``(N, 3)``. They may have single
                precision; their length must be 1 to within 1e-6.
            origins: Ray origins in that frame [m], of the same shape; zeros by default.
            times: Time at which each ray is cast, after the start of the frame [s], shape ``(H, W)`` or ``(N,)``.
            rings: Channel of each ray, integers of the same shape as `times`.
            near: Minimum measured depth [m]; nearer surfaces read -inf and still occlude.
            far: Maximum measured depth [m]; farther surfaces read +inf.
            kind: Definition of depth, `near` and `far`: ``"range"``, distance from the origin of the ray, or ``"z"``,
                along the z axis. ``"z"`` requires ``axes="opencv"`` and rays less than 90 degrees from z.
            axes: The axes of the sensor frame: ``"opencv"`` (x right, y down, z forward), ``"ros_body"`` (x forward,
                y left, z up, as for lidars), ``"opengl"`` or ``"ros_optical"``.
        """
        self._directions = _vectors(directions, "directions")
        self.height, self.width = self.shape if len(self.shape) == 2 else (1, *self.shape)
        length = np.linalg.norm(self._directions, axis=-1, keepdims=True)
        _check_lengths(length[..., 0])
        self._rays = freeze(self._directions / length)
        self._origins = None if origins is None else self._per_ray(_vectors(origins, "origins"), "origins", 3)
        self._times = None if times is None else self._per_ray(as_floats(times, "times"), "times")
        self._rings = None if rings is None else self._whole_numbers(rings)
        self.near, self.far = near, far
        check_range(self)
        try:
            self.axes = check_convention(axes)
        except PoseError as error:
            raise CameraError(str(error).replace("convention", "axes", 1)) from None
        check_choice(kind, "kind", ("z", "range"), CameraError)
        self.kind: DepthKind = kind
        if kind == "z":
            self._scale_to_unit_z()

    @property
    def shape(self) -> tuple[int, ...]:
        """``(H, W)`` or ``(N,)``."""
        return self._directions.shape[:-1]

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vectors in the sensor frame as given, shape ``(H, W, 3)`` or ``(N, 3)``, read-only."""
        return self._directions

    @property
    def origins(self) -> NDArray[np.float64] | None:
        """Ray origins in the sensor frame [m], with the shape of `directions`; None if all are zero."""
        return self._origins

    @property
    def times(self) -> NDArray[np.float64] | None:
        """Time of each ray, after the start of the frame [s], shape ``(H, W)`` or ``(N,)``; None if not given."""
        return self._times

    @property
    def rings(self) -> NDArray[np.int32] | None:
        """Channel of each ray, shape ``(H, W)`` or ``(N,)``; None if not given."""
        return self._rings

    @property
    def rays(self) -> NDArray[np.float64]:
        """Rays of depth 1, with the shape of `directions`, normalized in double precision: length 1, or z = 1."""
        return self._rays

    def with_range(self, near: float, far: float) -> Rays:
        """Return the same rays with another range of depth [m]; acceleration data of casters is shared."""
        other = copy.copy(self)
        other.near, other.far = near, far
        check_range(other)
        other.prepare_in(self._cache())
        return other

    def __len__(self) -> int:
        """Return the number of rays."""
        return math.prod(self.shape)

    def __repr__(self) -> str:
        """Return the shape and the options; arrays are not listed."""
        names = [name for name in ("origins", "times", "rings") if getattr(self, name) is not None]
        more = f" with {', '.join(names)}" if names else ""
        return f"Rays({self.shape}{more}, near={self.near}, far={self.far}, kind={self.kind!r}, axes={self.axes!r})"

    def _scale_to_unit_z(self) -> None:
        if self.axes != "opencv":
            raise CameraError(f'axes must be "opencv" (z forward) for kind="z", got {self.axes!r}')
        aside = int((self._rays[..., 2] <= 0).sum())
        if aside:
            raise CameraError(
                f'kind must be "range" for rays 90 degrees or more from z, got "z" for {aside} such rays of {len(self)}'
            )
        self._rays = freeze(self._rays / self._rays[..., 2:])

    def _per_ray(self, array: NDArray, name: str, *components: int) -> NDArray:
        if array.shape != (*self.shape, *components):
            raise CameraError(f"{name} must be one for each ray, shape {self.shape}, got {array.shape}")
        if not np.isfinite(array).all():
            raise CameraError(f"{name} must be finite, and {int((~np.isfinite(array)).sum())} are not")
        return freeze(array)

    def _whole_numbers(self, value: ArrayLike) -> NDArray[np.int32]:
        array = self._per_ray(as_floats(value, "rings"), "rings")
        wrong = (array != np.round(array)) | (array < 0) | (array >= 2**31)
        if wrong.any():
            raise CameraError(f"rings must be whole numbers from 0 up, got {array[wrong][0]:g}")
        return freeze(array.astype(np.int32))


@dataclass(frozen=True)
class WideCamera(RayCamera):
    """A wide-angle camera with one ray through the center of every pixel, in equal steps of angle.

    `Renderer` and `render` accept it. With u to the right and v downwards from the image's center, both from -1/2 to
    1/2 from border to border:

    * ``"cylindrical"``: the ray's azimuth is ``u * hfov`` to the right, its elevation ``v * hfov * height / width``
      downwards. Columns are equally spaced meridians and rows are equally spaced parallels (equirectangular).
    * ``"spherical"``: an equidistant fisheye. The angle between the ray and the camera's axis is
      ``hfov * sqrt(u^2 + v^2)``. It is ``hfov / 2`` at the centers of all four borders, so that an image that is not
      square is stretched, and larger at the corners.

    The formulas also apply to pixels with an angle of more than pi to the axis, or more than pi / 2 above or below the
    horizon: their rays go over the pole. These are the projections of Webots cameras (its shader
    ``merge_spherical.frag``).

    Depth is the *length* of the ray from the camera to the surface [m].
    """

    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    hfov: float
    """Horizontal field of view [rad], up to 2 pi."""
    projection: Projection = "cylindrical"
    """``"cylindrical"`` or ``"spherical"``."""
    near: float = 0.0
    """Minimum length of a ray [m]; nearer surfaces have depth -inf and still occlude."""
    far: float = math.inf
    """Maximum length of a ray [m]; farther surfaces have depth +inf."""

    kind = "range"
    usage_hint = "wv.render accepts it, and renders points and labels"

    def __post_init__(self) -> None:
        check_choice(self.projection, "projection", get_args(Projection), CameraError)
        check_image_size(self)
        if not is_number(self.hfov):
            raise CameraError(f"hfov must be a number, got {self.hfov!r}")
        if not 0 < self.hfov <= _MAX_HFOV:
            hint = degrees_hint(self.hfov)
            raise CameraError(f"hfov must be more than 0 and at most 2 pi radians, got {self.hfov}{hint}")
        object.__setattr__(self, "hfov", float(self.hfov))
        check_range(self)

    @property
    def rays(self) -> NDArray[np.float64]:
        """Unit vectors through the centers of all pixels, shape ``(height, width, 3)``."""
        return self._directions(np.arange(self.width) + 0.5, (np.arange(self.height) + 0.5)[:, None])

    def rays_at(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return unit vectors through image points [px], shape ``(..., 2)``; NaN outside the image."""
        points = as_rows(pixels, 2, "pixels")
        x, y = np.moveaxis(np.where(self._contains(points), points, np.nan), -1, 0)
        return self._directions(x, y)

    def angle_jacobian(self) -> NDArray[np.float64]:
        """Return the derivatives of `rays` with respect to `hfov` [1/rad], shape ``(height, width, 3)``."""
        u = np.broadcast_to((np.arange(self.width) + 0.5) / self.width - 0.5, self.shape)
        v = np.broadcast_to(((np.arange(self.height) + 0.5) / self.height - 0.5)[:, None], self.shape)
        if self.projection == "spherical":
            radius = np.hypot(u, v)
            angle = self.hfov * radius
            return np.stack([u * np.cos(angle), v * np.cos(angle), -radius * np.sin(angle)], axis=-1)
        ratio = self.height / self.width
        jacobian = jacobian_on_sphere(u * self.hfov, v * (self.hfov * ratio))
        return jacobian[..., 0] * u[..., None] + jacobian[..., 1] * (v * ratio)[..., None]

    def _directions(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.float64]:
        u, v = x / self.width - 0.5, y / self.height - 0.5
        if self.projection == "spherical":
            angle = self.hfov * np.hypot(u, v)
            scale = self.hfov * np.sinc(angle / math.pi)  # sin(away) / hypot(u, v)
            parts = scale * u, scale * v, np.cos(angle)
        else:
            parts = directions_on_sphere(u * self.hfov, v * (self.hfov * self.height / self.width))
        return np.stack(np.broadcast_arrays(*parts), axis=-1)


def _median_angle(camera: RayCamera) -> float:
    """Return the median angle between neighboring rays [rad]; 0 for a list of rays."""
    if len(camera.shape) < 2:
        return 0.0
    rays = camera.rays.reshape(*camera.shape, 3)
    with np.errstate(invalid="ignore"):
        rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        steps = [np.linalg.norm(np.diff(rays, axis=axis), axis=-1).ravel() for axis in (0, 1)]
    angles = np.concatenate(steps)
    angles = angles[np.isfinite(angles)]
    return float(np.median(angles)) if len(angles) else 0.0


def _vectors(value: ArrayLike, name: str) -> NDArray[np.float64]:
    array = as_floats(value, name)
    if array.ndim not in (2, 3) or array.shape[-1] != 3 or not array.size:
        raise CameraError(f"{name} must have shape (H, W, 3) or (N, 3), got {array.shape}")
    if array.size // 3 > MAX_RAYS:
        raise CameraError(f"{name} must have at most {MAX_RAYS} rays, got {array.size // 3}")
    wrong = ~np.isfinite(array).all(axis=-1)
    if wrong.any():
        first = ", ".join(map(str, np.argwhere(wrong)[0]))
        raise CameraError(
            f"{name} must be finite, got {int(wrong.sum())} of {wrong.size} that are not, the first at [{first}]. "
            "Leave out rays that are not cast."
        )
    return freeze(array)


def _check_lengths(length: NDArray[np.float64]) -> None:
    wrong = ~(np.abs(length - 1) <= _LENGTH_TOLERANCE)
    if wrong.any():
        index = tuple(np.argwhere(wrong)[0])
        first = ", ".join(map(str, index))
        raise CameraError(
            f"directions must have length 1 to within {_LENGTH_TOLERANCE:g}, got {int(wrong.sum())} of {wrong.size} "
            f"that have not, the first at [{first}] of length {length[index]:.9g}"
        )
