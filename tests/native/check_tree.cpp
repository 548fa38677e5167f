// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Check trees of 16 and 32 lanes: every triangle occurs once, and bounds are exact.

#include "check.h"

// Small parallel triangles stacked like the slats of a blind: whether they face a camera depends on its height, and
// their boxes are long along the stack.
static Mesh stack(Random& random, int count) {
    Mesh mesh;
    const int axis = random.whole(0, 2), way = random.pick({-1, 1});
    const double tilt = random.pick({0.0, 0.003, 0.02});
    for (int i = 0; i < count; ++i) {
        const double height = random.real(-1, 1);
        int corner[3];
        for (int k = 0; k < 3; ++k) {
            double p[3];
            p[axis] = height + tilt * (k == 1);
            p[(axis + 1) % 3] = 0.01 * (k == 1), p[(axis + 2) % 3] = 0.01 * (k == 2);
            corner[k] = mesh.add(p[0], p[1], p[2]);
        }
        mesh.face(corner[0], corner[way > 0 ? 1 : 2], corner[way > 0 ? 2 : 1]);
    }
    return mesh;
}

// Pairs of coincident triangles with opposite orientations, so that their normals sum to zero. Some have no area.
static Mesh sheets(Random& random, int count) {
    Mesh mesh;
    for (int i = 0; i < count; ++i) {
        const double x = random.whole(0, 9), y = random.whole(0, 9), size = random.pick({0.0, 1.0});
        const int a = mesh.add(x, y, 0), b = mesh.add(x + size, y, 0), c = mesh.add(x, y + size, 0);
        mesh.face(a, b, c);
        mesh.face(a, c, b);
    }
    return mesh;
}

// Meshes that are hard to split: coincident triangles, on a line, with growing distances; and ordinary meshes.
static Mesh hard_mesh(Random& random) {
    const int count = random.pick({1, 2, 15, 16, 17, 31, 32, 33, 64, 65, 128, 129, 300, 1200});
    const int kind = random.whole(0, 8);
    if (kind == 0) return meshes::soup(random, count, 1);
    if (kind == 1) return meshes::box(1, 2, 3, random.whole(1, 9));
    if (kind == 6) return meshes::grid(random, random.whole(10, 45), 0.1, random.pick({0.0, 1e-3, 0.02}));
    if (kind == 7) return stack(random, count);
    if (kind == 8) return sheets(random, count);
    Mesh mesh;
    for (int i = 0; i < count; ++i) {
        const double step = kind == 2   ? 0
                            : kind == 3 ? i
                            : kind == 4 ? std::pow(2.0, i % 120 - 60)
                                        : random.whole(0, 3);
        const double size = kind == 4 ? step / 4 : random.pick({0.0, 0.5});
        const int a = mesh.add(step, 0, kind == 5 ? random.real(0, 1) : 0);
        mesh.face(a, mesh.add(step + size, size, 0), mesh.add(step, size, size));
    }
    return mesh;
}

struct Checker {
    const Mesh& mesh;
    const BuiltTree& tree;
    const std::vector<int>& owner;
    const std::vector<unsigned char>& closed;
    const std::vector<Vec>& cameras;
    std::vector<int> times_seen, times_visited;
    int levels = 0;
    bool is_flat = false;
    const char* wrong = nullptr;

    void require(bool right, const char* what) {
        if (!right && !wrong) wrong = what;
    }

    struct Under {
        float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
        std::vector<int> triangles;
        bool all_closed = true;
        int height = 0;  // in levels of nodes, 0 for a leaf
    };

    // Whether all triangles have the same normal.
    bool find_flat() const {
        Vec first = {0, 0, 0};
        for (int triangle = 0; triangle < mesh.count(); ++triangle) {
            const Vec n = normal(triangle);
            if (n.length() == 0) return false;
            if (triangle == 0) first = n * (1 / n.length());
            if ((n * (1 / n.length()) - first).length() > 1e-6) return false;
        }
        return true;
    }

    Vec corner(int triangle, int k) const {
        const float* p = &mesh.vertices[3 * mesh.faces[3 * triangle + k]];
        return {p[0], p[1], p[2]};
    }

