// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "shared/constants.h"

// Shared counters of the workers of a job. No worker waits long, because it may occupy a core that another one needs;
// the thread that launched them reads from the counters how much is left to do, and sleeps.
struct Workers {
    enum { SPINS = 1 << 14 };  // about ten microseconds

    // Index of this worker, which selects its memory.
    static inline int enter(int* counter) { return __atomic_fetch_add(counter + COUNTER_ENTERED, 1, __ATOMIC_SEQ_CST); }

    // Take the next unit of work.
    static inline int take(int* counter) {
        return __atomic_fetch_add(counter + COUNTER_NEXT_UNIT, 1, __ATOMIC_RELAXED);
    }

    // Take units of work until none remain, and do each by `unit(number)`; other threads take from the same counter.
    template <class Unit>
    static inline __attribute__((always_inline)) void run(int* counter, int units, Unit unit) {
        for (int next; (next = take(counter)) < units;) unit(next);
        finish(counter);
    }

    // Take a unit if it is still the next one; otherwise, set `unit` to the next one and return false.
    static inline bool take_this(int* counter, int& unit) {
        return __atomic_compare_exchange_n(counter + COUNTER_NEXT_UNIT, &unit, unit + 1, false, __ATOMIC_RELAXED,
                                           __ATOMIC_RELAXED);
    }

    // Spin briefly until `count` units are done; returns whether they are.
    static inline bool wait_for_units(const int* counter, int count) {
        for (int spin = 0; spin < SPINS; ++spin)
            if (__atomic_load_n(counter + COUNTER_DONE, __ATOMIC_ACQUIRE) >= count) return true;
        return false;
    }

    // If workers come and go, they share pieces of memory, each with a flag. There are as many pieces as workers.
    static inline int take_memory(int* flags) {
        for (int i = 0;; ++i)
            if (!__atomic_exchange_n(flags + i, 1, __ATOMIC_ACQUIRE)) return i;
    }
    static inline void give_back_memory(int* flags, int i) { __atomic_store_n(flags + i, 0, __ATOMIC_RELEASE); }

    // Leave while work remains.
    static inline void leave(int* counter) { __atomic_fetch_sub(counter + COUNTER_ENTERED, 1, __ATOMIC_SEQ_CST); }

    // Mark this worker as finished, and spin briefly until all workers that entered have finished.
    static inline void finish(int* counter) {
        __atomic_thread_fence(__ATOMIC_SEQ_CST);  // non-temporal stores must be visible
        __atomic_fetch_add(counter + COUNTER_FINISHED, 1, __ATOMIC_SEQ_CST);
        for (int spin = 0; spin < SPINS; ++spin)
            if (__atomic_load_n(counter + COUNTER_FINISHED, __ATOMIC_ACQUIRE) >=
                __atomic_load_n(counter + COUNTER_ENTERED, __ATOMIC_ACQUIRE))
                return;
    }
};
