// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Replacement of kernels/native/cpu/arena.h with the same interface: memory between pieces is poisoned, so that the address sanitizer
// detects accesses beyond a piece of the same allocation.

#pragma once

struct Arena {
    enum { ALIGNMENT = 64, GUARD = 64 };

    char* base;
    long long used;

    static inline Arena at(void* memory) { return Arena{(char*)memory, 0}; }

    inline void* take(long long bytes) {
        char* const piece = base ? base + used : nullptr;
        const long long guarded = (bytes + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT + GUARD;
        if (piece) {
            __asan_unpoison_memory_region(piece, (size_t)bytes);
            __asan_poison_memory_region(piece + bytes, (size_t)(guarded - bytes));
        }
        used += guarded;
        return piece;
    }
    inline float* floats(long long count) { return (float*)take(count * (long long)sizeof(float)); }
    inline int* ints(long long count) { return (int*)take(count * (long long)sizeof(int)); }
    inline unsigned char* bytes(long long count) { return (unsigned char*)take(count); }
};
