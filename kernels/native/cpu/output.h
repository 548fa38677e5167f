// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// From w and id of every pixel to depth, points, normals, labels and objects, each written once.

struct Job {
    int views, height, width;
    int strips;  // of a view
    const int* strip_rows;  // where they begin, and where the last one ends; multiples of 16, but for that
    int most_rows;  // of a strip
    double focal[2], center[2];
    float near, far;
    bool cull_back_faces;
    const float* poses;  // [view]: x y z qx qy qz qw
    const float* closed_boxes;  // of closed objects that stay: least and greatest corner
    const int* closed_object;  // which they are
    int closed_count;
    int points;  // of a view, where rays go through points instead of pixels, or 0
    const float* at;  // [view][point]: x and y in pixels
};

// Rows of sixteen pixels on their way out; only `count` of them where the image ends.
struct Write {
    // Past the caches, where a whole line of one is written: what is rendered is not read again here.
    static inline bool aligned(const void* to) { return ((unsigned long long)to & 63) == 0; }
    static inline void stream(float* to, Floats value) {
        if (aligned(to))
            __builtin_nontemporal_store(value, (Floats*)to);
        else
            Lanes::store(to, value);
    }
    static inline void stream(int* to, Ints value) {
        if (aligned(to))
            __builtin_nontemporal_store(value, (Ints*)to);
        else
            Lanes::store(to, value);
    }
    static inline void row(float* to, Floats value, int count) {
        if (count == 16)
            stream(to, value);
        else
            for (int i = 0; i < count; ++i) to[i] = value[i];
    }
    static inline void row(int* to, Ints value, int count) {
        if (count == 16)
            stream(to, value);
        else
            for (int i = 0; i < count; ++i) to[i] = value[i];
    }
    // x0 y0 z0 x1 y1 z1 ...: first x and y are put in place, then z between them.
    static inline void row(float* to, Points p, int count) {
        if (count < 16) {
            for (int i = 0; i < count; ++i) {
                to[3 * i] = p.x[i];
                to[3 * i + 1] = p.y[i];
                to[3 * i + 2] = p.z[i];
            }
            return;
        }
        const Floats a = __builtin_shufflevector(p.x, p.y, 0, 16, 0, 1, 17, 0, 2, 18, 0, 3, 19, 0, 4, 20, 0, 5);
        const Floats b = __builtin_shufflevector(p.x, p.y, 21, 0, 6, 22, 0, 7, 23, 0, 8, 24, 0, 9, 25, 0, 10, 26);
        const Floats c = __builtin_shufflevector(p.x, p.y, 0, 11, 27, 0, 12, 28, 0, 13, 29, 0, 14, 30, 0, 15, 31, 0);
        stream(to, __builtin_shufflevector(a, p.z, 0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15));
        stream(to + 16, __builtin_shufflevector(b, p.z, 0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15));
        stream(to + 32, __builtin_shufflevector(c, p.z, 26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31));
    }
};

// Four blocks of 4 x 4 to four rows of 16.
struct Four {
    static inline void transpose(const float* blocks, Floats* rows) {
        const Floats a = Lanes::load(blocks), b = Lanes::load(blocks + 16);
        const Floats c = Lanes::load(blocks + 32), d = Lanes::load(blocks + 48);
        const Floats ab01 = __builtin_shufflevector(a, b, 0, 1, 2, 3, 16, 17, 18, 19, 4, 5, 6, 7, 20, 21, 22, 23);
        const Floats cd01 = __builtin_shufflevector(c, d, 0, 1, 2, 3, 16, 17, 18, 19, 4, 5, 6, 7, 20, 21, 22, 23);
        const Floats ab23 = __builtin_shufflevector(a, b, 8, 9, 10, 11, 24, 25, 26, 27, 12, 13, 14, 15, 28, 29, 30, 31);
        const Floats cd23 = __builtin_shufflevector(c, d, 8, 9, 10, 11, 24, 25, 26, 27, 12, 13, 14, 15, 28, 29, 30, 31);
        rows[0] = __builtin_shufflevector(ab01, cd01, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23);
        rows[1] = __builtin_shufflevector(ab01, cd01, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31);
        rows[2] = __builtin_shufflevector(ab23, cd23, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23);
        rows[3] = __builtin_shufflevector(ab23, cd23, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31);
    }
    // Integers ride along as floats: nothing is computed with them.
    static inline void transpose(const int* blocks, Ints* rows) { transpose((const float*)blocks, (Floats*)rows); }
};

// The world's axes as the camera's rays need them: a ray is forward + u * right + v * down.
struct Rays {
    float right[3], down[3], forward[3];

    inline Points at(Floats u, float v) const {
        return Points{u * right[0] + (v * down[0] + forward[0]), u * right[1] + (v * down[1] + forward[1]),
                      u * right[2] + (v * down[2] + forward[2])};
    }
};

struct Strip {
    // Normals of what a row of pixels shows, from u and v of the first one on.
    static inline Points normals(Lookup& lookup, Ints ids, Ints seen, double u, double v) {
        if (!lookup.moving) return triangle_normals(lookup, ids, Lanes::bits(seen));
        const Doubles column = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
        const Floats none = Lanes::all(0.0f);
        Points round = {none, none, none};
        const Ints solid = lookup.solid_normals(ids, seen, u + column, v + (Doubles)(0.0), round);
        const Points n = triangle_normals(lookup, ids, Lanes::bits(seen & ~solid));
        return Points{solid ? round.x : n.x, solid ? round.y : n.y, solid ? round.z : n.z};
    }

