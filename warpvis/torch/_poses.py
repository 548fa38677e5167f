# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses as tensors, with gradients."""

from __future__ import annotations

import torch
from torch import Tensor

from warpvis.core.poses import host_poses
from warpvis.errors import ArrayError, PoseError


def apply_twists(poses: Tensor, twists: Tensor) -> Tensor:
    """Return poses that are moved by small motions in their own frames.

    Args:
        poses: Rows ``x y z qx qy qz qw``, shape ``(..., 7)``.
        twists: Rotation vectors w [rad] and translations v [m], shape ``(..., 6)``: ``R exp([w]x)`` and ``t + R v``.

    Returns:
        Rows, ``(..., 7)``. At zero, gradients with respect to twists exist.
    """
    for name, value in (("poses", poses), ("twists", twists)):
        if not isinstance(value, Tensor) or not value.is_floating_point():
            got = value.dtype if isinstance(value, Tensor) else type(value).__name__
            raise ArrayError(f"{name} must be a torch.Tensor of floating-point numbers, got {got}")
    if poses.shape[-1:] != (7,) or twists.shape[-1:] != (6,):
        raise PoseError(
            f"poses and twists must have shapes (..., 7) and (..., 6), got {tuple(poses.shape)} and "
            f"{tuple(twists.shape)}"
        )
    if poses.dtype != twists.dtype:
        raise ArrayError(f"poses and twists must have the same dtype, got {poses.dtype} and {twists.dtype}")
    vector, translation = twists[..., :3], twists[..., 3:]
    angle = torch.linalg.vector_norm(vector, dim=-1, keepdim=True)
    turn = torch.cat([0.5 * torch.sinc(angle / (2 * torch.pi)) * vector, torch.cos(0.5 * angle)], dim=-1)
    rotation = poses[..., 3:]
    moved = poses[..., :3] + _rotate(rotation, translation)
    return torch.cat([moved, _product(rotation, turn)], dim=-1)


def matrices_to_rows(matrices: Tensor) -> Tensor:
    """Return the rows ``x y z qx qy qz qw`` of rigid transforms, shape ``(..., 4, 4)``, with gradients.

    The products of the quaternion's components are linear in the rotation matrix: ``4 q q^T = K``. The row of K with
    the largest diagonal is a multiple of q.
    """
    if matrices.shape[-2:] != (4, 4):
        raise PoseError(f"matrices must have shape (..., 4, 4), got {tuple(matrices.shape)}")
    r = [[matrices[..., i, k] for k in range(3)] for i in range(3)]
    x, y, z = r[0][0] - r[1][1] - r[2][2], r[1][1] - r[0][0] - r[2][2], r[2][2] - r[0][0] - r[1][1]
    xy, xz, yz = r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]
    xw, yw, zw = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    w = r[0][0] + r[1][1] + r[2][2]
    table = [1 + x, xy, xz, xw, xy, 1 + y, yz, yw, xz, yz, 1 + z, zw, xw, yw, zw, 1 + w]
    products = torch.stack(table, dim=-1).reshape(*matrices.shape[:-2], 4, 4)
    largest = torch.diagonal(products, dim1=-2, dim2=-1).argmax(dim=-1)
    chosen = torch.take_along_dim(products, largest[..., None, None].expand(*largest.shape, 1, 4), dim=-2)[..., 0, :]
    quaternion = chosen / torch.linalg.vector_norm(chosen, dim=-1, keepdim=True)
    return torch.cat([matrices[..., :3, 3], quaternion], dim=-1)


def _rotate(q: Tensor, v: Tensor) -> Tensor:
    """Rotate vectors by unit quaternions ``x y z w``."""
    cross = 2 * torch.linalg.cross(q[..., :3], v)
    return v + q[..., 3:] * cross + torch.linalg.cross(q[..., :3], cross)


def _product(p: Tensor, q: Tensor) -> Tensor:
    """Return products of quaternions ``x y z w``."""
    vector = p[..., 3:] * q[..., :3] + q[..., 3:] * p[..., :3] + torch.linalg.cross(p[..., :3], q[..., :3])
    scalar = p[..., 3:] * q[..., 3:] - (p[..., :3] * q[..., :3]).sum(dim=-1, keepdim=True)
    return torch.cat([vector, scalar], dim=-1)


def as_rows(poses: Tensor, name: str, axes: tuple[str, ...]) -> Tensor:
    """Return poses as rows of the shape ``(*axes, 7)``; the first axis may be missing."""
    if not isinstance(poses, Tensor):
        raise ArrayError(f"{name} must be a torch.Tensor, got {type(poses).__name__}")
    if poses.dtype != torch.float32:
        raise ArrayError(f"{name} must be float32, got {poses.dtype}")
    rows = matrices_to_rows(poses) if poses.ndim > len(axes) and poses.shape[-2:] == (4, 4) else poses
    rows = rows[None] if rows.ndim == len(axes) else rows
    if rows.ndim != len(axes) + 1 or rows.shape[-1] != 7:
        shape = ", ".join(axes)
        raise PoseError(f"{name} must have shape ({shape}, 7) or ({shape}, 4, 4), got {tuple(poses.shape)}")
    _check_values(poses, name)
    return rows


def _check_values(poses: Tensor, name: str) -> None:
    """Check poses on the CPU as `Renderer.render` does, which sees only the rows of matrices."""
    if poses.device.type != "cpu" or torch.compiler.is_compiling():
        return
    try:
        values = poses.detach().numpy()
    except RuntimeError:  # tensors without memory, as in torch.vmap
        return
    if values.size:
        host_poses(values.reshape(-1, *values.shape[values.ndim - (1 if values.shape[-1] == 7 else 2) :]), name=name)
