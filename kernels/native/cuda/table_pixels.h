// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Of a table's packets (table.h), those whose rays pass near the centres of pixels. See table_points.h for others.

struct TableSlots {
    // The image is the packet's pixels.
    static inline void set_sides(Camera& camera) {
        camera.last_x = PACKET_WIDTH - 1.0f;
        camera.last_y = PACKET_HEIGHT - 1.0f;
    }
    // How far from the principal point the image's first pixel is; the last one is as far as the image is large.
    static inline float farthest(const Camera& camera) { return fmaxf(fabsf(camera.first_u), fabsf(camera.first_v)); }
    // Rays are where their pixels are.
    static inline void index(const Camera&, Places&, const ImageBox*) {}
    static inline void add(const Camera&, Places&, int) {}
};
