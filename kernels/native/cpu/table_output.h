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
    const TableJob& table;
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

    // Depth, and a mask of rays with a hit in range.
    struct InRange {
        Floats depth;
        Ints seen;
    };
    static inline InRange in_range(Floats inv_z, Floats depth, float near, float far) {
        const Floats infinity = Lanes::all(__builtin_inff());
        const Ints far_enough = depth >= Lanes::all(near);
        const Ints seen = far_enough & (depth <= Lanes::all(far)) & (inv_z > Lanes::all(0.0f));
        return InRange{seen ? depth : (far_enough ? infinity : -infinity), seen};
    }

    // Results of the rays of a packet.
    struct Row {
        Floats depth;
        Points point, normal;
        Ints object;
    };
    inline InRange range_of(int packet, Floats inv_z, Floats z) const {
        const Floats along = KIND == ORIGIN_RAYS ? z - Lanes::load(tree.origins.begin + packet * LANES) : z;
        const Floats depth = tree.scale ? along * Lanes::load(tree.scale + packet * LANES) : along;
        return in_range(inv_z, depth, table.near, table.far);
    }
    inline void resolve(int packet, Row& row) {
        const Images& out = writer.out;
        const Floats inv_z = Lanes::load(writer.image.inv_z + packet * LANES), z = 1.0f / inv_z;
        const InRange range = range_of(packet, inv_z, z);
        const Ints seen = range.seen;
        row.depth = range.depth;
        if (out.points) row.point = points(packet, seen ? z : Lanes::all(__builtin_nanf("")));
        if (writer.mode == MODE_DEPTH) return;
        const Ints id = Lanes::load(writer.image.id + packet * LANES);
        if (writer.mode == MODE_TRIANGLES && out.normals) row.normal = normals(packet, id, seen);
        if (out.segmentation || out.labels) row.object = writer.objects(id, seen);
    }
    inline Points points(int packet, Floats reach) const {
        const Rays& rays = writer.rays;
        const float* origin = writer.camera.origin;
        const Floats u = Lanes::load(tree.u + packet * LANES), v = Lanes::load(tree.v + packet * LANES);
        Floats position[3];
        for (int k = 0; k < 3; ++k)
            position[k] = reach * (u * rays.right[k] + (v * rays.down[k] + rays.forward[k])) + origin[k];
        if constexpr (KIND == ORIGIN_RAYS) {
            const Floats p = Lanes::load(tree.origins.p + packet * LANES),
                         q = Lanes::load(tree.origins.q + packet * LANES);
            for (int k = 0; k < 3; ++k) position[k] += p * rays.right[k] + q * rays.down[k];
        }
        return Points{position[0], position[1], position[2]};
    }
    inline Points normals(int packet, Ints id, Ints seen) {
        if constexpr (KIND == ORIGIN_RAYS) return toward(packet, writer.triangle_normals(id, Lanes::bits(seen)));
        if (!writer.lookup.moving) return writer.triangle_normals(id, Lanes::bits(seen));
        Points round = {Lanes::all(0.0f), Lanes::all(0.0f), Lanes::all(0.0f)};
        const Ints solid = writer.lookup.solid_normals(id, seen, tree.exact_us(packet), tree.exact_vs(packet), round);
        const Points n = writer.triangle_normals(id, Lanes::bits(seen & ~solid));
        return Points{solid ? round.x : n.x, solid ? round.y : n.y, solid ? round.z : n.z};
    }

    // Flip normals toward the origins of the rays, which may see another side than the eye does.
    inline Points toward(int packet, Points n) const {
        const Rays& rays = writer.rays;
        const Floats u = Lanes::load(tree.u + packet * LANES), v = Lanes::load(tree.v + packet * LANES);
        Floats ray[3];
        for (int k = 0; k < 3; ++k) ray[k] = u * rays.right[k] + (v * rays.down[k] + rays.forward[k]);
        const Ints faces_away = Points::dot(n, Points{ray[0], ray[1], ray[2]}) > Lanes::all(0.0f);
        return Points{faces_away ? -n.x : n.x, faces_away ? -n.y : n.y, faces_away ? -n.z : n.z};
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
                Write::stream(target, in_range(inv_z[r], scale ? z * factor[r] : z, near, far).depth);
            }
        }
    }

    // Write a tile of the image, four rows of pixels at a time, with whole cache lines that bypass the caches.
    inline void blocks(int tile) {
        const Images& out = writer.out;
        for (int y = 0; y < TILE_SIDE; y += BLOCK_SIDE) {
            Row row[BLOCKS_ACROSS];
            for (int x = 0; x < BLOCKS_ACROSS; ++x)
                resolve(tile * TILE_BLOCKS + y / BLOCK_SIDE * BLOCKS_ACROSS + x, row[x]);
            const long long offset = first + tree.corner[tile] + (long long)y * table.width;
            Floats rows[3][BLOCK_SIDE];
            if (out.depth) {
                transpose(&row[0].depth, rows[0]);
                for (int r = 0; r < BLOCK_SIDE; ++r) Write::stream(out.depth + offset + r * table.width, rows[0][r]);
            }
            if (out.points) rows_of(out.points + offset * 3, &row[0].point, rows);
            if (writer.mode == MODE_DEPTH) continue;
            if (writer.mode == MODE_TRIANGLES && out.normals) rows_of(out.normals + offset * 3, &row[0].normal, rows);
            if (!(out.segmentation || out.labels)) continue;
            transpose((const Floats*)&row[0].object, rows[0]);
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

    // Convert the blocks of adjacent `Row`s to rows of pixels.
    static inline void transpose(const Floats* block, Floats* rows) {
        float side_by_side[BLOCKS_ACROSS * BLOCK_PIXELS];
        for (int x = 0; x < BLOCKS_ACROSS; ++x) {
            Lanes::store(side_by_side + x * BLOCK_PIXELS, *block);
            block = (const Floats*)((const char*)block + sizeof(Row));
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
        const Images& out = writer.out;
        const float* bounds = tree.bounds_of_packets(tile);
        for (int child = 0; child < LANES; ++child) {
            if (bounds[child] > bounds[2 * LANES + child]) continue;
            const int packet = tile * LANES + child, run = tree.run[packet];
            const int* place = tree.place + packet * LANES;
            Row row;
            resolve(packet, row);
            if (out.depth) Write::put(out.depth + first, place, run, row.depth);
            if (out.points) Write::put(out.points + first * 3, place, row.point);
            if (writer.mode == MODE_DEPTH) continue;
            if (writer.mode == MODE_TRIANGLES && out.normals) Write::put(out.normals + first * 3, place, row.normal);
            if (out.segmentation) Write::put((float*)out.segmentation + first, place, run, (Floats)row.object);
            if (!out.labels) continue;
            unsigned char label[LANES];
            Writer::labels(label, out.object_label, row.object, LANES);
            for (int lane = 0; lane < LANES; ++lane)
                if (place[lane] >= 0) out.labels[first + place[lane]] = label[lane];
        }
        if (writer.mode == MODE_TRIANGLES && out.faces) face_packets(tile);
    }

    // Write pixels without a ray as empty.
    static inline void empty(const TableJob& table, const Images& out, long long first) {
        const float nothing = __builtin_nanf("");
        for (int i = 0; i < table.without_rays; ++i) {
            const long long offset = first + table.without_ray[i];
            if (out.depth) out.depth[offset] = __builtin_inff();
            for (int k = 0; k < 3; ++k) {
                if (out.points) out.points[offset * 3 + k] = nothing;
                if (out.normals) out.normals[offset * 3 + k] = nothing;
            }
            if (out.segmentation) out.segmentation[offset] = -1;
            if (out.faces) out.faces[offset] = -1;
            if (out.labels) out.labels[offset] = LABEL_EMPTY;
        }
    }
};
