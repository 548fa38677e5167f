# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The visibility map in 3D of images through a lens: voxels' middles are projected on the host in double precision."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.core.ray_camera import LensedCamera
from warpvis.core.threads import launch_images
from warpvis.core.types import KernelArguments
from warpvis.maps._voxel_map import VoxelMap
from warpvis.rendering import ray_table

if TYPE_CHECKING:
    from warpvis.kernels.pinhole import Window
    from warpvis.kernels.voxels import VoxelGrid

# Projected points take 200 bytes each while they are worked on.
_AT_ONCE = 1 << 19


def add_lens_views(
    target: VoxelMap,
    grid: VoxelGrid,
    depth: wp.array,
    labels: wp.array | None,
    camera: LensedCamera,
    poses: wp.array,
    frames: list[wp.array],
    marks: wp.array,
    threads: int | None,
) -> None:
    """Raise a map by what views show; see `warpvis.maps.voxel_map`.

    Args:
        target: The map.
        grid: It, as kernels take it.
        depth: Images, on the map's device.
        labels: Labels of the same shape; None for obstacles alone.
        camera: The camera of all views.
        poses: Their poses on the device.
        frames: The same as `warpvis.kernels.points.camera_frames` makes them.
        marks: Zeros, as many as there are voxels.
        threads: CPU threads.
    """
    from warpvis.kernels import lens_voxels as kernels

    device, lens = target.states.device, camera.device_struct()
    table = ray_table(camera, device)
    launch_images(
        kernels.mark_surface_rays,
        depth.shape,
        lambda window: [lens, *frames, window, table, grid, depth, labels, marks],
        device=device,
        threads=1,  # on the CPU, Warp's atomics are not: only one thread may write to the marks
    )
    size = target.states.shape
    step = max(1, _AT_ONCE // math.prod(size[1:]))
    for view, row in enumerate(poses.numpy().astype(np.float64)):
        pose = wp.transformd(*row[:3], *(row[3:] / np.linalg.norm(row[3:])))
        for layer in range(0, size[0], step):
            layers = range(layer, min(layer + step, size[0]))
            shown = wp.array(_pixels_of(target, camera, row, layers), dtype=wp.int32, device=device)
            given = [wp.vec2i(view, layer), grid, shown, depth, labels, marks, target.states, target.labels]

            def arguments(
                window: Window, pose: wp.transformd = pose, given: KernelArguments = given
            ) -> KernelArguments:
                return [lens, pose, window, *given]

            launch_images(kernels.judge_voxels_at, shown.shape, arguments, device=device, threads=threads)


def _pixels_of(target: VoxelMap, camera: LensedCamera, pose: NDArray[np.float64], layers: range) -> NDArray[np.int32]:
    """Find which pixels voxels' middles are in, as indices into the image; -1 for none, or one without a ray."""
    counts = layers, *map(range, target.states.shape[1:])
    axes = [low + target.cell_size * (np.array(count) + 0.5) for low, count in zip(target.origin, counts, strict=True)]
    centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    matrix = poses_to_matrices(pose)
    seen = (centers - matrix[:3, 3]) @ matrix[:3, :3]
    at = camera.project(seen)
    inside: NDArray[np.bool_] = np.all((at >= 0) & (at < (camera.width, camera.height)), axis=-1)
    if camera.kind == "z":
        inside &= seen[..., 2] > 0
    columns, rows = np.moveaxis(np.where(inside[..., None], at, 0).astype(np.int32), -1, 0)
    inside &= np.isfinite(camera.rays[rows, columns, 2])
    return np.where(inside, rows * camera.width + columns, -1).astype(np.int32)
