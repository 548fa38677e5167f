# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The BVH builder for CUDA: wide nodes from the binary tree, as in ``native/cpu/bvh_collapse.h``, and the contents of
leaves and nodes; see `warpvis.kernels.bvh.build_cuda`. Leaves and nodes have `CUDA_LANES` lanes.
"""

import warp as wp

from warpvis.kernels.bvh.ranges_cuda import Binary
from warpvis.kernels.bvh.refit import first_corner, load_vec3
from warpvis.kernels.constants import (
    CONE_AXIS_ROW,
    CONE_CUTOFF_ROW,
    CUDA_LANES,
    NODE_HIGH_ROW,
    NODE_LOW_ROW,
    NOWHERE,
)

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

# Columns of `Opened.info`: a level's first node, its number of nodes, and the first leaf among their children.
FIRST_NODE, NODES, FIRST_LEAF = 0, 1, 2
OPENED_WORDS = 3

_WAITING = wp.constant(2 * CUDA_LANES)
_NEVER = wp.constant(2.0)
_MIN_COSINE = wp.constant(wp.float64(0.0872))  # cos(85 degrees)
_MARGIN = wp.constant(wp.float64(1e-3))


@wp.struct
class Opened:
    """The nodes of a level while their children are determined; all arrays except `info` hold one level at a time."""

    depth: int
    max_nodes: int  # upper limit of the level's number of nodes
    info: wp.array2d[wp.int32]  # one row per level; see `FIRST_NODE`
    nodes: wp.array2d[wp.int32]  # their binary nodes: one row for this level, one for the next
    parts: wp.array2d[wp.int32]  # binary nodes of their children; -1 for none
    counts: wp.array[wp.int32]  # inner nodes among the children of each, then leaves among them: twice `max_nodes`
    sums: wp.array[wp.int32]  # inclusive scan of `counts`


@wp.func
def cost_of(binary: Binary, costs: wp.array2d[float], node: int, max_parts: int) -> float:
    """Return the minimal node area of a subtree divided into at most `max_parts` parts, each a node or a leaf."""
    if binary.child[node] < 0:
        return 0.0
    return costs[node, max_parts - 1]


@wp.func
def share_of_left(binary: Binary, costs: wp.array2d[float], node: int, max_parts: int) -> int:
    """Return how many of at most `max_parts` parts the left child gets in the division of least cost."""
    left = binary.child[node]
    best, best_cost = int(1), float(NOWHERE)
    for share in range(1, max_parts):
        cost = cost_of(binary, costs, left, share) + cost_of(binary, costs, left + 1, max_parts - share)
        if cost < best_cost:
            best, best_cost = share, cost
    return best


@wp.func
def cost_of_share(binary: Binary, costs: wp.array2d[float], node: int, max_parts: int) -> float:
    left = binary.child[node]
    share = share_of_left(binary, costs, node, max_parts)
    return cost_of(binary, costs, left, share) + cost_of(binary, costs, left + 1, max_parts - share)


@wp.kernel
def find_costs(
    # In:
    binary: Binary,
    first: int,
    evenly: int,
    # Out:
    costs_out: wp.array2d[float],
):
    """Compute the cost of dividing a node's subtree into at most 1, 2, ... parts from its children's costs.

    One thread computes one number. If `evenly` is not 0, costs are such that both children get equal shares, so that a
    wide node covers at least five levels of the binary tree.
    """
    index, column = wp.tid()
    node, max_parts = first + index, column + 1
    if binary.child[node] < 0:
        return
    if evenly != 0:
        costs_out[node, column] = 1.0 / float(max_parts)
        return
    # More parts never cost more, but one part may cost less than many.
    min_cost = cost_of_share(binary, costs_out, node, CUDA_LANES) + binary.area[node] + 1.0e-30
    if max_parts > 1:
        min_cost = wp.min(min_cost, cost_of_share(binary, costs_out, node, max_parts))
    costs_out[node, column] = min_cost


@wp.kernel
def open_nodes(
    # In:
    binary: Binary,
    costs: wp.array2d[float],
    # Out:
    opened_out: Opened,
):
    """Find the children of a wide node from its binary node, in item order; count its inner nodes and leaves."""
    index = wp.tid()
    if index >= opened_out.info[opened_out.depth, NODES]:
        opened_out.counts[index] = 0
        opened_out.counts[opened_out.max_nodes + index] = 0
        return
    stack = wp.vector(length=_WAITING, dtype=wp.int32)
    part_limits = wp.vector(length=_WAITING, dtype=wp.int32)
    stack[0] = opened_out.nodes[opened_out.depth % 2, index]
    part_limits[0] = CUDA_LANES
    waiting, count, inner = int(1), int(0), int(0)
    is_root = bool(True)
    while waiting > 0:
        waiting -= 1
        node, max_parts = stack[waiting], int(part_limits[waiting])
        is_leaf = binary.child[node] < 0
        if not is_leaf and not is_root:
            while max_parts > 1 and costs[node, max_parts - 2] == costs[node, max_parts - 1]:
                max_parts -= 1
        if is_leaf or max_parts == 1:
            opened_out.parts[index, count] = node
            count += 1
            inner += int(not is_leaf)
        else:
            share = share_of_left(binary, costs, node, max_parts)
            stack[waiting] = binary.child[node] + 1
            part_limits[waiting] = max_parts - share
            stack[waiting + 1] = binary.child[node]
            part_limits[waiting + 1] = share
            waiting += 2
        is_root = False
    for lane in range(count, CUDA_LANES):
        opened_out.parts[index, lane] = -1
    opened_out.counts[index] = inner
    opened_out.counts[opened_out.max_nodes + index] = count - inner


@wp.kernel
def name_children(
    # In:
    binary: Binary,
    # Out:
    opened_out: Opened,
    children_out: wp.array2d[wp.int32],
    leaf_ranges_out: wp.array2d[wp.int32],
):
    """Number the children of a level's nodes by scans of their counts; thread 0 writes the next level's `info`."""
    index = wp.tid()
    depth, max_nodes = opened_out.depth, opened_out.max_nodes
    first, count = opened_out.info[depth, FIRST_NODE], opened_out.info[depth, NODES]
    first_leaf, all_inner = opened_out.info[depth, FIRST_LEAF], opened_out.sums[max_nodes - 1]
    if index == 0:
        opened_out.info[depth + 1, FIRST_NODE] = first + count
        opened_out.info[depth + 1, NODES] = all_inner
        opened_out.info[depth + 1, FIRST_LEAF] = first_leaf + opened_out.sums[2 * max_nodes - 1] - all_inner
    if index >= count:
        return
    inner = opened_out.sums[index] - opened_out.counts[index]
    leaf = first_leaf + opened_out.sums[max_nodes + index] - opened_out.counts[max_nodes + index] - all_inner
    for lane in range(CUDA_LANES):
        part, child = opened_out.parts[index, lane], int(0)
        if part >= 0:
            if binary.child[part] < 0:
                child = -1 - leaf
                leaf_ranges_out[leaf, 0] = binary.begin[part]
                leaf_ranges_out[leaf, 1] = binary.end[part]
                leaf += 1
            else:
                child = first + count + inner
                opened_out.nodes[1 - depth % 2, inner] = part
                inner += 1
        children_out[first + index, lane] = child


@wp.kernel
def fill_leaves(
    # Scene:
    vertices: wp.array[wp.vec3],
    faces: wp.array2d[wp.int32],
    owner: wp.array[wp.int32],
    # In:
    order: wp.array[wp.int32],
    leaf_ranges: wp.array2d[wp.int32],
    # Out:
    leaves_out: wp.array3d[float],
    triangles_out: wp.array2d[wp.int32],
    owners_out: wp.array2d[wp.int32],
):
    """Write the corners and the owner of each triangle; unused lanes repeat a corner and the owner of lane 0."""
    leaf, lane = wp.tid()
    begin = leaf_ranges[leaf, 0]
    is_used = lane < leaf_ranges[leaf, 1] - begin
    triangle = order[begin + wp.where(is_used, lane, 0)]
    first = first_corner(vertices[faces[triangle, 0]], vertices[faces[triangle, 1]], vertices[faces[triangle, 2]])
    for corner in range(3):
        vertex = vertices[faces[triangle, wp.where(is_used, (first + corner) % 3, 0)]]
        for axis in range(3):
            leaves_out[leaf, 3 * corner + axis, lane] = vertex[axis]
    triangles_out[leaf, lane] = wp.where(is_used, triangle, -1)
    owners_out[leaf, lane] = owner[triangle]


@wp.func
def exact(v: wp.vec3) -> wp.vec3d:
    return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))


@wp.func
def unit_normal(leaves: wp.array3d[float], leaf: int, lane: int) -> wp.vec3d:
    """Return the unit normal, zero for degenerate triangles. Single precision is inaccurate for slivers."""
    a, b, c = load_vec3(leaves, leaf, 0, lane), load_vec3(leaves, leaf, 3, lane), load_vec3(leaves, leaf, 6, lane)
    normal = wp.cross(exact(b) - exact(a), exact(c) - exact(a))
    squared = wp.dot(normal, normal)
    if not (squared > wp.float64(1.0e-300)):
        return wp.vec3d()
    return normal * (wp.float64(1.0) / wp.sqrt(squared))


@wp.func
def cutoff_of(cosine: wp.float64) -> float:
    """Return the sine of a cone's half angle plus a margin; `_NEVER` if the cone is too wide to cull."""
    if not (cosine > _MIN_COSINE):
        return _NEVER
    sine = wp.sqrt(wp.max(wp.float64(1.0) - cosine * cosine, wp.float64(0.0))) + _MARGIN
    return wp.where(sine < wp.float64(1.0), float(sine), _NEVER)


