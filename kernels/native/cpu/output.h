// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Conversion of inv_z and id of every pixel to depth, points, normals, labels, segmentation and faces.

#pragma once

#include "cpu/scene.h"
#include "shared/images.h"

// Stores of LANES pixels of a row, or of `count` at the end of a row.
struct Write {
    // Whole cache lines are stored with non-temporal hints, which bypass the caches: this code does not read the images
    // again.
    static inline bool aligned(const void* to) { return ((unsigned long long)to & (Arena::ALIGNMENT - 1)) == 0; }
    template <class Number, class Values>
    static inline void stream(Number* to, Values value) {
        if (aligned(to))
            __builtin_nontemporal_store(value, (Values*)to);
        else
            Lanes::store(to, value);
    }
    template <class Number, class Values>
    static inline void row(Number* to, Values value, int count) {
        if (count == LANES)
            stream(to, value);
        else
            for (int i = 0; i < count; ++i) to[i] = value[i];
    }
    static inline void row(float* to, Points p, int count) {
        if (count < LANES) {
            for (int i = 0; i < count; ++i) {
                to[3 * i] = p.x[i];
                to[3 * i + 1] = p.y[i];
                to[3 * i + 2] = p.z[i];
            }
            return;
        }
        Floats rows[3];
        Points::interleave(p, rows);
        for (int k = 0; k < 3; ++k) stream(to + k * LANES, rows[k]);
    }

    // Store values of four bytes; runs of `run` lanes are contiguous in memory.
    static inline void put(float* to, const int* place, int run, Floats value) {
        float lanes[LANES];
        Lanes::store(lanes, value);
        if (run == LANES) {
            __builtin_memcpy(to + place[0], lanes, sizeof lanes);
        } else if (run == LANES / 2) {
            for (int k = 0; k < LANES; k += LANES / 2) __builtin_memcpy(to + place[k], lanes + k, sizeof lanes / 2);
        } else if (run == LANES / 4) {
            for (int k = 0; k < LANES; k += LANES / 4) __builtin_memcpy(to + place[k], lanes + k, sizeof lanes / 4);
        } else {
            for (int k = 0; k < LANES; ++k)
                if (place[k] >= 0) to[place[k]] = lanes[k];
        }
    }
    static inline void put(float* to, const int* place, const Points& value) {
        float x[LANES], y[LANES], z[LANES];
        Lanes::store(x, value.x);
        Lanes::store(y, value.y);
        Lanes::store(z, value.z);
        for (int k = 0; k < LANES; ++k) {
            if (place[k] < 0) continue;
            float* target = to + 3LL * place[k];
            target[0] = x[k];
            target[1] = y[k];
            target[2] = z[k];
        }
    }
};

// Conversion of horizontally adjacent blocks of a tile to rows of pixels.
struct Blocks {
    static inline void transpose(const float* blocks, Floats* rows) {
        const Floats a = Lanes::load(blocks), b = Lanes::load(blocks + BLOCK_PIXELS);
        const Floats c = Lanes::load(blocks + 2 * BLOCK_PIXELS), d = Lanes::load(blocks + 3 * BLOCK_PIXELS);
        const Floats ab01 = __builtin_shufflevector(a, b, 0, 1, 2, 3, 16, 17, 18, 19, 4, 5, 6, 7, 20, 21, 22, 23);
        const Floats cd01 = __builtin_shufflevector(c, d, 0, 1, 2, 3, 16, 17, 18, 19, 4, 5, 6, 7, 20, 21, 22, 23);
        const Floats ab23 = __builtin_shufflevector(a, b, 8, 9, 10, 11, 24, 25, 26, 27, 12, 13, 14, 15, 28, 29, 30, 31);
        const Floats cd23 = __builtin_shufflevector(c, d, 8, 9, 10, 11, 24, 25, 26, 27, 12, 13, 14, 15, 28, 29, 30, 31);
        rows[0] = __builtin_shufflevector(ab01, cd01, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23);
        rows[1] = __builtin_shufflevector(ab01, cd01, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31);
        rows[2] = __builtin_shufflevector(ab23, cd23, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23);
        rows[3] = __builtin_shufflevector(ab23, cd23, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31);
    }
    // Integers are passed as floats: no arithmetic is done with them.
    static inline void transpose(const int* blocks, Ints* rows) { transpose((const float*)blocks, (Floats*)rows); }
};

