// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// Triangles and the tree above them, in rows of as many numbers as there are lanes: see warpvis/scene/_bvh.py.
struct Bvh {
    enum { LEAF_WORDS = LEAF_ROWS * LANES, NODE_WORDS = NODE_ROWS * LANES };

    const float* leaves;  // [leaf][LEAF_ROWS][lane]: corners a, b, c of triangles
    const int* owners;  // [leaf][lane]: object of a triangle; its complement where the object is closed
    const float* nodes;  // [node][NODE_ROWS][lane]: least and greatest corner, axis and cutoff of the normals' cone
    const int* children;  // [node][lane]: a node, or the complement of a leaf
    int root;  // node of what stays where it is, -1 if nothing does
    bool all_closed;  // whether every object that stays is
    const float* closed_boxes;  // [closed]: of closed objects that stay, least and greatest corner
    const int* closed_object;  // [closed]: which they are
    int closed_count;

    static inline int object_of(int owner) { return owner < 0 ? ~owner : owner; }
    inline const float* leaf(long long index) const { return leaves + index * LEAF_WORDS; }
    inline const float* node(long long index) const { return nodes + index * NODE_WORDS; }
    inline const int* children_of(long long node) const { return children + node * LANES; }
};

// A tree to draw, of what stays where it is or of one object that moves, and whose its triangles are.
struct Instance {
    int root;
    int first_id;  // number of a triangle, less its place in the leaves
    const int* owners;  // of leaf 0
    int owner_step;  // from the owners of a leaf to those of the next: 0 where there is but one
};
