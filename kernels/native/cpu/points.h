// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Points of the world: where they are in a view's image, and whether anything is in the way of them.
//
// First, chunk by chunk, points are projected. Those out of view or out of range are done with; the others are sorted
// by the rows of tiles that they are in. Then, strip by strip, they are sorted into the cells of a sparse image, in
// which each lane begins with the greatest inv_z that does not hide its point, as if that had been drawn already: the
// walk passes over what lies behind all points of a cell, and a lane that anything is nearer than is settled.

// A point in view and in range.
struct ProjectedPoint {
    float u, v, inv_z;
    unsigned key;  // which of its chunk's points it is, and above that its cell in a row of tiles
};
static_assert(sizeof(ProjectedPoint) * LANES == 4 * sizeof(Floats), "they are turned into packets by whole registers");

struct PointJob {
    const float* place;  // [point]: x y z in the world
    int count;  // points, of every view
    int batch;  // of them that are worked on at a time
    int strip_tiles;  // rows of tiles in a strip
    bool views_are_units;  // whether a unit of work is a view, not a part of one
    bool with_id;  // whether it is kept what hides a point
    double width, height;  // of the image, in the job's pixels, which need not be the camera's
    float tolerance;  // how far behind a surface a point still counts as seen [m]
    unsigned char* status;  // [view][point]
    int* occluders;  // [view][point], or null

    inline int batches() const { return (int)(((long long)count + batch - 1) / batch); }
    inline int chunks() const { return (batch + POINT_CHUNK - 1) / POINT_CHUNK; }  // of a batch
    inline int strips(int tiles_y) const { return (tiles_y + strip_tiles - 1) / strip_tiles; }
};

// A view's points while they are worked on, in bins: chunks, and in these rows of tiles. Then packets of them.
struct PointBins {
    int rows;  // of tiles in the image
    int* ends;  // [chunk][row]: where its points end
    ProjectedPoint* points;  // [chunk][point], by rows
    int* point_index;  // [lane] of packets, and so the others
    float *u, *v, *inv_z;
    int* id;  // what hides a point; null if nobody asks

    static inline PointBins carve(Arena& arena, const PointJob& points, int tiles_x, int tiles_y) {
        const long long chunks = points.chunks();
        const long long strip_cells = (long long)tiles_x * points.strip_tiles * TILE_BLOCKS;
        const long long lanes = Sparse::most_lanes(points.batch, strip_cells * points.strips(tiles_y));
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

    // Points in some rows.
    inline int count(int chunks, int first, int end) const {
        int sum = 0;
        for (int chunk = 0; chunk < chunks; ++chunk) sum += end_of(chunk, end - 1) - begin_of(chunk, first);
        return sum;
    }
};

// A worker's memory for chunks and strips of points.
struct PointMemory {
    ProjectedPoint* placed;  // of a chunk or of a row of tiles; whole registers are read of the last ones
    int* cell_ends;  // [cell of a row of tiles]
    Image image;
    Traversal traversal;

    static inline PointMemory carve(Arena& arena, const PointJob& points, int tiles_x, int movables, int levels) {
        const long long tiles = (long long)tiles_x * points.strip_tiles;
        PointMemory memory;
        memory.placed = (ProjectedPoint*)arena.take((points.batch + LANES) * (long long)sizeof(ProjectedPoint));
        memory.cell_ends = arena.ints((long long)tiles_x * TILE_BLOCKS);
        memory.image.empty = nullptr;
        memory.image.rows = nullptr;
        memory.image.id_rows = nullptr;
        memory.image.first_packet = arena.ints(tiles * TILE_BLOCKS + 1);
        memory.image.take_blocks(arena, tiles);
        memory.traversal = Traversal::carve(arena, movables, levels);
        return memory;
    }
};

// What all units of work share.
struct PointWork {
    const Scene& scene;
    const Job& job;
    const PointJob& points;
    const PointBins& bins;
};

// A point of a view in each lane.
struct Projection {
    Floats u, v, inv_z;
    Ints column, row;  // of pixels
    Ints status;  // visible as far as is known

    typedef float HalfFloats __attribute__((ext_vector_type(LANES / 2)));
    typedef int HalfInts __attribute__((ext_vector_type(LANES / 2)));
    typedef double HalfDoubles __attribute__((ext_vector_type(LANES / 2)));

