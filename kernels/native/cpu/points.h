// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Points of the world: where they are in a view's image, and whether anything is in the way of them.
//
// First, chunk by chunk, points are projected. Those out of view or out of range are done with; the others are sorted
// by the rows of tiles that they are in. Then, strip by strip, they are sorted into the cells of a sparse image, in which
// each lane begins with the greatest w = 1 / z that does not hide its point, as if that had been drawn already: the walk
// passes over what lies behind all points of a cell, and a lane that anything is nearer than is settled.

// A point in view and in range.
struct Spot {
    float u, v, w;
    unsigned key;  // which of its chunk's points it is, and above that its cell in a row of tiles
};

struct PointJob {
    enum { chunk = 8192, chunk_bits = 13 };  // points
    enum { out_of_view, too_near, too_far, occluded, visible };  // as in `warpvis.Visibility`
    const float* place;  // [point]: x y z in the world
    int count;  // points, of every view
    int batch;  // of them that are worked on at a time
    int strip_tiles;  // rows of tiles in a strip
    bool whole;  // whether a unit of work is a view, not a part of one
    double width, height;  // of the image, in the job's pixels, which need not be the camera's
    float tolerance;  // how far behind a surface a point still counts as seen [m]
    unsigned char* status;  // [view][point]
    int* occluders;  // [view][point], or null

    inline int batches() const { return (int)(((long long)count + batch - 1) / batch); }
    inline int chunks() const { return (batch + chunk - 1) / chunk; }  // of a batch
};

// What is known of a view's points while they are worked on.
struct Desk {
    int rows;  // of tiles in the image
    int* ends;  // [chunk][row]: where its spots end
    Spot* spots;  // [chunk][spot], by rows
    float* lanes;  // of packets: numbers of points, u, v, w, and, if anybody asks, what hides them
    long long room;  // for so many lanes
    bool with_id;

    static inline Desk carve(float* memory, const PointJob& points, int rows, long long room, bool with_id) {
        Desk desk = {rows, (int*)memory, nullptr, nullptr, room, with_id};
        desk.spots = (Spot*)(memory + ((long long)points.chunks() * rows + 15) / 16 * 16);
        desk.lanes = (float*)(desk.spots + (long long)points.chunks() * PointJob::chunk);
        return desk;
    }

    inline int begin_of(int chunk, int row) const { return row > 0 ? ends[(long long)chunk * rows + row - 1] : 0; }
    inline int end_of(int chunk, int row) const { return ends[(long long)chunk * rows + row]; }

    // Spots in some rows.
    inline int count(int chunks, int first, int end) const {
        int sum = 0;
        for (int chunk = 0; chunk < chunks; ++chunk) sum += end_of(chunk, end - 1) - begin_of(chunk, first);
        return sum;
    }
};

// Sixteen points in a view.
struct Projection {
    Floats u, v, w;
    Ints column, row;  // of pixels
    Ints status;  // visible as far as is known

    typedef float Floats8 __attribute__((ext_vector_type(8)));
    typedef int Ints8 __attribute__((ext_vector_type(8)));
    typedef double Doubles8 __attribute__((ext_vector_type(8)));

    // Eight of them: for sixteen in double precision there are too few registers.
    struct Half {
        Floats8 u, v, w, depth;
        Ints8 column, row, in_view;

