// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Round solids: their analytic surface is rendered if the camera is outside.
//
// All computations are in the frame of the unit solid: the object's frame, with x, y and z divided by three sizes.
// There the solid is the unit ball, or the part of the infinite unit cylinder about z at most `half` from the middle,
// or the same with unit balls around the centers of its ends. From a camera at o, the ray in direction d is at o + z d
// at depth z; w = 1 / z.
//
// A ray intersects a unit ball about 0 where C w^2 - 2 B w + A = 0, with A = d.d, B = -o.d and C = o.o - 1. The
// discriminant B^2 - A C is a small difference near the outline; it equals A - e.e with e = o x d. Like d, e is linear
// in the pixel coordinates, and its terms are small relative to a pixel near the object's center, so single precision
// suffices at each pixel if the coefficients are computed in double precision. If the camera almost touches the ball, C
// is small, as are both terms of the first form, which is then more accurate. The cylinder is the same without z.

#pragma once

#include "cuda/image.h"

// Factors that cover rounding: of the reach of a solid, and of the ends of its side.
constexpr float REACH_SLACK = 1.001f, SIDE_SLACK = 1e-6f;
// A smaller C means that the camera almost touches a ball or a side.
constexpr float SMALL_C = 0.1f;
// The square root of smaller values is slow, and negligible.
constexpr float MIN_ROOT = 1e-30f;
// From the first pixel of a block to its center.
constexpr float HALF_BLOCK_WIDTH = 0.5f * (BLOCK_WIDTH - 1), HALF_BLOCK_HEIGHT = 0.5f * (BLOCK_HEIGHT - 1);

// A solid in the frame of the unit solid.
struct UnitSolid {
    // The axes of a pose divided by the sizes: they transform vectors into the frame of the unit solid, and gradients
    // out of it.
    static inline void axes(const float* pose, const float* size, Vec3d* axis) {
        PoseRow::axes(pose, axis);
        for (int i = 0; i < 3; ++i) axis[i] = Vec3d::times(axis[i], 1.0 / __ldg(size + i));
    }
    static inline Vec3d inside(const Vec3d* axis, Vec3d v) {
        return Vec3d{Vec3d::dot(axis[0], v), Vec3d::dot(axis[1], v), Vec3d::dot(axis[2], v)};
    }

    static inline double across(Vec3d o) { return __fma_rn(o.x, o.x, __dmul_rn(o.y, o.y)); }

    // Whether the camera is outside a solid. All code that depends on this must call this function.
    static inline bool outside(int kind, double half, Vec3d o) {
        const double beyond = fmax(fabs(o.z) - half, 0.0);
        return kind == SOLID_CYLINDER ? across(o) > 1.0 || beyond > 0.0 : __fma_rn(beyond, beyond, across(o)) > 1.0;
    }

    // Height of the center of the ball or flat end that a part belongs to.
    static inline double middle(int kind, double half, double origin_z, int part) {
        if (kind == SOLID_BALL) return 0.0;
        return part == PART_LOWER || (kind == SOLID_CYLINDER && origin_z < 0.0) ? -half : half;
    }

    // Outward gradient of a part where a ray in direction d intersects it, not normalized.
    static inline Vec3d gradient(int kind, double half, Vec3d o, Vec3d d, int part) {
        if (kind == SOLID_CYLINDER && part != PART_SIDE) return Vec3d{0.0, 0.0, o.z < 0.0 ? -1.0 : 1.0};
        if (kind != SOLID_BALL && part == PART_SIDE)
            o.z = d.z = 0.0;
        else
            o.z -= middle(kind, half, o.z, part);
        const double a = Vec3d::dot(d, d), b = -Vec3d::dot(o, d), c = Vec3d::dot(o, o) - 1.0;
        const double z = c / (b + sqrt(fmax(b * b - a * c, 0.0)));
        return Vec3d{o.x + z * d.x, o.y + z * d.y, o.z + z * d.z};
    }
};

// A solid, set up for a view, in shared memory.
struct alignas(16) Solid {
    enum { FEW_BLOCKS = 4 };  // up to this many blocks, testing which may show the solid takes as long as rendering

    // Linear in the pixel coordinates: the ray's direction, z of e, and B of the side.
    Linear dx, dy, dz, ez, toward;
    float inverse;  // 1 / C of the side, 0 if the camera is inside the infinite cylinder
    float small_c;  // C of the side if it is small, else 0

    struct End {
        Linear ex, ey;  // of e, relative to the center of the end
        float z;  // of the camera, relative to that center
        float inverse;  // factor of w: 1 / C of a ball, -1 / z of a flat end, 0 if that faces away
        float small_c;  // C of a ball if it is small, else 0
    } ends[2];

