# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images that callers bring, checked and put on a device."""

from __future__ import annotations

from typing import Any

import warp as wp

from warpvis.core.arrays import as_numpy, as_warp, get_device
from warpvis.core.camera import Camera, require_camera
from warpvis.errors import ArrayError


def read_depth(depth: Any, camera: Camera, device: Any) -> wp.array:
    """Depth images that a camera took, shape ``(V, H, W)``, on a device; by default where they are.

    Raises:
        WarpvisError: They, the camera or the device are not what they have to be.
    """
    require_camera(camera)
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


def _device_of(array: Any) -> str:
    """Warp's name of the device a foreign array is on."""
    kind, index = array.__dlpack_device__() if hasattr(array, "__dlpack_device__") else (1, 0)
    return f"cuda:{index}" if kind == 2 else "cpu"
