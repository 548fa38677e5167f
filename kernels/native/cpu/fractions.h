// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Visible fractions of targets, which are one or several objects. A target is rasterized in isolation. All pixels that
// do not show it are then set to be infinitely near, so that a rasterization of the other objects visits only surfaces
// in front of it. Small targets are sampled more finely than by pixels.

#pragma once

#include "cpu/sample_windows.h"

// Counters of a target in a view, in the order of `FractionCounter`.
struct FractionCounts {
    int visible, image, silhouette, too_near, too_far;
    int box[4];
    int visible_centers, silhouette_centers, state_edges, silhouette_edges, across;

    // Extend the box by a pixel.
    inline void grow(int x, int y) {
        const int code[4] = {BOX_MIDDLE - x, BOX_MIDDLE - y, BOX_MIDDLE + x, BOX_MIDDLE + y};
        for (int k = 0; k < 4; ++k) box[k] = code[k] > box[k] ? code[k] : box[k];
    }
    inline void write(const FractionJob& request, int view, int target) const {
        const int* values = &visible;  // all counters, in order
        char* const to = request.counts + view * request.view_stride + target * (long long)sizeof(int);
        for (int counter = 0; counter < FRACTION_COUNTERS; ++counter)
            *(int*)(to + counter * request.count_stride) = values[counter];
    }
};
static_assert(sizeof(FractionCounts) == FRACTION_COUNTERS * sizeof(int), "all counters, and nothing else");
static_assert(VISIBLE_SAMPLES == 0 && FRACTION_BOX == 5 && VISIBLE_CENTERS == 9 && SAMPLES_ACROSS == 13,
              "the counters' order");

// A worker's memory. Counting samples clears the z-buffer.
struct FractionMemory {
    enum { TILES_AT_A_TIME = 512 };

    int tiles;  // capacity, at least one row of tiles of the canvas
    Image image;
    SampleBits::Row *silhouette, *visible, *above;  // above: the last rows before, of both
    unsigned char* excluded;  // [object]: of a view, and the target
    Traversal traversal;

    static inline FractionMemory carve(Arena& arena, const FractionJob& request, int movables, int levels) {
        FractionMemory memory;
        const int canvas = request.canvas[2] - request.canvas[0], fine = 3 * request.min_samples;
        const int row = Grid::tiles((canvas > fine ? canvas : fine) + 2 + TILE_SIDE - 1);
        memory.tiles = row > TILES_AT_A_TIME ? row : (int)TILES_AT_A_TIME;
        const long long samples = (long long)memory.tiles * TILE_PIXELS, rows = (long long)memory.tiles * TILE_SIDE;
        memory.image = Image();
        memory.image.inv_z = arena.floats(samples);
        memory.image.id = arena.ints(samples);
        memory.image.take_blocks(arena, memory.tiles);
        memory.silhouette = (SampleBits::Row*)arena.take(rows * (long long)sizeof(SampleBits::Row));
        memory.visible = (SampleBits::Row*)arena.take(rows * (long long)sizeof(SampleBits::Row));
        memory.above = (SampleBits::Row*)arena.take(2 * memory.tiles * (long long)sizeof(SampleBits::Row));
        memory.excluded = arena.bytes(request.objects);
        memory.traversal = Traversal::carve(arena, movables, levels);
        return memory;
    }
    // The image of some rows of a window.
    inline Image rows_of(const Job& window, int first_row, int rows) const {
        Image part = image;
        part.set_size(window.width, rows, first_row, window.height);
        part.set_center(window.center);
        part.clip_inv_z = window.clip_inv_z;
        part.clear_blocks();
        return part;
    }
};

// Some rows of a target's window: what it covers in isolation, and what remains visible of it.
struct FractionRows {
    const Job& job;  // of the image
    const FractionJob& request;
    const SampleWindow& window;
    const Image& image;  // of these rows
    SampleBits silhouette, visible;
    int* hidden_by;  // [object]

    enum { OWN_ID = -1 };  // less than all objects: what coincides with the target does not hide it

