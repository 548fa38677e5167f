# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Launches of kernels that read depth images: a thread processes a row of pixels on the CPU, a pixel on CUDA."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import warp as wp

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.core.types import KernelArguments
from warpvis.rendering.casters.rays import rays_on_device

if TYPE_CHECKING:
    from warpvis.kernels.pinhole import Window

# A row takes about 1 ns per pixel, plus as much for each sphere; labels without spheres take a quarter. Waking a thread
# takes 50 to 100 us.
_MIN_PIXELS, _MIN_LABELS = 2**17, 2**19


def launch_back_project(
    camera: AnyCamera, poses: wp.array, depth: wp.array, points: wp.array, threads: int | None
) -> None:
    """Write the world points of a camera's depth images."""
    if camera.origins is not None:
        _launch_bundle(camera, poses, depth, points, threads)
        return
    if depth.device.is_cpu:
        from warpvis.kernels.maps.depth_rows import back_project_rows as kernel
    elif camera.ray_model == "table":
        from warpvis.kernels.maps.classify import back_project_rays as kernel
    else:
        from warpvis.kernels.maps.classify import back_project as kernel
    _launch_camera(kernel, camera, poses, depth, [points], threads, _MIN_PIXELS)


def launch_classify(
    camera: ImageCamera,
    poses: wp.array,
    depth: wp.array,
    arguments: KernelArguments,
    threads: int | None,
    sphere_count: int,
) -> None:
    """Write the labels of depth images; `arguments` are the last ones of `kernels.maps.classify.classify_depth`."""
    if depth.device.is_cpu:
        from warpvis.kernels.maps.depth_rows import classify_rows as kernel
    elif camera.ray_model == "table":
        from warpvis.kernels.maps.classify import classify_rays as kernel
    else:
        from warpvis.kernels.maps.classify import classify_depth as kernel
    min_pixels = _MIN_PIXELS // (1 + sphere_count) if sphere_count else _MIN_LABELS
    _launch_camera(kernel, camera, poses, depth, arguments, threads, min_pixels)


def launch_label_objects(
    object_labels: wp.array, depth: wp.array, objects: wp.array, reach: float, labels: wp.array, threads: int | None
) -> None:
    """Write the labels of the objects that are visible at pixels."""
    if depth.device.is_cpu:
        from warpvis.kernels.maps.depth_rows import label_objects_rows as kernel
    else:
        from warpvis.kernels.maps.classify import label_objects as kernel

    def arguments(window: Window) -> KernelArguments:
        return [object_labels, window, depth, objects, reach, labels]

    _launch(kernel, depth, arguments, threads, _MIN_PIXELS)


def _launch_bundle(camera: AnyCamera, poses: wp.array, depth: wp.array, points: wp.array, threads: int | None) -> None:
    """Write the world points of rays with distinct origins."""
    from warpvis.kernels.maps.classify import back_project_bundle

    inputs = [rays_on_device(camera, depth.device), rays_on_device(camera, depth.device, "origins"), depth, points]

    def arguments(window: Window) -> KernelArguments:
        return [camera.device_struct(), poses, window, *inputs]

    launch_images(back_project_bundle, depth.shape, arguments, device=depth.device, threads=threads)


def _launch_camera(
    kernel: wp.Kernel,
    camera: AnyCamera,
    poses: wp.array,
    depth: wp.array,
    inputs: KernelArguments,
    threads: int | None,
    min_pixels: int,
) -> None:
    """Launch a kernel with the camera and, if it has a ray table or if the kernel is one for rows, with its rays."""
    from warpvis.kernels.pinhole import PinholeCamera

    struct, is_cpu = camera.device_struct(), depth.device.is_cpu
    rays = [None] if is_cpu else []
    if camera.ray_model == "table":
        rays = [rays_on_device(camera, depth.device)]
        if is_cpu:
            near, far, struct = struct.near, struct.far, PinholeCamera()
            struct.near, struct.far = near, far

    def arguments(window: Window) -> KernelArguments:
        return [struct, poses, window, *rays, depth, *inputs]

    _launch(kernel, depth, arguments, threads, min_pixels)


def _launch(
    kernel: wp.Kernel,
    depth: wp.array,
    arguments: Callable[[Window], KernelArguments],
    threads: int | None,
    min_pixels: int,
) -> None:
    launch_images(
        kernel,
        depth.shape,
        arguments,
        device=depth.device,
        threads=threads,
        span=WHOLE_ROW if depth.device.is_cpu else 1,
        min_pixels=min_pixels,
    )
