// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Visible fractions of targets, which are one or several objects; the counterpart of cpu/fractions.h. A warp renders a
// target in isolation. All pixels that do not show it are then set to be infinitely near, so that a rendering of all
// objects visits only surfaces in front of it.

#pragma once

#include "cuda/packets.h"
#include "shared/sample_window.h"

// The counters of a call of kernels/visibility/fraction_packets_cuda.py.
struct FractionCall {
    const int* first;  // [target + 1]: first of its objects in `members`
    const int* members;
    int canvas[4];  // x0, y0, x1, y1 in pixels of the image, end exclusive
    int min_samples;  // of the rectangle that a target may cover
    int parts;  // warps that share a target in a view
    int views, targets, objects;
    int* counts;  // [counter][view][target]
    int* hidden_by;  // [view][target][object]: samples occluded by that object

    template <class Targets, class Sampling, class Counts, class HiddenBy>
    static inline FractionCall of(const Targets& targets, const Sampling& sampling, const Counts& counts,
                                  const HiddenBy& hidden_by) {
        FractionCall call;
        call.first = targets.first.data, call.members = targets.members.data;
        call.canvas[0] = sampling.canvas.x0, call.canvas[1] = sampling.canvas.y0;
        call.canvas[2] = sampling.canvas.x1, call.canvas[3] = sampling.canvas.y1;
        call.min_samples = sampling.min_samples, call.parts = sampling.threads;
        call.views = counts.shape[1], call.targets = counts.shape[2], call.objects = hidden_by.shape[2];
        call.counts = counts.data, call.hidden_by = hidden_by.data;
        return call;
    }
    inline bool has(int target, int object) const {
        bool found = false;
        for (int i = first[target]; i < first[target + 1]; ++i) found |= members[i] == object;
        return found;
    }
    inline int* counter(int index, int view, int target) const {
        return counts + ((long long)index * views + view) * targets + target;
    }
};

// Part of a target's window: a packet, whose first row and column belong to the packets before.
struct FractionPacket {
    enum { NEW_WIDTH = PACKET_WIDTH - 1, NEW_HEIGHT = PACKET_HEIGHT - 1 };
    // States of a sample, stored instead of its key.
    enum { OUTSIDE, HIDDEN, VISIBLE };
    // Less preferred than all triangles at equal depth, but the target is brought nearer by a step of rounding.
    enum { OWN_ID = 0xfffffffeu };

    const FractionCall& call;
    const SampleWindow& window;
    const View& image;  // the camera
    int target;
    int x0, y0;  // the packet's first sample in the image

    // The camera of the packet's samples.
    inline View view() const {
        View part = image;
        part.width = PACKET_WIDTH, part.height = PACKET_HEIGHT;
        for (int k = 0; k < 2; ++k) {
            part.focal[k] = image.focal[k] * window.across;
            part.center[k] = image.center[k] * window.across - (k ? y0 : x0);
        }
        part.near = 0.0f, part.far = __int_as_float(Write::INFINITY_BITS);  // surfaces out of range occlude, too
        return part;
    }
    inline bool is_in_window(int x, int y) const {
        return x >= window.x0 && y >= window.y0 && x < window.x1 && y < window.y1;
    }
    inline bool is_in_image(int x, int y) const {
        return x >= 0 && y >= 0 && x < image.width * window.across && y < image.height * window.across;
    }
    inline bool is_center(int x, int y) const { return rest(x) == window.across / 2 && rest(y) == window.across / 2; }
    inline int rest(int sample) const {
        const int rest = sample % window.across;
        return rest < 0 ? rest + window.across : rest;
    }
    // Add the number of lanes whose condition holds to a counter.
    inline void add(int counter, bool condition) const { add_count(counter, __popc(Warp::ballot(condition))); }
    inline void add_count(int counter, int count) const {
        if (count && Warp::lane() == 0) atomicAdd(call.counter(counter, image.index, target), count);
    }

    // Call a function of a block, of the slot of the lane's sample in it, and of the sample's coordinates in the
    // packet, for some blocks. The loop is not unrolled: the code would exceed the instruction cache.
    template <class Function>
    static inline void each_sample(unsigned blocks, Function function) {
        const int lane = Warp::lane();
#pragma unroll 1
        for (unsigned remaining = blocks; remaining; remaining = Warp::without_first_lane(remaining)) {
            const int block = Warp::first_lane(remaining);
            function(block, Packet::index(block, lane), Packet::block_x(block) + Packet::pixel_x(lane),
                     Packet::block_y(block) + Packet::pixel_y(lane));
        }
    }
    static inline unsigned all_blocks() { return BLOCKS == LANES ? (unsigned)Warp::all : (1u << BLOCKS % LANES) - 1; }

