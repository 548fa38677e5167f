# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Color images of cameras in Webots worlds."""

from __future__ import annotations

import warnings
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import check_whole
from warpvis.errors import CameraError, SceneError
from warpvis.rendering import ColorOptions, Renderer, render_wide
from warpvis.webots._range_images import distorted_pixels, find_device, hidden_body
from warpvis.webots._world import WebotsWorld


def render_color(
    world: WebotsWorld,
    device_name: str,
    *,
    exclude_body: bool = False,
    threads: int | None = None,
    **colors: Unpack[ColorOptions],
) -> NDArray[np.uint8]:
    """Render the color image of a camera, under the lights of the world.

    As in Webots, back faces are invisible, the robot's own body is visible, surfaces nearer than `Device.near` are cut
    away (not in cylindrical and spherical images), surfaces beyond `far` are replaced by the background, and a `Lens`
    distorts planar images. A warning names the fields that are ignored, `Device.ignored`.

    Args:
        world: The world, from `load_webots`.
        device_name: The camera.
        exclude_body: Whether to hide the robot that the camera is part of.
        threads: Number of CPU threads; by default all cores available to the process.
        **colors: `shadows`, `reflections`, `ambient_occlusion` and `samples`, as for `warpvis.Renderer`; `samples` is 1
            for cameras that are not planar or have a `Lens`.

    Returns:
        Colors in sRGB, shape ``(H, W, 3)``.

    Raises:
        SceneError: If there is no such device, or it is a range finder.
        CameraError: If `samples` is above 1 for a camera that is not planar or has a `Lens`.
    """
    device = find_device(world, device_name)
    if device.measures:
        raise SceneError(f"{device_name!r} is a range finder, which has no colors: use render_range")
    if device.ignored:
        warnings.warn(f"{device_name!r}: {', '.join(device.ignored)} of Camera have no effect on colors", stacklevel=2)
    samples = check_whole(colors.get("samples", 1), "samples")
    if samples > 1 and (device.projection != "planar" or device.bends):
        kind = device.projection if device.projection != "planar" else "distorted by a lens"
        raise CameraError(f"samples must be 1 for {device_name!r}, whose image is {kind}, got {samples}")
    exclude = hidden_body(world, device, exclude_body) or None
    if device.projection != "planar":
        views = render_wide(
            world.scene,
            device.width,
            device.height,
            device.fov,
            device.pose,
            projection=device.projection,
            far=device.max_range,
            outputs=("color",),
            cull_backfaces=True,
            exclude=exclude,
            threads=threads,
            **colors,
        )
        return views.color.numpy()[0]
    renderer = Renderer(
        world.scene,
        device.camera,
        outputs=("color",),
        cull_backfaces=True,
        near_plane="clip",
        threads=threads,
        **colors,
    )
    if not device.bends:
        return renderer.render(device.pose, exclude=exclude).color.numpy()[0]
    pixels, outside = distorted_pixels(device)
    image = renderer.render_at(device.pose, pixels[None], exclude=exclude).color.numpy()[0]
    image[outside] = 0
    return image
