// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Integration of depth images into an occupancy map on CPU cores, 16 pixels or voxels at a time: see
// kernels/maps/occupancy.py.

#pragma once

#include "cpu/depth_rows.h"

constexpr int BLOCK_EDGE = VOXEL_BLOCK_SIDE, BLOCK_SIZE = VOXEL_BLOCK_SIZE;
constexpr float HALF_DIAGONAL = 0.8661f;  // of a voxel, in voxels
constexpr float MIN_DEPTH = 1e-3f;  // of blocks whose image is bounded [m]
constexpr float MARGIN = 0.25f;  // around the image of a block [px], more than the rounding error
constexpr int NEVER_SEEN = VOXEL_NEVER_SEEN, HIDDEN = VOXEL_HIDDEN;
static_assert(BLOCK_SIZE == BLOCK_EDGE * BLOCK_EDGE * BLOCK_EDGE, "a block is a cube");
static_assert(LANES == 2 * BLOCK_EDGE, "16 lanes are two rows of voxels along z");

// Depth of a row of pixels, and of the rows above and below; these are null at the border of the image.
struct SurfaceRow {
    int width;
    const float *depth, *above, *below;
    float near, reach;
    const float* sigma;  // standard deviation of depth [m]: coefficients of 1, z and z^2
    float max_step;  // relative

    // Depth in the convention of REP 117, as in `shown_between`.
    inline Floats shown(Floats depth) const {
        const Floats inf = Lanes::all(__builtin_inff());
        Floats result = depth < near ? -inf : (depth > reach ? inf : depth);
        result = depth > 0.0f ? result : Lanes::all(__builtin_nanf(""));
        return depth == -inf ? -inf : result;
    }
    inline Floats sigma_at(Floats z) const {
        return Lanes::max(sigma[0] + z * (sigma[1] + z * sigma[2]), Lanes::all(0.0f));
    }
    // Extend an interval to the border with a neighbor pixel on the same surface.
    static inline void widen(Floats depth, Floats neighbor, Floats max_step, Floats* low, Floats* high) {
        const Ints same = Lanes::abs(neighbor - depth) <= max_step;
        const Floats border = same ? 0.5f * (depth + neighbor) : depth;
        *low = Lanes::min(*low, border);
        *high = Lanes::max(*high, border);
    }
    inline Floats load(const float* row, int x) const {
        return row ? PixelLanes::load(row + x, width - x) : Lanes::all(__builtin_nanf(""));
    }
    // Write the intervals of `bound_surface`.
    inline void bound(float* bounds_out) const {
        const Floats inf = Lanes::all(__builtin_inff());
        for (int x = 0; x < width; x += LANES) {
            const int count = width - x < LANES ? width - x : LANES;
            float padded[LANES + 2];  // with the pixels to the left and to the right
            padded[0] = x > 0 ? depth[x - 1] : __builtin_nanf("");
            __builtin_memcpy(padded + 1, depth + x, count * sizeof(float));
            for (int k = count + 1; k < LANES + 2; ++k) padded[k] = __builtin_nanf("");
            if (x + LANES < width) padded[LANES + 1] = depth[x + LANES];
            const Floats seen = shown(Lanes::load(padded + 1));
            const Ints finite = Lanes::abs(seen) < inf;
            const Floats sigmas = sigma_at(seen), step = 3.0f * sigmas + max_step * seen;
            Floats low = seen, high = seen;
            widen(seen, Lanes::load(padded), step, &low, &high);
            widen(seen, Lanes::load(padded + 2), step, &low, &high);
            widen(seen, load(above, x), step, &low, &high);
            widen(seen, load(below, x), step, &low, &high);
            const Floats far = seen > 0.0f ? inf : Lanes::all(0.0f);  // the lower end without a surface in range
            low = finite ? low - sigmas : far;
            high = finite ? high + sigmas : (seen < 0.0f ? Lanes::all(near) : inf);
            PixelLanes::store_pairs(bounds_out + 2 * x, low, high, width - x);
        }
    }
};

// A grid of blocks; see `Blocks` of kernels/maps/occupancy_blocks.py.
struct BlockGrid {
    int first[3], size[3];  // [blocks]
    double cell;
    const int* slots;

