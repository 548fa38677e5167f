# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What the blocks of an occupancy map contain at points, in a box, and along the rays of cameras."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera, require_camera
from warpvis.core.arrays import empty
from warpvis.core.threads import launch_images, launch_points
from warpvis.errors import CameraError
from warpvis.maps._occupancy_blocks import BlockStorage

if TYPE_CHECKING:
    from warpvis.kernels.maps.occupancy_blocks import Blocks


def fade_blocks(blocks: BlockStorage, factor: float) -> None:
    """Multiply all log-odds by a factor."""
    from warpvis.kernels.maps import occupancy_blocks as kernels

    def fade(values: wp.array) -> None:
        launch_images(kernels.fade, values.shape, lambda window: [window, factor, values], device=blocks.device)

    fade(blocks.uniform)
    fade(blocks.voxels.reshape((1, *blocks.voxels.shape)))


def look_up(blocks: BlockStorage, points: wp.array, dtype: type, threads: int | None) -> wp.array:
    """Return the states of points, uint8, or the probabilities that they are occupied, float32."""
    from warpvis.kernels.maps import occupancy_blocks as kernels

    result = empty((len(points),), dtype, name="the result", device=blocks.device)
    states, probabilities = (result, None) if dtype is wp.uint8 else (None, result)
    inputs = [blocks.struct(), points, states, probabilities]
    launch_points(
        kernels.write_states_at,
        (1, len(points)),
        lambda window: [window, *inputs],
        device=blocks.device,
        threads=threads,
    )
    return result


def dense_states(
    blocks: BlockStorage,
    first: NDArray[np.int64],
    size: NDArray[np.int64],
    up_axis: int,
    ground_levels: int,
    threads: int | None,
) -> tuple[wp.array, wp.array]:
    """Return states and labels of a box of voxels; surfaces in its lowest `ground_levels` levels are ground."""
    from warpvis.kernels.maps import occupancy_blocks as kernels

    shape = tuple(size.tolist())
    states, labels = (empty(shape, wp.uint8, name="the map", device=blocks.device) for _ in range(2))
    inputs = [blocks.struct(), wp.vec3i(*first.tolist()), up_axis, ground_levels, states, labels]
    launch_images(kernels.write_states, shape, lambda window: [window, *inputs], device=blocks.device, threads=threads)
    return states, labels


def render_surface(blocks: Blocks, camera: Camera, poses: wp.array, images: int, threads: int | None) -> list[wp.array]:
    """Return the depth at parsed poses and, if there are 3 images, the depths between which the surface is."""
    from warpvis.kernels.maps import occupancy_lines

    lens = require_camera(camera, "camera").device_struct()
    if math.isinf(camera.far):
        raise CameraError("far of the camera must be finite to render a map, got inf")
    shape = (len(poses), camera.height, camera.width)
    depths = [empty(shape, wp.float32, name="depth", device=poses.device) for _ in range(images)]
    inputs = [blocks, *depths, *[None] * (3 - images)]
    launch_images(
        occupancy_lines.render_map,
        shape,
        lambda window: [lens, poses, window, *inputs],
        device=poses.device,
        threads=threads,
    )
    return depths
