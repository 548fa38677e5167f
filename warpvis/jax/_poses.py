# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses as JAX arrays, with gradients."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from warpvis.errors import PoseError

_SMALL_ANGLE = 1e-4
"""Squared angle [rad^2] below which series replace sine and cosine: their next terms vanish in single precision."""


def apply_twists(poses: ArrayLike, twists: ArrayLike) -> Array:
    """Return poses that are moved by small motions in their own frames.

    Args:
        poses: Rows ``x y z qx qy qz qw``, shape ``(..., 7)``.
        twists: Rotation vectors w [rad] and translations v [m], shape ``(..., 6)``: ``R exp([w]x)`` and ``t + R v``.

    Returns:
        Rows, ``(..., 7)``. At zero, gradients with respect to twists exist.
    """
    poses, twists = jnp.asarray(poses), jnp.asarray(twists)
    if poses.shape[-1:] != (7,) or twists.shape[-1:] != (6,):
        raise PoseError(
            f"poses and twists must have shapes (..., 7) and (..., 6), got {poses.shape} and {twists.shape}"
        )
    vector, translation = twists[..., :3], twists[..., 3:]
    squared = (vector * vector).sum(axis=-1, keepdims=True)
    is_small = squared < _SMALL_ANGLE
    half = 0.5 * jnp.sqrt(jnp.where(is_small, 1.0, squared))
    scale = jnp.where(is_small, 0.5 - squared / 48 + squared * squared / 3840, 0.5 * jnp.sin(half) / half)
    cosine = jnp.where(is_small, 1 - squared / 8 + squared * squared / 384, jnp.cos(half))
    rotation = poses[..., 3:]
    moved = poses[..., :3] + _rotate(rotation, translation)
    turned = _product(rotation, jnp.concatenate([scale * vector, cosine], axis=-1))
    shape = jnp.broadcast_shapes(moved.shape[:-1], turned.shape[:-1])
    return jnp.concatenate([jnp.broadcast_to(moved, (*shape, 3)), jnp.broadcast_to(turned, (*shape, 4))], axis=-1)


def matrices_to_rows(matrices: ArrayLike) -> Array:
    """Return the rows ``x y z qx qy qz qw`` of rigid transforms, shape ``(..., 4, 4)``, with gradients.

    Products of the quaternion's components are linear in the rotation matrix: ``4 q q^T = K``. The row of K with the
    largest diagonal is a multiple of q.
    """
    matrices = jnp.asarray(matrices)
    if matrices.shape[-2:] != (4, 4):
        raise PoseError(f"matrices must have shape (..., 4, 4), got {matrices.shape}")
    r = [[matrices[..., i, k] for k in range(3)] for i in range(3)]
    x, y, z = r[0][0] - r[1][1] - r[2][2], r[1][1] - r[0][0] - r[2][2], r[2][2] - r[0][0] - r[1][1]
    xy, xz, yz = r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]
    xw, yw, zw = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    w = r[0][0] + r[1][1] + r[2][2]
    table = [1 + x, xy, xz, xw, xy, 1 + y, yz, yw, xz, yz, 1 + z, zw, xw, yw, zw, 1 + w]
    products = jnp.stack(table, axis=-1).reshape(*matrices.shape[:-2], 4, 4)
    largest = jnp.diagonal(products, axis1=-2, axis2=-1).argmax(axis=-1)
    chosen = jnp.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    quaternion = chosen / jnp.sqrt((chosen * chosen).sum(axis=-1, keepdims=True))
    return jnp.concatenate([matrices[..., :3, 3], quaternion], axis=-1)


def _rotate(q: Array, v: Array) -> Array:
    """Rotate vectors by unit quaternions ``x y z w``."""
    cross = 2 * jnp.cross(q[..., :3], v)
    return v + q[..., 3:] * cross + jnp.cross(q[..., :3], cross)


def _product(p: Array, q: Array) -> Array:
    """Return products of quaternions ``x y z w``."""
    vector = p[..., 3:] * q[..., :3] + q[..., 3:] * p[..., :3] + jnp.cross(p[..., :3], q[..., :3])
    scalar = p[..., 3:] * q[..., 3:] - (p[..., :3] * q[..., :3]).sum(axis=-1, keepdims=True)
    return jnp.concatenate([vector, scalar], axis=-1)
