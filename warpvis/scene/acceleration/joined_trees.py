# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Concatenation of the trees of a scene's meshes into the arrays that kernels read, and face indices of triangles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import aligned_empty
from warpvis.core.kernel_cache import launch
from warpvis.scene.acceleration.bvh import check_leaves

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.scene.acceleration.bvh import Bvh


def join_trees(
    struct: BvhScene, trees: Sequence[Bvh], closed: Sequence[NDArray[np.bool_]], device: wp.Device, *, share: bool
) -> None:
    """Concatenate the arrays of all trees, and offset their children: node indices, or complements of leaf indices.

    Args:
        struct: Receives the arrays.
        trees: The trees, on the host or the device.
        closed: For each tree, which of its owners are closed: these are stored as their bitwise complement.
        device: Device of the arrays.
        share: Whether a single tree's arrays may be used and changed without a copy.
    """
    check_leaves(sum(tree.leaf_count for tree in trees), trees[0].lanes)
    if not all(tree.leaves.device.is_cpu for tree in trees):
        _join_on_device(struct, trees, closed, device, share=share)
        return
    owners = [_marked(tree, flags) for tree, flags in zip(trees, closed, strict=True)]
    if len(trees) == 1 and share:
        tree = trees[0]
        np.copyto(tree.owners.numpy(), owners[0])
        struct.leaves, struct.owners = tree.leaves.to(device), tree.owners.to(device)
        struct.nodes, struct.children = tree.nodes.to(device), tree.children.to(device)
        return
    children = []
    for tree, first_node, first_leaf in zip(trees, *first_places(trees), strict=True):
        child = tree.children.numpy()
        children.append(child + np.where(child > 0, first_node, 0) - np.where(child < 0, first_leaf, 0))
    struct.leaves = _join([tree.leaves.numpy() for tree in trees], wp.float32, device)
    struct.nodes = _join([tree.nodes.numpy() for tree in trees], wp.float32, device)
    struct.owners = _join(owners, wp.int32, device)
    struct.children = _join(children, wp.int32, device)


def first_places(trees: Sequence[Bvh]) -> NDArray[np.int64]:
    """Return the indices of each tree's first node and of its first leaf in the joined arrays, shape ``(2, trees)``."""
    counts = np.array([[tree.node_count for tree in trees], [tree.leaf_count for tree in trees]], dtype=np.int64)
    return np.cumsum(counts, axis=1) - counts


def move_children(children: wp.array, node: int, leaf: int) -> None:
    """Offset a tree's children for joined arrays in which its nodes begin at `node` and its leaves at `leaf`."""
    if not children.device.is_cpu:
        from warpvis.kernels.bvh.nodes_cuda import join_children

        launch(join_children, len(children), [node, leaf, children], children.device)
        return
    child = children.numpy()
    child += np.where(child > 0, node, 0).astype(np.int32) - np.where(child < 0, leaf, 0).astype(np.int32)


def concatenate(parts: Sequence[wp.array], device: wp.Device) -> wp.array:
    """Concatenate flat arrays of any device; on the CPU the result is aligned to 64 bytes."""
    count, dtype = sum(map(len, parts)), parts[0].dtype
    joined = aligned_empty((count,), dtype) if device.is_cpu else wp.empty(count, dtype=dtype, device=device)
    first = 0
    for part in parts:
        wp.copy(joined, part, dest_offset=first, count=len(part))
        first += len(part)
    return joined


def _join_on_device(
    struct: BvhScene, trees: Sequence[Bvh], closed: Sequence[NDArray[np.bool_]], device: wp.Device, *, share: bool
) -> None:
    from warpvis.kernels.bvh.nodes_cuda import mark_owners

    for name in ("leaves", "owners", "nodes", "children"):
        parts = [getattr(tree, name) for tree in trees]
        is_usable = len(parts) == 1 and share and parts[0].device == device
        setattr(struct, name, parts[0] if is_usable else concatenate(parts, device))
    node, leaf = 0, 0
    for tree, flags in zip(trees, closed, strict=True):
        lanes = tree.lanes
        owners = struct.owners[leaf * lanes : (leaf + tree.leaf_count) * lanes]
        if flags.any():
            launch(mark_owners, len(owners), [wp.array(flags, dtype=wp.uint8, device=device), owners], device)
        if node:
            children = struct.children[node * lanes : (node + tree.node_count) * lanes]
            move_children(children, node, leaf)
        node, leaf = node + tree.node_count, leaf + tree.leaf_count


def _marked(tree: Bvh, closed: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return a tree's owners, complemented for objects whose back faces can be culled."""
    owners = tree.owners.numpy()
    return np.where(closed[owners], ~owners, owners)


def _join(parts: Sequence[np.ndarray], dtype: type, device: wp.Device) -> wp.array:
    """Concatenate the parts; on the CPU the result is aligned to 64 bytes."""
    joined = aligned_empty((sum(len(part) for part in parts),), dtype)
    np.concatenate(parts, out=joined.numpy(), casting="same_kind")
    return joined.to(device)


def own_faces(owner: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return each triangle's face index in its object's mesh; an object's triangles are consecutive and in order.

    Args:
        owner: The triangles' object indices, shape ``(m,)``.
    """
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    counts = np.diff(starts, append=len(owner))
    return (np.arange(len(owner)) - np.repeat(starts, counts)).astype(np.int32)


def slot_faces(trees: Sequence[Bvh], owners: Sequence[NDArray[np.int32]], device: wp.Device) -> wp.array:
    """Return the object's face index for each leaf slot of the trees, one tree after the other; -1 for unused slots.

    Args:
        trees: The trees, on the host or a device.
        owners: For each tree, the object indices of the triangles it was built from.
        device: Device of the result.
    """
    parts = []
    for tree, owner in zip(trees, owners, strict=True):
        triangles = tree.triangles.numpy()
        parts.append(np.where(triangles < 0, np.int32(-1), own_faces(owner)[triangles]))
    return wp.array(np.concatenate(parts), dtype=wp.int32, device=device)
