// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Visible fractions of objects: each object is rasterized in isolation, on the part of the canvas that its box may
// cover, and compared block by block with an image of all objects. kernels/visibility/silhouettes.py does so with rays.

#pragma once

#include "cpu/packets.h"

struct SilhouetteJob {
    int count;  // of chosen objects
    const int* chosen;  // object indices
    int objects;  // of the scene
    int canvas[4];  // x0, y0, x1, y1 in pixels of the image, end exclusive
    bool seen_only;  // whether pixels outside the image count only for objects that are visible in it
    float near, far;
    const int* seen;  // [view][y][x]: visible object, -1 for none
    const float* depth;  // [view][y][x]; null if delta is 0
    float delta;  // distance behind the visible surface, along the ray, up to which a surface counts as visible
    char* counts;  // [counter][view][chosen]: ints
    long long count_stride, view_stride;  // bytes between counters and between views
    int* hidden_by;  // [view][chosen][object]: pixels occluded by that object
    unsigned char* masks;  // [view][chosen][y][x]: MASK_VISIBLE or MASK_HIDDEN in the silhouette; or null

    // The job of a `SilhouetteCall` of kernels/visibility/silhouette_packets.py.
    template <class SilhouetteCall, class Counts, class HiddenBy, class Masks>
    static inline SilhouetteJob of(const SilhouetteCall& call, const Counts& counts, const HiddenBy& hidden_by,
                                   const Masks& masks) {
        const auto& canvas = call.canvas;
        return SilhouetteJob{.count = call.chosen.index.shape[0],
                             .chosen = call.chosen.index.data,
                             .objects = call.scene.object_count,
                             .canvas = {canvas.x0, canvas.y0, canvas.x1, canvas.y1},
                             .seen_only = canvas.seen_only != 0,
                             .near = call.camera.near,
                             .far = call.camera.far,
                             .seen = call.comparison.segmentation.data,
                             .depth = call.comparison.depth.data,
                             .delta = call.comparison.delta,
                             .counts = (char*)counts.data,
                             .count_stride = counts.strides[0],
                             .view_stride = counts.strides[1],
                             .hidden_by = hidden_by.data,
                             .masks = masks.data};
    }
    // Whether all depths are in range and no masks are requested, so that only counts are needed.
    inline bool counts_all() const { return near <= 0.0f && far == __builtin_inff() && !masks; }
};

// Counters of an object's pixels in a view, by visibility.
struct PixelCounts {
    int visible, image, silhouette, too_near, too_far;
    int visible_box[4], silhouette_box[4];  // greatest codes so far, 0 if none (see SilhouetteCounter)

    // Grow a box by the pixels of a 4 x 4 block, starting at (x, y), whose bits are set.
    static inline void grow(int* box, unsigned bits, int x, int y) {
        if (holds(box, x, y, BLOCK_SIDE)) return;
        unsigned columns = 0;
        for (int row = 0; row < BLOCK_SIDE; ++row) columns |= bits >> row * BLOCK_SIDE & ((1 << BLOCK_SIDE) - 1);
        const int code[4] = {BOX_MIDDLE - (x + __builtin_ctz(columns)),
                             BOX_MIDDLE - (y + __builtin_ctz(bits) / BLOCK_SIDE), BOX_MIDDLE + x + last_bit(columns),
                             BOX_MIDDLE + y + last_bit(bits) / BLOCK_SIDE};
        for (int k = 0; k < 4; ++k)
            if (code[k] > box[k]) box[k] = code[k];
    }

    static inline int last_bit(unsigned bits) { return 31 - __builtin_clz(bits); }

    // Whether a box already contains a square of pixels, which then cannot grow it.
    static inline bool holds(const int* box, int x, int y, int side) {
        return BOX_MIDDLE - x <= box[0] && BOX_MIDDLE - y <= box[1] && BOX_MIDDLE + x + side - 1 <= box[2] &&
               BOX_MIDDLE + y + side - 1 <= box[3];
    }

    inline void write(const SilhouetteJob& request, int view, int place) const {
        const int* values = &visible;  // all counters, in order
        for (int counter = 0; counter < SILHOUETTE_COUNTERS; ++counter) {
            char* target =
                request.counts + counter * request.count_stride + view * request.view_stride + place * sizeof(int);
            *(int*)target = values[counter];
        }
    }
};
static_assert(sizeof(PixelCounts) == SILHOUETTE_COUNTERS * sizeof(int), "all counters, and nothing else");
static_assert(VISIBLE_PIXELS == 0 && IMAGE_PIXELS == 1 && SILHOUETTE_PIXELS == 2 && TOO_NEAR_PIXELS == 3 &&
                  TOO_FAR_PIXELS == 4 && VISIBLE_BOX == 5 && SILHOUETTE_BOX == 9,
              "the counters' order");

