# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check depth and label images from callers, and copy them to a device."""

from __future__ import annotations

import math

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.arrays import as_numpy, as_warp, get_device, on_gpu
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.types import ArrayInput, DeviceLike, PoseLike
from warpvis.errors import ArrayError

# Number of pixels that are examined first; all pixels are examined only if these may be in millimeters.
_SAMPLE = 4096

# Fractions of the measured pixels, and the factor by which they exceed the range, that only a wrong unit explains.
_NEARLY_ALL, _MAJORITY, _FAR_BEYOND = 0.9, 0.5, 10.0

# Distance below which a depth image in millimeters has few pixels [m].
_MIN_MILLIMETER_DEPTH = 0.1

# Measurements in meters never consist of this many distinct integers.
_MANY_WHOLE_NUMBERS = 16


def read_depth(
    depth: ArrayInput, camera: ImageCamera, device: DeviceLike, *, max_range: float | None = None
) -> wp.array:
    """Return a camera's depth images, shape ``(V, H, W)``, as an array on a device; by default the device they are on.

    The unit of arrays in host memory is checked, see `check_meters`. Arrays on a GPU are not examined, because that
    would require synchronization. `max_range` is the maximum valid depth [m], the camera's `far` by default.
    """
    require_image_camera(camera)
    if device is None:
        device = depth.device if isinstance(depth, wp.array) else _device_of(depth)
    device = get_device(device)
    if not on_gpu(depth):
        host = as_numpy(depth, name="depth")
        refuse_color(host.shape, camera, "depth")
        check_meters(host, "depth", camera.near, camera.far if max_range is None else max_range)
        depth = depth if isinstance(depth, wp.array) else host
    if getattr(depth, "ndim", 0) == 2:
        depth = depth.reshape((1, *depth.shape))
    return as_warp(depth, wp.float32, ("V", camera.height, camera.width), name="depth", device=device)


def read_images(
    depth: ArrayInput,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    convention: Convention,
    quaternion: QuaternionOrder,
    device: DeviceLike,
    max_range: float | None = None,
    *,
    poses_on_host: bool = False,
) -> tuple[wp.array, wp.array]:
    """Return a camera's depth images and their poses on one device.

    With `poses_on_host`, poses in host memory stay there.
    """
    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    depth = read_depth(depth, camera, device, max_range=max_range)
    place = "cpu" if poses_on_host and not on_gpu(camera_to_world) else depth.device
    poses = parse_poses(camera_to_world, convention=convention, device=place)
    if len(poses) != len(depth):
        raise ArrayError(f"camera_to_world must have one pose for each view of depth, {len(depth)}, got {len(poses)}")
    return depth, poses


def refuse_color(shape: tuple[int, ...], camera: ImageCamera, name: str) -> None:
    """Raise `ArrayError` if an array has the shape of color images of a camera."""
    if len(shape) > 2 and shape[-1] in (3, 4) and shape[-3:-1] == (camera.height, camera.width):
        raise ArrayError(f"{name} must be depth images, (V, H, W), got color images of shape {shape}; pass the depth")


def check_meters(depth: NDArray, name: str, near: float, far: float) -> None:
    """Check that depth is a float array in meters whose values are not obviously millimeters.

    With a finite `far`, values are millimeters if nearly all of them exceed it, most of them tenfold, and a thousandth
    of most values is between `near` and `far`. With an infinite `far`, values are millimeters if all of them are
    integers and many of them are different. NaN, infinities, 0 and negative values are not measurements and are
    ignored.

    Args:
        depth: Depth of any shape, in host memory.
        name: Name of the argument in error messages.
        near: Minimum depth of the camera [m].
        far: Maximum depth [m]; infinite if unknown.
    """
    if depth.dtype.kind != "f":
        remedy = "it may be a color image" if depth.dtype.itemsize == 1 else "divide millimeters by 1000"
        raise ArrayError(f"{name} must be in meters, a float array, got {depth.dtype}; {remedy}")
    if _is_gray(_sample(depth)) and _is_gray(depth):
        raise ArrayError(
            f"{name} must be in meters, got whole numbers up to {depth[depth < np.inf].max():g}, as gray images of 8 "
            "bits have; pass the depth images, not their pictures"
        )
    if not _in_millimeters(_sample(depth), near, far) or not _in_millimeters(depth, near, far):
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


def _sample(depth: NDArray) -> NDArray:
    """Return the pixels of a regular grid in each image, about `_SAMPLE` in total."""
    if depth.ndim < 2 or not depth.size:
        return depth
    step = min(math.isqrt(depth.size // _SAMPLE), *depth.shape[-2:]) or 1
    return depth[..., step // 2 :: step, step // 2 :: step]


def _measured(depth: NDArray) -> NDArray:
    return depth[(depth > 0) & (depth < np.inf)]


def _is_gray(depth: NDArray) -> bool:
    """Return whether depth has the values of images of 8 bits."""
    values = _measured(depth)
    return bool(values.size and values.max() <= 255 and _are_whole(values))


def _are_whole(values: NDArray) -> bool:
    """Return whether values are many distinct integers, which measurements in meters never are."""
    return not np.any(values != np.rint(values)) and len(np.unique(values)) >= _MANY_WHOLE_NUMBERS


def _in_millimeters(depth: NDArray, near: float, far: float) -> bool:
    """Return whether depth has the statistics of millimeters, as `check_meters` describes."""
    values = _measured(depth)
    if not values.size:
        return False
    if math.isinf(far):
        return bool(np.median(values) >= 1e3 * _MIN_MILLIMETER_DEPTH) and _are_whole(values)
    if np.mean(values > far) < _NEARLY_ALL or np.mean(values > _FAR_BEYOND * far) < _MAJORITY:
        return False
    lower = 1e3 * max(near, _MIN_MILLIMETER_DEPTH)
    return bool(np.mean((values >= lower) & (values <= 1e3 * far)) >= _MAJORITY)


def read_labels(labels: ArrayInput, shape: tuple[int, ...], device: wp.Device) -> wp.array:
    """Convert label images, ``(V, H, W)``, or ``(H, W)`` for a single view, to a uint8 array on a device."""
    if getattr(labels, "ndim", 0) == 2 and shape[0] == 1:
        labels = labels.reshape((1, *labels.shape))
    return as_warp(labels, wp.uint8, shape, name="labels", device=device)


def _device_of(array: object) -> str:
    """Return Warp's name for the device of a third-party array."""
    kind, index = array.__dlpack_device__() if hasattr(array, "__dlpack_device__") else (1, 0)
    return f"cuda:{index}" if kind == 2 else "cpu"
