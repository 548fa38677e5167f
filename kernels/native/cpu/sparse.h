// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rays through arbitrary points of the image instead of pixel centers. The image's blocks of 4 x 4 pixels become cells
// that hold the points inside them, in packets of LANES points, each with its own u and v. A cell without points
// occludes everything, so that the traversal skips geometry that no point can see.

#pragma once

#include "cpu/output.h"

// Occlusion of world points in double precision, for cases that single precision cannot decide.
struct ExactOcclusion {
    const float* place;  // [point]: x y z
    Pose pose;
    double focal[2], tolerance;

    // Whether a triangle's plane intersects a point's ray in front of the point by more than the tolerance.
    inline bool hides(const Camera& camera, const float* corners, int lane, int point) const {
        const double position[3] = {place[point * 3LL], place[point * 3LL + 1], place[point * 3LL + 2]};
        double seen[3], ray[3];  // in the camera frame, and in the frame of the triangle
        pose.transform_into(position, seen);
        const double distance = __builtin_sqrt(seen[0] * seen[0] + (seen[1] * seen[1] + seen[2] * seen[2]));
        const ExactRow* m = camera.exact_to_camera;
        for (int k = 0; k < 3; ++k)
            ray[k] = seen[0] * focal[0] * m[0][k] + (seen[1] * focal[1] * m[1][k] + seen[2] * m[2][k]);
        const ExactTriangle t = ExactTriangle::of(camera.exact_origin, corners, lane);
        const double* n = t.normal;
        return t.volume() / (n[0] * ray[0] + (n[1] * ray[1] + n[2] * ray[2])) < 1.0 - tolerance / distance;
    }
};

struct Sparse {
    // Greatest number of lanes of the packets of `points` points in `cells` cells: each cell may leave all but one lane
    // of a packet empty.
    static inline long long max_lanes(long long points, long long cells) {
        return (points + (LANES - 1) * (points < cells ? points : cells)) / LANES * LANES;
    }

    // Sort the points of a strip into cells (counting sort). `pixels` is x y x y ... in pixels of the view.
    static inline void place(const Image& image, const float* pixels, int count, const double* center) {
        const int cells = image.tiles() * TILE_BLOCKS;
        for (int c = 0; c <= cells; ++c) image.first_packet[c] = 0;
        for (int i = 0; i < count; ++i) {
            const int cell = cell_of(image, pixels + 2 * i);
            if (cell >= 0) image.first_packet[cell + 1] += 1;
        }
        for (int c = 0; c < cells; ++c)
            image.first_packet[c + 1] = image.first_packet[c] + (image.first_packet[c + 1] + LANES - 1) / LANES;
        const int lanes = image.first_packet[cells] * LANES;
        for (int i = 0; i < lanes; ++i) {
            image.point_index[i] = -1;
            image.inv_z[i] = NOWHERE;  // an empty lane occludes everything and is never written
            image.point_u[i] = image.point_v[i] = 0.0f;
        }
        for (int i = 0; i < count; ++i) {
            const int cell = cell_of(image, pixels + 2 * i);
            if (cell < 0) continue;
            int lane = image.first_packet[cell] * LANES;
            if (image.point_index[lane] >= 0) lane = next_lane(image, lane);
            image.point_index[lane] = i;
            image.point_u[lane] = (float)(pixels[2 * i] - center[0]);
            image.point_v[lane] = (float)(pixels[2 * i + 1] - center[1]);
            image.inv_z[lane] = 0.0f;
        }
        for (int c = 0; c < cells; ++c)
            image.block_min[c] = image.first_packet[c] < image.first_packet[c + 1] ? 0.0f : NOWHERE;
        for (int tile = 0; tile < image.tiles(); ++tile) {
            image.tile_min[tile] = Lanes::min_of(Lanes::load(image.block_min + tile * TILE_BLOCKS));
            image.tile_stale[tile] = 0;
        }
        __builtin_memset(image.block_stale, 0, cells);
    }