    // Count the samples that the target covers, and leave only those that may be visible; returns the blocks that have
    // any. `covered_blocks` receives the blocks in which the target covers the lane's sample.
    inline unsigned isolate(Packet& packet, unsigned& covered_blocks) const {
        unsigned open_blocks = 0;
        covered_blocks = 0;
        each_sample(all_blocks(), [&](int block, int slot, int x, int y) {
            const float inv_z = Write::inv_z_of(*packet.at(slot));
            const int at_x = x0 + x, at_y = y0 + y;
            const bool covered = inv_z > 0.0f && is_in_window(at_x, at_y);
            bool open = false;
            if (Warp::any(covered)) {
                const bool counts = covered && x > 0 && y > 0, in_image = covered && is_in_image(at_x, at_y);
                const float z = Reciprocal::of(inv_z);
                const bool near = in_image && z < image.near, far = in_image && z > image.far;
                covered_blocks |= (unsigned)covered << block;
                add(SILHOUETTE_SAMPLES, counts);
                add(IMAGE_SAMPLES, counts && in_image);
                add(TOO_NEAR_SAMPLES, counts && near);
                add(TOO_FAR_SAMPLES, counts && far);
                add(SILHOUETTE_CENTERS, counts && is_center(at_x, at_y));
                open = in_image && !near && !far;
                if (Warp::any(open)) open_blocks |= 1u << block;
            }
            *packet.at(slot) = open ? DepthKey::of(__uint_as_float(__float_as_uint(inv_z) + 1), OWN_ID)
                                    : DepthKey::of(NOWHERE, Packet::NO_TRIANGLE);
        });
        Warp::sync();
        packet.block_min_inv_z = __float_as_uint(NOWHERE);
        packet.stale_blocks = open_blocks;
        packet.refresh();
        return open_blocks;
    }

    // Count the samples of open blocks that are still visible, and write the states of all that the target covers.
    inline void count(const Scene& scene, Packet& packet, unsigned open_blocks, unsigned covered_blocks) const {
        int code[4] = {0, 0, 0, 0};
        each_sample(open_blocks, [&](int, int slot, int x, int y) {
            const Key key = *packet.at(slot);
            const int at_x = x0 + x, at_y = y0 + y;
            const bool open = Write::inv_z_of(key) < NOWHERE, counts = x > 0 && y > 0;
            const unsigned id = DepthKey::id(key);
            const int shown = open && id != OWN_ID ? scene.object_of(id) : -1;
            const bool visible = open && (shown < 0 || call.has(target, shown));
            add(VISIBLE_SAMPLES, visible && counts);
            add(VISIBLE_CENTERS, visible && counts && is_center(at_x, at_y));
            if (open && !visible && counts) atomicAdd(hidden_by(shown), 1);
            if (visible) {
                const int px = at_x / window.across, py = at_y / window.across;
                const int corner[4] = {BOX_MIDDLE - px, BOX_MIDDLE - py, BOX_MIDDLE + px, BOX_MIDDLE + py};
                for (int k = 0; k < 4; ++k) code[k] = max(code[k], corner[k]);
            }
            *packet.at(slot) = (Key)(visible ? VISIBLE : HIDDEN);
        });
        for (int k = 0; k < 4; ++k) {
            const unsigned most = Warp::reduce_max((unsigned)code[k]);
            if (most && Warp::lane() == 0) atomicMax(call.counter(FRACTION_BOX + k, image.index, target), (int)most);
        }
        const unsigned covered = Warp::reduce_or(covered_blocks);
        each_sample(covered, [&](int block, int slot, int, int) {
            const bool is_open = open_blocks >> block & 1;
            const int state =
                covered_blocks >> block & 1 ? is_open ? (int)*packet.at(slot) : (int)HIDDEN : (int)OUTSIDE;
            *packet.at(slot) = (Key)state;
        });
        Warp::sync();
        count_edges(packet, covered);
    }
    inline int* hidden_by(int object) const {
        return call.hidden_by + ((long long)image.index * call.targets + target) * call.objects + object;
    }
    // Count edges between samples of different states. Blocks that the target does not cover are OUTSIDE: their keys
    // have no id.
    inline void count_edges(const Packet& packet, unsigned covered) const {
        static_assert((int)OUTSIDE == 0 && (unsigned)Packet::NO_TRIANGLE == 0xffffffffu,
                      "a key without an id ends in 0");
        const unsigned left_column = (unsigned)(Warp::all / ((1ull << BLOCK_COLUMNS) - 1));
        const unsigned on_right = covered << 1 & ~left_column, below = covered << BLOCK_COLUMNS;
        int edges = 0, outline = 0;
        each_sample((covered | on_right | below) & all_blocks(), [&](int, int, int x, int y) {
            if (x == 0 || y == 0) return;
            const int state = state_at(packet, x, y), left = state_at(packet, x - 1, y);
            const int above = state_at(packet, x, y - 1);
            edges += (state != left) + (state != above);
            outline += ((state == OUTSIDE) != (left == OUTSIDE)) + ((state == OUTSIDE) != (above == OUTSIDE));
        });
        atomic_add_sum(STATE_EDGES, edges);
        atomic_add_sum(SILHOUETTE_EDGES, outline);
        Warp::sync();
    }
    // Add the sum of all lanes' numbers, each below 1024, to a counter.
    inline void atomic_add_sum(int counter, int number) const {
        int sum = 0;
        for (int bit = 0; bit < 10; ++bit) sum += __popc(Warp::ballot(number >> bit & 1)) << bit;
        add_count(counter, sum);
    }
    static inline int state_at(const Packet& packet, int x, int y) { return (int)*packet.at(Packet::index_at(x, y)); }
};

