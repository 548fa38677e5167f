# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images of lenses as those of a pinhole, for maps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import empty
from warpvis.core.threads import launch_images
from warpvis.errors import CameraError

# Largest angle between a ray and the axis: a pinhole image grows by its tangent.
_MAX_ANGLE = math.radians(75.0)


@dataclass(frozen=True)
class Rectification:
    """A pinhole camera, and which pixel of a lens each of its pixels shows."""

    camera: Camera
    """The pinhole, which contains all rays of the lens, with a range from 0 to inf."""
    pixels: wp.array
    """Index of the pixel of the lens that contains the ray of each pixel, -1 for none, ``(H, W)`` int32."""
    factors: wp.array
    """Planar depth per depth of the lens, ``(H, W)`` float32."""

    @classmethod
    def of(cls, camera: LensCamera, device: wp.Device) -> Rectification:
        """Compute the pinhole whose pixels are as large as those of the lens at the center of the image."""
        rays = camera.directions[~camera.mask]
        angle = float(np.arccos(np.clip(rays[:, 2].min(), -1.0, 1.0)))
        if angle > _MAX_ANGLE:
            raise CameraError(
                f"camera must have rays up to {math.degrees(_MAX_ANGLE):.0f} degrees from its axis for a map, got a "
                f"lens with {math.degrees(angle):.0f} degrees; pass the images of a rectified camera"
            )
        corners = camera.lens.unproject([(0, 0), (camera.width, 0), (0, camera.height), (camera.width, camera.height)])
        slopes = np.vstack([rays, corners[np.isfinite(corners).all(axis=1) & (corners[:, 2] > math.cos(_MAX_ANGLE))]])
        slopes = slopes[:, :2] / slopes[:, 2:]
        fx, fy = (1.0 / size for size in camera.pixel_size())
        (left, top), (right, bottom) = slopes.min(axis=0), slopes.max(axis=0)
        width, height = math.ceil(fx * (right - left)), math.ceil(fy * (bottom - top))
        pinhole = Camera(width, height, fx, fy, -fx * left, -fy * top)

        directions = pinhole.depth_rays(np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1) + 0.5)
        shown = camera.project(directions)
        with np.errstate(invalid="ignore"):
            inside: NDArray[np.bool_] = np.all((shown >= 0) & (shown < (camera.width, camera.height)), axis=-1)
        column, row = np.moveaxis(np.where(inside[..., None], shown, 0).astype(np.int32), -1, 0)
        inside &= ~camera.mask[row, column]
        factors = np.ones(inside.shape)
        if camera.kind == "range":
            factors = 1.0 / np.linalg.norm(directions, axis=-1)
        return cls(
            pinhole,
            wp.array(np.where(inside, row * camera.width + column, -1), dtype=wp.int32, device=device),
            wp.array(factors, dtype=wp.float32, device=device),
        )


def rectify(images: wp.array, camera: LensCamera, threads: int | None) -> tuple[wp.array, Camera]:
    """Return the depth images of a pinhole that sees what a lens sees, and the pinhole.

    Each pixel has the depth of the pixel of the lens that contains its ray. Pixels without one are NaN.
    """
    from warpvis.kernels.maps.rectify import rectify_depth

    device = images.device
    chosen = camera.prepared(("rectified", device.alias), lambda: Rectification.of(camera, device))
    depth = empty((len(images), *chosen.pixels.shape), wp.float32, name="depth", device=device)
    inputs = [camera.near, camera.far, chosen.pixels, chosen.factors, images, depth]
    launch_images(rectify_depth, depth.shape, lambda window: [window, *inputs], device=device, threads=threads)
    # A range along rays applies to the lens image only.
    near = camera.near if camera.kind == "z" else 0.0
    return depth, replace(chosen.camera, near=near, far=camera.far)
