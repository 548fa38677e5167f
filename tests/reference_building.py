# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Float64 references of the kernels that build a BVH on a GPU: one level of the binary tree, then of wide nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LANES, SMALL, BINS, MAX_DEPTH = 32, 128, 16, 40


def half_area(low: NDArray, high: NDArray) -> NDArray:
    """Return half the surface area of boxes, corners in the last axis."""
    x, y, z = np.moveaxis(np.asarray(high, dtype=np.float64) - low, -1, 0)
    return x * y + y * z + z * x


def leaves_of(count: NDArray) -> NDArray:
    """Return the number of leaves that hold `count` items."""
    return -(-np.asarray(count) // LANES)


def must_halve(count: int, depth: int) -> bool:
    """Return whether the range must be halved from this depth on to stay within the maximum depth."""
    return depth + int(np.ceil(np.log2(leaves_of(count)))) >= MAX_DEPTH


def half_of(count: int) -> int:
    """Return the number of items in the first half: a whole number of leaves."""
    return int(leaves_of(count // 2)) * LANES


def check_mesh(vertices: NDArray, faces: NDArray, farthest: float) -> list[int]:
    """Return the number of vertices out of range or not finite, the first one's index, and the face index range."""
    bad = np.flatnonzero(~(np.abs(vertices) <= farthest).all(axis=1))
    return [len(bad), *bad[:1], *([2**31 - 1] * (not len(bad))), faces.min(), faces.max()]


def bound_centers(low: NDArray, high: NDArray) -> NDArray:
    """Return the box of the sums of opposite corners (twice the centers) as one row of six."""
    twice = np.asarray(low, dtype=np.float64) + high
    return np.concatenate([twice.min(axis=0), twice.max(axis=0)])


def begin_tree(count: int) -> tuple[int, int, int]:
    """Return begin, end and child of the root."""
    return 0, count, -1


def mark_ranges(counts: NDArray) -> NDArray:
    """Return two rows: whether ranges are large, and whether they are small inner nodes."""
    return np.stack([counts > SMALL, (counts > LANES) & (counts <= SMALL)]).astype(int)


def count_ranges(info: NDArray, sums: NDArray) -> list[int]:
    """Return the next level's first node, nodes, large ranges and ranges, and the first node of the level after it."""
    *_, first, count = info
    return [first, count, *sums, first + count, 2 * sums[1]]


def clear_bins(count: int) -> tuple[NDArray, NDArray]:
    """Return boxes and counts of empty bins."""
    return np.tile([np.inf] * 3 + [-np.inf] * 3, (count, 1)), np.zeros(count, dtype=int)


def rank_ranges(counts: NDArray) -> NDArray:
    """Return indices of the ranges to split, large ones first."""
    large, small = mark_ranges(counts)
    return np.concatenate([np.flatnonzero(large), np.flatnonzero(small)])


def bins_of(low: NDArray, high: NDArray, grid: NDArray) -> NDArray:
    """Return the bin of each item along each axis, (n, 3), in single precision as the kernel assigns them."""
    centers, size = np.float32(low) + np.float32(high), np.float32(grid[1]) - np.float32(grid[0])
    scale = np.where(size > 1e-30, np.float32(BINS) / np.where(size > 1e-30, size, 1), 0).astype(np.float32)
    return np.clip(np.trunc((centers - np.float32(grid[0])) * scale), 0, BINS - 1).astype(int)


def fill_bins(low: NDArray, high: NDArray, grid: NDArray) -> tuple[NDArray, NDArray]:
    """Return boxes (3, 16, 6) of the items in each bin, (inf, -inf) if empty, and their counts (3, 16)."""
    cells = bins_of(low, high, grid)
    boxes = np.concatenate([np.full((3, BINS, 3), np.inf), np.full((3, BINS, 3), -np.inf)], axis=2)
    counts = np.zeros((3, BINS), dtype=int)
    for axis in range(3):
        for cell in range(BINS):
            inside = cells[:, axis] == cell
            counts[axis, cell] = inside.sum()
            if inside.any():
                boxes[axis, cell] = np.concatenate([low[inside].min(axis=0), high[inside].max(axis=0)])
    return boxes, counts


def cost_of_split(left: NDArray, left_count: NDArray, right: NDArray, right_count: NDArray) -> NDArray:
    """Return the cost of two children from their areas and counts."""
    total = np.asarray(left_count) + right_count
    return (left * leaves_of(left_count) + right * leaves_of(right_count)) / total


def choose_bins(boxes: NDArray, counts: NDArray) -> NDArray:
    """Return the cost of splitting before each bin, (3, 16); inf where one side would be empty."""
    costs = np.full((3, BINS), np.inf)
    for axis in range(3):
        for cell in range(1, BINS):
            sides = [slice(None, cell), slice(cell, None)]
            numbers = [counts[axis, side].sum() for side in sides]
            if min(numbers) > 0:
                areas = [half_area(boxes[axis, s, :3].min(axis=0), boxes[axis, s, 3:].max(axis=0)) for s in sides]
                costs[axis, cell] = cost_of_split(areas[0], numbers[0], areas[1], numbers[1])
    return costs


def sort_small(low: NDArray, high: NDArray, axis: int) -> NDArray:
    """Return the order of items by their centers along an axis, compared in single precision."""
    places = np.empty(len(low), dtype=int)
    places[np.argsort(np.float32(low[:, axis]) + np.float32(high[:, axis]), kind="stable")] = np.arange(len(low))
    return places


def choose_places(low: NDArray, high: NDArray) -> NDArray:
    """Return the cost of splitting after 1, 2, ... items along each axis, (3, n - 1)."""
    costs = []
    for axis in range(3):
        order = np.argsort(sort_small(low, high, axis))
        sides = [(low[o], high[o]) for o in (order, order[::-1])]
        areas = [half_area(np.minimum.accumulate(a), np.maximum.accumulate(b)) for a, b in sides]
        count = np.arange(1, len(low))
        costs.append(cost_of_split(areas[0][:-1], count, areas[1][-2::-1], len(low) - count))
    return np.array(costs)


def part_bins(boxes: NDArray, cell: int) -> list[NDArray]:
    """Return the boxes of the bins of one axis before a bin, and from it on."""
    sides = boxes[:cell], boxes[cell:]
    return [np.concatenate([side[:, :3].min(axis=0), side[:, 3:].max(axis=0)]) for side in sides]


def find_sides(low: NDArray, high: NDArray, grid: NDArray, axis: int, first_right: int) -> NDArray:
    """Return whether each item of a large range goes left when split before a bin."""
    return (bins_of(low, high, grid)[:, axis] < first_right).astype(int)


def move_items(lefts: NDArray) -> NDArray:
    """Return the order of a range's items: left ones first, otherwise stable."""
    return np.argsort(1 - lefts, kind="stable")


def part_small(low: NDArray, high: NDArray, middle: int) -> list[NDArray]:
    """Return the boxes of the items before and after a position, as rows of min and max corner."""
    sides = [slice(None, middle), slice(middle, None)]
    return [np.concatenate([low[side].min(axis=0), high[side].max(axis=0)]) for side in sides]


def find_costs(child: NDArray, area: NDArray, first: int) -> NDArray:
    """Return the smallest node area of each subtree in at most 1, 2, ..., 32 parts, (nodes, 32), from `first` on."""
    costs = np.zeros((len(child), LANES))
    for node in reversed(range(first, len(child))):
        if child[node] >= 0:
            left, right = costs[child[node]], costs[child[node] + 1]
            shares = [np.min(left[:most] + right[:most][::-1]) for most in range(1, LANES)]
            costs[node, 0] = area[node] + shares[-1]
            costs[node, 1:] = np.minimum.accumulate(np.minimum(shares, costs[node, 0]))
    return costs


def open_nodes(child: NDArray, costs: NDArray, node: int) -> float:
    """Return the smallest total cost of a node's parts."""
    left, right = costs[child[node]], costs[child[node] + 1]
    return float(np.min(left[: LANES - 1] + right[: LANES - 1][::-1]))


def name_children(parts: NDArray, is_leaf: NDArray, next_node: int, first_leaf: int) -> NDArray:
    """Return node and leaf numbers of parts, row by row; 0 for unused parts."""
    used = parts >= 0
    inner, leaves = used & ~is_leaf, used & is_leaf
    nodes = next_node + np.cumsum(inner).reshape(parts.shape) - 1
    return np.where(inner, nodes, np.where(leaves, -first_leaf - np.cumsum(leaves).reshape(parts.shape), 0))


def join_children(children: NDArray, first_node: int, first_leaf: int) -> NDArray:
    """Return the children of a tree that is appended to others."""
    return np.where(children > 0, children + first_node, np.where(children < 0, children - first_leaf, 0))


def mark_owners(owners: NDArray, closed: NDArray) -> NDArray:
    """Return the complement of the owners of closed meshes."""
    return np.where(closed[owners], ~owners, owners)


def fit_leaves(normals: NDArray, axis: NDArray) -> float:
    """Return the lower bound of the sine of a cone's cutoff: of the widest angle to an axis; 2 from 90 degrees on."""
    cosine = np.nanmin(normals @ axis)
    return float(np.sqrt(1 - cosine**2)) if cosine > 0 else 2.0
