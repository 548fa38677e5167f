// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

// A worker's memory, allocated piece by piece. Without memory behind it, the same code measures the size needed, so
// that Python does not duplicate the computation.
struct Arena {
    // Every piece begins at a cache line, so that no SIMD register straddles two lines.
    enum { ALIGNMENT = 64 };

    char* base;  // aligned to ALIGNMENT; null to measure
    long long used;  // bytes, including the padding of the last piece

    static inline Arena at(void* memory) { return Arena{(char*)memory, 0}; }

    inline void* take(long long bytes) {
        void* const piece = base ? base + used : nullptr;
        used += (bytes + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
        return piece;
    }
    inline float* floats(long long count) { return (float*)take(count * (long long)sizeof(float)); }
    inline int* ints(long long count) { return (int*)take(count * (long long)sizeof(int)); }
    inline unsigned char* bytes(long long count) { return (unsigned char*)take(count); }
};
