# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The first stage of the BVH builder for CUDA: checks of triangles, their items, and the root.

`warpvis.kernels.bvh.build_cuda` splits them.
"""

import warp as wp

from warpvis.kernels.bvh.ranges_cuda import (
    NEXT,
    NEXT_COUNT,
    Binary,
    Items,
    box_high,
    box_low,
    grow_box,
    is_split,
    set_child,
)
from warpvis.kernels.constants import NOWHERE

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def check_mesh(
    # Scene:
    vertices: wp.array[wp.vec3],
    faces: wp.array2d[wp.int32],
    # In:
    farthest: float,
    # Out:
    found_out: wp.array[wp.int32],
):
    """Count invalid corners (NaN or beyond `farthest`), find the first one, and the least and greatest vertex index."""
    index = wp.tid()
    if index < vertices.shape[0]:
        vertex = vertices[index]
        reach = wp.max(wp.max(wp.abs(vertex[0]), wp.abs(vertex[1])), wp.abs(vertex[2]))
        is_valid = reach <= farthest and vertex[0] == vertex[0] and vertex[1] == vertex[1] and vertex[2] == vertex[2]
        if not is_valid:
            wp.atomic_add(found_out, 0, 1)
            wp.atomic_min(found_out, 1, index)
    if index < faces.shape[0]:
        for corner in range(3):
            wp.atomic_min(found_out, 2, faces[index, corner])
            wp.atomic_max(found_out, 3, faces[index, corner])


@wp.kernel
def load_items(
    # Scene:
    vertices: wp.array[wp.vec3],
    faces: wp.array2d[wp.int32],
    # Out:
    items_out: Items,
):
    """Write the item of each triangle; all items belong to node 0."""
    triangle = wp.tid()
    a, b, c = vertices[faces[triangle, 0]], vertices[faces[triangle, 1]], vertices[faces[triangle, 2]]
    items_out.low[triangle] = wp.min(a, wp.min(b, c))
    items_out.high[triangle] = wp.max(a, wp.max(b, c))
    items_out.triangle[triangle] = triangle
    items_out.node[triangle] = wp.where(is_split(faces.shape[0]), 0, -1)


@wp.kernel
def bound_centers(
    # In:
    items: Items,
    threads: int,
    # Out:
    words_out: wp.array2d[wp.int32],
):
    """Grow a box around the items' doubled centers; each thread reads every `threads`-th item."""
    item = wp.tid()
    low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
    while item < items.low.shape[0]:
        center = items.low[item] + items.high[item]
        low, high = wp.min(low, center), wp.max(high, center)
        item += threads
    grow_box(words_out, 0, low, high)


@wp.kernel
def begin_tree(
    # In:
    words: wp.array2d[wp.int32],
    item_count: int,
    # Out:
    info_out: wp.array2d[wp.int32],
    binary_out: Binary,
):
    """Write the root, which contains all items, as the next level in row 0 of `info`; one thread."""
    node = wp.tid()
    info_out[0, NEXT] = 0
    info_out[0, NEXT_COUNT] = 1
    set_child(binary_out, node, 0, item_count, box_low(words, 0), box_high(words, 0), 0.0)
