// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Visibility of world points: their projections into a view, and whether a surface occludes them.
//
// First, points are projected chunk by chunk. Points out of view or out of range are finished; the others are sorted by
// rows of tiles. Then, strip by strip, they are sorted into the cells of a sparse image, in which each lane starts with
// the greatest inv_z that does not occlude its point, as if a surface had been rasterized there: the traversal skips
// geometry behind all points of a cell, and the first nearer surface settles a lane.

#pragma once

#include "cpu/point_bins.h"

// Second pass: a strip of the image is rasterized.
struct PointStrip {
    // The packets of a strip are stored after the greatest possible number of packets of the strips before it.
    static inline Image image_of(const PointWork& work, int strip, const PointMemory& memory,
                                 const ExactOcclusion& occlusion) {
        const PointJob& points = work.points;
        const PointBins& bins = work.bins;
        Image image = memory.image;
        const int first_row = strip * points.strip_tiles * TILE_SIDE;
        const int remaining = work.job.height - first_row, max_rows = points.strip_tiles * TILE_SIDE;
        image.set_size(work.job.width, remaining < max_rows ? remaining : max_rows, first_row, work.job.height);
        image.set_center(work.job.center);
        image.occlusion = &occlusion;
        long long before = 0;
        for (int other = 0; other < strip; ++other) {
            const int first = other * points.strip_tiles, end = first + points.strip_tiles;
            const long long cells = (long long)image.tiles_x * points.strip_tiles * TILE_BLOCKS;
            before += Sparse::max_lanes(bins.count(points.chunks(), first, end), cells);
        }
        image.point_index = bins.point_index + before;
        image.point_u = bins.u + before;
        image.point_v = bins.v + before;
        image.inv_z = bins.inv_z + before;
        image.id = bins.id ? bins.id + before : nullptr;
        return image;
    }

    // Sort a strip's points into cells and convert them to packets, one row of tiles at a time.
    static inline void place(const PointWork& work, const Image& image, const PointMemory& memory) {
        const int cells = image.tiles_x * TILE_BLOCKS;
        const int* ends = memory.cell_ends;
        int packets = 0;
        for (int row = 0; row < image.tiles_y; ++row) {
            sort(work, (image.first_row >> TILE_SHIFT) + row, cells, memory);
            for (int c = 0; c < cells; ++c) {
                const int cell = row * cells + c;
                Floats min_inv_z = Lanes::all(NOWHERE);
                image.first_packet[cell] = packets;
                for (int i = c > 0 ? ends[c - 1] : 0; i < ends[c]; i += LANES)
                    min_inv_z = Lanes::min(min_inv_z, pack(work, image, packets++, memory.placed + i, ends[c] - i));
                image.block_min[cell] = Lanes::min_of(min_inv_z);
            }
        }
        image.first_packet[cells * image.tiles_y] = packets;
        __builtin_memset(image.block_stale, 0, cells * image.tiles_y);
        __builtin_memset(image.tile_stale, 1, image.tiles());
    }

    // Sort the points of a row of tiles by cell (counting sort); `cell_ends` receives the end of each cell.
    static inline void sort(const PointWork& work, int row, int cells, const PointMemory& memory) {
        const PointBins& bins = work.bins;
        const int chunks = work.points.chunks();
        int* ends = memory.cell_ends;
        for (int c = 0; c < cells; ++c) ends[c] = 0;
        for (int chunk = 0; chunk < chunks; ++chunk) {
            const ProjectedPoint* points = bins.of_chunk(chunk);
            const int end = bins.end_of(chunk, row);
            for (int i = bins.begin_of(chunk, row); i < end; ++i) ends[points[i].key >> POINT_CHUNK_BITS] += 1;
        }
        PointChunk::sum_up(ends, cells);
        for (int chunk = 0; chunk < chunks; ++chunk) {
            const ProjectedPoint* points = bins.of_chunk(chunk);
            const int end = bins.end_of(chunk, row), first = chunk * POINT_CHUNK;
            for (int i = bins.begin_of(chunk, row); i < end; ++i) {
                ProjectedPoint point = points[i];
                ProjectedPoint& target = memory.placed[ends[point.key >> POINT_CHUNK_BITS]++];
                point.key = first + (point.key & (POINT_CHUNK - 1));  // from here on, the index in the batch
                target = point;
            }
        }
    }