    // The id of a cell's first lane counts the occupied lanes; ids are not needed before rasterization.
    static inline int next_lane(const Image& image, int first) {
        image.id[first] = image.inv_z[first + 1] == NOWHERE ? 1 : image.id[first] + 1;
        return first + image.id[first];
    }

    // -1 for points outside the strip, and for NaN.
    static inline int cell_of(const Image& image, const float* pixel) {
        const float x = pixel[0], y = pixel[1] - (float)image.first_row;
        if (!(x >= 0.0f && x < (float)image.width && y >= 0.0f && y < (float)image.height)) return -1;
        return (Image::column_part((int)x) + image.row_part((int)y)) / BLOCK_PIXELS;
    }

    static inline void rasterize(const Camera& camera, const Image& image, const Triangles& triangles, Ints inexact,
                                 Mode mode) {
        const unsigned rounded = Lanes::bits(inexact);
        for (const int k : Lanes::each(triangles.shown)) {
            const One one = One::of(triangles, k, (rounded >> k) & 1, mode);
            const int ty1 = triangles.y1[k] >> TILE_SHIFT, tx1 = triangles.x1[k] >> TILE_SHIFT;
            for (int ty = triangles.y0[k] >> TILE_SHIFT; ty <= ty1; ++ty)
                for (int tx = triangles.x0[k] >> TILE_SHIFT; tx <= tx1; ++tx)
                    if (image.min_of_tile(ty * image.tiles_x + tx) <= triangles.max_inv_z[k])
                        rasterize_tile(camera, image, one, tx, ty, mode);
        }
    }

    // A triangle of a leaf.
    struct One {
        const Triangles& triangles;
        int k;  // lane
        Linear edge[3];
        float error_bound;
        bool rounded;  // whether single precision does not suffice for inv_z
        int id;

        static inline One of(const Triangles& t, int k, bool rounded, Mode mode) {
            return One{t,
                       k,
                       {Linear::of_lane(t.edge[0], k), Linear::of_lane(t.edge[1], k), Linear::of_lane(t.edge[2], k)},
                       t.error_bound[k],
                       rounded,
                       Raster::id_of(t, k, mode)};
        }
    };

    // Find the cells of a tile that the triangle touches: an edge function is greatest at one of a cell's corners.
    static inline void rasterize_tile(const Camera& camera, const Image& image, const One& one, int tx, int ty,
                                      Mode mode) {
        const float margin = 0.001f, first = 0.5f + margin, side = BLOCK_SIDE + 2 * margin;
        const Floats cell_x = __builtin_convertvector(Grid::block_x(), Floats);
        const Floats cell_y = __builtin_convertvector(Grid::block_y(), Floats);
        const Floats u0 = (cell_x + (float)(tx * TILE_SIDE)) + (camera.first_u - first), u1 = u0 + side;
        const Floats v0 = (cell_y + (float)(ty * TILE_SIDE + image.first_row)) + (camera.first_v - first),
                     v1 = v0 + side;
        const int tile = ty * image.tiles_x + tx;
        Ints touched = Lanes::load(image.block_min + tile * TILE_BLOCKS) <= Lanes::all(one.triangles.max_inv_z[one.k]);
        for (const Linear& edge : one.edge) {
            const Floats u = edge.u >= Lanes::all(0.0f) ? u1 : u0, v = edge.v >= Lanes::all(0.0f) ? v1 : v0;
            touched &= edge.at(u, edge.row(v)) >= Lanes::all(-one.error_bound);
        }
        for (const int k : Lanes::each(touched)) {
            const int cell = tile * TILE_BLOCKS + k;
            for (int packet = image.first_packet[cell]; packet < image.first_packet[cell + 1]; ++packet)
                rasterize_packet(camera, image, one, cell, packet, mode);
        }
    }

