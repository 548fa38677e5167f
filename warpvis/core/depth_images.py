# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check depth and label images that callers bring, and put them on a device."""

from __future__ import annotations

import warp as wp

from warpvis.core.arrays import as_numpy, as_warp, get_device
from warpvis.core.image_cameras import ImageCamera, require_image_camera
from warpvis.core.types import ArrayInput, DeviceLike
from warpvis.errors import ArrayError


def read_depth(depth: ArrayInput, camera: ImageCamera, device: DeviceLike) -> wp.array:
    """Return depth images that a camera took, shape ``(V, H, W)``, on a device; by default where they are.

    Raises:
        WarpvisError: They, the camera or the device are not what they have to be.
    """
    require_image_camera(camera)
    if device is None:
        device = depth.device if isinstance(depth, wp.array) else _device_of(depth)
    device = get_device(device)
    if not isinstance(depth, wp.array) and device.is_cpu:
        depth = as_numpy(depth, name="depth")
        if depth.dtype.kind != "f":
            raise ArrayError(f"depth must be in metres, a float array, got {depth.dtype}; divide millimetres by 1000")
    if getattr(depth, "ndim", 0) == 2:
        depth = depth.reshape((1, *depth.shape))
    return as_warp(depth, wp.float32, ("V", camera.height, camera.width), name="depth", device=device)


def read_labels(labels: ArrayInput, shape: tuple[int, ...], device: wp.Device) -> wp.array:
    """Return images of labels, uint8, on a device.

    Args:
        labels: The images; one of shape ``(H, W)`` where a single view is wanted.
        shape: ``(V, H, W)``.
        device: Where they have to be.

    Raises:
        ArrayError: They are not what they have to be.
    """
    if getattr(labels, "ndim", 0) == 2 and shape[0] == 1:
        labels = labels.reshape((1, *labels.shape))
    return as_warp(labels, wp.uint8, shape, name="labels", device=device)


def _device_of(array: object) -> str:
    """Return Warp's name of the device a foreign array is on."""
    kind, index = array.__dlpack_device__() if hasattr(array, "__dlpack_device__") else (1, 0)
    return f"cuda:{index}" if kind == 2 else "cpu"
