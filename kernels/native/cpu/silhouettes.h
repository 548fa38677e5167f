// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// How much of each object a view sees: the object is drawn alone, on the part of the canvas that its box may cover, and
// compared block by block with an image of all objects. See kernels/silhouettes.py, which does the same by rays.

struct Survey {
    int count;  // of chosen objects
    const int* chosen;  // which they are, of all objects
    int objects;  // of the scene
    int canvas[4];  // x0, y0, x1, y1 in pixels of the image; the ends are not in it
    bool seen_only;  // whether what is beyond the image counts only for objects that are visible in it
    float near, far;
    const int* seen;  // [view][y][x]: object that is seen, -1 for none
    const float* depth;  // [view][y][x]; null where delta is 0
    float delta;  // how far behind what is seen a surface still counts as visible, along its ray
    char* counts;  // [counter][view][chosen]: ints
    long long count_stride, view_stride;  // bytes from a counter to the next, and from a view
    int* hidden_by;  // [view][chosen][object]: pixels
    unsigned char* masks;  // [view][chosen][y][x], or null: 1 for a silhouette, 2 where it is visible

    // Whether counting is all there is to do, of any depth.
    inline bool counts_all() const { return near <= 0.0f && far == __builtin_inff() && !masks; }
};

// Pixels of an object in a view, by what became of them.
struct Tally {
    int visible, image, silhouette, too_near, too_far;
    int visible_box[4], silhouette_box[4];  // greatest codes of what was met, 0 for nothing

    enum { box_middle = 1 << 24 };
    // The pixels of a block of 4 x 4 whose bits are set, where its first one is at (x, y).
    static inline void grow(int* box, unsigned bits, int x, int y) {
        if (holds(box, x, y, 4)) return;
        const unsigned columns = (bits | bits >> 4 | bits >> 8 | bits >> 12) & 15;
        const int code[4] = {box_middle - (x + __builtin_ctz(columns)), box_middle - (y + (__builtin_ctz(bits) >> 2)),
                             box_middle + x + 31 - __builtin_clz(columns),
                             box_middle + y + ((31 - __builtin_clz(bits)) >> 2)};
        for (int k = 0; k < 4; ++k)
            if (code[k] > box[k]) box[k] = code[k];
    }

    // Whether a square of pixels lies within a box that is known: then nothing in it makes the box larger.
    static inline bool holds(const int* box, int x, int y, int side) {
        return box_middle - x <= box[0] && box_middle - y <= box[1] && box_middle + x + side - 1 <= box[2] &&
               box_middle + y + side - 1 <= box[3];
    }

    // In the order of the counters in kernels/silhouettes.py.
    inline void write(const Survey& survey, int view, int place) const {
        const int single[5] = {visible, image, silhouette, too_near, too_far};
        for (int counter = 0; counter < 13; ++counter) {
            const int value = counter < 5   ? single[counter]
                              : counter < 9 ? visible_box[counter - 5]
                                            : silhouette_box[counter - 9];
            *(int*)(survey.counts + counter * survey.count_stride + view * survey.view_stride + place * 4LL) = value;
        }
    }
};

struct Silhouettes {
    // Tiles that are drawn at a time: they stay in a core's cache.
    enum { most_tiles = 512 };

    // Tiles that memory is for: at least one row of them.
    static inline int tiles_of(const Survey& survey) {
        const int row = (survey.canvas[2] - survey.canvas[0] + 15 + 15) >> 4;
        return row > most_tiles ? row : most_tiles;
    }

    // The image of some rows of a part of the canvas, in a thread's memory. Its pixels are at the same place whatever its
    // size: counting them leaves them empty.
    static inline Image carve(float* memory, const Survey& survey, const Job& part, int first_row, int rows,
                              float** rest) {
        const int tiles = tiles_of(survey);
        Image image = Image();
        image.width = part.width;
        image.height = rows;
        image.first_row = first_row;
        image.view_height = part.height;
        image.tiles_x = part.width >> 4;
        image.tiles_y = rows >> 4;
        memory += (-(unsigned long long)memory & 63) / 4;  // a register's worth must not straddle two cache lines
        image.w = memory;
        image.block_least = image.w + tiles * 256LL;
        image.tile_least = image.block_least + tiles * 16LL;
        image.block_stale = (unsigned char*)(image.tile_least + tiles);
        image.tile_stale = image.block_stale + tiles * 16LL;
        *rest = image.tile_least + tiles + tiles * 4LL + (tiles + 3) / 4;
        const int used = image.tiles_x * image.tiles_y;
        __builtin_memset(image.block_least, 0, used * 16 * sizeof(float));
        __builtin_memset(image.tile_least, 0, used * sizeof(float));
        __builtin_memset(image.block_stale, 0, used * 16);
        __builtin_memset(image.tile_stale, 0, used);
        return image;
    }

