# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The BVH builder for the CPU; see ``native/cpu/bvh_split.h`` and `warpvis.scene.acceleration.bvh`.

Each triangle is an item of `ITEM_WORDS` 32-bit numbers; each possible split has `SPLIT_WORDS` numbers.
"""

import warp as wp

from warpvis.kernels.constants import CPU_LANES, CUDA_LANES
from warpvis.kernels.native_source import include_native

wp.set_module_options(
    {
        "enable_backward": False,
        "default_grid_stride": False,
        "extra_build_options": include_native("cpu/bvh_collapse.h", "cpu/bvh_bounds.h"),
    }
)

LANE_COUNTS = (CPU_LANES, CUDA_LANES)
"""Supported numbers of lanes: triangles per leaf and children per node. Kernels take it as `lanes`."""


def _with_any_lanes(text: str) -> str:
    """Return C++ with one block per number of lanes, of which the parameter `lanes` selects one."""
    return "".join(f"if (lanes == {lanes}) {{\nconstexpr int LANES = {lanes};\n{text}\n}}\n" for lanes in LANE_COUNTS)


@wp.func_native("warpvis::Items::load((const float*)vertices, (const int*)faces, triangle, (warpvis::v8*)items);")
def load_item_native(vertices: wp.uint64, faces: wp.uint64, triangle: int, items: wp.uint64): ...


@wp.func_native(
    _with_any_lanes(
        """
        typedef warpvis::Splitter<LANES> Splitter;
        typedef warpvis::Aabb Aabb;
        typedef warpvis::v8 v8;
        const Splitter::Range whole = {.begin = begin,
                                        .end = end,
                                        .link = link,
                                        .depth = depth,
                                        .centers = slot < 0 ? Aabb::of_centers((const v8*)items, begin, end)
                                                            : ((v8*)boxes)[slot]};
        v8 centers[2];
        Splitter::split_all((v8*)items, (warpvis::Split*)splits, whole, max_splits, centers);
        for (int side = 0; max_splits == 1 && side < 2; ++side) ((v8*)part_boxes)[first_part + side] = centers[side];
        """
    )
)
def split_range_native(
    lanes: int,
    items: wp.uint64,
    splits: wp.uint64,
    begin: int,
    end: int,
    link: int,
    depth: int,
    max_splits: int,
    boxes: wp.uint64,
    slot: int,
    part_boxes: wp.uint64,
    first_part: int,
): ...


@wp.func_native(
    _with_any_lanes(
        """
        typedef warpvis::Collapser<LANES> Collapser;
        Collapser::collapse((const warpvis::Split*)splits, item_count, evenly != 0, (Collapser::Binary*)binaries,
                            (int*)children, (int*)leaf_ranges, (int*)counts);
        """
    )
)
def collapse_native(
    lanes: int,
    splits: wp.uint64,
    item_count: int,
    evenly: int,
    binaries: wp.uint64,
    children: wp.uint64,
    leaf_ranges: wp.uint64,
    counts: wp.uint64,
): ...


@wp.func_native(
    _with_any_lanes(
        """
        const warpvis::Mesh mesh = {.vertices = (const float*)vertices,
                                    .faces = (const int*)faces,
                                    .owner = (const int*)owner,
                                    .closed = (const unsigned char*)closed};
        const warpvis::Leaves<LANES> filled = {.rows = (float*)leaves,
                                               .triangles = (int*)triangles,
                                               .owners = (int*)owners,
                                               .bounds = (float*)leaf_bounds};
        filled.fill(mesh, (const warpvis::v8*)items, (const int*)leaf_ranges, leaf);
        """
    )
)
def fill_leaf_native(
    lanes: int,
    vertices: wp.uint64,
    faces: wp.uint64,
    owner: wp.uint64,
    closed: wp.uint64,
    items: wp.uint64,
    leaf_ranges: wp.uint64,
    leaf: int,
    leaves: wp.uint64,
    triangles: wp.uint64,
    owners: wp.uint64,
    leaf_bounds: wp.uint64,
): ...


@wp.func_native(
    _with_any_lanes(
        "warpvis::Nodes<LANES>::fit((const int*)children, (const float*)leaf_bounds, node_count, (float*)nodes);"
    )
)
def fit_nodes_native(lanes: int, children: wp.uint64, leaf_bounds: wp.uint64, node_count: int, nodes: wp.uint64): ...


@wp.kernel
def load_items(
    # Scene:
    vertices: wp.array[float],
    faces: wp.array[wp.int32],
    # In:
    first_triangle: int,
    # Out:
    items_out: wp.array[float],
):
    triangle = wp.tid() + first_triangle
    load_item_native(vertices.ptr, faces.ptr, triangle, items_out.ptr)


@wp.kernel
def split_range(
    # In:
    lanes: int,
    begin: int,
    end: int,
    link: int,
    depth: int,
    max_splits: int,
    boxes: wp.array[float],
    slot: int,
    first_part: int,
    # Out:
    items_out: wp.array[float],
    splits_out: wp.array[wp.int32],
    part_boxes_out: wp.array[float],
):
    """Split a range of items in one thread until all parts are leaves, or `max_splits` times.

    The bounding box of the items' centers is in a slot of `boxes`, or is computed if `slot` is -1. A single split
    writes the boxes of both parts to `part_boxes_out`, from `first_part` on.
    """
    _ = wp.tid()
    split_range_native(
        lanes,
        items_out.ptr,
        splits_out.ptr,
        begin,
        end,
        link,
        depth,
        max_splits,
        boxes.ptr,
        slot,
        part_boxes_out.ptr,
        first_part,
    )


@wp.kernel
def collapse_tree(
    # In:
    lanes: int,
    splits: wp.array[wp.int32],
    item_count: int,
    evenly: int,
    # Out:
    binaries_out: wp.array2d[wp.int32],
    children_out: wp.array2d[wp.int32],
    leaf_ranges_out: wp.array2d[wp.int32],
    counts_out: wp.array[wp.int32],
):
    """Number the tree's nodes and leaves in one thread, and count nodes, leaves and levels; `binaries_out` is scratch.

    The total area of node boxes is minimal; with `evenly`, nodes cover at least log2(lanes) levels of the binary tree.
    """
    _ = wp.tid()
    collapse_native(
        lanes,
        splits.ptr,
        item_count,
        evenly,
        binaries_out.ptr,
        children_out.ptr,
        leaf_ranges_out.ptr,
        counts_out.ptr,
    )


@wp.kernel
def fill_leaves(
    # Scene:
    vertices: wp.array[float],
    faces: wp.array[wp.int32],
    owner: wp.array[wp.int32],
    closed: wp.array[wp.uint8],
    # In:
    lanes: int,
    items: wp.array[float],
    leaf_ranges: wp.array2d[wp.int32],
    first_leaf: int,
    # Out:
    leaves_out: wp.array[float],
    triangles_out: wp.array[wp.int32],
    owners_out: wp.array[wp.int32],
    leaf_bounds_out: wp.array[float],
):
    leaf = wp.tid() + first_leaf
    fill_leaf_native(
        lanes,
        vertices.ptr,
        faces.ptr,
        owner.ptr,
        closed.ptr,
        items.ptr,
        leaf_ranges.ptr,
        leaf,
        leaves_out.ptr,
        triangles_out.ptr,
        owners_out.ptr,
        leaf_bounds_out.ptr,
    )


@wp.kernel
def fit_nodes(
    # In:
    lanes: int,
    children: wp.array[wp.int32],
    leaf_bounds: wp.array[float],
    node_count: int,
    # Out:
    nodes_out: wp.array[float],
):
    """Write boxes and normal cones of all nodes' children in one thread, from the leaves up."""
    _ = wp.tid()
    fit_nodes_native(lanes, children.ptr, leaf_bounds.ptr, node_count, nodes_out.ptr)