    static inline void rasterize_packet(const Camera& camera, const Image& image, const One& one, int cell, int packet,
                                        Mode mode) {
        const Triangles& t = one.triangles;
        const Linear* e = one.edge;
        const Floats u = Lanes::load(image.point_u + packet * LANES), v = Lanes::load(image.point_v + packet * LANES);
        const Floats old = Lanes::load(image.inv_z + packet * LANES), max_inv_z = Lanes::all(t.max_inv_z[one.k]);
        const Floats inner = Lanes::min(e[0].at(u, e[0].row(v)), e[1].at(u, e[1].row(v)), e[2].at(u, e[2].row(v)));
        const Ints visible = old <= max_inv_z, uncertain = visible & Raster::find_uncertain(inner, one.error_bound);
        const Ints inside = visible & (inner > Lanes::all(one.error_bound));
        if (Lanes::any(inside)) rasterize_lanes(camera, image, one, cell, packet, inside, mode);
        if (__builtin_expect(Lanes::any(uncertain), 0))
            rasterize_uncertain(camera, image, one, cell, packet, Lanes::bits(uncertain), mode);
    }

    // Rasterize lanes in which an edge function leaves coverage uncertain.
    static __attribute__((noinline, cold)) void rasterize_uncertain(const Camera& camera, const Image& image,
                                                                    const One& one, int cell, int packet,
                                                                    unsigned uncertain, Mode mode) {
        Ints inside = Lanes::all_ints(0);
        for (const int lane : Lanes::each(uncertain)) {
            const int slot = packet * LANES + lane;
            const double u = image.point_u[slot], v = image.point_v[slot];
            if (Exactly::covers(camera, one.triangles.corners, one.k, u, v)) inside[lane] = -1;
        }
        if (Lanes::any(inside)) rasterize_lanes(camera, image, one, cell, packet, inside, mode);
    }

    // Rasterize lanes that the triangle covers.
    static inline void rasterize_lanes(const Camera& camera, const Image& image, const One& one, int cell, int packet,
                                       Ints inside, Mode mode) {
        const Triangles& t = one.triangles;
        const Floats u = Lanes::load(image.point_u + packet * LANES), v = Lanes::load(image.point_v + packet * LANES);
        const Floats old = Lanes::load(image.inv_z + packet * LANES), max_inv_z = Lanes::all(t.max_inv_z[one.k]);
        const Linear plane = Linear::of_lane(t.inv_z, one.k);
        const Floats min_inv_z = Lanes::all(t.min_inv_z[one.k]);
        Floats inv_z = Lanes::max(Lanes::min(plane.at(u, plane.row(v)), max_inv_z), min_inv_z);
        if (one.rounded && image.id)
            for (const int lane : Lanes::each(inside)) {
                inv_z[lane] = Raster::exact_inv_z(camera, t, one.k, u[lane], v[lane]);
            }
        if (image.occlusion) inside = check(camera, image, one, packet, inside, inv_z);
        if (image.limit) inside &= inv_z <= Lanes::load(image.limit + packet * LANES);
        if (image.id)
            Raster::blend(image, packet, cell, inside, inv_z, one.id, mode);
        else
            settle(image, packet, cell, inside & (inv_z > old));
    }

    // Remove covered lanes whose points the triangle does not occlude, though rounding may suggest it; adjust inv_z in
    // the opposite case. Points that are already occluded are not checked.
    static inline Ints check(const Camera& camera, const Image& image, const One& one, int packet, Ints inside,
                             Floats& inv_z) {
        const Triangles& t = one.triangles;
        const Floats limit = Lanes::load(image.inv_z + packet * LANES);
        Ints uncertain = inside & (limit >= 0.999999f * t.min_inv_z[one.k]);
        if (image.id) uncertain &= Lanes::load(image.id + packet * LANES) < Lanes::all_ints(0);
        if (!one.rounded) uncertain &= Lanes::abs(inv_z - limit) <= 5e-6f * inv_z;
        for (const int lane : Lanes::each(uncertain)) {
            const int point = image.point_index[packet * LANES + lane];
            const bool hides = image.occlusion->hides(camera, t.corners, one.k, point);
            inside[lane] = hides ? -1 : 0;
            if (hides && inv_z[lane] <= limit[lane]) inv_z[lane] = limit[lane] * 1.000001f;
        }
        return inside;
    }

