# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Anti-aliasing of colors: several rays through each pixel at the edge of a surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from warpvis.cameras.base import AnyCamera
from warpvis.core.checks import check_whole
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError, CameraError, WarpvisError
from warpvis.rendering.casters.base import ImagesByName, Scratch, ViewBatch, as_image

EDGE_IMAGES = ("segmentation", "points", "normals")
"""The images from which edges are found."""

# Standard multisample patterns of Direct3D 11 (D3D11_STANDARD_MULTISAMPLE_QUALITY_LEVELS) [1/16 px].
_PATTERNS = {
    2: [(12, 12), (4, 4)],
    4: [(6, 2), (14, 6), (2, 10), (10, 14)],
    8: [(9, 5), (7, 11), (13, 9), (5, 3), (3, 13), (1, 7), (11, 15), (15, 1)],
    16: [
        *((9, 9), (7, 5), (5, 10), (12, 7), (3, 6), (10, 13), (13, 11), (11, 3)),
        *((6, 14), (8, 1), (4, 2), (2, 12), (0, 8), (15, 4), (14, 15), (1, 0)),
    ],
}

# Numbers of pixels at edges are rounded up to a power of this, since launches are packed for a number of points.
_GROWTH = 1.25


def check_samples(samples: int, camera: AnyCamera | None = None) -> int:
    """Return the number of rays through a pixel at an edge; raise an error if it is invalid, or for this camera."""
    if check_whole(samples, "samples") not in (1, *_PATTERNS):
        raise ArrayError(f"samples must be 1, {', '.join(map(str, _PATTERNS))} per pixel, got {samples}")
    if samples > 1 and camera is not None and camera.ray_model != "pinhole":
        raise CameraError(
            f"samples must be 1 for a {type(camera).__name__}: rays between pixels are those of a pinhole camera"
        )
    return int(samples)


def smooth_edges(
    samples: int,
    views: ViewBatch,
    images: ImagesByName,
    color: wp.array,
    render: Callable[[ViewBatch, wp.array], None],
    scratch: Scratch,
) -> None:
    """Replace the colors of pixels at edges by means over points within them.

    Args:
        samples: Number of points in a pixel.
        views: The views.
        images: Images of pixel centers, `EDGE_IMAGES`, ``(V, H, W)``.
        color: The colors of pixel centers, ``(V, H, W)`` vec3ub, which are changed.
        render: Writes the colors of image points of views, ``(V, 1, N)``.
        scratch: Memory of the call.

    Raises:
        WarpvisError: While a CUDA graph is captured, because the number of points depends on the images.
    """
    from warpvis.kernels.shading import edges

    device, (count, height, width) = color.device, color.shape
    if device.is_cuda and device.is_capturing:
        raise WarpvisError("samples must be 1 in a CUDA graph, because the number of rays depends on the images")
    shown = [as_image(images[name]) for name in EDGE_IMAGES]
    found = scratch.array("edge counts", (count,), wp.int32)
    pixels = scratch.array("edge pixels", (count, height * width), wp.int32)
    found.zero_()
    launch(edges.list_edges, color.shape, [*shown, found, pixels], device)
    longest = int(found.numpy().max(initial=0))
    if not longest:
        return
    room = min(height * width, int(np.ceil(_GROWTH ** np.ceil(np.log(longest) / np.log(_GROWTH)))))
    pattern = scratch.item(f"pattern {samples}", lambda: _pattern(samples, device))
    points = wp.empty((count, 1, room * samples), dtype=wp.vec2, device=device)
    launch(edges.place_samples, points.shape[::2], [pattern, width, found, pixels, points], device)
    colors = wp.empty(points.shape, dtype=wp.vec3ub, device=device)
    render(ViewBatch(views.poses, views.worlds, pixels=points, appearances=views.appearances), colors)
    launch(edges.average_samples, (count, longest), [samples, found, pixels, colors, color], device)


def _pattern(samples: int, device: Any) -> wp.array:
    return wp.array(np.array(_PATTERNS[samples], dtype=np.float32) / 16, dtype=wp.vec2, device=device)