    // Zero if the cross product is within its rounding error: the corners are collinear, or two of them coincide.
    Vec normal(int triangle) const {
        const Vec a = corner(triangle, 0), ab = corner(triangle, 1) - a, ac = corner(triangle, 2) - a;
        const Vec n = ab.cross(ac);
        return n.length() > 1e-15 * ab.length() * ac.length() ? n : Vec{0, 0, 0};
    }

    // Index of the corner that the leaf stores first. Corners at the same position are the same corner.
    int first_corner(int leaf, int lane, int triangle) const {
        for (int k = 0; k < 3; ++k) {
            bool same = true;
            for (int row = 0; row < 9; ++row) {
                const int from = mesh.faces[3 * triangle + (k + row / 3) % 3];
                same &= tree.leaf_rows[(leaf * 9 + row) * tree.lanes + lane] == mesh.vertices[3 * from + row % 3];
            }
            if (same) return k;
        }
        return 0;
    }

    // Lengths are L1 distances. The tree computes them in single precision, so two nearly equal sides may be swapped.
    bool has_longest_side_opposite(int triangle, int first) const {
        double length[3];
        for (int k = 0; k < 3; ++k) {
            const Vec side = corner(triangle, (k + 1) % 3) - corner(triangle, (k + 2) % 3);
            length[k] = std::fabs(side.x) + std::fabs(side.y) + std::fabs(side.z);
        }
        return length[first] >= (1 - 1e-6) * std::max({length[0], length[1], length[2]});
    }

    void add_leaf(int leaf, Under& under) {
        const int lanes = tree.lanes;
        require(leaf < tree.leaves, "no such leaf");
        if (leaf >= tree.leaves) return;
        bool ended = false;
        for (int k = 0; k < lanes; ++k) {
            const int triangle = tree.triangles[leaf * lanes + k],
                      real = triangle < 0 ? tree.triangles[leaf * lanes] : triangle;
            require(triangle >= 0 || k > 0, "an empty leaf");
            require(!(ended && triangle >= 0), "a gap in a leaf");
            ended |= triangle < 0;
            require(real >= 0 && real < mesh.count(), "no such triangle");
            if (wrong) return;
            require(tree.owners[leaf * lanes + k] == owner[real], "owner");
            const int first = triangle < 0 ? 0 : first_corner(leaf, k, triangle);
            for (int row = 0; row < 9; ++row) {
                const int from = mesh.faces[3 * real + (triangle < 0 ? 0 : (first + row / 3) % 3)];
                require(tree.leaf_rows[(leaf * 9 + row) * lanes + k] == mesh.vertices[3 * from + row % 3], "corner");
            }
            require(triangle < 0 || has_longest_side_opposite(triangle, first),
                    "the first corner is not opposite to the longest side");
            if (triangle < 0) continue;
            times_seen[triangle] += 1;
            under.triangles.push_back(triangle);
            under.all_closed &= closed[owner[triangle]] != 0;
            for (int i = 0; i < 9; ++i) {
                const float value = mesh.vertices[3 * mesh.faces[3 * triangle + i / 3] + i % 3];
                under.low[i % 3] = std::min(under.low[i % 3], value);
                under.high[i % 3] = std::max(under.high[i % 3], value);
            }
        }
    }

    void check_bounds(const float* row, const Under& under) {
        for (int k = 0; k < 3; ++k) {
            require(row[k * tree.lanes] == under.low[k], "least corner");
            require(row[(3 + k) * tree.lanes] == under.high[k], "greatest corner");
        }
        const double cutoff = row[9 * tree.lanes];
        // If all triangles have the same normal, only rounding widens a cone, level by level.
        require(!is_flat || !under.all_closed || cutoff < 1.5e-3 * (under.height + 1), "a cone that is too wide");
        const Vec axis = {row[6 * tree.lanes], row[7 * tree.lanes], row[8 * tree.lanes]};
        require(cutoff == 2.0 || under.all_closed, "a cone of an open object");
        if (cutoff == 2.0) return;
        require(cutoff >= 1e-3 && cutoff < 1, "cutoff");
        for (int triangle : under.triangles) {
            const Vec n = normal(triangle);
            if (n.length() == 0) continue;
            const double cosine = n.dot(axis) / n.length() / axis.length();
            require(cosine > 0 && std::sqrt(std::max(0.0, 1 - cosine * cosine)) <= cutoff, "a normal outside its cone");
        }
    }