    float reach;  // square of the greatest distance of the solid from its center, with a margin
    float low, high;  // ends of the side
    float z;  // of the camera
    float x, y;  // anchor: the pixel of the view relative to which coordinates are given
    int kind;
    int first_id;

    // Find the pixel that shows an object's center, or the closest one; for points, that image point, relative to the
    // principal point. It depends only on the view and the object.
    inline void find_anchor(const Camera& camera, Vec3 middle) {
        const float depth = Vec3::dot(camera.to_camera[2], middle), inv_z = depth > 0.0f ? __frcp_rn(depth) : 0.0f;
        if (POINTS) {  // the size of pixels differs between packets
            x = fmaxf(fminf(__fmul_rn(Vec3::dot(camera.to_camera[0], middle), inv_z), camera.last_x), -camera.last_x);
            y = fmaxf(fminf(__fmul_rn(Vec3::dot(camera.to_camera[1], middle), inv_z), camera.last_y), -camera.last_y);
            return;
        }
        // Centers are often projected to the center of a pixel or to a boundary between pixels, as in the middle of a
        // view: this offset avoids both, where rounding errors could change the pixel.
        const float rounding_offset = 0.8125f;
        x = floorf(__fmaf_rn(Vec3::dot(camera.to_camera[0], middle), inv_z, rounding_offset - camera.first_u));
        y = floorf(__fmaf_rn(Vec3::dot(camera.to_camera[1], middle), inv_z, rounding_offset - camera.first_v));
        x = fmaxf(fminf(x, camera.last_x), 0.0f);
        y = fmaxf(fminf(y, camera.last_y), 0.0f);
    }

    // Set up a lane's solid; returns false if the camera is not outside.
    inline bool set_up(const Camera& camera, const float* pose, int solid_kind, const float* size, int id) {
        kind = solid_kind, first_id = id;
        const double half = __ldg(size + 3);
        const Vec3d offset = Vec3d::minus(camera.exact_origin, PoseRow::position(pose));
        Vec3d axis[3];
        UnitSolid::axes(pose, size, axis);
        const Vec3d o = UnitSolid::inside(axis, offset);
        if (!UnitSolid::outside(kind, half, o)) return false;
        find_anchor(camera, Vec3d::times(offset, -1.0).rounded());
        const double end = UnitSolid::middle(kind, half, o.z, PART_UPPER), above = o.z - end, below = o.z + end;
        set_inverses(UnitSolid::across(o) - 1.0, above, below, fabs(o.z) > half);
        set_sides((float)o.z, (float)half);
        set_reach((float)half);
        const Vec3d right = UnitSolid::inside(axis, camera.exact_rays[0]),
                    down = UnitSolid::inside(axis, camera.exact_rays[1]);
        const Vec3d forward = UnitSolid::inside(axis, camera.exact_rays[2]);
        const double u = (double)x + (POINTS ? 0.0f : camera.first_u), v = (double)y + (POINTS ? 0.0f : camera.first_v);
        const Vec3d center = {__fma_rn(u, right.x, __fma_rn(v, down.x, forward.x)),
                              __fma_rn(u, right.y, __fma_rn(v, down.y, forward.y)),
                              __fma_rn(u, right.z, __fma_rn(v, down.z, forward.z))};
        set_column(&Linear::u, o, above, below, right);
        set_column(&Linear::v, o, above, below, down);
        set_column(&Linear::one, o, above, below, center);
        return true;
    }
    inline void set_inverses(double side, double above, double below, bool beyond) {
        inverse = side > 0.0 ? __frcp_rn((float)side) : 0.0f;
        small_c = small_or_0((float)side);
        ends[0].z = (float)above;
        ends[1].z = (float)below;
        if (kind == SOLID_CYLINDER) {
            ends[0].inverse = beyond ? __frcp_rn((float)-above) : 0.0f;
        } else {
            set_ball(ends[0], (float)__fma_rn(above, above, side));
            set_ball(ends[1], (float)__fma_rn(below, below, side));
        }
    }
    static inline float small_or_0(float c) { return c > 0.0f && c < SMALL_C ? c : 0.0f; }
    static inline void set_ball(End& end, float c) {
        end.inverse = __frcp_rn(c);
        end.small_c = small_or_0(c);
    }
    inline void set_sides(float origin_z, float half) {
        z = origin_z;
        // Leave no gap between the side and a visible flat end, whatever the rounding.
        const bool end = kind == SOLID_CYLINDER && ends[0].inverse != 0.0f;
        const float margin = end ? __fmul_rn(SIDE_SLACK, fabsf(z) + half) : 0.0f;
        low = -half - (z < 0.0f ? margin : 0.0f);
        high = half + (z < 0.0f ? 0.0f : margin);
    }
    inline void set_reach(float half) {
        const float ends = kind == SOLID_CAPSULE ? half + 1.0f : half;
        reach = REACH_SLACK * __fmaf_rn(ends, ends, kind == SOLID_CYLINDER ? 1.0f : 0.0f);
        if (kind == SOLID_BALL) reach = REACH_SLACK;
    }
    // Set the coefficients of u, of v, or the constants; d is the matching component of the direction.
    inline void set_column(float Linear::* column, Vec3d o, double above, double below, Vec3d d) {
        dx.*column = (float)d.x;
        dy.*column = (float)d.y;
        dz.*column = (float)d.z;
        ez.*column = (float)__fma_rn(o.x, d.y, -__dmul_rn(o.y, d.x));
        toward.*column = (float)-__fma_rn(o.x, d.x, __dmul_rn(o.y, d.y));
        ends[0].ex.*column = (float)__fma_rn(o.y, d.z, -__dmul_rn(above, d.y));
        ends[0].ey.*column = (float)__fma_rn(above, d.x, -__dmul_rn(o.x, d.z));
        ends[1].ex.*column = (float)__fma_rn(o.y, d.z, -__dmul_rn(below, d.y));
        ends[1].ey.*column = (float)__fma_rn(below, d.x, -__dmul_rn(o.x, d.z));
    }

