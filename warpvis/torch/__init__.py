# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Differentiable renders for PyTorch: gradients of depth, points and normals with respect to poses and shapes.

>>> import torch, warpvis.torch
>>> poses = torch.tensor([[0, 0, 0, 0, 0, 0, 1.0]], requires_grad=True)
>>> images = warpvis.torch.render(scene, camera, poses, outputs=("depth", "normals"))
>>> images.depth[images.depth.isfinite()].sum().backward()

Gradients are those of the seen surfaces; silhouettes do not contribute (`silhouette_mask`), except to
`coverage`, `soft_mask` and `visible_fraction`.
"""

from warpvis.torch._coverage import coverage, soft_mask, visible_fraction
from warpvis.torch._poses import apply_twists, matrices_to_rows
from warpvis.torch._render import Images, render
from warpvis.torch._silhouettes import silhouette_mask

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