    // Half of them: for all in double precision there are too few registers.
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
            // Not by the quotients, whose rounding would decide for points on a border.
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

    // The number of a point's cell in a row of tiles.
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

    static inline Projection of(const Pose& pose, const Job& job, const PointJob& points, Points at) {
        const Half a = Half::of(pose, job, points, at.x.lo, at.y.lo, at.z.lo);
        const Half b = Half::of(pose, job, points, at.x.hi, at.y.hi, at.z.hi);
        const Floats depth = join(a.depth, b.depth);
        Ints status = Lanes::all_ints(POINT_VISIBLE);
        status = depth > Lanes::all(job.far) ? Lanes::all_ints(POINT_TOO_FAR) : status;
        status = depth < Lanes::all(job.near) ? Lanes::all_ints(POINT_TOO_NEAR) : status;
        status = join(a.in_view, b.in_view) ? status : Lanes::all_ints(POINT_OUT_OF_VIEW);
        return Projection{join(a.u, b.u),           join(a.v, b.v),     join(a.inv_z, b.inv_z),
                          join(a.column, b.column), join(a.row, b.row), status};
    }
};

// The first half of the work: a chunk of points is projected, and sorted by rows of tiles.
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

    // Say what points are that cannot be hidden, and put down the others and their rows; returns how many.
    inline int project(const PointWork& work, ProjectedPoint* loose, unsigned short* row_of) const {
        const PointJob& points = work.points;
        const Pose pose = work.job.pose_of(view);
        int found = 0;
        for (int i = 0; i < count; i += LANES) {
            const int here = count - i < LANES ? count - i : LANES;
            const Projection p = Projection::of(pose, work.job, points, load(points.place + (first + i) * 3LL, here));
            write(points, (long long)view * points.count + first + i, p.status, here);
            unsigned seen = Lanes::bits(p.status == Lanes::all_ints(POINT_VISIBLE)) & ((1u << here) - 1);
            if (!seen) continue;
            float u[LANES], v[LANES], inv_z[LANES];
            int key[LANES], row[LANES];
            Lanes::store(u, p.u);
            Lanes::store(v, p.v);
            Lanes::store(inv_z, p.inv_z);
            Lanes::store(key, (p.cell_of_row() << POINT_CHUNK_BITS) | (Lanes::index() + i));
            Lanes::store(row, p.row >> TILE_SHIFT);
            for (; seen; seen &= seen - 1) {
                const int k = Lanes::first_lane(seen);
                loose[found] = ProjectedPoint{u[k], v[k], inv_z[k], (unsigned)key[k]};
                row_of[found++] = (unsigned short)row[k];
            }
        }
        return found;
    }

    // From how many there are of each kind to where the first one of each belongs.
    static inline void sum_up(int* counts, int kinds) {
        for (int k = 0, sum = 0; k < kinds; ++k) {
            const int count = counts[k];
            counts[k] = sum;
            sum += count;
        }
    }

    // A point in each lane, or as many as there are.
    static inline Points load(const float* from, int count) {
        float last[3 * LANES] = {};
        if (count < LANES) {
            __builtin_memcpy(last, from, count * 3 * sizeof(last[0]));
            from = last;
        }
        const Floats a = Lanes::load(from), b = Lanes::load(from + LANES), c = Lanes::load(from + 2 * LANES);
        const Floats x = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0);
        const Floats y = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0);
        const Floats z = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0);
        return Points{__builtin_shufflevector(x, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29),
                      __builtin_shufflevector(y, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30),
                      __builtin_shufflevector(z, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31)};
    }

    static inline void write(const PointJob& points, long long at, Ints status, int count) {
        typedef unsigned char Bytes __attribute__((ext_vector_type(LANES)));
        const Bytes narrow = __builtin_convertvector(status, Bytes);
        if (count == LANES)
            __builtin_memcpy(points.status + at, &narrow, LANES);
        else
            __builtin_memcpy(points.status + at, &narrow, count);
        for (int k = 0; k < count && points.occluders; ++k) points.occluders[at + k] = -1;
    }
};