// Cache of triangle normals: adjacent pixels and rows mostly show the same triangles.
struct NormalCache {
    enum { ENTRIES = 512 };
    int id[ENTRIES];
    float normal[ENTRIES][3];

    inline void clear() { __builtin_memset(id, 0xff, sizeof id); }
    inline const float* find(Lookup& lookup, int triangle) {
        const unsigned entry = (unsigned)triangle % ENTRIES;
        if (id[entry] != triangle) lookup.normal_of(id[entry] = triangle, normal[entry]);
        return normal[entry];
    }
};

// Depth of rays, and a mask of those with a hit in range.
struct InRange {
    Floats depth;
    Ints seen;

    static inline InRange of(Floats inv_z, Floats depth, float near, float far) {
        const Floats infinity = Lanes::all(__builtin_inff());
        const Ints far_enough = depth >= Lanes::all(near);
        const Ints seen = far_enough & (depth <= Lanes::all(far)) & (inv_z > Lanes::all(0.0f));
        return InRange{seen ? depth : (far_enough ? infinity : -infinity), seen};
    }
    // Planar depth.
    static inline InRange of(Floats inv_z, float near, float far) { return of(inv_z, 1.0f / inv_z, near, far); }
    // Points on rays from the origin, at a given distance along them; NaN if nothing is in range.
    inline Points along(const Points& ray, Floats distance, const float* origin) const {
        const Floats reach = seen ? distance : Lanes::all(__builtin_nanf(""));
        return Points{reach * ray.x + origin[0], reach * ray.y + origin[1], reach * ray.z + origin[2]};
    }
};

// Results of LANES rays.
struct Hits {
    Floats depth;
    Points point, normal;
    Ints object;
};

// Writes the images of a view from its z-buffer.
struct Writer {
    Lookup lookup;
    const Camera& camera;
    Rays rays;
    const Image& image;
    const Job& job;
    const Images& out;
    long long view;
    Mode mode;
    NormalCache* normal_cache = nullptr;  // of this view, initially empty

    inline void cache_normals(NormalCache& cache) {
        if (mode != MODE_TRIANGLES || !out.normals) return;
        cache.clear();
        normal_cache = &cache;
    }
    // Normals at rays through image points.
    inline Points normals(Ints ids, Ints seen, Doubles u, Doubles v) {
        if (!lookup.moving) return triangle_normals(ids, Lanes::bits(seen));
        Points round = Points::all(0.0f);
        const Ints solid = lookup.solid_normals(ids, seen, u, v, round);
        return Points::select(solid, round, triangle_normals(ids, Lanes::bits(seen & ~solid)));
    }

    // Normals of the triangles at a row of pixels, each looked up once: adjacent pixels mostly share a triangle.
    inline Points triangle_normals(Ints ids, unsigned seen) {
        Points n = Points::all(__builtin_nanf(""));
        int id[LANES];
        Lanes::store(id, ids);
        const Ints active = ((Lanes::all_ints((int)seen) >> Lanes::index()) & 1) == 1;
        while (seen) {
            const int first = id[Lanes::first_lane(seen)];
            float computed[3];
            const float* normal = normal_cache ? normal_cache->find(lookup, first) : computed;
            if (!normal_cache) lookup.normal_of(first, computed);
            const Ints same = ids == first;
            const Points found = {Lanes::all(normal[0]), Lanes::all(normal[1]), Lanes::all(normal[2])};
            n = Points::select(same & active, found, n);
            seen &= ~Lanes::bits(same);
        }
        return n;
    }

