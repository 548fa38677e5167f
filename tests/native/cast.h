// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Interface between the checks and the native code, independent of its structs: implemented by cast.cpp.

#pragma once

#include "memory.h"
#include "truth.h"

// Poses of movable objects in each world, and objects that views exclude.
struct Worlds {
    int views = 1, worlds = 1;
    Exact<float> cameras;  // [view][7]
    int moving = 0;  // number of movables with a pose in every world; the others are static instances
    Exact<float> poses;  // [world][movable][7]
    Exact<float> instances;  // [instance][7]
    Exact<int> world;  // [view], or empty
    Exact<unsigned char> excluded;  // [view or 1][object], or empty
    int excluded_views = 0;

    const float* place(int world, int movable) const {
        return movable < moving ? &poses[7 * (world * moving + movable)] : &instances[7 * (movable - moving)];
    }

    // The world of a view, -1 if it does not exist.
    int of(int view) const {
        const int index = world.data ? world[view] : worlds == 1 ? 0 : view;
        return index >= 0 && index < worlds ? index : -1;
    }
};

// The arrays of BvhScene in kernels/casting/packets.py.
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

// Division of a job among workers.
struct Shares {
    std::vector<int> strip_rows;  // first row of each strip, and the end of the last one
    int workers = 1;
    int shift = 0;  // offset of memory from a multiple of 64 bytes, in elements
};

BuiltTree build_tree(int lanes, const Mesh& mesh, const std::vector<int>& owner,
                     const std::vector<unsigned char>& closed, bool evenly, int depth);

// Bit mask of the children of a node of 16 lanes whose triangles all face away from a camera.
unsigned turned_away(const BuiltTree& tree, int node, const float* camera);

// Shrink the interval of columns of rows from v0 to v1 by an edge function u * edge[0] + v * edge[1] + edge[2],
// positive inside. Pixels where it is at least -error_bound must stay inside the interval.
void narrow_columns(const float* edge, float error_bound, float first_u, float v0, float v1, float& left, float& right);

// Whether an edge function at a pixel is positive or uncertain.
bool is_inside(const float* edge, float error_bound, float u, float v);

SceneBvh cluster(const Scene& scene);

enum { DEPTH = 1, POINTS = 2, NORMALS = 4, LABELS = 8, OBJECTS = 16, ALL_OUTPUTS = 31 };

// Output images; empty if not requested.
struct Pictures {
    Exact<float> depth, points, normals;
    Exact<unsigned char> labels;
    Exact<int> objects;
};

// `outputs` is a sum of the values above. `at` contains x and y of `points` points of each view; empty for pixel
// centers.
Pictures cast(const SceneBvh& clusters, const Worlds& worlds, const Lens& lens, const Shares& shares, bool cull,
              unsigned outputs, const Exact<float>& at, int points);

// Visibility of points.
struct Statuses {
    Exact<unsigned char> status;
    Exact<int> occluders;
};

// Batches and strips of points; see warpvis.point_packets.
struct Layout {
    double scale = 1;
    int batch = 16, strip_tiles = 1;
    bool whole = false, with_id = false, occluders = false;
    float tolerance = 0;
};

Statuses judge_points(const SceneBvh& clusters, const Worlds& worlds, const Lens& lens, const Shares& shares,
                      const Layout& layout, const Exact<float>& places);

// Counters of objects, as in kernels/visibility/silhouettes.py: visible, image, silhouette, too near, too far, and boxes.
enum { COUNTERS = 13, VISIBLE = 0, IMAGE, SILHOUETTE, TOO_NEAR, TOO_FAR, VISIBLE_BOX, SILHOUETTE_BOX = 9 };

struct Counts {
    Exact<int> counts;  // [counter][view][chosen]
    Exact<int> hidden_by;  // [view][chosen][object]
    Exact<unsigned char> masks;  // [view][chosen][y][x], or empty
};

// Images that objects are compared with.
struct Compared {
    std::vector<int> chosen;
    int canvas[4];
    bool seen_only, masks;
    float delta;
    Exact<int> seen;  // [view][y][x]
    Exact<float> depth;  // [view][y][x], or empty
};

Counts count_objects(const SceneBvh& clusters, const Worlds& worlds, const Lens& lens, const Shares& shares,
                     const Compared& with);