struct Fractions {
    // Measure one part of a target's window in a view; 32 threads call it. `isolated` has a frame for each object.
    static inline void measure(Scene scene, const Scene& isolated, const View& image, const FractionCall& call,
                               int target, int part, WarpMemory& memory) {
        // Without movable objects, there is one world, of no poses.
        if (scene.movables.moving == 0) scene.movables.poses = isolated.movables.poses;
        const bool exists = scene.movables.poses && isolated.movables.poses;
        const SampleWindow window = exists ? find_window(isolated, image, call, target) : SampleWindow{1, 0, 0, 0, 0};
        if (part == 0 && Warp::lane() == 0)
            *call.counter(SAMPLES_ACROSS, image.index, target) = window.empty() ? 0 : window.across;
        if (window.empty()) return;
        // A sample more on every side, where nothing is covered, so that all edges are counted.
        const int columns = (window.x1 - window.x0 + 1 + FractionPacket::NEW_WIDTH - 1) / FractionPacket::NEW_WIDTH;
        const int rows = (window.y1 - window.y0 + 1 + FractionPacket::NEW_HEIGHT - 1) / FractionPacket::NEW_HEIGHT;
        for (int i = part; i < columns * rows; i += call.parts) {
            const FractionPacket packet = {call,
                                           window,
                                           image,
                                           target,
                                           window.x0 - 1 + i % columns * FractionPacket::NEW_WIDTH,
                                           window.y0 - 1 + i / columns * FractionPacket::NEW_HEIGHT};
            measure(scene, isolated, packet, memory);
        }
    }
    static inline void measure(const Scene& scene, const Scene& isolated, const FractionPacket& part,
                               WarpMemory& memory) {
        const View view = part.view();
        Camera camera = Packets::camera_of(view);
        camera.skip_back_faces = false, camera.cull_back_faces = view.cull_back_faces;
        Packet packet;
        packet.memory = &memory.pixels;
        packet.first_x = packet.first_y = 0;
        packet.begin(PACKET_WIDTH, PACKET_HEIGHT);
        if (Warp::lane() == 0) memory.cameras[WarpMemory::WORLD] = camera;
        Warp::sync();
        unsigned open_blocks = 0, covered_blocks = 0;
        const int end = part.call.first[part.target + 1];
        // The target's objects, then all that is in front of them. A single call, because its code is long.
#pragma unroll 1
        for (int i = part.call.first[part.target]; i <= end; ++i) {
            const bool is_member = i < end;
            if (is_member && isolated.movables.excludes(part.call.members[i])) continue;
            if (!is_member) {
                open_blocks = part.isolate(packet, covered_blocks);
                if (!open_blocks) break;
                Packets::set_sides(scene, view, memory.cameras[WarpMemory::WORLD]);
            }
            const Scene& drawn = is_member ? isolated : scene;
            const ObjectPass::QueuedRange queued =
                is_member ? queue_one(isolated.movables, part.call.members[i], memory) : ObjectPass::QueuedRange{0, 0};
            Warp::sync();
            ObjectPass::render(drawn, view, packet, queued, !is_member && scene.bvh.root >= 0, memory);
            packet.refresh();
            Warp::sync();
        }
        if (Warp::any(covered_blocks)) part.count(scene, packet, open_blocks, covered_blocks);
    }
    // Queue a single object, as if all had been examined.
    static inline ObjectPass::QueuedRange queue_one(const Movables& movables, int m, WarpMemory& memory) {
        if (Warp::lane() == 0) {
            memory.objects.visits[0] = Visit::of(NOWHERE, 0, 0, PACKET_WIDTH - 1, PACKET_HEIGHT - 1);
            memory.objects.objects[0] = __ldg(movables.solid + m) != SOLID_NONE ? ~m : m;
        }
        return ObjectPass::QueuedRange{1, movables.count};
    }
    static inline SampleWindow find_window(const Scene& isolated, const View& image, const FractionCall& call,
                                           int target) {
        const Pose pose = Pose::from(image.pose);
        double low[2] = {1e30, 1e30}, high[2] = {-1e30, -1e30};
        bool crosses = false;
        for (int i = call.first[target]; i < call.first[target + 1]; ++i) {
            const int index = call.members[i];
            if (isolated.movables.excludes(index)) continue;
            const Pose local = pose.seen_from(Pose::from(isolated.movables.pose(index)));
            const Stretch stretch = isolated.movables.stretch(index);
            const int behind = SampleWindow::add_box(local, image, isolated.movables.box(index), stretch, low, high);
            crosses |= behind > 0 && behind < 8;
        }
        return crosses ? SampleWindow::all(call.canvas) : SampleWindow::of(low, high, call.canvas, call.min_samples);
    }
};
