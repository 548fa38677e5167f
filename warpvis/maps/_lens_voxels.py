# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Voxel maps of lens cameras, with voxel centers projected on the host in double precision."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.ray_camera import LensedCamera
from warpvis.core.poses import poses_to_matrices
from warpvis.core.threads import launch_images
from warpvis.core.types import KernelArguments
from warpvis.maps._voxel_map import VoxelMap
from warpvis.rendering import ray_table

if TYPE_CHECKING:
    from warpvis.kernels.maps.voxels import VoxelGrid
    from warpvis.kernels.pinhole import Window

# Number of points projected per batch; each needs 200 bytes of temporary memory.
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
    """Add views to a map; see `warpvis.maps.voxel_map`.

    Args:
        target: The map.
        grid: Its grid as a kernel argument.
        depth: Images, on the map's device.
        labels: Labels of the same shape, or None if all surfaces are obstacles.
        camera: The camera of all views.
        poses: Poses of the views, on the device.
        frames: The same poses from `warpvis.kernels.visibility.points.camera_frames`.
        marks: Zeros, one per voxel.
        threads: Number of CPU threads.
    """
    from warpvis.kernels.maps import lens_voxels as kernels

    device, lens = target.states.device, camera.device_struct()
    table = ray_table(camera, device)
    launch_images(
        kernels.mark_surface_rays,
        depth.shape,
        lambda window: [lens, *frames, window, table, grid, depth, labels, marks],
        device=device,
        threads=1,  # Warp's atomics are not atomic on the CPU: only one thread may write to the marks
    )
    size = target.states.shape
    step = max(1, _AT_ONCE // math.prod(size[1:]))
    for view, row in enumerate(poses.numpy().astype(np.float64)):
        pose = wp.transformd(*row[:3], *(row[3:] / np.linalg.norm(row[3:])))
        for layer in range(0, size[0], step):
            layers = range(layer, min(layer + step, size[0]))
            shown = wp.array(_pixels_of(target, camera, row, layers), dtype=wp.int32, device=device)
            inputs = [wp.vec2i(view, layer), grid, shown, depth, labels, marks, target.states, target.labels]

            def arguments(
                window: Window, pose: wp.transformd = pose, inputs: KernelArguments = inputs
            ) -> KernelArguments:
                return [lens, pose, window, *inputs]

            launch_images(kernels.judge_voxels_at, shown.shape, arguments, device=device, threads=threads)


def _pixels_of(target: VoxelMap, camera: LensedCamera, pose: NDArray[np.float64], layers: range) -> NDArray[np.int32]:
    """Find the pixels that contain the voxels' centers, as flat indices; -1 outside of the image or without a ray."""
    counts = layers, *map(range, target.states.shape[1:])
    axes = [low + target.cell_size * (np.array(count) + 0.5) for low, count in zip(target.origin, counts, strict=True)]
    centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    matrix = poses_to_matrices(pose)
    seen = (centers - matrix[:3, 3]) @ matrix[:3, :3]
    pixels = camera.project(seen)
    inside: NDArray[np.bool_] = np.all((pixels >= 0) & (pixels < (camera.width, camera.height)), axis=-1)
    if camera.kind == "z":
        inside &= seen[..., 2] > 0
    columns, rows = np.moveaxis(np.where(inside[..., None], pixels, 0).astype(np.int32), -1, 0)
    inside &= np.isfinite(camera.rays[rows, columns, 2])
    return np.where(inside, rows * camera.width + columns, -1).astype(np.int32)