    // Discriminant of the quadratic equation, from A, A - e.e and B.
    static inline float discriminant(float a, float difference, float b, float small_c) {
        return small_c > 0.0f ? __fmaf_rn(b, b, -__fmul_rn(a, small_c)) : difference;
    }
    // w where a ray intersects a ball or cylinder; 0 if it misses.
    static inline float meet(float b, float discriminant, float inverse) {
        const float w = __fmul_rn(b + __fsqrt_rn(fmaxf(discriminant, MIN_ROOT)), inverse);
        return discriminant >= 0.0f && b > 0.0f ? w : 0.0f;
    }

    // w where the ray of a pixel first intersects the solid, and the part; 0 if it misses.
    inline float at(float u, float v, int& part) const {
        const float to_x = dx.at(u, v), to_y = dy.at(u, v), to_z = dz.at(u, v), e_z = ez.at(u, v), b = toward.at(u, v);
        const float a = __fmaf_rn(to_x, to_x, __fmul_rn(to_y, to_y));
        const float difference = __fmaf_rn(-e_z, e_z, a);
        part = PART_SIDE;
        if (kind == SOLID_BALL) return ball(ends[0], u, v, to_z, a, difference, b);
        const float end_w = kind == SOLID_CYLINDER && ends[0].inverse != 0.0f ? flat(ends[0], u, v, to_z) : 0.0f;
        const float w = meet(b, discriminant(a, difference, b, small_c), inverse), height = __fmaf_rn(z, w, to_z);
        const bool within = w > 0.0f && height >= __fmul_rn(low, w) && height <= __fmul_rn(high, w);
        if (kind == SOLID_CYLINDER) {
            if (end_w > 0.0f) part = PART_UPPER;
            return end_w > 0.0f ? end_w : within ? w : 0.0f;
        }
        // Where the ray enters the infinite cylinder decides which part it hits: the end through which it enters, if
        // not the side.
        const bool to_end = !within && (w > 0.0f || inverse == 0.0f);
        if (!Warp::any(to_end)) return within ? w : 0.0f;
        const bool lower = (inverse == 0.0f ? z : height) < 0.0f;
        if (to_end) part = lower ? PART_LOWER : PART_UPPER;
        const float ball_w = ball(ends[lower], u, v, to_z, a, difference, b);
        return within ? w : to_end ? ball_w : 0.0f;
    }
    static inline float ball(const End& end, float u, float v, float to_z, float a, float difference, float side_b) {
        const float e_x = end.ex.at(u, v), e_y = end.ey.at(u, v), b = __fmaf_rn(-end.z, to_z, side_b);
        const float ball_difference = __fmaf_rn(-e_x, e_x, __fmaf_rn(-e_y, e_y, __fmaf_rn(to_z, to_z, difference)));
        return meet(b, discriminant(__fmaf_rn(to_z, to_z, a), ball_difference, b, end.small_c), end.inverse);
    }
    static inline float flat(const End& end, float u, float v, float to_z) {
        const float e_x = end.ex.at(u, v), e_y = end.ey.at(u, v);
        const bool inside = __fmaf_rn(e_x, e_x, __fmul_rn(e_y, e_y)) <= __fmul_rn(to_z, to_z);
        return inside ? __fmul_rn(to_z, end.inverse) : 0.0f;
    }

