// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// First pass of points.h: points are projected, chunk by chunk, and binned by rows of tiles.

#pragma once

#include "cpu/number_lanes.h"
#include "cpu/packets.h"

// A point in view and in range.
struct ProjectedPoint {
    float u, v, inv_z;
    unsigned key;  // index in its chunk, and in the higher bits its cell in a row of tiles
};
static_assert(sizeof(ProjectedPoint) * LANES == 4 * sizeof(Floats),
              "points are converted to packets by whole registers");

struct PointJob {
    const float* place;  // [point]: x y z in the world
    int count;  // points in total, the same for every view
    int batch;  // points that are processed at a time
    int strip_tiles;  // rows of tiles in a strip
    bool views_are_units;  // whether a unit of work is a whole view
    bool with_id;  // whether the occluder of a point is stored
    double width, height;  // of the image, in pixels of the job, which may differ from the camera's pixels
    float tolerance;  // distance behind a surface up to which a point counts as visible [m]
    unsigned char* status;  // [view][point]
    int* occluders;  // [view][point], or null

    // The job of a `PointCall` of kernels/visibility/point_packets.py.
    template <class PointCall, class Status, class Occluders>
    static inline PointJob of(const PointCall& call, const Status& status, const Occluders& occluders) {
        return PointJob{.place = (const float*)call.points.data,
                        .count = call.points.shape[0],
                        .batch = call.job.batch,
                        .strip_tiles = call.job.strip_tiles,
                        .views_are_units = call.job.views_are_units != 0,
                        .with_id = call.job.with_id != 0,
                        .width = call.camera.width * call.job.scale,
                        .height = call.camera.height * call.job.scale,
                        .tolerance = call.tolerance,
                        .status = status.data,
                        .occluders = occluders.data};
    }
    inline int batches() const { return (int)(((long long)count + batch - 1) / batch); }
    inline int chunks() const { return (batch + POINT_CHUNK - 1) / POINT_CHUNK; }  // per batch
    inline int strips(int tiles_y) const { return (tiles_y + strip_tiles - 1) / strip_tiles; }
};

// Points of a view during processing: first in bins, by chunk and by row of tiles, then in packets.
struct PointBins {
    int rows;  // of tiles in the image
    int* ends;  // [chunk][row]: end of the row's points
    ProjectedPoint* points;  // [chunk][point], sorted by row
    int* point_index;  // [packet][lane], like the arrays below
    float *u, *v, *inv_z;
    int* id;  // occluder of a point; null if not requested

    static inline PointBins carve(Arena& arena, const PointJob& points, int tiles_x, int tiles_y) {
        const long long chunks = points.chunks();
        const long long strip_cells = (long long)tiles_x * points.strip_tiles * TILE_BLOCKS;
        const long long lanes = Sparse::max_lanes(points.batch, strip_cells * points.strips(tiles_y));
        PointBins bins;
        bins.rows = tiles_y;
        bins.ends = arena.ints(chunks * tiles_y);
        bins.points = (ProjectedPoint*)arena.take(chunks * POINT_CHUNK * (long long)sizeof(ProjectedPoint));
        bins.point_index = arena.ints(lanes);
        bins.u = arena.floats(lanes);
        bins.v = arena.floats(lanes);
        bins.inv_z = arena.floats(lanes);
        bins.id = points.with_id ? arena.ints(lanes) : nullptr;
        return bins;
    }

    inline int begin_of(int chunk, int row) const { return row > 0 ? ends[(long long)chunk * rows + row - 1] : 0; }
    inline int end_of(int chunk, int row) const { return ends[(long long)chunk * rows + row]; }
    inline ProjectedPoint* of_chunk(int chunk) const { return points + (long long)chunk * POINT_CHUNK; }

    // Number of points in a range of rows.
    inline int count(int chunks, int first, int end) const {
        int sum = 0;
        for (int chunk = 0; chunk < chunks; ++chunk) sum += end_of(chunk, end - 1) - begin_of(chunk, first);
        return sum;
    }
};

// A worker's memory for chunks and strips of points.
struct PointMemory {
    ProjectedPoint* placed;  // of a chunk or of a row of tiles, padded: whole registers are read at the end
    int* cell_ends;  // [cell of a row of tiles]
    Image image;
    Traversal traversal;