    // Where an object may be, in pixels of an image.
    static inline bool find(const Movables& movables, const World& world, int index, const Pose& pose, const Job& job,
                            const Image& image, Visit& found) {
        const Eye eye = View::eye(pose, job);
        const float center_x = (float)job.center[0], center_y = (float)(job.center[1] - image.first_row);
        const MovedBoxes boxes = MovedBoxes::of(movables.boxes + (long long)index * 6,
                                                world.poses + (long long)index * 7, 0, pose, eye, job.focal);
        const Ints lane = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
        const Bounds bounds = boxes.bounds(eye, image, center_x, center_y, lane == Lanes::all_ints(0));
        if (!Lanes::any(bounds.shown)) return false;
        float near[16];
        int x0[16], y0[16], x1[16], y1[16];
        Lanes::store(near, bounds.nearest_w * 1.0001f);
        bounds.store(x0, y0, x1, y1);
        found = Visit{index, near[0], x0[0], y0[0], x1[0], y1[0]};
        return true;
    }

    // The camera's job for a part of the canvas, from (x0, y0) on in the image's pixels.
    static inline Job part_of(const Job& job, int x0, int y0, int x1, int y1) {
        Job part = job;
        part.width = x1 - x0;
        part.height = y1 - y0;
        part.center[0] = job.center[0] - x0;
        part.center[1] = job.center[1] - y0;
        return part;
    }

    static inline void unit(const Tree& tree, const Movables& movables, const Job& job, const Survey& survey,
                            float* scratch, int unit) {
        const int view = unit / survey.count, place = unit % survey.count, index = survey.chosen[place];
        const World world = movables.of_view(view);
        if (!world.known || world.excludes(index)) return;
        const int in_image[4] = {0, 0, job.width, job.height};
        Tally tally = Tally();
        // What hides it is counted twice then, which does not change what hides most.
        if (survey.seen_only) measure(tree, movables, world, job, survey, in_image, view, place, scratch, tally);
        if (!survey.seen_only || tally.visible) {
            tally = Tally();
            measure(tree, movables, world, job, survey, survey.canvas, view, place, scratch, tally);
        }
        tally.write(survey, view, place);
    }

    // Count an object's pixels on a canvas, whose edges are as in `Survey`.
    static inline void measure(const Tree& tree, const Movables& movables, const World& world, const Job& job,
                               const Survey& survey, const int* edge, int view, int place, float* scratch,
                               Tally& tally) {
        const int index = survey.chosen[place];
        const Pose pose = Pose::from(job.poses + (long long)view * 7);
        const Job canvas = part_of(job, edge[0], edge[1], edge[2], edge[3]);
        Image whole = Image();
        whole.width = canvas.width;
        whole.height = whole.view_height = canvas.height;
        Visit visit;
        if (!find(movables, world, index, pose, canvas, whole, visit)) return;
        // Whole tiles: what of them is beyond the canvas is drawn, and not counted.
        const int x0 = edge[0] + visit.x0, y0 = edge[1] + visit.y0;
        const int width = (visit.x1 - visit.x0 + 16) & ~15, height = (visit.y1 - visit.y0 + 16) & ~15;
        const Job part = part_of(job, x0, y0, x0 + width, y0 + height);
        const int step = tiles_of(survey) / (width >> 4) * 16;
        for (int row = 0; row < height; row += step) {
            float* rest;
            const Image image = carve(scratch, survey, part, row, height - row < step ? height - row : step, &rest);
            draw(tree, movables, world, part, pose, index, image, Notes::carve(rest, movables.count));
            const Seen seen = {survey, job, edge, view, place, index, x0, y0 + row};
            seen.count(image, tally);
        }
    }

    static inline void draw(const Tree& tree, const Movables& movables, const World& world, const Job& job,
                            const Pose& pose, int index, const Image& image, const Notes& notes) {
        Visit visit;
        if (!find(movables, world, index, pose, job, image, visit)) return;
        const Eye eye = Packets::look_at_movable(movables, world, index, job, pose, notes.frames);
        const Solid& solid = notes.frames[index].solid;
        if (solid.kind != Solid::none) {
            const Solids::Place place = {visit.x0, visit.y0, visit.x1, visit.y1, visit.nearest_w};
            Solids::draw(solid, eye, image, job.center, place, 0, false, false);
            return;
        }
        const Ints owner = Lanes::all_ints(index);
        const float center_x = (float)job.center[0], center_y = (float)(job.center[1] - image.first_row);
        const Pyramid pyramid = View::pyramid(eye, image, center_x, center_y);
        Walk::draw(tree, movables.piece(tree, index, (const int*)&owner), eye, pyramid, image, center_x, center_y,
                   notes.stack, false, true);
    }