        static inline Half of(const Pose& pose, const Job& job, const PointJob& points, Floats8 at_x, Floats8 at_y,
                              Floats8 at_z) {
            const Doubles8 x = exact(at_x) - pose.position[0], y = exact(at_y) - pose.position[1],
                           z = exact(at_z) - pose.position[2], none = (Doubles8)(0.0);
            const ExactRow* m = pose.axis;
            const Doubles8 ahead = m[2][0] * x + (m[2][1] * y + m[2][2] * z), w = 1.0 / ahead;
            const Doubles8 right = (m[0][0] * x + (m[0][1] * y + m[0][2] * z)) * job.focal[0];
            const Doubles8 down = (m[1][0] * x + (m[1][1] * y + m[1][2] * z)) * job.focal[1];
            // Not by the quotients, whose rounding would decide for points on a border.
            const Doubles8 left = right + job.center[0] * ahead, top = down + job.center[1] * ahead;
            const auto in_view = (ahead > none) & (left >= none) & (left < points.width * ahead) & (top >= none) &
                                 (top < points.height * ahead);
            const Doubles8 column = in_view ? left * w : none, row = in_view ? top * w : none;
            return Half{narrow(right * w),
                        narrow(down * w),
                        narrow(w),
                        narrow(ahead),
                        before(__builtin_convertvector(column, Ints8), job.width),
                        before(__builtin_convertvector(row, Ints8), job.height),
                        __builtin_convertvector(in_view, Ints8)};
        }
        static inline Ints8 before(Ints8 value, int end) { return value < end ? value : end - 1; }
        static inline Doubles8 exact(Floats8 value) { return __builtin_convertvector(value, Doubles8); }
        static inline Floats8 narrow(Doubles8 value) { return __builtin_convertvector(value, Floats8); }
    };

    static inline Floats join(Floats8 a, Floats8 b) {
        return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }
    static inline Ints join(Ints8 a, Ints8 b) {
        return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }

    static inline Projection of(const Pose& pose, const Job& job, const PointJob& points, Points at) {
        const Half a = Half::of(pose, job, points, at.x.lo, at.y.lo, at.z.lo);
        const Half b = Half::of(pose, job, points, at.x.hi, at.y.hi, at.z.hi);
        const Floats depth = join(a.depth, b.depth);
        Ints status = Lanes::all_ints(PointJob::visible);
        status = depth > Lanes::all(job.far) ? Lanes::all_ints(PointJob::too_far) : status;
        status = depth < Lanes::all(job.near) ? Lanes::all_ints(PointJob::too_near) : status;
        status = join(a.in_view, b.in_view) ? status : Lanes::all_ints(PointJob::out_of_view);
        return Projection{join(a.u, b.u),           join(a.v, b.v),     join(a.w, b.w),
                          join(a.column, b.column), join(a.row, b.row), status};
    }
};

// The first half of the work: a chunk of points becomes spots, by rows of tiles.
struct Chunk {
    static inline void sort(const Pose& pose, const Job& job, const PointJob& points, const Desk& desk, int view,
                            int number, int first, int count, Spot* loose) {
        unsigned short row_of[PointJob::chunk];
        const int found = project(pose, job, points, view, first, count, loose, row_of);
        int* place = desk.ends + (long long)number * desk.rows;
        for (int row = 0; row < desk.rows; ++row) place[row] = 0;
        for (int i = 0; i < found; ++i) place[row_of[i]] += 1;
        sum_up(place, desk.rows);
        Spot* spots = desk.spots + (long long)number * PointJob::chunk;
        for (int i = 0; i < found; ++i) spots[place[row_of[i]]++] = loose[i];
    }

    // Say what points are that cannot be hidden, and note the others and their rows; returns how many.
    static inline int project(const Pose& pose, const Job& job, const PointJob& points, int view, int first, int count,
                              Spot* loose, unsigned short* row_of) {
        const Ints lane = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
        int found = 0;
        for (int i = 0; i < count; i += 16) {
            const int here = count - i < 16 ? count - i : 16;
            const Projection p = Projection::of(pose, job, points, load(points.place + (first + i) * 3LL, here));
            write(points, (long long)view * points.count + first + i, p.status, here);
            unsigned seen = Lanes::bits(p.status == Lanes::all_ints(PointJob::visible)) & ((1u << here) - 1);
            if (!seen) continue;
            const Ints cell = ((p.column >> 4) << 4) + (p.row & 12) + ((p.column >> 2) & 3);
            float u[16], v[16], w[16];
            int key[16], row[16];
            Lanes::store(u, p.u);
            Lanes::store(v, p.v);
            Lanes::store(w, p.w);
            Lanes::store(key, (cell << PointJob::chunk_bits) | (lane + i));
            Lanes::store(row, p.row >> 4);
            for (; seen; seen &= seen - 1) {
                const int k = Lanes::first_lane(seen);
                loose[found] = Spot{u[k], v[k], w[k], (unsigned)key[k]};
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

    // Sixteen points, or as many as there are.
    static inline Points load(const float* from, int count) {
        float last[48] = {};
        if (count < 16) {
            __builtin_memcpy(last, from, count * 3 * sizeof(last[0]));
            from = last;
        }
        const Floats a = Lanes::load(from), b = Lanes::load(from + 16), c = Lanes::load(from + 32);
        const Floats x = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0);
        const Floats y = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0);
        const Floats z = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0);
        return Points{__builtin_shufflevector(x, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29),
                      __builtin_shufflevector(y, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30),
                      __builtin_shufflevector(z, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31)};
    }

