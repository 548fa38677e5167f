// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Shafts: what may block the light of a box of points.

#pragma once

#include "shared/shadow_volumes.h"

// The convex hull of the box of a packet and its light, or the box swept toward a directional light: bounds along the
// axes, and lines in the three planes of two axes that touch the box and contain, or are parallel to, the light.
struct Shaft {
    enum { LINES = 6 };

    float least[3], greatest[3];  // relative to the packet's center
    float line[LINES][2], offset[LINES];  // n.x + offset >= 0 in the shaft; axes of line i: i / 2 and the next one

    // Share of coordinates that covers their rounding in single precision, and that of the products and sums of a line.
    static constexpr float SLACK = 1e-6f;

    // The shaft of a box; the light, and the shaft, are relative to a center, as the center of the box is.
    static inline Shaft of(const LightPlace& light, const double* center, const double* half) {
        Shaft shaft;
        for (int k = 0; k < 3; ++k) shaft.set_bounds(k, light, center, half);
        for (int i = 0; i < LINES; ++i) shaft.set_line(i, light, center, half);
        return shaft;
    }
    // Half the extent of a box along an axis, with a margin for rounding.
    static inline double wider(const double* center, const double* half, int k) {
        return half[k] * (1.0 + 1e-6) + 1e-6 * size(center[k]) + 1e-30;
    }
    inline void set_bounds(int k, const LightPlace& light, const double* center, const double* half) {
        const double wide = wider(center, half, k);
        double low = -wide, high = wide;
        if (light.directional) {
            low = light.at[k] < 0 ? -(double)NOWHERE : low;
            high = light.at[k] > 0 ? (double)NOWHERE : high;
        } else {
            const double at = light.at[k] - center[k], margin = SLACK * size(at);
            low = at - margin < low ? at - margin : low;
            high = at + margin > high ? at + margin : high;
        }
        least[k] = (float)(low + center[k]), greatest[k] = (float)(high + center[k]);
    }
    inline void set_line(int index, const LightPlace& light, const double* center, const double* half) {
        const int i = index / 2, j = (i + 1) % 3;
        const double side = index % 2 ? -1.0 : 1.0, half_x = wider(center, half, i), half_y = wider(center, half, j);
        // The light, the point of the rectangle at which a line from the light touches it, and the line's normal.
        const double light_x = light.directional ? light.at[i] : light.at[i] - center[i];
        const double light_y = light.directional ? light.at[j] : light.at[j] - center[j];
        double x = 0, y = 0, normal_x = -side * light_y, normal_y = side * light_x;
        if (!light.directional) {
            const double beside = light_x > half_x ? 1.0 : light_x < -half_x ? -1.0 : 0.0;
            const double above = light_y > half_y ? 1.0 : light_y < -half_y ? -1.0 : 0.0;
            // The corners of a side that faces the light, or those at the ends of two such sides.
            x = (beside != 0 && above != 0 ? side * beside : beside != 0 ? beside : side) * half_x;
            y = (beside != 0 && above != 0 ? -side * above : beside != 0 ? side : above) * half_y;
            normal_x = light_y - y, normal_y = x - light_x;
            // The center of the rectangle is in the shaft; all of the plane is, if the light is within the rectangle.
            const double sign = normal_x * x + normal_y * y > 0 ? -1.0 : 1.0;
            const double scale = beside == 0 && above == 0 ? 0.0 : sign;
            normal_x *= scale, normal_y *= scale;
        }
        const double longest = size(normal_x) > size(normal_y) ? size(normal_x) : size(normal_y);
        const double scale = longest > 0 ? 1.0 / longest : 0.0;
        normal_x *= scale, normal_y *= scale;
        const double margin = size(normal_x) * half_x + size(normal_y) * half_y;
        const double past = light.directional ? margin : -(normal_x * x + normal_y * y);
        line[index][0] = (float)normal_x, line[index][1] = (float)normal_y;
        offset[index] = (float)(past + 4e-6 * margin + 1e-37);
        offset[index] -= (float)(line[index][0] * center[i] + line[index][1] * center[j]);
    }

    // Whether boxes, relative to the center, are not empty and may reach into the shaft. Numbers are `float`, or those
    // of several boxes, one per lane.
    template <class Number>
    inline auto meets(const Number* low, const Number* high) const {
        Number from[3], to[3];
        auto inside = low[0] <= high[0];
        for (int k = 0; k < 3; ++k) {
            from[k] = low[k] - SLACK * size(low[k]);
            to[k] = high[k] + SLACK * size(high[k]);
            inside &= (from[k] <= greatest[k]) & (to[k] >= least[k]);
        }
        for (int i = 0; i < LINES; ++i) {
            const int x = i / 2, y = (x + 1) % 3;
            const Number farthest =
                (line[i][0] < 0.0f ? from[x] : to[x]) * line[i][0] + (line[i][1] < 0.0f ? from[y] : to[y]) * line[i][1];
            inside &= farthest + offset[i] >= 0.0f;
        }
        return inside;
    }

    template <class Number>
    static inline Number size(Number a) {
        return a < Number() ? -a : a;
    }
};
