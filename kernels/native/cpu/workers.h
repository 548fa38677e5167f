// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// Workers of a job share its counters. None of them ever waits long: it may have a core that another one needs. Whoever
// launched them sees by the counters what is left to do, and sleeps.
struct Workers {
    enum { SPINS = 1 << 14 };  // some ten microseconds

    // This worker's number, of memory that is its own.
    static inline int enter(int* counter) { return __atomic_fetch_add(counter + COUNTER_ENTERED, 1, __ATOMIC_SEQ_CST); }

    // The next unit of work.
    static inline int take(int* counter) {
        return __atomic_fetch_add(counter + COUNTER_NEXT_UNIT, 1, __ATOMIC_RELAXED);
    }

    // A unit of work that is known to be the next one; if it is not any more, `unit` becomes the one that is.
    static inline bool take_this(int* counter, int& unit) {
        return __atomic_compare_exchange_n(counter + COUNTER_NEXT_UNIT, &unit, unit + 1, false, __ATOMIC_RELAXED,
                                           __ATOMIC_RELAXED);
    }

    // Wait for a moment until so many units are done; whether they are.
    static inline bool wait_for_units(const int* counter, int count) {
        for (int spin = 0; spin < SPINS; ++spin)
            if (__atomic_load_n(counter + COUNTER_DONE, __ATOMIC_ACQUIRE) >= count) return true;
        return false;
    }

    // Where workers come and go, they share pieces of memory that have a flag each. There are as many as workers.
    static inline int take_memory(int* flags) {
        for (int i = 0;; ++i)
            if (!__atomic_exchange_n(flags + i, 1, __ATOMIC_ACQUIRE)) return i;
    }
    static inline void give_back_memory(int* flags, int i) { __atomic_store_n(flags + i, 0, __ATOMIC_RELEASE); }

    // Go before there is nothing left.
    static inline void leave(int* counter) { __atomic_fetch_sub(counter + COUNTER_ENTERED, 1, __ATOMIC_SEQ_CST); }

    // Say that there is nothing left, and look for a moment whether the others that have begun are done too.
    static inline void finish(int* counter) {
        __atomic_thread_fence(__ATOMIC_SEQ_CST);  // what was written past the caches has to be there
        __atomic_fetch_add(counter + COUNTER_FINISHED, 1, __ATOMIC_SEQ_CST);
        for (int spin = 0; spin < SPINS; ++spin)
            if (__atomic_load_n(counter + COUNTER_FINISHED, __ATOMIC_ACQUIRE) >=
                __atomic_load_n(counter + COUNTER_ENTERED, __ATOMIC_ACQUIRE))
                return;
    }
};