// Comparison of a strip of an object's silhouette with the image.
struct Comparison {
    const SilhouetteJob& request;
    const Job& job;  // of the image
    const int* edge;  // of the canvas
    int view, place, index;
    int x0, y0;  // first pixel of the strip, in the image

    // Count a strip's pixels, and clear it.
    inline void count(const Image& image, PixelCounts& counts) const {
        for (int ty = 0; ty < image.tiles_y; ++ty)
            for (int tx = 0; tx < image.tiles_x; ++tx) {
                float* tile = image.inv_z + (ty * image.tiles_x + tx) * (long long)TILE_PIXELS;
                count_tile(tile, x0 + tx * TILE_SIDE, y0 + ty * TILE_SIDE, counts);
            }
    }

    inline void count_tile(float* tile, int x, int y, PixelCounts& counts) const {
        const bool within = x >= edge[0] && y >= edge[1] && x + TILE_SIDE <= edge[2] && y + TILE_SIDE <= edge[3];
        const bool outside = x >= job.width || y >= job.height || x + TILE_SIDE <= 0 || y + TILE_SIDE <= 0;
        const bool inside_image = x >= 0 && y >= 0 && x + TILE_SIDE <= job.width && y + TILE_SIDE <= job.height;
        if (within && PixelCounts::holds(counts.silhouette_box, x, y, TILE_SIDE)) {
            if (outside) counts.silhouette += count_all(tile);
            if (outside) return;
            if (inside_image && request.counts_all()) return count_inside(tile, x, y, counts);
        }
        take_blocks(tile, x, y, [&](Floats inv_z, Ints covered, int block_x, int block_y) {
            if (!within) covered &= inside(edge, block_x, block_y);
            if (within || Lanes::any(covered)) count_block(inv_z, covered, block_x, block_y, counts);
        });
    }

    // Call `take(inv_z, covered, x, y)` for the blocks of a tile with covered pixels, and clear them.
    template <class Take>
    static inline __attribute__((always_inline)) void take_blocks(float* tile, int x, int y, Take take) {
        for (int block = 0; block < TILE_BLOCKS; ++block) {
            const Floats inv_z = Lanes::load(tile + block * BLOCK_PIXELS);
            const Ints covered = inv_z > Lanes::all(0.0f);
            if (!Lanes::any(covered)) continue;
            Lanes::store(tile + block * BLOCK_PIXELS, Lanes::all(0.0f));
            take(inv_z, covered, x + block % BLOCKS_ACROSS * BLOCK_SIDE, y + block / BLOCKS_ACROSS * BLOCK_SIDE);
        }
    }

    // Count a tile inside the image that cannot grow the silhouette's box: only the visible objects there matter.
    inline void count_inside(float* tile, int x, int y, PixelCounts& counts) const {
        const bool is_inside_box = PixelCounts::holds(counts.visible_box, x, y, TILE_SIDE);
        Ints silhouette = Lanes::all_ints(0), seen = silhouette;
        take_blocks(tile, x, y, [&](Floats inv_z, Ints covered, int block_x, int block_y) {
            const Ints shown = load_block(request.seen, block_x, block_y);
            Ints visible = covered & (shown == Lanes::all_ints(index));
            if (request.depth && Lanes::any(covered & ~visible))
                visible |= covered & (behind(1.0f / inv_z, (1 << LANES) - 1, true, block_x, block_y) <=
                                      Lanes::all(request.delta));
            const Ints hidden = covered & ~visible;
            silhouette -= covered;
            seen -= visible;
            if (!is_inside_box && Lanes::any(visible))
                PixelCounts::grow(counts.visible_box, Lanes::bits(visible), block_x, block_y);
            if (Lanes::any(hidden)) count_hidden(shown, hidden);
        });
        const int count = __builtin_reduce_add(silhouette);
        counts.silhouette += count;
        counts.image += count;
        counts.visible += __builtin_reduce_add(seen);
    }

    static inline int count_all(float* tile) {
        Ints sum = Lanes::all_ints(0);
        for (unsigned block = 0; block < TILE_BLOCKS; ++block) {
            sum -= Lanes::load(tile + block * BLOCK_PIXELS) > Lanes::all(0.0f);
            Lanes::store(tile + block * BLOCK_PIXELS, Lanes::all(0.0f));
        }
        return __builtin_reduce_add(sum);
    }

    // Mask of a block's pixels inside a rectangle, end exclusive.
    static inline Ints inside(const int* edge, int x, int y) {
        const Ints column = Grid::column(), row = Grid::row();
        return (column + x >= edge[0]) & (column + x < edge[2]) & (row + y >= edge[1]) & (row + y < edge[3]);
    }