    static inline void write(const PointJob& points, long long at, Ints status, int count) {
        typedef unsigned char Bytes __attribute__((ext_vector_type(16)));
        const Bytes narrow = __builtin_convertvector(status, Bytes);
        if (count == 16)
            __builtin_memcpy(points.status + at, &narrow, 16);
        else
            __builtin_memcpy(points.status + at, &narrow, count);
        for (int k = 0; k < count && points.occluders; ++k) points.occluders[at + k] = -1;
    }
};

// The second half: a strip of the image is drawn.
struct PointStrip {
    static inline Image carve(const Desk& desk, const Job& job, const PointJob& points, const Judge& judge, int strip,
                              float* memory, float** rest) {
        Image image;
        image.width = job.width;
        image.first_row = strip * points.strip_tiles * 16;
        const int left = job.height - image.first_row, most = points.strip_tiles * 16;
        image.height = left < most ? left : most;
        image.view_height = job.height;
        image.tiles_x = (image.width + 15) >> 4;
        image.tiles_y = (image.height + 15) >> 4;
        image.empty = nullptr;
        image.rows = nullptr;
        image.id_rows = nullptr;
        image.judge = &judge;
        long long before = 0;
        for (int other = 0; other < strip; ++other) {
            const int first = other * points.strip_tiles, end = first + points.strip_tiles;
            before += room_for(desk.count(points.chunks(), first, end), image.tiles_x * points.strip_tiles * 16);
        }
        float* const lanes = desk.lanes + before;
        image.point_index = (int*)lanes;
        image.point_u = lanes + desk.room;
        image.point_v = lanes + desk.room * 2;
        image.w = lanes + desk.room * 3;
        image.id = desk.with_id ? (int*)(lanes + desk.room * 4) : nullptr;
        image.first_packet = (int*)memory;
        memory += image.tiles_x * image.tiles_y * 16 + 16;
        return Scratch::carve_blocks(image, memory, (long long)image.tiles_x * image.tiles_y, rest);
    }

    // Lanes that the packets of so many points in so many cells have at most.
    static inline long long room_for(long long points, long long cells) {
        return (points + 15 * (points < cells ? points : cells)) / 16 * 16;
    }

    // Sort a strip's spots into cells, and turn them into packets, a row of tiles at a time.
    static inline void place(const Image& image, const Job& job, const PointJob& points, const Desk& desk, Spot* placed,
                             int* ends) {
        const int cells = image.tiles_x * 16;
        int packets = 0;
        for (int row = 0; row < image.tiles_y; ++row) {
            sort(desk, points.chunks(), (image.first_row >> 4) + row, cells, placed, ends);
            for (int c = 0; c < cells; ++c) {
                const int cell = row * cells + c;
                Floats least = Lanes::all(3e38f);
                image.first_packet[cell] = packets;
                for (int i = c > 0 ? ends[c - 1] : 0; i < ends[c]; i += 16)
                    least = Lanes::least(least, pack(image, job, points.tolerance, packets++, placed + i, ends[c] - i));
                image.block_least[cell] = Lanes::least_of(least);
            }
        }
        image.first_packet[cells * image.tiles_y] = packets;
        __builtin_memset(image.block_stale, 0, cells * image.tiles_y);
        __builtin_memset(image.tile_stale, 1, image.tiles_x * image.tiles_y);
    }

