// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Check steep and flat edges of triangles: bounds of columns, with which rasterization begins, must not exclude a pixel
// on the inner side of an edge.

#include "check.h"

static void check_edge(Random& random, uint64_t seed) {
    const int width = random.pick({20, 300, 4000}), rows = random.pick({1, 16}), first_row = 16 * random.whole(0, 60);
    const float first_u = (float)(0.5 - random.pick({0.5, 0.3, 0.0}) * width);
    const float first_v = (float)(0.5 - random.pick({0.5, 0.0, -1.0}) * 500);
    const float v0 = first_row + first_v, v1 = v0 + (float)(rows - 1);
    // The edge passes through a point near a pixel center, or far away.
    const double x = random.whole(0, width - 1) + random.pick({0.0, 1e-6, -1e-4, 0.01, 0.3});
    const double y = random.chance(0.5) ? random.pick({(double)v0, (double)v1, 0.0}) : random.real(v0, v1);
    const double slope = std::pow(10.0, random.real(-3, 8)) * random.pick({-1, 1}),
                 size = random.pick({1e-6, 1.0, 1e6});
    const float edge[3] = {(float)(random.pick({-1, 1}) * size), (float)(slope * size), 0};
    const float through[3] = {edge[0], edge[1], (float)(-edge[0] * (x + first_u) - (double)edge[1] * y)};
    const float error_bound = (float)(random.pick({0.0, 1e-6, 1e-3, 1.0}) * size);
    float left = 0, right = (float)(width - 1);
    narrow_columns(through, error_bound, first_u, v0, v1, left, right);
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < width; ++column) {
            if (column >= left && column <= right) continue;
            if (is_inside(through, error_bound, (float)column + first_u, v0 + (float)row))
                return fail(seed, row, "a pixel is excluded", "column %d, not from %g to %g, slope %g", column, left,
                            right, slope);
        }
}

static void check_scene(uint64_t seed) {
    Random random(seed);
    for (int i = 0; i < 20; ++i) check_edge(random, seed);
}

int main(int count, char** arguments) { return check_all(count, arguments, check_scene); }
