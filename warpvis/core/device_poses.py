# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read camera poses in GPU memory without copying them to the host; see `warpvis.core.poses`."""

from __future__ import annotations

import warp as wp

from warpvis.core.kernel_cache import launch
from warpvis.core.types import PoseLike
from warpvis.errors import PoseError

_NO_ROTATION = (0.0, 0.0, 0.0, 1.0)


def parse_on_device(poses: wp.array, rotation: tuple[float, ...] | None, device: wp.Device, name: str) -> wp.array:
    """Check shape, dtype and device of poses on a GPU, and rotate each frame by a quaternion; see `parse_poses`."""
    from warpvis.kernels import poses as kernels

    if poses.device != device:
        raise PoseError(f"{name} must be on device {device}, got {poses.device}")
    matrices, poses = _as_poses(poses, name)
    if not matrices and rotation is None:
        return poses
    kernel = kernels.poses_from_matrices if matrices else kernels.poses_to_opencv
    out = wp.empty(poses.shape, dtype=wp.transform, device=device)
    launch(kernel, poses.shape, [poses, wp.quat(*(rotation or _NO_ROTATION)), out], device)
    return out


def to_xyzw_on_device(poses: wp.array) -> wp.array:
    """Convert poses with quaternions in wxyz order to xyzw order."""
    from warpvis.kernels import poses as kernels

    shape = poses.shape
    if wp.types.types_equal(poses.dtype, wp.transform):
        poses = poses.contiguous().view(wp.float32)
    if poses.dtype != wp.float32 or poses.shape[-1] != 7:
        return poses  # matrices, or invalid poses, which the parser rejects
    rows = poses.contiguous().reshape((-1, 7))
    out = wp.empty(rows.shape, dtype=wp.float32, device=rows.device)
    launch(kernels.quaternions_to_xyzw, rows.shape[0], [rows, out], rows.device)
    out = out.reshape(poses.shape)
    return out.view(wp.transform).reshape(shape) if len(shape) < len(poses.shape) else out


def _as_poses(poses: wp.array, name: str) -> tuple[bool, wp.array]:
    """Return whether a device array contains matrices, and a view of it as `wp.mat44` or `wp.transform` elements."""
    for dtype, shape in ((wp.transform, (7,)), (wp.mat44, (4, 4))):
        matrices = dtype is wp.mat44
        if poses.ndim == 1 and wp.types.types_equal(poses.dtype, dtype):
            return matrices, poses.contiguous()  # ray packets read consecutive rows
        if poses.dtype == wp.float32 and poses.shape[-len(shape) :] == shape and poses.is_contiguous:
            views = poses.shape[0] if poses.ndim > len(shape) else 1
            if poses.ndim <= len(shape) + 1:
                # The view must keep the memory it refers to alive.
                view = wp.array(ptr=poses.ptr, dtype=dtype, shape=(views,), device=poses.device)
                view._ref = poses
                return matrices, view
    raise PoseError(
        f"{name} on {poses.device} must be contiguous float32 of shape (V, 7) or (V, 4, 4), "
        f"got {poses.dtype.__name__} of shape {poses.shape}"
    )


def from_foreign(poses: PoseLike, name: str) -> wp.array:
    """Convert poses from another library to a Warp array."""
    try:
        return wp.from_dlpack(poses)
    except Exception as error:  # third-party libraries may raise any exception
        raise PoseError(f"{name} must be an array of numbers: {error}") from None
