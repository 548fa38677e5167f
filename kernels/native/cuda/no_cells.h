// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Packets of pixels need no search for points. See point_cells.h for the other kind.

struct CellGrid {};

struct Cells {
    int x0, y0, x1, y1;

    static inline bool any() { return false; }
    static inline int count() { return 0; }
    static inline Cells all() { return Cells{0, 0, 0, 0}; }
    static inline Cells between(const CellGrid&, float, float, float, float) { return all(); }
};

struct ImageBox;

// Point lookups that packets of pixels do not use.
struct NoPoints {
    static inline unsigned pixels_of(int) { return 0; }
    static inline Cells cells_of(int) { return Cells::all(); }
    static inline void bounds_of(int, ImageBox&) {}
    static inline int first_in(int, int) { return -1; }
    static inline int after(int) { return -1; }
    static inline bool is_behind(float, int) { return false; }
};
