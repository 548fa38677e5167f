// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// A packet's pixels, in shared memory.

#pragma once

#include "cuda/places.h"

struct PixelMemory : Places {
    Key z_buffer[SLOTS];  // [block][pixel]
};

struct Packet {
    enum { NO_TRIANGLE = 0xffffffffu };

    PixelMemory* memory;
    int first_x, first_y;  // in the view
    unsigned block_min_inv_z;  // least 1 / z of this lane's block, as bits
    unsigned stale_blocks;  // blocks whose least 1 / z may have increased

    // Slot of a pixel. Blocks of one row begin at different banks, so that a row of pixels is read without bank
    // conflicts.
    static inline int index(unsigned block, unsigned pixel) { return index(block, block % BLOCK_COLUMNS, pixel); }
    static inline int index(unsigned block, unsigned column, unsigned pixel) {
        return block * LANES + ((pixel + column * (LANES / BLOCK_COLUMNS)) & (LANES - 1));
    }
    static inline unsigned block_of(unsigned x, unsigned y) {
        return (y >> BLOCK_HEIGHT_BITS) * BLOCK_COLUMNS + (x >> BLOCK_WIDTH_BITS);
    }
    static inline int index_at(unsigned x, unsigned y) {
        return index(block_of(x, y), x >> BLOCK_WIDTH_BITS,
                     (y & (BLOCK_HEIGHT - 1)) * BLOCK_WIDTH + (x & (BLOCK_WIDTH - 1)));
    }
    // Pixel coordinates of a slot.
    static inline int x_of(unsigned index) { return block_x(index / LANES) + pixel_x(pixel_of(index)); }
    static inline int y_of(unsigned index) { return block_y(index / LANES) + pixel_y(pixel_of(index)); }
    static inline unsigned pixel_of(unsigned index) {
        return (index - index / LANES % BLOCK_COLUMNS * (LANES / BLOCK_COLUMNS)) & (LANES - 1);
    }
    static inline int block_x(unsigned block) { return block % BLOCK_COLUMNS * BLOCK_WIDTH; }
    static inline int block_y(unsigned block) { return block / BLOCK_COLUMNS * BLOCK_HEIGHT; }
    // Coordinates of a lane's pixel in a block.
    static inline int pixel_x(int lane) { return lane & (BLOCK_WIDTH - 1); }
    static inline int pixel_y(int lane) { return lane >> BLOCK_WIDTH_BITS; }

    inline Key* at(int index) const { return memory->z_buffer + index; }
    inline unsigned inv_z_bits(int x, int y) const { return DepthKey::inv_z_bits(*at(index_at(x, y))); }

    // Image coordinates of the ray of a pixel.
    inline RayPlace point(const Camera& camera, int x, int y, int index) const {
        return memory->point(camera, first_x + x, first_y + y, index);
    }
    inline ExactRayPlace exact_point(const Camera& camera, int x, int y, int index) const {
        return memory->exact(camera, first_x + x, first_y + y, index);
    }

    // Whether the ray of a slot begins behind the surface of a key.
    inline bool begins_behind(Key key, int index) const {
        return memory->is_behind(__uint_as_float(DepthKey::inv_z_bits(key)), index);
    }

    // Clear the z-buffer. Pixels outside the image count as very near, so that they hide everything and are never
    // shown.
    inline void begin(int columns, int rows) {
        const int lane = Warp::lane();
        if (columns >= PACKET_WIDTH && rows >= PACKET_HEIGHT && (int)BLOCK_PIXELS == (int)LANES) {
            for (int i = lane; i < (int)PIXELS; i += LANES) *at(i) = DepthKey::of(0.0f, NO_TRIANGLE);
        } else {
            for (int block = 0; block < BLOCKS; ++block) {
                const bool seen = lane < BLOCK_PIXELS && block_x(block) + pixel_x(lane) < columns &&
                                  block_y(block) + pixel_y(lane) < rows;
                *at(index(block, lane)) = DepthKey::of(seen ? 0.0f : NOWHERE, NO_TRIANGLE);
            }
        }
        begin_blocks(lane < BLOCKS && block_x(lane) < columns && block_y(lane) < rows);
    }
    // Clear the z-buffer of a packet whose slots have rays of a table, or points. Slots without one count as very near.
    template <class Rays>
    inline void begin_slots(const Camera& camera, const Rays& rays) {
        if (rays.is_full()) {  // without waiting for its rays
            for (int i = Warp::lane(); i < (int)SLOTS; i += LANES) *at(i) = DepthKey::of(0.0f, NO_TRIANGLE);
            begin_blocks(Warp::lane() < SLOT_BLOCKS);
            return;
        }
        unsigned filled = 0;
        memory->clear();
        for (int block = 0; block < SLOT_BLOCKS; ++block) {
            const int slot = index(block, Warp::lane());
            const bool has_ray = rays.has_ray(slot);
            *at(slot) = DepthKey::of(has_ray ? 0.0f : NOWHERE, NO_TRIANGLE);
            if (has_ray) memory->add(camera, memory->point(camera, 0, 0, slot), slot);
            if (Warp::any(has_ray)) filled |= 1u << block;
        }
        begin_blocks(filled >> Warp::lane() & 1);
    }
    inline void begin_blocks(bool is_seen) {
        block_min_inv_z = __float_as_uint(is_seen ? 0.0f : NOWHERE);
        stale_blocks = 0;
        Warp::sync();
    }

    // Recompute the least 1 / z of the blocks that were drawn into.
    inline void refresh() {
        const int lane = Warp::lane();
        for (unsigned remaining = stale_blocks; remaining; remaining = Warp::without_first_lane(remaining)) {
            const int block = Warp::first_lane(remaining);
            const unsigned min_bits = Warp::reduce_min(DepthKey::inv_z_bits(*at(index(block, lane))));
            if (lane == block) block_min_inv_z = min_bits;
        }
        stale_blocks = 0;
    }
};