    // A number of each triangle that is seen, -1 elsewhere: adjacent pixels mostly share a triangle.
    template <class Function>
    static inline Ints of_triangles(Ints ids, Ints seen, const Function& number) {
        int of[LANES];
        Lanes::store(of, ids);
        const unsigned remaining = Lanes::bits(seen);
        if (!remaining) return Lanes::all_ints(-1);
        const int first = of[Lanes::first_lane(remaining)], number_of_first = number(first);
        const unsigned others = remaining & ~Lanes::bits(ids == first);
        if (!others) return seen ? Lanes::all_ints(number_of_first) : Lanes::all_ints(-1);
        for (const int k : Lanes::each(remaining)) of[k] = number(of[k]);
        return seen ? Lanes::load(of) : Lanes::all_ints(-1);
    }

    // Indices of triangles in their objects' own meshes, -1 if nothing is visible, and for solids.
    inline Ints faces(Ints ids, Ints seen) {
        return of_triangles(ids, seen, [&](int id) { return face_of(id); });
    }

    inline int face_of(int id) {
        const int slot = lookup.slot_of(id);
        return slot < 0 ? -1 : out.slot_face[slot];
    }

    // Objects at a row of pixels, -1 if nothing is visible; `id` holds triangles or objects, depending on the mode.
    inline Ints objects(Ints id, Ints seen) {
        if (mode != MODE_TRIANGLES) return seen ? id : Lanes::all_ints(-1);
        return of_triangles(id, seen, [&](int triangle) { return lookup.object_of(triangle); });
    }

    // Adjacent pixels mostly show the same object.
    static inline void labels(unsigned char* to, const unsigned char* object_label, Ints objects, int count) {
        int object[LANES], previous = -1;
        unsigned char label = LABEL_EMPTY;
        Lanes::store(object, objects);
        for (int k = 0; k < count; ++k) {
            if (object[k] != previous)
                label = (previous = object[k]) < 0 ? (unsigned char)LABEL_EMPTY : object_label[object[k]];
            to[k] = label;
        }
    }

    // Write LANES pixels of a row to each requested image. Some images need an id, and in MODE_TRIANGLES some need a
    // triangle's id.
    inline void row(int x, int y, Floats inv_z, Ints id) {
        const int count = count_from(x, image.width);
        const long long offset = (view * job.height + image.first_row + y) * job.width + x;
        const InRange range = InRange::of(inv_z, job.near, job.far);
        const Ints seen = range.seen;
        if (out.depth) Write::row(out.depth + offset, range.depth, count);
        if (out.points) {
            const Points ray = rays.at((Lanes::index_floats() + (float)x) + camera.first_u,
                                       (float)(y + image.first_row) + camera.first_v);
            Write::row(out.points + offset * 3, range.along(ray, range.depth, camera.origin), count);
        }
        if (mode == MODE_TRIANGLES && out.normals) {
            const Doubles u = (x + 0.5 - job.center[0]) + __builtin_convertvector(Lanes::index(), Doubles);
            const Doubles v = (Doubles)(y + image.first_row + 0.5 - job.center[1]);
            Write::row(out.normals + offset * 3, normals(id, seen, u, v), count);
        }
        if (mode == MODE_TRIANGLES && out.faces) Write::row(out.faces + offset, faces(id, seen), count);
        if (mode == MODE_TRIANGLES && !(out.segmentation || out.labels)) return;
        const Ints object = objects(id, seen);
        if (out.segmentation) Write::row(out.segmentation + offset, object, count);
        if (out.labels) labels(out.labels + offset, out.object_label, object, count);
    }

    // Write the results of rays to pixels that are not adjacent; runs of `run` lanes are.
    inline __attribute__((always_inline)) void put(const Hits& hits, long long first, const int* place, int run) const {
        if (out.depth) Write::put(out.depth + first, place, run, hits.depth);
        if (out.points) Write::put(out.points + first * 3, place, hits.point);
        if (mode == MODE_DEPTH) return;
        if (mode == MODE_TRIANGLES && out.normals) Write::put(out.normals + first * 3, place, hits.normal);
        if (out.segmentation) Write::put((float*)out.segmentation + first, place, run, (Floats)hits.object);
        if (!out.labels) return;
        unsigned char label[LANES];
        labels(label, out.object_label, hits.object, LANES);
        for (int lane = 0; lane < LANES; ++lane)
            if (place[lane] >= 0) out.labels[first + place[lane]] = label[lane];
    }
    // Write a pixel without a ray, or with a ray outside the image, as empty.
    static inline void put_empty(const Images& out, long long place) {
        const float nothing = __builtin_nanf("");
        if (out.depth) out.depth[place] = __builtin_inff();
        for (int k = 0; k < 3; ++k) {
            if (out.points) out.points[place * 3 + k] = nothing;
            if (out.normals) out.normals[place * 3 + k] = nothing;
        }
        if (out.segmentation) out.segmentation[place] = -1;
        if (out.faces) out.faces[place] = -1;
        if (out.labels) out.labels[place] = LABEL_EMPTY;
    }

