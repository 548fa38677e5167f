// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/bvh_split.h"

// Collapses the binary tree into nodes of LANES children such that the total surface area of the nodes' boxes, and so
// the expected number of nodes that a random ray visits, is minimal (Ylitie, Karras and Laine 2017, section 3.1).
template <int LANES>
struct Collapser {
    enum {
        MAX_LEVELS = HALVING_DEPTH + 31
    };  // of the binary tree: below HALVING_DEPTH, ranges are halved at most 31 times

    // A node of the binary tree. cost[i] is the minimal area of the nodes that its subtree needs if divided into at
    // most i + 1 parts, each a node or a leaf.
    struct Binary {
        int begin, split, end;
        int child[2];  // -1 for a leaf
        float area;
        float cost[LANES];
    };

    static_assert(sizeof(Binary) == (BINARY_WORDS + LANES) * sizeof(int), "Python allocates nodes");

    // A subtree that is divided into at most `max_parts` parts.
    struct Part {
        int binary;  // -1 for a leaf
        int begin, end;
        int max_parts;
    };

    struct Pending {
        int binary;
        int level;
        long long slot;  // of `children`, to store the node's index in
    };

    static float cost(const Binary* tree, int binary, int max_parts) {
        return binary < 0 ? 0.0f : tree[binary].cost[max_parts - 1];
    }

    // List the nodes of the binary tree, parents before children; returns their number.
    static int list(const Split* splits, int item_count, Binary* tree) {
        struct Item {
            int parent, side, split, begin, end;
            float area;
        };
        Item stack[MAX_LEVELS + 1];  // one sibling per level, and both on the last level
        int waiting = 0, count = 0;
        stack[waiting++] = Item{-1, 0, splits[0].child[0], 0, item_count, 0.0f};
        while (waiting > 0) {
            const Item item = stack[--waiting];
            if (item.split == 0) continue;
            const int binary = count++;
            if (item.parent >= 0) tree[item.parent].child[item.side] = binary;
            tree[binary].begin = item.begin, tree[binary].split = item.split, tree[binary].end = item.end;
            tree[binary].child[0] = tree[binary].child[1] = -1;
            tree[binary].area = item.area;
            const Split& split = splits[item.split];
            stack[waiting++] = Item{binary, 1, split.child[1], item.split, item.end, split.area[1]};
            stack[waiting++] = Item{binary, 0, split.child[0], item.begin, item.split, split.area[0]};
        }
        return count;
    }

    // Number of the `max_parts` parts that the left child gets at the minimum cost.
    static int share(const Binary* tree, const Binary& node, int max_parts, float& min_cost) {
        int best = 1;
        min_cost = __builtin_inff();
        for (int k = 1; k < max_parts; ++k) {
            const float c = cost(tree, node.child[0], k) + cost(tree, node.child[1], max_parts - k);
            if (c < min_cost) min_cost = c, best = k;
        }
        return best;
    }

    static void find_costs(Binary* tree, int count) {
        for (int binary = count - 1; binary >= 0; --binary) {
            Binary& node = tree[binary];
            share(tree, node, LANES, node.cost[0]);
            node.cost[0] += node.area + 1e-30f;  // minimizes the number of nodes if all areas are 0
            for (int max_parts = 2; max_parts <= LANES; ++max_parts) {
                float open;
                share(tree, node, max_parts, open);
                node.cost[max_parts - 1] = open < node.cost[max_parts - 2] ? open : node.cost[max_parts - 2];
            }
        }
    }

    // Set costs that make `share` divide the parts evenly, except that a leaf takes one part. Then each half of a
    // subtree with 2^j parts or more is a leaf or gets 2^(j - 1) parts or more: a node spans at least log2(LANES)
    // levels of the binary tree, whatever its shape.
    static void share_evenly(Binary* tree, int count) {
        for (int binary = 0; binary < count; ++binary)
            for (int max_parts = 1; max_parts <= LANES; ++max_parts)
                tree[binary].cost[max_parts - 1] = 1.0f / max_parts;
    }

    // Find the children of a node, in the order of the items; returns their number.
    static int open(const Binary* tree, int binary, Part* children) {
        Part stack[2 * LANES];
        int waiting = 0, count = 0;
        push(tree, tree[binary], LANES, stack, waiting);
        while (waiting > 0) {
            Part part = stack[--waiting];
            if (part.binary >= 0) {
                const Binary& node = tree[part.binary];
                while (part.max_parts > 1 && node.cost[part.max_parts - 2] == node.cost[part.max_parts - 1])
                    --part.max_parts;
                if (part.max_parts > 1) {
                    push(tree, node, part.max_parts, stack, waiting);
                    continue;
                }
            }
            children[count++] = part;
        }
        return count;
    }

    static void push(const Binary* tree, const Binary& node, int max_parts, Part* stack, int& waiting) {
        float min_cost;
        const int left_parts = share(tree, node, max_parts, min_cost);
        stack[waiting++] = Part{node.child[1], node.split, node.end, max_parts - left_parts};
        stack[waiting++] = Part{node.child[0], node.begin, node.split, left_parts};
    }

    // `counts` receives the numbers of nodes, leaves and levels. Nodes precede their descendants. `evenly` bounds the
    // number of levels instead of minimizing the area.
    static void collapse(const Split* splits, int item_count, bool evenly, Binary* tree, int* children,
                         int* leaf_ranges, int* counts) {
        const int binaries = list(splits, item_count, tree);
        if (evenly)
            share_evenly(tree, binaries);
        else
            find_costs(tree, binaries);
        Pending stack[LANES * MAX_LEVELS];  // a wide tree has no more levels than the binary tree
        int waiting = 0, nodes = 0, leaves = 0, levels = 0;
        stack[waiting++] = Pending{binaries > 0 ? 0 : -1, 1, -1};
        while (waiting > 0) {
            const Pending pending = stack[--waiting];
            const int node = nodes++;
            if (pending.slot >= 0) children[pending.slot] = node;
            if (pending.level > levels) levels = pending.level;
            Part parts[LANES] = {Part{-1, 0, item_count, 1}};
            const int count = pending.binary < 0 ? 1 : open(tree, pending.binary, parts);
            int* child = children + (long long)node * LANES;
            for (int k = 0; k < LANES; ++k) {
                child[k] = 0;
                if (k >= count || parts[k].binary >= 0) continue;
                leaf_ranges[2 * leaves] = parts[k].begin;
                leaf_ranges[2 * leaves + 1] = parts[k].end;
                child[k] = ~leaves++;
            }
            for (int k = count - 1; k >= 0; --k)
                if (parts[k].binary >= 0)
                    stack[waiting++] = Pending{parts[k].binary, pending.level + 1, (long long)node * LANES + k};
        }
        counts[0] = nodes;
        counts[1] = leaves;
        counts[2] = levels;
    }
};
