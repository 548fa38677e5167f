// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
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
