// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// A worker's z-buffer: the greatest 1 / z of every pixel of a view, or of a strip of it, in blocks of 4 x 4 pixels, one
// to a register, in tiles of 4 x 4 blocks. Instead of pixels' centres, rays may go through points anywhere: then blocks
// are cells, which hold the points inside them in packets of as many as there are lanes.

enum {
    BLOCK_SHIFT = 2,
    TILE_SHIFT = 4,
    BLOCK_PIXELS = BLOCK_SIDE * BLOCK_SIDE,
    TILE_PIXELS = TILE_SIDE * TILE_SIDE,
    TILE_BLOCKS = TILE_PIXELS / BLOCK_PIXELS,
    BLOCKS_ACROSS = TILE_SIDE / BLOCK_SIDE,  // a tile
};
static_assert(BLOCK_SIDE == 1 << BLOCK_SHIFT && TILE_SIDE == 1 << TILE_SHIFT, "Python knows the sides");
static_assert(BLOCK_PIXELS == LANES && TILE_BLOCKS == LANES,
              "a register holds a block, and a number for each of a tile");

// What is kept of a pixel besides how near it is.
enum Mode {
    MODE_DEPTH,  // nothing: that is faster
    MODE_OBJECTS,  // the object that is seen
    MODE_TRIANGLES,  // the triangle, which tells the object, the normal and the face
};

// Where the pixels and blocks of an image are.
struct Grid {
    static inline int tiles(int pixels) { return (pixels + TILE_SIDE - 1) >> TILE_SHIFT; }

    // The index of a pixel is the sum of a part for its column and a part for its row.
    static inline int column_part(int x) {
        return (x >> TILE_SHIFT) * TILE_PIXELS + ((x >> BLOCK_SHIFT) & (BLOCKS_ACROSS - 1)) * BLOCK_PIXELS +
               (x & (BLOCK_SIDE - 1));
    }
    static inline int row_part(int y, int tiles_x) {
        return (y >> TILE_SHIFT) * tiles_x * TILE_PIXELS +
               ((y >> BLOCK_SHIFT) & (BLOCKS_ACROSS - 1)) * BLOCKS_ACROSS * BLOCK_PIXELS +
               (y & (BLOCK_SIDE - 1)) * BLOCK_SIDE;
    }
    // Where the pixels of a block are in it.
    static inline Ints column() { return Lanes::index() & (BLOCK_SIDE - 1); }
    static inline Ints row() { return Lanes::index() >> BLOCK_SHIFT; }
    // The same as floats: whole numbers, of which sums are exact, in whatever order.
    static inline Floats column_floats() { return Floats{0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3}; }
    static inline Floats row_floats() { return Floats{0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3}; }
    // Where the blocks of a tile are in it, in pixels.
    static inline Ints block_x() { return column() * (int)BLOCK_SIDE; }
    static inline Ints block_y() { return row() * (int)BLOCK_SIDE; }
};

struct ExactOcclusion;
struct RayTree;

struct Image {
    int width, height;  // of this strip, in pixels
    int first_row;  // of the strip in the view; a multiple of TILE_SIDE
    int view_height;
    int tiles_x, tiles_y;
    float center_x, center_y;  // the principal point, in pixels of the strip
    int* empty;  // whether inv_z is zero everywhere
    float* inv_z;  // [tile][block][pixel]: greatest 1 / z so far
    int* id;  // the same for the triangle or object that it belongs to; null if nobody asks
    int* first_packet;  // [block]: first of the packets of points in it, and one more; null for pixels
    int* point_index;  // [packet][lane]: which point, -1 for none
    float* point_u;  // [packet][lane]
    float* point_v;
    float* rows;  // four rows of inv_z on their way out
    int* id_rows;
    float* block_min;  // [tile][block]: least inv_z of a block, as far as it is known
    float* tile_min;  // [tile]
    unsigned char* block_stale;
    unsigned char* tile_stale;
    float most_inv_z;  // of what is drawn: what is nearer is not there
    const ExactOcclusion*
        occlusion;  // of points whose lanes begin with the greatest inv_z that does not hide them, or null
    const RayTree* tree;  // whose packets the blocks are, where rays are of a table

