// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Lanes of the emulator as cooperative fibers. Only this file is compiled without sanitizers; if EMULATOR_ASAN is
// defined, it reports stack switches to the address sanitizer.

#include <stdio.h>
#include <stdlib.h>
#include <ucontext.h>

#include "cuda_emulator.h"

#ifdef EMULATOR_ASAN
#include <sanitizer/asan_interface.h>
#include <sanitizer/common_interface_defs.h>
#endif

// Clang supports __builtin_setjmp and __builtin_longjmp on some targets only.
#if defined(__x86_64__) || !defined(__clang__)
#define EMULATOR_JUMPS 1
#endif

#define NOT_INLINED __attribute__((noinline))

emulator::Index threadIdx;

namespace emulator {
namespace {

enum { STACK_BYTES = 128 * 1024, DEEPEST = 64 };

// Where to resume.
struct Place {
    ucontext_t context;
    void* jump[5];
    bool started;
    void* fake_stack;  // of the address sanitizer
};

struct Lane {
    Place place;
    char* stack;
    bool arrived, finished;
    Operation operation;
    unsigned mask, value, result;
    int lane;  // lane requested by the operation
    int depth;  // call stack at the operation, innermost call first
    void* calls[DEEPEST];
};

Lane lanes[WARP_SIZE];
Place outside;
const void* outside_stack;  // set when the first lane begins
size_t outside_stack_bytes;

Launch current;
int current_view, current_y, current_x;
Order current_order;
int lane_order[WARP_SIZE];  // the order in which lanes run
int running;  // index in it
int finished_count;
void* shared;
unsigned long shared_bytes;
bool shared_is_fresh;
uint32_t random_state;

uint32_t random_word() {
    random_state ^= random_state << 13;
    random_state ^= random_state >> 17;
    random_state ^= random_state << 5;
    return random_state;
}

[[noreturn]] void fail(const char* what, int lane, int other) {
    fprintf(stderr, "emulator: view %d, packet %d, %d: lanes %d and %d %s\n", current_view, current_y, current_x, lane,
            other, what);
    fflush(stderr);
    abort();
}

void shuffle() {
    for (int i = WARP_SIZE - 1; i > 0; --i) {
        const int k = (int)(random_word() % (unsigned)(i + 1)), swapped = lane_order[i];
        lane_order[i] = lane_order[k];
        lane_order[k] = swapped;
    }
}

#ifdef EMULATOR_JUMPS
NOT_INLINED void jump_to(Place& to) { __builtin_longjmp(to.jump, 1); }

// Ten times as fast as swapcontext, which calls the kernel; poisoned regions of a stack stay poisoned.
NOT_INLINED void go(Place& from, Place& to) {
    if (__builtin_setjmp(from.jump)) return;
    if (to.started) jump_to(to);
    to.started = true;
    setcontext(&to.context);
}
#else
void go(Place& from, Place& to) { swapcontext(&from.context, &to.context); }
#endif

// Switch to another lane, or outside if `to` is null; returns when this lane is resumed.
NOT_INLINED void leave(Lane* from, Lane* to) {
    Place& here = from ? from->place : outside;
#ifdef EMULATOR_ASAN
    __sanitizer_start_switch_fiber(from && from->finished ? nullptr : &here.fake_stack, to ? to->stack : outside_stack,
                                   to ? (size_t)STACK_BYTES : outside_stack_bytes);
#endif
    if (to) threadIdx.x = (unsigned)(to - lanes);
    go(here, to ? to->place : outside);
#ifdef EMULATOR_ASAN
    __sanitizer_finish_switch_fiber(here.fake_stack, nullptr, nullptr);
#endif
}

// The next lane that has not arrived, or null.
Lane* next_lane() {
    for (int i = 1; i <= WARP_SIZE; ++i) {
        const int place = (running + i) % WARP_SIZE;
        Lane& lane = lanes[lane_order[place]];
        if (lane.arrived || lane.finished) continue;
        running = place;
        return &lane;
    }
    return nullptr;
}

void enter() {
    Lane& lane = lanes[threadIdx.x];
#ifdef EMULATOR_ASAN
    const void* stack;
    size_t bytes;
    __sanitizer_finish_switch_fiber(lane.place.fake_stack, &stack, &bytes);
    if (!outside_stack) outside_stack = stack, outside_stack_bytes = bytes;
#endif
    current.packet(current.arguments, current_view, current_y, current_x);
    lane.finished = true;
    ++finished_count;
    for (int other = 0; other < WARP_SIZE; ++other)
        if (lanes[other].arrived) fail("diverge: one has finished, the other waits", (int)(&lane - lanes), other);
    leave(&lane, next_lane());
}

// Record the call stack of a lane from the frames on its stack.
NOT_INLINED void record_call_stack(Lane& lane, void** frame) {
    lane.depth = 0;
    const char* end = lane.stack + STACK_BYTES;
    while ((char*)frame >= lane.stack && (char*)(frame + 2) <= end && lane.depth < DEEPEST) {
        lane.calls[lane.depth++] = frame[1];
        void** next = (void**)frame[0];
        if (next <= frame) break;
        frame = next;
    }
}

void compare(const Lane& one, const Lane& other) {
    const int a = (int)(&one - lanes), b = (int)(&other - lanes);
    if (one.operation != other.operation) fail("diverge: they came to different intrinsics", a, b);
    if (one.depth != other.depth) fail("diverge: they came to one intrinsic through different calls", a, b);
    for (int i = 0; i < one.depth; ++i)
        if (one.calls[i] != other.calls[i]) fail("diverge: they came to one intrinsic through different calls", a, b);
}

unsigned reduced(Operation operation) {
    unsigned least = ~0u, most = 0, united = 0, where = 0;
    for (int i = 0; i < WARP_SIZE; ++i) {
        const unsigned value = lanes[i].value;
        least = value < least ? value : least;
        most = value > most ? value : most;
        united |= value;
        where |= (unsigned)(value != 0) << i;
    }
    return operation == MIN ? least : operation == MAX ? most : operation == UNITED ? united : where;
}

// All lanes have arrived: compute their results.
void resolve() {
    for (int i = 0; i < WARP_SIZE; ++i) {
        if (lanes[i].mask != 0xffffffffu) fail("are not all named by the mask", i, i);
        compare(lanes[0], lanes[i]);
    }
    const unsigned all = reduced(lanes[0].operation);
    for (int i = 0; i < WARP_SIZE; ++i) {
        Lane& lane = lanes[i];
        int from = lane.lane;
        if (lane.operation == SHUFFLE_XOR) from ^= i;
        if (from < 0 || from >= WARP_SIZE) fail("shuffle with a lane that does not exist", i, from);
        lane.result = lane.operation == SHUFFLE || lane.operation == SHUFFLE_XOR ? lanes[from].value : all;
        lane.arrived = false;
    }
    if (current_order >= SHUFFLED) shuffle();
    running = WARP_SIZE - 1;
}

void prepare(Lane& lane) {
    lane.arrived = lane.finished = lane.place.started = false;
    lane.place.fake_stack = nullptr;
    if (!lane.stack) lane.stack = (char*)malloc(STACK_BYTES);
#ifdef EMULATOR_ASAN
    __asan_unpoison_memory_region(lane.stack, STACK_BYTES);  // left poisoned by the last warp's lane
#endif
    getcontext(&lane.place.context);
    lane.place.context.uc_stack.ss_sp = lane.stack;
    lane.place.context.uc_stack.ss_size = STACK_BYTES;
    lane.place.context.uc_link = nullptr;
    makecontext(&lane.place.context, enter, 0);
}

void run_warp() {
    shared_is_fresh = true;
    finished_count = 0;
    for (int i = 0; i < WARP_SIZE; ++i) prepare(lanes[i]);
    running = WARP_SIZE - 1;
    outside.started = true;
    leave(nullptr, next_lane());
}

}  // namespace

NOT_INLINED unsigned meet(Operation operation, unsigned mask, unsigned value, int lane_asked) {
    Lane& lane = lanes[threadIdx.x];
    lane.operation = operation, lane.mask = mask, lane.value = value, lane.lane = lane_asked;
    record_call_stack(lane, (void**)__builtin_frame_address(0));
    lane.arrived = true;
    for (int other = 0; finished_count && other < WARP_SIZE; ++other)
        if (lanes[other].finished) fail("diverge: one waits, the other has finished", (int)(&lane - lanes), other);
    Lane* next = next_lane();
    if (!next) {
        resolve();
        next = next_lane();
    }
    if (next != &lane) leave(&lane, next);
    return lane.result;
}

void interrupt() {
    if (current_order != INTERRUPTED || random_word() % 2) return;
    Lane& lane = lanes[threadIdx.x];
    Lane* next = next_lane();
    if (next && next != &lane) leave(&lane, next);
}

void* shared_memory(unsigned long bytes) {
    if (!shared || bytes != shared_bytes) {
        free(shared);
        shared = aligned_alloc(16, (bytes + 15) / 16 * 16);
        shared_bytes = bytes;
    }
    if (shared_is_fresh)
        for (unsigned long i = 0; i < bytes; ++i) ((unsigned char*)shared)[i] = (unsigned char)random_word();
    shared_is_fresh = false;
    return shared;
}

void run(const Launch& launch, Order order) {
    current = launch;
    current_order = order;
    random_state = 0x9e3779b9u + (unsigned)order;
    for (int i = 0; i < WARP_SIZE; ++i) lane_order[i] = order == REVERSE ? WARP_SIZE - 1 - i : i;
    if (order >= SHUFFLED) shuffle();
    for (current_view = 0; current_view < launch.views; ++current_view)
        for (current_y = 0; current_y < launch.packets_y; ++current_y)
            for (current_x = 0; current_x < launch.packets_x; ++current_x) run_warp();
}

}  // namespace emulator
