// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Builder of the BVH: leaves of LANES triangles, nodes of LANES children, 16 or 32. The kernels of kernels/bvh/build.py
// call Items::load and Splitter::split_all here, then Collapser::collapse in bvh_collapse.h, and Leaves::fill and
// Nodes::fit in bvh_bounds.h.

#pragma once

#include "shared/constants.h"

typedef float v4 __attribute__((ext_vector_type(4)));
typedef float v8 __attribute__((ext_vector_type(8)));
typedef int i4 __attribute__((ext_vector_type(4)));

// An AABB is stored as its lower corner and its negated upper corner, so that the union of two is one minimum. Lanes 3
// and 7 are free; an item is a triangle's box with the triangle's index there, as two floats that hold 16 bits each.
struct Aabb {
    static v8 empty() { return (v8)(NOWHERE); }

    // A single instruction, unlike __builtin_elementwise_min, which also handles NaN; no coordinate is NaN.
    static v8 unite(v8 a, v8 b) { return a < b ? a : b; }

    // Widen a box in memory. Without the empty instruction, Clang makes this a masked store, which takes tens of cycles
    // on AMD's processors: trees took up to 1.6 times as long.
    static void widen(v8& box, v8 other) {
        v8 wider = unite(box, other);
#if defined(__x86_64__)
        asm("" : "+x"(wider));
#endif
        box = wider;
    }

    static v8 intersect(v8 a, v8 b) { return a > b ? a : b; }

    static float half_area(v8 box) {
        v4 size = -(box.lo + box.hi);
        return size.x * size.y + size.y * size.z + size.z * size.x;
    }

    static v8 of_items(const v8* items, int begin, int end) {
        v8 box = empty();
        for (int i = begin; i < end; ++i) box = unite(box, items[i]);
        return box;
    }

    // Twice the center: lower plus upper corner.
    static v4 center(v8 item) { return item.lo - item.hi; }

    static v8 of_point(v4 p) { return __builtin_shufflevector(p, -p, 0, 1, 2, 3, 4, 5, 6, 7); }

    static v8 of_centers(const v8* items, int begin, int end) {
        v8 box = empty();
        for (int i = begin; i < end; ++i) box = unite(box, of_point(center(items[i])));
        return box;
    }
};

static_assert(sizeof(v8) == ITEM_WORDS * sizeof(float), "Python allocates items");

struct Items {
    // A float holds integers of 24 bits, so the index is split into two halves.
    enum { HALF_BITS = 16, LOW_HALF = (1 << HALF_BITS) - 1 };

    static int triangle(v8 item) { return ((int)item.s7 << HALF_BITS) | (int)item.s3; }

    static void load(const float* vertices, const int* faces, int triangle, v8* items) {
        const float* a = vertices + 3 * (long long)faces[3 * (long long)triangle];
        const float* b = vertices + 3 * (long long)faces[3 * (long long)triangle + 1];
        const float* c = vertices + 3 * (long long)faces[3 * (long long)triangle + 2];
        v4 pa = {a[0], a[1], a[2], 0.0f}, pb = {b[0], b[1], b[2], 0.0f}, pc = {c[0], c[1], c[2], 0.0f};
        v8 item = Aabb::unite(Aabb::of_point(pa), Aabb::unite(Aabb::of_point(pb), Aabb::of_point(pc)));
        item.s3 = (float)(triangle & LOW_HALF);
        item.s7 = (float)(triangle >> HALF_BITS);
        items[triangle] = item;
    }
};

// The binary tree. A node's items are a range; the node is identified by the position at which its range is split,
// where no other range is split. Threads that work on disjoint ranges therefore write disjoint splits. Slot 0 is above
// the root: its child[0] is the root's split.
struct Split {
    int child[2];  // the children's splits, 0 if the child is a leaf
    float area[2];  // half the surface area of the children's boxes
};

static_assert(sizeof(Split) == SPLIT_WORDS * sizeof(int), "Python allocates splits, and reads the children");

struct Choice {
    int axis, bin, left_count;
    float cost, left_area, right_area;
};

template <int LANES>
struct Splitter {
    typedef int Ints __attribute__((ext_vector_type(LANES)));

    enum {
        BINS = 16,  // bins per axis, for ranges that are too large to sort
        SMALL = 4 * LANES,  // ranges of at most this many items are sorted
        // quantization steps of an axis when sorting: a step and an item's index fit into 30 bits
        STEPS = (1 << 30) / SMALL,
    };

