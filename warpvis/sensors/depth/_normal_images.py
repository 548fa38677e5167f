# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of standard normal random numbers."""

from __future__ import annotations

from typing import Any

import warp as wp

from warpvis.core.threads import launch_images
from warpvis.rendering import Exposure


def draw_normal_image(exposure: Exposure, stream: int, name: str) -> wp.array:
    """Draw a random number of a stream for each pixel, ``(V, H, W)``, into scratch memory called `name`."""
    device, shape = exposure.scene.device, exposure.true_depth.shape
    normals = exposure.scratch(name, shape, wp.float32)
    kernel, span = drawing_kernel(device)
    drawn: list[Any] = [exposure.draws, wp.uint32(exposure.seed), wp.uint32(stream), normals]
    launch_images(kernel, shape, lambda window: [window, *drawn], device=device, threads=exposure.threads, span=span)
    return normals


def drawing_kernel(device: wp.Device) -> tuple[wp.Kernel, int]:
    """Return the kernel that draws normal numbers on a device, and the number of pixels per thread."""
    if device.is_cpu:
        from warpvis.kernels.random_rows import PIXELS_AT_ONCE, draw_normal_rows

        return draw_normal_rows, PIXELS_AT_ONCE
    from warpvis.kernels.random_numbers import draw_normals

    return draw_normals, 1