    // Load a point into each lane, or `count` points. An empty lane occludes everything and is never written.
    static inline Floats pack(const PointWork& work, const Image& image, int packet, const ProjectedPoint* points,
                              int count) {
        const float* source = (const float*)points;
        const Floats a = Lanes::load(source), b = Lanes::load(source + LANES);
        const Floats c = Lanes::load(source + 2 * LANES), d = Lanes::load(source + 3 * LANES);
        const Floats ab_uv = __builtin_shufflevector(a, b, 0, 4, 8, 12, 16, 20, 24, 28, 1, 5, 9, 13, 17, 21, 25, 29);
        const Floats cd_uv = __builtin_shufflevector(c, d, 0, 4, 8, 12, 16, 20, 24, 28, 1, 5, 9, 13, 17, 21, 25, 29);
        const Floats ab_zk = __builtin_shufflevector(a, b, 2, 6, 10, 14, 18, 22, 26, 30, 3, 7, 11, 15, 19, 23, 27, 31);
        const Floats cd_zk = __builtin_shufflevector(c, d, 2, 6, 10, 14, 18, 22, 26, 30, 3, 7, 11, 15, 19, 23, 27, 31);
        const Floats u = Projection::join(ab_uv.lo, cd_uv.lo), v = Projection::join(ab_uv.hi, cd_uv.hi);
        const Ints used = Lanes::index() < Lanes::all_ints(count);
        const Floats inv_z = limit(work.job, work.points.tolerance, u, v, Projection::join(ab_zk.lo, cd_zk.lo));
        const Floats stored = used ? inv_z : Lanes::all(NOWHERE);
        Lanes::store(image.point_u + packet * LANES, u);
        Lanes::store(image.point_v + packet * LANES, v);
        Lanes::store(image.inv_z + packet * LANES, stored);
        Lanes::store(image.point_index + packet * LANES,
                     used ? (Ints)Projection::join(ab_zk.hi, cd_zk.hi) : Lanes::all_ints(-1));
        if (image.id) Lanes::store(image.id + packet * LANES, Lanes::all_ints(-1));
        return stored;
    }

    // Greatest inv_z of a surface that does not occlude the point with the given inv_z, w. If the ray with z = 1 has
    // length s, a surface nearer by the tolerance t along the ray is at z - t / s, so its inv_z is w + w * w t / (s - w
    // t): a sum without cancellation.
    static inline Floats limit(const Job& job, float tolerance, Floats u, Floats v, Floats inv_z) {
        const Floats infinite = Lanes::all(2e38f);  // less than the value of a settled lane
        const Floats x = u * (float)(1.0 / job.focal[0]), y = v * (float)(1.0 / job.focal[1]),
                     nearer = tolerance * inv_z;
        const Floats remaining = __builtin_elementwise_sqrt(x * x + (y * y + 1.0f)) - nearer;
        return remaining > Lanes::all(0.0f) ? Lanes::min(inv_z + inv_z * (nearer / remaining), infinite) : infinite;
    }

    // Write the status of occluded points: all others are already marked as visible.
    static inline void write(const Image& image, const PointJob& points, long long first_point) {
        const int packets = image.first_packet[image.tiles() * TILE_BLOCKS];
        for (int first = 0; first < packets * LANES; first += LANES) {
            Ints hidden = Lanes::load(image.point_index + first) >= Lanes::all_ints(0);
            hidden &= image.id ? Lanes::load(image.id + first) >= Lanes::all_ints(0)
                               : Lanes::load(image.inv_z + first) == Lanes::all(NOWHERE);
            for (const int k : Lanes::each(hidden)) {
                const int lane = first + k;
                points.status[first_point + image.point_index[lane]] = POINT_OCCLUDED;
                if (points.occluders) points.occluders[first_point + image.point_index[lane]] = image.id[lane];
            }
        }
    }

    static inline void render(const PointWork& work, int view_index, int batch, int number, const PointMemory& memory) {
        const PointJob& points = work.points;
        const int first = number * points.strip_tiles, end = first + points.strip_tiles, rows = work.bins.rows;
        const World world = work.scene.movables.of_view(view_index);
        if (!world.exists || !work.bins.count(points.chunks(), first, end < rows ? end : rows)) return;
        const long long before = (long long)batch * points.batch;
        const View view = View::of<PIXEL_RAYS>(work.scene, work.job, world, work.job.pose_of(view_index));
        const double* focal = work.job.focal;
        const ExactOcclusion occlusion = {points.place + before * 3, view.pose, {focal[0], focal[1]}, points.tolerance};
        const Image image = image_of(work, number, memory, occlusion);
        place(work, image, memory);
        Packets<PIXEL_RAYS>::render(view, image, memory.traversal, MODE_OBJECTS);
        write(image, points, (long long)view_index * points.count + before);
    }
};

