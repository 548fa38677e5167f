# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Differentiable renders for JAX: gradients of images with respect to poses, shapes and colors.

>>> import jax, jax.numpy as jnp, warpvis.jax
>>> def loss(poses):
...     depth = warpvis.jax.render(scene, camera, poses).depth
...     return jnp.where(jnp.isfinite(depth), depth, 0.0).sum()
>>> gradient = jax.jit(jax.grad(loss))(jnp.array([[0, 0, 0, 0, 0, 0, 1.0]]))

Gradients are those of the seen surfaces; silhouettes do not contribute (`silhouette_mask`), except to `coverage`,
`soft_mask` and `visible_fraction`. Renders are calls of XLA's foreign function interface: on the CPU and on a GPU they
read and write JAX's buffers in place.
"""

from warpvis.jax._coverage import coverage, soft_mask, visible_fraction
from warpvis.jax._poses import apply_twists, matrices_to_rows
from warpvis.jax._render import Images, render
from warpvis.jax._silhouettes import silhouette_mask

__all__ = [
    "Images",
    "apply_twists",
    "coverage",
    "matrices_to_rows",
    "render",
    "silhouette_mask",
    "soft_mask",
    "visible_fraction",
]