    // A culled child must not contain a triangle that faces the camera.
    void check_turned(int node, int child, const Under& under) {
        for (const Vec& camera : cameras) {
            const float at[3] = {(float)camera.x, (float)camera.y, (float)camera.z};
            if (!(turned_away(tree, node, at) >> child & 1)) continue;
            for (int triangle : under.triangles) {
                const Vec a = corner(triangle, 0), n = normal(triangle);
                require(n.dot(a - Vec{at[0], at[1], at[2]}) >= -1e-6 * n.length(),
                        "a culled triangle faces the camera");
            }
        }
    }

    Under visit(int node, int level) {
        Under all;
        require(node < tree.nodes && level <= tree.levels, "no such node");
        if (wrong) return all;
        times_visited[node] += 1;
        levels = std::max(levels, level);
        bool ended = false;
        for (int k = 0; k < tree.lanes; ++k) {
            const int child = tree.children[node * tree.lanes + k];
            const float* row = &tree.node_rows[(size_t)node * 10 * tree.lanes + k];
            Under under;
            if (child == 0) {
                require(row[0] == 3e38f && row[3 * tree.lanes] == -3e38f, "bounds of a missing child");
                ended = true;
                continue;
            }
            require(!ended, "a gap in a node");
            require(child < 0 || child > node, "a child before its parent");
            if (child > 0) under = visit(child, level + 1);
            if (child < 0) add_leaf(~child, under);
            if (wrong) return all;
            check_bounds(row, under);
            if (tree.lanes == 16) check_turned(node, k, under);
            all.triangles.insert(all.triangles.end(), under.triangles.begin(), under.triangles.end());
            all.all_closed &= under.all_closed;
            all.height = std::max(all.height, under.height + 1);
            for (int i = 0; i < 3; ++i) {
                all.low[i] = std::min(all.low[i], under.low[i]);
                all.high[i] = std::max(all.high[i], under.high[i]);
            }
        }
        return all;
    }

    const char* fault(bool evenly) {
        times_seen.assign(mesh.count(), 0), times_visited.assign(tree.nodes, 0);
        is_flat = find_flat();
        visit(0, 1);
        require(tree.exact_areas, "area of a part");
        for (int times : times_seen) require(times == 1, "a triangle does not occur once");
        for (int times : times_visited) require(times == 1, "a node does not occur once");
        require(levels == tree.levels, "levels");
        // Halving from the root on gives the fewest levels: leaves that are full, except the last.
        int least = 1;
        for (long long most = tree.lanes * (long long)tree.lanes; most < mesh.count(); most *= tree.lanes) ++least;
        require(!evenly || tree.levels <= least + 1, "more levels than even division needs");
        return wrong;
    }
};

static void check_scene(uint64_t seed) {
    Random random(seed);
    const Mesh mesh = hard_mesh(random);
    const std::vector<unsigned char> closed = {1, (unsigned char)random.chance(0.5)};
    std::vector<int> owner;
    for (int i = 0; i < mesh.count(); ++i) owner.push_back(random.chance(0.05));
    const bool evenly = random.chance(0.3);
    const int depth = evenly ? 64 : random.pick({0, 0, 60, 64});
    std::vector<Vec> cameras;
    for (int i = 0; i < 6; ++i) cameras.push_back({random.real(-2, 2), random.real(-2, 2), random.real(-2, 2)});
    for (int lanes : {16, 32}) {
        const BuiltTree tree = build_tree(lanes, mesh, owner, closed, evenly, depth);
        Checker checker = {mesh, tree, owner, closed, cameras, {}, {}, 0, false, nullptr};
        const char* fault = checker.fault(evenly);
        if (fault) fail(seed, lanes, fault, "%d triangles", mesh.count());
    }
}

int main(int count, char** arguments) { return check_all(count, arguments, check_scene); }