    // These points are occluded: their lanes now occlude everything.
    static inline void settle(const Image& image, int packet, int cell, Ints hit) {
        if (!Lanes::any(hit)) return;
        const Floats old = Lanes::load(image.inv_z + packet * LANES);
        Lanes::store(image.inv_z + packet * LANES, hit ? Lanes::all(NOWHERE) : old);
        image.touch(cell);
    }

    // Write the results of each point to its index among the view's points.
    static inline void write(Writer& writer) {
        const Image& image = writer.image;
        const Job& job = writer.job;
        const long long first = writer.view * job.points;
        const int lanes = image.first_packet[image.tiles() * TILE_BLOCKS] * LANES;
        for (int i = 0; i < lanes; ++i)
            if (image.point_index[i] >= 0)
                write_point(writer, first + image.point_index[i],
                            Ray{image.inv_z[i], image.id[i], image.point_u[i], image.point_v[i]});
        if (image.first_row > 0) return;
        // Points outside the image belong to no strip; the first strip writes them.
        const float* pixels = job.pixels + first * 2;
        for (int i = 0; i < job.points; ++i)
            if (!(pixels[2 * i] >= 0.0f && pixels[2 * i] < (float)job.width && pixels[2 * i + 1] >= 0.0f &&
                  pixels[2 * i + 1] < (float)job.height))
                Writer::put_empty(writer.out, first + i);
    }

    // A point's ray and its hit.
    struct Ray {
        float inv_z;
        int id;
        float u, v;
    };

    static inline void normal_of(Lookup& lookup, const Ray& ray, float* normal) {
        Points round;
        const Doubles at_u = (Doubles)((double)ray.u), at_v = (Doubles)((double)ray.v);
        if (lookup.moving &&
            Lanes::any(lookup.solid_normals(Lanes::all_ints(ray.id), Lanes::all_ints(-1), at_u, at_v, round))) {
            normal[0] = round.x[0];
            normal[1] = round.y[0];
            normal[2] = round.z[0];
        } else {
            lookup.normal_of(ray.id, normal);
        }
    }

    static inline void write_point(Writer& writer, long long place, const Ray& ray) {
        const Images& out = writer.out;
        const Rays& rays = writer.rays;
        const float* origin = writer.camera.origin;
        const float inv_z = ray.inv_z, u = ray.u, v = ray.v, z = 1.0f / inv_z, nothing = __builtin_nanf("");
        const bool near = inv_z > 0.0f && z < writer.job.near;
        const bool seen = inv_z > 0.0f && !near && z <= writer.job.far;
        if (out.depth) out.depth[place] = seen ? z : near ? -__builtin_inff() : __builtin_inff();
        for (int c = 0; c < 3 && out.points; ++c)
            out.points[place * 3 + c] =
                seen ? z * (u * rays.right[c] + (v * rays.down[c] + rays.forward[c])) + origin[c] : nothing;
        if (out.normals) {
            float normal[3] = {nothing, nothing, nothing};
            if (seen) normal_of(writer.lookup, ray, normal);
            for (int c = 0; c < 3; ++c) out.normals[place * 3 + c] = normal[c];
        }
        if (out.faces) out.faces[place] = seen ? writer.face_of(ray.id) : -1;
        const int object = !seen ? -1 : writer.mode == MODE_TRIANGLES ? writer.lookup.object_of(ray.id) : ray.id;
        if (out.segmentation) out.segmentation[place] = object;
        if (out.labels) out.labels[place] = object < 0 ? LABEL_EMPTY : out.object_label[object];
    }
};
