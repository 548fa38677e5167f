// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Down the cluster tree, nearest first, past what is outside the view or hidden behind what has been drawn.

// A node or leaf to visit: where it is in the image, and how near it may be.
struct Visit {
    int child;
    float nearest_w;
    int x0, y0, x1, y1;
};

// The view's pyramid: a point relative to the rounded origin is inside where all five are greater than `least`.
struct Pyramid {
    float plane[5][3], least[5];
};

// Where sixteen boxes are in the image.
struct Bounds {
    Floats nearest_w, left, top, right, bottom;
    Ints shown;

    // Of the boxes' corners in camera space, as sums of one term an axis.
    static inline Bounds of(const Points (*term)[2], float far, const Image& image, float center_x, float center_y,
                            Ints shown) {
        Floats zmin = Lanes::all(0.0f), size = Lanes::all(0.0f);
        for (int axis = 0; axis < 3; ++axis) {
            zmin += Lanes::least(term[axis][0].z, term[axis][1].z);
            size += Lanes::most(__builtin_elementwise_abs(term[axis][0].z), __builtin_elementwise_abs(term[axis][1].z));
        }
        shown &= zmin <= Lanes::all(far);
        const Ints crossing = zmin <= 0.01f * size;

        Floats left = Lanes::all(3e38f), right = -left, top = left, bottom = -left;
        for (int corner = 0; corner < 8; ++corner) {
            const Points p =
                Points::plus(Points::plus(term[0][corner & 1], term[1][(corner >> 1) & 1]), term[2][corner >> 2]);
            const Floats inverse = 1.0f / (crossing ? Lanes::all(1.0f) : p.z);
            const Floats x = p.x * inverse, y = p.y * inverse;
            left = Lanes::least(left, x);
            right = Lanes::most(right, x);
            top = Lanes::least(top, y);
            bottom = Lanes::most(bottom, y);
        }
        // Bounds in pixels, wider than rounding can be wrong; boxes that reach behind the camera may be anywhere.
        const float slack = 0.1f + 2e-4f * (float)(image.width + image.height);
        const Floats none = Lanes::all(0.0f), wide = Lanes::all((float)(image.width - 1)),
                     tall = Lanes::all((float)(image.height - 1));
        left = Lanes::most(crossing ? none : left + (center_x - slack), none);
        top = Lanes::most(crossing ? none : top + (center_y - slack), none);
        right = crossing ? wide : right + (center_x + slack);
        bottom = crossing ? tall : bottom + (center_y + slack);
        shown &= (left < wide + 1.0f) & (top < tall + 1.0f) & (right >= none) & (bottom >= none);
        const Floats nearest_w = crossing ? Lanes::all(3e38f) : 1.00001f / zmin;
        return Bounds{nearest_w,
                      Lanes::least(left, wide),
                      Lanes::least(top, tall),
                      Lanes::least(right, wide),
                      Lanes::least(bottom, tall),
                      shown};
    }

    inline void store(int* x0, int* y0, int* x1, int* y1) const {
        const Floats none = Lanes::all(0.0f);
        Lanes::store(x0, __builtin_convertvector(shown ? left : none, Ints));
        Lanes::store(y0, __builtin_convertvector(shown ? top : none, Ints));
        Lanes::store(x1, __builtin_convertvector(shown ? right : none, Ints));
        Lanes::store(y1, __builtin_convertvector(shown ? bottom : none, Ints));
    }
};

struct View {
    static inline Eye eye(const Pose& pose, const Job& job) {
        Eye eye;
        for (int k = 0; k < 3; ++k) {
            eye.exact_origin[k] = pose.position[k];
            eye.origin[k] = (float)pose.position[k];
            for (int i = 0; i < 3; ++i) {
                const double f = i < 2 ? job.focal[i] : 1.0;
                eye.to_camera[i][k] = (float)(pose.axis[i][k] * f);
                eye.exact_to_camera[i][k] = pose.axis[i][k] / f;
            }
        }
        for (int i = 0; i < 3; ++i) {
            double rest = 0.0;
            for (int k = 0; k < 3; ++k) rest += pose.axis[i][k] * (eye.exact_origin[k] - eye.origin[k]);
            eye.rest[i] = (float)(i < 2 ? rest * job.focal[i] : rest);
        }
        eye.first_u = (float)(0.5 - job.center[0]);
        eye.first_v = (float)(0.5 - job.center[1]);
        eye.far = job.far * 1.00001f;
        eye.blur = 6e-8f * ((float)(job.focal[0] + job.focal[1]) + (float)(job.width + job.height));
        eye.excluded = nullptr;
        return eye;
    }