    // Call `take(place, x, y)` for each block: its index, and its first sample in the image.
    template <class Take>
    inline __attribute__((always_inline)) void each_block(Take take) const {
        for (int tile = 0; tile < image.tiles(); ++tile)
            for (int b = 0; b < TILE_BLOCKS; ++b) {
                const int x = tile % image.tiles_x * TILE_SIDE + b % BLOCKS_ACROSS * BLOCK_SIDE;
                const int y = tile / image.tiles_x * TILE_SIDE + b / BLOCKS_ACROSS * BLOCK_SIDE;
                take(tile * TILE_BLOCKS + b, x, y);
            }
    }
    // Count the samples that the target covers, and leave only those that may be visible; returns whether any are.
    inline bool isolate(FractionCounts& counts) const {
        const int across = window.across;
        const int canvas[4] = {window.x0, window.y0, window.x1, window.y1};
        const int in_image[4] = {0, 0, job.width * across, job.height * across};
        bool any = false;
        each_block([&](int place, int x, int y) {
            float* const stored = image.inv_z + place * BLOCK_PIXELS;
            const Floats inv_z = Lanes::load(stored);
            const int at_x = window.x0 + x, at_y = window.y0 + image.first_row + y;
            Ints open = inv_z > Lanes::all(0.0f);
            if (Lanes::any(open)) {
                open &= Comparison::inside(canvas, at_x, at_y);
                const unsigned covered = Lanes::bits(open);
                counts.silhouette += __builtin_popcount(covered);
                silhouette.set(covered, x / BLOCK_SIDE, y / BLOCK_SIDE);
                open &= Comparison::inside(in_image, at_x, at_y);
                counts.image += __builtin_popcount(Lanes::bits(open));
                const Floats z = 1.0f / inv_z;
                const Ints near = open & (z < Lanes::all(job.near)), far = open & (z > Lanes::all(job.far));
                counts.too_near += __builtin_popcount(Lanes::bits(near));
                counts.too_far += __builtin_popcount(Lanes::bits(far));
                open &= ~near & ~far;
                counts.silhouette_centers += centers(covered, at_x, at_y);
                any |= Lanes::any(open);
            }
            const Floats kept = open ? inv_z : Lanes::all(NOWHERE);
            Lanes::store(stored, kept);
            Lanes::store(image.id + place * BLOCK_PIXELS, Lanes::all_ints(OWN_ID));
            image.touch(place);
        });
        return any;
    }
    // Count the samples that are still visible, and clear the z-buffer.
    inline void count(FractionCounts& counts) const {
        each_block([&](int place, int x, int y) {
            float* const stored = image.inv_z + place * BLOCK_PIXELS;
            const Ints open = Lanes::load(stored) < Lanes::all(NOWHERE);
            Lanes::store(stored, Lanes::all(0.0f));
            if (!Lanes::any(open)) return;
            const Ints id = Lanes::load(image.id + place * BLOCK_PIXELS);
            const Ints shown = open & (id == Lanes::all_ints(OWN_ID));
            count_hidden(id, open & ~shown);
            const unsigned bits = Lanes::bits(shown);
            if (!bits) return;
            const int at_x = window.x0 + x, at_y = window.y0 + image.first_row + y;
            counts.visible += __builtin_popcount(bits);
            counts.visible_centers += centers(bits, at_x, at_y);
            visible.set(bits, x / BLOCK_SIDE, y / BLOCK_SIDE);
            for (const int k : Lanes::each(bits))
                counts.grow((at_x + k % BLOCK_SIDE) / window.across, (at_y + k / BLOCK_SIDE) / window.across);
        });
    }
    inline void count_hidden(Ints id, Ints hidden) const {
        int object[LANES];
        Lanes::store(object, id);
        for (unsigned remaining = Lanes::bits(hidden); remaining;) {
            const int occluder = object[Lanes::first_lane(remaining)];
            const unsigned same = remaining & Lanes::bits(id == Lanes::all_ints(occluder));
            hidden_by[occluder] += __builtin_popcount(same);
            remaining &= ~same;
        }
    }
    // Number of samples of a block at the centers of pixels.
    inline int centers(unsigned bits, int x, int y) const {
        if (window.across == 1) return __builtin_popcount(bits);
        int found = 0;
        for (const int k : Lanes::each(bits)) found += is_center(x + k % BLOCK_SIDE) && is_center(y + k / BLOCK_SIDE);
        return found;
    }
    inline bool is_center(int sample) const {
        const int rest = sample % window.across;
        return (rest < 0 ? rest + window.across : rest) == window.across / 2;
    }
};

struct Fractions {
    const Scene& scene;
    const Scene& isolated;  // in which every object has its own frame
    const Job& job;  // of the image
    const FractionJob& request;
    const FractionMemory& memory;

    inline void unit(int unit) const {
        const int view = unit / request.count, target = unit % request.count;
        World world = scene.movables.of_view(view);
        const World apart = isolated.movables.of_view(view);
        FractionCounts counts = FractionCounts();
        const SampleWindow window = world.exists ? find_window(apart, view, target) : SampleWindow{1, 0, 0, 0, 0};
        counts.across = window.empty() ? 0 : window.across;
        if (!window.empty()) {
            exclude(world, target);
            int* const hidden_by = request.hidden_by + (long long)unit * request.objects;
            measure(world, apart, window, view, target, hidden_by, counts);
        }
        counts.write(request, view, target);
    }
    template <class Function>
    inline void each_member(const World& world, int target, Function function) const {
        for (int i = request.first[target]; i < request.first[target + 1]; ++i)
            if (!world.excludes(request.members[i])) function(request.members[i]);
    }
    // Exclude the target's objects in addition to those of the view.
    inline void exclude(World& world, int target) const {
        if (world.excluded)
            __builtin_memcpy(memory.excluded, world.excluded, request.objects);
        else
            __builtin_memset(memory.excluded, 0, request.objects);
        for (int i = request.first[target]; i < request.first[target + 1]; ++i) memory.excluded[request.members[i]] = 1;
        world.excluded = memory.excluded;
    }
    // All of the canvas, sampled at pixels, if a box is partly behind the camera.
    inline SampleWindow find_window(const World& apart, int view, int target) const {
        const Pose pose = job.pose_of(view);
        double low[2] = {1e30, 1e30}, high[2] = {-1e30, -1e30};
        bool crosses = false;
        each_member(apart, target, [&](int index) {
            const Pose local = pose.seen_from(Pose::from(isolated.movables.poses_from(index, apart)));
            const float* box = isolated.movables.boxes + (long long)index * BOX_WORDS;
            const Stretch stretch = isolated.movables.stretch_of(index, apart);
            const int behind = SampleWindow::add_box(local, job, box, stretch, low, high);
            crosses |= behind > 0 && behind < 8;
        });
        const int* canvas = request.canvas;
        if (crosses) return SampleWindow::all(canvas);
        return SampleWindow::of(low, high, canvas, request.min_samples);
    }