    // Normals of the triangles that it shows; neighbours mostly share one.
    static inline Points triangle_normals(Lookup& lookup, Ints ids, unsigned seen) {
        int id[16], previous = -1;
        float n[3][16], last[3] = {0, 0, 0};
        Lanes::store(id, ids);
        for (int k = 0; k < 16; ++k) {
            const bool here = (seen >> k) & 1;
            if (here && id[k] != previous) lookup.normal_of(previous = id[k], last);
            for (int c = 0; c < 3; ++c) n[c][k] = here ? last[c] : __builtin_nanf("");
        }
        return Points{Lanes::load(n[0]), Lanes::load(n[1]), Lanes::load(n[2])};
    }

    // Objects of a block's pixels, -1 where nothing is seen; `id` holds triangles or already objects.
    static inline Ints objects(Lookup& lookup, Ints id, Ints seen, bool owner_id) {
        if (owner_id) return seen ? id : Lanes::all_ints(-1);
        int of[16];
        Lanes::store(of, id);
        for (unsigned left = Lanes::bits(seen); left; left &= left - 1) {
            const int k = Lanes::first_lane(left);
            of[k] = lookup.object_of(of[k]);
        }
        return seen ? Lanes::load(of) : Lanes::all_ints(-1);
    }

    // Neighbours mostly show one object.
    static inline void labels(unsigned char* to, const unsigned char* object_label, Ints objects, int count) {
        int object[16], previous = -1;
        unsigned char label = 0;
        Lanes::store(object, objects);
        for (int k = 0; k < count; ++k) {
            if (object[k] != previous) label = (previous = object[k]) < 0 ? 0 : object_label[object[k]];
            to[k] = label;
        }
    }

    // Write sixteen pixels of a row, once, to each image that was asked for.
    static inline void write_row(Lookup& lookup, const Eye& eye, const Rays& rays, const Image& image, const Job& job,
                                 const Images& out, long long view, int x, int y, Floats w, Ints id, bool owner_id) {
        const Floats column = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
        const int count = image.width - x < 16 ? image.width - x : 16;
        const long long at = (view * job.height + image.first_row + y) * job.width + x;

        const Floats z = 1.0f / w, infinity = Lanes::all(__builtin_inff());
        const Ints far_enough = z >= Lanes::all(job.near);
        const Ints seen = far_enough & (z <= Lanes::all(job.far)) & (w > Lanes::all(0.0f));
        if (out.depth) Write::row(out.depth + at, seen ? z : (far_enough ? infinity : -infinity), count);
        if (out.points) {
            const Points ray = rays.at((column + (float)x) + eye.first_u, (float)(y + image.first_row) + eye.first_v);
            const Floats reach = seen ? z : Lanes::all(__builtin_nanf(""));
            const Points point = {reach * ray.x + eye.origin[0], reach * ray.y + eye.origin[1],
                                  reach * ray.z + eye.origin[2]};
            Write::row(out.points + at * 3, point, count);
        }
        if (out.normals) {
            const double u = x + 0.5 - job.center[0], v = y + image.first_row + 0.5 - job.center[1];
            Write::row(out.normals + at * 3, normals(lookup, id, seen, u, v), count);
        }
        if (!(out.segmentation || out.labels)) return;
        const Ints object = objects(lookup, id, seen, owner_id);
        if (out.segmentation) Write::row(out.segmentation + at, object, count);
        if (out.labels) labels(out.labels + at, out.object_label, object, count);
    }

    // Four rows of pixels, out of a row of blocks, which are left empty. They wait in memory that stays in cache, so
    // that the images are written from beginning to end: four places at a time are twice as slow.
    static inline void write(Lookup& lookup, const Eye& eye, const Rays& rays, const Image& image, const Job& job,
                             const Images& out, long long view, bool with_id, bool owner_id) {
        const int stride = image.tiles_x * 16;
        for (int y = 0; y < image.height; y += 4) {
            for (int x = 0; x < image.width; x += 16) {
                const int first = Image::column_part(x) + image.row_part(y);
                Floats w[4];
                Four::transpose(image.w + first, w);
                for (int r = 0; r < 4; ++r) Lanes::store(image.rows + r * stride + x, w[r]);
                for (int block = 0; block < 4; ++block) Lanes::store(image.w + first + block * 16, Lanes::all(0.0f));
                if (!with_id) continue;
                Ints id[4];
                Four::transpose(image.id + first, id);
                for (int r = 0; r < 4; ++r) Lanes::store(image.id_rows + r * stride + x, id[r]);
            }
            const int rows = image.height - y < 4 ? image.height - y : 4;
            for (int r = 0; r < rows; ++r)
                for (int x = 0; x < image.width; x += 16) {
                    const int at = r * stride + x;
                    const Ints id = with_id ? Lanes::load(image.id_rows + at) : Lanes::all_ints(0);
                    write_row(lookup, eye, rays, image, job, out, view, x, y + r, Lanes::load(image.rows + at), id,
                              owner_id);
                }
        }
    }
};
