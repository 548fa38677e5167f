// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Tree construction as in kernels/bvh/build.py.

#pragma once

namespace warpvis {

// Whether the stored areas of the parts' boxes are exact, for a range's split and all splits below it.
inline bool has_exact_areas(const Exact<v8>& items, const Exact<Split>& splits, int split, int begin, int end) {
    if (split == 0) return true;
    const float left = Aabb::half_area(Aabb::of_items(items.data, begin, split));
    const float right = Aabb::half_area(Aabb::of_items(items.data, split, end));
    const Split& here = splits[split];
    return here.area[0] == left && here.area[1] == right &&
           has_exact_areas(items, splits, here.child[0], begin, split) &&
           has_exact_areas(items, splits, here.child[1], split, end);
}

template <int LANES>
inline BuiltTree build(const ::Mesh& given, const std::vector<int>& owner_of,
                       const std::vector<unsigned char>& closed_of, bool evenly, int depth) {
    const int count = given.count();
    const Exact<float> vertices(given.vertices);
    const Exact<int> faces(given.faces), owner(owner_of);
    const Exact<unsigned char> closed(closed_of);
    Exact<v8> items(count);
    Exact<Split> splits(count);
    for (int i = 0; i < count; ++i) Items::load(vertices.data, faces.data, i, items.data);
    v8 centers[2];
    Splitter<LANES>::split_all(items.data, splits.data, {0, count, 0, depth, Aabb::of_centers(items.data, 0, count)},
                               -1, centers);
    const bool exact_areas = has_exact_areas(items, splits, splits[0].child[0], 0, count);
    Exact<typename Collapser<LANES>::Binary> binaries(count);
    Exact<int> children((size_t)count * LANES, 0x55555555), ranges(2 * (size_t)count), counts(3);
    Collapser<LANES>::collapse(splits.data, count, evenly, binaries.data, children.data, ranges.data, counts.data);
    BuiltTree tree;
    tree.exact_areas = exact_areas;
    tree.lanes = LANES, tree.nodes = counts[0], tree.leaves = counts[1], tree.levels = counts[2];
    tree.children = Exact<int>(std::vector<int>(children.data, children.data + tree.nodes * LANES));
    tree.leaf_rows = Exact<float>((size_t)tree.leaves * LEAF_ROWS * LANES);
    tree.node_rows = Exact<float>((size_t)tree.nodes * NODE_ROWS * LANES);
    tree.triangles = Exact<int>((size_t)tree.leaves * LANES);
    tree.owners = Exact<int>((size_t)tree.leaves * LANES);
    Exact<float> bounds((size_t)tree.leaves * NODE_ROWS);
    const Mesh mesh = {vertices.data, faces.data, owner.data, closed.data};
    const Leaves<LANES> leaves = {tree.leaf_rows.data, tree.triangles.data, tree.owners.data, bounds.data};
    for (int leaf = 0; leaf < tree.leaves; ++leaf) leaves.fill(mesh, items.data, ranges.data, leaf);
    Nodes<LANES>::fit(tree.children.data, bounds.data, tree.nodes, tree.node_rows.data);
    return tree;
}

}  // namespace warpvis
