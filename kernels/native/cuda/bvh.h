// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The packet caster on CUDA: a warp traverses the BVH with a packet, PACKET_WIDTH x PACKET_HEIGHT pixels of a view.
//
// Coordinates are the camera's, with x and y scaled by the focal lengths: the ray of a pixel is (u, v, 1), where u and
// v are its distances in pixels from the principal point. The edge functions of a triangle, whose signs give the side
// on which the ray passes, and 1 / z of the triangle's plane are then linear in u and v.
//
// An edge function and 1 / z evaluate to the same value for a pixel in every packet, so an image does not depend on the
// packet size. If rounding leaves the sign of an edge function uncertain, it is evaluated in double precision
// (shared/edges.h), so that no ray slips between triangles.
//
// The variant of a kernel: constants that kernels/casting/packets_cuda.py defines before these headers.
//
//     PACKET_WIDTH, PACKET_HEIGHT   pixels of a packet
//     LEVELS                        greatest depth of a tree, in levels of nodes
//     CACHED_NUMBERS                trees with more numbers prefetch leaves
//     TILE_BITS, MAX_TILES          of `FoundObjects`
//     WITH_ID                       whether objects or normals may be requested
//     MOVABLE, RESIZED              whether objects may move, and may have the sizes of `Worlds`
//     CLIPS                         whether the near plane removes surfaces instead of letting them occlude others
//     IS_TABLE                      whether rays are those of a ray table
//     RAY_TABLE                     whether rays may miss the centers of their pixels: rays of a table, or points
//     POINT_BLOCKS                  blocks of rays that are anywhere in the image of a packet; 0 if each has a pixel
//     RAY_ORIGINS                   whether rays have distinct origins

#pragma once

#include "cuda/lanes.h"
#include "shared/pose.h"

// A or B.
template <bool IS_FIRST>
struct Select {
    template <class A, class B>
    using Type = A;
};
template <>
struct Select<false> {
    template <class A, class B>
    using Type = B;
};

enum {
    LEAF_WORDS = LEAF_ROWS * LANES,
    NODE_WORDS = NODE_ROWS * LANES,
    // 8x4 pixels, or the whole packet if that is smaller.
    BLOCK_WIDTH_BITS = (PACKET_WIDTH >= 2) + (PACKET_WIDTH >= 4) + (PACKET_WIDTH >= 8),
    BLOCK_HEIGHT_BITS = (PACKET_HEIGHT >= 2) + (PACKET_HEIGHT >= 4),
    BLOCK_WIDTH = 1 << BLOCK_WIDTH_BITS,  // pixels
    BLOCK_HEIGHT = 1 << BLOCK_HEIGHT_BITS,
    BLOCK_PIXELS = BLOCK_WIDTH * BLOCK_HEIGHT,
    BLOCK_COLUMNS = PACKET_WIDTH / BLOCK_WIDTH,
    BLOCK_ROWS = PACKET_HEIGHT / BLOCK_HEIGHT,
    BLOCKS = BLOCK_COLUMNS * BLOCK_ROWS,
    PIXELS = BLOCKS * LANES,
    // Contents of a z-buffer: pixels, or points of an image in their own blocks (points.h).
    POINTS = POINT_BLOCKS > 0,
    SLOT_BLOCKS = POINTS ? (int)POINT_BLOCKS : (int)BLOCKS,
    SLOTS = SLOT_BLOCKS * LANES,
};
static_assert((int)BLOCK_WIDTH * BLOCK_HEIGHT <= (int)LANES, "each lane rasterizes one pixel of a block");
static_assert(!POINTS || RAY_TABLE, "points are not at pixel centers");
static_assert((int)BLOCKS <= (int)LANES, "lane b holds the state of block b");
static_assert(PACKET_WIDTH % BLOCK_WIDTH == 0 && PACKET_HEIGHT % BLOCK_HEIGHT == 0,
              "a packet consists of whole blocks");

// Upper limit of 1 / z: nearer surfaces are clamped to it.
constexpr float MAX_INV_Z = 3e37f;

// Factor that covers the rounding error of 1 / z.
constexpr float NEARER = 1.00003f;

struct Bvh {
    const float* leaves;  // [leaf][LEAF_ROWS][lane]
    const int* owners;  // [leaf][lane]: object of a triangle; its complement if the object is closed
    const float* nodes;  // [node][NODE_ROWS][lane]
    const int* children;  // [node][lane]: index of a node, or the complement of the index of a leaf
    int root;
    int first_id;  // number of a triangle minus its slot in the leaves
    bool all_closed;  // whether every object is closed
    bool is_large;  // whether the leaves exceed the GPU's cache: they are prefetched before they are read
    const unsigned char* excluded;  // [object]: whether the view excludes it; null if the view excludes none

    static inline int object_of(int owner) { return owner < 0 ? ~owner : owner; }
    // The nine coordinates of the triangle in a slot, one per row from this address.
    inline const float* corners(unsigned slot) const {
        return leaves + (long long)(slot / LANES) * LEAF_WORDS + slot % LANES;
    }
};

