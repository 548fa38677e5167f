// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// A worker's hierarchical z-buffer: the greatest 1 / z of every pixel of a view, or of a strip of it, in blocks of 4 x
// 4 pixels, one per SIMD register, in tiles of 4 x 4 blocks. If rays pass through arbitrary points instead of pixel
// centers, blocks are cells that hold the points inside them in packets of LANES points.

#pragma once

#include "cpu/arena.h"
#include "cpu/lanes.h"

enum {
    BLOCK_SHIFT = 2,
    TILE_SHIFT = 4,
    BLOCK_PIXELS = BLOCK_SIDE * BLOCK_SIDE,
    TILE_PIXELS = TILE_SIDE * TILE_SIDE,
    TILE_BLOCKS = TILE_PIXELS / BLOCK_PIXELS,
    BLOCKS_ACROSS = TILE_SIDE / BLOCK_SIDE,  // of a tile
};
static_assert(BLOCK_SIDE == 1 << BLOCK_SHIFT && TILE_SIDE == 1 << TILE_SHIFT, "Python uses the sides");
static_assert(BLOCK_PIXELS == LANES && TILE_BLOCKS == LANES,
              "a register holds a block, and a number for each of a tile");

// What the rays of an image are.
enum RayKind {
    PIXEL_RAYS,  // through pixel centers or points of the image
    TABLE_RAYS,  // of a ray table: the packets of the image are those of a `RayTree`
    ORIGIN_RAYS,  // of a ray table, with distinct origins: see `RayOrigins`; the others begin at the eye
};

// What the z-buffer stores of a pixel in addition to 1 / z.
enum Mode {
    MODE_DEPTH,  // nothing, which is faster
    MODE_OBJECTS,  // index of the visible object
    MODE_TRIANGLES,  // number of the visible triangle, which determines the object, the normal and the face
};

// Memory layout of the pixels and blocks of an image.
struct Grid {
    static inline int tiles(int pixels) { return (pixels + TILE_SIDE - 1) >> TILE_SHIFT; }

    // The index of a pixel is the sum of a term for its column and a term for its row.
    static inline int column_part(int x) {
        return (x >> TILE_SHIFT) * TILE_PIXELS + ((x >> BLOCK_SHIFT) & (BLOCKS_ACROSS - 1)) * BLOCK_PIXELS +
               (x & (BLOCK_SIDE - 1));
    }
    static inline int row_part(int y, int tiles_x) {
        return (y >> TILE_SHIFT) * tiles_x * TILE_PIXELS +
               ((y >> BLOCK_SHIFT) & (BLOCKS_ACROSS - 1)) * BLOCKS_ACROSS * BLOCK_PIXELS +
               (y & (BLOCK_SIDE - 1)) * BLOCK_SIDE;
    }
    // Column and row of each pixel of a block.
    static inline Ints column() { return Lanes::index() & (BLOCK_SIDE - 1); }
    static inline Ints row() { return Lanes::index() >> BLOCK_SHIFT; }
    // The same as floats: integers, whose sums are exact in any order.
    static inline Floats column_floats() { return Floats{0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3}; }
    static inline Floats row_floats() { return Floats{0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3}; }
    // Position of each block of a tile, in pixels.
    static inline Ints block_x() { return column() * (int)BLOCK_SIDE; }
    static inline Ints block_y() { return row() * (int)BLOCK_SIDE; }

    // Load a block from rows of `width` values.
    static inline Floats window(const float* first, long long width) {
        typedef float Four __attribute__((ext_vector_type(4)));
        typedef float Eight __attribute__((ext_vector_type(8)));
        Four row[BLOCK_SIDE];
        for (int y = 0; y < BLOCK_SIDE; ++y) __builtin_memcpy(&row[y], first + y * width, sizeof row[y]);
        const Eight low = __builtin_shufflevector(row[0], row[1], 0, 1, 2, 3, 4, 5, 6, 7);
        const Eight high = __builtin_shufflevector(row[2], row[3], 0, 1, 2, 3, 4, 5, 6, 7);
        return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }
};