    // Mark the voxels that contain the points of a row of pixels, and their blocks.
    inline void mark(const DepthRow& row, unsigned char* marks, unsigned char* marked_slots) const {
        const double per_cell = 1.0 / cell;
        int last[3] = {-1, -1, -1};
        for (int x = 0; x < row.width; x += LANES) {
            const Floats seen = row.load(x);
            const Ints known = row.range.contains(seen) & (PixelLanes::indices(x) < row.width);
            if (!Lanes::any(known)) continue;
            const Floats depth = known ? seen : Lanes::all(0.0f);
            Ints voxel[3];
            for (int k = 0; k < 3; ++k) {
                const Doubles away =
                    __builtin_convertvector(depth, Doubles) * row.directions.component(k).from(x, LANES);
                const Doubles place = __builtin_elementwise_floor((away + row.origin[k]) * per_cell);
                voxel[k] = __builtin_convertvector(place, Ints) - BLOCK_EDGE * first[k];
            }
            for (const int lane : Lanes::each(known)) {
                const int x = voxel[0][lane], y = voxel[1][lane], z = voxel[2][lane];
                if (x == last[0] && y == last[1] && z == last[2]) continue;
                last[0] = x, last[1] = y, last[2] = z;
                const int slot = slot_of(x, y, z);
                if (slot < 0) continue;
                const int offset = ((x % BLOCK_EDGE) * BLOCK_EDGE + y % BLOCK_EDGE) * BLOCK_EDGE + z % BLOCK_EDGE;
                marks[(long long)BLOCK_SIZE * slot + offset] = 1;
                marked_slots[slot] = 1;
            }
        }
    }
    // Slot of the block of a voxel, negative outside of the grid or without one.
    inline int slot_of(int x, int y, int z) const {
        const unsigned i = (unsigned)x / BLOCK_EDGE, j = (unsigned)y / BLOCK_EDGE, k = (unsigned)z / BLOCK_EDGE;
        if (i >= (unsigned)size[0] || j >= (unsigned)size[1] || k >= (unsigned)size[2]) return -1;
        return slots[((long long)i * size[1] + j) * size[2] + k];
    }
};

typedef short Shorts __attribute__((ext_vector_type(LANES)));

// What an image shows of 16 voxels: lanes that are hit, missed or hidden.
struct Judgment {
    Shorts hit, missed, hidden;

    static inline Judgment of(Ints hit, Ints missed, Ints hidden) {
        return Judgment{__builtin_convertvector(hit, Shorts), __builtin_convertvector(missed, Shorts),
                        __builtin_convertvector(hidden, Shorts)};
    }
};

// States that the voxels of a box may have in an image, apart from those without information.
struct PossibleStates {
    bool free, surface, hidden;
    bool all_inside;  // every voxel is in the image and in range
    bool all_measured;  // and its pixel has a measurement
};

// The depth image that updates blocks.
struct BlockView {
    float fx, fy, cx, cy, width, height, reach;
    int row_length;
    const float* bounds;  // interval of each pixel
    const float* tiles;  // `SurfaceLimits` of tiles of pixels
    int tile_side, tiles_per_row;  // [px], [tiles]
    short hit, miss, minimum, maximum;  // log-odds
    float cell;
    float step[3][3];  // change of the position in the camera frame per voxel along the world's axes [m]