// The near plane, which removes surfaces nearer than it if it CLIPS, and lets them occlude others otherwise.
struct NearPlane {
    float clip_inv_z;  // limit of 1 / z for visible surfaces
    float reach;  // greatest distance from the eye of the plane's corners or, if they are distinct, of ray origins

    // Whether the plane may clip a surface whose greatest 1 / z is max_inv_z; and whether a point of it remains
    // visible.
    inline bool cuts(float max_inv_z) const { return CLIPS && max_inv_z > clip_inv_z; }
    inline bool shows(float inv_z, bool cut) const { return !CLIPS || !cut || inv_z <= clip_inv_z; }
    inline float max_inv_z(float endless) const { return CLIPS ? clip_inv_z : endless; }
    // Coordinates of a box, moved by `reach`: the near plane clips no box that the eye is beyond, and all ray origins
    // are outside that box.
    inline float below(float value) const { return CLIPS || RAY_ORIGINS ? value - reach : value; }
    inline float above(float value) const { return CLIPS || RAY_ORIGINS ? value + reach : value; }
};
static_assert(!(CLIPS && RAY_ORIGINS), "there is one reach");

struct Box {
    // A coordinate of the box of an object that may be stretched.
    static inline float side(const float* value, float factor) {
        return RESIZED ? __fmul_rn(__ldg(value), factor) : __ldg(value);
    }
    static inline Vec3 corner(const float* values, Vec3 by) {
        return Vec3{side(values, by.x), side(values + 1, by.y), side(values + 2, by.z)};
    }
    // Whether a camera is inside a box (least and greatest corner), or so close to it that the near plane may cut the
    // box.
    static inline bool holds(const float* box, Vec3 by, Vec3 p, NearPlane near) {
        return p.x >= near.below(side(box, by.x)) && p.x <= near.above(side(box + 3, by.x)) &&
               p.y >= near.below(side(box + 1, by.y)) && p.y <= near.above(side(box + 4, by.y)) &&
               p.z >= near.below(side(box + 2, by.z)) && p.z <= near.above(side(box + 5, by.z));
    }
};

// A point whose coordinates are stored in rows with one number per lane.
struct Place {
    static inline Vec3 load(const float* source) {
        return Vec3{__ldg(source), __ldg(source + LANES), __ldg(source + 2 * LANES)};
    }
};

// A value that is linear in u and v.
struct Linear {
    float u, v, one;

    inline float at(float at_u, float at_v) const { return __fmaf_rn(u, at_u, __fmaf_rn(v, at_v, one)); }
};

// Image coordinates of a ray.
struct alignas(8) ImagePoint {
    float u, v;
};
struct ExactImagePoint {
    double u, v;
};

// Three coordinates in double precision.
struct Vec3d {
    double x, y, z;

    static inline Vec3d of(const float* p, int stride) { return Vec3d{p[0], p[stride], p[2 * stride]}; }
    static inline Vec3d minus(Vec3d a, Vec3d b) { return Vec3d{a.x - b.x, a.y - b.y, a.z - b.z}; }
    static inline double dot(Vec3d a, Vec3d b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
    static inline Vec3d cross(Vec3d a, Vec3d b) {
        return Vec3d{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    }
    static inline Vec3d times(Vec3d a, double by) { return Vec3d{a.x * by, a.y * by, a.z * by}; }
    inline Vec3 rounded() const { return Vec3{(float)x, (float)y, (float)z}; }

    // Normal of a triangle, not normalized.
    static inline Vec3d normal(const float* corners) {
        const Vec3d a = of(corners, LANES);
        return cross(minus(of(corners + 3 * LANES, LANES), a), minus(of(corners + 6 * LANES, LANES), a));
    }
};

static_assert(sizeof(Vec3d) == 3 * sizeof(double), "rows of axes are read as numbers");

// A row x y z qx qy qz qw of an array of poses.
struct PoseRow {
    // The x, y and z axes of the frame in parent coordinates, in double precision.
    static inline void axes(const float* row, Vec3d* axis) {
        const double x = __ldg(row + 3), y = __ldg(row + 4), z = __ldg(row + 5), w = __ldg(row + 6);
        const double two = 2.0 / (x * x + y * y + z * z + w * w);  // normalizes the quaternion
        Pose::axes_of(x, y, z, w, two, (double (*)[3])axis);
    }
    static inline Vec3d position(const float* row) { return Vec3d{__ldg(row), __ldg(row + 1), __ldg(row + 2)}; }
    // A direction, rotated from the frame into parent coordinates.
    static inline Vec3d rotated_out(const Vec3d* axis, Vec3d v) {
        return Vec3d{axis[0].x * v.x + axis[1].x * v.y + axis[2].x * v.z,
                     axis[0].y * v.x + axis[1].y * v.y + axis[2].y * v.z,
                     axis[0].z * v.x + axis[1].z * v.y + axis[2].z * v.z};
    }
};
