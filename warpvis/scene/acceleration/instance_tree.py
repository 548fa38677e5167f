# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A tree of instances' boxes in depth-first order, for rays that are traced one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.kernels.constants import CPU_LANES, NODE_HIGH_ROW, NODE_LOW_ROW, NODE_ROWS
from warpvis.scene.acceleration.bvh import Bvh, build_bvh


def instance_steps(boxes: NDArray[np.float32], poses: NDArray[np.float32]) -> np.ndarray:
    """Build a tree of boxes in the world for stackless traversal: `InstanceStep` of the kernels, in depth-first order.

    If the box of a step is missed, traversal skips to `after`, past its whole subtree; else it goes on with the next
    step (Smits 1998, "Efficiency issues for ray tracing").

    Args:
        boxes: Minimum and maximum corner of each instance's box [m], shape ``(n, 2, 3)``.
        poses: Their poses, shape ``(n, 7)``.
    """
    from warpvis.kernels.casting.triangle_scene import InstanceStep

    corners = np.arange(2 * len(boxes), dtype=np.int32).reshape(-1, 2)
    tree = build_bvh(  # each triangle is a diagonal of a box
        boxes.reshape(-1, 3),
        corners[:, [0, 1, 0]],
        np.zeros(len(boxes), dtype=np.int32),
        np.zeros(1, dtype=bool),
        lanes=CPU_LANES,
    )
    source, after = _walk(tree, len(boxes))
    nodes = tree.nodes.numpy().reshape(-1, NODE_ROWS, tree.lanes)
    sides = [nodes[:, row : row + 3].transpose(0, 2, 1).reshape(-1, 3) for row in (NODE_LOW_ROW, NODE_HIGH_ROW)]
    every_box = np.concatenate([boxes, np.stack(sides, axis=1)])
    steps: np.ndarray = np.zeros(len(source), dtype=InstanceStep.numpy_dtype())  # type: ignore[attr-defined]
    steps["low"], steps["high"] = every_box[source, 0], every_box[source, 1]
    steps["after"], steps["instance"] = after, np.where(source < len(boxes), source, -1)
    steps["pose"][: len(poses)] = poses
    return steps


def _walk(tree: Bvh, count: int) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
    """Return each step's box, an instance below `count` or `count` plus a child slot, and each step's `after`."""
    children = tree.children.numpy().reshape(-1, tree.lanes)
    leaves = [leaf[leaf >= 0].tolist() for leaf in tree.triangles.numpy().reshape(-1, tree.lanes)]
    source: list[int] = []
    after: list[int] = []

    def visit(node: int) -> None:
        for lane, child in enumerate(children[node].tolist()):
            if child == 0:
                continue
            step = len(source)
            source.append(count + node * tree.lanes + lane)
            after.append(0)
            if child > 0:
                visit(child)
            else:
                source.extend(leaves[~child])
                after.extend(range(step + 2, len(source) + 1))
            after[step] = len(source)

    visit(0)
    return np.array(source, dtype=np.intp), np.array(after, dtype=np.int32)
