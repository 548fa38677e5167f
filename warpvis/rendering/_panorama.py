# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Wide-angle images, up to 360 degrees: cylindrical and spherical (fisheye) projections."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.pinhole import check_range, check_size
from warpvis.cameras.ray_camera import MAX_RAYS, OnceCache, RayCamera
from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_choice, degrees_hint, is_number
from warpvis.core.poses import Convention, QuaternionOrder
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.errors import CameraError
from warpvis.rendering._choices import Output
from warpvis.rendering._renderer import render
from warpvis.rendering._views import Views
from warpvis.scene import Scene, require_scene

Projection = Literal["cylindrical", "spherical"]

# Two pi, rounded to four decimals as in files.
_MAX_HFOV = 6.2832
# A scene caches the prepared rays of this many images of `render_wide`, with at most this many rays each: 30 MB.
_MAX_CACHED, _MAX_CACHED_RAYS = 2, 2**20


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
        for name in ("width", "height"):
            object.__setattr__(self, name, check_size(getattr(self, name), name))
        if self.width * self.height > MAX_RAYS:
            raise CameraError(f"width x height must be at most {MAX_RAYS} rays, got {self.width} x {self.height}")
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
        """Return unit vectors through image points [px], shape ``(..., 2)``; NaN outside the image.

        Raises:
            WarpvisError: If `pixels` is not a numeric array of this shape.
        """
        points = as_numpy(pixels, name="pixels").astype(np.float64)
        if points.shape[-1:] != (2,):
            raise CameraError(f"pixels must have shape (..., 2), got {points.shape}")
        x, y = np.moveaxis(points, -1, 0)
        inside = (x >= 0) & (x < self.width) & (y >= 0) & (y < self.height)
        return self._directions(np.where(inside, x, np.nan), np.where(inside, y, np.nan))

    def _directions(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.float64]:
        u, v = x / self.width - 0.5, y / self.height - 0.5
        if self.projection == "spherical":
            angle = self.hfov * np.hypot(u, v)
            scale = self.hfov * np.sinc(angle / math.pi)  # sin(away) / hypot(u, v)
            parts = scale * u, scale * v, np.cos(angle)
        else:
            azimuth, elevation = u * self.hfov, v * (self.hfov * self.height / self.width)
            horizontal = np.cos(elevation)
            parts = horizontal * np.sin(azimuth), np.sin(elevation), horizontal * np.cos(azimuth)
        return np.stack(np.broadcast_arrays(*parts), axis=-1)


def render_wide(
    scene: Scene,
    width: int,
    height: int,
    hfov: float,
    camera_to_world: PoseLike,
    *,
    projection: Projection = "cylindrical",
    near: float = 0.0,
    far: float = math.inf,
    outputs: Sequence[Output] = ("depth",),
    cull_backfaces: bool = False,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> Views:
    """Render wide-angle views with the projections of `WideCamera`.

    The first call sorts the rays for packets on CPU cores; the scene caches the sorted rays of the two images rendered
    last, if they have at most 2^20 pixels. Larger images are cast ray by ray: to render them repeatedly, create a
    `WideCamera` and use `render` or `Renderer`.

    Args:
        scene: The scene to render.
        width: Image width [px].
        height: Image height [px].
        hfov: Horizontal field of view [rad], up to 2 pi.
        camera_to_world: Poses, as for `Renderer.render`.
        projection: ``"cylindrical"`` or ``"spherical"``.
        near: Minimum length of a ray [m].
        far: Maximum length of a ray [m].
        outputs: The images to render, as for `Renderer`.
        cull_backfaces: Whether to ignore triangles seen from behind, as for `Renderer`.
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: CPU threads to use; all cores of this process by default.

    Returns:
        The images, indexed ``[view, y, x]``, on the scene's device. Depth is the *length* of the ray from the camera to
        the surface [m]: +inf without a surface within `far`, -inf where it is nearer than `near` (REP 117).

    Raises:
        WarpvisError: If an argument is invalid.
    """
    require_scene(scene)
    camera = WideCamera(width, height, hfov, projection, near, far)
    is_small = camera.width * camera.height <= _MAX_CACHED_RAYS
    if is_small:
        _share(scene, camera)
    return render(
        scene,
        camera,
        camera_to_world,
        outputs=outputs,
        caster="auto" if is_small else "rays",
        cull_backfaces=cull_backfaces,
        object_poses=object_poses,
        world_index=world_index,
        exclude=exclude,
        convention=convention,
        quaternion=quaternion,
        threads=threads,
    )


def _share(scene: Scene, camera: WideCamera) -> None:
    """Share prepared rays between cameras with the same image and any range."""
    image = (camera.width, camera.height, camera.hfov, camera.projection)
    camera.prepare_in(scene.cached_rays.setdefault(image, OnceCache()))
    for old in list(scene.cached_rays)[:-_MAX_CACHED]:
        scene.cached_rays.pop(old, None)
