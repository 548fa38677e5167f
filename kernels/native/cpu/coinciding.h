// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/number_lanes.h"
#include "cpu/rows.h"
#include "shared/pose.h"
#include "shared/triples.h"

// Finds pixels of a row whose visible point may be on a later object: all others need no exact test. `Call` is a
// `LaterCall` of kernels/mujoco/coinciding_rows.py.
template <class Call>
struct PairRow {
    typedef Triple<PixelLanes> Vector;
    enum { ALWAYS, WHERE_TOGETHER };
    // Error of points in single precision, and tolerance of the exact test, relative to all distances.
    static constexpr float MAX_ERROR = 2e-5f;

    const Call& call;
    const int* objects;
    const float* depth;
    int view, y, width, world;
    Pose camera;

    template <class Image>
    static inline PairRow of(const Call& call, const Image& segmentation, int view, int y) {
        const int width = segmentation.shape[2];
        const long long first = ((long long)view * segmentation.shape[1] + y) * width;
        const auto& worlds = call.worlds;
        int world = worlds.world.data ? worlds.world.data[view] : (worlds.object_poses.shape[0] == 1 ? 0 : view);
        if (world < 0 || world >= worlds.object_poses.shape[0]) world = -1;
        return PairRow{call,
                       segmentation.data + first,
                       call.depth.data + first,
                       view,
                       y,
                       width,
                       world,
                       Pose::from((const float*)(call.camera_to_world.data + view))};
    }

    // One bit for each of the pixels from x on.
    inline unsigned candidates(int x) const {
        const int count = width - x;
        const Ints object = PixelLanes::load(objects + x, count);
        unsigned remaining = Lanes::bits((object >= 0) & (Lanes::index() < count)), found = 0;
        while (remaining) {
            const int shown = object[Lanes::first_lane(remaining)];
            const unsigned same = Lanes::bits(object == shown) & remaining;
            remaining &= ~same;
            const int first = call.coinciding.first_pair.data[shown];
            for (int pair = first; pair < call.coinciding.first_pair.data[shown + 1]; ++pair)
                if (same & ~found) found |= same & near_pair(pair, x, count);
        }
        return found;
    }

  private:
    // The pixels whose point is near the box in which the objects of a pair coincide; all without numbers.
    inline unsigned near_pair(int pair, int x, int count) const {
        const auto& pairs = call.coinciding;
        const unsigned all = (1u << LANES) - 1u;
        if (pairs.mode.data[pair] <= WHERE_TOGETHER) return all;
        const int column = pairs.column.data[pairs.later.data[pair]];
        if (column >= 0 && world < 0) return all;
        const Vector path = path_of(x, count);
        Vector place = path + Vector{Lanes::all((float)camera.position[0]), Lanes::all((float)camera.position[1]),
                                     Lanes::all((float)camera.position[2])};
        Floats reach = path.length() + place.length();
        if (column >= 0) {
            const auto& poses = call.worlds.object_poses;
            const Pose pose = Pose::from((const float*)(poses.data + (long long)world * poses.shape[1] + column));
            const float at[3] = {(float)pose.position[0], (float)pose.position[1], (float)pose.position[2]};
            reach = reach + Vector::of(at).length();
            const Vector offset = place.minus(at);
            place = Vector{turned(pose, 0, offset), turned(pose, 1, offset), turned(pose, 2, offset)};
        }
        reach = reach * MAX_ERROR;
        const auto low = pairs.low.data[pair], high = pairs.high.data[pair];
        const Ints outside = (place.x < low[0] - reach) | (place.x > high[0] + reach) | (place.y < low[1] - reach) |
                             (place.y > high[1] + reach) | (place.z < low[2] - reach) | (place.z > high[2] + reach);
        return all & ~Lanes::bits(outside);
    }
    // The way from the camera to the visible points.
    inline Vector path_of(int x, int count) const {
        const auto& lens = call.camera;
        const double down = (y + 0.5 - lens.cy) / lens.fy, left = (0.5 - lens.cx) / lens.fx;
        const Floats across = PixelLanes::columns(x) * (float)(1.0 / lens.fx) + (float)left;
        const auto along = [&](int k) {
            const double rest = camera.axis[1][k] * down + camera.axis[2][k];
            return across * (float)camera.axis[0][k] + (float)rest;
        };
        return Vector{along(0), along(1), along(2)} * PixelLanes::load(depth + x, count);
    }
    static inline Floats turned(const Pose& pose, int k, const Vector& offset) {
        const float axis[3] = {(float)pose.axis[k][0], (float)pose.axis[k][1], (float)pose.axis[k][2]};
        return offset.dot(axis);
    }
};

template <class Call, class Image>
inline unsigned coinciding_pixels(const Call& call, const Image& segmentation, int view, int y, int x) {
    return PairRow<Call>::of(call, segmentation, view, y).candidates(x);
}