    // What is compared with a strip of an object's silhouette.
    struct Seen {
        const Survey& survey;
        const Job& job;  // of the image
        const int* edge;  // of the canvas
        int view, place, index;
        int x0, y0;  // where the strip begins, in pixels of the image

        // Count a strip's pixels, and leave it empty.
        inline void count(const Image& image, Tally& tally) const {
            for (int ty = 0; ty < image.tiles_y; ++ty)
                for (int tx = 0; tx < image.tiles_x; ++tx) {
                    float* tile = image.w + (ty * image.tiles_x + tx) * 256LL;
                    count_tile(tile, x0 + tx * 16, y0 + ty * 16, tally);
                }
        }

        inline void count_tile(float* tile, int x, int y, Tally& tally) const {
            const bool within = x >= edge[0] && y >= edge[1] && x + 16 <= edge[2] && y + 16 <= edge[3];
            const bool outside = x >= job.width || y >= job.height || x + 16 <= 0 || y + 16 <= 0;
            const bool inside_image = x >= 0 && y >= 0 && x + 16 <= job.width && y + 16 <= job.height;
            if (within && Tally::holds(tally.silhouette_box, x, y, 16)) {
                if (outside) tally.silhouette += count_all(tile);
                if (outside) return;
                if (inside_image && survey.counts_all()) return count_inside(tile, x, y, tally);
            }
            for (int block = 0; block < 16; ++block) {
                const Floats w = Lanes::load(tile + block * 16);
                Ints covered = w > Lanes::all(0.0f);
                if (!Lanes::any(covered)) continue;
                Lanes::store(tile + block * 16, Lanes::all(0.0f));
                const int block_x = x + (block & 3) * 4, block_y = y + (block >> 2) * 4;
                if (!within) covered &= inside(edge, block_x, block_y);
                if (within || Lanes::any(covered)) count_block(w, covered, block_x, block_y, tally);
            }
        }

        // A tile in the image whose silhouette makes no box larger: what the image shows there decides.
        inline void count_inside(float* tile, int x, int y, Tally& tally) const {
            const bool known = Tally::holds(tally.visible_box, x, y, 16);
            Ints silhouette = Lanes::all_ints(0), seen = silhouette;
            for (int block = 0; block < 16; ++block) {
                const Floats w = Lanes::load(tile + block * 16);
                const Ints covered = w > Lanes::all(0.0f);
                if (!Lanes::any(covered)) continue;
                Lanes::store(tile + block * 16, Lanes::all(0.0f));
                const int block_x = x + (block & 3) * 4, block_y = y + (block >> 2) * 4;
                const Ints shown = load_block(survey.seen, block_x, block_y);
                Ints visible = covered & (shown == Lanes::all_ints(index));
                if (survey.depth && Lanes::any(covered & ~visible))
                    visible |= covered & (behind(1.0f / w, 0xffff, true, block_x, block_y) <= Lanes::all(survey.delta));
                const Ints hidden = covered & ~visible;
                silhouette -= covered;
                seen -= visible;
                if (!known && Lanes::any(visible))
                    Tally::grow(tally.visible_box, Lanes::bits(visible), block_x, block_y);
                if (Lanes::any(hidden)) count_hidden(shown, hidden);
            }
            const int count = __builtin_reduce_add(silhouette);
            tally.silhouette += count;
            tally.image += count;
            tally.visible += __builtin_reduce_add(seen);
        }

        static inline int count_all(float* tile) {
            Ints sum = Lanes::all_ints(0);
            for (int block = 0; block < 16; ++block) {
                sum -= Lanes::load(tile + block * 16) > Lanes::all(0.0f);
                Lanes::store(tile + block * 16, Lanes::all(0.0f));
            }
            return __builtin_reduce_add(sum);
        }

        // Which pixels of a block are between least and greatest coordinates; the ends are not.
        static inline Ints inside(const int* edge, int x, int y) {
            const Ints column = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
            const Ints row = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
            return (column + x >= edge[0]) & (column + x < edge[2]) & (row + y >= edge[1]) & (row + y < edge[3]);
        }