struct ExactOcclusion;
struct RayTree;

struct Image {
    int width, height;  // of this strip, in pixels
    int first_row;  // of the strip in the view; a multiple of TILE_SIDE
    int view_height;
    int tiles_x, tiles_y;
    float center_x, center_y;  // the principal point, in pixels of the strip
    int* empty = nullptr;  // whether inv_z is zero everywhere
    float* inv_z = nullptr;  // [tile][block][pixel]: greatest 1 / z so far
    int* id = nullptr;  // the triangle or object there; null if not requested
    // [block]: index of its first packet of points, and the end of the last one; null if rays pass through pixel
    // centers
    int* first_packet = nullptr;
    int* point_index = nullptr;  // [packet][lane]: index of the point, -1 for an empty lane
    float *point_u = nullptr, *point_v = nullptr;  // [packet][lane]
    float* rows = nullptr;  // four rows of inv_z being written out
    int* id_rows = nullptr;
    float* block_min = nullptr;  // [tile][block]: lower bound of inv_z in a block, exact unless it is stale
    float* tile_min = nullptr;  // [tile]: the same for a tile
    unsigned char *block_stale = nullptr, *tile_stale = nullptr;
    float clip_inv_z = __builtin_inff();  // nearer surfaces are clipped
    // for points whose lanes start with the greatest inv_z that does not occlude them, or null
    const ExactOcclusion* occlusion = nullptr;
    // [packet][lane]: for points, the greatest inv_z of surfaces that are visible, and whether the nearer front of a
    // solid was skipped; or null
    float* limit = nullptr;
    int* passed = nullptr;
    const RayTree* tree = nullptr;  // the tree whose packets are the blocks, if rays are from a ray table

    static inline int column_part(int x) { return Grid::column_part(x); }
    inline int row_part(int y) const { return Grid::row_part(y, tiles_x); }
    inline int tiles() const { return tiles_x * tiles_y; }

    // First and last pixel whose center may lie between two coordinates, in pixels from the first center; for arbitrary
    // points, all pixels that may be touched.
    inline Floats first_pixel(Floats from) const {
        return __builtin_elementwise_ceil(first_packet ? __builtin_elementwise_floor(from + 0.5f) : from);
    }
    inline Floats last_pixel(Floats to) const { return __builtin_elementwise_floor(first_packet ? to + 0.5f : to); }

    // Index of the block at a column and a row of blocks.
    inline int block_at(int bx, int by) const {
        return ((by >> BLOCK_SHIFT) * tiles_x + (bx >> BLOCK_SHIFT)) * TILE_BLOCKS +
               (by & (BLOCKS_ACROSS - 1)) * BLOCKS_ACROSS + (bx & (BLOCKS_ACROSS - 1));
    }

    // Set the rectangle of the view that this image covers; the principal point of a view is in double precision.
    inline void set_size(int view_width, int rows, int at_row, int of_view) {
        width = view_width;
        height = rows;
        first_row = at_row;
        view_height = of_view;
        tiles_x = Grid::tiles(width);
        tiles_y = Grid::tiles(height);
    }
    inline void set_center(const double* center) {
        center_x = (float)center[0];
        center_y = (float)(center[1] - first_row);
    }
    // Allocate the arrays of blocks and tiles.
    inline void take_blocks(Arena& arena, long long count) {
        block_min = arena.floats(count * TILE_BLOCKS);
        tile_min = arena.floats(count);
        block_stale = arena.bytes(count * TILE_BLOCKS);
        tile_stale = arena.bytes(count);
    }

