// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Emulation of the CUDA functions used by kernels/native/cuda/*.h, for an ordinary C++ compiler: a warp of 32 lanes,
// each a fiber.
//
// A lane runs until it calls an intrinsic that synchronizes the warp; then the next lane runs. When all have arrived,
// the emulator checks that they arrived at the same call through the same call stack, computes their results, and
// continues. Lanes run in one of several orders: results that depend on the order indicate a race.

#pragma once

#include <math.h>
#include <stdint.h>
#include <string.h>

namespace emulator {

enum { WARP_SIZE = 32 };

// Order of the lanes, and whether they may be interrupted.
enum Order { FORWARD, REVERSE, SHUFFLED, OTHERWISE_SHUFFLED, INTERRUPTED, ORDERS };

struct Index {
    unsigned x;
};

// A grid of packets of several views, and the function that processes a packet; every lane calls it.
struct Launch {
    void (*packet)(void* arguments, int view, int packet_y, int packet_x);
    void* arguments;
    int views, packets_y, packets_x;
};

// Run a launch, warp after warp. Aborts the process with a message if lanes diverge.
void run(const Launch& launch, Order order);

// Shared memory of a warp, filled with random bytes when the warp begins; the same address for all lanes.
void* shared_memory(unsigned long bytes);

enum Operation { SYNC, BALLOT, ANY, SHUFFLE, SHUFFLE_XOR, MIN, MAX, UNITED };

// Wait for all lanes, each with a value and a lane, and return the operation's result for this lane.
unsigned meet(Operation operation, unsigned mask, unsigned value, int lane);

// Let another lane run before this one continues; only in some orders.
void interrupt();

}  // namespace emulator

#define __noinline__ __attribute__((noinline))

// The running lane.
extern emulator::Index threadIdx;

static inline void __syncwarp() { emulator::meet(emulator::SYNC, 0xffffffffu, 0, 0); }
static inline unsigned __ballot_sync(unsigned mask, bool condition) {
    return emulator::meet(emulator::BALLOT, mask, condition, 0);
}
static inline bool __any_sync(unsigned mask, bool condition) {
    return emulator::meet(emulator::ANY, mask, condition, 0) != 0;
}
static inline int __shfl_sync(unsigned mask, int value, int lane) {
    return (int)emulator::meet(emulator::SHUFFLE, mask, (unsigned)value, lane);
}
static inline unsigned __shfl_xor_sync(unsigned mask, unsigned value, int lanes) {
    return emulator::meet(emulator::SHUFFLE_XOR, mask, value, lanes);
}
static inline unsigned __reduce_min_sync(unsigned mask, unsigned value) {
    return emulator::meet(emulator::MIN, mask, value, 0);
}
static inline unsigned __reduce_max_sync(unsigned mask, unsigned value) {
    return emulator::meet(emulator::MAX, mask, value, 0);
}
static inline unsigned __reduce_or_sync(unsigned mask, unsigned value) {
    return emulator::meet(emulator::UNITED, mask, value, 0);
}

template <class Word>
static inline Word atomicMax(Word* at, Word value) {
    emulator::interrupt();
    const Word before = *at;
    if (value > before) *at = value;
    return before;
}
static inline int atomicAdd(int* at, int value) {
    emulator::interrupt();
    const int before = *at;
    *at = before + value;
    return before;
}
static inline int atomicExch(int* at, int value) {
    emulator::interrupt();
    const int before = *at;
    *at = value;
    return before;
}
static inline unsigned atomicAnd(unsigned* at, unsigned value) {
    emulator::interrupt();
    const unsigned before = *at;
    *at = before & value;
    return before;
}

template <class T>
static inline T __ldg(const T* at) {
    return *at;
}

static inline int __popc(unsigned bits) { return __builtin_popcount(bits); }
static inline int __ffs(unsigned bits) { return __builtin_ffs((int)bits); }

template <class To, class From>
static inline To bits_of(From value) {
    static_assert(sizeof(To) == sizeof(From), "equal sizes");
    To bits;
    memcpy(&bits, &value, sizeof(bits));
    return bits;
}
static inline unsigned __float_as_uint(float value) { return bits_of<unsigned>(value); }
static inline float __uint_as_float(unsigned bits) { return bits_of<float>(bits); }
static inline float __int_as_float(int bits) { return bits_of<float>(bits); }

static inline float __fmul_rn(float a, float b) { return a * b; }
static inline float __fmaf_rn(float a, float b, float c) { return fmaf(a, b, c); }
static inline float __fsqrt_rn(float a) { return sqrtf(a); }
static inline float __frcp_rn(float a) { return 1.0f / a; }
static inline double __dmul_rn(double a, double b) { return a * b; }
static inline double __fma_rn(double a, double b, double c) { return fma(a, b, c); }

// CUDA guarantees two units in the last place, and 0 for the largest divisors: errors of that size are emulated.
static inline float __fdividef(float a, float b) {
    const float size = fabsf(b);
    if (size > 8.507059e37f) return size <= 3.4028235e38f && fabsf(a) <= 3.4028235e38f ? 0.0f : a * (1.0f / b) * 0.0f;
    const float exact = a / b;
    if (!(fabsf(exact) > 1e-30f && fabsf(exact) < 1e30f)) return exact;
    const int wrong = (int)((__float_as_uint(b) * 2654435761u) >> 30) - 1;  // from -1 to 2, a function of the divisor
    return __uint_as_float(__float_as_uint(exact) + (unsigned)wrong);
}

// Convert to an integer as CUDA does: saturated, and 0 for NaN.
static inline int saturated(float whole) {
    if (!(whole == whole)) return 0;
    return whole >= 2147483648.0f ? 2147483647 : whole < -2147483648.0f ? -2147483647 - 1 : (int)whole;
}
static inline int __float2int_ru(float a) { return saturated(ceilf(a)); }
static inline int __float2int_rd(float a) { return saturated(floorf(a)); }

static inline int min(int a, int b) { return a < b ? a : b; }
static inline int max(int a, int b) { return a > b ? a : b; }
static inline unsigned min(unsigned a, unsigned b) { return a < b ? a : b; }