    static inline Pyramid pyramid(const Eye& eye, const Image& image, float center_x, float center_y) {
        Pyramid pyramid;
        const Row* m = eye.to_camera;
        for (int k = 0; k < 3; ++k) {
            pyramid.plane[0][k] = m[2][k];
            pyramid.plane[1][k] = m[0][k] + center_x * m[2][k];
            pyramid.plane[2][k] = (image.width - center_x) * m[2][k] - m[0][k];
            pyramid.plane[3][k] = m[1][k] + center_y * m[2][k];
            pyramid.plane[4][k] = (image.height - center_y) * m[2][k] - m[1][k];
        }
        const float* rest = eye.rest;
        pyramid.least[0] = rest[2];
        pyramid.least[1] = rest[0] + center_x * rest[2];
        pyramid.least[2] = (image.width - center_x) * rest[2] - rest[0];
        pyramid.least[3] = rest[1] + center_y * rest[2];
        pyramid.least[4] = (image.height - center_y) * rest[2] - rest[1];
        return pyramid;
    }

    static inline Rays rays(const Eye& eye) {
        Rays rays;
        for (int k = 0; k < 3; ++k) {
            rays.right[k] = (float)eye.exact_to_camera[0][k];
            rays.down[k] = (float)eye.exact_to_camera[1][k];
            rays.forward[k] = (float)eye.exact_to_camera[2][k];
        }
        return rays;
    }

    // Whether the camera is outside the boxes of all closed objects that stay where they are and may be seen, so that
    // their back faces are hidden behind their front faces.
    static inline bool outside_all(const Job& job, const World& world, const Pose& pose) {
        for (int i = 0; i < job.closed_count; ++i)
            if (pose.inside(job.closed_boxes + i * 6) && !world.excludes(job.closed_object[i])) return false;
        return true;
    }
};

struct Walk {
    static inline Floats farthest_along(const float* plane, Points low, Points high) {
        return Lanes::most(plane[0] * low.x, plane[0] * high.x) +
               (Lanes::most(plane[1] * low.y, plane[1] * high.y) + Lanes::most(plane[2] * low.z, plane[2] * high.z));
    }

    // All triangles of the child face away: the directions from the camera to anywhere in its box make less than a right
    // angle with every normal in the cone.
    static inline Ints faces_away(const float* node, Points low, Points high) {
        const Points to_center = Points{0.5f * (low.x + high.x), 0.5f * (low.y + high.y), 0.5f * (low.z + high.z)};
        const Points half = Points{0.5f * (high.x - low.x), 0.5f * (high.y - low.y), 0.5f * (high.z - low.z)};
        const Points axis = Points{Lanes::load(node + 96), Lanes::load(node + 112), Lanes::load(node + 128)};
        const Floats distance = __builtin_elementwise_sqrt(Points::dot(to_center, to_center));
        const Floats radius = __builtin_elementwise_sqrt(Points::dot(half, half));
        return Points::dot(to_center, axis) >= Lanes::load(node + 144) * distance + 1.0001f * radius;
    }