    inline void count_block(Floats inv_z, Ints covered, int x, int y, PixelCounts& counts) const {
        const unsigned covered_bits = Lanes::bits(covered);
        counts.silhouette += __builtin_popcount(covered_bits);
        PixelCounts::grow(counts.silhouette_box, covered_bits, x, y);
        const bool is_inside = x >= 0 && y >= 0 && x + BLOCK_SIDE <= job.width && y + BLOCK_SIDE <= job.height;
        const int image_edge[4] = {0, 0, job.width, job.height};
        if (!is_inside) covered &= inside(image_edge, x, y);
        const unsigned in_image = is_inside ? covered_bits : Lanes::bits(covered);
        if (!in_image) return;
        counts.image += __builtin_popcount(in_image);

        const Ints shown = gather(request.seen, in_image, is_inside, x, y);
        const Floats z = 1.0f / inv_z;
        const Ints near = covered & (z < Lanes::all(request.near)), far = covered & (z > Lanes::all(request.far));
        Ints visible = shown == Lanes::all_ints(index);
        if (request.depth) visible |= behind(z, in_image, is_inside, x, y) <= Lanes::all(request.delta);
        visible &= covered & ~near & ~far;
        const unsigned bits = Lanes::bits(visible);
        if (bits) {
            counts.visible += __builtin_popcount(bits);
            PixelCounts::grow(counts.visible_box, bits, x, y);
        }
        if (bits != in_image) {
            counts.too_near += __builtin_popcount(Lanes::bits(near));
            counts.too_far += __builtin_popcount(Lanes::bits(far));
            count_hidden(shown, covered & ~near & ~far & ~visible);
        }
        if (request.masks) write_masks(in_image, bits, x, y);
    }

    // Distance of a surface behind the visible surface, along the rays.
    inline Floats behind(Floats z, unsigned in_image, bool is_inside, int x, int y) const {
        const Floats column = Grid::column_floats(), row = Grid::row_floats();
        const Floats u = (column + (float)(x + 0.5 - job.center[0])) * (float)(1.0 / job.focal[0]);
        const Floats v = (row + (float)(y + 0.5 - job.center[1])) * (float)(1.0 / job.focal[1]);
        const Ints surface = gather((const int*)request.depth, in_image, is_inside, x, y);
        Floats depth;
        __builtin_memcpy(&depth, &surface, sizeof depth);
        return (z - depth) * __builtin_elementwise_sqrt(u * u + (v * v + 1.0f));
    }

    // Load a block of an image of four-byte values; the block lies inside the image.
    inline Ints load_block(const int* image, int x, int y) const {
        const int* source = image + ((long long)view * job.height + y) * job.width + x;
        return (Ints)Grid::window((const float*)source, job.width);
    }

    // Load a block that may extend beyond the image: -1 outside.
    inline Ints gather(const int* image, unsigned in_image, bool is_inside, int x, int y) const {
        if (is_inside) return load_block(image, x, y);
        const int* source = image + ((long long)view * job.height + y) * job.width + x;
        int block[LANES];
        for (int k = 0; k < LANES; ++k)
            block[k] = (in_image >> k) & 1 ? source[k / BLOCK_SIDE * (long long)job.width + k % BLOCK_SIDE] : -1;
        return Lanes::load(block);
    }

    inline void count_hidden(Ints shown, Ints hidden) const {
        int object[LANES];
        Lanes::store(object, shown);
        int* counters = request.hidden_by + ((long long)view * request.count + place) * request.objects;
        for (unsigned remaining = Lanes::bits(hidden & (shown >= Lanes::all_ints(0))); remaining;) {
            const int occluder = object[Lanes::first_lane(remaining)];
            const unsigned same = remaining & Lanes::bits(shown == Lanes::all_ints(occluder));
            counters[occluder] += __builtin_popcount(same);
            remaining &= ~same;
        }
    }

    inline void write_masks(unsigned in_image, unsigned visible, int x, int y) const {
        unsigned char* mask = request.masks + ((long long)view * request.count + place) * job.height * job.width;
        for (const int k : Lanes::each(in_image)) {
            mask[(long long)(y + k / BLOCK_SIDE) * job.width + x + k % BLOCK_SIDE] =
                (visible >> k) & 1 ? MASK_VISIBLE : MASK_HIDDEN;
        }
    }
};

// A worker's memory for parts of a canvas. The layout does not depend on a part's size; counting pixels clears them.
struct SilhouetteMemory {
    // Tiles that are rasterized at a time: they stay in a core's cache.
    enum { TILES_AT_A_TIME = 512 };

    int tiles;  // capacity: at least one row of tiles, which may begin at any pixel of a tile of the canvas
    Image image;
    Traversal traversal;

