// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rays of a packet of pixels pass through the pixel centers. See table_places.h for the other kind.

struct Places : NoPoints {
    // The ray of a pixel, given its coordinates in the view and its index in the packet.
    static inline ImagePoint point(const Camera& camera, int x, int y, int) {
        return ImagePoint{SmallInt::to_float(x) + camera.first_u, SmallInt::to_float(y) + camera.first_v};
    }
    static inline ExactImagePoint exact(const Camera& camera, int x, int y, int) {
        return ExactImagePoint{(double)SmallInt::to_float(x) + camera.first_u,
                               (double)SmallInt::to_float(y) + camera.first_v};
    }
};
