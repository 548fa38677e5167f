// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Images of bundles of a ray table.

#pragma once

#include "cpu/table_job.h"

// Writes the results of a bundle's rays to their pixels, packet by packet.
template <RayKind KIND>
struct TableWriter {
    Writer writer;
    const Job& table;  // size of the image, and range
    const RayTree& tree;
    long long first;  // index of the view's first pixel

    inline void tiles(int groups) {
        const bool depth_only = writer.mode == MODE_DEPTH && writer.out.depth && !writer.out.points;
        for (int group = 0; group < groups; ++group) {
            const float* bounds = tree.bounds_of_tiles(group);
            for (int tile = 0; tile < LANES; ++tile) {
                const int index = group * LANES + tile;
                if (tree.corner[index] >= 0 && depth_only)
                    depth_blocks(index);
                else if (tree.corner[index] >= 0)
                    blocks(index);
                else if (bounds[tile] <= bounds[2 * LANES + tile])
                    packets(index);
            }
        }
    }

    inline InRange range_of(int packet, Floats inv_z, Floats z) const {
        const Floats along = KIND == ORIGIN_RAYS ? z - Lanes::load(tree.origins.begin + packet * LANES) : z;
        const Floats depth = tree.scale ? along * Lanes::load(tree.scale + packet * LANES) : along;
        return InRange::of(inv_z, depth, table.near, table.far);
    }
    inline void resolve(int packet, Hits& hits) {
        const Images& out = writer.out;
        const Floats inv_z = Lanes::load(writer.image.inv_z + packet * LANES), z = 1.0f / inv_z;
        const InRange range = range_of(packet, inv_z, z);
        hits.depth = range.depth;
        if (out.points) hits.point = points(packet, range, z);
        if (writer.mode == MODE_DEPTH) return;
        const Ints id = Lanes::load(writer.image.id + packet * LANES);
        if (writer.mode == MODE_TRIANGLES && out.normals) hits.normal = normals(packet, id, range.seen);
        if (out.segmentation || out.labels) hits.object = writer.objects(id, range.seen);
    }
    inline Points points(int packet, const InRange& range, Floats z) const {
        const auto rays = RayLanes<KIND>::packet(tree, packet);
        const Rays& basis = writer.rays;
        Points point = range.along(basis.at(rays.u, rays.v), z, writer.camera.origin);
        if constexpr (KIND == ORIGIN_RAYS) {
            point.x += rays.p * basis.right[0] + rays.q * basis.down[0];
            point.y += rays.p * basis.right[1] + rays.q * basis.down[1];
            point.z += rays.p * basis.right[2] + rays.q * basis.down[2];
        }
        return point;
    }
    // Normals; with distinct origins, they are flipped toward the origin of each ray, which may see another side than
    // the eye does.
    inline Points normals(int packet, Ints id, Ints seen) {
        if constexpr (KIND != ORIGIN_RAYS)
            return writer.normals(id, seen, tree.exact_us(packet), tree.exact_vs(packet));
        const auto rays = RayLanes<KIND>::packet(tree, packet);
        const Points n = writer.triangle_normals(id, Lanes::bits(seen));
        const Ints faces_away = Points::dot(n, writer.rays.at(rays.u, rays.v)) > Lanes::all(0.0f);
        return Points::select(faces_away, Points{-n.x, -n.y, -n.z}, n);
    }

    // Write a tile of the image if only depth is requested.
    inline void depth_blocks(int tile) const {
        float* target = writer.out.depth + (first + tree.corner[tile]);
        const float near = table.near, far = table.far;
        const float* source = writer.image.inv_z + tile * (LANES * LANES);
        const float* scale = tree.scale ? tree.scale + tile * (LANES * LANES) : nullptr;
        const float* begin = KIND == ORIGIN_RAYS ? tree.origins.begin + tile * (LANES * LANES) : nullptr;
        const int width = table.width;
        for (int y = 0; y < BLOCKS_ACROSS; ++y) {
            Floats inv_z[BLOCK_SIDE], factor[BLOCK_SIDE], first[BLOCK_SIDE];
            Blocks::transpose(source + y * (BLOCKS_ACROSS * LANES), inv_z);
            if (scale) Blocks::transpose(scale + y * (BLOCKS_ACROSS * LANES), factor);
            if constexpr (KIND == ORIGIN_RAYS) Blocks::transpose(begin + y * (BLOCKS_ACROSS * LANES), first);
            for (int r = 0; r < BLOCK_SIDE; ++r, target += width) {
                const Floats z = KIND == ORIGIN_RAYS ? 1.0f / inv_z[r] - first[r] : 1.0f / inv_z[r];
                Write::stream(target, InRange::of(inv_z[r], scale ? z * factor[r] : z, near, far).depth);
            }
        }
    }

