// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Counterpart of ray_raster.h for rays with distinct origins (`RayOrigins`).
//
// A ray (p, q, 0) + z (u, v, 1) has Plücker coordinates with direction d = (u, v, 1) and moment m = (-q, p, u q - v p)
// about the eye. The edge function of an edge from a to b is their side product (a x b) . d + (a - b) . m: its sign
// gives the side on which the ray passes, and its first term is the edge function of a ray from the eye. If N . d is 1
// / z of a plane for a ray from the eye, N . d / (1 - N . (p, q, 0)) is 1 / z for this ray. If that denominator is not
// well above 0 for the whole bundle, a ray may see the other side of the plane than the eye does: such triangles are
// tested in double precision, ray by ray.

#pragma once

#include "cpu/ray_raster.h"

// Rays in lanes: of a packet, one ray in all lanes, or a window of a tile.
struct RayLanes {
    Floats u, v, p, q, w;

    static inline RayLanes of(Floats u, Floats v, Floats p, Floats q) { return RayLanes{u, v, p, q, u * q - v * p}; }
    static inline RayLanes packet(const RayTree& tree, int packet) {
        const int first = packet * LANES;
        return of(Lanes::load(tree.u + first), Lanes::load(tree.v + first), Lanes::load(tree.origins.p + first),
                  Lanes::load(tree.origins.q + first));
    }
    static inline RayLanes ray(const RayTree& tree, int ray) {
        return of(Lanes::all(tree.u[ray]), Lanes::all(tree.v[ray]), Lanes::all(tree.origins.p[ray]),
                  Lanes::all(tree.origins.q[ray]));
    }
    static inline RayLanes window(const RayTree& tree, int corner, int width) {
        return of(RayTree::window(tree.row_u + corner, width), RayTree::window(tree.row_v + corner, width),
                  RayTree::window(tree.origins.row_p + corner, width),
                  RayTree::window(tree.origins.row_q + corner, width));
    }

    inline Floats edge(const Linear& e, const Points& side) const {
        return e.at(u, e.row(v)) + (side.y * p + (side.z * w - side.x * q));
    }
    // Minimum of a triangle's three edge functions: of triangle k for all rays, or of each lane's triangle.
    inline Floats inner(const Triangles& t, int k) const {
        Floats minimum = edge(Linear::of_lane(t.edge[0], k), lane_of(t.side[0], k));
        for (int e = 1; e < 3; ++e)
            minimum = Lanes::min(minimum, edge(Linear::of_lane(t.edge[e], k), lane_of(t.side[e], k)));
        return minimum;
    }
    inline Floats inner(const Triangles& t) const {
        return Lanes::min(edge(t.edge[0], t.side[0]), edge(t.edge[1], t.side[1]), edge(t.edge[2], t.side[2]));
    }
    static inline Points lane_of(const Points& all, int k) {
        return Points{Lanes::all(all.x[k]), Lanes::all(all.y[k]), Lanes::all(all.z[k])};
    }
    inline Floats inv_z(const Linear& plane) const {
        return plane.at(u, plane.row(v)) / (1.0f - (plane.u * p + plane.v * q));
    }
};

// A leaf's triangles relative to the rays of a tile.
struct RayOriginsLeaf : RayLeaf {
    Floats one[3], slack[3];  // edge functions at the middle of the moments, and the bound of their deviation from it
    unsigned uncertain_side;

    explicit inline RayOriginsLeaf(const Triangles& of) : RayLeaf(of) {}

    inline void begin(const Camera& camera, const Image& image, const Visit& visit) {
        const Triangles& t = triangles;
        set(image, visit, 0);
        // Rounding of the corners may rotate the plane of a sliver: then single precision does not suffice for inv_z
        // either.
        const Floats width = t.place[2] - t.place[0], height = t.place[3] - t.place[1];
        const Floats change = Lanes::abs(t.inv_z.u) * width + Lanes::abs(t.inv_z.v) * height;
        inexact = Lanes::bits(t.inexact | (camera.blur * (width + height) * change > 6e-6f * t.min_inv_z * t.area));
        uncertain_side = Lanes::bits(t.uncertain_side);
    }
    inline void set_tile(const RayOrigins& origins, int tile) {
        const Triangles& t = triangles;
        const float* range = origins.range + tile * RayOrigins::RANGE_WORDS;
        const Ints endless = t.place[0] <= Lanes::all(-1e30f);
        const Floats max_inv_z = endless ? Lanes::all(0.0f) : t.max_inv_z,
                     min_inv_z = endless ? Lanes::all(0.0f) : t.min_inv_z;
        const Floats middle = 0.5f * (max_inv_z + min_inv_z), half = 0.50001f * (max_inv_z - min_inv_z);
        for (int k = 0; k < 2; ++k) {
            const Floats shift = range[k] * middle;
            const Floats margin =
                __builtin_fabsf(range[k]) * half + range[k + 3] * max_inv_z + 1e-5f * Lanes::abs(shift);
            Lanes::store(bounds[k], t.place[k] - (shift + margin));
            Lanes::store(bounds[k + 2], t.place[k + 2] - (shift - margin));
        }
        for (int e = 0; e < 3; ++e) {
            const Points& s = t.side[e];
            one[e] = t.edge[e].one + (s.y * range[0] + (s.z * range[2] - s.x * range[1]));
            slack[e] = t.error_bound + 1.0001f * (Lanes::abs(s.y) * range[3] +
                                                  (Lanes::abs(s.z) * range[5] + Lanes::abs(s.x) * range[4]));
        }
    }

