// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The objects of a view's world that it may see. Each has a tree in its own frame, into which the camera is moved:
// rigid motion changes neither depths nor where things are in the image, and moving an object rebuilds nothing.

// Sixteen objects' boxes in camera space: their centres, and half of each of their edges.
struct MovedBoxes {
    Points center, half[3];

    // A column of sixteen rows; the last one again where there are fewer.
    static inline Doubles column(const float* rows, int stride, int last) {
        float value[16];
        for (int k = 0; k < 16; ++k) value[k] = rows[(k < last ? k : last) * stride];
        return __builtin_convertvector(Lanes::load(value), Doubles);
    }
    static inline Floats narrow(Doubles value) { return __builtin_convertvector(value, Floats); }

    // The axes of sixteen objects in the world, of quaternions of any length.
    static inline void axes(const float* row, int last, Doubles (*axis)[3]) {
        const Doubles x = column(row + 3, 7, last), y = column(row + 4, 7, last), z = column(row + 5, 7, last),
                      w = column(row + 6, 7, last);
        const Doubles s = 2.0 / ((x * x + y * y) + (z * z + w * w));
        axis[0][0] = 1.0 - s * (y * y + z * z);
        axis[0][1] = s * (x * y + z * w);
        axis[0][2] = s * (x * z - y * w);
        axis[1][0] = s * (x * y - z * w);
        axis[1][1] = 1.0 - s * (x * x + z * z);
        axis[1][2] = s * (y * z + x * w);
        axis[2][0] = s * (x * z + y * w);
        axis[2][1] = s * (y * z - x * w);
        axis[2][2] = 1.0 - s * (x * x + y * y);
    }

    // Centres in double precision: an object may be far from the origin of its frame, which may be far from the world's.
    static inline MovedBoxes of(const float* box, const float* row, int last, const Pose& camera, const Eye& eye,
                                const double* focal) {
        MovedBoxes moved;
        Doubles axis[3][3], center[3];
        axes(row, last, axis);
        for (int k = 0; k < 3; ++k) center[k] = column(row + k, 7, last) - camera.position[k];
        for (int i = 0; i < 3; ++i) {
            const Doubles low = column(box + i, 6, last), high = column(box + 3 + i, 6, last);
            for (int k = 0; k < 3; ++k) center[k] += axis[i][k] * (0.5 * (low + high));
            const Floats size = narrow(0.5 * (high - low));
            const Points edge = {narrow(axis[i][0]) * size, narrow(axis[i][1]) * size, narrow(axis[i][2]) * size};
            moved.half[i] = Eye::turn(eye, edge);  // in the world's frame nothing is left of the origin
        }
        const ExactRow* m = camera.axis;
        moved.center.x = narrow((m[0][0] * center[0] + m[0][1] * center[1] + m[0][2] * center[2]) * focal[0]);
        moved.center.y = narrow((m[1][0] * center[0] + m[1][1] * center[1] + m[1][2] * center[2]) * focal[1]);
        moved.center.z = narrow(m[2][0] * center[0] + m[2][1] * center[1] + m[2][2] * center[2]);
        return moved;
    }

    // Whether the boxes reach to the inner side of a plane through the camera.
    inline Ints reach(float x, float y, float z) const {
        Floats farthest = x * center.x + (y * center.y + z * center.z);
        for (int i = 0; i < 3; ++i) farthest += Lanes::size(x * half[i].x + (y * half[i].y + z * half[i].z));
        return farthest >= Lanes::all(0.0f);
    }

    // Where they are in the image.
    inline Bounds bounds(const Eye& eye, const Image& image, float center_x, float center_y, Ints shown) const {
        shown &= reach(0.0f, 0.0f, 1.0f) & reach(1.0f, 0.0f, center_x) & reach(-1.0f, 0.0f, image.width - center_x) &
                 reach(0.0f, 1.0f, center_y) & reach(0.0f, -1.0f, image.height - center_y);
        const Points zero = {Lanes::all(0.0f), Lanes::all(0.0f), Lanes::all(0.0f)};
        Points term[3][2];
        for (int i = 0; i < 3; ++i) {
            const Points middle = i == 0 ? center : zero;
            term[i][0] = Points::minus(middle, half[i]);
            term[i][1] = Points::plus(middle, half[i]);
        }
        return Bounds::of(term, eye.far, image, center_x, center_y, shown);
    }
};

// Movable objects that a view may see, as visits of which the child is the object.
struct Queue {
    Visit* visits;
    int* order;  // the nearest first
    int count;

    inline void fill(const Movables& movables, const World& world, const Pose& camera, const Eye& eye,
                     const Image& image, const double* focal, float center_x, float center_y) {
        const Ints lane = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
        for (int first = 0; first < movables.count; first += 16) {
            const int last = movables.count - 1 - first;
            const float* box = movables.boxes + (long long)first * 6;
            const float* row = world.poses + (long long)first * 7;
            const MovedBoxes boxes = MovedBoxes::of(box, row, last, camera, eye, focal);
            add(movables, world, first, boxes.bounds(eye, image, center_x, center_y, lane <= Lanes::all_ints(last)));
        }
        sort();
    }

    inline void add(const Movables& movables, const World& world, int first, const Bounds& bounds) {
        if (!Lanes::any(bounds.shown)) return;
        float near[16];
        int x0[16], y0[16], x1[16], y1[16];
        // A little nearer than the boxes of the trees inside: these corners come of longer sums.
        Lanes::store(near, bounds.nearest_w * 1.0001f);
        bounds.store(x0, y0, x1, y1);
        for (unsigned rest = Lanes::bits(bounds.shown); rest; rest &= rest - 1) {
            const int k = Lanes::first_lane(rest);
            if (world.excludes(movables.object[first + k])) continue;
            visits[count++] = Visit{first + k, near[k], x0[k], y0[k], x1[k], y1[k]};
        }
    }

    // By eighths of powers of two, which is near enough: the order changes the time, not the image.
    enum { bucket_bits = 20, buckets = 256 };
    static inline int bucket(float w) {
        const int middle = 127 << 3;  // of w = 1
        int bits;
        __builtin_memcpy(&bits, &w, sizeof bits);
        const int place = middle + 64 - (bits >> bucket_bits);
        return place < 0 ? 0 : place < buckets ? place : buckets - 1;
    }
    inline void sort() {
        int start[buckets + 1];
        if (count < 2) {
            order[0] = 0;
            return;
        }
        for (int b = 0; b <= buckets; ++b) start[b] = 0;
        for (int i = 0; i < count; ++i) start[bucket(visits[i].nearest_w) + 1] += 1;
        for (int b = 0; b < buckets; ++b) start[b + 1] += start[b];
        for (int i = 0; i < count; ++i) order[start[bucket(visits[i].nearest_w)]++] = i;
    }
};
