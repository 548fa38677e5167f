# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the functions that build trees over triangles on the host and refit them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def load_items(vertices: NDArray, faces: NDArray) -> NDArray[np.float64]:
    """Return boxes of the triangles: rows min x y z, max x y z."""
    corners = np.asarray(vertices, dtype=np.float64)[faces]
    return np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)


def box_area(boxes: NDArray) -> float:
    """Return half the surface area of the box around boxes, rows as from `load_items`."""
    x, y, z = boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)
    return x * y + y * z + z * x


def split_cost(left: NDArray, right: NDArray, lanes: int) -> float:
    """Return the cost of two children by the surface area heuristic, with leaves of `lanes` boxes."""
    return sum(box_area(boxes) * -(-len(boxes) // lanes) for boxes in (left, right))


def split_range(boxes: NDArray, lanes: int) -> float:
    """Return the smallest cost of any split of boxes ordered by their centers along an axis."""
    centers = boxes[:, :3] + boxes[:, 3:]
    orders = [np.argsort(centers[:, axis], kind="stable") for axis in range(3)]
    return min(split_cost(boxes[o[:i]], boxes[o[i:]], lanes) for o in orders for i in range(1, len(boxes)))


def collapse_tree(splits: dict[int, tuple], root: int, lanes: int) -> float:
    """Return the smallest total area of all nodes but the root, over all trees with at most `lanes` children per node.

    `splits` holds the binary tree: ``(left, right, left area, right area)``, where 0 denotes a leaf.
    """
    memory: dict[tuple[int, int], float] = {}

    def as_parts(split: int, most: int) -> float:
        left, right, *areas = splits[split]
        return min(subtree(left, areas[0], k) + subtree(right, areas[1], most - k) for k in range(1, most))

    def subtree(split: int, area: float, most: int) -> float:
        if split == 0:
            return 0.0
        if (split, most) not in memory:
            as_node = area + as_parts(split, lanes)
            memory[split, most] = as_node if most == 1 else min(as_node, as_parts(split, most))
        return memory[split, most]

    return as_parts(root, lanes) if root else 0.0


def fill_leaves(vertices: NDArray, faces: NDArray, triangles: NDArray) -> NDArray[np.float32]:
    """Return rows ax ay az bx by bz cx cy cz of the leaves, shape (L, 9, lanes); `triangles` has shape (L, lanes)."""
    used = np.where(triangles >= 0, triangles, triangles[:, :1])
    corners = vertices[faces[used]]
    corners[triangles < 0] = corners[triangles < 0][:, :1]
    return rotate_corners(corners).reshape(*triangles.shape, 9).swapaxes(1, 2)


def rotate_corners(corners: NDArray) -> NDArray:
    """Rotate the corners of triangles, shape (..., 3, 3), so that the first one is opposite to the longest side."""
    sides = np.abs(np.roll(corners, -1, axis=-2) - np.roll(corners, -2, axis=-2))
    first = np.argmax((sides[..., 0] + sides[..., 1]) + sides[..., 2], axis=-1)
    return np.take_along_axis(corners, (first[..., None, None] + np.arange(3)[:, None]) % 3, axis=-2)


def fit_nodes(vertices: NDArray, faces: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what bounds must contain: vertices, shape (n, 3, 3), and unit normals, NaN for degenerate triangles."""
    corners = np.asarray(vertices, dtype=np.float64)[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    return corners, normals / np.where(lengths > 0, lengths, np.nan)[:, None]


def refit_leaves(vertices: NDArray, leaf_vertices: NDArray) -> tuple[NDArray, NDArray]:
    """Return leaf rows, shape (L, 9, lanes), and leaf boxes, shape (L, 6); `leaf_vertices` is (L, 3, lanes)."""
    corners = vertices[leaf_vertices].swapaxes(1, 2)
    boxes = np.concatenate([corners.min(axis=(1, 2)), corners.max(axis=(1, 2))], axis=1)
    return np.moveaxis(rotate_corners(corners), 1, 3).reshape(len(leaf_vertices), 9, -1), boxes


def refit_nodes(boxes: NDArray, children: NDArray) -> tuple[NDArray, NDArray]:
    """Return boxes of the children, shape (N, 6, lanes), and of the root; `children` is (N, lanes)."""
    rows = np.empty((len(children), 6, children.shape[1]), dtype=boxes.dtype)
    rows[:, :3], rows[:, 3:] = 3e38, -3e38
    box = np.empty((len(children), 6), dtype=boxes.dtype)
    for node in reversed(range(len(children))):
        for lane in np.flatnonzero(children[node]):
            child = children[node, lane]
            rows[node, :, lane] = box[child] if child > 0 else boxes[~child]
        box[node] = [*rows[node, :3].min(axis=1), *rows[node, 3:].max(axis=1)]
    return rows, box[0]