    // Triangles that may be visible in a rectangle of the tile.
    inline unsigned touching(const RayBox& box, float min_inv_z) const {
        const Triangles& t = triangles;
        Ints candidates = t.shown & RayTree::overlap(bounds[0], box) & (t.max_inv_z >= Lanes::all(min_inv_z));
        const Floats none = Lanes::all(0.0f);
        Ints inside = Lanes::all_ints(-1);
        for (int e = 0; e < 3; ++e) {
            const Linear edge = {t.edge[e].u, t.edge[e].v, one[e]};
            const Floats u = edge.u >= none ? Lanes::all(box.u1) : Lanes::all(box.u0);
            const Floats v = edge.v >= none ? Lanes::all(box.v1) : Lanes::all(box.v0);
            inside &= edge.at(u, edge.row(v)) >= -slack[e];
        }
        return Lanes::bits(candidates & (inside | t.uncertain_side));
    }
    // Packets of the tile that a triangle may touch.
    inline unsigned touched(int k, const float* bounds) const {
        const Triangles& t = triangles;
        if ((uncertain_side >> k) & 1) return (1u << LANES) - 1;
        Ints touched = Lanes::all_ints(-1);
        for (int e = 0; e < 3; ++e) {
            const float u = t.edge[e].u[k], v = t.edge[e].v[k];
            const Floats at_u = Lanes::load(bounds + (u >= 0.0f ? 2 : 0) * LANES);
            const Floats at_v = Lanes::load(bounds + (v >= 0.0f ? 3 : 1) * LANES);
            touched &= u * at_u + (v * at_v + one[e][k]) >= Lanes::all(-slack[e][k]);
        }
        return Lanes::bits(touched);
    }
};

// Intersection of one ray and one triangle in double precision.
struct ExactRays {
    const Camera& camera;
    const RayTree& tree;
    const Triangles& t;

    inline double u(int ray) const { return (double)tree.u[ray] + tree.rest_u[ray]; }
    inline double v(int ray) const { return (double)tree.v[ray] + tree.rest_v[ray]; }
    inline ExactCorners corners(int k, int ray) const {
        ExactCorners seen = Exactly::corners(camera, t.corners, k);
        const ExactRow* m = camera.exact_to_camera;
        for (int i = 0; i < 3; ++i) {
            const double offset = tree.origins.p[ray] * m[0][i] + tree.origins.q[ray] * m[1][i];
            for (int c = 0; c < 3; ++c) seen.corner[c][i] -= offset;
        }
        return seen;
    }
    __attribute__((noinline, cold)) bool covers(int k, int ray) const {
        double along[3];
        camera.ray_at(u(ray), v(ray), along);
        const ExactCorners seen = corners(k, ray);
        const double volume = seen.volume();
        return !(camera.cull_back_faces && volume > 0.0) && seen.meet(along, volume);
    }
    __attribute__((noinline, cold)) Ints covered(int k, int packet, unsigned uncertain) const {
        Ints inside = Lanes::all_ints(0);
        for (; uncertain; uncertain &= uncertain - 1) {
            const int lane = Lanes::first_lane(uncertain);
            if (covers(k, packet * LANES + lane)) inside[lane] = -1;
        }
        return inside;
    }
    __attribute__((noinline, cold)) float inv_z(int k, int ray) const {
        double along[3], normal[3];
        camera.ray_at(u(ray), v(ray), along);
        const ExactCorners seen = corners(k, ray);
        seen.normal(normal);
        const float inv_z = (float)(ExactCorners::dot(normal, along) / ExactCorners::dot(normal, seen.corner[0]));
        return inv_z < t.min_inv_z[k] ? t.min_inv_z[k] : inv_z > t.max_inv_z[k] ? t.max_inv_z[k] : inv_z;
    }
};