    inline void measure(const World& world, const World& apart, const SampleWindow& window, int view, int target,
                        int* hidden_by, FractionCounts& counts) const {
        const Pose pose = job.pose_of(view);
        Job part = job_of(window, job);
        part.far = __builtin_inff();  // surfaces beyond the range occlude, too
        const View complete = View::of<PIXEL_RAYS>(scene, part, world, pose);
        const View single = View::of<PIXEL_RAYS>(isolated, part, apart, pose);
        const int tiles_x = part.width / TILE_SIDE, step = memory.tiles / tiles_x * TILE_SIDE;
        SampleBits above[2] = {{memory.above, tiles_x}, {memory.above + memory.tiles, tiles_x}};
        above[0].clear(1), above[1].clear(1);
        for (int row = 0; row < part.height; row += step) {
            const Image image = memory.rows_of(part, row, part.height - row < step ? part.height - row : step);
            each_member(apart, target, [&](int index) {
                Visit visit;
                if (Queue<PIXEL_RAYS>::find(single, image, index, visit))
                    Packets<PIXEL_RAYS>::render_movable(single, image, memory.traversal, visit, MODE_DEPTH);
            });
            const FractionRows rows = {
                job, request, window, image, {memory.silhouette, tiles_x}, {memory.visible, tiles_x}, hidden_by};
            rows.silhouette.clear(image.height), rows.visible.clear(image.height);
            if (rows.isolate(counts)) Packets<PIXEL_RAYS>::render(complete, image, memory.traversal, MODE_OBJECTS);
            rows.count(counts);
            count_edges(rows.silhouette, rows.visible, above, image.height, counts);
        }
        for (int tile = 0; tile < tiles_x; ++tile) {  // below the window, nothing is covered
            const int edges = __builtin_popcount(above[0].at(0, tile));
            counts.silhouette_edges += edges;
            counts.state_edges += edges;
        }
    }
    // Count edges of the samples of some rows, the first of which is below those of `above`; replace these by the last.
    static inline void count_edges(const SampleBits& silhouette, const SampleBits& visible, const SampleBits* above,
                                   int rows, FractionCounts& counts) {
        for (int row = 0; row < rows; ++row) {
            for (int tile = 0; tile < silhouette.tiles_x; ++tile) {
                const unsigned across = silhouette.differs_left(row, tile);
                const unsigned down = silhouette.at(row, tile) ^ above[0].at(0, tile);
                const unsigned all_across = across | visible.differs_left(row, tile);
                const unsigned all_down = down | (visible.at(row, tile) ^ above[1].at(0, tile));
                counts.silhouette_edges += __builtin_popcount(across) + __builtin_popcount(down);
                counts.state_edges += __builtin_popcount(all_across) + __builtin_popcount(all_down);
            }
            counts.silhouette_edges += silhouette.last(row);
            counts.state_edges += silhouette.last(row);
            for (int tile = 0; tile < silhouette.tiles_x; ++tile) {
                above[0].at(0, tile) = silhouette.at(row, tile);
                above[1].at(0, tile) = visible.at(row, tile);
            }
        }
    }

    // Do units of work: one target in one view each.
    inline void run(int* counter) const {
        Workers::run(counter, job.views * request.count, [&](int next) { unit(next); });
    }
};

struct FractionLaunch : Launch {
    // See kernels/visibility/fraction_packets.py.
    template <class FractionCall, class Counts, class HiddenBy>
    static inline void measure(const FractionCall& call, const Counts& counts, const HiddenBy& hidden_by) {
        const Scene scene = Scene::of(call.scene, call.worlds), isolated = Scene::of(call.isolated, call.spread_worlds);
        const FractionJob request = FractionJob::of(call, counts, hidden_by);
        Job job = Job::of_camera(call.camera, call.poses);
        job.cull_back_faces = call.cull_backfaces != 0;
        const int levels = call.scene.levels > call.isolated.levels ? call.scene.levels : call.isolated.levels;
        const int movables =
            scene.movables.count > isolated.movables.count ? scene.movables.count : isolated.movables.count;
        worker(
            call.workers, [&](Arena& arena) { return FractionMemory::carve(arena, request, movables, levels); },
            [&](const FractionMemory& memory) {
                Fractions{scene, isolated, job, request, memory}.run(call.workers.counter.data);
            });
    }
};
