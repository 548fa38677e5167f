// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Constants shared by C++ and Python, defined only here. scripts/generate_constants.py generates kernels/constants.py
// from this file; it reads one NAME = NUMBER per line.

#pragma once

// Kinds of solids, whose analytic surface is intersected: `warpvis.scene.solids.SolidKind`.
enum SolidKind {
    SOLID_NONE = 0,
    SOLID_BALL = 1,
    SOLID_CYLINDER = 2,
    SOLID_CAPSULE = 3,
};

// Parts of a solid's surface.
enum SolidPart {
    PART_SIDE = 0,  // of a cylinder or a capsule; the whole surface of a ball
    PART_UPPER = 1,  // the upper hemisphere of a capsule; of a cylinder, the flat end that faces the camera
    PART_LOWER = 2,  // the lower hemisphere of a capsule
    SOLID_PARTS = 3,
};

// Label of a pixel or a point: `warpvis.Label`.
enum Label {
    LABEL_EMPTY = 0,
    LABEL_GROUND = 1,
    LABEL_OBSTACLE = 2,
    LABEL_OBJECT = 3,
    LABEL_HUMAN = 4,
    LABEL_ROBOT = 5,
};

// Visibility of a point: `warpvis.Visibility`.
enum Visibility {
    POINT_OUT_OF_VIEW = 0,
    POINT_TOO_NEAR = 1,
    POINT_TOO_FAR = 2,
    POINT_OCCLUDED = 3,
    POINT_VISIBLE = 4,
    POINT_UNKNOWN = 5,
};

// Measured depth compared with expected depth: `warpvis.maps.Agreement`.
enum Agreement {
    DEPTH_NO_MEASUREMENT = 0,
    DEPTH_AGREES = 1,
    DEPTH_NEARER = 2,
    DEPTH_FARTHER = 3,
    DEPTH_NO_SURFACE = 4,
};

// Why a sensor reports no depth at a pixel: `warpvis.sensors.Reason`.
enum Reason {
    REASON_VALID = 0,
    REASON_EMPTY = 1,
    REASON_RANGE = 2,
    REASON_SHADOW = 3,
    REASON_BAND = 4,
    REASON_EDGE = 5,
    REASON_GRAZING = 6,
    REASON_DROPOUT = 7,
    REASON_SATURATED = 8,
};

// Random streams, one for each purpose.
enum RandomStream {
    STREAM_DISPARITY = 1,
    STREAM_DROPOUT = 2,
    STREAM_RANGE = 3,
    STREAM_POWER = 4,  // noise of received power
    STREAM_FALSE_RETURN = 5,  // whether a lidar has a return from a drop
    STREAM_FALSE_RANGE = 6,  // range of that return
    STREAM_RINGS = 7,  // range error of a ring
    STREAM_ACROSS = 10,  // column offset of the surface that a pixel shows
    STREAM_DOWN = 11,  // row offset of that surface
    STREAM_DEPTH = 12,
    STREAM_RECTANGLES = 13,
    STREAM_ADDED = 14,
    STREAM_MULTIPLIED = 15,
    STREAM_LOST = 16,
    STREAM_PARAMETERS = 17,  // sensor parameters drawn for each view
    STREAM_LEARNED = 18,  // noise that a learned model reads
};

// Counters that the CPU workers of a job share.
enum JobCounter {
    COUNTER_NEXT_UNIT = 0,  // next unit of work
    COUNTER_ENTERED = 1,  // workers that entered
    COUNTER_FINISHED = 2,  // workers that finished
    COUNTER_DONE = 3,  // finished units of work
    JOB_COUNTERS = 4,
};

// Counters of an object's silhouette in a view. A box is least x and y, then greatest x and y, encoded as distances
// outward from BOX_MIDDLE, so that every entry is a maximum and 0 stands for an empty box.
enum SilhouetteCounter {
    VISIBLE_PIXELS = 0,
    IMAGE_PIXELS = 1,
    SILHOUETTE_PIXELS = 2,
    TOO_NEAR_PIXELS = 3,
    TOO_FAR_PIXELS = 4,
    VISIBLE_BOX = 5,
    SILHOUETTE_BOX = 9,
    SILHOUETTE_COUNTERS = 13,
    BOX_MIDDLE = 1 << 24,
};