    // Write rows of pixels from rows of blocks, and clear the blocks. Rows are buffered in memory that stays in cache,
    // so that the images are written sequentially: writing BLOCK_SIDE rows at a time takes twice as long.
    inline void strip() {
        const int stride = image.tiles_x * TILE_SIDE;
        for (int y = 0; y < image.height; y += BLOCK_SIDE) {
            for (int x = 0; x < image.width; x += TILE_SIDE) unpack(x, y, stride);
            const int rows = image.height - y < BLOCK_SIDE ? image.height - y : BLOCK_SIDE;
            if (mode == MODE_DEPTH) {
                for (int r = 0; r < rows; ++r) plain_row(y + r, image.rows + r * stride);
                continue;
            }
            for (int r = 0; r < rows; ++r)
                for (int x = 0; x < image.width; x += LANES) {
                    const int offset = r * stride + x;
                    row(x, y + r, Lanes::load(image.rows + offset), Lanes::load(image.id_rows + offset));
                }
        }
    }
    // Write a row if no requested image needs an id. To the compiler, stores may alias any memory: separate loops keep
    // their parameters in registers.
    inline void plain_row(int y, const float* row_inv_z) const {
        const long long first = (view * job.height + image.first_row + y) * job.width;
        if (out.depth) depth_row(out.depth + first, row_inv_z, image.width, job.near, job.far);
        if (out.points) point_row(out.points + first * 3, row_inv_z, y);
    }
    static inline void depth_row(float* to, const float* row_inv_z, int width, float near, float far) {
        for (int x = 0; x < width; x += LANES)
            Write::row(to + x, InRange::of(Lanes::load(row_inv_z + x), near, far).depth, count_from(x, width));
    }
    inline void point_row(float* to, const float* row_inv_z, int y) const {
        const int width = image.width;
        const float near = job.near, far = job.far, v = (float)(y + image.first_row) + camera.first_v;
        const float first_u = camera.first_u, origin[3] = {camera.origin[0], camera.origin[1], camera.origin[2]};
        const Rays from = rays;
        for (int x = 0; x < width; x += LANES) {
            const InRange range = InRange::of(Lanes::load(row_inv_z + x), near, far);
            const Points ray = from.at((Lanes::index_floats() + (float)x) + first_u, v);
            Write::row(to + 3LL * x, range.along(ray, range.depth, origin), count_from(x, width));
        }
    }
    static inline int count_from(int x, int width) { return width - x < LANES ? width - x : LANES; }

    // Unpack the blocks from a pixel on, across a tile.
    inline void unpack(int x, int y, int stride) {
        const int first = Image::column_part(x) + image.row_part(y);
        Floats inv_z[BLOCK_SIDE];
        Blocks::transpose(image.inv_z + first, inv_z);
        for (int r = 0; r < BLOCK_SIDE; ++r) Lanes::store(image.rows + r * stride + x, inv_z[r]);
        for (int block = 0; block < BLOCKS_ACROSS; ++block)
            Lanes::store(image.inv_z + first + block * BLOCK_PIXELS, Lanes::all(0.0f));
        if (mode == MODE_DEPTH) return;
        Ints id[BLOCK_SIDE];
        Blocks::transpose(image.id + first, id);
        for (int r = 0; r < BLOCK_SIDE; ++r) Lanes::store(image.id_rows + r * stride + x, id[r]);
    }
};