    // Write a tile of the image, four rows of pixels at a time, with whole cache lines that bypass the caches.
    inline void blocks(int tile) {
        const Images& out = writer.out;
        for (int y = 0; y < TILE_SIDE; y += BLOCK_SIDE) {
            Hits hits[BLOCKS_ACROSS];
            for (int x = 0; x < BLOCKS_ACROSS; ++x)
                resolve(tile * TILE_BLOCKS + y / BLOCK_SIDE * BLOCKS_ACROSS + x, hits[x]);
            const long long offset = first + tree.corner[tile] + (long long)y * table.width;
            Floats rows[3][BLOCK_SIDE];
            if (out.depth) {
                transpose(&hits[0].depth, rows[0]);
                for (int r = 0; r < BLOCK_SIDE; ++r) Write::stream(out.depth + offset + r * table.width, rows[0][r]);
            }
            if (out.points) rows_of(out.points + offset * 3, &hits[0].point, rows);
            if (writer.mode == MODE_DEPTH) continue;
            if (writer.mode == MODE_TRIANGLES && out.normals) rows_of(out.normals + offset * 3, &hits[0].normal, rows);
            if (!(out.segmentation || out.labels)) continue;
            transpose((const Floats*)&hits[0].object, rows[0]);
            for (int r = 0; r < BLOCK_SIDE; ++r) {
                const Ints object = (Ints)rows[0][r];
                if (out.segmentation) Write::stream(out.segmentation + offset + r * table.width, object);
                if (out.labels) Writer::labels(out.labels + offset + r * table.width, out.object_label, object, LANES);
            }
        }
        if (writer.mode == MODE_TRIANGLES && out.faces) face_blocks(tile);
    }

    // Write the faces of both kinds of tiles, separately because they are rarely requested.
    inline void face_blocks(int tile) {
        int* target = writer.out.faces + (first + tree.corner[tile]);
        for (int y = 0; y < BLOCKS_ACROSS; ++y) {
            int side_by_side[BLOCKS_ACROSS * BLOCK_PIXELS];
            for (int x = 0; x < BLOCKS_ACROSS; ++x)
                Lanes::store(side_by_side + x * BLOCK_PIXELS, faces(tile * TILE_BLOCKS + y * BLOCKS_ACROSS + x));
            Ints rows[BLOCK_SIDE];
            Blocks::transpose(side_by_side, rows);
            for (int r = 0; r < BLOCK_SIDE; ++r, target += table.width) Write::stream(target, rows[r]);
        }
    }
    inline void face_packets(int tile) {
        const float* bounds = tree.bounds_of_packets(tile);
        for (int child = 0; child < LANES; ++child) {
            const int packet = tile * LANES + child;
            if (bounds[child] <= bounds[2 * LANES + child])
                Write::put((float*)writer.out.faces + first, tree.place + packet * LANES, tree.run[packet],
                           (Floats)faces(packet));
        }
    }
    inline Ints faces(int packet) {
        const Floats inv_z = Lanes::load(writer.image.inv_z + packet * LANES);
        const Ints seen = range_of(packet, inv_z, 1.0f / inv_z).seen;
        return writer.faces(Lanes::load(writer.image.id + packet * LANES), seen);
    }

    // Convert the blocks of adjacent `Hits` to rows of pixels.
    static inline void transpose(const Floats* block, Floats* rows) {
        float side_by_side[BLOCKS_ACROSS * BLOCK_PIXELS];
        for (int x = 0; x < BLOCKS_ACROSS; ++x) {
            Lanes::store(side_by_side + x * BLOCK_PIXELS, *block);
            block = (const Floats*)((const char*)block + sizeof(Hits));
        }
        Blocks::transpose(side_by_side, rows);
    }
    inline void rows_of(float* to, const Points* block, Floats (*rows)[BLOCK_SIDE]) const {
        transpose(&block->x, rows[0]);
        transpose(&block->y, rows[1]);
        transpose(&block->z, rows[2]);
        for (int r = 0; r < BLOCK_SIDE; ++r)
            Write::row(to + 3LL * r * table.width, Points{rows[0][r], rows[1][r], rows[2][r]}, LANES);
    }

    // Write a tile whose packets are not blocks of the image, packet by packet.
    inline void packets(int tile) {
        const float* bounds = tree.bounds_of_packets(tile);
        for (int child = 0; child < LANES; ++child) {
            if (bounds[child] > bounds[2 * LANES + child]) continue;
            const int packet = tile * LANES + child;
            Hits hits;
            resolve(packet, hits);
            writer.put(hits, first, tree.place + packet * LANES, tree.run[packet]);
        }
        if (writer.mode == MODE_TRIANGLES && writer.out.faces) face_packets(tile);
    }
};
