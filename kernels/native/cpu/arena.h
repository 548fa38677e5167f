// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// A worker's memory, handed out piece by piece. The same code carves it and, without memory behind it, measures how
// much is needed: Python asks for that, and has no formula of its own.
struct Arena {
    // Every piece begins at a cache line, so that no register's worth straddles two of them.
    enum { ALIGNMENT = 64 };

    char* base;  // at a multiple of ALIGNMENT; null to measure
    long long used;  // bytes, with what rounds the last piece up

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