        inline void count_block(Floats w, Ints covered, int x, int y, Tally& tally) const {
            const unsigned all = Lanes::bits(covered);
            tally.silhouette += __builtin_popcount(all);
            Tally::grow(tally.silhouette_box, all, x, y);
            const bool whole = x >= 0 && y >= 0 && x + 4 <= job.width && y + 4 <= job.height;
            const int image_edge[4] = {0, 0, job.width, job.height};
            if (!whole) covered &= inside(image_edge, x, y);
            const unsigned in_image = whole ? all : Lanes::bits(covered);
            if (!in_image) return;
            tally.image += __builtin_popcount(in_image);

            const Ints shown = gather(survey.seen, in_image, whole, x, y);
            const Floats z = 1.0f / w;
            const Ints near = covered & (z < Lanes::all(survey.near)), far = covered & (z > Lanes::all(survey.far));
            Ints visible = shown == Lanes::all_ints(index);
            if (survey.depth) visible |= behind(z, in_image, whole, x, y) <= Lanes::all(survey.delta);
            visible &= covered & ~near & ~far;
            const unsigned bits = Lanes::bits(visible);
            if (bits) {
                tally.visible += __builtin_popcount(bits);
                Tally::grow(tally.visible_box, bits, x, y);
            }
            if (bits != in_image) {
                tally.too_near += __builtin_popcount(Lanes::bits(near));
                tally.too_far += __builtin_popcount(Lanes::bits(far));
                count_hidden(shown, covered & ~near & ~far & ~visible);
            }
            if (survey.masks) write_masks(in_image, bits, x, y);
        }

        // How far a surface lies behind what is seen, along its rays.
        inline Floats behind(Floats z, unsigned in_image, bool whole, int x, int y) const {
            const Floats column = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
            const Floats row = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
            const Floats u = (column + (float)(x + 0.5 - job.center[0])) * (float)(1.0 / job.focal[0]);
            const Floats v = (row + (float)(y + 0.5 - job.center[1])) * (float)(1.0 / job.focal[1]);
            const Ints surface = gather((const int*)survey.depth, in_image, whole, x, y);
            Floats depth;
            __builtin_memcpy(&depth, &surface, sizeof depth);
            return (z - depth) * __builtin_elementwise_sqrt(u * u + (v * v + 1.0f));
        }

        // A block of an image, of any kind of four bytes, that is all inside of it.
        inline Ints load_block(const int* image, int x, int y) const {
            typedef int Four __attribute__((ext_vector_type(4)));
            const int* from = image + ((long long)view * job.height + y) * job.width + x;
            Four row[4];
            for (int r = 0; r < 4; ++r) __builtin_memcpy(&row[r], from + (long long)r * job.width, sizeof row[r]);
            const auto upper = __builtin_shufflevector(row[0], row[1], 0, 1, 2, 3, 4, 5, 6, 7);
            const auto lower = __builtin_shufflevector(row[2], row[3], 0, 1, 2, 3, 4, 5, 6, 7);
            return __builtin_shufflevector(upper, lower, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        }

        // One that may reach beyond it: -1 there.
        inline Ints gather(const int* image, unsigned in_image, bool whole, int x, int y) const {
            if (whole) return load_block(image, x, y);
            const int* from = image + ((long long)view * job.height + y) * job.width + x;
            int block[16];
            for (int k = 0; k < 16; ++k)
                block[k] = (in_image >> k) & 1 ? from[(k >> 2) * (long long)job.width + (k & 3)] : -1;
            return Lanes::load(block);
        }

        inline void count_hidden(Ints shown, Ints hidden) const {
            int object[16];
            Lanes::store(object, shown);
            int* by = survey.hidden_by + ((long long)view * survey.count + place) * survey.objects;
            for (unsigned left = Lanes::bits(hidden & (shown >= Lanes::all_ints(0))); left;) {
                const int occluder = object[Lanes::first_lane(left)];
                const unsigned same = left & Lanes::bits(shown == Lanes::all_ints(occluder));
                by[occluder] += __builtin_popcount(same);
                left &= ~same;
            }
        }

        inline void write_masks(unsigned in_image, unsigned visible, int x, int y) const {
            unsigned char* mask = survey.masks + ((long long)view * survey.count + place) * job.height * job.width;
            for (unsigned left = in_image; left; left &= left - 1) {
                const int k = Lanes::first_lane(left);
                mask[(long long)(y + (k >> 2)) * job.width + x + (k & 3)] = (visible >> k) & 1 ? 2 : 1;
            }
        }
    };

    // Take units of work, an object in a view each, until none are left.
    static inline void run(const Tree& tree, const Movables& movables, const Job& job, const Survey& survey,
                           float* scratch, int* counter) {
        const int units = job.views * survey.count;
        for (;;) {
            const int next = __atomic_fetch_add(counter + Packets::next_unit, 1, __ATOMIC_RELAXED);
            if (next >= units) break;
            unit(tree, movables, job, survey, scratch, next);
        }
        Packets::await_others(counter);
    }
};