struct OriginRaster : RayDescent<OriginRaster, RayOriginsLeaf> {
    static inline __attribute__((always_inline)) void rasterize(const Camera& camera, const Image& image,
                                                                const Triangles& triangles, const Visit& visit,
                                                                Mode mode) {
        RayOriginsLeaf leaf(triangles);
        leaf.begin(camera, image, visit);
        rasterize_leaf(camera, image, leaf, mode);
    }

    static inline __attribute__((always_inline)) void rasterize_tile(const Camera& camera, const Image& image,
                                                                     RayOriginsLeaf& leaf, int tile, Mode mode) {
        leaf.set_tile(image.tree->origins, tile);
        unsigned candidates = Lanes::bits(leaf.triangles.shown);
        if (leaf.min_size < RayColumns::SMALL_SIDE * image.tree->fit[tile].spacing) {
            const RayColumns columns(image, leaf, tile);
            const unsigned small = columns.small & ~leaf.uncertain_side;
            if (small) rasterize_small(camera, image, leaf, columns, small, mode);
            candidates = columns.larger | (columns.small & leaf.uncertain_side);
        }
        if (candidates) rasterize_in_tile(camera, image, leaf, tile, candidates, mode);
    }

    // Rasterize one triangle in a tile's packets.
    static inline __attribute__((always_inline)) void rasterize_in_packets(const Camera& camera, const Image& image,
                                                                           RayOriginsLeaf& leaf, int k, int tile,
                                                                           Mode mode) {
        const RayTree& tree = *image.tree;
        const Triangles& t = leaf.triangles;
        const int first = tile * LANES;
        unsigned touched = tree.packets_in(image, tile, leaf.box_of(k), t.max_inv_z[k]);
        const float* bounds = tree.bounds_of_packets(tile);
        if (__builtin_popcount(touched) > FEW_PACKETS) {
            touched &= leaf.touched(k, bounds);
            if (!((leaf.uncertain_side >> k) & 1))
                touched &= Lanes::bits(not_hidden(camera, image, leaf, k, first, bounds));
        }
        for (; touched; touched &= touched - 1)
            rasterize_rays(camera, image, leaf, k, first + Lanes::first_lane(touched), mode);
    }
    // Packets in which the triangle's plane may be nearer than the farthest surface rasterized so far.
    static inline Ints not_hidden(const Camera& camera, const Image& image, RayOriginsLeaf& leaf, int k, int first,
                                  const float* bounds) {
        const RayOrigins& origins = image.tree->origins;
        PacketPlanes planes;
        planes.set(camera, leaf.plane(camera, k), bounds);
        const float aside = __builtin_fabsf(planes.u) * origins.max_p + __builtin_fabsf(planes.v) * origins.max_q;
        // `aside` is below 0.5 unless the triangle is in `uncertain_side`: see Setup::find_uncertain_sides.
        const float nearer = 1.0001f / (1.0f - (aside < 0.5f ? aside : 0.5f));
        return Lanes::load(image.block_min + first) <= Lanes::max(planes.nearest, Lanes::all(0.0f)) * nearer;
    }

    // Rasterize small triangles: one register holds all rays that a triangle may touch.
    static inline __attribute__((always_inline)) void rasterize_small(const Camera& camera, const Image& image,
                                                                      RayOriginsLeaf& leaf, const RayColumns& columns,
                                                                      unsigned small, Mode mode) {
        const RayTree& tree = *image.tree;
        const Triangles& t = leaf.triangles;
        const int width = columns.fit.last_column() + 1;
        int column[LANES], row[LANES];
        RayColumns::begin(columns.first_column, columns.fit.last_column(), column);
        RayColumns::begin(columns.first_row, columns.fit.last_row(), row);
        for (; small; small &= small - 1) {
            const int k = Lanes::first_lane(small);
            const RayLanes rays = RayLanes::window(tree, columns.first_ray + row[k] * width + column[k], width);
            const Floats inner = rays.inner(t, k);
            unsigned hits = Lanes::bits(inner >= Lanes::all(-t.error_bound[k]));
            if (!hits) continue;
            const unsigned certain = Lanes::bits(inner > Lanes::all(t.error_bound[k]));
            float inv_z[LANES];
            Lanes::store(inv_z, within(t, k, rays.inv_z(Linear::of_lane(t.inv_z, k))));
            for (; hits; hits &= hits - 1) {
                const int lane = Lanes::first_lane(hits);
                const int ray = columns.first_ray + columns.fit.slot(column[k] + (lane & (RayColumns::SMALL_SIDE - 1)),
                                                                     row[k] + lane / RayColumns::SMALL_SIDE);
                if (t.max_inv_z[k] < image.inv_z[ray]) continue;
                put(camera, image, leaf, k, ray, (certain >> lane) & 1, inv_z[lane], mode);
            }
        }
    }
    static inline Floats within(const Triangles& t, int k, Floats inv_z) {
        return Lanes::max(Lanes::min(inv_z, Lanes::all(t.max_inv_z[k])), Lanes::all(t.min_inv_z[k]));
    }

