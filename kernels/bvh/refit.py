# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Refitting of a BVH to moved vertices: corners in leaves, then boxes from the leaves up.

Launched by `warpvis.scene.acceleration.bvh`. A leaf or a node is processed by one thread on the CPU, and by a warp
on CUDA, with one thread per lane: `parts` is the number of threads. Slots are indices of children, written as
``node * lanes + lane``.
"""

import warp as wp

from warpvis.kernels.constants import CUDA_LANES, NODE_HIGH_ROW, NODE_LOW_ROW, NOWHERE

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func
def l1_distance(a: wp.vec3, b: wp.vec3) -> float:
    return wp.abs(a[0] - b[0]) + wp.abs(a[1] - b[1]) + wp.abs(a[2] - b[2])


@wp.func
def first_corner(a: wp.vec3, b: wp.vec3, c: wp.vec3) -> int:
    """Return the index of the corner opposite to the longest side; see ``native/cpu/bvh_bounds.h``."""
    first = int(0)
    longest = l1_distance(b, c)
    if l1_distance(c, a) > longest:
        first = 1
        longest = l1_distance(c, a)
    if l1_distance(a, b) > longest:
        first = 2
    return first


@wp.func_native(
    f"""
#if defined(__CUDA_ARCH__)
    for (int other = {CUDA_LANES // 2}; other; other >>= 1) {{
        const float theirs = __shfl_xor_sync(0xffffffffu, value, other);
        value = theirs < value ? theirs : value;
    }}
#endif
    return value;
    """
)
def min_of_parts(value: float) -> float: ...


@wp.struct
class Aabb:
    """An axis-aligned bounding box."""

    low: wp.vec3
    high: wp.vec3


@wp.func
def no_box() -> Aabb:
    box = Aabb()
    box.low = wp.vec3(NOWHERE)
    box.high = wp.vec3(-NOWHERE)
    return box


@wp.func
def box_of_parts(box: Aabb) -> Aabb:
    """Return, in every thread, the bounds of the boxes of all threads that share a leaf or a node."""
    bounds = Aabb()
    low, high = box.low, box.high
    bounds.low = wp.vec3(min_of_parts(low[0]), min_of_parts(low[1]), min_of_parts(low[2]))
    bounds.high = -wp.vec3(min_of_parts(-high[0]), min_of_parts(-high[1]), min_of_parts(-high[2]))
    return bounds


@wp.func
def set_child_box(box: Aabb, slot: int, nodes_out: wp.array3d[float]):
    lanes = nodes_out.shape[2]
    for axis in range(3):
        nodes_out[slot // lanes, NODE_LOW_ROW + axis, slot % lanes] = box.low[axis]
        nodes_out[slot // lanes, NODE_HIGH_ROW + axis, slot % lanes] = box.high[axis]


@wp.func
def load_vec3(rows: wp.array3d[float], index: int, row: int, lane: int) -> wp.vec3:
    """Return a vector of a node or a leaf, whose coordinates are in three rows from `row` on."""
    return wp.vec3(rows[index, row, lane], rows[index, row + 1, lane], rows[index, row + 2, lane])


@wp.kernel
def refit_leaves(
    # Scene:
    vertices: wp.array[wp.vec3],
    # In:
    leaf_vertices: wp.array3d[wp.int32],
    leaf_slots: wp.array[wp.int32],
    first_leaf: int,
    parts: int,
    # Out:
    leaves_out: wp.array3d[float],
    nodes_out: wp.array3d[float],
):
    """Write the corners of a leaf's triangles, and write their box to the leaf's slot."""
    leaf, part = wp.tid()
    leaf += first_leaf

    box = no_box()
    for lane in range(part, leaf_vertices.shape[2], parts):
        first = first_corner(
            vertices[leaf_vertices[leaf, 0, lane]],
            vertices[leaf_vertices[leaf, 1, lane]],
            vertices[leaf_vertices[leaf, 2, lane]],
        )
        for corner in range(3):
            vertex = vertices[leaf_vertices[leaf, (first + corner) % 3, lane]]
            for axis in range(3):
                leaves_out[leaf, 3 * corner + axis, lane] = vertex[axis]
            box.low = wp.min(box.low, vertex)
            box.high = wp.max(box.high, vertex)
    box = box_of_parts(box)
    if part == 0:
        set_child_box(box, leaf_slots[leaf], nodes_out)


@wp.kernel
def refit_nodes(
    # In:
    order: wp.array[wp.int32],
    node_slots: wp.array[wp.int32],
    first: int,
    parts: int,
    # Out:
    nodes_out: wp.array3d[float],
    box_out: wp.array[float],
):
    """Write the boxes of nodes to their slots, and the box of the root, which has no slot, to `box_out`.

    The nodes are those of `order` from `first` on; none is an ancestor of another, and their children are up to date.
    """
    index, part = wp.tid()
    node = order[first + index]

    box = no_box()
    for lane in range(part, nodes_out.shape[2], parts):
        box.low = wp.min(box.low, load_vec3(nodes_out, node, NODE_LOW_ROW, lane))
        box.high = wp.max(box.high, load_vec3(nodes_out, node, NODE_HIGH_ROW, lane))
    box = box_of_parts(box)
    if part == 0:
        slot = node_slots[node]
        if slot >= 0:
            set_child_box(box, slot, nodes_out)
        else:
            for axis in range(3):
                box_out[axis] = box.low[axis]
                box_out[3 + axis] = box.high[axis]