@wp.func
def rounded_axis(total: wp.vec3d) -> wp.vec3:
    """Return the direction of a sum of vectors in single precision; zero if the sum is too small."""
    length = wp.length(total)
    if not (length > wp.float64(1.0e-6)):
        return wp.vec3()
    axis = total / length
    return wp.vec3(float(axis[0]), float(axis[1]), float(axis[2]))


@wp.func
def set_bounds(
    nodes: wp.array3d[float], node: int, lane: int, low: wp.vec3, high: wp.vec3, axis: wp.vec3, cutoff: float
):
    for k in range(3):
        nodes[node, NODE_LOW_ROW + k, lane] = low[k]
        nodes[node, NODE_HIGH_ROW + k, lane] = high[k]
        nodes[node, CONE_AXIS_ROW + k, lane] = axis[k]
    nodes[node, CONE_CUTOFF_ROW, lane] = cutoff


@wp.kernel
def fit_leaves(
    # In:
    children: wp.array2d[wp.int32],
    leaves: wp.array3d[float],
    owners: wp.array2d[wp.int32],
    closed: wp.array[wp.uint8],
    # Out:
    nodes_out: wp.array3d[float],
):
    """Write each leaf's box and normal cone into its lane of its parent node."""
    node, lane = wp.tid()
    child = children[node, lane]
    low, high, axis, cutoff = wp.vec3(NOWHERE), wp.vec3(-NOWHERE), wp.vec3(), float(_NEVER)
    if child > 0:
        return
    if child < 0:
        leaf = -1 - child
        all_closed, total = bool(True), wp.vec3d()
        for k in range(CUDA_LANES):
            for corner in range(3):
                vertex = load_vec3(leaves, leaf, 3 * corner, k)
                low, high = wp.min(low, vertex), wp.max(high, vertex)
            all_closed = all_closed and closed[owners[leaf, k]] != wp.uint8(0)
        if all_closed:
            for k in range(CUDA_LANES):
                total += unit_normal(leaves, leaf, k)
            axis = rounded_axis(total)
        if wp.length_sq(axis) > 0.0:
            min_cosine = wp.float64(1.0)
            for k in range(CUDA_LANES):
                normal = unit_normal(leaves, leaf, k)
                if wp.length_sq(normal) > wp.float64(0.0):
                    min_cosine = wp.min(min_cosine, wp.dot(normal, exact(axis)))
            cutoff = cutoff_of(min_cosine)
    set_bounds(nodes_out, node, lane, low, high, axis, cutoff)