    // The spots of a row of tiles by cells, and where those of each cell end: count, sum up, place.
    static inline void sort(const Desk& desk, int chunks, int row, int cells, Spot* placed, int* ends) {
        for (int c = 0; c < cells; ++c) ends[c] = 0;
        for (int chunk = 0; chunk < chunks; ++chunk) {
            const Spot* spots = desk.spots + (long long)chunk * PointJob::chunk;
            const int end = desk.end_of(chunk, row);
            for (int i = desk.begin_of(chunk, row); i < end; ++i) ends[spots[i].key >> PointJob::chunk_bits] += 1;
        }
        Chunk::sum_up(ends, cells);
        for (int chunk = 0; chunk < chunks; ++chunk) {
            const Spot* spots = desk.spots + (long long)chunk * PointJob::chunk;
            const int end = desk.end_of(chunk, row), first = chunk * PointJob::chunk;
            for (int i = desk.begin_of(chunk, row); i < end; ++i) {
                Spot spot = spots[i];
                Spot& to = placed[ends[spot.key >> PointJob::chunk_bits]++];
                spot.key = first + (spot.key & (PointJob::chunk - 1));  // from here on, in the batch
                to = spot;
            }
        }
    }

    // Sixteen spots, or as many as there are. A lane without a point hides, and never shows.
    static inline Floats pack(const Image& image, const Job& job, float tolerance, int packet, const Spot* spots,
                              int count) {
        const float* from = (const float*)spots;
        const Floats a = Lanes::load(from), b = Lanes::load(from + 16);
        const Floats c = Lanes::load(from + 32), d = Lanes::load(from + 48);
        const Floats ab_uv = __builtin_shufflevector(a, b, 0, 4, 8, 12, 16, 20, 24, 28, 1, 5, 9, 13, 17, 21, 25, 29);
        const Floats cd_uv = __builtin_shufflevector(c, d, 0, 4, 8, 12, 16, 20, 24, 28, 1, 5, 9, 13, 17, 21, 25, 29);
        const Floats ab_wk = __builtin_shufflevector(a, b, 2, 6, 10, 14, 18, 22, 26, 30, 3, 7, 11, 15, 19, 23, 27, 31);
        const Floats cd_wk = __builtin_shufflevector(c, d, 2, 6, 10, 14, 18, 22, 26, 30, 3, 7, 11, 15, 19, 23, 27, 31);
        const Floats u = Projection::join(ab_uv.lo, cd_uv.lo), v = Projection::join(ab_uv.hi, cd_uv.hi);
        const Ints lane = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}, taken = lane < Lanes::all_ints(count);
        const Floats w = limit(job, tolerance, u, v, Projection::join(ab_wk.lo, cd_wk.lo));
        const Floats least = taken ? w : Lanes::all(3e38f);
        Lanes::store(image.point_u + packet * 16, u);
        Lanes::store(image.point_v + packet * 16, v);
        Lanes::store(image.w + packet * 16, least);
        Lanes::store(image.point_index + packet * 16,
                     taken ? (Ints)Projection::join(ab_wk.hi, cd_wk.hi) : Lanes::all_ints(-1));
        if (image.id) Lanes::store(image.id + packet * 16, Lanes::all_ints(-1));
        return least;
    }

    // The greatest w of a surface that does not hide the point whose w is given. Where the ray of z = 1 has the length s,
    // what is nearer by the tolerance t along it is at z - t / s, and its w is w + w * w t / (s - w t): a sum that loses
    // no digits.
    static inline Floats limit(const Job& job, float tolerance, Floats u, Floats v, Floats w) {
        const Floats most = Lanes::all(2e38f);  // less than of a lane that is settled
        const Floats x = u * (float)(1.0 / job.focal[0]), y = v * (float)(1.0 / job.focal[1]), nearer = tolerance * w;
        const Floats left = __builtin_elementwise_sqrt(x * x + (y * y + 1.0f)) - nearer;
        return left > Lanes::all(0.0f) ? Lanes::least(w + w * (nearer / left), most) : most;
    }

    // What is hidden: all others count as visible already.
    static inline void write(const Image& image, const PointJob& points, long long at) {
        const int packets = image.first_packet[image.tiles_x * image.tiles_y * 16];
        for (int first = 0; first < packets * 16; first += 16) {
            Ints hidden = Lanes::load(image.point_index + first) >= Lanes::all_ints(0);
            hidden &= image.id ? Lanes::load(image.id + first) >= Lanes::all_ints(0)
                               : Lanes::load(image.w + first) == Lanes::all(3e38f);
            for (unsigned left = Lanes::bits(hidden); left; left &= left - 1) {
                const int lane = first + Lanes::first_lane(left);
                points.status[at + image.point_index[lane]] = PointJob::occluded;
                if (points.occluders) points.occluders[at + image.point_index[lane]] = image.id[lane];
            }
        }
    }
};