    static inline int column_part(int x) { return Grid::column_part(x); }
    inline int row_part(int y) const { return Grid::row_part(y, tiles_x); }
    inline int tiles() const { return tiles_x * tiles_y; }

    // The first and the last pixel whose centres may be between two places, in pixels from the first centre; for points
    // anywhere, all that may be touched.
    inline Floats first_pixel(Floats from) const {
        return __builtin_elementwise_ceil(first_packet ? __builtin_elementwise_floor(from + 0.5f) : from);
    }
    inline Floats last_pixel(Floats to) const { return __builtin_elementwise_floor(first_packet ? to + 0.5f : to); }

    // The index of the block in a column and a row of blocks.
    inline int block_at(int bx, int by) const {
        return ((by >> BLOCK_SHIFT) * tiles_x + (bx >> BLOCK_SHIFT)) * TILE_BLOCKS +
               (by & (BLOCKS_ACROSS - 1)) * BLOCKS_ACROSS + (bx & (BLOCKS_ACROSS - 1));
    }

    // The rectangle of a view that it holds; a view's principal point is in double precision.
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
    // What is known of blocks and tiles, for so many tiles.
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
        Floats least = Lanes::all(NOWHERE);
        for (int packet = first_packet[block]; packet < first_packet[block + 1]; ++packet)
            least = Lanes::min(least, Lanes::load(inv_z + packet * LANES));
        return Lanes::min_of(least);
    }
    inline float min_of_tile(int tile) const {
        if (tile_stale[tile]) {
            for (int block = tile * TILE_BLOCKS; block < (tile + 1) * TILE_BLOCKS; ++block) min_of_block(block);
            tile_min[tile] = Lanes::min_of(Lanes::load(block_min + tile * TILE_BLOCKS));
            tile_stale[tile] = 0;
        }
        return tile_min[tile];
    }

    // A rectangle of more blocks than this is judged by whole tiles.
    enum { MAX_BLOCKS = 32 };

    // Whether everything in a rectangle of pixels is nearer than inv_z.
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

    // Nothing seen yet, as far as blocks and tiles know.
    inline void clear_blocks() const {
        __builtin_memset(block_min, 0, tiles() * TILE_BLOCKS * sizeof(float));
        __builtin_memset(tile_min, 0, tiles() * sizeof(float));
        __builtin_memset(block_stale, 0, tiles() * TILE_BLOCKS);
        __builtin_memset(tile_stale, 0, tiles());
    }
    // Nothing seen yet.
    inline void begin() const {
        clear_blocks();
        // Writing an image out leaves it empty, but for what was put outside of it.
        if (!*empty)
            for (int block = 0; block < tiles() * TILE_BLOCKS; ++block)
                Lanes::store(inv_z + block * BLOCK_PIXELS, Lanes::all(0.0f));
        *empty = width == tiles_x * TILE_SIDE && height == tiles_y * TILE_SIDE;
        if (!*empty) hide_outside();
    }

    // What lies outside the image counts as infinitely near, so that it hides and never shows.
    inline void hide_outside() const {
        for (int y = 0; y < tiles_y * TILE_SIDE; ++y)
            for (int x = y < height ? width : 0; x < tiles_x * TILE_SIDE; ++x) {
                const int pixel = column_part(x) + row_part(y);
                inv_z[pixel] = NOWHERE;
                touch((unsigned)pixel / BLOCK_PIXELS);
            }
    }
};

// A node, a leaf or an object to visit: where it is in the image, and how near it may be.
struct Visit {
    int child;
    float nearest_inv_z;
    int x0, y0, x1, y1;
};
static_assert(sizeof(Visit) == 6 * sizeof(int), "a stack has room for many");