@wp.kernel
def fit_nodes(
    # In:
    children: wp.array2d[wp.int32],
    first: int,
    # Out:
    nodes_out: wp.array3d[float],
):
    """Write the box and normal cone of each child node into its lane, for the nodes of one level."""
    index, lane = wp.tid()
    node = first + index
    child = children[node, lane]
    if child <= 0:
        return
    low, high, total = wp.vec3(NOWHERE), wp.vec3(-NOWHERE), wp.vec3d()
    widest = float(0.0)
    for k in range(CUDA_LANES):
        if children[child, k] != 0:
            low = wp.min(low, load_vec3(nodes_out, child, NODE_LOW_ROW, k))
            high = wp.max(high, load_vec3(nodes_out, child, NODE_HIGH_ROW, k))
            widest = wp.max(widest, nodes_out[child, CONE_CUTOFF_ROW, k])
            total += exact(load_vec3(nodes_out, child, CONE_AXIS_ROW, k))
    axis, cutoff = wp.vec3(), float(_NEVER)
    if widest < 1.0:
        axis = rounded_axis(total)
    if wp.length_sq(axis) > 0.0:
        min_cosine, one = wp.float64(1.0), wp.float64(1.0)
        for k in range(CUDA_LANES):
            if children[child, k] != 0:
                # A cone contains a child's cone if it covers the angle between the axes plus the child's half angle.
                cosine_between = wp.min(wp.dot(exact(load_vec3(nodes_out, child, CONE_AXIS_ROW, k)), exact(axis)), one)
                sine = wp.float64(nodes_out[child, CONE_CUTOFF_ROW, k])
                cosine = wp.sqrt(wp.max(one - sine * sine, wp.float64(0.0)))
                sine_between = wp.sqrt(wp.max(one - cosine_between * cosine_between, wp.float64(0.0)))
                min_cosine = wp.min(min_cosine, cosine_between * cosine - sine_between * sine)
        cutoff = cutoff_of(min_cosine)
    set_bounds(nodes_out, node, lane, low, high, axis, cutoff)


@wp.kernel
def join_children(
    # In:
    first_node: int,
    first_leaf: int,
    # Out:
    children_out: wp.array[wp.int32],
):
    """Offset a tree's child indices to arrays in which nodes and leaves of other trees come first."""
    slot = wp.tid()
    child = children_out[slot]
    if child > 0:
        children_out[slot] = child + first_node
    if child < 0:
        children_out[slot] = child - first_leaf


@wp.kernel
def mark_owners(
    # In:
    closed: wp.array[wp.uint8],
    # Out:
    owners_out: wp.array[wp.int32],
):
    """Replace owners by their complement if the object is closed, so that casters may cull its back faces."""
    slot = wp.tid()
    owner = owners_out[slot]
    if closed[owner] != wp.uint8(0):
        owners_out[slot] = -1 - owner