    static inline PointMemory carve(Arena& arena, const PointJob& points, int tiles_x, int movables, int levels) {
        const long long tiles = (long long)tiles_x * points.strip_tiles;
        PointMemory memory;
        memory.placed = (ProjectedPoint*)arena.take((points.batch + LANES) * (long long)sizeof(ProjectedPoint));
        memory.cell_ends = arena.ints((long long)tiles_x * TILE_BLOCKS);
        memory.image.first_packet = arena.ints(tiles * TILE_BLOCKS + 1);
        memory.image.take_blocks(arena, tiles);
        memory.traversal = Traversal::carve(arena, movables, levels);
        return memory;
    }
};

// Inputs and bins that all units of work share.
struct PointWork {
    const Scene& scene;
    const Job& job;
    const PointJob& points;
    const PointBins& bins;
};

// Projections of LANES points into a view.
struct Projection {
    Floats u, v, inv_z;
    Ints column, row;  // pixel coordinates
    Ints status;  // POINT_VISIBLE unless out of view or out of range

    typedef float HalfFloats __attribute__((ext_vector_type(LANES / 2)));
    typedef int HalfInts __attribute__((ext_vector_type(LANES / 2)));
    typedef double HalfDoubles __attribute__((ext_vector_type(LANES / 2)));

    // Half of the lanes: in double precision, there are too few registers for all.
    struct Half {
        HalfFloats u, v, inv_z, depth;
        HalfInts column, row, in_view;

        static inline Half of(const Pose& pose, const Job& job, const PointJob& points, HalfFloats at_x,
                              HalfFloats at_y, HalfFloats at_z) {
            const HalfDoubles x = exact(at_x) - pose.position[0], y = exact(at_y) - pose.position[1],
                              z = exact(at_z) - pose.position[2], none = (HalfDoubles)(0.0);
            const ExactRow* m = pose.axis;
            const HalfDoubles ahead = m[2][0] * x + (m[2][1] * y + m[2][2] * z), inv_z = 1.0 / ahead;
            const HalfDoubles right = (m[0][0] * x + (m[0][1] * y + m[0][2] * z)) * job.focal[0];
            const HalfDoubles down = (m[1][0] * x + (m[1][1] * y + m[1][2] * z)) * job.focal[1];
            // Compare products, not quotients, whose rounding would decide for points on the border of the image.
            const HalfDoubles left = right + job.center[0] * ahead, top = down + job.center[1] * ahead;
            const auto in_view = (ahead > none) & (left >= none) & (left < points.width * ahead) & (top >= none) &
                                 (top < points.height * ahead);
            const HalfDoubles column = in_view ? left * inv_z : none, row = in_view ? top * inv_z : none;
            return Half{narrow(right * inv_z),
                        narrow(down * inv_z),
                        narrow(inv_z),
                        narrow(ahead),
                        before(__builtin_convertvector(column, HalfInts), job.width),
                        before(__builtin_convertvector(row, HalfInts), job.height),
                        __builtin_convertvector(in_view, HalfInts)};
        }
        static inline HalfInts before(HalfInts value, int end) { return value < end ? value : end - 1; }
        static inline HalfDoubles exact(HalfFloats value) { return __builtin_convertvector(value, HalfDoubles); }
        static inline HalfFloats narrow(HalfDoubles value) { return __builtin_convertvector(value, HalfFloats); }
    };

    // Index of a point's cell in a row of tiles.
    inline Ints cell_of_row() const {
        const Ints bx = (column >> BLOCK_SHIFT) & (BLOCKS_ACROSS - 1), by = (row >> BLOCK_SHIFT) & (BLOCKS_ACROSS - 1);
        return (column >> TILE_SHIFT) * (int)TILE_BLOCKS + by * (int)BLOCKS_ACROSS + bx;
    }

    static inline Floats join(HalfFloats a, HalfFloats b) {
        return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }
    static inline Ints join(HalfInts a, HalfInts b) {
        return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }

