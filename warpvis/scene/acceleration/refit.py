# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""BVHs of deforming meshes, which are refitted to new vertices without a rebuild."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.kernel_cache import launch
from warpvis.core.threads import check_threads, run_each
from warpvis.core.types import KernelArguments
from warpvis.kernels.constants import LEAF_ROWS, NODE_ROWS

if TYPE_CHECKING:
    from warpvis.scene.acceleration.bvh import Bvh

# Fewer leaves are not worth a separate launch or another thread.
_MIN_LEAVES = 512
_PARTS_PER_THREAD = 4


class BvhRefit:
    """Refits one BVH. The constructor allocates all memory: on CUDA, a refit neither allocates nor synchronizes.

    It reads the vertices `points`, and writes `leaves` and `nodes`, the tree's ranges of the joined arrays, and its
    bounding `box`, six numbers.
    """

    def __init__(
        self,
        tree: Bvh,
        faces: NDArray[np.int32],
        points: wp.array,
        leaves: wp.array,
        nodes: wp.array,
        box: wp.array,
    ) -> None:
        """Record the launches of a refit."""
        from warpvis.kernels.bvh import refit

        device, lanes = points.device, tree.lanes
        leaf_slots, node_slots, levels = _slots(tree.children.numpy().reshape(-1, lanes), tree.leaf_count)
        parts = 1 if device.is_cpu else lanes
        numbers = [leaf_vertices(tree, faces), leaf_slots, node_slots, np.concatenate(levels)]
        corners, leaf_slots, node_slots, order = (wp.array(array, dtype=wp.int32, device=device) for array in numbers)
        leaves = leaves.reshape((-1, LEAF_ROWS, lanes))
        nodes = nodes.reshape((-1, NODE_ROWS, lanes))
        # Recorded launches do not hold references to their arguments.
        self._references = [corners, leaf_slots, node_slots, order, leaves, nodes, box, points]

        def record(kernel: wp.Kernel, count: int, arguments: KernelArguments) -> wp.Launch:
            return launch(kernel, (count, parts), arguments, device, record_cmd=True)

        self._threads = check_threads(None) if device.is_cpu and tree.leaf_count > 2 * _MIN_LEAVES else 1
        step = max(_MIN_LEAVES, -(-tree.leaf_count // (_PARTS_PER_THREAD * self._threads)))
        step = step if device.is_cpu else tree.leaf_count
        self._leaf_launches = [
            record(
                refit.refit_leaves,
                min(step, tree.leaf_count - first),
                [points, corners, leaf_slots, first, parts, leaves, nodes],
            )
            for first in range(0, tree.leaf_count, step)
        ]
        firsts = np.cumsum([0] + [len(level) for level in levels]).tolist()
        self._node_launches = [
            record(refit.refit_nodes, len(level), [order, node_slots, first, parts, nodes, box])
            for level, first in zip(levels, firsts, strict=False)
        ]

    def refit(self) -> None:
        """Update the tree to the current vertices."""
        run_each(lambda recorded: recorded.launch(), self._leaf_launches, self._threads)
        for recorded in self._node_launches:
            recorded.launch()


def leaf_vertices(tree: Bvh, faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the triangles' corner indices, shape ``(leaves, 3, lanes)``, in the layout of `Bvh.leaves`."""
    triangles = tree.triangles.numpy().reshape(-1, tree.lanes)
    unused = triangles < 0
    used = np.where(unused, triangles[:, :1], triangles)
    first = faces[used, 0]
    return np.stack([first] + [np.where(unused, first, faces[used, corner]) for corner in (1, 2)], axis=1)


def _slots(
    children: NDArray[np.int32], leaf_count: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], list[NDArray[np.int32]]]:
    """Return each leaf's and each node's slot among the children (-1 for the root), and the levels, deepest first."""
    leaf_slots = np.empty(leaf_count, dtype=np.int32)
    node_slots = np.full(len(children), -1, dtype=np.int32)
    flat = children.ravel()
    leaf, node = np.flatnonzero(flat < 0), np.flatnonzero(flat > 0)
    leaf_slots[~flat[leaf]], node_slots[flat[node]] = leaf, node
    levels: list[NDArray[np.int32]] = []
    level = np.zeros(1, dtype=np.int32)
    while len(level):
        levels.insert(0, level)
        below = children[level]
        level = below[below > 0]
    return leaf_slots, node_slots, levels