    // Load the intervals of 16 pixels.
    inline void gather(Ints pixels, Floats* low, Floats* high) const {
        struct Interval {
            float low, high;
        } intervals[LANES];
        int index[LANES];
        __builtin_memcpy(index, &pixels, sizeof index);
        for (int k = 0; k < LANES; ++k) intervals[k] = ((const Interval*)bounds)[index[k]];
        Floats first, second;
        __builtin_memcpy(&first, intervals, sizeof first);
        __builtin_memcpy(&second, intervals + LANES / 2, sizeof second);
        *low = __builtin_shufflevector(first, second, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
        *high = __builtin_shufflevector(first, second, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
    }
    // Bound the states of a box of voxels by the tiles of its image. `first` is the center of its first voxel, `edges`
    // lead to the last ones along the box's edges [m].
    inline PossibleStates bound(const float* first, const float edges[3][3]) const {
        PossibleStates any = {.free = true, .surface = true, .hidden = true};
        const Ints corner = Lanes::index();
        Floats place[3];
        for (int k = 0; k < 3; ++k) {
            place[k] = Lanes::all(first[k]);
            for (int edge = 0; edge < 3; ++edge) place[k] += (corner & (1 << edge)) != 0 ? edges[edge][k] : 0.0f;
        }
        const float near_z = Lanes::min_of(place[2]), far_z = -Lanes::min_of(-place[2]);
        if (!(near_z > MIN_DEPTH)) return any;
        if (near_z > reach) return PossibleStates{};
        const Floats inverse_z = 1.0f / place[2];
        const Floats x = fx * place[0] * inverse_z + cx, y = fy * place[1] * inverse_z + cy;
        const float low_x = Lanes::min_of(x) - MARGIN, high_x = MARGIN - Lanes::min_of(-x);
        const float low_y = Lanes::min_of(y) - MARGIN, high_y = MARGIN - Lanes::min_of(-y);
        if (!(high_x >= 0.0f && high_y >= 0.0f && low_x < width && low_y < height)) return PossibleStates{};
        const int first_column = low_x > 0.0f ? (int)low_x / tile_side : 0,
                  first_row = low_y > 0.0f ? (int)low_y / tile_side : 0;
        const int last_column = (int)(high_x < width - 1.0f ? high_x : width - 1.0f) / tile_side;
        const int last_row = (int)(high_y < height - 1.0f ? high_y : height - 1.0f) / tile_side;
        float low = __builtin_inff(), high = 0.0f, gaps = 0.0f;
        for (int row = first_row; row <= last_row; ++row)
            for (int column = first_column; column <= last_column; ++column) {
                const float* tile = tiles + 3 * (row * tiles_per_row + column);
                low = tile[0] < low ? tile[0] : low;
                high = tile[1] > high ? tile[1] : high;
                gaps = tile[2] > gaps ? tile[2] : gaps;
            }
        if (high == 0.0f) return PossibleStates{};  // no pixel has a measurement
        const float margin = HALF_DIAGONAL * cell + 1e-5f * far_z;
        const bool in_image = low_x >= 0.0f && low_y >= 0.0f && high_x < width && high_y < height;
        any.all_inside = in_image && far_z < reach;
        any.all_measured = any.all_inside && gaps == 0.0f;
        PossibleStates one = {.all_inside = any.all_inside, .all_measured = any.all_measured};
        one.free = far_z < low - margin;
        one.hidden = near_z > high + margin;
        if (one.free || one.hidden) return one;
        return any;
    }
    // Return whether 16 voxels may change if their states are those of a bound.
    inline bool may_change(Shorts values, const PossibleStates& states) const {
        if (states.surface) return true;
        Shorts changed = (Shorts)(0);
        if (states.free) changed |= values != minimum;
        if (states.hidden) changed |= values == (short)NEVER_SEEN;
        return Lanes::any(__builtin_convertvector(changed, Ints));
    }
    // Judge voxels by the centers' positions in the camera frame, and along the world's axes [m]; `marked` ones contain
    // the point of a pixel. If INSIDE, all are in the image and in range.
    template <bool INSIDE>
    inline Judgment judge(const Points& position, const Points& sight, Ints marked) const {
        const Floats z = position.z, inverse_z = 1.0f / z;
        const Floats x = fx * position.x * inverse_z + cx, y = fy * position.y * inverse_z + cy;
        Ints seen = Lanes::all_ints(-1);
        if (!INSIDE) {
            seen = (z > 0.0f) & (z <= reach);
            seen &= (x >= 0.0f) & (x < width) & (y >= 0.0f) & (y < height);
            if (!Lanes::any(seen)) return Judgment::of(seen, seen, seen);
        }
        const Ints column = __builtin_convertvector(seen ? x : Lanes::all(0.0f), Ints);
        const Ints row = __builtin_convertvector(seen ? y : Lanes::all(0.0f), Ints);
        Floats low, high;
        gather(column + row * row_length, &low, &high);
        const Floats largest = Lanes::max(Lanes::abs(sight.x), Lanes::abs(sight.y), Lanes::abs(sight.z));
        const Floats margin = 0.5f * cell * z / largest;
        const Ints missed = seen & ~marked & (z < low - margin), hidden = seen & ~marked & (z > high + margin);
        return Judgment::of(seen & ~missed & ~hidden & (marked | (low > 0.0f)), missed, hidden);
    }
    inline Shorts updated(Shorts values, const Judgment& judged) const {
        const Shorts old = values > (short)HIDDEN ? values : (Shorts)(0);
        Shorts odds = old + (judged.hit ? (Shorts)hit : (Shorts)miss);
        odds = odds < minimum ? (Shorts)minimum : (odds > maximum ? (Shorts)maximum : odds);
        const Shorts unseen = judged.hidden & (values == (short)NEVER_SEEN);
        return (judged.hit | judged.missed) ? odds : (unseen ? (Shorts)(short)HIDDEN : values);
    }
};

// A block with a slot.
struct VoxelBlock {
    short* values;
    unsigned char* marks;  // of voxels that contain a point, null if none does

    // The values of a block, as it is updated.
    struct Summary {
        Shorts lowest = (Shorts)(32767), highest = (Shorts)(-32768);

        inline void add(Shorts values) {
            lowest = __builtin_elementwise_min(lowest, values);
            highest = __builtin_elementwise_max(highest, values);
        }
        inline int low() const { return __builtin_reduce_min(lowest); }
        inline int high() const { return __builtin_reduce_max(highest); }
    };

    inline Shorts load(int offset) const {
        Shorts loaded;
        __builtin_memcpy(&loaded, values + offset, sizeof loaded);
        return loaded;
    }
    inline void update(const BlockView& view, int offset, const Judgment& judged, Summary* summary) const {
        const Shorts value = view.updated(load(offset), judged);
        __builtin_memcpy(values + offset, &value, sizeof value);
        summary->add(value);
    }
    // Update all voxels alike.
    inline Summary update(const BlockView& view, bool is_free) const {
        const Shorts all = (Shorts)(-1), none = (Shorts)(0);
        const Judgment judged = {.hit = none, .missed = is_free ? all : none, .hidden = is_free ? none : all};
        Summary summary;
        for (int offset = 0; offset < BLOCK_SIZE; offset += LANES) update(view, offset, judged, &summary);
        return summary;
    }
    // Bound the states of all voxels; where a voxel contains a point, all are possible.
    inline PossibleStates bound(const BlockView& view, const float* position) const {
        float edges[3][3];
        for (int edge = 0; edge < 3; ++edge)
            for (int k = 0; k < 3; ++k) edges[edge][k] = (BLOCK_EDGE - 1) * view.step[edge][k];
        PossibleStates states = view.bound(position, edges);
        if (marks) states.free = states.surface = states.hidden = true;
        return states;
    }
    // Update each voxel by its pixel, and clear its mark. `sight` is the center of the first voxel from the camera,
    // along the world's axes, and `position` in the camera frame [m].
    inline Summary update(const BlockView& view, const float* sight, const float* position) const {
        const PossibleStates states = bound(view, position);
        if (states.all_measured && !states.surface) return update(view, states.free);
        const Summary summary = states.all_inside ? update<true>(view, states, sight, position)
                                                  : update<false>(view, states, sight, position);
        if (marks) __builtin_memset(marks, 0, BLOCK_SIZE);
        return summary;
    }
    template <bool INSIDE>
    inline Summary update(const BlockView& view, const PossibleStates& states, const float* sight,
                          const float* position) const {
        const Floats y = __builtin_convertvector(Lanes::index() / BLOCK_EDGE, Floats);
        const Floats z = __builtin_convertvector(Lanes::index() % BLOCK_EDGE, Floats);
        Floats first[3];  // positions of the first two rows
        for (int k = 0; k < 3; ++k) first[k] = position[k] + y * view.step[1][k] + z * view.step[2][k];
        Summary summary;
        for (int offset = 0; offset < BLOCK_SIZE; offset += LANES) {
            const Shorts old = load(offset);
            if (!view.may_change(old, states)) {
                summary.add(old);
                continue;
            }
            const float i = offset / (BLOCK_EDGE * BLOCK_EDGE), j = offset / BLOCK_EDGE % BLOCK_EDGE;
            Floats place[3];
            for (int k = 0; k < 3; ++k) place[k] = first[k] + (i * view.step[0][k] + j * view.step[1][k]);
            const Points along = {Lanes::all(sight[0] + i * view.cell), y * view.cell + (sight[1] + j * view.cell),
                                  z * view.cell + sight[2]};
            const Ints marked = marks ? PixelLanes::load(marks + offset, LANES) != 0 : Lanes::all_ints(0);
            const Judgment judged = view.judge<INSIDE>(Points{place[0], place[1], place[2]}, along, marked);
            update(view, offset, judged, &summary);
        }
        return summary;
    }
};