// Units of work. For each batch of points of a view there are first all chunks, then all strips. Strips wait for the
// chunks of their batch, and chunks for the strips of the previous batch; units are taken in order, so a worker is
// already processing those.
struct PointPackets {
    const PointWork& work;
    const PointMemory& memory;
    int chunks, strips, batches, parts, units;

    static inline PointPackets of(const PointWork& work, const PointMemory& memory) {
        const PointJob& points = work.points;
        const int chunks = points.chunks(), strips = points.strips(work.bins.rows), batches = points.batches();
        const int parts = points.views_are_units ? 1 : chunks + strips;
        return PointPackets{work, memory, chunks, strips, batches, parts, work.job.views * batches * parts};
    }

    // Number of units that must be done before a unit can begin.
    inline int before(int unit) const {
        if (work.points.views_are_units) return 0;
        return unit / parts * parts + (unit % parts < chunks ? 0 : chunks);
    }

    inline void chunk(int view, int batch, int number) const {
        PointChunk::of(work.points, view, batch, number).sort(work, memory.placed);
    }
    inline void strip(int view, int batch, int number) const { PointStrip::render(work, view, batch, number, memory); }

    inline void unit(int unit) const {
        const int round = unit / parts, view = round / batches, batch = round % batches, part = unit % parts;
        if (work.points.views_are_units) {
            for (int i = 0; i < chunks; ++i) chunk(view, batch, i);
            for (int i = 0; i < strips; ++i) strip(view, batch, i);
        } else if (part < chunks) {
            chunk(view, batch, part);
        } else {
            strip(view, batch, part - chunks);
        }
    }

    // Take units of work as `Workers::run` does. If the next one would have to wait long, return: the counter then
    // shows that work remains, and the caller sleeps before it calls again.
    inline void run(int* counter) const {
        int next = __atomic_load_n(counter + COUNTER_NEXT_UNIT, __ATOMIC_RELAXED);
        while (next < units) {
            if (!Workers::wait_for_units(counter, before(next))) return Workers::leave(counter);
            if (!Workers::take_this(counter, next)) continue;
            unit(next);
            __atomic_fetch_add(counter + COUNTER_DONE, 1, __ATOMIC_RELEASE);
            next = __atomic_load_n(counter + COUNTER_NEXT_UNIT, __ATOMIC_RELAXED);
        }
        Workers::finish(counter);
    }
};

struct PointLaunch {
    // Run a worker of a launch; see kernels/visibility/point_packets.py.
    template <class PointCall, class Status, class Occluders>
    static inline void judge(const PointCall& call, const Status& status, const Occluders& occluders) {
        const auto& layout = call.job;
        const PointJob points = PointJob::of(call, status, occluders);
        const Job job = Job::of_camera(call.camera, call.poses, layout.scale);
        const Scene scene = Scene::of(call.scene, call.worlds);
        const int tiles_x = Grid::tiles(job.width), tiles_y = Grid::tiles(job.height);
        const auto carve = [&](Arena& arena) {
            return PointMemory::carve(arena, points, tiles_x, scene.movables.count, call.scene.levels);
        };
        if (!layout.bins.data) {
            Arena bins = Arena::at(nullptr), scratch = Arena::at(nullptr);
            PointBins::carve(bins, points, tiles_x, tiles_y);
            carve(scratch);
            layout.bytes.data[0] = bins.used;
            layout.bytes.data[1] = scratch.used;
            return;
        }
        Workers::enter(layout.counter.data);
        const int slot = Workers::take_memory(layout.taken.data);
        const long long bins_row = points.views_are_units ? slot : 0;
        Arena shared = Arena::at((char*)layout.bins.data + bins_row * layout.bins.strides[0]);
        Arena own = Arena::at((char*)layout.scratch.data + slot * (long long)layout.scratch.strides[0]);
        const PointBins bins = PointBins::carve(shared, points, tiles_x, tiles_y);
        const PointMemory memory = carve(own);
        const PointWork work = {scene, job, points, bins};
        PointPackets::of(work, memory).run(layout.counter.data);
        Workers::give_back_memory(layout.taken.data, slot);
    }
};