    // Store a triangle at one of its rays, given 1 / z in single precision.
    static inline __attribute__((always_inline)) void put(const Camera& camera, const Image& image,
                                                          const RayOriginsLeaf& leaf, int k, int ray, bool certain,
                                                          float inv_z, Mode mode) {
        const Triangles& t = leaf.triangles;
        const ExactRays exactly = {camera, *image.tree, t};
        if (!certain && !exactly.covers(k, ray)) return;
        const float value = (((leaf.inexact | leaf.uncertain_side) >> k) & 1) ? exactly.inv_z(k, ray) : inv_z;
        if (value <= image.tree->origins.clip_inv_z[ray])
            Raster::put(image, ray, value, Raster::id_of(t, k, mode), mode);
    }

    // Rasterize all triangles for one ray.
    static inline __attribute__((always_inline)) void rasterize_ray(const Camera& camera, const Image& image,
                                                                    const RayOriginsLeaf& leaf, int ray,
                                                                    unsigned candidates, Mode mode) {
        const Triangles& t = leaf.triangles;
        const RayLanes rays = RayLanes::ray(*image.tree, ray);
        const Floats inner = rays.inner(t);
        unsigned hits = Lanes::bits((inner >= -t.error_bound) | t.uncertain_side) & candidates;
        if (!hits) return;
        const unsigned certain = Lanes::bits(inner > t.error_bound) & ~leaf.uncertain_side;
        const Floats inv_z = Lanes::max(Lanes::min(rays.inv_z(t.inv_z), t.max_inv_z), t.min_inv_z);
        for (; hits; hits &= hits - 1) {
            const int k = Lanes::first_lane(hits);
            put(camera, image, leaf, k, ray, (certain >> k) & 1, inv_z[k], mode);
        }
    }

    // Rasterize one triangle for all rays of a packet.
    static inline __attribute__((always_inline)) void rasterize_rays(const Camera& camera, const Image& image,
                                                                     RayOriginsLeaf& leaf, int k, int packet,
                                                                     Mode mode) {
        const RayTree& tree = *image.tree;
        const Triangles& t = leaf.triangles;
        Ints inside = Lanes::load(image.inv_z + packet * LANES) <= Lanes::all(t.max_inv_z[k]);
        if (__builtin_expect((leaf.uncertain_side >> k) & 1, 0)) {
            for (unsigned remaining = Lanes::bits(inside); remaining; remaining &= remaining - 1)
                put(camera, image, leaf, k, packet * LANES + Lanes::first_lane(remaining), false, 0.0f, mode);
            return;
        }
        const RayLanes rays = RayLanes::packet(tree, packet);
        const Floats inner = rays.inner(t, k);
        const Ints uncertain = inside & Raster::find_uncertain(inner, t.error_bound[k]);
        inside &= inner > Lanes::all(t.error_bound[k]);
        if (__builtin_expect(Lanes::any(uncertain), 0))
            inside |= ExactRays{camera, tree, t}.covered(k, packet, Lanes::bits(uncertain));
        if (!Lanes::any(inside)) return;
        const Floats inv_z = ((leaf.inexact >> k) & 1) ? exact_inv_z(tree, leaf.plane(camera, k), packet)
                                                       : rays.inv_z(Linear::of_lane(t.inv_z, k));
        const Floats value = within(t, k, inv_z);
        inside &= value <= Lanes::load(tree.origins.clip_inv_z + packet * LANES);
        Raster::blend(image, packet, packet, inside, value, Raster::id_of(t, k, mode), mode);
    }
    static inline Floats exact_inv_z(const RayTree& tree, const ExactPlane& plane, int packet) {
        const Doubles p = wide(tree.origins.p, packet), q = wide(tree.origins.q, packet);
        const Doubles inv_z = plane.u * exact_u(tree, packet) + (plane.v * exact_v(tree, packet) + plane.one);
        return __builtin_convertvector(inv_z / (1.0 - (plane.u * p + plane.v * q)), Floats);
    }
    static inline Doubles wide(const float* from, int packet) {
        return __builtin_convertvector(Lanes::load(from + packet * LANES), Doubles);
    }
    static inline Doubles exact_u(const RayTree& tree, int packet) {
        return wide(tree.u, packet) + wide(tree.rest_u, packet);
    }
    static inline Doubles exact_v(const RayTree& tree, int packet) {
        return wide(tree.v, packet) + wide(tree.rest_v, packet);
    }
};
