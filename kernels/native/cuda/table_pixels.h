// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Packets of a ray table (table.h) whose rays pass near the centers of pixels. See table_points.h for others.

struct TableSlots {
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