    // Cost of a child in the surface area heuristic, in leaves: a leaf costs the same however few triangles it has. If
    // boxes have no area, the fewest leaves are best.
    static float cost(float area, int count, float per_item) {
        return (area + 1e-30f) * ((float)((count + LANES - 1) / LANES) * per_item);
    }

    struct Grid {
        v4 origin, scale;

        static Grid of(v8 centers) {
            v4 size = -(centers.lo + centers.hi);
            Grid grid;
            grid.origin = centers.lo;
            for (int axis = 0; axis < 4; ++axis) grid.scale[axis] = size[axis] > 1e-30f ? BINS / size[axis] : 0.0f;
            return grid;
        }

        i4 cells(v4 center) const {
            v4 x = (center - origin) * scale;
            x = __builtin_elementwise_min(__builtin_elementwise_max(x, (v4)(0.0f)), (v4)(BINS - 1.0f));
            return __builtin_convertvector(x, i4);
        }
    };

    struct Bins {
        v8 box[3][BINS];
        int count[3][BINS];

        void fill(const v8* items, int begin, int end, Grid grid) {
            for (int axis = 0; axis < 3; ++axis)
                for (int k = 0; k < BINS; ++k) box[axis][k] = Aabb::empty(), count[axis][k] = 0;
            for (int i = begin; i < end; ++i) {
                const v8 item = items[i];
                const i4 cell = grid.cells(Aabb::center(item));
                add(0, cell.x, item), add(1, cell.y, item), add(2, cell.z, item);
            }
        }

        void add(int axis, int k, v8 item) {
            Aabb::widen(box[axis][k], item);
            ++count[axis][k];
        }

        void choose(int axis, int total, Choice& best) const {
            float right_area[BINS];
            v8 right = Aabb::empty();
            for (int k = BINS - 1; k > 0; --k) {
                right = Aabb::unite(right, box[axis][k]);
                right_area[k] = Aabb::half_area(right);
            }
            v8 left = Aabb::empty();
            int left_count = 0;
            for (int k = 1; k < BINS; ++k) {
                left = Aabb::unite(left, box[axis][k - 1]);
                left_count += count[axis][k - 1];
                if (left_count == 0 || left_count == total) continue;
                const float left_area = Aabb::half_area(left), per_item = 1.0f / total;
                const float c =
                    cost(left_area, left_count, per_item) + cost(right_area[k], total - left_count, per_item);
                if (c < best.cost) best = Choice{axis, k, left_count, c, left_area, right_area[k]};
            }
        }
    };

    // Move the items left of the bin to the front, without branches: every item is swapped with the first item of the
    // right part, and the border advances if the swapped item belongs to the left part.
    static void partition(v8* items, int begin, int end, Grid grid, Choice choice) {
        const int axis = choice.axis;
        const float origin = grid.origin[axis], scale = grid.scale[axis], bound = (float)choice.bin;
        int border = begin;
        for (int i = begin; i < end; ++i) {
            const v8 item = items[i];
            const float* corner = (const float*)&item;
            const bool is_left = (corner[axis] - corner[4 + axis] - origin) * scale < bound;
            items[i] = items[border];
            items[border] = item;
            border += is_left;
        }
    }

    // Sort the items along an axis. Keys are unique because they end in the items' indices, so an item's rank is the
    // number of smaller keys, which needs no branch.
    static void sort(const v8* items, int count, int axis, float low, float high, int* order) {
        Ints key[SMALL / LANES], rank[SMALL / LANES];
        const int blocks = (count + LANES - 1) / LANES;
        const float scale = high - low > 1e-30f ? (STEPS - 1.0f) / (high - low) : 0.0f;
        for (int i = 0; i < blocks * LANES; ++i) {
            const float* corner = (const float*)(items + (i < count ? i : 0));
            const float x = (corner[axis] - corner[4 + axis] - low) * scale;
            const int step = (int)__builtin_fminf(__builtin_fmaxf(x, 0.0f), STEPS - 1.0f);
            ((int*)key)[i] = (i < count ? step : STEPS) * SMALL + i;
        }
        for (int b = 0; b < blocks; ++b) {
            rank[b] = (Ints)(0);
            for (int j = 0; j < count; ++j) rank[b] -= (Ints)(((const int*)key)[j]) < key[b];
        }
        for (int i = 0; i < count; ++i) order[((const int*)rank)[i]] = i;
    }