    inline void touch(int block) const {
        block_stale[block] = 1;
        tile_stale[(unsigned)block / TILE_BLOCKS] = 1;
    }
    inline float min_of_block(int block) const {
        if (block_stale[block]) {
            block_min[block] =
                first_packet ? min_of_packets(block) : Lanes::min_of(Lanes::load(inv_z + block * BLOCK_PIXELS));
            block_stale[block] = 0;
        }
        return block_min[block];
    }
    inline float min_of_packets(int block) const {
        Floats min_inv_z = Lanes::all(NOWHERE);
        for (int packet = first_packet[block]; packet < first_packet[block + 1]; ++packet)
            min_inv_z = Lanes::min(min_inv_z, Lanes::load(inv_z + packet * LANES));
        return Lanes::min_of(min_inv_z);
    }
    inline float min_of_tile(int tile) const {
        if (tile_stale[tile]) {
            for (int block = tile * TILE_BLOCKS; block < (tile + 1) * TILE_BLOCKS; ++block) min_of_block(block);
            tile_min[tile] = Lanes::min_of(Lanes::load(block_min + tile * TILE_BLOCKS));
            tile_stale[tile] = 0;
        }
        return tile_min[tile];
    }

    // Rectangles of more blocks than this are tested tile by tile.
    enum { MAX_BLOCKS = 32 };

    // Whether a rectangle is occluded: all its pixels are nearer than `nearest_inv_z`.
    inline bool hides(int x0, int y0, int x1, int y1, float nearest_inv_z) const {
        const int bx0 = x0 >> BLOCK_SHIFT, bx1 = x1 >> BLOCK_SHIFT, by0 = y0 >> BLOCK_SHIFT, by1 = y1 >> BLOCK_SHIFT;
        if ((bx1 - bx0 + 1) * (by1 - by0 + 1) > MAX_BLOCKS)
            return tiles_hide(x0 >> TILE_SHIFT, y0 >> TILE_SHIFT, x1 >> TILE_SHIFT, y1 >> TILE_SHIFT, nearest_inv_z);
        for (int by = by0; by <= by1; ++by)
            for (int bx = bx0; bx <= bx1; ++bx)
                if (min_of_block(block_at(bx, by)) <= nearest_inv_z) return false;
        return true;
    }
    inline bool tiles_hide(int tx0, int ty0, int tx1, int ty1, float nearest_inv_z) const {
        for (int ty = ty0; ty <= ty1; ++ty)
            for (int tx = tx0; tx <= tx1; ++tx)
                if (min_of_tile(ty * tiles_x + tx) <= nearest_inv_z) return false;
        return true;
    }

    // Clear the upper levels of the hierarchical z-buffer.
    inline void clear_blocks() const {
        __builtin_memset(block_min, 0, tiles() * TILE_BLOCKS * sizeof(float));
        __builtin_memset(tile_min, 0, tiles() * sizeof(float));
        __builtin_memset(block_stale, 0, tiles() * TILE_BLOCKS);
        __builtin_memset(tile_stale, 0, tiles());
    }
    // Clear the z-buffer.
    inline void begin() const {
        clear_blocks();
        // Writing out an image clears it, except for the pixels outside the image that hide_outside() set.
        if (!*empty)
            for (int block = 0; block < tiles() * TILE_BLOCKS; ++block)
                Lanes::store(inv_z + block * BLOCK_PIXELS, Lanes::all(0.0f));
        *empty = width == tiles_x * TILE_SIDE && height == tiles_y * TILE_SIDE;
        if (!*empty) hide_outside();
    }

    // Pixels outside the image are set to be infinitely near, so that they occlude everything and are never written.
    inline void hide_outside() const {
        for (int y = 0; y < tiles_y * TILE_SIDE; ++y)
            for (int x = y < height ? width : 0; x < tiles_x * TILE_SIDE; ++x) {
                const int pixel = column_part(x) + row_part(y);
                inv_z[pixel] = NOWHERE;
                touch((unsigned)pixel / BLOCK_PIXELS);
            }
    }
};

// A node, leaf or object to visit: its rectangle in the image, and an upper bound of its 1 / z.
struct Visit {
    int child;
    float nearest_inv_z;
    int x0, y0, x1, y1;
};
static_assert(sizeof(Visit) == 6 * sizeof(int), "the size of a stack is computed from this");
