// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// What the checks ask of the native code, without its structs: cast.cpp holds those.

#pragma once

#include "memory.h"
#include "truth.h"

// What of the objects is where in each world, and what views leave out.
struct Worlds {
    int views = 1, worlds = 1;
    Exact<float> cameras;  // [view][7]
    int moving = 0;  // movables that have a pose in every world; those behind them stay
    Exact<float> poses;  // [world][movable][7], of those
    Exact<float> instances;  // [movable][7], of the others
    Exact<int> world;  // [view], or none
    Exact<unsigned char> excluded;  // [view or 1][object], or none
    int excluded_views = 0;

    const float* place(int world, int movable) const {
        return movable < moving ? &poses[7 * (world * moving + movable)] : &instances[7 * (movable - moving)];
    }

    // The world of a view, -1 where there is none.
    int of(int view) const {
        const int index = world.data ? world[view] : worlds == 1 ? 0 : view;
        return index >= 0 && index < worlds ? index : -1;
    }
};

// The arrays of kernels/packets.py's BvhScene.
struct SceneBvh {
    Exact<float> leaves, nodes;
    Exact<int> owners, children;
    int static_root = -1, levels = 0;
    bool all_closed = true;
    Exact<float> closed_boxes;
    Exact<int> closed_object, still;
    Exact<int> object, root, first_leaf, first_id, closed, solid;
    Exact<float> boxes, size;
    Exact<unsigned char> labels;
};

// How a job is shared out.
struct Shares {
    std::vector<int> strip_rows;  // where strips begin and the last one ends
    int workers = 1;
    int shift = 0;  // how many words after a multiple of 64 bytes memory begins
};

BuiltTree build_tree(int lanes, const Mesh& mesh, const std::vector<int>& owner,
                     const std::vector<unsigned char>& closed, bool evenly, int depth);

// The children of a node of 16 lanes whose triangles all face away from a camera, one bit for each.
unsigned turned_away(const BuiltTree& tree, int node, const float* camera);

// Make columns fewer, by an edge that is positive inside, u * edge[0] + v * edge[1] + edge[2], in rows from v0 to v1,
// and of which no value may be left out that is negative by no more than the doubt.
void narrow_columns(const float* edge, float doubt, float first_u, float v0, float v1, float& left, float& right);

// Whether a pixel is on an edge's inner side, or may be.
bool is_inside(const float* edge, float doubt, float u, float v);

SceneBvh cluster(const Scene& scene);

enum { DEPTH = 1, POINTS = 2, NORMALS = 4, LABELS = 8, OBJECTS = 16, ALL_OUTPUTS = 31 };

// What a caster wrote; empty where nobody asked.
struct Pictures {
    Exact<float> depth, points, normals;
    Exact<unsigned char> labels;
    Exact<int> objects;
};

// `outputs`: a sum of the values above. `at`: x and y of `points` points of each view, or none for pixels' centres.
Pictures cast(const SceneBvh& clusters, const Worlds& worlds, const Lens& lens, const Shares& shares, bool cull,
              unsigned outputs, const Exact<float>& at, int points);

// What of points is seen.
struct Statuses {
    Exact<unsigned char> status;
    Exact<int> occluders;
};

// How points are worked on; see warpvis.point_packets.
struct Layout {
    double scale = 1;
    int batch = 16, strip_tiles = 1;
    bool whole = false, with_id = false, occluders = false;
    float tolerance = 0;
};

Statuses judge_points(const SceneBvh& clusters, const Worlds& worlds, const Lens& lens, const Shares& shares,
                      const Layout& layout, const Exact<float>& places);

// What of objects is counted, as in kernels/silhouettes.py: visible, image, silhouette, too near, too far, and boxes.
enum { COUNTERS = 13, VISIBLE = 0, IMAGE, SILHOUETTE, TOO_NEAR, TOO_FAR, VISIBLE_BOX, SILHOUETTE_BOX = 9 };

struct Counts {
    Exact<int> counts;  // [counter][view][chosen]
    Exact<int> hidden_by;  // [view][chosen][object]
    Exact<unsigned char> masks;  // [view][chosen][y][x], or none
};

// What objects are compared with.
struct Compared {
    std::vector<int> chosen;
    int canvas[4];
    bool seen_only, masks;
    float delta;
    Exact<int> seen;  // [view][y][x]
    Exact<float> depth;  // the same, or none
};

Counts count_objects(const SceneBvh& clusters, const Worlds& worlds, const Lens& lens, const Shares& shares,
                     const Compared& with);