    static inline SilhouetteMemory carve(Arena& arena, const SilhouetteJob& request, int movables, int levels) {
        SilhouetteMemory memory;
        const int row = Grid::tiles(request.canvas[2] - request.canvas[0] + TILE_SIDE - 1);
        memory.tiles = row > TILES_AT_A_TIME ? row : (int)TILES_AT_A_TIME;
        memory.image = Image();
        memory.image.clip_inv_z = __builtin_inff();
        memory.image.inv_z = arena.floats((long long)memory.tiles * TILE_PIXELS);
        memory.image.take_blocks(arena, memory.tiles);
        memory.traversal = Traversal::carve(arena, movables, levels);
        return memory;
    }

    // The image for some rows of a part of the canvas.
    inline Image rows_of(const Job& part, int first_row, int rows) const {
        Image rectangle = image;
        rectangle.set_size(part.width, rows, first_row, part.height);
        rectangle.set_center(part.center);
        rectangle.clear_blocks();
        return rectangle;
    }
};

struct Silhouettes {
    const Scene& scene;
    const Job& job;  // of the image
    const SilhouetteJob& request;
    const SilhouetteMemory& memory;

    // The camera's job for a part of the canvas, from (x0, y0) in pixels of the image.
    static inline Job part_of(const Job& job, int x0, int y0, int x1, int y1) {
        Job part = job;
        part.width = x1 - x0;
        part.height = y1 - y0;
        part.center[0] = job.center[0] - x0;
        part.center[1] = job.center[1] - y0;
        return part;
    }

    inline void unit(int unit) const {
        const int view = unit / request.count, place = unit % request.count, index = request.chosen[place];
        const World world = scene.movables.of_view(view);
        if (!world.exists || world.excludes(index)) return;
        const int in_image[4] = {0, 0, job.width, job.height};
        PixelCounts counts = PixelCounts();
        // Its occluders are then counted twice, which does not change their order.
        if (request.seen_only) measure(world, in_image, view, place, counts);
        if (!request.seen_only || counts.visible) {
            counts = PixelCounts();
            measure(world, request.canvas, view, place, counts);
        }
        counts.write(request, view, place);
    }

    // Count an object's pixels on a canvas, given its edges as in `SilhouetteJob`.
    inline void measure(const World& world, const int* edge, int view, int place, PixelCounts& counts) const {
        const int index = request.chosen[place];
        const Pose pose = job.pose_of(view);
        const Job canvas = part_of(job, edge[0], edge[1], edge[2], edge[3]);
        Image canvas_image = Image();
        canvas_image.set_size(canvas.width, canvas.height, 0, canvas.height);
        canvas_image.set_center(canvas.center);
        Visit visit;
        if (!Queue<PIXEL_RAYS>::find(View::of<PIXEL_RAYS>(scene, canvas, world, pose), canvas_image, index, visit))
            return;
        // Use whole tiles: pixels beyond the canvas are rasterized, but not counted.
        const int x0 = edge[0] + visit.x0, y0 = edge[1] + visit.y0;
        const int tiles_x = Grid::tiles(visit.x1 - visit.x0 + 1), tiles_y = Grid::tiles(visit.y1 - visit.y0 + 1);
        const int width = tiles_x * TILE_SIDE, height = tiles_y * TILE_SIDE;
        const Job part = part_of(job, x0, y0, x0 + width, y0 + height);
        const View part_view = View::of<PIXEL_RAYS>(scene, part, world, pose);
        const int step = memory.tiles / tiles_x * TILE_SIDE;
        for (int row = 0; row < height; row += step) {
            const Image image = memory.rows_of(part, row, height - row < step ? height - row : step);
            if (Queue<PIXEL_RAYS>::find(part_view, image, index, visit))
                Packets<PIXEL_RAYS>::render_movable(part_view, image, memory.traversal, visit, MODE_DEPTH);
            const Comparison comparison = {request, job, edge, view, place, index, x0, y0 + row};
            comparison.count(image, counts);
        }
    }

    // Do units of work: one object in one view each.
    inline void run(int* counter) const {
        Workers::run(counter, job.views * request.count, [&](int next) { unit(next); });
    }
};

struct SilhouetteLaunch : Launch {
    // See kernels/visibility/silhouette_packets.py.
    template <class SilhouetteCall, class Counts, class HiddenBy, class Masks>
    static inline void measure(const SilhouetteCall& call, const Counts& counts, const HiddenBy& hidden_by,
                               const Masks& masks) {
        const Scene scene = Scene::of(call.scene, call.worlds);
        const SilhouetteJob request = SilhouetteJob::of(call, counts, hidden_by, masks);
        Job job = Job::of_camera(call.camera, call.poses);
        job.far = __builtin_inff();
        worker(
            call.workers,
            [&](Arena& arena) {
                return SilhouetteMemory::carve(arena, request, scene.movables.count, call.scene.levels);
            },
            [&](const SilhouetteMemory& memory) {
                Silhouettes{scene, job, request, memory}.run(call.workers.counter.data);
            });
    }
};
