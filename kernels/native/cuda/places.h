// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The rays of a packet, and the search for those that a surface may cover.

#pragma once

#include "cuda/setup.h"
#include "cuda/visits.h"

// Point lookups that packets of pixels do not use.
struct NoPoints {
    static inline unsigned pixels_of(int) { return 0; }
    static inline Cells cells_of(int) { return Cells::all(); }
    static inline void bounds_of(int, ImageBox&) {}
    static inline int first_in(int, int) { return -1; }
    static inline int after(int) { return -1; }
    static inline bool is_behind(float, int) { return false; }
    static inline void set_block(const Camera&, int, const ImageBox&, bool) {}
    static inline void clear() {}
    static inline void add(const Camera&, ImagePoint, int) {}
};

// Search for the points of a packet that a surface may cover: by the cells of a grid, and by blocks.
struct PointIndex {
    int first[CellGrid::COUNT];  // the slot of a point in each cell; -1 if empty
    short next[SLOTS];  // the slot of the next point in the same cell; -1 at the end
    ImageBox bounds[SLOT_BLOCKS];  // of the points of a block
    Cells cells[SLOT_BLOCKS];  // cell ranges of the blocks
    unsigned pixels[SLOT_BLOCKS];  // pixels of the packet that contain the points of a block: a Visit

    inline unsigned pixels_of(int block) const { return pixels[min(block, SLOT_BLOCKS - 1)]; }
    inline Cells cells_of(int block) const { return cells[min(block, SLOT_BLOCKS - 1)]; }
    inline void bounds_of(int block, ImageBox& box) const { box = bounds[min(block, SLOT_BLOCKS - 1)]; }
    inline int first_in(int x, int y) const { return first[y * CellGrid::SIDE + x]; }
    inline int after(int slot) const { return next[slot]; }
    static inline bool is_behind(float, int) { return false; }

    // Each lane sets the bounds of one block, or marks it as empty.
    inline void set_block(const Camera& camera, int block, const ImageBox& box, bool has_points) {
        bounds[block] = has_points ? box : ImageBox{NOWHERE, -NOWHERE, NOWHERE, -NOWHERE};
        cells[block] = has_points ? box.cells(camera, 0.0f) : Cells{1, 1, 0, 0};
        // An empty range of pixels ends before it begins.
        pixels[block] = has_points ? visit(camera, box) : Visit::of(0.0f, PACKET_WIDTH - 1, PACKET_HEIGHT - 1, 0, 0);
    }
    static inline unsigned visit(const Camera& camera, const ImageBox& box) {
        return Visit::of(0.0f, pixel(box.left - camera.first_u), pixel(box.top - camera.first_v),
                         pixel(box.right - camera.first_u), pixel(box.bottom - camera.first_v));
    }
    static inline int pixel(float from_first) {
        return max(min(__float2int_rd(from_first + 0.5f), PACKET_WIDTH - 1), 0);
    }

    // Call before any point is added.
    inline void clear() {
        for (int cell = Warp::lane(); cell < CellGrid::COUNT; cell += LANES) first[cell] = -1;
        Warp::sync();
    }
    // Insert a point into its cell.
    inline void add(const Camera& camera, ImagePoint p, int slot) {
        const Cells cell = ImageBox{p.u, p.u, p.v, p.v}.cells(camera, 0.0f);
        next[slot] = (short)atomicExch(first + cell.y0 * CellGrid::SIDE + cell.x0, slot);
    }
};

// Rays of a packet of pixels pass through the pixel centers.
struct GridPlaces : NoPoints {
    // The ray of a pixel, given its coordinates in the view and its index in the packet.
    static inline ImagePoint point(const Camera& camera, int x, int y, int) {
        return ImagePoint{SmallInt::to_float(x) + camera.first_u, SmallInt::to_float(y) + camera.first_v};
    }
    static inline ExactImagePoint exact(const Camera& camera, int x, int y, int) {
        return ExactImagePoint{(double)SmallInt::to_float(x) + camera.first_u,
                               (double)SmallInt::to_float(y) + camera.first_v};
    }
};

// Rays of a packet of points pass anywhere in its image (points.h).
struct PointPlaces : PointIndex {
    enum { NO_POINT = -0x7fffffff - 1 };
    enum { first_x = 0, first_y = 0 };  // first pixel of the packet in its image

    const ImagePoint* list;  // points of the view [px], from the image's corner
    double scale, center[2];  // u is `scale` times the distance to the right of the center
    ImagePoint points[SLOTS];  // u and v
    int place[SLOTS];  // index in the list; the complement of the index if the point is outside the image; NO_POINT

    inline ImagePoint point(const Camera&, int, int, int index) const { return points[index]; }
    inline ExactImagePoint exact(const Camera&, int, int, int index) const { return exact(list[max(place[index], 0)]); }
    inline ExactImagePoint exact(ImagePoint pixel) const {
        return ExactImagePoint{((double)pixel.u - center[0]) * scale, ((double)pixel.v - center[1]) * scale};
    }

    // Whether a slot has a ray, and its index in the list or -1.
    inline bool has_ray(int slot) const { return place[slot] >= 0; }
    inline int pixel_of(int slot) const {
        const int i = place[slot];
        return i >= 0 ? i : i == NO_POINT ? -1 : ~i;
    }
    static inline bool is_full() { return false; }
    struct Measure {
        static inline float depth(float z) { return z; }
    };
    static inline Measure measure_of(int) { return Measure{}; }
};

// Rays of a ray table, near the centers of the pixels of their packet (warpvis/rendering/casters/sorted_rays_cuda.py),
// or anywhere in its image (warpvis/rendering/casters/packet_images_cuda.py).
struct TableRays {
    const ImagePoint* points;  // in the order of the z-buffer; the centers of pixels without a ray
    const ImagePoint* rests;  // rounding errors of the points
    RayStarts starts;
    const float* scale;  // depth at z = 1; 0 if there is no ray
    const int* place;  // pixel in the table's image; -1 if there is none
    bool full;  // whether all slots have a ray
    int first_x, first_y;  // first pixel of the packet in its image

    // How depth along a ray follows from z.
    struct Measure {
        float begin = 0.0f, scale = 0.0f;

        inline float depth(float z) const { return __fmul_rn(RayStarts::from_begin(z, begin), scale); }
    };
    // Whether a slot has a ray, its pixel or -1, and its measure; whether all slots have a ray.
    inline bool has_ray(int slot) const { return __ldg(scale + slot) > 0.0f; }
    inline int pixel_of(int slot) const { return __ldg(place + slot); }
    inline Measure measure_of(int slot) const { return Measure{starts.begin_of(slot), __ldg(scale + slot)}; }
    inline bool is_full() const { return !POINTS && full; }
};

template <class Index>
struct TablePlaces : Index, TableRays {
    inline RayPlace point(const Camera&, int, int, int index) const { return starts.of(points[index], index); }
    inline ExactRayPlace exact(const Camera&, int, int, int index) const {
        const ImagePoint p = points[index], error = rests[index];
        return starts.of(ExactImagePoint{(double)p.u + error.u, (double)p.v + error.v}, index);
    }
    inline bool is_behind(float inv_z, int index) const { return starts.is_behind(inv_z, index); }
};

typedef Select<POINTS>::Type<PointIndex, NoPoints> RayIndex;
typedef Select<POINTS>::Type<PointPlaces, GridPlaces> CameraPlaces;
typedef Select<IS_TABLE>::Type<TablePlaces<RayIndex>, CameraPlaces> Places;
