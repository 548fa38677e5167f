# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that C++ and Python share: made of native/shared/constants.h by scripts/generate_constants.py."""

# Kinds of solids, whose true surface rays meet: `warpvis.scene.solids.SolidKind`.
SOLID_NONE = 0
SOLID_BALL = 1
SOLID_CYLINDER = 2
SOLID_CAPSULE = 3

# Parts of a solid's surface.
PART_SIDE = 0  # of a cylinder or a capsule; all of a ball
PART_UPPER = 1  # the upper half ball of a capsule; of a cylinder, the flat end that faces the camera
PART_LOWER = 2  # the lower half ball of a capsule
SOLID_PARTS = 3

# What a pixel or a point shows: `warpvis.Label`.
LABEL_EMPTY = 0
LABEL_GROUND = 1
LABEL_OBSTACLE = 2
LABEL_OBJECT = 3
LABEL_HUMAN = 4
LABEL_ROBOT = 5

# Whether a point can be seen: `warpvis.Visibility`.
POINT_OUT_OF_VIEW = 0
POINT_TOO_NEAR = 1
POINT_TOO_FAR = 2
POINT_OCCLUDED = 3
POINT_VISIBLE = 4
POINT_UNKNOWN = 5

# Why a sensor has no depth of a pixel: `warpvis.sensors.Reason`.
REASON_VALID = 0
REASON_EMPTY = 1
REASON_RANGE = 2
REASON_SHADOW = 3
REASON_BAND = 4
REASON_EDGE = 5
REASON_GRAZING = 6
REASON_DROPOUT = 7
REASON_SATURATED = 8

# What random numbers are for: each purpose has a stream of its own.
STREAM_DISPARITY = 1
STREAM_DROPOUT = 2
STREAM_RANGE = 3
STREAM_ACROSS = 10  # which column's surface a pixel shows
STREAM_DOWN = 11  # and which row's
STREAM_DEPTH = 12
STREAM_RECTANGLES = 13
STREAM_ADDED = 14
STREAM_MULTIPLIED = 15
STREAM_LOST = 16
STREAM_PARAMETERS = 17  # of a view's own sensor

# Counters that the CPU workers of a job share.
COUNTER_NEXT_UNIT = 0  # of work
COUNTER_ENTERED = 1  # workers
COUNTER_FINISHED = 2  # workers
COUNTER_DONE = 3  # units of work
JOB_COUNTERS = 4

# Counters of an object's silhouette in a view. A box is least x and y, and greatest x and y, all as codes that are
# greater the farther out: coordinates from BOX_MIDDLE up or down, so that 0 stands for an empty box.
VISIBLE_PIXELS = 0
IMAGE_PIXELS = 1
SILHOUETTE_PIXELS = 2
TOO_NEAR_PIXELS = 3
TOO_FAR_PIXELS = 4
VISIBLE_BOX = 5
SILHOUETTE_BOX = 9
SILHOUETTE_COUNTERS = 13
BOX_MIDDLE = 1 << 24

# What masks of silhouettes hold.
MASK_HIDDEN = 1
MASK_VISIBLE = 2

# Lengths of rows in memory, in numbers of four bytes.
POSE_WORDS = 7  # x y z qx qy qz qw
BOX_WORDS = 6  # least x y z, greatest x y z
SOLID_WORDS = 4  # factors along x, y and z, and half length before them

# A BVH as casters read it: rows of as many numbers as there are lanes.
CPU_LANES = 16  # triangles of a leaf and children of a node, one for each SIMD lane
CUDA_LANES = 32  # one for each thread of a warp
LEAF_ROWS = 9  # corners: ax ay az bx by bz cx cy cz
NODE_ROWS = 10  # of each child, its box and the cone of its normals
NODE_LOW_ROW = 0
NODE_HIGH_ROW = 3
CONE_AXIS_ROW = 6
CONE_CUTOFF_ROW = 9

# What the builder of a BVH works with, in numbers of four bytes.
ITEM_WORDS = 8  # a triangle
SPLIT_WORDS = 4  # a node of the binary tree while ranges are split
BINARY_WORDS = 6  # the same while nodes are made of it, and a cost for each lane besides
HALVING_DEPTH = 64  # from here on ranges are halved, so that no input makes a deep tree

# An image on CPU cores, and the points that are sorted into it.
BLOCK_SIDE = 4  # pixels: a block fills a register
TILE_SIDE = 16  # pixels: a tile is 4 x 4 blocks
POINT_CHUNK_BITS = 13
POINT_CHUNK = 1 << 13  # points that are projected at a time

# Where nothing is: beyond every coordinate, and nearer, as 1 / z, than any surface.
NOWHERE = 3e38

# A box may be anywhere in the image from where its nearest corner is no farther than this part of the sum of its
# terms.
BOX_CROSSING_SHARE = 0.02

# How much rounding of a box may be wrong, in pixels: a little,
BOX_SLACK = 0.01

# and so many times what it may move a corner.
BOX_SLACK_BLURS = 256.0

# From this depth of half a box on, as a part of its middle's, its bounds in the image are worth a look at each corner.
DEEP_SHARE = 0.03

# How much rounding of other boxes may be wrong, in pixels: a little, but more than of a triangle,
SMALL_BOX_SLACK = 0.003

# and so many times what it may move a corner.
SMALL_BOX_SLACK_BLURS = 16.0
