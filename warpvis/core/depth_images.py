# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check depth and label images that callers bring, and put them on a device."""

from __future__ import annotations

import math

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, as_warp, get_device, on_gpu
from warpvis.core.image_cameras import ImageCamera, require_image_camera
from warpvis.core.types import ArrayInput, DeviceLike
from warpvis.errors import ArrayError

# Pixels that are examined first; all pixels only where these look like millimeters.
_SAMPLE = 4096

# Shares of the measured pixels, and how many times the range they exceed, that a wrong unit explains and nothing else.
_NEARLY_ALL, _MOST, _FAR_BEYOND = 0.9, 0.5, 10.0

# A depth image in millimeters shows little that is nearer [m].
_MIN_MILLIMETER_DEPTH = 0.1

# Distinct whole numbers that measured meters never are.
_MANY_WHOLE_NUMBERS = 16


def read_depth(
    depth: ArrayInput, camera: ImageCamera, device: DeviceLike, *, max_range: float | None = None
) -> wp.array:
    """Return depth images that a camera took, shape ``(V, H, W)``, on a device; by default where they are.

    The unit of arrays on the host is checked, see `check_meters`. Arrays on a GPU are not examined, because that would
    wait for them.

    Args:
        depth: The images [m].
        camera: The camera that took them.
        device: The device of the result.
        max_range: Greatest depth that counts [m]; the camera's `far` by default.

    Raises:
        WarpvisError: They, the camera or the device are not what they have to be.
    """
    require_image_camera(camera)
    if device is None:
        device = depth.device if isinstance(depth, wp.array) else _device_of(depth)
    device = get_device(device)
    if not on_gpu(depth):
        host = depth.numpy() if isinstance(depth, wp.array) else as_numpy(depth, name="depth")
        check_meters(host, "depth", camera.near, camera.far if max_range is None else max_range)
        depth = depth if isinstance(depth, wp.array) else host
    if getattr(depth, "ndim", 0) == 2:
        depth = depth.reshape((1, *depth.shape))
    return as_warp(depth, wp.float32, ("V", camera.height, camera.width), name="depth", device=device)


def check_meters(depth: NDArray, name: str, near: float, far: float) -> None:
    """Check that depth is in meters, a float array whose values are not plainly millimeters.

    With a finite `far`, values are millimeters if nearly all of them are beyond it, most of them ten times as far, and
    a thousandth of most is between `near` and `far`. Without one, they are if all of them are whole numbers, many of
    them different. NaN, infinities, 0 and negative values are no measurements and are ignored.

    Args:
        depth: Depth of any shape, on the host.
        name: What messages call it.
        near: Least depth of the camera [m].
        far: Greatest depth [m]; infinite if it is not known.

    Raises:
        ArrayError: If it is an array of integers, or of millimeters.
    """
    if depth.dtype.kind != "f":
        raise ArrayError(f"{name} must be in meters, a float array, got {depth.dtype}; divide millimeters by 1000")
    if not _in_millimeters(_some_of(depth), near, far) or not _in_millimeters(depth, near, far):
        return
    median = float(np.median(_measured(depth)))
    if math.isinf(far):
        raise ArrayError(
            f"{name} must be in meters, got whole numbers only, with a median of {median:g}, as millimeters are: pass "
            f"{name} / 1000; if these are meters, give the camera its far"
        )
    raise ArrayError(
        f"{name} must be in meters, got a median of {median:g} beyond a range of {near:g} to {far:g} m, which it is "
        f"within as millimeters: pass {name} / 1000; if these are meters, give the camera a far that includes them"
    )


def _some_of(depth: NDArray) -> NDArray:
    """Return pixels of an even grid in each image, about `_SAMPLE` in all."""
    if depth.ndim < 2 or not depth.size:
        return depth
    step = min(math.isqrt(depth.size // _SAMPLE), *depth.shape[-2:]) or 1
    return depth[..., step // 2 :: step, step // 2 :: step]


def _measured(depth: NDArray) -> NDArray:
    return depth[(depth > 0) & (depth < np.inf)]


def _in_millimeters(depth: NDArray, near: float, far: float) -> bool:
    """Return whether depth has the statistics of millimeters, as `check_meters` describes."""
    values = _measured(depth)
    if not values.size:
        return False
    if math.isinf(far):
        if np.median(values) < 1e3 * _MIN_MILLIMETER_DEPTH or np.any(values != np.rint(values)):
            return False
        return len(np.unique(values)) >= _MANY_WHOLE_NUMBERS
    if np.mean(values > far) < _NEARLY_ALL or np.mean(values > _FAR_BEYOND * far) < _MOST:
        return False
    least = 1e3 * max(near, _MIN_MILLIMETER_DEPTH)
    return bool(np.mean((values >= least) & (values <= 1e3 * far)) >= _MOST)


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
