# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangle meshes of MuJoCo's flat shapes, closed and facing outward; round shapes are in `warpvis.scene.solids`.

Sizes and axes follow MuJoCo (https://mujoco.readthedocs.io/en/stable/XMLreference.html#body-geom-size).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]
"""Vertices [m], shape ``(n, 3)``, and faces, shape ``(m, 3)``."""

SLAB = 1e-4
"""Distance of a plane's underside below it [m]."""


def box(half_sizes: tuple[float, float, float]) -> Mesh:
    """Build a box of three half sizes [m]."""
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners * np.asarray(half_sizes, dtype=np.float64), _split_quads(quads)


def plane(half_x: float, half_y: float) -> Mesh:
    """Build the rectangle z = 0 of two half sizes [m] as the top of a slab, so that it is visible from both sides.

    MuJoCo draws planes from both sides although it culls back faces (`renderGeom` in src/render/classic/render_gl3.c).
    """
    vertices, faces = box((half_x, half_y, SLAB / 2))
    vertices[:, 2] = np.where(vertices[:, 2] > 0, 0.0, -SLAB)
    return vertices, faces


def height_field(elevation: NDArray[np.float64], size: NDArray[np.float64]) -> Mesh:
    """Build a height field with sides and bottom, identical to MuJoCo's.

    Cells are split along the diagonal from their lower corner (`mjr_uploadHField` in src/render/classic/
    render_context.c; collisions and rays do the same).

    Args:
        elevation: Heights as a fraction of ``size[2]``, shape ``(rows, columns)``: rows along y, columns along x.
        size: Half size in x, half size in y, maximum elevation, thickness of the base [m]: `mjModel.hfield_size`.
    """
    rows, columns = elevation.shape
    x, y = np.linspace(-size[0], size[0], columns), np.linspace(-size[1], size[1], rows)
    top = np.stack([*np.meshgrid(x, y), elevation * size[2]], axis=-1).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    lower, right, far, up = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    surface = np.stack([lower, right, far, lower, far, up], axis=-1).reshape(-1, 3)

    # The border, counterclockwise from above; under it its shadow on the base, and a fan from the base's middle.
    border = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    below = len(top) + np.arange(len(border))
    base = np.r_[top[border][:, :2], [[0.0, 0.0]]]
    sides = _split_quads(np.stack([border, below, np.roll(below, -1), np.roll(border, -1)], axis=-1))
    bottom = np.stack([np.full(len(border), len(top) + len(border)), np.roll(below, -1), below], axis=-1)
    vertices = np.concatenate([top, np.c_[base, np.full(len(base), -size[3])]])
    return vertices, np.concatenate([surface, sides, bottom]).astype(np.int32)


def _split_quads(quads: NDArray[np.int_]) -> NDArray[np.int32]:
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
