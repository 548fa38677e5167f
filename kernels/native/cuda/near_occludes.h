// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Occluding near plane: surfaces nearer than the near plane hide what lies behind them. See near_clips.h for the other
// kind.

struct NearPlane {
    static inline NearPlane of(float, float) { return NearPlane{}; }
    static inline bool cuts(float) { return false; }
    static inline bool shows(float, bool) { return true; }
    static inline float max_inv_z(float endless) { return endless; }
    static inline bool clips() { return false; }
    static inline float below(float value) { return value; }
    static inline float above(float value) { return value; }
};