    // Split a small range at the cheapest position along any of the three axes; sorts the items along that axis.
    static Choice split_sorted(v8* items, int count) {
        const v8 centers = Aabb::of_centers(items, 0, count);
        const float per_item = 1.0f / count;
        int orders[3][SMALL];
        float right_area[SMALL];
        Choice best = {0, 0, 0, __builtin_inff(), 0.0f, 0.0f};
        for (int axis = 0; axis < 3; ++axis) {
            int* order = orders[axis];
            sort(items, count, axis, centers[axis], -centers[4 + axis], order);
            v8 right = Aabb::empty();
            for (int i = count - 1; i > 0; --i) {
                right = Aabb::unite(right, items[order[i]]);
                right_area[i] = Aabb::half_area(right);
            }
            v8 left = Aabb::empty();
            for (int i = 1; i < count; ++i) {
                left = Aabb::unite(left, items[order[i - 1]]);
                const float area = Aabb::half_area(left);
                const float c = cost(area, i, per_item) + cost(right_area[i], count - i, per_item);
                if (c < best.cost) best = Choice{axis, 0, i, c, area, right_area[i]};
            }
        }
        v8 sorted[SMALL];
        for (int i = 0; i < count; ++i) sorted[i] = items[orders[best.axis][i]];
        for (int i = 0; i < count; ++i) items[i] = sorted[i];
        return best;
    }

    // Split after a whole number of leaves, near the middle.
    static Choice halve(const v8* items, int begin, int end) {
        const int half = ((end - begin) / 2 + LANES - 1) / LANES * LANES, middle = begin + half;
        return Choice{0,
                      0,
                      half,
                      0.0f,
                      Aabb::half_area(Aabb::of_items(items, begin, middle)),
                      Aabb::half_area(Aabb::of_items(items, middle, end))};
    }

    struct Range {
        int begin, end;
        int link;  // 2 * split + side of the parent
        int depth;
        v8 centers;  // their bounding box

        int count() const { return end - begin; }
    };

    // Split a range. `centers` receives bounding boxes of the centers of its parts: the intersection of the range's
    // box, one side of the bin, and the box of the part's items.
    static Choice split(v8* items, const Range& range, v8* centers) {
        centers[0] = centers[1] = range.centers;
        if (range.depth >= HALVING_DEPTH) return halve(items, range.begin, range.end);
        if (range.count() <= SMALL) return split_sorted(items + range.begin, range.count());
        const Grid grid = Grid::of(range.centers);
        Bins bins;
        bins.fill(items, range.begin, range.end, grid);
        Choice best = {0, 0, 0, __builtin_inff(), 0.0f, 0.0f};
        for (int axis = 0; axis < 3; ++axis) bins.choose(axis, range.count(), best);
        if (best.left_count == 0) return halve(items, range.begin, range.end);  // all centers coincide
        partition(items, range.begin, range.end, grid, best);
        for (int side = 0; side < 2; ++side) {
            v8 box = Aabb::empty();
            for (int k = side ? best.bin : 0; k < (side ? BINS : best.bin); ++k)
                box = Aabb::unite(box, bins.box[best.axis][k]);
            centers[side] = Aabb::intersect(range.centers, box + box);
        }
        return best;
    }

    // Split a range and its parts recursively until all are leaves, or `max_splits` times. The smaller part is
    // processed first, so that the stack never holds more ranges than `count` has bits. `centers` receives the boxes of
    // the parts of the last split.
    static void split_all(v8* items, Split* splits, const Range& root, int max_splits, v8* centers) {
        Range stack[8 * sizeof(root.end)];
        int waiting = 0;
        stack[waiting++] = root;
        while (waiting > 0) {
            const Range range = stack[--waiting];
            int& name = splits[range.link / 2].child[range.link % 2];
            name = 0;
            if (range.count() <= LANES || max_splits == 0) continue;
            --max_splits;
            const Choice choice = split(items, range, centers);
            const int middle = range.begin + choice.left_count;
            name = middle;
            splits[middle].area[0] = choice.left_area;
            splits[middle].area[1] = choice.right_area;
            const Range left = {range.begin, middle, 2 * middle, range.depth + 1, centers[0]};
            const Range right = {middle, range.end, 2 * middle + 1, range.depth + 1, centers[1]};
            const bool left_is_smaller = left.count() < right.count();
            stack[waiting++] = left_is_smaller ? right : left;
            stack[waiting++] = left_is_smaller ? left : right;
        }
    }
};