// The second half: a strip of the image is drawn.
struct PointStrip {
    // Its packets lie behind those that strips before it have at most.
    static inline Image image_of(const PointWork& work, int strip, const PointMemory& memory,
                                 const ExactOcclusion& occlusion) {
        const PointJob& points = work.points;
        const PointBins& bins = work.bins;
        Image image = memory.image;
        const int first_row = strip * points.strip_tiles * TILE_SIDE;
        const int left = work.job.height - first_row, most = points.strip_tiles * TILE_SIDE;
        image.set_size(work.job.width, left < most ? left : most, first_row, work.job.height);
        image.set_center(work.job.center);
        image.occlusion = &occlusion;
        long long before = 0;
        for (int other = 0; other < strip; ++other) {
            const int first = other * points.strip_tiles, end = first + points.strip_tiles;
            const long long cells = (long long)image.tiles_x * points.strip_tiles * TILE_BLOCKS;
            before += Sparse::most_lanes(bins.count(points.chunks(), first, end), cells);
        }
        image.point_index = bins.point_index + before;
        image.point_u = bins.u + before;
        image.point_v = bins.v + before;
        image.inv_z = bins.inv_z + before;
        image.id = bins.id ? bins.id + before : nullptr;
        return image;
    }

    // Sort a strip's points into cells, and turn them into packets, a row of tiles at a time.
    static inline void place(const PointWork& work, const Image& image, const PointMemory& memory) {
        const int cells = image.tiles_x * TILE_BLOCKS;
        const int* ends = memory.cell_ends;
        int packets = 0;
        for (int row = 0; row < image.tiles_y; ++row) {
            sort(work, (image.first_row >> TILE_SHIFT) + row, cells, memory);
            for (int c = 0; c < cells; ++c) {
                const int cell = row * cells + c;
                Floats least = Lanes::all(NOWHERE);
                image.first_packet[cell] = packets;
                for (int i = c > 0 ? ends[c - 1] : 0; i < ends[c]; i += LANES)
                    least = Lanes::min(least, pack(work, image, packets++, memory.placed + i, ends[c] - i));
                image.block_min[cell] = Lanes::min_of(least);
            }
        }
        image.first_packet[cells * image.tiles_y] = packets;
        __builtin_memset(image.block_stale, 0, cells * image.tiles_y);
        __builtin_memset(image.tile_stale, 1, image.tiles());
    }

