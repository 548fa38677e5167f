// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// A camera's or an object's place in the world, in double precision.
struct Pose {
    double position[3];
    double axis[3][3];  // right, down, forward of a camera, or x, y, z of an object, in the world

    // The axes of a rotation by a quaternion; `two` is 2 divided by its squared length, which normalises it. The CPU
    // normalises first and gives 2, CUDA gives the quotient: each rounds in its own way, and so it stays.
    static inline void axes_of(double x, double y, double z, double w, double two, double (*axis)[3]) {
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

    // From x y z qx qy qz qw, of a quaternion of any length.
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

    // A direction of the world, along this pose's axes.
    inline void turn_into(const double* direction, double* turned) const {
        for (int k = 0; k < 3; ++k)
            turned[k] = axis[k][0] * direction[0] + axis[k][1] * direction[1] + axis[k][2] * direction[2];
    }
    // A direction of this pose's frame, in the world.
    inline void turn_out(const double* direction, double* turned) const {
        for (int k = 0; k < 3; ++k)
            turned[k] = axis[0][k] * direction[0] + axis[1][k] * direction[1] + axis[2][k] * direction[2];
    }
    // A place of the world, in this pose's frame.
    inline void move_into(const double* place, double* moved) const {
        const double from_here[3] = {place[0] - position[0], place[1] - position[1], place[2] - position[2]};
        turn_into(from_here, moved);
    }
    // This pose in the frame of an object.
    inline Pose seen_from(const Pose& object) const {
        Pose seen;
        object.move_into(position, seen.position);
        for (int i = 0; i < 3; ++i) object.turn_into(axis[i], seen.axis[i]);
        return seen;
    }
    // Whether it is in a box, least and greatest corner, or farther from it than a margin along no axis.
    inline bool inside(const float* box, float margin) const { return inside(box, Stretch::none(), margin); }
    // The same of a box of what is stretched.
    inline bool inside(const float* box, const Stretch& stretch, float margin) const {
        bool inside = true;
        for (int k = 0; k < 3; ++k)
            inside &= position[k] >= box[k] * stretch.factor[k] - margin &&
                      position[k] <= box[3 + k] * stretch.factor[k] + margin;
        return inside;
    }
};
