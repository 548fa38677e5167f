// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "shared/stretch.h"

// Pose of a camera or an object in the world, in double precision.
struct Pose {
    double position[3];
    double axis[3][3];  // world axes: right, down, forward of a camera, or x, y, z of an object

    // Axes of a rotation given by a quaternion; `two` is 2 divided by its squared norm, which normalizes it. The CPU
    // normalizes the quaternion first and passes 2, CUDA passes the quotient: they round differently, and changing
    // either would change results. Numbers may also be those of several objects, one per lane.
    template <class Number>
    static inline void axes_of(Number x, Number y, Number z, Number w, Number two, Number (*axis)[3]) {
        axis[0][0] = 1 - two * (y * y + z * z);
        axis[0][1] = two * (x * y + z * w);
        axis[0][2] = two * (x * z - y * w);
        axis[1][0] = two * (x * y - z * w);
        axis[1][1] = 1 - two * (x * x + z * z);
        axis[1][2] = two * (y * z + x * w);
        axis[2][0] = two * (x * z + y * w);
        axis[2][1] = two * (y * z - x * w);
        axis[2][2] = 1 - two * (x * x + y * y);
    }

    static inline double root(double square) {
#if defined(__CUDA_ARCH__)
        return sqrt(square);
#else
        return __builtin_sqrt(square);
#endif
    }

    // Build from x y z qx qy qz qw, with a quaternion of any norm.
    static inline Pose from(const float* row) {
        Pose pose;
        double q[4], squared = 0;
        for (int k = 0; k < 4; ++k) squared += (double)row[3 + k] * row[3 + k];
        const double scale = 1.0 / root(squared);
        for (int k = 0; k < 4; ++k) q[k] = row[3 + k] * scale;
        for (int k = 0; k < 3; ++k) pose.position[k] = row[k];
        axes_of(q[0], q[1], q[2], q[3], 2.0, pose.axis);
        return pose;
    }

    // Rotate a world direction into this pose's frame.
    inline void rotate_into(const double* direction, double* rotated) const {
        for (int k = 0; k < 3; ++k)
            rotated[k] = axis[k][0] * direction[0] + axis[k][1] * direction[1] + axis[k][2] * direction[2];
    }
    // Rotate a direction of this pose's frame into the world.
    inline void rotate_out(const double* direction, double* rotated) const {
        for (int k = 0; k < 3; ++k)
            rotated[k] = axis[0][k] * direction[0] + axis[1][k] * direction[1] + axis[2][k] * direction[2];
    }
    // Transform a world point into this pose's frame.
    inline void transform_into(const double* place, double* moved) const {
        const double from_here[3] = {place[0] - position[0], place[1] - position[1], place[2] - position[2]};
        rotate_into(from_here, moved);
    }
    // This pose in the frame of an object.
    inline Pose seen_from(const Pose& object) const {
        Pose seen;
        object.transform_into(position, seen.position);
        for (int i = 0; i < 3; ++i) object.rotate_into(axis[i], seen.axis[i]);
        return seen;
    }
    // Whether the position is inside a box (least and greatest corner) or within a margin of it along every axis.
    inline bool inside(const float* box, float margin) const { return inside(box, Stretch::none(), margin); }
    // The same for the box of a stretched object.
    inline bool inside(const float* box, const Stretch& stretch, float margin) const {
        bool inside = true;
        for (int k = 0; k < 3; ++k)
            inside &= position[k] >= box[k] * stretch.factor[k] - margin &&
                      position[k] <= box[3 + k] * stretch.factor[k] + margin;
        return inside;
    }
};
