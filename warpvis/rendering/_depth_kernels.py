# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Launch kernels that read depth images: of rows of pixels on the CPU, of single pixels on CUDA."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import warp as wp

from warpvis.core.image_cameras import ImageCamera
from warpvis.core.ray_camera import RayCamera
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.core.types import KernelArguments
from warpvis.rendering.casters import ray_table

if TYPE_CHECKING:
    from warpvis.kernels.pinhole import Window

# Rows take about 0.5 ns a pixel, and as much again for each sphere; to wake a thread takes 50 to 100 us.
_MIN_PIXELS = 2**17


def launch_back_project(
    camera: ImageCamera, poses: wp.array, depth: wp.array, points: wp.array, threads: int | None
) -> None:
    """Write the world points of depth images that a camera took."""
    if depth.device.is_cpu:
        from warpvis.kernels.depth_rows import back_project_ray_rows as of_rays, back_project_rows as of_pinhole
    else:
        from warpvis.kernels.classify import back_project as of_pinhole
        from warpvis.kernels.ray_points import back_project_rays as of_rays
    _launch_camera((of_pinhole, of_rays), camera, poses, depth, [points], threads, _MIN_PIXELS)


def launch_classify(
    camera: ImageCamera,
    poses: wp.array,
    depth: wp.array,
    arguments: KernelArguments,
    threads: int | None,
    sphere_count: int,
) -> None:
    """Write the labels of depth images; `arguments` are those of `warpvis.kernels.classify.classify_depth`."""
    if depth.device.is_cpu:
        from warpvis.kernels.depth_rows import classify_depth_rows as of_pinhole, classify_ray_rows as of_rays
    else:
        from warpvis.kernels.classify import classify_depth as of_pinhole
        from warpvis.kernels.ray_points import classify_rays as of_rays
    _launch_camera((of_pinhole, of_rays), camera, poses, depth, arguments, threads, _MIN_PIXELS // (1 + sphere_count))


def launch_label_objects(
    object_labels: wp.array, depth: wp.array, objects: wp.array, reach: float, labels: wp.array, threads: int | None
) -> None:
    """Write the labels of the objects that pixels show."""
    if depth.device.is_cpu:
        from warpvis.kernels.depth_rows import label_objects_rows as kernel
    else:
        from warpvis.kernels.classify import label_objects as kernel

    def arguments(window: Window) -> KernelArguments:
        return [object_labels, window, depth, objects, reach, labels]

    _launch(kernel, depth, arguments, threads, _MIN_PIXELS)


def _launch_camera(
    kernels: tuple[wp.Kernel, wp.Kernel],
    camera: ImageCamera,
    poses: wp.array,
    depth: wp.array,
    others: KernelArguments,
    threads: int | None,
    least_pixels: int,
) -> None:
    """Launch the kernel of pinholes or of ray tables."""
    of_pinhole, of_rays = kernels
    struct = camera.device_struct()
    rays = [ray_table(camera, depth.device)] if isinstance(camera, RayCamera) else []

    def arguments(window: Window) -> KernelArguments:
        return [struct, poses, window, *rays, depth, *others]

    _launch(of_rays if rays else of_pinhole, depth, arguments, threads, least_pixels)


def _launch(
    kernel: wp.Kernel,
    depth: wp.array,
    arguments: Callable[[Window], KernelArguments],
    threads: int | None,
    least_pixels: int,
) -> None:
    launch_images(
        kernel,
        depth.shape,
        arguments,
        device=depth.device,
        threads=threads,
        span=WHOLE_ROW if depth.device.is_cpu else 1,
        least_pixels=least_pixels,
    )
