// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/lanes.h"

// Triangles and the tree above them, in rows with one number per lane: see warpvis/scene/acceleration/bvh.py.
struct Bvh {
    enum { LEAF_WORDS = LEAF_ROWS * LANES, NODE_WORDS = NODE_ROWS * LANES };

    const float* leaves;  // [leaf][LEAF_ROWS][lane]: corners a, b, c of triangles
    const int* owners;  // [leaf][lane]: object of a triangle; its complement if the object is closed
    const float* nodes;  // [node][NODE_ROWS][lane]: least and greatest corner, axis and cutoff of the normals' cone
    const int* children;  // [node][lane]: index of a node, or the complement of the index of a leaf
    int root;  // root node of the static geometry, -1 if there is none
    bool all_closed;  // whether every static object is closed
    const float* closed_boxes;  // [closed]: least and greatest corner of each closed static object
    const int* closed_object;  // [closed]: index of that object
    int closed_count;

    static inline int object_of(int owner) { return owner < 0 ? ~owner : owner; }
    inline const float* leaf(long long index) const { return leaves + index * LEAF_WORDS; }
    inline const float* node(long long index) const { return nodes + index * NODE_WORDS; }
    inline const int* children_of(long long node) const { return children + node * LANES; }
};

// A tree to traverse, of the static geometry or of one movable object, and the owners of its triangles.
struct Instance {
    int root;
    int first_id;  // number of a triangle minus its slot in the leaves
    const int* owners;  // of leaf 0
    int owner_step;  // from the owners of a leaf to those of the next; 0 if all leaves share them
};