// Counters of a target, one or several objects, in a view: of samples, then of pixels, and how often adjacent samples
// differ. The box is encoded as those of `SilhouetteCounter`.
enum FractionCounter {
    VISIBLE_SAMPLES = 0,
    IMAGE_SAMPLES = 1,
    SILHOUETTE_SAMPLES = 2,
    TOO_NEAR_SAMPLES = 3,
    TOO_FAR_SAMPLES = 4,
    FRACTION_BOX = 5,  // of pixels with a visible sample
    VISIBLE_CENTERS = 9,  // pixels whose center shows the target
    SILHOUETTE_CENTERS = 10,
    STATE_EDGES = 11,  // pairs of adjacent samples of different states: outside, hidden, visible
    SILHOUETTE_EDGES = 12,  // pairs of which one is outside
    SAMPLES_ACROSS = 13,  // samples along the side of a pixel
    FRACTION_COUNTERS = 14,
};

// Limits of the samples of a target.
enum FractionLimit {
    MAX_SAMPLES_ACROSS = 63,  // along the side of a pixel; odd, so that one is at the pixel's center
};

// Values in silhouette masks.
enum MaskValue {
    MASK_HIDDEN = 1,
    MASK_VISIBLE = 2,
};

// Lengths of rows in memory, in four-byte words.
enum Layout {
    POSE_WORDS = 7,  // x y z qx qy qz qw
    BOX_WORDS = 6,  // least x y z, greatest x y z
    SOLID_WORDS = 4,  // factors along x, y and z, and the unscaled half length
};

// Layout of a BVH: rows with one number per lane.
enum BvhLayout {
    CPU_LANES = 16,  // triangles of a leaf and children of a node, one per SIMD lane
    CUDA_LANES = 32,  // one per thread of a warp
    LEAF_ROWS = 9,  // corners: ax ay az bx by bz cx cy cz
    NODE_ROWS = 10,  // of each child, its bounding box and the cone of its normals
    NODE_LOW_ROW = 0,
    NODE_HIGH_ROW = 3,
    CONE_AXIS_ROW = 6,
    CONE_CUTOFF_ROW = 9,
};

// Records of the BVH builder, in four-byte words.
enum BvhBuilder {
    ITEM_WORDS = 8,  // a triangle
    SPLIT_WORDS = 4,  // a node of the binary tree during splitting
    BINARY_WORDS = 6,  // a node of the binary tree during collapsing, without its LANES costs
    HALVING_DEPTH = 64,  // ranges at this depth or deeper are halved, which bounds the depth of the tree
};

// Blocks and tiles of an image on the CPU, and chunks of points that are sorted into it.
enum CpuImage {
    BLOCK_SIDE = 4,  // pixels: a block fills a SIMD register
    TILE_SIDE = 16,  // pixels: a tile is 4 x 4 blocks
    POINT_CHUNK_BITS = 13,
    POINT_CHUNK = 1 << 13,  // points projected at a time
};

// Blocks of an occupancy map, and stored values of voxels that were not measured, less than all log-odds.
enum OccupancyBlock {
    VOXEL_BLOCK_SIDE = 8,  // voxels along an edge
    VOXEL_BLOCK_SIZE = 512,  // voxels
    VOXEL_NEVER_SEEN = -32768,
    VOXEL_HIDDEN = -32767,
};

// Marks empty entries: beyond every coordinate and, as 1 / z, nearer than any surface.
constexpr float NOWHERE = 3e38f;

// Rays with distinct origins are cast in packets on the CPU if the origins of a table, or those of a moving sensor's
// bundle, extend at most this far along an axis [m],
constexpr float CPU_MAX_ORIGIN_EXTENT = 0.5f;

// and if those of a packet are at most this far from their middle, on average [m]. Packets of a finer scene would else
// test most of its triangles.
constexpr float CPU_MAX_SPREAD = 0.04f;

// A box is treated as covering the whole image if the depth of its nearest corner is at most this fraction of the sum
// of the magnitudes of its terms.
constexpr float BOX_CROSSING_SHARE = 0.02f;

// Margin of a box in the image for rounding, in pixels: the constant part,
constexpr float BOX_SLACK = 0.01f;

// and the multiple of `blur`, the distance by which rounding may move a corner.
constexpr float BOX_SLACK_BLURS = 256.0f;

// A box is projected corner by corner if its depth extent exceeds this fraction of the depth of its center.
constexpr float DEEP_SHARE = 0.03f;

// The same margin for boxes that are not projected corner by corner: larger than the margin of a triangle,
constexpr float SMALL_BOX_SLACK = 0.003f;

// and the multiple of `blur`.
constexpr float SMALL_BOX_SLACK_BLURS = 16.0f;
