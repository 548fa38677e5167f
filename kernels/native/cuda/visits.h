// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Bounds of a node's children in a packet: depth and pixels.

#pragma once

#include "cuda/bvh.h"

// Visit of one child of a node, in a sortable word: the bits of its greatest 1 / z, rounded up, and below them the
// blocks it may cover; 0 if there is nothing to visit.
struct Visit {
    enum {
        COLUMN_BITS = 2,
        ROW_BITS = 3,
        BLOCK_BITS = 2 * (COLUMN_BITS + ROW_BITS),
        BLOCK_MASK = (1 << BLOCK_BITS) - 1,
        // Bit positions of the first and last column and row.
        X0 = 0,
        X1 = COLUMN_BITS,
        Y0 = 2 * COLUMN_BITS,
        Y1 = 2 * COLUMN_BITS + ROW_BITS,
    };

    static inline unsigned of(float nearest_inv_z, int x0, int y0, int x1, int y1) {
        const unsigned bits = (__float_as_uint(nearest_inv_z) + BLOCK_MASK) & ~BLOCK_MASK;
        const unsigned columns = (x0 >> BLOCK_WIDTH_BITS) << X0 | (x1 >> BLOCK_WIDTH_BITS) << X1;
        const unsigned rows = (y0 >> BLOCK_HEIGHT_BITS) << Y0 | (y1 >> BLOCK_HEIGHT_BITS) << Y1;
        return bits | columns | rows;
    }
    static inline int column(unsigned visit, int shift) { return visit >> shift & ((1 << COLUMN_BITS) - 1); }
    static inline int row(unsigned visit, int shift) { return visit >> shift & ((1 << ROW_BITS) - 1); }
    static inline bool touches(unsigned visit, int block) {
        const int bx = block % BLOCK_COLUMNS, by = block / BLOCK_COLUMNS;
        // Without branches: this is evaluated at every step of a traversal.
        return (bx >= column(visit, X0)) & (bx <= column(visit, X1)) & (by >= row(visit, Y0)) & (by <= row(visit, Y1));
    }
    // The same for blocks anywhere in the packet, each given as a word of the pixels that contain its points.
    static inline bool meets(unsigned visit, unsigned other) {
        return (column(visit, X0) <= column(other, X1)) & (column(other, X0) <= column(visit, X1)) &
               (row(visit, Y0) <= row(other, Y1)) & (row(other, Y0) <= row(visit, Y1));
    }
    static inline unsigned nearest_inv_z(unsigned visit) { return visit & ~BLOCK_MASK; }
};

static_assert(BLOCK_COLUMNS <= 1 << Visit::COLUMN_BITS && BLOCK_ROWS <= 1 << Visit::ROW_BITS,
              "a word holds all blocks");

// The rectangle of a packet's pixels that a child may cover, in a word.
struct PixelRect {
    enum { BITS = 5, MASK = (1 << BITS) - 1, ANYWHERE = 1 << 4 * BITS };

    static inline unsigned of(int x0, int y0, int x1, int y1) {
        return x0 | y0 << BITS | (x1 - x0) << 2 * BITS | (y1 - y0) << 3 * BITS;
    }
    static inline int x0(unsigned rect) { return rect & MASK; }
    static inline int y0(unsigned rect) { return rect >> BITS & MASK; }
    static inline int columns(unsigned rect) { return (rect >> 2 * BITS & MASK) + 1; }
    static inline int rows(unsigned rect) { return (rect >> 3 * BITS & MASK) + 1; }
    // A small rectangle is entirely in front of the camera and no larger than a block or, since movable objects are
    // small trees of which most is visible at once, than a few blocks.
    enum { SMALL_COLUMNS = MOVABLE ? 16 : BLOCK_WIDTH, SMALL_ROWS = MOVABLE ? 16 : BLOCK_HEIGHT };
    static inline bool small(unsigned rect) {
        return columns(rect) <= SMALL_COLUMNS && rows(rect) <= SMALL_ROWS && !(rect & ANYWHERE);
    }
    // Whether there are few enough for one lane: up to four in a row, or 2x2. Always false for points, whose positions
    // are unknown here.
    static inline bool few(unsigned rect) {
        return !POINTS && columns(rect) <= (rows(rect) == 1 ? 4 : 2) && rows(rect) <= 2;
    }
};
static_assert(PACKET_WIDTH <= 1 << PixelRect::BITS && PACKET_HEIGHT <= 1 << PixelRect::BITS, "a word holds a packet");

// Coordinates of these pixels; some may be repeated.
struct FewPixels {
    int x[4], y[4];

    static inline FewPixels of(unsigned rect) {
        const int x0 = PixelRect::x0(rect), y0 = PixelRect::y0(rect);
        const int x1 = x0 + PixelRect::columns(rect) - 1, y1 = y0 + PixelRect::rows(rect) - 1;
        return FewPixels{{x0, min(x0 + 1, x1), y0 == y1 ? min(x0 + 2, x1) : x0, x1}, {y0, y0, y1, y1}};
    }
};

// One child of an opened node, per lane.
struct Child {
    unsigned visit, pixels;
};
