# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The trees of a scene over its lifetime: built on first use, refitted, spliced, and dropped when objects change."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.kernels.constants import (
    BOX_WORDS,
    CPU_LANES,
    CUDA_LANES,
    LEAF_ROWS,
    NODE_HIGH_ROW,
    NODE_LOW_ROW,
    NODE_ROWS,
)
from warpvis.scene._object import ObjectList, SceneObject
from warpvis.scene.acceleration.bvh import Bvh, check_leaves, check_slots
from warpvis.scene.acceleration.geometry import (
    SceneBvh,
    Triangles,
    build_scene_bvh,
    build_triangles,
    concatenate,
    make_mesh,
    move_children,
)

if TYPE_CHECKING:
    from warpvis.scene.acceleration.tree_cache import TreeCache


class SceneTrees:
    """The trees of a scene; the caller holds a lock."""

    def __init__(self, device: wp.Device) -> None:
        """Create it without trees."""
        self._device = device
        self._cache: TreeCache | None = None
        self._bvh: SceneBvh | None = None
        self._triangles: Triangles | None = None
        self._with_faces = False

    def triangles(self, objects: ObjectList, *, faces: bool) -> Triangles:
        """Return the triangles and Warp's trees of them."""
        if self._triangles is None:
            self._triangles = build_triangles(objects, self._device)
        if faces:
            self._triangles.store_faces()
        return self._triangles

    def bvh(self, objects: ObjectList, *, faces: bool) -> SceneBvh:
        """Return the BVH; all later ones have faces, too, if this one has."""
        self._with_faces |= faces
        if self._bvh is None or (faces and not self._bvh.has_faces):
            self._bvh = build_scene_bvh(objects, self._device, cache=self._cache, faces=self._with_faces)
        return self._bvh

    def forget(self, *, cache_next: bool = False) -> None:
        """Drop the trees; with `cache_next`, those built from now on are cached, and reused where nothing changed."""
        self._bvh = self._triangles = None
        if cache_next:
            from warpvis.scene.acceleration.tree_cache import TreeCache

            self._cache = self._cache or TreeCache()

    def refit(self, index: int) -> None:
        """Update the trees of an object that deforms to its vertices."""
        for built in (self._bvh, self._triangles):
            if built is not None:
                built.refits[index].refit()

    def exchange(self, objects: ObjectList, index: int, item: SceneObject, *, closed: bool) -> None:
        """Replace an object, which is neither attached nor a parent, by one with another mesh."""
        from warpvis.scene.acceleration.tree_cache import build_object_tree

        bvh, triangles = self._bvh, self._triangles
        if item.pose is None:
            bvh = triangles = None
        if bvh is not None and bvh.refits.keys() - {index}:  # other objects deform in these arrays
            bvh = None
        column = objects.movable.index(index) if item.pose is not None else -1
        if bvh is not None:
            lanes = CPU_LANES if self._device.is_cpu else CUDA_LANES
            tree = build_object_tree(item, closed, lanes, self._device)
            bvh = splice_bvh(bvh, column, tree, closed=closed, old_count=objects[index].triangle_count)
        if triangles is not None:
            triangles = splice_triangles(triangles, column, index, make_mesh(item.mesh, self._device))
        self.forget(cache_next=bvh is None)
        if self._cache is not None:
            self._cache.set_closed(item, closed)
        objects[index] = item
        self._bvh, self._triangles = bvh, triangles


class _Span(NamedTuple):
    """The range of a tree in the joined arrays."""

    node: int
    nodes_end: int
    leaf: int
    leaves_end: int


