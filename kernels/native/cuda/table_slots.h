// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The image of a packet of a ray table (table.h), and the order of its rays.

#pragma once

#include "cuda/point_blocks.h"

// Rays pass near the centers of pixels.
struct PixelSlots {
    // The image is the packet's pixels.
    static inline void set_sides(Camera& camera) {
        camera.last_x = PACKET_WIDTH - 1.0f;
        camera.last_y = PACKET_HEIGHT - 1.0f;
    }
    // Distance of the image's first pixel from the principal point; that of the last pixel is at most this plus the
    // image size.
    static inline float farthest(const Camera& camera) { return fmaxf(fabsf(camera.first_u), fabsf(camera.first_v)); }
    // Nothing to index: each ray belongs to its pixel.
    static inline void index(const Camera&, Places&, const ImageBox*) {}
    static inline void add(const Camera&, Places&, int) {}
};

// Rays are anywhere in their image and fill it, like packets of points of a view (points.h).
template <class Places, class Camera>
struct PointSlots {
    // Set the distances of the image's sides from the principal point, and the cells that divide it.
    static inline void set_sides(Camera& camera) {
        const float across = PACKET_WIDTH - 1.0f, along = PACKET_HEIGHT - 1.0f;
        camera.last_x = fmaxf(fabsf(camera.first_u), fabsf(camera.first_u + across)) + 1.0f;
        camera.last_y = fmaxf(fabsf(camera.first_v), fabsf(camera.first_v + along)) + 1.0f;
        camera.cells.per_u = PointBlocks::per_side(across);
        camera.cells.per_v = PointBlocks::per_side(along);
    }
    static inline float farthest(const Camera& camera) { return fmaxf(camera.last_x, camera.last_y); }
    // Prepare for adding rays: each lane sets the bounds of one block. For a block without rays, left is greater than
    // right.
    static inline void index(const Camera& camera, Places& places, const ImageBox* bounds) {
        const int block = Warp::lane();
        if (block < SLOT_BLOCKS) {
            const ImageBox box = bounds[block];
            PointBlocks::set(camera, places, block, box, box.left <= box.right);
        }
        places.clear();
    }
    static inline void add(const Camera& camera, Places& places, int slot) {
        places.add(camera, places.points[slot], slot);
    }
};

typedef Select<POINTS>::Type<PointSlots<Places, Camera>, PixelSlots> TableSlots;
static_assert(sizeof(ImageBox) == 4 * sizeof(float), "Python stores rows of left, right, top and bottom");