    // Change of a linear function from the center of a block to its pixels, and its greatest and least magnitude there.
    static inline float spread(const Linear& l) {
        return __fmaf_rn(HALF_BLOCK_WIDTH, fabsf(l.u), HALF_BLOCK_HEIGHT * fabsf(l.v));
    }
    static inline float max_magnitude(const Linear& l, float u, float v) { return fabsf(l.at(u, v)) + spread(l); }
    static inline float min_magnitude(const Linear& l, float u, float v) {
        return fmaxf(fabsf(l.at(u, v)) - spread(l), 0.0f);
    }
    static inline Linear between(const Linear& a, const Linear& b) {
        return Linear{0.5f * (a.u + b.u), 0.5f * (a.v + b.v), 0.5f * (a.one + b.one)};
    }

    // Mask of blocks with rays that may intersect the infinite cylinder and the bounding ball of the solid, one block
    // per lane. Conservative with respect to rounding.
    inline unsigned blocks_met(const Packet& packet, unsigned blocks) const {
        const int lane = Warp::lane();
        const float u = SmallInt::to_float(packet.first_x + Packet::block_x(lane)) - x + HALF_BLOCK_WIDTH;
        const float v = SmallInt::to_float(packet.first_y + Packet::block_y(lane)) - y + HALF_BLOCK_HEIGHT;
        const float to_x = max_magnitude(dx, u, v), to_y = max_magnitude(dy, u, v), to_z = max_magnitude(dz, u, v);
        const float e_x = min_magnitude(between(ends[0].ex, ends[1].ex), u, v),
                    e_y = min_magnitude(between(ends[0].ey, ends[1].ey), u, v);
        const float e_z = min_magnitude(ez, u, v), side = to_x * to_x + to_y * to_y;
        bool meets = e_x * e_x + e_y * e_y + e_z * e_z <= reach * (side + to_z * to_z);
        if (kind != SOLID_BALL) {
            meets &= e_z * e_z <= REACH_SLACK * side;
            if (inverse > 0.0f) meets &= toward.at(u, v) + REACH_SLACK * spread(toward) > 0.0f;
        }
        return blocks & Warp::ballot(meets);
    }

    // Image coordinates of this lane's ray of a block, relative to the anchor.
    inline ImagePoint from_anchor(const Camera& camera, const Packet& packet, int block) const {
        const int lane = Warp::lane();
        if (RAY_TABLE) {
            const ImagePoint p = packet.point(camera, 0, 0, Packet::index(block, lane));
            if (POINTS) return ImagePoint{p.u - x, p.v - y};
            return ImagePoint{p.u - (x + camera.first_u), p.v - (y + camera.first_v)};
        }
        const float u0 = SmallInt::to_float(packet.first_x + Packet::pixel_x(lane)) - x,
                    v0 = SmallInt::to_float(packet.first_y + Packet::pixel_y(lane)) - y;
        return ImagePoint{u0 + SmallInt::to_float(Packet::block_x(block)),
                          v0 + SmallInt::to_float(Packet::block_y(block))};
    }

    // Render the solid into blocks of pixels. It is not clipped: points nearer than the near plane are so only by
    // rounding.
    inline void render(const Camera& camera, Packet& packet, unsigned blocks) const {
        const int lane = Warp::lane();
        const float clip_inv_z = camera.near.max_inv_z(MAX_INV_Z);
        if (!RAY_TABLE && __popc(blocks) > FEW_BLOCKS) blocks = blocks_met(packet, blocks);
        for (; blocks; blocks = Warp::without_first_lane(blocks)) {
            const int block = Warp::first_lane(blocks);
            int part;
            const ImagePoint p = from_anchor(camera, packet, block);
            const float w = at(p.u, p.v, part);
            Key* stored = packet.at(Packet::index(block, lane));
            const Key key = DepthKey::of(fminf(w, clip_inv_z), first_id + part);
            Key nearest = *stored;
            if (w > 0.0f && key > nearest) *stored = nearest = key;
            const unsigned min_bits = Warp::reduce_min(DepthKey::inv_z_bits(nearest));
            if (lane == block) packet.block_min_inv_z = min_bits;
        }
    }
};