def splice_bvh(built: SceneBvh, column: int, tree: Bvh, *, closed: bool, old_count: int) -> SceneBvh:
    """Return the trees with that of one movable object replaced; the new tree, of any device, comes last.

    No other object may deform; the object, in `column` of `Scene.movable` and of `old_count` triangles, is neither
    attached to another one nor a parent.
    """
    old, lanes = built.struct, tree.lanes
    struct = _copied(old)
    roots, leaves = old.movable_root.numpy(), old.movable_leaf.numpy()
    span = _find_span(roots, leaves, column, len(old.children) // lanes, len(old.owners) // lanes)
    node = len(old.children) // lanes - (span.nodes_end - span.node)
    leaf = len(old.owners) // lanes - (span.leaves_end - span.leaf)
    check_leaves(leaf + tree.leaf_count, lanes)
    removed = old_count if span.nodes_end > span.node else 0
    for name, words, begin, end in (
        ("leaves", LEAF_ROWS * lanes, span.leaf, span.leaves_end),
        ("owners", lanes, span.leaf, span.leaves_end),
        ("nodes", NODE_ROWS * lanes, span.node, span.nodes_end),
        ("children", lanes, span.node, span.nodes_end),
    ):
        setattr(struct, name, _exchanged(getattr(old, name), begin * words, end * words, getattr(tree, name)))
    if built.has_faces:  # the tree's triangles are numbered as the object's faces
        struct.slot_face = _exchanged(old.slot_face, span.leaf * lanes, span.leaves_end * lanes, tree.triangles)
    _renumber(struct, span, node, leaf, lanes)
    struct.owners[leaf * lanes :].fill_(-1 if closed else 0)  # owner 0, complemented if closed
    roots, leaves = (
        np.where(starts >= end, starts - (end - begin), starts)
        for starts, begin, end in ((roots, span.node, span.nodes_end), (leaves, span.leaf, span.leaves_end))
    )
    roots[column], leaves[column] = node, leaf
    _set_columns(struct, column, roots, leaves, tree, closed=closed)
    struct.levels = max(old.levels, tree.depth)
    return replace(
        built,
        struct=struct,
        depth=struct.levels,
        bytes_per_triangle=_bytes(struct) / (_bytes(old) / built.bytes_per_triangle + tree.triangle_count - removed),
        moves_solids_only=False,
        has_solids=bool(struct.movable_solid.numpy().any()),
        refits={},
        free_workspaces=[],
    )


def splice_triangles(built: Triangles, column: int, index: int, mesh: wp.Mesh) -> Triangles:
    """Return the meshes of the ``rays`` caster with that of the movable object `index`, in `column`, replaced."""
    struct = _copied(built.struct)
    _set(struct, "movable_mesh", column, np.uint64(mesh.id))
    _set(struct, "movable_solid", column, 0)
    refits = {number: other for number, other in built.refits.items() if number != index}
    return replace(built, struct=struct, meshes=[*built.meshes, mesh], refits=refits)


def _find_span(
    roots: NDArray[np.int32], leaves: NDArray[np.int32], column: int, nodes_end: int, leaves_end: int
) -> _Span:
    """Return the range of an object's tree; an empty one at the end if other objects share it."""
    if (roots == roots[column]).sum() > 1:
        return _Span(nodes_end, nodes_end, leaves_end, leaves_end)
    next_node = min(roots[roots > roots[column]], default=nodes_end)
    next_leaf = min(leaves[leaves > leaves[column]], default=leaves_end)
    return _Span(int(roots[column]), int(next_node), int(leaves[column]), int(next_leaf))


def _exchanged(array: wp.array, begin: int, end: int, added: wp.array) -> wp.array:
    """Copy an array without the range from `begin` to `end`, and append `added`."""
    retained = [array[first:last] for first, last in ((0, begin), (end, len(array))) if last > first]
    return concatenate([*retained, added], array.device)


def _renumber(struct: Any, span: _Span, node: int, leaf: int, lanes: int) -> None:
    """Offset the children of trees behind the removed range, and of the new tree at the end."""
    ends = node, len(struct.children) // lanes
    moves = (span.node - span.nodes_end, span.leaf - span.leaves_end), (node, leaf)
    for (begin, end), (nodes, leaves) in zip(pairwise((span.node, *ends)), moves, strict=True):
        if end > begin and (nodes or leaves):
            move_children(struct.children[begin * lanes : end * lanes], nodes, leaves)


def _set_columns(
    struct: Any, column: int, roots: NDArray[np.int32], leaves: NDArray[np.int32], tree: Bvh, *, closed: bool
) -> None:
    """Update the per-object arrays of the movable objects' trees."""
    device, lanes = struct.owners.device, tree.lanes
    starts, which = np.unique(leaves, return_inverse=True)
    slots = np.diff(starts, append=len(struct.owners) // lanes).astype(np.int64)[which] * lanes
    first = int(struct.movable_first_id.numpy()[0])
    ends = first + np.cumsum(slots)
    check_slots(int(ends[-1]))
    for name, values in (("movable_root", roots), ("movable_leaf", leaves), ("movable_first_id", ends - slots)):
        setattr(struct, name, wp.array(values, dtype=wp.int32, device=device))
    rows = tree.nodes[: NODE_ROWS * lanes].numpy().reshape(NODE_ROWS, lanes)
    box = [*rows[NODE_LOW_ROW:][:3].min(axis=1), *rows[NODE_HIGH_ROW:][:3].max(axis=1)]
    _set(struct, "movable_closed", column, int(closed))
    _set(struct, "movable_solid", column, 0)
    _set(struct, "movable_size", column, 1.0)
    _set(struct, "movable_boxes", slice(BOX_WORDS * column, BOX_WORDS * (column + 1)), box)


def _set(struct: Any, name: str, index: int | slice, value: Any) -> None:
    """Replace a small array of a struct by a copy with some elements changed."""
    array = getattr(struct, name)
    values = array.numpy().copy()
    values[index] = value
    setattr(struct, name, wp.array(values, dtype=array.dtype, device=array.device))


def _copied(struct: Any) -> Any:
    """Return a shallow copy of a struct."""
    result = type(struct)()
    for name in struct._cls.vars:
        setattr(result, name, getattr(struct, name))
    return result


def _bytes(struct: Any) -> int:
    """Return the memory of the trees as built, in bytes; `Bvh.triangles` is as large as `owners`, hence twice."""
    return 4 * sum(len(getattr(struct, name)) for name in ("leaves", "owners", "owners", "nodes", "children"))