    static inline Projection of(const Pose& pose, const Job& job, const PointJob& points, Points place) {
        const Half a = Half::of(pose, job, points, place.x.lo, place.y.lo, place.z.lo);
        const Half b = Half::of(pose, job, points, place.x.hi, place.y.hi, place.z.hi);
        const Floats depth = join(a.depth, b.depth);
        Ints status = Lanes::all_ints(POINT_VISIBLE);
        status = depth > Lanes::all(job.far) ? Lanes::all_ints(POINT_TOO_FAR) : status;
        status = depth < Lanes::all(job.near) ? Lanes::all_ints(POINT_TOO_NEAR) : status;
        status = join(a.in_view, b.in_view) ? status : Lanes::all_ints(POINT_OUT_OF_VIEW);
        return Projection{join(a.u, b.u),           join(a.v, b.v),     join(a.inv_z, b.inv_z),
                          join(a.column, b.column), join(a.row, b.row), status};
    }
};

// First pass: a chunk of points is projected and sorted by rows of tiles.
struct PointChunk {
    int view;
    int number;  // of the chunk in its batch
    int first, count;  // of its points

    static inline PointChunk of(const PointJob& points, int view, int batch, int number) {
        const long long first = (long long)batch * points.batch + (long long)number * POINT_CHUNK;
        const long long all = (batch + 1LL) * points.batch, end = all < points.count ? all : points.count;
        const long long left = first < end ? end - first : 0, count = left < POINT_CHUNK ? left : POINT_CHUNK;
        return PointChunk{view, number, (int)first, (int)count};
    }

    inline void sort(const PointWork& work, ProjectedPoint* loose) const {
        unsigned short row_of[POINT_CHUNK];
        const PointBins& bins = work.bins;
        const int found = project(work, loose, row_of);
        int* place = bins.ends + (long long)number * bins.rows;
        for (int row = 0; row < bins.rows; ++row) place[row] = 0;
        for (int i = 0; i < found; ++i) place[row_of[i]] += 1;
        sum_up(place, bins.rows);
        ProjectedPoint* sorted = bins.of_chunk(number);
        for (int i = 0; i < found; ++i) sorted[place[row_of[i]]++] = loose[i];
    }

    // Write the status of points that are out of view or out of range, and append the others and their rows; returns
    // their number.
    inline int project(const PointWork& work, ProjectedPoint* loose, unsigned short* row_of) const {
        const PointJob& points = work.points;
        const Pose pose = work.job.pose_of(view);
        int found = 0;
        for (int i = 0; i < count; i += LANES) {
            const int chunk = count - i < LANES ? count - i : LANES;
            Floats place[3];
            PixelLanes::load_triples(points.place + (first + i) * 3LL, place, chunk);
            const Projection p = Projection::of(pose, work.job, points, Points{place[0], place[1], place[2]});
            write(points, (long long)view * points.count + first + i, p.status, chunk);
            unsigned seen = Lanes::bits(p.status == Lanes::all_ints(POINT_VISIBLE)) & ((1u << chunk) - 1);
            if (!seen) continue;
            float u[LANES], v[LANES], inv_z[LANES];
            int key[LANES], row[LANES];
            Lanes::store(u, p.u);
            Lanes::store(v, p.v);
            Lanes::store(inv_z, p.inv_z);
            Lanes::store(key, (p.cell_of_row() << POINT_CHUNK_BITS) | (Lanes::index() + i));
            Lanes::store(row, p.row >> TILE_SHIFT);
            for (const int k : Lanes::each(seen)) {
                loose[found] = ProjectedPoint{u[k], v[k], inv_z[k], (unsigned)key[k]};
                row_of[found++] = (unsigned short)row[k];
            }
        }
        return found;
    }

    // Convert the count of each kind into the index of its first item (exclusive prefix sum).
    static inline void sum_up(int* counts, int kinds) {
        for (int k = 0, sum = 0; k < kinds; ++k) {
            const int count = counts[k];
            counts[k] = sum;
            sum += count;
        }
    }

    static inline void write(const PointJob& points, long long offset, Ints status, int count) {
        if (count == LANES)
            PixelLanes::store(points.status + offset, status, LANES);  // of a known size: one instruction
        else
            PixelLanes::store(points.status + offset, status, count);
        for (int k = 0; k < count && points.occluders; ++k) points.occluders[offset + k] = -1;
    }
};