    // The children of a node that may be seen, as visits, the nearest last; returns how many.
    static inline int open(const Tree& tree, const Eye& eye, const Pyramid& pyramid, const Image& image, float center_x,
                           float center_y, int index, Visit* out) {
        const float* node = tree.nodes + (long long)index * 160;
        const Floats low_x = Lanes::load(node), high_x = Lanes::load(node + 48);
        const Points low = Eye::relative(eye, low_x, Lanes::load(node + 16), Lanes::load(node + 32));
        const Points high = Eye::relative(eye, high_x, Lanes::load(node + 64), Lanes::load(node + 80));
        Ints shown = low_x <= high_x;
        for (int p = 0; p < 5; ++p)
            shown &= farthest_along(pyramid.plane[p], low, high) >= Lanes::all(pyramid.least[p]);
        if (eye.skip_back_faces) shown &= ~faces_away(node, low, high);
        if (!Lanes::any(shown)) return 0;

        // The eight corners in camera space, as sums of one term an axis.
        Points term[3][2];
        for (int k = 0; k < 2; ++k) {
            const Points corner = k ? high : low;
            const Row* m = eye.to_camera;
            term[0][k] = Points{m[0][0] * corner.x, m[1][0] * corner.x, m[2][0] * corner.x};
            term[1][k] = Points{m[0][1] * corner.y, m[1][1] * corner.y, m[2][1] * corner.y};
            term[2][k] = Points{m[0][2] * corner.z - eye.rest[0], m[1][2] * corner.z - eye.rest[1],
                                m[2][2] * corner.z - eye.rest[2]};
        }
        const Bounds bounds = Bounds::of(term, eye.far, image, center_x, center_y, shown);
        const unsigned found = Lanes::bits(bounds.shown);
        float near[16];
        int x0[16], y0[16], x1[16], y1[16], place[16];
        Lanes::store(near, bounds.nearest_w);
        Lanes::store(place, places(bounds.shown ? bounds.nearest_w : Lanes::all(3.2e38f)));
        bounds.store(x0, y0, x1, y1);
        for (unsigned rest = found; rest; rest &= rest - 1) {
            const int k = Lanes::first_lane(rest);
            out[place[k]] = Visit{tree.children[index * 16 + k], near[k], x0[k], y0[k], x1[k], y1[k]};
        }
        return __builtin_popcount(found);
    }

    // Where each lane's value stands among all of them in ascending order; of equal ones, the lesser lane first. Counting
    // takes no branches, which a sort would mispredict.
    static inline Ints places(Floats values) {
        const Ints lane = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
        Ints place = Lanes::all_ints(0);
        for (int other = 0; other < 16; ++other) {
            const Floats value = Lanes::all(values[other]);
            place -= (value < values) | ((value == values) & (lane > other));
        }
        return place;
    }

    // Of a tree of one leaf, that leaf: its node is no smaller.
    static inline int begin(const Tree& tree, int root, Visit* stack) {
        const int* children = tree.children + (long long)root * 16;
        if (children[0] >= 0 || children[1] != 0) return 0;
        stack[0] = Visit{children[0], 3e38f, 0, 0, 0, 0};  // as near as can be: nothing hides it
        return 1;
    }

    // Ask for what is visited next while this one is at work.
    static inline void fetch(const Tree& tree, int child) {
        const char* rows =
            (const char*)(child >= 0 ? tree.nodes + (long long)child * 160 : tree.leaves + (long long)~child * 144);
        for (int line = 0; line < 9; ++line) __builtin_prefetch(rows + line * 64);
    }

    // Draw all that is seen. `stack` has room for every level of the tree at its widest.
    static inline void draw(const Tree& tree, const Piece& piece, const Eye& eye, const Pyramid& pyramid,
                            const Image& image, float center_x, float center_y, Visit* stack, bool with_id,
                            bool owner_id) {
        int depth = begin(tree, piece.root, stack);
        if (depth == 0) depth = open(tree, eye, pyramid, image, center_x, center_y, piece.root, stack);
        while (depth > 0) {
            const Visit visit = stack[--depth];
            if (depth > 0) fetch(tree, stack[depth - 1].child);
            if (image.hides(visit.x0, visit.y0, visit.x1, visit.y1, visit.nearest_w)) continue;
            if (visit.child >= 0) {
                depth += open(tree, eye, pyramid, image, center_x, center_y, visit.child, stack + depth);
                continue;
            }
            const long long leaf = ~visit.child;
            Cluster cluster;
            cluster.corners = tree.leaves + leaf * 144;
            cluster.owners = piece.owners + leaf * piece.owner_step;
            cluster.first_id = (int)leaf * 16 + piece.number;
            if (!Setup::cluster(eye, image, center_x, center_y, cluster)) continue;
            if (image.first_packet)
                Sparse::draw(eye, image, cluster, Raster::loses_digits(eye, cluster) | Raster::turns(eye, cluster),
                             owner_id);
            else
                Raster::draw(eye, image, cluster, with_id, owner_id);
        }
    }
};