struct PointPackets {
    static inline void chunk(const Job& job, const PointJob& points, const Desk& desk, int view, int batch, int number,
                             float* memory) {
        const long long first = (long long)batch * points.batch + (long long)number * PointJob::chunk;
        const long long all = (batch + 1LL) * points.batch, end = all < points.count ? all : points.count;
        const long long left = first < end ? end - first : 0, count = left < PointJob::chunk ? left : PointJob::chunk;
        const Pose pose = Pose::from(job.poses + (long long)view * 7);
        Chunk::sort(pose, job, points, desk, view, number, (int)first, (int)count, (Spot*)memory);
    }

    // `memory`: of this worker, first for spots.
    static inline void strip(const Tree& tree, const Movables& movables, const Job& job, const PointJob& points,
                             const Desk& desk, int view, int batch, int number, float* memory) {
        const int first = number * points.strip_tiles, end = first + points.strip_tiles;
        const World world = movables.of_view(view);
        if (!world.known || !desk.count(points.chunks(), first, end < desk.rows ? end : desk.rows)) return;
        const long long before = (long long)batch * points.batch;
        const Pose pose = Pose::from(job.poses + (long long)view * 7);
        const Judge judge = {points.place + before * 3, pose, {job.focal[0], job.focal[1]}, points.tolerance};
        Spot* placed = (Spot*)memory;
        float* rest = memory + (points.batch + 16) * 4LL;
        const Image image = PointStrip::carve(desk, job, points, judge, number, rest, &rest);
        PointStrip::place(image, job, points, desk, placed, (int*)rest);
        const Notes notes = Notes::carve(rest + image.tiles_x * 16, movables.count);
        Packets::draw(tree, movables, world, job, pose, View::eye(pose, job), image, notes, true, true);
        PointStrip::write(image, points, (long long)view * points.count + before);
    }

    enum { done = Packets::finished + 1 };  // units, of a job's counters

    // Take units of work as `Packets::run` does. Of a view's batch of points there are first all chunks, then all strips,
    // which wait for the chunks, as the next batch's chunks do for the strips: whoever took those is at work on them.
    static inline void run(const Tree& tree, const Movables& movables, const Job& job, const PointJob& points,
                           const Desk& desk, float* memory, int* counter) {
        const int chunks = points.chunks(), strips = (desk.rows + points.strip_tiles - 1) / points.strip_tiles;
        const int batches = points.batches(), parts = points.whole ? 1 : chunks + strips;
        for (;;) {
            const int unit = __atomic_fetch_add(counter + Packets::next_unit, 1, __ATOMIC_RELAXED);
            if (unit >= job.views * batches * parts) break;
            const int turn = unit / parts, view = turn / batches, batch = turn % batches, part = unit % parts;
            if (points.whole) {
                for (int i = 0; i < chunks; ++i) chunk(job, points, desk, view, batch, i, memory);
                for (int i = 0; i < strips; ++i) strip(tree, movables, job, points, desk, view, batch, i, memory);
                continue;
            }
            const int before = turn * parts + (part < chunks ? 0 : chunks);
            while (__atomic_load_n(counter + done, __ATOMIC_ACQUIRE) < before) {
            }
            if (part < chunks)
                chunk(job, points, desk, view, batch, part, memory);
            else
                strip(tree, movables, job, points, desk, view, batch, part - chunks, memory);
            __atomic_fetch_add(counter + done, 1, __ATOMIC_RELEASE);
        }
        Packets::await_others(counter);
    }
};