    // The points of a row of tiles by cells, and where those of each cell end: count, sum up, place.
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
                ProjectedPoint& to = memory.placed[ends[point.key >> POINT_CHUNK_BITS]++];
                point.key = first + (point.key & (POINT_CHUNK - 1));  // from here on, in the batch
                to = point;
            }
        }
    }

    // A point to each lane, or as many as there are. A lane without a point hides, and never shows.
    static inline Floats pack(const PointWork& work, const Image& image, int packet, const ProjectedPoint* points,
                              int count) {
        const float* from = (const float*)points;
        const Floats a = Lanes::load(from), b = Lanes::load(from + LANES);
        const Floats c = Lanes::load(from + 2 * LANES), d = Lanes::load(from + 3 * LANES);
        const Floats ab_uv = __builtin_shufflevector(a, b, 0, 4, 8, 12, 16, 20, 24, 28, 1, 5, 9, 13, 17, 21, 25, 29);
        const Floats cd_uv = __builtin_shufflevector(c, d, 0, 4, 8, 12, 16, 20, 24, 28, 1, 5, 9, 13, 17, 21, 25, 29);
        const Floats ab_zk = __builtin_shufflevector(a, b, 2, 6, 10, 14, 18, 22, 26, 30, 3, 7, 11, 15, 19, 23, 27, 31);
        const Floats cd_zk = __builtin_shufflevector(c, d, 2, 6, 10, 14, 18, 22, 26, 30, 3, 7, 11, 15, 19, 23, 27, 31);
        const Floats u = Projection::join(ab_uv.lo, cd_uv.lo), v = Projection::join(ab_uv.hi, cd_uv.hi);
        const Ints taken = Lanes::index() < Lanes::all_ints(count);
        const Floats inv_z = limit(work.job, work.points.tolerance, u, v, Projection::join(ab_zk.lo, cd_zk.lo));
        const Floats least = taken ? inv_z : Lanes::all(NOWHERE);
        Lanes::store(image.point_u + packet * LANES, u);
        Lanes::store(image.point_v + packet * LANES, v);
        Lanes::store(image.inv_z + packet * LANES, least);
        Lanes::store(image.point_index + packet * LANES,
                     taken ? (Ints)Projection::join(ab_zk.hi, cd_zk.hi) : Lanes::all_ints(-1));
        if (image.id) Lanes::store(image.id + packet * LANES, Lanes::all_ints(-1));
        return least;
    }

    // The greatest inv_z of a surface that does not hide the point whose inv_z is given. Where the ray of z = 1 has the
    // length s, what is nearer by the tolerance t along it is at z - t / s, and its inv_z (w for short) is
    // w + w * w t / (s - w t): a sum that loses no digits.
    static inline Floats limit(const Job& job, float tolerance, Floats u, Floats v, Floats inv_z) {
        const Floats most = Lanes::all(2e38f);  // less than of a lane that is settled
        const Floats x = u * (float)(1.0 / job.focal[0]), y = v * (float)(1.0 / job.focal[1]),
                     nearer = tolerance * inv_z;
        const Floats left = __builtin_elementwise_sqrt(x * x + (y * y + 1.0f)) - nearer;
        return left > Lanes::all(0.0f) ? Lanes::min(inv_z + inv_z * (nearer / left), most) : most;
    }

    // What is hidden: all others count as visible already.
    static inline void write(const Image& image, const PointJob& points, long long at) {
        const int packets = image.first_packet[image.tiles() * TILE_BLOCKS];
        for (int first = 0; first < packets * LANES; first += LANES) {
            Ints hidden = Lanes::load(image.point_index + first) >= Lanes::all_ints(0);
            hidden &= image.id ? Lanes::load(image.id + first) >= Lanes::all_ints(0)
                               : Lanes::load(image.inv_z + first) == Lanes::all(NOWHERE);
            for (unsigned left = Lanes::bits(hidden); left; left &= left - 1) {
                const int lane = first + Lanes::first_lane(left);
                points.status[at + image.point_index[lane]] = POINT_OCCLUDED;
                if (points.occluders) points.occluders[at + image.point_index[lane]] = image.id[lane];
            }
        }
    }

    static inline void draw(const PointWork& work, int view_index, int batch, int number, const PointMemory& memory) {
        const PointJob& points = work.points;
        const int first = number * points.strip_tiles, end = first + points.strip_tiles, rows = work.bins.rows;
        const World world = work.scene.movables.of_view(view_index);
        if (!world.exists || !work.bins.count(points.chunks(), first, end < rows ? end : rows)) return;
        const long long before = (long long)batch * points.batch;
        const View view = View::of(work.scene, work.job, world, work.job.pose_of(view_index));
        const double* focal = work.job.focal;
        const ExactOcclusion occlusion = {points.place + before * 3, view.pose, {focal[0], focal[1]}, points.tolerance};
        const Image image = image_of(work, number, memory, occlusion);
        place(work, image, memory);
        Packets::draw(view, image, memory.traversal, MODE_OBJECTS);
        write(image, points, (long long)view_index * points.count + before);
    }
};

// Units of work. Of a view's batch of points there are first all chunks, then all strips, which wait for the chunks, as
// the next batch's chunks do for the strips: whoever took those is at work on them.
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

    // Units that have to be done before one can begin.
    inline int before(int unit) const {
        if (work.points.views_are_units) return 0;
        return unit / parts * parts + (unit % parts < chunks ? 0 : chunks);
    }

    inline void chunk(int view, int batch, int number) const {
        PointChunk::of(work.points, view, batch, number).sort(work, memory.placed);
    }
    inline void strip(int view, int batch, int number) const { PointStrip::draw(work, view, batch, number, memory); }

    inline void unit(int unit) const {
        const int turn = unit / parts, view = turn / batches, batch = turn % batches, part = unit % parts;
        if (work.points.views_are_units) {
            for (int i = 0; i < chunks; ++i) chunk(view, batch, i);
            for (int i = 0; i < strips; ++i) strip(view, batch, i);
        } else if (part < chunks) {
            chunk(view, batch, part);
        } else {
            strip(view, batch, part - chunks);
        }
    }

    // Take units of work as `Packets::run` does. Where the next one has to wait for long, return: then the counter
    // shows that there is work left, and the caller sleeps before it comes again.
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
